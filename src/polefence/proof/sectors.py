"""Quadratic forms that are nowhere negative on what a controllable damper does.

A damper with a demand q and a rate v gives the force u in the middle of q and its two curves. In
the plane of q and v that is a region for each part of the curves, cut at v = 0 besides, and each of
three cases; u is a line in (q, v, 1) there, and the region is where some lines l of (q, v, 1) are
not negative. A form s of (q, v, u, 1) is not negative on all of these (q, v, u) if in each region

    s(q, v, u, 1) - sum of t_ab l_a l_b > 0,  t_ab > 0,

over the pairs of its lines and 1. The regions of a damper are added up, those of several are not
multiplied.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, pairwise
from typing import Any, Self

from polefence.proof.dampers import Part, SemiActive
from polefence.proof.matrices import Rationals, identity, product
from polefence.proof.reading import MAX_SIZE, Table, as_list, as_number, plain
from polefence.proof.short import Short
from polefence.proof.text import digits_down
from polefence.proof.work import FormatError

GIVEN, LOWER, UPPER = range(3)  # what a damper does in a case: the demand, or one of its bounds
WORDS = ("as demanded", "at its lower bound", "at its upper bound")
MAX_REGIONS = 1000

Row = list[Fraction]


@dataclass(frozen=True)
class Region(Short):
    """Where a damper does one thing: its force by (q, v, 1), where lines are not negative.

    The last of the lines is 1.
    """

    words: str
    force: Row
    lines: list[Row]

    @property
    def pairs(self) -> list[tuple[Row, Row]]:
        """The lines two by two."""
        return list(combinations(self.lines, 2))


@dataclass(frozen=True)
class Sector(Short):
    """A form of (q, v, u, 1), and what proves that it is not negative.

    Attributes
    ----------
    form : 4 x 4 rationals
    shares : tuple of tuples of Fraction
        t of each pair of lines, for each region; see `regions_of`.
    """

    form: Rationals
    shares: tuple[tuple[Fraction, ...], ...]

    @classmethod
    def read(cls, table: Table) -> Self:
        """Read it from a file."""
        where, rows = table.path("shares"), list[tuple[Fraction, ...]]()
        for k, row in enumerate(table.items("shares", MAX_REGIONS)):
            place = f"{where}[{k + 1}]"
            rows.append(tuple(as_number(x, place) for x in as_list(row, place, MAX_SIZE)))
        return cls(table.matrix("form", 4, 4), tuple(rows))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        return {"form": plain(self.form), "shares": plain(self.shares)}

    def require(self, damper: SemiActive) -> None:
        """Refuse what does not fit a damper.

        Raises
        ------
        FormatError
        """
        counts = [len(region.pairs) for region in regions_of(damper)]
        if len(self.form) != 4 or any(len(row) != 4 for row in self.form):
            raise FormatError("sectors: each form must be 4 x 4")
        if [len(row) for row in self.shares] != counts:
            raise FormatError("sectors: there must be a share for each pair of each region's lines")

    @property
    def numbers(self) -> list[Rationals]:
        """All that it is given by."""
        return [self.form, *([list(row)] for row in self.shares)]

    def blocks(self, damper: SemiActive) -> Iterator[tuple[str, Rationals]]:
        """Yield what is to be positive definite in each region, with its name."""
        for region, shares in zip(regions_of(damper), self.shares, strict=True):
            matrix = on_graph(self.form, region.force)
            for k, (share, (a, b)) in enumerate(zip(shares, region.pairs, strict=True)):
                yield f"share {k + 1}, {region.words}", [[share]]
                for i, k in ((i, k) for i in range(3) for k in range(3)):
                    matrix[i][k] -= share * (a[i] * b[k] + b[i] * a[k]) / 2
            yield f"of a sector, {region.words}", matrix


def regions_of(damper: SemiActive) -> list[Region]:
    """Return what a damper does in the plane of demand and rate.

    >>> one = SemiActive(0, [], *(Curve.line(Fraction(c)) for c in (1, 2)))
    >>> [len(region.lines) for region in regions_of(one)]
    [3, 4, 3, 3, 4, 3]
    """
    zero, one = Fraction(0), Fraction(1)
    cuts = sorted({zero, *damper.low.bends, *damper.high.bends})
    regions, asked = list[Region](), [one, zero, zero]
    for part in pairwise([None, *cuts, None]):
        start, end = part
        sign = -1 if start is None or start < 0 else 1  # of the rate: the curves have it too
        low, high = ([zero, c, d] for c, d in damper.lines(part))
        within = [] if start is None else [[zero, one, -start]]
        within += [] if end is None else [[zero, -one, end]]
        cases: list[tuple[int, Row, list[tuple[Row, Row]]]] = [
            (GIVEN, asked, [(asked, low), (high, asked)]),
            (LOWER, low, [(low, asked)]),
            (UPPER, high, [(asked, high)]),
        ]
        if low == high:  # whatever is demanded
            cases = [(LOWER, low, [])]
        for what, force, beside in cases:
            lines = [
                [sign * (x - y) for x, y in zip(more, less, strict=True)] for more, less in beside
            ]
            said = f"u{damper.number + 1} {WORDS[what]}{part_text(part)}"
            regions.append(Region(said, force, [*within, *lines, [zero, zero, one]]))
    return regions


def on_graph(form: Rationals, force: Sequence[Fraction]) -> Rationals:
    """Return the form by (q, v, 1) where the force is a line in these."""
    q, v, one = identity(3)
    place = [q, v, list(force), one]
    return product([list(column) for column in zip(*place, strict=True)], product(form, place))


def part_text(part: Part) -> str:
    """Say where the rate is."""
    start, end = (None if x is None else digits_down(x) for x in part)
    if start is not None and end is not None:
        return f", its rate from {start} to {end}"
    return f", its rate from {start}" if start else f", its rate to {end}" if end else ""
