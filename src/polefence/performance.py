"""What a given law keeps: the least bound on a signal that is proved, in exact arithmetic."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from polefence.conditions.lyapunov import Loop
from polefence.conditions.performance import Output, Source
from polefence.errors import PlantError, SolverError
from polefence.gain_norm import GainNorm, levels
from polefence.law import FixedGain, Law
from polefence.loops import domain_of, loop_with
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import exact
from polefence.proof.performance import PerformanceClaim, prove_performance
from polefence.region_text import digits_up
from polefence.solve.given import Proof
from polefence.solve.performance_given import least_given, work
from polefence.solve.smallest import TOLERANCE
from polefence.specification import Specification, claim_of, output_of

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (2, 0))
# How far above what was found in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
# How near its end the search comes: evidence on the very edge may not survive its rounding.
NEAR = (TOLERANCE, 1e-6, 1e-4, 1e-2)
MOST_WORK = 3e8  # of one search beyond the first [multiplications an iteration]
WORTH = 1e-3  # a smaller bound by less than this share ends the climb


@dataclass(frozen=True, eq=False)
class Bound:
    """A bound on a signal that is proved.

    Attributes
    ----------
    specification : Specification
    level : float
        In the signal's unit; of a gain, per unit of the disturbance.
    claim : PerformanceClaim
        With its evidence.
    degree : int
        Of the Lyapunov polynomial; of a gain norm of the law's.
    reason : str
        What was proved.
    """

    specification: Specification
    level: float
    claim: PerformanceClaim
    degree: int
    reason: str

    def __str__(self) -> str:
        own = self.specification
        return f"{own.kind} of {own.name} <= {digits_up(self.level)}"


def best_bound(plant: UncertainPlant, law: Law, specification: Specification) -> Bound | None:
    """Return the least bound that is proved with Lyapunov polynomials of growing degree."""
    best: Bound | None = None
    for points in _climb(plant, law, specification, 1.0):
        own = next(
            (
                bound
                for evidence, r in points
                for step in STEPS
                if (
                    bound := _proved(
                        plant, law, specification, evidence, _level(specification, r) * (1 + step)
                    )
                )
            ),
            None,
        )
        if own is None:
            continue
        worth = best is None or own.level < best.level * (1 - WORTH)
        if best is None or own.level < best.level:
            best = own
        if not worth:
            break
    return best


def kept_bound(plant: UncertainPlant, law: Law, specification: Specification) -> Bound | None:
    """Return the proof that a specification's own limit is kept, None where there is none."""
    limit = specification.at_most or 0.0
    for points in _climb(plant, law, specification, limit):
        for number, (evidence, r) in enumerate(points):
            if r < 1:
                own = _proved(plant, law, specification, evidence, limit)
                if own is not None:
                    return own
            elif not number:  # of those nearest to the edge
                break
    return None


Points = Iterator[tuple[exact.Evidence, float]]


def _climb(
    plant: UncertainPlant, law: Law, specification: Specification, unit: float
) -> Iterator[Points]:
    """Yield points of each form in turn: evidence, and the r that it proves in floats."""
    if isinstance(specification, GainNorm):
        yield from (iter([point]) for point in _norms(plant, law, specification, unit))
        return
    source, output = output_of(plant, domain_of(plant, law), specification, unit)
    loop = loop_with(plant, law, output.C, output.D)
    for form in LADDER:
        first = form == LADDER[0]
        if first or (len(plant.vertices) > 1 and work(loop, source, *form) <= MOST_WORK):
            yield _points(loop, source, output, form)


def _norms(plant: UncertainPlant, law: Law, specification: GainNorm, unit: float) -> Points:
    with suppress(SolverError):
        for level, elevation in levels(plant, law, specification):
            if np.isfinite(level):
                yield exact.Evidence([], elevation=elevation), (level / unit) ** 2


def _points(loop: Loop, source: Source, output: Output, form: tuple[int, int]) -> Points:
    """Yield points farther and farther from the edge of what a form proves."""
    found: Proof | None = None
    for tolerance in NEAR:
        for near in dict.fromkeys((found, None)):
            with suppress(SolverError):
                again = least_given(loop, source, output, *form, tolerance, near)
                if again.r > 0:
                    found = found or again
                    yield _evidence(again, form), again.r


def _level(specification: Specification, r: float) -> float:
    return float(r if specification.kind == "gain" else np.sqrt(r))


def _proved(
    plant: UncertainPlant,
    law: Law,
    specification: Specification,
    evidence: exact.Evidence,
    level: float,
) -> Bound | None:
    on = "box" if len(domain_of(plant, law).sizes) > 1 else "simplex"
    claim = claim_of(plant, exact_law(law), on, specification, evidence, Fraction(level))
    try:
        verdict = prove_performance(claim)
    except exact.FormatError as error:
        raise PlantError(f"{plant.name}: {error}") from error
    if not verdict.proved:
        return None
    degree = evidence.degree
    if isinstance(specification, GainNorm):
        degree = 0 if isinstance(law, FixedGain) else law.degree
    return Bound(specification, level, claim, degree, verdict.reason)


def _evidence(found: Proof, form: tuple[int, int]) -> exact.Evidence:
    X = [[[Fraction(x) for x in row] for row in Q] for Q in found.Q.tolist()]
    multiple = () if found.multiple is None else tuple(map(Fraction, found.multiple.tolist()))
    return exact.Evidence(X, form[0], form[1], multiple)


def exact_law(law: Law) -> exact.Law:
    """Return a law in exact rationals."""
    if isinstance(law, FixedGain):
        return exact.Law([_rationals(law.K)])
    return exact.Law(
        None, [_rationals(W) for W in law.W], [_rationals(Z) for Z in law.Z], law.degree
    )


def _rationals(matrix: Array) -> exact.Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]
