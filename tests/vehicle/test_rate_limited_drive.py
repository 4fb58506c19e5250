"""Drives with rate limits, against equations written out by hand, in both integrators."""

import numpy as np
import pytest

from polefence import (
    Disk,
    FixedGain,
    PolynomialGain,
    ScheduledGain,
    analyse,
    at_sample_time,
)
from polefence.base.errors import InputError
from polefence.certify.running import running
from polefence.plant.larger import with_actuator, with_states
from polefence.response.discrete import Sampling
from polefence.vehicle import Actuator, Hardware
from support.lag import BOTH, STEP, A, B, driven, lag

LIMIT, RATE, T = 1.6, 12.0, 0.02


def within(demand, last, limit=LIMIT):
    return min(max(min(max(demand, -limit), limit), last - RATE * T), last + RATE * T)


def seen_at_samples(law, steps=300):
    """x, the input on its way and the integral of x as a computer has them, one sample late."""
    x, late, z, seen = 1.0, 0.0, 0.0, []
    for _ in range(steps):
        seen.append((x, late, z))
        demand = law(x, late, z)
        u = within(demand, late)
        z += T * (x - 0.375 * (u - demand))
        x = np.exp(A * T) * x + (np.exp(A * T) - 1) / A * B * late
        late = u
    return np.array(seen)


LAWS = {
    "one gain": FixedGain([[-4.0, -0.1]]),
    "polynomial": PolynomialGain(
        ((0, 0), (1, 0)), [[(-4.0, -0.1)], [(0.0, 0.0)]], (), lag().parameters
    ),
    "scheduled": ScheduledGain(
        np.stack([np.eye(2)] * 4), np.stack([[[-4.0, -0.1]]] * 4), lag().parameters, 1, (4,)
    ),
}


@BOTH
@pytest.mark.parametrize("kind", LAWS)
def test_a_computer_moves_what_it_sends_no_faster(monkeypatch, kernel, kind):
    samples = at_sample_time(lag(), T, 1)
    made = running(lag(), analyse(samples, LAWS[kind], Disk(0, 1)).design)
    hardware = Hardware(sampling=made.sampling, actuator=Actuator(limit=LIMIT, slew=RATE))
    done = driven(monkeypatch, kernel, made.plant, made.law, hardware)
    found = done.states[0, :: round(T / STEP)][:300]
    seen = seen_at_samples(lambda x, late, _: -4 * x - 0.1 * late)
    assert np.abs(found - seen[:, :2]).max() < 1e-9
    sent = done.applied[0, :: round(T / STEP), 0]
    assert np.abs(np.diff(sent)).max() < RATE * T * (1 + 1e-9)
    assert next(event.kind for event in done.events) == "rate limit"


@BOTH
def test_with_anti_windup_it_runs_as_its_code(monkeypatch, kernel):
    samples = with_states(at_sample_time(lag(), T, 1), 1)
    K = [(-4.0, -0.1, -3.0), (1.0, 0.0, 0.0)]  # of x, of the input on its way, of z
    law = PolynomialGain(((0, 0),), [K], (), samples.parameters)
    law = law.with_anti_windup(np.array([[0, 0], [0, 0], [-0.375, 0]]))
    made = running(lag(), analyse(samples, law, Disk(0, 1)).design)
    hardware = Hardware(sampling=made.sampling, actuator=Actuator(limit=LIMIT, slew=RATE))
    done = driven(monkeypatch, kernel, made.plant, made.law, hardware)
    seen = seen_at_samples(lambda x, late, z: -4 * x - 0.1 * late - 3 * z)
    assert np.abs(done.states[0, :: round(T / STEP)][:300] - seen).max() < 1e-9


@BOTH
@pytest.mark.parametrize("own", [True, False])
def test_an_actuator_with_a_lag_moves_no_faster(monkeypatch, kernel, own):
    """As a part of the plant, or beside it."""
    w = 50.0
    law = FixedGain([[-4.0, 0.0]] if own else [[-4.0]])
    plant = with_actuator(lag(), "u", w / (2 * np.pi)) if own else lag()
    actuator = Actuator(None if own else w / (2 * np.pi), LIMIT, 8.0)
    done = driven(monkeypatch, kernel, plant, law, Hardware(actuator=actuator), 2.0)

    def slope(y):
        demand = min(max(-4 * y[0], -LIMIT), LIMIT)
        return np.array([A * y[0] + B * y[1], min(max(w * (demand - y[1]), -8.0), 8.0)])

    state, h = np.array([1.0, 0.0]), STEP / 4
    for k in range(4 * 2000):
        if k % 4 == 0:
            force = done.states[0, k // 4, 1] if own else done.applied[0, k // 4, 0]
            seen = np.array([done.states[0, k // 4, 0], force])
            assert np.abs(seen - state).max() < 1e-4
        a = slope(state)
        b = slope(state + h / 2 * a)
        c = slope(state + h / 2 * b)
        state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c))
    assert "rate limit" in [event.kind for event in done.events]


@BOTH
def test_a_rate_that_is_never_met_changes_nothing(monkeypatch, kernel):
    made = running(lag(), analyse(at_sample_time(lag(), T, 1), LAWS["one gain"], Disk(0, 1)).design)
    free, fast = (
        driven(
            monkeypatch,
            kernel,
            made.plant,
            made.law,
            Hardware(sampling=made.sampling, actuator=Actuator(slew=slew)),
            1.0,
        )
        for slew in (None, 1e6)
    )
    assert np.abs(free.states - fast.states).max() < 1e-12


def test_an_input_that_moves_at_once_has_no_rate(monkeypatch):
    with pytest.raises(InputError, match="u, which moves at once: give the actuator a bandwidth"):
        driven(monkeypatch, True, lag(), FixedGain([[-4.0]]), Hardware(actuator=Actuator(slew=1.0)))
    with pytest.raises(InputError, match="rate limit of the actuator"):
        Actuator(slew=0.0)


def test_a_sampling_controller_begins_from_zero(monkeypatch):
    hardware = Hardware(sampling=Sampling(T), actuator=Actuator(slew=RATE))
    done = driven(monkeypatch, True, lag(), FixedGain([[-4.0]]), hardware, 1.0)
    sent = done.applied[0, :: round(T / STEP), 0]
    assert sent[0] == -RATE * T
    assert np.abs(np.diff(sent)).max() < RATE * T * (1 + 1e-9)
