"""Regions of the complex plane: intersections of parts { z : L + M z + M' conj(z) < 0 }."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import (
    Integers,
    Rationals,
    bits,
    common_denominator,
    transposed,
    whole_numbers,
)
from polefence.proof.polynomials import Polynomial
from polefence.proof.reading import Table, is_double, shown
from polefence.proof.work import FormatError, spend

MAX_PARTS = 16
TANGENTS = 32  # of an ellipse, in the upper half-plane
# Parts of regions: their kinds and the numbers that each has.
KINDS = {
    "disk": ("centre", "radius"),
    "half_plane": ("decay",),
    "sector": ("damping", "slope"),
    "vertical_strip": ("low", "high"),
    "horizontal_strip": ("height",),
    "ellipse": ("centre", "real", "imaginary"),
}
POSITIVE = ("radius", "height", "real", "imaginary")
LEAST_RATE, MOST_RATE, LEAST_DAMPING = map(Fraction, (1e-100, 1e100, 1e-8))


@dataclass(frozen=True)
class Part:
    """One part of a region: its kind, and its numbers as `KINDS` names them."""

    kind: str
    numbers: tuple[Fraction, ...]


def require_region(parts: tuple[Part, ...]) -> None:
    """Refuse numbers that make no region: no pole lies in one, nor outside.

    Raises
    ------
    FormatError
        Naming the first such part.
    """
    for k, part in enumerate(parts):
        fault = _fault(part)
        if fault:
            where = "region" if len(parts) == 1 else f"region.parts[{k + 1}]"
            raise FormatError(f"{where}.{fault}")


def _fault(part: Part) -> str:
    """Say which number of a part makes it no region, and what it must be."""
    v = dict(zip(KINDS[part.kind], part.numbers, strict=True))
    for key, value in v.items():
        if value and not LEAST_RATE <= abs(value) <= MOST_RATE:
            return f"{key} = {_short(value)} is out of range; use magnitudes 1e-100 to 1e100"
        if key in POSITIVE and value <= 0:
            return f"{key} = {_short(value)} must be positive"
    if part.kind == "disk" and v["centre"] >= 0 and v["centre"] + v["radius"] > 1:
        return f"centre = {_short(v['centre'])} must be negative, or the disk in the unit disk"
    if part.kind == "ellipse" and v["centre"] >= 0:
        return f"centre = {_short(v['centre'])} must be negative"
    if part.kind == "vertical_strip" and v["low"] >= v["high"]:
        return f"low = {_short(v['low'])} must be below high = {_short(v['high'])}"
    if part.kind == "sector":
        if not LEAST_DAMPING <= v["damping"] < 1:
            return f"damping = {_short(v['damping'])} must be a damping ratio between 0 and 1"
        if v["slope"] != _slope(v["damping"]):
            right = float(_slope(v["damping"]))
            return f"slope = {_short(v['slope'])} is not that of its damping, {right!r}"
    return ""


def _slope(damping: Fraction) -> Fraction:
    """Return the slope sqrt(1 - damping^2) / damping, rounded down: no pole is damped less."""
    ratio = float(damping)
    slope = math.sqrt((1 - ratio) * (1 + ratio)) / ratio
    while damping**2 * (1 + Fraction(slope) ** 2) > 1:
        slope = math.nextafter(slope, 0)
    return Fraction(slope)


def _short(value: Fraction) -> str:
    return repr(float(value)).removesuffix(".0")


def characteristic_pairs(part: Part) -> list[tuple[Rationals, Rationals]]:
    """Return L and M of { z : L + M z + M' conj(z) < 0 }; a strip has two."""
    v, one = part.numbers, Fraction(1)
    zero = one - one
    if part.kind == "disk":
        return [([[-v[1], -v[0]], [-v[0], -v[1]]], [[zero, one], [zero, zero]])]
    if part.kind == "half_plane":
        return [([[2 * v[0]]], [[one]])]
    if part.kind == "sector":
        return [([[zero, zero], [zero, zero]], [[v[1], one], [-one, v[1]]])]
    if part.kind == "vertical_strip":
        return [([[-2 * v[1]]], [[one]]), ([[2 * v[0]]], [[-one]])]
    if part.kind == "horizontal_strip":
        return [([[-2 * v[0], zero], [zero, -2 * v[0]]], [[zero, one], [-one, zero]])]
    c, a, b = v
    M = [[zero, (1 + b / a) / 2], [(b / a - 1) / 2, zero]]
    return [([[-b, -c * b / a], [-c * b / a, -b]], M)]


def holds(part: Part, p: Fraction, q: Fraction, c: Fraction) -> bool:
    """Whether the part lies in the half-plane p x + q y <= c."""
    v, flat = part.numbers, not q
    if part.kind in ("disk", "ellipse"):
        a, b = v[1], v[-1]
        rest = c - p * v[0]
        return rest >= 0 and rest**2 >= (a * p) ** 2 + (b * q) ** 2
    if part.kind == "half_plane":
        return flat and p >= 0 and -v[0] * p <= c
    if part.kind == "sector":
        return c >= 0 and p >= v[1] * abs(q)
    if part.kind == "vertical_strip":
        return flat and max(p * v[0], p * v[1]) <= c
    return not p and abs(q) * v[0] <= c


def sides(part: Part) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    """Yield p, q, c of half-planes p x + q |y| < c of which the part is the intersection."""
    v, zero, one = part.numbers, Fraction(0), Fraction(1)
    if part.kind == "half_plane":
        yield one, zero, -v[0]
    elif part.kind == "sector":
        yield v[1], one, zero
    elif part.kind == "vertical_strip":
        yield one, zero, v[1]
        yield -one, zero, -v[0]
    elif part.kind == "horizontal_strip":
        yield zero, one, v[0]
    else:  # the ellipse ((x - c) / a)^2 + (y / b)^2 < 1, by tangents at rational points
        c, a, b = v
        for k in range(TANGENTS + 1):
            s = Fraction(k, TANGENTS)
            cosine, sine = (1 - s**2) / (1 + s**2), 2 * s / (1 + s**2)
            for sign in (1, -1):
                yield sign * cosine / a, sine / b, 1 + sign * cosine * c / a


Region = tuple[Part, ...]


def read_region(table: Table) -> Region:
    """Read the parts of a region: doubles, so that what is printed of them is what is proved."""
    if table.word("kind", (*KINDS, "intersection")) != "intersection":
        found: Region = (_part(table),)
    else:
        found = tuple(map(_part, table.tables("parts", MAX_PARTS)))
        for k, part in enumerate(found):
            if part in found[:k]:
                raise FormatError(
                    f"{table.path('parts')}[{k + 1}] stands there twice; leave one out"
                )
    require_region(found)
    return found


def parts_of(document: dict[str, Any]) -> Region:
    """Return the parts of a region from plain data."""
    return read_region(Table.of(document, "region"))


def _part(table: Table) -> Part:
    kind = table.word("kind", KINDS)
    numbers = tuple(table.number(key) for key in KINDS[kind])
    for key, value in zip(KINDS[kind], numbers, strict=True):
        if not is_double(value):
            given = shown(table.at(key))
            raise FormatError(f"{table.path(key)} = {given} is no double; give a decimal")
    return Part(kind, numbers)


def write_region(region: Region) -> dict[str, Any]:
    """Return a region as a file has it."""
    parts = [
        {"kind": part.kind} | dict(zip(KINDS[part.kind], map(float, part.numbers), strict=True))
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
