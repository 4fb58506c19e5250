"""Recursive least squares against batch least squares, brute force, and known cars."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lsim

from polefence.base.errors import InputError
from polefence.examples import family
from polefence.response.closed import close
from polefence.vehicle.estimate import Tuning, cost, estimate, estimator, nearest, point, slopes
from polefence.vehicle.reference_laws import lqr, passive
from polefence.vehicle.roads import random_road

STEP = 0.005


@pytest.fixture(scope="module")
def road():
    return random_road("C", 20 * 10.1, seed=4).velocity(20, STEP, 10)[1]


def driven(plant, law, road, **values):
    """What sensors of a linear car see: acceleration, deflection, its rate, force."""
    loops = close(plant, law, plant.alpha(**values))
    n = plant.shape[0]
    system = (loops.closed[0], loops.E[0], np.eye(n), np.zeros((n, 1)))
    x = lsim(system, road, STEP * np.arange(len(road)))[1]
    force = x @ loops.K[0].T
    return x @ loops.closed[0][2], x[:, 0], x[:, 3] - x[:, 2], force[:, 0]


@pytest.mark.parametrize("values", [{"m1": 250, "beta": -8}, {"m1": 340, "beta": 9.5}])
def test_without_noise_the_true_car_is_found(physical, road, values):
    seen = driven(physical, lqr(physical), road, **values)
    found = estimate(physical, *seen, STEP, Tuning(memory=math.inf, noise=1e-4))
    true = [values["m1"], 850 + 17 * values["beta"], 10000 + 200 * values["beta"]]
    assert found.values[0, -1] == pytest.approx(true, rel=1e-4)
    assert found.parameters[0, -1] == pytest.approx(list(values.values()), abs=1e-2)
    assert np.all(found.deviation[0, -1] < 1e-3 * np.array(true))
    assert np.all(found.deviation[0, 0] > 0.1 * np.array(true))


def test_noise_is_averaged_and_its_spread_is_told(physical, road):
    values = {"m1": 320, "beta": 4}
    seen = driven(physical, lqr(physical), road, **values)
    random = np.random.default_rng(1)
    noisy = seen[0][:500] + 0.1 * random.normal(size=(40, 500))
    others = [np.tile(s[:500], (40, 1)) for s in seen[1:]]
    found = estimate(physical, noisy, *others, STEP, Tuning(memory=math.inf, noise=0.1, spread=10))
    end = found.values[:, -1]
    scatter = end.std(axis=0, ddof=1)
    # the standard deviation of 40 samples is itself known to 11 %
    assert np.all(np.abs(scatter / found.deviation[0, -1] - 1) < 0.45)
    true = np.array([320, 918, 10800])
    assert np.all(np.abs(end.mean(axis=0) - true) < 4 * scatter / math.sqrt(40))


def test_recursion_without_forgetting_is_regularised_least_squares(physical):
    own = estimator(physical, STEP, Tuning(memory=math.inf, noise=0.2))
    random = np.random.default_rng(2)
    phi = random.normal(size=(30, 3)) * [300, 0.1, 0.01]
    y = random.normal(size=30)
    belief = own.begin(1)
    for k in range(30):
        belief = own.update(belief, phi[k : k + 1], y[k : k + 1])
    scaled = phi * own.scale
    # one tall least-squares problem: the prior's rows, then the samples'
    rows = np.vstack([np.sqrt(own.floor), scaled / 0.2])
    right = np.concatenate([np.sqrt(np.diag(own.floor)), y / 0.2])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0]
    assert belief.theta[0] == pytest.approx(expected, rel=1e-9)
    assert belief.information[0] == pytest.approx(rows.T @ rows, rel=1e-9)


def test_nothing_winds_up_while_nothing_moves(physical, road):
    values = {"m1": 260, "beta": 5}
    own = estimator(physical, STEP, Tuning(memory=0.5, noise=0.1))
    belief = own.begin(1)
    y, x, rate, u = driven(physical, lqr(physical), road, **values)
    for k in range(800):
        belief = own.update(belief, np.array([[u[k], rate[k], x[k]]]), y[k : k + 1])
    learnt = belief
    random = np.random.default_rng(3)
    for _ in range(2000):  # 10 s at rest, twenty memories
        belief = own.update(belief, np.zeros((1, 3)), 0.1 * random.normal(size=1))
    assert belief.theta == pytest.approx(learnt.theta, abs=1e-12)
    covariance = np.linalg.inv(belief.information[0])
    assert np.linalg.eigvalsh(np.linalg.inv(own.floor) - covariance).min() > -1e-12
    # without the floor it would be e^20 of what it was
    assert np.trace(covariance) < 1e3 * np.trace(np.linalg.inv(learnt.information[0]))
    before = own.projected(belief, 8).shares
    moved = own.update(belief, np.array([[u[300], rate[300], x[300]]]), y[300:301])
    assert np.abs(own.projected(moved, 8).shares - before).max() < 0.5


def test_a_useless_sample_changes_nothing_but_memory(physical):
    own = estimator(physical, STEP)
    begin = own.begin(2)
    phi, y = np.array([[300.0, 0.1, 0.01]] * 2), np.array([3.0, 3.0])
    after = own.update(begin, phi, y, np.array([True, False]))
    assert np.abs(after.theta[0] - 1).max() > 1e-3
    assert np.array_equal(after.theta[1], begin.theta[1])
    assert after.information[1] == pytest.approx(own.floor)


def test_a_load_step_is_followed(physical, road):
    first = driven(physical, lqr(physical), road, m1=250, beta=0)
    second = driven(physical, lqr(physical), road, m1=330, beta=0)
    seen = [np.concatenate([a, b]) for a, b in zip(first, second, strict=True)]
    seen[0] = seen[0] + 0.05 * np.random.default_rng(0).normal(size=seen[0].size)
    found = estimate(physical, *seen, STEP, Tuning(memory=1.0, noise=0.05))
    m1, change = found.parameters[0, :, 0], len(road)
    assert np.abs(m1[change - 200 : change] - 250).max() < 12
    assert np.abs(m1[change + 800 :] - 330).max() < 12
    settled = found.settled(np.where(found.time < change * STEP, 250, 330)[:, None], [12, 20])
    assert change * STEP < settled[0, 0] < (change + 800) * STEP


def test_without_force_mass_is_not_seen(physical, road):
    seen = driven(physical, passive(physical), road, m1=250, beta=0)
    found = estimate(physical, *seen, STEP, Tuning(memory=math.inf, noise=1e-4))
    m1, c, k = found.values[0, -1]
    assert m1 == pytest.approx(288.9, rel=1e-6)
    assert [c / m1, k / m1] == pytest.approx([850 / 250, 10000 / 250], rel=1e-3)
    assert found.deviation[0, -1, 0] > 50


def test_settled_is_nan_where_the_band_is_left_at_the_end(physical, road):
    seen = driven(physical, lqr(physical), road, m1=250, beta=0)
    found = estimate(physical, *seen, STEP)
    assert np.isnan(found.settled([340, 0], [1, 100])[0, 0])
    assert found.settled([340, 0], [1, 100])[0, 1] == 0


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_projection_is_the_nearest_point_of_the_box(seed):
    random = np.random.default_rng(seed)
    corners = np.array([1.0, 0.8, 1.2]) + np.kron(
        random.normal(size=(2, 3)), np.ones((2, 1))
    ) * 0.2 + np.tile(random.normal(size=(2, 3)), (2, 1)) * 0.2  # fmt: skip
    corners[3] += 0.03 * random.normal(size=3)
    root = random.normal(size=(3, 3)) + 0.3 * np.eye(3)
    weight = (root @ root.T + 0.01 * np.eye(3))[None]
    target = 1 + 0.5 * random.normal(size=(1, 3))
    found = nearest(corners, weight, target, np.full((1, 2), 0.5), 12)
    assert np.all((found >= 0) & (found <= 1))
    own = cost(weight, target - point(corners, found))[0]
    a, b = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41))
    lattice = np.stack([a.ravel(), b.ravel()], axis=1)
    others = cost(weight, target - point(corners, lattice)[:, None]).min()
    assert own <= others * (1 + 1e-2) + 1e-9


def test_point_and_slopes_are_multi_affine():
    corners = np.random.default_rng(0).normal(size=(8, 3))
    eye = np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 1, 1]], dtype=float)
    assert point(corners, eye) == pytest.approx(corners[[0, 1, 2, 7]])
    t = np.array([0.2, 0.7, 0.4])
    d = 1e-6 * np.eye(3)
    numeric = [(point(corners, t + e) - point(corners, t - e)) / 2e-6 for e in d]
    assert slopes(corners, t) == pytest.approx(np.array(numeric), rel=1e-6)


def test_prior_is_where_it_begins(physical):
    own = estimator(physical, STEP, Tuning(prior={"m1": 250, "c": 800, "k": 9000}))
    assert own.physical(own.begin(1).theta)[0] == pytest.approx([250, 800, 9000])
    plain = estimator(physical, STEP)
    assert plain.parameters(plain.begin(1).shares)[0] == pytest.approx([288.9, 0], abs=1e-9)


def test_a_car_given_by_its_vertices_has_no_parameters_but_m1_c_k(road):
    car = family("quarter-car-physical")
    plant = replace(car, parameters=())
    seen = driven(car, lqr(car), road, m1=300, beta=2)
    found = estimate(plant, *seen, STEP)
    assert found.parameters.shape == (1, len(road), 0)
    assert found.values[0, -1, 0] == pytest.approx(300, rel=0.02)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"acceleration": np.array([0.0, np.nan])}, "acceleration: sample 2 is not finite"),
        ({"force": np.zeros(3)}, "samples must have one shape"),
        ({"force": "some"}, "force must be an array"),
        ({"velocity": np.zeros((1, 1, 2))}, "velocity must have shape"),
        ({"period": 0.0}, r"period of an estimator \[s\] = 0.0"),
        ({"tuning": ("prior", {"m1": 3})}, "prior: c = None"),
        ({"tuning": ("prior", {"mass": 3})}, "prior: unknown 'mass'"),
        ({"tuning": ("memory", -1)}, r"memory of an estimator \[s\] = -1"),
        ({"tuning": ("noise", math.nan)}, "noise of an estimator.* = nan"),
    ],
)
def test_bad_input_is_refused_in_a_line(physical, change, message):
    good = {name: np.zeros(2) for name in ("acceleration", "deflection", "velocity", "force")}
    call = good | {"period": STEP} | change
    with pytest.raises(InputError, match=message) as caught:
        if "tuning" in change:
            name, value = change["tuning"]
            call["tuning"] = Tuning(**{name: value})
        estimate(physical, **call)
    assert "\n" not in str(caught.value)


def test_another_plant_is_refused(make_random):
    with pytest.raises(InputError, match="not described as a quarter car"):
        estimator(make_random(1, 3, 1, 2), STEP)
