"""The search: laws of a structure with the least worst case, from several starts.

A law is first brought into the region, then within the limits, then to the least level, at a few
points of the family. Where it is worse elsewhere these points are added, and it is improved again.
Last comes the smallest law that is as good to a thousandth.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np

from polefence.base.errors import InputError
from polefence.base.progress import counted, stage
from polefence.base.team import ALONE, Team
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.lmi.conditions.target import Goal, Side
from polefence.plant.family import UncertainPlant
from polefence.plant.points import edges, inside
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.laws import OWN
from polefence.region.regions import Region, stable
from polefence.requirements.specification import Specification
from polefence.search.tune.descent import (
    EARLY,
    FEASIBLE,
    FULL,
    PATIENT,
    QUICK,
    ROUGH,
    Effort,
    Rows,
    descend,
    descent,
)
from polefence.search.tune.measures import (
    LEVEL,
    LIMITS,
    REGION,
    SMALL,
    WIDE,
    WORST,
    Ask,
    Points,
    Task,
)
from polefence.search.tune.meeting import met
from polefence.search.tune.quadratic import Program
from polefence.search.tune.starts import regulators, typical
from polefence.search.tune.unknowns import FEW, Unknowns
from polefence.search.tune.worth import SMALLER, promising, taken

T = TypeVar("T")

INSIDE, ON_EDGES = 160, 3  # points of the cloud: in the family, and on each edge
MOST_CORNERS, MOST_CLOUD = 16, 600
SMOOTH = 10.0, 300.0, 1e4  # kappa, one after the other, before poles themselves
# Starts at random: of 20 laws, of random plants and shown ones, one is 0.4 % worse without; of
# eight gains of a library none is better with 8.
RANDOM, SEED = 4, 20261122
# The same beside laws that are given: those of an order start near one another. Three masses, one
# velocity, order 2: 0.530 without, 0.387 with eight; half of a direct search's starts come there.
BESIDE = 8
SHARED = 30  # numbers of a program that are worth a thread: 0.15 ms in the kernel
STRICT = 1e5  # of what is not quite kept at the end
# The same while a law is made small: the level rises so steeply that it is left with less. Of four
# laws of a car the searches take 290 evaluations in place of 460, and lead to sizes as small.
STEEP = 1e3
ENOUGH = 4  # laws that are given, beside which the search has no regulators of its own
# Times the best gain: of two laws of a car it leads to levels 0.16 and 0.35 % lower.
FARTHER = 4.0, 16.0
# Starts that are followed at the corners, and over the family: of eight gains of a library 6 lower
# one by 4.6 and one by 1 % beside 3, in a third more time.
BEST, LAST = 6, 2
ROUNDS, MORE = 10, 1e-4  # of added points, and by how much one must be worse
KEPT = 1e-6  # limits to rounding
ALIKE = 1e-3  # of laws that count as one
NUDGE = 1e-4


@dataclass(frozen=True, eq=False)
class Tuned:
    """A law that a search found; nothing of it is proved.

    Attributes
    ----------
    law : Law
        A `FixedGain` where the structure is one gain of plain states.
    level : float
        The worst of what is minimised at the points that were looked at.
    alpha : (N,) array
        Where.
    kept : bool
        Whether limits, region and largest gain are kept at all of them.
    bounded_by : str
        What stopped the gain from growing further; empty where nothing had to.
    size : float
        The largest norm of the gain of all states, in typical sizes, at points of the family.
    larger : pair of Law and float, optional
        A law of a lower level, for which this smaller one was taken, and that level.
    """

    law: Law
    level: float
    alpha: Array
    kept: bool
    bounded_by: str
    size: float = 0.0
    larger: tuple[Law, float] | None = None


def tune(
    plant: UncertainPlant,
    structure: Structure,
    minimise: Specification | None,
    limits: Sequence[Specification] = (),
    region: Region | None = None,
    starts: Sequence[Law] = (),
    alone: bool = False,
) -> list[Tuned]:
    """Search laws of a structure; return those found, the best first.

    Parameters
    ----------
    minimise : Specification or None
        None: the law's own size, that of its gain in typical units of signals and inputs.
    limits : sequence of Specification
        Each with its ``at_most``.
    region : Region, optional
        For the poles; stability by default.
    starts : sequence of Law
        Laws to start from besides the search's own. One that is of the structure and keeps
        everything is among the results, so that these are never worse.
    alone : bool
        Whether the search has no other starts.

    Raises
    ------
    InputError
        If the structure or a specification does not fit the plant.
    """
    return _run(_task(plant, structure, minimise, tuple(limits), region), starts, alone)


def rough(
    plant: UncertainPlant,
    structure: Structure,
    minimise: Specification | None,
    limits: Sequence[Specification] = (),
    region: Region | None = None,
    starts: Sequence[Law] = (),
) -> Tuned | None:
    """Return what the best start of `tune` leads to at the corners: for starts of another search.

    None where that keeps not even these.
    """
    task = _task(plant, structure, minimise, tuple(limits), region)
    return _Search(task).rough(starts)


def tune_region(
    plant: UncertainPlant,
    structure: Structure,
    goal: Goal,
    limits: Sequence[Specification] = (),
    starts: Sequence[Law] = (),
) -> list[Tuned]:
    """Search laws with the least r of a region that grows with r; return them, the best first.

    Parameters
    ----------
    goal : Disks, Around, Decays or Sectors
        The level is its r, as `polefence.lmi.conditions.target` has it.
    limits, starts
        As `tune` has them.

    Raises
    ------
    InputError
        As `tune` raises.
    """
    return _run(_of_region(plant, structure, goal, limits), starts)


def _of_region(
    plant: UncertainPlant, structure: Structure, goal: Goal, limits: Sequence[Specification]
) -> Task:
    sides = tuple(side for side in goal.target(1.0).sides if np.any(side.L1) or np.any(side.M1))
    within = getattr(goal, "within", None)
    return _task(plant, structure, sides, tuple(limits), within)


def at_vertices(
    plant: UncertainPlant,
    structure: Structure,
    goal: Goal,
    limits: Sequence[Specification] = (),
    start: Law | None = None,
) -> Tuned | None:
    """Return the best law for the vertices alone, from one start; None where none keeps the limits.

    Parameters
    ----------
    goal, limits
        As `tune_region` has them.
    start : Law, optional
        By default the best of the search's own starts.
    """
    search = _Search(_of_region(plant, structure, goal, limits), most=len(plant.vertices))
    return search.rough(() if start is None else (start,), alone=start is not None)


def _task(
    plant: UncertainPlant,
    structure: Structure,
    minimise: Specification | tuple[Side, ...] | None,
    limits: tuple[Specification, ...],
    region: Region | None,
) -> Task:
    structure.require_fit(plant)
    for asked in (minimise, *limits):
        if isinstance(asked, Specification):
            asked.require_fit(plant)
    for limit in limits:
        if limit.at_most is None:
            raise InputError(f"the limit of {limit.name!r} is missing; give at_most")
    sizes = typical(plant, structure.rows(plant).mean(axis=0))
    free = isinstance(minimise, tuple) and plant.sample_time is not None
    if region is None:
        region = stable(float(plant.step))
    elif not region.stable and plant.sample_time is None:
        region = region & stable(float(plant.step))
    rates = [np.abs(np.linalg.eigvals(v)).max() for v in plant.A]
    fastest = 100.0 * max(*rates, region.scale, sizes.rate)
    if region.bounds_speed or np.all(np.isfinite(structure.largest(plant))) or free:
        fastest = np.inf
    unknowns = Unknowns(plant, structure, sizes.states, sizes.inputs)
    return Task(plant, unknowns, minimise, limits, region, sizes, float(fastest))


@stage("tuning")
def _run(task: Task, starts: Sequence[Law], alone: bool = False) -> list[Tuned]:
    """Return what a search finds; one gain, a special case, is first if no such law is given."""
    structure = task.unknowns.structure
    if not alone and task.unknowns.terms > 1 and all(law.W is not None for law in starts):
        one = replace(task.unknowns, structure=replace(structure, schedule=()))
        simple = _Search(replace(task, unknowns=one)).run(starts)
        starts = (*starts, *(tuned.law for tuned in simple[:1]))
    return _Search(task).run(starts, alone)


@dataclass(frozen=True, eq=False)
class _Reached:
    """Numbers that a start led to.

    Attributes
    ----------
    theta : (size,) array
    points : Points
        At which it was improved.
    excess : float
        By how much something is not kept there, zero or less where all is.
    level : float
        The worst there of what is minimised.
    larger : pair of (size,) array and float, optional
        Numbers of a law for which this smaller one was taken, and their level.
    """

    theta: Array
    points: Points
    excess: float
    level: float
    larger: tuple[Array, float] | None = None

    @property
    def rank(self) -> tuple[float, float]:
        """What is less is better."""
        return max(self.excess - FEASIBLE, 0.0), self.level


Asking = Generator[Ask | Program, Any, T]  # asks for what `Points.answers` answers, or a minimum


def together(searches: Sequence[Asking[T]], points: Points) -> list[T]:
    """Return what comes of searches that are answered together, at points."""
    ends, answers = dict[int, T](), dict[int, Any](dict.fromkeys(range(len(searches))))
    asks = dict[int, Ask]()
    with Team() as team:
        while answers:
            programs = dict[int, Program]()
            for k, answer in answers.items():
                try:
                    asked = searches[k].send(answer)
                except StopIteration as done:
                    ends[k] = done.value
                    continue
                if isinstance(asked, Program):
                    programs[k] = asked
                else:
                    asks[k] = asked
            # all descents come to their next point before these are looked at
            if programs:
                every = list(programs.values())
                each = team.each if len(every[0].q) >= SHARED else ALONE.each
                minima = each(Program.minimum, every)
                answers = dict(zip(programs, minima, strict=True))
            else:
                asks = dict(sorted(asks.items()))
                rows = points.answers(list(asks.values()), team)
                answers, asks = dict(zip(asks, rows, strict=True)), {}
    return [ends[k] for k in range(len(searches))]


def _asking(ask: Ask, **how: Any) -> Asking[tuple[Array, Rows] | None]:
    """Return the minimum that a descent finds which asks so from its own points."""
    descending = descent(ask.theta, **how)
    try:
        asked = next(descending)
        while True:
            question = asked if isinstance(asked, Program) else replace(ask, theta=asked)
            asked = descending.send((yield question))
    except StopIteration as done:
        found: tuple[Array, Rows] | None = done.value
        return found


def _level(theta: Array) -> Asking[float]:
    """Return the worst of what is minimised."""
    worst = yield Ask(theta, WORST)
    return float(worst[0].max())


class _Search:
    """A task with the points that it is looked at."""

    def __init__(self, task: Task, most: int = MOST_CORNERS) -> None:
        count = len(task.plant.vertices)
        self.task = task
        self.domain = Domain.of("box" if task.plant.parameters else "simplex", count)
        corners = np.eye(count)
        if count > most:
            some = np.random.default_rng(SEED).permutation(count)[:most]
            corners = corners[np.sort(some)]
        self.first = task.at(corners)
        self.places = _cloud(self.domain)
        self.cloud = task.at(self.domain.alpha(self.places))
        self._seen = dict[bytes, tuple[Array, Array]]()

    def run(self, laws: Sequence[Law], alone: bool = False) -> list[Tuned]:
        """Return what all starts lead to, the best first; with ``alone`` no others than laws."""
        nothing = self.task.unknowns.law(np.zeros(self.task.unknowns.size))
        if self.task.minimise is None and (zero := self._given(nothing)).kept:
            return [zero]
        quick = self._of_given(laws) if alone else self._quick(laws)
        # beside laws that are given stand some at random, for which none of these makes way
        first = quick[: len(laws)] if len(laws) >= ENOUGH else quick
        followed = dict.fromkeys((*_distinct(first)[:BEST], *_distinct(quick)[:BEST]))
        reached = [
            min(better, start, key=attrgetter("rank"))
            for better, start in zip(
                self._improved([start.theta for start in followed], self.first),
                followed,
                strict=True,
            )
        ]
        reached += self._meeting(_distinct(reached)[:1])
        ends = _distinct(reached)[:LAST]
        # beside these, none of which makes way: what is best at the corners need not be elsewhere
        ends += [] if alone else self._farther(ends[:1])
        results = [self._tuned(self._finished(end)) for end in counted(ends, "best start")]
        least = min((tuned.level for tuned in results if tuned.kept), default=np.inf)
        own = [law for law, fits in zip(laws, self._of_structure(laws), strict=True) if fits]
        given = [self._given(law) for law in own if self._promises(law, least)]
        results += [tuned for tuned in given if tuned.kept]
        results.sort(key=lambda tuned: (not tuned.kept, tuned.level))
        kept = [tuned for tuned in results if tuned.kept]
        if kept and isinstance(self.task.minimise, Specification):
            k = taken([tuned.level for tuned in kept], [tuned.size for tuned in kept])
            chosen = results.pop(k)
            if k and (chosen.larger is None or chosen.larger[1] > kept[0].level):
                chosen = replace(chosen, larger=(kept[0].law, kept[0].level))
            results.insert(0, chosen)
        return results

    def rough(self, laws: Sequence[Law], alone: bool = False) -> Tuned | None:
        """Return what the best start leads to at the corners, None where it does not keep them.

        With ``alone`` from these laws and no other.
        """
        quick = self._of_given(laws) if alone else self._quick(laws)
        for start in _distinct(quick)[:1]:
            better = self._improved([start.theta], self.first)[0]
            best = min(better, start, key=attrgetter("rank"))
            if best.excess <= FEASIBLE:
                law = self.task.unknowns.law(best.theta)
                return Tuned(law, best.level, self.first.alpha[0], True, "")
        return None

    def _of_given(self, laws: Sequence[Law]) -> list[_Reached]:
        """Return what laws alone lead to at the corners."""
        return self._improved(self._given_starts(laws), self.first, QUICK)

    def _quick(self, laws: Sequence[Law]) -> list[_Reached]:
        """Return what all starts lead to at the corners; with patience if none is inside."""
        starts = self._starts(laws)
        ends = self._improved(starts, self.first, QUICK)
        asks = [Ask(end.theta, REGION) for end in ends]
        if any(rows and rows.level <= FEASIBLE for rows in self.first.answers(asks)):
            return ends
        return self._improved(starts, self.first)

    def _farther(self, best: Sequence[_Reached]) -> list[_Reached]:
        """Return what many times the gain leads to: between it and there a level may be higher."""
        if not isinstance(self.task.minimise, Specification) or _has_own_states(self.task.plant):
            return []
        starts = [times * start.theta for start in best for times in FARTHER]
        ends = _distinct(self._improved(starts, self.first, QUICK))[:1]
        better = self._improved([end.theta for end in ends], self.first)
        return [end for end in better if _distinct([*best, end])[0] is end]

    def _meeting(self, best: Sequence[_Reached]) -> list[_Reached]:
        """Return the law of one plant for which all poles of a region that grows are in one place.

        It is looked for where smooth measures that come closer and closer to the poles lead to.
        """
        of_poles = isinstance(self.task.minimise, tuple)
        if not of_poles or len(self.cloud.alpha) > 1 or len(self.task.plant.vertices) > 1:
            return []
        ends = list[_Reached]()
        for start in best:
            theta, unit = start.theta, self.task.unit(start.level)
            for kappa in (10.0, 1e2, 1e3, 1e4, 1e5, 1e6):
                evaluate = partial(self.first.rows, phase=LEVEL, unit=unit, kappa=kappa)
                lower = descend(evaluate, theta, effort=PATIENT)
                if lower is None:
                    break
                theta = lower[0]
            there = met(self._loop, theta)
            for numbers in (theta, *([] if there is None else [there[0]])):
                rows = self.first.rows(numbers, LIMITS)
                excess = rows.level if rows is not None else np.inf
                ends.append(_Reached(numbers, self.first, excess, self._level(self.first, numbers)))
        return ends

    def _loop(self, theta: Array) -> Array:
        """Return A + B K at the first point, states in their sizes."""
        inner, channel = self.first.unknowns.gains(theta), self.first.channels[0]
        return np.asarray(channel.A[0] + channel.B[0] @ inner[0] @ self.first.unknowns.C[0])

    def _given_starts(self, laws: Sequence[Law]) -> list[Array]:
        unknowns, alpha = self.task.unknowns, self._few
        few, root = unknowns.at(alpha), _root(self.task.sizes.covariance)
        return few.nearest([np.asarray(law.gain(alpha)) * unknowns.states for law in laws], root)

    @property
    def _few(self) -> Array:
        return self.cloud.alpha[:: max(1, len(self.cloud.alpha) // FEW)]

    def _starts(self, laws: Sequence[Law]) -> list[Array]:
        starts = self._given_starts(laws)
        random = np.random.default_rng(SEED)
        if len(starts) >= ENOUGH:
            size = self.task.unknowns.size
            return [*starts, *(random.normal(size=size) for _ in range(BESIDE))]
        task, unknowns, alpha = self.task, self.task.unknowns, self._few
        few, root = unknowns.at(alpha), _root(task.sizes.covariance)
        some = regulators(task.plant, task.sizes, task.region, task.requirements)
        starts += few.nearest([np.broadcast_to(K, (len(alpha), *K.shape)) for K in some], root)
        starts.append(np.zeros(unknowns.size))
        starts += [random.normal(size=unknowns.size) for _ in range(RANDOM)]
        # none is exactly where poles coincide
        return [theta + NUDGE * random.normal(size=unknowns.size) for theta in starts]

    @stage("search")
    def _improved(
        self,
        starts: Sequence[Array],
        points: Points,
        effort: Effort = FULL,
        smooth: Sequence[float] = SMOOTH,
    ) -> list[_Reached]:
        """Return where the phases lead to from each start, at some points; all go on together."""
        return together([self._improving(one, points, effort, smooth) for one in starts], points)

    def _improving(
        self, theta: Array, points: Points, effort: Effort, smooth: Sequence[float]
    ) -> Asking[_Reached]:
        """Return where the phases lead to: into the region, the limits, down."""
        theta = self.task.unknowns.balanced(theta)
        rows = yield Ask(theta, REGION)
        outside = rows is None or rows.level > FEASIBLE
        regions = (SMOOTH[0], SMOOTH[-1], None) if outside else ()
        for phase, kappa in (*((REGION, kappa) for kappa in regions), (LIMITS, None)):
            # the smoothest measure stays positive well inside the region: it only leads the way
            most = effort if kappa == SMOOTH[0] else FULL
            minimum = yield from _asking(Ask(theta, phase, kappa=kappa), target=0.0, effort=most)
            if minimum is None:
                return _Reached(theta, points, np.inf, np.inf)
            theta, rows = minimum
            if rows.level > FEASIBLE and kappa is None:
                return _Reached(theta, points, rows.level, (yield from _level(theta)))
        theta = yield from self._lowering(theta, effort, smooth)
        last = yield Ask(theta, LIMITS)
        if last is not None and last.level > FEASIBLE:
            unit = self.task.unit((yield from _level(theta)))
            minimum = yield from _asking(Ask(theta, LEVEL, unit), effort=QUICK, penalty=STRICT)
            if minimum is not None:
                theta = minimum[0]
                last = yield Ask(theta, LIMITS)
        level = yield from _level(theta)
        return _Reached(theta, points, last.level if last else np.inf, level)

    def _lowering(self, theta: Array, effort: Effort, smooth: Sequence[float]) -> Asking[Array]:
        """Return where the level is least, of numbers that keep everything."""
        of_poles = isinstance(self.task.minimise, tuple)
        for kappa in (*smooth, None) if of_poles else (None,):
            theta = self.task.unknowns.balanced(theta)
            unit = self.task.unit((yield from _level(theta)))
            early = of_poles and kappa != smooth[-1] and effort is FULL
            most = EARLY if early else effort
            minimum = yield from _asking(Ask(theta, LEVEL, unit, kappa), effort=most)
            if minimum is None:
                break
            theta = minimum[0]
        return theta

    def _level(self, points: Points, theta: Array) -> float:
        return float(self._worst(points, theta)[0].max())

    @staticmethod
    def _worst(points: Points, theta: Array) -> Array:
        inner = points.unknowns.gains(theta)
        return points.worst(inner @ points.unknowns.C, inner)

    def _finished(self, reached: _Reached) -> _Reached:
        """Return it improved at points where it is worse, then made small.

        While there are such points a few steps will do.
        """
        settled = True
        for _ in range(ROUNDS):
            more = self._more(reached)
            if more is None and settled:
                break
            settled = more is None
            effort = FULL if settled else EARLY
            points = more or reached.points
            reached = self._improved([reached.theta], points, effort, smooth=SMOOTH[-1:])[0]
        if reached.excess > FEASIBLE or self.task.minimise is None:
            return reached
        points, most = reached.points, reached.level + (WIDE - 1) * abs(reached.level)
        law = self.task.unknowns.law
        unit = self._size(law(reached.theta)) or 1.0
        evaluate = partial(points.rows, phase=SMALL, unit=unit, most=most)
        minimum = descend(evaluate, reached.theta, effort=ROUGH, penalty=STEEP)
        if minimum is None or minimum[1].excess > FEASIBLE:
            return reached
        smaller = _Reached(minimum[0], points, 0.0, self._level(points, minimum[0]))
        if self._size(law(minimum[0])) > SMALLER * unit or self._more(smaller) is not None:
            return reached
        return replace(smaller, larger=(reached.theta, reached.level))

    def _more(self, reached: _Reached) -> Points | None:
        """Return the points with those at which a law is worse; None where there are none."""
        worst, alpha = self._looked_at(reached.theta)
        here = self._worst(reached.points, reached.theta).max(axis=1)
        if not np.isfinite(here[0]) and not np.isfinite(worst[0]):
            here[0] = worst[0]
        slack = np.append(MORE * abs(here[0]), np.full(len(here) - 1, KEPT / 2))
        beyond = np.append(here[:1], np.maximum(here[1:], 0.0)) + slack
        new = alpha[worst > np.where(np.isnan(beyond), np.inf, beyond)]
        have = reached.points.alpha
        far = [a for a in new if np.abs(have - a).max(axis=1).min() > 1e-6]
        if not far:
            return None
        return self.task.at(np.vstack([have, np.unique(np.round(far, 12), axis=0)]))

    def _looked_at(self, theta: Array) -> tuple[Array, Array]:
        """Return what `_looked` returns of numbers, which may be asked for again."""
        key = theta.tobytes()
        if key not in self._seen:
            self._seen[key] = self._looked(lambda points: self._worst(points, theta))
        return self._seen[key]

    def _looked(self, worst: Any) -> tuple[Array, Array]:
        """Return the worst of each measure over the family, and where: from the cloud, uphill.

        Parameters
        ----------
        worst : callable
            From points to the values of all measures there, (measures, count).
        """
        of_cloud = worst(self.cloud)
        best = of_cloud.argmax(axis=1)
        values, places = of_cloud.max(axis=1), self.places[best]
        if len(self.places) == 1:
            return values, self.domain.alpha(places)
        corners = np.array(self.domain.monomials(1), dtype=float)
        moves = self._moves(corners.shape[1])
        share, index = 0.25, np.arange(len(values))
        for _ in range(7):
            near = places[:, None] + share * np.stack([to(places) for to in moves], axis=1)
            nearby = worst(self.task.at(self.domain.alpha(near.reshape(-1, near.shape[2]))))
            nearby = nearby.reshape(len(index), len(index), len(moves))[index, index]
            at = nearby.argmax(axis=1)
            places = np.where((nearby[index, at] > values)[:, None], near[index, at], places)
            values = np.maximum(values, nearby.max(axis=1))
            share /= 2
        return values, self.domain.alpha(places)

    def _moves(self, count: int) -> list[Any]:
        """Return ways towards each corner of each simplex, the others as they are."""
        cuts = np.cumsum((0, *self.domain.sizes))
        moves = []
        for first, last in pairwise(cuts):
            for corner in range(first, last):
                target = np.eye(count)[corner]
                part = np.zeros(count)
                part[first:last] = 1.0
                moves.append(lambda c, t=target, p=part: (t - c) * p)
        return moves

    def _tuned(self, reached: _Reached) -> Tuned:
        worst, alpha = self._looked_at(reached.theta)
        there = self._worst(reached.points, reached.theta)
        law = self.task.unknowns.law(reached.theta)
        tuned = self._answer(law, worst, alpha, there, reached.points.alpha)
        if reached.larger is None or not isinstance(self.task.minimise, Specification):
            return tuned
        theta, level = reached.larger
        return replace(tuned, larger=(self.task.unknowns.law(theta), level))

    def _promises(self, law: Law, least: float) -> bool:
        """Return whether a law is worth a proof beside one of a level, by what it is at corners."""
        level = float(self._worst_of(law, self.first)[0].max())
        return level <= promising(least) if np.isfinite(least) else True

    def _worst_of(self, law: Law, points: Points) -> Array:
        K = np.asarray(law.gain(points.alpha)) * self.task.unknowns.states
        return points.worst(K, points.unknowns.of(law, points.alpha))

    def _given(self, law: Law) -> Tuned:
        values, alpha = self._looked(partial(self._worst_of, law))
        return self._answer(law, values, alpha, values[:, None], alpha[:1])

    def _answer(self, law: Law, worst: Array, alpha: Array, there: Array, where: Array) -> Tuned:
        k = int(there[0].argmax())
        level, at = max((float(there[0, k]), k), (float(worst[0]), -1))
        kept = np.maximum(worst, there.max(axis=1))
        fast, bound = 1 + len(self.task.sides), ""
        if np.isfinite(self.task.fastest) and kept[fast] > -0.5:  # from half of it on
            bound = f"poles of at most {self.task.fastest:.2g} 1/s"
        place = alpha[0] if at < 0 else where[at]
        sides = slice(1, fast)
        keeps = np.all(kept[1:] <= KEPT) and np.all(kept[sides] <= -1e-9)  # a region is open
        return Tuned(law, level, place, bool(keeps), bound, self._size(law))

    def _size(self, law: Law) -> float:
        """Return the largest norm of a law's gain of all states, in typical sizes."""
        unknowns = self.task.unknowns
        K = np.asarray(law.gain(self._few)) * unknowns.states / unknowns.inputs[:, None]
        return float(np.linalg.norm(K, axis=(1, 2)).max())

    def _of_structure(self, laws: Sequence[Law]) -> list[bool]:
        """Return of each law whether it is one of the structure."""
        unknowns, at = self.task.unknowns, self.cloud.unknowns
        free = unknowns.structure
        free_of_all = free.measured is None and free.schedule is None and free.pattern is None
        plain = [law for law in laws if law.W is None]
        K = [np.asarray(law.gain(self.cloud.alpha)) * unknowns.states for law in plain]
        nearest = at.nearest(K, np.eye(len(unknowns.states)))
        own = (
            np.abs(at.gains(theta) @ at.C - k).max() <= 1e-6 * np.abs(k).max()
            for theta, k in zip(nearest, K, strict=True)
        )
        return [bool(next(own)) if law.W is None else free_of_all for law in laws]


def _has_own_states(plant: UncertainPlant) -> bool:
    """Whether some states are those of a law."""
    return any(name.startswith(OWN) for name in plant.states)


def _root(X: Array) -> Array:
    values, vectors = np.linalg.eigh(X)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 1e-6 * values.max())))


def _cloud(domain: Domain) -> Array:
    """Return points of a domain in its own coordinates: corners, edges, and within."""
    if domain.corners == 1:
        return np.ones((1, 1))
    if domain.corners <= MOST_CORNERS:
        return np.vstack([edges(domain, ON_EDGES), inside(domain, INSIDE)])
    corners = np.array(domain.monomials(1), dtype=float)
    return np.vstack([corners[:MOST_CLOUD], inside(domain, INSIDE)])


def _distinct(reached: Sequence[_Reached]) -> list[_Reached]:
    """Return the best, each of a level of its own."""
    distinct = list[_Reached]()
    for end in sorted(reached, key=attrgetter("rank")):
        alike = distinct and abs(end.level - distinct[-1].level) <= ALIKE * abs(distinct[-1].level)
        if np.isfinite(end.excess) and not alike:
            distinct.append(end)
    return distinct
