"""Gains of a drive, and what sensors make of the parameters on the way to them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.law.laws import FixedGain, given_law
from polefence.law.table import GainTable
from polefence.plant.system import Array
from polefence.vehicle.driving.parts import Measured
from polefence.vehicle.driving.trajectories import Courses, Space
from polefence.vehicle.excitation import Excitation

# Jumps at an instant of the grid belong to the step that begins there: a step is looked at this
# share of it inside its ends.
INSIDE = 1e-8

Gains = Callable[[Array], Array]


def gains_of(space: Space, law: Any) -> Gains:
    """Return the function from parameter values (..., q), in or out of bounds, to K (..., m, n)."""
    plant = space.plant
    n, m = plant.shape
    if law is None:
        return lambda values: np.zeros((*values.shape[:-1], m, n))
    if isinstance(law, GainTable):
        names = [p.name for p in plant.parameters]
        if [p.name for p in law.parameters] != names or law.gains.shape[-2:] != (m, n):
            raise InputError(f"the table of gains does not fit {plant.name}")

        def table(values: Array) -> Array:
            points = space.inside(values).reshape(-1, values.shape[-1])
            return law.at(points).reshape(*values.shape[:-1], m, n)

        return table
    own = given_law(plant, law)
    if isinstance(own, FixedGain):
        return lambda values: np.broadcast_to(own.K, (*values.shape[:-1], m, n))
    return lambda values: own.gain(space.alpha(space.inside(values)), clamp=True)


class Reading:
    """What sensors say of the parameters: `Measured`, as a function of time."""

    def __init__(self, courses: Courses, how: Measured, grid: Excitation, period: float) -> None:
        self.courses, self.how, self.grid, self.period = courses, how, grid, period
        space, end = courses.space, float(grid.times[-1])
        for name in how.noise:
            if name not in space.names:
                raise InputError(f"noise: unknown parameter {name!r}; {suggest(name, space.names)}")
        deviation = np.array([how.noise.get(name, 0.0) for name in space.names])
        count = int(end / period) + 2
        random = np.random.default_rng(how.seed)
        noisy = bool(deviation.any())
        shape = (count, len(courses.cars), len(deviation))
        self.noise = random.normal(size=shape) * deviation if noisy else None
        self.constant = courses.constant and not noisy
        self.filtered = None if self.constant or not how.lag else self._filtered()

    def at(self, times: Array) -> Array:
        """Return readings at times (T,), (T, count, q) or (1, count, q)."""
        if self.constant:
            return self.courses.at(times)
        if self.filtered is None:
            return self._raw(times)
        h, lag = self.grid.step, self.how.lag
        k = np.clip((times / h).astype(int), 0, self.grid.steps - 1)
        start, end = self._ends(k)
        return _lagged(self.filtered[k], start, end, (times - k * h)[:, None, None], h, lag)

    def _raw(self, times: Array) -> Array:
        found = self.courses.at(np.maximum(times - self.how.delay, 0.0))
        if self.noise is not None:
            held = np.floor(times / self.period * (1 + 1e-12) + 1e-9).astype(int)
            found = found + self.noise[np.clip(held, 0, len(self.noise) - 1)]
        return found

    def _ends(self, k: Any) -> tuple[Array, Array]:
        h = self.grid.step
        start, end = self._raw((k + INSIDE) * h), self._raw((k + 1 - INSIDE) * h)
        shape = np.broadcast_shapes(start.shape, end.shape)
        return np.broadcast_to(start, shape), np.broadcast_to(end, shape)

    def _filtered(self) -> Array:
        """Return the filter's output at the instants, exact for a straight line in each step."""
        from scipy.signal import lfilter

        h, lag, steps = self.grid.step, self.how.lag, self.grid.steps
        start, end = self._ends(np.arange(steps))
        begin = start[:1]
        after = _lagged(np.zeros(()), start, end, np.array(h), h, lag)
        decay = np.exp(-h / lag)
        found, _ = lfilter([1.0], [1.0, -decay], after, axis=0, zi=decay * begin)
        return np.concatenate([begin, np.broadcast_to(found, (steps, *begin.shape[1:]))])


def _lagged(before: Array, start: Array, end: Array, t: Array, h: float, lag: float) -> Array:
    """Return y at t into a step of lag y' = u - y, u straight from start to end of the step."""
    decay = np.exp(-t / lag)
    slope = (end - start) / h
    return np.asarray(decay * before + start * (1 - decay) + slope * (t - lag * (1 - decay)))
