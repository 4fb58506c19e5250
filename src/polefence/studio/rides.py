"""One car on a road: under its law or without, as heights and signals over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.readable import compared
from polefence.plant.cars import Car
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances
from polefence.plant.system import Array
from polefence.plant.tracks import SHARE, STATE
from polefence.vehicle.comfort import comfort, comfort_reading
from polefence.vehicle.contact import GRAVITY, static_loads
from polefence.vehicle.driving.drive import Run, Setup, run
from polefence.vehicle.driving.parts import BumpStops, Hardware
from polefence.vehicle.excitation import Excitation, on_road, on_wheels
from polefence.vehicle.roads import (
    LONGEST_STEP,
    SECONDS,
    Road,
    both_sides,
    bump,
    grade,
    kerb,
    length_of,
    level_of,
    pothole,
    random_road,
    seconds_over,
)
from polefence.vehicle.suspensions import suspensions
from polefence.vehicle.vehicle import Ride, masses, require_ride, ride

STEP, EVERY = LONGEST_STEP, 20  # [s]; one frame in so many steps


@dataclass(frozen=True)
class RoadChoice:
    """A road that can be chosen.

    Attributes
    ----------
    option : str
        Of `polefence simulate`.
    make : callable
        Returns the road for a speed [m/s] and the seed of a random road, 0 by default.
    words : callable
        Returns the Python that does.
    length : float
        Of an obstacle [m]; 0 of a random road.
    """

    option: str
    make: Callable[..., Road]
    words: Callable[..., str]
    length: float = 0.0

    def seconds(self, speed: float) -> float:
        """Return how long it is driven on, as `polefence simulate` does [s]."""
        return seconds_over(self.length, speed) if self.length else SECONDS


def _random(name: str) -> RoadChoice:
    def make(speed: float, seed: int = 0) -> Road:
        return random_road(name, length_of(speed, SECONDS), seed)

    def words(speed: float, seed: int = 0) -> str:
        return f"pf.vehicle.random_road({name!r}, {length_of(speed, SECONDS)!r}, {seed})"

    return RoadChoice(f"--road {name}", make, words)


def _obstacle(option: str, make: Callable[..., Road], *sizes: float) -> RoadChoice:
    def made(speed: float) -> Road:
        return make(*sizes, **level_of(speed, chosen.seconds(speed)))

    def words(speed: float) -> str:
        ends = (f"{key}={value!r}" for key, value in level_of(speed, chosen.seconds(speed)).items())
        return f"pf.vehicle.{make.__name__}({', '.join((*map(repr, sizes), *ends))})"

    text = " ".join(f"{size:g}" for size in sizes)
    chosen = RoadChoice(f"--{option} {text}", made, words, sizes[-1])
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
class Felt:
    """What is felt at a seat, or of a quarter car's body.

    Attributes
    ----------
    name : str
        Of the seat.
    acceleration : (T,) array
        [m/s2]
    comfort : float
        Weighted rms of it, by ISO 2631-1 [m/s2].
    shocks : bool
        Whether the rms says too little.
    """

    name: str
    acceleration: Array
    comfort: float
    shocks: bool

    @property
    def text(self) -> str:
        """What people in public transport say of it."""
        shocks = "; shocks: the rms says too little" if self.shocks else ""
        return f"{self.comfort:.3g} m/s², {' to '.join(comfort_reading(self.comfort))}{shocks}"

    def beside(self, passive: Felt) -> str:
        """Say how it is beside the passive car's."""
        if not passive.comfort > 0:
            return ""
        said = compared(self.comfort, passive.comfort, "smoother than", "rougher than")
        if said == "the same":
            return "as rough as passive"
        return f"{said} as rough as passive" if said.endswith("times") else f"{said} passive"


@dataclass(frozen=True, eq=False)
class Motion:
    """A car on a road, frame by frame.

    Attributes
    ----------
    time : (T,) array
        [s]
    road, twist : (T, wheels) arrays
        Height of the road under the wheels, and what of it under four wheels no plane fits, which
        the car does not feel [m].
    unsprung, sprung : (T, wheels) arrays
        Heights of the wheels, and of the body above them, over where they rest on a level road [m].
    travel, tyre, force : (T, wheels) arrays
        Compression of the suspension [m]; force of the tyre on the road, its static part included
        [N]; of the actuator, up on the body [N].
    pose : (T, 3) array
        Heave [m], pitch and roll [rad] of the body.
    felt : tuple of Felt
    travel_limit : float
        Where bump stops begin [m]; 0 of none.
    """

    time: Array
    road: Array
    twist: Array
    unsprung: Array
    sprung: Array
    travel: Array
    tyre: Array
    force: Array
    pose: Array
    felt: tuple[Felt, ...]
    travel_limit: float

    @property
    def lifted(self) -> Any:
        """Where a tyre would have to pull, which no tyre does, (T, wheels)."""
        return self.tyre < 0

    @property
    def stopped(self) -> Any:
        """Where a bump stop is hit, (T, wheels)."""
        return (np.abs(self.travel) > self.travel_limit) & (self.travel_limit > 0)

    def height(self, x: float, y: float) -> Array:
        """Return how high a point of the body is over where it rests [m], (T,)."""
        return np.asarray(self.pose @ corners([(x, y)])[0])


def corners(places: Any) -> Array:
    """Return how points (x, y) of the body go up with its heave, pitch and roll, (points, 3)."""
    x, y = np.asarray(places, float).T
    return np.stack([np.ones_like(x), -x, y], axis=1)


def wheels_of(car: Car | None) -> tuple[tuple[str, ...], Array]:
    """Return names and places (x, y) [m] of a car's wheels; a quarter car has one, of no name."""
    if car is None:
        return ("",), np.zeros((1, 2))
    places = [(float(wheel.x), float(wheel.y)) for wheel in car.wheels]
    return tuple(wheel.name for wheel in car.wheels), np.array(places)


def seats_of(car: Car | None) -> tuple[str, ...]:
    """Return where a ride is felt: at the seats of a car, or by the body of one without."""
    return ("body",) if car is None else tuple(car.seats) or ("body",)


def rides(plant: UncertainPlant, car: Car | None) -> bool:
    """Whether a plant is a car that a road moves, and that roads are no part of."""
    if car is not None:
        whole = not any(state.startswith(STATE) for state in plant.states)
        return whole and set(car.places) <= {source.name for source in disturbances(plant)}
    known = ride(plant)
    return known is not None and known.road is not None


@lru_cache(maxsize=4)
def roads(road: str, speed: float, width: float = 0.0) -> tuple[Road, Road]:
    """Return the roads on the left and on the right, of one of `ROADS`.

    Parameters
    ----------
    width : float
        Between wheels on the left and on the right [m]; random roads differ over it.
    """
    chosen = ROADS[road]
    right = chosen.make(speed)
    if chosen.length or not width:
        return right, right
    return both_sides(right, chosen.make(speed, 1), float(SHARE) * width)


def under(car: Car | None, road: str, speed: float) -> tuple[Road, Road]:
    """Return the roads under the left and the right wheels of a car."""
    return roads(road, speed, float(np.ptp(wheels_of(car)[1][:, 1])))


def ridden(
    plant: UncertainPlant,
    car: Car | None,
    law: Any,
    values: Mapping[str, float],
    road: str,
    speed: float,
    travel_limit: float = 0.0,
    dampers: tuple[Damper, ...] = (),
) -> Motion:
    """Drive a car on a road, as `polefence simulate` does.

    Parameters
    ----------
    car : Car, optional
        Of a plant that is one on several wheels.
    law : None or Design
    values : mapping
        Of all parameters.
    road : str
        One of `ROADS`.
    speed : float
        [m/s]
    travel_limit : float
        Of every suspension, either way [m]: where bump stops begin; 0 for none.
    dampers : tuple of Damper
        Controllable ones, that give what a law demands of them.

    Raises
    ------
    InputError
        If the plant is no car, the law cannot be driven, or the loop runs away.
    """
    stops = BumpStops(travel_limit, travel_limit) if travel_limit else None
    moved = _moved(plant, car, road, speed)
    parts = Hardware(stops=stops, dampers=dampers)
    setup = Setup(plant, moved, values or None, hardware=parts, car=car)
    known = None if car is not None else require_ride(plant)
    done = run(setup, law)
    if done.lost is not None:
        raise InputError(f"the loop runs away at {done.lost.first:.4g} s")
    heights = _heights(car, road, speed, setup.time)
    G = corners(wheels_of(car)[1])
    flat = np.linalg.pinv(G)  # fits a plane
    twist = heights - heights @ flat.T @ G.T
    compressed, tyre = _tyres(done, known)
    states = done.response.values[0][:, : plant.shape[0]]
    travel = states @ suspensions(plant, car).compression.T
    unsprung = heights - twist - compressed
    sprung = unsprung - travel
    return Motion(
        time=setup.time[::EVERY],
        road=heights[::EVERY],
        twist=twist[::EVERY],
        unsprung=unsprung[::EVERY],
        sprung=sprung[::EVERY],
        travel=travel[::EVERY],
        tyre=tyre[::EVERY],
        force=_forces(done, known)[::EVERY],
        pose=(sprung @ flat.T)[::EVERY],
        felt=_felt(done, known),
        travel_limit=travel_limit,
    )


def python(
    car: Car | None,
    spec: str,
    values: Mapping[str, float],
    road: str,
    speed: float,
    travel_limit: float,
    dampers: tuple[Damper, ...],
) -> str:
    """Return the Python that drives ``plant`` under ``design`` as `ridden` does."""
    chosen, words = ROADS[road], {"plant": "plant", "roads": "road"}
    across = float(np.ptp(wheels_of(car)[1][:, 1]))
    lines, parts = [f"road = {chosen.words(speed)}"], []
    if car is not None:
        lines.insert(0, f"car = load_car({spec!r})")
        words = {"plant": "plant, car.places", "roads": "(road, road)"}
    if across and not chosen.length:
        width = f"{float(SHARE) * across!r}"
        lines.append(f"roads = pf.vehicle.both_sides(road, {chosen.words(speed, 1)}, {width})")
        words["roads"] = "roads"
    move = "on_road" if car is None else "on_wheels"
    timed = f"{speed!r}, {STEP!r}, {chosen.seconds(speed)!r}"
    lines.append(f"moved = pf.vehicle.{move}({words['plant']}, {words['roads']}, {timed})")
    if travel_limit:
        parts.append(f"stops=pf.vehicle.BumpStops({travel_limit!r}, {travel_limit!r})")
    if dampers:
        parts.append(f"dampers=load_dampers({spec!r})")
    lines.append(f"parts = pf.vehicle.Hardware({', '.join(parts)})")
    end = "" if car is None else ", car=car"
    given = dict(values) or None
    lines.append(f"ride = pf.vehicle.drive(plant, design, moved, {given!r}, parts{end})")
    names = [*(["load_car"] if car is not None else []), *(["load_dampers"] if dampers else [])]
    if names:
        lines.insert(0, f"from polefence.plant.spec import {', '.join(names)}\n")
    return "\n".join(lines)


def _moved(plant: UncertainPlant, car: Car | None, road: str, speed: float) -> Excitation:
    pair, seconds = under(car, road, speed), ROADS[road].seconds(speed)
    if car is None:
        return on_road(plant, pair[0], speed, STEP, seconds)
    return on_wheels(plant, car.places, pair, speed, STEP, seconds)


def _heights(car: Car | None, road: str, speed: float, time: Array) -> Array:
    """Return how much higher the road under each wheel is than where it begins, (T, wheels)."""
    left, right = under(car, road, speed)
    _, places = wheels_of(car)
    under_wheels = []
    for x, y in places:
        track = (left if y > 0 else right).later(float(places[:, 0].max() - x))
        under_wheels.append(
            np.interp(track.distance[0] + speed * time, track.distance, track.height)
        )
    heights = np.stack(under_wheels, axis=1)
    return np.asarray(heights - heights[0])


def _columns(done: Run, names: Sequence[str]) -> Array:
    """Return signals over time, (T, names)."""
    return np.stack([done.response.of(name)[0] for name in names], axis=1)


def _tyres(done: Run, known: Ride | None) -> tuple[Array, Array]:
    """Return how much the tyres are compressed, and their forces on the road, (T, wheels)."""
    plant, alpha = done.setup.plant, done.response.alpha
    car: Any = done.setup.car
    if known is not None:
        car_masses = masses(plant, known, alpha)
        compressed = known.sense[1] * _columns(done, [known.tyre.name])
        return compressed, (car_masses.m1 + car_masses.m2) * GRAVITY + car_masses.kt * compressed
    names = wheels_of(car)[0]
    compressed = _columns(done, [f"{name} tyre deflection" for name in names])
    varied = _columns(done, [f"{name} tyre force variation" for name in names])
    return compressed, static_loads(plant, car, alpha) + varied


def _forces(done: Run, known: Ride | None) -> Array:
    names = [f"{name} force" for name in wheels_of(done.setup.car)[0]]
    return _columns(done, names if known is None else [known.force.name])


def _felt(done: Run, known: Ride | None) -> tuple[Felt, ...]:
    car, every = done.setup.car, []
    for name in seats_of(car):
        signal = f"{name} acceleration" if car and car.seats else "heave acceleration"
        felt = done.response.of(signal if known is None else known.acceleration.name)[0]
        of = comfort(felt, STEP)
        every.append(Felt(name, felt[::EVERY], float(of.weighted_rms), bool(of.shocks)))
    return tuple(every)
