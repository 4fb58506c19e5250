"""Question of a drive, read and refused where it cannot be driven."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.response.weighting import positive
from polefence.vehicle.driving.integration import stages
from polefence.vehicle.driving.model import Model
from polefence.vehicle.driving.scheduling import Grid
from polefence.vehicle.driving.trajectories import Courses
from polefence.vehicle.excitation import on_road

MOST_STEPS = 10_000_000
LOOKS = 20  # instants at which poles are looked at


def read_grid(
    plant: UncertainPlant,
    road: Any,
    speed: float | None,
    duration: float | None,
    step: float,
    hold: str,
) -> Grid:
    """Return instants and road velocity, from a `Road`, samples, a function or nothing.

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
    E = plant.vertices[0].E
    width = 1 if E is None else E.shape[1]
    if road is not None and any(v.E is None for v in plant.vertices):
        raise InputError(f"{plant.name} says nowhere how a road enters; give E in its spec")
    if hasattr(road, "velocity"):
        if speed is None:
            raise InputError("give the speed [m/s] at which the road is driven")
        return _sampled(on_road(plant, road, speed, step, duration).w[:-1], step, None, True, width)
    if speed is not None:
        raise InputError("speed goes with a Road; samples and functions are in time already")
    if road is None or callable(road):
        if duration is None:
            raise InputError("give the duration of the drive [s]")
        steps = _steps(duration, step)
        return Grid(step, steps, _function(road, width), True)
    try:
        w = np.asarray(road, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError("road must be a Road, samples of its velocity, or a function") from error
    return _sampled(w, step, duration, hold == "held", width)


def _sampled(w: Array, step: float, duration: float | None, held: bool, width: int) -> Grid:
    if w.ndim == 1:
        w = w[:, None]
    if w.ndim != 2 or w.shape[1] != width:
        raise InputError(f"samples of the road have shape {w.shape}; give (time,) or (time, q)")
    bad = np.argwhere(~np.isfinite(w))
    if len(bad):
        raise InputError(f"road: sample {bad[0][0] + 1} of the velocity is not finite; mend it")
    steps = len(w) - (0 if held else 1)
    if duration is not None:
        wanted = _steps(duration, step)
        if wanted > steps:
            raise InputError(
                f"the road has {steps} steps of {step:g} s; {duration:g} s need {wanted}"
            )
        steps = wanted
    if steps < 1:
        raise InputError("the road has no step; give two samples or more")
    return Grid(step, steps, w, held)


def _function(road: Any, width: int) -> Any:
    if road is None:
        return lambda times: np.zeros((len(times), width))

    def values(times: Array) -> Array:
        try:
            found = np.asarray(road(times), dtype=float)
            found = found[:, None] if found.ndim == 1 and len(found) == len(times) else found
            w = np.broadcast_to(found, (len(times), width))
        except (TypeError, ValueError, IndexError) as error:
            raise InputError(
                f"road: the function must take an array of times and return velocities ({error})"
            ) from error
        if not np.all(np.isfinite(w)):
            where = times[~np.isfinite(w).all(axis=1)][0]
            raise InputError(f"road: the velocity at {where:g} s is not finite")
        return w

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


def multiple(period: float, step: float, what: str) -> int:
    """Return how many steps a period has.

    Raises
    ------
    InputError
        If it is no multiple of the step.
    """
    count = round(period / step)
    if count < 1 or abs(period - count * step) > 1e-6 * step:
        near = max(count, 1) * step
        raise InputError(
            f"{what} = {period:g} s is no multiple of the step, {step:g} s; use {near:.6g} s, or "
            "another step"
        )
    return count


def read_start(start: Any, count: int, n: int, width: int) -> Array:
    """Return the state to begin with, (count, width); forces of an actuator are zero."""
    z = np.zeros((count, width))
    if start is not None:
        try:
            z[:, :n] = np.asarray(start, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"start must have shape ({n},) or ({count}, {n})") from error
        if not np.all(np.isfinite(z)):
            raise InputError("start is not finite")
    return z


def fastest_pole(model: Model, courses: Courses, settled: bool) -> float:
    """Return the largest |pole| [1/s] of plant, law, actuator and stops, at instants of the drive.

    Parameters
    ----------
    settled : bool
        The demand is held over a step, so that the law makes no poles; else, where the law is not
        known beforehand, it is looked at at the corners of the family.
    """
    steps = model.grid.steps
    k = np.unique(np.linspace(0, steps - 1, LOOKS).astype(int))
    every = stages(model, k)
    F = every.F
    if every.K is not None:
        F = F + every.B @ every.K
    elif model.reading is None and not settled:
        space = courses.space
        corners = space.values(np.eye(len(model.plant.vertices)))
        K = model.padded(model.gains(corners))
        F = (F + every.B @ K[:, None, None]).reshape(-1, *F.shape[-2:])
    found = _largest(F)
    if model.stops is not None and model.known is not None:
        x, sense, stops = model.known.places[0], model.known.sense[0], model.stops
        row = sense * stops.damping * F[..., x, :]
        row[..., x] += sense * stops.stiffness
        found = max(found, _largest(F + every.S[..., :, None] * row[..., None, :]))
    return max(found, model.actuator.rate)


def _largest(F: Array) -> float:
    return float(np.abs(np.linalg.eigvals(F)).max())


def require_step(model: Model, courses: Courses, settled: bool) -> None:
    """Refuse a fixed step longer than the fastest time constant, 1 / |pole|.

    Runge-Kutta of order four is stable to 2.8 of it; at 1 its error in a step is below 1 %.

    Raises
    ------
    InputError
        Naming the bound.
    """
    fastest, h = fastest_pole(model, courses, settled), model.grid.step
    if fastest * h > 1:
        digits = 10.0 ** (2 - math.floor(math.log10(1 / fastest)))
        bound = math.floor(digits / fastest) / digits
        raise InputError(
            f"step = {h:g} s is too long for the fastest pole, {fastest:.4g} 1/s in size; use at "
            f"most {bound:g} s"
        )
