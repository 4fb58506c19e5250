"""Plants to and from python-control; needs the extra ``polefence[control]``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from polefence.base.errors import MissingExtraError, ParameterValueError, PlantError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import System

_NUMBERED = re.compile(r"(sys|[xu])\[\d+\]")  # what python-control calls that which has no name


def _control() -> Any:
    try:
        import control
    except ImportError as error:
        raise MissingExtraError(
            "python-control is not installed; pip install 'polefence[control]'"
        ) from error
    return control


def from_control(systems: Any, disturbances: int = 0, name: str = "") -> UncertainPlant:
    """Return the polytope whose vertices are python-control ``StateSpace`` systems.

    Parameters
    ----------
    systems : control.StateSpace or sequence of them
        One, or one a vertex: all of one shape, in continuous time or of one sample time. States and
        inputs keep the names that they were given. For the outputs see
        `polefence.response.signals.outputs_of`; ``system.C`` is what `observe` takes as measured.
    disturbances : int
        How many of the last inputs are disturbances (columns of E) rather than controls.
    name : str
        Of the plant; by default that of the first system, where it was given one.

    Raises
    ------
    PlantError
        If a system is no ``StateSpace``, of another time or other names than the first, or leaves
        no control input.
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    given = [systems] if isinstance(systems, control.InputOutputSystem) else list(systems)
    if not given:
        raise PlantError("a plant needs at least one vertex")
    for j, system in enumerate(given):
        _require_vertex(control, system, given[0], f"system {j + 1}", disturbances)
    first = given[0]
    m = first.ninputs - disturbances
    return UncertainPlant.from_vertices(
        [s.A for s in given],
        [s.B[:, :m] for s in given],
        [s.B[:, m:] for s in given] if disturbances else None,
        name=name or _own([first.name], "plant"),
        states=_names(first.state_labels),
        inputs=_names(first.input_labels[:m]),
        disturbances=_names(first.input_labels[m:]),
        sample_time=first.dt or None,
    )


def _require_vertex(control: Any, system: Any, first: Any, where: str, disturbances: int) -> None:
    if not isinstance(system, control.StateSpace):
        kind = type(system).__name__
        raise PlantError(f"{where} is a {kind}, no StateSpace; control.ss() makes one")
    if system.dt is True:
        raise PlantError(f"{where} is in discrete time without a sample time; give its dt [s]")
    if (system.dt or 0) != (first.dt or 0):
        raise PlantError(f"{where} has dt = {system.dt}, system 1 {first.dt}; they must agree")
    if system.nstates < 1:
        raise PlantError(f"{where} has no states; nothing has poles")
    if not 0 <= disturbances < system.ninputs:
        raise PlantError(
            f"{where} has {system.ninputs} inputs; {disturbances} disturbances leave no control "
            "input"
        )
    for key in ("state_labels", "input_labels"):
        own, others = getattr(system, key), getattr(first, key)
        if len(own) == len(others) and _names(own) and _names(own) != _names(others):
            raise PlantError(f"{where} names other signals than system 1: {', '.join(own)}")


def _names(labels: Sequence[str]) -> tuple[str, ...]:
    """Return names, none where python-control has only numbered the signals."""
    return () if all(map(_NUMBERED.fullmatch, labels)) else tuple(labels)


def _own(labels: Sequence[str], otherwise: str) -> str:
    return "".join(_names(labels)) or otherwise


def to_control(plant: UncertainPlant | System, alpha: Any = None) -> Any:
    """Return a plant, or one vertex of it, as a python-control ``StateSpace``.

    Parameters
    ----------
    plant : UncertainPlant or System
        A `System` has no names.
    alpha : sequence of N numbers, optional
        The point of the polytope, for example ``plant.alpha(m1=300, beta=2)``; may be left out
        where there is one vertex.

    Returns
    -------
    control.StateSpace
        Inputs [u, w], outputs the states, under the names that `Design.to_control` has too, so that
        the two interconnect by name.

    Raises
    ------
    ParameterValueError
        If alpha is missing or no point of the polytope.
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    if isinstance(plant, System):
        plant = UncertainPlant((plant,), name=plant.name)
    A, B = plant.at(_point(plant, alpha))
    if plant.vertices[0].E is not None:
        E = np.tensordot(_point(plant, alpha), [v.E for v in plant.vertices], 1)
        B = np.hstack([B, E])
    n, (x, u, w) = len(A), signal_names(plant)
    labels: dict[str, Any] = {"states": x, "outputs": x, "inputs": [*u, *w]}
    dt = 0 if plant.sample_time is None else float(plant.sample_time)
    (name,) = valid_names([plant.name])
    return control.ss(A, B, np.eye(n), np.zeros((n, B.shape[1])), dt, name=name, **labels)


def _point(plant: UncertainPlant, alpha: Any) -> Any:
    count = len(plant.vertices)
    if alpha is None and count > 1:
        raise ParameterValueError(f"{plant.name} has {count} vertices; give alpha, one weight each")
    weights = np.ones(1) if alpha is None else np.asarray(alpha, dtype=float)
    inside = weights.shape == (count,) and weights.min() >= 0 and abs(weights.sum() - 1) < 1e-9
    if not inside:
        raise ParameterValueError(f"alpha must be {count} weights, zero or more, that sum to one")
    return weights


def signal_names(
    plant: UncertainPlant, before: Sequence[str] = ()
) -> tuple[list[str], list[str], list[str]]:
    """Return names of states, inputs and disturbances for python-control, all different.

    Parameters
    ----------
    before : sequence of str
        Names that are taken already.
    """
    n, m = plant.shape
    E = plant.vertices[0].exact_E
    states = plant.states or [f"x{j + 1}" for j in range(n)]
    inputs = plant.inputs or [f"u{j + 1}" for j in range(m)]
    others = plant.disturbances or [f"w{j + 1}" for j in range(0 if E is None else len(E[0]))]
    found = valid_names((*before, *states, *inputs, *others))[len(before) :]
    return found[:n], found[n : n + m], found[n + m :]


def valid_names(names: Iterable[str]) -> list[str]:
    """Return names for python-control: without units, of letters, digits and _, no two the same."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"\W+", "_", re.sub(r"\[[^\]]*\]", "", name), flags=re.ASCII).strip("_")
        plain = plain if plain and not plain[0].isdigit() else f"signal_{plain}".rstrip("_")
        own, count = plain, 1
        while own in found:
            count += 1
            own = f"{plain}_{count}"
        found.append(own)
    return found
