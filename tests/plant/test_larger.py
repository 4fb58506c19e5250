"""Larger plants: against transfer functions, feedback of python-control, and noise by hand."""

import math
from dataclasses import replace
from fractions import Fraction

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from polefence import InputError, UncertainPlant, with_actuator, with_sensor
from polefence.certify.certificate import plant_of
from polefence.examples import family
from polefence.plant.exact import file_plant
from polefence.plant.larger import with_dynamics, with_pid, with_states
from polefence.plant.outputs import Output, states
from polefence.plant.spec import load, loads
from polefence.response.stationary import stationary
from support.specs import TWO_STATES

ACCELERATION = "sprung-mass acceleration"
W = 2 * math.pi * 30
HARDWARE = """
[actuator."force"]
bandwidth = 30
[sensor."x"]
bandwidth = 100
noise = 0.01
"""


@pytest.fixture(scope="module")
def car() -> UncertainPlant:
    return family("quarter-car-ride")


def random_plant(seed: int, n: int = 3, m: int = 2, q: int = 1, r: int = 2) -> UncertainPlant:
    random = np.random.default_rng(seed)
    parts = [[random.normal(size=s).round(3) for _ in range(2)] for s in ((n, n), (n, m), (n, q))]
    outputs = tuple(
        Output(f"y{i + 1}", "m", C=random.normal(size=(2, n)), D=random.normal(size=m))
        for i in range(r)
    )
    return UncertainPlant.from_vertices(*parts, outputs=outputs)


def response(plant, s, signal, vertex=0):
    """From the inputs, then the disturbances, to a signal at a complex frequency."""
    own = plant.vertices[vertex]
    C, D, F = (rows[vertex] for rows in plant.signal(signal).arrays(plant))
    into = np.hstack([own.B, own.E]) if own.E is not None else own.B
    straight = np.concatenate([D, F])
    return C @ np.linalg.solve(s * np.eye(len(own.A)) - own.A, into) + straight


@given(
    st.integers(0, 50), st.sampled_from([1, 2]), st.floats(0.5, 200), st.floats(0.1, 500),
    st.floats(0.2, 2),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_an_actuator_is_its_transfer_function_before_one_input(seed, order, hertz, rate, damping):
    plant, s, w = random_plant(seed), 1j * rate, 2 * math.pi * hertz
    more = {"damping": damping} if order == 2 else {}
    slow = with_actuator(plant, "u2", hertz, order, **more)
    lag = w / (s + w) if order == 1 else w**2 / (s**2 + 2 * damping * w * s + w**2)
    before, after = response(plant, s, "y1"), response(slow, s, "y1")
    assert np.allclose(after, before * [1, lag, 1], rtol=1e-9)
    assert np.allclose(response(slow, s, "u2")[1], lag, rtol=1e-9)  # the force itself
    assert [own.name for own in states(slow)][3] == "u2"


@given(st.integers(0, 50), st.floats(0.1, 50))
@settings(max_examples=20, deadline=None)
def test_a_very_fast_actuator_is_none(seed, rate):
    plant = random_plant(seed)
    fast = with_actuator(with_actuator(plant, "u1", 1e8), "u2", 1e8)
    before, after = (response(own, 1j * rate, "y2") for own in (plant, fast))
    assert np.allclose(after, before, rtol=1e-5, atol=1e-5)


def test_an_actuator_lags(car):
    slow = with_actuator(car, "actuator force", 50 / (2 * math.pi))
    A, B = slow.at([0.1, 0.2, 0.3, 0.4])
    plain_A, plain_B = car.at([0.1, 0.2, 0.3, 0.4])
    assert np.allclose(A, np.block([[plain_A, plain_B], [np.zeros((1, 4)), -50 * np.eye(1)]]))
    assert np.allclose(B[:, 0], [0, 0, 0, 0, 50])
    assert slow.states[-1] == car.inputs[0]
    assert not any(vertex.fixed.count for vertex in slow.vertices)
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="bandwidth"):
            with_actuator(car, "actuator force", wrong)


def test_an_actuators_default_damping_has_its_bandwidth_at_three_decibels(car):
    slow = with_actuator(car, "actuator force", 30, 2)
    assert abs(response(slow, 1j * W, "actuator force")[0]) == pytest.approx(0.5**0.5, rel=1e-4)


@pytest.mark.parametrize("hertz", [1, 100])
@pytest.mark.parametrize("name", [ACCELERATION, "suspension deflection", "tyre force variation"])
def test_a_sensors_noise_has_its_rms(car, name, hertz):
    noisy = with_sensor(car, name, hertz, 0.05)
    own = f"measured {name}"
    quiet = [0 if physical else 1 for physical in noisy.physical]
    found = stationary(noisy, None, np.eye(4), quiet, [own])
    assert found.rms == pytest.approx(0.05, rel=1e-9)
    # and by the integral of the one-sided density 1 over frequency in Hz
    entry = float(noisy.vertices[0].exact_E[-1][-1])
    w = 2 * math.pi * hertz
    variance = quad(lambda f: entry**2 / ((2 * math.pi * f) ** 2 + w**2), 0, np.inf)[0]
    assert math.sqrt(variance) == pytest.approx(0.05, rel=1e-6)


def test_noise_does_not_reach_what_it_only_measures(car):
    noisy = with_sensor(car, ACCELERATION, 100, 0.05)
    signals = [ACCELERATION, "suspension deflection", "tyre deflection"]
    alpha = np.eye(4)
    before = stationary(car, None, alpha, 1e-3, signals).rms
    assert np.allclose(stationary(noisy, None, alpha, [1e-3, 1], signals).rms, before, rtol=1e-12)


@given(st.integers(0, 50), st.floats(0.1, 100), st.floats(0.1, 500))
@settings(max_examples=30, deadline=None)
def test_a_sensor_is_its_transfer_function(seed, hertz, rate):
    plant = random_plant(seed)
    y = plant.signal("y1")
    plant = replace(plant, outputs=(replace(y, F=[0.7]), plant.outputs[1]))
    w, s = 2 * math.pi * hertz, 1j * rate
    seen = with_sensor(plant, "y1", hertz)
    wanted = w / (s + w) * response(plant, s, "y1")
    assert np.allclose(response(seen, s, "measured y1"), wanted, rtol=1e-9)
    assert np.allclose(response(seen, s, "y1"), response(plant, s, "y1"), rtol=1e-9)


@given(st.integers(0, 100), st.integers(1, 4))
@settings(max_examples=30, deadline=None)
def test_a_law_of_an_order_is_a_gain_of_the_larger_plant(seed, order):
    """Its loop has the poles of python-control's feedback interconnection."""
    plant, random = random_plant(seed, n=4), np.random.default_rng(seed)
    own, C = plant.vertices[0], random.normal(size=(2, 4))
    Ac, Bc, Cc, Dc = (
        random.normal(size=s) for s in ((order, order), (order, 2), (2, order), (2, 2))
    )
    open_loop = control.ss(own.A, own.B, C, np.zeros((2, 2)))
    loop = control.feedback(open_loop, control.ss(Ac, Bc, Cc, Dc), sign=1)
    larger = with_states(plant, order)
    K, seen = np.block([[Dc, Cc], [Bc, Ac]]), np.zeros((2 + order, 4 + order))
    seen[:2, :4], seen[2:, 4:] = C, np.eye(order)
    A, B = larger.A[0], larger.B[0]
    found = np.linalg.eigvals(A + B @ K @ seen)
    assert np.allclose(np.poly(found), np.poly(loop.poles()), rtol=1e-8, atol=1e-8)


@given(st.floats(0.1, 100), st.floats(0.05, 200))
@settings(max_examples=30, deadline=None)
def test_a_pid_measures_integral_and_filtered_derivative(hertz, rate):
    plant = random_plant(3)
    plain = replace(plant, outputs=(Output("y", "m", C=[1, 2, 3]),))
    larger, names = with_pid(plain, plain.outputs, hertz)
    assert names == ("y", "pid integral of y", "pid derivative of y")
    assert [larger.signal(name).unit for name in names] == ["m", "m s", "m/s"]
    s, w = 1j * rate, 2 * math.pi * hertz
    y, integral, derivative = (response(larger, s, name) for name in names)
    assert np.allclose(integral, y / s, rtol=1e-9)
    assert np.allclose(derivative, y * w * s / (s + w), rtol=1e-8)


def test_dynamics_go_behind_several_signals():
    plant, s = random_plant(1), 0.3 + 2j
    a, b = np.array([[-1, 2], [0, -3]]), np.array([[1, 0], [2, 1]])
    exact = [tuple(tuple(Fraction(int(x)) for x in row) for row in M) for M in (a, b)]
    larger = with_dynamics(plant, plant.outputs, *exact, ("z1", "z2"))
    y = np.stack([response(plant, s, name) for name in ("y1", "y2")])
    z = np.stack([response(larger, s, name) for name in ("z1", "z2")])
    assert np.allclose(z, np.linalg.solve(s * np.eye(2) - a, b @ y), rtol=1e-12)


def test_a_spec_says_the_same_as_the_verbs(tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(TWO_STATES + HARDWARE)
    plant = load(path)
    bare = loads(TWO_STATES)
    assert plant == with_sensor(with_actuator(bare, "force", 30), "x", 100, Fraction("0.01"))
    assert plant.noise == ("noise of x",)
    assert plant.physical == (True, False)


def test_files_keep_which_disturbances_are_noise():
    plant = loads(TWO_STATES + HARDWARE)
    assert plant_of(file_plant(plant)) == plant
    assert "noise" not in file_plant(loads(TWO_STATES)).write()


def test_noise_of_a_plant_without_disturbances_is_its_first():
    plant = loads(TWO_STATES.replace("E = [[0], [1]]", "").replace("disturbances", "# disturb"))
    noisy = with_sensor(plant, "v", 10, 2)
    assert noisy.disturbances == ("noise of v",)
    assert noisy.physical == (False,)
    A, E = noisy.vertices[0].A, noisy.vertices[0].E
    assert E[:2].tolist() == [[0], [0]]
    assert E[2, 0] ** 2 / (-4 * A[2, 2]) == pytest.approx(4)


WRONG = {
    "no such input": (lambda p: with_actuator(p, "forse", 30), "no input 'forse'; did you mean 'f"),
    "a state": (lambda p: with_actuator(p, "x", 30), "no input 'x'"),
    "twice": (
        lambda p: with_actuator(with_actuator(p, "force", 3), "force", 3),
        "no input 'force'",
    ),
    "negative": (lambda p: with_actuator(p, "force", -1), "bandwidth = -1 must be a positive"),
    "order 3": (lambda p: with_actuator(p, "force", 3, 3), "order = 3 must be 1 or 2"),
    "damping": (lambda p: with_actuator(p, "force", 3, 1, 0.5), "damping belongs to order = 2"),
    "no damping": (lambda p: with_actuator(p, "force", 3, 2, 0), "damping = 0 must be a positive"),
    "no such signal": (lambda p: with_sensor(p, "w", 30), "sensor of 'w': no signal 'w'"),
    "an input": (lambda p: with_sensor(p, "force", 30), "no signal 'force'"),
    "two sensors": (lambda p: with_sensor(with_sensor(p, "x", 9), "x", 9), "has a sensor already"),
    "noise alone": (lambda p: with_sensor(p, "x", noise=1), "noise without a bandwidth has no rms"),
    "no bandwidth": (lambda p: with_sensor(p, "x"), "bandwidth is missing; give bandwidth"),
    "no noise": (lambda p: with_sensor(p, "x", 1, 0), "noise = 0 must be a positive number"),
    "infinite": (lambda p: with_sensor(p, "x", float("inf")), "must be a finite number"),
    "order -1": (lambda p: with_states(p, -1), "order = -1 must be 0 to 40"),
    "order 2.0": (lambda p: with_states(p, 2.0), "order = 2.0 must be a whole number"),
    "order twice": (lambda p: with_states(with_states(p, 1), 1), "a signal 'law state 1' already"),
    "discrete": (
        lambda p: with_actuator(replace(p, sample_time=1), "force", 3),
        "in discrete time",
    ),
    "no noise of it": (lambda p: replace(p, noise=("v",)), "noise: no disturbance 'v'"),
}


@pytest.mark.parametrize(("make", "said"), WRONG.values(), ids=WRONG)
def test_what_cannot_be_is_said(make, said):
    with pytest.raises(InputError) as caught:
        make(loads(TWO_STATES))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
