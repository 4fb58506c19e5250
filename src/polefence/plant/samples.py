"""The claim that a plant is the samples of another."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Exact
from polefence.proof.claims.samples import Samples
from polefence.proof.plant import Plant, Range


def claim_of_samples(plant: UncertainPlant) -> Samples:
    """Return the claim that a plant is the samples of another."""
    own = plant.sampling
    if own is None:
        raise InputError(f"{plant.name} is no plant's samples")
    A, B, E = _matrices(own.plant)
    return Samples(_file(plant), A, B, E, own.delay, own.terms, own.units)


def _matrices(plant: UncertainPlant) -> tuple[list[Any], list[Any], list[Any]]:
    each = ([getattr(v, key) for v in plant.vertices] for key in ("exact_A", "exact_B", "exact_E"))
    A, B, E = ([_rows(M) for M in own if M is not None] for own in each)
    return A, B, E


def _rows(matrix: Exact) -> list[list[Fraction]]:
    return [list(row) for row in matrix]


def _file(plant: UncertainPlant) -> Plant:
    ranges = tuple(Range(p.low, p.high, p.inverted, p.name) for p in plant.parameters)
    A, B, E = _matrices(plant)
    return Plant(A, B, E, ranges, sample_time=plant.sample_time, remainder=plant.remainder)
