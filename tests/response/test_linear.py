"""Linear responses against scipy.signal, python-control, and what is known in closed form."""

import math
import tracemalloc

import control
import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from polefence import GainTable, InputError, UncertainPlant
from polefence.plant.outputs import Output, inputs, output_matrices, rate_of, states, weighted_sum
from polefence.response import discrete, grid, linear
from polefence.response.closed import close, point_text
from polefence.response.discrete import (
    exponential,
    first_order_hold,
    forced_response,
    free_response,
    zero_order_hold,
)
from polefence.response.linear import frequency, impulse, simulate, step
from polefence.vehicle.vehicle import ride

CLOSE = 1e-9  # of the largest value of a signal


def instants(step, w):
    return step * np.arange(len(w))


def off(found, expected):
    """Largest error of (T, p) as a share of each signal's peak."""
    return np.max(np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0))


@pytest.fixture(scope="module")
def points():
    a, b = np.array([[0.0, 0.0], [1.0, 0.3], [0.4, 0.9], [0.5, 0.5], [1.0, 1.0]]).T
    return np.stack([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b], axis=1)


@pytest.fixture(scope="module")
def looked_at(as_printed):
    every = (*states(as_printed), *inputs(as_printed))
    return (*every, rate_of(as_printed, "sprung-mass velocity"))


@pytest.fixture(scope="module")
def systems(as_printed, placed, points, looked_at):
    """Each closed loop as scipy.signal has it, from the road's velocity."""
    found = []
    for a in points:
        A, B = as_printed.at(a)
        K = placed.law.gain(a)
        C = np.vstack([np.eye(5), K, (A + B @ K)[2]])
        E = as_printed.vertices[0].E
        found.append((A + B @ K, E, C, np.vstack([np.zeros((6, 1)), E[2:3]])))
    return found


def oscillator(rate=3.0, ratio=0.2):
    """A mass on a spring, static gain 1 from w to x1; the input does nothing of interest."""
    A = [[0, 1], [-(rate**2), -2 * ratio * rate]]
    return UncertainPlant.from_vertices(
        [A], [[[0], [1]]], [[[0], [rate**2]]], name="oscillator", states=("x [m]", "v [m/s]")
    )


# --- discretisation ------------------------------------------------------------------------------


def test_exponentials_of_any_size_are_those_of_scipy():
    random = np.random.default_rng(0)
    M = random.normal(size=(40, 5, 5)) * 10.0 ** random.uniform(-3, 2, (40, 1, 1))
    M[3] = 0
    for own, expected in zip(exponential(M), map(scipy.linalg.expm, M), strict=True):
        assert np.allclose(own, expected, rtol=0, atol=2e-12 * np.abs(expected).max())
    assert np.allclose(exponential(M[3]), np.eye(5), rtol=0, atol=1e-15)
    assert np.allclose(exponential(M[5] * 0.1) @ exponential(-M[5] * 0.1), np.eye(5), atol=1e-12)
    assert exponential(np.zeros((0, 3, 3))).shape == (0, 3, 3)


def test_badly_scaled_states_keep_their_small_entries():
    # In units that differ by 1e6 each, the small entries are as good as the large ones.
    A = np.array([[-1.0, 2.0, 0.5], [-3.0, -0.2, 1.0], [0.3, 0.7, -2.0]])
    units = np.diag([1.0, 1e6, 1e-6])
    own = exponential(units @ A @ np.linalg.inv(units))
    expected = units @ scipy.linalg.expm(A) @ np.linalg.inv(units)
    assert np.allclose(own, expected, rtol=1e-13, atol=0)


def test_steps_of_their_own_size_for_every_matrix():
    random = np.random.default_rng(1)
    A, E, h = random.normal(size=(4, 3, 3)), random.normal(size=(4, 3, 2)), random.random(4)
    together, ramps = zero_order_hold(A, E, h), first_order_hold(A, E, h)
    for k in range(4):
        ours = (*together, *ramps)
        theirs = (*zero_order_hold(A[k], E[k], h[k]), *first_order_hold(A[k], E[k], h[k]))
        for own, alone in zip(ours, theirs, strict=True):
            assert np.allclose(own[k], alone, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("T", [1, 2, 15, 16, 17, 32, 33, 64, 700, 1025])
@pytest.mark.parametrize("q", [1, 2])
def test_blocks_are_the_recursion(T, q, monkeypatch):
    monkeypatch.setattr(discrete, "BUFFER", 40_000)  # more than one group of systems
    random = np.random.default_rng([T, q])
    A, E = random.normal(size=(5, 3, 3)) - 2 * np.eye(3), random.normal(size=(5, 3, q))
    Phi, Gamma, Gamma1 = first_order_hold(A, E, 0.05)
    C, D = random.normal(size=(5, 2, 3)), random.normal(size=(5, 2, q))
    w, x = random.normal(size=(T, q)), random.normal(size=(5, 3))
    found = forced_response(Phi, Gamma, C, D, w, x, Gamma1)
    assert found.shape == (5, T, 2)
    for k in range(T):
        y = np.einsum("apn,an->ap", C, x) + D @ w[k]
        assert np.allclose(found[:, k], y, rtol=1e-11, atol=1e-11)
        x = np.einsum("ank,ak->an", Phi, x) + Gamma @ w[k] + Gamma1 @ w[min(k + 1, T - 1)]
    assert free_response(Phi, C, x, T).shape == (5, T, 2)


# --- responses -----------------------------------------------------------------------------------


def test_a_driven_response_is_that_of_lsim(as_printed, placed, points, looked_at, systems):
    w = np.random.default_rng(2).normal(size=3001)
    time = 1e-3 * np.arange(len(w))
    ours = simulate(as_printed, placed, points, w, time, looked_at)
    still = simulate(as_printed, placed, points, w, time, looked_at, hold="held")
    assert ours.values.shape == (5, 3001, 7)
    assert np.array_equal(ours.time, time)
    for k, system in enumerate(systems):
        assert off(ours.values[k], scipy.signal.lsim(system, w, time)[1]) < CLOSE
        assert off(still.values[k], scipy.signal.lsim(system, w, time, interp=False)[1]) < CLOSE
    assert np.array_equal(ours.of("actuator force"), ours.values[:, :, 5])


def test_step_and_impulse_responses_are_those_of_scipy_and_control(
    as_printed, placed, points, looked_at, systems
):
    up, hit = (f(as_printed, placed, points, looked_at, None, 1.0, 2e-3) for f in (step, impulse))
    assert len(up.time) == 501
    assert up.time[-1] == pytest.approx(1.0)
    for k, system in enumerate(systems):
        assert off(up.values[k], scipy.signal.step(system, T=up.time)[1]) < CLOSE
        assert off(hit.values[k], scipy.signal.impulse(system, T=hit.time)[1]) < CLOSE
        same = control.ss(*system)
        theirs = control.step_response(same, up.time, squeeze=False).outputs[:, 0].T
        assert off(up.values[k], theirs) < CLOSE
        assert np.allclose(
            up.final[k], control.dcgain(same)[:, 0], atol=1e-9 * np.abs(up.final).max()
        )
        theirs = control.impulse_response(same, hit.time, squeeze=False).outputs[:, 0].T
        assert off(hit.values[k], theirs) < CLOSE
    assert np.array_equal(hit.final, np.zeros((5, 7)))


@pytest.mark.filterwarnings("ignore:Badly conditioned filter coefficients")
def test_gains_over_frequency_are_those_of_scipy_and_control(
    as_printed, placed, points, looked_at, systems
):
    ours = frequency(as_printed, placed, points, np.geomspace(0.01, 100, 30), looked_at)
    assert ours.gain.shape == (5, 30, 7, 1)
    assert [s.label for s in ours.sources] == ["road velocity [m/s]"]
    rates = 2 * np.pi * ours.frequency
    for k, (A, E, C, D) in enumerate(systems):
        theirs = control.ss(A, E, C, D)(1j * rates)[:, 0].T
        assert off(ours.gain[k, :, :, 0], theirs) < CLOSE
        for i in (0, 6):  # as transfer functions, which lose digits of their own
            one = scipy.signal.freqresp((A, E, C[i : i + 1], D[i : i + 1]), rates)[1]
            assert off(ours.gain[k, :, i], one[:, None]) < 1e-6
    assert ours.of("actuator force").shape == (5, 30, 1)


def test_a_step_of_an_input_is_added_to_what_the_law_asks_for(as_printed, placed, points):
    force = inputs(as_printed)[0].name
    up = step(as_printed, placed, points, source=force, duration=0.5, step=1e-3)
    tone = frequency(as_printed, placed, points, [3.0], source=force)
    for k, a in enumerate(points):
        A, B = as_printed.at(a)
        K = placed.law.gain(a)
        C, D = np.vstack([np.eye(5), K]), np.array([[0.0]] * 5 + [[1.0]])
        same = (A + B @ K, B, C, D)
        assert off(up.values[k], scipy.signal.step(same, T=up.time)[1]) < CLOSE
        theirs = control.ss(*same)(6j * np.pi)
        assert np.allclose(tone.gain[k, 0], theirs, rtol=1e-9)
    assert np.array_equal(up.of(force)[:, 0], np.ones(5))


def test_a_plant_without_disturbances_still_has_inputs():
    plant = UncertainPlant.from_vertices([[[-1]], [[-2]]], [[[1]], [[1]]])
    up = step(plant, None, [0.5, 0.5], source="u1", duration=4, step=0.1)
    assert np.allclose(up.of("x1")[0], (1 - np.exp(-1.5 * up.time)) / 1.5, atol=1e-12)
    with pytest.raises(InputError, match="has no E, so no disturbance enters"):
        step(plant, None, [0.5, 0.5])


def test_several_disturbances_add_up_and_are_told_apart():
    names = {"states": ("x [m]", "y [m]"), "disturbances": ("wind [N]", "sea [m]")}
    E = [[1, 2], [0.5, -1]]
    plant = UncertainPlant.from_vertices([[[-1, 0.2], [0, -3]]], [[[1], [0]]], [E], **names)
    w = np.random.default_rng(3).normal(size=(500, 2))
    both = simulate(plant, None, [1.0], w, instants(0.05, w))
    system = (plant.A[0], np.array(E), np.eye(2), np.zeros((2, 2)))
    assert off(both.values[0, :, :2], scipy.signal.lsim(system, w, both.time)[1]) < CLOSE
    sea = step(plant, None, [1.0], "x", "sea", 3.0, 0.1)
    theirs = control.step_response(control.ss(*system), sea.time, input=1, output=0).outputs
    assert np.allclose(sea.values[0, :, 0], np.squeeze(theirs), atol=1e-9)
    tones = frequency(plant, None, [1.0], [0.3])
    assert [s.unit for s in tones.sources] == ["N", "m"]
    assert np.allclose(tones.gain[0, 0, :2], control.ss(*system)(0.6j * np.pi), rtol=1e-9)
    assert frequency(plant, None, [1.0], [0.3], source="sea").gain.shape == (1, 1, 3, 1)


def test_laws_of_every_kind_and_none(physical, points):
    knots = {"m1": [231.12, 346.68], "beta": [-10, 10]}
    K = np.array([[100.0, -50.0, -400.0, 20.0, -300.0]])
    table = GainTable(physical.parameters, knots, np.broadcast_to(K, (2, 2, 1, 5)))
    w = np.sin(np.arange(400) * 0.05)
    ways = [simulate(physical, law, points, w, instants(2e-3, w)).values for law in (K, table)]
    assert np.allclose(*ways, rtol=1e-12)
    alone = simulate(physical, None, points, w, instants(2e-3, w))
    assert not np.any(alone.of("actuator force"))
    assert not np.allclose(alone.values[:, :, 0], ways[0][:, :, 0])


def test_a_state_to_start_from_and_a_function_of_time():
    plant = oscillator()
    start = np.array([0.3, -1.0])
    fall = simulate(plant, None, [1.0], lambda t: 0.0, 2.0, start=start)
    assert fall.time[1] == pytest.approx(0.1 / 3)  # a tenth over the size of the pole
    for k in (7, 40):
        expected = scipy.linalg.expm(plant.A[0] * fall.time[k]) @ start
        assert np.allclose(fall.values[0, k, :2], expected, rtol=1e-11)
    # A straight line is followed exactly, at any step.
    ramp = simulate(plant, None, [1.0], lambda t: t, 0.25 * np.arange(21))
    fine = simulate(plant, None, [1.0], lambda t: t, 0.025 * np.arange(201))
    assert np.allclose(ramp.values, fine.values[:, ::10], rtol=1e-11, atol=1e-12)


def test_memory_is_about_that_of_the_result(physical, points, monkeypatch):
    alpha = np.tile(points, (12, 1))
    w = np.random.default_rng(4).normal(size=15_000)
    monkeypatch.setattr(discrete, "BUFFER", 2_000_000)
    monkeypatch.setattr(linear, "BUFFER", 2_000_000)
    simulate(physical, None, points, w[:10], instants(1e-3, w[:10]))
    tracemalloc.start()
    try:
        found = simulate(physical, None, alpha, w, instants(1e-3, w))
        found.peaks(), found.settling(), found.rms()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.values.nbytes > 40e6
    assert peak < found.values.nbytes + 12e6


# --- measures ------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.6, 0.9])
def test_overshoot_and_settling_of_an_oscillator(ratio):
    rate = 3.0
    plant = oscillator(rate, ratio)
    up = step(plant, None, [1.0], "x", duration=60 / rate / ratio**0.5, step=2e-3)
    fast = rate * math.sqrt(1 - ratio**2)
    assert up.final[0, 0] == pytest.approx(1.0, rel=1e-12)
    expected = math.exp(-math.pi * ratio * rate / fast)
    assert up.overshoot()[0, 0] == pytest.approx(expected, rel=2e-5)
    peak, at = up.peaks()
    assert peak[0, 0] == pytest.approx(1 + expected, rel=2e-5)
    assert at[0, 0] == pytest.approx(math.pi / fast, abs=2e-3)
    # A search on a grid a hundred times as dense.
    dense = np.arange(0, up.time[-1], 2e-5)
    damping = ratio * rate
    wave = np.cos(fast * dense) + damping / fast * np.sin(fast * dense)
    away = np.abs(np.exp(-damping * dense) * wave)
    for share in (0.02, 0.05, 0.3):
        last = dense[np.flatnonzero(away > share)[-1]]
        assert up.settling(share)[0, 0] == pytest.approx(last, abs=5e-5)


def test_settling_of_what_returns_to_zero_is_to_a_share_of_its_peak():
    hit = impulse(oscillator(2.0, 0.3), None, [1.0], ["x", "v"], step=1e-3)
    for i in range(2):
        y = hit.values[0, :, i]
        last = hit.time[np.flatnonzero(np.abs(y) > 0.02 * np.abs(y).max())[-1]]
        assert last <= hit.settling()[0, i] <= last + 1e-3
    assert np.all(np.isnan(hit.overshoot()))
    assert np.array_equal(hit.settling(of="peak"), hit.settling())
    # ... and one that does not return, of the peak where that is asked
    up = step(oscillator(2.0, 0.1), None, [1.0], "x", step=1e-3)
    assert up.settling(of="peak")[0, 0] < up.settling()[0, 0] == up.settling(of="final")[0, 0]


def test_what_has_not_settled_has_no_settling_time():
    short = step(oscillator(2.0, 0.1), None, [1.0], ["x"], duration=3.0)
    assert np.isnan(short.settling()[0, 0])
    unstable = UncertainPlant.from_vertices([[[0.5]], [[-1]]], [[[1]]] * 2, [[[1]]] * 2)
    both = step(unstable, None, np.eye(2), "x1", duration=6, step=0.1)
    assert np.isnan(both.final[0, 0])
    assert both.final[1, 0] == pytest.approx(1.0)
    assert np.array_equal(np.isnan(both.settling()[:, 0]), [True, False])
    assert np.array_equal(np.isnan(both.settling(of="peak")[:, 0]), [True, False])
    assert np.array_equal(np.isnan(both.overshoot()[:, 0]), [True, False])
    assert both.settling()[1, 0] == pytest.approx(math.log(50), abs=1e-2)
    hit = impulse(unstable, None, np.eye(2), "x1", duration=6, step=0.1)
    assert np.array_equal(hit.final[:, 0], [np.nan, 0], equal_nan=True)
    assert np.array_equal(np.isnan(hit.settling()[:, 0]), [True, False])
    still = simulate(unstable, None, np.eye(2), np.zeros(5), 0.1 * np.arange(5))
    assert np.array_equal(still.settling(), np.zeros((2, 2)))  # never away from zero


@pytest.mark.parametrize("step", [0.0, 0.1])
@pytest.mark.parametrize("weight", [0.01, 0.03])
def test_a_slow_mode_counts_where_it_makes_a_share_of_a_signal(weight, step):
    """Modes at -1 and -0.01, of which a unit step makes 1 and 100 of what enters them."""
    A, B, E = [[-1, 0], [0, "-0.01"]], [[1], [1]], [[1], [str(weight / 100)]]
    if step:  # the same rates in discrete time
        A, E = [["0.9", 0], [0, "0.999"]], [[str(step)], [str(step * weight / 100)]]
    plant = UncertainPlant.from_vertices([A], [B], [E], sample_time=step or None)
    both = Output("both", "m", C=[1, 1])
    found = linear.slowest_seen(plant, None, [1.0], [both], share=0.02)
    assert found == pytest.approx(0.01 if weight > 0.02 else 1.0, rel=1e-9)
    assert linear.slowest_seen(plant, None, [1.0], [both], share=1e-3) == pytest.approx(0.01)


def test_measures_do_not_depend_on_how_the_batch_is_cut(physical, points, monkeypatch):
    w = np.random.default_rng(5).normal(size=200)
    found = simulate(physical, None, points, w, instants(2e-3, w))
    before = found.settling(0.3), *found.peaks(), found.rms(0.1)
    monkeypatch.setattr(linear, "BUFFER", 1)
    after = found.settling(0.3), *found.peaks(), found.rms(0.1)
    for one, other in zip(before, after, strict=True):
        assert np.array_equal(one, other, equal_nan=True)
    late = found.values[:, 50:]
    assert np.allclose(found.rms(0.1), np.sqrt((late**2).mean(axis=1)), rtol=1e-12)


def test_the_papers_design_settles_within_half_a_second(as_printed, placed):
    """Disk (-40, 31), printed vertices: road steps and impulses, 5 % of final value or peak."""
    a = np.linspace(0, 1, 9)
    a, b = (x.ravel() for x in np.meshgrid(a, a))
    alpha = np.stack([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b], axis=1)
    signals = ride(as_printed).signals
    for kind in (step, impulse):
        found = kind(as_printed, placed, alpha, signals, step=5e-4)
        assert found.settling(0.05).max() < 0.5
        assert not np.any(np.isnan(found.settling()))  # 2 % takes longer, but is reached in time
    assert placed.poles(alpha).real.max() < -9


# --- wrong inputs --------------------------------------------------------------------------------


def test_a_step_too_long_for_the_fastest_pole_names_the_bound(physical, points):
    loops = close(physical, None, points)
    bound = grid.longest_step(loops)
    assert bound * np.abs(loops.poles()).max() == pytest.approx(1.0)
    with pytest.raises(InputError, match=r"step = 0\.05 s is too long .* at m1 = .* or less") as e:
        simulate(physical, None, points, np.zeros(10), 0.05 * np.arange(10))
    named = float(str(e.value).split(" at ")[-1].split(" s")[0])
    assert 0.99 * bound < named <= bound
    simulate(physical, None, points, np.zeros(10), named * np.arange(10))
    assert "\n" not in str(e.value)


def test_the_bound_is_what_straight_lines_lose():
    """At the bound, samples of a sine at the pole's rate joined by lines keep 92 % of it."""
    rate = 3.0
    t = np.arange(0, 2 * np.pi * 40 / rate, 1e-3)
    at = np.arange(0, t[-1] + 2, grid.LONGEST / rate)
    drawn = np.interp(t, at, np.exp(1j * rate * at).real)
    kept = 2 * np.mean(drawn * np.cos(rate * t))
    assert kept == pytest.approx((math.sin(0.5) / 0.5) ** 2, abs=5e-3)
    assert (math.sin(0.05) / 0.05) ** 2 == pytest.approx(1 - 0.0008, abs=1e-4)


TIME = 0.01 * np.arange(5)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"w": np.zeros(5), "time": 0.01}, "an array of two instants or more"),
        ({"w": np.zeros(5), "time": "now"}, "an array of two instants or more"),
        ({"w": np.zeros(1), "time": [0.0]}, "an array of two instants or more"),
        ({"w": np.zeros(5), "time": np.zeros(5)}, "second instant"),
        ({"w": np.zeros(5), "time": np.arange(5) * math.nan}, "second instant"),
        ({"w": np.zeros(5), "time": TIME + 0.01}, "evenly spaced from 0"),
        ({"w": np.zeros(5), "time": TIME**1.01}, "evenly spaced from 0"),
        ({"w": np.sin, "time": TIME[::-1]}, "second instant|evenly spaced"),
        ({"w": [0, 0, math.nan, 1, 1], "time": TIME}, "sample 3"),
        ({"w": np.zeros((5, 2)), "time": TIME}, r"shape \(5, 2\); give \(5, 1\)"),
        ({"w": np.zeros(4), "time": TIME}, r"shape \(4,\); give \(5, 1\)"),
        ({"w": np.zeros((0, 1)), "time": TIME}, r"give \(5, 1\)"),
        ({"w": "abc", "time": TIME}, r"give \(5, 1\)"),
        ({"w": np.zeros(5), "time": TIME, "hold": "cubic"}, "hold"),
        ({"w": np.sin, "time": -1}, "time"),
        ({"w": np.sin, "time": 1e9}, "GB"),
        ({"w": np.zeros(5), "time": TIME, "start": [1, 2, 3]}, "start"),
        ({"w": np.zeros(5), "time": TIME, "start": [math.inf, 0]}, "start"),
        ({"w": np.zeros(5), "time": TIME, "signals": ["x", "x"]}, "twice"),
        ({"w": np.zeros(5), "time": TIME, "signals": []}, "no signal"),
        ({"w": np.zeros(5), "time": TIME, "signals": ["vv"]}, "did you mean 'v'"),
    ],
)
def test_wrong_disturbances_are_refused(arguments, said):
    with pytest.raises(InputError, match=said) as error:
        simulate(oscillator(), None, [1.0], **arguments)
    assert "\n" not in str(error.value)


def test_wrong_questions_are_refused(physical, points):
    plant = oscillator()
    for kind in (step, impulse):
        with pytest.raises(InputError, match="duration"):
            kind(plant, None, [1.0], duration=0)
        with pytest.raises(InputError, match="longer than the duration"):
            kind(plant, None, [1.0], duration=1, step=2)
        with pytest.raises(InputError, match="no disturbance or input 'w2'"):
            kind(plant, None, [1.0], source="w2")
        with pytest.raises(InputError, match="does not die away at m1 = .* give a duration"):
            kind(physical, None, points)
    with pytest.raises(InputError, match="frequency"):
        frequency(plant, None, [1.0], [1.0, -1.0])
    with pytest.raises(InputError, match="frequency"):
        frequency(plant, None, [1.0], "all")
    with pytest.raises(InputError, match=r"pole at the frequency 0 Hz at m1"):
        frequency(physical, None, points[:1], [1.0, 0.0])
    with pytest.raises(InputError, match="off the simplex"):
        step(physical, None, [0.5, 0.5, 0.5, 0.5])
    with pytest.raises(InputError, match="alpha has shape"):
        step(physical, None, np.zeros((0, 4)))
    with pytest.raises(InputError, match="outgrows floating point"):
        grows = UncertainPlant.from_vertices([[[5.0]]], [[[1]]], [[[1]]])
        simulate(grows, None, [1.0], np.ones(20_000), 0.1 * np.arange(20_000))
    with pytest.raises(InputError, match="outgrows floating point"):
        step(grows, None, [1.0], duration=2e3, step=1e3)


def test_what_no_signal_depends_on_does_not_matter(physical, points):
    """The passive car's integral never ends; its deflections do, and have a gain at 0 Hz."""
    signals = ride(physical).signals
    up = step(physical, None, points, signals)
    assert np.all(up.settling() < up.time[-1])
    at_rest = frequency(physical, None, points, [0.0], signals)
    assert np.allclose(at_rest.gain[:, 0, :, 0], up.final, atol=1e-9)
    assert len(frequency(physical, None, points).frequency) == 400


def test_points_are_named_by_what_is_known_of_them(physical, points):
    assert point_text(physical, points[0]) == "m1 = 231.12 kg, beta = -10"
    assert point_text(oscillator(), np.ones(1)) == "alpha = [1.0]"


def test_results_are_read_only_and_say_what_they_are(physical, points):
    w = np.zeros(3)
    found = simulate(physical, None, points, w, instants(1e-3, w))
    with pytest.raises(ValueError, match="read-only"):
        found.values[0, 0, 0] = 1
    assert repr(found) == "<Response of 'quarter car, physical': 5 points, 3 samples, 6 signals>"
    tones = frequency(physical, None, points, [1.0], Output("mine", "N", C=[2, 0, 0, 0, 0]))
    assert repr(tones).endswith("5 points, 1 frequencies, 1 signals, 1 sources>")
    with pytest.raises(InputError, match="no signal"):
        found.of("mine")


def test_signals_of_forces_and_rates(physical, points):
    """A rate and an input in one signal, against the state's own derivative."""
    K = np.array([[100.0, -50.0, -400.0, 20.0, -300.0]])
    loops = close(physical, K, points)
    tyre, force = physical.signal("tyre deflection"), physical.signal("actuator force")
    parts = [(2, tyre), (3, rate_of(physical, "tyre deflection")), (0.5, force)]
    mixed = weighted_sum("mixed", "", parts)
    C, D = output_matrices(physical, [mixed], points, loops.K)
    x, w = np.random.default_rng(6).normal(size=(5, 1)), np.array([[0.7]])
    slope = loops.closed @ x + loops.E @ w
    expected = 2 * x[1] + 3 * slope[:, 1] + 0.5 * (loops.K @ x)[:, 0]
    assert np.allclose((C @ x + D @ w)[:, 0], expected, rtol=1e-12)


def test_a_step_response_of_every_third_sample_is_that_of_all_of_them():
    A = np.array([[0.2, 0.9], [-0.4, 0.7]])
    B, E = np.array([[0.0], [1.0]]), np.array([[1.0], [-2.0]])
    outputs = [Output("y", "", [[1, 3]], [[2]])]
    plant = UncertainPlant.from_vertices([A], [B], [E], sample_time=0.1, outputs=outputs)
    gain, signals = [[-0.1, -0.2]], ["y", *states(plant)]
    whole = step(plant, gain, [1.0], signals, duration=3.0)
    third = step(plant, gain, [1.0], signals, duration=3.0, step=0.3)
    np.testing.assert_allclose(third.time, whole.time[::3], atol=1e-12)
    np.testing.assert_allclose(third.values, whole.values[:, ::3], atol=1e-12)
    x, K = np.zeros(2), np.array(gain)
    for k in range(30):  # x(t + T) = (A + B K) x + E
        expected = np.array([x @ [1, 3] + 2 * (K @ x)[0], *x])
        np.testing.assert_allclose(whole.values[0, k], expected, atol=1e-12)
        x = (A + B @ K) @ x + E[:, 0]
    for wrong in (0.25, 0.05, math.nan):
        with pytest.raises(InputError):
            step(plant, gain, [1.0], signals, duration=3.0, step=wrong)
    with pytest.raises(InputError, match=r"its samples are 0.1 s apart"):
        impulse(plant, gain, [1.0], signals, duration=3.0, step=0.3)
