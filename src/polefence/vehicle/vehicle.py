"""A quarter car, known by its states: what its ride is judged by, its physics.

Either sign of a deflection will do. Which one a plant has is read off its kinematic rows, exactly:
the deflection of the suspension grows like x4 - x3 where compression is positive, like x3 - x4
where extension is; that of the tyre like w - x4 or x4 - w, w being the road's velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.base.errors import InputError
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

    Velocities, accelerations and the force on the sprung mass are positive upwards; a deflection in
    compression, or in extension where ``sense`` says so. All are about the static equilibrium of
    the current load.

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
        Variation of the tyre's force on the road [N], kt times its compression; where the plant's
        matrices say kt, the same at every vertex.
    places : tuple of int
        Numbers of the four `STATES` in the plant's state.
    sense : tuple of int
        Of suspension and tyre: 1 where compression is positive, -1 where extension is.
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
    sense: tuple[int, int] = (1, 1)
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
    """Return the ride signals of a plant that is a quarter car, else None.

    It has states named as `STATES`, with the kinematics of these. Upper and lower case, a hyphen or
    a blank, "tyre" and "tire" are the same; units in brackets and further states do not matter. The
    force is the input named "actuator force", or the only input there is.
    """
    found = _recognised(plant)
    return None if isinstance(found, str) else found


def require_ride(plant: UncertainPlant) -> Ride:
    """Return the ride signals.

    Raises
    ------
    InputError
        If the plant is no quarter car, with what is missing.
    """
    found = _recognised(plant)
    if isinstance(found, str):
        raise InputError(f"{plant.name} is not known as a quarter car; {found}")
    return found


def _recognised(plant: UncertainPlant) -> Ride | str:
    """Return the ride signals, or what is to be mended for them."""
    names = [_plain(name) for name in plant.states]
    number = _force_input(plant)
    if number is None or any(names.count(_plain(wanted)) != 1 for wanted in STATES):
        states_named = ", ".join(repr(name) for name in STATES)
        return f"name four of its states {states_named}, and its only input or {FORCE!r}"
    if plant.sample_time is not None:
        return "it is in discrete time, and a car's equations are in continuous time"
    first, second, third, fourth = (names.index(_plain(wanted)) for wanted in STATES)
    suspension = _sense(plant, first, {third: -1, fourth: 1})
    if not suspension:
        return (
            f"the row of {plant.states[first]!r} in A must be the difference of both velocities: "
            "1 at one of them, -1 at the other, 0 elsewhere and in B and E"
        )
    tyre = _sense(plant, second, {fourth: -1}, road=True)
    if not tyre:
        return (
            f"the row of {plant.states[second]!r} must be the road's velocity less that of the "
            "unsprung mass: -1 in A there and 1 in E, or both signs the other way, 0 elsewhere"
        )
    places, known = (first, second, third, fourth), states(plant)
    kt, force = _tyre_stiffness(plant, places, tyre, number), None
    if kt is not None:
        force = Signal("tyre force variation", "N", state={second: tyre * kt})
    return Ride(
        travel=known[first],
        tyre=known[second],
        acceleration=rate_of(known[third], "sprung-mass acceleration"),
        unsprung=rate_of(known[fourth], "unsprung-mass acceleration"),
        force=inputs(plant)[number],
        tyre_force=force,
        places=places,
        sense=(suspension, tyre),
        input=number,
    )


def _sense(
    plant: UncertainPlant, place: int, compression: dict[int, int], road: bool = False
) -> int:
    """Return 1 where a deflection's row is that of its compression, -1 of its extension, else 0.

    Exactly, at every vertex. With ``road`` its velocity may enter too, in any unit.
    """
    found = set()
    for vertex in plant.vertices:
        row, pushed = vertex.exact_A[place], vertex.exact_B[place]
        entering = () if vertex.exact_E is None else tuple(w for w in vertex.exact_E[place] if w)
        for sense in (1, -1):
            wanted = [sense * compression.get(j, 0) for j in range(len(row))]
            up = all(w * sense > 0 for w in entering) if road else not entering
            if list(row) == wanted and up and not any(pushed):
                found.add(sense)
                break
        else:
            return 0
    return found.pop() if len(found) == 1 else 0


def masses(plant: UncertainPlant, known: Ride, alpha: Array) -> Masses:
    """Return masses, stiffnesses and damping at points alpha (..., N), read off A and B.

    With the force u up on the sprung and down on the unsprung mass,

        m1 dx3/dt = k x1 + c (x4 - x3) + u,     m2 dx4/dt = -k x1 - c (x4 - x3) + kt x2 - u,

    x1 and x2 being compression.

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
    suspension, tyre = known.sense
    return Masses(
        m1,
        m2,
        suspension * m1 * A[..., third, first],
        m1 * A[..., third, fourth],
        tyre * m2 * A[..., fourth, second],
    )


def _plain(name: str) -> str:
    return split(name)[0].casefold().replace("-", " ").replace("tire", "tyre")


def _force_input(plant: UncertainPlant) -> int | None:
    names = [_plain(name) for name in plant.inputs]
    if names.count(_plain(FORCE)) == 1:
        return names.index(_plain(FORCE))
    return 0 if plant.shape[1] == 1 else None


def _tyre_stiffness(
    plant: UncertainPlant, places: tuple[int, int, int, int], sense: int, number: int
) -> float | None:
    """Return kt = -A[4, 2] / B[4], of compression, where that is one positive number, exactly."""
    found = set()
    for vertex in plant.vertices:
        down = vertex.exact_B[places[3]][number]
        if not down:
            return None
        found.add(-sense * vertex.exact_A[places[3]][places[1]] / down)
    kt = found.pop()
    return None if found or kt <= 0 else float(kt)
