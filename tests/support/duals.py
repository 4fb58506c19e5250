"""Random loops with dual evidence that SciPy finds: nothing here is of the search in the package.

At each node of the family Q is the observability Gramian, or of a gain the solution of a Riccati
equation, with a little added; its interpolation is the evidence. The worst value is that of
samples.
"""

from fractions import Fraction
from functools import cached_property

import numpy as np
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from polefence.plant.polynomial import Domain
from polefence.proof.claims import EnergyPeak, Gain, Output, Rms, Subject
from polefence.proof.document import Document
from polefence.proof.laws import Evidence, Law
from polefence.proof.plant import Plant
from polefence.proof.ranges import Range

KINDS = ("rms", "energy peak", "gain")
# law, parameters (0: a simplex of three vertices, -1: one vertex)
FORMS = (
    ("fixed", 0),
    ("fixed", 2),
    ("fixed", -1),
    ("scheduled", 0),
    ("scheduled", 2),
    ("polynomial", 0),
    ("polynomial", 1),
    ("measured", 2),
)
n, m, q = 2, 1, 2


def rationals(matrix):
    return [[Fraction(float(x)) for x in row] for row in np.round(matrix, 12)]


class Case:
    """A plant, a law, outputs, and a dual polynomial of a degree."""

    def __init__(self, kind, form, seed=0, degree=4, through=False):
        self.kind, (self.form, count) = kind, form
        random = np.random.default_rng(seed)
        N = {0: 3, -1: 1}.get(count, 2 ** max(count, 0))
        self.on = "box" if count > 0 else "simplex"
        self.domain, self.degree = Domain.of(self.on, N), degree if N > 1 else 0

        def vertices(rows, columns, share=0.05):
            middle = random.normal(size=(rows, columns))
            return np.round(middle + share * random.normal(size=(N, rows, columns)), 3)

        outputs = 1 if kind == "energy peak" else 2
        self.A, self.B, self.E = vertices(n, n), vertices(n, m), vertices(n, q)
        self.A -= np.eye(n) * np.round(2 + np.linalg.eigvals(self.A).real.max(), 3)
        self.C, self.D = vertices(outputs, n), vertices(outputs, m, 0)
        self.F = vertices(outputs, q, 0) * 0.25 * (kind == "gain" and through)
        self.law, own = self._law(random, N, count), []
        self.names = ("a", "b")[: len(self.law.measured)]
        for k, name in enumerate(self.names):
            rows = [[C[k]] for C in self.law.C]
            own.append(Output(rows, [[[Fraction(0)] * m]] * N, name))
        ranges = tuple(Range(Fraction(1), Fraction(2), False, f"p{k}") for k in range(count))
        each = ([rationals(M) for M in own] for own in (self.A, self.B, self.E))
        self.plant = Plant(*each, ranges, "plant", outputs=tuple(own))

    def _law(self, random, N, count):
        def gains(number, columns=n):
            return [rationals(0.1 * random.normal(size=(m, columns))) for _ in range(number)]

        if self.form == "fixed":
            return Law(gains(1))
        if self.form == "scheduled":
            half = 0.2 * random.normal(size=(N, n, n))
            W = [rationals(np.eye(n) + H @ H.T) for H in half]
            return Law(None, W, gains(N), 1)
        powers = ((0, 0), (1, 0), (1, 1)) if count == 2 else ((0,), (1,), (2,))
        if not count:
            powers = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        names, C = ((), ()) if self.form != "measured" else (("a",), random.normal(size=(N, 1, n)))
        degree = max(map(sum, powers))
        K = gains(3, len(names) or n)
        rows = tuple(rationals(np.round(own, 3)) for own in C)
        return Law(K, degree=degree, powers=powers, measured=names, C=rows)

    def gain(self, alpha):
        """K at alpha, in floats."""
        law = self.law
        K, W, Z, C = (np.array(M or [], dtype=float) for M in (law.K, law.W, law.Z, law.C))
        if self.form == "scheduled":
            basis = self.domain.basis(alpha, 1)
            return np.tensordot(basis, Z, 1) @ np.linalg.inv(np.tensordot(basis, W, 1))
        if self.form == "fixed":
            return K[0]
        at = self.domain.coordinates(alpha)
        c = at[1::2] - at[::2] if self.on == "box" else at
        own = sum(np.prod(c ** np.array(e)) * k for e, k in zip(law.powers, K, strict=True))
        return own @ np.tensordot(alpha, C, 1) if len(C) else own

    def loop(self, alpha):
        """A + B K, C + D K, E and F at alpha."""
        each = (self.A, self.B, self.C, self.D, self.E, self.F)
        A, B, C, D, E, F = (np.tensordot(alpha, M, 1) for M in each)
        K = self.gain(alpha)
        return A + B @ K, C + D @ K, E, F

    def value(self, alpha):
        """What is bounded, at alpha."""
        A, Y, E, F = self.loop(alpha)
        if self.kind != "gain":
            return np.sqrt(np.trace(E.T @ solve_continuous_lyapunov(A.T, -Y.T @ Y) @ E))
        s = 1j * np.concatenate([[0], np.geomspace(1e-2, 1e2, 400)])[:, None, None]
        G = Y @ np.linalg.solve(s * np.eye(n) - A, np.broadcast_to(E, (len(s), n, q))) + F
        return max(np.linalg.norm(G, 2, axis=(1, 2)).max(), np.linalg.norm(F, 2))

    def alphas(self, count=30):
        """Corners, and points between."""
        random, sizes = np.random.default_rng(7), self.domain.sizes
        points = [
            np.concatenate([random.dirichlet(np.ones(size)) for size in sizes])
            for _ in range(count)
        ]
        return [*np.eye(len(self.A)), *self.domain.alpha(np.array(points))]

    @cached_property
    def worst(self):
        return max(self.value(alpha) for alpha in self.alphas())

    def evidence(self, slack=0.02):
        """Q at the nodes, with somewhat more than C'C; of a gain at a level somewhat above."""
        nodes = self.domain.nodes(self.degree) if len(self.A) > 1 else np.ones((1, 1))
        found = np.array([self._solved(*self.loop(alpha), slack) for alpha in nodes])
        if len(self.A) > 1:
            found = self.domain.interpolated(found, self.degree)
        return Evidence([rationals((Q + Q.T) / 2) for Q in found], self.degree, dual=True)

    def _solved(self, A, Y, E, F, slack):
        more = slack * np.trace(Y.T @ Y) * np.eye(n)
        if self.kind != "gain":
            return solve_continuous_lyapunov(A.T, -Y.T @ Y - more)
        g = self.worst * (1 + 4 * slack)
        low = np.linalg.inv(g * np.eye(q) - F.T @ F / g)
        high = np.linalg.inv(g * np.eye(len(F)) - F @ F.T / g)
        own = A + E @ low @ F.T @ Y / g
        right = Y.T @ high @ Y + more / (10 * g)
        return -solve_continuous_are(own, np.linalg.cholesky(E @ low @ E.T), -right, np.eye(n))

    def claim(self, level, evidence=None):
        """The claim of a level, a float."""
        evidence = self.evidence() if evidence is None else evidence
        plant, none = self.plant, not np.any(self.F)
        subject = Subject(plant.A, plant.B, plant.E, self.law, evidence, self.on)
        outputs = []
        for k in range(self.C.shape[1]):
            C, D, F = ([rationals(M[k : k + 1]) for M in own] for own in (self.C, self.D, self.F))
            outputs.append(Output(C, D, f"y{k + 1}", () if none else tuple(F)))
        kinds = {"rms": Rms, "energy peak": EnergyPeak, "gain": Gain}
        return kinds[self.kind](subject, tuple(outputs), Fraction(float(level)))

    def document(self, level):
        """A file of the claim."""
        return Document(self.plant, self.law, (self.claim(level),), self.on)
