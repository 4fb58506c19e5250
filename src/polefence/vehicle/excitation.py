"""Excitation of a plant: a road, steps, impulses, initial states, recorded disturbances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from polefence.base.columns import read_columns
from polefence.base.errors import InputError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Signal, disturbances, split, states
from polefence.plant.system import Array
from polefence.vehicle.road import Road
from polefence.vehicle.vehicle import require_ride

MAX_BYTES = 50_000_000  # of a recorded disturbance
MOST_STEPS = 10_000_000


@dataclass(frozen=True, eq=False)
class Excitation:
    """What moves a plant from time 0 on.

    Attributes
    ----------
    name : str
    step : float
        Between instants [s].
    w : (time, q) array
        Disturbances at the instants, the last of which is the end.
    held : bool
        Whether they stay over a step as they are at its beginning; else they run straight.
    start : (n,) array
        State at time 0.
    impulse : (q,) array
        Of the disturbances at time 0 [their units times s].
    road : str, optional
        Name of the road.
    height : (time,) array, optional
        Of the road under the wheel [m].
    """

    name: str
    step: float
    w: Array
    start: Array
    impulse: Array
    held: bool = True
    road: str | None = None
    height: Array | None = None

    @property
    def time(self) -> Array:
        """All instants [s]."""
        return np.asarray(self.step * np.arange(len(self.w)))

    def begin(self, plant: UncertainPlant, alpha: Array) -> Array:
        """Return the state right after time 0 at points alpha (count, N), (count, n)."""
        Es = [v.E for v in plant.vertices if v.E is not None]
        if not Es or not self.impulse.any():
            return np.tile(self.start, (len(alpha), 1))
        return np.asarray(self.start + np.tensordot(alpha, np.stack(Es), 1) @ self.impulse)


def on_road(
    plant: UncertainPlant, road: Road, speed: float, step: float, duration: float | None = None
) -> Excitation:
    """Return a road under a car.

    Parameters
    ----------
    speed, step : float
        [m/s], [s]
    duration : float, optional
        [s]; as long as the road reaches by default.

    Raises
    ------
    InputError
        If the plant is not described as a vehicle, or as `Road.velocity` raises.
    """
    column = require_ride(plant).road
    if column is None:
        raise InputError(f"{plant.name} says nowhere how a road enters; give E in its spec")
    _, mean = road.velocity(speed, step, duration)
    w = np.zeros((len(mean) + 1, plant.disturbance_count))
    w[:, column] = np.append(mean, mean[-1])
    where = road.distance[0] + speed * step * np.arange(len(w))
    height = np.interp(where, road.distance, road.height)
    found = _nothing(plant, f"{road.name}, at {speed:g} m/s", step, w)
    return replace(found, road=road.name, height=np.asarray(height))


def _nothing(plant: UncertainPlant, name: str, step: float, w: Array) -> Excitation:
    return Excitation(name, step, w, np.zeros(plant.shape[0]), np.zeros(plant.disturbance_count))


def excited(
    plant: UncertainPlant,
    duration: float,
    step: float,
    steps: Mapping[str, float] | None = None,
    impulses: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
) -> Excitation:
    """Return steps and impulses of disturbances, by their names, from an initial state.

    Parameters
    ----------
    duration, step : float
        [s]
    steps, impulses : mapping of str to float, optional
        Size of each [its unit], [its unit times s].
    start : mapping of str to float, optional
        States at time 0 [their units]; the others are zero.

    Raises
    ------
    InputError
        If the plant has no signal of a name, a size is not finite, or there are too many steps.
    """
    count = duration / step
    if not 0.5 <= count <= MOST_STEPS:
        raise InputError(f"{duration:g} s in steps of {step:g} s; give 1 to {MOST_STEPS} steps")
    sources, known = disturbances(plant), states(plant)
    w = np.zeros((round(count) + 1, len(sources)))
    w[:] = _sizes(steps or {}, sources, f"disturbance of {plant.name}")
    words = [f"{kind} of {name}" for kind, own in (("step", steps), ("impulse", impulses))
             for name in own or {}]  # fmt: skip
    words += ["an initial state"] * bool(start)
    found = _nothing(plant, " and ".join(words) or "nothing", step, w)
    return replace(
        found,
        impulse=_sizes(impulses or {}, sources, f"disturbance of {plant.name}"),
        start=_sizes(start or {}, known, f"state of {plant.name}"),
    )


def _sizes(given: Mapping[str, float], known: tuple[Signal, ...], what: str) -> Array:
    names, found = [signal.name for signal in known], np.zeros(len(known))
    for name, size in given.items():
        if name not in names:
            remedy = suggest(name, names) if names else "it has none"
            raise InputError(f"no {what} is called {name!r}; {remedy}")
        if not math.isfinite(size):
            raise InputError(f"{name} = {size!r} must be a finite number")
        found[names.index(name)] = size
    return found


def recorded(plant: UncertainPlant, path: str | Path, step: float | None = None) -> Excitation:
    """Read disturbances from a CSV file: time [s] first, then a column for each, named as it is.

    Between the rows they run straight; those that have no column are zero.

    Parameters
    ----------
    step : float, optional
        Between instants [s]; by default the shortest time between rows.

    Raises
    ------
    InputError
        Naming the file and the row, if a cell is missing or no finite number, time does not
        increase, a name or a unit is not that of a disturbance, or there are too many steps.
    """
    path = Path(path)
    table = read_columns(path, MAX_BYTES, "cut it into shorter ones")
    known = disturbances(plant)
    places = _columns(path, table.labels, known)
    time, values = table.values[:, 0], table.values[:, 1:]
    if len(time) < 2:
        raise InputError(f"{path}: {len(time)} rows; a disturbance needs two or more")
    for k in range(len(time)):
        if not np.all(np.isfinite(table.values[k])) or (k and time[k] <= time[k - 1]):
            raise InputError(
                f"{path}: row {table.lines[k]}: numbers must be finite, and times increase"
            )
    step = float(np.diff(time).min()) if step is None else step
    count = (time[-1] - time[0]) / step
    if not 0.5 <= count <= MOST_STEPS:
        raise InputError(f"{path}: {count:.3g} steps of {step:g} s; give 1 to {MOST_STEPS}")
    w = np.zeros((math.floor(count * (1 + 1e-12)) + 1, len(known)))
    instants = time[0] + step * np.arange(len(w))
    for column, place in enumerate(places):
        w[:, place] = np.interp(instants, time, values[:, column])
    return replace(_nothing(plant, path.name, step, w), held=False)


def _columns(path: Path, labels: tuple[str, ...], known: tuple[Signal, ...]) -> list[int]:
    """Return the numbers of the disturbances that the columns are."""
    names = [signal.name for signal in known]
    example = ", ".join(["time [s]", *(signal.label for signal in known)])
    if len(labels) < 2 or split(labels[0]) not in (("time", "s"), ("time", "")):
        raise InputError(f"{path}: row 1 must name the columns, as in: {example}")
    found = list[int]()
    for label in labels[1:]:
        name, unit = split(label)
        if name not in names or names.index(name) in found:
            raise InputError(f"{path}: row 1: no disturbance {name!r}, or twice; give {example}")
        if unit and unit != known[names.index(name)].unit:
            raise InputError(
                f"{path}: row 1: {label!r} is in {unit}; {name} is in "
                f"{known[names.index(name)].unit or 'no unit'}"
            )
        found.append(names.index(name))
    return found
