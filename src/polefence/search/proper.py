"""Which entries of a law are zero, so that no disturbance passes into a signal of infinite size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from polefence.base.errors import InputError
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import stacked
from polefence.plant.system import Array
from polefence.requirements.specification import Specification


def proper(
    structure: Structure, plant: UncertainPlant, asked: Sequence[Specification]
) -> Structure:
    """Return the structure with zeros where a disturbance may not pass straight through.

    An rms has no bound where white noise passes into its signal, nor has a peak where a disturbance
    of bounded energy or an impulse does: by a gain from what it passes into to an input that passes
    into the signal. Laws with states of their own are then strictly proper there.

    Raises
    ------
    InputError
        If nothing is left of a law without states of its own.
    """
    larger, gain = structure.extended(plant)
    F = gain.passing_rows(larger)
    if F is None:
        return structure
    blocked = np.zeros((larger.shape[1], F.shape[1]), dtype=bool)
    for specification in asked:
        specification.require_samples(plant, F)
        if specification.of_signal and not specification.direct:
            n, more = plant.shape[0], larger.shape[0] - plant.shape[0]
            limit = specification.extended(n, more) if more else specification
            through = np.any(limit.passed(larger, F), axis=(0, 2))
            blocked |= np.outer(_direct(limit, larger), through)
    (m, _), r = plant.shape[::-1], F.shape[1] - structure.order
    blocked = blocked[:m, :r]
    if not np.any(blocked):
        return structure
    pattern = structure.pattern or tuple(
        tuple(f"entry {i + 1} {j + 1}" for j in range(r)) for i in range(m)
    )
    pattern = tuple(
        tuple("0" if none else entry for entry, none in zip(*row, strict=True))
        for row in zip(pattern, blocked, strict=True)
    )
    if not structure.order and not any(entry != "0" for row in pattern for entry in row):
        names = ", ".join(repr(y.name) for y in gain.outputs(larger) if y.F)
        raise InputError(
            f"measured: a disturbance passes straight into {names}, and by any gain into what is "
            "bounded, of which nothing is proved then; give the law an order, or a sensor a "
            "bandwidth"
        )
    return replace(structure, pattern=pattern)


def whitened(structure: Structure, plant: UncertainPlant) -> bool:
    """Whether a law may have white noise in an input: what is proved of others is not of it."""
    larger, gain = structure.extended(plant)
    F = gain.passing_rows(larger)
    if F is None:
        return False
    free = gain.free(larger)[: plant.shape[1]] >= 0
    return bool(np.any(free[:, np.any(F, axis=(0, 2))]))


def _direct(limit: Specification, plant: UncertainPlant) -> Array:
    """Return which inputs pass straight into what is bounded, (m,)."""
    outputs = zip(limit.outputs(plant), limit.filters, strict=True)
    plain = [output for output, behind in outputs if behind is None]
    if not plain:
        return np.zeros(plant.shape[1], dtype=bool)
    return np.asarray(np.any(stacked(plant, plain)[1], axis=(0, 1)))
