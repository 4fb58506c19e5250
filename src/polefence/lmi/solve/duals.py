"""Dual polynomials on the whole box, of rising degree, and on parts of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from polefence.base.effort import ended, spend
from polefence.lmi.solve.dual_problem import Dual, DualProblem
from polefence.lmi.solve.gramians import ROUNDS, Interpolation
from polefence.lmi.solve.late import LateSearch
from polefence.lmi.solve.one_loop import RiccatiOfOne
from polefence.lmi.solve.over_clock import OverClock
from polefence.lmi.solve.reached import ReachedSearch
from polefence.lmi.solve.started import StartedSearch
from polefence.lmi.solve.storage import StorageSearch
from polefence.plant.boxes import MOST_BENT, MOST_PARTS, Box, Point, divided
from polefence.plant.parts import Point as Exact

MOST = 3e8  # of the work on one polynomial [multiplications]
# The same on a part of the box, and on all parts. Degree 4 for 16 states and three parameters is
# 1.1e9 and takes 0.3 s; degree 2 in six parameters is more, and minutes for a few parts.
MOST_IN_PART, MOST_IN_PARTS = 1.2e9, 4e10
DEGREES, BENT = (2, 4), (1, 2)  # on parts of the box; of samples between nodes
MOST_OVER_CLOCK = 64  # parts: what takes more is missed along the length of a period


def duals(problem: DualProblem, worst: float, near: float = 1e-3, most: int = 4) -> Iterator[Dual]:
    """Yield dual polynomials of rising degree until one proves a level near the worst sample.

    Parameters
    ----------
    worst : float
        What is bounded, at the worst point known.
    near : float
        How far above it a level ends the climb, as a share.
    most : int
        The highest degree.
    """
    first = int(problem.domain.corners > 1)
    if first and problem.clocked:  # parts of the box take less
        return
    if problem.means is not None:
        whole = problem.means.inside(Box.whole(problem.domain), problem.domain)
        problem = replace(problem, means=whole)
    for degree in range(first, most + 1 if first else 1):
        if problem.work(degree) * ROUNDS > MOST and degree > first:
            return
        dual: Dual | None = None
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            dual = _of(problem, degree).least(worst)
        if dual is not None:
            yield dual
            if dual.level <= worst * (1 + near):
                return


@dataclass(frozen=True, eq=False)
class Part:
    """A dual polynomial on a part of the box; ``low`` and ``high`` are weights of upper ends."""

    low: Point | Exact
    high: Point | Exact
    dual: Dual


Known = dict[tuple[Box, int], Dual | None]  # what was found in a part, of a degree


def in_parts(
    problem: DualProblem,
    level: float,
    most: int | None = None,
    known: Known | None = None,
    first: Sequence[Box] = (),
) -> list[Part] | None:
    """Return a partition of the box with a dual polynomial that proves the level on each part.

    A part on which none does is halved along the parameter along which the loop changes most.

    Parameters
    ----------
    most : int
        How many parts there may be; None is returned where that is not enough.
    known : dict, optional
        What was found for lower levels of the problem; what is found now is added.
    first : sequence of Box
        Parts to begin with, which make up the box; by default all of it is one.
    """
    known = {} if known is None else known
    most = most or (MOST_BENT if problem.plant.bent else MOST_PARTS)
    if problem.clocked:
        most = min(most, MOST_OVER_CLOCK)
    by_level = problem.gain or problem.starts is not None or problem.plant.remainder is not None
    if not problem.law.divisible(problem.plant) or problem.share is not None:
        return None
    begun = list(first) or [Box.whole(problem.domain)]
    tried: tuple[int, ...] = BENT if problem.plant.bent or problem.clocked else DEGREES
    work = {degree: problem.inside(begun[0]).work(degree) * ROUNDS for degree in tried}
    degrees = [d for d in work if work[d] <= MOST_IN_PART]
    if not degrees:
        return None

    done = 0.0

    def proving(box: Box) -> Dual | None:
        nonlocal done
        for degree in degrees:
            dual = known.get((box, degree))
            # of some kinds it hangs on the level whether there is one
            if dual is None and (by_level or (box, degree) not in known):
                dual = next(_duals(problem.inside(box), level, [degree]), None)
                known[box, degree] = dual
                done += work[degree]
                spend(0.3 * work[degree])  # measured: 0.3 operations a multiplication
            if dual is not None and dual.level < level:
                return dual
        return None

    def along(box: Box) -> int | None:
        late = done > MOST_IN_PARTS or ended()
        return None if late else replace(problem, box=box).widest

    parts = divided(begun, proving, along, most)
    return None if parts is None else [Part(box.low, box.high, dual) for box, dual in parts]


def _duals(problem: DualProblem, level: float, degrees: Sequence[int]) -> Iterator[Dual]:
    """Yield dual polynomials of some degrees on a part, for a gain at the level itself."""
    for degree in degrees:
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            dual = _of(problem, degree).proving(level)
            if dual is not None:
                yield dual


def least_in(problem: DualProblem, parts: Sequence[tuple[Box, int]], worst: float) -> float | None:
    """Return the least level that dual polynomials prove in these parts of the box.

    Parameters
    ----------
    parts : sequence of Box and int
        With the degree of the dual polynomial in each.
    """
    largest = 0.0
    for box, degree in parts:
        dual: Dual | None = None
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            dual = _of(problem.inside(box), degree).least(worst)
        if dual is None:
            return None
        largest = max(largest, dual.level)
    return largest


class Search(Protocol):
    """The search for a dual of one degree."""

    def least(self, worst: float) -> Dual | None:
        """Return one as near the worst sample as there is."""

    def proving(self, level: float) -> Dual | None:
        """Return one that proves a level."""


def _of(problem: DualProblem, degree: int) -> Search:
    """Return the search for R, between samples or over a clock where there are such."""
    if problem.plant.dead_time is not None:
        return LateSearch(problem, degree)
    if problem.starts is not None:
        return StartedSearch(problem, degree)
    if problem.storing is not None:
        return (StorageSearch if problem.gain else ReachedSearch)(problem, degree)
    if problem.ticking:
        return OverClock(problem, degree)
    if problem.gain and problem.domain.corners == 1 and problem.plant.remainder is None:
        return RiccatiOfOne(problem, degree)
    return Interpolation(problem, degree)
