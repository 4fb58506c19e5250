"""Reach of a given law: its largest decay rate or damping ratio, its smallest disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError, RegionError, SolverError
from polefence.design.certificate import Certificate
from polefence.design.checks import require_region
from polefence.design.counterexample import first_worst, worst_points
from polefence.design.given.analysis import (
    certificate_of,
    evidence_of,
    forms,
    loop_of,
    placeholder,
)
from polefence.design.search import Deadline, first
from polefence.law.laws import Law, domain_of, given_law
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.target import Around, Decays, Disks, Goal, Sectors
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, least
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at
from polefence.plant.system import Array
from polefence.region.regions import Disk, HalfPlane, Region, Sector, damping_of

TOLERANCES = (1e-8, 1e-6, 1e-4, 1e-2)
# How far beyond the r that a point reaches in floats the exact proof is attempted.
STEPS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
# How far inside the half-plane a first point for damping ratios is looked for.
INSIDE = 0.98
# A proof within this share of the worst point is near enough.
NEAR = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class WorstCase:
    """How far a law goes: the smallest region of a kind it is proved to keep, and what it fails.

    Attributes
    ----------
    region : Region or None
        Proved; None where nothing was.
    certificate : Certificate or None
        That of the region: ``Design(certificate)`` saves and checks.
    bound : float
        The radius or decay rate [1/s], or the damping ratio, at the worst alpha found: no proof
        can pass it.
    alpha : tuple of float
        That alpha.
    values : dict or None
        The parameters' values there.
    cut : bool
        Whether the budget in seconds ended the search.
    """

    region: Region | None
    certificate: Certificate | None
    bound: float
    alpha: tuple[float, ...]
    values: dict[str, float] | None = None
    cut: bool = False

    def __repr__(self) -> str:
        return f"<WorstCase: {self.region} proved, {self.bound:.6g} sampled>"


def worst_case(
    plant: UncertainPlant,
    law: Any,
    of: str = "half_plane",
    centre: float | None = None,
    budget: float | None = None,
) -> WorstCase:
    """Return the smallest region of a kind that a given law is proved to keep.

    Parameters
    ----------
    plant : UncertainPlant
    law
        As for `analyse`, but no table.
    of : str
        "half_plane" (the largest decay rate), "sector" (the largest damping ratio) or "disk".
    centre : float
        Of the disks [1/s].
    budget : float, optional
        Time after which no higher degree is begun [s]; ``cut`` then says so.

    Raises
    ------
    InputError
        If the law does not fit the plant, or the question is incomplete.
    """
    law = given_law(plant, law)
    if (of == "disk") != (centre is not None):
        raise InputError("of = 'disk' needs a centre (centre=-40, say), other questions have none")
    measure = _measure(of, centre)
    widest = HalfPlane(0) if centre is None else Disk(centre, 1e-6)
    require_region(plant, widest)
    ladder = forms(plant, law)
    deadline = Deadline(budget)
    claim = certificate_of(plant, law, widest, [placeholder(plant, law)]).claim()
    point, worst = first_worst(worst_points(claim, measure))
    alpha = tuple(float(a) for a in domain_of(plant, law).alpha(point))
    question = _question(of, centre, worst, typical_rate(plant.A), plant.sample_time is not None)
    best: tuple[float, Region, Certificate] | None = None
    cut = False
    for form in ladder if np.isfinite(question.bound) else ():
        found = _tried(plant, law, question, form)
        if found is not None and (best is None or found[0] < best[0]):
            best = found
        near = best is not None and best[0] <= question.bound * (1 + NEAR)
        cut = not near and deadline.passed
        if near or cut:
            break
    bound, values = worst if of == "disk" else 0.0 - worst, values_at(plant, alpha)
    if best is None:
        return WorstCase(None, None, bound, alpha, values, cut)
    return WorstCase(best[1], best[2], bound, alpha, values, cut)


def _measure(of: str, centre: float | None) -> Callable[[Any], Array]:
    """Return how bad poles are: distance from the centre, or minus decay rate or damping ratio."""
    if centre is not None:
        return lambda z: np.asarray(np.abs(z - centre).max(axis=-1))
    if of == "half_plane":
        return lambda z: np.asarray(np.real(z).max(axis=-1))
    if of == "sector":
        return lambda z: np.asarray((np.real(z) / np.maximum(np.abs(z), 1e-300)).max(axis=-1))
    raise InputError(f"of = {of!r} is unknown; use 'disk', 'half_plane' or 'sector'")


@dataclass(frozen=True, eq=False)
class _Question:
    """What grows with r, the region of an r, the r at the worst point found; where to begin."""

    goal: Goal
    region: Callable[[float], Region | None]
    bound: float
    first: Goal | None = None


def _question(
    of: str, centre: float | None, worst: float, rate: float, discrete: bool
) -> _Question:
    if centre is not None:
        c = float(centre)
        return _Question(Disks(c), lambda r: _disk(c, r, discrete), worst)
    if of == "half_plane":
        # just beyond the decay rate at the worst point, so that r is small
        fastest = -worst + max(abs(worst), 1e-3 * rate)
        return _Question(Decays(fastest), lambda r: HalfPlane(fastest - r), fastest + worst)
    slope = np.sqrt(max(1 / worst**2 - 1, 0.0)) if worst < 0 else np.inf
    return _Question(Sectors(rate), _sector, float(slope), Around(HalfPlane(0)))


def _disk(centre: float, radius: float, discrete: bool) -> Region | None:
    with suppress(RegionError):  # in discrete time, a disk that leaves the unit circle
        disk = Disk(centre, radius)
        return disk if disk.discrete or not discrete else None
    return None


def _sector(slope: float) -> Region | None:
    damping = damping_of(slope)
    return Sector(damping) if 1e-8 <= damping < 1 else None


def _tried(
    plant: UncertainPlant, law: Law, question: _Question, form: tuple[int, int]
) -> tuple[float, Region, Certificate] | None:
    """Return the least r that is proved with polynomials of one form, with its region."""

    def proved(found: LyapunovPolynomial, r: float) -> tuple[float, Region, Certificate] | None:
        region = question.region(r)
        if region is None:
            return None
        certificate = certificate_of(plant, law, region, [evidence_of(found, form)])
        return (r, region, certificate) if certificate.prove().proved else None

    points = _points(loop_of(plant, law), question, form)
    return first(proved(found, found.r * (1 + step)) for found in points for step in STEPS)


def _points(loop: Loop, question: _Question, form: tuple[int, int]) -> Iterator[LyapunovPolynomial]:
    """Yield points farther and farther from the edge."""
    near = None
    if question.first is not None:
        with suppress(SolverError):
            near = least(loop, question.first, *form, enough=INSIDE)
    for tolerance in TOLERANCES:
        with suppress(SolverError):
            yield least(loop, question.goal, *form, tolerance=tolerance, near=near)
