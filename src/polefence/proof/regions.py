"""Regions of the complex plane: intersections of parts { z : L + M z + M' conj(z) < 0 }."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from fractions import Fraction
from types import MappingProxyType
from typing import Any, ClassVar

from polefence.proof.matrices import (
    ONE,
    ZERO,
    Integers,
    Rationals,
    bits,
    common_denominator,
    transposed,
    whole_numbers,
)
from polefence.proof.polynomials import Polynomial
from polefence.proof.reading import Table, is_double, shown
from polefence.proof.short import Short
from polefence.proof.work import FormatError, spend

MAX_PARTS = 16
TANGENTS = 32  # of an ellipse, in the upper half-plane
DIGITS = 20  # binary, of the tangent of half an angle
LEAST_RATE, MOST_RATE, LEAST_DAMPING = map(Fraction, (1e-100, 1e100, 1e-8))

Pair = tuple[Rationals, Rationals]
Side = tuple[Fraction, Fraction, Fraction]  # p, q, c of a half-plane p x + q |y| < c


@dataclass(frozen=True)
class Part(Short):
    """One part of a region; a kind is a class of its own, and `KINDS` lists it."""

    kind: ClassVar[str]
    positive: ClassVar[tuple[str, ...]] = ()  # those of its numbers that must be
    definite: ClassVar[bool] = False  # whether its inequality implies that X is positive definite

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of its numbers, as a file has them."""
        return tuple(field.name for field in fields(cls))

    @property
    def numbers(self) -> tuple[Fraction, ...]:
        """Its numbers, in the order of `names`."""
        return tuple(getattr(self, key) for key in self.names())

    @property
    def pairs(self) -> list[Pair]:
        """L and M of { z : L + M z + M' conj(z) < 0 }; a strip has two."""
        raise NotImplementedError

    def fault(self) -> str:
        """Say which number makes it no region, and what it must be: no pole lies in one."""
        for key, value in zip(self.names(), self.numbers, strict=True):
            if value and not LEAST_RATE <= abs(value) <= MOST_RATE:
                return f"{key} = {_short(value)} is out of range; use magnitudes 1e-100 to 1e100"
            if key in self.positive and value <= 0:
                return f"{key} = {_short(value)} must be positive"
        return self.own_fault()

    def own_fault(self) -> str:
        """Say what besides makes it no region."""
        return ""

    def fault_alone(self, discrete: bool) -> str:  # noqa: ARG002
        """Say what makes it no region where no other part keeps it among stable poles."""
        return ""

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether it lies in the half-plane p x + q y <= c."""
        raise NotImplementedError

    def sides(self) -> Iterator[Side]:
        """Yield half-planes p x + q |y| < c of which it is the intersection; of a disk none."""
        raise NotImplementedError

    @property
    def circle(self) -> tuple[Fraction, Fraction] | None:
        """Centre and radius of a disk; None of other parts."""
        return None

    @property
    def in_unit_disk(self) -> bool:
        """Whether it is a disk in the open unit disk."""
        return self.circle is not None and abs(self.circle[0]) + self.circle[1] <= 1

    def decays(self, step: Fraction) -> bool:  # noqa: ARG002
        """Whether it says how fast motions decay, in continuous time or at this step."""
        return False

    def facing(self, z: complex) -> Iterator[Side]:  # noqa: ARG002
        """Yield half-planes p x + q |y| < c that hold it and may not hold z, Im z >= 0."""
        return self.sides()


@dataclass(frozen=True)
class Disk(Part):
    """|z - centre| < radius."""

    kind = "disk"
    positive = ("radius",)
    definite = True

    centre: Fraction
    radius: Fraction

    def fault_alone(self, discrete: bool) -> str:
        """Say that it is no disk of continuous, or of discrete time."""
        if self.centre < 0 or (discrete and self.in_unit_disk):
            return ""
        where = f"centre = {_short(self.centre)} must be negative"
        if discrete:
            return f"{where}, or the disk, or another part, in the unit disk"
        return f"{where}, or another part in the left half-plane"

    @property
    def pairs(self) -> list[Pair]:
        """L and M."""
        c, r = self.centre, self.radius
        return [([[-r, -c], [-c, -r]], [[ZERO, ONE], [ZERO, ZERO]])]

    @property
    def circle(self) -> tuple[Fraction, Fraction]:
        """Centre and radius."""
        return self.centre, self.radius

    def decays(self, step: Fraction) -> bool:
        """Whether a motion's factor at each step is below the radius."""
        return bool(step) and not self.centre

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether the distance of the centre is no less than the radius."""
        rest = c - p * self.centre
        return rest >= 0 and rest**2 >= self.radius**2 * (p**2 + q**2)

    def facing(self, z: complex) -> Iterator[Side]:
        """Yield the tangent nearest to z."""
        p, q = _direction(z - float(self.centre))
        yield p, q, p * self.centre + self.radius


@dataclass(frozen=True)
class HalfPlane(Part):
    """Re z < -decay."""

    kind = "half_plane"

    decay: Fraction

    def decays(self, step: Fraction) -> bool:
        """Whether motions decay at its rate."""
        return not step

    @property
    def pairs(self) -> list[Pair]:
        """L and M."""
        return [([[2 * self.decay]], [[ONE]])]

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether the lines are parallel, and the other the farther."""
        return not q and p >= 0 and -self.decay * p <= c

    def sides(self) -> Iterator[Side]:
        """Yield it itself."""
        yield ONE, ZERO, -self.decay


@dataclass(frozen=True)
class Sector(Part):
    """|Im z| < -slope Re z, of a slope that the damping ratio has."""

    kind = "sector"

    damping: Fraction
    slope: Fraction

    def own_fault(self) -> str:
        """Say that one number is no damping ratio, or the other not its slope."""
        if not LEAST_DAMPING <= self.damping < 1:
            return (
                f"damping = {_short(self.damping)} must be a damping ratio between 0 and 1; "
                "half_plane(0) asks for stability alone"
            )
        right = slope_of(self.damping)
        if self.slope == right:
            return ""
        return f"slope = {_short(self.slope)} is not that of its damping, {float(right)!r}"

    @property
    def wedge(self) -> Wedge:
        """The same, without its damping."""
        return Wedge(ZERO, self.slope)

    @property
    def pairs(self) -> list[Pair]:
        """L and M."""
        return self.wedge.pairs

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether the wedge does."""
        return self.wedge.in_half_plane(p, q, c)

    def sides(self) -> Iterator[Side]:
        """Yield those of the wedge."""
        return self.wedge.sides()


@dataclass(frozen=True)
class Wedge(Part):
    """|Im z| < slope (apex - Re z)."""

    kind = "wedge"

    apex: Fraction
    slope: Fraction

    def own_fault(self) -> str:
        """Say that it is none."""
        return "" if self.slope else "slope = 0 leaves no wedge; above zero it opens to the left"

    @property
    def pairs(self) -> list[Pair]:
        """L and M."""
        s, level = self.slope, -2 * self.slope * self.apex
        return [([[level, ZERO], [ZERO, level]], [[s, ONE], [-ONE, s]])]

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether both rays and the apex do."""
        along = p if self.slope > 0 else -p
        return p * self.apex <= c and along >= abs(self.slope * q)

    def sides(self) -> Iterator[Side]:
        """Yield both lines, which are one."""
        yield self.slope, ONE, self.slope * self.apex


@dataclass(frozen=True)
class VerticalStrip(Part):
    """low < Re z < high."""

    kind = "vertical_strip"

    low: Fraction
    high: Fraction

    def own_fault(self) -> str:
        """Say that it is empty."""
        if self.low < self.high:
            return ""
        low, high = map(_short, self.numbers)
        return f"low = {low} is not below high = {high}; the strip is empty"

    @property
    def pairs(self) -> list[Pair]:
        """L and M of both halves."""
        return [([[-2 * self.high]], [[ONE]]), ([[2 * self.low]], [[-ONE]])]

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether the lines are parallel, and the other the farther."""
        return not q and max(p * self.low, p * self.high) <= c

    def sides(self) -> Iterator[Side]:
        """Yield both halves."""
        yield ONE, ZERO, self.high
        yield -ONE, ZERO, -self.low


@dataclass(frozen=True)
class HorizontalStrip(Part):
    """|Im z| < height."""

    kind = "horizontal_strip"
    positive = ("height",)

    height: Fraction

    @property
    def pairs(self) -> list[Pair]:
        """L and M."""
        h = -2 * self.height
        return [([[h, ZERO], [ZERO, h]], [[ZERO, ONE], [-ONE, ZERO]])]

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether the lines are parallel, and the other the farther."""
        return not p and abs(q) * self.height <= c

    def sides(self) -> Iterator[Side]:
        """Yield both lines, which are one."""
        yield ZERO, ONE, self.height


@dataclass(frozen=True)
class Ellipse(Part):
    """((Re z - centre) / real)^2 + (Im z / imaginary)^2 < 1."""

    kind = "ellipse"
    positive = ("real", "imaginary")

    centre: Fraction
    real: Fraction
    imaginary: Fraction

    def fault_alone(self, discrete: bool) -> str:  # noqa: ARG002
        """Say that its centre is unstable."""
        if self.centre < 0:
            return ""
        return (
            f"centre = {_short(self.centre)} must be negative, or another part in the left "
            "half-plane"
        )

    @property
    def pairs(self) -> list[Pair]:
        """L and M."""
        c, b, ratio = self.centre, self.imaginary, self.imaginary / self.real
        M = [[ZERO, (1 + ratio) / 2], [(ratio - 1) / 2, ZERO]]
        return [([[-b, -c * ratio], [-c * ratio, -b]], M)]

    def in_half_plane(self, p: Fraction, q: Fraction, c: Fraction) -> bool:
        """Whether the distance of the centre is no less than the support."""
        rest = c - p * self.centre
        return rest >= 0 and rest**2 >= (self.real * p) ** 2 + (self.imaginary * q) ** 2

    def sides(self) -> Iterator[Side]:
        """Yield tangents at rational points, in place of all: a polygon that contains it."""
        c, a, b = self.numbers
        for k in range(TANGENTS + 1):
            cosine, sine = _on_circle(Fraction(k, TANGENTS))
            for sign in (1, -1):
                yield sign * cosine / a, sine / b, 1 + sign * cosine * c / a

    def facing(self, z: complex) -> Iterator[Side]:
        """Yield the tangent where the ray to z leaves it."""
        c, a, b = self.numbers
        p, q = _direction(complex((z.real - float(c)) / float(a), z.imag / float(b)))
        yield p / a, q / b, 1 + p * c / a


KINDS: Mapping[str, type[Part]] = MappingProxyType(
    {
        part.kind: part
        for part in (Disk, HalfPlane, Sector, Wedge, VerticalStrip, HorizontalStrip, Ellipse)
    }
)


def slope_of(damping: Fraction) -> Fraction:
    """Return the slope sqrt(1 - damping^2) / damping, rounded down: no pole is damped less.

    Zero for what is no damping ratio.
    """
    if not LEAST_DAMPING <= damping < 1:
        return ZERO
    ratio = float(damping)
    slope = math.sqrt((1 - ratio) * (1 + ratio)) / ratio
    while damping**2 * (1 + Fraction(slope) ** 2) > 1:
        slope = math.nextafter(slope, 0)
    return Fraction(slope)


def _on_circle(t: Fraction) -> tuple[Fraction, Fraction]:
    """Return cosine and sine of the angle whose half has the tangent t."""
    return (1 - t**2) / (1 + t**2), 2 * t / (1 + t**2)


def _direction(z: complex) -> tuple[Fraction, Fraction]:
    """Return a rational point of the unit circle near the direction of z, Im z >= 0."""
    half = z.imag / (abs(z) + abs(z.real)) if z else 0.0
    cosine, sine = _on_circle(Fraction(round(half * 2**DIGITS), 2**DIGITS))
    return (cosine if z.real >= 0 else -cosine), sine


def _short(value: Fraction) -> str:
    return repr(float(value)).removesuffix(".0")


def require_region(parts: tuple[Part, ...]) -> None:
    """Refuse numbers that make no region: no pole lies in one, nor outside.

    Raises
    ------
    FormatError
        Naming the first such part.
    """
    _refuse([part.fault() for part in parts])


def require_left(parts: tuple[Part, ...], discrete: bool) -> None:
    """Refuse a disk or an ellipse about a point that is not in the left half-plane.

    Not where another part lies there; in discrete time not a disk in the unit disk, nor one beside
    it. A claim about such a region may be proved, but is none that anybody means: it is a slip of
    the sign.

    Raises
    ------
    FormatError
        Naming the first such part.
    """
    kept = (part.in_half_plane(ONE, ZERO, ZERO) for part in parts)
    if discrete:
        kept = (part.in_unit_disk for part in parts)
    if not any(kept):
        _refuse([part.fault_alone(discrete) for part in parts])


def _refuse(faults: list[str]) -> None:
    for k, fault in enumerate(faults):
        if fault:
            where = "region" if len(faults) == 1 else f"region.parts[{k + 1}]"
            raise FormatError(f"{where}.{fault}")


Region = tuple[Part, ...]


def read_region(table: Table) -> Region:
    """Read the parts of a region: doubles, so that what is printed of them is what is proved."""
    if table.word("kind", (*KINDS, "intersection")) != "intersection":
        region: Region = (_part(table),)
    else:
        region = tuple(map(_part, table.tables("parts", MAX_PARTS)))
        for k, part in enumerate(region):
            if part in region[:k]:
                raise FormatError(f"{table.path('parts')}[{k + 1}] is given twice; leave one out")
    require_region(region)
    return region


def read_whole(table: Table, discrete: bool) -> Region:
    """Read the region of a claim, as a whole: see `require_left`."""
    region = read_region(table)
    require_left(region, discrete)
    return region


def parts_of(document: dict[str, Any]) -> Region:
    """Return the parts of a region from plain data."""
    return read_region(Table.of(document, "region"))


def _part(table: Table) -> Part:
    kind = KINDS[table.word("kind", KINDS)]
    numbers = [table.number(key) for key in kind.names()]
    for key, value in zip(kind.names(), numbers, strict=True):
        if not is_double(value):
            given = shown(table.at(key))
            raise FormatError(f"{table.path(key)} = {given} is not a double; give a decimal")
    return kind(*numbers)


def write_region(region: Region) -> dict[str, Any]:
    """Return a region as a file has it."""
    parts = [
        {"kind": part.kind} | dict(zip(part.names(), map(float, part.numbers), strict=True))
        for part in region
    ]
    return parts[0] if len(parts) == 1 else {"kind": "intersection", "parts": parts}


def lyapunov(L: Rationals, M: Rationals, X: Polynomial, N: Polynomial) -> Polynomial:
    """Return -(L (x) X + M (x) N + M' (x) N')."""
    X = X.raised(N.degrees)
    whole, unit = math.lcm(X.whole, N.whole), common_denominator([L, M])
    L_, M_ = whole_numbers(L, unit), whole_numbers(M, unit)
    x, n = X.over(whole), N.over(whole)
    zero = [[0] * len(row) for row in next(iter(n.values()))]
    terms = {e: _block(L_, M_, x.get(e, zero), n.get(e, zero)) for e in x.keys() | n.keys()}
    return Polynomial(terms, N.sizes, N.degrees, whole * unit)


def _block(L: Integers, M: Integers, X: Integers, N: Integers) -> Integers:
    T = transposed(N)
    rows: Integers = []
    spend(3 * (len(L) * len(X)) ** 2, max(bits(L), bits(M)), max(bits(X), bits(N)))
    for a in range(len(L)):
        for i in range(len(X)):
            row: list[int] = []
            for b in range(len(L)):
                p, q, r = L[a][b], M[a][b], M[b][a]
                row += [-(p * x + q * y + r * z) for x, y, z in zip(X[i], N[i], T[i], strict=True)]
            rows.append(row)
    return rows


def factors(M: Rationals) -> tuple[Rationals, Rationals]:
    """Return M1, M2 of full rank with M = M1 M2: M's pivot columns, its reduced rows."""
    rows, pivots = [list(row) for row in M], list[int]()
    for column in range(len(M[0])):
        r = len(pivots)
        pivot = next((i for i in range(r, len(rows)) if rows[i][column]), None)
        if pivot is None:
            continue
        rows[r], rows[pivot] = rows[pivot], rows[r]
        rows[r] = [value / rows[r][column] for value in rows[r]]
        for i, row in enumerate(rows):
            if i != r and row[column]:
                rows[i] = [x - row[column] * y for x, y in zip(row, rows[r], strict=True)]
        pivots.append(column)
    return [[row[p] for p in pivots] for row in M], rows[: len(pivots)]
