"""The least bound on a signal that a law of a degree keeps, beside a region and other bounds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.gain_norm import Norm, tangents
from polefence.lmi.conditions.methods import design
from polefence.lmi.conditions.pencil import Pencil, Variable
from polefence.lmi.conditions.performance import Demands, Output, Source, Through, unit_of
from polefence.lmi.conditions.saturation import HELD
from polefence.lmi.conditions.target import Target, fixed
from polefence.lmi.solve.assembly import stacked_design
from polefence.lmi.solve.interior_point import TOLERANCE, WIDE
from polefence.lmi.solve.scaling import Scaling
from polefence.lmi.solve.search import (
    Reached,
    attempt,
    coefficients,
    interior,
    lyapunov_mean,
    rounds,
)
from polefence.lmi.solve.stacked import Stacked, stack
from polefence.plant.motion import STILL, Motion
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import Region, stable

# Bounds on the law are tight near the last point only, and a point at the edge of all others hardly
# moves: each round stops at a share of the gap, less when a round is worth no more than this.
NORM_ROUNDS, SHARES, WORTH = 30, (0.3, 0.03, 1e-3, 1e-5), (0.03, 3e-3, 1e-4, 1e-5)

Bounds = tuple[tuple[Output, ...], tuple[Norm, ...]]


@dataclass(frozen=True, eq=False)
class Problem:
    """Region and bounds that are asked of a family, and the form of the law.

    Attributes
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    sources : tuple of Source
    outputs : tuple of Output
    region : Region, optional
    domain : Domain
    degree, elevation : int
    norms : tuple of Norm
        Bounds on the law itself.
    step : float
        Of a delta form [s]; zero in continuous time.
    motion : Motion
        Of the parameters.
    """

    A: Array
    B: Array
    sources: tuple[Source, ...]
    outputs: tuple[Output, ...]
    region: Region | None
    domain: Domain
    degree: int
    elevation: int
    norms: tuple[Norm, ...] = ()
    step: float = 0.0
    motion: Motion = STILL

    def pencil(
        self,
        scaling: Scaling,
        outputs: tuple[Output, ...],
        norms: tuple[Norm, ...],
        values: dict[str, Array],
        tangent: int = 0,
    ) -> tuple[Pencil, Stacked]:
        """Return the condition in other coordinates; bounds on the law are tight near ``values``.

        Of the pencil only the variables may be used.

        ``tangent`` numbers those of `polefence.lmi.conditions.gain_norm.tangents`.
        """
        A, B = scaling.apply(self.A, self.B)
        inverse = np.asarray(np.linalg.inv(scaling.T), dtype=float)
        sources = tuple(s.changed(inverse, scaling.rate) for s in self.sources)
        changed = tuple(o.changed(scaling.T, scaling.S) for o in outputs)
        region = self.region
        if region is None and not sources:  # nothing else asks for stability
            region = stable(self.step)
        motion = self.motion.changed(scaling.rate)
        target = Target(fixed(region, scaling.rate), positive=not sources, motion=motion)
        W = np.stack([values[f"W{k + 1}"] for k in range(self.domain.count(self.degree))])
        near = inverse @ W @ inverse.T
        scaled = [norm.changed(scaling.T, scaling.S) for norm in norms]
        tight = [(norm, tangents(norm, near)[tangent]) for norm in scaled]
        step = self.step * scaling.rate
        # the first inequality with a margin of 1e-7 of the search's own rate
        demands = Demands(target, sources, changed, tuple(tight), 1e-7, step)
        form = self.domain, self.degree, self.elevation
        held = any(output.held for output in outputs)
        if not norms and not step and not motion and not held:
            return stacked_design(A, B, demands, *form)
        pencil = design(A, B, demands, *form)
        return pencil, stack(pencil)


def least(
    problem: Problem,
    start: dict[str, Array],
    scaling: Scaling,
    tolerance: float = TOLERANCE,
    t: dict[str, float] | None = None,
) -> Reached:
    """Minimise the one output's bound that is not fixed, from a point within the region.

    Parameters
    ----------
    start : dict
        W and Z of the condition's degree, for which all poles lie in the region, in the original
        coordinates.
    t : dict, optional
        Of a start that keeps the fixed bounds: W / t is the Lyapunov matrix of a source.

    Raises
    ------
    SolverError
        If there is no point to start from, or none that keeps the fixed bounds.
    """
    units = {f"t {source.name}": unit_of(source, scaling.rate) for source in problem.sources}
    t = {name: value * units[name] for name, value in (t or {}).items() if name in units}
    begin = Reached(r=np.inf, values=dict(start), t=t)
    outputs, norms = problem.outputs, problem.norms
    fixed_ones = [bound.fixed for bound in outputs] + [norm.fixed for norm in norms]
    reached: Reached | None = None
    if not all(fixed_ones) and (t or not any(fixed_ones)):
        with suppress(SolverError):
            reached = _Stage(problem, scaling, (outputs, norms), tolerance).run(begin)
    if reached is None:
        reached = _within(problem, begin, scaling, tolerance)
        if not all(fixed_ones):
            reached = _Stage(problem, scaling, (outputs, norms), tolerance).run(reached)
    return replace(reached, t={name: value / units[name] for name, value in reached.t.items()})


def _within(problem: Problem, begin: Reached, scaling: Scaling, tolerance: float) -> Reached:
    """Return a point that keeps the fixed bounds, by shrinking them with r to their values.

    What is to be minimised must not run away meanwhile: at first it grows with them.
    """
    outputs = tuple(replace(o, fixed=False) for o in problem.outputs if o.fixed)
    norms = tuple(replace(norm, fixed=False) for norm in problem.norms if norm.fixed)
    failure = SolverError("no law was found that keeps the limits and the region")
    for bounds in (*_watched(problem, begin, scaling, outputs, norms), (outputs, norms)):
        try:
            # 3 % within the limits' squares
            reached = _Stage(problem, scaling, bounds, tolerance, 0.97).run(begin)
        except SolverError as error:
            failure = error
            continue
        if reached.r < 1:
            return reached
    raise failure


def _watched(
    problem: Problem,
    begin: Reached,
    scaling: Scaling,
    outputs: tuple[Output, ...],
    norms: tuple[Norm, ...],
) -> Iterator[Bounds]:
    """Yield the bounds plus one on the minimised output, some way above its start."""
    more = tuple(o for o in problem.outputs if not o.fixed)
    if not more:
        return
    power = 0.5 if not isinstance(_source(problem, more[0]), Through) else 1.0
    if power == 0.5 and outputs and not norms:
        share = _size(begin, more) / (_size(begin, outputs) or 1.0)
    else:
        share = _share_of(problem, begin, scaling, (outputs, norms), more)
    # room of what is minimised while the limits are not kept yet
    for room in (1e3, 1e8) if np.isfinite(share) and share > 0 else ():
        level = more[0].level * (room * share) ** power
        yield (*outputs, replace(more[0], level=level)), norms


def _size(begin: Reached, outputs: tuple[Output, ...]) -> float:
    """Return the largest Y W^-1 Y' over the level's square, at the vertices."""
    W, Z = (coefficients(begin.values, name).mean(axis=0) for name in "WZ")
    largest = 0.0
    for output in outputs:
        Y = (output.C @ W + output.D @ Z) / output.level
        with suppress(np.linalg.LinAlgError):
            squares = np.einsum(
                "vij,vij->v", Y, np.linalg.solve(W, Y.swapaxes(1, 2)).swapaxes(1, 2)
            )
            largest = max(largest, float(squares.max()))
    return largest


def _share_of(
    problem: Problem,
    begin: Reached,
    scaling: Scaling,
    bounds: Bounds,
    more: tuple[Output, ...],
) -> float:
    """Return the initial r of the minimised output over that of the limits; else zero."""
    try:
        refined = scaling.refined(lyapunov_mean(begin.values))
    except SolverError:
        return 0.0
    first = []
    for kept in (bounds, (more, ())):
        pencil, stacked = problem.pencil(refined, *kept, begin.values)
        matrices = tuple(v for v in pencil.variables if v.rows)
        values = refined.scaled(_with_held(begin.values, matrices), matrices)
        first.append(interior(pencil, stacked, values, begin.t)[1])
    return first[1] / first[0] if all(first) else 0.0


def _with_held(values: dict[str, Array], variables: tuple[Variable, ...]) -> dict[str, Array]:
    """Return values with starts of the saturated inputs: they begin unsaturated."""
    held = (v.name for v in variables if v.name[0] == HELD and v.name not in values)
    return values | {name: values[f"Z{name.rpartition('.')[2]}"] for name in held}


def _source(problem: Problem, output: Output) -> Source:
    return next(source for source in problem.sources if source.name == output.source)


@dataclass(frozen=True, eq=False)
class _Stage:
    """A search of which only the bounds change: until r is ``enough`` or the gap is closed."""

    problem: Problem
    scaling: Scaling
    bounds: Bounds
    tolerance: float
    enough: float = 0.0

    def run(self, begin: Reached) -> Reached:
        """Return the point that was reached.

        Raises
        ------
        SolverError
            If there is no point to start from.
        """
        if self.bounds[1]:
            reached = self._near_norms(begin)
        else:
            reached = rounds(lambda last: self._once(last or begin, self.tolerance), self.enough)
        if reached is None:
            raise SolverError("no point to start from: the numbers are too far apart for doubles")
        return reached

    def _near_norms(self, begin: Reached) -> Reached | None:
        """Go from tangent to tangent, centred at first."""
        best: Reached | None = None
        iterations, stage = 0, 0
        for _ in range(NORM_ROUNDS):
            again = self._once(begin, max(SHARES[stage], self.tolerance))
            worth = again is not None and (best is None or again.r < best.r * (1 - WORTH[stage]))
            if again is not None and (best is None or again.r < best.r):
                iterations += again.iterations
                best = begin = again
                if best.r <= self.enough:
                    break
            if not worth:
                stage += 1
                if stage == len(SHARES):
                    break
        return None if best is None else replace(best, iterations=iterations)

    def _once(self, begin: Reached, tolerance: float) -> Reached | None:
        """Run from a point in the coordinates of its Lyapunov matrix; None if that is no start."""
        try:
            scaling = self.scaling.refined(lyapunov_mean(begin.values))
        except SolverError:
            return None
        for tangent in range(3 if self.bounds[1] else 1):
            condition = self.problem.pencil(scaling, *self.bounds, begin.values, tangent)
            again = _run(condition, begin, scaling, self.enough, tolerance)
            if again is not None:
                return again
        return None


def _run(
    condition: tuple[Pencil, Stacked],
    begin: Reached,
    scaling: Scaling,
    enough: float,
    tolerance: float,
) -> Reached | None:
    pencil, stacked = condition
    matrices = tuple(v for v in pencil.variables if v.rows)
    scalars = [v.name for v in pencil.variables if not v.rows]
    values = _with_held(begin.values, matrices)
    x, r = interior(pencil, stacked, scaling.scaled(values, matrices), begin.t)
    if x is None:
        return None
    outcome = attempt(stacked, x, WIDE * r, enough, tolerance)
    if outcome is None:
        return None
    back = pencil.unpack(outcome.x)
    t = {name: back.pop(name).item() for name in scalars}
    # those of bounds on the law are one again, beside the W that was found
    t = {name: value for name, value in t.items() if name.startswith("t ")}
    size = max(t.values(), default=float(np.abs(back["W1"]).max()))
    values = scaling.restore({k: v / size for k, v in back.items()}, matrices)
    t = {name: value / size for name, value in t.items()}
    return Reached(
        r=outcome.r,
        values=values,
        t=t,
        converged=outcome.converged,
        iterations=outcome.iterations,
        residual=partial(stacked.residual, outcome.x, outcome.r, outcome.Y),
    )
