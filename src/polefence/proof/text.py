"""Claims in words and numbers that say no more than what is proved.

States, inputs and disturbances are x1, u1, w1 and so on: their names are a file's own words, which
no proof is about. A number that is rounded in what it defines has a ~ before it.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction

from polefence.proof.matrices import Rationals
from polefence.proof.regions import Part

LARGEST = 10**308  # of a double, nearly
LONGEST = 80  # characters of a name in a sentence
MOST_ROWS = 6  # of a matrix
MOST_TERMS = 24  # of a sum that is written in full
SHORT = 12  # characters of a number that is not rounded

# Of Unicode's categories those that draw nothing of their own, but move, hide or end a line.
_HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
_PLURALS = (("matrix", "matrices"), ("vertex", "vertices"), ("axis", "axes"), ("ss", "sses"))
# Products of powers of units that are in use: kg, N s/m, m/s^2, 1/s, %, m/s per m/s2.
_SYMBOLS = (
    "m g s A K mol cd rad sr Hz N Nm Pa J W Wh C V VA F Ω Ohm ohm S Wb T H lm lx Bq L l t bar eV "
    "rev deg degC min h d in ft lb psi mph"
)
_PREFIX = "(?:da|[YZEPTGMkhdcmµμunpfazy])?"
_WORD = (
    rf"(?:{_PREFIX}(?:{'|'.join(_SYMBOLS.split())})|%|°C?|rpm|per)(?:\^?[-+]?\d(?:\.\d)?|⁻?[¹²³⁴])?"
)
_UNIT = re.compile(rf"(?:1/)?\(?{_WORD}(?:[ /*·]\(?{_WORD}\)?){{0,7}}|/s|")


def digits_up(value: float | Fraction, digits: int = 6) -> str:
    """Print with so many digits, rounded up: for what is proved to be no larger.

    A double that so many digits read back as is printed so; any other number is rounded.
    """
    return _digits(value, digits, ROUND_CEILING)


def digits_down(value: float | Fraction, digits: int = 6) -> str:
    """Print with so many digits, rounded down: for what is proved to be no smaller."""
    return _digits(value, digits, ROUND_FLOOR)


def _digits(value: float | Fraction, digits: int, direction: str) -> str:
    if not isinstance(value, Fraction) or _is_double(value):
        short = f"{float(value):.{digits}g}"
        if float(short) == value:  # reads back the same: nothing was rounded
            return short
    # correctly rounded, once: first to a double would be a second time
    top, bottom = value.as_integer_ratio()
    rounded = Context(prec=digits, rounding=direction).divide(Decimal(top), Decimal(bottom))
    plain = rounded == 0 or -5 <= rounded.adjusted() < 12
    return f"{rounded:f}" if plain else f"{rounded:e}"


def _is_double(value: Fraction) -> bool:
    return abs(value) < LARGEST and Fraction(float(value)) == value


def exactly(value: float) -> str:
    """Print a float so that it reads back the same: a rounded radius would be another claim."""
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def visible(text: str) -> str:
    r"""Return text that stays on its line: what is no letter, sign or space as ``\n``, ``\x1b``."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode() if unicodedata.category(c) in _HIDDEN else c
        for c in text
    )


def quoted(name: str) -> str:
    """Return a name in quotes, which it does not leave, cut short where it is endless."""
    short = name if len(name) <= LONGEST else f"{name[: LONGEST - 3]}..."
    return repr(short)


def plural(count: int, noun: str) -> str:
    """Return a number of things: "1 vertex", "4 vertices", "0 inequalities"."""
    if count == 1:
        return f"{count} {noun}"
    for ending, several in _PLURALS:
        if noun.endswith(ending):
            return f"{count} {noun.removesuffix(ending)}{several}"
    if noun[-1] == "y" and noun[-2] not in "aeou":
        return f"{count} {noun[:-1]}ies"
    return f"{count} {noun}s"


def unit_text(unit: str) -> str:
    """Return a unit as it is, or in quotes where it might be read as more than one."""
    return unit if _UNIT.fullmatch(unit) else quoted(unit)


def rate_text(unit: str) -> str:
    """Return a printable unit per second: "1/s" of none, "(N s/m)/s" of a quotient."""
    return f"({unit})/s" if "/" in unit else f"{unit or 1}/s"


def region_text(parts: Sequence[Part]) -> str:
    """Return a region as people write it, each number as it is."""
    return " & ".join(f"{part.kind}({', '.join(_numbers(part))})" for part in parts)


def _numbers(part: Part) -> Iterable[str]:
    for key, value in zip(part.names(), part.numbers, strict=True):
        if (part.kind, key) != ("sector", "slope"):  # that of the damping
            yield exactly(float(value)) if Fraction(float(value)) == value else str(value)


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
    return plain if len(plain) <= (5 if fraction else SHORT) else f"~{float(value):.6g}"


def sum_text(rows: Sequence[tuple[str, Sequence[Fraction]]]) -> str:
    """Return a sum of signals, as ``x1 - 2 x3 + ~0.333333 u1``: a letter and its factors each."""
    text, terms = "", sum(bool(factor) for _, factors in rows for factor in factors)
    left = MOST_ROWS if terms > MOST_TERMS else terms
    for letter, factors in rows:
        for k, factor in enumerate(factors):
            if factor and left:
                left, terms = left - 1, terms - 1
                size = number_text(abs(factor))
                sign = ("-" if factor < 0 else "") if not text else " - " if factor < 0 else " + "
                text += f"{sign}{'' if size == '1' else f'{size} '}{letter}{k + 1}"
    more = f" + {terms} terms of the file" if terms else ""
    return f"{text}{more}" or "0"


def output_text(C: list[Rationals], D: list[Rationals], F: Sequence[Rationals] = ()) -> str:
    """Return what an output is, at the vertices where it is not the same at all of them."""
    zero: list[Rationals] = [[[]]] * len(C)
    rows = [
        (("x", c[0]), ("u", d[0]), ("w", f[0]))
        for c, d, f in zip(C, D, list(F) or zero, strict=True)
    ]
    if all(row == rows[0] for row in rows):
        return sum_text(rows[0])
    shown = [f"{sum_text(row)} at vertex {j + 1}" for j, row in enumerate(rows[:8])]
    more = len(rows) - len(shown)
    return "; ".join(shown + [f"and what the file has at {more} more"] * bool(more))


def impulses_text(impulses: Sequence[Fraction]) -> str:
    """Say which impulses are meant, one at a time."""
    acting = [(k, size) for k, size in enumerate(impulses) if size]
    said = [f"an impulse {digits_down(abs(size), 4)} in w{k + 1}" for k, size in acting]
    return " or ".join(said)


def points_text(points: Sequence[Sequence[Fraction]]) -> str:
    """List initial states."""
    shown = [f"({', '.join(map(number_text, point))})" for point in points[:8]]
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


def each_gain_text(error: Fraction, sizes: Sequence[Sequence[Fraction]]) -> str:
    """Say by how much each gain may be off, all at once; rounded down, which leaves errors out."""
    if max(len(sizes), len(sizes[0])) > MOST_ROWS:
        by = f"{digits_down(error, 4)} times its size in the file"
    else:
        rows = (" ".join(digits_down(error * s, 4) if s else "0" for s in row) for row in sizes)
        by = f"[{'; '.join(rows)}]"
    return f"each gain of K off by itself, by up to {by}"


def milliseconds_text(time: Fraction) -> str:
    """Return a time [s] in milliseconds: of a double the shortest decimal that reads back as it."""
    if Fraction(float(time)) == time and len(repr(float(time))) <= SHORT:
        return f"{(1000 * Decimal(repr(float(time)))).normalize():f}"
    plain = number_text(1000 * time)
    return plain if "/" not in plain else f"~{float(1000 * time):.6g}"


def late_text(late: Fraction) -> str:
    """Say how many samples late: "1 sample late", "0.5 samples late"."""
    if late.denominator == 1:
        return f"{plural(int(late), 'sample')} late"
    return f"{number_text(late)} samples late"


def range_text(name: str, unit: str, low: Fraction, high: Fraction) -> str:
    """Return a parameter's interval, rounded inwards."""
    return f"{name} in [{digits_up(low)}, {digits_down(high)}] {unit}".rstrip()
