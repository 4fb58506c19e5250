"""A law designed in continuous time, as a computer closes its loop: a law of the plant's samples.

The opposite way of `polefence.certify.running`. What is late is a state of the samples, which the
law does not feed back; states that the law keeps itself are stepped by their rates at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from polefence.base.explained import explained
from polefence.law.laws import Law, given_law
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states, with_states
from polefence.plant.outputs import Output
from polefence.plant.system import System
from polefence.response.samples import ENOUGH, at_sample_time


@explained
def at_samples(
    plant: UncertainPlant, law: Any, sample_time: Any, delay: int = 1, remainder: float = ENOUGH
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
    remainder : float
        As `polefence.at_sample_time` has it.

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
    kept = 0 if law.W is not None else own_states(plant)  # a quotient keeps no states
    held = at_sample_time(_without(plant, kept), sample_time, delay, remainder=remainder)
    late = held.shape[0] - (plant.shape[0] - kept)
    samples = with_states(held, kept) if kept else held
    if kept and plant.states:  # a PID's have names of their own
        states = (*samples.states[:-kept], *plant.states[-kept:])
        inputs = (*samples.inputs[:-kept], *plant.inputs[-kept:])
        samples = replace(samples, states=states, inputs=inputs)
    return samples, given_law(samples, law.late(plant.shape[0] - kept, late) if late else law)


def _without(plant: UncertainPlant, kept: int) -> UncertainPlant:
    """Return the plant before states of a law, which move nothing by themselves, were added."""
    if not kept:
        return plant
    n, m = plant.shape
    n, m = n - kept, m - kept
    vertices = []
    for vertex in plant.vertices:
        A = tuple(tuple(row[:n]) for row in vertex.exact_A[:n])
        B = tuple(tuple(row[:m]) for row in vertex.exact_B[:n])
        E = None if vertex.exact_E is None else vertex.exact_E[:n]
        vertices.append(System(A, B, E, vertex.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        states=plant.states[:n],
        inputs=plant.inputs[:m],
        outputs=tuple(_narrowed(plant, n, m)),
        vehicle=None,
    )


def _narrowed(plant: UncertainPlant, n: int, m: int) -> Iterator[Output]:
    """Yield the outputs of the first states and inputs alone."""
    for output in plant.every_output:
        C, D, F = output.exact(plant)
        if not any(any(row[n:]) for row in C) and not any(any(row[m:]) for row in D):
            F = F if plant.disturbance_count else ()
            yield Output(output.name, output.unit, [x[:n] for x in C], [x[:m] for x in D], F)
