"""Excitation of a plant: a road, steps, impulses, initial states, recorded disturbances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Signal, disturbances, split, states
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.columns import read_columns
from polefence.response.weighting import positive
from polefence.vehicle.roads import Road
from polefence.vehicle.suspensions import suspensions

MOST_STEPS = 10_000_000


@dataclass(frozen=True, eq=False)
class Excitation(Short):
    """Excitation of a plant from time 0 on.

    Attributes
    ----------
    name : str
    step : float
        Between instants [s].
    steps : int
        One less than there are instants.
    w : (steps, q) or (steps + 1, q) array, or function
        Disturbances at the instants; or a function of times (T,) [s] that returns them, (T, q).
    held : bool
        Whether they stay over a step as they are at its beginning; else they run straight.
    start : (n,) or (count, n) array
        State at time 0.
    impulse : (q,) array
        Of the disturbances at time 0 [their units times s].
    road : str, optional
        Name of the road.
    height : (steps + 1,) array, optional
        Of the road under the wheel [m].
    """

    name: str
    step: float
    steps: int
    w: Array | Callable[[Array], Array]
    start: Array
    impulse: Array
    held: bool = True
    road: str | None = None
    height: Array | None = None

    @property
    def times(self) -> Array:
        """All instants [s]."""
        return np.asarray(self.step * np.arange(self.steps + 1))

    @property
    def samples(self) -> Array:
        """Disturbances at all instants, at the last one those of the last step."""
        k = np.minimum(np.arange(self.steps + 1), self.steps - 1)
        return self.disturbance(self.times, k)

    def disturbance(self, times: Array, k: Array) -> Array:
        """Return w (T, q) at times that lie in steps number k."""
        if callable(self.w):
            return self.w(times)
        if self.held:
            return np.asarray(self.w[k])
        share = np.clip(times / self.step - k, 0.0, 1.0)[:, None]
        return np.asarray((1 - share) * self.w[k] + share * self.w[k + 1])

    def begin(self, plant: UncertainPlant, alpha: Array) -> Array:
        """Return the state right after time 0 at points alpha (count, N), (count, n).

        Raises
        ------
        InputError
            If there is not one state, or one for each point.
        """
        try:
            x = np.array(np.broadcast_to(self.start, (len(alpha), plant.shape[0])))
        except ValueError as error:
            n, count = plant.shape[0], len(alpha)
            raise InputError(f"start must have shape ({n},) or ({count}, {n})") from error
        Es = [v.E for v in plant.vertices if v.E is not None]
        if Es and self.impulse.any():
            x += np.tensordot(alpha, np.stack(Es), 1) @ self.impulse
        return x


@explained
def on_road(
    plant: UncertainPlant, road: Road, speed: float, step: float, duration: float | None = None
) -> Excitation:
    """Return a road under a car: under all its wheels, as `on_wheels` does, where it has several.

    Parameters
    ----------
    speed, step : float
        [m/s], [s]
    duration : float, optional
        [s]; as long as the road reaches by default.

    Raises
    ------
    InputError
        If the plant is not described as a car, or as `Road.velocity` raises.
    """
    if plant.car is not None:
        return on_wheels(plant, plant.car.places, road, speed, step, duration)
    roads = suspensions(plant).roads
    if not roads:
        raise InputError(f"{plant.name} has no E, so no road enters; give E in its spec")
    (column,) = roads
    _, mean = road.velocity(speed, step, duration)
    w = np.zeros((len(mean), plant.disturbance_count))
    w[:, column] = mean
    return _driven(plant, road, speed, step, w)


@explained
def on_wheels(
    plant: UncertainPlant,
    places: Mapping[str, Any],
    road: Road | tuple[Road, Road],
    speed: float,
    step: float,
    duration: float | None = None,
) -> Excitation:
    """Return a road under each wheel of a car; wheels behind see it later.

    Parameters
    ----------
    places : mapping of str to (x, y)
        Where each road is, by the name of the disturbance: `Car.places` [m].
    road : Road or pair of them
        Under all wheels, or under those on the left (y above zero) and under the others. It begins
        under the foremost wheels; those behind stand as high as it begins.
    speed, step : float
        [m/s], [s]
    duration : float, optional
        [s]; as long as the road reaches by default.

    Raises
    ------
    InputError
        If the plant has no such disturbance, or one more that is a road, or as `Road.velocity`
        raises.
    """
    names = [disturbance.name for disturbance in disturbances(plant)]
    for name in places:
        if name not in names:
            raise InputError(f"{plant.name} has no disturbance {name!r}; {suggest(name, names)}")
    roads = [disturbance.name for disturbance in disturbances(plant) if disturbance.unit == "m/s"]
    for name in roads:
        if name not in places:
            raise InputError(f"{name!r} is a road too; say where its wheel is, or drive without")
    left, right = (road, road) if isinstance(road, Road) else road
    foremost = max(float(x) for x, _ in places.values())
    w = np.zeros((0, plant.disturbance_count))
    for name, (x, y) in places.items():
        track = left if float(y) > 0 else right
        _, mean = track.later(foremost - float(x)).velocity(speed, step, duration)
        if not len(w):
            w = np.zeros((len(mean), plant.disturbance_count))
        w[:, names.index(name)] = mean[: len(w)]
    return _driven(plant, left, speed, step, w)


def _driven(plant: UncertainPlant, road: Road, speed: float, step: float, w: Array) -> Excitation:
    """Return these disturbances, with the name and the height of a road."""
    where = road.distance[0] + speed * step * np.arange(len(w) + 1)
    height = np.interp(where, road.distance, road.height)
    excitation = _nothing(plant, f"{road.name}, at {speed:g} m/s", step, w)
    return replace(excitation, road=road.name, height=np.asarray(height))


def _nothing(plant: UncertainPlant, name: str, step: float, w: Any, steps: int = 0) -> Excitation:
    """Return disturbances, from rest."""
    rest, quiet = np.zeros(plant.shape[0]), np.zeros(plant.disturbance_count)
    return Excitation(name, step, steps or len(w), w, rest, quiet)


@explained
def disturbed(
    plant: UncertainPlant,
    w: Any = None,
    step: float = 1e-3,
    duration: float | None = None,
    hold: str = "linear",
    start: Any = None,
) -> Excitation:
    """Return disturbances as they are given, from an initial state.

    Parameters
    ----------
    w : (T,) or (T, q) samples, function of times, or None
        A function and None need ``duration``; None: only the initial state.
    step : float
        Between instants [s].
    duration : float, optional
        [s]
    hold : "linear" or "held"
        What samples do in between: run straight to the next, or stay.
    start : (n,) or (count, n) array, optional
        State at time 0; zero by default.

    Raises
    ------
    InputError
        Naming what is missing, not finite, or of another shape.
    """
    step = positive(step, "step [s]")
    if hold not in ("linear", "held"):
        raise InputError(f"hold = {hold!r}; use 'linear' or 'held'")
    if duration is not None:
        duration = positive(duration, "duration [s]")
    if w is not None and not plant.disturbance_count:
        raise InputError(f"{plant.name} has no E, so no disturbance enters; give E in its spec")
    if w is None or callable(w):
        if duration is None:
            raise InputError("give the duration [s]")
        function = _function(w, plant.disturbance_count)
        excitation = _nothing(plant, "a disturbance", step, function, _steps(duration, step))
    else:
        excitation = _sampled(plant, w, step, duration, hold == "held")
    return excitation if start is None else replace(excitation, start=_start(start))


def _start(start: Any) -> Array:
    try:
        x = np.asarray(start, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("start must be numbers, one per state") from error
    if not np.all(np.isfinite(x)):
        raise InputError("start is not finite")
    return x


def _sampled(
    plant: UncertainPlant, given: Any, step: float, duration: float | None, held: bool
) -> Excitation:
    try:
        w = np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("w must be samples of the disturbance, or a function") from error
    w = w[:, None] if w.ndim == 1 else w
    if w.ndim != 2 or w.shape[1] != plant.disturbance_count:
        raise InputError(f"samples of w have shape {w.shape}; give (time,) or (time, q)")
    bad = np.argwhere(~np.isfinite(w))
    if len(bad):
        raise InputError(f"w: sample {bad[0][0] + 1} is not finite; mend it")
    steps = len(w) - (0 if held else 1)
    if duration is not None:
        wanted = _steps(duration, step)
        if wanted > steps:
            raise InputError(f"w has {steps} steps of {step:g} s; {duration:g} s need {wanted}")
        steps = wanted
    if steps < 1:
        raise InputError("w has no step; give two samples or more")
    return replace(_nothing(plant, "a disturbance", step, w, steps), held=held)


def _function(w: Any, width: int) -> Any:
    if w is None:
        return lambda times: np.zeros((len(times), width))

    def values(times: Array) -> Array:
        try:
            values = np.asarray(w(times), dtype=float)
            values = values[:, None] if values.ndim == 1 and len(values) == len(times) else values
            values = np.broadcast_to(values, (len(times), width))
        except (TypeError, ValueError, IndexError) as error:
            raise InputError(
                f"w: the function must take an array of times and return values ({error})"
            ) from error
        if not np.all(np.isfinite(values)):
            where = times[~np.isfinite(values).all(axis=1)][0]
            raise InputError(f"w at {where:g} s is not finite")
        return values

    return values


def _steps(duration: float, step: float) -> int:
    steps = duration / step
    if steps > MOST_STEPS:
        raise InputError(
            f"{steps:.3g} steps; at most {MOST_STEPS} (a longer step, or a shorter drive)"
        )
    if round(steps) < 1:
        raise InputError(f"step = {step:g} s is longer than the duration, {duration:g} s")
    return round(steps)


@explained
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
    sources, known = disturbances(plant), states(plant)
    w = np.zeros((_steps(duration, step), len(sources)))
    w[:] = _sizes(steps or {}, sources, f"disturbance of {plant.name}")
    words = [f"{kind} of {name}" for kind, sizes in (("step", steps), ("impulse", impulses))
             for name in sizes or {}]  # fmt: skip
    words += ["an initial state"] * bool(start)
    excitation = _nothing(plant, " and ".join(words) or "nothing", step, w)
    return replace(
        excitation,
        impulse=_sizes(impulses or {}, sources, f"disturbance of {plant.name}"),
        start=_sizes(start or {}, known, f"state of {plant.name}"),
    )


def _sizes(given: Mapping[str, float], known: tuple[Signal, ...], what: str) -> Array:
    names, sizes = [signal.name for signal in known], np.zeros(len(known))
    for name, size in given.items():
        if name not in names:
            remedy = suggest(name, names) if names else "it has none"
            raise InputError(f"no {what} is called {name!r}; {remedy}")
        if not math.isfinite(size):
            raise InputError(f"{name} = {size!r} must be a finite number")
        sizes[names.index(name)] = size
    return sizes


@explained
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
    table = read_columns(path, 50_000_000, "cut it into shorter ones")
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
    return replace(_nothing(plant, path.name, step, w, len(w) - 1), held=False)


def _columns(path: Path, labels: tuple[str, ...], known: tuple[Signal, ...]) -> list[int]:
    """Return the numbers of the disturbances that the columns are."""
    names = [signal.name for signal in known]
    example = ", ".join(["time [s]", *(signal.label for signal in known)])
    if len(labels) < 2 or split(labels[0]) not in (("time", "s"), ("time", "")):
        raise InputError(f"{path}: row 1 must name the columns, as in: {example}")
    columns = list[int]()
    for label in labels[1:]:
        name, unit = split(label)
        if name not in names or names.index(name) in columns:
            raise InputError(f"{path}: row 1: no disturbance {name!r}, or twice; give {example}")
        if unit and unit != known[names.index(name)].unit:
            raise InputError(
                f"{path}: row 1: {label!r} is in {unit}; {name} is in "
                f"{known[names.index(name)].unit or 'no unit'}"
            )
        columns.append(names.index(name))
    return columns
