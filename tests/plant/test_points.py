"""Samples of a family: in the domain, on its edges, seeded, and as many as the work allows."""

import numpy as np
import pytest

from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.points import MOST_POINTS, edges, inside, sample, seeded, weights_of
from polefence.plant.polynomial import Domain

DOMAINS = [Domain((1,)), Domain((2,)), Domain((5,)), Domain((2, 2)), Domain((2, 2, 2))]


@pytest.mark.parametrize("domain", DOMAINS, ids=str)
def test_points_are_in_the_domain_and_seeded(domain):
    cuts = np.cumsum(domain.sizes)[:-1]
    for points in (edges(domain), inside(domain, 100), sample(domain)):
        assert np.all(points >= 0)
        for own in np.split(points, cuts, axis=1):
            assert np.allclose(own.sum(axis=1), 1)
    assert np.array_equal(inside(domain, 100), inside(domain, 100))
    if domain.corners > 1:
        assert not np.array_equal(inside(domain, 100), inside(domain, 100, seed=1))


@pytest.mark.parametrize(("sizes", "count"), [((4,), 6), ((2, 2), 4), ((2, 2, 2), 12)])
def test_edges_join_corners_that_differ_in_one_simplex(sizes, count):
    """4 corners of a simplex have 6 edges, of a square 4; a cube has 12."""
    domain = Domain(sizes)
    points = edges(domain, 3)
    corners, between = points[: domain.corners], points[domain.corners :]
    assert np.array_equal(domain.alpha(corners), np.eye(domain.corners))
    assert len(between) == 3 * count
    # a product of weights that are 0 or 1 but for one pair: two corners alone have a weight
    assert np.all((domain.alpha(between) > 0).sum(axis=1) == 2)
    assert np.array_equal(edges(domain, 3, some=[0]), points[: domain.corners + 3])


def test_large_families_have_all_corners_and_no_more_points_than_the_work_allows():
    for domain in (Domain((256,)), Domain((2,) * 8)):
        few, many = sample(domain, states=60), sample(domain)
        assert len(few) <= len(many) <= MOST_POINTS
        assert np.array_equal(domain.alpha(few[:256]), np.eye(256))


def test_few_points_of_many_corners_are_corners():
    names = [f"k{i}" for i in range(8)]
    parameters = [Parameter(name, 1, 2) for name in names]
    plant = UncertainPlant.from_expressions(parameters, [["-" + "-".join(names)]], [[1]])
    assert np.array_equal(seeded(plant, 200), np.eye(256)[:200])
    assert np.array_equal(seeded(plant, 256), np.eye(256))
    assert seeded(plant, 300)[256:].sum(axis=1) == pytest.approx(np.ones(44))


def test_weights_of_values_are_those_of_the_plant_and_end_at_its_bounds():
    p, q = Parameter("p", 1, 4, through="1/p"), Parameter("q", -1, 3)
    plant = UncertainPlant.from_expressions([p, q], [["-1/p", "q"], [0, -1]], [[0], [1]])
    values = np.array([[1, -1], [2, 0], [4, 3], [3.2, 2.5]])
    for own, alpha in zip(values, weights_of(plant.parameters, values), strict=True):
        assert alpha == pytest.approx(plant.alpha(p=own[0], q=own[1]), abs=1e-14)
    beyond = weights_of(plant.parameters, np.array([[9.0, -5.0]]))
    assert beyond[0] == pytest.approx(plant.alpha(p=4, q=-1))
