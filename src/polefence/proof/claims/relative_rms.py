"""Rms of a signal as a share of that of another loop under the same noise.

As for the rms, with g^2 C0 P C0' in place of g^2, where A0 P + P A0' + S E0 E0' > 0 for a baseline
that X0 > 0, -(A0 X0 + X0 A0') > 0 show to be stable, so that P is less than its covariance; in
discrete time with T A0 P A0' besides. The dual form likewise.

Of the plant without control the baseline keeps the states that y depends on: those of a law, of
sensors and of integrals are none of them.

With a remainder, which only the same plant without control has as a baseline, A0 is off by H Delta
V, V = diag(columns), and E0 by F: with M = I + T A0, Omega > M P V'V P M' and kappa I > -V P V' the
left hand side loses (1 + T kappa) H H' + Omega at most, and S E0 E0' what it does from above.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Inequality
from polefence.proof.claims.signal import (
    Rows,
    SignalClaim,
    Subject,
    decreasing,
    dual_of_noise,
    moving,
    noise,
    require_shapes,
    varies,
)
from polefence.proof.laws import Evidence, Law, read_evidence
from polefence.proof.matrices import Rationals, least_work
from polefence.proof.plant import Output
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Polynomial,
    affine,
    bernstein,
    constant,
    count_of,
    diagonal,
)
from polefence.proof.reading import MAX_SIZE, Table, plain
from polefence.proof.remainder import SHARE, Remainder, Spread
from polefence.proof.short import Short
from polefence.proof.text import digits_down, number_text
from polefence.proof.transfer import (
    Tensor,
    Transfer,
    bernstein_of,
    combined,
    product_of,
    require_few,
)
from polefence.proof.work import RATIONAL, FormatError, spend


@dataclass(frozen=True)
class Baseline(Short):
    """Another loop x' = A x + E w, y = C x on the same domain, under the same noise.

    ``stability`` holds X(alpha) > 0 with -(A X + X A') > 0; ``covariance`` in its X a symmetric
    P(alpha) with A P + P A' + intensity E E' > 0, which is less than the loop's covariance.
    ``states`` are those of the claim's loop that it keeps, counted from 0; none named: all.
    """

    A: list[Rationals]
    E: list[Rationals]
    C: list[Rationals]
    stability: Evidence
    covariance: Evidence
    states: tuple[int, ...] = ()


@dataclass(frozen=True)
class RelativeRms(SignalClaim):
    """The rms of y is less than ``level`` times that of the baseline, at every alpha."""

    kind: ClassVar[str] = "relative rms"
    has_dual: ClassVar[bool] = True
    has_transfer: ClassVar[bool] = True
    has_filters: ClassVar[bool] = True
    has_passing: ClassVar[bool] = True
    has_cells: ClassVar[bool] = False  # the baseline is of the whole box
    has_motion: ClassVar[bool] = False  # along a motion there is no one covariance to compare with

    baseline: Baseline
    intensity: Fraction = Fraction(1)

    @classmethod
    def read_extra(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read the baseline: a gain and the states that are kept, and its evidence."""
        below, n, m = table.table("baseline"), subject.n, subject.m
        K = below.matrix("K", m, n) if "K" in below else None
        states = below.items("states", MAX_SIZE) if "states" in below else list(range(1, n + 1))
        if any(type(j) is not int for j in states):
            raise FormatError(f"{below.path('states')} must be whole numbers, 1 the first state")
        kept = tuple(j - 1 for j in states)
        A, E, C = baseline_loop(subject, outputs[0], K, kept)
        kept = kept if len(kept) < n else ()
        intensity = table.number("intensity", 1)
        if subject.evidence.transfer:
            none = Evidence([])
            return {"baseline": Baseline(A, E, C, none, none, kept), "intensity": intensity}
        stability, covariance = (
            read_evidence(below.table(key), len(A[0]), subject.sizes, letter)
            for key, letter in (("stability", "X"), ("covariance", "P"))
        )
        base = Baseline(A, E, C, stability, covariance, kept)
        return {"baseline": base, "intensity": intensity}

    def write_extra(self) -> dict[str, Any]:
        """Return the baseline's evidence, and the intensity."""
        if not self.without_control:
            raise FormatError(f"{self.outputs[0].name}: only no control is written as a baseline")
        baseline = self.baseline
        table: dict[str, Any] = (
            {"states": [j + 1 for j in baseline.states]} if baseline.states else {}
        )
        if not self.subject.evidence.transfer:
            table["stability"] = baseline.stability.write("X")
            table["covariance"] = baseline.covariance.write("P")
        return {"intensity": plain(self.intensity), "baseline": table}

    @property
    def bare(self) -> Self:
        """What is claimed, without what proves it."""
        none = Evidence([])
        baseline = replace(self.baseline, stability=none, covariance=none)
        return replace(super().bare, baseline=baseline)

    @property
    def without_control(self) -> bool:
        """Whether the baseline is the same plant under no control."""
        base, whole = self.baseline, self.series
        states = base.states or tuple(range(whole.subject.n))
        with suppress(FormatError):  # some of its states depend on others
            alone = baseline_loop(whole.subject, whole.outputs[0], None, states)
            return alone == (base.A, base.E, base.C)
        return False

    @property
    def _remainder(self) -> Remainder | None:
        """The remainder of the baseline's states."""
        remainder, states = self.subject.remainder, self.baseline.states
        return remainder.kept(states) if remainder is not None and states else remainder

    def require_extra(self) -> None:
        """Refuse a baseline that does not fit."""
        baseline, N, q = self.baseline, len(self.subject.A), self.subject.q
        if not baseline.A or not baseline.A[0]:
            raise FormatError("the baseline is missing")
        n = len(baseline.A[0])
        require_shapes(baseline.A, N, n, n, "the baseline's A")
        require_shapes(baseline.E, N, n, q, "the baseline's E")
        require_shapes(baseline.C, N, 1, n, "the baseline's C")
        if self.subject.evidence.transfer:
            if baseline.stability != Evidence([]) or baseline.covariance != Evidence([]):
                raise FormatError("a proof by the transfer function has no other evidence")
            return
        for name, proof in (("X", baseline.stability), ("P", baseline.covariance)):
            if any(not 0 <= degree <= MAX_DEGREE for degree in (proof.degree, proof.elevation)):
                raise FormatError(f"degrees must be 0 to {MAX_DEGREE}")
            if replace(proof, X=[], degree=0, elevation=0, spread=None) != Evidence([]):
                raise FormatError(f"the baseline's {name} is a polynomial and no more")
            count = count_of(self.subject.sizes, proof.degree)
            require_shapes(proof.X, count, n, n, f"the baseline's {name}")
            self._require_spread(proof, kappa=name == "P")

    def _require_spread(self, evidence: Evidence, kappa: bool) -> None:
        """Refuse a baseline's evidence that does not fit the remainder, or lack of it."""
        remainder, spread = self._remainder, evidence.spread
        if (spread is None) != (remainder is None):
            raise FormatError("a remainder has evidence of its own, for the baseline too")
        if remainder is None or spread is None:
            return
        if not self.without_control:
            raise FormatError("with a remainder the baseline is the plant without control")
        spread.require(remainder, kappa=kappa)

    @property
    def least_degree(self) -> int:
        """That of E E' and of C0 P C0'."""
        least = self.baseline.covariance.degree + 2 * varies(self.baseline.C)
        return max(super().least_degree, least)

    @property
    def more_work(self) -> int:
        """Work on the baseline's inequalities."""
        stability, covariance = self.baseline.stability, self.baseline.covariance
        remainder = self.subject.remainder
        d = 1 if remainder is None else remainder.degree
        degrees = [stability.degree + d + stability.elevation] * (2 if remainder is None else 3)
        once = 2 * d if self.subject.step else d
        highest = max(covariance.degree + once, 2 * d) + covariance.elevation
        degrees += [highest] * (1 if remainder is None else 3)
        count = sum(count_of(self.subject.sizes, degree) for degree in degrees)
        return least_work(count, len(self.baseline.A[0]) + self.subject.q)

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield the baseline's matrices too."""
        yield from super().symmetric()
        for name, proof in (("X", self.baseline.stability), ("P", self.baseline.covariance)):
            for k, matrix in enumerate(proof.X):
                yield f"the baseline's {name} {k + 1}", matrix

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return what bounds the covariance, and the output's variance."""
        driven = moving(self.subject, self.scales, X.sizes, self.intensity)
        falling = self.subject.falling(X, N, driven)
        return {"of the noise": falling, "of the output": [[self._square, Y], [X]]}

    def dual_rows(self) -> Rows:
        """Return what bounds the observability Gramian, and the noise in it."""
        return dual_of_noise(self, self._square, self.intensity)

    def transfer(self) -> Transfer:
        """Return the transfer function, with that of the baseline beside it."""
        base, subject = self.baseline, self.subject
        n, count = len(base.A[0]), len(base.A)
        none = [[Fraction(0)] for _ in range(n)]
        law, y = Law([[[Fraction(0)] * n]]), Output(base.C, [[[Fraction(0)]]] * count)
        loop = Subject(
            base.A, [none] * count, base.E, law, subject.evidence, subject.on, subject.step
        )
        return replace(super().transfer(), beside=loop.transfer((y,), self.scales, self.power))

    def polynomials(self, loop: Transfer) -> Iterator[tuple[str, Tensor]]:
        """Yield D and D0 of both loops, and g^2 N0 D - N D0: the variances are N / D, N0 / D0."""
        if loop.beside is None:
            raise FormatError("the baseline is missing")
        (D, N), (D0, N0) = loop.variance, loop.beside.variance
        yield "of the poles", bernstein_of(D)
        yield "of the baseline's poles", bernstein_of(D0)
        degrees = [a + b - 2 for a, b in zip(D.shape, D0.shape, strict=True)]
        require_few(degrees)
        D, N, D0, N0 = (form.on_nodes(degrees) for form in (D, N, D0, N0))
        one, other = product_of(N0, D), product_of(N, D0)
        yield "of the ratio", bernstein_of(combined(one, self.level**2, other, Fraction(-1)))

    def value(self, loop: Transfer) -> Fraction | None:
        """Return the square of the ratio at the first node."""
        return loop.square / loop.beside.square if loop.beside is not None else None

    @property
    def _square(self) -> Polynomial:
        """What the output's variance is to be less than: level^2 C0 P C0'."""
        sizes, P = self.subject.sizes, self.baseline.covariance
        C = affine(self.baseline.C, sizes)
        return (C * bernstein(P.X, sizes, P.degree) * C.T).times(self.level**2)

    def inequalities(self) -> Iterator[Inequality]:
        """Yield that the baseline is stable, and that P is less than its covariance, too."""
        yield from super().inequalities()
        if self.filters:
            return
        baseline, subject = self.baseline, self.subject
        sizes, step, remainder = subject.sizes, subject.step, self._remainder
        A = affine(baseline.A, sizes)
        A = A if remainder is None else remainder.curved(A)
        stability, covariance = baseline.stability, baseline.covariance
        X, P = (bernstein(proof.X, sizes, proof.degree) for proof in (stability, covariance))
        N, M = A * X, A * P
        driven = M + M.T
        driven = driven + (M * A.T).times(step) if step else driven
        rows = {"X": [[X]], "decrease": decreasing(-(N + N.T), X, N, step, stability.spread)}
        if stability.spread is not None:
            V = self._columns(stability.spread) * X
            rows["remainder"] = stability.spread.bounding(V)
        more: Rows = {"noise": [[driven + self._noise(covariance.spread)]]}
        if covariance.spread is not None:
            more |= self._below(P, P + M.times(step), covariance.spread)
        for group, by in ((rows, stability.elevation), (more, covariance.elevation)):
            for name, blocks in group.items():
                yield Inequality.raised(f"of the baseline's {name}", blocks, by)

    def _noise(self, spread: Spread | None) -> Polynomial:
        """Return the intensity times E0 E0', less where E0 and A0 are only near."""
        subject, sizes, remainder = self.subject, self.subject.sizes, self._remainder
        if spread is None or remainder is None:
            return noise(self.baseline.E, self.intensity, sizes, self.scales)
        E = affine(self.baseline.E, sizes)
        E = remainder.curved(E, len(self.baseline.E[0]) + subject.m)
        E = E * diagonal(self.scales, sizes) if self.scales else E
        most = max(spread.driving(self.scales, subject.q), default=Fraction(0))
        known = (E * E.T).times(self.intensity * (1 - SHARE if most else 1))
        lost = 1 + subject.step * spread.kappa + (1 / SHARE - 1) * self.intensity * most**2
        return known - constant(spread.entering(lost), sizes) - constant(spread.omega, sizes)

    def _below(self, P: Polynomial, MP: Polynomial, spread: Spread) -> Rows:
        """Return that Omega and kappa of a covariance from below are enough."""
        V = self._columns(spread)
        kappa = diagonal([spread.kappa] * V.shape[0], V.sizes)
        return {"spread": spread.bounding(V * MP.T), "kappa": [[kappa + V * P * V]]}

    def _columns(self, spread: Spread) -> Polynomial:
        """Return V = diag(columns) of the states."""
        return diagonal(spread.columns[: len(self.baseline.A[0])], self.subject.sizes)

    def scale_text(self, scale: Fraction) -> str:
        """Return it as it is, or with a ~: a ratio may grow as one disturbance becomes less."""
        return number_text(scale)

    @property
    def under(self) -> str:
        """The baseline, and the noise."""
        other = "no control" if self.without_control else "a loop that the file defines"
        return f" of that of {other}, at density {digits_down(2 * self.intensity, 4)}"


def baseline_loop(
    subject: Subject, output: Output, K: Rationals | None, states: tuple[int, ...]
) -> tuple[list[Rationals], list[Rationals], list[Rationals]]:
    """Return A, E, C of the subject's plant with u = K x, of these states alone.

    Parameters
    ----------
    subject : Subject
        Its law and evidence are not used.
    output : Output
    K : (m, n) rationals, optional
        None: u = 0, the passive plant.
    states : tuple of int
        Those that are kept, counted from 0.

    Raises
    ------
    FormatError
        If a state that is kept, or y, depends on one that is not, or with a remainder may: what is
        left would be another loop.
    """
    n = subject.n
    if sorted(set(states)) != list(states) or not states or states[0] < 0 or states[-1] >= n:
        raise FormatError(f"states must be some of the {n}, in their order")
    left = [j for j in range(n) if j not in states]
    remainder = subject.remainder
    off = [] if remainder is None else [remainder.entries, *remainder.curve]
    if any(M[i][j] for M in off for i in states for j in left):
        raise FormatError("by the remainder the baseline may depend on a state left out")
    As, Es, Cs = list[Rationals](), list[Rationals](), list[Rationals]()
    for k in range(len(subject.A)):
        A = _closed(subject.A[k], subject.B[k], K)
        C = _closed(output.C[k], output.D[k], K)
        if any(row[j] for row in ([A[i] for i in states] + C) for j in left):
            raise FormatError(f"vertex {k + 1}: the baseline depends on a state left out")
        As.append([[A[i][j] for j in states] for i in states])
        Es.append([subject.E[k][i] for i in states])
        Cs.append([[row[j] for j in states] for row in C])
    return As, Es, Cs


def _closed(A: Rationals, B: Rationals, K: Rationals | None) -> Rationals:
    """Return A + B K."""
    if K is None:
        return A
    columns = list(zip(*K, strict=True))
    spend(RATIONAL * len(A) * len(columns) * len(K), 64, 64)
    return [
        [
            a + sum((b * k for b, k in zip(bs, column, strict=True)), Fraction(0))
            for a, column in zip(row, columns, strict=True)
        ]
        for row, bs in zip(A, B, strict=True)
    ]
