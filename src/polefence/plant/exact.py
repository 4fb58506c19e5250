"""A plant in exact numbers, as files and their proofs have it."""

from __future__ import annotations

from fractions import Fraction

from polefence.plant.family import UncertainPlant
from polefence.proof.plant import Plant
from polefence.proof.ranges import Range

Matrices = list[list[list[Fraction]]]  # of each vertex; none of a key that the plant has not


def bare_plant(plant: UncertainPlant) -> Plant:
    """Return a plant without its names and outputs."""
    A, B, E = matrices_of(plant)
    return Plant(
        A,
        B,
        E,
        ranges_of(plant),
        sample_time=plant.sample_time,
        remainder=plant.remainder,
        functions=plant.functions,
    )


def matrices_of(plant: UncertainPlant) -> tuple[Matrices, Matrices, Matrices]:
    """Return A, B and E at the vertices."""
    A, B, E = (
        [list(map(list, M)) for v in plant.vertices if (M := getattr(v, key)) is not None]
        for key in ("exact_A", "exact_B", "exact_E")
    )
    return A, B, E


def ranges_of(plant: UncertainPlant) -> tuple[Range, ...]:
    """Return the parameters of a plant."""
    return tuple(
        Range(p.low, p.high, p.inverted, p.name, p.unit, p.label, p.rate) for p in plant.parameters
    )
