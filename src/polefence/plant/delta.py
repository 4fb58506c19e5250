"""Plants in discrete time in their delta form, in which they look like those in continuous time.

x(t + T) = A x + B u + E w is (x(t + T) - x(t)) / T = A_d x + B_d u + E_d w with A_d = (A - I) / T,
B_d = B / T and E_d = E / T (Middleton & Goodwin, Digital Control and Estimation, 1990). Its rates
are in 1/s, and as T tends to zero it is x' = A x + B u + E w. A pole z is (z - 1) / T.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.plant.family import UncertainPlant
from polefence.plant.system import Exact, System


def delta_form(plant: UncertainPlant) -> UncertainPlant:
    """Return a plant in discrete time in its delta form; any other as it is."""
    T = plant.sample_time
    if T is None:
        return plant
    vertices = tuple(
        System(_less_identity(v.exact_A, T), _over(v.exact_B, T), _over(v.exact_E, T), v.name)
        for v in plant.vertices
    )
    remainder = plant.remainder and plant.remainder.over(T)
    return replace(plant, vertices=vertices, sample_time=None, step=T, remainder=remainder)


def sampled_form(plant: UncertainPlant) -> UncertainPlant:
    """Return the plant in discrete time of which this is the delta form; any other as it is."""
    if not plant.step:
        return plant
    T = 1 / plant.step
    vertices = tuple(
        System(_more_identity(v.exact_A, T), _over(v.exact_B, T), _over(v.exact_E, T), v.name)
        for v in plant.vertices
    )
    remainder, own = plant.remainder and plant.remainder.over(T), plant.step
    found = replace(plant, vertices=vertices, remainder=remainder)
    return replace(found, sample_time=own, step=Fraction(0))


def _over(matrix: Exact | None, T: Fraction) -> Any:
    return None if matrix is None else tuple(tuple(x / T for x in row) for row in matrix)


def _less_identity(A: Exact, T: Fraction) -> Exact:
    return tuple(tuple((x - (i == j)) / T for j, x in enumerate(row)) for i, row in enumerate(A))


def _more_identity(A: Exact, T: Fraction) -> Exact:
    return tuple(tuple(x / T + (i == j) for j, x in enumerate(row)) for i, row in enumerate(A))
