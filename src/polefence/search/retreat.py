"""Laws some way off an infimum that none attains, or none that can be proved or built.

Where nothing limits the law, what is minimised falls, or comes closer to its infimum, as gains grow
without bound. Poles that are bounded make the question one whose optimum is attained; a point some
way off the edge has a proof. Each step is the start of the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from polefence.base.errors import NotProvedError, RegionError, SolverError
from polefence.law.laws import Law
from polefence.lmi.solve.search import Reached
from polefence.plant.family import UncertainPlant
from polefence.proof.short import Short
from polefence.region.regions import bounded
from polefence.response.closed import close
from polefence.search.task import Task, level_of

SPEEDS = (1e1, 1e2, 1e3, 1e4)  # of poles, times the plant's own fastest
FASTEST = 1e5  # a law of faster poles is no law to be built
GAP = 1e-3  # how far from the optimum the search ends, relative to it
GAPS = (1e-3, 5e-3, 2e-2, 5e-2, 0.2)  # the same, where the region itself bounds the poles
CLOSE = 0.01  # a step that comes as near to the infimum as this share is near enough
FAR = 1.0  # a step that is farther is no answer
FALL = 2.0  # from step to step, of what falls without end


@dataclass(frozen=True, eq=False)
class Step:
    """A law for poles that are bounded.

    Attributes
    ----------
    speed : float
        The largest magnitude of poles that was allowed [1/s].
    found : Reached
    level : float
        Of what is minimised, as one Lyapunov matrix for everything has it; zero where nothing is.
    """

    speed: float
    found: Reached
    level: float


@dataclass(frozen=True)
class Retreat(Short):
    """Distance of a law from an infimum.

    Attributes
    ----------
    speed : float
        The largest magnitude of poles that the design allowed [1/s]; infinite where it is the
        region that bounds it.
    level, least : float
        What the search found with one Lyapunov matrix for everything, in floats: at the step that
        was taken, and the least without a bound on the poles, or at any step.
    """

    speed: float
    level: float
    least: float

    @property
    def share(self) -> float:
        """Height of the step above the least, as a share of it."""
        return self.level / self.least - 1


def own_speed(plant: UncertainPlant) -> float:
    """Return the largest magnitude of the vertices' poles without a law [1/s]; one if all are 0."""
    return float(np.abs(np.linalg.eigvals(plant.A)).max()) or 1.0


def is_too_fast(plant: UncertainPlant, law: Law) -> bool:
    """Whether poles at the vertices are so fast that nothing but floats bounded them.

    Those of a stable loop at samples are bounded by its step.
    """
    if plant.step:
        return False
    poles = close(plant, law, np.eye(len(plant.vertices)), disturbed=False).poles()
    return bool(np.abs(poles).max() > FASTEST * own_speed(plant))


def steps(task: Task) -> Iterator[Step]:
    """Yield laws for faster and faster poles; farther and farther from the edge of a region."""
    if task.region.bounds_speed:
        for gap in GAPS:
            try:
                found = task.reached(task.region, gap)
            except SolverError:
                continue
            yield Step(np.inf, found, level_of(task, found))
        return
    near: Reached | None = None
    own = max(own_speed(task.plant), task.region.scale)
    for factor in SPEEDS:
        try:
            near = task.reached(bounded(task.region, factor * own), GAP, near)
        except (SolverError, RegionError):
            continue
        yield Step(factor * own, near, level_of(task, near))


def is_falling(taken: Sequence[Step]) -> bool:
    """Whether what is minimised falls without end as poles are allowed to be faster."""
    return len(taken) > 1 and all(a.level > FALL * b.level for a, b in pairwise(taken))


def unbounded(task: Task, taken: Sequence[Step]) -> NotProvedError:
    """Return that no law is best, and what would make one so."""
    own = task.minimise
    what = "" if own is None else own.title
    levels = ", ".join(f"{step.level:.3g} for poles up to {step.speed:.2g} 1/s" for step in taken)
    return NotProvedError(
        f"unbounded: {what} falls without end as the law grows ({levels}); limit the gain, the "
        "input or the actuator: add a limit on the gain norm, on the rms or gain of an input, or a "
        "region that bounds the poles, such as a disk"
    )
