"""Matrix polynomials on products of simplices: every operation is that of their values, exactly."""

from __future__ import annotations

import random
from fractions import Fraction
from math import prod

import pytest

from polefence.proof.matrices import identity, product
from polefence.proof.polynomials import (
    Polynomial,
    affine,
    basis,
    bernstein,
    count_of,
    diagonal,
    monomials,
    number,
    symmetric,
)

SIZES = [(3,), (2, 2), (2, 3)]


def fraction(dice):
    return Fraction(dice.randrange(-9, 10), dice.randrange(1, 7))


def matrix(dice, rows=2, columns=2):
    return [[fraction(dice) for _ in range(columns)] for _ in range(rows)]


def some(dice, sizes, degree, rows=2, columns=2):
    count = count_of(sizes, degree)
    return bernstein([matrix(dice, rows, columns) for _ in range(count)], sizes, degree)


def point(dice, sizes, on=True):
    """Coordinates, of sum one in each simplex, or any."""
    found = []
    for size in sizes:
        own = [Fraction(dice.randrange(1, 9)) for _ in range(size)]
        found += [x / sum(own) for x in own] if on else own
    return found


def value(P, x):
    rows, columns = P.shape
    total = [[Fraction(0)] * columns for _ in range(rows)]
    for e, M in P.terms.items():
        weight = prod((a**p for a, p in zip(x, e, strict=True)), start=Fraction(1)) / P.whole
        total = [
            [t + weight * m for t, m in zip(*r, strict=True)] for r in zip(total, M, strict=True)
        ]
    return total


def plus(X, Y, sign=1):
    return [[a + sign * b for a, b in zip(*rows, strict=True)] for rows in zip(X, Y, strict=True)]


@pytest.mark.parametrize("sizes", SIZES)
def test_values_of_sums_products_and_parts(sizes):
    dice = random.Random(str(sizes))
    P, Q, x = some(dice, sizes, 1), some(dice, sizes, 2), point(dice, sizes)
    p, q = value(P, x), value(Q, x)
    assert value(P * Q, x) == product(p, q)
    assert value(P + Q, x) == plus(p, q)  # of other degrees and denominators
    assert value(P - Q, x) == plus(p, q, -1)
    assert value(P.T, x) == [list(column) for column in zip(*p, strict=True)]
    assert value(P.times(Fraction(-2, 3)), x) == [[Fraction(-2, 3) * e for e in r] for r in p]
    assert value(P.part(slice(1), slice(1, 2)), x) == [[p[0][1]]]
    assert value(P.elevated(2), x) == p
    assert P.elevated(2).degrees == (3,) * len(sizes)
    M = matrix(dice, 2, 3)
    wanted = [[m * e for m in ms for e in row] for ms in M for row in p]
    assert value(P.beside(M), x) == wanted
    f = some(dice, sizes, 1, 1, 1)
    assert value(f * P, x) == [[value(f, x)[0][0] * e for e in row] for row in p]


@pytest.mark.parametrize("sizes", SIZES)
def test_half_of_a_symmetric_product_is_the_product(sizes):
    dice = random.Random(str(sizes))
    P, Q = some(dice, sizes, 2, 3, 4), some(dice, sizes, 1, 4, 4)
    square = P * (Q + Q.T)
    whole, half = square * P.T, square.half_times(P.T)
    assert half == whole
    # what is not symmetric is not seen to be so: a claim's matrices are looked at before
    assert (P * Q).half_times(P.T) != P * Q * P.T


@pytest.mark.parametrize("sizes", SIZES)
def test_the_inner_product_is_of_entries_in_the_same_place(sizes):
    dice = random.Random(str(sizes))
    P, R, x = some(dice, sizes, 1, 3, 2), some(dice, sizes, 2, 3, 2), point(dice, sizes)
    pairs = zip(value(P, x), value(R, x), strict=True)
    wanted = sum(p * r for rows in pairs for p, r in zip(*rows, strict=True))
    assert value(P.inner(R), x) == [[wanted]]


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("degree", [0, 1, 3])
def test_coefficients_are_bernsteins(sizes, degree):
    dice = random.Random(degree)
    coefficients = [matrix(dice) for _ in range(count_of(sizes, degree))]
    x = point(dice, sizes)
    weights = basis(x, sizes, degree)
    assert sum(weights) == 1
    wanted = [
        [sum(w * c[i][j] for w, c in zip(weights, coefficients, strict=True)) for j in range(2)]
        for i in range(2)
    ]
    assert value(bernstein(coefficients, sizes, degree), x) == wanted


@pytest.mark.parametrize("sizes", SIZES)
def test_forms_in_place_of_coordinates(sizes):
    """At any coordinates, on a simplex or not: both sides are homogeneous."""
    dice, other = random.Random(5), (3, 2)
    P = some(dice, sizes, 2)
    forms = [some(dice, other, 1, 1, 1) for _ in range(sum(sizes))]
    x = point(dice, other, on=False)
    composed = P.composed(forms, other)
    assert value(composed, x) == value(P, [value(f, x)[0][0] for f in forms])
    assert composed.degrees == tuple(2 * len(sizes) for _ in other)
    constant = number(Fraction(2, 3), sizes)
    assert value(constant.composed([], other), x) == [[Fraction(2, 3)]]


def test_a_derivative_is_the_slope():
    """p(x + h) - p(x) = h p'(x) + h^2 p''(x) / 2 of degree two, exactly."""
    dice, sizes = random.Random(6), (3, 2)
    P, x, h = some(dice, sizes, 2), point(dice, sizes, on=False), Fraction(2, 7)
    for k in range(5):
        moved = [v + h * (j == k) for j, v in enumerate(x)]
        first, second = P.derivative(k), P.derivative(k).derivative(k)
        slope = plus(
            [[h * e for e in row] for row in value(first, x)],
            [[h * h / 2 * e for e in row] for row in value(second, x)],
        )
        assert plus(value(P, moved), value(P, x), -1) == slope
        assert first.degrees == ((1, 2) if k < 3 else (2, 1))


def test_a_symmetric_matrix_of_blocks():
    dice, sizes = random.Random(7), (2, 2)
    X = some(dice, sizes, 1)
    rows = [[X + X.T, some(dice, sizes, 2, 2, 1)], [number(3, sizes)]]
    found = list(symmetric(rows, (2, 2)))
    assert [e for e, _ in found] == monomials(sizes, 2)
    whole = Polynomial(dict(found), sizes, (2, 2))
    x = point(dice, sizes)
    (a, b), (c,) = ([value(block, x) for block in row] for row in rows)
    wanted = [r + s for r, s in zip(a, b, strict=True)] + [[b[0][0], b[1][0], c[0][0]]]
    mine = value(whole, x)
    assert all(
        e * wanted[0][0] == mine[0][0] * w
        for r, s in zip(mine, wanted, strict=True)
        for e, w in zip(r, s, strict=True)
    )


def test_what_is_the_same_at_all_vertices_is_constant():
    M = [[Fraction(1, 3), Fraction(2)]]
    assert affine([M, M, M], (3,)).degrees == (0,)
    assert affine([M, [[Fraction(0), Fraction(2)]]], (2,)).degrees == (1,)
    assert value(diagonal([Fraction(1)] * 3, (2,)), [Fraction(1), Fraction(0)]) == identity(3)


def largest(rows, columns, degree, size, sign):
    """A polynomial whose entries all have that many bits."""
    entry = Fraction(sign * (2**size - 1))
    count = count_of((2, 2), degree)
    return bernstein([[[entry] * columns] * rows for _ in range(count)], (2, 2), degree)


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("bits", [(1, 1), (8, 8), (9, 7), (64, 301)])
@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 5, 3), (3, 7, 1)])
def test_rows_in_one_number_do_not_run_into_one_another(shape, bits, signs):
    rows, inner, columns = shape
    P = largest(rows, inner, 2, bits[0], signs[0])
    Q = largest(inner, columns, 3, bits[1], signs[1])
    x = [Fraction(1, 3), Fraction(2, 3), Fraction(1, 5), Fraction(4, 5)]
    assert value(P * Q, x) == product(value(P, x), value(Q, x))
