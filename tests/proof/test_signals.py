"""Claims about signals: matrices against numpy's, brackets on both sides, one fault at a time."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
import pytest

from polefence.plant.polynomial import Domain
from polefence.proof.claims.base import prove
from polefence.proof.claims.energy_peak import EnergyPeak
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.initial_peak import InitialPeak
from polefence.proof.claims.relative_rms import Baseline, RelativeRms, baseline_loop
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.signal import Subject
from polefence.proof.laws import Evidence, Law
from polefence.proof.plant import Output
from polefence.proof.work import FormatError

KINDS = ["rms", "energy", "initial", "gain", "relative"]
# (law, degree of the law, degree of X, elevation, on)
FORMS = [
    ("one", 0, 0, 0, "simplex"),
    ("one", 0, 2, 1, "box"),
    ("corners", 1, 1, 0, "simplex"),
    ("corners", 1, 0, 0, "box"),
    ("own", 1, 0, 1, "simplex"),
    ("own", 2, 0, 0, "box"),
    ("own", 0, 0, 1, "simplex"),
    ("given", 1, 1, 0, "simplex"),
    ("given", 1, 0, 0, "box"),
]


def exact(matrix):
    return [[Fraction(float(x)) for x in row] for row in np.atleast_2d(matrix)]


def several(matrices):
    return [exact(matrix) for matrix in matrices]


def symmetric(random, n):
    half = random.normal(size=(n, n))
    return half + half.T


# --- matrices ------------------------------------------------------------------------------------


class Example:
    """A claim of no meaning, in exact numbers and as functions of alpha in floats."""

    def __init__(self, kind, form, seed=1, constant=False):
        random = np.random.default_rng(seed)
        self.kind, (self.law, self.degree, self.own, self.elevation, on) = kind, form
        n, m, q, N = 2, 2, 2, 4 if on == "box" else 3
        self.domain = Domain.of(on, N)

        def values(rows, columns, degree=1):
            each = random.normal(size=(self.domain.count(degree), rows, columns))
            return np.repeat(each[:1], len(each), axis=0) if constant and degree == 1 else each

        self.A, self.B, self.E = (random.normal(size=(N, n, k)) for k in (n, m, q))
        self.E = values(n, q)
        self.C, self.D, self.F = values(1, n), values(1, m), values(1, q)
        count = self.domain.count(self.degree)
        self.K = random.normal(size=(1 if self.law == "one" else N, m, n))
        self.W = np.array([symmetric(random, n) for _ in range(count)])
        self.Z = random.normal(size=(count, m, n))
        self.X = np.array([symmetric(random, n) for _ in range(self.domain.count(self.own))])
        self.multiple = random.normal(size=1 if self.law == "own" else len(self.X))
        law = Law(several(self.K)) if self.law in ("one", "corners") else None
        law = law or Law(None, several(self.W), several(self.Z), self.degree)
        multiple = tuple(Fraction(float(x)) for x in self.multiple)
        evidence = Evidence(several(self.X), self.own, self.elevation)
        if self.law == "own":
            evidence = Evidence([], 0, self.elevation, multiple)
        elif self.law == "given":
            evidence = replace(evidence, multiple=multiple)
        A, B, E = (several(each) for each in (self.A, self.B, self.E))
        subject = Subject(A, B, E, law, evidence, on)
        output = Output(several(self.C), several(self.D))
        self.level, self.size = Fraction(7, 3), Fraction(5, 7)
        self.claim = getattr(self, f"_{kind}")(subject, output)

    def _rms(self, subject, output):
        return Rms(subject, (output,), self.level, self.size)

    def _energy(self, subject, output):
        return EnergyPeak(subject, (output,), self.level, self.size)

    def _initial(self, subject, output):
        point = (Fraction(1, 3), Fraction(-2))
        return InitialPeak(subject, (output,), self.level, (point,), (Fraction(0), self.size))

    def _gain(self, subject, output):
        return Gain(subject, (replace(output, F=tuple(several(self.F))),), self.level)

    def _relative(self, subject, output):
        random = np.random.default_rng(5)
        count, N = self.domain.count, self.domain.corners
        self.A0, self.E0 = random.normal(size=(N, 3, 3)), random.normal(size=(N, 3, 2))
        self.C0 = random.normal(size=(N, 1, 3))
        self.X0 = np.array([symmetric(random, 3) for _ in range(count(1))])
        self.P0 = np.array([symmetric(random, 3) for _ in range(count(2))])
        baseline = Baseline(
            *(several(each) for each in (self.A0, self.E0, self.C0)),
            Evidence(several(self.X0), 1, 1),
            Evidence(several(self.P0), 2, 0),
        )
        return RelativeRms(subject, (output,), self.level, baseline, self.size)

    def at(self, matrices, alpha, degree=1):
        return np.tensordot(self.domain.basis(alpha, degree), matrices, 1)

    def expected(self, alpha):
        """Every inequality's matrix at alpha, by name."""
        A, B, E, C, D, F = (
            self.at(each, alpha) for each in (self.A, self.B, self.E, self.C, self.D, self.F)
        )
        W, Z = self.at(self.W, alpha, self.degree), self.at(self.Z, alpha, self.degree)
        X = self.at(self.X, alpha, self.own)
        K = self.K[0] if self.law == "one" else Z @ np.linalg.inv(W)
        K = self.at(self.K, alpha) if self.law == "corners" else K
        if self.law == "own":
            X = self.multiple[0] * W
        elif self.law == "given":
            X = W * self.at(self.multiple, alpha, self.own) + W @ X @ W
        N, Y, g, s = (A + B @ K) @ X, (C + D @ K) @ X, float(self.level), float(self.size)
        minus, output = -(N + N.T), lambda g2, Y: np.block([[g2, Y], [Y.T, X]])
        square = np.array([[g * g]])
        if self.kind == "gain":
            corner = np.block([[g * np.eye(2), -F.T], [-F, g * np.eye(1)]])
            side = np.hstack([-E, -Y.T])
            return {"of X": X, "of the gain": np.block([[minus, side], [side.T, corner]])}
        if self.kind == "initial":
            x0, x1, one = np.array([[1 / 3], [-2]]), s * E[:, 1:], np.eye(1)
            return {
                "of the decrease": minus,
                "of point 1": np.block([[one, x0.T], [x0, X]]),
                "of impulse 2": np.block([[one, x1.T], [x1, X]]),
                "of the output": output(square, Y),
            }
        if self.kind == "energy":
            # (g / e)^2 with Y is g^2 with e Y, by diag(e, I) from both sides
            block = output(square / s**2, Y)
            change = np.diag([s, 1, 1])
            return {"of the noise": minus - E @ E.T, "of the output": change @ block @ change}
        found = {"of the noise": minus - s * E @ E.T, "of the output": output(square, Y)}
        if self.kind == "relative":
            A0, E0, C0, X0 = (self.at(m, alpha) for m in (self.A0, self.E0, self.C0, self.X0))
            P0 = self.at(self.P0, alpha, 2)
            found["of the output"] = output(square * (C0 @ P0 @ C0.T), Y)
            found["of the baseline's X"] = X0
            found["of the baseline's decrease"] = -(A0 @ X0 + X0 @ A0.T)
            found["of the baseline's noise"] = A0 @ P0 + P0 @ A0.T + s * E0 @ E0.T
        return found


def points(domain, count=2, seed=0):
    random = np.random.default_rng(seed)
    for _ in range(count):
        shares = [random.dirichlet(np.ones(size)) for size in domain.sizes]
        yield np.concatenate(shares), domain.alpha(np.concatenate(shares))


@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_inequalities_are_those_of_the_theorem(kind, form, constant):
    example = Example(kind, form, constant=constant)
    assert example.claim.subject.sizes == example.domain.sizes
    found = list(example.claim.inequalities())
    for coordinates, alpha in points(example.domain):
        expected = example.expected(alpha)
        assert [each.name for each in found] == list(expected)
        for each in found:
            order = example.domain.monomials(each.degrees[0])
            weights = [np.prod(coordinates ** np.array(e)) for e in order]
            matrices = [np.array(m, dtype=object) for _, m in each.blocks()]
            assert len(matrices) == each.count == len(order)
            value = sum(
                w * (m / 2**400).astype(float) for w, m in zip(weights, matrices, strict=True)
            )
            mine, other = (M / np.linalg.norm(M) for M in (value, expected[each.name]))
            assert mine.shape == (each.size,) * 2
            assert np.allclose(mine, other, atol=1e-11)


def test_degrees_are_the_least_that_are_needed():
    one, own = FORMS[0], FORMS[4]
    assert [i.degrees[0] for i in of(Example("rms", one))] == [2, 2]  # E E'
    assert [i.degrees[0] for i in of(Example("rms", one, constant=True))] == [1, 1]
    assert [i.degrees[0] for i in of(Example("gain", one))] == [1, 1]
    assert [i.degrees[0] for i in of(Example("rms", own))] == [3, 3]
    assert [i.degrees[0] for i in of(Example("relative", one))] == [4, 4, 2, 3, 3]


def of(example):
    return list(example.claim.inequalities())


# --- one state -----------------------------------------------------------------------------------


def first_order(kind, level, X, a=Fraction(2), c=Fraction(3), k=Fraction(1, 2), f=Fraction(0)):
    """x' = -(a + k) x + u + w with u = k x, y = (c - k) x + u: -a and c in the end."""

    def cell(v):
        return [[[Fraction(v)]]]

    subject = Subject(cell(-a - k), cell(1), cell(1), Law(cell(k)), Evidence(cell(X)))
    output = Output(cell(c - k), cell(1))
    if kind == "rms":
        return Rms(subject, (output,), level, Fraction(5))
    if kind == "energy":
        return EnergyPeak(subject, (output,), level, Fraction(7))
    if kind == "initial":
        return InitialPeak(subject, (output,), level, ((Fraction(-5),), (Fraction(4),)))
    if kind == "impulse":
        return InitialPeak(subject, (output,), level, (), (Fraction(-5),))
    if kind == "gain":
        return Gain(subject, (replace(output, F=tuple(cell(f))),), level)
    baseline = Baseline(  # y0 = 2 x0, x0' = -x0 / 4 + w: covariance 5 / (1/2)
        cell(Fraction(-1, 4)), cell(1), cell(2), Evidence(cell(1)), Evidence(cell(10 * WITHIN))
    )
    return RelativeRms(subject, (output,), level, baseline, Fraction(5))


WITHIN, BEYOND = Fraction(99999, 100000), Fraction(100001, 100000)
# square of the least level (its own for a gain), and X that proves it
CLOSED = {
    "rms": (Fraction(5 * 9, 4), Fraction(5, 4)),
    "energy": (Fraction(49 * 9, 4), Fraction(1, 4)),
    "initial": (Fraction(25 * 9), Fraction(25)),
    "impulse": (Fraction(25 * 9), Fraction(25)),
    "gain": (Fraction(9, 4), Fraction(1, 3)),  # X of -2 a X + 1 / g + c^2 X^2 / g = 0
    "relative": (Fraction(5 * 9, 4) / 40, Fraction(5, 4)),
}


def rational_root(x):
    return Fraction(float(x) ** 0.5)


@pytest.mark.parametrize("kind", CLOSED)
def test_first_order_loops_have_their_closed_forms_as_bounds(kind):
    square, X = CLOSED[kind]
    least = rational_root(square)
    for share in (Fraction(1, 50), Fraction(1, 1000)):
        level = least * (1 + share)
        assert prove(first_order(kind, level, X * (1 + share / 3))).proved
    trials = [X * Fraction(k, 100) for k in range(1, 400, 2)]
    trials += [X, *(X * Fraction(100 + s, 100) for s in (-1, 1))]
    assert not any(prove(first_order(kind, least * WITHIN, x)).proved for x in trials)


def test_what_passes_straight_through_adds_to_the_gain():
    for f, least in ((1, Fraction(5, 2)), (-1, Fraction(1))):
        # x' = -2 x + w, y = 3 x + f w: the largest is |3/2 + f| at rest, or |f| at infinity
        args = {"f": Fraction(f)}
        trials = [Fraction(k, 60) for k in range(1, 90)]
        proved = [
            any(prove(first_order("gain", least * share, x, **args)).proved for x in trials)
            for share in (Fraction(101, 100), WITHIN)
        ]
        assert proved == [True, False]


def test_the_oscillator():
    """x'' + 2 z x' + x = w: rms^2 = S / (4 z), peak gain 1 / (2 z sqrt(1 - z^2))."""
    z = 0.2
    A, E, C = np.array([[0, 1.0], [-1, -2 * z]]), np.array([[0], [1.0]]), np.array([[1.0, 0]])
    rms, gain = np.sqrt(3 / (4 * z)), 1 / (2 * z * np.sqrt(1 - z**2))
    covariance = lyapunov(A, 3 * E @ E.T + 1e-7 * np.eye(2))
    subject = loop_of([A], [E], covariance)
    output = Output([exact(C)], [exact(np.zeros(1))])
    bracket(lambda g: Rms(subject, (output,), g, Fraction(3)), rms, 1e-5)
    X = bounded_real(A, E, C, gain * 1.0001)
    bracket(lambda g: Gain(loop_of([A], [E], X), (output,), g), gain, 2e-4)


def bracket(claim, true, tolerance):
    assert prove(claim(Fraction(true * (1 + tolerance)))).proved
    assert not prove(claim(Fraction(true * (1 - 1e-9)))).proved


def lyapunov(A, Q):
    """X with A X + X A' + Q = 0."""
    n = len(A)
    eye = np.eye(n)
    X = np.linalg.solve(np.kron(A, eye) + np.kron(eye, A), -Q.ravel()).reshape(n, n)
    return (X + X.T) / 2


def bounded_real(A, E, C, g, more=1e-9):
    """X of A X + X A' + E E' / g + more I + X C' C X / g = 0, from its Hamiltonian matrix."""
    n = len(A)
    H = np.block([[A.T, C.T @ C / g], [-(E @ E.T / g + more * np.eye(n)), -A]])
    values, vectors = np.linalg.eig(H)
    U = vectors[:, np.argsort(values.real)[:n]]
    X = (U[n:] @ np.linalg.inv(U[:n])).real
    return (X + X.T) / 2


def loop_of(As, Es, X, on="simplex"):
    """A loop without inputs, and one Lyapunov matrix."""
    n, N = len(As[0]), len(As)
    B, K = [exact(np.zeros((n, 1)))] * N, [exact(np.zeros((1, n)))]
    return Subject(several(As), B, several(Es), Law(K), Evidence([exact(X)]), on)


# --- random loops --------------------------------------------------------------------------------


class Family:
    """Vertices that are close together: what holds at one X holds at all of them."""

    def __init__(self, on, law, kind, seed=3, spread=0.004):
        random = np.random.default_rng(seed)
        n, m, q, N = 3, 1, 2, 4
        self.on, self.law, self.kind, self.domain = on, law, kind, Domain.of(on, N)
        self.degree = {"own 2": 2, "own": 1, "given": 1}.get(law, 0)

        def near(middle, count=N):
            return middle + spread * random.normal(size=(count, *middle.shape))

        A, self.B = random.normal(size=(n, n)), near(random.normal(size=(n, m)))
        A -= (np.linalg.eigvals(A).real.max() + 1) * np.eye(n)
        K = random.normal(size=(m, n))
        self.A = near(A - self.B.mean(axis=0) @ K)
        self.E, self.C = near(random.normal(size=(n, q))), near(random.normal(size=(1, n)))
        self.D, self.F = near(random.normal(size=(1, m))), near(0.1 * random.normal(size=(1, q)))
        self.K = near(K, N if law == "corners" else 1)
        self.middle = A, self.E.mean(axis=0), (self.C + self.D @ K).mean(axis=0)
        count = self.domain.count(self.degree)
        self.X = self.lyapunov_matrix()
        self.W = np.array([self.X + spread * symmetric(random, n) for _ in range(count)])
        self.Z = near(K, count) @ self.W

    def lyapunov_matrix(self):
        """One matrix that proves the claim in the middle, with something to spare."""
        A, E, C = self.middle
        if self.kind == "initial":
            X, starts = lyapunov(A, np.eye(3)), np.hstack([self.points().T, E])
            return 1.1 * X * np.sum(starts * np.linalg.solve(X, starts), axis=0).max()
        if self.kind == "gain":
            return bounded_real(A, E, C, 1.2 * self.norm(A, E, C, 0 * self.F[0]), 0.1)
        return lyapunov(A, E @ E.T + 0.5 * np.eye(3))

    def points(self):
        return np.array([[1.0, 0, 0], [0.5, -0.5, 1]])

    def norm(self, A, E, C, F):
        w = np.concatenate([[0], np.geomspace(1e-2, 1e3, 200)])
        states = np.linalg.solve(1j * w[:, None, None] * np.eye(len(A)) - A, E.astype(complex))
        return np.linalg.norm(C @ states + F, axis=(1, 2)).max()

    def subject(self):
        A, B, E, W, Z = (several(each) for each in (self.A, self.B, self.E, self.W, self.Z))
        if self.law in ("one", "corners"):
            law, evidence = Law(several(self.K)), Evidence([exact(self.X)])
        else:
            law, evidence = Law(None, W, Z, self.degree), Evidence([])
            if self.law == "given":  # X = W (0 + Q W)
                half = np.linalg.inv(self.W.mean(axis=0))
                Q = half @ self.X @ half
                evidence = Evidence([exact((Q + Q.T) / 2)])
        return Subject(A, B, E, law, evidence, self.on)

    def claim(self, level):
        subject, output = self.subject(), Output(several(self.C), several(self.D))
        level = Fraction(level)
        if self.kind == "rms":
            return Rms(subject, (output,), level, Fraction(1))
        if self.kind == "energy":
            return EnergyPeak(subject, (output,), level, Fraction(2))
        if self.kind == "initial":
            x = tuple(tuple(map(Fraction, row)) for row in self.points())
            return InitialPeak(subject, (output,), level, x, (Fraction(1), Fraction(-1, 2)))
        if self.kind == "gain":
            return Gain(subject, (replace(output, F=tuple(several(self.F))),), level)
        return RelativeRms(subject, (output,), level, self.baseline, Fraction(1))

    @cached_property
    def baseline(self):
        """The same loop with its poles moved to the left by one, under one gain."""
        A = self.A + self.B @ self.K[:1] - np.eye(3)
        X = lyapunov(A.mean(axis=0), np.eye(3))
        C, E = self.C, self.E
        # exact at the vertices, less a little; affine between them
        P = np.array([lyapunov(a, e @ e.T - 0.05 * np.eye(3)) for a, e in zip(A, E, strict=True)])
        stability, covariance = Evidence([exact(X)]), Evidence(several(P), 1, 1)
        return Baseline(several(A), several(E), several(C), stability, covariance)

    def at(self, matrices, alpha, degree=1):
        if len(matrices) == 1:
            return matrices[0]
        return np.tensordot(self.domain.basis(alpha, degree), matrices, 1)

    def signals(self, alpha):
        """The loop, its output and its Lyapunov matrix."""
        A, B, E, C, D = (self.at(M, alpha) for M in (self.A, self.B, self.E, self.C, self.D))
        K, X = self.at(self.K, alpha), self.X
        if self.degree:
            W, Z = (self.at(M, alpha, self.degree) for M in (self.W, self.Z))
            half = np.linalg.inv(self.W.mean(axis=0)) @ W
            K, X = Z @ np.linalg.inv(W), half.T @ X @ half if self.law == "given" else W
        return A + B @ K, E, C + D @ K, X

    def bound(self, alpha):
        """What X proves at alpha; nothing for gains."""
        _, _, Y, X = self.signals(alpha)
        level = np.sqrt((Y @ X @ Y.T).item())
        if self.kind == "relative":
            base = self.baseline
            C0 = self.at(np.array(base.C, dtype=float), alpha)
            P = self.at(np.array(base.covariance.X, dtype=float), alpha)
            return level / np.sqrt((C0 @ P @ C0.T).item())
        return level * (2 if self.kind == "energy" else 1)

    def truth(self, alpha):
        """What is bounded, by other means than the proof's."""
        A, E, Y, _ = self.signals(alpha)
        rms = np.sqrt((Y @ lyapunov(A, E @ E.T) @ Y.T).item())
        if self.kind == "rms":
            return rms
        if self.kind == "energy":  # the worst w is the impulse response, backwards
            return 2 * rms
        if self.kind == "gain":
            return self.norm(A, E, Y, self.at(self.F, alpha))
        if self.kind == "relative":
            base = self.baseline
            A0, E0, C0 = (
                self.at(np.array(M, dtype=float), alpha) for M in (base.A, base.E, base.C)
            )
            return rms / np.sqrt((C0 @ lyapunov(A0, E0 @ E0.T) @ C0.T).item())
        starts = np.hstack([self.points().T, E * [1, -0.5]])
        values, vectors = np.linalg.eig(A)
        t = np.linspace(0, 10, 600)[:, None, None]
        moved = (Y @ vectors)[None] * np.exp(values * t)
        return np.abs((moved @ np.linalg.inv(vectors) @ starts).real).max()


PAIRS = [
    (on, law) for on in ("simplex", "box") for law in ("one", "corners", "own", "own 2", "given")
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("on", "law"), PAIRS)
def test_what_is_proved_is_what_the_lyapunov_matrix_bounds(on, law, kind):
    family = Family(on, law, kind)
    alphas = [*np.eye(4), *(alpha for _, alpha in points(family.domain, 12))]
    true = max(map(family.truth, alphas))
    if kind == "gain":
        assert prove(family.claim(1.6 * true)).proved
        assert not prove(family.claim(0.9999 * true)).proved
        return
    bound = max(map(family.bound, alphas))
    assert true < bound
    assert prove(family.claim(1.002 * bound)).proved
    assert not prove(family.claim(0.9999 * bound)).proved


# --- faults --------------------------------------------------------------------------------------


def shortened(value, where=""):
    """Every copy of a claim in which one list, at any depth, has lost its last entry."""
    if is_dataclass(value):
        for field in fields(value):
            for path, each in shortened(getattr(value, field.name), f"{where}.{field.name}"):
                yield path, replace(value, **{field.name: each})
    elif isinstance(value, list | tuple):
        if value:
            yield where, value[:-1]
        for k, entry in enumerate(value[-1:], start=len(value) - 1):
            for path, each in shortened(entry, f"{where}[{k}]"):
                yield path, type(value)((*value[:k], each))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("law", ["one", "corners", "own", "given"])
def test_a_claim_with_an_entry_missing_is_refused(law, kind):
    claim = Family("simplex", law, kind).claim(20)
    assert prove(claim).proved
    if law == "given":
        own = replace(claim.subject.evidence, multiple=(Fraction(0),))
        claim = replace(claim, subject=replace(claim.subject, evidence=own))
    seen = set()
    for path, fault in shortened(claim):
        if path in (".points", ".subject.evidence.multiple"):
            continue  # less is claimed, nothing is a number
        seen.add(path)
        if law == "given" and path == ".subject.evidence.X":  # X = 0 W is what is left
            assert not prove(fault).proved
            continue
        with pytest.raises(FormatError):
            prove(fault)
    wanted = {".subject.A", ".subject.A[3]", ".subject.B[3][2]", ".outputs", ".outputs[0].D"}
    assert wanted | {".outputs[0].C[3][0]"} <= seen
    assert len(seen) > 15


def changed(claim, path, change):
    """Return the claim with one number, or matrix, changed."""
    name, *rest = path
    if isinstance(name, int):
        value = changed(claim[name], rest, change) if rest else change(claim[name])
        return type(claim)((*claim[:name], value, *claim[name + 1 :]))
    own = getattr(claim, name)
    return replace(claim, **{name: changed(own, rest, change) if rest else change(own)})


# what must not become larger (or smaller, where marked), by kind; bounds are sharp to 0.2 per cent
TIGHT = {
    "rms": [("intensity",), ("level", -1)],
    "energy": [("norm",), ("level", -1)],
    "initial": [("level", -1)],
    "relative": [("level", -1)],
    "gain": [],
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("on", "law"), [("simplex", "corners"), ("box", "own"), ("box", "given")])
def test_one_number_wrong_is_one_too_many(on, law, kind):
    family = Family(on, law, kind)
    if kind == "gain":
        level = 1.6 * family.truth(np.full(4, 0.25))
    else:
        level = 1.002 * max(family.bound(alpha) for alpha in np.eye(4))
    claim = family.claim(level)
    assert prove(claim).proved
    for path in TIGHT[kind]:
        down = path[-1] == -1
        fault = changed(claim, path[:1], lambda v, d=down: v / 2 if d else v * 2)
        assert not prove(fault).proved, path
    paths = [("outputs", 0, "C", 1, 0, 0), ("outputs", 0, "D", 2, 0, 0), ("subject", "A", 0, 0, 1)]
    paths += [("subject", "B", 3, 2, 0), ("subject", "E", 1, 0, 1)]
    paths += {
        "corners": [("subject", "law", "K", 1, 0, 2), ("subject", "evidence", "X", 0, 1, 1)],
        "own": [("subject", "law", "W", 1, 1, 1), ("subject", "law", "Z", 0, 0, 0)],
        "given": [("subject", "law", "W", 1, 1, 1), ("subject", "evidence", "X", 0, 1, 1)],
    }[law]
    if kind == "relative":
        paths += [("baseline", letter, 1, 0, 0) for letter in "AEC"]
        paths += [("baseline", each, "X", 0, 1, 1) for each in ("stability", "covariance")]
    if kind == "initial":
        paths += [("points", 0, 0), ("impulses", 0)]
    if kind == "gain":
        paths += [("outputs", 0, "F", 1, 0, 1)]
    for path in paths:
        answers = [
            prove(changed(claim, path, lambda v, more=more: v + more)).proved for more in (-50, 50)
        ]
        assert not all(answers), path  # another number may be as good, not every other


@pytest.mark.parametrize("law", ["one", "own", "given"])
def test_what_is_not_symmetric_proves_nothing(law):
    claim = Family("simplex", law, "relative").claim(20)
    places = [("baseline", "stability", "X", 0), ("baseline", "covariance", "X", 1)]
    places += [("subject", "evidence", "X", 0)] if law != "own" else []
    places += [("subject", "law", "W", 1)] if law != "one" else []
    assert prove(claim).proved
    for path in places:
        fault = changed(claim, (*path, 1, 0), lambda v: v * (1 + Fraction(1, 2**52)))
        verdict = prove(fault)
        assert not verdict.proved
        assert "not symmetric" in verdict.reason


FAULTS = {
    "level": (("level",), Fraction(-1), "level must be zero or more"),
    "intensity": (("intensity",), Fraction(-1), "intensity must be zero or more"),
    "no E": (("subject", "E"), [], "E is missing"),
    "degree": (("subject", "evidence", "degree"), 1, "matrices are missing"),
    "elevation": (("subject", "evidence", "elevation"), 17, "0 to 16"),
    "below": (("subject", "evidence", "elevation"), -1, "0 to 16"),
    "epsilon": (("subject", "evidence", "epsilon"), Fraction(1), "epsilon belongs"),
    "tau": (("subject", "evidence", "tau"), Fraction(1), "tau belongs"),
    "G": (("subject", "evidence", "G"), [[Fraction(1)]], "G does not belong"),
    "multiple": (("subject", "evidence", "multiple"), (Fraction(1),), "multiples belong"),
    "no X": (("subject", "evidence", "X"), [], "matrices are missing"),
    "on": (("subject", "on"), "ball", "do not make a ball"),
    "law": (("subject", "law", "W"), [[[Fraction(1)] * 3] * 3], "do not belong"),
    "P": (("baseline", "covariance", "degree"), 17, "0 to 16"),
    "P elevated": (("baseline", "covariance", "elevation"), -1, "0 to 16"),
    "X0": (("baseline", "stability", "degree"), 1, "not 4"),
    "X0 with G": (("baseline", "stability", "G"), [[Fraction(1)]], "polynomial and no more"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_claim_that_is_not_consistent_is_named(fault):
    path, value, message = FAULTS[fault]
    claim = Family("simplex", "one", "relative").claim(20)
    with pytest.raises(FormatError, match=message):
        prove(changed(claim, path, lambda _: value))


@pytest.mark.parametrize("kind", ["rms", "initial", "relative"])
def test_work_out_of_all_proportion_is_refused(kind):
    claim, N = first_order(kind, Fraction(99), Fraction(26)), 24
    for where, letters in (("subject",), "ABE"), (("outputs", 0), "CD"), (("baseline",), "AEC"):
        for letter in letters if hasattr(claim, where[0]) else "":
            claim = changed(claim, (*where, letter), lambda matrices: matrices * N)
    assert prove(claim).proved
    elevation = ("subject", "evidence", "elevation")
    with pytest.raises(FormatError, match="to be checked"):
        prove(changed(claim, elevation, lambda _: 5))
    for each in ("stability", "covariance") if kind == "relative" else ():
        with pytest.raises(FormatError, match="to be checked"):
            prove(changed(claim, ("baseline", each, "elevation"), lambda _: 5))
    if kind == "initial":  # one block a point
        raised = changed(claim, elevation, lambda _: 3)
        with pytest.raises(FormatError, match="to be checked"):
            prove(replace(raised, points=claim.points * 32))


def test_products_of_what_varies_are_part_of_the_work():
    """E E' and C0 P C0' are of degree 2, and all inequalities about the loop with them."""
    claim = first_order("relative", Fraction(99), Fraction(26))
    for where, letters in (("subject",), "ABE"), (("outputs", 0), "CD"), (("baseline",), "AEC"):
        for letter in letters:
            claim = changed(claim, (*where, letter), lambda matrices: matrices * 60)
    claim = changed(claim, ("subject", "evidence", "elevation"), lambda _: 2)
    claim.require()
    for name, letter in (("subject", "E"), ("baseline", "C")):
        with pytest.raises(FormatError, match="to be checked"):
            changed(claim, (name, letter, 7, 0, 0), lambda x: x / 2).require()


def test_the_laws_own_matrix_has_its_own_degree_and_one_multiple():
    claim = Family("simplex", "own", "rms").claim(20)
    for key, value in (("degree", 1), ("multiple", (Fraction(1),) * 2)):
        with pytest.raises(FormatError, match="own degree"):
            prove(changed(claim, ("subject", "evidence", key), lambda _, v=value: v))


def test_points_and_impulses_are_needed():
    claim = Family("simplex", "one", "initial").claim(20)
    for points_, impulses, message in (
        ((), (), "missing"),
        ((), (Fraction(0),) * 2, "missing"),
        (claim.points, (Fraction(1),), "2 numbers"),
        (claim.points * 40, (), "more than 64"),
    ):
        with pytest.raises(FormatError, match=message):
            prove(replace(claim, points=points_, impulses=impulses))
    bare = replace(claim, subject=replace(claim.subject, E=[]), impulses=())
    assert prove(bare).proved  # nothing is driven


def test_the_passive_loop_is_what_is_left_without_its_integral():
    claim = Family("box", "one", "rms").claim(20)
    A = [[[*row[:2], Fraction(0)] for row in matrix] for matrix in claim.subject.A]
    C = [[[*row[:2], Fraction(0)] for row in matrix] for matrix in claim.outputs[0].C]
    subject, output = replace(claim.subject, A=A), replace(claim.outputs[0], C=C)
    found = baseline_loop(subject, output, None, (0, 1))
    assert found[0] == [[row[:2] for row in matrix[:2]] for matrix in A]
    assert found[1] == [matrix[:2] for matrix in subject.E]
    assert found[2] == [[row[:2] for row in matrix] for matrix in C]
    with pytest.raises(FormatError, match="left out"):  # y has the integral in it
        baseline_loop(subject, claim.outputs[0], None, (0, 1))
    for states in ((0, 2), (1,), (), (0, 3), (-1, 0), (1, 0), (0, 0, 1)):
        with pytest.raises(FormatError, match="left out|states must be"):
            baseline_loop(subject, output, None, states)
    K = [[Fraction(1), Fraction(2), Fraction(3)]]
    with pytest.raises(FormatError, match="vertex 1: the baseline depends"):
        baseline_loop(subject, output, K, (0, 1))
    A, E, C = baseline_loop(subject, output, K, (0, 1, 2))
    loop = np.array(subject.A[2], dtype=float) + np.array(subject.B[2], dtype=float) @ [[1, 2, 3]]
    row = np.array(output.C[2], dtype=float) + np.array(output.D[2], dtype=float) @ [[1, 2, 3]]
    assert np.allclose(np.array(A[2], dtype=float), loop)
    assert np.allclose(np.array(C[2], dtype=float), row)
    assert E == subject.E
