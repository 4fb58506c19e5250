"""Matrices of rationals and of whole numbers, every operation counted; positive definite or not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import chain
from math import isqrt
from operator import add, mul

from polefence.proof.work import CALL, LEAST_WORK, FormatError, WorkError, cost, spend

ZERO, ONE = Fraction(0), Fraction(1)
MAX_BITS, LONGEST = 20_000, 10**6  # of a common denominator: of what is read; of what is computed

Rationals = list[list[Fraction]]
Integers = list[list[int]]

RUNG = 64  # bits of the first attempt


def is_symmetric(X: Rationals) -> bool:
    """Whether a matrix is its own transpose."""
    return all(X[i][j] == X[j][i] for i in range(len(X)) for j in range(i))


def bits(matrix: Integers) -> int:
    """Return the length of the longest entry."""
    return max(map(int.bit_length, chain.from_iterable(matrix)), default=0)


def times(factor: int, matrix: Integers) -> Integers:
    """Return a multiple of a matrix."""
    return matrix if factor == 1 else [[factor * entry for entry in row] for row in matrix]


def plus(X: Integers, Y: Integers) -> Integers:
    """Return the sum of two matrices."""
    return [list(map(add, x, y)) for x, y in zip(X, Y, strict=True)]


def transposed(matrix: Integers) -> Integers:
    """Return the transpose."""
    return [list(column) for column in zip(*matrix, strict=True)]


def common_denominator(matrices: Iterable[Rationals], limit: int = MAX_BITS) -> int:
    """Return the least common denominator of all entries.

    Raises
    ------
    FormatError
        If it has more bits than the limit.
    """
    common = 1
    for denominator in {entry.denominator for M in matrices for row in M for entry in row}:
        length = common.bit_length()
        spend(1, length, min(length, denominator.bit_length()) + 30)
        common = math.lcm(common, denominator)
        if common.bit_length() > limit:
            raise WorkError("the numbers' common denominator is too large")
    return common


def longest(points: Iterable[Iterable[Fraction]]) -> int:
    """Return the length of the longest numerator or denominator."""
    pairs = (x.as_integer_ratio() for point in points for x in point)
    return max((max(map(int.bit_length, pair)) for pair in pairs), default=0)


def beside(matrices: Sequence[Rationals]) -> Rationals:
    """Return matrices of as many rows side by side."""
    return [[x for row in rows for x in row] for rows in zip(*matrices, strict=True)]


def whole_numbers(matrix: Rationals, denominator: int) -> Integers:
    """Return a matrix times a multiple of its denominators."""
    length = denominator.bit_length()
    spend(2 * len(matrix) * len(matrix[0] if matrix else []), length, min(length, 1000))
    return [[e.numerator * (denominator // e.denominator) for e in row] for row in matrix]


def quotient(matrix: Rationals) -> tuple[Rationals, Rationals]:
    """Return a matrix as N W^-1: N and W = I."""
    return matrix, identity(len(matrix))


def multiplied(P: Integers, Q: Integers) -> Integers:
    """Return the product of two matrices."""
    spend(len(P) * len(Q) * len(Q[0]), bits(P), bits(Q))
    columns = transposed(Q)
    return [[sum(map(mul, row, column)) for column in columns] for row in P]


def mix(weights: list[Fraction], matrices: list[Rationals]) -> Rationals:
    """Return the sum of weights times matrices."""
    return mixes([weights], matrices)[0]


def mixes(every: Sequence[list[Fraction]], matrices: list[Rationals]) -> list[Rationals]:
    """Return the sums of each weights times the same matrices."""
    whole = common_denominator(matrices, LONGEST)
    integers = [whole_numbers(M, whole) for M in matrices]
    count, length = sum(len(M) * len(M[0]) for M in matrices), max(map(bits, integers))
    table = [list(zip(*rows, strict=True)) for rows in zip(*integers, strict=True)]
    mixed = list[Rationals]()
    for weights in every:
        common = common_denominator([[weights]], LONGEST)
        (factors,) = whole_numbers([weights], common)
        spend(count, bits([factors]), length)
        below = common * whole
        mixed.append([[_ratio(sum(map(mul, factors, e)), below) for e in row] for row in table])
    return mixed


def _ratio(above: int, below: int) -> Fraction:
    return Fraction(above, below) if above else ZERO  # most entries of a plant are zero


def right_divide(Z: Rationals, W: Rationals) -> Rationals | None:
    """Return Z W^-1 by fraction-free Gauss-Jordan elimination on columns, None for a singular W."""
    n = len(W)
    common = common_denominator([Z, W], LONGEST)
    table = transposed(whole_numbers(W, common) + whole_numbers(Z, common))
    length = n * bits(table)
    spend(n * n * len(table[0]), length, length)
    previous = 1
    for p in range(n):
        pivot = next((i for i in range(p, n) if table[i][p]), None)
        if pivot is None:
            return None
        table[p], table[pivot] = table[pivot], table[p]
        leading = table[p]
        for i in range(n):
            factor = table[i][p]
            if i != p:
                table[i] = [
                    (leading[p] * a - factor * b) // previous
                    for a, b in zip(table[i], leading, strict=True)
                ]
        previous = leading[p]
    return [[Fraction(table[i][n + q], table[i][i]) for i in range(n)] for q in range(len(Z))]


def product(left: Rationals, right: Rationals) -> Rationals:
    """Return the product of two matrices."""
    one, other = (common_denominator([M], LONGEST) for M in (left, right))
    both = multiplied(whole_numbers(left, one), whole_numbers(right, other))
    return [[Fraction(e, one * other) for e in row] for row in both]


def scaled(matrix: Rationals, rows: tuple[Fraction, ...]) -> Rationals:
    """Return the matrix with each row divided by its scale."""
    return [[value / s for value in row] for row, s in zip(matrix, rows, strict=True)]


def identity(n: int) -> Rationals:
    """Return I."""
    return [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]


def inverse(T: Rationals, name: str) -> Rationals:
    """Return the inverse.

    Raises
    ------
    FormatError
        If the matrix, of this name, is singular.
    """
    inverted = right_divide(identity(len(T)), T)
    if inverted is None:
        raise FormatError(f"{name} is singular")
    return inverted


def norm(matrix: Rationals) -> Fraction:
    """Return a little more than the Frobenius norm."""
    common = common_denominator([matrix], LONGEST)
    spend(sum(map(len, matrix)), common.bit_length(), common.bit_length())
    whole = sum(value * value for row in whole_numbers(matrix, common) for value in row)
    return root(Fraction(whole, common**2))


def root(value: Fraction) -> Fraction:
    """Return a short rational a little above the square root."""
    if value <= 0:
        return Fraction(0)
    shift = max(0, 64 - value.numerator.bit_length() // 2 + value.denominator.bit_length() // 2)
    whole = -(-(value.numerator << 2 * shift) // value.denominator)
    return Fraction(isqrt(whole) + 1, 1 << shift)


def root_above(square: Fraction) -> Fraction:
    """Return a little more than the square root, of few digits."""
    bits = max(0, 48 - (square.numerator.bit_length() - square.denominator.bit_length()) // 2)
    return Fraction(math.isqrt((square.numerator << 2 * bits) // square.denominator) + 1, 1 << bits)


def least_work(count: int, rows: int) -> int:
    """Return the least that so many inequalities of so many rows take, whatever their numbers."""
    return count * (rows * (rows + 1) * (rows + 2) // 6 * cost(RUNG, RUNG) + LEAST_WORK)


def is_positive_definite(matrix: Integers) -> bool:
    """Decide exactly whether a symmetric matrix is positive definite.

    By `_attempt` with numbers cut to 64, 256, 1024, 4096 bits, one after the other, until they are
    enough; where the matrix is too near to a singular one for that, by Sylvester's criterion.

    Raises
    ------
    FormatError
        If a count of the work says that it is too much.
    """
    n, length = len(matrix), bits(matrix)
    spend(LEAST_WORK // CALL, 0)
    spend(n * n, length)
    exponents = [(matrix[i][i].bit_length() + 1) // 2 for i in range(n)]
    if any(matrix[i][i] <= 0 for i in range(n)):
        return False
    p = RUNG
    while p <= min(max(RUNG, n * length), 4096):
        spend(n * (n + 1) * (n + 2) // 3, p, p)
        answer = _attempt(matrix, exponents, p)
        if answer is not None:
            return answer
        p *= 4
    return _sylvester(matrix)


def _attempt(matrix: Integers, exponents: list[int], p: int) -> bool | None:
    """Decide with p bits, None where they are too few.

    S, the matrix scaled by powers of two to diagonal entries from 1/4 to 1, is S 2^p = s + E1 with
    whole s and entries of E1 from 0 to 1, so |E1| <= n. If Cholesky's recursion in whole numbers
    finds R for s - c I, then (s - c I) 2^p = R'R + E2, where E2 has the remainders of its divisions
    and roots: 0 <= E2 <= 2 (2^p + c) entry by entry, |E2| <= 2 n (2^p + c). So s - c I >=
    -2 n (1 + c / 2^p) I, and c > 3 n (1 + c / 2^p) makes S positive definite. If it meets a pivot
    that is not positive for s + c I, there is x with x'R'R x = 0, and x'S x < 0 by the same bounds.
    """
    n = len(matrix)
    s: Integers = []
    for i, row in enumerate(matrix):
        scaled = []
        for j in range(i, n):
            total = exponents[i] + exponents[j]
            if row[j].bit_length() > total:  # above the root of the two diagonal entries
                return False
            shift = p - total
            scaled.append(row[j] << shift if shift >= 0 else row[j] >> -shift)
        s.append(scaled)
    c = 4 * n + 4
    if _has_root(s, -c, p):
        return True
    return None if _has_root(s, c, p) else False


def _has_root(s: Integers, c: int, p: int) -> bool:
    """Whether all pivots of Cholesky's recursion for s + c I are positive; s is its upper half."""
    columns: Integers = [[] for _ in s]
    for i, row in enumerate(s):
        leading = columns[i]
        square = ((row[0] + c) << p) - sum(map(mul, leading, leading))
        pivot = math.isqrt(square) if square > 0 else 0
        if not pivot:
            return False
        for entry, column in zip(row[1:], columns[i + 1 :], strict=True):
            column.append(((entry << p) - sum(map(mul, leading, column))) // pivot)
    return True


def is_semidefinite(matrix: Integers) -> bool:
    """Decide exactly whether a symmetric matrix has no negative eigenvalue.

    Raises
    ------
    FormatError
        If a count of the work says that it is too much.
    """
    n = len(matrix)
    if any(matrix[i][i] < 0 for i in range(n)):
        return False
    spend(n * (n + 1) * (n + 2) // 3, RUNG, RUNG)
    exponents = [(matrix[i][i].bit_length() + 1) // 2 for i in range(n)]
    answer = _attempt(matrix, exponents, RUNG)
    return _sylvester(matrix, singular=True) if answer is None else answer


def _sylvester(matrix: Integers, singular: bool = False) -> bool:
    """Sylvester's criterion by fraction-free (Bareiss) elimination: all pivots are minors > 0.

    A pivot may be zero, with its row, where the matrix may be singular.
    """
    n, length = len(matrix), bits(matrix)
    spend(n * (n + 1) * (n + 2) // 3, n * length, n * length // 2)
    common = math.gcd(*(entry for row in matrix for entry in row)) or 1
    # Upper triangle only: the Schur complements stay symmetric.
    rows = [[entry // common for entry in row[i:]] for i, row in enumerate(matrix)]
    previous = 1
    while rows:
        first, *rest = rows
        pivot = first[0]
        if singular and not any(first):
            rows = rest
            continue
        if pivot <= 0:
            return False
        rows = [
            [
                (pivot * entry - first[i + 1] * first[i + 1 + j]) // previous
                for j, entry in enumerate(row)
            ]
            for i, row in enumerate(rest)
        ]
        previous = pivot
    return True
