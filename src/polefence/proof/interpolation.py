"""Samples between nodes: how far the exponential is from its interpolation.

With M(t) = [A, B, E] T, affine in each of the coordinates t_i from 0 to 1 of the box, and rows of
zeros below it, the samples are the first rows of exp M. Entry by entry |exp M| <= exp N, where N
has the largest diagonal entries of M, with their signs, and beside these the largest magnitudes.
So the second derivative along t_i, with |dM/dt_i| <= N_i, is at most that of exp (N + s N_i) at
s = 0,

    C_i = d^2/ds^2 exp (N + s N_i) = e^-c d^2/ds^2 exp (c I + N + s N_i),

of which the last is a series of numbers that are not negative. Between nodes w_i apart along t_i
the multi-affine interpolation is off by at most the sum of w_i^2 C_i / 8: it is one linear
interpolation after the other, each of which is off by at most w_i^2 / 8 times the second
derivative, and makes no error of another larger.

The interpolation of degree 2 along each t_i has nodes in the middle too. The third derivative is
at most

    D_i = d^3/ds^3 exp (N + s N_i) at s = 0,

and one interpolation along t_i is off by at most w_i^3 D_i / 124, as |t (t - 1/2) (t - 1)| / 6 is
at most 1 / (72 sqrt 3). It makes errors of those before it larger, by at most 5/4, the largest sum
of the magnitudes of its three weights.

Where M has functions of the parameters among its entries, N, N_i and the higher derivatives of M
hold these too, and N + s N_i + s^2 N_ii / 2 + s^3 N_iii / 6 is in place of N + s N_i.

The derivatives of a table are those between its knots. A part of the box with a knot of a cubic one
inside has a bounded second derivative still, and no third: it is interpolated between its corners.
So is one with a knot between straight lines, where there is no second derivative either. There the
function f is e off the multi-affine g of its values at the corners, whose second derivatives are
zero, and whose first are no larger than those of f. The samples are bounded with g, and f, with its
matrix F in M, moves them by at most e S more,

    S = d/ds exp (N + s |F|) at s = 0.

All is computed in whole multiples of 2^-96 and rounded to the safe side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from operator import add, mul

from polefence.proof.claims.steps import exponential
from polefence.proof.matrices import Integers, Rationals, bits, longest
from polefence.proof.work import RATIONAL, FormatError, spend

FINE = 96  # bits after the point
ONE = 1 << FINE
MAX_TERMS = 120
TERMS = (20, 40, 60, 80, 100, 120)  # of which the fewest are taken that miss next to nothing
NEXT_TO_NOTHING = Fraction(1, 1 << 60)
SHORT_SERIES = 22  # terms, of numbers whose rows sum to 1/2 at most: what is left is 2^-108


@dataclass(frozen=True)
class Bends:
    """Bounds for the samples of a family.

    Attributes
    ----------
    along : tuple of (n, n + m + q) rationals
        C_i of each parameter.
    missing : Fraction
        What an entry of `sample` is off by at most.
    third : tuple of (n, n + m + q) rationals
        D_i of each parameter.
    kinks : tuple of (n, n + m + q) rationals
        S of each function; none where no table has a knot inside.
    """

    along: tuple[Rationals, ...]
    missing: Fraction
    third: tuple[Rationals, ...]
    kinks: tuple[Rationals, ...] = ()


@dataclass(frozen=True)
class Curves:
    """What functions of the parameters add to [A, B, E] T between its corners.

    Attributes
    ----------
    size : (n, width) rationals
        Its largest magnitude.
    along : tuple of three (n, width) rationals each
        Of each parameter the largest magnitudes of its three derivatives.
    kinks : tuple of (n, width) rationals
        |F| of each function, zero where it has no knot between straight lines; none of these where
        no table has a knot inside.
    """

    size: Rationals
    along: tuple[tuple[Rationals, Rationals, Rationals], ...]
    kinks: tuple[Rationals, ...] = ()


def bends(M: Sequence[Rationals], terms: int, curves: Curves | None = None) -> Bends:
    """Return how much the samples of a family bend, from its vertices.

    Parameters
    ----------
    M : sequence of (n, width) rationals
        [A, B, E] T at the 2^k corners of the box; the first parameter varies slowest.
    terms : int
        Of the series of `sample`.
    curves : Curves, optional
        What is added between the corners.

    Raises
    ------
    FormatError
        If the series needs more terms than these.
    """
    count, length = len(M).bit_length() - 1, max(map(longest, M))
    spend(RATIONAL * len(M) * (count + 1) * len(M[0]) * len(M[0][0]), length, length)
    largest, more = _largest_with(M, curves)
    missing = _missing(largest, terms)
    tops = [
        max(math.ceil(matrix[i][i] * ONE) for matrix in M) + (more[i][i] if more else 0)
        for i in range(len(largest))
    ]
    shift = max(0, -min(tops))
    N = largest
    for i, top in enumerate(tops):
        N[i][i] = top + shift
    along, third = list[Rationals](), list[Rationals]()
    for i in range(count):
        half = 1 << (count - 1 - i)  # places between the two ends of parameter i
        lower = (j for j in range(len(M)) if not j // half % 2)
        rates = [_largest(_magnitudes(_less(M[j + half], M[j])) for j in lower)]
        if curves is not None:
            first, *higher = map(_magnitudes, curves.along[i])
            rates[0] = _sum(rates[0], first)
            rates += [
                [[-(-x // math.factorial(k)) for x in row] for row in matrix]
                for k, matrix in enumerate(higher, 2)
            ]
        _, twice, thrice = _derivatives(N, rates, shift)
        along.append(twice)
        third.append(thrice)
    kinks = tuple(
        _derivatives(N, [_magnitudes(F)], shift)[0] if any(map(any, F)) else F
        for F in (curves.kinks if curves else ())
    )
    return Bends(tuple(along), missing, tuple(third), kinks)


def _largest_with(
    M: Sequence[Rationals], curves: Curves | None
) -> tuple[Integers, Integers | None]:
    """Return the largest magnitudes of the entries, and what of these lies between corners."""
    largest = _largest(map(_magnitudes, M))
    if curves is None:
        return largest, None
    more = _magnitudes(curves.size)
    return _sum(largest, more), more


def terms_needed(M: Sequence[Rationals], curves: Curves | None = None) -> int:
    """Return how many terms of the series of `sample` miss next to nothing.

    Raises
    ------
    FormatError
        If the sample time is too long for so many as are computed.
    """
    largest, _ = _largest_with(M, curves)
    for terms in TERMS[:-1]:
        with suppress(FormatError):
            if _missing(largest, terms) < NEXT_TO_NOTHING:
                return terms
    _missing(largest, TERMS[-1])
    return TERMS[-1]


def sample(M: Rationals, terms: int) -> Integers:
    """Return the sum of A^(k - 1) M / k! for k from 1 to so many terms, times 2^96.

    With [I, 0, 0] it is the samples, to what `Bends.missing` bounds.

    Parameters
    ----------
    M : (n, width) rationals
        [A, B, E] T, of no larger row sums than that of `bends`.
    """
    rates = [[round(x * ONE) for x in row] for row in M]
    spend(terms * len(rates) ** 2 * len(rates[0]), max(FINE, bits(rates)), FINE)
    A, term, total = [row[: len(rates)] for row in rates], rates, rates
    for k in range(2, terms + 1):
        divisor, columns = k << FINE, list(zip(*term, strict=True))
        term = [[sum(map(mul, row, column)) // divisor for column in columns] for row in A]
        total = _sum(total, term)
    return total


def held_sample(M: Rationals, terms: int, early: Fraction, inputs: int) -> Integers:
    """Return `sample` where inputs change when a share ``early`` of the period is left.

    The columns of the next inputs follow those of the inputs that act before: these act for what
    is left of the period, for which the exponential is that of a shorter one.
    """
    whole, n = sample(M, terms), len(M)
    if not early:
        return whole
    soon = sample([[x * early for x in row] for row in M], terms)
    held = slice(n, n + inputs)
    return [
        [
            *x[:n],
            *(a - b for a, b in zip(x[held], y[held], strict=True)),
            *y[held],
            *x[n + inputs :],
        ]
        for x, y in zip(whole, soon, strict=True)
    ]


def _derivatives(N: Integers, rates: Sequence[Integers], shift: int) -> list[Rationals]:
    """Return S, C and D of one parameter, from N + c I and |d^k M/dt_i^k| / k!; c is the shift.

    The exponential is the square of that of half the numbers, and so on: of numbers so small that
    a few terms of the series are enough.
    """
    n, width = len(N), len(N[0])
    halvings = math.ceil(2 * _row_sum(N)).bit_length()
    products = 7 * SHORT_SERIES + 10 * halvings
    spend(products * n * n * width, max(FINE, bits(N)), max(FINE, *map(bits, rates)))
    part = 1 << halvings
    rates = [[[-(-x // part) for x in row] for row in matrix] for matrix in (N, *rates)]
    size, *changes = map(_row_sum, rates)
    below = -(-shift // part)
    none = [[0] * width for _ in range(n)]
    one = [[ONE * (i == j) for j in range(width)] for i in range(n)]
    # of s^0 to s^3 in ((N + s slope) / part)^k / k!
    term, total = [one, none, none, none], [one, none, none, none]  # powers of s
    for k in range(1, SHORT_SERIES + 1):
        term = _product(term, rates, below, k)
        total = [_sum(*pair) for pair in zip(total, term, strict=True)]
    for d, matrix in enumerate(total):
        # of s^d in (size + s c1 + s^2 c2 + ...)^k / k!, all k > terms: of j factors with a power
        # of s it is size^(k - j) / (k - j)! times what is of s^d in (s c1 + ...)^j / j!
        rest = sum(
            (
                share / math.factorial(j) * _tail(size, SHORT_SERIES + 1 - j)
                for j, share in enumerate(_powers(changes, d))
            ),
            Fraction(0),
        )
        total[d] = [[x + math.ceil(rest * ONE) for x in row] for row in matrix]
    below = math.ceil(exponential(Fraction(below, ONE)) * ONE)
    for _ in range(halvings):
        total = _product(total, total, below)
        below = -(-(below**2) >> FINE)
    least = _at_most_exponential(Fraction(shift, ONE)) * ONE
    return [
        [[math.factorial(d) * Fraction(x) / least for x in row] for row in total[d]]
        for d in (1, 2, 3)
    ]


def _powers(changes: Sequence[Fraction], d: int) -> list[Fraction]:
    """Return what is of s^d in (s c1 + s^2 c2 + ...)^j, for j from 0 to d."""
    powers, rows = [Fraction(1), *[Fraction(0)] * d], list[Fraction]()
    for _ in range(d + 1):
        rows.append(powers[d])
        powers = [
            sum((powers[k - 1 - i] * c for i, c in enumerate(changes[:k])), Fraction(0))
            for k in range(d + 1)
        ]
    return rows


def _product(
    left: Sequence[Integers], right: Sequence[Integers], below: int, divisor: int = 1
) -> list[Integers]:
    """Return the first powers of s of a product over a divisor, rounded up.

    Both are sums of powers of s times matrices (n, width) of numbers that are not negative; below
    the right ones are [0, d I], of which d is given.
    """
    n, whole = len(left[0]), divisor << FINE
    columns = [list(zip(*matrix, strict=True)) for matrix in right]
    product = list[Integers]()
    for r in range(len(left)):
        pairs = [(left[r - b], columns[b]) for b in range(min(r + 1, len(right)))]
        rows = list[list[int]]()
        for i in range(n):
            sides = [(matrix[i][:n], of_right) for matrix, of_right in pairs if any(matrix[i][:n])]
            beside = [0] * n + [below * x for x in left[r][i][n:]]
            rows.append(
                [
                    -(-(x + sum(sum(map(mul, row, of[j])) for row, of in sides)) // whole)
                    for j, x in enumerate(beside)
                ]
            )
        product.append(rows)
    return product


def _sum(one: Integers, other: Integers) -> Integers:
    return [list(map(add, *rows)) for rows in zip(one, other, strict=True)]


def _tail(size: Fraction, first: int) -> Fraction:
    """Return at least the sum of size^k / k! from k = first on."""
    return size**first / math.factorial(first) / (1 - size / (first + 1))


def _at_most_exponential(x: Fraction) -> Fraction:
    """Return a little less than e^x, for x >= 0."""
    term = total = ONE
    for k in range(1, MAX_TERMS):
        term = term * x.numerator // (x.denominator * k)
        total += term
    return Fraction(total, ONE)


def _missing(largest: Integers, terms: int) -> Fraction:
    """Return what `sample` is off by: its entries' rounding, its terms' rounding, what is left.

    Parameters
    ----------
    largest : (n, width) integers
        |M| at most, times 2^96.

    Raises
    ------
    FormatError
        If it needs more terms.
    """
    size = _row_sum(largest)
    if size > 16:  # of a row's sum of |M|: what is left of 96 bits is then 70
        raise FormatError("the sample time is too long for these rates")
    if not 4 * size + 2 <= terms <= MAX_TERMS:
        raise FormatError(f"the samples need {math.ceil(4 * size) + 2} to {MAX_TERMS} terms")
    grown = exponential(size + 1)
    return Fraction(len(largest[0]) + 2 * terms, 2 * ONE) * grown + _tail(size, terms + 1)


def _magnitudes(M: Rationals) -> Integers:
    """Return |M| in multiples of 2^-96, rounded up."""
    return [[math.ceil(abs(x) * ONE) for x in row] for row in M]


def _largest(matrices: Iterable[Integers]) -> Integers:
    """Return the largest of each entry."""
    return [[max(xs) for xs in zip(*rows, strict=True)] for rows in zip(*matrices, strict=True)]


def _less(M: Rationals, N: Rationals) -> Rationals:
    return [[a - b for a, b in zip(*rows, strict=True)] for rows in zip(M, N, strict=True)]


def _row_sum(M: Integers) -> Fraction:
    return Fraction(max(map(sum, M)), ONE)
