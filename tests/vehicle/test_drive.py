"""Drives against exact and independent solutions, their limits, and what they report."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lsim

from polefence import Disk, GainTable, Scheduled, UncertainPlant, place, tightest
from polefence.base.errors import InputError
from polefence.certify.margins import in_service, parameter_rate
from polefence.examples import family
from polefence.plant.larger import with_states
from polefence.plant.outputs import rate_of
from polefence.response.discrete import Sampling
from polefence.vehicle.driving.parts import (
    Actuator,
    BumpStops,
    Estimated,
    Jump,
    Measured,
    Ramp,
    Sensors,
    Sine,
)
from polefence.vehicle.estimate import Tuning
from polefence.vehicle.reference_laws import lqr
from polefence.vehicle.roads import random_road
from polefence.vehicle.vehicle import SIGNALS, quarter_car, ride
from support.drives import drive
from support.polynomials import design as polynomial

H = 1e-3


def wave(t):
    """A smooth road [m/s]."""
    return 0.3 * np.sin(9 * t) + 0.1 * np.cos(31 * t)


def near(found, expected, rel=1e-6, within=1e-12):
    """What pytest.approx says, of long arrays at once."""
    return np.all(np.abs(found - expected) <= np.maximum(rel * np.abs(expected), within))


MOVING = {"m1": Sine(290, 40, 0.7), "beta": Ramp(-6, 7, 0.0, 1.0)}


@pytest.fixture(scope="module")
def design(physical):
    return place(physical, Disk(-40, 31), Scheduled(1, 0, "box"))


@pytest.fixture(scope="module")
def service(design):
    return in_service(design)


@pytest.fixture(scope="module")
def road():
    return random_road("C", 20 * 3.6, seed=2)


# -- the equations ------------------------------------------------------------------------------


@pytest.mark.parametrize("hold", ["linear", "held"])
def test_frozen_parameters_are_the_exact_linear_response(physical, design, hold):
    w = np.random.default_rng(0).normal(size=1001) * 0.2
    cars = [{"m1": 240, "beta": -9}, {"m1": 300, "beta": 2}, {"m1": 340, "beta": 9}]
    fixed = drive(physical, design, w, step=H, hold=hold, parameters=cars, duration=1.0)
    exact = drive(
        physical, design, w[:51], step=H, hold=hold, parameters=cars, duration=0.05, adaptive=True
    )
    for j, car in enumerate(cars):
        A, B = physical.at(physical.alpha(**car))
        K = design.law.gain_at(**car)
        system = (A + B @ K, np.eye(5)[:, [1]], np.eye(5), np.zeros((5, 1)))
        x = lsim(system, w, fixed.time, interp=hold == "linear")[1]
        size = np.abs(x).max(axis=0)
        assert np.all(np.abs(fixed.states[j] - x).max(axis=0) < 2e-6 * size)
        early = np.abs(x[:51]).max(axis=0)
        assert np.all(np.abs(exact.states[j] - x[:51]).max(axis=0) < 1e-9 * early)
        assert near(fixed.applied[j], fixed.states[j] @ K.T, rel=1e-9)
        ahead = w[:, None] * np.eye(5)[1]
        rates = fixed.states[j] @ (A + B @ K).T + ahead
        assert near(fixed.rates[j, :1000], rates[:1000], rel=1e-7, within=1e-7)


def independent(physical, design, end, told=lambda p, t: p):
    """The varying loop, written out anew and integrated by scipy."""

    def slope(t, x):
        p = {"m1": 290 + 40 * math.sin(2 * math.pi * 0.7 * t), "beta": -6 + 13 * t}
        k, c = 10000 + 200 * p["beta"], 850 + 17 * p["beta"]
        A, B, E = (np.array(M, float) for M in quarter_car(p["m1"], 28.58, k, 155900, c))
        u = design.law.gain_at(**told(p, t)) @ x
        return A @ x + B @ u + E[:, 0] * wave(t)

    return solve_ivp(slope, (0, end), np.zeros(5), rtol=1e-8, atol=1e-11).y[:, -1]


def test_moving_parameters_against_equations_written_out_anew(physical, design):
    x = independent(physical, design, 0.2)
    fixed = drive(physical, design, wave, duration=0.2, step=H, parameters=MOVING)
    assert near(fixed.states[0, -1], x, rel=1e-6)
    adaptive = drive(
        physical, design, wave, duration=0.2, step=0.02, parameters=MOVING, adaptive=True
    )
    assert near(adaptive.states[0, -1], x, rel=1e-6)
    # and it matters: the frozen car is another
    frozen = drive(physical, design, wave, duration=0.2, parameters={"m1": 290, "beta": -6})
    assert np.abs(frozen.states[0, -1] / x - 1).max() > 1e-2


@pytest.mark.parametrize("actuator", [None, Actuator(10.0)])
def test_the_fixed_step_is_of_order_four(physical, design, actuator):
    same = {"duration": 0.48, "parameters": MOVING, "actuator": actuator}
    best = drive(physical, design, wave, step=0.0005, **same).states[0, -1]
    errors = [
        np.abs(drive(physical, design, wave, step=h, **same).states[0, -1] - best).max()
        for h in (0.008, 0.004, 0.002)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.6)
    assert np.all(orders < 4.6)


def test_a_jump_between_two_steps_costs_no_order(physical, design):
    same = {"duration": 0.48, "parameters": {"m1": Jump(0.16, 250, 330), "beta": 0}}
    best = drive(physical, design, wave, step=0.0005, **same).states[0, -1]
    errors = [
        np.abs(drive(physical, design, wave, step=h, **same).states[0, -1] - best).max()
        for h in (0.008, 0.004)
    ]
    assert math.log2(errors[0] / errors[1]) > 3.6


def test_values_at_all_instants_are_a_course_too(physical, design):
    t = H * np.arange(201)
    trajectory = {"m1": 290 + 40 * np.sin(2 * math.pi * 0.7 * t), "beta": lambda t: -6 + 13 * t}
    a = drive(physical, design, wave, duration=0.2, parameters=trajectory)
    b = drive(physical, design, wave, duration=0.2, parameters=MOVING)
    assert near(a.states, b.states, rel=1e-4, within=1e-9)
    assert near(a.parameters[0, :, 0], trajectory["m1"], rel=1e-9)


def test_a_road_at_a_speed_is_held_over_each_step(physical, road):
    law = lqr(physical)
    ours = drive(physical, law, road, speed=20, duration=0.5)
    w = road.velocity(20, H, 0.5)[1]
    same = drive(physical, law, w, hold="held")
    assert np.array_equal(ours.states, same.states)
    assert len(ours.time) == len(w) + 1
    linear = drive(physical, law, np.append(w, 0.0), hold="linear")
    assert np.abs(linear.states - ours.states).max() > 1e-6


def test_many_cars_are_as_one_each(physical, design):
    cars = [MOVING, {"m1": 240, "beta": Jump(0.05, 0, 5)}]
    both = drive(physical, design, wave, duration=0.1, parameters=cars)
    for j, car in enumerate(cars):
        own = drive(physical, design, wave, duration=0.1, parameters=car)
        assert near(both.states[j], own.states[0], rel=1e-12, within=1e-15)


def test_weights_and_vertices_without_parameters(physical, design):
    alpha = np.array([physical.alpha(m1=250, beta=3), physical.alpha(m1=300, beta=0)])
    by_weights = drive(physical, design, wave, duration=0.1, parameters=alpha)
    assert near(by_weights.parameters[:, 0], np.array([[250, 3], [300, 0]]), within=1e-9)
    bare = UncertainPlant(physical.vertices, states=physical.states)
    law = design.law.gain_at(m1=300, beta=0)
    constant = drive(bare, law, wave, duration=0.1, parameters=alpha)
    assert near(constant.states[1], by_weights.states[1], rel=1e-6, within=1e-9)
    assert constant.parameters.shape == (2, 101, 4)
    moved = drive(
        bare, law, wave, duration=0.1,
        parameters=lambda t: np.outer(1 - t, alpha[0]) + np.outer(t, alpha[1]),
    )  # fmt: skip
    assert np.all(np.abs(moved.parameters.sum(axis=-1) - 1) < 1e-12)
    with pytest.raises(InputError, match="not a product of the weights of m1, beta"):
        drive(physical, design, wave, duration=0.1, parameters=[0.5, 0, 0, 0.5])


def test_a_table_of_gains_drives(physical, design):
    knots = {"m1": ["231.12", "288.9", "346.68"], "beta": [-10, 10]}
    points = [[design.law.gain_at(clamp=True, m1=float(a), beta=b) for b in knots["beta"]]
              for a in knots["m1"]]  # fmt: skip
    table = GainTable(physical.parameters, knots, np.array(points))
    ours = drive(physical, table, wave, duration=0.1, parameters={"m1": 300, "beta": 4})
    K = table.gain_at(m1=300, beta=4)
    fixed = drive(physical, K, wave, duration=0.1, parameters={"m1": 300, "beta": 4})
    assert near(ours.states, fixed.states, rel=1e-9, within=1e-15)


def test_outside_its_interval_the_car_is_still_that_car(physical):
    law = lqr(physical)
    ours = drive(
        physical, law, wave, duration=0.3, parameters={"m1": 450, "beta": 14}, outside=True
    )
    A, B, E = (np.array(M, float) for M in quarter_car(450, 28.58, 12800, 155900, 1088))
    system = (A + B @ law.K, E, np.eye(5), np.zeros((5, 1)))
    fine = np.linspace(0, 0.3, 3001)
    x = lsim(system, wave(fine), fine)[1][::10]
    assert np.all(np.abs(ours.states[0] - x).max(axis=0) < 1e-4 * np.abs(x).max(axis=0))
    assert [e.kind for e in ours.events] == ["interval", "interval"]
    assert "m1 = 450 kg outside [231.12, 346.68]" in ours.events[0].text
    assert ours.events[0].first == 0
    assert ours.events[0].duration == pytest.approx(0.3)


def test_a_load_that_has_weight_sinks_the_car(physical):
    trajectory = {"m1": Jump(0.5, 250, 330), "beta": 0}
    light = drive(physical, None, duration=8, step=0.008, parameters=trajectory)
    assert not light.states.any()
    ours = drive(physical, None, duration=8, step=0.008, parameters=trajectory, gravity=9.81)
    assert not ours.states[0, :62].any()
    assert near(ours.states[0, -1, 0], 80 * 9.81 / 10000, rel=1e-3)
    assert near(ours.states[0, -1, 1], 80 * 9.81 / 155900, rel=1e-3)


# -- scheduling ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "how", [Measured(), Measured(delay=0.0, lag=0.0, noise={"m1": 0.0}), Measured(delay=1e-9)]
)
def test_perfect_sensors_are_the_plain_loop(physical, design, how):
    same = {"duration": 0.2, "parameters": MOVING}
    plain = drive(physical, design, wave, **same)
    ours = drive(physical, design, wave, scheduling=how, **same)
    assert near(ours.states, plain.states, rel=1e-7, within=1e-12)
    assert np.array_equal(plain.used, plain.parameters)


@pytest.mark.parametrize("name", ["delay", "lag", "noise"])
def test_as_sensors_get_better_the_plain_loop_returns(physical, design, name):
    same = {"duration": 0.3, "parameters": MOVING}
    plain = drive(physical, design, wave, **same).states
    errors = []
    for size in (4e-2, 2e-2, 1e-2):
        value = {"m1": 100 * size} if name == "noise" else size
        found = drive(physical, design, wave, scheduling=Measured(**{name: value}), **same)
        errors.append(np.abs(found.states - plain).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 1.6) & (ratios < 2.5))


def test_late_and_filtered_readings_are_what_they_should_be(physical, design):
    ramp = {"m1": Ramp(250, 350 - 10, 0.0, 1.0), "beta": Jump(0.1, -4, 6)}
    late = drive(physical, design, duration=0.5, parameters=ramp, scheduling=Measured(delay=0.05))
    t = late.time
    assert near(late.used[0, :, 0], 250 + 90 * np.maximum(t - 0.05, 0), within=1e-5)
    assert near(late.used[0, :, 1], np.where(t > 0.1499, 6, -4))
    slow = drive(physical, design, duration=0.5, parameters=ramp, scheduling=Measured(lag=0.04))
    expected = 250 + 90 * (t - 0.04 * (1 - np.exp(-t / 0.04)))
    assert near(slow.used[0, :, 0], expected, rel=1e-6)
    after = np.maximum(t - 0.1, 0)
    assert near(slow.used[0, :, 1], 6 - 10 * np.exp(-after / 0.04), rel=1e-5)


def test_noise_is_white_seeded_held_and_cut_off(physical, design):
    def used(seed, m1=290):
        how = Measured(noise={"m1": 5.0}, period=0.01, seed=seed)
        car = {"m1": m1, "beta": 0}
        return drive(physical, design, duration=10, step=0.01, parameters=car, scheduling=how).used

    first = used(1)[0, :, 0]
    assert np.array_equal(first, used(1)[0, :, 0])
    assert not np.array_equal(first, used(2)[0, :, 0])
    wrong = first - 290
    assert abs(wrong.mean()) < 4 * 5 / math.sqrt(1000)
    assert abs(wrong.std() - 5) < 4 * 5 / math.sqrt(2000)
    assert abs(np.mean(wrong[1:] * wrong[:-1])) < 4 * 25 / math.sqrt(1000)
    assert used(1, 346.0).max() == 346.68
    how = Measured(noise={"m1": 5.0}, period=0.01)
    held = drive(physical, design, duration=0.1, scheduling=how).used[0, :100, 0].reshape(10, 10)
    assert np.all(held == held[:, :1])
    assert len(np.unique(held)) == 10


# -- sampling and actuators ---------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 1, 0.4, 1.75])
def test_a_sampled_loop_is_the_discrete_loop(physical, design, delay):
    car, T = {"m1": 310, "beta": -3}, 0.004
    start = np.array([0.02, 0.001, 0.1, -0.2, 0.0])
    ours = drive(
        physical, design, duration=0.2, parameters=car, start=start, sampling=Sampling(T, delay)
    )
    A, B = physical.at(physical.alpha(**car))
    K, moved, first = design.law.gain_at(**car), by_parts(A, B, T, delay), math.ceil(delay)
    x, sent = start, [np.zeros(1)] * 4
    terms = (np.abs(K) @ np.abs(start)).item()  # of a demand, which is small beside them
    for k in range(50):
        assert near(ours.states[0, 4 * k], x, rel=1e-5, within=1e-9)
        sent = [K @ x, *sent[:-1]]
        steps = math.ceil(4 * (1 - first + delay))  # instants before the next one acts
        acting = ours.demanded[0, 4 * k : 4 * k + steps, 0]
        assert acting == pytest.approx(np.full(steps, sent[first][0]), rel=1e-5, abs=1e-7 * terms)
        x = moved(x, sent)
    assert any("the controller samples every 0.004 s" in note for note in ours.notes)
    fine = drive(
        physical, design, duration=0.05, parameters=car, start=start, adaptive=True,
        sampling=Sampling(T, delay),
    )  # fmt: skip
    assert near(fine.states[0], ours.states[0, :51], rel=1e-5, within=1e-7)


@pytest.mark.parametrize("delay", [0, 1, 0.4])
def test_states_of_the_law_are_stepped_at_once_as_its_code_does(delay):
    plant, car, T = with_states(family("quarter-car-ride"), 1), {"m1": 300, "beta": 2}, 0.01
    K = np.array([[9000, 0, -2000, 150, 1000.0], [0.5, 0, 0.1, 0, -5.0]])
    start = np.array([0.02, 0.001, 0.1, -0.2, 0.3])
    ours = drive(
        plant, K, duration=0.2, parameters=car, start=start, sampling=Sampling(T, delay)
    ).states[0]
    A, B = plant.at(plant.alpha(**car))
    moved = by_parts(A[:4, :4], B[:4, :1], T, delay)
    every, x, sent = round((len(ours) - 1) / 20), start, [np.zeros(1)] * 2
    for k in range(20):
        assert near(ours[every * k], x, rel=1e-5, within=1e-7)
        u, rate = K @ x
        sent = [np.array([u]), sent[0]]
        x = np.array([*moved(x[:4], sent), x[4] + T * rate])


def by_parts(A, B, T, delay):
    """What a period makes of x: by exponentials of its two parts, of demands, the newest first."""
    n, m = B.shape
    first = math.ceil(delay)

    def moved(x, sent):
        for share, late in ((1 - first + delay, first), (first - delay, first - 1)):
            F = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * T * share)
            x = F[:n, :n] @ x + F[:n, n:] @ sent[late]
        return x

    return moved


@pytest.mark.parametrize("hardware", [{"limit": 1.0}, {"bandwidth": 0.1}])
def test_an_actuator_neither_cuts_nor_delays_states_of_the_law(hardware):
    """The rate is 500 at first, 20 times as fast as the actuator, and is the law's own."""
    plant = with_states(family("quarter-car-ride"), 1)
    K = np.array([[0, 0, 0, 0, 1.0], [0, 0, 0, 0, -50.0]])
    found = drive(
        plant, K, duration=0.1, parameters={"m1": 300, "beta": 2},
        start=np.array([0, 0, 0, 0, 10.0]), actuator=Actuator(**hardware),
    )  # fmt: skip
    assert near(found.states[0, :, 4], 10 * np.exp(-50 * found.time), rel=1e-4)
    assert np.abs(found.demanded[0, :, 1]).max() == pytest.approx(500)
    assert found.states[0, -1, 2] != 0  # the force acts


def test_with_faster_hardware_the_plain_loop_returns(physical, design):
    same = {"duration": 0.1, "parameters": MOVING, "step": 0.0005}
    plain = drive(physical, design, wave, **same).states

    def error(**hardware):
        return np.abs(drive(physical, design, wave, **same, **hardware).states - plain).max()

    for errors in (
        [error(sampling=Sampling(T)) for T in (0.004, 0.002, 0.001)],
        [error(sampling=Sampling(T, delay=1)) for T in (0.002, 0.001, 0.0005)],
        [error(actuator=Actuator(f)) for f in (75.0, 150.0, 300.0)],
    ):
        ratios = np.array(errors[:-1]) / errors[1:]
        assert np.all((ratios > 1.5) & (ratios < 2.8))
    assert error(actuator=Actuator(limit=1e9)) < 1e-12


@pytest.mark.parametrize("bandwidth", [None, 15.0])
@pytest.mark.parametrize("sampling", [None, Sampling(0.005)])
@pytest.mark.parametrize("adaptive", [False, True])
def test_the_force_never_exceeds_its_limit(physical, design, bandwidth, sampling, adaptive):
    ours = drive(
        physical, design, lambda t: 3 * wave(t), duration=0.05 if adaptive else 0.5,
        actuator=Actuator(bandwidth, 400.0), sampling=sampling, adaptive=adaptive,
    )  # fmt: skip
    assert np.abs(ours.applied).max() <= 400
    assert np.abs(ours.demanded).max() > 600
    (event,) = [e for e in ours.events if e.kind == "limit"]
    over = np.abs(ours.demanded[0, :, 0]) > 400
    assert event.first == ours.time[np.argmax(over)]
    assert event.duration == pytest.approx(H * np.count_nonzero(over[:-1]))
    assert f"{np.abs(ours.demanded).max():.4g} demanded" in event.text
    if bandwidth is None:
        assert near(ours.applied, np.clip(ours.demanded, -400, 400))


def test_an_actuator_with_a_lag_is_first_order(physical):
    law = np.zeros((1, 5))
    law[0, 4] = 1000.0  # of the integral alone
    start = [0, 0, 0, 0, 0.1]
    ours = drive(physical, law, duration=0.1, start=start, actuator=Actuator(bandwidth=5.0))
    rate = 2 * math.pi * 5
    slope = np.gradient(ours.applied[0, :, 0], H)
    expected = rate * (ours.demanded - ours.applied)[0, :, 0]
    assert near(slope[1:-1], expected[1:-1], rel=1e-3, within=1)
    assert ours.applied[0, 0, 0] == 0
    assert ours.demanded[0, 0, 0] == pytest.approx(100)


# -- stops --------------------------------------------------------------------------------------


@given(st.floats(-0.3, 0.3), st.floats(-5, 5), st.floats(0.01, 0.1), st.floats(0, 5000))
@settings(max_examples=60)
def test_stops_push_inwards_or_not_at_all(x, v, free, damping):
    stops = BumpStops(free, 2 * free, 1e5, damping)
    force = float(stops.force(np.array([x]), np.array([v]))[0])
    if -2 * free <= x <= free:
        assert force == 0
    elif x > 0:
        assert force == pytest.approx(max(1e5 * (x - free) + damping * v, 0), rel=1e-9)
    else:
        assert force == pytest.approx(-max(1e5 * (-x - 2 * free) - damping * v, 0), rel=1e-9)


@pytest.mark.parametrize("damping", [0.0, 800.0])
def test_stops_keep_travel_and_are_in_the_equations(physical, damping):
    def kerb(t):
        return np.where(t < 0.05, 2.0, 0.0)

    stops = BumpStops(0.03, 0.02, 2e5, damping)
    free = drive(physical, None, kerb, duration=0.5)
    ours = drive(physical, None, kerb, duration=0.5, stops=stops)
    x = ours.states[0, :, 0]
    assert 0.03 < x.max() < 0.7 * free.states[0, :, 0].max()
    assert -0.02 > x.min() > 0.95 * free.states[0, :, 0].min()
    push = ours.stop_force[0]
    assert np.all(push[(x < 0.03) & (x > -0.02)] == 0)
    assert np.all(push[x > 0.03 + 1e-12] >= 0)
    assert push.max() > 0 > push.min()
    m1 = 288.9
    spring = 10000 * x + 850 * (ours.states[0, :, 3] - ours.states[0, :, 2])
    assert near(ours.rates[0, :, 2], (spring + push) / m1, rel=1e-9, within=1e-9)
    acceleration = ours.response([ride(physical).acceleration]).values[0, :, 0]
    assert np.array_equal(acceleration, ours.rates[0, :, 2])
    (event,) = [e for e in ours.events if e.kind == "stops"]
    assert event.first == ours.time[np.argmax(push != 0)]
    adaptive = drive(physical, None, kerb, duration=0.1, stops=stops, adaptive=True)
    # with damping the force jumps at contact, where a fixed step loses its order
    assert near(adaptive.states[0], ours.states[0, :101], within=1e-2 if damping else 2e-4)
    assert not free.stop_force.any()


def test_energy_is_neither_made_nor_lost_in_an_undamped_stop():
    A, B, E = (np.array(M, float) for M in quarter_car(300, 30, 8000, 160000, 0))
    plant = UncertainPlant.from_vertices([A], [B], [E], **SIGNALS)
    stops = BumpStops(0.01, 0.01, 1e5)
    start = [0, 0, -0.8, 0.3, 0]
    ours = drive(plant, None, duration=0.5, step=4e-4, start=start, stops=stops)
    x1, x2, x3, x4, _ = ours.states[0].T
    beyond = np.maximum(np.abs(x1) - 0.01, 0)
    energy = 300 * x3**2 + 30 * x4**2 + 8000 * x1**2 + 160000 * x2**2 + 1e5 * beyond**2
    assert beyond.max() > 0.01
    assert near(energy, energy[0], rel=1e-3)


def test_a_tyre_that_would_have_to_pull_is_told(physical):
    ours = drive(physical, None, lambda t: np.where(t < 0.05, -3.0, 0.0), duration=0.2)
    load = (288.9 + 28.58) * 9.81 + 155900 * ours.states[0, :, 1]
    (event,) = ours.events
    assert event.kind == "road"
    assert event.first == ours.time[np.argmax(load < 0)]


# -- what is guaranteed -------------------------------------------------------------------------


def kinds(found):
    return [event.kind for event in found.events]


def test_slow_parameters_known_exactly_are_covered(physical, design, service):
    rate = service["rate-m1"].value
    slow = {"m1": Ramp(250, 250 + 0.02 * 0.9 * rate, 0.1, 0.12), "beta": 0}
    ours = drive(physical, design, wave, duration=0.2, parameters=slow, margins=service)
    assert ours.events == ()
    assert ours.covered.all()
    assert ours.report()[1] == "the margins cover 0.2 s of 0.2 s (the worst car)"


def test_a_rate_above_what_is_proved_is_told(physical, design, service):
    rate = service["rate-m1"].value
    fast = {"m1": Ramp(250, 250 + 0.02 * 1.1 * rate, 0.1, 0.12), "beta": 0}
    ours = drive(physical, design, wave, duration=0.2, parameters=fast, margins=service)
    (event,) = ours.events
    assert event.kind == "rate"
    assert event.first == pytest.approx(0.1)
    assert event.duration == pytest.approx(0.02)
    assert f"m1 {1.1 * rate:.4g} kg/s" in event.text
    assert f"{1.1:.4g} times what is proved" in event.text
    assert np.array_equal(ours.covered[0], (ours.time < 0.0999) | (ours.time > 0.1199))
    both = {"m1": Ramp(250, 330, 0.0, 0.1), "beta": Ramp(-9, 9, 0.0, 0.1)}
    within = drive(physical, design, duration=0.2, parameters=both, margins=service)
    together = [m for m in service if m.name == "rate"]
    assert kinds(within) == []
    assert kinds(drive(physical, design, duration=0.2, parameters=both, margins=together)) == []
    single = [service["rate-m1"], service["rate-beta"]]
    alone = drive(physical, design, duration=0.2, parameters=both, margins=single)
    assert kinds(alone) == ["rate"]  # each is proved while the other rests


def test_a_jump_is_no_rate_but_for_one_matrix_W(physical, design, service):
    jump = {"m1": Jump(0.1, 250, 251), "beta": 0}
    ours = drive(physical, design, duration=0.2, parameters=jump, margins=service)
    assert kinds(ours) == ["rate"]
    assert ours.events[0].first == pytest.approx(0.1)
    assert "m1 jumps" in ours.events[0].text
    fixed = tightest(physical, -40, "quadratic")
    any_rate = parameter_rate(fixed)
    same = drive(physical, fixed, duration=0.2, parameters=jump, margins=any_rate)
    assert kinds(same) == []
    assert same.covered.all()


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_an_error_of_the_scheduling_is_told_above_its_margin(physical, design, service, share):
    error = share * service["estimate-m1"].value
    told = SimpleNamespace(m1=300.0)
    late = Measured(delay=10.0)  # the law keeps the first value
    trajectory = {"m1": Jump(0.1, told.m1, told.m1 + error), "beta": 0}
    ours = drive(
        physical, design, duration=0.2, parameters=trajectory, scheduling=late, margins=service
    )
    wanted = ["rate"] if share < 1 else ["rate", "estimate"]
    assert kinds(ours) == wanted
    assert ours.covered[0, 150] == (share < 1)
    if share > 1:
        event = ours.events[1]
        assert event.first == pytest.approx(0.1)
        assert event.duration == pytest.approx(0.1)
        assert f"m1 {error:.4g} kg" in event.text


def test_an_error_while_parameters_move_is_covered_by_no_margin(physical, design, service):
    trajectory = {"m1": Ramp(300, 301, 0.05, 0.15), "beta": 0}
    late = Measured(delay=0.01)
    ours = drive(
        physical, design, duration=0.2, parameters=trajectory, scheduling=late, margins=service
    )
    assert kinds(ours) == ["rate and estimate"]
    assert ours.events[0].first == pytest.approx(0.051, abs=0.0011)
    assert not ours.covered[0, 100]
    assert ours.covered[0, 10]


def test_a_fixed_gain_has_no_error_of_scheduling(physical):
    fixed = tightest(physical, -40, "quadratic")
    ours = drive(
        physical, fixed, duration=0.1, parameters=MOVING, scheduling=Measured(delay=0.05),
        margins=parameter_rate(fixed),
    )  # fmt: skip
    assert kinds(ours) == []
    assert ours.covered.all()


def test_limits_of_hardware_end_the_cover(physical, design, service):
    ours = drive(
        physical, design, lambda t: 3 * wave(t), duration=0.2, actuator=Actuator(limit=300.0),
        margins=service,
    )  # fmt: skip
    over = np.abs(ours.demanded[0, :, 0]) > 300
    assert np.array_equal(ours.covered[0], ~over)


def test_without_margins_nothing_is_compared_and_that_is_told(physical, design):
    ours = drive(
        physical, design, duration=0.1, parameters={"m1": Ramp(250, 260, 0, 0.1), "beta": 0}
    )
    assert ours.covered is None
    assert "no margins were given" in ours.notes[0]
    assert "m1 100 kg/s" in ours.notes[0]
    assert "note: no margins" in str(ours)


def test_margins_of_another_law_or_plant_are_refused(physical, design, service, as_printed):
    other = replace(design.law, Z=1.01 * design.law.Z)
    for law in (other, None, lqr(physical)):
        with pytest.raises(InputError, match="another law's"):
            drive(physical, law, duration=0.1, margins=service)
    with pytest.raises(InputError, match="the margins are of quarter car, physical"):
        drive(as_printed, None, duration=0.1, margins=service)
    with pytest.raises(InputError, match="margins must be what in_service"):
        drive(physical, design, duration=0.1, margins=3)
    drive(physical, design.law, duration=0.1, margins=service["estimate-m1"])


def test_a_car_that_runs_away_is_told_and_the_others_drive_on(physical, design):
    cars = [{"m1": 240, "beta": -9}, {"m1": 340, "beta": 9}]
    wrong = np.array([[0, 0, 400.0, 0, 0]])  # drives the body on
    ours = drive(physical, wrong * 40, wave, duration=6, step=0.002, parameters=cars)
    assert "lost" in kinds(ours)
    event = next(e for e in ours.events if e.kind == "lost")
    gone = np.isnan(ours.states[event.car]).any(axis=1)
    assert event.first == ours.time[np.argmax(gone)]
    assert np.all(gone[np.argmax(gone) :])
    assert np.abs(np.nan_to_num(ours.states)).max() < 1e9
    alone = drive(physical, wrong * 0, wave, duration=1, step=0.002, parameters=cars)
    assert kinds(alone) == []
    slow = Sampling(0.1)
    mixed = drive(physical, design, wave, duration=20, step=0.005, parameters=cars, sampling=slow)
    assert {e.car for e in mixed.events if e.kind == "lost"} == {0, 1}
    told = np.array([[240, -9], [340, 9]])  # also behind where all are lost
    assert mixed.used == pytest.approx(np.broadcast_to(told[:, None], mixed.used.shape))


def test_the_report_of_many_cars_has_a_line_a_kind(physical, design):
    cars = [{"m1": m, "beta": 0} for m in (240, 290, 340)]
    actuator = Actuator(limit=300.0)
    ours = drive(physical, design, wave, duration=0.3, parameters=cars, actuator=actuator)
    lines = ours.report()
    assert lines[0] == "quarter car, physical: 3 cars, 0.3 s"
    assert lines[1].startswith("limit: 3 of 3 cars; car ")
    assert repr(ours) == "<Drive of 'quarter car, physical': 3 cars, 0.3 s, 301 instants, 3 events>"


# -- estimates ----------------------------------------------------------------------------------


def test_estimated_parameters_reach_the_law(physical, design, road):
    trajectory = {"m1": Jump(1.5, 250, 330), "beta": 4}
    how = Estimated(
        period=0.01, tuning=Tuning(memory=0.5, noise=0.05), sensors=Sensors(0.05), seed=3
    )
    ours = drive(
        physical, design, road, speed=20, parameters=trajectory, scheduling=how,
        sampling=Sampling(0.01),
    )  # fmt: skip
    found = ours.estimate
    assert ours.used[0, 0] == pytest.approx([288.9, 0], abs=1e-9)
    m1 = ours.used[0, :, 0]
    assert np.abs(m1[1000:1500] - 250).max() < 8
    assert np.abs(m1[2800:] - 330).max() < 12
    assert found.values.shape == (1, len(found.time), 3)
    assert near(np.diff(found.time), 0.01)
    # what the law was told is what the estimator had found by then
    assert near(ours.used[0, 1002], found.parameters[0, 100], rel=1e-2, within=0.3)
    assert found.deviation[0, 120, 0] < 0.1 * found.deviation[0, 0, 0]
    again = drive(
        physical, design, road, speed=20, duration=0.3, parameters=trajectory, scheduling=how,
        sampling=Sampling(0.01),
    )  # fmt: skip
    assert np.array_equal(again.states[0], ours.states[0, :301])


def test_with_the_truth_as_its_prior_an_estimator_is_the_plain_loop(physical, design):
    car = {"m1": 300, "beta": 5}
    prior = {"m1": 300, "c": 935, "k": 11000}
    how = Estimated(tuning=Tuning(prior=prior, noise=1.0))
    same = {"duration": 0.1, "parameters": car}
    ours = drive(physical, design, wave, scheduling=how, **same)
    plain = drive(physical, design, wave, **same)
    assert near(ours.states, plain.states, rel=1e-6, within=1e-9)
    adaptive = drive(physical, design, wave, scheduling=how, adaptive=True, **same)
    assert near(adaptive.states, plain.states, rel=1e-5, within=1e-9)


def test_samples_in_the_stops_do_not_mislead(physical, design):
    def kerb(t):
        return np.where((t > 0.5) & (t < 0.55), 3.0, wave(t))

    car, stops = {"m1": 300, "beta": 0}, BumpStops(0.004, 0.004, 3e5)
    how = Estimated(tuning=Tuning(memory=math.inf, noise=0.01))
    ours = drive(
        physical, design, kerb, duration=1, step=0.0025, parameters=car, scheduling=how, stops=stops
    )
    assert "stops" in kinds(ours)
    assert np.abs(ours.used[0, 200:, 0] - 300).max() < 1


# -- bad input ----------------------------------------------------------------------------------

GOOD = {"road": wave, "duration": 0.1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parameters": {"m2": 3}}, "unknown parameter 'm2'; known: beta, m1"),
        ({"parameters": {"m1": 300}}, "give a trajectory of every parameter; missing: beta"),
        ({"parameters": {"m1": 400, "beta": 0}}, r"m1 = 400 kg at 0 s lies outside"),
        ({"parameters": {"m1": Jump(0.05, 300, 200), "beta": 0}}, "m1 = 200 kg at 0.05 s lies"),
        ({"parameters": {"m1": -1, "beta": 0}, "outside": True}, "m1 reaches zero, where 1/m1"),
        ({"parameters": {"m1": np.nan, "beta": 0}}, "m1 is not finite at 0 s"),
        ({"parameters": {"m1": np.ones(7), "beta": 0}}, "m1: an array must have a value at each"),
        ({"parameters": {"m1": lambda t: 3 if t < 1 else 4, "beta": 0}}, "m1: the function must"),
        ({"parameters": {"m1": "heavy", "beta": 0}}, "m1: give a number, Jump, Ramp"),
        ({"parameters": [0.5, 0.6, 0, 0]}, "alpha is off the simplex"),
        ({"parameters": "some"}, "parameters must be a mapping"),
        ({"step": 0.025}, r"fastest pole, 42.66 1/s in size; use at most 0.0234 s"),
        ({"step": 0.01, "actuator": Actuator(1000)}, "fastest pole, 6283 1/s"),
        ({"stops": BumpStops(stiffness=1e9)}, "too long for the fastest pole"),
        ({"step": 0}, r"step \[s\] = 0"),
        ({"step": 0.3}, "step = 0.3 s is longer than the duration, 0.1 s"),
        ({"step": 1e-9}, "steps; at most"),
        ({"duration": None}, "give the duration"),
        ({"duration": -1}, r"duration \[s\] = -1"),
        ({"road": np.array([0, 1, np.nan, 2]), "duration": None}, "w: sample 3 is not finite"),
        ({"road": np.zeros((5, 2)), "duration": None}, "samples of w have shape"),
        ({"road": np.zeros(5)}, "w has 4 steps of 0.001 s; 0.1 s need 100"),
        ({"road": np.zeros(1), "duration": None}, "w has no step"),
        ({"road": lambda t: np.full(len(t), np.inf)}, "w at 1e-11 s is not finite"),
        ({"road": lambda t: np.ones(3)}, "w: the function must take"),
        ({"hold": "cubic"}, "hold = 'cubic'"),
        (
            {"sampling": Sampling(0.0015)},
            "sampling period = 0.0015 s is not a multiple of the step",
        ),
        ({"scheduling": Measured(noise={"mass": 1})}, "noise: unknown parameter 'mass'"),
        ({"scheduling": Estimated(period=0.0007)}, "period of the estimator = 0.0007 s"),
        ({"start": [1, 2]}, r"start must have shape \(5,\)"),
        ({"start": [1, 2, 3, 4, np.inf]}, "start is not finite"),
    ],
)
def test_bad_input_is_refused_in_a_line(physical, design, change, message):
    with pytest.raises(InputError, match=message) as caught:
        call = GOOD | change
        drive(physical, design, call.pop("road"), **call)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Measured(delay=-0.1), "delay = -0.1 of the scheduling must not be negative"),
        (lambda: Measured(lag=math.nan), "lag = nan"),
        (lambda: Measured(noise={"m1": -1}), "noise of m1 = -1"),
        (lambda: Measured(period=0), "period of the noise"),
        (lambda: Sensors(force=-1), "noise of force = -1"),
        (lambda: Sampling(0), "sampling period"),
        (lambda: Actuator(bandwidth=-1), "bandwidth of the actuator"),
        (lambda: Actuator(limit=0), "limit of the actuator"),
        (lambda: BumpStops(bump=0), "free travel in bump"),
        (lambda: BumpStops(damping=-1), "damping of the stops = -1"),
        (lambda: Ramp(1, 2, 1, 1), "it must end later"),
        (lambda: Estimated(period=-1), "period of the estimator"),
    ],
)
def test_parts_refuse_bad_values(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_what_needs_a_quarter_car_says_so(make_random):
    plant = make_random(1, 3, 1, 2)
    law = np.zeros((1, 3))
    for part in ({"stops": BumpStops()}, {"gravity": 9.81}, {"scheduling": Estimated()}):
        with pytest.raises(InputError, match=r"not described as a (quarter )?car"):
            drive(plant, law, duration=0.1, **part)
    with pytest.raises(InputError, match="has no E, so no disturbance enters"):
        drive(plant, law, wave, duration=0.1)
    rest = drive(plant, law, duration=0.01, start=[1, 0, 0])
    assert rest.states[0, 0, 0] == 1
    assert rest.of("x1").shape == (1, 11)


def test_signals_come_by_name(physical, design):
    ours = drive(physical, design, wave, duration=0.05)
    assert np.array_equal(ours.of("suspension deflection"), ours.states[:, :, 0])
    assert np.array_equal(ours.of("actuator force"), ours.applied[:, :, 0])
    jolt = rate_of(physical, "sprung-mass velocity")
    assert np.array_equal(ours.response([jolt]).values[..., 0], ours.rates[..., 2])
    with pytest.raises(InputError, match="no signal 'roll'"):
        ours.of("roll")


# -- polynomial laws ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["square", "measured", "many"])
def test_a_polynomial_law_drives_as_its_gain_does(kind):
    """At frozen parameters it is the fixed gain of that point."""
    own, here = polynomial(kind), {"m1": 300.0, "beta": 2.0}
    K = own.law.gain(own.plant.alpha(**here))
    ours, gain = (drive(own.plant, law, wave, duration=0.5, parameters=here) for law in (own, K))
    assert near(ours.states, gain.states, rel=1e-9)


def test_margins_of_a_polynomial_law_are_its_own():
    own, other = polynomial("affine"), polynomial("square")
    proved = in_service(own)
    slow = {"m1": 300.0, "beta": Ramp(0, 1, 0.0, 0.1)}
    ours = drive(own.plant, own, duration=0.1, parameters=slow, margins=proved)
    assert ours.covered.all()
    with pytest.raises(InputError, match="another law's"):
        drive(own.plant, other, duration=0.1, parameters=slow, margins=proved)


def test_a_law_of_signals_that_vary_is_not_driven_while_they_do():
    own, moved = polynomial("varying"), {"m1": Jump(0.05, 300.0, 310.0), "beta": 0.0}
    with pytest.raises(InputError, match="'spring force', which depends on the parameters"):
        drive(own.plant, own, duration=0.1, parameters=moved)
    drive(own.plant, own, duration=0.1, parameters=moved | {"m1": 300.0})
