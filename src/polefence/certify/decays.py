"""How fast a loop decays where its clock is not perfect: the largest rate that is proved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from polefence.certify.bounds import Bound, dual_evidence
from polefence.law.laws import Law
from polefence.lmi.solve.duals import duals, in_parts
from polefence.plant.boxes import Box
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.proof.claims.base import prove
from polefence.proof.claims.decay import Decay, none
from polefence.proof.laws import Evidence, Piece
from polefence.proof.work import FormatError, counted
from polefence.requirements.rms import Rms
from polefence.requirements.specification import claim_of
from polefence.response.closed import close

# Of the slowest rate of constant periods at the corners, what is tried: a loop of two states has
# 0.95 for +-20 % of 0.5 and of 1 s, not 0.99; a servo with a soft shaft 0.85 for +-20 %.
SHARES = (0.95, 0.85, 0.7, 0.5, 0.3, 0.1)
# Parts of the box where bounds took none: a spring with two parameters takes 3 to 8. Where they
# took some the rate has these and no more: of a van, for 20 % of jitter and a lost sample, a rate
# that has no proof took four minutes in up to 16 parts.
MOST = 16


def proved_decay(plant: UncertainPlant, law: Law, bounds: Iterable[Bound]) -> Decay | None:
    """Return the claim of the largest rate that is proved for periods in any order; None of none.

    Parameters
    ----------
    bounds : iterable of Bound
        What is proved: the rate is asked for where one is of an rms of the samples of a clock that
        is not perfect.
    """
    known = [(one.specification, one.claim) for one in bounds]
    of_rms = [(asked, claim) for asked, claim in known if isinstance(asked, Rms)]
    asked = of_rms[0][0] if of_rms else None
    held = None if asked is None else asked.held(plant)
    if asked is None or held is None or held.clock is None:
        return None
    slowest = slowest_rate(plant, law, asked)
    if not slowest > 0:
        return None
    cells = max((claim.subject.evidence.cells for _, claim in of_rms), key=len)
    boxes = [Box(tuple(map(float, c.low)), tuple(map(float, c.high))) for c in cells]
    rates = (slowest * share for share in SHARES)
    return next(filter(None, (_proved(plant, law, asked, rate, boxes) for rate in rates)), None)


def slowest_rate(plant: UncertainPlant, law: Law, asked: Rms) -> float:
    """Return the slowest rate of constant periods of the clock, at the corners [1/s]."""
    plant, corners, rates = delta_form(plant), np.eye(len(plant.vertices)), list[float]()
    loops = close(plant, law, corners)
    for length in asked.lengths(plant):
        channel = asked.over(plant, corners, length)
        F = np.eye(plant.shape[0]) + float(plant.period) * (channel.A + channel.B @ loops.K)
        radius = float(np.abs(np.linalg.eigvals(F)).max())
        rates.append(-np.log(max(radius, 1e-300)) / (length * float(plant.period)))
    return min(rates)


def _proved(
    plant: UncertainPlant, law: Law, asked: Rms, rate: float, boxes: Sequence[Box]
) -> Decay | None:
    plant = delta_form(plant)
    dual = asked.dual(plant, law)
    if dual is None or not dual.clocked:
        return None
    problem = replace(dual, decay=rate)
    if len(plant.vertices) == 1:
        evidence = next((dual_evidence(one) for one in duals(problem, 1.0)), None)
    else:
        parts = in_parts(problem, np.inf, len(boxes) or MOST, first=boxes)
        pieces = tuple(
            Piece(tuple(map(Fraction, p.low)), tuple(map(Fraction, p.high)), dual_evidence(p.dual))
            for p in parts or ()
        )
        evidence = Evidence([], dual=True, cells=pieces) if pieces else None
    if evidence is None:
        return None
    claim = decay_claim(plant, law, asked, evidence, Fraction(rate))
    with counted(claim.allowed):
        try:
            return claim if prove(claim).proved else None
        except FormatError:  # more work than is checked
            return None


def decay_claim(
    plant: UncertainPlant, law: Law, asked: Rms, evidence: Evidence, rate: Fraction
) -> Decay:
    """Return the claim that a loop decays at a rate, by the evidence given."""
    plant = delta_form(plant)
    on = law.domain_of(plant).on
    subject = claim_of(plant, law.exact, on, asked, evidence, Fraction(1)).subject
    zero = (none(subject.n, subject.m, len(subject.A)),)
    return Decay(subject, zero, rate, held=asked.held(plant))
