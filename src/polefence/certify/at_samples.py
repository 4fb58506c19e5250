"""A law designed in continuous time, as a computer closes its loop: a law of the plant's samples.

The opposite way of `polefence.certify.running`. What is late is a state of the samples, which the
law does not feed back; states that the law keeps itself are stepped by their rates at once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.law.laws import FixedGain, Law, PolynomialGain, ScheduledGain, given_law
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states, with_states
from polefence.plant.system import Array, System
from polefence.response.samples import at_sample_time


@explained
def at_samples(
    plant: UncertainPlant, law: Any, sample_time: Any, delay: int = 1
) -> tuple[UncertainPlant, Law]:
    """Return a plant's samples, and the same law of their states: what is computed is unchanged.

    Every claim about a discrete-time loop, such as a disk that keeps its poles, then says what
    holds of the law when a computer runs it.

    Parameters
    ----------
    plant : UncertainPlant
        In continuous time.
    law : any law of `polefence.law`, or a Design
        Of this plant.
    sample_time : number
        [s]; the inputs are held between samples.
    delay : int
        How many samples late they act: 1 where the law is computed during a step.

    Returns
    -------
    plant : UncertainPlant
        As `polefence.at_sample_time` returns it, with the states that the law keeps behind the
        inputs on their way.
    law : Law

    Raises
    ------
    InputError
        If the plant is in discrete time, the law does not fit it, or `at_sample_time` refuses.
    """
    law = given_law(plant, law)
    kept = 0 if isinstance(law, ScheduledGain) else own_states(plant)
    held = at_sample_time(_without(plant, kept), sample_time, delay)
    late = held.shape[0] - (plant.shape[0] - kept)
    found = with_states(held, kept) if kept else held
    return found, given_law(found, _late(law, plant.shape[0] - kept, late))


def _without(plant: UncertainPlant, kept: int) -> UncertainPlant:
    """Return the plant before states of a law, which move nothing by themselves, were added."""
    if not kept:
        return plant
    n, m = plant.shape
    n, m = n - kept, m - kept
    vertices = []
    for own in plant.vertices:
        A = tuple(tuple(row[:n]) for row in own.exact_A[:n])
        B = tuple(tuple(row[:m]) for row in own.exact_B[:n])
        E = None if own.exact_E is None else own.exact_E[:n]
        vertices.append(System(A, B, E, own.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        states=plant.states[:n],
        inputs=plant.inputs[:m],
        outputs=(),
        vehicle=None,
    )


def _late(law: Law, n: int, late: int) -> Law:
    """Return the law with no gain of the inputs on their way, which are behind n states."""
    if not late:
        return law
    if isinstance(law, FixedGain):
        return FixedGain(np.insert(law.K, [n] * late, 0.0, axis=1))
    if isinstance(law, PolynomialGain):
        if law.measured:
            none = (0,) * late
            wider = [
                replace(y, C=[(*row[:n], *none, *row[n:]) for row in y.C]) for y in law.measured
            ]
            return replace(law, measured=tuple(wider))
        return replace(law, gains=np.insert(law.gains, [n] * late, 0.0, axis=2))
    if not isinstance(law, ScheduledGain):
        raise InputError(f"a law of the kind {type(law).__name__} has no form at samples")
    count, width = len(law.W), n + late
    W, Z = np.zeros((count, width, width)), np.insert(law.Z, [n] * late, 0.0, axis=2)
    W[:, :n, :n] = law.W
    own = np.arange(n, width)
    W[:, own, own] = np.tile(_energy(law), late // law.Z.shape[1])  # any: in the inputs' own units
    return replace(law, W=W, Z=Z)


def _energy(law: ScheduledGain) -> Array:
    """Return the diagonal of Z W^-1 Z' in the middle, short and positive, (m,)."""
    W, Z = law.W.mean(axis=0), law.Z.mean(axis=0)
    size = np.diag(Z @ np.linalg.solve(W, Z.T))
    return np.asarray(2.0 ** np.round(np.log2(np.where(size > 0, size, 1.0))))
