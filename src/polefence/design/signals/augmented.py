"""Plants with a filter on one of their signals, as weighted specifications need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.requirements.rms import WEIGHTS
from polefence.design.requirements.specification import Specification, rows
from polefence.law.laws import FixedGain, Law, PolynomialGain
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_dynamics
from polefence.plant.outputs import Output, padded, states
from polefence.plant.system import Exact
from polefence.response.discrete import zero_order_hold


def with_filter(
    plant: UncertainPlant, signal: Output, system: Sequence[Any], name: str
) -> tuple[UncertainPlant, Output]:
    """Return the plant with a filter on a signal below it, and the filtered signal.

    A law designed for it feeds back the filter's states too: the filter runs in the controller, on
    the measured signal. In discrete time it is the filter of a signal held between samples.

    Parameters
    ----------
    system : A, B, C, D of the filter
        One input, one output; no direct way through it (D = 0), or the signal is a sum of states
        and inputs all the same.
    name : str
        Of the filter, for names of states and of the signal.

    Raises
    ------
    InputError
        If a disturbance passes straight into the signal.
    """
    A, B, C, D = map(np.atleast_2d, system)
    if plant.sample_time is not None:  # of a signal that is held between samples
        A, B = zero_order_hold(A, B, float(plant.sample_time))
    a, b, c, d = (_exact(M) for M in (A, B, C, D))
    if d[0][0]:
        raise InputError(f"the filter {name} has a direct way through it; give one without")
    rows(plant, signal)
    labels = [f"{name} state {i + 1}" for i in range(len(a))]
    larger = with_dynamics(plant, (signal,), a, b, labels)
    behind = [Fraction(0)] * plant.shape[0] + list(c[0])
    return larger, Output(f"{signal.name}, {name}", signal.unit, C=behind)


def with_weights(
    plant: UncertainPlant, specifications: Sequence[Specification]
) -> tuple[UncertainPlant, tuple[Specification, ...]]:
    """Return the plant with the filters that specifications ask for, and those without weights.

    Raises
    ------
    InputError
        If the plant has no such signal, or a disturbance passes straight into it.
    """
    made: dict[tuple[str, str], Output] = {}
    bare, n = plant, plant.shape[0]
    for own in specifications:
        for signal, name in _behind(bare, own):
            if name is not None and (signal.name, name) not in made:
                wider = padded(signal, plant.shape[0] - n)
                system = WEIGHTS[name].state_space()
                plant, filtered = with_filter(plant, wider, system, name)
                made[signal.name, name] = filtered
    more, found = plant.shape[0] - n, list[Specification]()
    for own in specifications:
        pairs = _behind(bare, own)
        if pairs:
            signals = [y if name is None else made[y.name, name] for y, name in pairs]
            wide = (len(y.C[0]) if y.C else n for y in signals)
            own = own.filtered(
                [padded(y, n + more - k) for y, k in zip(signals, wide, strict=True)]
            )
        found.append(own.extended(n, more) if more else own)
    return plant, tuple(found)


def _behind(plant: UncertainPlant, own: Specification) -> list[tuple[Output, str | None]]:
    """Return the entries with the names of their filters, none where no entry has one."""
    names = own.filters
    return list(zip(own.outputs(plant), names, strict=True)) if any(names) else []


def without_feedback(law: Law, plant: UncertainPlant) -> Law:
    """Return a law of the plant's first states as one of all: the others are not fed back."""
    n = plant.shape[0]
    if isinstance(law, FixedGain):
        return FixedGain(np.pad(law.K, ((0, 0), (0, n - law.K.shape[1]))))
    if isinstance(law, PolynomialGain):
        measured = law.measured or states(plant)[: law.C.shape[2]]
        wider = tuple(padded(own, n - len(own.C[0])) for own in measured)
        return replace(law, measured=wider)
    own = law.W.shape[1]
    W = np.tile(np.eye(n), (len(law.W), 1, 1))
    # any W does that is positive and of a size; the proofs have Lyapunov matrices of their own
    W *= np.trace(law.W.mean(axis=0)) / own
    W[:, :own, :own] = law.W
    return replace(law, W=W, Z=np.pad(law.Z, ((0, 0), (0, 0), (0, n - own))))


def _exact(matrix: Any) -> Exact:
    return tuple(tuple(Fraction(float(x)) for x in row) for row in np.atleast_2d(matrix))
