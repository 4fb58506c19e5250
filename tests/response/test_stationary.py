"""Stationary answers against scipy, an integral over frequency, a simulated drive, and figures."""

import math
from importlib import import_module

import numpy as np
import pytest
import scipy.linalg
import scipy.stats
from scipy.integrate import trapezoid

from polefence import InputError, UncertainPlant
from polefence.plant.outputs import Output, rate_of
from polefence.response.closed import close
from polefence.response.discrete import zero_order_hold
from polefence.response.linear import frequency, simulate
from polefence.response.stationary import (
    covariance,
    lyapunov,
    needed,
    stationary,
    unstable,
    velocity_psd,
)
from polefence.vehicle.vehicle import ride

ROAD = velocity_psd(256e-6, 20)  # class C at 20 m/s


@pytest.fixture(scope="module")
def points():
    a = np.linspace(0, 1, 4)
    a, b = (x.ravel() for x in np.meshgrid(a, a))
    return np.stack([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b], axis=1)


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_covariances_are_those_of_scipy(n, monkeypatch):
    random = np.random.default_rng(n)
    A = random.normal(size=(7, n, n))
    A -= (1 + np.linalg.eigvals(A).real.max(axis=1))[:, None, None] * np.eye(n)
    units = 10.0 ** random.uniform(-4, 4, n)
    E, psd = random.normal(size=(7, n, 2)), np.array([0.3, 2.0])
    module = import_module("polefence.response.stationary")  # the package has the function
    monkeypatch.setattr(module, "BUFFER", 3000)  # in several parts
    # Ours in states of units far apart, scipy's in even ones: its answer suffers from them.
    X = covariance(A * units[:, None] / units, E * units[:, None], psd)
    assert np.array_equal(X, X.swapaxes(1, 2))
    X = X / (units[:, None] * units)
    for own, a, e in zip(X, A, E, strict=True):
        Q = e @ np.diag(psd / 2) @ e.T
        theirs = scipy.linalg.solve_continuous_lyapunov(a, -Q)
        size = np.sqrt(np.outer(np.diag(theirs), np.diag(theirs)))
        assert np.abs((own - theirs) / size).max() < 1e-9
        assert np.abs(a @ own + own @ a.T + Q).max() < 1e-10 * np.abs(Q).max()
    assert lyapunov(np.zeros((0, 2, 2)), np.zeros((0, 2, 2))).shape == (0, 2, 2)


def test_the_figures_of_the_passive_car(physical, points):
    found = stationary(physical, None, points, ROAD, ride(physical).signals)
    comfort, tyre = found.of("sprung-mass acceleration"), found.of("tyre deflection")
    assert np.round([comfort.min(), comfort.max()], 2).tolist() == [0.77, 1.36]
    assert np.round([1e3 * tyre.min(), 1e3 * tyre.max()], 2).tolist() == [4.10, 4.72]
    assert not np.any(found.of("actuator force"))
    assert found.rms.shape == (16, 6)
    # Twice the speed is twice the density.
    fast = stationary(physical, None, points, velocity_psd(256e-6, 40), ride(physical).signals)
    assert np.allclose(fast.rms, math.sqrt(2) * found.rms, rtol=1e-12)


def test_known_in_closed_form():
    """x' = -a x + w: variance S / (2 a) with two-sided S = psd / 2."""
    plant = UncertainPlant.from_vertices([[[-1]], [[-4]]], [[[1]]] * 2, [[[1]], [[3]]])
    found = stationary(plant, None, np.eye(2), 0.8, "x1")
    assert np.allclose(found.rms[:, 0], [math.sqrt(0.2), math.sqrt(9 * 0.4 / 8)], rtol=1e-14)


@pytest.mark.parametrize("law", ["none", "scheduled"])
def test_rms_is_the_integral_over_frequency(law, as_printed, placed, points):
    some = points[::5]
    signals = ride(as_printed).signals
    chosen = None if law == "none" else placed
    found = stationary(as_printed, chosen, some, ROAD, signals)
    # Trapezia over log f, refined; the rest below and above falls off as 1/f^2 or faster.
    f = np.geomspace(1e-5, 1e6, 40_001)
    gain = frequency(as_printed, chosen, some, f, signals).gain[..., 0]
    power = trapezoid(np.abs(gain) ** 2 * ROAD * f[:, None], np.log(f), axis=1)
    assert np.allclose(np.sqrt(power), found.rms, rtol=2e-5)


def test_a_long_drive_has_the_stationary_rms(physical, points):
    """Mean squares of stretches of a drive scatter about the stationary value as they should."""
    some, step, stretch, count = points[[0, 6, 15]], 2e-3, 5000, 60
    signals = ride(physical).signals
    exact = stationary(physical, None, some, ROAD, signals).rms[:, [0, 1, 2, 3, 5]] ** 2
    # White noise of one-sided density G, held over steps, has the variance G / (2 step).
    random = np.random.default_rng(7)
    w = random.normal(scale=math.sqrt(ROAD / (2 * step)), size=(count + 1) * stretch)
    drive = simulate(physical, None, some, w, step * np.arange(len(w)), signals, hold="held")
    squares = drive.values[:, stretch:, [0, 1, 2, 3, 5]] ** 2  # at rest at first
    means = squares.reshape(len(some), count, stretch, -1).mean(axis=2)
    margin = scipy.stats.t.ppf(0.9995, count - 1) * means.std(axis=1, ddof=1) / math.sqrt(count)
    assert np.all(np.abs(means.mean(axis=1) - exact) < margin)
    assert np.all(margin < 0.3 * exact)  # tells a one-sided density from a two-sided one
    assert np.allclose(drive.rms(stretch * step)[:, :4] ** 2, means.mean(axis=1)[:, :4], rtol=1e-9)


def test_the_held_drive_has_a_covariance_of_its_own_that_tends_to_this_one(physical, points):
    """Without chance: X = Phi X Phi' + Gamma Gamma' G / (2 h) tends to the answer as h falls."""
    loops = close(physical, None, points[:3])
    A, E = loops.closed[:, :4, :4], loops.E[:, :4]
    X = covariance(A, E, ROAD)
    errors = []
    for h in (4e-3, 2e-3):
        Phi, Gamma = zero_order_hold(A, E, h)
        for own, phi, gamma in zip(X[:1], Phi, Gamma, strict=False):
            theirs = scipy.linalg.solve_discrete_lyapunov(phi, gamma @ gamma.T * ROAD / (2 * h))
            errors.append(np.abs(np.diag(theirs) / np.diag(own) - 1).max())
    assert errors[1] < 0.01
    assert 3 < errors[0] / errors[1] < 5  # second order


def test_states_that_no_signal_depends_on_are_dropped(physical, points):
    loops = close(physical, None, points)
    C = np.zeros((len(points), 1, 5))
    C[:, 0, 2] = 1
    assert needed(C, loops.closed).tolist() == [0, 1, 2, 3]
    C[:, 0, 4] = 1
    assert needed(C, loops.closed).tolist() == [0, 1, 2, 3, 4]
    assert needed(np.zeros_like(C), loops.closed).tolist() == []
    chain = np.zeros((1, 4, 4))
    chain[0, [0, 1, 2], [1, 2, 3]] = 1
    assert needed(np.array([[[1.0, 0, 0, 0]]]), chain).tolist() == [0, 1, 2, 3]
    assert needed(np.array([[[0, 0, 1.0, 0]]]), chain).tolist() == [2, 3]
    # A signal that depends on nothing is zero, whatever the loop does.
    none = stationary(physical, None, points, ROAD, "actuator force")
    assert not np.any(none.rms)


def test_an_unstable_loop_is_named_with_its_parameters(physical, points):
    with pytest.raises(InputError) as error:
        stationary(physical, None, points, ROAD)
    assert str(error.value) == (
        "quarter car, physical has a pole at 0 1/s at m1 = 231.12 kg, beta = -10, so nothing there "
        "is stationary; leave out 'integral of suspension deflection', or give a law that "
        "stabilises what they depend on"
    )
    push = [[0, 0, 1000.0, 0, 0]]
    with pytest.raises(InputError, match=r"pole at .* \+- .*j 1/s at m1 = .*; close it with a law"):
        stationary(physical, push, points, ROAD, ride(physical).signals)


def test_only_the_point_at_fault_is_named():
    plant = UncertainPlant.from_vertices([[[-1]], [[1]]], [[[1]]] * 2, [[[1]]] * 2, name="mine")
    assert stationary(plant, None, [0.6, 0.4], 1.0).rms.shape == (1, 2)
    with pytest.raises(InputError, match=r"mine has a pole at 0\.2 1/s at alpha = \[0\.4, 0\.6\]"):
        stationary(plant, None, [[0.6, 0.4], [0.4, 0.6]], 1.0)
    # On the edge there is nothing stationary either.
    with pytest.raises(InputError, match="pole at"):
        stationary(plant, None, [0.5, 0.5], 1.0)
    assert unstable(np.array([[[-1e-3]], [[0.0]], [[1e-3]]])).tolist() == [1, 2]


def test_white_noise_itself_has_no_rms(physical, points):
    tyre = rate_of(physical, "tyre deflection", "tyre rate")
    with pytest.raises(InputError, match="'tyre rate' follows the white disturbance itself"):
        stationary(physical, None, points, ROAD, [tyre])
    # A disturbance of density zero is none.
    stationary(physical, None, points, 0.0, [tyre])


def test_several_independent_disturbances_add_their_squares():
    E = [[1, 2], [0.5, -1]]
    plant = UncertainPlant.from_vertices([[[-1, 0.2], [0, -3]]], [[[1], [0]]], [E])
    sum_of = Output("sum", C=[1, 1])
    one, other, both = (
        stationary(plant, None, [1.0], psd, sum_of).rms[0, 0]
        for psd in ([0.3, 0.0], [0.0, 0.7], [0.3, 0.7])
    )
    assert both == pytest.approx(math.hypot(one, other), rel=1e-12)
    assert np.allclose(stationary(plant, None, [1.0], 0.5).psd, [0.5, 0.5])


@pytest.mark.parametrize("psd", [-1.0, math.nan, [1.0, 2.0], "C", None])
def test_wrong_densities_are_refused(psd, physical, points):
    with pytest.raises(InputError, match="psd"):
        stationary(physical, None, points, psd, ride(physical).signals)


def test_density_of_a_roads_velocity():
    assert velocity_psd(256e-6, 20) == pytest.approx((2 * math.pi * 0.1) ** 2 * 256e-6 * 20)
    # Of displacement at n = f / v, turned into velocity by (2 pi f)^2: white.
    for f in (0.5, 3.0, 40.0):
        n = f / 20
        displacement = 256e-6 * (n / 0.1) ** -2 / 20  # per Hz
        assert (2 * math.pi * f) ** 2 * displacement == pytest.approx(velocity_psd(256e-6, 20))
    for wrong in ((0, 20), (256e-6, 0), (256e-6, -1), (math.nan, 20)):
        with pytest.raises(InputError, match=r"speed|roughness"):
            velocity_psd(*wrong)
