"""Claims in words and numbers that say no more than what is proved.

States, inputs and disturbances are x1, u1, w1 and so on: their names are a file's own words, which
no proof is about. A number that is rounded in what it defines has a ~ before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from fractions import Fraction

from polefence.plant.names import quoted
from polefence.proof import placement, regions
from polefence.proof.matrices import Rationals
from polefence.proof.placement import Claim
from polefence.proof.regions import Part
from polefence.region.regions import exactly
from polefence.region.text import LARGEST, digits_down, digits_up

MOST_VERTICES = 8  # whose rows are written out
MOST_POINTS = 8  # initial states that are
MOST_ROWS = 6  # of a matrix
SHORT, SHORT_FRACTION = 12, 5  # characters of a number that is not rounded


def region_text(parts: Sequence[Part]) -> str:
    """Return a region as people write it, each number as it is."""
    return " & ".join(f"{part.kind}({', '.join(_numbers(part))})" for part in parts)


def _numbers(part: Part) -> Iterable[str]:
    for key, value in zip(regions.KINDS[part.kind], part.numbers, strict=True):
        if key != "slope":  # that of the damping
            yield exactly(float(value)) if Fraction(float(value)) == value else str(value)


def poles_text(claim: Claim) -> str:
    """Say where a design claims all poles to be, under which law, for which alpha."""
    domain = f"the simplex of {len(claim.A)} vertices"
    if claim.on == "box":
        domain = f"the box of {len(placement.simplices(claim))} parameters"
    law, by = "one gain K", f"method {claim.method}"
    if claim.law.K is None:
        law = f"K(alpha) = Z W^-1 of degree {claim.law.degree}"
    return f"poles in {region_text(claim.region)}, of A + B K with {law}, on {domain}, {by}"


def name_text(name: str) -> str:
    """Return a parameter's name as it is, anything else in quotes."""
    return name if name.isidentifier() and name.isascii() and len(name) <= 40 else quoted(name)


def number_text(value: Fraction) -> str:
    """Return a number that defines something: as it is, else with six digits and a ~."""
    if abs(value) >= LARGEST:
        return f"~{digits_down(value)}"
    short = f"{float(value):.{SHORT - 2}g}"
    if Fraction(short) == value:
        return f"{float(value):g}" if Fraction(f"{float(value):g}") == value else short
    fraction = Fraction(float(value)) != value
    plain = str(value) if fraction else exactly(float(value))
    return (
        plain if len(plain) <= (SHORT_FRACTION if fraction else SHORT) else f"~{float(value):.6g}"
    )


def sum_text(rows: Sequence[tuple[str, Sequence[Fraction]]]) -> str:
    """Return a sum of signals, as ``x1 - 2 x3 + ~0.333333 u1``: a letter and its factors each."""
    text = ""
    for letter, factors in rows:
        for k, factor in enumerate(factors):
            if factor:
                size = number_text(abs(factor))
                sign = ("-" if factor < 0 else "") if not text else " - " if factor < 0 else " + "
                text += f"{sign}{'' if size == '1' else f'{size} '}{letter}{k + 1}"
    return text or "0"


def output_text(C: list[Rationals], D: list[Rationals], F: Sequence[Rationals] = ()) -> str:
    """Return what an output is, at the vertices where it is not the same at all of them."""
    zero: list[Rationals] = [[[]]] * len(C)
    rows = [
        (("x", c[0]), ("u", d[0]), ("w", f[0]))
        for c, d, f in zip(C, D, list(F) or zero, strict=True)
    ]
    if all(row == rows[0] for row in rows):
        return sum_text(rows[0])
    shown = [f"{sum_text(row)} at vertex {j + 1}" for j, row in enumerate(rows[:MOST_VERTICES])]
    more = len(rows) - len(shown)
    return "; ".join(shown + [f"and what the file has at {more} more"] * bool(more))


def impulses_text(impulses: Sequence[Fraction]) -> str:
    """Say which impulses are meant, one at a time."""
    acting = [(k, size) for k, size in enumerate(impulses) if size]
    said = [f"an impulse {digits_down(abs(size), 4)} in w{k + 1}" for k, size in acting]
    return " or ".join(said)


def points_text(points: Sequence[Sequence[Fraction]]) -> str:
    """List initial states."""
    shown = [f"({', '.join(map(number_text, point))})" for point in points[:MOST_POINTS]]
    more = len(points) - len(shown)
    rest = [f"{more} more of the file"] * bool(more)
    return f"x(0) = {' or '.join(shown + rest)}"


def ellipsoid_text(X0: Sequence[Sequence[Fraction]]) -> str:
    """Say which ellipsoid of initial states is meant."""
    return f"x(0)' X0^-1 x(0) <= 1, X0 = {matrix_text(X0)}"


def matrix_text(matrix: Sequence[Sequence[Fraction]]) -> str:
    """Return a matrix in a line; a large one is only counted."""
    n = len(matrix)
    if all(not x for i, row in enumerate(matrix) for j, x in enumerate(row) if i != j):
        return f"diag({', '.join(number_text(matrix[i][i]) for i in range(n))})"
    if n > MOST_ROWS:
        return f"the {n} x {n} matrix of the file"
    return f"[{'; '.join(' '.join(map(number_text, row)) for row in matrix)}]"


def errors_text(
    error: Fraction,
    rows: Sequence[Fraction],
    columns: Sequence[Fraction | tuple[Fraction, ...]],
) -> str:
    """Say which errors S D T of a gain are meant, |D| <= 1, whatever a file measures them by.

    The largest number of S is 1; rounded down, which leaves some errors out.
    """
    top = max(rows)
    left = ", ".join(digits_down(s / top, 4) for s in rows)
    scale = error * top
    numbers = [c for c in columns if isinstance(c, Fraction)]
    if len(numbers) == len(columns):
        right = f"diag({', '.join(digits_down(scale * c, 4) for c in numbers)})"
    else:
        matrix = [c for c in columns if not isinstance(c, Fraction)]
        right = f"{digits_down(scale, 4)} times {matrix_text(matrix)}"
    if len(rows) == 1:
        return f"K off by D T for all |D| <= 1, T = {right}"
    return f"K off by S D T for all |D| <= 1, S = diag({left}), T = {right}"


def milliseconds_text(time: Fraction) -> str:
    """Return a time [s] in milliseconds: of a double the shortest decimal that reads back as it."""
    if Fraction(float(time)) == time and len(repr(float(time))) <= SHORT:
        return f"{(1000 * Decimal(repr(float(time)))).normalize():f}"
    plain = number_text(1000 * time)
    return plain if "/" not in plain else f"~{float(1000 * time):.6g}"


def range_text(name: str, unit: str, low: Fraction, high: Fraction) -> str:
    """Return a parameter's interval, rounded inwards."""
    return f"{name} in [{digits_up(low)}, {digits_down(high)}] {unit}".rstrip()
