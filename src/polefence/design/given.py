"""Laws that are given: their poles in a region proved or refuted, and how far they go."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, overload

import numpy as np

from polefence.base.errors import InputError, RegionError, SolverError, require_type
from polefence.design.certificate import Certificate
from polefence.design.checks import require_region
from polefence.design.counterexample import counterexample, first_worst, worst_points
from polefence.design.design import Design
from polefence.design.search import Deadline, first
from polefence.design.table import TableAnalysis, analyse_table
from polefence.law.laws import (
    FixedGain,
    GainTable,
    Law,
    PolynomialGain,
    ScheduledGain,
    divisible,
    domain_of,
    given_law,
)
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.target import Around, Decays, Disks, Goal, Sectors
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, least, points_inside
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.boxes import MOST_PARTS, Box, divided, widest
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at, values_text
from polefence.plant.polynomial import bernstein, elevated, times
from polefence.plant.system import Array
from polefence.proof import matrices, work
from polefence.proof.claims.base import prove
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, Piece
from polefence.proof.polynomials import coordinates
from polefence.region.regions import Disk, HalfPlane, Region, Sector, damping_of

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
# What a step of the search may cost, beyond the first form [multiplications].
MOST_WORK = 1e10
# Degree and elevation in parts of the box, and what a step may cost there beyond the first form.
IN_PARTS, MOST_IN_PART = ((0, 0), (1, 0)), 1e9

TOLERANCES = (1e-8, 1e-6, 1e-4, 1e-2)
# How far beyond the r that a point reaches in floats the exact proof is attempted.
STEPS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
# How far inside the half-plane a first point for damping ratios is looked for.
INSIDE = 0.98
# A proof within this share of the worst point is near enough.
NEAR = 1e-4
# How far beyond the worst point a region is proved in parts of the box.
BEYOND = (1e-4, 1e-3, 1e-2)


@dataclass(frozen=True, eq=False, repr=False)
class Analysis:
    """The answer to "does this law keep all poles in the region?".

    Attributes
    ----------
    plant, law, region
        The question.
    answer : str
        "proved", "refuted" or "undecided".
    reason : str
    certificate : Certificate or None
        Of a proved answer: it saves and checks as a design's does.
    alpha : tuple of Fraction or None
        Of a refuted answer: where a pole is not in the region, exactly.
    pole : complex or None
        That pole, in floats [1/s].
    """

    plant: UncertainPlant
    law: Law
    region: Region
    answer: str
    reason: str
    certificate: Certificate | None = None
    alpha: tuple[Fraction, ...] | None = None
    pole: complex | None = None

    def __repr__(self) -> str:
        return f"<Analysis of {self.plant.name!r}: {self.region}, {self.answer}>"

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    @property
    def values(self) -> dict[str, float] | None:
        """The parameters' values at ``alpha``; None without, or where none have this alpha."""
        return None if self.alpha is None else values_at(self.plant, self.alpha)

    @property
    def design(self) -> Design:
        """The law, region and certificate as a design, to save or draw.

        Raises
        ------
        InputError
            If the answer is not "proved".
        """
        if self.certificate is None:
            raise InputError(f"the analysis is {self.answer}; only a proved one makes a design")
        return Design(self.certificate)

    def poles(self, alpha: Array) -> Array:
        """Closed-loop poles at points alpha (..., N) of the simplex, as (..., n) complex."""
        A, B = self.plant.at(alpha)
        return np.asarray(np.linalg.eigvals(A + B @ self.law.gain(alpha)))


@overload
def analyse(
    plant: UncertainPlant,
    law: GainTable,
    region: Region,
    budget: float | None = ...,
    depth: int = ...,
) -> TableAnalysis: ...


@overload
def analyse(
    plant: UncertainPlant, law: Any, region: Region, budget: float | None = ..., depth: int = ...
) -> Analysis: ...


def analyse(
    plant: UncertainPlant, law: Any, region: Region, budget: float | None = None, depth: int = 4
) -> Analysis | TableAnalysis:
    """Prove or refute that a given law keeps all poles of the whole family in a region.

    For one gain, or a law Z W^-1: Lyapunov polynomials of growing degree are tried, one for each
    part of the region; where those that are cheap do not prove it, one for each of some parts of
    the box. For a table of gains: cell by cell, see `TableAnalysis`. For a plant with parameters
    the family is that of the parameters' box.

    Parameters
    ----------
    plant : UncertainPlant
    law : (m, n) matrix, any law of `polefence.law`, Design or control.StateSpace
        u = K x. Of python-control's ``lqr``, whose u is -K x, give -K. A ``StateSpace`` must be a
        static gain.
    region : Region
    budget : float, optional
        Time after which no higher degree is begun, and no cell halved [s]; the answer then says
        so. Without one the counted size of the next step alone ends the search.
    depth : int
        How often a cell of a table may be halved.

    Returns
    -------
    Analysis or TableAnalysis
        The latter for a table.

    Raises
    ------
    InputError
        If the law does not fit the plant, or the region the plant's time.
    """
    if isinstance(law, GainTable):
        return analyse_table(plant, law, region, depth, budget)
    return _analysed(plant, given_law(plant, law), region, Deadline(budget), MOST_PARTS)


def analyse_whole(plant: UncertainPlant, law: Law, region: Region) -> Analysis:
    """Analyse a law as `analyse` does, with one Lyapunov polynomial for all of the box."""
    return _analysed(plant, law, region, Deadline(None), 1)


def _analysed(
    plant: UncertainPlant, law: Law, region: Region, deadline: Deadline, most: int
) -> Analysis:
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    require_region(plant, region)
    ladder = list(forms(plant, law, len(region.parts)))
    claim = certificate_of(plant, law, region, [placeholder(plant, law)] * len(region.parts))
    parts = list[dict[str, Any]]()
    # of the lowest degree first: most laws that keep a region need no other
    found = [_at(plant, law, part, ladder[0]) for part in region.parts]
    if None in found:
        alpha = counterexample(claim.claim())
        if alpha is not None:
            return _refuted(plant, law, region, alpha)
    for part, first_found in zip(region.parts, found, strict=True):
        evidence = first_found
        if evidence is None:
            search = _Search(plant, law, part, ladder, deadline, most)
            evidence = search.proof()
            if search.alpha is not None:
                return _refuted(plant, law, region, search.alpha)
        if evidence is None:
            reason = f"no proof for {part} with {search.tried}; no counterexample either"
            if deadline.passed and search.last != ladder[-1]:
                reason += f"; {deadline}"
            return Analysis(plant, law, region, "undecided", reason)
        parts.append(evidence)
    certificate = certificate_of(plant, law, region, parts)
    verdict = certificate.prove()
    answer = "proved" if verdict.proved else "undecided"
    return Analysis(plant, law, region, answer, verdict.reason, certificate)


class _Search:
    """The search for evidence of one part of a region, beyond the lowest form.

    ``last`` is the form of the whole box tried last; ``alpha``, where there is one, refutes it.
    """

    def __init__(
        self,
        plant: UncertainPlant,
        law: Law,
        part: Region,
        ladder: Sequence[tuple[int, int]],
        deadline: Deadline,
        most: int,
    ) -> None:
        self.plant, self.law, self.part, self.ladder = plant, law, part, ladder
        self.deadline = deadline
        self.most = _most_parts(plant, law, most)
        self.last, self.halved = ladder[0], False
        self.alpha: list[Fraction] | None = None

    @property
    def tried(self) -> str:
        """What was tried, in words."""
        degree, elevation = self.last
        found = f"Lyapunov polynomials up to degree {degree}, elevation {elevation}"
        return found + f", nor in {self.most} parts of the box" * self.halved

    def proof(self) -> dict[str, Any] | None:
        """Return evidence of a higher form, else of low ones in parts of the box."""
        for form in self.ladder[1:]:
            if self.deadline.passed:
                return None
            self.last = form
            evidence = _at(self.plant, self.law, self.part, form)
            if evidence is not None:
                return evidence
        return self.in_parts()

    def in_parts(self) -> dict[str, Any] | None:
        """Return evidence in parts of the box, None where there are too many."""
        if self.most < 2 or self.deadline.passed:
            return None
        self.halved = True
        plant, law = self.plant, self.law
        claim = certificate_of(plant, law, self.part, [placeholder(plant, law)]).claim()
        loop = loop_of(plant, law)

        def proving(box: Box) -> Evidence | None:
            return _evidence_in(box, claim, loop, self.part, self._forms)

        def along(box: Box) -> int | None:
            self.alpha = _leaving(box, claim)
            return None if self.alpha or self.deadline.passed else self._widest(box)

        whole = Box.whole(loop.domain)
        halves = list(whole.halves(self._widest(whole)))
        with suppress(np.linalg.LinAlgError):
            parts = divided(halves, proving, along, self.most)
            return parts and {"cells": tuple(_cell(box, own) for box, own in parts)}
        return None

    @property
    def _forms(self) -> list[tuple[int, int]]:
        first, *higher = IN_PARTS
        works = ((form, _work(self.plant, self.law, form)) for form in higher)
        return [first, *(form for form, own in works if own <= MOST_IN_PART)]

    def _widest(self, box: Box) -> int:
        plant, law, domain = self.plant, self.law, domain_of(self.plant, self.law)

        def loops(own: Array) -> Array:
            alpha = box.alpha(domain, own)
            A, B = plant.at(alpha)
            return np.asarray(A + B @ law.gain(alpha))

        return widest(domain, loops)


def _most_parts(plant: UncertainPlant, law: Law, most: int) -> int:
    """Return in how many parts of the box a claim is searched for and checked."""
    if not divisible(plant, law):
        return 1
    checked = matrices.least_work(_blocks(plant, law, IN_PARTS[-1]), 2 * plant.shape[0])
    found = MOST_PARTS * MOST_IN_PART / _work(plant, law, IN_PARTS[0])
    return min(most, work.MAX_WORK // checked, int(found))


def _evidence_in(
    box: Box, claim: Poles, loop: Loop, part: Region, ladder: Sequence[tuple[int, int]]
) -> Evidence | None:
    """Return evidence that proves a claim about one part of a region in a part of the box."""
    inside = claim.inside(_piece(box, claim.evidence[0]))
    own = loop.inside(box)
    for form in ladder:
        for found in points_inside(own, part, form):
            X = [[[Fraction(e) for e in row] for row in Q] for Q in found.Q.tolist()]
            evidence = Evidence(X, *form)
            if prove(replace(inside, evidence=(evidence,))).proved:
                return evidence
    return None


def _leaving(box: Box, claim: Poles) -> list[Fraction] | None:
    """Return an alpha in a part of the box at which a pole leaves the region, None if none was."""
    piece = _piece(box, claim.evidence[0])
    alpha = counterexample(claim.inside(piece))
    if alpha is None:
        return None
    own, whole = coordinates(alpha, claim.sizes)[1::2], [Fraction(1)]
    for low, high, t in zip(piece.low, piece.high, own, strict=True):
        at = low + (high - low) * t
        whole = [a * w for a in whole for w in (1 - at, at)]
    return whole


def _piece(box: Box, evidence: Evidence) -> Piece:
    return Piece(tuple(map(Fraction, box.low)), tuple(map(Fraction, box.high)), evidence)


def _cell(box: Box, own: Evidence) -> dict[str, Any]:
    """Return the evidence of a part of the box as a certificate has it."""
    X = np.array([[[float(e) for e in row] for row in Q] for Q in own.X])
    ends = {"low": np.array(box.low), "high": np.array(box.high)}
    return ends | {"X": X, "degree": own.degree, "elevation": own.elevation}


def _at(
    plant: UncertainPlant, law: Law, part: Region, form: tuple[int, int]
) -> dict[str, Any] | None:
    """Return evidence of a form that is proved for one part of a region."""

    def proved(found: LyapunovPolynomial) -> dict[str, Any] | None:
        evidence = evidence_of(found, form)
        holds = certificate_of(plant, law, part, [evidence]).prove().proved
        return evidence if holds else None

    with suppress(np.linalg.LinAlgError):  # a law without a value somewhere
        return first(map(proved, points_inside(loop_of(plant, law), part, form)))
    return None


def _refuted(plant: UncertainPlant, law: Law, region: Region, alpha: list[Fraction]) -> Analysis:
    point = np.array([float(a) for a in alpha])
    A, B = plant.at(point)
    try:
        poles = np.linalg.eigvals(A + B @ law.gain(point))
        pole = complex(poles[np.argmax(region.distance(poles))])
        shown = f"{pole:.6g}" if pole.imag else f"{pole.real:.6g}"
        what = f"the pole {shown} is not in {region}"
    except np.linalg.LinAlgError:
        pole, what = None, "the law has no value"
    weights = f"alpha = ({', '.join(f'{a:.6g}' for a in point)})"
    values = values_at(plant, alpha)
    if values is not None:
        weights = f"{values_text(plant, values)}, {weights}"
    elif plant.parameters:
        weights += ", which no parameter values have,"
    reason = f"at {weights} {what}"
    return Analysis(plant, law, region, "refuted", reason, None, tuple(alpha), pole)


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
    if isinstance(law, PolynomialGain):
        both = bernstein(domain, law.form, law.degree)
        eye = elevated({(0,) * sum(domain.sizes): np.eye(n)}, domain, law.degree + 1)
        return Loop(eye, times(AB, both), domain)
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
    n = plant.shape[0]
    for form in LADDER:
        blocks = _blocks(plant, law, form)
        checked = matrices.least_work(blocks * parts**2, 2 * n) <= work.MAX_WORK
        if form == LADDER[0]:
            if not checked:
                raise InputError(f"{plant.name}: {blocks} inequalities are more than is checked")
        elif not checked or _work(plant, law, form) > MOST_WORK:
            return
        yield form


def _blocks(plant: UncertainPlant, law: Law, form: tuple[int, int]) -> int:
    """Return how many inequalities a Lyapunov polynomial of a form has for a part of a region."""
    own = 0 if isinstance(law, FixedGain) else law.degree
    own *= 2 if isinstance(law, ScheduledGain) else 1
    return domain_of(plant, law).count(form[0] + 1 + own + form[1])


def _work(plant: UncertainPlant, law: Law, form: tuple[int, int]) -> float:
    """Return about what a step of the search for one costs [multiplications]."""
    n = plant.shape[0]
    unknowns = domain_of(plant, law).count(form[0]) * n * (n + 1) // 2
    return float(_blocks(plant, law, form) * unknowns**2 * (2 * n) ** 2)


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


@dataclass(frozen=True, eq=False, repr=False)
class WorstCase:
    """Reach of a law: the smallest region of a kind it is proved to keep, and what it fails.

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
    else:
        best = _beyond(plant, law, question, best, deadline)
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
    """A region that grows with r, the r at the worst point found, and where to begin."""

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


def _beyond(
    plant: UncertainPlant,
    law: Law,
    question: _Question,
    best: tuple[float, Region, Certificate] | None,
    deadline: Deadline,
) -> tuple[float, Region, Certificate] | None:
    """Return the least r that is proved in parts of the box, else the best so far."""
    for step in BEYOND:
        r = question.bound * (1 + step)
        region = question.region(r)
        if not np.isfinite(r) or region is None or (best is not None and best[0] <= r):
            continue
        search = _Search(plant, law, region, [LADDER[0]], deadline, MOST_PARTS)
        evidence = search.in_parts()
        if evidence is not None:
            certificate = certificate_of(plant, law, region, [evidence])
            if certificate.prove().proved:
                return r, region, certificate
    return best


def _points(loop: Loop, question: _Question, form: tuple[int, int]) -> Iterator[LyapunovPolynomial]:
    """Yield points farther and farther from the edge."""
    near = None
    if question.first is not None:
        with suppress(SolverError):
            near = least(loop, question.first, *form, enough=INSIDE)
    for tolerance in TOLERANCES:
        with suppress(SolverError):
            yield least(loop, question.goal, *form, tolerance=tolerance, near=near)
