"""Requirements by names of signals, which go along wherever a plant is enlarged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.requirements.specification import Specification

Asked = TypeVar("Asked", bound=Specification)


def by_name(
    plant: UncertainPlant, specifications: Sequence[Asked]
) -> tuple[UncertainPlant, tuple[Asked, ...]]:
    """Return requirements by names of signals, and the plant that knows them all.

    A row C of an `Output` fits one number of states. States of a law, of samples or of filters
    make more of them.

    Raises
    ------
    InputError
        If an output has the name of another signal of the plant, or does not fit it.
    """
    named = list[Asked]()
    for specification in specifications:
        if specification.of_signal and not all(isinstance(s, str) for s in specification.entries):
            for signal in specification.outputs(plant):
                plant = _knowing(plant, signal)
            names = tuple(s if isinstance(s, str) else s.name for s in specification.entries)
            specification = replace(specification, signal=names[0] if len(names) == 1 else names)
        named.append(specification)
    return plant, tuple(named)


def _knowing(plant: UncertainPlant, signal: Output) -> UncertainPlant:
    """Return the plant with a signal among its outputs."""
    rows = signal.exact(plant)
    for known in plant.signals:
        if known.name == signal.name:
            if known.exact(plant) != rows:
                raise InputError(
                    f"{plant.name} has another signal {signal.name!r}; give this output a name of "
                    "its own"
                )
            return plant
    return replace(plant, outputs=(*plant.outputs, signal))
