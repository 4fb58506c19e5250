"""Task of a search: limits, a signal to minimise, a region; and the law found."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.design.requirements.gain_norm import as_norms
from polefence.design.requirements.specification import Specification
from polefence.law.laws import FixedGain, Law, ScheduledGain, right_divide
from polefence.lmi.conditions.methods import Method, options
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.interior_point import TOLERANCE
from polefence.lmi.solve.performance import Problem, least
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.search import Reached, coefficients, singular_is_failure
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.lmi.solve.starts import regulators
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import HalfPlane, Region, bounded
from polefence.response.closed import close

INSIDE = 0.95  # how far inside the region the search begins
KEPT = 1 - 1e-5  # share of a limit that a design keeps, so that the proof has something to spare
AGREED = 1e-5  # how close two ends of one question are, as a share
ENDS = 2  # that are compared where they depend on the start
ROUGH = 1e-4  # gap at which one gain is a start: a point that is not at the edge of everything
ROUNDED = 1e-9  # of the fastest pole: what rounding may move a pole by
SPEED = 100.0  # times the plant's own rates, where nothing else bounds the first law's


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked for, with one Lyapunov matrix for everything."""

    plant: UncertainPlant
    minimise: Specification | None
    limits: tuple[Specification, ...]
    region: Region
    method: Method
    # the plant without filters, and the limits as they were asked for
    asked: tuple[UncertainPlant, tuple[Specification, ...]] | None = None

    @property
    def domain(self) -> Domain:
        """Where alpha lives."""
        return Domain.of(options(self.method).on, len(self.plant.vertices))

    def as_noise(self, bandwidth: float) -> Task:
        """Return the task for rms values in place of gains: what one is small of, the other is too.

        A signal of gain g has, of white noise, an rms of about g times the root of the bandwidth it
        follows the noise in [rad/s].
        """
        limits = tuple(own.as_noise(bandwidth) for own in self.limits)
        least = self.minimise and self.minimise.as_noise(bandwidth)
        return replace(self, minimise=least, limits=limits)

    def question(self, region: Region | None) -> Problem:
        """Return the condition with one Lyapunov matrix for everything."""
        o, plant = options(self.method), self.plant
        pairs = [s.condition(plant, self.domain) for s in self.limits if s.of_signal]
        if self.minimise is not None and self.minimise.of_signal:
            pairs.append(self.minimise.condition(plant, self.domain, 1.0))
        pairs = [(s, replace(o, level=o.level * KEPT if o.fixed else o.level)) for s, o in pairs]
        sources = {source.name: source for source, _ in pairs}
        outputs = tuple(output for _, output in pairs)
        degree, elevation = int(o.degree), o.elevation
        values = tuple(sources.values())
        norms = as_norms(plant, self.limits, self.minimise)
        form = self.domain, degree, elevation, norms
        return Problem(plant.A, plant.B, values, outputs, region, *form)

    @singular_is_failure()
    def reached(
        self,
        region: Region | None,
        tolerance: float = TOLERANCE,
        near: Reached | None = None,
    ) -> Reached:
        """Search for the law.

        Without bounds on the law itself the question is convex: an end that two searches come to
        will do. With them the end depends on the start: the best of a few is returned.

        Parameters
        ----------
        region : Region, optional
        tolerance : float
            Of the gap at which the search ends, relative to what is minimised.
        near : Reached, optional
            A point of this method and a narrower region, to start from.

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
        starts = self._starts(question, region, scaling)
        if near is not None:
            starts = chain([(near.values, near.t)], starts)
        for start, t in starts:
            try:
                found = least(question, start, scaling, tolerance, t)
            except SolverError as error:
                failure = error
                continue
            again = best is not None and best.converged and found.r >= best.r * (1 - AGREED)
            holds = self._holds(found, region)
            if best is None or (holds, -found.r) > (held, -best.r):
                best, held = found, holds
            if not holds:  # its r is of a W that doubles do not hold
                continue
            ends += 1
            ended = found.converged and not question.norms and (again or tolerance > AGREED)
            if self.minimise is None or ended or (question.norms and ends == ENDS):
                break
        if best is None:
            raise failure
        return best

    def _holds(self, found: Reached, region: Region | None) -> bool:
        """Whether the law of a point, as doubles have it, keeps the poles where its W puts them.

        Where the signals do not bound W it grows until its smallest directions are lost in
        rounding; the law that Z W^-1 then is in doubles is another.
        """
        try:
            law = self.law(found)
            loops = close(self.plant, law, np.eye(len(self.plant.vertices)), disturbed=False)
            poles = loops.poles()
        except (SolverError, InputError, np.linalg.LinAlgError):
            return False
        kept = region or HalfPlane(0)
        return bool(np.all(kept.distance(poles) < ROUNDED * np.abs(poles).max()))

    def _starts(
        self, question: Problem, region: Region | None, scaling: Scaling
    ) -> Iterator[tuple[dict[str, Array], dict[str, float]]]:
        """Yield W and Z to start from, and what of W is a Lyapunov matrix, where that is known."""
        if int(options(self.method).degree):
            # what one gain reaches a scheduled law reaches too
            with suppress(SolverError):
                one = replace(self, method="quadratic").reached(region, ROUGH)
                yield self._as_scheduled(one.values), one.t
        else:
            for values in regulators(question, scaling):
                yield values, {}
        kept = region or HalfPlane(0)
        for inside in dict.fromkeys((kept, bounded(kept, SPEED * typical_rate(self.plant.A)))):
            with suppress(SolverError):
                yield self._start(inside), {}

    def _as_scheduled(self, values: dict[str, Array]) -> dict[str, Array]:
        """Return one W and Z as those of a degree: all coefficients are equal."""
        count = self.domain.count(int(options(self.method).degree))
        return numbered("W", [values["W1"]] * count) | numbered("Z", [values["Z1"]] * count)

    def _start(self, inside: Region) -> dict[str, Array]:
        """Return W and Z of a law that keeps a region."""
        start = smallest(self.plant.A, self.plant.B, Around(inside), self.method, enough=INSIDE)
        if start.r >= 1:
            raise SolverError(f"no law of this method keeps {inside}")
        W, Z = coefficients(start.values, "W"), coefficients(start.values, "Z")
        return numbered("W", W) | numbered("Z", Z)

    @singular_is_failure()
    def law(self, found: Reached) -> Law:
        """Return the law of a point.

        Raises
        ------
        SolverError
            If W is singular in floats, or the law's numbers are none that doubles hold.
        """
        degree = int(options(self.method).degree)
        W, Z = coefficients(found.values, "W"), coefficients(found.values, "Z")
        try:
            if not degree:
                return FixedGain(right_divide(Z, W)[0])
            return ScheduledGain(W, Z, self.plant.parameters, degree, self.domain.sizes)
        except InputError as error:
            raise SolverError(str(error)) from error


def numbered(name: str, coefficients: Iterable[Array]) -> dict[str, Array]:
    """Return matrices under the names that a condition's variables have: W1, W2 and so on."""
    return {f"{name}{k}": matrix for k, matrix in enumerate(coefficients, 1)}
