"""Matrices of rationals that several proofs need; the standard library only."""

from __future__ import annotations

from fractions import Fraction
from math import isqrt

from polefence.proof.exact import (
    LONGEST,
    Rationals,
    _denominator,
    _integers,
    rational_product,
    spend,
)

BITS = 64  # of a square root


def product(left: Rationals, right: Rationals) -> Rationals:
    """Return the product of two matrices."""
    return rational_product(left, right)


def scaled(matrix: Rationals, rows: tuple[Fraction, ...]) -> Rationals:
    """Return the matrix with each row divided by its scale."""
    return [[value / s for value in row] for row, s in zip(matrix, rows, strict=True)]


def norm(matrix: Rationals) -> Fraction:
    """Return a little more than the Frobenius norm."""
    common = _denominator([matrix], LONGEST)
    spend(sum(map(len, matrix)), common.bit_length(), common.bit_length())
    whole = sum(value * value for row in _integers(matrix, common) for value in row)
    return root(Fraction(whole, common**2))


def root(value: Fraction) -> Fraction:
    """Return a short rational a little above the square root."""
    if value <= 0:
        return Fraction(0)
    shift = max(0, BITS - value.numerator.bit_length() // 2 + value.denominator.bit_length() // 2)
    whole = -(-(value.numerator << 2 * shift) // value.denominator)
    return Fraction(isqrt(whole) + 1, 1 << shift)
