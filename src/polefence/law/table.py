"""A gain that is looked up in a table: analysed, not one of the laws with a proof of their own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import prod
from typing import Any

import numpy as np

from polefence.base.errors import InputError, ParameterValueError, suggest
from polefence.base.explained import explained, explained_fields
from polefence.law.law import more_columns
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter, exact
from polefence.plant.points import values_at
from polefence.plant.system import Array
from polefence.proof.claims.cells import MAX_KNOTS
from polefence.proof.short import Short

LARGEST = 1e100


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Short):
    """u = K(p) x, K multi-linear in the physical parameters between the knots of a grid.

    Parameters
    ----------
    parameters : tuple of Parameter
        The plant's, in its order.
    grid : mapping
        Name of each parameter to its knots, rising, from its lower to its upper bound or beyond.
    gains : (k1, k2, ..., m, n) array
        The gain at every knot, axes in the order of ``parameters``.

    Raises
    ------
    InputError
        If a parameter or knot is missing, knots do not rise or do not cover the interval, or the
        shapes do not fit.
    """

    parameters: tuple[Parameter, ...]
    grid: Mapping[str, Sequence[Any]]
    gains: Array
    fixed = False
    exact = None  # which no claim is about

    @explained_fields
    def __post_init__(self) -> None:
        names = [p.name for p in self.parameters]
        if not names:
            raise InputError("a table of gains needs a plant with parameters")
        for name in self.grid:
            if name not in names:
                raise InputError(f"grid: unknown parameter {name!r}; {suggest(str(name), names)}")
        for name in names:
            if name not in self.grid:
                raise InputError(f"grid: the knots of {name} are missing")
        knots = {p.name: _knots(p, self.grid[p.name]) for p in self.parameters}
        object.__setattr__(self, "grid", knots)
        try:
            gains: Array = np.array(self.gains, dtype=float)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError("gains must be nested lists of numbers, all of one shape") from error
        shape = tuple(len(knots[name]) for name in names)
        if gains.ndim != len(names) + 2 or gains.shape[: len(names)] != shape:
            raise InputError(f"gains has shape {gains.shape}; the grid needs {shape} + (m, n)")
        if not np.all(np.abs(gains) <= LARGEST):
            raise InputError(f"gains must be finite numbers, of magnitudes up to {LARGEST:g}")
        gains.flags.writeable = False
        object.__setattr__(self, "gains", gains)

    def __repr__(self) -> str:
        sizes = " x ".join(str(len(k)) for k in self.grid.values())
        m, n = self.gains.shape[-2:]
        return f"<GainTable {m} x {n}, {sizes} knots>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        known = (
            (name, f"{len(knots)} knots from {float(knots[0]):g} to {float(knots[-1]):g}")
            for name, knots in self.grid.items()
        )
        m, n = self.gains.shape[-2:]
        return card("u = K(p) x, from a table", [("gains", f"{m} x {n}"), *known])

    @cached_property
    def axes(self) -> list[Array]:
        """Knots of each parameter, in floats."""
        return [np.array([float(v) for v in self.grid[p.name]]) for p in self.parameters]

    def passing(self, alpha: Array) -> Array | None:  # noqa: ARG002
        """Return None: it is of all states, and no disturbance passes into these."""
        return None

    def over(self, plant: UncertainPlant, alpha: Array) -> Array:
        """Return the gains at points alpha (count, N) of a plant, (count, m, n).

        Raises
        ------
        InputError
            If a point is of no parameters.
        """
        values = [values_at(plant, a) for a in alpha]
        if any(v is None for v in values):
            raise InputError(f"a table of gains needs the parameters of {plant.name}")
        return np.stack([self.gain_at(clamp=True, **v) for v in values if v is not None])

    def with_states(self, more: int) -> GainTable:
        """Return it for a plant with more states behind its n, which are not fed back."""
        return replace(self, gains=more_columns(self.gains, more))

    @property
    def flat(self) -> Array:
        """All gains in one row, the first parameter varying slowest."""
        return self.gains.reshape(-1, *self.gains.shape[-2:])

    @explained
    def gain_at(self, clamp: bool = False, **values: Any) -> Array:
        """Return K at physical parameter values.

        Raises
        ------
        ParameterValueError
            If a value is missing, unknown, or outside its interval (unless ``clamp``).
        """
        names = [p.name for p in self.parameters]
        if set(values) != set(names):
            raise ParameterValueError(f"give a value of every parameter: {', '.join(names)}")
        point = []
        for p in self.parameters:
            p.weights(values[p.name], clamp)  # refuses what lies outside
            point.append(min(max(float(values[p.name]), float(p.low)), float(p.high)))
        return np.asarray(self.at(np.array([point]))[0])

    @explained
    def at(self, points: Array) -> Array:
        """Return K at points (count, parameters), as (count, m, n)."""
        K = np.zeros((len(points), *self.gains.shape[-2:]))
        places = []
        for axis, column in zip(self.axes, points.T, strict=True):
            i = np.clip(np.searchsorted(axis, column, side="right") - 1, 0, len(axis) - 2)
            places.append((i, (column - axis[i]) / (axis[i + 1] - axis[i])))
        for corner in np.ndindex(*(2,) * len(places)):
            weight = prod(t if bit else 1 - t for (_, t), bit in zip(places, corner, strict=True))
            index = tuple(i + bit for (i, _), bit in zip(places, corner, strict=True))
            K += np.asarray(weight)[:, None, None] * self.gains[index]
        return K


def _knots(parameter: Parameter, given: Sequence[Any]) -> tuple[Fraction, ...]:
    where = f"grid: knots of {parameter.name}"
    if isinstance(given, str | Mapping) or not isinstance(given, Iterable):
        raise InputError(f"{where} must be a list of numbers")
    knots = [exact(v, where) for v in given]
    if not 2 <= len(knots) <= MAX_KNOTS:
        raise InputError(f"{where}: {len(knots)} given; use 2 to {MAX_KNOTS}")
    # a float bound is not the decimal one
    rounding = (parameter.high - parameter.low) / 10**12
    for i, bound in ((0, parameter.low), (-1, parameter.high)):
        if abs(knots[i] - bound) <= rounding:
            knots[i] = bound
    if not all(a < b for a, b in pairwise(knots)):
        raise InputError(f"{where} must rise")
    if knots[0] > parameter.low or knots[-1] < parameter.high:
        raise InputError(
            f"{where} must cover [{float(parameter.low):g}, {float(parameter.high):g}]"
        )
    return tuple(knots)


def table_from(parameters: tuple[Parameter, ...], data: Any) -> GainTable:
    """Return a table from plain data, {"grid": {name: knots}, "gains": nested lists}.

    The gains may be called K.

    Raises
    ------
    InputError
        If it is malformed or does not fit the parameters.
    """
    if isinstance(data, dict) and set(data) == {"grid", "K"}:
        data = {"grid": data["grid"], "gains": data["K"]}
    if not isinstance(data, dict) or set(data) != {"grid", "gains"}:
        raise InputError('a table of gains is {"grid": {name: knots}, "gains": nested lists}')
    if not isinstance(data["grid"], dict):
        raise InputError('grid must name the knots of each parameter: {"m1": [...], ...}')
    return GainTable(parameters, data["grid"], data["gains"])
