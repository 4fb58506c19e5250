"""Plants with more states: a filter on one of their signals, or actuators with dynamics."""

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
from polefence.plant.outputs import Output, inputs, padded, states
from polefence.plant.system import Exact, System


def with_filter(
    plant: UncertainPlant, signal: Output, system: Sequence[Any], name: str
) -> tuple[UncertainPlant, Output]:
    """Return the plant with a filter on a signal below it, and the filtered signal.

    A law designed for it feeds back the filter's states too: the filter runs in the controller, on
    the measured signal.

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
    a, b, c, d = (_exact(M) for M in system)
    C, D = rows(plant, signal)
    n, zero = plant.shape[0], Fraction(0)
    k = len(a)
    vertices = []
    for vertex, Cj, Dj in zip(plant.vertices, C, D, strict=True):
        below = [[b[i][0] * x for x in Cj[0]] + list(a[i]) for i in range(k)]
        A = [[*row, *[zero] * k] for row in vertex.exact_A] + below
        B = [list(row) for row in vertex.exact_B] + [[b[i][0] * x for x in Dj[0]] for i in range(k)]
        E = None
        if vertex.exact_E is not None:
            q = len(vertex.exact_E[0])
            E = [list(row) for row in vertex.exact_E] + [[zero] * q for _ in range(k)]
        vertices.append(
            System(_matrix(A), _matrix(B), None if E is None else _matrix(E), vertex.name)
        )
    names = (*(s.label for s in states(plant)), *(f"{name} state {i + 1}" for i in range(k)))
    if d[0][0]:
        raise InputError(f"the filter {name} has a direct way through it; give one without")
    outputs = tuple(padded(output, k) for output in plant.outputs)
    larger = replace(plant, vertices=tuple(vertices), states=names, outputs=outputs)
    return larger, Output(f"{signal.name}, {name}", signal.unit, C=[zero] * n + list(c[0]))


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
        if own.filter is None:
            continue
        for signal in own.outputs(bare):
            if (signal.name, own.filter) not in made:
                wider = padded(signal, plant.shape[0] - n)
                system = WEIGHTS[own.filter].state_space()
                plant, filtered = with_filter(plant, wider, system, own.filter)
                made[signal.name, own.filter] = filtered
    more, found = plant.shape[0] - n, list[Specification]()
    for own in specifications:
        if own.filter is not None:
            signals = [made[signal.name, own.filter] for signal in own.outputs(bare)]
            own = own.filtered([padded(y, n + more - len(y.C[0])) for y in signals])
        found.append(own.extended(n, more) if more else own)
    return plant, tuple(found)


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


def with_actuator(plant: UncertainPlant, bandwidth: float) -> UncertainPlant:
    """Return the plant behind first-order actuators: what was an input is a state, u its demand.

    Parameters
    ----------
    bandwidth : float
        [rad/s]

    Raises
    ------
    InputError
        If the bandwidth is not positive.
    """
    if not (np.isfinite(bandwidth) and bandwidth > 0):
        raise InputError(f"bandwidth = {bandwidth!r} must be a positive number [rad/s]")
    w, zero = Fraction(bandwidth), Fraction(0)
    n, m = plant.shape
    vertices = []
    for vertex in plant.vertices:
        A = [[*ra, *rb] for ra, rb in zip(vertex.exact_A, vertex.exact_B, strict=True)]
        A += [[zero] * n + [-w if i == j else zero for j in range(m)] for i in range(m)]
        B = [[zero] * m for _ in range(n)]
        B += [[w if i == j else zero for j in range(m)] for i in range(m)]
        E = None
        if vertex.exact_E is not None:
            E = [list(row) for row in vertex.exact_E] + [[zero] * len(vertex.exact_E[0])] * m
        vertices.append(
            System(_matrix(A), _matrix(B), None if E is None else _matrix(E), vertex.name)
        )
    names = tuple(s.label for s in states(plant)) + tuple(s.label for s in inputs(plant))
    demands = tuple(f"demand of {s.label}" for s in inputs(plant))
    outputs = []
    for output in plant.outputs:
        C, D, _ = output.exact(plant)
        both = [(*c, *d) for c, d in zip(C, D, strict=True)]
        outputs.append(replace(output, C=both, D=()))
    return replace(
        plant,
        vertices=tuple(vertices),
        states=names,
        inputs=demands,
        outputs=tuple(outputs),
        vehicle=None,  # its force is no input any more
    )


def _matrix(lists: list[list[Fraction]]) -> Exact:
    return tuple(tuple(row) for row in lists)


def _exact(matrix: Any) -> Exact:
    return tuple(tuple(Fraction(float(x)) for x in row) for row in np.atleast_2d(matrix))
