"""Laws that are given, closed around a plant: as polynomials to analyse, and claims to prove."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.design.certificate import Certificate
from polefence.law.laws import FixedGain, Law, ScheduledGain, domain_of
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, least
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import bernstein, elevated, times
from polefence.plant.system import Array
from polefence.proof import definite, work
from polefence.region.regions import Region

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
# What a step of the search may cost, beyond the first form [multiplications].
MOST_WORK = 1e10
# How far inside a region a proof is looked for first; then as far as the search goes.
INSIDE = (0.98, 0.0)


def loop_of(plant: UncertainPlant, law: Law) -> Loop:
    """Return the closed loop as a quotient of polynomials."""
    return _loop(plant, law, np.concatenate([plant.A, plant.B], axis=2))


def loop_with(plant: UncertainPlant, law: Law, C: Array, D: Array) -> Loop:
    """Return the closed loop with the rows of y = C x + D u, (N, p, n) and (N, p, m), below it."""
    rows = [np.concatenate([plant.A, C], axis=1), np.concatenate([plant.B, D], axis=1)]
    return _loop(plant, law, np.concatenate(rows, axis=2))


def _loop(plant: UncertainPlant, law: Law, rows: Array) -> Loop:
    n, domain = plant.shape[0], domain_of(plant, law)
    AB = bernstein(domain, rows, 1)
    if isinstance(law, FixedGain):
        eye = {(0,) * sum(domain.sizes): np.eye(n)}
        both = {(0,) * sum(domain.sizes): np.vstack([np.eye(n), law.K])}
        return Loop(elevated(eye, domain, 1), times(AB, both), domain)
    W = bernstein(domain, law.W, law.degree)
    both = bernstein(domain, np.concatenate([law.W, law.Z], axis=1), law.degree)
    return Loop(elevated(W, domain, 1), times(AB, both), domain, W)


def forms(plant: UncertainPlant, law: Law, parts: int = 1) -> Iterator[tuple[int, int]]:
    """Yield degree and elevation of the Lyapunov polynomials worth trying, the first whatever.

    Raises
    ------
    InputError
        If the plant is so large that the exact checker does not take even the first.
    """
    n, domain = plant.shape[0], domain_of(plant, law)
    own = 2 * law.degree if isinstance(law, ScheduledGain) else 0
    for degree, elevation in LADDER:
        blocks = domain.count(degree + 1 + own + elevation)
        unknowns = domain.count(degree) * n * (n + 1) // 2
        checked = definite.least_work(blocks * parts**2, 2 * n) <= work.MAX_WORK
        if (degree, elevation) == LADDER[0]:
            if not checked:
                raise InputError(f"{plant.name}: {blocks} inequalities are more than is checked")
        elif not checked or blocks * unknowns**2 * (2 * n) ** 2 > MOST_WORK:
            return
        yield degree, elevation


def points_inside(
    loop: Loop, region: Region, form: tuple[int, int]
) -> Iterator[LyapunovPolynomial]:
    """Yield Lyapunov polynomials of a form for a region: well inside it, then as far as it goes."""
    for enough in INSIDE:
        with suppress(SolverError):
            found = least(loop, Around(region), *form, enough=enough)
            if found.r >= 1:
                return
            yield found


def placeholder(plant: UncertainPlant, law: Law) -> dict[str, Any]:
    """Return evidence that has the shape of some, for a claim whose poles are to be looked at."""
    n, count = plant.shape[0], domain_of(plant, law).count(0)
    return {"X": np.tile(np.eye(n), (count, 1, 1)), "degree": 0, "elevation": 0}


def evidence_of(found: LyapunovPolynomial, form: tuple[int, int]) -> dict[str, Any]:
    """Return what was found as a certificate has it."""
    evidence = {"X": found.Q, "degree": form[0], "elevation": form[1]}
    return evidence if found.multiple is None else evidence | {"multiple": found.multiple}


def certificate_of(
    plant: UncertainPlant, law: Law, region: Region, parts: Sequence[dict[str, Any]]
) -> Certificate:
    """Return the claim with its evidence, one for each part of the region."""
    evidence: dict[str, Any] = {"parts": tuple(parts)}
    if isinstance(law, FixedGain) and len(domain_of(plant, law).sizes) > 1:
        evidence["on"] = "box"
    return Certificate(plant, region, "lyapunov", law, evidence)
