"""Polynomials of rational matrices on a product of simplices, held in whole numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain

from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    Rationals,
    _denominator,
    _integers,
    _transposed,
)
from polefence.proof.polynomials import (
    Exponent,
    Polynomial,
    _bernstein,
    _elevated,
    _multiple,
    _plus,
    _product,
    monomials,
)


@dataclass(frozen=True)
class Form:
    """A matrix polynomial, of one degree in each simplex; ``P`` is it times ``whole`` > 0."""

    P: Polynomial
    sizes: tuple[int, ...]
    degree: int
    whole: int = 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        matrix = next(iter(self.P.values()))
        return len(matrix), len(matrix[0])

    def raised(self, degree: int) -> Form:
        """Return the same polynomial, by powers of the sums of coordinates of this degree."""
        if degree == self.degree:
            return self
        P = _elevated(self.P, self.sizes, degree - self.degree)
        return Form(P, self.sizes, degree, self.whole)

    def over(self, whole: int) -> Polynomial:
        """Return the polynomial times a multiple of ``self.whole``."""
        return _multiple(whole // self.whole, self.P)

    def __mul__(self, other: Form) -> Form:
        P = _product(self.P, other.P)
        return Form(P, self.sizes, self.degree + other.degree, self.whole * other.whole)

    def __add__(self, other: Form) -> Form:
        degree, whole = max(self.degree, other.degree), math.lcm(self.whole, other.whole)
        one, two = (form.raised(degree).over(whole) for form in (self, other))
        return Form(_plus(one, two), self.sizes, degree, whole)

    def times(self, factor: Fraction) -> Form:
        """Return a multiple."""
        P = _multiple(factor.numerator, self.P)
        return Form(P, self.sizes, self.degree, self.whole * factor.denominator)

    @property
    def T(self) -> Form:
        """The transpose."""
        P = {e: _transposed(matrix) for e, matrix in self.P.items()}
        return Form(P, self.sizes, self.degree, self.whole)

    def part(self, rows: slice, columns: slice = slice(None)) -> Form:
        """Return some rows and columns."""
        P = {e: [row[columns] for row in matrix[rows]] for e, matrix in self.P.items()}
        return Form(P, self.sizes, self.degree, self.whole)


def bernstein(
    coefficients: list[Rationals], sizes: tuple[int, ...], degree: int, limit: int = 2 * MAX_BITS
) -> Form:
    """Return the polynomial with these Bernstein coefficients."""
    whole = _denominator(coefficients, limit)
    integers = [_integers(c, whole) for c in coefficients]
    return Form(_bernstein(integers, sizes, degree), sizes, degree, whole)


def affine(vertices: list[Rationals], sizes: tuple[int, ...]) -> Form:
    """Return what has these values at the vertices: of degree 1, or 0 if all are the same."""
    if all(each == vertices[0] for each in vertices):
        return bernstein(vertices[:1], sizes, 0)
    return bernstein(vertices, sizes, 1)


def identity(n: int, sizes: tuple[int, ...]) -> Form:
    """Return I."""
    eye = [[int(i == j) for j in range(n)] for i in range(n)]
    return Form({(0,) * sum(sizes): eye}, sizes, 0)


def symmetric_blocks(rows: list[list[Form]], degree: int) -> Iterator[tuple[Exponent, Integers]]:
    """Yield each coefficient of a symmetric matrix of blocks, times one positive integer.

    ``rows`` holds the blocks on the diagonal and to its right.
    """
    whole = math.lcm(*(form.whole for row in rows for form in row))
    upper = [[form.raised(degree).over(whole) for form in row] for row in rows]
    for e in monomials(rows[0][0].sizes, degree):
        matrix: Integers = []
        for i, blocks in enumerate(upper):
            left = [_transposed(upper[k][i - k][e]) for k in range(i)]
            both = [*left, *(block[e] for block in blocks)]
            matrix += [list(chain(*parts)) for parts in zip(*both, strict=True)]
        yield e, matrix
