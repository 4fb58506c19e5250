"""Starts of laws with states: observers, and filters that stay as they are, seen by a gain."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import Disk, HalfPlane, InitialPeak, Rms, Structure, UncertainPlant, optimise
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.search.tune.dynamic import filtered, observers
from polefence.search.tune.tuner import tune
from support.specs import TWO_STATES, rms

REGION = HalfPlane(0.1)


@pytest.fixture(scope="module")
def plant():
    return loads(TWO_STATES)


@cache
def started(structure):
    """Filters that several tests look at, of the plant of `plant`."""
    return filtered(loads(TWO_STATES), structure, rms("x"), (), REGION)


@pytest.mark.parametrize(("order", "schedule"), [(1, ()), (2, ("m",))])
def test_a_law_of_the_order_keeps_everything_and_is_better_than_one_without(plant, order, schedule):
    own = Structure(("x",), schedule, order=order, largest_gain=2.0)
    law = started(own)[0]
    larger, gain = own.extended(plant)
    assert law.powers == gain.powers(larger)
    alpha = np.random.default_rng(2).dirichlet(np.ones(2), (20, 2))
    alpha = np.array([np.kron(*each) for each in alpha])
    K = np.tensordot(law.terms(alpha), law.gains, 1)
    assert np.abs(K[:, 0, 0]).max() <= 2.0
    A, B = larger.at(alpha)
    poles = np.linalg.eigvals(A + B @ law.gain(alpha))
    assert poles.real.max() <= -0.1 + 1e-6
    # the filter: of unit gain, and its pole in the region
    assert np.allclose(law.gains[:, 1, 0], -law.gains[:, 1, 1])
    static = tune(plant, Structure(("x",), schedule, largest_gain=2.0), rms("x"))[0]
    level = rms("x").values(larger, law, np.eye(4)).max()
    assert level < 0.9 * static.level


def test_it_is_where_a_search_begins_that_is_no_worse(plant):
    own = Structure(("x",), (), order=1, largest_gain=2.0)
    laws = started(own)
    larger, gain = own.extended(plant)
    found = tune(larger, gain, rms("x"), (), REGION, laws)[0]
    assert found.kept
    assert found.level <= rms("x").values(larger, laws[0], np.eye(4)).max() * (1 + 1e-6)


@pytest.mark.usefixtures("hasty")
def test_a_peak_from_initial_states_is_one_of_the_filters_at_rest(plant):
    own, peak = Structure(("x",), (), order=1), InitialPeak("x", 1.5, points=[(1.0, 0.0)])
    (law, *_) = filtered(plant, own, rms("x"), (peak,), REGION)
    larger, _ = own.extended(plant)
    assert peak.extended(2, 1).values(larger, law, np.eye(4)).max() <= 1.5 * (1 + 1e-6)


def test_there_are_none_without_states(plant):
    assert filtered(plant, Structure(("x",)), rms("x")) == ()
    assert observers(plant, Structure(("x",))) == ()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.usefixtures("hasty")
def test_in_the_delta_form_they_are_near_those_of_continuous_time(plant, order):
    """The same starts, of a step that is short beside all rates."""
    own, step = Structure(("x",), (), order=order, largest_gain=2.0), Fraction(1, 10**5)
    delta = replace(plant, step=step)
    assert len(started(own)) == len(filtered(delta, own, rms("x"), (), REGION)) > 0
    laws, near = (observers(each, own, (), REGION) for each in (plant, delta))
    assert len(laws) == len(near) > 0
    each_loop = (np.poly(loops(plant, own, [law])[0][0]) for law in (near[0], laws[0]))
    assert np.allclose(*each_loop, rtol=0.01)
    larger, gain = own.extended(delta)
    best = filtered(delta, own, rms("x"), (), Disk(-1 / float(step), 1 / float(step) - 0.1))[0]
    found = tune(larger, gain, rms("x"), (), REGION, [best])[0]
    assert found.kept


def masses(k=None):
    """Two masses and a spring, force on the first; the position of the second is measured."""
    stiff = (0.5, 2.0) if k is None else (k, k)
    A = [[[0, 0, 1, 0], [0, 0, 0, 1], [-x, x, 0, 0], [x, -x, 0, 0]] for x in stiff]
    return UncertainPlant.from_vertices(A, [[[0.0], [0.0], [1.0], [0.0]]] * 2)


def loops(plant, structure, laws):
    larger, _ = structure.extended(plant)
    return [[v.A + v.B @ law.K for v in larger.vertices] for law in laws]


@pytest.mark.parametrize("order", [4, 6])
def test_of_a_plant_that_is_known_an_observer_of_full_order_keeps_the_region(order):
    plant, own = masses(k=1.0), Structure(("x2",), (), order=order)
    laws = observers(plant, own, (), REGION)
    assert laws
    inside = [
        REGION.distance(np.linalg.eigvals(both[0])).max() < 0 for both in loops(plant, own, laws)
    ]
    assert any(inside)
    for law in laws:
        # of the position alone; states beyond the plant's are filters that do nothing
        assert not np.any(law.K[:, [0, 2, 3]])
        assert not np.any(law.K[:5, 8:])
        assert np.all(np.diag(law.K[5:, 8:]) < 0)


def test_an_observer_of_the_middle_is_stable_there_and_reduced_to_the_order():
    plant = masses()
    for order in (2, 3, 4):
        own = Structure(("x2",), (), order=order)
        larger, gain = own.extended(plant)
        A, B = larger.at(np.array([[0.5, 0.5]]))
        laws = observers(plant, own, (), None)
        poles = [np.linalg.eigvals(A[0] + B[0] @ law.K) for law in laws]
        assert min(each.real.max() for each in poles) < 0
        assert gain.rows(larger).shape[1] == order + 1


def test_there_are_no_observers_without_states():
    assert observers(masses(), Structure(("x2",), ())) == ()


# --- three masses between springs, a force and a velocity -----------------------------------------

MASSES, SPRINGS = np.array([0.66, 1.0, 1.63]), np.array([2.3, 1.06, 2.77, 2.94])
LIGHTLY, SMALL_FORCE, DENSITY_OF_FORCE = 0.0264, 0.46, 2.0


def three_masses():
    """Damping ratios of 1 to 3 %, the last spring uncertain by 20 %."""
    each = []
    for last in (0.8, 1.2):
        k = SPRINGS * (1, 1, 1, last)
        K = np.diag(k[:3] + k[1:]) - np.diag(k[1:3], 1) - np.diag(k[1:3], -1)
        K = K / MASSES[:, None]
        each.append(np.block([[np.zeros((3, 3)), np.eye(3)], [-K, -LIGHTLY * K]]))
    push = np.eye(6)[:, [4]]
    outputs = (Output("z", "", C=[[1.0] + [0.0] * 5]), Output("w", "", D=[[SMALL_FORCE]]))
    names = tuple(f"x{k + 1}" for k in range(6))
    return UncertainPlant.from_vertices(
        each, [push] * 2, [push] * 2, states=names, inputs=("u",), outputs=outputs
    )


def worst_by_lyapunov(plant, D, C, B, A):
    """The worst rms of [z, w] with a law u = D y + C x_c, x_c' = B y + A x_c, y the velocity."""
    k, y = len(A), np.eye(6)[3]
    found = []
    for share in np.linspace(0, 1, 21):
        own = (1 - share) * plant.A[0] + share * plant.A[1]
        push = np.eye(6)[:, [4]]
        loop = np.block([[own + push * D * y, push @ C], [B[:, None] * y, A]])
        assert np.linalg.eigvals(loop).real.max() < 0
        Z = np.zeros((2, 6 + k))
        Z[0, 0], Z[1, :6], Z[1, 6:] = 1.0, SMALL_FORCE * D * y, SMALL_FORCE * C[0]
        E = np.append(push[:, 0], np.zeros(k))
        X = solve_continuous_lyapunov(loop, -np.outer(E, E) * DENSITY_OF_FORCE / 2)
        found.append(np.sqrt(np.trace(Z @ X @ Z.T)))
    return max(found)


@pytest.mark.parametrize(
    ("order", "law"),
    [
        (1, (-54.26, [[54.02]], [210.0], [[-210.0]])),
        (2, (-2548.9, [[-360.1, 2906.5]], [26.8, 214.4], [[-26.8, 0.0], [0.0, -214.4]])),
    ],
)
def test_a_law_of_an_order_differentiates_where_that_is_best(order, law):
    plant = three_masses()
    best = worst_by_lyapunov(plant, *(np.array(part) for part in law))
    structure = Structure(measured=("x4",), schedule=(), order=order)
    found = optimise(plant, Rms(("z", "w"), density=DENSITY_OF_FORCE), structure=structure)
    assert found.bounds[0].level < best * 1.01
