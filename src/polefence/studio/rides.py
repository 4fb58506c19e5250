"""One car on a road: under its law and without, as heights and signals over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.vehicle.comfort import comfort, comfort_reading
from polefence.vehicle.contact import GRAVITY
from polefence.vehicle.driving.drive import drive
from polefence.vehicle.excitation import on_road
from polefence.vehicle.roads import Road, bump, grade, kerb, pothole, random_road
from polefence.vehicle.vehicle import masses, require_ride, ride

STEP, EVERY = 1e-3, 20  # [s]; one frame in so many steps
SECONDS = 10.0
LEAD = 0.1  # [s] of level road before an obstacle
WAVE = 100.0  # [m] of random road at least
PASSED, LONG = 3.0, 1.0  # [s] over an obstacle; what takes longer is added


@dataclass(frozen=True)
class RoadChoice:
    """A road that can be chosen.

    Attributes
    ----------
    option : str
        Of `polefence simulate`.
    make : callable
        Returns the road for a speed [m/s].
    length : float
        Of an obstacle [m]; 0 of a random road.
    """

    option: str
    make: Callable[[float], Road]
    length: float = 0.0

    def seconds(self, speed: float) -> float:
        """Return how long it is driven on, as `polefence simulate` does [s]."""
        if not self.length:
            return SECONDS
        over = self.length / speed
        return PASSED + (over if over > LONG else 0.0)


def _random(name: str) -> RoadChoice:
    def make(speed: float) -> Road:
        return random_road(name, max(speed * SECONDS, WAVE), 0)

    return RoadChoice(f"--road {name}", make)


def _obstacle(option: str, make: Callable[..., Road], *sizes: float) -> RoadChoice:
    def made(speed: float) -> Road:
        seconds = chosen.seconds(speed)
        return make(*sizes, before=LEAD * speed, after=seconds * speed)

    text = " ".join(f"{size:g}" for size in sizes)
    chosen = RoadChoice(f"--{option} {text}", made, sizes[-1])
    return chosen


ROADS: Mapping[str, RoadChoice] = {
    "class A": _random("A"),
    "class B": _random("B"),
    "class C": _random("C"),
    "class D": _random("D"),
    "bump, 60 mm": _obstacle("bump", bump, 0.06, 3.0),
    "pothole, 50 mm": _obstacle("pothole", pothole, 0.05, 0.6),
    "kerb, 40 mm": _obstacle("kerb", kerb, 0.04),
    "hill, 6 %": _obstacle("grade", grade, 0.06, 30.0),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """A car on a road, frame by frame.

    Attributes
    ----------
    time, unsprung, sprung : (T,) arrays
        [s]; heights above where they rest on a level road [m].
    acceleration, travel, tyre, force : (T,) arrays
        Of the body [m/s2]; compression of the suspension [m]; force of the tyre on the road, its
        static part included [N]; of the actuator [N].
    comfort : float
        Weighted rms of the acceleration, by ISO 2631-1 [m/s2].
    """

    time: Array
    unsprung: Array
    sprung: Array
    acceleration: Array
    travel: Array
    tyre: Array
    force: Array
    comfort: float

    @property
    def lifted(self) -> Any:
        """Where the tyre would have to pull, which no tyre does, (T,)."""
        return self.tyre < 0

    @property
    def words(self) -> str:
        """What people in public transport say of it."""
        return " to ".join(comfort_reading(self.comfort))


def rides(plant: UncertainPlant) -> bool:
    """Whether a plant is a quarter car that a road moves."""
    known = ride(plant)
    return known is not None and known.road is not None


def ridden(
    plant: UncertainPlant, law: Any, values: Mapping[str, float], road: str, speed: float
) -> tuple[Motion, Array, Array]:
    """Drive a car on a road.

    Parameters
    ----------
    law : None or Design
    values : mapping
        Of all parameters.
    road : str
        One of `ROADS`.
    speed : float
        [m/s]

    Returns
    -------
    Motion
    distance, height : arrays
        Of the road, from where the wheel begins [m].

    Raises
    ------
    InputError
        If the plant is no quarter car, or the law cannot be driven.
    """
    known, chosen = require_ride(plant), ROADS[road]
    own = chosen.make(speed)
    excitation = on_road(plant, own, speed, STEP, chosen.seconds(speed))
    asked = [known.travel, known.tyre, known.acceleration, known.force]
    done = drive(plant, law, excitation, values or None).response(asked)
    travel, tyre, acceleration, force = done.values[0].T
    car = masses(plant, known, done.alpha)
    distance = own.distance - own.distance[0]
    height = own.height - own.height[0]
    under = np.interp(done.time * speed, distance, height)
    compressed = known.sense[1] * tyre
    unsprung = under - compressed
    sprung = unsprung - known.sense[0] * travel
    static = float(car.m1[0] + car.m2[0]) * GRAVITY
    motion = Motion(
        time=done.time[::EVERY],
        unsprung=unsprung[::EVERY],
        sprung=sprung[::EVERY],
        acceleration=acceleration[::EVERY],
        travel=known.sense[0] * travel[::EVERY],
        tyre=static + float(car.kt[0]) * compressed[::EVERY],
        force=force[::EVERY],
        comfort=float(comfort(acceleration, STEP).weighted_rms),
    )
    return motion, distance, height
