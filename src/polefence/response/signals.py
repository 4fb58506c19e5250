"""Signals: states, their rates of change, inputs, and sums of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array

_UNIT = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\]]*)\]$")


@dataclass(frozen=True)
class Signal:
    """y = state . x + rate . dx/dt + input . u, with weights by state and input number.

    Attributes
    ----------
    name : str
    unit : str
    state, rate, input : mapping of int to float
        Weights; what is not named has none.
    """

    name: str
    unit: str
    state: dict[int, float] = field(default_factory=dict)
    rate: dict[int, float] = field(default_factory=dict)
    input: dict[int, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name and unit, as an axis has them."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def split(label: str) -> tuple[str, str]:
    """Return name and unit of "name [unit]"; the unit is empty where none is given."""
    found = _UNIT.match(label.strip())
    return (found["name"], found["unit"]) if found else (label.strip(), "")


def states(plant: UncertainPlant) -> tuple[Signal, ...]:
    """Return a signal for every state, named as the plant names it, else x1, x2, ..."""
    names = plant.states or tuple(f"x{i + 1}" for i in range(plant.shape[0]))
    return tuple(Signal(*split(name), state={i: 1.0}) for i, name in enumerate(names))


def inputs(plant: UncertainPlant) -> tuple[Signal, ...]:
    """Return a signal for every input, named as the plant names it, else u1, u2, ..."""
    names = plant.inputs or tuple(f"u{i + 1}" for i in range(plant.shape[1]))
    return tuple(Signal(*split(name), input={i: 1.0}) for i, name in enumerate(names))


def outputs_of(system: Any) -> tuple[Signal, ...]:
    """Return the outputs y = C x + D u of a python-control ``StateSpace``, under their names.

    Where vertices have one C and D, as they must have here, those of any. Signals go where a
    specification or a response asks for one.

    Parameters
    ----------
    system : control.StateSpace
        The columns of D that belong to disturbances must be zero, or the signals do not fit.
    """
    return tuple(
        Signal(
            *split(re.sub(r"^y\[(\d+)\]$", r"output \1", label)),
            state={i: float(v) for i, v in enumerate(c) if v},
            input={j: float(v) for j, v in enumerate(d) if v},
        )
        for label, c, d in zip(system.output_labels, system.C, system.D, strict=True)
    )


def rate_of(signal: Signal, name: str | None = None) -> Signal:
    """Return the rate of change of a sum of states: of a velocity in m/s, the acceleration in m/s2.

    Raises
    ------
    InputError
        If the signal has an input or a rate in it.
    """
    if signal.rate or signal.input:
        raise InputError(f"{signal.name!r} is no sum of states; its rate of change is no signal")
    unit = {"m/s": "m/s2", "m": "m/s", "rad": "rad/s", "rad/s": "rad/s2"}.get(signal.unit)
    if unit is None:
        unit = f"{signal.unit}/s" if signal.unit else "1/s"
    return Signal(name or f"rate of {signal.name}", unit, rate=dict(signal.state))


def pick(known: Sequence[Signal], name: str) -> Signal:
    """Return the signal of that name.

    Raises
    ------
    InputError
        If there is none.
    """
    for signal in known:
        if signal.name == name:
            return signal
    raise InputError(f"no signal {name!r}; {suggest(name, dict.fromkeys(s.name for s in known))}")


def choose(
    plant: UncertainPlant, signals: Sequence[Signal | str] | None = None
) -> tuple[Signal, ...]:
    """Return signals, those given as names found among the plant's states and inputs.

    Parameters
    ----------
    signals : sequence of Signal or str, optional
        All states and inputs by default.

    Raises
    ------
    InputError
        If there is no signal of a name, none at all, or two of one name.
    """
    known = (*states(plant), *inputs(plant))
    if signals is None:
        return known
    if isinstance(signals, str | Signal):
        signals = (signals,)
    found = tuple(s if isinstance(s, Signal) else pick(known, str(s)) for s in signals)
    names = [s.name for s in found]
    twice = [name for name in names if names.count(name) > 1]
    if twice or not found:
        raise InputError(f"signal {twice[0]!r} is asked twice" if twice else "no signal is asked")
    return found


def output_matrices(
    signals: Sequence[Signal], closed: Array, E: Array, K: Array
) -> tuple[Array, Array]:
    """Return C (..., p, n) and D (..., p, q) of the signals in a closed loop.

    Parameters
    ----------
    closed : (..., n, n) array
        A + B K.
    E : (..., n, q) array
    K : (..., m, n) array
        Of u = K x.
    """
    n, m = closed.shape[-1], K.shape[-2]
    state, rate, into = (
        _rows([getattr(s, kind) for s in signals], width)
        for kind, width in (("state", n), ("rate", n), ("input", m))
    )
    return state + rate @ closed + into @ K, rate @ E + np.zeros((len(signals), E.shape[-1]))


def _rows(weights: Sequence[dict[int, float]], width: int) -> Array:
    rows = np.zeros((len(weights), width))
    for row, own in zip(rows, weights, strict=True):
        for index, value in own.items():
            row[index] = value
    return rows
