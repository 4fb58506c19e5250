"""Record of a drive: inputs, rates of states, forces of stops, at all instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.plant.system import Array
from polefence.vehicle.driving.integration import Marched
from polefence.vehicle.driving.model import Model
from polefence.vehicle.driving.scheduling import INSIDE, Reading
from polefence.vehicle.vehicle import Ride

CHUNK = 4_000_000  # numbers held at once


@dataclass(frozen=True, eq=False)
class Record:
    """Arrays (count, time, ...) at all instants; see `driving.result.Drive`.

    ``disturbance`` (time, q) is that of the step which begins at an instant; ``mass`` [kg] is what
    rests on the tyre of a car, infinite for any other plant.
    """

    disturbance: Array
    states: Array
    rates: Array
    demanded: Array
    applied: Array
    stops: Array
    parameters: Array
    used: Array
    mass: Array


def record(model: Model, marched: Marched, reading: Reading | None) -> Record:
    """Return what was the case at every instant; at the last one, the road of the last step.

    Parameters
    ----------
    reading : Reading, optional
        What the law followed, where no controller has recorded what it used and demanded.
    """
    grid, (n, m) = model.grid, model.plant.shape
    total, count, width = marched.z.shape
    q = len(model.courses.space.names)
    x, rates = marched.z[..., :n], np.empty((total, count, n))
    demanded = np.empty((total, count, m)) if marched.demanded is None else marched.demanded
    used = np.empty((total, count, q)) if marched.used is None else marched.used
    true, stops = np.empty((total, count, q)), np.zeros((total, count))
    applied, mass = np.empty((total, count, m)), np.full((total, count), np.inf)
    length = max(1, CHUNK // (count * n * (n + m + 4)))
    for first in range(0, total, length):
        part = slice(first, min(first + length, total))
        k = np.arange(part.start, part.stop)
        last = np.minimum(k, grid.steps - 1)
        times = np.where(k > last, grid.steps - INSIDE, k + INSIDE) * grid.step
        true[part] = model.courses.at(times)
        if reading is not None and marched.used is None:
            given = model.courses.space.inside(reading.at(times))
            used[part], K = given, model.gains(given)
            demanded[part] = (K @ x[part, :, :, None])[..., 0]
        acts = marched.z[part, :, n:] if width > n else model.actuator.limited(demanded[part])
        applied[part] = model.actuator.limited(acts)
        A, B, g = model.open(times, last)
        rates[part] = (A @ x[part, :, :, None] + B @ applied[part][..., None])[..., 0] + g
        if model.known is not None:
            mass[part] = _mass(model, model.known, B)
        if model.stops is not None and model.known is not None:
            i, sense = model.known.places[0], model.known.sense[0]
            stops[part] = model.stops.force(sense * x[part, :, i], sense * rates[part, :, i])
            rates[part] += stops[part, :, None] * B[..., :, model.known.input]
    every = np.arange(total)
    last = np.minimum(every, grid.steps - 1)
    times = np.where(every > last, grid.steps - INSIDE, every + INSIDE) * grid.step
    arrays = (x, rates, demanded, applied, stops, true, used, mass)
    return Record(grid.disturbance(times, last), *(np.swapaxes(v, 0, 1) for v in arrays))


def _mass(model: Model, known: Ride, B: Array) -> Array:
    """Return both masses together, as the force's entries in B say them; the first load's."""
    up, down = (B[..., known.places[i], known.input] for i in (2, 3))
    return np.asarray((model.first_load if model.gravity else 1 / up) - 1 / down)
