"""Drives of laws with anti-windup, against equations written out by hand, in both integrators."""

import math

import numpy as np
import pytest

from polefence import Disk, PolynomialGain, Structure, analyse, at_sample_time
from polefence.certify.running import running
from polefence.plant.larger import with_states
from polefence.response.discrete import Sampling
from polefence.vehicle import Actuator, Hardware
from support.lag import BOTH, STEP, A, B, driven, lag

LIMIT = 1.4


def integrating(gain):
    plant = with_states(lag(), 1)
    law = PolynomialGain(((0, 0),), [[(-4.0, -3.0), (1.0, 0.0)]], (), plant.parameters)
    return plant, law.with_anti_windup(None if gain is None else np.array([[0, 0], [gain, 0]]))


@BOTH
@pytest.mark.parametrize("delay", [0, 1, 0.3, 1.25])
def test_at_samples_it_is_what_the_code_does(monkeypatch, kernel, delay):
    T = 0.02
    plant, law = integrating(-0.375)
    sampling, first = Sampling(T, delay), math.ceil(delay)
    parts = ((1 - first + delay) * T, first), ((first - delay) * T, first - 1)
    done = driven(
        monkeypatch, kernel, plant, law, Hardware(sampling=sampling, actuator=Actuator(limit=LIMIT))
    )
    x, z, sent, seen = 1.0, 0.0, [0.0] * 3, []
    for _ in range(300):
        seen.append((x, z))
        asked = -4 * x - 3 * z
        u = min(max(asked, -LIMIT), LIMIT)
        z += T * (x - 0.375 * (u - asked))
        sent = [u, *sent[:-1]]
        for time, late in parts:
            x = np.exp(A * time) * x + (np.exp(A * time) - 1) / A * B * sent[late]
    found = done.states[0, :: round(T / STEP)][:300]
    assert np.abs(found - np.array(seen)).max() < 1e-9
    assert any(event.kind == "limit" for event in done.events)


@BOTH
def test_in_continuous_time_it_is_the_equation(monkeypatch, kernel):
    plant, law = integrating(-0.375)
    done = driven(monkeypatch, kernel, plant, law, Hardware(actuator=Actuator(limit=LIMIT)))
    state = np.array([1.0, 0.0])

    def slope(y):
        asked = -4 * y[0] - 3 * y[1]
        u = min(max(asked, -LIMIT), LIMIT)
        return np.array([A * y[0] + B * u, y[0] - 0.375 * (u - asked)])

    h = STEP / 4
    for k in range(4 * 6000):
        if k % 4 == 0:
            assert np.abs(done.states[0, k // 4] - state).max() < 1e-5
        a = slope(state)
        b = slope(state + h / 2 * a)
        c = slope(state + h / 2 * b)
        state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c))


@BOTH
def test_with_it_the_lag_is_caught_and_without_it_is_not(monkeypatch, kernel):
    hardware = Hardware(actuator=Actuator(limit=LIMIT))
    ends = [
        abs(driven(monkeypatch, kernel, *integrating(gain), hardware, 12.0).states[0, -1, 0])
        for gain in (-0.375, None)
    ]
    assert ends[0] < 1e-3
    assert ends[1] > 10.0


@BOTH
def test_without_a_limit_and_within_it_the_motion_is_that_of_the_law(monkeypatch, kernel):
    for limit in (None, 100.0):
        hardware = Hardware(actuator=Actuator(limit=limit))
        found, other = (
            driven(monkeypatch, kernel, *integrating(gain), hardware, 1.0)
            for gain in (-0.375, None)
        )
        assert np.array_equal(found.states, other.states)


@BOTH
@pytest.mark.parametrize("bandwidth", [None, 5.0])
def test_a_pid_has_it_and_an_actuator_with_a_lag(monkeypatch, kernel, bandwidth):
    structure = Structure(measured=("x",), schedule=(), kind="pid", derivative_bandwidth=5.0)
    plant, gain = structure.extended(lag())
    law = gain.law(plant, np.array([[[-5.0, -4.0, 0.0]]]))
    hardware = Hardware(actuator=Actuator(bandwidth=bandwidth, limit=1.6))
    G = np.zeros((3, 1))
    G[1] = -0.3
    found = driven(monkeypatch, kernel, plant, law.with_anti_windup(G), hardware, 8.0)
    other = driven(monkeypatch, kernel, plant, law, hardware, 8.0)
    # the integral grows less where the demand is beyond the limit
    assert found.states[0, :, 1].max() < 0.8 * other.states[0, :, 1].max()

    assert np.abs(found.applied[0, :, 0]).max() <= 1.6
    assert found.plant is plant  # as it was given: the rates of its states are no inputs of it
    assert found.demanded.shape == other.demanded.shape


@BOTH
def test_a_law_that_was_designed_at_samples_one_late_runs_as_its_code(monkeypatch, kernel):
    T = 0.02
    samples = with_states(at_sample_time(lag(), T, 1), 1)
    K = [(-4.0, -0.1, -3.0), (1.0, 0.0, 0.0)]  # of x, of the input on its way, of z
    law = PolynomialGain(((0, 0),), [K], (), samples.parameters)
    law = law.with_anti_windup(np.array([[0, 0], [0, 0], [-0.375, 0]]))
    design = analyse(samples, law, Disk(0, 1)).design
    made = running(lag(), design)
    hardware = Hardware(sampling=made.sampling, actuator=Actuator(limit=LIMIT))
    done = driven(monkeypatch, kernel, made.plant, made.law, hardware)
    x, z, late, seen = 1.0, 0.0, 0.0, []
    for _ in range(300):
        seen.append((x, late, z))
        asked = -4 * x - 0.1 * late - 3 * z
        u = min(max(asked, -LIMIT), LIMIT)
        z += T * (x - 0.375 * (u - asked))
        x = np.exp(A * T) * x + (np.exp(A * T) - 1) / A * B * late
        late = u
    found = done.states[0, :: round(T / STEP)][:300]
    assert np.abs(found - np.array(seen)).max() < 1e-9
