"""A law that was optimised, driven over a road while the load changes: every limit is held."""

import numpy as np
import pytest

from polefence.examples import family
from polefence.requirements.rms import Rms
from polefence.search.optimise import optimise
from polefence.vehicle import Jump, random_road, ride, velocity_density
from support.drives import drive

DENSITY = velocity_density("C", 20.0)
LIMITS = {"tyre deflection": 4.72e-3, "suspension deflection": 27e-3, "actuator force": 700.0}


@pytest.fixture(scope="module")
def done():
    limits = [Rms(name, value, DENSITY) for name, value in LIMITS.items()]
    first = Rms("sprung-mass acceleration", None, DENSITY)
    return optimise(family("quarter-car-ride"), first, limits, method="scheduled")


def test_limits_hold_while_the_load_changes(done):
    """The stiff car, the worst; an rms over a road of 600 m varies by a few percent."""
    plant = done.plant
    known = ride(plant)
    signals = (known.acceleration, known.tyre, known.travel, known.force)
    rms = []
    for seed in range(2):
        found = drive(
            plant,
            done.law,
            random_road("C", 600.0, seed),
            speed=20.0,
            duration=30.0,
            step=2e-3,
            parameters={"m1": Jump(235.0, 340.0, 15.0), "beta": 10.0},
        )
        values = found.response(signals).values[0, 1000:]
        rms.append(np.sqrt(np.mean(values**2, axis=0)))
    acceleration, tyre, travel, force = np.mean(rms, axis=0)
    assert 0.5 * done.bounds[0].level < acceleration < done.bounds[0].level
    assert tyre < LIMITS["tyre deflection"] * 1.03
    assert travel < LIMITS["suspension deflection"]
    assert force < LIMITS["actuator force"]
