"""Laws by an LMI, for the region as it is and for shares of its parts.

One W(alpha) for region and signals is conservative, so that the whole region does not give the best
law. A law for less of it may keep all of it: samples say so first, then proofs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.certify.bounds import sampled
from polefence.certify.candidates import Deadline
from polefence.law.laws import Law
from polefence.lmi.conditions.methods import options
from polefence.lmi.solve.search import Reached
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.region.regions import HalfPlane, Region, Sector
from polefence.requirements.specification import Specification
from polefence.response.closed import close
from polefence.search.retreat import is_too_fast
from polefence.search.task import ROUNDED, Candidate, Origin, Task, candidate, level_of

# Designs for shares between none of the region and all of it; the step of such a share.
ROUNDS, FINEST = 5, 1 / 64
SAMPLES = 200  # at which a law is judged before anything is proved of it
# Of designs: after so much no further one is begun [multiplications, as iterations times cubes of
# the number of unknowns].
MOST_WORK = 2.5e11

Shares = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Point:
    """A law with what samples say of it.

    Attributes
    ----------
    origin : Origin
    law : Law
    region : Region, optional
        That was asked of the design; None where stability alone was.
    estimate : float
        The worst sample of what is minimised; zero where nothing is.
    lost : tuple of int
        Parts of the whole region that a sampled pole is outside of.
    """

    origin: Origin
    law: Law
    region: Region | None
    estimate: float
    lost: tuple[int, ...]

    def proved(self, task: Task, halved: bool) -> Candidate | None:
        """Return the law with proofs of region and limits, as `candidate` does."""
        return candidate(task, self.law, self.region, self.origin, self.estimate, halved)


class Designs:
    """Laws for shares of a region.

    Attributes
    ----------
    points : list of Point
        Laws of which samples keep the whole region, the least estimate first.
    reasons : list of str
        Why designs failed.
    whole : Reached or None
        The point for the whole region.
    """

    def __init__(self, task: Task, deadline: Deadline, refute: Callable[[], None]) -> None:
        """Design.

        Parameters
        ----------
        refute : callable
            Raises, after a design that fails, where no law can be found.
        """
        self.task, self.deadline, self.refute = task, deadline, refute
        self.reasons = list[str]()
        self.whole: Reached | None = None
        self.alpha, self.spent = seeded(task.plant, SAMPLES), 0.0
        points = self._all(task)
        # with limits on the law itself the question is not convex: a law may keep them unasked
        signals = tuple(own for own in task.limits if own.of_signal)
        if len(signals) < len(task.limits) and (signals or task.minimise is not None):
            points += self._all(replace(task, limits=signals))
        kept = (own for own in points if not own.lost and self._keeps_limits(own.law))
        self.points = sorted(kept, key=lambda own: own.estimate)

    def _keeps_limits(self, law: Law) -> bool:
        most = ((own, own.at_most or 0.0) for own in self.task.limits if not own.of_signal)
        return all(worst(self.task, law, own, self.alpha) <= limit for own, limit in most)

    def _all(self, task: Task) -> list[Point]:
        found = self._designed(task, self._ones)
        points = [] if found is None else [found]
        if self.deadline.passed or (points and task.minimise is None):
            return points
        return points + self._between(task)

    @property
    def _ones(self) -> Shares:
        return (1.0,) * len(self.task.region.parts)

    def _between(self, task: Task) -> list[Point]:
        """Return laws for none of the region, then for shares that halving leads to.

        Each part has its own: what a law loses of one says nothing of the others.
        """
        low, high = [0.0 * own for own in self._ones], [*self._ones]
        shares, found = tuple(low), list[Point]()
        if relaxed(task.region, shares) == task.region:
            return found
        for _ in range(1 + ROUNDS):
            own = self._designed(task, shares)
            if own is None:
                break
            found.append(own)
            for k, share in enumerate(shares):
                (low if k in own.lost else high)[k] = share
            before, shares = shares, tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
            nearly = max(abs(a - b) for a, b in zip(shares, before, strict=True)) < FINEST
            if nearly or self.deadline.passed or self.spent > MOST_WORK:
                break
        return found

    def _designed(self, task: Task, shares: Shares) -> Point | None:
        """Design for shares of the region's parts; None where no law is."""
        region, whole = relaxed(task.region, shares), shares == self._ones
        try:
            found = task.reached(region, sure=whole)
            law = task.law(found)
        except SolverError as error:
            self.reasons.append(str(error))
            if len(self.reasons) == 1:
                self.refute()
            return None
        self.whole = found if whole and task is self.task else self.whole
        n, m = task.plant.shape
        count = task.domain.count(int(options(task.method).degree))
        self.spent += found.iterations * (count * (n * (n + 1) // 2 + m * n)) ** 3
        fast = is_too_fast(task.plant, law)  # of which samples would be rounding
        if fast and task is not self.task:
            return None
        estimate = level_of(task, found) if fast else worst(task, law, task.minimise, self.alpha)
        return Point(Origin(task, found), law, region, estimate, lost(task, law, self.alpha))


def worst(task: Task, law: Law, own: Specification | None, alpha: Array) -> float:
    """Return the worst sample of a signal: infinite where there is none, zero without a signal."""
    if own is None:
        return 0.0
    try:
        found = sampled(task.plant, law, own, alpha).worst
    except (InputError, np.linalg.LinAlgError):
        return np.inf
    return found if np.isfinite(found) else np.inf


def lost(task: Task, law: Law, alpha: Array) -> tuple[int, ...]:
    """Return which parts of the region a pole is outside of, at samples; proofs decide."""
    parts = range(len(task.region.parts))
    try:
        poles = close(task.plant, law, alpha, disturbed=False).poles()
    except (InputError, np.linalg.LinAlgError):
        return tuple(parts)
    slight = ROUNDED * np.abs(poles).max()
    return tuple(k for k in parts if not np.all(task.region.parts[k].distance(poles) < slight))


def relaxed(region: Region, shares: Shares) -> Region | None:
    """Return a region with shares of its parts' decay and damping; None for none of it."""
    kept: Region | None = None
    for part, share in zip(region.parts, shares, strict=True):
        own: Region = part
        if isinstance(part, HalfPlane) and share < 1:
            own = HalfPlane(part.decay * share if part.decay > 0 else part.decay)
        elif isinstance(part, Sector) and share < 1:
            if not share:
                continue
            own = Sector(part.damping * share)
        kept = own if kept is None else kept & own
    return kept
