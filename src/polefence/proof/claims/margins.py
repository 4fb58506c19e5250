"""Margins of a design: how much may go wrong, proved from its own matrices.

With X = W (of the law K = Z W^-1; for one gain its Lyapunov matrix), or of a law that was given
(the method lyapunov) each part's own X, three kinds of claims, each about every parameter value of
the plant, or every alpha where the plant has no parameters. Their inequalities are polynomials,
homogeneous in the coordinates of pieces of the parameters' intervals; each holds if all of its
coefficients, times (sum of coordinates)^elevation, are positive definite.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import MAX_BLOCKS, Claim, Inequality, require_work
from polefence.proof.claims.poles import Poles, plant_form
from polefence.proof.laws import Point, degree_of, lifted
from polefence.proof.matrices import Rationals, least_work
from polefence.proof.pieces import MAX_PIECES, coordinates_in, numbered
from polefence.proof.plant import Plant
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Polynomial,
    Sizes,
    count_of,
    form,
    monomials,
    number,
)
from polefence.proof.ranges import Range
from polefence.proof.reading import Table, plain
from polefence.proof.regions import Part
from polefence.proof.short import Short
from polefence.proof.text import digits_down, name_text, range_text, unit_text
from polefence.proof.work import FormatError, WorkError


@dataclass(frozen=True)
class Subject(Short):
    """The design that a claim is about, and how finely the claim is proved.

    ``ranges`` and ``pieces`` (equal parts of each interval) have one entry a parameter, none for a
    plant given by its vertices; ``elevation`` is the power of (sum of coordinates).
    """

    design: Poles
    ranges: tuple[Range, ...] = ()
    pieces: tuple[int, ...] = ()
    elevation: int = 0

    @property
    def sizes(self) -> Sizes:
        """Corners of the plant's own simplices: of its parameters, or the one of its vertices."""
        return (2,) * len(self.ranges) or (len(self.design.A),)

    def degree(self, part: int = 0) -> int:
        """Return the degree of X."""
        return degree_of(self.design.law, self.design.evidence[part])

    @property
    def plant_degree(self) -> int:
        """The degree of A and B: one, but for that of a curve."""
        remainder = self.design.remainder
        return 1 if remainder is None else remainder.degree

    @property
    def parts(self) -> Iterator[tuple[int, tuple[Part, ...]]]:
        """Each X by its number, with the parts of the region that it is for."""
        if self.design.method == "lyapunov":
            yield from ((k, (part,)) for k, part in enumerate(self.design.region))
        else:
            yield 0, self.design.region


@dataclass(frozen=True)
class MarginClaim(Short, Claim):
    """A claim about a design's loop when something is not as it is meant to be."""

    has_cells: ClassVar[bool] = False  # whether the design may be proved in parts of the box
    has_remainder: ClassVar[bool] = False  # whether its plant may have one

    subject: Subject

    @property
    def inner_points(self) -> list[Point]:
        """Nodes of the parts of the box that the design is proved in, but its corners."""
        return self.subject.design.inner_points

    @property
    def values(self) -> tuple[Fraction, ...] | None:
        """What is proved of each parameter, or one number without any; None of any value."""
        raise NotImplementedError

    @property
    def allowed(self) -> int | None:
        """Work that it may take; more in parts of the box."""
        return self.subject.design.allowed

    def value(self, name: str) -> Fraction | None:
        """Return what is proved of a parameter, or as a share of each range of all; None of any."""
        values, ranges = self.values, self.subject.ranges
        if values is None:
            return None
        if name:
            named = (v for v, r in zip(values, ranges, strict=True) if r.name == name)
            return next(named, Fraction(0))
        spans = [r.high - r.low for r in ranges] or [Fraction(1)]
        return min(value / span for value, span in zip(values, spans, strict=True))

    @classmethod
    def read_own(cls, table: Table, subject: Subject) -> dict[str, Any]:
        """Read the fields of this kind."""
        raise NotImplementedError

    def write_own(self) -> dict[str, Any]:
        """Return what `read_own` reads."""
        keys = [field.name for field in fields(self) if field.name != "subject"]
        return {key: plain(getattr(self, key)) for key in keys}

    def require_own(self, count: int) -> None:
        """Refuse fields of this kind that do not fit; ``count`` is that of parameters, or one."""

    def work(self) -> tuple[int, int]:
        """Return how many inequalities there are at most, W > 0 left out, and half their size."""
        raise NotImplementedError

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read the design's claim, how finely it is proved, and what the kind has of its own."""
        design = Poles.read(table, plant.at_rest, law, on)
        count = len(plant.ranges)
        pieces = table.items("pieces", count, count) if "pieces" in table else [1] * count
        if any(type(k) is not int for k in pieces):
            raise FormatError(f"{table.path('pieces')} must be a list of whole numbers")
        subject = Subject(design, plant.ranges, tuple(pieces), table.whole("elevation", 0))
        return cls(subject, **cls.read_own(table, subject))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table = self.subject.design.write() | {"kind": self.kind} | self.write_own()
        if self.subject.pieces:
            table["pieces"] = list(self.subject.pieces)
        return table | {"elevation": self.subject.elevation}

    def require(self) -> None:
        """Refuse designs that have no margins, and what is inconsistent or too much."""
        subject, count = self.subject, max(len(self.subject.ranges), 1)
        design = subject.design
        if design.method == "slack":
            raise FormatError("margins are not proved for the method slack")
        require_design(design)
        if design.remainder is not None and not self.has_remainder:
            raise FormatError(f"{self.kind}: needs a plant without remainder")
        if any(evidence.cells for evidence in design.evidence) and not self.has_cells:
            raise FormatError(f"cells: a claim of kind {self.kind} needs one X for all of the box")
        if subject.ranges and len(design.A) != 2 ** len(subject.ranges):
            raise FormatError(
                f"{len(subject.ranges)} parameters need {2 ** len(subject.ranges)} corners"
            )
        if not subject.ranges and len(design.sizes) > 1:
            raise FormatError("a law on a box needs the parameters' ranges")
        for r in subject.ranges:
            if r.low >= r.high or (r.inverted and r.low <= 0 <= r.high):
                raise FormatError("a parameter's range is empty, or touches zero where 1/p is used")
        if len(subject.pieces) != len(subject.ranges):
            raise FormatError("pieces must hold one whole number a parameter")
        if any(not 1 <= pieces <= MAX_PIECES for pieces in subject.pieces):
            raise FormatError(f"pieces must be 1 to {MAX_PIECES}")
        if not 0 <= subject.elevation <= MAX_DEGREE:
            raise FormatError(f"elevation must be 0 to {MAX_DEGREE}")
        self.require_own(count)
        blocks, size = self.work()
        if blocks > MAX_BLOCKS:
            raise WorkError("the inequalities are too many, or too large, to be checked here")
        require_work(least_work(blocks, 2 * size), self.allowed)

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield the design's Lyapunov matrices."""
        return self.subject.design.symmetric()

    def pieces_work(self, degree: int) -> int:
        """Return the number of coefficients of an inequality on all pieces, for all parts."""
        subject = self.subject
        raised = degree + subject.plant_degree + subject.elevation
        whole = math.prod(subject.pieces) * len(subject.design.region)
        return whole * count_of(subject.sizes, raised)

    def names(self, plant: Plant) -> list[tuple[str, str]]:
        """Return the names and units of the parameters, as they can be shown."""
        return [(name_text(r.name), unit_text(r.unit)) for r in plant.ranges]

    def within(self, plant: Plant) -> str:
        """Say which intervals the parameters have."""
        pairs = zip(self.names(plant), self.subject.ranges, strict=True)
        over = ", ".join(range_text(name, unit, r.low, r.high) for (name, unit), r in pairs)
        return f", {over}" if over else ""


def require_design(design: Poles) -> None:
    """Refuse laws whose evidence does not fit, tables of gains, and plants with weights."""
    design.require()
    if design.weights:
        raise FormatError("margins are not proved for plants with weights")
    if len(design.law.K or [()]) > 1 and not design.law.polynomial:
        raise FormatError("margins are not proved for tables of gains")


def require_numbers(
    values: tuple[Fraction, ...], count: int, key: str, positive: bool = False
) -> None:
    """Refuse other than so many numbers of zero or more."""
    if len(values) != count:
        raise FormatError(f"{key} must hold {count} numbers")
    if any(value < 0 or (positive and not value) for value in values):
        raise FormatError(f"{key} must be {'positive' if positive else 'zero or more'}")


def listed(text: str, names: list[tuple[str, str]], values: tuple[Fraction, ...]) -> str:
    """Fill a text with each name, value and unit."""
    pairs = zip(names, values, strict=True)
    return ", ".join(
        " ".join(text.format(name, digits_down(value, 4), unit).split())
        for (name, unit), value in pairs
    )


# --- plant and law on pieces ---------------------------------------------------------------------


@dataclass(frozen=True)
class Family(Short):
    """[A, B] and [X; K X] as polynomials on the plant's own simplices; X is W unless given."""

    AB: Polynomial
    XKX: Polynomial

    @property
    def n(self) -> int:
        """Number of states."""
        return self.XKX.shape[1]

    @property
    def X(self) -> Polynomial:
        """X alone."""
        return self.XKX.part(slice(self.n))

    @property
    def varies(self) -> bool:
        """Whether X differs with alpha."""
        return any(self.XKX.degrees)


def family_of(subject: Subject, part: int = 0) -> Family:
    """Return plant and law on the box of the parameters, or on the simplex without any."""
    design, sizes = subject.design, subject.sizes
    XKX = lifted(design.law, design.evidence[part], design.sizes)
    if design.sizes != sizes:  # at alpha that are products
        ones = (1,) * len(sizes)
        corners = [Polynomial({e: [[1]]}, sizes, ones) for e in monomials(sizes, 1)]
        XKX = XKX.composed(corners, sizes)
    AB = plant_form(design.A, design.B, sizes)
    return Family(AB if design.remainder is None else design.remainder.curved(AB), XKX)


@dataclass(frozen=True)
class Cell(Short):
    """A piece: coordinates of plant and law as forms (1 x 1) in the piece's own coordinates.

    The first ``raised`` simplices are elevated.
    """

    name: str
    sizes: Sizes
    plant: list[Polynomial]
    law: list[Polynomial]
    raised: int

    def loop(self, family: Family) -> tuple[Polynomial, Polynomial, Polynomial]:
        """Return X and N, of one degree, and [A, B]."""
        AB = family.AB.composed(self.plant, self.sizes)
        XKX = family.XKX.composed(self.law, self.sizes)
        whole = self._one(self.plant, family.AB)  # A and B times the sums of their coordinates
        return whole * XKX.part(slice(family.n)), AB * XKX, AB

    def one(self, family: Family) -> Polynomial:
        """Return what a constant is times beside N."""
        return self._one(self.plant, family.AB) * self._one(self.law, family.XKX)

    def _one(self, forms: list[Polynomial], P: Polynomial) -> Polynomial:
        """Return the sums of coordinates, to the powers that P has of them."""
        whole, start = number(1, self.sizes), 0
        for size, degree in zip(P.sizes, P.degrees, strict=True):
            coordinates = forms[start : start + size]
            for _ in range(degree):
                whole = whole * sum(coordinates[1:], coordinates[0])
            start += size
        return whole

    def elevated(self, degrees: tuple[int, ...], by: int) -> tuple[int, ...]:
        """Return degrees that are higher by so much in the simplices that are elevated."""
        return tuple(d + by * (f < self.raised) for f, d in enumerate(degrees))

    def positive(
        self, X: Polynomial, degrees: tuple[int, ...], parts: tuple[Part, ...]
    ) -> Iterator[Inequality]:
        """X > 0, which the inequality of a disk implies."""
        if any(not part.definite for part in parts):
            yield Inequality("of W", [[X]], degrees, self.name)


def cells(subject: Subject) -> Iterator[Cell]:
    """Yield the pieces: equal parts of each scheduling variable's interval; or the one simplex."""
    sizes = subject.sizes
    if not subject.ranges:
        forms = [form(0, row, sizes) for row in unit_rows(sizes[0])]
        yield Cell("", sizes, forms, forms, 1)
        return
    for numbers, forms in coordinates_in(subject.pieces):
        yield Cell(f" in piece {numbered(numbers)}", sizes, forms, forms, len(sizes))


def unit_rows(count: int) -> list[tuple[int, ...]]:
    """Return the rows of I."""
    return [tuple(int(j == k) for j in range(count)) for k in range(count)]
