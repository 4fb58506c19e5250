"""Polynomials on simplices and boxes against direct evaluation, away from sum one too."""

from math import comb, factorial, prod

import numpy as np
import pytest

from polefence import InputError
from polefence.plant.polynomial import Domain, binomial
from polefence.proof import polynomials

SIZES = [(1,), (2,), (3,), (5,), (2, 2), (2, 2, 2), (2, 2, 2, 2), (3, 2)]
RANDOM = np.random.default_rng(17)


def points(sizes, count=6, spread=0.0):
    """Coordinates in each simplex, side by side; with ``spread`` their sums are not one."""
    parts = [RANDOM.dirichlet(np.ones(size), count) for size in sizes]
    factors = [1 + spread * RANDOM.uniform(size=(count, 1)) for _ in sizes]
    return np.hstack([f * part for f, part in zip(factors, parts, strict=True)])


def split(sizes, coordinates):
    return np.split(coordinates, np.cumsum(sizes)[:-1])


def bernstein(sizes, degree, coefficients, c):
    """The homogeneous polynomial with these Bernstein coefficients, term by term."""
    total = 0.0
    for e, k in zip(Domain(sizes).monomials(degree), coefficients, strict=True):
        term = 1.0
        for own, powers in zip(split(sizes, c), split(sizes, np.array(e)), strict=True):
            term *= factorial(degree) / prod(factorial(p) for p in powers)
            term *= np.prod(own**powers)
        total += k * term
    return total


def linear(sizes, values, c):
    """The multilinear form with these values at the corners, the first simplex slowest."""
    weights = np.ones(1)
    for own in split(sizes, c):
        weights = np.kron(weights, own)
    return values @ weights


def monomial(e, c):
    return np.prod(c ** np.array(e))


def sums(sizes, c):
    return prod(own.sum() for own in split(sizes, c))


def rank(powers):
    """Fewest corners first, then the largest exponents, then the first corners."""
    corners = sorted(np.flatnonzero(powers).tolist(), key=lambda j: (-powers[j], j))
    return len(corners), [-int(powers[j]) for j in corners], corners


def test_the_order_is_the_papers():
    """(15), (16), (17): cubes, then squares by j and k, then products of three."""
    assert Domain((3,)).monomials(3) == (
        *((3, 0, 0), (0, 3, 0), (0, 0, 3)),
        *((2, 1, 0), (2, 0, 1), (1, 2, 0), (0, 2, 1), (1, 0, 2), (0, 1, 2)),
        (1, 1, 1),
    )
    assert Domain((2, 2)).monomials(1) == ((1, 0, 1, 0), (1, 0, 0, 1), (0, 1, 1, 0), (0, 1, 0, 1))
    assert Domain((4,)).monomials(2)[4:6] == ((1, 1, 0, 0), (1, 0, 1, 0))


@pytest.mark.parametrize("sizes", SIZES)
def test_monomials_are_all_there_once_and_in_the_checkers_order(sizes):
    for degree in range(5 if sum(sizes) < 8 else 3):
        found = Domain(sizes).monomials(degree)
        assert list(found) == polynomials.monomials(sizes, degree)
        assert len(set(found)) == len(found) == Domain(sizes).count(degree)
        assert len(found) == prod(comb(size - 1 + degree, degree) for size in sizes)
        for e in found:
            assert all(part.sum() == degree for part in split(sizes, np.array(e)))
        ranks = [[rank(part) for part in split(sizes, np.array(e))] for e in found]
        assert ranks == sorted(ranks)


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_basis_sums_to_one_and_reproduces_linear_functions(sizes, degree):
    domain, c = Domain(sizes), points(sizes)
    alpha = domain.alpha(c)
    basis = domain.basis(alpha, degree)
    assert basis.shape == (len(c), domain.count(degree))
    assert np.allclose(basis.sum(axis=1), 1)
    assert (basis >= 0).all()
    if degree:
        # the coefficients of a linear function are its values at exponent / degree
        nodes = np.array(domain.monomials(degree)) / degree
        assert np.allclose(basis @ nodes, c)
    values = RANDOM.normal(size=domain.count(degree))
    direct = [bernstein(sizes, degree, values, one) for one in c]
    assert np.allclose(basis @ values, direct)


@pytest.mark.parametrize("sizes", [(4,), (2,), (2, 2, 2), (3, 2), (1,)])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_interpolation_recovers_the_coefficients_from_values_at_the_nodes(sizes, degree):
    domain = Domain(sizes)
    given = np.random.default_rng(1).normal(size=(domain.count(degree), 2, 3))
    nodes = domain.nodes(degree)
    at_nodes = np.tensordot(domain.basis(nodes, degree), given, 1)
    assert domain.interpolated(at_nodes, degree) == pytest.approx(given, abs=1e-9)
    # the products of each simplex's own, in the order of the monomials
    c = domain.coordinates(nodes)
    for e, own in zip(domain.monomials(degree), domain.basis(nodes, degree).T, strict=True):
        assert own == pytest.approx(binomial(sizes, e) * np.prod(c ** np.array(e), axis=-1))


@pytest.mark.parametrize("sizes", SIZES)
def test_elevation_multiplies_by_the_sums_of_the_coordinates(sizes):
    domain = Domain(sizes)
    for degree in range(3):
        for times in range(3):
            if domain.count(degree + times) > 300:
                continue
            values = RANDOM.normal(size=domain.count(degree))
            table = domain.elevated(degree, times)
            for c in points(sizes, 2, spread=1.0):
                total = sum(
                    monomial(e, c) * sum(w * values[k] for k, w in row.items())
                    for e, row in zip(domain.monomials(degree + times), table, strict=True)
                )
                expected = bernstein(sizes, degree, values, c) * sums(sizes, c) ** times
                assert np.isclose(total, expected)


@pytest.mark.parametrize("sizes", SIZES)
def test_pairs_multiply_by_a_linear_form(sizes):
    domain = Domain(sizes)
    for degree in range(3):
        for elevation in range(3):
            if domain.count(degree + 1 + elevation) > 300:
                continue
            corners = RANDOM.normal(size=domain.corners)
            values = RANDOM.normal(size=domain.count(degree))
            table = domain.pairs(degree, elevation)
            for c in points(sizes, 2, spread=1.0):
                total = sum(
                    monomial(e, c) * sum(w * corners[j] * values[k] for (j, k), w in row.items())
                    for e, row in zip(domain.monomials(degree + 1 + elevation), table, strict=True)
                )
                expected = linear(sizes, corners, c) * bernstein(sizes, degree, values, c)
                assert np.isclose(total, expected * sums(sizes, c) ** elevation)


@pytest.mark.parametrize("sizes", SIZES)
def test_alpha_is_the_product_of_the_coordinates_and_gives_them_back(sizes):
    domain, c = Domain(sizes), points(sizes)
    alpha = domain.alpha(c)
    assert alpha.shape == (len(c), domain.corners)
    for own, a in zip(c, alpha, strict=True):
        assert np.allclose([linear(sizes, row, own) for row in np.eye(len(a))], a)
    assert np.allclose(domain.coordinates(alpha), c)
    assert np.allclose(domain.alpha(domain.coordinates(alpha)), alpha)
    # a single point, and corners
    assert np.allclose(domain.coordinates(alpha[0]), c[0])
    assert np.allclose(domain.alpha(np.array(domain.monomials(1))), np.eye(domain.corners))


def test_on_a_box_a_point_that_is_no_product_counts_by_its_marginals():
    box = Domain.of("box", 4)
    even, diagonal = np.full(4, 0.25), np.array([0.5, 0.0, 0.0, 0.5])
    assert np.allclose(box.basis(diagonal, 2), box.basis(even, 2))
    simplex = Domain.of("simplex", 4)
    assert not np.allclose(simplex.basis(diagonal, 2), simplex.basis(even, 2))


@pytest.mark.parametrize(("on", "N"), [("box", 3), ("box", 6), ("ball", 4), ("", 4), (None, 2)])
def test_domains_that_there_are_not_are_refused(on, N):
    with pytest.raises(InputError):
        Domain.of(on, N)


def test_one_vertex_is_a_domain_of_its_own():
    for on in ("box", "simplex"):
        assert Domain.of(on, 1) == Domain((1,))
    assert Domain((1,)).monomials(3) == ((3,),)
