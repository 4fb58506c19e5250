"""Poles inside and outside a region, decided exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from operator import mul
from typing import Any

from polefence.proof.matrices import (
    LONGEST,
    ZERO,
    Integers,
    Rationals,
    bits,
    common_denominator,
    is_positive_definite,
    is_symmetric,
    multiplied,
    transposed,
    whole_numbers,
)
from polefence.proof.reading import Table, plain
from polefence.proof.regions import Part
from polefence.proof.work import cost, spend


@dataclass(frozen=True)
class Outside:
    """Evidence that a pole does not lie in the half-plane p x + q y < c, which holds the region.

    P = S + i T, S symmetric, T skew. If all poles did, R = (p - i q) A - c I would be stable, and
    every P with R* P + P R < 0 positive definite (Lyapunov). For a law K = Z W^-1 both sides come
    times W: W* P (A W + B Z), with which W is seen to be regular, too.
    """

    p: Fraction
    q: Fraction
    c: Fraction
    S: Rationals
    T: Rationals

    @classmethod
    def read(cls, table: Table, n: int) -> Outside:
        """Read evidence about n states."""
        p, q, c = table.numbers("line", 3)
        T = table.matrix("T", n, n) if "T" in table else [[ZERO] * n for _ in range(n)]
        return cls(p, q, c, table.matrix("S", n, n), T)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table = {"line": plain([self.p, self.q, self.c]), "S": plain(self.S)}
        return table | ({"T": plain(self.T)} if any(map(any, self.T)) else {})


def is_outside(
    loop: tuple[Rationals, Rationals],
    region: tuple[Part, ...],
    by: Outside,
    off: Fraction = ZERO,
) -> bool:
    """Whether this proves that a pole of N W^-1 is outside, ``loop`` holding N and W.

    False says nothing. Entries of N may be ``off`` by so much.
    """
    n = len(loop[0])
    shapes = all(len(M) == n and all(len(row) == n for row in M) for M in (by.S, by.T))
    if not shapes or not any(part.in_half_plane(by.p, by.q, by.c) for part in region):
        return False
    if not is_symmetric(by.S) or any(
        by.T[i][j] != -by.T[j][i] for i in range(n) for j in range(i + 1)
    ):
        return False
    p, q, c = whole_numbers(
        [[by.p, by.q, by.c]], common_denominator([[[by.p, by.q, by.c]]], LONGEST)
    )[0]
    N, W = (whole_numbers(M, common_denominator(list(loop), LONGEST)) for M in loop)
    S, T = (whole_numbers(M, common_denominator([by.S, by.T], LONGEST)) for M in (by.S, by.T))
    left = transposed(W)
    SN, TN, SW, TW = (_between(left, *pair) for pair in ((S, N), (T, N), (S, W), (T, W)))
    ahead = [
        [p * a + q * b for a, b in zip(*rows, strict=True)] for rows in zip(SN, TN, strict=True)
    ]
    aside = [
        [p * b - q * a for a, b in zip(*rows, strict=True)] for rows in zip(SN, TN, strict=True)
    ]
    real = [[2 * c * SW[i][j] - ahead[i][j] - ahead[j][i] for j in range(n)] for i in range(n)]
    skew = [[2 * c * TW[i][j] - aside[i][j] + aside[j][i] for j in range(n)] for i in range(n)]
    if off:  # of W' (S + iT) an entry times what a column of N is off by, in every row of the sum
        whole = common_denominator(list(loop), LONGEST)
        both = (_product(left, M) for M in (S, T))
        largest = max(sum(map(abs, x)) + sum(map(abs, y)) for x, y in zip(*both, strict=True))
        more = math.ceil(4 * n * (abs(p) + abs(q)) * largest * off * whole)
        real = [[x - more * (i == j) for j, x in enumerate(row)] for i, row in enumerate(real)]
    decreases = is_positive_definite(_embedded(real, skew))
    return decreases and not is_positive_definite(_embedded(S, T))


def _between(left: Integers, P: Integers, right: Integers) -> Integers:
    return _product(left, _product(P, right))


def _product(P: Integers, Q: Integers) -> Integers:
    """Return the product of two matrices; at once where one is zero, or a multiple of the unit."""
    for one, other in ((P, Q), (Q, P)):
        factor = _multiple(one)
        if factor is not None:
            spend(len(P) ** 2, bits(other), factor.bit_length())
            return [[factor * x for x in row] for row in other]
    return multiplied(P, Q)


def _multiple(M: Integers) -> int | None:
    """Return c of M = c I; None of another matrix."""
    c = M[0][0]
    alike = all(x == c * (i == j) for i, row in enumerate(M) for j, x in enumerate(row))
    return c if alike else None


def _embedded(real: Integers, skew: Integers) -> Integers:
    """Return the symmetric matrix of a Hermitian one; the real part alone where that is all."""
    if not any(map(any, skew)):
        return real
    upper = [a + [-x for x in b] for a, b in zip(real, skew, strict=True)]
    return upper + [b + a for a, b in zip(real, skew, strict=True)]


def all_inside(matrix: Rationals, region: tuple[Part, ...]) -> bool:
    """Decide whether all eigenvalues lie in the region, as `poles_inside` does."""
    whole = common_denominator([matrix], LONGEST)
    polynomial = characteristic(whole_numbers(matrix, whole))
    return roots_inside(polynomial, region, whole)


def inside_work(matrix: Rationals) -> int:
    """Return about what `all_inside` costs."""
    n, length = len(matrix), bits(whole_numbers(matrix, common_denominator([matrix], LONGEST)))
    return n**4 * cost(n * length // 2, length)


def roots_inside(polynomial: list[int], region: tuple[Part, ...], whole: int = 1) -> bool:
    """Decide whether all roots, over ``whole``, lie in the region; the highest power comes first.

    An ellipse is replaced by the polygon of its `TANGENTS`, which contains it.
    """
    for part in region:
        if part.circle is not None:
            common = common_denominator([[list(part.circle)]], LONGEST)
            centre, radius = (int(v * common) * whole for v in part.circle)
            moved = _shifted(_scaled(polynomial, common), centre)
            if not _in_unit_disk([a * radius**k for k, a in enumerate(reversed(moved))][::-1]):
                return False
        elif not all(_in_half_plane(polynomial, whole, *side) for side in part.sides()):
            return False
    return True


def characteristic(matrix: Integers) -> list[int]:
    """Coefficients of det(z I - matrix), highest power first (Faddeev-LeVerrier)."""
    n, length = len(matrix), bits(matrix)
    spend(n**4, n * length // 2, length)
    coefficients = [1]
    power = [[int(i == j) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        columns = transposed(power)
        power = [[sum(map(mul, row, column)) for column in columns] for row in matrix]
        coefficients.append(-sum(power[i][i] for i in range(n)) // k)  # divides exactly
        for i in range(n):
            power[i][i] += coefficients[-1]
    return coefficients


def _shifted(polynomial: list[int], c: int) -> list[int]:
    """Return the polynomial in z of p(z + c), by Horner's scheme."""
    shifted = polynomial[:]
    longest = max(map(int.bit_length, polynomial)) + len(polynomial) * c.bit_length()
    spend(len(polynomial) ** 2, longest, c.bit_length())
    for end in range(len(shifted), 1, -1):
        for i in range(1, end):
            shifted[i] += c * shifted[i - 1]
    return shifted


def _scaled(polynomial: list[int], r: int) -> list[int]:
    """Return the polynomial whose roots are r times those of p."""
    return [c * r**k for k, c in enumerate(polynomial)]


def _in_unit_disk(polynomial: list[int]) -> bool:
    return is_positive_definite(_schur_cohn(polynomial))


def _in_half_plane(
    polynomial: list[int], whole: int, p: Fraction, q: Fraction, c: Fraction
) -> bool:
    """Decide whether all roots z, over ``whole``, of a real polynomial have p x + q |y| < c.

    The numbers z (p - i q) and their conjugates have real parts p x + q y and p x - q y; the left
    half-plane is the unit disk by s = (w + 1) / (w - 1).
    """
    common = common_denominator([[[p, q, c]]], LONGEST)
    P, Q, C = int(p * common), int(q * common), int(c * common) * whole
    rotated = _scaled(polynomial, P)
    if Q:
        # of roots z (p - i q): coefficient k times (p - i q)^k; times the conjugate polynomial
        real, imaginary = [1], [0]
        for _ in polynomial[1:]:
            x, y = real[-1], imaginary[-1]
            real.append(P * x + Q * y)
            imaginary.append(P * y - Q * x)
        parts = [
            [a * b for a, b in zip(polynomial, powers, strict=True)] for powers in (real, imaginary)
        ]
        squares = [_convolved(part, part) for part in parts]
        rotated = [a + b for a, b in zip(*squares, strict=True)]
    s = _shifted(rotated, C)
    n = len(s) - 1
    # in a unit of about the size of the roots, 2^e; then s = 1 + 2 / v with v = w - 1
    e = (s[-1].bit_length() - s[0].bit_length()) // max(n, 1)
    s = [a << (-e * k if e < 0 else e * (n - k)) for k, a in enumerate(s)]
    around = [a << k for k, a in enumerate(reversed(_shifted(s, 1)))]
    mapped = _shifted(around, -1)
    return mapped[0] != 0 and _in_unit_disk(mapped)


def _convolved(a: list[int], b: list[int]) -> list[int]:
    longest = (max(map(int.bit_length, coefficients)) for coefficients in (a, b))
    spend(len(a) * len(b), *longest)
    result = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] += x * y
    return result


def _schur_cohn(a: list[int]) -> Integers:
    """T1 T1' - T2 T2' of the polynomial's triangular Toeplitz matrices."""
    n = len(a) - 1
    longest = max(map(int.bit_length, a))
    spend(n * n * (n + 1) * 2 // 3, longest, longest)
    return [
        [
            sum(a[i - k] * a[j - k] - a[n - i + k] * a[n - j + k] for k in range(min(i, j) + 1))
            for j in range(n)
        ]
        for i in range(n)
    ]
