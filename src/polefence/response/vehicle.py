"""A quarter car, known by the names of its states: what its ride is judged by, its physics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.response.signals import Signal, inputs, rate_of, split, states

STATES = (
    "suspension deflection",
    "tyre deflection",
    "sprung-mass velocity",
    "unsprung-mass velocity",
)
FORCE = "actuator force"


@dataclass(frozen=True)
class Ride:
    """The signals by which a quarter car's ride is judged, and where its states stand.

    Both deflections are positive in compression; velocities, accelerations and the force on the
    sprung mass are positive upwards. All are about the static equilibrium of the current load.

    Attributes
    ----------
    travel : Signal
        Suspension deflection [m].
    tyre : Signal
        Tyre deflection [m].
    acceleration : Signal
        Of the sprung mass [m/s2]: the rate of its velocity.
    unsprung : Signal
        Acceleration of the unsprung mass [m/s2].
    force : Signal
        Of the actuator, up on the sprung mass and down on the unsprung [N].
    tyre_force : Signal, optional
        Variation of the tyre's force on the road [N], kt times the tyre deflection; where the
        plant's matrices say kt, the same at every vertex.
    places : tuple of int
        Numbers of the four `STATES` in the plant's state.
    input : int
        Number of the actuator force among the inputs.
    """

    travel: Signal
    tyre: Signal
    acceleration: Signal
    unsprung: Signal
    force: Signal
    tyre_force: Signal | None
    places: tuple[int, int, int, int]
    input: int = 0

    @property
    def signals(self) -> tuple[Signal, ...]:
        """All of them, the variation of tyre force last and only where it is known."""
        known = (self.travel, self.tyre, self.acceleration, self.unsprung, self.force)
        return known if self.tyre_force is None else (*known, self.tyre_force)


@dataclass(frozen=True, eq=False)
class Masses:
    """What the matrices of a quarter car say of its physics, arrays of one shape.

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


def ride(plant: UncertainPlant) -> Ride | None:
    """Return the ride signals of a plant whose states are named as a quarter car's, else None.

    Upper and lower case, a hyphen or a blank, "tyre" and "tire" are the same; units in brackets
    and further states do not matter. The force is the input named "actuator force", or the only
    input there is.
    """
    names = [_plain(name) for name in plant.states]
    if any(names.count(_plain(wanted)) != 1 for wanted in STATES):
        return None
    number = _force_input(plant)
    if number is None:
        return None
    first, second, third, fourth = (names.index(_plain(wanted)) for wanted in STATES)
    places = (first, second, third, fourth)
    known = states(plant)
    deflection = known[second]
    kt = _tyre_stiffness(plant, places, number)
    return Ride(
        travel=known[first],
        tyre=deflection,
        acceleration=rate_of(known[third], "sprung-mass acceleration"),
        unsprung=rate_of(known[fourth], "unsprung-mass acceleration"),
        force=inputs(plant)[number],
        tyre_force=None if kt is None else Signal("tyre force variation", "N", state={second: kt}),
        places=places,
        input=number,
    )


def require_ride(plant: UncertainPlant) -> Ride:
    """Return the ride signals.

    Raises
    ------
    InputError
        If the plant's states are not named as a quarter car's.
    """
    found = ride(plant)
    if found is None:
        raise InputError(
            f"{plant.name} is not known as a quarter car; name four of its states "
            f"{', '.join(repr(name) for name in STATES)}, and its only input or {FORCE!r}"
        )
    return found


def masses(plant: UncertainPlant, known: Ride, alpha: Array) -> Masses:
    """Return masses, stiffnesses and damping at points alpha (..., N), read off A and B.

    With the force u up on the sprung and down on the unsprung mass,

        m1 dx3/dt = k x1 + c (x4 - x3) + u,     m2 dx4/dt = -k x1 - c (x4 - x3) + kt x2 - u.

    Raises
    ------
    InputError
        If the force does not act so.
    """
    A, B = plant.at(alpha)
    first, second, third, fourth = known.places
    up, down = B[..., third, known.input], B[..., fourth, known.input]
    if not (np.all(up > 0) and np.all(down < 0)):
        raise InputError(
            f"{plant.name}: the force must act up on the sprung mass and down on the unsprung; "
            "change its sign in B"
        )
    m1, m2 = 1 / up, -1 / down
    return Masses(
        m1, m2, m1 * A[..., third, first], m1 * A[..., third, fourth], m2 * A[..., fourth, second]
    )


def _plain(name: str) -> str:
    return split(name)[0].casefold().replace("-", " ").replace("tire", "tyre")


def _force_input(plant: UncertainPlant) -> int | None:
    names = [_plain(name) for name in plant.inputs]
    if names.count(_plain(FORCE)) == 1:
        return names.index(_plain(FORCE))
    return 0 if plant.shape[1] == 1 else None


def _tyre_stiffness(
    plant: UncertainPlant, places: tuple[int, int, int, int], number: int
) -> float | None:
    """Return kt = -A[4, 2] / B[4] where that is one positive number, in exact arithmetic."""
    found = set()
    for vertex in plant.vertices:
        down = vertex.exact_B[places[3]][number]
        if not down:
            return None
        found.add(-vertex.exact_A[places[3]][places[1]] / down)
    kt = found.pop()
    return None if found or kt <= 0 else float(kt)
