"""Laws without needless effort: of those as good as the best to a thousandth, one of small gain.

Near its optimum what is minimised hardly changes along some directions of the gain, and a search
ends far out along them. There the gain is the only thing left to choose, so a smaller one is taken
where it falls by a fifth, in units in which states and inputs have typical sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.law.laws import Law
from polefence.lmi.solve.search import Reached
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.proof.short import Short
from polefence.requirements.gain_norm import GainNorm
from polefence.response.closed import close
from polefence.search.task import Task, level_of
from polefence.search.tune.starts import typical
from polefence.search.tune.worth import taken


@dataclass(frozen=True)
class Closer(Short):
    """The best law that was found, where one of a smaller gain is as good to a thousandth.

    Attributes
    ----------
    level : float
        What is proved of what is minimised; of a law that is not proved, as much less than of the
        smaller one as it is in floats.
    gain, smaller : float
        The norms of its gain and of the smaller one, in typical sizes.
    """

    level: float
    gain: float
    smaller: float


def gain_norm(plant: UncertainPlant) -> GainNorm:
    """Return the norm of a law's gain, states and inputs in their typical sizes."""
    sizes = typical(plant, np.eye(plant.shape[0]))
    return GainNorm(rows=tuple(map(float, sizes.inputs)), columns=tuple(map(float, sizes.states)))


def gain_of(plant: UncertainPlant, law: Any) -> float:
    """Return the largest norm of a law's gain at samples, in typical sizes."""
    return float(gain_norm(plant).values(plant, law, seeded(plant, 50)).max())


def least(
    every: Sequence[Closer], better: Sequence[Closer], most: float = np.inf
) -> tuple[int, Closer | None]:
    """Return which of some laws is `taken`, and the best where that is another.

    Parameters
    ----------
    every, better : sequence of Closer
        Level and gain of each, at least one; of better laws that smaller ones were taken for.
    most : float
        Level that is not to be exceeded, if one of them keeps it.
    """
    first = min(range(len(every)), key=lambda k: (every[k].level, every[k].gain))
    known = (*every, *(law for law in better if law.level < every[first].level))
    highest = max(most, every[first].level)
    k = taken([law.level for law in known], [law.gain for law in known], highest)
    k = k if k < len(every) else first
    chosen, best = every[k], min(known, key=lambda law: law.level)
    return k, replace(best, smaller=chosen.gain) if best.level < chosen.level else None


def is_too_fast(plant: UncertainPlant, law: Law) -> bool:
    """Whether poles at the vertices are so fast that nothing but floats bounded them.

    Those of a stable loop at samples are bounded by its step.
    """
    if plant.step:
        return False
    poles = close(plant, law, np.eye(len(plant.vertices)), disturbed=False).poles()
    fastest = float(np.abs(np.linalg.eigvals(plant.A)).max()) or 1.0
    return bool(np.abs(poles).max() > 1e5 * fastest)  # a law of faster poles is none to be built


def calmer(task: Task, point: Reached) -> Law | None:
    """Return the LMI's law of the least gain for nearly the level of a point, if it can be built.

    Near its least a level bounds some directions of a gain by nothing but floats.
    """
    if task.minimise is None or not task.minimise.of_signal:
        return None
    # so much a calmer law may cost, of what counts as good as the best
    near = replace(task.minimise, at_most=level_of(task, point) * (1 + 8e-4))
    asked = replace(task, minimise=gain_norm(task.plant), limits=(*task.limits, near))
    with suppress(SolverError, InputError):
        law = asked.law(asked.reached(task.region, 1e-3))
        return None if is_too_fast(task.plant, law) else law
    return None
