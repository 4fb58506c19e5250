"""Matrix polynomials on products of simplices."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import combinations_with_replacement, product
from typing import Any

from polefence.proof.matrices import Integers, _sum, _times, _transposed, bits
from polefence.proof.work import MAX_HELD, FormatError, spend

MAX_COEFFICIENTS = 20_000
MAX_DEGREE = 16  # of any polynomial, in each simplex
COORDINATES = 2  # of an exponent, which are added at the cost of one operation
Exponent = tuple[int, ...]
Polynomial = dict[Exponent, Integers]  # homogeneous in each simplex, coefficients of monomials


def _longest(P: Polynomial) -> int:
    return max(map(bits, P.values()), default=0)


def _hold(matrices: int, entries: int, length: int) -> None:
    if matrices * entries * (36 + length // 7) > MAX_HELD:
        raise FormatError("its polynomials are larger than is checked here; use a lower degree")


def monomials(sizes: tuple[int, ...], degree: int) -> list[Exponent]:
    """Return the exponents of the monomials of a degree in each simplex, in the file's order.

    Fewest corners first, then by exponents from the largest down, then by corners; in a product
    the first simplex varies slowest.
    """
    return [sum(parts, ()) for parts in product(*(_simplex(size, degree) for size in sizes))]


def _simplex(size: int, degree: int) -> list[Exponent]:
    spend(math.comb(size - 1 + degree, degree) * (size // COORDINATES + degree + 1), 0)

    def rank(chosen: Exponent) -> Any:
        order = sorted(set(chosen), key=lambda j: (-chosen.count(j), j))
        return len(order), [-chosen.count(j) for j in order], order

    powers = []
    for chosen in sorted(combinations_with_replacement(range(size), degree), key=rank):
        power = [0] * size
        for j in chosen:
            power[j] += 1
        powers.append(tuple(power))
    return powers


def _number(sizes: tuple[int, ...], degree: int) -> int:
    return math.prod(math.comb(size - 1 + degree, degree) for size in sizes)


def _binomial(exponent: Exponent, sizes: tuple[int, ...]) -> int:
    """Return the multinomial coefficient of a monomial, the product over the simplices."""
    value, start = 1, 0
    for size in sizes:
        powers = exponent[start : start + size]
        start += size
        value *= math.factorial(sum(powers))
        for power in powers:
            value //= math.factorial(power)
    return value


def _bernstein(coefficients: list[Integers], sizes: tuple[int, ...], degree: int) -> Polynomial:
    return {
        e: _times(_binomial(e, sizes), c)
        for e, c in zip(monomials(sizes, degree), coefficients, strict=True)
    }


def _product(P: Polynomial, Q: Polynomial) -> Polynomial:
    """Multiply matrix polynomials."""
    result: Polynomial = {}
    columns = {e: _transposed(q) for e, q in Q.items()}
    left, right = _longest(P), _longest(Q)
    none: Integers = [[]]
    one, other = next(iter(P.values()), none), next(iter(columns.values()), none)
    spend(len(P) * len(Q) * len(one) * len(other) * len(one[0]), left, right)
    _spend_exponents(len(P) * len(Q), P)
    for d, p in P.items():
        for e, c in columns.items():
            both = [[sum(map(int.__mul__, row, column)) for column in c] for row in p]
            _add(result, tuple(map(int.__add__, d, e)), both)
        _hold(len(result), len(one) * len(other), left + right)
    return result


def _spend_exponents(count: int, P: Polynomial) -> None:
    spend(count * len(next(iter(P), ())) // COORDINATES, 0)


def _add(P: Polynomial, exponent: Exponent, matrix: Integers) -> None:
    P[exponent] = _sum(P[exponent], matrix) if exponent in P else matrix


def _plus(P: Polynomial, Q: Polynomial) -> Polynomial:
    result = dict(P)
    for e, matrix in Q.items():
        _add(result, e, matrix)
    return result


def _multiple(factor: int, P: Polynomial) -> Polynomial:
    spend(
        sum(len(matrix) * len(matrix[0]) for matrix in P.values()), factor.bit_length(), _longest(P)
    )
    return P if factor == 1 else {e: _times(factor, matrix) for e, matrix in P.items()}


def _elevated(P: Polynomial, sizes: tuple[int, ...], times: int) -> Polynomial:
    """Multiply by (sum of a simplex's coordinates)^times, for every simplex."""
    for _ in range(times):
        start, length = 0, _longest(P)
        for size in sizes:
            one = next(iter(P.values()))
            spend(len(P) * size * len(one) * len(one[0]), length)
            _spend_exponents(len(P) * size, P)
            _hold(len(P) * size, len(one) * len(one[0]), length)
            result: Polynomial = {}
            for e, matrix in P.items():
                for j in range(start, start + size):
                    _add(result, (*e[:j], e[j] + 1, *e[j + 1 :]), matrix)
            P, start = result, start + size
    return P


def _weighted(weights: Polynomial, X: Polynomial) -> Polynomial:
    result: Polynomial = {}
    entries = sum(len(matrix) * len(matrix[0]) for matrix in X.values())
    spend(len(weights) * entries, _longest(weights), _longest(X))
    _spend_exponents(len(weights) * len(X), X)
    for d, q in weights.items():
        for e, matrix in X.items():
            _add(result, tuple(map(int.__add__, d, e)), _times(q[0][0], matrix))
    return result


def _starts(sizes: tuple[int, ...]) -> list[int]:
    return [sum(sizes[:f]) for f in range(len(sizes))]


def _coordinates(alpha: list[Fraction], sizes: tuple[int, ...]) -> list[Fraction]:
    """Return the point's coordinates in each simplex, one after the other."""
    if len(sizes) == 1:
        return alpha
    found: list[Fraction] = []
    for f in range(len(sizes)):
        bit = len(sizes) - 1 - f
        high = sum((a for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        found += [1 - high, high]
    for a, corner in zip(alpha, monomials(sizes, 1), strict=True):
        if a != math.prod(x for x, power in zip(found, corner, strict=True) if power):
            raise ValueError("alpha is no product of points of the parameters' intervals")
    return found


def _basis(coordinates: list[Fraction], sizes: tuple[int, ...], degree: int) -> list[Fraction]:
    """Return the values of the Bernstein polynomials."""
    return [
        math.prod((x**p for x, p in zip(coordinates, e, strict=True)), start=Fraction(1))
        * _binomial(e, sizes)
        for e in monomials(sizes, degree)
    ]
