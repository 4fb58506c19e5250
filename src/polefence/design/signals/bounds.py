"""Bounds of a given law: the least on a signal that is proved, in exact arithmetic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import PlantError, SolverError
from polefence.design.given.closed_loop import loop_with
from polefence.design.requirements.gain_norm import GainNorm, levels
from polefence.design.requirements.specification import Specification, claim_of
from polefence.design.search import first
from polefence.law.laws import FixedGain, Law, domain_of
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.performance import Output, Source
from polefence.lmi.solve.interior_point import TOLERANCE
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, points_given, work
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import laws, matrices
from polefence.proof.claims.base import prove
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.laws import Evidence
from polefence.proof.work import FormatError
from polefence.region.text import digits_up

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (2, 0))
# How far above what was found in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
# How near its end the search comes: evidence on the very edge may not survive its rounding.
NEAR = (TOLERANCE, 1e-6, 1e-4, 1e-2)
POOR = 0.05  # a point whose r is farther from the least than this share proves little
MOST_WORK = 3e8  # of one search beyond the first [multiplications an iteration]
WORTH = 1e-3  # a smaller bound by less than this share ends the climb


Known = tuple[Evidence, float]


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
    claim: BoundClaim
    degree: int
    reason: str

    def __str__(self) -> str:
        own = self.specification
        return f"{own.kind} of {own.name} <= {digits_up(self.level)}"


def best_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None = None
) -> Bound | None:
    """Return the least bound that is proved with Lyapunov polynomials of growing degree.

    Parameters
    ----------
    known : pair of Evidence and float, optional
        What proves the bound of that level as far as floats tell; tried where nothing lower is
        proved otherwise.
    """
    best: Bound | None = None
    for points in _climb(plant, law, specification, 1.0):
        own = first(
            _stepped(plant, law, specification, evidence, specification.level(r))
            for evidences, r in points
            for evidence in evidences
        )
        if own is None:
            continue
        worth = best is None or own.level < best.level * (1 - WORTH)
        if best is None or own.level < best.level:
            best = own
        if not worth:
            break
    if known is not None and (best is None or known[1] * (1 + STEPS[0]) < best.level):
        own = known_bound(plant, law, specification, known)
        if own is not None and (best is None or own.level < best.level):
            best = own
    return best


def known_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known
) -> Bound | None:
    """Return what given evidence proves: the limit, else a level near its own; None if nothing."""
    if specification.at_most is not None:
        return _proved(plant, law, specification, known[0], specification.at_most)
    return _stepped(plant, law, specification, *known)


def _stepped(
    plant: UncertainPlant,
    law: Law,
    specification: Specification,
    evidence: Evidence,
    level: float,
) -> Bound | None:
    """Return the first step above a level at which evidence is a proof, None if it is at none."""
    farthest = _proved(plant, law, specification, evidence, level * (1 + STEPS[-1]))
    nearer = (_proved(plant, law, specification, evidence, level * (1 + s)) for s in STEPS[:-1])
    return None if farthest is None else first(nearer) or farthest


def raised(bound: Bound, level: float) -> Bound | None:
    """Return the bound with a higher level, proved with the same evidence."""
    claim = replace(bound.claim, level=Fraction(level))
    verdict = prove(claim)
    if not verdict.proved:
        return None
    return replace(bound, level=level, claim=claim, reason=verdict.reason)


def kept_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None = None
) -> Bound | None:
    """Return the proof that a specification's own limit is kept, None where there is none.

    Parameters
    ----------
    known : pair of Evidence and float, optional
        What proves it as far as floats tell; tried first.
    """
    limit = specification.at_most or 0.0
    if known is not None and (own := known_bound(plant, law, specification, known)) is not None:
        return own
    for points in _climb(plant, law, specification, limit):
        for number, (evidences, r) in enumerate(points):
            if r < 1:
                for evidence in evidences:
                    own = _proved(plant, law, specification, evidence, limit)
                    if own is not None:
                        return own
            elif not number:  # of those nearest to the edge
                break
    return None


def own_evidence(law: Law, W: Array, t: float) -> Evidence:
    """Return the evidence that a design leaves of a signal: its own W over t, (count, n, n)."""
    if isinstance(law, FixedGain):
        return Evidence([_rationals(W[0] / t)])
    none = [[Fraction(0)] * W.shape[1] for _ in range(W.shape[1])]
    return Evidence([none], multiple=(Fraction(1 / t),))


# Evidence, to rounding and then exactly as it was found, and the r that it proves in floats.
Points = Iterator[tuple[Iterable[Evidence], float]]


def _climb(
    plant: UncertainPlant, law: Law, specification: Specification, unit: float
) -> Iterator[Points]:
    """Yield points of each form in turn: evidence, and the r that it proves in floats."""
    if isinstance(specification, GainNorm):
        yield from (iter([point]) for point in _norms(plant, law, specification, unit))
        return
    source, output = specification.condition(plant, domain_of(plant, law), unit)
    loop = loop_with(plant, law, output.C, output.D)
    for form in LADDER:
        first = form == LADDER[0]
        if first or (len(plant.vertices) > 1 and work(loop, source, *form) <= MOST_WORK):
            yield _points(loop, source, output, form)


def _norms(plant: UncertainPlant, law: Law, specification: GainNorm, unit: float) -> Points:
    with suppress(SolverError):
        for level, elevation in levels(plant, law, specification):
            if np.isfinite(level):
                yield [Evidence([], elevation=elevation)], (level / unit) ** 2


def _points(loop: Loop, source: Source, output: Output, form: tuple[int, int]) -> Points:
    """Yield points farther and farther from the edge of what a form proves, poor ones last."""
    found: LyapunovPolynomial | None = None
    poor = list[LyapunovPolynomial]()
    for tolerance in NEAR:
        for near in dict.fromkeys((found, None)):
            points = list[LyapunovPolynomial]()
            with suppress(SolverError):
                points = points_given(loop, source, output, *form, tolerance, near)
            for own in points:
                found = found or own
                if own.r <= found.r * (1 + POOR):
                    yield _evidences(own, form), own.r
                else:
                    poor.append(own)
    for own in sorted(poor, key=lambda own: own.r):
        yield _evidences(own, form), own.r


def _proved(
    plant: UncertainPlant,
    law: Law,
    specification: Specification,
    evidence: Evidence,
    level: float,
) -> Bound | None:
    on = "box" if len(domain_of(plant, law).sizes) > 1 else "simplex"
    claim = claim_of(plant, exact_law(law), on, specification, evidence, Fraction(level))
    try:
        verdict = prove(claim)
    except FormatError as error:
        raise PlantError(f"{plant.name}: {error}") from error
    if not verdict.proved:
        return None
    degree = evidence.degree
    if isinstance(specification, GainNorm):
        degree = 0 if isinstance(law, FixedGain) else law.degree
    return Bound(specification, level, claim, degree, verdict.reason)


def _evidences(found: LyapunovPolynomial, form: tuple[int, int]) -> Iterator[Evidence]:
    """Yield Q as floats have it, and as the exact product that it is of what was found."""
    multiple = () if found.multiple is None else tuple(map(Fraction, found.multiple.tolist()))
    yield Evidence([_rationals(Q) for Q in found.Q], form[0], form[1], multiple)
    left = _rationals(found.left)
    products = [_congruent(left, _rationals((S + S.T) / 2)) for S in found.scaled]
    yield Evidence(products, form[0], form[1], multiple)


def _congruent(left: matrices.Rationals, middle: matrices.Rationals) -> matrices.Rationals:
    """Return left @ middle @ left', exactly."""
    half = [[_dot(row, column) for column in middle] for row in left]  # middle is symmetric
    return [[_dot(row, column) for column in left] for row in half]


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def exact_law(law: Law) -> laws.Law:
    """Return a law in exact rationals."""
    if isinstance(law, FixedGain):
        return laws.Law([_rationals(law.K)])
    return laws.Law(
        None, [_rationals(W) for W in law.W], [_rationals(Z) for Z in law.Z], law.degree
    )


def _rationals(matrix: Array) -> matrices.Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]
