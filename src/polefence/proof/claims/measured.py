"""Measures of a response, at all times and for all values of the parameters.

From x(0) on, under a constant b or under none, x is followed as `polefence.proof.claims.followed`
has it, and so is y = C x + F w. Where x tends to is found by steps of Newton's method,
x = x - M (A x + b) with M about A^-1: by what is left, r = A x + b, it is off by |r|_Q / beta at
most; without b it is zero. After the last step, of time T,

    |y(t) - y(oo)| <= kappa exp(-beta (t - T)) |x(T) - x(oo)|_Q.

With the sign s of y(oo), the same for all parameters, a ``measure`` is at most ``level``:

    peak         |y(t)| <= level
    overshoot    s y(t) <= (1 + level) |y(oo)|
    undershoot   s y(t) >= -level |y(oo)|
    settling     |y(t) - y(oo)| <= band |y(oo)|  from t = level on; without b |y(t)| <= band
    rise         s y(level) >= (1 - band) |y(oo)|
    final        |y(oo)| <= level
    envelope     |y(t) - c(t)| <= level r(t) from the first point of an envelope on

with c = (upper + lower) / 2 and r = (upper - lower) / 2, which are linear between the points of an
envelope, and constant from its last one on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

from polefence.proof.claims.followed import Followed, Following, Run, Sums
from polefence.proof.claims.signal import Subject, outputs_text
from polefence.proof.matrices import ZERO
from polefence.proof.plant import Output, Plant
from polefence.proof.reading import Table, plain
from polefence.proof.response import Follower, Form, Step, positive
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up, number_text
from polefence.proof.work import FormatError

RELATIVE = ("overshoot", "undershoot", "settling", "rise")  # to a final value
MAX_POINTS = 64


@dataclass(frozen=True)
class Envelope(Short):
    """Numbers between which a signal is to stay: linear between points, the last for ever after.

    Attributes
    ----------
    points : tuple of (Fraction, Fraction, Fraction)
        Time [s], lower and upper number; before the first time nothing is asked.
    """

    points: tuple[tuple[Fraction, Fraction, Fraction], ...]

    @classmethod
    def read(cls, table: Table) -> Envelope | None:
        """Read it; None where there is none."""
        if "envelope" not in table:
            return None
        rows = table.matrix("envelope", None, 3)
        return cls(tuple((row[0], row[1], row[2]) for row in rows))

    def require(self) -> None:
        """Refuse times that do not rise, and numbers between which there is none."""
        times = self.times
        if not 1 <= len(times) <= MAX_POINTS:
            raise FormatError(f"envelope must have 1 to {MAX_POINTS} points")
        if times[0] < 0 or any(b <= a for a, b in pairwise(times)):
            raise FormatError("envelope: times must rise from zero or more")
        if any(upper <= lower for _, lower, upper in self.points):
            raise FormatError("envelope: each upper number must be above the lower one")

    @property
    def times(self) -> tuple[Fraction, ...]:
        """When its points are [s]."""
        return tuple(t for t, _, _ in self.points)

    def stretched(self, level: Fraction) -> Envelope:
        """Return it with so many times the width, about the same middle."""
        points = list[tuple[Fraction, Fraction, Fraction]]()
        for t, lower, upper in self.points:
            middle, half = (upper + lower) / 2, (upper - lower) / 2
            points.append((t, middle - level * half, middle + level * half))
        return Envelope(tuple(points))

    def at(self, t: Fraction) -> Sides:
        """Return lower and upper number at a time, not before the first."""
        for (t0, *one), (t1, *other) in pairwise(self.points):
            if t <= t1:
                share = (t - t0) / (t1 - t0)
                lower, upper = (a + share * (b - a) for a, b in zip(one, other, strict=True))
                return lower, upper
        return self.points[-1][1:]

    def __str__(self) -> str:
        shown = [
            f"{digits_down(lower)} to {digits_up(upper)} at {number_text(t)} s"
            for t, lower, upper in self.points
        ]
        return f"{', '.join(shown)} and ever after"


Sides = tuple[Fraction, Fraction]  # a lower and an upper number


@dataclass(frozen=True)
class MeasuredResponse(Followed):
    """A measure of y after a start is at most ``level``."""

    measures: ClassVar[tuple[str, ...]] = ("peak", "settling", "envelope")
    has_final: ClassVar[bool] = False  # whether it tends to a value that is not zero

    measure: str = field(default="peak", kw_only=True)
    band: Fraction = field(default=ZERO, kw_only=True)
    envelope: Envelope | None = field(default=None, kw_only=True)

    @property
    def after(self) -> str:
        """What the loop begins with, in words."""
        raise NotImplementedError

    @property
    def relative(self) -> bool:
        """Whether the measure is one beside the final value."""
        return self.has_final and self.measure in RELATIVE

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,
        outputs: tuple[Output, ...],
    ) -> dict[str, Any]:
        """Read the measure, its band or envelope, and how it is followed in each part."""
        return {
            "measure": table.word("measure", cls.measures),
            "band": table.number("band", 0),
            "envelope": Envelope.read(table),
        } | super().read_extra(table, subject, outputs)

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        table: dict[str, Any] = {"measure": self.measure}
        table |= {"band": plain(self.band)} if self.band else {}
        table |= {"envelope": plain(self.envelope.points)} if self.envelope else {}
        return table | super().write_extra()

    def require_extra(self) -> None:
        """Refuse a measure or a series that does not fit."""
        super().require_extra()
        if self.measure not in self.measures:
            raise FormatError(f"{self.kind}: it has no measure {self.measure!r}")
        if self.measure in ("settling", "rise") and self.band <= 0:
            raise FormatError("band must be above zero")
        if self.relative and self.band >= 1:
            raise FormatError("band must be below one")
        if (self.measure == "envelope") != (self.envelope is not None):
            raise FormatError("envelope: the measure of that name has one, and no other")
        if self.envelope is not None:
            self.envelope.require()

    @property
    def under(self) -> str:
        """What the loop begins with."""
        return f" {self.after}"

    def missed(self) -> str:
        """Say what is not proved; "" where all is."""
        run = self.run
        follower = run.follower
        end = run.final(follower)
        if end is None:
            return "where the signal tends to is not known"
        return _Compared.of(self, run, follower, *end).fault()

    def statement(self, plant: Plant) -> str:
        """Say what is proved; an envelope as it is where the level has stretched it."""
        what = outputs_text(self.outputs, plant)
        bound = f"<= {digits_up(self.level)}"
        if self.envelope is not None:
            bound = f"within {self.envelope.stretched(self.level)},"
        acting = f"{self.under}{self.acting_words(plant)}, on the {self.subject.on}"
        return f"{self._said} of {what} {bound}{acting}"

    @property
    def _said(self) -> str:
        """The measure, in words."""
        said = {"settling": "settling time", "rise": "rise time"}
        said |= {"envelope": f"{self.kind} response"}
        end = "its final value" if self.has_final else "zero"
        within = f" to within {digits_up(self.band)} of {end}" if self.band else ""
        return f"{said.get(self.measure, self.measure)}{within}"

    def named(self, plant: Plant) -> str:  # noqa: ARG002
        """Say in a few words what is bounded; of an envelope its width is."""
        width = "times the width of the envelope, " if self.envelope else ""
        return f"{width}{self._said} of {', '.join(self.names)}"


Compared = tuple[Sums, Fraction]  # a polynomial that is to be more than a number everywhere


@dataclass(frozen=True)
class _Compared:
    """The measure of one part of the box, as inequalities between polynomials of s and g.

    Attributes
    ----------
    claim : MeasuredResponse
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

    claim: MeasuredResponse
    run: Run
    follower: Follower
    x_end: Form
    off: Fraction
    y_end: Sums
    rounding: Fraction
    slack: Fraction

    @classmethod
    def of(
        cls, claim: MeasuredResponse, run: Run, follower: Follower, x_end: Form, off: Fraction
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
        return self.number(self.claim.level)

    def number(self, value: Fraction, slope: Fraction = ZERO) -> Sums:
        """Return value + slope s, its coefficients rounded down."""
        one, others = 2**self.following.bits, (0,) * len(self.follower.variables)
        both = {(k, *others): (x * one).__floor__() for k, x in enumerate((value, slope))}
        return both if slope else {(0, *others): both[0, *others]}

    @cached_property
    def envelope(self) -> Envelope | None:
        """The claim's envelope, as wide as its level makes it."""
        own = self.claim.envelope
        return None if own is None else own.stretched(self.claim.level)

    @property
    def times(self) -> tuple[Fraction, ...]:
        """When the envelope has points; none where there is none."""
        return () if self.envelope is None else self.envelope.times

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
        if self.claim.relative and not self.sign:
            return "the final value is not proved to be away from zero"
        last, error = self.run.start
        for step in self.follower.steps(last, self.following.every, error):
            last, error = step.last, step.error
            if measure == "rise" and step.end == level:
                risen = self.holds(self._risen(last, error))
                return "" if risen else f"the signal has not risen at {float(level):g} s"
            if measure == "rise" or (measure == "settling" and step.end <= level):
                continue
            if measure == "settling" and step.begin < level:
                return "the steps have no end at the settling time"
            if self.times and step.end <= self.times[0]:
                continue
            if any(step.begin < t < step.end for t in self.times):
                return "the steps have no end at a point of the envelope"
            y, rounded = self.run.along(step)
            if not self._kept(y, self.following.reach * error + rounded + self.ulp, step):
                return f"it is not proved from {float(step.begin):g} to {float(step.end):g} s"
        if measure == "rise":
            return "the steps have no end at the rise time"
        if any(sum(self.following.every) < t for one in self.run.drives for t in one.changes):
            return "the steps end before the bump does"
        if measure == "settling" and sum(self.following.every) < level:
            return "the steps end before the settling time"
        if self.times and sum(self.following.every) < self.times[-1]:
            return "the steps end before the last point of the envelope"
        return "" if self._kept_after(last, error) else "it is not proved after the last step"

    def _within(self, limit: Sums, q: Sums, slack: Fraction) -> bool:
        """Whether |q| is less than a limit by more than a number."""
        return all(self.holds((_sum(limit, _times(q, sign)), slack)) for sign in (1, -1))

    def _between(self, y: Sums, slack: Fraction, begin: Fraction, end: Fraction) -> bool:
        """Whether y is within the envelope, which has no point inside this time."""
        if self.envelope is None:
            return False
        ends = zip(self.envelope.at(begin), self.envelope.at(end), strict=True)
        for sign, (first, last) in zip((-1, 1), ends, strict=True):
            side = self.number(sign * (first + last) / 2, sign * (last - first) / 2)
            if not self.holds((_sum(side, _times(y, -sign)), slack + self.ulp)):
                return False
        return True

    def _kept(self, y: Sums, slack: Fraction, step: Step) -> bool:
        """Whether the signal keeps what is claimed, where y is as far off as the slack."""
        level, band = self.claim.level, self.claim.band
        match self.claim.measure:
            case "envelope":
                return self._between(y, slack, step.begin, step.end)
            case "peak":
                return self._within(self.level, y, slack)
            case "settling" if not self.claim.has_final:
                return self._within(self.number(band), y, slack)
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
        if self.claim.measure == "envelope":
            return self._between(self.y_end, tail + self.slack, self.times[-1], self.times[-1])
        if not self.claim.has_final:
            return self.holds((self.number(self.claim.band), tail))
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
