"""Suspensions of any car: where they are in the state, and what a ride on them is judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.cars import Car
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import DEMAND
from polefence.plant.outputs import Output, disturbances, inputs, split, states
from polefence.plant.system import Array
from polefence.plant.tracks import SOURCES
from polefence.proof.short import Short
from polefence.vehicle.vehicle import Ride, masses, ride

TRAVEL = "suspension deflection"
NO_CAR = "is not described as a car; add a table [vehicle] (of a quarter car) or [car] to its spec"


@dataclass(frozen=True, eq=False)
class Corners(Short):
    """Physics of a car at each of its k suspensions.

    Attributes
    ----------
    mass : (..., k) array
        What a suspension's force feels of the body [kg].
    spring, tyre : (..., k) array
        Stiffness of the suspension, without anti-roll bars, and of the tyre [N/m].
    """

    mass: Array
    spring: Array
    tyre: Array


@dataclass(frozen=True, eq=False)
class Suspensions:
    """One or more of them, k, of a plant with n states.

    Attributes
    ----------
    names : tuple of str
        Of their wheels; empty text where there is but one.
    compression : (k, n) array
        Their deflections by the state, positive in compression [m].
    push : callable
        Returns how a force on each, up on the body and down on the wheel, moves the state
        (..., n, k), from A and B at points.
    places : tuple of int
        Numbers of the states that are the car's own: not of hardware, a law or a road.
    body : (k, n) array
        The body's velocity above each wheel, upwards [m/s].
    felt : dict of str to Output
        Vertical accelerations by the name of the seat [m/s2]: of a car that names no seats its
        heave, of a quarter car, by empty text, its sprung mass.
    travel, tyre, force : tuple of Output
        Deflections of suspensions and tyres [m], and forces [N].
    inputs : tuple of int
        Numbers of the inputs that are the forces, or that these follow.
    lags : tuple of (int or None)
        Numbers of the states that are the forces, where they follow their inputs.
    roads : tuple of int
        Numbers of the disturbances that are a road's velocity.
    corners : callable
        Returns the `Corners` at points alpha (..., N).
    """

    names: tuple[str, ...]
    compression: Array
    push: Callable[[Array, Array], Array]
    places: tuple[int, ...]
    body: Array
    felt: dict[str, Output]
    travel: tuple[Output, ...]
    tyre: tuple[Output, ...]
    force: tuple[Output, ...]
    inputs: tuple[int, ...]
    lags: tuple[int | None, ...]
    roads: tuple[int, ...]
    corners: Callable[[Array], Corners]


def in_continuous_time(plant: UncertainPlant) -> UncertainPlant:
    """Return the plant that a sampled one is the samples of; any other as it is."""
    return plant if plant.sampling is None else plant.sampling.plant


def is_car(plant: UncertainPlant) -> bool:
    """Whether the plant, or what it is the samples of, is described as a car."""
    plant = in_continuous_time(plant)
    return plant.vehicle is not None or plant.car is not None


def require_car(plant: UncertainPlant) -> None:
    """Refuse a plant that is no car, nor the samples of one.

    Raises
    ------
    InputError
        Naming what to add to its spec.
    """
    if not is_car(plant):
        raise InputError(f"{plant.name} {NO_CAR}")


def suspensions(plant: UncertainPlant, car: Car | None = None) -> Suspensions:
    """Return the suspensions of a quarter car, or of a car on several wheels.

    Parameters
    ----------
    plant : UncertainPlant
        In continuous time, with or without hardware, states of a law, and roads in tracks.
    car : Car, optional
        The car on several wheels that it is, where it does not know itself.

    Raises
    ------
    InputError
        If the plant is no car.
    """
    car = car or plant.car
    if car is not None:
        return _on_wheels(plant, car)
    known = ride(plant)
    if known is None:
        raise InputError(f"{plant.name} {NO_CAR}")
    return _of_a_quarter_car(plant, known)


def _of_a_quarter_car(plant: UncertainPlant, known: Ride) -> Suspensions:
    eye = np.eye(plant.shape[0])
    first, _, third, _ = known.places

    def corners(alpha: Array) -> Corners:
        car = masses(plant, known, alpha)
        return Corners(car.m1[..., None], car.k[..., None], car.kt[..., None])

    return Suspensions(
        names=("",),
        compression=known.sense[0] * eye[[first]],
        push=lambda A, B: known.push(A, B)[..., None],
        places=known.places,
        body=eye[[third]],
        felt={"": known.acceleration},
        travel=(known.travel,),
        tyre=(known.tyre,),
        force=(known.force,),
        inputs=(known.input,),
        lags=(known.lag,),
        roads=() if known.road is None else (known.road,),
        corners=corners,
    )


def _on_wheels(plant: UncertainPlant, car: Car) -> Suspensions:
    wheels = tuple(wheel.name for wheel in car.wheels)
    known = {signal.name: signal for signal in plant.signals}
    moved = [split(label)[0] for label in car.signals["states"]]
    for name in (*moved, *(f"{wheel} {what}" for wheel in wheels for what in ("force", TRAVEL))):
        if name not in known:
            raise InputError(f"{plant.name} is not the plant of this car: it has no {name!r}")
    names = [state.name for state in states(plant)]
    place = {name: names.index(name) for name in moved}
    forces = tuple(known[f"{wheel} force"] for wheel in wheels)
    lags = tuple(names.index(force.name) if force.name in names else None for force in forces)
    seats = {seat: f"{seat} acceleration" for seat in car.seats} or {"heave": "heave acceleration"}
    travel = tuple(known[f"{wheel} {TRAVEL}"] for wheel in wheels)
    compression = np.array([signal.arrays(plant)[0][0] for signal in travel])
    motions, places = car.body.motions, tuple(place.values())
    up = np.zeros(compression.shape)
    for motion in motions:  # compression is -(g h + tyre deflection), the body's velocity g v
        up[:, place[f"{motion} rate"]] = -compression[:, place[f"{motion} over the road"]]
    chosen = tuple(_input(plant, force.name) for force in forces)

    def push(A: Array, B: Array) -> Array:
        columns = np.zeros((*A.shape[:-1], len(wheels)))
        for i, (number, lag) in enumerate(zip(chosen, lags, strict=True)):
            column = B[..., :, number] if lag is None else A[..., :, lag]
            columns[..., places, i] = column[..., places]
        return columns

    def corners(alpha: Array) -> Corners:
        A, B = plant.at(alpha)
        moved, heave = push(A, B), place["heave over the road"]
        mass, spring, tyre = (np.empty(moved.shape[:-2] + moved.shape[-1:]) for _ in range(3))
        for i, wheel in enumerate(wheels):
            row, force = place[f"{wheel} wheel velocity"], known[f"{wheel} tyre force variation"]
            mass[..., i] = 1 / (moved[..., i] @ up[i])
            # a heave lifts no tyre, and bars do not push against it
            spring[..., i] = -A[..., row, heave] / moved[..., row, i]
            stiffness = force.arrays(plant)[0][:, place[f"{wheel} tyre deflection"]]
            tyre[..., i] = np.asarray(alpha) @ stiffness
        return Corners(mass, spring, tyre)

    roads = (*(name for name in car.places), *SOURCES)
    return Suspensions(
        names=wheels,
        compression=compression,
        push=push,
        places=places,
        body=up,
        felt={seat: known[name] for seat, name in seats.items()},
        travel=travel,
        tyre=tuple(known[f"{wheel} tyre deflection"] for wheel in wheels),
        force=forces,
        inputs=chosen,
        lags=lags,
        roads=tuple(j for j, w in enumerate(disturbances(plant)) if w.name in roads),
        corners=corners,
    )


def _input(plant: UncertainPlant, force: str) -> int:
    """Return the number of the input that is a force, or the demand that an actuator follows."""
    names = [signal.name for signal in inputs(plant)]
    for name in (force, f"{DEMAND}{force}"):
        if name in names:
            return names.index(name)
    raise InputError(f"{plant.name} has no input {force!r}, nor one that {force!r} follows")
