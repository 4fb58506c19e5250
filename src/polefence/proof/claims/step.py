"""What a constant disturbance makes of a signal, at all times and for all values of the parameters.

From rest and under w constant from time zero on, x is followed by polynomials in time and in the
parameters over the steps of a series, see `polefence.proof.response`, and so is y = C x + F w.
How far they are off is measured by |e|_Q = sqrt(e'Q e), of which is proved

    -(Q A + A'Q) - 2 beta Q > 0,    [ kappa^2, C; C', Q ] > 0,    so |C e| <= kappa |e|_Q.

Where x tends to is found by steps of Newton's method, x = x - M (A x + b) with M about A^-1: by
what is left, r = A x + b, it is off by |r|_Q / beta at most. After the last step, of time T,

    |y(t) - y(oo)| <= kappa exp(-beta (t - T)) |x(T) - x(oo)|_Q.

With the sign s of y(oo), the same for all parameters, a ``measure`` is at most ``level``:

    peak         |y(t)| <= level
    overshoot    s y(t) <= (1 + level) |y(oo)|
    undershoot   s y(t) >= -level |y(oo)|
    settling     |y(t) - y(oo)| <= band |y(oo)|  from t = level on
    rise         s y(level) >= (1 - band) |y(oo)|
    final        |y(oo)| <= level
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.base import Verdict, undecided
from polefence.proof.claims.signal import Rows, SignalClaim, Subject
from polefence.proof.matrices import ONE, ZERO, Rationals, inverse
from polefence.proof.plant import Output, Plant
from polefence.proof.polynomials import constant, number
from polefence.proof.reading import Table, plain
from polefence.proof.response import (
    Centred,
    Follower,
    Form,
    Series,
    norms,
    positive,
    variables,
)
from polefence.proof.short import Short
from polefence.proof.text import digits_up
from polefence.proof.work import FormatError

MEASURES = ("peak", "overshoot", "undershoot", "settling", "rise", "final")
RELATIVE = ("overshoot", "undershoot", "settling", "rise")
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
class StepResponse(SignalClaim):
    """A measure of y after a step of the disturbances, each of its scale, is at most ``level``."""

    kind: ClassVar[str] = "step"
    direct: ClassVar[bool] = True
    has_dual: ClassVar[bool] = True
    has_motion: ClassVar[bool] = False
    has_passing: ClassVar[bool] = True

    measure: str = field(default="peak", kw_only=True)
    band: Fraction = field(default=ZERO, kw_only=True)
    following: tuple[Following, ...] = field(default=(), kw_only=True)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read the measure, its band, and how it is followed in each part."""
        return {
            "measure": table.word("measure", MEASURES),
            "band": table.number("band", 0),
            "following": tuple(map(Following.read, table.tables("following", 20_000))),
        }

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        table: dict[str, Any] = {"measure": self.measure}
        table |= {"band": plain(self.band)} if self.band else {}
        return table | {"following": [own.write() for own in self.following]}

    def require_extra(self) -> None:
        """Refuse a measure or a series that does not fit."""
        evidence = self.subject.evidence
        if self.subject.step:
            raise FormatError("step: of a plant in continuous time")
        if self.subject.remainder is not None or self.subject.law.W is not None:
            raise FormatError("step: of a plant that is known exactly, and a law that is no Z W^-1")
        if not evidence.dual:
            raise FormatError("step: its evidence is a Q in each part of the box")
        if len(self.following) != 1:
            raise FormatError("following: there must be one for each part of the box")
        if self.measure in ("settling", "rise") and not 0 < self.band < 1:
            raise FormatError("band must be above zero and below one")
        self.following[0].require()

    def inside(self, piece: Any) -> StepResponse:
        """Return the claim about a part of the box, with its own series."""
        if len(self.following) != len(self.subject.evidence.cells):
            raise FormatError("following: there must be one for each part of the box")
        return self.part(piece, self.following[self.subject.evidence.cells.index(piece)])

    def part(self, piece: Any, following: Following | None) -> StepResponse:
        """Return the claim about a part of the box that is followed so."""
        own = () if following is None else (following,)
        return replace(super().inside(piece), following=own)

    @property
    def run(self) -> Run:
        """The motion that is followed."""
        return Run.of(self)

    def _with(self, piece: Any) -> StepResponse:
        return replace(super()._with(piece), following=self.following[:1])

    def dual_rows(self) -> Rows:
        """Return that errors fade, and how far they reach."""
        own, loop = self.following[0], self.subject.dual_loop(self.outputs)
        falling = (loop.QM + loop.QM.T + loop.Q.times(2 * own.rate)).times(-1)
        reach = [[number(own.reach**2, loop.Q.sizes), loop.Y], [loop.Q]]
        return {"of the decrease": [[falling]], "of the output": reach}

    @property
    def largest(self) -> int:
        """Rows of the largest inequality."""
        return self.subject.n + 1

    @property
    def under(self) -> str:
        """After a step."""
        return " after a step"

    def decided(self) -> Verdict:
        """Prove that errors fade, and then the measure, in each part of the box."""
        verdict = self.fades()
        if not verdict.proved:
            return verdict
        cells, steps = self.subject.evidence.cells, 0
        for k, one in enumerate(map(self.inside, cells) if cells else [self]):
            fault = one._missed()
            if fault:
                place = f"cell {k + 1}: " if cells else ""
                return undecided(place + fault)
            steps += one.following[0].steps
        return verdict.noted(f"followed over {steps} steps")

    def fades(self) -> Verdict:
        """Prove that errors fade, and how far they reach."""
        return super().decided()

    def _missed(self) -> str:
        """Say what is not proved; "" where all is."""
        return self.run.fault()

    def statement(self, plant: Plant) -> str:
        """Say what is proved."""
        text = super().statement(plant)
        said = {"settling": "settling time", "rise": "rise time"}.get(self.measure, self.measure)
        within = f" to within {digits_up(self.band)} of its final value" if self.band else ""
        return text.replace(f"{self.kind} of ", f"{said}{within} of ", 1)


@dataclass(frozen=True)
class Run(Short):
    """The motion of one part of the box."""

    claim: StepResponse
    A: Centred
    b: Centred
    C: Centred
    F: Centred | None
    Q: list[Rationals]

    @classmethod
    def of(cls, claim: StepResponse) -> Run:
        """Return the motion."""
        subject = claim.subject
        loop = subject.dual_loop(claim.outputs)
        every = constant([[ONE] for _ in range(subject.q)], subject.sizes)
        b = subject.driving(claim.scales, subject.sizes) * every
        passing = subject.through(claim.outputs, claim.scales)
        F = None if passing is None else Centred.of(passing * every)
        Q = subject.evidence.X
        return cls(claim, Centred.of(loop.M), Centred.of(b), Centred.of(loop.Y), F, Q)

    @property
    def follower_variables(self) -> tuple[Fraction, ...]:
        """The largest size of each variable."""
        return variables(self.claim.subject.sizes)

    @property
    def follower(self) -> Follower:
        """What is followed."""
        own = self.claim.following[0]
        series = Series(own.terms, own.degree, own.bits)
        return Follower(self.A, self.b, series, self.claim.subject.sizes, norms(self.Q), own.rate)

    def output(self, x: Form, *, direct: bool = True) -> tuple[dict[Any, int], Fraction]:
        """Return C x + F over 2^bits, and what that is rounded by."""
        bits = self.claim.following[0].bits
        total = {e: v[0] // self.C.whole for e, v in self.C.times(x).items()}
        off = len(total)
        if self.F is not None and direct:
            for e, M in self.F.terms.items():
                total[e] = total.get(e, 0) + (M[0][0] << bits) // self.F.whole
                off += 1
        return total, Fraction(off, 1 << bits)

    def final(self, follower: Follower) -> tuple[Form, Fraction] | None:
        """Return where x tends to, and how far that is off in the norm."""
        own, n = self.claim.following[0], self.claim.subject.n
        middle = self.A.terms.get((0,) * len(follower.variables))
        if middle is None:
            return None
        exact = inverse([[Fraction(v, self.A.whole) for v in row] for row in middle], "A")
        M = [[Fraction((x * 2**FEW).__floor__(), 2**FEW) for x in row] for row in exact]
        x: Form = {}
        best: tuple[Form, Fraction] | None = None
        for _ in range(own.degree + 3):
            left = follower.rate_of(x)
            rounded = 2 * len(left) * sum(follower.norm)
            size = (follower.size(left) + rounded) / 2**own.bits / own.rate
            if best is None or size < best[1]:
                best = x, size
            moved: Form = {}
            for e, v in left.items():
                if sum(e) <= own.degree:
                    moved[e] = [
                        round(sum((a * y for a, y in zip(row, v, strict=True)), ZERO)) for row in M
                    ]
            x = {
                e: [p - q for p, q in zip(x.get(e, [0] * n), moved.get(e, [0] * n), strict=True)]
                for e in {**x, **moved}
            }
        return best

    def fault(self) -> str:
        """Say what is not proved; "" where all is."""
        claim, follower = self.claim, self.follower
        own, ends = claim.following[0], self.final(follower)
        if ends is None:
            return "where the signal tends to is not known"
        x_end, off = ends
        y_end, rounding = self.output(x_end)
        slack_end = own.reach * off + rounding
        bits, most = own.bits, follower.variables
        zero = (0,) * len(most)

        def holds(q: dict[Any, int], slack: Fraction) -> bool:
            """Whether a polynomial of s and g, over 2^bits, is more than its slack everywhere."""
            taken = dict(q)
            key = (0, *zero)
            taken[key] = taken.get(key, 0) - -(-(slack * 2**bits).__floor__() - 1)
            return positive(taken, most)

        def lifted(q: dict[Any, int], factor: Fraction = ONE) -> dict[Any, int]:
            return {(0, *e): (factor * v).__floor__() for e, v in q.items()}

        def plus(*forms: dict[Any, int]) -> dict[Any, int]:
            total: dict[Any, int] = {}
            for one in forms:
                for e, v in one.items():
                    total[e] = total.get(e, 0) + v
            return total

        def times(q: dict[Any, int], sign: int) -> dict[Any, int]:
            return {e: sign * v for e, v in q.items()}

        level = {(0, *zero): (claim.level * 2**bits).__floor__()}
        ulp = Fraction(len(y_end) + 4, 2**bits)
        if claim.measure == "final":
            return next(
                (
                    "the final value is not proved to be so small"
                    for sign in (1, -1)
                    if not holds(plus(level, times(lifted(y_end), sign)), slack_end + ulp)
                ),
                "",
            )
        sign = 0
        if claim.measure in RELATIVE:
            sign = next((s for s in (1, -1) if holds(times(lifted(y_end), s), slack_end)), 0)
            if not sign:
                return "the final value is not proved to be away from zero"

        def share(factor: Fraction) -> dict[Any, int]:
            return lifted(times(y_end, sign), factor)

        last: Form = {}
        error = ZERO
        for step in follower.steps({}, own.every):
            begin, end = step.begin, step.end
            y, rounded = self.along(step.forms)
            slack = own.reach * step.error + rounded + ulp
            last, error = step.last, step.error
            if claim.measure == "peak":
                asked = [(plus(level, times(y, s)), slack) for s in (1, -1)]
            elif claim.measure == "overshoot":
                asked = [
                    (
                        plus(share(1 + claim.level), times(y, -sign)),
                        slack + (1 + claim.level) * slack_end,
                    )
                ]
            elif claim.measure == "undershoot":
                asked = [
                    (plus(share(claim.level), times(y, sign)), slack + claim.level * slack_end)
                ]
            elif claim.measure == "settling":
                if end <= claim.level:
                    continue
                if begin < claim.level:
                    return "the steps have no end at the settling time"
                gap = plus(y, times(lifted(y_end), -1))
                both = slack + (1 + claim.band) * slack_end
                asked = [(plus(share(claim.band), times(gap, s)), both) for s in (1, -1)]
            else:  # a rise
                if end != claim.level:
                    continue
                y_now, off_now = self.output(last)
                q = plus(lifted(times(y_now, sign)), times(share(1 - claim.band), -1))
                both = own.reach * error + off_now + ulp + (1 - claim.band) * slack_end
                return "" if holds(q, both) else f"the signal has not risen at {float(end):g} s"
            for q, room in asked:
                if not holds(q, room):
                    return f"it is not proved from {float(begin):g} to {float(end):g} s"
        if claim.measure == "rise":
            return "the steps have no end at the rise time"
        n = claim.subject.n
        gap_x = {
            e: [p - q for p, q in zip(last.get(e, [0] * n), x_end.get(e, [0] * n), strict=True)]
            for e in {**last, **x_end}
        }
        tail = own.reach * (follower.size(gap_x) / 2**bits + error + off) + rounding
        if claim.measure == "peak":
            after = [(plus(level, times(lifted(y_end), s)), tail + slack_end) for s in (1, -1)]
        elif claim.measure == "undershoot":
            after = [(share(1 + claim.level), tail + (1 + claim.level) * slack_end)]
        else:
            of = claim.level if claim.measure == "overshoot" else claim.band
            after = [(share(of), tail + of * slack_end)]
        if claim.measure == "settling" and sum(own.every) < claim.level:
            return "the steps end before the settling time"
        for q, room in after:
            if not holds(q, room + ulp):
                return "it is not proved after the last step"
        return ""

    def along(self, forms: tuple[Form, ...]) -> tuple[dict[Any, int], Fraction]:
        """Return y over a step, over 2^bits, in powers of s and of g, and its rounding."""
        total: dict[Any, int] = {}
        off = ZERO
        for i, form in enumerate(forms):
            y, rounded = self.output(form, direct=i == 0)
            off += rounded
            total |= {(i, *e): v for e, v in y.items()}
        return total, off
