"""Claims of which motions are followed over steps of time: how, and how far errors reach.

How far what is followed is off is measured by |e|_Q = sqrt(e'Q e), of which is proved

    -(Q A + A'Q) - 2 beta Q > 0,    [ kappa^2, C; C', Q ] > 0,    so |C e| <= kappa |e|_Q.

See `polefence.proof.response`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Verdict, undecided
from polefence.proof.claims.signal import Rows, SignalClaim, Subject
from polefence.proof.drives import Constant, Drive
from polefence.proof.matrices import ZERO, Rationals, identity, right_divide
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, constant, number
from polefence.proof.reading import Table, plain
from polefence.proof.response import (
    Centred,
    Follower,
    Form,
    Series,
    Step,
    monomial,
    norms,
    variables,
)
from polefence.proof.short import Short
from polefence.proof.work import FormatError

Sums = dict[Any, int]  # coefficients over 2^bits, of monomials of g or of s and g
FEW = 60  # bits of about the inverse of A
MAX_STEPS, MAX_TERMS, MAX_FORM, MAX_BITS = 20_000, 40, 16, 400


def _whole_pairs(table: Table) -> tuple[tuple[int, int], ...]:
    pairs = table.matrix("lengths", None, 2)
    if any(x.denominator != 1 for pair in pairs for x in pair):
        raise FormatError("lengths must be pairs of whole numbers")
    return tuple((int(a), int(b)) for a, b in pairs)


@dataclass(frozen=True)
class Following(Short):
    """How the response is followed in one part of the box.

    Attributes
    ----------
    unit : Fraction
        Of lengths [s].
    lengths : tuple of (int, int)
        Of how many units a step is, and how many steps of that length follow one another.
    terms, degree, bits : int
    rate, reach : Fraction
        beta [1/s] and kappa.
    """

    unit: Fraction
    lengths: tuple[tuple[int, int], ...]
    terms: int
    degree: int
    bits: int
    rate: Fraction
    reach: Fraction

    @classmethod
    def read(cls, table: Table) -> Following:
        """Read it."""
        return cls(
            table.number("unit"),
            _whole_pairs(table),
            table.whole("terms", None, MAX_TERMS, 1),
            table.whole("degree", None, MAX_FORM),
            table.whole("bits", None, MAX_BITS, 1),
            table.number("rate"),
            table.number("reach"),
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        whole = {key: getattr(self, key) for key in ("terms", "degree", "bits")}
        whole |= {"lengths": [list(pair) for pair in self.lengths]}
        return whole | {key: plain(getattr(self, key)) for key in ("unit", "rate", "reach")}

    def require(self) -> None:
        """Refuse numbers that are not positive."""
        if min(self.unit, self.rate, self.reach) <= 0:
            raise FormatError("following: unit, rate and reach must be positive")
        if any(min(pair) < 1 for pair in self.lengths) or not 1 <= self.steps <= MAX_STEPS:
            raise FormatError(f"lengths must be whole numbers, of 1 to {MAX_STEPS} steps")

    @property
    def steps(self) -> int:
        """How many steps there are."""
        return sum(count for _, count in self.lengths)

    @property
    def every(self) -> list[Fraction]:
        """The length of each step [s]."""
        return [units * self.unit for units, count in self.lengths for _ in range(count)]


@dataclass(frozen=True)
class Followed(SignalClaim):
    """A bound on what motions make of an output, which are followed in each part of the box."""

    direct: ClassVar[bool] = True
    has_dual: ClassVar[bool] = True
    has_motion: ClassVar[bool] = False
    has_passing: ClassVar[bool] = True

    following: tuple[Following, ...] = field(default=(), kw_only=True)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read how it is followed in each part."""
        return {"following": tuple(map(Following.read, table.tables("following", 20_000)))}

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        return {"following": [own.write() for own in self.following]}

    def require_extra(self) -> None:
        """Refuse a series that does not fit."""
        evidence, kind = self.subject.evidence, self.kind
        if self.subject.step:
            raise FormatError(f"{kind}: of a plant in continuous time")
        if self.subject.remainder is not None:
            raise FormatError(f"{kind}: of a plant that is known exactly")
        if not evidence.dual:
            raise FormatError(f"{kind}: its evidence is a Q in each part of the box")
        if len(self.following) != 1:
            raise FormatError("following: there must be one for each part of the box")
        self.following[0].require()

    @property
    def driving(self) -> Polynomial | None:
        """The b of x' = A x + b w, a column for each drive; None where it is zero."""
        return None

    @property
    def drives(self) -> tuple[Drive, ...]:
        """What w(t) is; one that stays one unless said."""
        return (Constant(),)

    @property
    def begun(self) -> Polynomial | None:
        """x(0), a column; None where it is zero."""
        return None

    @property
    def passing(self) -> Polynomial | None:
        """What w adds to C x, a row; None where it is zero."""
        return None

    @property
    def run(self) -> Run:
        """The motion that is followed."""
        return Run.of(self)

    def inside(self, piece: Any) -> Self:
        """Return the claim about a part of the box, with its own series."""
        if len(self.following) != len(self.subject.evidence.cells):
            raise FormatError("following: there must be one for each part of the box")
        return self.part(piece, self.following[self.subject.evidence.cells.index(piece)])

    def part(self, piece: Any, following: Following | None) -> Self:
        """Return the claim about a part of the box that is followed so."""
        own = () if following is None else (following,)
        return replace(super().inside(piece), following=own)

    def _with(self, piece: Any) -> Self:
        return replace(super()._with(piece), following=self.following[:1])

    def dual_rows(self) -> Rows:
        """Return that errors fade, and how far they reach."""
        own, loop = self.following[0], self.subject.dual_loop(self.outputs)
        W = self.subject.turning
        square = loop.Q if W is None else loop.WQ * W
        falling = (loop.WQM + loop.WQM.T + square.times(2 * own.rate)).times(-1)
        reach = [[number(own.reach**2, loop.Q.sizes), loop.Y], [square]]
        return {"of the decrease": [[falling]], "of the output": reach}

    @property
    def largest(self) -> int:
        """Rows of the largest inequality."""
        return self.subject.n + 1

    def decided(self) -> Verdict:
        """Prove that errors fade, and then the measure, in each part of the box."""
        verdict = self.fades()
        if not verdict.proved:
            return verdict
        cells, steps = self.subject.evidence.cells, 0
        for k, one in enumerate(map(self.inside, cells) if cells else [self]):
            fault = one.missed()
            if fault:
                place = f"cell {k + 1}: " if cells else ""
                return undecided(place + fault)
            steps += one.following[0].steps
        return verdict.noted(f"followed over {steps} steps")

    def fades(self) -> Verdict:
        """Prove that errors fade, and how far they reach."""
        return super().decided()

    def missed(self) -> str:
        """Say what is not proved; "" where all is."""
        raise NotImplementedError


@dataclass(frozen=True)
class Run(Short):
    """The motion of one part of the box."""

    claim: Followed
    A: Centred
    b: Centred
    drives: tuple[Drive, ...]
    x0: Centred
    C: Centred
    F: Centred | None
    Q: list[Rationals]
    W: Centred | None

    @classmethod
    def of(cls, claim: Followed) -> Run:
        """Return the motion."""
        subject, F = claim.subject, claim.passing
        loop = subject.dual_loop(claim.outputs)
        none, drives = constant([[ZERO]] * subject.n, subject.sizes), claim.drives
        b, x0 = (Centred.of(M or none) for M in (claim.driving, claim.begun))
        passing = None if F is None else Centred.of(F)
        Q, W = subject.evidence.X, subject.turning
        turning = None if W is None else Centred.of(W)
        return cls(
            claim, Centred.of(loop.M), b, drives, x0, Centred.of(loop.Y), passing, Q, turning
        )

    @property
    def follower_variables(self) -> tuple[Fraction, ...]:
        """The largest size of each variable."""
        return variables(self.claim.subject.sizes)

    @property
    def follower(self) -> Follower:
        """What is followed."""
        own = self.claim.following[0]
        series = Series(own.terms, own.degree, own.bits)
        sizes, norm = self.claim.subject.sizes, norms(self.Q)
        return Follower(self.A, self.b, series, sizes, norm, own.rate, self.W, self.drives)

    @property
    def start(self) -> tuple[Form, Fraction]:
        """x(0) over 2^bits, or z(0) of x = W z, and how far x is off in the norm."""
        bits, whole, norm = self.claim.following[0].bits, self.x0.whole, sum(norms(self.Q))
        form = {e: [(row[0] << bits) // whole for row in M] for e, M in self.x0.terms.items()}
        rounded = len(form) * norm / 2**bits
        if self.W is None or not form:
            return form, rounded
        W = self.W

        def left(z: Form) -> Form:
            moved = {e: [x // W.whole for x in v] for e, v in W.times(z).items()}
            return _less(moved, form)

        found = self._solved(left, W)
        if found is None:
            raise FormatError("W is singular in the middle")
        return found[0], found[1] + rounded

    def output(self, x: Form, passing: Sequence[int] | None = None) -> tuple[Sums, Fraction]:
        """Return C x + F w over 2^bits, and what that is rounded by.

        Parameters
        ----------
        passing : sequence of int, optional
            w over 2^bits; that after all changes unless said.
        """
        bits = self.claim.following[0].bits
        total = {e: v[0] // self.C.whole for e, v in self.C.times(x).items()}
        off = len(total)
        if passing is None:
            passing = [0 if drive.rests else 1 << bits for drive in self.drives]
        if self.F is not None and any(passing):
            for e, M in self.F.terms.items():
                own = sum(map(int.__mul__, M[0], passing)) // self.F.whole
                total[e] = total.get(e, 0) + own
                off += 1
        return total, Fraction(off, 1 << bits)

    def final(self, follower: Follower) -> tuple[Form, Fraction] | None:
        """Return where x tends to, and how far that is off in the norm."""
        if not self.b.terms or all(drive.rests for drive in self.drives):
            return {}, ZERO
        end = self._solved(follower.rate_of, self.A)
        return None if end is None else (end[0], end[1] / follower.rate)

    def _solved(self, left: Callable[[Form], Form], P: Centred) -> tuple[Form, Fraction] | None:
        """Return x for which P x + c is nearly zero, and how large that is in the norm.

        None where P is singular in the middle.

        Parameters
        ----------
        left : callable
            From x to P x + c, each number rounded down twice at most.
        """
        own, n, follower = self.claim.following[0], self.claim.subject.n, self.follower
        middle = P.terms.get((0,) * len(follower.variables))
        exact = middle and right_divide(
            identity(n), [[Fraction(v, P.whole) for v in row] for row in middle]
        )
        if not exact:
            return None
        M = [[Fraction((x * 2**FEW).__floor__(), 2**FEW) for x in row] for row in exact]
        x, best = Form(), None
        for _ in range(own.degree + 3):
            over = left(x)
            rounded = 2 * len(over) * sum(follower.norm)
            size = (follower.size(over) + rounded) / 2**own.bits
            if best is None or size < best[1]:
                best = x, size
            moved = {
                e: [round(sum((a * y for a, y in zip(row, v, strict=True)), ZERO)) for row in M]
                for e, v in over.items()
                if sum(e) <= own.degree
            }
            x = _less(x, moved)
        return best

    def along(self, step: Step) -> tuple[Sums, Fraction]:
        """Return y over a step, over 2^bits, in powers of s and of g, and how far that is off."""
        total = Sums()
        off = ZERO
        for i, form in enumerate(step.forms):
            passing = [w[i] if i < len(w) else 0 for w, _ in step.driven]
            y, rounded = self.output(form, passing)
            off += rounded
            total |= {(i, *e): v for e, v in y.items()}
        for k, (_, own) in enumerate(step.driven):
            off += own * self._passed(k) if own else ZERO
        return total, off

    def _passed(self, k: int) -> Fraction:
        """Return how large F is at most, of one drive."""
        if self.F is None:
            return ZERO
        most, terms = self.follower_variables, self.F.terms.items()
        return sum((abs(M[0][k]) * monomial(e, most) for e, M in terms), ZERO) / self.F.whole


def _less(x: Form, y: Form) -> Form:
    """Return the difference of two forms."""
    none = [0] * len(next(iter((x or y).values()), []))
    return {
        e: [p - q for p, q in zip(x.get(e, none), y.get(e, none), strict=True)] for e in {**x, **y}
    }
