"""Plants in discrete time in their delta form, in which they look like those in continuous time.

x(t + T) = A x + B u + E w is (x(t + T) - x(t)) / T = A_d x + B_d u + E_d w with A_d = (A - I) / T,
B_d = B / T and E_d = E / T (Middleton & Goodwin, Digital Control and Estimation, 1990). Its rates
are in 1/s, and as T tends to zero it is x' = A x + B u + E w. A pole z is (z - 1) / T.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from polefence.plant.family import UncertainPlant
from polefence.plant.system import Exact, System


def delta_form(plant: UncertainPlant) -> UncertainPlant:
    """Return a plant in discrete time in its delta form; any other as it is."""
    T = plant.sample_time
    if T is None:
        return plant
    return replace(_over(plant, T, less=Fraction(1)), sample_time=None, step=T)


def sampled_form(plant: UncertainPlant) -> UncertainPlant:
    """Return the plant in discrete time of which this is the delta form; any other as it is."""
    T = plant.step
    if not T:
        return plant
    return replace(_over(plant, 1 / T, less=-1 / T), sample_time=T, step=Fraction(0))


def _over(plant: UncertainPlant, T: Fraction, less: Fraction) -> UncertainPlant:
    """Return the plant with A - less I, B, E and the remainder, each over T."""
    vertices = tuple(
        System(
            tuple(
                tuple((x - less * (i == j)) / T for j, x in enumerate(row))
                for i, row in enumerate(v.exact_A)
            ),
            _divided(v.exact_B, T),
            v.exact_E and _divided(v.exact_E, T),
            v.name,
        )
        for v in plant.vertices
    )
    return replace(plant, vertices=vertices, remainder=plant.remainder and plant.remainder.over(T))


def _divided(matrix: Exact, T: Fraction) -> Exact:
    return tuple(tuple(x / T for x in row) for row in matrix)
