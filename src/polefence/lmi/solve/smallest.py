"""The least r of a condition for a law that is sought: where to start, and in which coordinates.

Lemma 1 starts in those of a nominal Lyapunov matrix; the other conditions in those of a rough
solution of Lemma 1, which is a point of theirs; a sweep in those of its neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.methods import Method, normal
from polefence.lmi.conditions.pencil import Variable
from polefence.lmi.conditions.target import Disks, Goal, Patch
from polefence.lmi.solve.assembly import condition
from polefence.lmi.solve.engine import inside
from polefence.lmi.solve.interior_point import TOLERANCE, WIDE, Outcome
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.search import (
    FLOOR,
    Dual,
    Reached,
    Trail,
    attempt,
    common_point,
    lyapunov_mean,
    rounds,
)
from polefence.lmi.solve.stacked import Stacked
from polefence.lmi.solve.starts import nominal_start
from polefence.plant.motion import STILL, Motion
from polefence.plant.system import Array

CLOSE = 1.1  # the first r over the radius of a point that a neighbour left
# Condition of a Lyapunov matrix in the coordinates of its run: at such an end a gap of zero may be
# a matter of the coordinates, and the run is made again in better ones.
FAR = 1e6


def smallest(
    A: Array,
    B: Array,
    goal: Goal,
    method: Method,
    near: Reached | None = None,
    enough: float = 0.0,
    engine: str | None = None,
    tolerance: float = TOLERANCE,
    motion: Motion = STILL,
    patches: tuple[Patch, ...] = (),
    central: bool = False,
) -> Reached:
    """Find the least r at which the condition is feasible: a disk's radius, or what grows with r.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    goal : Goal
        Of disks the radius [1/s] about a centre.
    method : str, Scheduled or Slack
    near : Reached, optional
        The same condition's answer for a neighbouring goal, to start from; a goal may have no start
        without one (a sector's needs a stable one).
    enough : float
        Stop at the first r found that is no larger; of disks at 1e-4 |centre| in any case.
    engine : str, optional
        "compiled" or "numpy"; by default the compiled one where there is one.
    tolerance : float
        Of the gap, relative to r.
    motion : Motion
        Of the parameters, under which half-planes are kept.
    patches : tuple of Patch
        Where the law is given estimates of the parameters; no disks' duals are those of it.
    central : bool
        Whether to end at the analytic centre of ``enough``: one point, on any machine.

    Raises
    ------
    SolverError
        If there is no point to start from in floats.
    """
    scale = goal.scale
    if not scale or goal.is_open:
        scale = max(scale, typical_rate(A))  # an open region may be far slower than the plant
    of_law = enough, engine, motion, patches, central
    search = _Search(A, B, goal, scale, method, balanced(A, B, scale), *of_law)
    first, wide = near, CLOSE
    if first is None:
        first, wide = search.first(), WIDE
    trails = list[Trail]()

    def once(last: Reached | None) -> Reached | None:
        again = search.run(last or first, CLOSE if last else wide, tolerance)
        trails.extend(again.trails if again else ())
        return again

    best = rounds(once, search.floor)
    if best is None:
        raise SolverError("no point to start from: the numbers are too far apart for doubles")
    started = () if near else first.trails
    before = [replace(trail, variables=trails[0].pencil.variables) for trail in started]
    return replace(best, trails=(*trails[::-1], *before))


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
    motion: Motion
    patches: tuple[Patch, ...]
    central: bool

    @property
    def floor(self) -> float:
        """Least r that is worth reaching."""
        return max(self.enough, FLOOR * (self.scale if self.goal.rated else 1.0))

    def first(self) -> Reached:
        """Return a nominal design, or a rough solution of Lemma 1 where that is a start."""
        centre = self.goal.centre_of(self.scale)
        if not self.goal.disks:  # r is found out when it is run
            return replace(replace(self, goal=Disks(centre), patches=()).first(), r=0.0)
        if normal(self.method) == "quadratic":
            start = nominal_start(self.A, self.B, -centre, self.plain, self.scale)
            return Reached(r=start.radius, values={"W": start.W, "Z": start.K @ start.W})
        # below 1 % of sigma W tends to a singular one
        lemma_1 = replace(self, method="quadratic", enough=1e-2 * self.scale)
        nominal = lemma_1.first()
        return lemma_1.run(nominal, WIDE, 1e-2) or nominal  # rough: it is a start

    def run(self, start: Reached, wide: float, tolerance: float = TOLERANCE) -> Reached | None:
        """Run from a point, in the coordinates of its Lyapunov matrix; None if it is no start."""
        scaling = self._coordinates(start)
        unit = scaling.rate if self.goal.rated else 1.0
        A, B = scaling.apply(self.A, self.B)
        target = self.goal.target(scaling.rate).under(self.motion.changed(scaling.rate))
        target = replace(target, patches=self.patches)
        pencil, stacked = condition(self.method, A, B, target, scaling.unit)
        radius = max(start.r, FLOOR * unit * self.scale / scaling.rate)
        values = self._scaled(start.values, radius, scaling, pencil.variables, wide)
        x = pencil.pack(values)
        r = wide * radius / unit
        if not self.goal.disks:
            point = inside(stacked, x, engine=self.engine)
            if point is None:
                return None
            r = max(r, point[1])
        # up to 12 widenings, each by half
        limits = self.floor / unit, tolerance
        outcome = attempt(stacked, x, r, *limits, self.engine, 12, self.central)
        if outcome is None:
            return None
        end = pencil.unpack(outcome.x)
        return Reached(
            r=unit * outcome.r,
            values=scaling.restore(end, pencil.variables),
            dual=dual_of(outcome, stacked, scaling) if self.goal.disks else None,
            converged=outcome.converged and _is_near(lyapunov_mean(end)),
            iterations=outcome.iterations,
            rate=scaling.rate,
            trails=(Trail(unit * outcome.trail[:, 0], outcome.trail[:, 1:], pencil, scaling),),
        )

    def _coordinates(self, start: Reached) -> Scaling:
        try:
            return self.plain.refined(lyapunov_mean(start.values))
        except SolverError:
            return self.plain

    def _scaled(
        self,
        start: dict[str, Array],
        radius: float,
        scaling: Scaling,
        variables: tuple[Variable, ...],
        wide: float,
    ) -> dict[str, Array]:
        values = start
        if any(v.name not in values for v in variables):
            values = common_point(values["W"], values["Z"], variables) | values
        scaled = scaling.scaled(values, variables)
        if "tau" in scaled and "tau" not in start:
            # a tenth of what the blocks have to spare
            spare = (wide - 1) * radius / scaling.rate
            scaled["tau"] = np.array([[0.1 * spare / np.linalg.norm(scaling.unit, 2)]])
        return scaled


def _is_near(W: Array) -> bool:
    """Whether a Lyapunov matrix is well conditioned in its run's coordinates."""
    values = np.linalg.eigvalsh(W)
    return bool(values[-1] < FAR * values[0])


def dual_of(outcome: Outcome, stacked: Stacked, scaling: Scaling) -> Dual:
    """Return the duals of the disk blocks, the largest, as the pencil has them."""
    Y = outcome.Y[-1]
    return Dual(Y[np.argsort(stacked.sequence[-len(Y) :])], scaling.T)
