"""A plant of a spec as a model of what was measured: its signals at values of its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.data.local import Model, Signals
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances, inputs, rows_at


def model_at(plant: UncertainPlant, signals: Signals, values: Mapping[str, float]) -> Model:
    """Return the plant at values of its parameters, from the signals that act to the measured.

    Raises
    ------
    InputError
        If it has no such signal, or a value is not in its range.
    """
    given: dict[str, Any] = {p.name: values[p.name] for p in plant.parameters}
    alpha = plant.alpha(**given) if given else np.ones(1)
    A, B = plant.at(alpha)
    driven = plant.driven(alpha) if plant.disturbance_count else np.zeros((len(A), 0))
    C, D, F = rows_at(plant, [plant.signal(name) for name in signals.outputs], alpha)
    names = [signal.name for signal in (*inputs(plant), *disturbances(plant))]
    columns = list[int]()
    for name in signals.inputs:
        if name not in names:
            raise InputError(f"{plant.name} has no input {name!r}; {suggest(name, names)}")
        columns.append(names.index(name))
    return Model(A, np.hstack([B, driven])[:, columns], C, np.hstack([D, F])[:, columns])
