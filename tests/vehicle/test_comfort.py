"""Weightings against the standard's table; bands and doses against integrals done otherwise."""

import itertools
import math
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from scipy import integrate, linalg, signal
from scipy.integrate import trapezoid

from polefence.base.errors import InputError
from polefence.examples import family
from polefence.response import bands as of_bands
from polefence.response import weighting as of_weighting
from polefence.response.bands import MOTION, RIDE, Bands, quadrature, stationary_ride, thirds
from polefence.response.closed import close
from polefence.response.linear import frequency as frequency_response
from polefence.response.stationary import velocity_density
from polefence.response.weighting import WD, WE, WF, WK

of = import_module("polefence.vehicle.comfort")  # the package has the function of that name

# ISO 2631-1:1997, table 3: factors times 1000 at the nominal one-third octaves, band limits
# among them. Wk from 0.1 to 400 Hz, Wf from 0.02 to 4 Hz. Figures, as several public programs
# and papers repeat them. Wd at 10 Hz, printed as 212, is 202, as We has it an octave below.
TABLE_WK = """31.2 48.6 79.0 121 182 263 352 418 459 477 482 484 494 531 631 804 967 1039 1054 1036
988 902 768 636 513 405 314 246 186 132 88.7 54.0 28.5 15.2 7.90 3.98 1.95"""
TABLE_WD = """62.4 97.3 158 243 365 530 713 853 944 992 1011 1008 968 890 776 642 512 409 323 253
202 161 125 100 80.0 63.2 49.4 38.8 29.5 21.1"""
TABLE_WE = """62.5 97.5 159 245 368 536 723 862 939 941 880 772 632 512 409 323 253 202 160 125
100 80.1 62.5 50.0 39.9 31.6 24.7 19.4 14.8 10.5"""
TABLE_WF = """24.2 37.7 59.7 97.1 157 267 461 695 895 1006 992 854 619 384 224 116 53.0 23.5 9.98
3.77 1.55 0.64 0.25 0.097"""


def table(text, first):
    factors = np.array([float(v) for v in text.split()]) / 1000
    return Bands(first, first + len(factors) - 1).nominal, factors


@pytest.mark.parametrize(
    ("weighting", "text", "first", "ends"),
    [
        (WK, TABLE_WK, -10, (0.1, 400.0)),
        (WD, TABLE_WD, -10, (0.1, 80.0)),
        (WE, TABLE_WE, -10, (0.1, 80.0)),
        (WF, TABLE_WF, -17, (0.02, 4.0)),
    ],
    ids=["Wk", "Wd", "We", "Wf"],
)
def test_gain_meets_the_whole_table(weighting, text, first, ends):
    frequency, factors = table(text, first)
    assert (frequency[0], frequency[-1]) == ends
    np.testing.assert_allclose(np.abs(weighting.gain(frequency)), factors, rtol=0.01)


def test_the_table_would_show_a_wrong_band_limit():
    frequency, factors = table(TABLE_WK, -10)
    wrong = np.abs(replace(WK, low_pass=110.0).gain(frequency))
    assert np.abs(wrong / factors - 1).max() > 0.02


def test_known_figures_of_the_standard():
    found = np.abs(WK.gain([1, 6.3, 31.5, 80]))
    np.testing.assert_allclose(found, [0.482, 1.054, 0.405, 0.132], rtol=0.01)
    np.testing.assert_allclose(np.abs(WF.gain([0.2, 0.4])), [0.992, 0.384], rtol=0.01)
    # ISO 8041: at its reference frequency, 100 rad/s
    found = [abs(own.gain(50 / np.pi)) for own in (WK, WD, WE)]
    np.testing.assert_allclose(found, [0.7718, 0.1261, 0.06287], rtol=4e-4)


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


@pytest.mark.parametrize("weighting", [WK, WD, WE, WF])
def test_three_forms_are_one_filter(weighting):
    s = 2j * np.pi * np.geomspace(0.01, 500, 40)
    above, below = weighting.transfer_function()
    A, B, C, D = weighting.state_space()
    by_state = [(C @ np.linalg.solve(p * np.eye(len(A)) - A, B) + D).item() for p in s]
    gain = weighting.gain(s.imag / (2 * np.pi))
    np.testing.assert_allclose(np.polyval(above, s) / np.polyval(below, s), gain, rtol=1e-9)
    np.testing.assert_allclose(by_state, gain, rtol=1e-9, atol=1e-14)
    slowest = -np.linalg.eigvals(A).real.max()
    assert weighting.settling == pytest.approx(20 / slowest)


def test_sampled_sines_meet_the_table_up_to_80_hz():
    """200 samples a second: a bilinear filter would pass an eighth of the table's factor at 80."""
    frequency, factors = table(TABLE_WK, -10)
    keep = (frequency >= 0.5) & (frequency <= 80)
    time = np.arange(0, 40, 0.005)
    out = WK.apply(np.sin(2 * np.pi * frequency[keep, None] * time), 0.005)
    steady = (time >= 15) & (time < 35)
    amplitude = np.sqrt(2 * np.mean(out[:, steady] ** 2, axis=-1))
    np.testing.assert_allclose(amplitude, factors[keep], rtol=0.01)


@pytest.mark.parametrize(("weighting", "step", "span"), [(WK, 0.004, 4.0), (WF, 0.05, 60.0)])
def test_apply_meets_an_integration_of_the_states(weighting, step, span):
    """A pulse that fades in and out smoothly, against solve_ivp on the analogue filter."""
    time = np.arange(0, span, step)

    def pulse(t):
        hill = math.sin(math.pi * 2 * t / span) ** 6 if t < span / 2 else 0.0
        return hill * math.sin(2 * math.pi * weighting.top / 4 * t)

    A, B, C, D = weighting.state_space()
    B0 = B[:, 0]
    states = integrate.solve_ivp(
        lambda t, x: A @ x + B0 * pulse(t),
        (0, span),
        np.zeros(8),
        method="DOP853",
        t_eval=time,
        rtol=1e-8,
        atol=1e-11,
        max_step=span / 100,
    ).y
    record = np.array([pulse(t) for t in time])
    exact = (C @ states)[0] + D[0, 0] * record
    assert weighting.apply(record, step) == pytest.approx(exact, abs=2e-6 * abs(exact).max())


def test_rows_are_weighted_alone_whatever_the_block(monkeypatch):
    rows = np.random.default_rng(1).normal(size=(2, 3, 400))
    whole = WK.apply(rows, 0.005)
    monkeypatch.setattr(of_weighting, "BLOCK", 1)
    np.testing.assert_allclose(WK.apply(rows, 0.005), whole, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(WK.apply(rows[1, 2], 0.005), whole[1, 2], rtol=1e-12, atol=1e-14)


def test_the_end_of_a_record_does_not_come_back_at_its_start():
    time = np.arange(0, 4, 0.004)
    late = np.where(time > 3.5, np.sin(2 * np.pi * (time - 3.5)) ** 4, 0.0)
    out = WK.apply(late, 0.004)
    assert np.abs(out[time < 3]).max() < 1e-6 * np.abs(out).max()


def test_bands_of_the_paper():
    assert MOTION.nominal.tolist() == [0.1, 0.125, 0.16, 0.2, 0.25, 0.315, 0.4, 0.5, 0.63]
    assert (RIDE.nominal[0], RIDE.nominal[-1], len(RIDE.nominal)) == (1.0, 80.0, 20)
    np.testing.assert_allclose(RIDE.edges[1:] / RIDE.edges[:-1], 10**0.1)
    np.testing.assert_allclose(np.sqrt(RIDE.edges[1:] * RIDE.edges[:-1]), RIDE.centre)
    np.testing.assert_allclose(RIDE.nominal, RIDE.centre, rtol=0.015)


def test_density_bands_are_exact_for_a_broken_line():
    rng = np.random.default_rng(2)
    frequency = np.concatenate([[0.05], np.sort(rng.uniform(0.05, 100, 60)), [100.0]])
    density = rng.uniform(0, 3, (2, 62))
    found = RIDE.of_density(frequency, density) ** 2
    for row, own in zip(density, found, strict=True):
        for k, (low, high) in enumerate(itertools.pairwise(RIDE.edges)):
            corners = frequency[(frequency > low) & (frequency < high)]
            at = np.concatenate([[low], corners, [high]])
            assert own[k] == pytest.approx(trapezoid(np.interp(at, frequency, row), at))


def test_signal_bands_share_out_the_mean_square():
    record = np.random.default_rng(3).normal(size=(2, 5000))
    every = Bands(-6, 19)
    power = (every.of_signal(record, 0.005) ** 2).sum(-1)
    spectrum = np.fft.fft(record) / 5000
    frequency = np.abs(np.fft.fftfreq(5000, 0.005))
    # Lines are 0.04 Hz apart: the two at the outer edges are the only ones not wholly in or out.
    inside = (frequency > every.edges[0]) & (frequency < every.edges[-1])
    within = (np.abs(spectrum[:, inside]) ** 2).sum(-1)
    np.testing.assert_allclose(power, within, rtol=2e-3)


def test_signal_band_of_a_sine_is_its_rms():
    time = np.arange(0, 20, 0.004)
    amplitude = np.arange(1, 21)
    waves = amplitude[:, None] * np.sin(2 * np.pi * np.round(RIDE.centre, 1)[:, None] * time)
    found = RIDE.of_signal(waves, 0.004)
    np.testing.assert_allclose(found.diagonal(), amplitude / math.sqrt(2), rtol=1e-6)
    assert (found - np.diag(found.diagonal())).max() < 1e-6
    odd = RIDE.of_signal(waves.sum(0)[:-1], 0.004)
    np.testing.assert_allclose(odd, amplitude / math.sqrt(2), rtol=0.03)


def test_lines_at_an_edge_are_shared_in_proportion():
    time = np.arange(0, 20, 0.004)
    found = RIDE.of_signal(math.sqrt(2) * np.sin(2 * np.pi * 1.1 * time), 0.004) ** 2
    below = (10**0.05 - 1.075) / 0.05  # of the line's 1.075 to 1.125 Hz
    np.testing.assert_allclose(found[:2], [below, 1 - below], rtol=1e-9)
    # The last line of an even count stands for itself alone: half the rate, 89.13 Hz.
    found = RIDE.of_signal((-1.0) ** np.arange(1000), 1 / (2 * 89.13)) ** 2
    assert found[-1] == pytest.approx(0.5 - 500 * (1 - 10**1.95 / 89.13), rel=1e-6)


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


# The stationary ride: physical quarter car, passive, without its integral state (pole at 0).


def car(alpha):
    loops = close(family("quarter-car-physical"), None, alpha)
    A, E = loops.closed[:, :4, :4], loops.E[:, :4, :]
    return A, E, A[:, 2:3, :], E[:, 2:3, :]


def gains(system, frequency):
    A, E, C, D = (m[:, None] for m in system)
    s = 2j * np.pi * frequency[:, None, None]
    return (C @ np.linalg.solve(s * np.eye(4) - A, E + 0j) + D)[..., 0, 0]


def lyapunov_rms(system, density, weighting=None):
    """Root of C X C' of plant, and filter where there is one, in a row."""
    found = []
    for A, E, C, D in zip(*system, strict=True):
        if weighting is not None:
            Aw, Bw, Cw, Dw = weighting.state_space()
            A = np.block([[A, np.zeros((4, 8))], [Bw @ C, Aw]])
            E, C, D = np.vstack([E, Bw @ D]), np.hstack([Dw @ C, Cw]), Dw @ D
        assert not D.any()
        X = linalg.solve_continuous_lyapunov(A, -density / 2 * E @ E.T)
        found.append(math.sqrt((C @ X @ C.T).item()))
    return np.array(found)


@pytest.fixture(scope="module")
def ride():
    rng = np.random.default_rng(6)
    alpha = np.vstack([np.eye(4), rng.dirichlet(np.ones(4), 3)])
    system, density = car(alpha), velocity_density("C", 20)
    frequency, _ = quadrature()
    return system, density, stationary_ride(gains(system, frequency), density)


def test_stationary_rms_meets_the_augmented_lyapunov_equation(ride):
    system, density, found = ride
    np.testing.assert_allclose(found.weighted_rms, lyapunov_rms(system, density, WK), rtol=1e-10)
    np.testing.assert_allclose(found.sickness_rms, lyapunov_rms(system, density, WF), rtol=1e-9)
    plain = lyapunov_rms(system, density)[:4]
    assert (plain.min(), plain.max()) == pytest.approx((0.77, 1.36), abs=0.01)


def test_gains_of_the_linear_responses_fit(ride):
    system, density, _ = ride
    plant = family("quarter-car-physical")
    acceleration = plant.signal("sprung-mass acceleration")
    alpha = np.eye(4)
    found = frequency_response(plant, None, alpha, quadrature()[0], [acceleration])
    own = stationary_ride(found.gain[:, :, 0, 0], density)
    corners = [m[:4] for m in system]
    np.testing.assert_allclose(own.weighted_rms, lyapunov_rms(corners, density, WK), rtol=1e-9)


def test_stationary_bands_meet_direct_integration(ride):
    system, density, found = ride
    for bands, values in ((MOTION, found.motion), (RIDE, found.ride)):
        for i in (0, 3, 5):
            one = [m[i : i + 1] for m in system]
            for k in (0, 3, len(bands.nominal) - 1):
                direct, _ = integrate.quad(
                    lambda f, one=one: abs(gains(one, np.array([f]))[0, 0]) ** 2,
                    *bands.edges[k : k + 2],
                    epsrel=1e-10,
                )
                assert values[i, k] == pytest.approx(math.sqrt(density * direct), rel=1e-8)


def test_stationary_bands_meet_the_frequency_limited_gramian(ride):
    """Exactly: the covariance of a band is F X + X F', F a difference of matrix logarithms."""
    system, density, found = ride
    edges = 2 * np.pi * RIDE.edges
    for (A, E, C, _), own in zip(zip(*system, strict=True), found.ride, strict=True):
        X = linalg.solve_continuous_lyapunov(A, -E @ E.T)
        logs = [linalg.logm(1j * w * np.eye(4) - A) for w in edges]
        F = np.array([(b - a) / 1j for a, b in itertools.pairwise(logs)])
        power = 2 * (C @ F @ X @ C.T).real[:, 0, 0] * density / (2 * np.pi)
        np.testing.assert_allclose(own, np.sqrt(power), rtol=1e-7)


def test_bands_of_a_density_meet_the_stationary_ones(ride):
    system, density, found = ride
    frequency = np.geomspace(0.05, 100, 4000)
    banded = RIDE.of_density(frequency, density * np.abs(gains(system, frequency)) ** 2)
    np.testing.assert_allclose(banded, found.ride, rtol=1e-4)


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
        (lambda: WK.apply(np.zeros(900), 0.01), "weighting Wk: a sampling step of 0.01 s .*0.0056"),
        (lambda: RIDE.of_signal(np.zeros(900), 0.01), "too long for bands up to 80 Hz.*0.0056"),
        (lambda: RIDE.of_signal(np.zeros(900), 0.001), "0.9 s does not resolve .* 1 Hz.*4.3"),
        (lambda: MOTION.of_signal(np.zeros(30), 1.0), "too long for bands up to 0.63 Hz.*0.7"),
        (lambda: WK.apply(np.zeros(9), 0.0), r"sampling step \[s\] = 0.0"),
        (lambda: WK.apply([1.0, 2.0, math.nan], 0.001), "sample 3 is not a finite number"),
        (lambda: WK.apply([1.0], 0.001), "two samples"),
        (lambda: of.comfort(np.zeros(500), 0.001), "0.499 s is shorter than its window of 1 s"),
        (lambda: of.running_rms(np.zeros(5), 1, 1, "square"), "average = 'square'"),
        (lambda: of.rms([1.0]), "two samples"),
        (
            lambda: thirds(0.9, 80),
            "0.9 Hz is not a one-third-octave frequency; the nearest is 1 Hz",
        ),
        (lambda: thirds(80, 1), "lower frequency first"),
        (lambda: RIDE.of_density([1, 50], [1, 1]), "from 1 to 50 Hz does not cover .*0.8913 to 89"),
        (lambda: RIDE.of_density([0.1, 200], [1, -1]), "nowhere negative"),
        (lambda: RIDE.of_density([200, 0.1], [1, 1]), "increase"),
        (lambda: RIDE.of_density([0.1, 200], [1, 1, 1]), "does not fit"),
        (lambda: stationary_ride(np.ones(7), 1.0), "1020 frequencies"),
        (lambda: stationary_ride(np.full(1020, np.inf), 1.0), "imaginary axis"),
        (lambda: stationary_ride(np.ones(1020), 0.0), "density of the road velocity"),
    ],
)
def test_bad_input_is_named_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_node_count_matches_its_message():
    assert len(quadrature()[0]) == of_bands.NODES * (of_bands.LAST - of_bands.FIRST + 1) == 1020
