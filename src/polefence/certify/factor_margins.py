"""Gain and phase margins of a given law: the largest that is proved, or whether one is kept.

A margin is stability of a family that has a factor in its loop. Of a phase, an arc of factors is
halved where no proof is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.progress import stage
from polefence.certify.candidates import Deadline, first
from polefence.certify.evidence import (
    FORMS,
    Search,
    certificate_of,
    evidence_at,
    with_remainder,
    work_of,
)
from polefence.certify.interpolated import interpolated
from polefence.law.laws import Law, law_of
from polefence.plant.delta import sampled_form
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.points import seeded
from polefence.plant.system import System
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.factor_margin import GainMargin as GainClaim
from polefence.proof.claims.factor_margin import PhaseMargin as PhaseClaim
from polefence.proof.claims.factor_margin import tangent_up
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence
from polefence.proof.work import FormatError, counted
from polefence.region.regions import Disk, HalfPlane, Region
from polefence.requirements.factor_margin import FactorMargin, PhaseMargin

# How much less than what samples have is tried, as shares of what the margin is above none, and in
# how many parts of the box. Of 40 random loops 35 are proved at the first without parts; five, at
# samples, at the second or third in parts.
STEPS = ((1e-5, 8), (1e-4, 16), (1e-3, 32), *((x, 64) for x in (1e-2, 0.03, 0.1, 0.3, 0.6)))
NEAR = 2  # the first step of samples with a remainder: a car's at 5 ms are proved at none before
MOST_PARTS = 400  # of a limit, as many as of a region
SAMPLES = 500  # beside the vertices
MOST_ARCS = 24  # that are tried: of a van with 3 parameters in 60 s, to half of what samples have
MOST_OF_FORM = 3e10  # what an LMI may cost [multiplications]: of a van and a factor 2e10, 1 s
# Of the whole, below which an arc is not halved; and of samples, of which no proof goes nearer: of
# a quarter car at 5 ms 1e-2.
SHORTEST, COARSE = 1e-5, 3e-3
BITS = 20  # of where an arc ends, behind the point
READ = "read {}"  # names of what a law measures

Proved = tuple[GainClaim, Verdict]


def kept(plant: UncertainPlant, law: Law, asked: FactorMargin) -> Proved | None:
    """Return the claim that a margin's limit is kept, and its proof; None where there is none.

    Raises
    ------
    InputError
        If no such margin is proved of the plant or the law.
    """
    plant = sampled_form(plant)
    if asked.at_most is None or _sampled(plant, law, asked) > asked.at_most:
        return None
    with stage(f"limit on {asked.title}"):
        return _proved(plant, law, asked, asked.at_most, MOST_PARTS)


def largest(plant: UncertainPlant, law: Law, asked: FactorMargin) -> Proved | None:
    """Return the claim of the largest margin that was proved, and its proof; None of none."""
    plant = sampled_form(plant)
    worst = _sampled(plant, law, asked)
    with stage(f"bound on {asked.title}"):
        steps = STEPS if plant.remainder is None else STEPS[NEAR:]
        if isinstance(asked, PhaseMargin):
            claim = _blank(plant, law, asked, asked.level_below(worst, steps[0][0]))
            arcs = _by_arcs(plant, claim) if isinstance(claim, PhaseClaim) else None
            return _checked(arcs and _up_to(asked, arcs))
        return first(
            _proved(plant, law, asked, asked.level_below(worst, share), most)
            for share, most in steps
        )


def _sampled(plant: UncertainPlant, law: Law, asked: FactorMargin) -> float:
    alpha = seeded(plant, len(plant.vertices) + SAMPLES)
    return float(asked.values(plant, law, alpha).max())


def _blank(plant: UncertainPlant, law: Law, asked: FactorMargin, level: float) -> GainClaim:
    """Return the claim of one level, without evidence."""
    return asked.of_law(plant, law.exact, Fraction(level))


def _proved(
    plant: UncertainPlant, law: Law, asked: FactorMargin, level: float, most: int
) -> Proved | None:
    """Return the claim of one level, and its proof."""
    claim = _blank(plant, law, asked, level)
    if isinstance(claim, PhaseClaim):
        return _checked(_by_arcs(plant, claim))
    evidence = _evidence(plant, claim.families[0], most)
    return _checked(None if evidence is None else replace(claim, evidence=(evidence,)))


def _checked(claim: GainClaim | None) -> Proved | None:
    """Return a claim that its evidence proves, and how."""
    if claim is None:
        return None
    with counted(claim.allowed), suppress(FormatError):  # more work than is checked
        verdict = prove(claim)
        return (claim, verdict) if verdict.proved else None
    return None


def _up_to(asked: PhaseMargin, claim: PhaseClaim) -> PhaseClaim | None:
    """Return a claim of the margin to which its arcs go."""
    end = float(claim.ends[-1])
    if not end or not claim.uncovered():
        return claim if end else None
    return replace(claim, level=Fraction(asked.level_of_degrees(2 * math.degrees(math.atan(end)))))


def _by_arcs(plant: UncertainPlant, claim: PhaseClaim) -> PhaseClaim:
    """Return a claim with evidence of arcs from zero on, as far as there is some.

    An arc that has none is halved.
    """
    last = _up(tangent_up(claim.margin))
    shortest = last * Fraction(SHORTEST if plant.remainder is None else COARSE)
    open_, done = list(reversed([*_arcs(last)])), list[tuple[Fraction, Evidence]]()
    for _ in range(MOST_ARCS):
        if not open_:
            break
        a, b = open_.pop()
        evidence = _evidence(plant, replace(claim, ends=(a, b)).families[0], 1)
        if evidence is not None:
            done.append((b, evidence))
        elif b - a > shortest:
            middle = _up((a + b) / 2)
            open_ += [(middle, b), (a, middle)]
        else:
            break
    ends = (Fraction(0), *(end for end, _ in done))
    return replace(claim, ends=ends, evidence=tuple(own for _, own in done))


def _arcs(last: Fraction) -> Iterator[tuple[Fraction, Fraction]]:
    """Yield arcs of 53 degrees, the last shorter."""
    a, step = Fraction(0), Fraction(1, 2)
    while a < last:  # the tangent of a sum
        b = _up((a + step) / (1 - a * step)) if a * step < 1 else last
        b = min(last, b)
        yield a, b
        a = b


def _up(t: Fraction) -> Fraction:
    """Return a number of few bits that is no less."""
    unit = 1 << BITS
    return Fraction(-((-t.numerator * unit) // t.denominator), unit)


def _evidence(plant: UncertainPlant, poles: Poles, most: int) -> Evidence | None:
    """Return evidence that all poles of a family with factors are stable, in so many parts."""
    family, law = _family(plant, poles)
    part = Disk(0.0, 1.0) if plant.sample_time is not None else HalfPlane(0.0)
    with suppress(InputError, np.linalg.LinAlgError):
        if plant.moving:
            found = Search(family, law, part, Deadline(None)).proof(FORMS)
        else:
            found = _between(family, law, part)
            if found is None:
                forms = (form for form in FORMS if work_of(family, law, form) <= MOST_OF_FORM)
                found = first(evidence_at(family, law, part, form) for form in forms)
            if found is None and most > 1:
                search = Search(family, law, part, Deadline(None), most=most, between=True)
                found = search.in_parts()
        if found is not None:
            return certificate_of(family, law, part, [found]).claim().evidence[0]
    return None


def _between(family: UncertainPlant, law: Law, part: Region) -> dict[str, Any] | None:
    """Return evidence that is interpolated between the corners, if it is a proof."""
    found = interpolated(family, law, part)
    if found is None:
        return None
    evidence = with_remainder(family, law, found)
    return evidence if certificate_of(family, law, part, [evidence]).holds() else None


def _family(plant: UncertainPlant, poles: Poles) -> tuple[UncertainPlant, Law]:
    """Return the plant and the law with factors that a claim about poles is of."""
    count = len(poles.A).bit_length() - 1
    known = {p.name for p in plant.parameters}
    free = (name for k in range(100) if (name := f"factor{k}") not in known)
    more = tuple(
        Parameter(next(free), Fraction(0), Fraction(1))
        for _ in range(count - len(plant.parameters))
    )
    vertices = tuple(
        System(tuple(map(tuple, A)), tuple(map(tuple, B)), None, f"vertex {k + 1}")
        for k, (A, B) in enumerate(zip(poles.A, poles.B, strict=True))
    )
    law, size = poles.law, len(poles.law.C[0]) if poles.law.C else 0
    names = tuple(READ.format(j + 1) for j in range(size))
    outputs = tuple(Output(name, "", C=[M[j] for M in law.C]) for j, name in enumerate(names))
    family = UncertainPlant(
        vertices,
        (*plant.parameters, *more),
        plant.name,
        sample_time=plant.sample_time,
        remainder=poles.remainder,
        outputs=outputs,
    )
    return family, law_of(replace(law, measured=names), family, poles.sizes)
