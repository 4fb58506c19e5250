"""Slopes of every kind of requirement, against central differences at random stable loops."""

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError
from polefence.plant.outputs import Output
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.gain_norm import GainNorm
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.saturation import Saturation
from polefence.requirements.text import KINDS
from polefence.response.modes import Modes

n, m, q = 4, 2, 2
ALPHA = np.array([[1, 0], [0, 1], [0.3, 0.7]])


def made(seed):
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.8) * np.eye(n)
    As = [A, A + 0.1 * random.normal(size=(n, n))]
    B, E = random.normal(size=(n, m)), [random.normal(size=(n, q)) for _ in range(2)]
    plant = pf.UncertainPlant.from_vertices(As, [B, B], E)
    signals = [
        Output(f"z{k}", "", C=random.normal(size=n), D=random.normal(size=m)) for k in range(2)
    ]
    return plant, signals, 0.1 * random.normal(size=(m, n)), random


def requirements(seed):
    plant, (y, z), K, random = made(seed)
    direct = Output("d", "", C=random.normal(size=n), F=random.normal(size=q))
    half = random.normal(size=(n, n))
    X0 = half @ half.T
    points = tuple(map(tuple, random.normal(size=(2, n))))
    each = [
        Rms([y, z], density=3.0),
        RelativeRms(y),
        EnergyPeak(y, norm=2.0, disturbances={"w1": 0.5}),
        Gain(z),
        Gain([y, direct]),
        Gain([y, direct], band=(0.05, 0.12)),
        Gain(z, band=(0.3, 2)),
        GainNorm(rows=(1.0, 2.0), columns=(1.0, 2.0, 3.0, 4.0)),
        InitialPeak(z, impulse=2.0, points=points),
        InitialPeak(z, ellipsoid=tuple(map(tuple, (X0 + X0.T) / 2))),
    ]
    return plant, K, random, each


def evaluated(own, channel, K):
    each = np.broadcast_to(K, (len(channel.A), *K.shape))
    found = own.slopes(channel.closed(each, Modes(channel.A + channel.B @ each)))
    return found, channel.slopes(found)


def test_every_kind_that_laws_are_tuned_for_has_slopes():
    plant, K, _, each = requirements(0)
    # those of opened loops have tests of their own: of gains this small margins' peaks are flat
    opened = {kind for kind, own in KINDS.items() if own.is_margin} | {"worst-case gain"}
    # so have responses, in tests/requirements: test_step.py, test_free.py, test_bump.py and others
    opened |= {"step", "initial", "impulse", "bump", "peak to peak"}
    assert {own.kind for own in each} == set(KINDS) - {"saturation"} - opened
    own = Saturation("u1", points=((1.0, 0.0, 0.0, 0.0),))
    channel = own.channel(plant, ALPHA)
    with pytest.raises(InputError, match="a saturated input has no slopes"):
        evaluated(own, channel, K)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("k", range(10))
def test_slopes_are_those_of_central_differences(k, seed):
    plant, K, random, each = requirements(seed)
    channel = each[k].channel(plant, ALPHA).in_units(np.array([1.0, 2.0, 0.5, 4.0]))
    found, slopes = evaluated(each[k], channel, K)
    for _ in range(4):
        step, size = random.normal(size=K.shape), 1e-5
        ahead, back = (evaluated(each[k], channel, K + s * size * step)[0] for s in (1, -1))
        assert len(ahead.values) == len(found.values) == len(back.values)
        difference = (ahead.values - back.values) / (2 * size)
        along = (slopes * step).sum(axis=(1, 2))
        assert np.abs(difference - along).max() <= 1e-5 * np.abs(slopes).max()


@pytest.mark.parametrize("k", range(10))
def test_slopes_of_what_passes_through_a_law_are_those_of_central_differences(k):
    plant, K, random, each = requirements(1)
    channel = each[k].channel(plant, ALPHA).in_units(np.array([1.0, 2.0, 0.5, 4.0]))
    acts = each[k].kind != "gain norm" and getattr(each[k], "impulse", 1.0) > 0
    modes = Modes(channel.A + channel.B @ np.broadcast_to(K, (len(ALPHA), *K.shape)))
    through = random.normal(size=(len(ALPHA), len(K), plant.disturbance_count))

    def values(P):
        return each[k].slopes(channel.closed(K[None], modes, P)).values

    found = each[k].slopes(channel.closed(K[None], modes, through))
    if channel.S is None:
        assert np.array_equal(values(through), values(0 * through))
        return
    slopes = channel.passing_slopes(found)
    assert acts == bool(np.any(slopes))
    for _ in range(4):
        step, size = random.normal(size=through.shape), 1e-5
        difference = (values(through + size * step) - values(through - size * step)) / (2 * size)
        along = (slopes * step[found.points]).sum(axis=(1, 2))
        assert np.abs(difference - along).max() <= 1e-5 * max(np.abs(slopes).max(), 1.0)


@pytest.mark.parametrize("k", range(10))
def test_the_worst_of_the_rows_is_the_value(k):
    plant, K, _, each = requirements(5)
    found, _ = evaluated(each[k], each[k].channel(plant, ALPHA), K)
    best = np.zeros(len(ALPHA))
    np.maximum.at(best, found.points, found.values)
    known = each[k].values(plant, pf.FixedGain(K), ALPHA)
    # a peak is sampled there: this is never lower
    assert np.all(best >= known * (1 - 1e-9))
    assert np.all(best <= known * (1.03 if each[k].kind == "initial peak" else 1 + 1e-4))


def test_units_of_states_change_nothing():
    plant, K, _, each = requirements(2)
    d = np.array([10.0, 0.1, 3.0, 1.0])
    for own in each:
        channel = own.channel(plant, ALPHA)
        plain, slopes = evaluated(own, channel, K)
        scaled, others = evaluated(own, channel.in_units(d), K * d)
        assert scaled.values == pytest.approx(plain.values, rel=1e-7)
        assert others * d == pytest.approx(slopes, rel=1e-5, abs=1e-7 * np.abs(slopes).max())


def test_two_equal_peaks_are_two_rows():
    # two resonances far apart, of one height
    def second(w):
        return np.array([[0, 1], [-w * w, -0.1 * w]])

    A = np.block([[second(1.0), np.zeros((2, 2))], [np.zeros((2, 2)), second(10.0)]])
    E = np.array([[0.0], [1.0], [0.0], [100.0]])
    plant = pf.UncertainPlant.from_vertices([A], [np.ones((4, 1))], [E])
    own = Gain(Output("sum", "", C=[1, 0, 1, 0]))
    found, _ = evaluated(own, own.channel(plant, np.ones((1, 1))), np.zeros((1, 4)))
    assert len(found.values) == 2
    assert found.values == pytest.approx([10, 10], rel=0.03)


def test_a_narrow_peak_between_the_points_of_any_grid_is_found():
    w = 3.7
    A = np.array([[0, 1, 0], [-w * w, -2e-6 * w, 0], [0, 0, -1.0]])
    plant = pf.UncertainPlant.from_vertices([A], [np.ones((3, 1))], [[[0.0], [1.0], [1.0]]])
    own = Gain(Output("y", "", C=[1, 0, 1]))
    found, _ = evaluated(own, own.channel(plant, np.ones((1, 1))), np.zeros((1, 3)))
    assert found.values.max() == pytest.approx(1 / (2e-6 * w * w), rel=1e-5)


def test_lyapunov_equations_hold_without_eigenvectors_too():
    A = np.array([[[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -1.0]]])  # one Jordan block
    W = np.eye(3)[None]
    own = Modes(A)
    X, Q = own.lyapunov(W), own.observed(W)
    At = np.swapaxes(A, 1, 2)
    assert np.abs(A @ X + X @ At + W).max() < 1e-12
    assert np.abs(At @ Q + Q @ A + W).max() < 1e-12
