"""Static elements that make a plant unstable: numbers in their sectors, decided exactly.

What the circle criterion does not prove may still be true. A number k for each element, w = k y,
with which a pole of the loop is to the right, refutes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.robust.breaking import BEYOND, decided, failure_at, known_exactly
from polefence.certify.robust.family import short
from polefence.law.law import Law
from polefence.plant.family import UncertainPlant
from polefence.proof.claims.failure import Failure
from polefence.proof.regions import parts_of
from polefence.proof.work import FormatError
from polefence.region.regions import Disk, HalfPlane
from polefence.requirements.sector import FARTHEST, SectorBound


def broken_elements(
    plant: UncertainPlant,
    law: Law,
    limit: SectorBound,
    alpha: Sequence[Fraction],
    within: Fraction = FARTHEST,
) -> Failure | None:
    """Return numbers nearly as near to the centres as any that make the loop unstable at alpha.

    None where none were found, or the plant is not known exactly.

    Parameters
    ----------
    within : Fraction, optional
        By what factor the sectors are wider at most.
    """
    if not known_exactly(plant):
        return None
    with suppress(InputError, FormatError, np.linalg.LinAlgError):
        elements = limit.elements(plant)
        factors, signs = limit.linear(plant, law, np.array([[float(a) for a in alpha]]))
        region = HalfPlane(0) if plant.sample_time is None else Disk(0, 1)
        blank = failure_at(plant, law, parts_of(region.document()), alpha)
        if not np.isfinite(factors[0]):
            return None
        for beyond in BEYOND:
            factor = short(float(factors[0]) * (1 + beyond), up=True)
            if factor > within:
                return None
            numbers = [
                (a + b) / 2 + factor * sign * (b - a) / 2
                for (a, b), sign in zip(elements.sectors, map(Fraction, signs[0]), strict=True)
            ]
            found = replace(elements, sectors=tuple((k, k) for k in numbers))
            failure = decided(replace(blank, elements=found))
            if failure is not None:
                return failure
    return None


def factor_of(failure: Failure, plant: UncertainPlant, limit: SectorBound) -> Fraction:
    """Return by what factor sectors are to be wider to hold the numbers of a failure."""
    elements = limit.elements(plant)
    numbers = () if failure.elements is None else failure.elements.sectors
    return max(
        abs(k - (a + b) / 2) / ((b - a) / 2)
        for (k, _), (a, b) in zip(numbers, elements.sectors, strict=True)
    )
