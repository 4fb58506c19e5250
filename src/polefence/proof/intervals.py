"""Intervals that enclose real numbers: ends in whole multiples of 2^-128, rounded outwards.

Square roots are those of whole numbers. Exponentials, sines and logarithms are sums of their
series, in which 64 bits more are kept than in the ends; every ``_EXTRA``-bit result is off by less
than one end's unit, by which it is widened.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import isqrt

from polefence.proof.work import FormatError, spend

FINE = 128  # bits after the point
ONE = 1 << FINE
_MORE = 64  # bits that series have besides
_WIDE = FINE + _MORE
MOST_BITS = 1024  # of an end before the point
MOST_EXPONENT = 600  # e^x of a larger x is not computed
MOST_ANGLE = 2**40  # [rad]

Interval = tuple[int, int]

ZERO: Interval = (0, 0)
UNIT: Interval = (ONE, ONE)


class NoValueError(FormatError):
    """A function has no value somewhere in an interval; ``what`` says why."""


def enclosing(value: Fraction) -> Interval:
    """Return the least interval about a rational."""
    top, bottom = value.numerator << FINE, value.denominator
    return _within((top // bottom, -(-top // bottom)))


def hull(intervals: Sequence[Interval]) -> Interval:
    """Return the least interval about some."""
    return min(low for low, _ in intervals), max(high for _, high in intervals)


def middle(a: Interval) -> Fraction:
    """Return the number in the middle."""
    return Fraction(a[0] + a[1], 2 * ONE)


def size(a: Interval) -> Fraction:
    """Return the largest magnitude."""
    return Fraction(max(-a[0], a[1]), ONE)


def negative(a: Interval) -> Interval:
    """Return -a."""
    return -a[1], -a[0]


def plus(a: Interval, b: Interval) -> Interval:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1]


def minus(a: Interval, b: Interval) -> Interval:
    """Return a - b."""
    return a[0] - b[1], a[1] - b[0]


def times(a: Interval, b: Interval) -> Interval:
    """Return a b."""
    if a == ZERO or b == ZERO:
        return ZERO
    ends = (a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])
    return _within((min(ends) >> FINE, -(-max(ends) >> FINE)))


def inverse(a: Interval) -> Interval:
    """Return 1 / a.

    Raises
    ------
    NoValueError
        If zero is in it.
    """
    if a[0] <= 0 <= a[1]:
        raise NoValueError("a denominator may be zero")
    top = ONE * ONE
    return _within((top // a[1], -(-top // a[0])))


def root(a: Interval) -> Interval:
    """Return the square root.

    Raises
    ------
    NoValueError
        If a number in it is negative.
    """
    if a[0] < 0:
        raise NoValueError("the argument of sqrt may be negative")
    low, high = isqrt(a[0] << FINE), isqrt(a[1] << FINE)
    return low, high + 1


def exponential(a: Interval) -> Interval:
    """Return e^a.

    Raises
    ------
    NoValueError
        If it is out of range.
    """
    if max(abs(a[0]), abs(a[1])) > MOST_EXPONENT * ONE:
        raise NoValueError(f"the argument of exp may be beyond {MOST_EXPONENT}")
    return max(_exponential(a[0]) - 1, 0), _exponential(a[1]) + 1


def logarithm(a: Interval) -> Interval:
    """Return the natural logarithm.

    Raises
    ------
    NoValueError
        If a number in it is not positive.
    """
    if a[0] <= 0:
        raise NoValueError("the argument of log may be zero or negative")
    return _logarithm(a[0]) - 1, _logarithm(a[1]) + 1


def pi() -> Interval:
    """Return pi."""
    return (_PI >> _MORE) - 1, (_PI >> _MORE) + 2


def sine(a: Interval) -> Interval:
    """Return the sine."""
    return _between(a, 1)


def cosine(a: Interval) -> Interval:
    """Return the cosine."""
    return _between(a, 0)


def _within(a: Interval) -> Interval:
    """Refuse ends that are too long: the work of what follows grows with them."""
    if max(-a[0], a[1]).bit_length() > FINE + MOST_BITS:
        raise NoValueError("a value is out of range")
    return a


def _exponential(x: int) -> int:
    """Return e^x to less than one unit."""
    spend(100, _WIDE, _WIDE)
    halvings = max(0, (abs(x) >> FINE).bit_length()) + 8
    # of x / 2^halvings, below 2^-7 ; each squaring doubles what the sum is off by, relatively
    more = _MORE + 2 * halvings + MOST_EXPONENT * 2
    part = (x << more) >> halvings
    one = 1 << (FINE + more)
    term = total = one
    k = 1
    while term:
        term = (term * part >> (FINE + more)) // k
        total += term
        k += 1
        if term in (0, -1):
            break
    for _ in range(halvings):
        total = total * total >> (FINE + more)
    return total >> more


def _logarithm(x: int) -> int:
    """Return log x to less than one unit, by Newton's method from a series."""
    spend(200, _WIDE, _WIDE)
    shift = x.bit_length() - FINE  # x = 2^shift m, 1/2 <= m < 1
    m = x << (_MORE - shift) if shift < _MORE else x >> (shift - _MORE)
    return (_artanh(m) + shift * _LOG_2) >> _MORE


def _artanh(m: int) -> int:
    """Return log m = 2 artanh((m - 1) / (m + 1)) for m from 1/2 to 1, in wide units."""
    one = 1 << _WIDE
    y = ((m - one) << _WIDE) // (m + one)
    square, power, total, k = y * y >> _WIDE, y, 0, 1
    while power not in (0, -1):
        total += power // k
        power = power * square >> _WIDE
        k += 2
    return 2 * total


_LOG_2 = -_artanh(1 << (_WIDE - 1))


def _arctan_of_inverse(k: int) -> int:
    """Return arctan(1 / k) in wide units, with 32 bits more."""
    power = (1 << (_WIDE + 32)) // k
    total, sign, n = 0, 1, 1
    while power:
        total += sign * (power // n)
        power //= k * k
        sign, n = -sign, n + 2
    return total


_PI = (16 * _arctan_of_inverse(5) - 4 * _arctan_of_inverse(239)) >> 32  # Machin


def _between(a: Interval, quarters: int) -> Interval:
    """Return the range of cos(x - quarters pi / 2)."""
    if max(-a[0], a[1]) > MOST_ANGLE << FINE:
        raise NoValueError("the argument of sin or cos is out of range")
    shift = quarters * _PI // 2
    low, high = (a[0] << _MORE) - shift - 2, (a[1] << _MORE) - shift + 2
    # cos is 1 at even multiples of pi, and -1 at odd ones
    slack = 1 << (_MORE - 8)  # a multiple of pi is off by less: it counts where it is near an end
    first, last = -((-low + slack) // _PI), (high + slack) // _PI
    if last - first >= 1:
        return -ONE, ONE
    values = [_cosine(low), _cosine(high)]
    bottom, top = min(values) - 2, max(values) + 2
    if first == last:
        bottom, top = (bottom, ONE) if first % 2 == 0 else (-ONE, top)
    return max(bottom, -ONE), min(top, ONE)


def _cosine(x: int) -> int:
    """Return the cosine of a number in wide units, to less than one unit."""
    spend(100, _WIDE, _WIDE)
    turn = 2 * _PI
    x = abs((x + _PI) % turn - _PI)  # 0 to pi
    sign = 1
    if 2 * x > _PI:
        x, sign = _PI - x, -1
    square, term, total, k = x * x >> _WIDE, 1 << _WIDE, 0, 0
    while term:
        total += term if k % 4 == 0 else -term
        k += 2
        term = (term * square >> _WIDE) // (k * (k - 1))
    return sign * (total >> _MORE)
