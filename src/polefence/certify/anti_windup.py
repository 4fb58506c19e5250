"""The anti-windup gain of a law with states of its own, for the least limit at which it recovers.

While inputs saturate the law's own states run on: they wind up. With G (sat(u) - u) added to their
rates they need not. G is found for a law that is given, by one LMI beside which G is convex; what
is proved is proved of the gain as it is, like any other of the law's numbers.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import SolverError
from polefence.base.explained import explained
from polefence.certify.bounds import MOST_WORK
from polefence.certify.evidence import FORMS
from polefence.law.laws import FixedGain, Law, PolynomialGain
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.performance import Output, Source
from polefence.lmi.solve.loops import loop_with, with_inputs
from polefence.lmi.solve.lyapunov import least_given, work
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import LATE, states
from polefence.plant.points import seeded
from polefence.plant.system import Array, Exact, System
from polefence.proof.laws import OWN
from polefence.requirements.specification import Specification
from polefence.response.closed import Loops, close

# Of the square of a limit, what a gain need not go below: a loop that comes to rest with any limit
# has no least one.
ENOUGH = 0.25
TOLERANCE = 1e-4  # of the gap, relative to the least: what is found is proved as it is
POINTS = 50  # of the family, at which the fastest pole is looked for
# How much faster than the loop's fastest pole a gain may move its input. Of an unstable lag, of its
# samples and of the balance the least limit falls to 1.333, 1.335 and 18.46 with 4, and no lower
# with 100; to 1.335, 1.335 and 18.46 with 2, and 1.449, 1.458 and 18.89 with 1.
FASTER = 4.0
# A share of the largest that an entry may be, below which it is zero; and the latter of one that is
# to be zero, for LMIs need room.
SLIGHT, LEAST = 1e-6, 1e-12


@explained
def with_anti_windup(plant: UncertainPlant, law: Law, asked: Iterable[Specification]) -> Law:
    """Return a law with an anti-windup gain for what is asked about its saturated inputs.

    The law itself where it has no states of its own, nothing is asked about saturation, no gain is
    found, or its computer does not know what acts: how far an actuator of the plant is. An entry of
    the gain moves the input that it belongs to no faster than a few times the loop's fastest pole:
    beyond that a computer had to sample more often for it.

    Parameters
    ----------
    plant : UncertainPlant
        With the law's own states.
    asked : iterable of Specification
        Of each input the first that is about its saturation counts.
    """
    plant = delta_form(plant)
    rows = [k for k, state in enumerate(states(plant)) if state.name.startswith(OWN)]
    if not rows or not isinstance(law, PolynomialGain):
        return law
    (n, m), done = plant.shape, set[int]()
    gain = np.zeros((n, m))
    for specification in asked:
        chosen = set(specification.cut_off(plant)) - done
        if chosen and not _is_known(plant, specification):
            continue
        found = _found(plant, law, specification, rows) if chosen else None
        if found is not None:
            places = np.ix_(rows, sorted(chosen))
            gain[places] = found[:, sorted(chosen)]
            done |= chosen
    if not np.any(gain):
        return law
    return law.with_anti_windup(np.array([[float(f"{x:.6g}") for x in row] for row in gain]))


def _is_known(plant: UncertainPlant, specification: Specification) -> bool:
    """Whether a computer knows what acts: its own inputs, and what it sent before."""
    late = np.array([state.name.endswith(LATE) for state in states(plant)])
    own = np.array([state.name.startswith(OWN) for state in states(plant)])
    return not any(
        output.arrays(plant)[0][:, ~(late | own)].any() for output in specification.outputs(plant)
    )


def _found(
    plant: UncertainPlant, law: Law, specification: Specification, rows: list[int]
) -> Array | None:
    """Return the gain (k, m) of the lowest limit, None where none is found.

    Of a family that is too large for an LMI, that of its middle: of a van of three parameters under
    a law of order 2 in 0.8 s for 35. With it a step of 10 cm is proved to take no more than
    600 N, where it takes 4,535 N in floats.
    """
    most = specification.at_most
    source, output, loop = _loop(plant, law, specification, rows)
    if work(loop, source, *FORMS[-1]) > MOST_WORK:
        plant, law = _middle(plant, law)
        source, output, loop = _loop(plant, law, specification, rows)
    best, least, enough = None, np.inf, 0.0 if most is None else ENOUGH
    for form in FORMS[: 1 if len(plant.vertices) == 1 else None]:
        with suppress(SolverError, np.linalg.LinAlgError):
            point = least_given(loop, source, output, *form, TOLERANCE, enough=enough)
            if point.anti_windup is not None and point.r < least:
                best, least = point.anti_windup, point.r
            if least <= enough:
                break
    if best is None or loop.fastest is None:
        return None
    kept = (np.abs(best) > SLIGHT * loop.fastest) & (loop.fastest > LEAST)
    return np.where(kept, best, 0.0)


def _loop(
    plant: UncertainPlant, law: Law, specification: Specification, rows: list[int]
) -> tuple[Source, Output, Loop]:
    """Return what the limit is asked for, and the loop with the gain that is sought."""
    unit = specification.at_most or 1.0
    source, output = specification.condition(plant, law.domain_of(plant), unit, law)
    loop = with_inputs(plant, law, loop_with(plant, law, output.C, output.D))
    return source, output, _sought(plant, law, loop, rows)


def _middle(plant: UncertainPlant, law: Law) -> tuple[UncertainPlant, Law]:
    """Return the mean of the vertices as a plant, and the law's gain there."""
    systems = plant.vertices
    even = [1 / len(systems)] * len(systems)
    driven = [system.exact_E for system in systems if system.exact_E is not None]
    middle = System(
        _mean([system.exact_A for system in systems]),
        _mean([system.exact_B for system in systems]),
        _mean(driven) if driven else None,
        systems[0].name,
    )
    bare = replace(plant, vertices=(middle,), parameters=(), outputs=(), remainder=None)
    return bare, FixedGain(law.gain(even))


def _mean(matrices: list[Exact]) -> Exact:
    count = len(matrices)
    return tuple(
        tuple(sum(entries, Fraction(0)) / count for entries in zip(*rows, strict=True))
        for rows in zip(*matrices, strict=True)
    )


def _sought(plant: UncertainPlant, law: Law, loop: Loop, rows: list[int]) -> Loop:
    """Return the loop with the rows in which the gain is sought, and how large it may be."""
    points = seeded(plant, len(plant.vertices) + POINTS)
    loops = close(plant, law, points, disturbed=False)
    fastest = float(np.abs(loops.poles()).max())
    moved = _moved(loops, rows, fastest)
    # of an input that a state does not move the gain is zero: its room is lost in rounding
    most = np.where(moved > 0, FASTER * fastest / np.where(moved > 0, moved, 1.0), LEAST)
    return replace(loop, own=np.eye(plant.shape[0])[:, rows], fastest=most.T)


def _moved(loops: Loops, rows: list[int], fastest: float) -> Array:
    """Return by how much the law's own states move each input, at once and a little later."""
    at_once = np.abs(loops.K[:, :, rows]).max(axis=0)
    later = np.abs(loops.K @ loops.closed)[:, :, rows].max(axis=0) / fastest
    return np.asarray(at_once + later)
