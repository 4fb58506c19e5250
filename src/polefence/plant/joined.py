"""Several plants as one: for the search of a law that they share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain

from polefence.base.errors import PlantError
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output


def require_alike(plants: Sequence[UncertainPlant]) -> None:
    """Refuse plants whose laws mean different things.

    Raises
    ------
    PlantError
        If they differ in shape, or in the names of states, inputs or disturbances, or in time.
    """
    first = plants[0]
    for other in plants[1:]:
        if other.shape != first.shape:
            raise PlantError("plants of one law need the same numbers of states and inputs")
        for key in ("states", "inputs", "disturbances", "noise", "sample_time"):
            if getattr(other, key) != getattr(first, key):
                raise PlantError(f"plants of one law need the same {key.replace('_', ' ')}")


def joined(plants: Sequence[UncertainPlant], signals: Iterable[str] = ()) -> UncertainPlant:
    """Return the convex hull of all plants, with the outputs of these names.

    It holds more than the plants: what lies between them. A law for it is one for each of them; to
    prove this of each alone asks less.

    Raises
    ------
    PlantError
        If they differ in what a law is about, or have too many vertices together.
    """
    require_alike(plants)
    first = plants[0]
    vertices = tuple(chain.from_iterable(plant.vertices for plant in plants))
    known = {output.name for output in first.every_output}
    outputs = tuple(_output(plants, name) for name in dict.fromkeys(signals) if name in known)
    return replace(first, vertices=vertices, parameters=(), outputs=outputs, vehicle=None)


def _output(plants: Sequence[UncertainPlant], name: str) -> Output:
    signals = [(plant.signal(name), plant) for plant in plants]
    C, D, F = (
        tuple(row for row in chain.from_iterable(rows) if row)  # none without disturbances
        for rows in zip(*(signal.exact(plant) for signal, plant in signals), strict=True)
    )
    return Output(name, signals[0][0].unit, C, D, F)
