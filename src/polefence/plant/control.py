"""Plants to and from python-control; needs the extra ``polefence[control]``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from polefence.errors import MissingExtraError, PlantError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import System


def _control() -> Any:
    try:
        import control
    except ImportError as error:
        raise MissingExtraError(
            "python-control is not installed; pip install 'polefence[control]'"
        ) from error
    return control


def from_control(
    systems: Sequence[Any], disturbances: int = 0, name: str = "plant"
) -> UncertainPlant:
    """Return the polytope whose vertices are python-control ``StateSpace`` systems.

    Parameters
    ----------
    systems : sequence of control.StateSpace
        Continuous time, all of one shape; outputs are not used.
    disturbances : int
        How many of the last inputs are disturbances (columns of E) rather than controls.

    Raises
    ------
    PlantError
        If a system is not a continuous-time ``StateSpace``, or leaves no control input.
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    for j, system in enumerate(systems):
        if not isinstance(system, control.StateSpace) or not system.isctime():
            raise PlantError(f"system {j + 1} is not a continuous-time StateSpace")
        if not 0 <= disturbances < system.ninputs:
            raise PlantError(
                f"system {j + 1} has {system.ninputs} inputs; {disturbances} disturbances leave "
                "no control input"
            )
    if not systems:
        raise PlantError("a plant needs at least one vertex")
    m = systems[0].ninputs - disturbances
    return UncertainPlant.from_vertices(
        [s.A for s in systems],
        [s.B[:, :m] for s in systems],
        [s.B[:, m:] for s in systems] if disturbances else None,
        name=name,
        states=tuple(systems[0].state_labels),
        inputs=tuple(systems[0].input_labels[:m]),
        disturbances=tuple(systems[0].input_labels[m:]),
    )


def to_control(system: System) -> Any:
    """Return a system as a python-control ``StateSpace``, inputs [u, w], outputs the states.

    Raises
    ------
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    n, _ = system.shape
    B = system.B if system.E is None else np.hstack([system.B, system.E])
    return control.ss(system.A, B, np.eye(n), np.zeros((n, B.shape[1])))
