"""Peaks from initial states of a sampled loop, at all times: against exponentials, by scipy."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov

from polefence import (
    Disk,
    FixedGain,
    InitialPeak,
    PolynomialGain,
    analyse,
    at_sample_time,
)
from polefence.base.errors import InputError
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
PARTS = 40  # of a period, at which the signal is looked at


def motion(plant, alpha, K, T, delay):
    """What [x; the demand before] is at PARTS of a period, and at the next sample."""
    A, B = plant.at(alpha)
    n, late = len(A), int(delay > 0)
    N = np.zeros((n + 1, n + 1))
    N[:n, :n], N[:n, n:] = A, B
    step, change = expm(N * T / PARTS), round(PARTS * delay)
    now, s = K, np.eye(n + late)
    y = np.vstack([s[:n], s[n:] if late else now])
    seen = [y[:n]]
    for k in range(PARTS):
        if k == change and late:
            y = np.vstack([y[:n], now])
        y = step @ y
        seen.append(y[:n])
    return np.stack(seen), np.vstack([y[:n], now]) if late else y[:n]


def truth(plant, alpha, K, T, row, delay, begin):
    """The largest |row x| from columns of ``begin``, or the largest root of sums over them."""
    seen, M = motion(plant, alpha, K, T, delay)
    x, largest, root = begin, 0.0, 0.0
    for _ in range(20_000):
        y = np.tensordot(row, seen, (0, 1)) @ x
        largest = max(largest, float(np.abs(y).max()))
        root = max(root, float((y**2).sum(axis=1).max() ** 0.5))
        x = M @ x
        if np.abs(x).max() < 1e-5 * np.abs(begin).max():
            break
    return largest, root


@pytest.fixture(scope="module")
def spring():
    return loads(SPRING)


@pytest.mark.parametrize(
    ("T", "delay"), [(0.002, 0), (0.002, 0.5), (0.02, 0), (0.02, 0.5), (0.02, 1), (0.1, 0)]
)
def test_a_spring_is_bounded_just_above_the_truth(spring, T, delay):
    plant, law = at_sample_time(spring, T, delay), FixedGain(LATE if delay else K)
    n, row = plant.shape[0], np.array([1.0, 0.0])
    X0 = np.diag([1.0, 100.0, 0.0][:n])
    both = InitialPeak("x", points=(tuple(np.eye(n)[0]),)), InitialPeak("x", ellipsoid=X0.tolist())
    for own, begin, k in ((both[0], np.eye(n)[:, :1], 0), (both[1], X0**0.5, 1)):
        worst = max(truth(spring, at, law.K, T, row, delay, begin)[k] for at in np.eye(4))
        assert own.values(plant, law, np.eye(4)).max() == pytest.approx(worst, rel=1e-3)
        bound = best_bound(plant, law, own)
        assert bound.claim.held is not None
        assert worst * (1 - 1e-6) <= bound.level <= 1.015 * worst
        assert own.values(plant, law, seeded(plant, 1000)).max() <= bound.level
        assert f", at all times, with inputs held for {1000 * T:g} ms" in bound.claim.time_text


def random_plant(seed):
    """Three states and an input, with a parameter; a gain; both stable."""
    dice = np.random.default_rng(seed)
    A, change = dice.normal(size=(3, 3)), 0.1 * dice.normal(size=(3, 3))
    A -= (np.linalg.eigvals(A).real.max() + 2.0) * np.eye(3)
    rows = [[f"{A[i, j]} + {change[i, j]} * p" for j in range(3)] for i in range(3)]
    spec = {"A": rows, "B": dice.normal(size=(3, 1)).tolist(), "E": [[1], [0], [0]]}
    matrices = "\n".join(f"{key} = {json.dumps(M)}" for key, M in spec.items())
    plant = loads(
        'states = ["a", "b", "c"]\ninputs = ["u"]\ndisturbances = ["w"]\n'
        f"[parameter.p]\nrange = [-1, 1]\n[matrices]\n{matrices}\n"
    )
    return plant, 0.2 * dice.normal(size=(1, 3))


@pytest.mark.parametrize("seed", range(4))
def test_random_plants_are_bounded_on_either_side_of_a_limit(seed):
    """From an ellipsoid that no motion leaves, of which what ellipsoids prove is the truth."""
    plant, gain = random_plant(seed)
    T, row = (0.05, 0.3)[seed % 2], np.eye(3)[seed % 3]
    samples, law = at_sample_time(plant, T), FixedGain(gain)
    M = motion(plant, np.array([0.5, 0.5]), gain, T, 0)[1]
    X0 = solve_discrete_lyapunov(M, np.eye(3))
    X0 = np.round((X0 + X0.T) / 2, 9)
    own = InitialPeak("abc"[seed % 3], ellipsoid=X0.tolist())
    begin = np.linalg.cholesky(X0)
    ends = (np.array([1 - a, a]) for a in (0.0, 0.5, 1.0))
    worst = max(truth(plant, at, gain, T, row, 0, begin)[1] for at in ends)
    bound = best_bound(samples, law, own)
    assert bound.claim.held is not None
    assert worst * (1 - 1e-6) <= bound.level <= 1.01 * worst
    assert kept_bound(samples, law, replace(own, at_most=1.01 * worst)) is not None
    assert kept_bound(samples, law, replace(own, at_most=0.998 * worst)) is None


@pytest.mark.parametrize("seed", range(4))
def test_random_plants_from_points_never_exceed_a_bound(seed):
    plant, gain = random_plant(10 + seed)
    T, row = (0.3, 0.05)[seed % 2], np.eye(3)[seed % 3]
    points = np.random.default_rng(seed).normal(size=(3, 2))
    own = InitialPeak("abc"[seed % 3], points=tuple(map(tuple, points.T)))
    bound = best_bound(at_sample_time(plant, T), FixedGain(gain), own)
    ends = (np.array([1 - a, a]) for a in (0.0, 0.25, 0.5, 0.75, 1.0))
    worst = max(truth(plant, at, gain, T, row, 0, points)[0] for at in ends)
    assert bound.claim.held is not None
    assert worst * (1 - 1e-6) <= bound.level <= 1.5 * worst  # ellipsoids lose more of points


@pytest.mark.parametrize("delay", [0, 0.5])
@pytest.mark.parametrize("signal", ["x", "v", "f"])
def test_slopes_are_those_of_differences(spring, delay, signal):
    plant = delta_form(at_sample_time(spring, 0.05, delay))
    n, alpha, gain = plant.shape[0], seeded(plant, 6), (LATE if delay else K)
    own = InitialPeak(signal, points=((0.1, 1.0, 2.0)[:n],), ellipsoid=np.eye(n).tolist())
    channel = own.channel(plant, alpha)

    def found(gain):
        gains = np.broadcast_to(gain, (len(alpha), *gain.shape))
        loop = channel.A + channel.B @ gains
        return own.slopes(channel.closed(gains, Modes(loop, float(plant.step))))

    here = found(gain)
    slopes = channel.slopes(here)
    for i in range(gain.shape[1]):
        moved = 1e-5 * np.eye(gain.shape[1])[[i]]
        up, down = found(gain + moved), found(gain - moved)
        np.testing.assert_array_equal(up.points, here.points)
        differences = (up.values - down.values) / 2e-5
        np.testing.assert_allclose(slopes[:, 0, i], differences, rtol=1e-5, atol=1e-9)


def test_a_law_polynomial_in_the_parameters_and_a_file(spring, tmp_path):
    plant, own = at_sample_time(spring, 0.05), InitialPeak("x", points=((1.0, 0.0),))
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
    plant, own = at_sample_time(spring, 0.1), InitialPeak("x", points=((0.0, 1.0),))
    law = FixedGain(K)
    all_times, samples = own.values(plant, law, np.eye(4)), own.at_samples(plant, law, np.eye(4))
    assert np.all(all_times >= samples * (1 - 1e-12))
    assert all_times.max() > 1.02 * samples.max()


def test_after_an_impulse_there_is_no_such_peak(spring):
    plant = at_sample_time(spring, 0.02)
    with pytest.raises(InputError, match="give that state as points"):
        best_bound(plant, FixedGain(K), InitialPeak("x", impulse=1.0))
