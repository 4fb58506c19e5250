"""Parameters over time, for one car or many, and where they lie."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, ParameterValueError, suggest
from polefence.law.laws import check_alpha
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.vehicle.estimate import corner_weights

Trajectory = Callable[[Array], Any]
# A bound that is a decimal fraction, and its float: this share of the interval apart.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Space:
    """Space of a plant's parameters; without parameters, the weights alpha of its vertices."""

    plant: UncertainPlant

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, or alpha1, alpha2, ..."""
        names = tuple(p.name for p in self.plant.parameters)
        return names or tuple(f"alpha{j + 1}" for j in range(len(self.plant.vertices)))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """SI units."""
        return tuple(p.unit for p in self.plant.parameters) or ("",) * len(self.names)

    @cached_property
    def low(self) -> Array:
        """Lower bounds, (q,)."""
        bounds = [float(p.low) for p in self.plant.parameters]
        return np.array(bounds or [0.0] * len(self.names))

    @cached_property
    def high(self) -> Array:
        """Upper bounds, (q,)."""
        bounds = [float(p.high) for p in self.plant.parameters]
        return np.array(bounds or [1.0] * len(self.names))

    def alpha(self, values: Array) -> Array:
        """Return the vertices' weights at values (..., q); beyond the intervals, extrapolated.

        A and B are multi-affine in the scheduling variables, so that there too they are the
        plant's own.
        """
        if not self.plant.parameters:
            return values
        pairs = []
        for i, p in enumerate(self.plant.parameters):
            low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
            s = 1 / values[..., i] if p.inverted else values[..., i]
            share = (s - low) / (high - low)
            pairs.append(np.stack([1 - share, share], axis=-1))
        return corner_weights(pairs)

    def values(self, alpha: Array) -> Array:
        """Return the values (..., q) that have weights alpha (..., N).

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex, or is no product of parameters' weights.
        """
        alpha = check_alpha(alpha, len(self.plant.vertices))
        if not self.plant.parameters:
            return alpha
        pairs = Domain.of("box", alpha.shape[-1]).coordinates(alpha)
        physical = []
        for i, p in enumerate(self.plant.parameters):
            low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
            s = low + pairs[..., 2 * i + 1] * (high - low)
            physical.append(1 / s if p.inverted else s)
        values = np.stack(physical, axis=-1)
        if np.abs(self.alpha(values) - alpha).max() > ROUNDING:
            raise ParameterValueError(
                "alpha is not a product of the weights of "
                f"{', '.join(self.names)}; give their values"
            )
        return np.clip(values, self.low, self.high)

    def inside(self, values: Array) -> Array:
        """Return the nearest values inside the intervals."""
        if self.plant.parameters:
            return np.asarray(np.clip(values, self.low, self.high))
        return check_alpha(values, len(self.names), clamp=True)

    def distance(self, values: Array) -> Array:
        """Return how far each value lies outside its interval, (..., q); zero inside."""
        over = np.maximum(np.maximum(values - self.high, self.low - values), 0.0)
        return np.asarray(np.where(over > ROUNDING * (self.high - self.low), over, 0.0))


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Values of all parameters over time, one row or one function for each car."""

    space: Space
    cars: tuple[Array | Trajectory, ...]

    @cached_property
    def constant(self) -> bool:
        """Whether nothing moves."""
        return not any(callable(car) for car in self.cars)

    @cached_property
    def _rows(self) -> Array:
        return np.stack([np.asarray(car) for car in self.cars])

    def at(self, times: Array) -> Array:
        """Return values at times (T,), as (T, count, q), or (1, count, q) where nothing moves."""
        if self.constant:
            return self._rows[None]
        values = np.empty((len(times), len(self.cars), len(self.space.names)))
        for j, car in enumerate(self.cars):
            values[:, j] = car(times) if callable(car) else car
        return values

    def check(self, times: Array, outside: bool) -> None:
        """Refuse what is no number, or outside its interval unless ``outside``.

        Raises
        ------
        ParameterValueError
            Naming the first such value.
        """
        values, space = self.at(times), self.space
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            k, _, i = bad[0]
            raise ParameterValueError(f"{space.names[i]} is not finite at {times[k]:g} s")
        if not space.plant.parameters and np.abs(values.sum(axis=-1) - 1).max() > ROUNDING:
            raise ParameterValueError("weights alpha must sum to one at all times")
        for i, p in enumerate(space.plant.parameters):
            if p.inverted and np.any(values[..., i] * float(p.low) <= 0):
                raise ParameterValueError(f"{p.name} reaches zero, where {p.through} has no value")
        bad = np.argwhere(space.distance(values) > 0)
        if len(bad) and not outside:
            k, j, i = bad[0]
            raise ParameterValueError(
                f"{space.names[i]} = {values[k, j, i]:g} {space.units[i]} at {times[k]:g} s lies "
                f"outside [{space.low[i]:g}, {space.high[i]:g}]; the guarantee ends there "
                "(outside=True drives on)"
            )


def read_trajectories(plant: UncertainPlant, given: Any, times: Array) -> Trajectories:
    """Return trajectories of parameters in any of the forms that `drive` takes.

    Raises
    ------
    InputError
        If a parameter is unknown or missing, or a trajectory has another length than the instants.
    """
    space = Space(plant)
    if given is None:
        middle = (space.low + space.high) / 2 if plant.parameters else space.high / len(space.names)
        return Trajectories(space, (middle,))
    if isinstance(given, Mapping):
        return Trajectories(space, (_car(space, given, times),))
    if callable(given):
        return Trajectories(space, (_of_all_parameters(given, len(space.names)),))
    if isinstance(given, Sequence) and given and all(isinstance(g, Mapping) for g in given):
        return Trajectories(space, tuple(_car(space, g, times) for g in given))
    try:
        alpha = np.atleast_2d(np.asarray(given, dtype=float))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            "parameters must be a mapping of names to trajectories, a list of such, or alpha"
        ) from error
    if alpha.ndim != 2 or not alpha.size:
        raise InputError(f"weights alpha must have shape (N,) or (count, N); got {alpha.shape}")
    return Trajectories(space, tuple(space.values(alpha)))


def _car(space: Space, given: Mapping[Any, Any], times: Array) -> Array | Trajectory:
    known = {p.name for p in space.plant.parameters}
    if not known:
        raise InputError(f"{space.plant.name} has no parameters; give weights alpha")
    for name in given:
        if name not in known:
            raise InputError(f"unknown parameter {name!r}; {suggest(str(name), known)}")
    missing = [name for name in space.names if name not in given]
    if missing:
        raise InputError(f"give a trajectory of every parameter; missing: {', '.join(missing)}")
    parts = [_trajectory(name, given[name], times) for name in space.names]
    if not any(callable(part) for part in parts):
        return np.array(parts, dtype=float)

    def values(times: Array) -> Array:
        values = np.empty((len(times), len(parts)))
        for i, part in enumerate(parts):
            values[:, i] = part(times) if callable(part) else part
        return values

    return values


def _trajectory(name: str, given: Any, times: Array) -> float | Trajectory:
    if callable(given):
        return _checked(given, name, ())
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{name}: give a number, Jump, Ramp, Sine, a function of time or an array"
        ) from error
    if values.ndim == 0:
        return float(values)
    if values.shape != times.shape:
        raise InputError(
            f"{name}: an array must have a value at each of the {len(times)} instants; it has "
            f"shape {values.shape}"
        )
    return lambda t: np.interp(t, times, values)


def _of_all_parameters(given: Trajectory, width: int) -> Trajectory:
    return _checked(given, "parameters", (width,))


def _checked(given: Trajectory, name: str, last: tuple[int, ...]) -> Trajectory:
    """Return a user's function with its result checked."""

    def values(times: Array) -> Array:
        try:
            values = np.asarray(given(times), dtype=float)
            return np.broadcast_to(values, (*times.shape, *last))
        except (TypeError, ValueError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                f"{name}: the function must take an array of times and return as many values "
                f"({error})"
            ) from error

    return values
