"""Quarter cars: their equations, the signals by which their ride is assessed, and their physics.

Of `quarter_car`, whose uncertain families are `polefence.examples`, the states: suspension
deflection [m], tyre deflection [m], sprung-mass velocity [m/s], unsprung-mass velocity [m/s],
integral of suspension deflection [m s]. Input: actuator force [N]. Disturbance: vertical road
velocity [m/s]. Leite & Peres (2005), equations (1)-(3) and Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, inputs, states
from polefence.plant.system import Array
from polefence.plant.vehicle import ACCELERATION, TYRE_FORCE, UNSPRUNG, Vehicle
from polefence.proof.short import Short

# What names the plant's signals, and says that it is a car.
SIGNALS: dict[str, Any] = {
    "states": (
        "suspension deflection [m]",
        "tyre deflection [m]",
        "sprung-mass velocity [m/s]",
        "unsprung-mass velocity [m/s]",
        "integral of suspension deflection [m s]",
    ),
    "inputs": ("actuator force [N]",),
    "disturbances": ("road velocity [m/s]",),
    "vehicle": Vehicle(),
}


@dataclass(frozen=True)
class Ride(Short):
    """The signals by which a quarter car's ride is assessed, and where its states stand.

    Velocities, accelerations and the force on the sprung mass are positive upwards; a deflection in
    compression, or in extension where ``sense`` says so. All are about the static equilibrium of
    the current load.

    Attributes
    ----------
    travel : Output
        Suspension deflection [m].
    tyre : Output
        Tyre deflection [m].
    acceleration : Output
        Of the sprung mass [m/s2]: the rate of its velocity.
    unsprung : Output
        Acceleration of the unsprung mass [m/s2].
    force : Output
        Of the actuator, up on the sprung mass and down on the unsprung [N].
    tyre_force : Output, optional
        Variation of the tyre's force on the road [N], kt times its compression; where the plant's
        matrices say kt, the same at every vertex.
    places : tuple of int
        Numbers in the plant's state of suspension deflection, tyre deflection and the velocities of
        sprung and unsprung mass.
    sense : tuple of int
        Of suspension and tyre: 1 where compression is positive, -1 where extension is.
    input : int
        Number of the input that is the actuator force, or that the force follows.
    road : int, optional
        Number of the road's velocity among the disturbances, where the plant has any.
    lag : int, optional
        Number in the plant's state of the actuator force, where it follows its input with a lag.
    """

    travel: Output
    tyre: Output
    acceleration: Output
    unsprung: Output
    force: Output
    tyre_force: Output | None
    places: tuple[int, int, int, int]
    sense: tuple[int, int] = (1, 1)
    input: int = 0
    road: int | None = None
    lag: int | None = None

    def push(self, A: Array, B: Array) -> Array:
        """Return how the force moves the state (..., n), from A and B at points."""
        if self.lag is None:
            return np.asarray(B[..., :, self.input])
        column, masses = np.zeros(A.shape[:-1]), list(self.places[2:])
        column[..., masses] = A[..., masses, self.lag]
        return column

    @property
    def signals(self) -> tuple[Output, ...]:
        """All of them, the variation of tyre force last and only where it is known."""
        known = (self.travel, self.tyre, self.acceleration, self.unsprung, self.force)
        return known if self.tyre_force is None else (*known, self.tyre_force)


@dataclass(frozen=True, eq=False)
class Masses(Short):
    """Physics of a quarter car as its matrices have it, arrays of one shape.

    Attributes
    ----------
    m1, m2 : (...) array
        Sprung and unsprung mass [kg].
    k, c : (...) array
        Suspension stiffness [N/m] and damping [N s/m].
    kt : (...) array
        Tyre stiffness [N/m].
    """

    m1: Array
    m2: Array
    k: Array
    c: Array
    kt: Array


@explained
def ride(plant: UncertainPlant) -> Ride | None:
    """Return the ride signals of a plant that is described as a vehicle, else None."""
    car = plant.vehicle
    if car is None:
        return None
    places, number, lag = car.places(plant), car.input(plant), car.lag(plant)
    known = {output.name: output for output in plant.every_output}
    return Ride(
        travel=states(plant)[places[0]],
        tyre=states(plant)[places[1]],
        acceleration=known[ACCELERATION],
        unsprung=known[UNSPRUNG],
        force=inputs(plant)[number] if lag is None else states(plant)[lag],
        tyre_force=known.get(TYRE_FORCE),
        places=places,
        sense=car.sense,
        input=number,
        road=car.column(plant),
        lag=lag,
    )


def require_ride(plant: UncertainPlant) -> Ride:
    """Return the ride signals.

    Raises
    ------
    InputError
        If the plant is not described as a quarter car.
    """
    signals = ride(plant)
    if signals is None:
        raise InputError(
            f"{plant.name} is not described as a quarter car; add a table [vehicle] with "
            'model = "quarter car" to its spec'
        )
    return signals


@explained
def masses(plant: UncertainPlant, known: Ride, alpha: Array) -> Masses:
    """Return masses, stiffnesses and damping at points alpha (..., N), read off A and B."""
    A, B = plant.at(alpha)
    first, second, third, fourth = known.places
    force = known.push(A, B)
    m1, m2 = 1 / force[..., third], -1 / force[..., fourth]
    suspension, tyre = known.sense
    return Masses(
        m1,
        m2,
        suspension * m1 * A[..., third, first],
        m1 * A[..., third, fourth],
        tyre * m2 * A[..., fourth, second],
    )


@explained
def quarter_car(m1: Any, m2: Any, k: Any, kt: Any, c: Any) -> tuple[Any, Any, Any]:
    """Return A, B, E as nested lists for masses [kg], stiffnesses [N/m], damping [N s/m].

    `SIGNALS` are the names that go with them, as `UncertainPlant` takes them. Works on any numbers
    that add, multiply and divide: floats, Fractions, rational functions.
    """
    A = [
        [0, 0, -1, 1, 0],
        [0, 0, 0, -1, 0],
        [k / m1, 0, -c / m1, c / m1, 0],
        [-k / m2, kt / m2, c / m2, -c / m2, 0],
        [1, 0, 0, 0, 0],
    ]
    B = [[0], [0], [1 / m1], [-1 / m2], [0]]
    E = [[0], [1], [0], [0], [0]]
    return A, B, E
