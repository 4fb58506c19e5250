"""Suspensions of a car, between which and the body stops push: where they are in the state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.cars import Car
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import inputs
from polefence.plant.system import Array
from polefence.vehicle.vehicle import require_ride


@dataclass(frozen=True, eq=False)
class Suspensions:
    """One or more of them.

    Attributes
    ----------
    names : tuple of str
        Of their wheels; empty text where there is but one.
    compression : (k, n) array
        Their deflections by the state, positive in compression [m].
    push : callable
        Returns how a force on each, up on the body and down on the wheel, moves the state
        (..., n, k), from A and B at points.
    """

    names: tuple[str, ...]
    compression: Array
    push: Callable[[Array, Array], Array]


def suspensions(plant: UncertainPlant, car: Car | None) -> Suspensions:
    """Return the suspensions of a quarter car or of a car on several wheels.

    Raises
    ------
    InputError
        If the plant is no car.
    """
    if car is None:
        return _of_a_quarter_car(plant)
    known = {output.name: output for output in plant.every_output}
    inlets = [signal.name for signal in inputs(plant)]
    names = tuple(wheel.name for wheel in car.wheels)
    for name in names:
        force, deflection = f"{name} force", f"{name} suspension deflection"
        if force not in inlets or deflection not in known:
            raise InputError(
                f"{plant.name} is not the plant of this car: it has no {force!r} or no "
                f"{deflection!r}"
            )
    rows = [known[f"{name} suspension deflection"].arrays(plant)[0][0] for name in names]
    forces = [inlets.index(f"{name} force") for name in names]
    return Suspensions(names, np.array(rows), lambda A, B: B[..., :, forces])  # noqa: ARG005


def _of_a_quarter_car(plant: UncertainPlant) -> Suspensions:
    known = require_ride(plant)
    row = np.zeros((1, plant.shape[0]))
    row[0, known.places[0]] = known.sense[0]
    return Suspensions(("",), row, lambda A, B: known.push(A, B)[..., None])
