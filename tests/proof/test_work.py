"""Positive definiteness by few digits, poles outside by evidence, and the count of the work."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.certify import counterexample
from polefence.proof import matrices, roots, work
from polefence.proof import matrices as definite
from polefence.proof.matrices import product
from polefence.proof.regions import parts_of
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    damping_of,
)

# Regions that grow with t > 0, one family a kind.
GROWING = {
    "disk": lambda t: Disk(-5, t),
    "half_plane": lambda t: HalfPlane(5 - t),
    "sector": lambda t: Sector(damping_of(t)),
    "vertical_strip": lambda t: VerticalStrip(-5 - t, -5 + t),
    "horizontal_strip": lambda t: HorizontalStrip(t),
    "ellipse": lambda t: Ellipse(-5, 2 * t, t),
}


def rationals(matrix):
    return [[Fraction(float(x)) for x in row] for row in matrix]


def gram(rows):
    return [[sum(a * b for a, b in zip(x, y, strict=True)) for y in rows] for x in rows]


integers = st.lists(
    st.lists(st.integers(-(10**30), 10**30), min_size=4, max_size=4), min_size=4, max_size=4
)


@given(integers, st.integers(0, 400), st.integers(-3, 3))
def test_few_digits_decide_as_all_do(rows, shift, beside):
    """Gram matrices, singular ones among them, moved by one unit of the last place; and scaled."""
    for matrix in (gram(rows), gram([*rows[:3], rows[0]])):
        moved = [
            [e + beside * (i == j == 2) for j, e in enumerate(r)] for i, r in enumerate(matrix)
        ]
        wide = [
            [e << shift * ((i == 0) + (j == 0)) for j, e in enumerate(r)]
            for i, r in enumerate(moved)
        ]
        wanted = definite._sylvester(moved)
        assert definite.is_positive_definite(moved) == wanted
        assert definite.is_positive_definite(wide) == wanted
        for p in (64, 70, 256, 2048):
            exponents = [(wide[i][i].bit_length() + 1) // 2 for i in range(4)]
            if all(wide[i][i] > 0 for i in range(4)):
                assert definite._attempt(wide, exponents, p) in (wanted, None)


@given(integers, st.integers(-1, 1))
def test_semidefinite_takes_singular_matrices_and_no_negative_ones(rows, beside):
    whole = gram([*rows[:3], [a + b for a, b in zip(rows[0], rows[1], strict=True)]])
    assert definite.is_semidefinite(whole)
    whole[3][3] += beside
    assert definite.is_semidefinite(whole) == (beside >= 0)
    assert definite.is_semidefinite([[0, 0], [0, 4]])
    assert not definite.is_semidefinite([[0, 1], [1, 4]])


def test_a_margin_of_one_in_ten_to_the_fifty_is_seen_from_both_sides():
    for n in (2, 7):
        ones = [[10**50 + 2 * (i == j) for j in range(n)] for i in range(n)]
        assert definite.is_positive_definite(ones)
        ones[0][0] -= 4
        assert not definite.is_positive_definite(ones)
        ones = [[10**50] * n for _ in range(n)]
        assert not definite.is_positive_definite(ones)  # singular


@pytest.mark.parametrize("kind", GROWING)
@pytest.mark.parametrize("n", [2, 5, 12])
def test_evidence_is_found_where_a_pole_is_outside_and_nowhere_else(kind, n):
    random = np.random.default_rng(n)
    seen = 0
    for _ in range(4):
        A = random.normal(size=(n, n)) / np.sqrt(n) - 5 * np.eye(n)
        poles = np.linalg.eigvals(A)
        reach = {
            "disk": np.abs(poles + 5).max(),
            "half_plane": poles.real.max() + 5,
            "sector": np.abs(poles.imag / poles.real).max(),
            "vertical_strip": np.abs(poles.real + 5).max(),
            "horizontal_strip": np.abs(poles.imag).max(),
            "ellipse": np.abs((poles.real + 5) / 2 + 1j * poles.imag).max(),
        }[kind]
        if not reach > 1e-3:
            continue
        seen += 1
        loop = matrices.quotient(rationals(A))
        for factor, beyond in ((1 + 1e-7, False), (1 - 1e-7, True)):
            region = parts_of((GROWING[kind](reach * factor)).document())
            assert (counterexample.shown(loop, region) is not None) is beyond
            if n < 12:  # else the polynomial is too much work where there is no evidence
                assert counterexample.leaves(loop, region) is beyond
    assert seen


def test_evidence_about_one_loop_proves_nothing_about_another():
    """For loops whose poles are inside, no evidence of any other loop is taken."""
    random = np.random.default_rng(3)
    region = parts_of((Disk(-5, 2) & HalfPlane(3.5)).document())
    proofs, stable = [], []
    while len(proofs) < 20 or len(stable) < 20:
        A = 0.7 * random.normal(size=(3, 3)) - 5 * np.eye(3)
        loop = matrices.quotient(rationals(A))
        found = counterexample.shown(loop, region)
        if roots.all_inside(loop[0], region):
            assert found is None
            stable.append(loop)
        elif found is not None:
            proofs.append(found)
    for loop in stable:
        for by in proofs:
            for sign in (1, -1):
                turned = replace(by, p=sign * by.p, q=-by.q, c=by.c)
                for tried in (by, turned):
                    assert not roots.is_outside(loop, region, tried)


def test_a_quotient_needs_no_inverse():
    """N W^-1 with an ill-conditioned W is decided as the matrix that it is."""
    random = np.random.default_rng(5)
    A = rationals(np.round(16 * random.normal(size=(4, 4))) / 16 - 3 * np.eye(4))
    W = rationals(np.round(random.normal(size=(4, 4)) * 64) / 64)
    W = product(W, [list(c) for c in zip(*W, strict=True)])
    N = product(A, W)
    assert matrices.right_divide(N, W) == A
    reach = max(np.linalg.eigvals(np.array(A, dtype=float)).real)
    for step, beyond in ((1e-6, True), (-1e-6, False)):
        region = parts_of((HalfPlane(-reach + step)).document())
        assert counterexample.leaves((N, W), region) is beyond
    singular = [[W[i][j] * (i > 0 and j > 0) for j in range(4)] for i in range(4)]
    assert counterexample.leaves((N, singular), region)


def test_a_pole_on_the_boundary_is_outside_and_only_the_polynomial_knows():
    loop = matrices.quotient([[Fraction(0), Fraction(1)], [Fraction(-4), Fraction(0)]])
    region = parts_of((HalfPlane(0)).document())
    assert counterexample.shown(loop, region) is None
    assert counterexample.leaves(loop, region)


def test_work_is_counted_before_it_begins_and_by_length():
    short, long = ([[1 << bits, 1], [1, 1 << bits]] for bits in (60, 60_000))
    with work.counted() as count:
        matrices.multiplied(short, short)
        first = count.spent
        matrices.multiplied(long, long)
        assert count.spent - first > 1000 * first
    with (
        work.counted(count.spent - first - 1) as less,
        pytest.raises(work.FormatError, match="too long, to be"),
    ):
        matrices.multiplied(long, long)
    assert not less.spent
    with work.counted(10) as outer, work.counted() as inner:
        assert inner.most == outer.most == 10  # a count within a count has no more than that
