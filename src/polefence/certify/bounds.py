"""Bounds of a given law: the least on a signal that is proved, beside samples, and in files.

A sample proves nothing. Its worst value is at most the true worst case, which is at most a bound
that is proved; the ratio of the two says how far apart they can be.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.effort import spend
from polefence.base.errors import InputError, SolverError
from polefence.base.explained import explained
from polefence.base.files import write_documents
from polefence.base.progress import stage
from polefence.certify import factor_margins, peak_to_peak, responses
from polefence.certify.by_transfer import ByTransfer
from polefence.certify.candidates import TOLERANCES, first
from polefence.certify.certificate import Certificate
from polefence.certify.design import FILE_NAME
from polefence.certify.evidence import finer, pieces_of
from polefence.certify.lyapunov import lyapunov_matrix, weights_at
from polefence.certify.scaled_parts import Found, InParts
from polefence.law.laws import Law
from polefence.lmi.conditions import performance
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.performance import Source
from polefence.lmi.solve.along_motions import Along, along_motions
from polefence.lmi.solve.dual_problem import Dual, DualProblem
from polefence.lmi.solve.duals import Known as KnownParts
from polefence.lmi.solve.duals import Part, duals, in_parts, least_in
from polefence.lmi.solve.late import LateSearch
from polefence.lmi.solve.loops import loop_with, with_inputs
from polefence.lmi.solve.lyapunov import (
    MOST_STATES,
    LyapunovPolynomial,
    least_given,
    points_given,
    work,
)
from polefence.lmi.solve.piecewise import OnGrid, on_grids
from polefence.lmi.solve.piecewise import least_in as least_on_grid
from polefence.lmi.solve.spread import spread_of
from polefence.lmi.solve.started import StartedSearch
from polefence.plant.boxes import Box
from polefence.plant.card import card
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.parts import inside
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof import matrices
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.claims.signal import SignalClaim
from polefence.proof.document import Document
from polefence.proof.laws import Evidence, Piece
from polefence.proof.polynomials import corners_of
from polefence.proof.remainder import SHARE, Spread
from polefence.proof.short import Short
from polefence.proof.storage import Stretch
from polefence.proof.work import FormatError, counted
from polefence.requirements.factor_margin import FactorMargin
from polefence.requirements.gain_norm import GainNorm, by_multiples, levels
from polefence.requirements.measured import Measured
from polefence.requirements.peak_to_peak import PeakToPeak
from polefence.requirements.rms import (
    Rms,
    in_any_order,
    of_one_noise,
    of_one_noise_at_samples,
)
from polefence.requirements.specification import Specification, claim_of
from polefence.requirements.weights import behind

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (2, 0))
# How far above what was found in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
# Further ones, of functions of the parameters, whose remainder takes room: of two states and one
# moving parameter the gain is proved at 0.423 with them, at 0.762 without; sampled 0.381.
FARTHER = (3e-3, 1e-2, 3e-2, 0.1)
MOST_WORK = 3e8  # of one search beyond the first [multiplications an iteration]
# Of the square of a limit of saturated inputs, what a proof of the limit itself need not go below.
ENOUGH = 0.5
# Times the work of an iteration that a search may take which ends there: 31 of a van's, 2 s.
SHORT = 6
# How far above the worst case in floats a bound is looked for in parts of the box: of a van for
# periods of any length none of 1 % was found in 64 parts, and 2 % takes 6. Of two lengths, one for
# a lost sample, 0.1 % takes 15.
IN_PARTS: tuple[float, ...] = (1e-3, 5e-3, 2e-2)
IN_ANY_ORDER: tuple[float, ...] = (2e-2, 5e-2, 0.15)
# The same with a dead time, above the least that is proved of each corner alone: of a van with two
# sensors the first takes 8 parts and 7 s; of a mass on a spring 1e-3 is out of reach.
LATE = (5e-3, 2e-2, 1e-1)
# From initial states, at all times: of a van's peak 5 % takes 2 parts and 11 s, 2 % 4 and 61 s.
FROM_STATES: tuple[float, ...] = (5e-2, 0.15, 0.5)
# By what a grid of twice as many cells lowers a gain along motions, if a finer one is tried: of a
# loop with dead time 4.6, 2.7 and 1.4 % at 8, 16 and 32 cells, which take 5, 7 and 13 s.
FINER = 0.03
# The same of what is posed for one level after the other, as a limit.
NEARLY = 0.01  # how near one that is looked for a bound is near enough
AS_LIMITS = (2e-5, 2e-4, 2e-3, 1e-2, 5e-2, 0.2, 0.6, 1.5)
NEAREST = 1e-4  # so near the worst sample dual polynomials end
CLOSE = 2e-3  # a bound within this share of the worst sample is good enough

Known = tuple[Evidence, float]

# Evidence, to rounding and then exactly as it was found, and the r that it proves in floats.
Points = Iterator[tuple[Iterable[Evidence], float]]

# A sample is computed with rounding: it agrees with a bound that it passes by this share.
AGREED = 1e-6
FEW = 20  # samples beside the vertices
# The same where entries are functions of the parameters: the worst is inside the box more often. Of
# a pendulum's two parameters 20 samples missed 2.7 % of the rms, 500 none.
MORE = 500


@dataclass(frozen=True, eq=False)
class Bound(Short):
    """A bound on a signal that is proved.

    Attributes
    ----------
    specification : Specification
    level : float
        In the signal's unit; of a gain, per unit of the disturbance.
    claim : BoundClaim
        With its evidence.
    degree : int
        Of the Lyapunov polynomial; of a gain norm of the law's.
    reason : str
        What was proved.
    parameters : tuple of Parameter
        Of the plant.
    errors : float, optional
        Of a plant with functions of its parameters, by what share the level would be lower if the
        polynomials that stand for them were exact, with as many parts of the box; in floats.
    """

    specification: Specification
    level: float
    claim: BoundClaim
    degree: int
    reason: str
    parameters: tuple[Parameter, ...] = ()
    errors: float | None = None

    @property
    def number(self) -> float:
        """What people read of the level."""
        return self.specification.read_as(self.level)

    def __str__(self) -> str:
        return self.specification.bound_text(self.level)

    def lyapunov_at(self, alpha: Any = None, /, **values: Any) -> Array:
        """Return the Lyapunov matrix P of the proof at one point, as ``lyapunov_at(m1=300)``.

        V = x'P x falls along every motion of the loop while no disturbance acts. Of an rms bound
        P^-1 is at least the covariance of the states (or P the observability Gramian, of the dual
        form). A plant at samples is one of x(t + T) = A_c x(t): A_c'P A_c < P.

        Parameters
        ----------
        alpha : (N,) array, optional
            Weights of the vertices, in place of the parameters' values.
        **values : number
            Of every parameter, in its unit.

        Returns
        -------
        (n, n) array
            Symmetric, positive definite; computed exactly, then rounded.

        Raises
        ------
        InputError
            If the point is none of the family, or the bound is proved without a Lyapunov matrix,
            as one on the norm of the gain is, and one by the transfer function.
        """
        if not self.specification.of_signal:
            raise InputError(f"{self.specification.title}: its bound needs no Lyapunov matrix")
        subject = self.claim.subject
        weights = weights_at(self.parameters, corners_of(subject.sizes), alpha, values)
        return lyapunov_matrix(subject.law, subject.sizes, subject.evidence, weights)

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        return card("bound", [("proved", str(self)), ("by", self.reason)])


@explained
def best_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None = None
) -> Bound | None:
    """Return the least bound that is proved with Lyapunov polynomials of growing degree.

    Dual ones, found by interpolation, come first; an LMI is solved where they are not close.

    Parameters
    ----------
    known : pair of Evidence and float, optional
        What proves the bound of that level as far as floats tell; tried where nothing lower is
        proved otherwise.
    """
    specification.require_fit(plant)
    require_passing(plant, law, specification)
    if isinstance(specification, FactorMargin):
        return _of_given(plant, specification, factor_margins.largest(plant, law, specification))
    if isinstance(specification, Measured):
        return _of_given(plant, specification, responses.least(plant, law, specification))
    if isinstance(specification, PeakToPeak):
        return _of_given(plant, specification, peak_to_peak.least(plant, law, specification))
    with stage(f"bound on {specification.title}"):
        best = _least_bound(plant, law, specification, known)
        if specification.scales_apart(plant, law):
            level = np.inf if best is None else best.level
            found = InParts(delta_form(plant), law, specification, _least_bound).least(level)
            best = best if found is None else _joined(plant, specification, found)
        return _of(specification, best)


def _least_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None = None
) -> Bound | None:
    best: Bound | None = None
    hoped = 0.0  # how near what was looked for a bound leaves nothing to another way
    for nearest, way in specification.ways(delta_form(plant), law):
        if best is not None and best.level <= (hoped if nearest is None else nearest):
            break
        hoped = max(hoped, (nearest or 0.0) * (1 + NEARLY))
        bound = (
            _best_bound(*way.posed(delta_form(plant), law), known)
            if nearest is None
            else _least_kept(plant, law, way, nearest)
        )
        if bound is not None and (best is None or bound.level < best.level):
            best = bound
    return best


def _joined(plant: UncertainPlant, specification: Specification, found: Found) -> Bound:
    """Return the bound that is proved in parts with scales of their own."""
    claim, reason, degree = found
    return Bound(specification, float(claim.level), claim, degree, reason, plant.parameters)


def _least_kept(
    plant: UncertainPlant, law: Law, specification: Specification, nearest: float
) -> Bound | None:
    """Return the bound of the first level above the nearest that is proved as a limit."""
    if not np.isfinite(nearest):
        return None
    limits = (replace(specification, at_most=nearest * (1 + share)) for share in AS_LIMITS)
    return first(_kept_bound(*limit.posed(delta_form(plant), law), None) for limit in limits)


def _of(specification: Specification, bound: Bound | None) -> Bound | None:
    """Return a bound of what a specification posed as one of the specification itself."""
    return None if bound is None else replace(bound, specification=specification)


def _of_given(
    plant: UncertainPlant,
    specification: Specification,
    found: factor_margins.Proved | responses.Proved | peak_to_peak.Proved | None,
) -> Bound | None:
    """Return the bound of a claim about poles with factors, or of a response that is followed."""
    if found is None:
        return None
    claim, verdict = found
    level, degree = float(claim.level), getattr(claim, "degree", 0)
    return Bound(specification, level, claim, degree, verdict.reason, plant.parameters)


def _best_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None
) -> Bound | None:
    question = _Question.of(plant, law, specification)
    climbs = [_dual_bounds, _in_parts, _along_motions, _on_grids, _climbed]
    best: Bound | None = None
    for climb in (_by_transfer, *(reversed(climbs) if question.by_lmi else climbs)):
        for bound in climb(question):
            if best is None or bound.level < best.level:
                best = bound
        if best is not None and best.level <= question.worst * (1 + question.close):
            break
    if known is not None and (best is None or known[1] * (1 + STEPS[0]) < best.level):
        given = known_bound(plant, law, specification, known)
        if given is not None and (best is None or given.level < best.level):
            best = given
    return None if best is None else question.with_errors(best)


@dataclass(frozen=True, eq=False)
class _Question:
    """What is to be bounded, of which law.

    Attributes
    ----------
    plant, law, specification
    problem : DualProblem, optional
        Its dual form; None of a kind that has none, or a law that is undefined somewhere.
    worst : float
        The worst value at a few points, exact where doubles find none; zero where that has none.
        From initial states at all times the least that is proved at the vertices, if that is more.
    by_transfer : ByTransfer, optional
        Its proof by the transfer function, where there is one.
    moved : DualProblem, optional
        What it is where parameters move.
    known_parts : dict
        What was found on parts of the box, for one level after the other.
    """

    plant: UncertainPlant
    law: Law
    specification: Specification
    problem: DualProblem | None = None
    worst: float = 0.0
    by_transfer: ByTransfer | None = None
    moved: DualProblem | None = None
    known_parts: KnownParts = field(default_factory=dict)

    @classmethod
    def of(cls, plant: UncertainPlant, law: Law, specification: Specification) -> _Question:
        """Return the question with what samples say."""
        few = FEW if plant.functions is None else MORE
        alpha, by_transfer, dual, worst = seeded(plant, len(plant.vertices) + few), None, None, 0.0
        with suppress(InputError, np.linalg.LinAlgError):
            by_transfer = ByTransfer.of(plant, law, specification)
        with suppress(InputError, np.linalg.LinAlgError):
            worst = worst_of(sampled(plant, law, specification, alpha), by_transfer)[0]
            wide = behind(plant, law, specification)
            dual = wide.specification.dual(wide.plant, wide.law)
            if dual is not None and dual.clocked:
                corners = np.eye(len(plant.vertices))
                nearest = in_any_order(wide.specification, wide.plant, wide.law, corners).max()
                dual = dual if np.isfinite(nearest) else None  # nor is there one for more
                worst = max(worst, float(nearest))
            if dual is not None and plant.dead_time is not None:
                worst = max(worst, LateSearch(dual, 1).nearest)
            if dual is not None and dual.starts is not None:  # no bound by ellipsoids is lower
                worst = max(worst, StartedSearch(dual, 1).nearest)
        if not worst and by_transfer is not None:  # doubles may call a loop unstable that is not
            worst = by_transfer.largest(alpha)
        # along a motion a dual form would bound means over time only
        moves = plant.moving and plant.dead_time is None
        still, moved = (None, dual) if moves else (dual, None)
        return cls(plant, law, specification, still, worst, by_transfer, moved)

    @property
    def by_lmi(self) -> bool:
        """Whether it is about a gain, or a ratio, of which LMIs are tried first."""
        problem = self.problem
        if problem is None or (problem.domain.corners == 1 and problem.gain):
            return False
        return problem.gain or problem.share is not None

    @property
    def close(self) -> float:
        """The share of the worst sample within which a bound is good enough."""
        if self.plant.dead_time is not None:
            return LATE[0]
        from_states = self.problem is not None and self.problem.starts is not None
        return FROM_STATES[0] if from_states else CLOSE

    @property
    def duals(self) -> Iterator[Dual]:
        """Dual polynomials of rising degree."""
        return iter(()) if self.problem is None else duals(self.problem, self.worst, NEAREST)

    @property
    def along_motions(self) -> Iterator[Along]:
        """Interpolated polynomials of rising degree, where parameters move."""
        return iter(()) if self.moved is None else along_motions(self.moved, self.worst, NEAREST)

    def along(self, polynomial: Along) -> Evidence:
        """Return the evidence that one is."""
        square, degree = self.specification.driven_by**2, polynomial.degree
        each = [Evidence([_rationals(M / square) for M in X], degree) for X in polynomial.X]
        if len(each) == 1:
            return each[0]
        pieces = tuple(
            Piece(*ends, evidence) for ends, evidence in zip(polynomial.cells, each, strict=True)
        )
        return Evidence([], cells=pieces)

    def evidence(self, dual: Dual) -> Evidence:
        """Return the evidence that a dual polynomial is; with a dead time X of a noise."""
        if dual.reached and self.plant.dead_time is not None:
            return self.along(Along([], [dual.Q], dual.degree, dual.level))
        return dual_evidence(dual)

    def stepped(self, evidence: Evidence, level: float) -> Bound | None:
        """Return the first step above a level at which evidence is a proof."""
        return _stepped(self.plant, self.law, self.specification, evidence, level)

    def proved(self, evidence: Evidence, level: float) -> Bound | None:
        """Return the bound of that level if evidence proves it."""
        return _proved(self.plant, self.law, self.specification, evidence, level)

    def bound_of(self, claim: SignalClaim, verdict: Verdict) -> Bound:
        """Return the bound of a claim that is proved."""
        level, parameters = float(claim.level), self.plant.parameters
        return Bound(self.specification, level, claim, 0, verdict.reason, parameters)

    def kept_by_transfer(self, level: float) -> Bound | None:
        """Return the bound of that level if the transfer function proves it."""
        proof = None if self.by_transfer is None else self.by_transfer.proved(level)
        return None if proof is None else self.bound_of(*proof)

    @property
    def on_grids(self) -> Iterator[OnGrid]:
        """A continuous Q on finer and finer grids, where parameters move."""
        return iter(()) if self.moved is None else on_grids(self.moved, self.worst)

    def on_grid(self, found: OnGrid, level: float) -> Bound | None:
        """Return the bound of that level if what was found on a grid proves it."""
        return self._of(found.parts(level), level)

    def in_parts(self, level: float) -> Bound | None:
        """Return the bound of that level if dual polynomials on parts of the box prove it."""
        parts = None
        if self.problem is not None:
            parts = in_parts(self.problem, level, known=self.known_parts)
        return self._of(parts, level)

    def with_errors(self, bound: Bound) -> Bound:
        """Return the bound with what enclosing functions of the parameters takes of it."""
        problem, evidence = self.problem or self.moved, bound.claim.subject.evidence
        remainder = self.plant.remainder
        if self.plant.functions is None or problem is None or remainder is None:
            return bound
        known = (remainder, *(near for near in problem.near if near is not None))
        if not evidence.cells and not any(any(map(any, one.entries)) for one in known):
            return replace(bound, errors=0.0)
        if not evidence.per_cell[0].dual:
            return bound
        whole = Box.whole(problem.domain)
        boxes = [
            Box(tuple(map(float, cell.low)), tuple(map(float, cell.high)))
            for cell in evidence.cells
        ] or [whole]
        degrees = [part.degree for part in evidence.per_cell]
        exact, own = replace(problem, errors=False), bound.level
        least: float | None
        if self.moved is not None:
            least = least_on_grid(exact, boxes, degrees[0], self.worst)
        else:
            parts = list(zip(boxes, degrees, strict=True))
            own = min(own, least_in(problem, parts, self.worst) or own)
            least = least_in(exact, parts, self.worst)
        return bound if least is None else replace(bound, errors=max(0.0, 1 - least / own))

    def _of(self, parts: Sequence[Part] | None, level: float) -> Bound | None:
        """Return the bound of that level if these parts prove it."""
        if parts is None:
            return None
        pieces = tuple(
            Piece(tuple(map(Fraction, p.low)), tuple(map(Fraction, p.high)), self.evidence(p.dual))
            for p in parts
        )
        return self.proved(Evidence([], dual=pieces[0].evidence.dual, cells=pieces), level)


def _by_transfer(question: _Question) -> Iterator[Bound]:
    """Yield the bound that the transfer function proves, if the kind has one."""
    if question.by_transfer is not None and question.worst > 0:
        proof = question.by_transfer.least(question.worst)
        if proof is not None:
            yield question.bound_of(*proof)


def _climbed(question: _Question) -> Iterator[Bound]:
    """Yield bounds of Lyapunov polynomials of rising degree that LMIs give."""
    last = np.inf
    specification = question.specification
    for points in _climb(question.plant, question.law, specification, 1.0):
        bound = first(
            question.stepped(evidence, specification.level(r))
            for evidences, r in points
            for evidence in evidences
        )
        if bound is not None:
            yield bound
            # along motions the next forms take long
            enough = question.worst * (1 + CLOSE) if question.plant.moving else 0.0
            if bound.level >= last * (1 - 1e-3) or bound.level <= enough:
                return
            last = bound.level


def _dual_bounds(question: _Question) -> Iterator[Bound]:
    """Yield bounds of dual polynomials, if the kind has them."""
    last = np.inf
    for dual in question.duals:
        if dual.level < last:
            bound = question.stepped(question.evidence(dual), dual.level)
            if bound is not None:
                yield bound
                last = bound.level


def _in_parts(question: _Question) -> Iterator[Bound]:
    """Yield the least bound of dual polynomials on parts of the box, if the kind has them."""
    problem, shares = question.problem, IN_PARTS
    if problem is not None and problem.clocked:
        shares = IN_ANY_ORDER if problem.jittered else (*IN_PARTS, *IN_ANY_ORDER[1:])
    elif problem is not None and problem.starts is not None:
        shares = FROM_STATES
    elif question.plant.dead_time is not None:
        shares = LATE
    levels = (question.worst * (1 + share) for share in shares)
    bound = first(map(question.in_parts, levels))
    if bound is not None:
        yield bound


def _along_motions(question: _Question) -> Iterator[Bound]:
    """Yield the least bound of polynomials that are interpolated, where parameters move."""
    every = sorted(question.along_motions, key=lambda along: along.level)
    bound = first(question.stepped(question.along(along), along.level) for along in every)
    if bound is not None:
        yield bound


def dual_evidence(dual: Dual) -> Evidence:
    """Return the evidence that a dual polynomial is."""
    spread = None
    if dual.cover is not None:
        sides = (tuple(map(Fraction, x.tolist())) for x in (dual.cover.rows, dual.cover.columns))
        rows, columns = sides
        spread = Spread([], rows, columns, Fraction(dual.cover.kappa))
    storage = tuple(
        Stretch(
            Fraction(end),
            [_rationals((one + one.T) / 2) for S in stretch for one in S],
            dual.degree,
            stretch.shape[1] - 1,
            dual.inverse,
        )
        for end, stretch in dual.storage
    )
    Q = [_rationals(Q) for Q in dual.Q]
    return Evidence(Q, dual.degree, dual=not dual.reached, spread=spread, storage=storage)


def _on_grids(question: _Question) -> Iterator[Bound]:
    """Yield the least bound of a gain by a continuous Q on grids, where parameters move."""
    found = list[OnGrid]()
    for on_grid in question.on_grids:
        found.append(on_grid)
        if len(found) > 1 and on_grid.level > found[-2].level * (1 - FINER):
            break
    found.sort(key=lambda on_grid: on_grid.level)
    pairs = ((on_grid, on_grid.level * (1 + step)) for on_grid in found for step in STEPS)
    bound = first(question.on_grid(on_grid, level) for on_grid, level in pairs)
    if bound is not None:
        yield bound


def known_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known
) -> Bound | None:
    """Return what given evidence proves: the limit, else a level near its own; None if nothing."""
    posed = specification.posed(plant, law)
    if specification.at_most is not None:
        return _of(specification, _proved(*posed, known[0], specification.at_most))
    return _of(specification, _stepped(*posed, *known))


def _stepped(
    plant: UncertainPlant,
    law: Law,
    specification: Specification,
    evidence: Evidence,
    level: float,
) -> Bound | None:
    """Return the first step above a level at which evidence is a proof, None if it is at none."""
    square = _least_square(plant, law, specification, evidence)
    if square is not None:
        enough = (higher for s in STEPS if Fraction(higher := level * (1 + s)) ** 2 > square)
        least = next(enough, None)
        return None if least is None else _proved(plant, law, specification, evidence, least)
    steps = STEPS if plant.functions is None else (*STEPS, *FARTHER)
    farthest = _proved(plant, law, specification, evidence, level * (1 + steps[-1]))
    nearer = (_proved(plant, law, specification, evidence, level * (1 + s)) for s in steps[:-1])
    return None if farthest is None else first(nearer) or farthest


def _least_square(
    plant: UncertainPlant, law: Law, specification: Specification, evidence: Evidence
) -> Fraction | None:
    """Return what the square of a level must exceed, where evidence proves all else or nothing."""
    if not (evidence.dual or evidence.storage):
        return None
    on = law.domain_of(plant).on
    with suppress(FormatError), counted():
        claim = claim_of(plant, law.exact, on, specification, evidence, Fraction(1))
        return claim.least_square if isinstance(claim, SignalClaim) else None
    return None


def raised(bound: Bound, level: float) -> Bound | None:
    """Return the bound with a higher level, proved with the same evidence."""
    claim = replace(bound.claim, level=Fraction(level))
    try:
        verdict = prove(claim)
    except FormatError:  # its number may be longer
        return None
    if not verdict.proved:
        return None
    return replace(bound, level=level, claim=claim, reason=verdict.reason)


@explained
def kept_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None = None
) -> Bound | None:
    """Return the proof that a specification's own limit is kept, None where there is none.

    Parameters
    ----------
    known : pair of Evidence and float, optional
        What proves it as far as floats tell; tried first.
    """
    require_passing(plant, law, specification)
    if isinstance(specification, FactorMargin):
        return _of_given(plant, specification, factor_margins.kept(plant, law, specification))
    if isinstance(specification, Measured):
        return _of_given(plant, specification, responses.kept(plant, law, specification))
    if isinstance(specification, PeakToPeak):
        return _of_given(plant, specification, peak_to_peak.kept(plant, law, specification))
    with stage(f"limit on {specification.title}"):
        kept = _within_limit(plant, law, specification, known)
        if kept is None and specification.scales_apart(plant, law):
            limit, own = specification.at_most or 0.0, _within_limit
            found = InParts(delta_form(plant), law, specification, own).kept(limit)
            kept = None if found is None else _joined(plant, specification, found)
        return _of(specification, kept)


def _within_limit(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None = None
) -> Bound | None:
    delta = delta_form(plant)
    limit, ways = specification.at_most or 0.0, specification.ways(delta, law)
    near = (way for x, way in ways if not limit < (x or 0.0) < np.inf)
    return first(_kept_bound(*way.posed(delta, law), known) for way in near)


def _kept_bound(
    plant: UncertainPlant, law: Law, specification: Specification, known: Known | None
) -> Bound | None:
    limit = specification.at_most or 0.0
    if known is not None and (bound := known_bound(plant, law, specification, known)) is not None:
        return bound
    question = _Question.of(plant, law, specification)
    if question.worst > limit * (1 + AGREED):  # nor would a proof be taken
        return None
    bound = question.kept_by_transfer(limit)
    if bound is not None:
        return bound
    for dual in question.duals:
        if dual.level < limit:
            bound = question.proved(question.evidence(dual), limit)
            if bound is not None:
                return bound
    bound = question.in_parts(limit)
    if bound is not None:
        return bound
    for along in question.along_motions:
        if along.level < limit:
            bound = question.proved(question.along(along), limit)
            if bound is not None:
                return bound
    for found in question.on_grids:
        if found.level < limit:
            bound = question.on_grid(found, limit)
            if bound is not None:
                return bound
    for points in _climb(plant, law, specification, limit):
        for number, (evidences, r) in enumerate(points):
            if r < 1:
                for evidence in evidences:
                    bound = _proved(plant, law, specification, evidence, limit)
                    if bound is not None:
                        return bound
            elif not number:  # of those nearest to the edge
                break
    return None


def own_evidence(law: Law, W: Array, t: float) -> Evidence:
    """Return the evidence that a design leaves of a signal: its own W over t, (count, n, n)."""
    if law.W is None:
        return Evidence([_rationals(W[0] / t)])
    none = [[Fraction(0)] * W.shape[1] for _ in range(W.shape[1])]
    return Evidence([none], multiple=(Fraction(1 / t),))


def with_held(evidence: Evidence, held: Array, degree: int) -> Evidence:
    """Return evidence with H X, (count, m, n), where inputs are cut off."""
    return replace(evidence, held=tuple(map(_rationals, held)), held_degree=degree)


def _climb(
    plant: UncertainPlant, law: Law, specification: Specification, unit: float
) -> Iterator[Points]:
    """Yield points of each form in turn: evidence, and the r that it proves in floats."""
    if isinstance(specification, GainNorm):
        yield from (iter([point]) for point in _norms(plant, law, specification, unit))
        return
    if not specification.has_primal(plant) or plant.shape[0] > MOST_STATES:
        return
    wide = behind(plant, law, specification)
    plant, law, specification = wide.plant, wide.law, wide.specification
    source, output = specification.condition(plant, law.domain_of(plant), unit, law)
    loop, enough = loop_with(plant, law, output.C, output.D), 0.0
    if output.held:
        loop = with_inputs(plant, law, loop)
        # a loop that comes to rest with any limit has a least one of zero, and no end of a search
        enough = ENOUGH if unit == specification.at_most else 0.0
    for form in LADDER:
        first = form == LADDER[0]
        most = MOST_WORK * (SHORT if enough else 1)
        if not first and (len(plant.vertices) < 2 or work(loop, source, *form) > most):
            continue
        if plant.remainder is None or isinstance(source, performance.Through):
            yield _points(loop, source, output, form, enough)
        else:
            yield _with_room(plant, law, loop, source, output, form)
    for form, pieces in finer(plant, law):
        divided = replace(loop, pieces=pieces_of(plant, pieces))
        if work(loop, source, *form) * math.prod(divided.pieces) <= MOST_WORK:
            yield _points(divided, source, output, form, enough)


def _with_room(
    plant: UncertainPlant,
    law: Law,
    loop: Loop,
    source: performance.Noise | performance.Points,
    output: performance.Output,
    form: tuple[int, int],
) -> Points:
    """Yield points that leave room for what a remainder costs: as more noise, or less decay."""
    for times in (1.05, 1.5, 4.0):  # times what a remainder costs
        with suppress(SolverError, np.linalg.LinAlgError):
            polynomial = least_given(loop, source, output, *form)
            for _ in range(2):  # what it costs is found anew
                evidence = next(iter(_evidences(polynomial, form)))
                spread = spread_of(plant, law, evidence, cut=output.held)
                cost = np.diag(np.square(np.array(spread.rows, dtype=float)))
                cost += 2 * np.array(spread.omega, dtype=float)
                if isinstance(source, performance.Noise):
                    noisy = source.times(1 + 2 * float(SHARE)).more(loop.domain, times * cost)
                    polynomial = least_given(loop, noisy, output, *form)
                    continue
                T = np.linalg.inv(np.linalg.cholesky(polynomial.Q.mean(axis=0)))
                slower = times * float(np.linalg.norm(T @ cost @ T.T, 2)) / 2
                polynomial = least_given(loop, source, output, form[0], form[1], margin=slower)
            yield _evidences(polynomial, form), polynomial.r


def _norms(plant: UncertainPlant, law: Law, specification: GainNorm, unit: float) -> Points:
    with suppress(SolverError):
        for level, elevation in levels(plant, law, specification):
            if np.isfinite(level):
                yield [Evidence([], elevation=elevation)], (level / unit) ** 2
        least = by_multiples(plant, law, specification)
        if least is not None:
            level, multiples = least
            evidence = Evidence([], multiple=tuple(map(Fraction, multiples.tolist())))
            yield [evidence], (level / unit) ** 2


def _points(
    loop: Loop,
    source: Source,
    output: performance.Output,
    form: tuple[int, int],
    enough: float = 0.0,
) -> Points:
    """Yield points farther and farther from the edge of what a form proves, poor ones last."""
    nearest: LyapunovPolynomial | None = None
    poor = list[LyapunovPolynomial]()
    for tolerance in TOLERANCES:
        for near in dict.fromkeys((nearest, None)):
            points = list[LyapunovPolynomial]()
            with suppress(SolverError):
                points = points_given(loop, source, output, *form, tolerance, near, enough=enough)
            for point in points:
                nearest = nearest or point
                if point.r <= nearest.r * 1.05:
                    yield _evidences(point, form), point.r
                else:
                    poor.append(point)
    for point in sorted(poor, key=lambda point: point.r):
        yield _evidences(point, form), point.r


def _proved(
    plant: UncertainPlant,
    law: Law,
    specification: Specification,
    evidence: Evidence,
    level: float,
) -> Bound | None:
    on = law.domain_of(plant).on
    if plant.remainder is not None and specification.of_signal:
        try:
            if not (evidence.dual or evidence.per_cell[0].storage):
                evidence = _with_spread(plant, law, specification, evidence)
        except np.linalg.LinAlgError:  # no Lyapunov matrix
            return None
    claim = claim_of(plant, law.exact, on, specification, evidence, Fraction(level))
    with counted(claim.allowed) as count:
        try:
            verdict = prove(claim)
        except FormatError:  # more work than is checked: other evidence may take less
            return None
        finally:
            spend(0.6 * count.spent)  # measured: proofs do 1.6e9 to 2.0e9 a second
    if not verdict.proved:
        return None
    degree = evidence.highest
    if not specification.of_signal:
        degree = law.degree
    return Bound(specification, level, claim, degree, verdict.reason, plant.parameters)


def _with_spread(
    plant: UncertainPlant, law: Law, specification: Specification, evidence: Evidence
) -> Evidence:
    """Return evidence with what a remainder asks for besides, in each cell."""
    cut, wide = specification.cut_off(plant), behind(plant, law, specification)
    if not evidence.cells:
        return replace(evidence, spread=spread_of(wide.plant, wide.law, evidence, cut=cut))
    pieces = list[Piece]()
    for piece in evidence.cells:
        own = inside(wide.plant, piece.low, piece.high)
        held = wide.law.inside(wide.plant, piece.low, piece.high)
        spread = spread_of(own, held, piece.evidence, cut=cut)
        pieces.append(replace(piece, evidence=replace(piece.evidence, spread=spread)))
    return replace(evidence, cells=tuple(pieces))


def _evidences(point: LyapunovPolynomial, form: tuple[int, int]) -> Iterator[Evidence]:
    """Yield Q as floats have it, and as the exact product that it is of what was found."""
    multiple = () if point.multiple is None else tuple(map(Fraction, point.multiple.tolist()))
    rounded = Evidence([_rationals(Q) for Q in point.Q], form[0], form[1], multiple)
    rounded = replace(rounded, pieces=point.pieces)
    if point.held is not None:
        rounded = with_held(rounded, point.held, point.held_degree)
    yield rounded
    left = _rationals(point.left)
    products = [_congruent(left, _rationals((S + S.T) / 2)) for S in point.scaled]
    yield replace(rounded, X=products)


def _congruent(left: matrices.Rationals, middle: matrices.Rationals) -> matrices.Rationals:
    """Return left @ middle @ left', exactly."""
    half = [[_dot(row, column) for column in middle] for row in left]  # middle is symmetric
    return [[_dot(row, column) for column in left] for row in half]


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def _rationals(matrix: Array) -> matrices.Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]


@dataclass(frozen=True, eq=False)
class Sampled(Short):
    """One specification's signal at points of a family.

    Attributes
    ----------
    specification : Specification
    alpha : (count, N) array
    values : (count,) array
        In the signal's unit; of a gain, per unit of the disturbance.
    """

    specification: Specification
    alpha: Array
    values: Array

    @property
    def worst(self) -> float:
        """The largest value."""
        return float(self.values.max())


@explained
def sampled(
    plant: UncertainPlant, law: Any, specification: Specification, alpha: Array | None = None
) -> Sampled:
    """Return what a specification bounds, at points of a family.

    The rms by a Lyapunov equation at each point, and so the peak for bounded energy, which is the
    norm times the root of c P c', P the controllability Gramian; the peak from initial states by
    exact responses at close instants, from an ellipsoid of them by the largest root of
    c e^At X0 e^A't c' at those; the norm of a gain by its singular values; the gain by a sweep
    over frequency, which is fine at the worst points only.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    alpha : (count, N) array, optional
        By default `seeded`, 10,000 of them.

    Raises
    ------
    InputError
        If the loop is not stable at a point, or as `stationary` and `simulate` raise.
    """
    require_passing(plant, law, specification)
    alpha = seeded(plant) if alpha is None else np.atleast_2d(np.asarray(alpha, dtype=float))
    values = specification.values(plant, law, alpha)
    return Sampled(specification, alpha, np.asarray(values))


def require_passing(plant: UncertainPlant, law: Any, specification: Specification) -> None:
    """Refuse a bound that does not exist, where disturbances pass into what a law measures.

    Raises
    ------
    InputError
        Saying what to do.
    """
    law = law.as_law() if hasattr(law, "as_law") else law
    if not (isinstance(law, Law) and law.passes and specification.of_signal):
        return
    F = np.stack([y.arrays(plant)[2] for y in law.measured], axis=1)
    specification.require_samples(plant, F)
    at = law.domain_of(plant).nodes(law.passing_degree + 1)
    passing = law.passing(at)
    if specification.direct or passing is None:
        return
    moved = specification.passed(plant, passing)
    for output, weighting in zip(specification.outputs(plant), specification.filters, strict=True):
        D = np.tensordot(at, output.arrays(plant)[1], 1)[:, None]
        if weighting is None and np.any(D @ moved):
            raise InputError(
                f"{specification.title}: through the law a disturbance passes straight into "
                f"{output.name!r}, of which nothing is proved then; take a law that is strictly "
                "proper, or give the sensor a bandwidth"
            )


def is_loose(level: float, worst: float) -> bool:
    """Whether a proved level is so far above the worst sample that it may say little."""
    return level > 1.05 * worst


def worst_of(samples: Sampled, by_transfer: ByTransfer | None) -> tuple[float, int]:
    """Return the worst of samples, exact where floats are not, and its number."""
    if by_transfer is None:
        k = int(samples.values.argmax())
        return float(samples.values[k]), k
    return by_transfer.worst(samples.alpha, samples.values)


def each_sampled(
    plant: UncertainPlant, law: Any, specifications: Sequence[Specification], alpha: Array
) -> list[Sampled]:
    """Return what `sampled` does of each; rms values of one noise from one covariance.

    Raises
    ------
    InputError
        As `sampled` of one of them.
    """
    for signal in specifications:
        require_passing(plant, law, signal)
    values = dict[int, Array]()
    for alike in _of_one_noise(plant, specifications):
        rms = of_one_noise(plant, law, list(alike.values()), alpha)
        values |= dict(zip(alike, rms, strict=True))
    return [
        Sampled(signal, alpha, values[k] if k in values else signal.values(plant, law, alpha))
        for k, signal in enumerate(specifications)
    ]


def each_at_samples(
    plant: UncertainPlant, law: Any, specifications: Sequence[Specification], alpha: Array
) -> list[Array | None]:
    """Return what `at_samples` of each does; rms values of one noise from one covariance.

    Raises
    ------
    InputError
        As `sampled` of one of them.
    """
    values = dict[int, Array]()
    for alike in _of_one_noise(plant, specifications):
        held = {k: rms for k, rms in alike.items() if rms.held(plant) is not None}
        if held:
            rms = of_one_noise_at_samples(plant, law, list(held.values()), alpha)
            values |= dict(zip(held, rms, strict=True))
    return [
        values.get(k) if type(signal) is Rms else signal.at_samples(plant, law, alpha)
        for k, signal in enumerate(specifications)
    ]


def _of_one_noise(
    plant: UncertainPlant, specifications: Sequence[Specification]
) -> list[dict[int, Rms]]:
    """Return the rms values under each noise, by their numbers."""
    noises = dict[Any, dict[int, Rms]]()
    for k, signal in enumerate(specifications):
        if type(signal) is Rms:
            noises.setdefault((signal.density, str(signal.squares(plant))), {})[k] = signal
    return list(noises.values())


def agreed_bound(plant: UncertainPlant, law: Any, bound: Bound) -> Bound | None:
    """Return a proved bound that is no less than what doubles show of the law; None if they differ.

    The law is proved as a real matrix. One that cancels numbers far larger than what it leaves, or
    whose poles are too fast for doubles, does not keep the bound once doubles evaluate it. Where
    what is left is rounding, of the signal's own parts, the bound is raised above it.
    """
    asked, alpha = bound.specification, seeded(plant, len(plant.vertices) + FEW)
    try:
        worst = sampled(plant, law, asked, alpha).worst
        if worst <= bound.level * (1 + AGREED):
            return bound
        near = worst <= bound.level * 1.01 or worst <= 1e-9 * _parts(plant, law, asked, alpha)
    except (InputError, np.linalg.LinAlgError):
        return None
    return raised(bound, worst * (1 + AGREED)) if near and asked.at_most is None else None


def _parts(plant: UncertainPlant, law: Any, specification: Specification, alpha: Array) -> float:
    """Return the largest worst value of the signal's terms, each alone."""
    worst = [0.0]
    for signal, key in product(specification.outputs(plant), "CD"):
        rows = getattr(signal, key)
        for k in range(len(rows[0]) if rows else 0):
            alone = [[x if j == k else 0 for j, x in enumerate(row)] for row in rows]
            if any(map(any, alone)):
                row: dict[str, Any] = {"C": (), "D": (), key: alone}
                one = replace(signal, F=(), near=None, **row)
                worst.append(sampled(plant, law, specification.of(one), alpha).worst)
    return max(worst)


def save(certificate: Certificate, claims: Sequence[BoundClaim], directory: str | Path) -> Path:
    """Write ``design.json``, with the bounds, into a folder, made if need be; return its path.

    The numbers are those that were proved: a double as it is, any other rational as "p/q".

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    try:
        text = bounds_file(certificate, claims).dumps()
    except FormatError as error:
        raise InputError(str(error)) from error
    return write_documents(Path(directory), {FILE_NAME: text})[0]


@explained
def bounds_file(certificate: Certificate, claims: Sequence[BoundClaim]) -> Document:
    """Return the file of a design's region, and of bounds on its signals."""
    return certificate.file([certificate.claim(), *claims])
