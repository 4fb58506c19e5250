"""Doses and comfort of records against closed forms and integrals done otherwise."""

import math
from importlib import import_module

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import trapezoid

from polefence.base.errors import InputError
from polefence.response.bands import RIDE, quadrature, stationary_ride
from polefence.response.stationary import velocity_density
from polefence.response.weighting import WE, WF, WK
from support.passive import car, gains

of = import_module("polefence.vehicle.comfort")  # the package has the function of that name


def test_a_seat_feels_rotations_too():
    time = np.arange(0, 40, 2e-3)
    heave, turn = np.sin(2 * np.pi * 4 * time), 3 * np.sin(2 * np.pi * time)
    alone = of.vibration_total(heave, 2e-3)
    assert alone == pytest.approx(of.comfort(heave, 2e-3).weighted_rms)
    both = of.vibration_total(heave, 2e-3, roll=turn, pitch=2 * turn)
    by_we = 3 / np.sqrt(2) * abs(WE.gain(1.0))  # of a sine, but for its beginning
    wanted = np.sqrt(alone**2 + by_we**2 * (0.63**2 + (2 * 0.4) ** 2))
    assert both == pytest.approx(wanted, rel=5e-3)
    less = of.vibration_total(heave, 2e-3, pitch=2 * turn)
    assert less == pytest.approx(np.sqrt(alone**2 + (0.8 * by_we) ** 2), rel=5e-3)


def test_doses_of_a_sine_in_closed_form():
    time = np.arange(0, 12 + 1e-9, 0.001)
    wave = 2 * np.sin(2 * np.pi * 3 * time)
    assert of.rms(wave) == pytest.approx(math.sqrt(2))
    assert of.vdv(wave, 0.001) == pytest.approx((3 / 8 * 2**4 * 12) ** 0.25)
    assert of.msdv(wave, 0.001) == pytest.approx(math.sqrt(2 * 12))
    running = of.running_rms(wave, 0.001)
    np.testing.assert_allclose(running[1001:], math.sqrt(2), rtol=1e-5)
    assert running[0] == 0
    assert (running[:1000] <= running[1000] + 1e-9).all()


@pytest.mark.parametrize("average", ["linear", "exponential"])
def test_running_rms_meets_its_integral(average):
    """Against quadrature of the standard's definition, at a window of no whole steps."""
    step, window = 0.01, 0.333
    record = np.random.default_rng(4).normal(size=200)
    time = step * np.arange(200)
    found = of.running_rms(record, step, window, average)
    for i in (20, 34, 120, 199):
        start = max(time[i] - window, 0) if average == "linear" else 0
        at = np.union1d(
            np.linspace(start, time[i], 40_001), time[(time > start) & (time < time[i])]
        )
        square = np.interp(at, time, record**2)
        fade = 1.0 if average == "linear" else np.exp((at - time[i]) / window)
        expected = math.sqrt(trapezoid(square * fade, at) / window)
        assert found[i] == pytest.approx(expected, rel=1e-6)
    assert of.mtvv(record, step) == of.running_rms(record, step).max()


def test_comfort_of_records():
    time = np.arange(0, 60, 0.004)
    steady = np.sin(2 * np.pi * 5 * time)
    shock = 0.01 * steady + 20 * np.exp(-(((time - 30) / 0.02) ** 2))
    heave = np.sin(2 * np.pi * 0.2 * time)
    found = of.comfort(np.stack([steady, shock, heave, 0 * time]), 0.004)
    wk5, wf2 = abs(WK.gain(5)), abs(WF.gain(0.2))
    assert found.duration == pytest.approx(60 - 0.004)
    assert found.weighted_rms[0] == pytest.approx(wk5 / math.sqrt(2), rel=5e-3)
    assert found.mtvv[0] == pytest.approx(wk5 / math.sqrt(2), rel=0.02)
    assert found.crest_factor[0] == pytest.approx(math.sqrt(2), rel=0.1)
    assert found.vdv[0] == pytest.approx(wk5 * (3 / 8 * 60) ** 0.25, rel=5e-3)
    assert found.msdv[2] == pytest.approx(wf2 * math.sqrt(30), rel=0.05)
    assert found.shocks.tolist() == [False, True, False, False]
    assert found.crest_factor[1] > 9
    assert np.isnan(found.crest_factor[3])
    assert found.vdv[3] == 0


def test_comfort_keeps_the_shape_of_the_batch(monkeypatch):
    records = np.random.default_rng(8).normal(size=(2, 3, 800))
    found = of.comfort(records, 0.004)
    monkeypatch.setattr(of, "BLOCK", 1600)  # two records at once
    again = of.comfort(records, 0.004)
    one = of.comfort(records[1, 2], 0.004)
    for name in ("weighted_rms", "peak", "mtvv", "vdv", "msdv"):
        assert getattr(found, name).shape == (2, 3)
        np.testing.assert_allclose(getattr(again, name), getattr(found, name), rtol=1e-12)
        assert getattr(one, name) == pytest.approx(getattr(found, name)[1, 2])
    assert found.crest_factor.shape == found.shocks.shape == (2, 3)
    assert of.comfort(records[:, :0], 0.004).vdv.shape == (2, 0)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.0, ["not uncomfortable"]),
        (0.314, ["not uncomfortable"]),
        (0.315, ["a little uncomfortable"]),
        (0.4, ["a little uncomfortable"]),
        (0.55, ["a little uncomfortable", "fairly uncomfortable"]),
        (0.7, ["fairly uncomfortable"]),
        (0.9, ["fairly uncomfortable", "uncomfortable"]),
        (1.1, ["uncomfortable"]),
        (1.4, ["uncomfortable", "very uncomfortable"]),
        (1.9, ["very uncomfortable"]),
        (2.2, ["very uncomfortable", "extremely uncomfortable"]),
        (2.6, ["extremely uncomfortable"]),
    ],
)
def test_comfort_reading(value, words):
    assert list(of.comfort_reading(value)) == words


def test_health_reading():
    zone = [of.health_reading(a, 8).split()[0] for a in (0.42, 0.44, 0.85, 0.88)]
    assert zone == ["below", "in", "in", "above"]
    zone = [of.health_reading(a, 0.1).split()[0] for a in (2.9, 3.1, 5.9, 6.1)]
    assert zone == ["below", "in", "in", "above"]
    assert [of.dose_reading(v).split()[0] for v in (8.4, 8.6, 17.1)] == ["below", "in", "above"]
    with pytest.raises(InputError, match="1 min to 24 h"):
        of.health_reading(1.0, 25)
    with pytest.raises(InputError, match=r"weighted rms \[m/s2\] = nan"):
        of.comfort_reading(math.nan)


def test_record_of_a_random_ride_meets_the_stationary_one():
    """White velocity drawn at 1 kHz through the sampled car: within its statistical error."""
    system, density = car(np.eye(4)[:1]), velocity_density("C", 20)
    A, E, C, D = (m[0] for m in system)
    step, count = 0.001, 400_000
    white = np.random.default_rng(7).normal(size=count) * math.sqrt(density / 2 / step)
    Ad, Ed, Cd, Dd, _ = signal.cont2discrete((A, E, C, D), step)
    above, below = signal.ss2tf(Ad, Ed, Cd, Dd)
    record = signal.lfilter(above[0], below, white)
    expected = stationary_ride(gains(system, quadrature()[0]), density)
    found = of.comfort(record, step)
    assert found.weighted_rms == pytest.approx(expected.weighted_rms[0], rel=0.03)
    banded = RIDE.of_signal(record, step)
    # A band holds about 2 B T independent values: four standard errors of the rms.
    error = 4 / np.sqrt(4 * np.diff(RIDE.edges) * count * step)
    assert (np.abs(banded / expected.ride[0] - 1) < np.maximum(error, 0.03)).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: of.comfort(np.zeros(500), 0.001), "0.499 s is shorter than its window of 1 s"),
        (lambda: of.running_rms(np.zeros(5), 1, 1, "square"), "average = 'square'"),
        (lambda: of.rms([1.0]), "two samples"),
    ],
)
def test_bad_input_is_named_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
