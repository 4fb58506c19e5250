"""One-third-octave bands, and the stationary ride in them, against integrals done otherwise."""

import itertools
import math

import numpy as np
import pytest
from scipy import integrate, linalg
from scipy.integrate import trapezoid

from polefence.base.errors import InputError
from polefence.examples import family
from polefence.response import bands as of_bands
from polefence.response.bands import MOTION, RIDE, Bands, quadrature, stationary_ride, thirds
from polefence.response.linear import frequency as frequency_response
from polefence.response.stationary import velocity_density
from polefence.response.weighting import WF, WK
from support.passive import car, gains


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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: RIDE.of_signal(np.zeros(900), 0.01), "too long for bands up to 80 Hz.*0.0056"),
        (lambda: RIDE.of_signal(np.zeros(900), 0.001), "0.9 s does not resolve .* 1 Hz.*4.3"),
        (lambda: MOTION.of_signal(np.zeros(30), 1.0), "too long for bands up to 0.63 Hz.*0.7"),
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
