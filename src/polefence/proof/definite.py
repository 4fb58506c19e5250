"""Positive definite matrices of whole numbers, decided exactly."""

from __future__ import annotations

import math
from operator import mul

from polefence.proof.matrices import Integers, bits
from polefence.proof.work import CALL, LEAST_WORK, cost, spend


def least_work(count: int, rows: int) -> int:
    """Return the least that so many inequalities of so many rows take, whatever their numbers."""
    return count * (rows * (rows + 1) * (rows + 2) // 6 * cost(RUNG, RUNG) + LEAST_WORK)


RUNG, LAST_RUNG = 64, 4096  # bits of the first attempt and of the last


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
    while p <= min(max(RUNG, n * length), LAST_RUNG):
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
        own = columns[i]
        square = ((row[0] + c) << p) - sum(map(mul, own, own))
        pivot = math.isqrt(square) if square > 0 else 0
        if not pivot:
            return False
        for entry, column in zip(row[1:], columns[i + 1 :], strict=True):
            column.append(((entry << p) - sum(map(mul, own, column))) // pivot)
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
