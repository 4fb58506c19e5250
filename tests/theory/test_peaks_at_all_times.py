"""Peaks at all times of a sampled loop: against sums of impulse responses, by scipy alone.

From rest |z(t)| is at most e (int |h(t, s)|^2 ds)^(1/2) for disturbances of norm e, h the response
at t to an impulse at s, and as large for the worst of them.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    Disk,
    EnergyPeak,
    FixedGain,
    PolynomialGain,
    analyse,
    at_sample_time,
)
from polefence.certify import bounds
from polefence.certify.bounds import best_bound, kept_bound
from polefence.plant.delta import delta_form
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import loads as read
from polefence.response.modes import Modes
from support.specs import SPRING

K = np.array([[-30.0, -12.0]])
LATE = np.array([[-30.0, -12.0, -0.2]])
NORM = 2.0
PARTS = 40  # of a period, at which impulses act and the signal is looked at


def truth(plant, alpha, K, T, row, delay):
    """The largest root of the integral of squared impulse responses, and that at samples."""
    A, B = plant.at(alpha)
    E = np.tensordot(alpha, np.stack([v.E for v in plant.vertices]), 1)
    n, q, h = len(A), E.shape[1], T / PARTS
    N = np.zeros((n + 2, n + 2))
    N[:n, :n], N[:n, n : n + 1] = A, B
    step = expm(N * h)  # of [x; the input that acts; the last demand]
    y, squares = np.zeros((n + 2, PARTS + 1, q)), np.zeros(PARTS)
    weight = np.full(PARTS + 1, h)
    weight[[0, -1]] = h / 2
    change = {0: 0, 0.5: PARTS // 2, 1: PARTS}[delay]  # where a demand goes out
    for k in range(400 * PARTS):
        now = k % PARTS
        if k:
            y = np.tensordot(step, y, 1)
        if 0 < k <= PARTS:  # the last just before the sample, the first just after it
            y[:n, k] += E
        if now == change % PARTS and delay == 1:
            y[n] = y[n + 1]
        if now == 0:  # of late inputs the last demand is a state
            s = y[:n] if delay == 0 else np.concatenate([y[:n], y[n + 1 :]])
            y[n + 1] = np.tensordot(K[0], s, 1)
        if now == change and delay < 1:
            y[n] = y[n + 1]
        more = (np.tensordot(row, y[:n], 1) ** 2).sum(axis=1) * weight
        if k < PARTS:  # what came before is seen
            more[k] /= 2
        squares[now] += more.sum()
        if not k:
            y[:n, 0] += E
        if k > 2 * PARTS and now == 0 and np.abs(y).max() < 1e-4 * np.abs(E).max():
            break
    return squares.max() ** 0.5, squares[0] ** 0.5


@pytest.fixture(scope="module")
def spring():
    return loads(SPRING)


def random_plant(seed):
    """Three states, an input and two disturbances, with a parameter; a gain; both stable."""
    dice = np.random.default_rng(seed)
    A, change = dice.normal(size=(3, 3)), 0.2 * dice.normal(size=(3, 3))
    A -= (np.linalg.eigvals(A).real.max() + 3.0) * np.eye(3)
    B, E = dice.normal(size=(3, 1)), dice.normal(size=(3, 2))
    rows = [[f"{A[i, j]} + {change[i, j]} * p" for j in range(3)] for i in range(3)]
    spec = {"A": rows, "B": B.tolist(), "E": E.tolist()}
    matrices = "\n".join(f"{key} = {json.dumps(M)}" for key, M in spec.items())
    plant = loads(
        'states = ["a", "b", "c"]\ninputs = ["u"]\ndisturbances = ["w", "v"]\n'
        f"[parameter.p]\nrange = [-1, 1]\n[matrices]\n{matrices}\n"
    )
    return plant, 0.2 * dice.normal(size=(1, 3))


@pytest.mark.parametrize(("T", "delay"), [(0.02, 0), (0.02, 0.5), (0.02, 1), (0.1, 0)])
def test_a_spring_is_bounded_just_above_the_truth(spring, T, delay):
    plant, own = at_sample_time(spring, T, delay), EnergyPeak("x", norm=NORM)
    law = FixedGain(LATE if delay else K)
    alpha = np.eye(4)
    exact = [truth(spring, at, law.K, T, np.array([1.0, 0.0]), delay) for at in alpha]
    worst = NORM * max(most for most, _ in exact)
    assert own.values(plant, law, alpha).max() == pytest.approx(worst, rel=1e-3)
    bound = best_bound(plant, law, own)
    assert bound.claim.held is not None
    assert worst * (1 - 1e-3) <= bound.level <= 1.01 * worst
    assert own.values(plant, law, seeded(plant, 10_000)).max() <= bound.level
    assert bound.claim.time_text == f", at all times, with inputs held for {1000 * T:g} ms"


@pytest.mark.parametrize("seed", range(3))
def test_random_plants_are_bounded_on_either_side_of_a_limit(seed):
    plant, gain = random_plant(seed)
    T, row = (0.05, 0.2)[seed % 2], np.eye(3)[seed % 3]
    samples, law = at_sample_time(plant, T), FixedGain(gain)
    own = EnergyPeak("abc"[seed % 3])
    shares = (0.0, 0.5, 1.0)
    worst = max(truth(plant, np.array([1 - a, a]), gain, T, row, 0)[0] for a in shares)
    bound = best_bound(samples, law, own)
    assert bound.claim.held is not None
    assert worst * (1 - 1e-3) <= bound.level <= 1.01 * worst
    assert kept_bound(samples, law, replace(own, at_most=1.01 * worst)) is not None
    assert kept_bound(samples, law, replace(own, at_most=0.998 * worst)) is None


def test_a_short_period_is_nearly_continuous_time(spring):
    own, law = EnergyPeak("x"), FixedGain(K)
    continuous = own.values(spring, law, np.eye(4)).max()
    far, near = (own.values(at_sample_time(spring, T), law, np.eye(4)).max() for T in (1e-3, 1e-4))
    assert 0 < near / continuous - 1 < 0.3 * (far / continuous - 1) < 0.01


@pytest.mark.parametrize("delay", [0, 0.5])
@pytest.mark.parametrize("signal", ["x", "v", "f"])
def test_slopes_are_those_of_differences(spring, delay, signal):
    plant, own = delta_form(at_sample_time(spring, 0.05, delay)), EnergyPeak(signal, norm=NORM)
    alpha = seeded(plant, 6)
    channel, gain = own.channel(plant, alpha), (LATE if delay else K)

    def found(gain):
        gains = np.broadcast_to(gain, (len(alpha), *gain.shape))
        loop = channel.A + channel.B @ gains
        return own.slopes(channel.closed(gains, Modes(loop, float(plant.step))))

    here = found(gain)
    slopes = channel.slopes(here)
    for i in range(gain.shape[1]):
        moved = 1e-4 * np.eye(gain.shape[1])[[i]]
        up, down = found(gain + moved), found(gain - moved)
        np.testing.assert_array_equal(up.points, here.points)
        differences = (up.values - down.values) / 2e-4
        np.testing.assert_allclose(slopes[:, 0, i], differences, rtol=1e-5, atol=1e-9)


def test_a_law_polynomial_in_the_parameters_and_a_file(spring, tmp_path):
    plant, own = at_sample_time(spring, 0.05, 1), EnergyPeak("x", norm=NORM)
    measured = tuple(plant.signal(name) for name in ("x", "v"))
    law = PolynomialGain(
        ((0, 0), (1, 0)), [[[-20.0, -8.0]], [[3.0, 1.0]]], measured, plant.parameters
    )
    bound = best_bound(plant, law, own)
    worst = own.values(plant, law, seeded(plant, 2000)).max()
    assert worst <= bound.level <= 1.01 * worst
    certificate = analyse(plant, law, Disk(0.0, 1.0)).design.certificate
    bounds.save(certificate, [bound.claim], tmp_path)
    document = read((tmp_path / "design.json").read_text())
    assert all(verdict.proved for verdict in map(prove, document.claims))
    assert bound.claim in document.claims


def test_between_samples_there_is_more(spring):
    plant, own, law = at_sample_time(spring, 0.1), EnergyPeak("x", norm=NORM), FixedGain(K)
    all_times, samples = own.values(plant, law, np.eye(4)), own.at_samples(plant, law, np.eye(4))
    assert np.all(all_times > 1.05 * samples)
    assert all_times[0] > 1.25 * samples[0]
