"""Random plants drawn wide, and hostile ones, through the public door: proved or refused."""

import runpy

import numpy as np
import pytest

from polefence import UncertainPlant, build, tightest
from polefence.base.errors import PlantError, UncontrollableError
from polefence.lmi.solve.interior_point import MAX_ITERATIONS
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import ROUNDS, lyapunov_mean
from polefence.search.by_lmi import smallest_disk
from support.margin import largest_margin
from support.paths import FAMILIES

METHODS = ("quadratic", "slack", "scheduled")
DRAW = runpy.run_path(str(FAMILIES))
MOST = ROUNDS * MAX_ITERATIONS  # iterations of one radius


# --- random plants -------------------------------------------------------------------------------


def rows(draw, seed):
    """Designs and points of one plant, by method: all of them proved."""
    plant, centre = DRAW[draw](seed)
    N, n = plant.A.shape[:2]
    found = {}
    for method in METHODS if N * n <= 20 else METHODS[:2]:
        design, point = smallest_disk(plant, centre, method)
        assert design.certificate.prove().proved
        assert design.region.centre == centre
        assert point.r <= design.region.radius <= point.r * (1 + 2e-4)
        assert design.lower is None or 0 < design.lower < design.region.radius
        assert 0 < point.iterations <= MOST
        found[method] = design, point
    return plant, centre, found


def orderings(found):
    """Lemma 1 is a special case of the other two."""
    assert "slack" in found
    quadratic = found["quadratic"][1].r
    assert all(point.r <= quadratic * (1 + 1e-6) for _, point in found.values())


def clarabel_agrees(plant, centre, point):
    """Feasible a little above the radius, infeasible a little below."""
    scaling = balanced(plant.A, plant.B, -centre).refined(lyapunov_mean(point.values))
    pencil = build("quadratic", *scaling.apply(plant.A, plant.B), -centre / scaling.rate)
    above, below = (
        largest_margin(pencil, point.r * side / scaling.rate) for side in (1.001, 0.999)
    )
    assert above.t > 1e-5
    assert below.optimal
    # from sigma on, the strict inequality just fails: its margin is zero below the radius
    assert below.t < (-1e-5 if point.r < -centre else 1e-7)


@pytest.mark.parametrize("seed", range(12))
def test_polytopes(seed):
    plant, centre, found = rows("polytope", seed)
    orderings(found)
    for design, point in found.values():
        if point.r > -1e-2 * centre:
            assert point.converged
            assert 1 - design.lower / design.region.radius <= 2e-5
    clarabel_agrees(plant, centre, found["quadratic"][1])


@pytest.mark.parametrize("seed", [*range(9), 10, 12, 13])
def test_quarter_cars(seed):
    plant, centre, found = rows("quarter_car", seed)
    orderings(found)
    assert set(found) == set(METHODS)
    for design, point in found.values():
        assert point.converged
        if design.region.radius < -centre:
            assert 1 - design.lower / design.region.radius <= 1e-5
    clarabel_agrees(plant, centre, found["quadratic"][1])


# --- hostile plants ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def base(make_random):
    plant = make_random(9, 3, 2, 3)
    return plant.A, plant.B


def spoilt(X, value):
    X = X.copy()
    X[1, 0, 1] = value
    return X


OUT_OF_RANGE = [np.nan, np.inf, -np.inf, 1e300, -1e308, 1e150, 1e-150, 1e-300, 1e-310, 5e-324]


@pytest.mark.parametrize("value", OUT_OF_RANGE)
def test_numbers_out_of_range_are_refused(value, base):
    A, B = base
    for As, Bs in ((spoilt(A, value), B), (A, spoilt(B, value))):
        with pytest.raises(PlantError, match=r"vertex 2: [AB]\[1\]\[2\]"):
            UncertainPlant.from_vertices(As, Bs)


@pytest.mark.parametrize("method", METHODS)
def test_a_vertex_out_of_reach_is_refused(method, base):
    A, B = base
    deaf, mute = A.copy(), B.copy()
    deaf[1], mute[1] = np.eye(3), 0.0
    with pytest.raises(UncontrollableError, match="vertex 2"):
        tightest(UncertainPlant.from_vertices(deaf, B), -3.0, method)
    with pytest.raises(PlantError, match="vertex 2"):
        UncertainPlant.from_vertices(A, mute)


UNITS = np.array([2.0**-27, 1.0, 2.0**27])
# The same plant in another guise has the same smallest radius.
GUISES = {
    "vertices twice": lambda A, B: (np.concatenate([A, A]), np.concatenate([B, B])),
    "a vertex thrice": lambda A, B: (A[[0, 1, 1, 1, 2]], B[[0, 1, 1, 1, 2]]),
    "vertices reversed": lambda A, B: (A[::-1], B[::-1]),
    "inputs twice": lambda A, B: (A, np.concatenate([B, B], axis=2)),
    "an input twice": lambda A, B: (A, B[:, :, [0, 0, 1]]),
    "inputs that differ by little": lambda A, B: (A, np.concatenate([B, B + 1e-12 * B], axis=2)),
    "inputs 1e20 times as strong": lambda A, B: (A, 1e20 * B),
    "inputs 1e-20 times as strong": lambda A, B: (A, 1e-20 * B),
    "an input 1e-9 times as strong": lambda A, B: (A, B * np.array([1.0, 1e-9])),
    "states in far units": lambda A, B: (A * UNITS[:, None] / UNITS, B * UNITS[:, None]),
    "negative zeros": lambda A, B: (np.where(A == 0, -0.0, A), B),
}


@pytest.fixture(scope="module")
def radii(base):
    plant = UncertainPlant.from_vertices(*base)
    return {method: tightest(plant, -3.0, method) for method in METHODS}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("guise", GUISES.values(), ids=GUISES)
def test_guises_change_no_radius(guise, method, base, radii):
    plant = UncertainPlant.from_vertices(*guise(*base))
    design, point = smallest_disk(plant, -3.0, method)
    assert design.certificate.prove().proved
    assert 0 < point.iterations <= MOST
    plain = radii[method]
    assert plain.lower * (1 - 1e-5) <= design.region.radius <= plain.region.radius * (1 + 1e-5)
    assert design.lower is None or design.lower <= plain.region.radius * (1 + 1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_equal_inputs_are_one(method, base):
    A, B = base
    one, two = (
        tightest(UncertainPlant.from_vertices(A, B[:, :, columns]), -3.0, method).region.radius
        for columns in ([0], [0, 0])
    )
    assert np.isclose(one, two, rtol=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("copies", [1, 4])
def test_a_known_plant_is_placed(method, copies, base):
    A, B = (X[[0] * copies] for X in base)
    design, point = smallest_disk(UncertainPlant.from_vertices(A, B), -3.0, method)
    assert design.region.radius <= 1e-3 * 3.0
    assert 0 < point.iterations <= MOST


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [0.0, 1e-20, 1e-8, 3.0, 10.0, 100.0])
def test_one_entry_far_from_the_others(value, method, base):
    A, B = base
    for As, Bs in ((spoilt(A, value), B), (A, spoilt(B, value))):
        plant = UncertainPlant.from_vertices(As, Bs)
        design, point = smallest_disk(plant, -3.0, method)
        assert design.certificate.prove().proved
        if design.region.radius < 3.0:  # from sigma on, the infimum need not be attained
            assert 0 < 1 - design.lower / design.region.radius <= 1e-3
        assert 0 < point.iterations <= MOST
        alpha = np.random.default_rng(0).dirichlet(np.ones(3), 50)
        assert design.region.contains(design.poles(alpha))
