"""Families fitted to responses: coefficients come back, misfits are those found independently."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import polefence as pf
from polefence.data import FrequencyResponse, Response, measured
from polefence.plant.spec import loads
from support.measurements import (
    BAND,
    POINTS,
    at,
    companion,
    exactly,
    gains,
    in_frequency,
    in_time,
    integrated,
    names,
)


def signals(plant):
    known = names(plant)
    return {"inputs": known["input_names"], "outputs": known["output_names"]}


def of_family(plant, q, words):
    """A, B and C of a family at a value of q, outputs among its states or beside them."""
    alpha = plant.alpha(q=q)
    A, B = plant.at(alpha)
    C = np.array([alpha @ plant.signal(name).arrays(plant)[0] for name in words["outputs"]])
    return A, B, C


@pytest.mark.parametrize("kind", ["frequency", "time"])
@pytest.mark.parametrize("seed", range(8))
def test_coefficients_come_back_from_data_without_noise(seed, kind):
    """In the plant's own form: states are told apart by what they begin with, an output."""
    source = np.random.default_rng(seed)
    order = int(source.integers(1, 7))
    m, p = int(source.integers(1, 4)), int(source.integers(1, min(order, 3) + 1))
    plant = companion(order, m, p, source)
    responses = in_frequency(plant) if kind == "frequency" else in_time(plant, source)
    words = signals(plant)
    found = pf.identify(responses, order, **words)
    assert found.data.all.largest < 1e-6
    for q in (1.1, 1.5, 1.9):
        A, B, C = at(plant, q)
        own = of_family(found.plant, q, words)
        # the same form: rows C A^k of the chains, and what B does to them
        T, S = (
            np.vstack([c @ np.linalg.matrix_power(a, k) for k in range(order)])
            for a, _, c in ((A, B, C), own)
        )
        np.testing.assert_allclose(S @ own[1], T @ B, rtol=0, atol=1e-6 * np.abs(T @ B).max())
        np.testing.assert_allclose(np.poly(own[0]), np.poly(A), rtol=1e-6, atol=1e-6)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), order=st.integers(1, 5), degree=st.integers(1, 2))
def test_any_plant_comes_back(seed, order, degree):
    plant = companion(order, 1, 1, np.random.default_rng(seed))
    found = pf.identify(in_frequency(plant), order, degree, **signals(plant))
    G, H = gains(*at(plant, 1.45), BAND), gains(*of_family(found.plant, 1.45, signals(plant)), BAND)
    assert np.abs(G - H).max() <= 1e-6 * np.abs(G).max()


@pytest.mark.parametrize("seed", range(3))
def test_the_misfit_in_frequency_is_the_one_found_independently(seed):
    source = np.random.default_rng(seed)
    plant = companion(4, 2, 2, source)
    responses, words = in_frequency(plant, 0.03, source), signals(plant)
    found = pf.identify(responses, 4, **words)
    shares = []
    for own in responses:
        H = gains(*of_family(found.plant, own.at["q"], words), BAND)
        size = np.maximum(np.abs(H), 0.01 * np.abs(H).max(axis=2, keepdims=True))
        shares.append(np.abs(own.values - H) / size)
    shares = np.array(shares)  # (measurements, p, m, frequencies)
    assert found.data.all.rms == pytest.approx(np.sqrt((shares**2).mean()), rel=0.01)
    assert found.data.all.largest == pytest.approx(shares.max(), rel=0.01)
    assert found.data.all.rms >= np.sqrt((shares**2).mean())
    assert found.data.all.largest >= shares.max() * (1 - 1e-12)
    for i, (name, own) in enumerate(found.data.outputs):
        assert name == words["outputs"][i]
        assert own.largest == pytest.approx(shares[:, i].max(), rel=0.01)
    k, i, j, n = np.unravel_index(shares.argmax(), shares.shape)
    assert found.data.place == (
        f"q = {POINTS[k]:g}, y{i} from u{j}, at {BAND[n] / 2 / np.pi:.4g} Hz"
    )
    # the noise is the misfit: its rms over both parts
    assert found.data.all.rms == pytest.approx(0.03 * np.sqrt(2), rel=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_the_misfit_in_time_is_the_one_found_independently(seed):
    source = np.random.default_rng(seed)
    plant = companion(3, 1, 2, source)
    responses, words = in_time(plant, source, 0.05), signals(plant)
    found = pf.identify(responses, 3, **words)
    left, sizes = [], []
    for k, own in enumerate(responses):
        A, B, C = of_family(found.plant, own.at["q"], words)
        forced = exactly(A, B, C, own.time, own.inputs, np.zeros(3))
        # what an initial state and constants explain, all outputs together
        scale = np.sqrt(np.mean([(r.outputs.T - r.outputs.mean(axis=1)).T ** 2
                                 for r in responses], axis=(0, 2)))  # fmt: skip
        free = [exactly(A, 0 * B, C, own.time, 0 * own.inputs, e) for e in np.eye(3)]
        ones = [np.outer(e, np.ones(own.count)) for e in np.eye(2)]
        Z = np.array([(row.T / scale).T.ravel() for row in (*free, *ones)]).T
        y = ((own.outputs - forced).T / scale).T.ravel()
        best = y - Z @ np.linalg.lstsq(Z, y, rcond=None)[0]
        left.append(best.reshape(2, -1))
        sizes.append(scale)
        shown = ((own.outputs - found.response(k)).T / scale).T
        assert np.abs(shown).max() <= np.abs(left[-1]).max() * 1.05
    rms = np.sqrt(np.mean(np.array(left) ** 2))
    assert found.data.all.rms == pytest.approx(rms, rel=0.01)
    assert found.data.all.rms == pytest.approx(0.05, rel=0.15)
    assert found.data.all.largest == pytest.approx(np.abs(left).max(), rel=0.05)


def test_a_measurement_left_out_is_missed_by_a_fit_of_the_others():
    source = np.random.default_rng(4)
    plant = companion(2, 1, 1, source)
    responses, words = in_frequency(plant, 0.03, source), signals(plant)
    odd = responses[1]
    responses[1] = replace(
        odd, values=odd.values * np.exp(0.4j * np.tanh(BAND))
    )  # of another plant
    found = pf.identify(responses, 2, **words)
    shares = []
    for k, own in enumerate(responses):
        rest = [one for j, one in enumerate(responses) if j != k]
        box = [pf.Parameter("q", min(r.at["q"] for r in rest), max(r.at["q"] for r in rest))]
        other = pf.identify(rest, 2, parameters=box, **words).plant
        # beyond its range where an end was left out: affine
        low, high = (float(end) for end in (other.parameters[0].low, other.parameters[0].high))
        t = (own.at["q"] - low) / (high - low)
        A, B = ((1 - t) * M[0] + t * M[1] for M in (other.A, other.B))
        H = gains(A, B, other.signal("y0").arrays(other)[0][:1], BAND)
        size = np.maximum(np.abs(H), 0.01 * np.abs(H).max())
        shares.append(np.abs(own.values - H) / size)
    assert found.data.left_out.rms == pytest.approx(np.sqrt(np.mean(np.square(shares))), rel=0.02)
    assert found.data.left_out.largest == pytest.approx(np.max(shares), rel=0.02)
    assert found.data.left_out.rms > 1.2 * found.data.all.rms
    assert "one left out of the fit" in str(found)


def test_two_values_leave_none_out():
    plant = companion(2, 1, 1, np.random.default_rng(0))
    found = pf.identify(in_frequency(plant, points=(1.0, 2.0)), 2, **signals(plant))
    assert found.data.left_out is None
    assert "left out" not in str(found)


def test_samples_are_those_of_a_solver():
    """The simulation of inputs that are straight between samples, by a Runge-Kutta method."""
    source = np.random.default_rng(3)
    A, B, C = at(companion(3, 2, 2, source), 1.2)
    time, u = np.arange(60) * 0.1, source.standard_normal((2, 60))
    x0 = source.standard_normal(3)
    np.testing.assert_allclose(
        integrated(A, B, C, time, u, x0), exactly(A, B, C, time, u, x0), atol=1e-7
    )


def test_inputs_that_are_held_are_another_plant():
    source = np.random.default_rng(5)
    A, B, C = at(companion(2, 1, 1, source), 1.0)
    u = np.repeat(source.standard_normal((1, 150)), 4, axis=1)
    step = control.sample_system(control.ss(A, B, C, 0), 0.3)
    _, y = control.forced_response(step, np.arange(600) * 0.3, u[0])
    response = Response(np.arange(600) * 0.3, u, y, hold="held")
    found = pf.identify([response], 2, inputs=["u1"], outputs=["y1"])
    assert found.data.all.largest < 1e-6
    linear = pf.identify([replace(response, hold="linear")], 2, inputs=["u1"], outputs=["y1"])
    assert linear.data.all.rms > 1e-3


def test_what_passes_straight_is_found():
    source = np.random.default_rng(6)
    A, B, C = at(companion(2, 2, 2, source), 1.5)
    D = np.array([[0.0, 0.0], [0.7, -0.2]])
    own = FrequencyResponse(BAND, gains(A, B, C, BAND, D))
    asked = {"inputs": ["u1 [N]"], "disturbances": ["u2 [m/s]"], "outputs": ["y1 [m]", "y2"]}
    found = pf.identify([own], 2, direct=["y2"], **asked)
    assert found.data.all.largest < 1e-6
    _, D_, F_ = found.plant.signal("y2").arrays(found.plant)
    np.testing.assert_allclose([D_[0, 0], F_[0, 0]], D[1], rtol=1e-6)
    assert found.plant.inputs == ("u1 [N]",)
    assert found.plant.disturbances == ("u2 [m/s]",)
    assert pf.identify([own], 2, **asked).data.all.rms > 1e-3
    D[1, 1] = 0
    own = FrequencyResponse(BAND, gains(A, B, C, BAND, D))
    found = pf.identify([own], 2, direct=["y2 from u1 [N]"], **asked)
    assert found.data.all.largest < 1e-6
    signal = found.plant.signal("y2")
    assert not signal.F
    assert float(signal.D[0][0]) == pytest.approx(0.7, rel=1e-6)


def test_more_outputs_than_states():
    source = np.random.default_rng(7)
    A, B = np.array([[-1.0]]), np.array([[2.0, 1.0]])
    own = FrequencyResponse(BAND, gains(A, B, source.standard_normal((3, 1)), BAND))
    found = pf.identify([own], 1, inputs=["u1", "u2"], outputs=["y1", "y2", "y3"])
    assert found.data.all.largest < 1e-6
    assert found.plant.shape == (1, 2)


def test_an_unstable_plant_is_fitted_where_it_is_said_to_be():
    A, B, C = np.array([[0.0, 1], [1, -0.5]]), np.array([[0.0], [1]]), np.array([[1.0, 0]])
    own = FrequencyResponse(BAND, gains(A, B, C, BAND))
    asked = {"inputs": ["u1"], "outputs": ["y1"]}
    found = pf.identify([own], 2, unstable=True, **asked)
    np.testing.assert_allclose(np.poly(found.plant.A[0]), np.poly(A), rtol=1e-6)
    with pytest.raises(pf.InputError, match=r"unstable|determine") as refused:
        pf.identify([own], 2, **asked)
    assert "\n" not in str(refused.value)


def test_responses_of_python_control_are_measurements():
    source = np.random.default_rng(8)
    plant = companion(2, 1, 2, source)
    systems = {q: control.ss(*at(plant, q), np.zeros((2, 1)), inputs=["pull"],
                             outputs=["a", "b"]) for q in POINTS}  # fmt: skip
    by_frequency = [
        measured(control.frequency_response(system, BAND), {"q": q}, f"{q:g}")
        for q, system in systems.items()
    ]
    found = pf.identify(by_frequency, 2, inputs=["pull [N]"], outputs=["a", "b"])
    assert found.data.all.largest < 1e-6
    time = np.arange(400) * 0.05
    u = np.convolve(source.standard_normal(400), np.ones(5), "same")
    in_the_time = [
        measured(control.forced_response(system, time, u), {"q": q}, f"{q:g}")
        for q, system in systems.items()
    ]
    found = pf.identify(in_the_time, 2, inputs=["pull [N]"], outputs=["a", "b"])
    assert found.data.all.largest < 1e-5
    assert found.data.kind == "time"


def test_two_parameters_and_their_squares():
    source = np.random.default_rng(9)
    points = [(k, c) for k in (1.0, 1.5, 2.0) for c in (0.4, 0.7, 1.0)]
    responses = []
    for k, c in points:
        A = np.array([[0, 1], [-k - 0.1 * k * k, -c - 0.05 * k * c]])
        G = gains(A, np.array([[0.0], [1]]), np.array([[1.0, 0]]), BAND)
        responses.append(FrequencyResponse(BAND, G, {"k": k, "c": c}, name=f"{k} {c}"))
    found = pf.identify(responses, 2, 2, inputs=["u1"], outputs=["y1"])
    assert found.data.all.largest < 1e-6
    A, _ = found.plant.at(found.plant.alpha(k=1.2, c=0.9))
    np.testing.assert_allclose(np.poly(A), [1, 0.9 + 0.05 * 1.2 * 0.9, 1.2 + 0.144], rtol=1e-6)
    del source


def test_a_reciprocal_is_another_family():
    responses = []
    for m in (1.0, 1.4, 2.0):
        G = gains(np.array([[0, 1], [-2 / m, -0.5 / m]]), np.array([[0], [1 / m]]),
                  np.array([[1.0, 0]]), BAND)  # fmt: skip
        responses.append(FrequencyResponse(BAND, G, {"m": m}, name=f"{m}"))
    asked = {"inputs": ["u1"], "outputs": ["y1"]}
    through = [pf.Parameter("m", 1, 2, "kg", through="1/m")]
    assert pf.identify(responses, 2, parameters=through, **asked).data.all.largest < 1e-6
    assert pf.identify(responses, 2, **asked).data.all.rms > 1e-3


def test_the_text_is_the_plant_with_its_data(tmp_path):
    source = np.random.default_rng(10)
    plant = companion(3, 2, 1, source)
    found = pf.identify(in_frequency(plant, 0.02, source), 3, name="a plant", **signals(plant))
    path = found.save(tmp_path / "family.toml")
    assert pf.load(path) == found.plant == loads(found.text)
    assert found.plant.data == found.data
    assert found.plant.parameters[0].low == 1
    assert str(found).startswith("unproved, from data: ")


RESPONSE = FrequencyResponse(BAND, 1 / (1j * BAND + 1))
TIMED = Response(np.arange(200) * 0.1, np.sin(np.arange(200)), np.cos(np.arange(200)))
ASKED = {"inputs": ["u1"], "outputs": ["y1"]}
SHORT = FrequencyResponse(BAND[:4], RESPONSE.values[..., :4])
BOTH = [replace(RESPONSE, at={"q": q}, name=f"{q}") for q in (1.0, 2.0)]
FAULTS = {
    "none": (lambda: pf.identify([], 1, **ASKED), "0 measurements"),
    "of two kinds": (lambda: pf.identify([RESPONSE, TIMED], 1, **ASKED), "fitted apart"),
    "one name": (lambda: pf.identify([RESPONSE, RESPONSE], 1, **ASKED), "one name"),
    "a number": (lambda: pf.identify([3], 1, **ASKED), "is no response"),
    "no input": (lambda: pf.identify([RESPONSE], 1, inputs=[], outputs=["y1"]), "at least one"),
    "no such input": (
        lambda: pf.identify([TIMED], 1, inputs=["pull"], outputs=["y1"]), "'pull' is not among"
    ),
    "no such pair": (
        lambda: pf.identify([RESPONSE], 1, inputs=["pull"], outputs=["y1"]), "has 'y1' from 'pull'"
    ),
    "a name twice": (lambda: pf.identify([RESPONSE], 1, inputs=["y1"], outputs=["y1"]), "one name"),
    "direct": (lambda: pf.identify([RESPONSE], 1, direct=["z"], **ASKED), "'z' is no output"),
    "direct from": (lambda: pf.identify([RESPONSE], 1, direct=["y1 from v"], **ASKED), "no output"),
    "order 0": (lambda: pf.identify([RESPONSE], 0, **ASKED), "order = 0 must be a whole"),
    "order 13": (lambda: pf.identify([RESPONSE], 13, **ASKED), "from 1 to 12"),
    "degree": (lambda: pf.identify(BOTH, 1, 3, **ASKED), "degree = 3 must be 0, 1 or 2"),
    "too few": (lambda: pf.identify([SHORT], 3, **ASKED), "8 measured numbers are too few for 6"),
    "one value": (
        lambda: pf.identify([replace(RESPONSE, at={"q": 1.0})], 1, **ASKED), "measured at 1 alone"
    ),
    "too few values": (lambda: pf.identify(BOTH, 1, 2, **ASKED), "2 points of the parameters"),
    "no value": (
        lambda: pf.identify([*BOTH, replace(RESPONSE, name="other")], 1, **ASKED), "no value of q"
    ),
    "another range": (
        lambda: pf.identify(BOTH, 1, parameters=[pf.Parameter("q", 1, 3)], **ASKED),
        "is not what was measured, 1 to 2",
    ),
    "order too high": (lambda: pf.identify([RESPONSE], 3, **ASKED), "ask for a lower order"),
    "unstable in time": (
        lambda: pf.identify([TIMED], 1, unstable=True, **ASKED), "frequency responses alone"
    ),
    "does not move": (
        lambda: pf.identify([replace(TIMED, outputs=np.ones(200))], 1, **ASKED), "does not move"
    ),
    "falling times": (lambda: replace(TIMED, time=-TIMED.time), "time does not rise: sample 2"),
    "uneven times": (lambda: replace(TIMED, time=TIMED.time**2), "not evenly spaced"),
    "nan": (lambda: replace(TIMED, outputs=np.full(200, np.nan)), "no finite number"),
    "infinite": (lambda: replace(RESPONSE, values=RESPONSE.values / 0), "no finite number"),
    "shape": (lambda: replace(TIMED, inputs=np.ones(3)), "inputs have shape"),
    "shape in frequency": (lambda: replace(RESPONSE, values=np.ones((2, 3))), "values have shape"),
    "at zero": (lambda: replace(RESPONSE, frequency=BAND - BAND[0]), "must be above zero"),
    "hold": (lambda: replace(TIMED, hold="zero"), "must be 'linear' or 'held'"),
    "names": (lambda: replace(TIMED, input_names=("a", "b")), "1 different names"),
    "at": (lambda: replace(TIMED, at={"q": np.inf}), "at holds what is no finite"),
    "too long": (lambda: replace(TIMED, time=np.arange(200001.0)), "4 to 200000 numbers"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_what_cannot_be_used_is_one_line(fault):
    call, said = FAULTS[fault]
    with pytest.raises(pf.InputError) as refused:
        call()
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_work_is_bounded_before_it_begins(monkeypatch):
    from polefence.data import fit

    monkeypatch.setattr(fit, "MOST_WORK", 180 * 2 * 2 - 1)
    with pytest.raises(pf.InputError, match="thin the samples out"):
        pf.identify([RESPONSE], 1, **ASKED)
    monkeypatch.setattr(fit, "MOST_WORK", 180 * 2 * 2)
    assert pf.identify([RESPONSE], 1, **ASKED).data.all.largest < 1e-6
