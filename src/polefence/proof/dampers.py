"""Controllable dampers: inputs between two curves of a rate, straight lines or bent at points.

A curve F(v) is linear between its points and goes on beyond them as it ended; F(0) = 0. A line
through zero, c v, is one of no bend. Both curves have the sign of v, and the lower is within the
higher: u = c v, c from the least F(v) / v of the one to the largest of the other, which are those
at bends, at zero and far out, as F(v) / v goes up or down along each straight part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

from polefence.proof.claims.signal import require_shapes
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Plant
from polefence.proof.reading import MAX_SIZE, Table, as_list, as_number, plain, plain_rows
from polefence.proof.short import Short
from polefence.proof.text import number_text, output_text
from polefence.proof.work import FormatError

MAX_POINTS = 40  # of a curve

Line = tuple[Fraction, Fraction]  # slope and value at zero
Part = tuple[Fraction | None, Fraction | None]  # from where to where; None for no end


@dataclass(frozen=True)
class Curve(Short):
    """A force by a rate, piecewise linear.

    Attributes
    ----------
    points : tuple of pairs of Fraction
        Rate and force, by ascending rates.
    """

    points: tuple[tuple[Fraction, Fraction], ...]

    @classmethod
    def line(cls, c: Fraction) -> Self:
        """Return c v."""
        return cls(((Fraction(0), Fraction(0)), (Fraction(1), c)))

    @classmethod
    def read(cls, value: Any, where: str) -> Self:
        """Read a coefficient, or points."""
        if not isinstance(value, list):
            return cls.line(as_number(value, where))
        pairs = (as_list(pair, where, 2, 2) for pair in as_list(value, where, MAX_POINTS, 2))
        return cls(tuple((as_number(v, where), as_number(F, where)) for v, F in pairs))

    def write(self) -> Any:
        """Return what `read` reads."""
        c = self.points[-1][1]
        return plain(c) if self == Curve.line(c) else plain(self.points)

    @cached_property
    def slopes(self) -> tuple[Fraction, ...]:
        """From each point to the next."""
        return tuple((G - F) / (w - v) for (v, F), (w, G) in pairwise(self.points))

    @cached_property
    def bends(self) -> tuple[Fraction, ...]:
        """Rates at which the slope changes."""
        inner = zip(self.points[1:-1], pairwise(self.slopes), strict=True)
        return tuple(v for (v, _), (before, after) in inner if before != after)

    def along(self, v: Fraction) -> Line:
        """Return the line that it is just above a rate."""
        k = max((k for k, (w, _) in enumerate(self.points[:-1]) if w <= v), default=0)
        (w, F), slope = self.points[k], self.slopes[k]
        return slope, F - slope * w

    def at(self, v: Fraction) -> Fraction:
        """Return its value."""
        slope, start = self.along(v)
        return slope * v + start

    @cached_property
    def ratios(self) -> tuple[Fraction, Fraction]:
        """The least and the largest F(v) / v."""
        found = [self.slopes[0], self.slopes[-1]]
        found += [F / v for v, F in self.points if v]
        # next to zero, where a point is; elsewhere it is a straight line through it
        found += [s for (v, _), s in zip(self.points, self.slopes, strict=False) if not v]
        found += [s for (v, _), s in zip(self.points[1:], self.slopes, strict=True) if not v]
        return min(found), max(found)

    def fault(self) -> str | None:
        """Say what is wrong with its points."""
        rates = [v for v, _ in self.points]
        if len(rates) < 2 or any(v >= w for v, w in pairwise(rates)):
            return "rates must ascend, of two points or more"
        if self.at(Fraction(0)):
            return "it must be zero where the rate is; give it the point [0, 0]"
        return None

    @property
    def text(self) -> str:
        """As sentences have it."""
        c = self.points[-1][1]
        if self == Curve.line(c):
            return number_text(c)
        pairs = (f"({number_text(v)}, {number_text(F)})" for v, F in self.points)
        return f"the line by {' '.join(pairs)}"


@dataclass(frozen=True)
class SemiActive(Short):
    """An input between two curves of a rate, at any time.

    Attributes
    ----------
    number : int
        Of the input, counted from zero.
    rate : list of matrices
        Of one row, at every vertex: the rate by the state.
    low, high : Curve
    """

    number: int
    rate: list[Rationals]
    low: Curve
    high: Curve

    @property
    def ends(self) -> tuple[Fraction, Fraction]:
        """The least and the largest coefficient."""
        return self.low.ratios[0], self.high.ratios[1]

    @property
    def straight(self) -> bool:
        """Whether both curves are lines."""
        return not (self.low.bends or self.high.bends)

    @property
    def parts(self) -> list[Part]:
        """Ranges of the rate in which both curves are lines."""
        bends = sorted({*self.low.bends, *self.high.bends})
        return list(pairwise([None, *bends, None]))

    @property
    def case_count(self) -> int:
        """In how many cases its force is a line: three a part, one where both curves are one."""
        return sum(1 if low == high else 3 for low, high in map(self.lines, self.parts))

    def lines(self, part: Part) -> tuple[Line, Line]:
        """Return both curves in a range of the rate."""
        below = min(self.low.points[0][0], self.high.points[0][0]) - 1
        start = below if part[0] is None else part[0]
        return self.low.along(start), self.high.along(start)

    def between(self, share: Fraction) -> Curve:
        """Return the curve that is a share of the way from low to high at every rate.

        >>> one, two = (Curve.line(Fraction(c)) for c in (1, 3))
        >>> SemiActive(0, [], one, two).between(Fraction(1, 2)) == Curve.line(Fraction(2))
        True
        """
        rates = sorted({v for curve in (self.low, self.high) for v, _ in curve.points})
        pairs = ((v, self.low.at(v), self.high.at(v)) for v in rates)
        return Curve(tuple((v, low + share * (high - low)) for v, low, high in pairs))

    def rows(self, vertex: int, m: int) -> tuple[list[Fraction], list[Fraction]]:
        """Return u - c1 v and u - c2 v by (x, u), of the least and the largest coefficient."""
        rate, push = self.rate[vertex][0], [Fraction(int(k == self.number)) for k in range(m)]
        first, second = ([*(-c * x for x in rate), *push] for c in self.ends)
        return first, second

    def require(self, N: int, n: int, m: int) -> None:
        """Refuse what does not fit a plant.

        Raises
        ------
        FormatError
        """
        if type(self.number) is not int or not 0 <= self.number < m:
            raise FormatError(f"damper: input {self.number!r} is not one of 0 to {m - 1}")
        require_shapes(self.rate, N, 1, n, "rate")
        for name, curve in (("low", self.low), ("high", self.high)):
            if len(curve.points) > MAX_POINTS:
                raise FormatError(f"damper: {name}: at most {MAX_POINTS} points")
            if fault := curve.fault():
                raise FormatError(f"damper: {name}: {fault}")
        if not self.nested:
            raise FormatError("damper: low must not be above high")

    @property
    def nested(self) -> bool:
        """Whether low is nowhere further from zero than high."""
        bends = {*self.low.bends, *self.high.bends}
        within = all((self.high.at(v) - self.low.at(v)) * v >= 0 for v in bends)
        return within and all(self.low.slopes[k] <= self.high.slopes[k] for k in (0, -1))

    @property
    def numbers(self) -> list[Rationals]:
        """All that it is given by."""
        points = [list(pair) for curve in (self.low, self.high) for pair in curve.points]
        return [*self.rate, points]

    def write(self) -> dict[str, Any]:
        """Return it as a file has it."""
        rows = {"input": self.number + 1, "rate": plain_rows(self.rate)}
        return rows | {"low": self.low.write(), "high": self.high.write()}

    @property
    def bounds_text(self) -> str:
        """Describe the bounds of the damper's force."""
        none = [[[Fraction(0)]]] * len(self.rate)
        rate = output_text(self.rate, none)
        if self.straight and self.low == Curve.line(self.low.slopes[0]):
            return f"{self.low.text} to {self.high.text} times ({rate})"
        return f"{self.low.text} to {self.high.text} at ({rate})"

    @property
    def range_text(self) -> str:
        """Say which input it is, and between what."""
        return f"u{self.number + 1} from {self.bounds_text}"


def read_dampers(table: Table, plant: Plant) -> tuple[SemiActive, ...]:
    """Read the dampers of a claim, none where it has no such key."""
    rows = table.tables("dampers", MAX_SIZE) if "dampers" in table else []
    return tuple(
        SemiActive(
            row.whole("input", None, plant.m, 1) - 1,
            row.rows("rate", plant.n, len(plant.A)),
            Curve.read(row.at("low"), row.path("low")),
            Curve.read(row.at("high"), row.path("high")),
        )
        for row in rows
    )


def dampers_text(dampers: Sequence[SemiActive]) -> str:
    """Say between what their forces are."""
    return ", ".join(damper.range_text for damper in dampers)
