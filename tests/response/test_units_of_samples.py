"""Units in which samples are rounded, of plants with sensors and actuators that stand apart."""

import numpy as np
import pytest

import polefence as pf
from polefence.certify.bounds import kept_bound
from polefence.plant.delta import delta_form
from polefence.plant.larger import with_states
from polefence.plant.spec import loads
from polefence.response.samples import _units

CRANE = """
states = ["cart position [m]", "cart velocity [m/s]", "offset [m]", "offset velocity [m/s]"]
inputs = ["drive force [kN]"]
disturbances = ["wind [m/s2]"]
[parameter.m]
range = [200, 1000]
[parameter.l]
range = [4, 8]
through = "1/l"
[matrices]
A = [
    [0, 1, 0, 0],
    [0, -0.3, "m*9.81/(1000*l)", 0],
    [0, 0, 0, 1],
    [0, 0.3, "-9.81/l - m*9.81/(1000*l)", 0],
]
B = [[0], [1], [0], [-1]]
E = [[0], [0], [0], [1]]
[outputs]
"angle [rad]" = {C = [0, 0, "1/l", 0]}
[actuator."drive force"]
bandwidth = 5
[sensor."cart position"]
bandwidth = 20
noise = 0.002
[sensor."angle"]
bandwidth = 20
noise = 0.002
"""
T, LATE = "0.02", 0.5


@pytest.fixture(scope="module")
def crane():
    return loads(CRANE)


def test_sensors_and_an_integrator_are_rounded_no_more_than_the_rest(crane):
    rounding = pf.at_sample_time(crane, T, LATE).remainder.rounding
    assert 0 < max(float(x) for row in rounding for x in row) < 1e-14


@pytest.mark.parametrize("seed", range(6))
def test_states_that_stand_apart_do_not_move_the_units_of_others(seed):
    """A chain of sensors behind a plant, before it actuators: units of the plant stay as they are.

    Each other state has one in which what moves it, or what it moves, does so at 1/64 of its rate.
    """
    random = np.random.default_rng(seed)
    n, rate = 3, 50.0
    A = np.zeros((n + 3, n + 3))
    A[:n, :n] = random.normal(size=(n, n)) * 10.0 ** random.integers(-3, 4, n)[:, None]
    A[n, 0], A[n, n] = rate, -rate  # a sensor, and a filter of what it says
    A[n + 1, n], A[n + 1, n + 1] = rate, -rate
    A[1, n + 2], A[n + 2, n + 2] = 3.0, -rate  # an actuator
    B = np.eye(n + 3)[:, -1:] * rate
    units = _units(pf.UncertainPlant.from_vertices([A], [B]))[: n + 3]
    alone = _units(pf.UncertainPlant.from_vertices([A[:n, :n]], [np.ones((n, 1))]))[:n]
    assert units[:n] == pytest.approx(alone)
    assert units[n + 1] == 64 * units[n] == 64**2 * units[0]
    assert 0.5 <= 64 * units[n + 2] * 3.0 / units[1] / rate <= 2


def test_a_limit_on_a_law_with_a_state_is_proved_in_a_few_parts(crane):
    seen = delta_form(pf.at_sample_time(crane, T, LATE))
    rows = [[-68.7230934604778, -138.1771833576187, 0, 335.7405844184511]]
    rows += [[1.8724242309780297, 4.2889571742098225, 0, -9.474959714487982]]
    K = np.hstack([np.zeros((2, 5)), rows])
    force = pf.Rms("drive force", density=0.01, at_most=0.3)
    bound = kept_bound(with_states(seen, 1), pf.FixedGain(K), force)
    assert bound is not None
    assert len(bound.claim.subject.evidence.cells) <= 4
    tighter = pf.Rms("drive force", density=0.01, at_most=0.27)  # samples have 0.276
    assert kept_bound(with_states(seen, 1), pf.FixedGain(K), tighter) is None
