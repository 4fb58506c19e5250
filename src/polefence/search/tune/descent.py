"""Sequential quadratic programming for the largest of many functions, within limits on others.

What is minimised is max f subject to h <= 0, through the exact penalty max f + rho max(0, h). All
rows are known with their slopes, so that kinks between them are met as corners of a quadratic
program, within a reach that adapts; curvature is BFGS's, of the rows that are active. Where a step
leads higher, what is high there was missed: its rows are kept as cuts, as bundle methods keep them
(Apkarian, Noll & Prot, 2008). A point at which nothing can be evaluated counts as infinitely bad.

Steps that are worth little say nothing of the distance to a minimum: BFGS takes a flat valley for a
steep one until it has gone along it. Where they stall the curvature is measured, by differences of
slopes, and the search ends where a step by that is worth nothing either.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from polefence.base.effort import ended as effort_ended
from polefence.base.progress import note, stage
from polefence.plant.system import Array
from polefence.search.tune.quadratic import Program

T = TypeVar("T")

ENOUGH = 1e-8  # of a decrease that is foreseen
LEAST, BAD, GOOD = 1e-3, 0.3, 0.7  # shares of what is foreseen: taken, less reach, more reach
STALL = 8  # steps taken that must be worth it
PENALTY, MOST_PENALTY = 10.0, 1e7
FIRST = 0.3  # length of the first step, of a point's own size
# Rows of a point that were missed, such points, and how far they are kept, in steps. They are for
# measures of which the highest alone is known: of 15 searches that know all, on random plants and a
# car, none changes by more than 3e-7 without them. One has a radius 10 % larger with every row kept
# from everywhere.
MISSED, CUTS, ALONG = 8, 6, 4.0
ACTIVE = 1e-7  # of a multiplier
FEASIBLE = 1e-6  # by how much what is to be kept may be exceeded at the end
# Of differences of slopes, of a number's own size; and of curvatures, of the largest: flatter is
# taken for that. From 14 starts of a car whose valleys are that flat 10 to 12 end at its minimum
# with 1e-3 to 1e-5 and 1e-8 to 1e-12; without a measurement none did.
DIFFERENCE, FLATTEST = 1e-4, 1e-10


@dataclass(frozen=True)
class Effort:
    """How long a search goes on.

    Attributes
    ----------
    steps : int
        At most.
    worth : float
        The decrease that a few of them must be worth.
    rest : float
        The decrease that a measured curvature may foresee at the end; infinite: none is measured.
    """

    steps: int
    worth: float
    rest: float = np.inf


# With 300 steps searches of the van's law of order 2 ended at levels from 0.77545 to 0.77618, on
# three kinds of processors; with 600 from 0.77543 to 0.77553.
FULL, EARLY, QUICK = Effort(600, 1e-6, 1e-5), Effort(60, 1e-4), Effort(15, 1e-3)
ROUGH = Effort(100, 1e-2, 1e-2)  # for what is only to be small
PATIENT = Effort(200, 1e-6)  # for smooth functions of which the very end matters


@dataclass(frozen=True, eq=False)
class Rows:
    """Functions at one point, with slopes.

    Attributes
    ----------
    values : (rows,) array
    slopes : (rows, n) array
    groups : (rows,) array of int
        Rows of one group are taken for the same function in any order: peaks, poles.
    objective : (rows,) array of bool
        Whether it is one of those whose largest is minimised; else it is to be zero at most.
    """

    values: Array
    slopes: Array
    groups: Any
    objective: Any

    @property
    def finite(self) -> bool:
        """Whether all values and slopes are finite."""
        return bool(np.all(np.isfinite(self.values)) and np.all(np.isfinite(self.slopes)))

    @cached_property
    def level(self) -> float:
        """The largest of what is minimised."""
        return float(self.values[self.objective].max())

    @cached_property
    def excess(self) -> float:
        """The largest of the others; what is above zero is not kept."""
        return float(self.values[~self.objective].max(initial=-np.inf))


Evaluate = Callable[[Array], Rows | None]
# Asks for the rows at a point or for the minimum of a program, and is sent them.
Asking = Generator[Array | Program, Any, T]
Descent = Asking[tuple[Array, Rows] | None]  # returns the minimum with its rows
Cut = tuple[Array, Rows]  # where, and what is high there


@stage("search")
def descend(
    evaluate: Evaluate,
    theta: Array,
    target: float = -np.inf,
    effort: Effort = FULL,
    penalty: float = PENALTY,
) -> tuple[Array, Rows] | None:
    """Return what `descent` finds."""

    def answer(question: Array | Program) -> Any:
        return question.minimum() if isinstance(question, Program) else evaluate(question)

    return answered(descent(theta, target, effort, penalty), answer)


def answered(asking: Generator[Any, Any, T], answer: Callable[[Any], Any]) -> T:
    """Return what comes of a generator whose questions are answered one by one."""
    try:
        question = next(asking)
        while True:
            question = asking.send(answer(question))
    except StopIteration as done:
        found: T = done.value
        return found


def descent(
    theta: Array,
    target: float = -np.inf,
    effort: Effort = FULL,
    penalty: float = PENALTY,
) -> Descent:
    """Return a local minimum and the rows there; None where nothing can be evaluated at first.

    A generator: it yields points whose rows it asks for, and programs that it has solved, so that
    several descents may be answered together.

    Parameters
    ----------
    target : float
        Where the level is below it, and all is kept, the search ends.
    penalty : float
        At first, of what is not kept, beside the level.
    """
    here = yield theta
    if here is None:
        return None
    rho, cuts, merits = penalty, list[Cut](), list[float]()
    H, reach, fresh = _first(here, theta), _within(theta), True
    ended, measured = False, np.inf  # the merit where curvature was measured last
    kept = (theta, here)  # the lowest where all is kept, if there is one
    for step in range(effort.steps):
        note(f"step {step + 1}")
        if (here.level <= target and here.excess <= 0) or effort_ended():
            break
        merits = merits or [_merit(here, rho)]
        if ended or (len(merits) > STALL and merits[-1 - STALL] - merits[-1] < effort.worth):
            merit, reach = _merit(here, rho), _within(theta)
            if here.excess > FEASIBLE and rho < MOST_PENALTY:
                rho, merits, ended, measured = min(100 * rho, MOST_PENALTY), [], False, np.inf
                continue
            if not (np.isfinite(effort.rest) and measured - merit > effort.worth):
                break
            _, z, _, _ = yield from _direction(here, here.values, H, rho, reach)
            anew = yield from _measured(theta, here, z)
            if anew is None:
                break
            _, _, _, foreseen = yield from _direction(here, here.values, anew, rho, reach)
            if not foreseen > effort.rest:
                break
            H, fresh, cuts, merits, measured = anew, False, [], [merit], merit
        known = _with(here, theta, cuts)
        d, z, rho, foreseen = yield from _direction(known, known.values, H, rho, reach)
        if not foreseen > ENOUGH:  # beside rows from afar; a shorter step may not meet them
            ended, cuts = not cuts, []
            continue
        length = float(np.abs(d).max())
        there, lower, share = yield from _tried(theta, here, d, (H, rho, reach, foreseen))
        if lower is None:
            reach = length / 3.0
            shortest = 1e-9 * max(1.0, float(np.abs(theta).max()))
            ended = reach < shortest or foreseen < effort.worth / STALL
            if there is not None:
                cuts = [*cuts, (theta + d, _high(here, there))][-CUTS:]
            continue
        after, there = lower
        if share < BAD:
            reach = length / 2
        elif share > GOOD and length > 0.9 * reach:
            reach *= 2.5
        z = _shared(here, known, z)
        H = _updated(H, after - theta, _turn(here, there, after - theta, z), fresh)
        cuts = [cut for cut in cuts if np.abs(cut[0] - after).max() <= ALONG * length]
        theta, here, fresh = after, there, False
        if here.excess <= FEASIBLE and (kept[1].excess > FEASIBLE or here.level < kept[1].level):
            kept = theta, here
        merits.append(_merit(here, rho))
    # Steps go a little beyond limits, and come back later. A full car's best law was lost by 4e-6.
    return kept if effort_ended() and here.excess > FEASIBLE else (theta, here)


def _within(theta: Array) -> float:
    return FIRST * max(1.0, float(np.abs(theta).max()))


def _high(here: Rows, there: Rows) -> Rows:
    """Return the rows of another point that are higher than the highest is here: those missed."""
    some = np.flatnonzero(there.values >= _top(here, there))
    some = some[np.argsort(-there.values[some], kind="stable")][:MISSED]
    columns = (there.values, there.slopes, there.groups, there.objective)
    return Rows(*(column[some] for column in columns))


def _top(here: Rows, other: Rows) -> Array:
    """Return for each row of another point the highest of its kind here."""
    excess = here.excess if np.isfinite(here.excess) else 0.0
    return np.where(other.objective, here.level, max(excess, 0.0))


def _with(here: Rows, theta: Array, cuts: Sequence[Cut]) -> Rows:
    """Return the rows with those that were missed, as they tell from afar, no higher than here."""
    if not cuts:
        return here
    far = [
        replace(rows, values=np.minimum(rows.values + rows.slopes @ (theta - at), _top(here, rows)))
        for at, rows in cuts
    ]
    columns = ([getattr(rows, f.name) for rows in (here, *far)] for f in fields(Rows))
    return Rows(*(np.concatenate(parts) for parts in columns))


def _shared(here: Rows, known: Rows, z: Array) -> Array:
    """Return the multipliers of the rows here, with those of the missed ones of each group."""
    count = len(here.values)
    multipliers = z[:count].copy()
    for k in np.flatnonzero(z[count:] > 0) + count:
        same = np.flatnonzero(here.groups == known.groups[k])
        if len(same):
            multipliers[same[here.values[same].argmax()]] += z[k]
    return multipliers


def _merit(rows: Rows, rho: float) -> float:
    return rows.level + rho * max(0.0, rows.excess)


def _first(rows: Rows, theta: Array) -> Array:
    """Return the curvature at which the first step is of a modest length."""
    some = rows.objective if rows.excess <= 0 else ~rows.objective
    steepest = rows.slopes[some][rows.values[some].argmax()]
    length = FIRST * max(1.0, float(np.linalg.norm(theta)))
    return max(float(np.linalg.norm(steepest)) / length, 1e-8) * np.eye(len(theta))


def _direction(
    rows: Rows, values: Array, H: Array, rho: float, reach: float
) -> Asking[tuple[Array, Array, float, float]]:
    """Return the quadratic program's step within reach, multipliers, rho and the decrease."""
    some = _within_reach(rows, values, reach)
    n, m = len(H), len(some)
    P = np.zeros((n + 2, n + 2))
    P[:n, :n] = H
    G = np.zeros((m + 1, n + 2))
    G[:m, :n] = rows.slopes[some]
    G[:m, n], G[:m, n + 1] = -1.0 * rows.objective[some], -1.0 * ~rows.objective[some]
    G[m, n + 1] = -1.0
    h = np.append(-values[some], 0.0)
    while True:
        q = np.zeros(n + 2)
        q[n], q[n + 1] = 1.0, rho
        x, z = yield Program(P, q, G, h, reach, n)
        if rows.objective.all() or rho >= MOST_PENALTY:
            break
        if x[n + 1] <= max(1e-7, 0.5 * rows.excess):  # kept, or under way
            break
        if rows.excess > 0 and x[n + 1] >= 0.99 * rows.excess:
            break  # out of reach
        rho *= 10
    multipliers = np.zeros(len(values))
    multipliers[some] = z[:m]
    lower = float(x[n] + rho * max(0.0, x[n + 1]))
    return x[:n], multipliers, rho, _merit(rows, rho) - lower


def _within_reach(rows: Rows, values: Array, reach: float) -> Any:
    """Return the rows that may be active within reach: of a law of 96 numbers a tenth of them."""
    change = reach * np.abs(rows.slopes).sum(axis=1)
    lowest = (values - change)[rows.objective].max()
    return np.flatnonzero(values + change >= np.where(rows.objective, lowest, 0.0))


def _tried(
    theta: Array, here: Rows, d: Array, model: tuple[Array, float, float, float]
) -> Asking[tuple[Rows | None, tuple[Array, Rows] | None, float]]:
    """Return what a step leads to, the point if it is lower, and its share of what was foreseen.

    Where the step itself falls short it is bent once, as the rows are.
    """
    H, rho, reach, foreseen = model
    merit = _merit(here, rho)
    there = yield theta + d
    share = -np.inf if there is None else (merit - _merit(there, rho)) / foreseen
    lower = None if there is None else (theta + d, there)
    if there is not None and share < BAD:
        values = there.values[_again(here, there, d)] - here.slopes @ d
        bent, _, _, _ = yield from _direction(here, values, H, rho, reach)
        again = yield theta + bent
        if again is not None and (merit - _merit(again, rho)) / foreseen > share:
            share = (merit - _merit(again, rho)) / foreseen
            lower = theta + bent, again
    return there, (lower if share > LEAST else None), share


def _measured(theta: Array, here: Rows, z: Array) -> Asking[Array | None]:
    """Return the curvature of the active rows, of saddles its magnitude; None where it has none."""
    turns = []
    for step in np.diag(DIFFERENCE * np.maximum(np.abs(theta), 1.0)):
        there = yield theta + step
        turn = None if there is None else _turn(here, there, step, z)
        if turn is None:
            return None
        turns.append(turn / step.max())
    values, vectors = np.linalg.eigh(np.array(turns) + np.transpose(turns))
    size = np.abs(values) / 2
    return np.asarray((vectors * np.maximum(size, FLATTEST * size.max())) @ vectors.T)


def _turn(here: Rows, there: Rows, s: Array, z: Array) -> Array | None:
    """Return by how much the slopes of the active rows turned, each found again in its group."""
    active = np.flatnonzero(z > ACTIVE * z.sum())
    both = here.groups[active, None] == there.groups[None, :]
    if not np.all(both.any(axis=1)):
        return None
    mean = (here.slopes[active] @ s)[:, None] / 2 + (there.slopes @ s)[None, :] / 2
    miss = np.abs(there.values[None, :] - here.values[active, None] - mean)
    again = np.where(both, miss, np.inf).argmin(axis=1)
    return np.asarray(z[active] @ (there.slopes[again] - here.slopes[active]))


def _again(here: Rows, there: Rows, d: Array) -> Any:
    """Return which row after a step is each of those before it, of those of its group."""
    other = here.groups[:, None] != there.groups[None, :]
    foreseen = (here.values + here.slopes @ d)[:, None]
    return np.where(other, np.inf, np.abs(there.values[None, :] - foreseen)).argmin(axis=1)


def _updated(H: Array, s: Array, y: Array | None, fresh: bool) -> Array:
    """Return the curvature after a step, damped as Powell has it."""
    if y is None:
        return H
    if fresh and (y @ s) > 1e-8 * np.linalg.norm(y) * np.linalg.norm(s):
        H = max(float(y @ y) / float(y @ s), 1e-8) * np.eye(len(H))
    Hs = H @ s
    size = float(s @ Hs)
    if not size > 0:
        return H
    curvature = float(s @ y)
    if curvature < 0.2 * size:
        y = Hs + 0.8 * size / (size - curvature) * (y - Hs)
    return np.asarray(H - np.outer(Hs, Hs) / size + np.outer(y, y) / float(s @ y))
