"""Sequential quadratic programming for the largest of many functions, within limits on others.

What is minimised is max f subject to h <= 0, through the exact penalty max f + rho max(0, h). All
rows are known with their slopes, so that kinks between them are met as corners of a quadratic
program; curvature is BFGS's, of the rows that are active. A point at which nothing can be evaluated
counts as infinitely bad.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.design.tune.quadratic import minimum
from polefence.plant.system import Array

STEPS = 150
ENOUGH = 1e-7  # of a decrease that is foreseen
ARMIJO, HALVINGS = 1e-3, 25
PENALTY, MOST_PENALTY = 10.0, 1e7
FIRST = 0.3  # length of the first step, of a point's own size
ACTIVE = 1e-7  # of a multiplier


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
    def level(self) -> float:
        """The largest of what is minimised."""
        return float(self.values[self.objective].max())

    @property
    def excess(self) -> float:
        """The largest of the others; what is above zero is not kept."""
        return float(self.values[~self.objective].max(initial=-np.inf))


Evaluate = Callable[[Array], Rows | None]


def descend(
    evaluate: Evaluate, theta: Array, target: float = -np.inf, steps: int = STEPS
) -> tuple[Array, Rows] | None:
    """Return a local minimum and the rows there; None where nothing can be evaluated at first.

    Parameters
    ----------
    target : float
        Where the level is below it, and all is kept, the search ends.
    """
    here = evaluate(theta)
    if here is None:
        return None
    H, rho, fresh = _first(here, theta), PENALTY, True
    for _ in range(steps):
        if here.level <= target and here.excess <= 0:
            break
        d, z, rho, foreseen = _direction(here, here.values, H, rho)
        if not foreseen > ENOUGH:
            if fresh:
                break
            H, fresh = _first(here, theta), True
            continue
        found = _line(evaluate, theta, here, d, (H, rho, foreseen))
        if found is None:
            if fresh:
                break
            H, fresh = _first(here, theta), True
            continue
        after, there = found
        H = _updated(H, after - theta, _turn(here, there, after - theta, z), fresh)
        theta, here, fresh = after, there, False
    return theta, here


def _merit(rows: Rows, rho: float) -> float:
    return rows.level + rho * max(0.0, rows.excess)


def _first(rows: Rows, theta: Array) -> Array:
    """Return the curvature at which the first step is of a modest length."""
    some = rows.objective if rows.excess <= 0 else ~rows.objective
    steepest = rows.slopes[some][rows.values[some].argmax()]
    length = FIRST * max(1.0, float(np.linalg.norm(theta)))
    return max(float(np.linalg.norm(steepest)) / length, 1e-8) * np.eye(len(theta))


def _direction(
    rows: Rows, values: Array, H: Array, rho: float
) -> tuple[Array, Array, float, float]:
    """Return the step to the quadratic program's minimum, multipliers, rho and the decrease."""
    n, m = len(H), len(values)
    P = np.zeros((n + 2, n + 2))
    P[:n, :n] = H
    G = np.zeros((m + 1, n + 2))
    G[:m, :n] = rows.slopes
    G[:m, n], G[:m, n + 1] = -1.0 * rows.objective, -1.0 * ~rows.objective
    G[m, n + 1] = -1.0
    size = max(1.0, float(np.abs(values).max()))
    while True:
        q = np.zeros(n + 2)
        q[n], q[n + 1] = 1.0, rho
        x, z = minimum(P, q, G, np.append(-values, 0.0))
        if x[n + 1] <= 1e-7 * size or rho >= MOST_PENALTY or rows.objective.all():
            break
        if rows.excess > 0 and x[n + 1] <= 0.5 * rows.excess:
            break  # it is under way
        rho *= 10
    return x[:n], z[:m], rho, _merit(rows, rho) - float(x[n] + rho * max(0.0, x[n + 1]))


def _line(
    evaluate: Evaluate, theta: Array, here: Rows, d: Array, model: tuple[Array, float, float]
) -> tuple[Array, Rows] | None:
    """Return the first point along d that is lower by enough; once, the step is bent before."""
    H, rho, foreseen = model
    merit, share = _merit(here, rho), 1.0
    for k in range(HALVINGS):
        there = evaluate(theta + share * d)
        if there is not None and _merit(there, rho) <= merit - ARMIJO * share * foreseen:
            return theta + share * d, there
        if k == 0 and there is not None and len(there.values) == len(here.values):
            # rows are curved: the program again with their values at the end of the step
            bent, _, _, _ = _direction(here, there.values - here.slopes @ d, H, rho)
            if np.linalg.norm(bent - d) < np.linalg.norm(d):
                there = evaluate(theta + bent)
                if there is not None and _merit(there, rho) <= merit - ARMIJO * foreseen:
                    return theta + bent, there
        share /= 2
    return None


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
    own = float(s @ y)
    if own < 0.2 * size:
        y = Hs + 0.8 * size / (size - own) * (y - Hs)
    return np.asarray(H - np.outer(Hs, Hs) / size + np.outer(y, y) / float(s @ y))
