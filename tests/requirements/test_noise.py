"""Noise of sensors in requirements: at its own density in an rms, not at all in gains and peaks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import EnergyPeak, FixedGain, Gain, InitialPeak, RelativeRms, Rms, with_sensor
from polefence.certify.bounds import best_bound
from polefence.certify.refutation import refute_limits
from polefence.examples import family, spec_text
from polefence.plant.spec import loads
from support.commands import ran
from support.specs import TWO_STATES

DENSITY = 0.02
NAME = "suspension deflection"


@pytest.fixture(scope="module")
def car():
    return family("quarter-car-ride")


@pytest.fixture(scope="module")
def noisy(car):
    return with_sensor(car, "sprung-mass velocity", 50, 0.1)


@pytest.fixture(scope="module")
def law():
    return FixedGain([[0, 0, 0, 0, -1500.0]])  # of the measured velocity


def test_an_rms_has_the_noise_at_density_one(noisy, law):
    alpha = np.array([[0.1, 0.2, 0.3, 0.4]])
    A, B = noisy.at(alpha[0])
    E = noisy.vertices[0].E
    N = E @ np.diag([DENSITY / 2, 1 / 2]) @ E.T
    X = solve_continuous_lyapunov(A + B @ law.K, -N)
    own = Rms("actuator force", density=DENSITY)
    assert own.values(noisy, law, alpha) == pytest.approx(np.sqrt(law.K @ X @ law.K.T)[0], rel=1e-9)
    assert own.title == "rms of actuator force"


def test_what_names_disturbances_has_those_as_they_are(noisy, law):
    alpha = np.eye(4)
    road = Rms("actuator force", density=DENSITY, disturbances=["road velocity"])
    both = Rms(
        "actuator force", density=DENSITY,
        disturbances={"road velocity": 1, "noise of sprung-mass velocity": DENSITY**-0.5},
    )  # fmt: skip
    every = Rms("actuator force", density=DENSITY)
    assert both.values(noisy, law, alpha) == pytest.approx(every.values(noisy, law, alpha))
    assert np.all(road.values(noisy, law, alpha) < every.values(noisy, law, alpha))


@pytest.mark.parametrize(
    "own",
    [Gain(NAME), EnergyPeak(NAME, norm=0.1), InitialPeak(NAME, impulse=0.05)],
    ids=lambda own: own.kind,
)
def test_gains_and_peaks_are_of_what_is_physical(car, noisy, own):
    alpha, passive = np.eye(4), FixedGain(np.zeros((1, 5)))
    found = own.values(noisy, passive, alpha)
    named = replace(own, disturbances=["road velocity"])
    assert np.array_equal(found, named.values(noisy, passive, alpha))
    # sampled at other instants, or frequencies, for a sensor is faster than the car
    assert found == pytest.approx(own.values(car, FixedGain(np.zeros((1, 4))), alpha), rel=5e-3)


def test_of_a_plant_with_noise_alone_everything_is_of_that():
    text = TWO_STATES.replace("E = [[0], [1]]", "").replace('disturbances = ["w [m/s2]"]', "")
    plant = with_sensor(loads(text), "x", 10, 0.5)
    assert Gain("measured x").scales(plant) == ()
    noise = Rms("measured x", density=3.0)
    found = noise.values(plant, FixedGain(np.zeros((1, 3))), np.eye(4))
    assert found == pytest.approx(0.5, rel=1e-9)


def test_bounds_are_proved_of_both(noisy, law):
    own = Rms("actuator force", density=DENSITY)
    bound = best_bound(noisy, law, own)
    worst = own.values(noisy, law, np.random.default_rng(1).dirichlet(np.ones(4), 200)).max()
    assert worst <= bound.level < 1.05 * worst
    quiet = best_bound(noisy, law, Rms("actuator force", density=DENSITY,
                                       disturbances=["road velocity"]))  # fmt: skip
    assert quiet.level < bound.level


def test_a_ratio_to_the_plant_without_control_has_the_noise_too(noisy, law):
    alpha = np.eye(4)
    own = RelativeRms(NAME, density=DENSITY)
    passive = Rms(NAME, density=DENSITY).values(noisy, None, alpha)
    ratio = Rms(NAME, density=DENSITY).values(noisy, law, alpha) / passive
    assert own.values(noisy, law, alpha) == pytest.approx(ratio)


def test_limits_of_two_densities_are_refuted_each_with_its_noise(car, noisy):
    """What no law does without noise none does with it, whatever other limits there are."""
    tight = [Rms("sprung-mass acceleration", 0.1, DENSITY), Rms("tyre deflection", 1e-4, DENSITY)]
    loose = Rms("actuator force", 1e6, 7 * DENSITY)
    assert refute_limits(car, [*tight, loose]) is not None
    found = refute_limits(noisy, [loose, *tight])
    assert found is not None
    assert loose not in found.specifications


def test_a_road_is_one_disturbance_beside_noise(tmp_path, capsys):
    path = tmp_path / "car.toml"
    sensor = '\n[sensor."sprung-mass velocity"]\nbandwidth = 50\nnoise = 0.1\n'
    path.write_text(spec_text("quarter-car-ride") + sensor)
    gain = "[[0, 0, 0, 0, -1500]]"
    words = ["analyse", str(path), "--gain", gain, "--region", "half_plane(0)"]
    ran(capsys, *words)
    from polefence.plant.spec import load
    from polefence.requirements.asked import wanted
    from polefence.requirements.text import spec_road

    least, limits = wanted(load(path), path, road=spec_road(path))
    assert least.scales(load(path)) == (1.0, pytest.approx(least.density**-0.5))
    assert len(limits) == 3
