"""Rates that saturate: against exact limits and simulated loops; faults; signals that are none."""

from dataclasses import replace
from fractions import Fraction
from math import exp

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    EnergyPeak,
    FixedGain,
    Gain,
    InitialPeak,
    PolynomialGain,
    Rms,
    Saturation,
    UncertainPlant,
    at_sample_time,
)
from polefence.base.errors import InputError
from polefence.certify.anti_windup import with_anti_windup
from polefence.certify.bounds import best_bound
from polefence.plant.delta import delta_form
from polefence.plant.exact import file_plant
from polefence.plant.larger import with_actuator, with_states
from polefence.plant.parameters import Parameter
from polefence.plant.samples import claim_of_samples
from polefence.proof.claims.base import prove
from polefence.proof.document import Document, check, loads
from polefence.proof.work import FormatError
from polefence.requirements.text import parse_specification

T = 0.02


def pendulum():
    """An inverted pendulum of unknown mass and stiffness, pushed."""

    def matrices(m, g):
        return [[0, 1], [g, 0]], [[0], [1 / m]], [[0], [1 / m]]

    return UncertainPlant.from_function(
        matrices,
        [Parameter("m", 1, 2, "kg", "1/m"), Parameter("g", 4, 6)],
        states=("x [rad]", "v [rad/s]"),
        inputs=("u [Nm]",),
        disturbances=("w",),
        name="pendulum",
    )


def late():
    return delta_form(at_sample_time(pendulum(), T, delay=1))


LAW = FixedGain(np.array([[-20.0, -7.0, -0.3]]))
CORNERS = [(1.0, 4.0), (2.0, 4.0), (1.0, 6.0), (2.0, 6.0), (1.4, 5.2)]
ROUND = np.diag([1.0, 1.0, 0.0]).tolist()
STARTS = np.array([(np.cos(t), np.sin(t)) for t in np.linspace(0, 2 * np.pi, 500)])


def runs(p, rate, most=np.inf, x=STARTS, w=(), steps=1500, K=LAW.K[0], swapped=False):
    """States at last of the sampled loop, u late by a sample, written out by hand."""
    m, g = p
    both = expm(np.array([[0, 1, 0], [g, 0, 1 / m], [0, 0, 0]]) * T)
    F, G = both[:2, :2], both[:2, 2]
    acts = np.zeros(len(x))
    for k in range(steps):
        u = x @ K[:2] + acts * K[2]
        if swapped:
            u = np.clip(np.clip(u, acts - rate * T, acts + rate * T), -most, most)
        else:
            u = np.clip(np.clip(u, -most, most), acts - rate * T, acts + rate * T)
        push = w[k] if k < len(w) else 0.0
        x, acts = x @ F.T + (acts + push)[:, None] * G, u
    return np.abs(x).max()


# --- exact limits --------------------------------------------------------------------------------


@pytest.mark.parametrize("a", [0.5, 2.0])
def test_the_least_rate_in_continuous_time_is_the_one_that_turns_it_back(a):
    """x' = a x + f, f' = sat(30 (v - f)): with y = x + f / a, y' = a y + f' / a falls if f' may
    be a^2 y. A law that needs hardly more feeds y back, and f a little.
    """
    plant = UncertainPlant.from_vertices([[[a]]], [[[1]]], states=("x",), inputs=("f [N]",))
    plant = with_actuator(plant, "f", 30 / (2 * np.pi))
    w = float(-plant.vertices[0].exact_A[1][1])
    law = FixedGain(np.array([[-3 * a * a / w, 1 - (3 * a - 0.05 * a) / w]]))
    bound = best_bound(plant, law, Saturation("rate of f", points=[(1.0, 0.0)]))
    assert bound.claim.subject.B[0] == [[0], [bound.claim.outputs[0].D[0][0][0]]]
    assert a * a < bound.level < 1.03 * a * a

    def last(rate, dt=1e-3 / a):
        x, f = 1.0, 0.0
        for _ in range(int(30 / a / dt)):
            v = law.K[0] @ (x, f)
            x, f = x + dt * (a * x + f), f + dt * float(np.clip(w * (v - f), -rate, rate))
            if abs(x) > 1e4:
                break
        return abs(x)

    assert last(0.99 * a * a) > 1e3
    assert last(bound.level) < 3.0


def test_the_least_rate_at_samples_is_the_one_that_turns_it_back():
    """With F = exp(T), y = x + s G / (F - 1) grows by F, and a sample's change moves it by that."""
    plant = UncertainPlant.from_vertices([[[1.0]]], [[[1.0]]], states=("x",), inputs=("u",))
    F = G = exp(0.1)
    G -= 1.0
    sampled = at_sample_time(plant, 0.1, delay=1)
    k = 3 * (F - 1) / G
    law = FixedGain(np.array([[-k * (F - 1), 1 - k * G + 0.005]]))
    bound = best_bound(delta_form(sampled), law, Saturation("rate of u", points=[(1.0, 0.0)]))
    least = (F - 1) ** 2 / G / 0.1
    assert least < bound.level < 1.03 * least

    def last(rate):
        x, s = 1.0, 0.0
        for _ in range(400):
            v = law.K[0] @ (x, s)
            x, s = F * x + G * s, float(np.clip(v, s - 0.1 * rate, s + 0.1 * rate))
        return abs(x)

    assert last(0.99 * least) > 1e3 > 2 > last(bound.level)


# --- simulated loops -----------------------------------------------------------------------------


def test_states_of_the_ellipsoid_come_to_rest_at_that_rate():
    bound = best_bound(late(), LAW, Saturation("rate of u", ellipsoid=ROUND))
    linear = best_bound(late(), LAW, InitialPeak("rate of u", ellipsoid=ROUND))
    assert bound.level < 0.2 * linear.level
    assert max(runs(p, bound.level) for p in CORNERS) < 1e-2
    assert max(runs(p, 0.25 * bound.level) for p in CORNERS) > 10


@pytest.mark.parametrize("limits", [(20.0, 200.0), (14.0, 400.0)])
def test_a_limit_and_a_rate_limit_together_in_either_order(limits):
    both = Saturation(["u", "rate of u"], ellipsoid=ROUND, limits=limits)
    bound = best_bound(late(), LAW, both)
    alone = [
        best_bound(late(), LAW, Saturation(name, ellipsoid=ROUND)).level / limit
        for name, limit in zip(both.signal, limits, strict=True)
    ]
    assert bound.level >= max(alone) * (1 - 1e-6)
    u, rate = (bound.level * limit for limit in limits)
    for swapped in (False, True):
        assert max(runs(p, rate, u, swapped=swapped) for p in CORNERS) < 1e-2
    assert max(runs(p, 0.3 * rate, 0.3 * u) for p in CORNERS) > 10


def test_disturbances_are_borne_at_that_rate():
    norm = 1.0
    bound = best_bound(late(), LAW, Saturation("rate of u", norm=norm))
    random, count, steps = np.random.default_rng(3), 400, 200
    length = random.uniform(0.02, 3.0, count)
    t = np.arange(steps) * T
    w = np.where(t[:, None] < length, 1 + 0.1 * random.normal(size=(steps, count)), 0.0)
    w *= norm / np.sqrt(T * (w**2).sum(axis=0))
    still = np.zeros((count, 2))
    assert max(runs(p, bound.level, x=still, w=w) for p in CORNERS) < 1e-2
    assert max(runs(p, 0.1 * bound.level, x=still, w=w) for p in CORNERS) > 10


def test_random_plants_come_to_rest_where_it_is_proved():
    random, proved, closer = np.random.default_rng(5), 0, 0
    for _ in range(6):
        A = random.normal(size=(2, 2)) + 0.7 * np.eye(2)
        B = random.normal(size=(2, 1))
        plant = with_actuator(
            UncertainPlant.from_vertices([A.tolist()], [B.tolist()], inputs=("f",)), "f", 5
        )
        A, B = plant.vertices[0].A, plant.vertices[0].B
        # poles by Ackermann's formula
        power = [np.linalg.matrix_power(A, k) for k in range(4)]
        wanted = np.poly([-2.0, -3.0, -8.0])
        at = sum(c * M for c, M in zip(wanted, power[::-1], strict=True))
        reach = np.hstack([M @ B for M in power[:3]])
        K = -np.linalg.solve(reach.T, np.eye(3)[2])[None] @ at
        law = FixedGain(K)
        bound = best_bound(
            plant, law, Saturation("rate of f", ellipsoid=np.diag([1.0, 1, 0]).tolist())
        )
        if bound is None:
            continue
        proved += 1
        w = 10 * np.pi
        for size, rate in ((1.0, bound.level), (1.0, 0.3 * bound.level)):
            x = np.hstack([size * STARTS[::10], np.zeros((50, 1))])
            for _ in range(4000):
                v = x @ K[0]
                slope = x @ A.T
                slope[:, 2] = np.clip(w * (v - x[:, 2]), -rate, rate)
                x = np.clip(x + 0.002 * slope, -1e6, 1e6)
            if rate == bound.level:
                assert np.abs(x).max() < 0.05
            closer += np.abs(x).max() > 10
    assert proved >= 4
    assert closer >= 3


# --- laws with states of their own ---------------------------------------------------------------


def integrating(gain=None):
    """The late loop under proportional, derivative and integral action."""
    plant = with_states(late(), 1)
    K = np.array([[-22.0, -7.5, -0.3, -6.0], [1.0, 0, 0, 0]])
    law = PolynomialGain(((0, 0),), [K], (), pendulum().parameters)
    if gain is not None:
        G = np.zeros((4, 2))
        G[3, 0] = gain
        law = law.with_anti_windup(G)
    return plant, law


def test_anti_windup_is_found_for_a_rate_too():
    plant, law = integrating()
    asked = Saturation("rate of u", points=[(1.0, 0, 0, 0)])
    found = with_anti_windup(plant, law, [asked])
    assert np.any(found.anti_windup)
    levels = [best_bound(plant, choice, asked).level for choice in (law, found)]
    assert levels[1] < 0.98 * levels[0]
    G, rate = found.anti_windup[3, 0], levels[1]
    for m, g in CORNERS:
        both = expm(np.array([[0, 1, 0], [g, 0, 1 / m], [0, 0, 0]]) * T)
        x, acts, z = np.array([1.0, 0.0]), 0.0, 0.0
        for _ in range(3000):
            v = law.gains[0][0] @ (*x, acts, z)
            u = float(np.clip(v, acts - rate * T, acts + rate * T))
            z, (x, acts) = z + T * (x[0] + G * (u - v)), (both[:2, :2] @ x + both[:2, 2] * acts, u)
        assert abs(x).max() < 1e-2


def test_no_anti_windup_is_found_that_a_computer_could_not_run():
    """How far the actuator is, and so what it makes of a demand, is nothing that a law knows."""
    plant = with_states(with_actuator(pendulum(), "u", 5), 1)
    K = np.array([[-40.0, -14.0, -0.3, -6.0], [1.0, 0, 0, 0]])
    law = PolynomialGain(((0, 0),), [K], (), pendulum().parameters)
    start = [(1.0, 0, 0, 0)]
    assert with_anti_windup(plant, law, [Saturation("rate of u", points=start)]) is law
    found = with_anti_windup(plant, law, [Saturation("demand of u", points=start)])
    assert np.any(found.anti_windup)


# --- the proof -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def claim():
    both = Saturation(["u", "rate of u"], points=[(1.0, 0, 0)], limits=(20.0, 200.0))
    bound = best_bound(late(), LAW, both)
    assert prove(bound.claim).proved
    return bound.claim


def test_less_of_anything_is_not_proved(claim):
    F = Fraction
    assert not prove(replace(claim, level=claim.level * F(99, 100))).proved
    u, rate = claim.outputs
    for outputs in ((u, replace(rate, D=[[[2 * x for x in M[0]]] for M in rate.D])),
                    (u, replace(rate, C=[[[-x for x in M[0]]] for M in rate.C])),
                    (replace(u, D=[[[2 * x for x in M[0]]] for M in u.D]), rate)):  # fmt: skip
        assert not prove(replace(claim, outputs=outputs)).proved
    held = tuple(tuple(tuple(2 * x for x in row) for row in M) for M in claim.held)
    assert not prove(replace(claim, held=held)).proved
    with pytest.raises(FormatError, match="held"):
        prove(replace(claim, held=tuple((*M, *M) for M in claim.held)))


def document(claim):
    samples = at_sample_time(pendulum(), T, delay=1)
    known = claim_of_samples(samples)
    return Document(file_plant(samples), claim.subject.law, (claim, known), "box")


def test_it_is_read_back_from_a_file_and_proved_from_that_alone():
    bound = best_bound(late(), LAW, Saturation("rate of u", points=[(1.0, 0, 0)]))
    whole = document(bound.claim)
    again = loads(whole.dumps())
    assert check(again).proved
    said = check(again).claims[0]
    assert "'rate of u' = -50 x3 + 50 u1 saturated at +-" in said
    assert "by what acts in place of u1: the loop comes to rest" in said


def test_another_signal_by_this_name_is_refused():
    bound = best_bound(late(), LAW, Saturation("rate of u", points=[(1.0, 0, 0)]))
    (rate,) = bound.claim.outputs
    half = {key: [[[x / 2 for x in M[0]]] for M in getattr(rate, key)] for key in "CD"}
    other = replace(bound.claim, outputs=(replace(rate, **half),), level=bound.claim.level / 2)
    assert prove(other).proved
    answer = check(loads(document(other).dumps()))
    assert "the output called 'rate of u' is another of the plant's" in answer.reason
    assert not answer.proved


# --- as signals, and questions that are none ------------------------------------------------------


def test_what_a_rate_is():
    driven = with_actuator(pendulum(), "u", 5)
    rate, w = driven.signal("rate of u"), -driven.vertices[0].exact_A[2][2]
    assert (rate.unit, rate.C, rate.D) == ("Nm/s", ((0, 0, -w),), ((w,),))
    rate = late().signal("rate of u")
    assert (rate.unit, rate.C, rate.D) == ("Nm/s", ((0, 0, -50),), ((50,),))
    assert at_sample_time(pendulum(), T, delay=1).signal("rate of u") == rate
    assert pendulum().signal("rate of v").unit == "rad/s2"
    assert pendulum().signal("rate of x").C == ((0, 1),)


@pytest.mark.parametrize("delay", [1, 2])
def test_the_peak_of_a_rate_is_that_of_its_samples(delay):
    plant = delta_form(at_sample_time(pendulum(), T, delay))
    K = np.array([[-20.0, -7.0, *[-0.3] * delay]])
    start = (1.0, 0.0, *[0.0] * delay)
    bound = best_bound(plant, FixedGain(K), InitialPeak("rate of u", points=[start]))
    largest = 0.0
    for m, g in CORNERS:
        both = expm(np.array([[0, 1, 0], [g, 0, 1 / m], [0, 0, 0]]) * T)
        x, waiting = np.array([1.0, 0.0]), [0.0] * delay
        for _ in range(300):
            u = float(K[0] @ (*x, *waiting))
            largest = max(largest, abs(u - waiting[0]) / T)
            x = both[:2, :2] @ x + both[:2, 2] * waiting[-1]
            waiting = [u, *waiting[:-1]]
    assert largest * (1 - 1e-9) < bound.level < 1.1 * largest


@pytest.mark.parametrize("kind", [Rms, EnergyPeak, Gain])
def test_rates_are_bounded_as_any_signal_is(kind):
    plain, slow = (best_bound(late(), LAW, kind(name)) for name in ("u", "rate of u"))
    assert slow.level > plain.level
    driven = with_actuator(pendulum(), "u", 5)
    law = FixedGain(np.array([[-40.0, -14.0, -0.3]]))
    bound = best_bound(driven, law, kind("rate of u"))
    alpha = np.eye(4)
    values = kind("rate of u").values(driven, law, alpha)
    assert values.max() * (1 - 1e-9) <= bound.level < 1.05 * values.max()


@pytest.mark.parametrize(
    ("plant", "name", "says"),
    [
        (pendulum, "rate of u", r'u moves at once; give it \[actuator."u"\], or a sample time'),
        (lambda: at_sample_time(pendulum(), T), "rate of u", "take a delay of 1 sample"),
        (late, "rate of x", "between its samples x is known only near"),
        (late, "rate of y", "no signal 'rate of y'"),
    ],
)
def test_rates_that_are_none(plant, name, says):
    with pytest.raises(InputError, match=says):
        plant().signal(name)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (lambda: Saturation("u", points=[(1.0,)], limits=(1.0, 2.0)), "2 numbers for 1 signals"),
        (lambda: Saturation("u", points=[(1.0,)], limits=(0.0,)), "must be numbers from"),
        (lambda: Saturation("u", points=[(1.0,)], limits=(np.inf,)), "must be numbers from"),
        (
            lambda: Saturation("rate of v", points=[(1.0, 0)]).require_fit(pendulum()),
            "a disturbance passes straight into it",
        ),
        (
            lambda: Saturation("rate of x", points=[(1.0, 0)]).require_fit(pendulum()),
            "'rate of x': none of u moves it directly",
        ),
    ],
)
def test_questions_that_are_none(asked, says):
    with pytest.raises(InputError, match=says):
        asked()


def test_limits_are_read_from_a_line():
    asked = parse_specification(
        "saturation of [u, rate of u] <= 1 with limits [20, 200] with norm 2"
    )
    assert asked.limits == (20.0, 200.0)
    assert asked.title == "saturation of [u, rate of u] at [20, 200]"


def test_shares_of_limits_are_of_signals_with_names_of_their_own():
    limits = Saturation(("u", "rate of u"), limits=(20.0, 200.0), points=[(1.0, 0, 0)])
    plant = late()
    names = [signal.name for signal in limits.signals(plant)]
    assert names == list(limits.entries)
    shares = [signal.name for signal in limits.outputs(plant)]
    assert shares == ["u over 20 Nm", "rate of u over 200 Nm/s"]
