"""Products of matrix polynomials: by values at nodes they are those term by term."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.proof import products
from polefence.proof.matrices import transposed
from polefence.proof.polynomials import Polynomial, monomials_of
from polefence.proof.work import MAX_WORK, counted

DEGREES = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=3)


def polynomial(rng, degrees, shape, bits=90, missing=0.2):
    sizes = (2,) * len(degrees)
    terms = {
        e: [[rng.randint(-(2**bits), 2**bits) for _ in range(shape[1])] for _ in range(shape[0])]
        for e in monomials_of(sizes, degrees)
        if rng.random() >= missing
    }
    return terms or {next(iter(monomials_of(sizes, degrees))): [[1] * shape[1]] * shape[0]}


def filled(terms):
    return {e: M for e, M in terms.items() if any(map(any, M))}


@given(pairs=DEGREES, seed=st.integers(0, 10**6))
def test_at_nodes_it_is_what_it_is_term_by_term(pairs, seed):
    rng = random.Random(seed)
    P = polynomial(rng, [d for d, _ in pairs], (2, 3), bits=rng.choice([1, 40, 200]))
    Q = polynomial(rng, [e for _, e in pairs], (3, 2), bits=rng.choice([1, 40, 200]))
    shape = products._Shape.of(P, Q, half=False)
    by_terms = products._by_terms(P, Q, shape)
    assert filled(products._Nodes(pairs).multiplied(P, Q, shape)) == filled(by_terms)


@given(pairs=DEGREES, seed=st.integers(0, 10**6))
def test_half_of_a_symmetric_product_is_the_whole(pairs, seed):
    rng = random.Random(seed)
    M = polynomial(rng, [d for d, _ in pairs], (3, 3))
    S = {
        e: [
            [a + b for a, b in zip(*rows, strict=True)]
            for rows in zip(X, transposed(X), strict=True)
        ]
        for e, X in polynomial(rng, [e for _, e in pairs], (3, 3)).items()
    }
    MT = {e: transposed(X) for e, X in M.items()}
    SM = products.multiplied(S, M, [(e, d) for d, e in pairs])
    whole = products._by_terms(MT, SM, products._Shape.of(MT, SM, half=False))
    nodes = products._Nodes([(d, d + e) for d, e in pairs])
    halves = nodes.multiplied(MT, SM, products._Shape.of(MT, SM, half=True))
    assert filled(halves) == filled(whole)


def test_of_high_degrees_values_at_nodes_take_less_work():
    rng = random.Random(1)
    P, Q = (polynomial(rng, (3, 3, 3), (4, 4), missing=0) for _ in range(2))
    degrees = [(3, 3)] * 3
    spent = []
    for given_degrees in (None, degrees):
        with counted(MAX_WORK) as count:
            found = products.multiplied(P, Q, given_degrees)
        spent.append((count.spent, filled(found)))
    assert spent[0][1] == spent[1][1]
    assert spent[1][0] < spent[0][0] / 3


@pytest.mark.parametrize("by", [(0, 0), (1, 0), (3, 2)])
def test_a_raised_polynomial_has_the_same_values(by):
    rng = random.Random(2)
    P = Polynomial(polynomial(rng, (1, 2), (2, 3)), (2, 2), (1, 2), 7)
    raised = P.raised((1 + by[0], 2 + by[1]))
    at = [3, 4, 5, 6]  # of sums 7 and 11
    one, other = (
        [
            [sum(M[i][j] * power(at, e) for e, M in X.terms.items()) for j in range(3)]
            for i in (0, 1)
        ]
        for X in (P, raised)
    )
    factor = 7 ** by[0] * 11 ** by[1]
    assert other == [[x * factor for x in row] for row in one]


def power(at, e):
    value = 1
    for x, k in zip(at, e, strict=True):
        value *= x**k
    return value


def test_a_product_that_is_zero_keeps_its_shape():
    sizes = (2, 2, 2)
    zero, threes = (
        Polynomial(
            {e: [[x] * 6 for _ in range(6)] for e in monomials_of(sizes, (2, 2, 2))},
            sizes,
            (2, 2, 2),
        )
        for x in (0, 3)
    )
    product = zero * threes
    assert product.shape == (6, 6)
    assert not any(any(row) for M in product.terms.values() for row in M)
