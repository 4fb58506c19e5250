"""Wheels of a car on the road: static loads of the tyres, and where a tyre would have to pull.

The equations count from the static equilibrium and know springs that push and pull alike.
"""

from __future__ import annotations

import numpy as np

from polefence.plant.cars import Car
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.plant.outputs import Output, states
from polefence.plant.system import Array

GRAVITY = 9.81  # [m/s2]


def tyre_forces(plant: UncertainPlant, car: Car) -> tuple[Output, ...]:
    """Return the variation of each tyre's force on the road [N], in the order of the wheels."""
    known = {output.name: output for output in plant.every_output}
    return tuple(known[f"{wheel.name} tyre force variation"] for wheel in car.wheels)


def static_loads(plant: UncertainPlant, car: Car, alpha: Array) -> Array:
    """Return what rests on each tyre of a standing car [N].

    With all masses falling freely the equations are those of a car without weight; so weight
    deflects the tyres by x with A x = g, where g has 9.81 m/s2 at heave rate and wheel velocities.

    Parameters
    ----------
    plant : UncertainPlant
        That of the car; a law's own states, if it has any, are at rest.
    car : Car
        For the names of its wheels.
    alpha : (..., N) array

    Returns
    -------
    (..., wheels) array
    """
    falling = {"heave rate", *(f"{wheel.name} wheel velocity" for wheel in car.wheels)}
    g = np.array([GRAVITY * (state.name in falling) for state in states(plant)])
    n = plant.shape[0] - own_states(plant)
    A, g = plant.at(alpha)[0][..., :n, :n], g[:n, None]
    x = np.linalg.solve(A, np.broadcast_to(g, (*A.shape[:-1], 1)))[..., 0]
    rows = [np.tensordot(alpha, force.arrays(plant)[0], 1) for force in tyre_forces(plant, car)]
    return np.stack([np.sum(row[..., :n] * x, axis=-1) for row in rows], axis=-1)
