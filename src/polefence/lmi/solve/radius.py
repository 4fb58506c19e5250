"""The least r of a condition: where to start the interior point, and in which coordinates.

The state coordinates decide how far floats carry. Lemma 1 starts in those of a nominal Lyapunov
matrix; the other conditions in those of a rough solution of Lemma 1, which is a point of theirs; a
sweep in those of its neighbour. A run that stalls goes on in the coordinates it has reached.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.linear import Variable
from polefence.lmi.conditions.methods import Method, normal
from polefence.lmi.conditions.target import Disks, Goal
from polefence.lmi.solve.engine import run
from polefence.lmi.solve.layout import stacked_pencil
from polefence.lmi.solve.nominal import common_point, nominal_start
from polefence.lmi.solve.point import Dual, Found, lyapunov_mean
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.smallest import TOLERANCE, WIDE, Outcome
from polefence.lmi.solve.stacked import Stacked
from polefence.plant.system import Array

ROUGH = 1e-2  # Lemma 1 as a start is run until its gap is this share of its radius
CLOSE = 1.1  # the first r over the radius of a point that a neighbour or a stalled run left
FLOOR = 1e-4  # a radius of this share of sigma is as good as zero
ROUNDS = 4
WIDENINGS = 12  # of a radius that turned out not to be interior, each by half


def smallest_radius(
    A: Array,
    B: Array,
    sigma: float,
    method: Method,
    near: Found | None = None,
    enough: float = 0.0,
    engine: str | None = None,
    tolerance: float = TOLERANCE,
) -> Found:
    """Find the least radius at which the condition is feasible, for disks about -sigma.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    sigma : float
        The centre is -sigma [1/s].
    method : str, Scheduled or Slack
    near : Found, optional
        The same condition's answer for a neighbouring centre, to start from.
    enough : float
        Stop at the first radius found that is no larger; at 1e-4 sigma it stops in any case.
    engine : str, optional
        "compiled" or "numpy"; by default the compiled one where there is one.
    tolerance : float
        Of the gap, relative to the radius.

    Raises
    ------
    SolverError
        If there is no point to start from in floats.
    """
    return smallest(A, B, Disks(-sigma), method, near, enough, engine, tolerance)


def smallest(
    A: Array,
    B: Array,
    goal: Goal,
    method: Method,
    near: Found | None = None,
    enough: float = 0.0,
    engine: str | None = None,
    tolerance: float = TOLERANCE,
) -> Found:
    """Find the least r at which the condition is feasible, whatever grows with r.

    Parameters as for `smallest_radius`; ``near`` is a point of the condition without which a goal
    may have no start (a sector's needs a stable one).

    Raises
    ------
    SolverError
        If there is no point to start from in floats.
    """
    scale = goal.scale or typical_rate(A)
    search = _Search(A, B, goal, scale, method, balanced(A, B, scale), enough, engine)
    enough = search.floor
    best, wide = (search.first(), WIDE) if near is None else (near, CLOSE)
    found = None
    for _ in range(ROUNDS):
        again = search.run(best, wide, tolerance)
        if again is None or (found is not None and again.radius >= found.radius):
            break
        iterations = again.iterations + (found.iterations if found else 0)
        found = best = replace(again, iterations=iterations)
        if found.converged or found.radius <= enough:
            break
        wide = CLOSE
    if found is None:
        raise SolverError("no point to start from: the numbers are too far apart for doubles")
    return found


def typical_rate(A: Array) -> float:
    """Return a rate typical of the plant: the geometric mean of its modes' [1/s]."""
    modes = np.abs(np.linalg.eigvals(A.mean(axis=0)))
    modes = modes[modes > 1e-6 * modes.max(initial=0.0)]
    return float(np.exp(np.log(modes).mean())) if modes.size else 1.0


@dataclass(frozen=True, eq=False)
class _Search:
    A: Array
    B: Array
    goal: Goal
    scale: float
    method: Method
    plain: Scaling
    enough: float
    engine: str | None

    @property
    def floor(self) -> float:
        """Least r that is worth reaching."""
        return max(self.enough, FLOOR * (self.scale if self.goal.rated else 1.0))

    def first(self) -> Found:
        """Return a nominal design, or a rough solution of Lemma 1 where that is a start."""
        if not isinstance(self.goal, Disks):
            # of disks about a centre typical of the region; r is found out when it is run
            own = Disks(-self.scale)
            return replace(replace(self, goal=own).first(), radius=0.0)
        if normal(self.method) == "quadratic":
            start = nominal_start(self.A, self.B, -self.goal.centre, self.plain, self.scale)
            return Found(start.radius, {"W": start.W, "Z": start.K @ start.W})
        lemma_1 = replace(self, method="quadratic", enough=0.0)
        nominal = lemma_1.first()
        return lemma_1.run(nominal, WIDE, ROUGH) or nominal

    def run(self, start: Found, wide: float, tolerance: float = TOLERANCE) -> Found | None:
        """Run from a point, in the coordinates of its Lyapunov matrix; None if it is no start."""
        scaling = self._coordinates(start)
        unit = scaling.rate if self.goal.rated else 1.0
        A, B = scaling.apply(self.A, self.B)
        target = self.goal.target(scaling.rate)
        pencil, stacked = stacked_pencil(self.method, A, B, target, scaling.unit)
        radius = max(start.radius, FLOOR * unit * self.scale / scaling.rate)
        values = self._scaled(replace(start, radius=radius), scaling, pencil.variables, wide)
        x = pencil.pack(values)
        r = wide * radius / unit
        if not isinstance(self.goal, Disks):
            r = max(r, first_radius(stacked, x))
            if not np.isfinite(r):
                return None
        outcome = self._outcome(stacked, x, r, unit, tolerance)
        if outcome is None:
            return None
        return Found(
            unit * outcome.r,
            scaling.restore(pencil.unpack(outcome.x), pencil.variables),
            _dual(outcome, stacked, scaling) if isinstance(self.goal, Disks) else None,
            outcome.converged,
            outcome.iterations,
            scaling.rate,
        )

    def _outcome(
        self, stacked: Stacked, x: Array, r: float, unit: float, tolerance: float
    ) -> Outcome | None:
        for _ in range(WIDENINGS):
            try:
                outcome = run(stacked, x, r, self.floor / unit, tolerance, self.engine)
            except np.linalg.LinAlgError:
                r *= 1.5
            except MemoryError as error:
                raise SolverError("more inequalities than there is memory for") from error
            else:
                sound = np.isfinite(outcome.r) and np.all(np.isfinite(outcome.x))
                return outcome if sound else None
        return None

    def _coordinates(self, start: Found) -> Scaling:
        try:
            return self.plain.refined(lyapunov_mean(start.values))
        except SolverError:
            return self.plain

    def _scaled(
        self, start: Found, scaling: Scaling, variables: tuple[Variable, ...], wide: float
    ) -> dict[str, Array]:
        values = start.values
        if any(v.name not in values for v in variables):
            values = common_point(values["W"], values["Z"], variables) | values
        scaled = scaling.scaled(values, variables)
        if "tau" in scaled and "tau" not in start.values:
            # a tenth of what the blocks have to spare
            spare = (wide - 1) * start.radius / scaling.rate
            scaled["tau"] = np.array([[0.1 * spare / np.linalg.norm(scaling.unit, 2)]])
        return scaled


def first_radius(stacked: Stacked, x: Array) -> float:
    """Return an r at which x is interior, within a factor of about two of the least; inf if none.

    D(x) >= 0, so that r D(x) - M(x) only grows with r.
    """
    blocks = stacked.at(x)
    for r in 2.0 ** np.arange(-14, 60):
        try:
            for D, M in blocks:
                np.linalg.cholesky(r * D - M)
        except np.linalg.LinAlgError:
            continue
        return float(r)
    return float("inf")


def _dual(outcome: Outcome, stacked: Stacked, scaling: Scaling) -> Dual:
    """Sort the duals of the disk blocks, the largest, as the pencil has them."""
    Y = outcome.Y[-1]
    return Dual(Y[np.argsort(stacked.sequence[-len(Y) :])], scaling.T)
