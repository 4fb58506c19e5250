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

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

from polefence.proof.claims.followed import Followed, Following, Run, Sums
from polefence.proof.claims.signal import Subject
from polefence.proof.matrices import ZERO
from polefence.proof.plant import Output, Plant
from polefence.proof.reading import Table, plain
from polefence.proof.response import Follower, Form, positive
from polefence.proof.text import digits_up
from polefence.proof.work import FormatError

MEASURES = ("peak", "overshoot", "undershoot", "settling", "rise", "final")
RELATIVE = ("overshoot", "undershoot", "settling", "rise")


@dataclass(frozen=True)
class StepResponse(Followed):
    """A measure of y after a step of the disturbances, each of its scale, is at most ``level``."""

    kind: ClassVar[str] = "step"

    measure: str = field(default="peak", kw_only=True)
    band: Fraction = field(default=ZERO, kw_only=True)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,
        outputs: tuple[Output, ...],
    ) -> dict[str, Any]:
        """Read the measure, its band, and how it is followed in each part."""
        own = {"measure": table.word("measure", MEASURES), "band": table.number("band", 0)}
        return own | super().read_extra(table, subject, outputs)

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        table: dict[str, Any] = {"measure": self.measure}
        table |= {"band": plain(self.band)} if self.band else {}
        return table | super().write_extra()

    def require_extra(self) -> None:
        """Refuse a measure or a series that does not fit."""
        super().require_extra()
        if self.measure in ("settling", "rise") and not 0 < self.band < 1:
            raise FormatError("band must be above zero and below one")

    @property
    def under(self) -> str:
        """After a step."""
        return " after a step"

    def missed(self) -> str:
        """Say what is not proved; "" where all is."""
        run = self.run
        follower = run.follower
        end = run.final(follower)
        if end is None:
            return "where the signal tends to is not known"
        return _Compared.of(self, run, follower, *end).fault()

    def statement(self, plant: Plant) -> str:
        """Say what is proved."""
        text = super().statement(plant)
        said = {"settling": "settling time", "rise": "rise time"}.get(self.measure, self.measure)
        within = f" to within {digits_up(self.band)} of its final value" if self.band else ""
        return text.replace(f"{self.kind} of ", f"{said}{within} of ", 1)


Compared = tuple[Sums, Fraction]  # a polynomial that is to be more than a number everywhere


@dataclass(frozen=True)
class _Compared:
    """The measure of one part of the box, as inequalities between polynomials of s and g.

    Attributes
    ----------
    claim : StepResponse
    run : Run
    follower : Follower
    x_end : Form
        Where x tends to.
    off : Fraction
        How far that is off, in the norm.
    y_end : polynomial
        The signal there.
    rounding, slack : Fraction
        How far that is rounded, and off in all.
    """

    claim: StepResponse
    run: Run
    follower: Follower
    x_end: Form
    off: Fraction
    y_end: Sums
    rounding: Fraction
    slack: Fraction

    @classmethod
    def of(
        cls, claim: StepResponse, run: Run, follower: Follower, x_end: Form, off: Fraction
    ) -> _Compared:
        """Return it."""
        y_end, rounding = run.output(x_end)
        slack = claim.following[0].reach * off + rounding
        return cls(claim, run, follower, x_end, off, _lifted(y_end), rounding, slack)

    @property
    def following(self) -> Following:
        """How the response is followed."""
        return self.claim.following[0]

    @property
    def ulp(self) -> Fraction:
        """How far products with a number are rounded, of all coefficients together."""
        return Fraction(len(self.y_end) + 4, 1 << self.following.bits)

    @property
    def level(self) -> Sums:
        """The claim's level."""
        zero = (0,) * (1 + len(self.follower.variables))
        return {zero: (self.claim.level * 2**self.following.bits).__floor__()}

    @cached_property
    def sign(self) -> int:
        """The sign of the final value; zero where it is not proved to have one."""
        return next((s for s in (1, -1) if self.holds((_times(self.y_end, s), self.slack))), 0)

    def size(self, factor: Fraction) -> Sums:
        """Return so many times the size of the final value."""
        return _times(self.y_end, self.sign * factor)

    def holds(self, compared: Compared) -> bool:
        """Whether a polynomial is more than a number everywhere."""
        q, slack = compared
        zero = (0,) * (1 + len(self.follower.variables))
        less = (slack * 2**self.following.bits).__floor__() + 1
        return positive(_sum(q, {zero: -less}), self.follower.variables)

    def fault(self) -> str:
        """Say what is not proved; "" where all is."""
        measure, level = self.claim.measure, self.claim.level
        if measure == "final":
            both = self._within(self.level, self.y_end, self.slack + self.ulp)
            return "" if both else "the final value is not proved to be so small"
        if measure in RELATIVE and not self.sign:
            return "the final value is not proved to be away from zero"
        last, error = Form(), ZERO
        for step in self.follower.steps({}, self.following.every):
            last, error = step.last, step.error
            if measure == "rise" and step.end == level:
                risen = self.holds(self._risen(last, error))
                return "" if risen else f"the signal has not risen at {float(level):g} s"
            if measure == "rise" or (measure == "settling" and step.end <= level):
                continue
            if measure == "settling" and step.begin < level:
                return "the steps have no end at the settling time"
            y, rounded = self.run.along(step.forms)
            if not self._kept(y, self.following.reach * error + rounded + self.ulp):
                return f"it is not proved from {float(step.begin):g} to {float(step.end):g} s"
        if measure == "rise":
            return "the steps have no end at the rise time"
        if measure == "settling" and sum(self.following.every) < level:
            return "the steps end before the settling time"
        return "" if self._kept_after(last, error) else "it is not proved after the last step"

    def _within(self, limit: Sums, q: Sums, slack: Fraction) -> bool:
        """Whether |q| is less than a limit by more than a number."""
        return all(self.holds((_sum(limit, _times(q, sign)), slack)) for sign in (1, -1))

    def _kept(self, y: Sums, slack: Fraction) -> bool:
        """Whether the signal keeps what is claimed, where y is as far off as the slack."""
        level, band = self.claim.level, self.claim.band
        match self.claim.measure:
            case "peak":
                return self._within(self.level, y, slack)
            case "overshoot":
                above = _sum(self.size(1 + level), _times(y, -self.sign))
                return self.holds((above, slack + (1 + level) * self.slack))
            case "undershoot":
                below = _sum(self.size(level), _times(y, self.sign))
                return self.holds((below, slack + level * self.slack))
        gap = _sum(y, _times(self.y_end, -1))
        return self._within(self.size(band), gap, slack + (1 + band) * self.slack)

    def _risen(self, x: Form, error: Fraction) -> Compared:
        """Return that the signal has come within the band of its final value, where x is."""
        share = 1 - self.claim.band
        y, rounded = self.run.output(x)
        risen = _sum(_times(_lifted(y), self.sign), _times(self.size(share), -1))
        off = self.following.reach * error + rounded + self.ulp
        return risen, off + share * self.slack

    def _kept_after(self, x: Form, error: Fraction) -> bool:
        """Whether what is claimed is kept after the last step, which ends where x is."""
        zero, level = [0] * self.claim.subject.n, self.claim.level
        gap = {
            e: [p - q for p, q in zip(x.get(e, zero), self.x_end.get(e, zero), strict=True)]
            for e in {**x, **self.x_end}
        }
        far = self.follower.far(gap) + error + self.off
        tail = self.following.reach * far + self.rounding + self.ulp
        if self.claim.measure == "peak":
            return self._within(self.level, self.y_end, tail + self.slack)
        share = {"undershoot": 1 + level, "overshoot": level}.get(
            self.claim.measure, self.claim.band
        )
        return self.holds((self.size(share), tail + share * self.slack))


def _lifted(q: Sums) -> Sums:
    """Return a polynomial of g as one of s and g."""
    return {(0, *e): v for e, v in q.items()}


def _sum(*forms: Sums) -> Sums:
    total = Sums()
    for form in forms:
        for e, v in form.items():
            total[e] = total.get(e, 0) + v
    return total


def _times(q: Sums, factor: Fraction | int) -> Sums:
    """Return the product with a number, its coefficients rounded down."""
    return {e: (factor * v).__floor__() for e, v in q.items()}
