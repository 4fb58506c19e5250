"""Closed loops of a family under a law, for many parameter values at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.law.laws import check_alpha, law_or_table
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at, values_text
from polefence.plant.system import Array, floats


@dataclass(frozen=True, eq=False)
class Loops:
    """x' = (A + B K) x + E w at ``count`` points of the family; in discrete time the delta form.

    Attributes
    ----------
    plant : UncertainPlant
    alpha : (count, N) array
    A, B, E, K : (count, n, n), (count, n, m), (count, n, q), (count, m, n) arrays
        E is the loop's: with what passes from disturbances to inputs.
    passing : (count, m, q) array
        What does, of u = K x + passing w.
    """

    plant: UncertainPlant
    alpha: Array
    A: Array
    B: Array
    E: Array
    K: Array
    passing: Array

    @property
    def step(self) -> float:
        """The sample time of a delta form [s]; zero in continuous time."""
        return float(self.plant.step)

    @property
    def closed(self) -> Array:
        """A + B K, (count, n, n)."""
        return np.asarray(self.A + self.B @ self.K)

    @property
    def passed(self) -> Array | None:
        """What passes from disturbances to inputs, None where nothing does."""
        return self.passing if self.passing.any() else None

    def poles(self) -> Array:
        """Closed-loop poles, (count, n) complex; (z - 1) / T of a delta form."""
        return np.asarray(np.linalg.eigvals(self.closed))


def close(plant: UncertainPlant, law: Any, alpha: Any, disturbed: bool = True) -> Loops:
    """Close a law around the plant at points alpha.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    alpha : (count, N) or (N,) array
    disturbed : bool
        False takes a plant that names no disturbance too; E then has no columns.

    Raises
    ------
    InputError
        If the law does not fit the plant, or the plant names no disturbance (no E); if alpha lies
        off the simplex by more than rounding.
    """
    plant = delta_form(plant)
    alpha = np.atleast_2d(floats(alpha, "alpha"))
    if alpha.ndim > 2 or not len(alpha):
        raise InputError(f"alpha has shape {alpha.shape}; give (count, {len(plant.vertices)})")
    alpha = check_alpha(alpha, len(plant.vertices))
    A, B = plant.at(alpha)
    Es = [v.E for v in plant.vertices]
    if any(E is None for E in Es):
        if not disturbed:
            nothing = np.zeros((len(alpha), sum(plant.shape), 0))
            E, passed = np.split(nothing, [plant.shape[0]], axis=1)
            return Loops(plant, alpha, A, B, E, gains(plant, law, alpha), passed)
        raise InputError(
            f"{plant.name} has no E, so no disturbance enters; give E for every vertex, or "
            "in [matrices]"
        )
    E, passed = plant.driven(alpha), passing(plant, law, alpha)
    return Loops(plant, alpha, A, B, E + B @ passed, gains(plant, law, alpha), passed)


def gains(plant: UncertainPlant, law: Any, alpha: Array) -> Array:
    """Return K at every alpha, (count, m, n); zero where there is no law."""
    n, m = plant.shape
    if law is None:
        return np.zeros((len(alpha), m, n))
    return law_or_table(plant, law).over(plant, alpha)


def passing(plant: UncertainPlant, law: Any, alpha: Array) -> Array:
    """Return what passes straight from disturbances to inputs, (count, m, q)."""
    nothing = np.zeros((len(alpha), plant.shape[1], plant.disturbance_count))
    if law is None:
        return nothing
    passed = law_or_table(plant, law).passing(alpha)
    return nothing if passed is None else passed


def point_text(plant: UncertainPlant, alpha: Array) -> str:
    """Name a point of the family: by its parameters' values where it has them, else by alpha."""
    values = values_at(plant, alpha.tolist())
    if values is not None:
        return values_text(plant, values)
    return f"alpha = {[float(f'{a:.6g}') for a in alpha]}"
