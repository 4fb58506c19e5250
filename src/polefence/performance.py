"""What a given law keeps: the least bound on a signal that is proved, in exact arithmetic."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

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
from polefence.solve.performance_given import least_given
from polefence.specification import Specification, claim_of, output_of

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (2, 0))
# How far above what was found in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
LONG = 8.0  # a search that took so long [s] ends the climb: the next takes several times as long
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
    for evidence, r in _found(plant, law, specification, None):
        level = _level(specification, r, 1.0)
        own = next(
            (
                bound
                for step in STEPS
                if (bound := _proved(plant, law, specification, evidence, level * (1 + step)))
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
    for evidence, r in _found(plant, law, specification, limit):
        if r < 1:
            own = _proved(plant, law, specification, evidence, limit)
            if own is not None:
                return own
    return None


def _found(
    plant: UncertainPlant, law: Law, specification: Specification, unit: float | None
) -> Iterator[tuple[exact.Evidence, float]]:
    """Yield evidence, and the r that it proves in floats."""
    if isinstance(specification, GainNorm):
        for level, elevation in levels(plant, law, specification):
            if np.isfinite(level):
                yield exact.Evidence([], elevation=elevation), (level / (unit or 1.0)) ** 2
        return
    source, output = output_of(plant, domain_of(plant, law), specification, unit or 1.0)
    loop = loop_with(plant, law, output.C, output.D)
    for form in LADDER:
        begin = time.perf_counter()
        with suppress(SolverError):
            found = least_given(loop, source, output, *form)
            yield _evidence(found, form), found.r
        if time.perf_counter() - begin > LONG:
            return


def _level(specification: Specification, r: float, unit: float) -> float:
    return float(unit * (r if specification.kind == "gain" else np.sqrt(r)))


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
