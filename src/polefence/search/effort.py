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
from polefence.lmi.solve.search import Reached, singular_is_failure
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.proof.short import Short
from polefence.region.regions import Region
from polefence.requirements.gain_norm import GainNorm
from polefence.requirements.specification import Specification
from polefence.search.retreat import GAP
from polefence.search.task import Candidate, Origin, Task, candidate, level_of
from polefence.search.tune.starts import typical
from polefence.search.tune.worth import NEAR, SMALLER, taken

SHARES = (8e-4, 3e-4, 1e-4)  # of the level that a smaller law may cost, one after the other
SAMPLES = 50


@dataclass(frozen=True)
class Closer(Short):
    """The best law that was found, where one of a smaller gain is as good to a thousandth.

    Attributes
    ----------
    level : float
        What is proved of what is minimised; of a law that is not proved, as much less than of the
        smaller one as it is in floats.
    gain, own : float
        The norms of its gain and of the smaller one, in typical sizes.
    """

    level: float
    gain: float
    own: float


def gain_norm(plant: UncertainPlant) -> GainNorm:
    """Return the norm of a law's gain, states and inputs in their typical sizes."""
    sizes = typical(plant, np.eye(plant.shape[0]))
    return GainNorm(rows=tuple(map(float, sizes.inputs)), columns=tuple(map(float, sizes.states)))


def gain_of(plant: UncertainPlant, law: Any) -> float:
    """Return the largest norm of a law's gain at samples, in typical sizes."""
    return float(gain_norm(plant).values(plant, law, seeded(plant, SAMPLES)).max())


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
    lowest = min(own.level for own in every)
    best = min((*every, *better), key=lambda own: own.level)
    limit = max(min(best.level + NEAR * abs(best.level), max(most, lowest)), lowest)
    k = taken([own.level for own in every], [own.gain for own in every], limit)
    own = every[k]
    return k, replace(best, own=own.gain) if best.level < own.level else None


def smaller(
    task: Task, origin: Origin, designed: Region | None, law: Law, estimate: float
) -> Candidate | None:
    """Return a law of a smaller gain for nearly the same level of the LMI, proved, if there is one.

    Parameters
    ----------
    origin, designed
        Of the law that is to have a smaller gain: its task and point, and what of the region was
        asked of it.
    estimate : float
        Its worst sample of what is minimised.
    """
    minimised, first = task.minimise, origin.task.minimise
    if minimised is None or first is None or not minimised.of_signal:
        return None
    if not np.isfinite(origin.found.r):
        return None
    most = SMALLER * gain_of(task.plant, law)
    level, norm = level_of(origin.task, origin.found), gain_norm(task.plant)
    methods = list(dict.fromkeys(("quadratic", origin.task.method)))
    for share in SHARES:
        near = replace(first, at_most=level * (1 + share))
        asked = replace(origin.task, minimise=norm, limits=(*origin.task.limits, near))
        for method in tuple(methods):
            found = _found(replace(asked, method=method), designed, most, minimised)
            if found is None:  # nor within a smaller share
                methods.remove(method)
                continue
            own, reached, worst = found
            if worst <= estimate * (1 + NEAR):
                proved = candidate(task, own, designed, Origin(asked, reached), worst)
                if proved is not None:
                    return proved
    return None


def _found(
    asked: Task, designed: Region | None, most: float, minimised: Specification
) -> tuple[Law, Reached, float] | None:
    """Return the law of the least gain within a level, its point and its worst sample.

    None where there is none, or its gain is above a size.
    """
    with suppress(SolverError, InputError, np.linalg.LinAlgError), singular_is_failure():
        found = asked.reached(designed, GAP)
        law = asked.law(found)
        if gain_of(asked.plant, law) <= most:
            alpha = seeded(asked.plant, SAMPLES)
            return law, found, float(minimised.values(asked.plant, law, alpha).max())
    return None
