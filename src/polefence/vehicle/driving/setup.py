"""Steps of a drive: what is a multiple of one, and how long one may be."""

from __future__ import annotations

import math

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.system import Array
from polefence.vehicle.driving.integration import stages
from polefence.vehicle.driving.model import Model
from polefence.vehicle.driving.trajectories import Courses

LOOKS = 20  # instants at which poles are looked at


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
