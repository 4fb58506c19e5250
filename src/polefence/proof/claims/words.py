"""Errors of code in fixed point: integers of 16 or 32 bits, products of twice as many.

A number is an integer times 2^-s, its exponent s a constant. A signal has s_j bits behind the
point, a sum of products of one row of the gain r_i, the answer t_i <= r_i. A gain is an integer
times 2^(s_j - r_i), so that all products of a row add up as they are; sums are exact, for bounds on
the integers leave room for them (`require`). Rounding is to nearest, after each of these:

- a share of a parameter's interval, of Q = bits - 2 bits behind the point: h = 2^-(Q + 1), and the
  errors of the constants; alpha that is given, over its sum: h;
- a product of two numbers of size one at most: the errors of both, and h;
- a polynomial entry of the gain, Sum K_e c^e: 2^(s_j - r_i - 1), and of each term |K_e| times the
  error of c^e;
- the answer: 2^-(t_i + 1).

All but the last are errors of the gain, as those of floats are. The last is an absolute one, at
most half a unit of the answer whatever the signals are. States that the code keeps have t_i > s_j
bits, of which it multiplies the s_j nearest: an absolute error of each answer too. Rows of such
states hold the gain times the time T between updates.

Anti-windup adds T G (sat(u) - u) to such a step, sat the cut at the integers' own limits: what is
cut off an input is rounded to b_i <= t_i bits behind the point, in which it always fits a word, and
a row's sum of r'_k bits to those of the state. It is zero, exactly, where nothing is cut; while an
input is, the step is off by the rounding of T G, of its sum and of what is cut off, and by T G
times the error of u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction

from polefence.proof.matrices import Rationals
from polefence.proof.reading import Table, plain
from polefence.proof.short import Short
from polefence.proof.work import FormatError

BITS = (16, 32)
MOST = 400  # an exponent's size


@dataclass(frozen=True)
class Scales(Short):
    """Bits behind the point: of signals, of what is given, of rows' sums and of answers.

    ``signals`` are those that are measured and, last, the code's own states as they are multiplied;
    ``given`` the parameters, none for alpha; ``answers`` the inputs and, last, the states as they
    are kept. ``columns`` and ``solving`` are of a law that solves equations: see `solving`.
    ``beyond`` is of what is cut off each input, ``recovering`` of the sums that it adds to states.
    """

    signals: tuple[int, ...]
    given: tuple[int, ...]
    rows: tuple[int, ...]
    answers: tuple[int, ...]
    columns: tuple[int, ...] = ()
    solving: tuple[int, ...] = ()
    beyond: tuple[int, ...] = ()
    recovering: tuple[int, ...] = ()

    @classmethod
    def read(cls, table: Table) -> Scales:
        """Read the exponents."""
        lists = []
        for field in fields(cls):
            numbers = table.numbers(field.name) if field.name in table else ()
            if any(x.denominator != 1 or abs(x) > MOST for x in numbers):
                raise FormatError(f"{table.path(field.name)} must be whole numbers up to {MOST}")
            lists.append(tuple(map(int, numbers)))
        return cls(*lists)

    def write(self) -> dict[str, list[int]]:
        """Return what `read` reads."""
        lists = {field.name: list(getattr(self, field.name)) for field in fields(self)}
        return {key: plain(values) for key, values in lists.items() if values}


def two(exponent: int) -> Fraction:
    """Return a power of two."""
    return Fraction(2) ** exponent


def largest(bits: int) -> int:
    """Return the largest integer of so many bits."""
    return (1 << (bits - 1)) - 1


def half(bits: int) -> Fraction:
    """Return the error of a number of size one that is rounded."""
    return two(1 - bits)


def sizes(terms: Sequence[Rationals]) -> Rationals:
    """Return the largest sizes of a gain's entries."""
    by_rows = zip(*terms, strict=True)
    return [[sum(map(abs, k), Fraction(0)) for k in zip(*rows, strict=True)] for rows in by_rows]


def gain_errors(
    exact: Sequence[Rationals],
    code: Sequence[Rationals],
    off: Sequence[Fraction],
    scales: Scales,
    varies: bool,
) -> Rationals:
    """Return bounds on the errors of the entries of the gain.

    Parameters
    ----------
    exact, code
        The terms of the law, its last rows times T, and the code's.
    off
        Errors of c^e.
    varies
        Whether entries are found from several terms, and rounded.
    """
    pairs = [(r, s) for r in scales.rows for s in scales.signals]
    units = [two(s - r - 1) if varies else Fraction(0) for r, s in pairs]
    width = len(scales.signals)
    total = [units[k : k + width] for k in range(0, len(units), width)]
    for a, b, t in zip(exact, code, off, strict=True):
        for i, row in enumerate(total):
            for j in range(width):
                row[j] += abs(a[i][j] - b[i][j]) + t * abs(b[i][j])
    return total


def answer_errors(code: Sequence[Rationals], scales: Scales, states: int) -> list[Fraction]:
    """Return bounds on the absolute errors of the answers; of states that of one step."""
    first = len(scales.rows) - states
    kept = zip(scales.signals[len(scales.signals) - states :], scales.answers[first:], strict=True)
    read = [two(-s - 1) if t > s else Fraction(0) for s, t in kept]
    errors = []
    for row, r, t in zip(sizes(code), scales.rows, scales.answers, strict=True):
        rounded = two(-t - 1) if r > t else Fraction(0)
        own = row[len(row) - states :]
        errors.append(rounded + sum((k * e for k, e in zip(own, read, strict=True)), Fraction(0)))
    return errors


def reached(bits: int, code: Sequence[Rationals], scales: Scales) -> list[int]:
    """Return the largest integers that answers have before they are cut."""
    found = []
    for row, r, t in zip(sizes(code), scales.rows, scales.answers, strict=True):
        whole = sum((k * two(r - s) for k, s in zip(row, scales.signals, strict=True)), Fraction(0))
        found.append(int(whole * (largest(bits) + 1) + (1 << (r - t) >> 1)) >> (r - t))
    return found


def step_errors(
    bits: int,
    code: Sequence[Rationals],
    recovering: Rationals,
    exact: Rationals,
    scales: Scales,
) -> list[Fraction]:
    """Return bounds on the absolute errors that anti-windup adds to a step, while inputs are cut.

    That is besides what it makes of the error of u as one of the gain.

    Parameters
    ----------
    recovering, exact
        T G as the code has it, and itself: a row a state, a column an input.
    """
    q = len(recovering)
    most = [n * two(-t) for n, t in zip(reached(bits, code, scales), scales.answers, strict=True)]
    of_u = answer_errors(code, scales, q)
    pairs = zip(scales.beyond, scales.answers, strict=False)
    rounded = [two(-b - 1) if t > b else Fraction(0) for b, t in pairs]
    errors = []
    ends = zip(scales.recovering, scales.answers[len(scales.answers) - q :], strict=True)
    for own, row, (r, t) in zip(recovering, exact, ends, strict=True):
        error = two(-t - 1) if r > t else Fraction(0)
        for j, (k, g) in enumerate(zip(own, row, strict=True)):
            error += abs(k) * (of_u[j] + rounded[j]) + abs(g - k) * most[j]
        errors.append(error)
    return errors


def require_recovering(
    bits: int, code: Sequence[Rationals], recovering: Rationals, scales: Scales
) -> None:
    """Refuse anti-windup that is no integers of so many bits, or whose sums may leave no room."""
    q, m = len(recovering), len(scales.rows) - len(recovering)
    if len(scales.beyond) != m or len(scales.recovering) != q:
        raise FormatError("code.scales must hold one exponent an input and a state of anti-windup")
    top, wide = largest(bits), largest(2 * bits)
    for n, t, b in zip(reached(bits, code, scales), scales.answers, scales.beyond, strict=False):
        shift = t - b
        half = 1 << shift >> 1 if 0 <= shift <= 2 * bits - 2 else wide
        if n + half > wide or (n + half) >> shift > top:
            raise FormatError("code: what is cut off an input may take more than a word")
    for row, r, t in zip(recovering, scales.recovering, scales.answers[m:], strict=True):
        whole = [k * two(r - b) for k, b in zip(row, scales.beyond, strict=True)]
        if any(k.denominator != 1 for k in whole):
            raise FormatError(f"code.G is no integer of {bits} bits")
        require_sums(bits, [abs(k) for k in whole], r - t)


def require(bits: int, code: Sequence[Rationals], scales: Scales, states: int, given: int) -> None:
    """Refuse constants that are no integers of so many bits, or sums that may leave no room."""
    m, n = len(code[0]), len(code[0][0])
    require_counts(scales, n, m, given)
    for row, r, t in zip(sizes(code), scales.rows, scales.answers, strict=True):
        require_sums(
            bits, [k * two(r - s) for k, s in zip(row, scales.signals, strict=True)], r - t
        )
    for entries in code:
        for row, r in zip(entries, scales.rows, strict=True):
            for k, s in zip(row, scales.signals, strict=True):
                if (k * two(r - s)).denominator != 1:
                    raise FormatError(f"code: a gain is no integer of {bits} bits")
    for s, t in zip(scales.signals[n - states :], scales.answers[m - states :], strict=True):
        if not 0 <= t - s <= bits:
            raise FormatError("code.scales: a state is kept with more bits than there are")


def require_counts(scales: Scales, n: int, m: int, given: int) -> None:
    """Refuse another number of exponents than of signals, parameters and rows."""
    counts = [len(scales.signals), len(scales.given), len(scales.rows), len(scales.answers)]
    if counts != [n, given, m, m]:
        raise FormatError("code.scales must hold one exponent a signal, a parameter and a row")


def require_sums(bits: int, whole: Sequence[Fraction], shift: int) -> None:
    """Refuse a row of gains whose integers, or whose sum of products, may have no room.

    ``whole`` are the largest sizes of the integers; the sum is shifted to the answer.
    """
    top, wide = largest(bits), largest(2 * bits)
    if not 0 <= shift <= 2 * bits - 2 or max(whole) > top:
        raise FormatError(f"code: a gain is no integer of {bits} bits")
    if sum(whole) * (top + 1) + (1 << shift >> 1) > wide:
        raise FormatError(f"code: a sum may take more than {2 * bits} bits")


def require_whole(values: Sequence[Fraction], what: str, most: int) -> None:
    """Refuse what is no integer, or a larger one."""
    for value in values:
        if value.denominator != 1 or abs(value) > most:
            raise FormatError(f"{what} is no integer of the code")


def require_share(
    bits: int, low: Fraction, high: Fraction, scale: Fraction, exponent: int, inverted: bool
) -> None:
    """Refuse a parameter's constants that are no integers, or whose products leave no room."""
    top, wide, one = largest(bits), largest(2 * bits), two(exponent)
    ends = [low * one, high * one]
    factor = scale * two(bits - 2) if inverted else scale * two(2 * bits - 2 - exponent)
    require_whole(ends, "code.shares: an end", top)
    require_whole([factor], "code.shares: a scale", wide)
    product = (ends[1] - ends[0]) * abs(factor)
    if inverted:
        product = 2 * product + 2 * max(map(abs, ends))
    if product + two(bits - 1) > wide:
        raise FormatError(f"code.shares: a product may take more than {2 * bits} bits")
