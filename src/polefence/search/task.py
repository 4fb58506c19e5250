"""The task of a search for a law, the law that one Lyapunov matrix for everything leads to, proofs.

One W(alpha) for region and signals is conservative: what a law keeps is proved of it as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.certify.anti_windup import with_anti_windup
from polefence.certify.bounds import (
    Bound,
    agreed_bound,
    best_bound,
    kept_bound,
    known_bound,
    own_evidence,
    with_held,
)
from polefence.certify.candidates import Deadline
from polefence.certify.certificate import Certificate
from polefence.certify.design import Design
from polefence.certify.given import analysed
from polefence.law.laws import FixedGain, Law, ScheduledGain, right_divide
from polefence.lmi.conditions.methods import Method, options
from polefence.lmi.conditions.saturation import held_name
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.interior_point import TOLERANCE
from polefence.lmi.solve.performance import Problem, least
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.search import Reached, coefficients, singular_is_failure
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.lmi.solve.starts import regulators
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import Region, bounded, stable
from polefence.requirements.gain_norm import as_norms
from polefence.requirements.specification import Specification
from polefence.response.closed import close

KEPT = 1 - 1e-5  # share of a limit that a design keeps, so that the proof has something to spare
AGREED = 1e-5  # how close two ends of one question are, as a share
# Of an entry of a gain that float32 computes, what rounding may change: 64 times that of one
# operation; a law's code takes 30 to 40. At so many points beside the vertices, so often.
ROUNDING, POINTS, CHANGES = 64 * 2.0**-24, 20, 20


@dataclass(frozen=True, eq=False)
class Task:
    """Requirements and a region, with one Lyapunov matrix for everything."""

    plant: UncertainPlant
    minimise: Specification | None
    limits: tuple[Specification, ...]
    region: Region
    method: Method
    # the plant and the limits as they were asked for, before a law had states
    asked: tuple[UncertainPlant, tuple[Specification, ...]] | None = None
    # the parts of the region in words, as they were asked for
    words: tuple[str, ...] = ()
    # whether what runs a law keeps its region; all do where it is not asked
    bears: Callable[[Design], bool] | None = None

    def takes(self, certificate: Certificate) -> bool:
        """Whether a law with a proof of its region is one that may be returned."""
        return self.bears is None or self.bears(Design(certificate))

    @property
    def parts(self) -> dict[Region, str]:
        """The parts of the region, and each in words."""
        parts = self.region.parts
        return dict(zip(parts, self.words or map(str, parts), strict=True))

    @property
    def domain(self) -> Domain:
        """The domain of alpha."""
        return Domain.of(options(self.method).on, len(self.plant.vertices))

    def question(self, region: Region | None) -> Problem:
        """Return the condition with one Lyapunov matrix for everything, signals without weights.

        With the filters' states the law that it gives would be one of these too.
        """
        # the LMI is about the combinations of the vertices; what is proved is about the plant
        o, plant = options(self.method), self.plant.combinations
        asked: list[tuple[Specification, float | None]]
        asked = [(s, None) for s in self.limits if s.of_signal]
        if self.minimise is not None and self.minimise.of_signal:
            asked.append((self.minimise, 1.0))
        conditions = ((s, s.unweighted().condition(plant, self.domain, unit)) for s, unit in asked)
        pairs = [(source, replace(output, name=s.title)) for s, (source, output) in conditions]
        pairs = [(s, replace(o, level=o.level * KEPT if o.fixed else o.level)) for s, o in pairs]
        sources = {source.name: source for source, _ in pairs}
        outputs = tuple(output for _, output in pairs)
        degree, elevation = int(o.degree), o.elevation
        values = tuple(sources.values())
        norms = as_norms(plant, self.limits, self.minimise)
        form = self.domain, degree, elevation, norms, float(plant.step), Motion.of(plant)
        return Problem(plant.A, plant.B, values, outputs, region, *form)

    @singular_is_failure()
    def reached(
        self,
        region: Region | None,
        tolerance: float = TOLERANCE,
    ) -> Reached:
        """Search for the law.

        Without bounds on the law itself the question is convex: an end whose duals say so, or that
        two searches come to, will do. With them it depends on the start: the best of a few is
        returned.

        Parameters
        ----------
        region : Region, optional
        tolerance : float
            Of the gap at which the search ends, relative to what is minimised.

        Raises
        ------
        SolverError
            If there is none, or nowhere to start.
        """
        scaling = balanced(self.plant.A, self.plant.B, typical_rate(self.plant.A))
        question = self.question(region)
        best: Reached | None = None
        held, ends = False, 0
        failure = SolverError("nowhere to start from")
        for start, t in self._starts(question, region, scaling):
            try:
                point = least(question, start, scaling, tolerance, t)
            except SolverError as error:
                failure = error
                continue
            again = best is not None and best.converged and point.r >= best.r * (1 - AGREED)
            holds = self._holds(point, region)
            if best is None or (holds, -point.r) > (held, -best.r):
                best, held = point, holds
            if not holds:  # its r is of a W that doubles do not hold
                continue
            ends += 1
            ended = point.converged and not question.norms
            loose = tolerance > AGREED
            ended = ended and (again or loose or point.residual() <= AGREED)
            if self.minimise is None or ended or (question.norms and ends == 2):
                break
        if best is None:
            raise failure
        return best

    def _holds(self, point: Reached, region: Region | None) -> bool:
        """Whether the law of a point, as doubles have it, keeps the poles where its W puts them.

        Where the signals do not bound W it grows until its smallest directions are lost in
        rounding; the law that Z W^-1 then is in doubles is another.
        """
        try:
            law = self.law(point)
            loops = close(self.plant, law, np.eye(len(self.plant.vertices)), disturbed=False)
            poles = loops.poles()
        except (SolverError, InputError, np.linalg.LinAlgError):
            return False
        kept = region or stable(float(self.plant.step))
        return bool(np.all(kept.distance(poles) < 1e-9 * np.abs(poles).max()))

    def _starts(
        self, question: Problem, region: Region | None, scaling: Scaling
    ) -> Iterator[tuple[dict[str, Array], dict[str, float]]]:
        """Yield W and Z to start from, and what of W is a Lyapunov matrix, where that is known."""
        if int(options(self.method).degree):
            # what one gain reaches a scheduled law reaches too
            with suppress(SolverError):
                # well off the edge of everything
                one = replace(self, method="quadratic").reached(region, 0.1)
                yield self._as_scheduled(one.values), one.t
        else:
            for values in regulators(question, scaling):
                yield values, {}
        kept = region or stable(float(self.plant.step))
        for inside in dict.fromkeys((kept, bounded(kept, 100.0 * typical_rate(self.plant.A)))):
            with suppress(SolverError):
                yield self._start(inside), {}

    def _as_scheduled(self, values: dict[str, Array]) -> dict[str, Array]:
        """Return one W and Z as those of a degree: all coefficients are equal."""
        count = self.domain.count(int(options(self.method).degree))
        return numbered("W", [values["W1"]] * count) | numbered("Z", [values["Z1"]] * count)

    def _start(self, inside: Region) -> dict[str, Array]:
        """Return W and Z of a law that keeps a region."""
        plant, goal, motion = self.plant, Around(inside), Motion.of(self.plant)
        start = smallest(plant.A, plant.B, goal, self.method, enough=0.95, motion=motion)
        if start.r >= 1:
            raise SolverError(f"no law of this method keeps {inside}")
        W, Z = coefficients(start.values, "W"), coefficients(start.values, "Z")
        return numbered("W", W) | numbered("Z", Z)

    @singular_is_failure()
    def law(self, point: Reached) -> Law:
        """Return the law of a point.

        Raises
        ------
        SolverError
            If W is singular in floats, or the law's numbers are none that doubles hold.
        """
        degree = int(options(self.method).degree)
        W, Z = coefficients(point.values, "W"), coefficients(point.values, "Z")
        try:
            if not degree:
                return FixedGain(right_divide(Z, W)[0])
            return ScheduledGain(W, Z, self.plant.parameters, degree, self.domain.sizes)
        except InputError as error:
            raise SolverError(str(error)) from error


def numbered(name: str, coefficients: Iterable[Array]) -> dict[str, Array]:
    """Return matrices under the names that a condition's variables have: W1, W2 and so on."""
    return {f"{name}{k}": matrix for k, matrix in enumerate(coefficients, 1)}


def level_of(task: Task, point: Reached) -> float:
    """Return the bound on what is minimised that a point has in floats; zero where nothing is."""
    if task.minimise is None:
        return 0.0
    return task.minimise.level(point.r)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law with proofs of the region and of all limits."""

    certificate: Certificate
    limits: tuple[Bound, ...]


class Missing(Enum):
    """What a law has no proof of."""

    REGION = "region"
    LIMIT = "limit"


def withstands_rounding(task: Task, law: Law) -> bool:
    """Whether poles stay in the region where code in float32 computes the gain.

    An optimum likes poles to meet, and where three do, a change of the gain of 2e-6 moves them by a
    hundredth. Two ways to one optimum of a levelled quarter car (three BLAS kernels) gave one law
    that bears 1e-4 of its gain, and two that bear 1e-8.
    """
    alpha = seeded(task.plant, len(task.plant.vertices) + POINTS)
    A, B = task.plant.at(alpha)
    K, source = law.gain(alpha), np.random.default_rng(0)
    most = ROUNDING * np.abs(K).max(axis=0)
    return all(
        float(task.region.distance(np.linalg.eigvals(A + B @ (K + most * signs))).max()) <= 0
        for signs in source.choice([-1.0, 1.0], (CHANGES, *most.shape))
    )


def candidate(task: Task, law: Law) -> Candidate | Missing:
    """Return proofs of the region and of the limits of a task, or what has none."""
    missing = Missing.REGION
    with suppress(SolverError), singular_is_failure():
        asked = (*task.limits, *([task.minimise] if task.minimise else ()))
        recovering = with_anti_windup(task.plant, law, asked)
        certificate = analysed(task.plant, recovering, task.region, Deadline(None)).certificate
        if certificate is None or not task.takes(certificate):
            return missing
        missing = Missing.LIMIT
        # of the certificate's law: its alpha may live on another domain than the search's
        choices = [certificate.law]
        if recovering is not law:  # the loop is the same while nothing saturates
            choices.append(law)
            choices.sort(key=lambda choice: _least_limit(task, choice))
        for choice in choices:
            limits = _kept(task, choice)
            if limits is not None:
                same = choice is certificate.law
                return Candidate(certificate if same else replace(certificate, law=choice), limits)
    return missing


def _least_limit(task: Task, law: Law) -> float:
    """Return the limit of saturated inputs that is proved, where that is minimised; else zero."""
    if task.minimise is None or not task.minimise.cut_off(task.plant):
        return 0.0
    bound = best_bound(task.plant, law, task.minimise)
    return np.inf if bound is None else bound.level


def _kept(task: Task, law: Law) -> tuple[Bound, ...] | None:
    """Return proofs of the limits of a task, None where one has none."""
    limits: list[Bound] = []
    for limit in task.limits:
        bound = kept_bound(task.plant, law, limit)
        # of a law that doubles cannot evaluate a proof is of no use
        if bound is None or agreed_bound(task.plant, law, bound) is None:
            return None
        limits.append(bound)
    return tuple(limits)


def together(task: Task, law: Law, point: Reached) -> tuple[Certificate, tuple[Bound, ...]] | None:
    """Prove region, what is minimised and all limits with the one W of the law's point.

    Returns
    -------
    pair of Certificate and bounds, optional
        What is minimised comes first; None where the one W does not prove each of them.
    """
    asked = () if task.minimise is None else (task.minimise,)
    bounds: list[Bound] = []
    if task.plant.remainder is not None:  # of which the LMI knows nothing
        return None
    with suppress(SolverError), singular_is_failure():
        name = "quadratic"
        evidence: dict[str, Any] = {"W": point.values["W1"]}
        if law.W is not None:
            elevation = options(task.method).elevation
            name, evidence = "scheduled", {"tau": np.array(0.0), "elevation": elevation}
        certificate = Certificate(task.plant, task.region, name, law, evidence)
        if not certificate.holds() or not task.takes(certificate):
            return None
        for specification in (*asked, *task.limits):
            bound = _bound(task, law, specification, point)
            agreed = None if bound is None else agreed_bound(task.plant, law, bound)
            if agreed is None:
                return None
            bounds.append(agreed)
        return certificate, tuple(bounds)
    return None


def _bound(task: Task, law: Law, asked: Specification, point: Reached) -> Bound | None:
    """Prove one specification with the point's W; a bound on the law itself needs none."""
    if not asked.of_signal:
        prove = best_bound if asked.at_most is None else kept_bound
        return prove(task.plant, law, asked)
    t = point.t.get(f"t {asked.condition(task.plant, task.domain, 1.0)[0].name}", 0.0)
    if any(asked.filters) or not t > 0:
        return None
    evidence, prefix = own_evidence(law, coefficients(point.values, "W"), t), held_name(asked.title)
    if any(name.startswith(prefix) for name in point.values):
        held = coefficients(point.values, prefix)
        evidence = with_held(evidence, held / t, int(options(task.method).degree))
    return known_bound(task.plant, law, asked, (evidence, asked.at_most or level_of(task, point)))
