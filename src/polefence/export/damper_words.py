"""A law of controllable dampers in fixed point: its scales, its integers, and what it is off by.

With u = K x, v the rate, and the force f = u between two curves of v, lines from bend to bend, the
code's coefficient is f / v between the bounds c1 and c2 of them all; the force of a damper, c v, is
then f between c1 v and c2 v. In words u, v and f have t_u, t_v and t_u bits behind the point, the
slopes of the curves h, and c has t_c. Where all |x| are in their ranges, u and v are off by e_u and
e_v, their rounding and that of their gains, and the force by no more than

    c2 e_v                              v itself,
    3/2 2^-t_c |v|                      c to nearest, its bounds inwards,
    max(e_u, max(s, c2) e_v)            f, s the steepest slope,
    2^-(h + 1) |v| + 2^-t_u + s 2^-t_v  the curves, their bends.

The coefficient never leaves its bounds: its own are integers inside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor

from polefence.base.errors import InputError
from polefence.export.words import exponent_of, longer, row_of, whole_of
from polefence.proof.claims.words import largest, two
from polefence.proof.dampers import SemiActive

HALF = Fraction(1, 2)


@dataclass(frozen=True)
class DamperWords:
    """The integers of one damper, by the templates' names of them.

    Attributes
    ----------
    K, rate : tuple of int
        A number each signal.
    starts : tuple of int
        Where each part begins, the first has none.
    low, low_start, high, high_start : tuple of int
        Slopes of the curves and their values at zero, part by part.
    least, most : int
        Bounds of the coefficient.
    of_c : int
        Bits behind its point.
    of_u, of_v, of_line, up : int
        Shifts: from sums to u and v, from slopes times v to u, and from u to c times v.
    error : Fraction
        What the force is off by at most, where all signals are in their ranges.
    """

    K: tuple[int, ...]
    rate: tuple[int, ...]
    starts: tuple[int, ...]
    low: tuple[int, ...]
    low_start: tuple[int, ...]
    high: tuple[int, ...]
    high_start: tuple[int, ...]
    least: int
    most: int
    of_c: int
    of_u: int
    of_v: int
    of_line: int
    up: int
    error: Fraction


def scales_of(names: Sequence[str], ranges: Mapping[str, float], bits: int) -> tuple[int, ...]:
    """Return the bits behind the point of each signal.

    Raises
    ------
    InputError
        If a range is missing, unknown, or no positive number.
    """
    for name, value in ranges.items():
        if name not in names:
            raise InputError(
                f"range {name!r} is of no signal of the law; these are: {', '.join(names)}"
            )
        if not 1e-100 < value < 1e100:
            raise InputError(f"range of {name!r} = {value!r} must be a positive number")
    missing = [name for name in names if name not in ranges]
    if missing:
        raise InputError(
            f"--fixed needs the range of {', '.join(missing)}: give the largest absolute value of "
            f"each in its unit, such as --range '{missing[0]} = 0.1'"
        )
    return tuple(exponent_of(Fraction(ranges[name]), bits) for name in names)


def in_words(
    row: Sequence[Fraction], damper: SemiActive, signals: Sequence[int], bits: int
) -> DamperWords:
    """Return the integers of a damper.

    Parameters
    ----------
    row : sequence of Fraction
        K of the signals.
    signals : sequence of int
        Their bits behind the point.

    Raises
    ------
    InputError
        If so many bits have no room for a number between its bounds.
    """
    top, rate = largest(bits), damper.rate[0][0][: len(signals)]
    r_v, t_v = row_of(_entries(rate, signals), None, bits)
    r_u, t_u = row_of(_entries(row, signals), None, bits)
    lines = [damper.lines(part) for part in damper.parts]
    bounds = damper.ends
    steepest = max(abs(line[0]) for pair in lines for line in pair)
    fastest = top * two(-t_v)
    force = max(abs(s * v) for s in (steepest, bounds[1]) for v in (fastest,))
    force += max(abs(line[1]) for pair in lines for line in pair)
    h = exponent_of(steepest, bits)
    of_c = exponent_of(bounds[1], bits)
    t_u = min(t_u, exponent_of(force * Fraction(5, 4), bits), h + t_v, of_c + t_v)
    of_c = min(of_c, t_u - t_v + bits - 2)
    least, most = ceil(bounds[0] * two(of_c)), floor(bounds[1] * two(of_c))
    if least > most or not 0 <= h + t_v - t_u <= 2 * bits - 2 or r_u - t_u > 2 * bits - 2:
        raise InputError(
            f"--fixed {bits} cannot hold the law: no integer lies between the bounds of a "
            f"coefficient; {longer(bits)}"
        )
    errors = [
        sum(
            (
                abs(k - whole_of(k, r - s) * two(s - r)) * top * two(-s)
                for k, s in zip(gains, signals, strict=True)
            ),
            two(-t - 1) if r > t else Fraction(0),
        )
        for gains, r, t in ((row, r_u, t_u), (rate, r_v, t_v))
    ]
    e_u, e_v = errors
    error = bounds[1] * e_v + Fraction(3, 2) * two(-of_c) * fastest
    error += max(e_u, max(steepest, bounds[1]) * e_v)
    error += two(-h - 1) * fastest + two(-t_u) + steepest * two(-t_v)
    starts = [Fraction(0) if part[0] is None else part[0] for part in damper.parts]
    return DamperWords(
        tuple(whole_of(k, r_u - s) for k, s in zip(row, signals, strict=True)),
        tuple(whole_of(k, r_v - s) for k, s in zip(rate, signals, strict=True)),
        tuple(whole_of(start, t_v) for start in starts),
        tuple(whole_of(low[0], h) for low, _ in lines),
        tuple(whole_of(low[1], t_u) for low, _ in lines),
        tuple(whole_of(high[0], h) for _, high in lines),
        tuple(whole_of(high[1], t_u) for _, high in lines),
        least,
        most,
        of_c,
        r_u - t_u,
        r_v - t_v,
        h + t_v - t_u,
        of_c + t_v - t_u,
        error,
    )


def _entries(row: Sequence[Fraction], signals: Sequence[int]) -> list[list[Fraction]]:
    return [[k * two(-s)] for k, s in zip(row, signals, strict=True)]
