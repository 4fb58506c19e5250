"""The search for a law: for shares of a region, within limits that are asked for and implied.

One W(alpha) for everything is conservative, so that neither the whole region nor the widest limits
give the best law. Each law that is found is judged as it is: by samples first, then by proofs of
region and limits. Limits on the inputs at what the best law needs, and somewhat more, exclude no
law that is better for it; they keep the next ones from being bought with effort.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from polefence.analysis import analyse
from polefence.conditions.methods import options
from polefence.design_task import Task
from polefence.errors import InputError, SolverError
from polefence.gain_norm import GainNorm, is_signal
from polefence.law import FixedGain, Law
from polefence.performance import Bound, Known, best_bound, kept_bound, own_evidence
from polefence.proof.certificate import Certificate
from polefence.region import HalfPlane, Region, Sector
from polefence.response.signals import inputs
from polefence.retreat import level_of
from polefence.sampled_bounds import agreed_bound, sampled, seeded
from polefence.solve.deadline import Deadline
from polefence.solve.performance import Reached
from polefence.solve.singular import singular_is_failure
from polefence.specification import RelativeRms, Rms, Specification, output_of

HALVINGS = 5  # of the share of the region that the design keeps
SAMPLES = 200  # at which a law is judged before anything is proved of it
SLIGHT = 1e-6  # a law that is better by less is not looked at further
WORTH = 1e-3  # the same of a round of implied limits
# Implied limits over what the best law needs, and how often each is taken from the law it led to.
ROOM, AGAIN = (2.0, 1.0), 3


@dataclass(frozen=True, eq=False)
class Origin:
    """Where a law comes from: what was asked of the design, and the point that was found."""

    task: Task
    found: Reached

    def known(self, law: Law, own: Specification) -> Known | None:
        """Return what the design itself says of a signal; None where that is nothing."""
        if not is_signal(own):
            return None
        source = output_of(self.task.plant, self.task.domain, own, 1.0)[0]
        t = self.found.t.get(f"t {source.name}", 0.0)
        if not t > 0 or (own.at_most is None and self.task.minimise is not own):
            return None
        values = self.found.values
        W = np.stack([values[f"W{k + 1}"] for k in range(len(values) // 2)])
        return own_evidence(law, W, t), own.at_most or level_of(self.task, self.found)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law with proofs of the region and of all limits.

    Attributes
    ----------
    certificate : Certificate
    limits : tuple of Bound
    share : float
        Of the region, what the design kept.
    estimate : float
        The worst sampled value of what is minimised; zero where nothing is.
    origin : Origin, optional
        Of a law that was found, not given.
    """

    certificate: Certificate
    limits: tuple[Bound, ...]
    share: float
    estimate: float
    origin: Origin | None = None

    def known(self, own: Specification) -> Known | None:
        """Return what the law's own design says of a signal, if anything."""
        return None if self.origin is None else self.origin.known(self.certificate.law, own)


class Search:
    """What was found so far.

    Attributes
    ----------
    candidates : list of Candidate
    reasons : list of str
        Why designs failed.
    whole : Reached or None
        The point for the whole region within the limits as they were asked.
    """

    def __init__(self, task: Task, deadline: Deadline, proved: bool = False) -> None:
        self.task, self.deadline = task, deadline
        self.proved = proved  # whether the bound on what is minimised must have a proof at once
        self.candidates, self.reasons = list[Candidate](), list[str]()
        self.whole: Reached | None = None
        self.floor = np.inf  # the least that one W(alpha) proves for any share
        self.alpha = seeded(task.plant, SAMPLES)

    def run(self) -> None:
        """Search until nothing more is gained."""
        self._shares(self.task)
        if int(options(self.task.method).degree):
            self._shares(replace(self.task, method="quadratic"))
        if not self.candidates:
            self._one_by_one()
        if self.task.minimise is not None:
            self._implied()

    @property
    def best(self) -> float:
        """The least estimate."""
        return min((own.estimate for own in self.candidates), default=np.inf)

    def _shares(self, task: Task) -> None:
        """Try the region as it is, none of it, and shares between that turn out to be kept."""
        if self._attempt(task, 1.0) == "kept" and self.task.minimise is None:
            return
        loose = relaxed(task.region, 0.0)
        if loose == task.region or self._attempt(task, 0.0) == "kept":
            return
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            if self.deadline.passed:
                return
            share = (low + high) / 2
            answer = self._attempt(task, share)
            if answer == "kept" and self.task.minimise is None:
                return
            # a law that does not keep the region: ask for more of it
            low, high = (share, high) if answer == "lost" else (low, share)

    def _attempt(self, task: Task, share: float) -> str:
        """Design for a share of the region; return "none", "worse", "lost" or "kept"."""
        try:
            found = task.reached(relaxed(task.region, share))
            law = task.law(found)
        except (SolverError, InputError) as error:  # or its numbers are none that doubles hold
            self.reasons.append(str(error))
            return "none"
        if task is self.task:
            self.whole = found if share == 1 else self.whole
            self.floor = min(self.floor, level_of(task, found))
        estimate = self._estimate(law)
        if not estimate < self.best * (1 - SLIGHT):
            return "worse" if self.candidates else "lost"
        own = candidate(self.task, law, share, Origin(task, found), estimate)
        if own is None or not self._has_bound(own):
            return "lost"
        self.candidates.append(own)
        return "kept"

    def _has_bound(self, own: Candidate) -> bool:
        least = self.task.minimise
        if least is None or not self.proved:
            return True
        law = own.certificate.law
        with suppress(SolverError), singular_is_failure():
            return best_bound(self.task.plant, law, least, own.known(least)) is not None
        return False

    @property
    def shared(self) -> float:
        """What one W(alpha) proves for the whole region, infinite where that is nothing."""
        if self.task.minimise is None:
            return 0.0
        return np.inf if self.whole is None else level_of(self.task, self.whole)

    def _estimate(self, law: Law) -> float:
        own = self.task.minimise
        return 0.0 if own is None else self._worst(law, own)

    def _worst(self, law: Law, own: Specification) -> float:
        try:
            worst = sampled(self.task.plant, law, own, self.alpha).worst
        except (InputError, np.linalg.LinAlgError):
            return np.inf
        return worst if np.isfinite(worst) else np.inf

    def _one_by_one(self) -> None:
        """Minimise each of the limits within the others: that may lead where all at once do not."""
        for own in self.task.limits:
            others = tuple(s for s in self.task.limits if s is not own)
            least = replace(self.task, minimise=replace(own, at_most=None), limits=others)
            for share in (1.0, 0.0):
                if self.deadline.passed or self._attempt(least, share) == "kept":
                    return

    def _implied(self) -> None:
        """Design again within limits on the inputs, about what the best law needs."""
        for room in ROOM:
            for _ in range(AGAIN):
                before = self.best
                # where the region costs nothing there is nothing to be gained
                if self.deadline.passed or not self.floor * (1 + WORTH) < before < np.inf:
                    return
                more = self._inputs(room)
                if not more:
                    return
                self._shares(replace(self.task, limits=(*self.task.limits, *more)))
                if not self.best < before * (1 - WORTH):
                    break

    def _inputs(self, room: float) -> tuple[Specification, ...]:
        """Return limits on the inputs, of the kind of what is minimised, about the best law's."""
        own, law = self.task.minimise, None
        for candidate in self.candidates:
            if candidate.estimate <= self.best:
                law = candidate.certificate.law
        if own is None or law is None or isinstance(own, GainNorm):
            return ()
        if isinstance(own, RelativeRms):  # without control an input has none
            own = Rms(own.signal, None, own.density)
        found = []
        for signal in inputs(self.task.plant):
            like = replace(own, signal=replace(signal, name=f"{signal.name}, implied"))
            worst = self._worst(law, like)
            if 0 < worst < np.inf:
                found.append(replace(like, at_most=room * worst))
        return tuple(found)


@singular_is_failure()
def _proofs(
    task: Task, law: Law, share: float, origin: Origin | None, estimate: float
) -> Candidate | None:
    """Return what `candidate` does."""
    certificate = _region(task, law, share, origin)
    if certificate is None:
        return None
    own = Candidate(certificate, (), share, estimate, origin)
    limits: list[Bound] = []
    for limit in task.limits:
        # of the certificate's law: its alpha may live on another domain than that of the search
        bound = kept_bound(task.plant, certificate.law, limit, own.known(limit))
        # of a law that doubles cannot evaluate a proof is of no use
        if bound is None or agreed_bound(task.plant, certificate.law, bound) is None:
            return None
        limits.append(bound)
    return replace(own, limits=tuple(limits))


def candidate(
    task: Task, law: Law, share: float, origin: Origin | None = None, estimate: float = 0.0
) -> Candidate | None:
    """Return proofs of the region and of the limits of a task; None where there is not each."""
    try:
        return _proofs(task, law, share, origin, estimate)
    except SolverError:
        return None


def relaxed(region: Region, share: float) -> Region | None:
    """Return a region with less decay and damping; None for none of it."""
    if share >= 1:
        return region
    kept: Region | None = None
    for part in region.parts:
        own: Region = part
        if isinstance(part, HalfPlane):
            own = HalfPlane(part.decay * share if part.decay > 0 else part.decay)
        elif isinstance(part, Sector):
            if not share:
                continue
            own = Sector(part.damping * share)
        kept = own if kept is None else kept & own
    return kept


def _region(task: Task, law: Law, share: float, origin: Origin | None) -> Certificate | None:
    """Prove the region with the law's own W where it was asked of it, else as of a given law."""
    if share == 1 and origin is not None:
        elevation = options(origin.task.method).elevation
        name, evidence = "scheduled", {"tau": np.array(0.0), "elevation": elevation}
        if isinstance(law, FixedGain):
            name, evidence = "quadratic", {"W": origin.found.values["W1"]}
        own = Certificate(task.plant, task.region, name, law, evidence)
        if own.prove().proved:
            return own
    answer = analyse(task.plant, law, task.region)
    return answer.certificate if answer.proved else None
