"""A car whose force is a state behind an actuator, and whose sensors have noise."""

from dataclasses import replace

import numpy as np
import pytest

from polefence import FixedGain, PlantError, PolynomialGain, with_actuator, with_sensor
from polefence.base.errors import InputError
from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.plant.points import seeded
from polefence.response.stationary import stationary, velocity_density
from polefence.vehicle import drive, on_road, random_road
from polefence.vehicle.compare import compare
from polefence.vehicle.driving.parts import Actuator, BumpStops, Hardware, Jump, Measured, Sampling
from polefence.vehicle.reference_laws import Sizes, lqr, skyhook
from polefence.vehicle.rest import held_words, rests
from polefence.vehicle.vehicle import masses, ride

HERTZ = 12.0


@pytest.fixture(scope="module")
def car():
    return family("quarter-car-level")


@pytest.fixture(scope="module", params=[1, 2])
def lagging(car, request):
    return with_actuator(car, "actuator force", HERTZ, request.param)


def test_its_physics_and_its_signals_stay(car, lagging):
    known, before = ride(lagging), ride(car)
    alpha = seeded(car, 50)
    for key, value in vars(masses(lagging, known, alpha)).items():
        assert value == pytest.approx(getattr(masses(car, before, alpha), key), rel=1e-12)
    assert [own.label for own in known.signals] == [own.label for own in before.signals]
    assert (known.lag, known.input, known.road) == (5, 0, 0)
    # forces of springs, damper and actuator move the masses as they did
    x, force = np.array([0.01, 0.002, 0.3, -0.2, 0.1]), 70.0
    more = np.concatenate([x, [force], np.zeros(lagging.shape[0] - 6)])
    for new, old in zip(known.signals, before.signals, strict=True):
        (C, D, _), (after, direct, _) = old.arrays(car), new.arrays(lagging)
        assert not direct.any()
        assert after @ more == pytest.approx(C @ x + D[:, 0] * force, rel=1e-12)


def test_reference_laws_ask_for_the_force(car, lagging):
    for law, other in ((skyhook(car), skyhook(lagging)), (lqr(car), lqr(lagging))):
        assert np.allclose(other.K[:, :5], law.K, rtol=1e-9)
        assert not other.K[:, 5:].any()
    assert np.allclose(lqr(lagging, Sizes(integral=1.0)).K[:, :5], lqr(car, Sizes(integral=1.0)).K)


@pytest.mark.parametrize("stops", [None, BumpStops(0.004, 0.004, 100e3, 300.0)])
def test_a_drive_is_that_with_the_same_lag_in_the_actuator(car, stops):
    """Also where the load changes, and in the stops."""
    lagging = with_actuator(car, "actuator force", HERTZ)
    road = random_road("C", 10, seed=4)
    moved = {"m1": Jump(0.2, 260.0, 330.0), "beta": 3.0}
    found = [
        drive(plant, law, on_road(plant, road, 20, 5e-4), moved, Hardware(stops=stops, **more))
        for plant, law, more in (
            (car, skyhook(car), {"actuator": Actuator(HERTZ)}),
            (lagging, skyhook(lagging), {}),
        )
    ]
    for name in ("suspension deflection", "sprung-mass acceleration", "tyre force variation"):
        one, other = (own.of(name) for own in found)
        assert np.abs(one - other).max() < 1e-5 * np.abs(one).max()
    if stops is not None:
        assert np.abs(found[0].stop_force).max() > 100
        assert np.allclose(found[0].stop_force, found[1].stop_force, atol=1e-2)


def test_a_comparison_has_the_road_at_its_density_and_noise_at_its_own(car):
    noisy = with_sensor(
        with_actuator(car, "actuator force", HERTZ), "sprung-mass velocity", 50, 0.1
    )
    K = np.zeros((1, 7))
    K[0, 6] = -1500.0
    law, alpha = FixedGain(K), np.eye(4)
    found = compare(noisy, {"law": law}, "C", 20, alpha)
    psd = [velocity_density("C", 20), 1.0]
    known = ride(noisy)
    own = stationary(noisy, law, alpha, psd, [known.force, known.travel])
    forces, travels = found.values[0, :, 5], found.values[0, :, 4]
    assert forces == pytest.approx(own.rms[:, 0], rel=1e-9)
    assert travels == pytest.approx(own.rms[:, 1], rel=1e-9)
    quiet = stationary(noisy, law, alpha, [psd[0], 0.0], [known.force])
    assert np.all(forces > 1.001 * quiet.rms[:, 0])


def test_noise_is_not_held(car):
    noisy = with_sensor(car, "suspension deflection", 50, 0.001)
    found = rests(noisy, FixedGain(np.zeros((1, 6))), np.eye(4), ["suspension deflection"])
    assert {rest.source.name for rest in found} == {"road velocity"}
    assert "a grade" in held_words(noisy, found[0].source)


def test_a_force_that_several_inputs_move_is_said(car):
    lagging = with_actuator(car, "actuator force", HERTZ)
    vertices = tuple(
        replace(v, exact_B=tuple((*row, row[0]) for row in v.exact_B)) for v in lagging.vertices
    )
    with pytest.raises(PlantError, match="2 inputs move 'actuator force'"):
        replace(lagging, vertices=vertices, inputs=("a", "b"))


def test_every_command_takes_a_spec_with_hardware(tmp_path, capsys):
    path = tmp_path / "car.toml"
    path.write_text(
        spec_text("quarter-car-ride")
        + '\n[actuator."actuator force"]\nbandwidth = 30\n'
        + '\n[sensor."sprung-mass acceleration"]\nbandwidth = 100\nnoise = 0.05\n'
    )
    assert main(["compare", str(path), "--law", "passive", "--law", "skyhook"]) == 0
    assert "actuator force rms" in capsys.readouterr().out
    words = ["simulate", str(path), "--law", "skyhook", "--road", "C", "--speed", "20"]
    assert main([*words, "--duration", "1", "--step", "0.0005", "-o", str(tmp_path / "x.csv")]) == 0
    assert "measured sprung-mass acceleration" in capsys.readouterr().out
    assert main(["compare", str(path), "--law", "quadratic", "--law", "passive"]) == 0


@pytest.mark.parametrize("sampling", [None, Sampling(0.002, delay=1)])
@pytest.mark.parametrize("m1", [250.0, 330.0])
def test_a_law_takes_the_acceleration_of_the_car_that_is_driven(lagging, sampling, m1):
    """Its rows are those of the load, and the law's gain that of what it is told of it."""
    signal, here = lagging.signal("sprung-mass acceleration"), {"beta": 3.0}
    assert len(signal.C) > 1
    hardware = Hardware(sampling=sampling)
    law = PolynomialGain(((0, 0), (1, 0)), [[[-40.0]], [[-5.0]]], (signal,), lagging.parameters)
    excitation = on_road(lagging, random_road("C", 10, seed=4), 20, 5e-4)
    gain = FixedGain(law.gain(lagging.alpha(m1=m1, **here)))
    other = law.gain(lagging.alpha(m1=300.0, **here))
    assert np.abs(other - gain.K).max() > 0.01 * np.abs(other).max()
    found, plain = (
        drive(lagging, each, excitation, here | {"m1": m1}, hardware).of(signal.name)
        for each in (law, gain)
    )
    assert np.allclose(found, plain, rtol=0, atol=1e-9 * np.abs(plain).max())
    noisy = replace(hardware, scheduling=Measured(noise={"m1": 5.0}))
    near = drive(lagging, law, excitation, here | {"m1": m1}, noisy).of(signal.name)
    assert 0 < np.abs(near - plain).max() < 0.05 * np.abs(plain).max()
    with pytest.raises(InputError, match="drives along moving or estimated parameters"):
        drive(lagging, law, excitation, here | {"m1": Jump(0.2, 260.0, 330.0)}, hardware)
