"""The smallest radius of a condition: where to start the interior point, and in which coordinates.

The state coordinates decide how far floats carry. Lemma 1 starts in those of a nominal Lyapunov
matrix; the other conditions in those of a rough solution of Lemma 1, which is a point of theirs; a
sweep in those of its neighbour. A run that stalls goes on in the coordinates it has reached.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.conditions.linear import Variable
from polefence.conditions.methods import Method
from polefence.errors import SolverError
from polefence.plant.system import Array
from polefence.solve.engine import run
from polefence.solve.found import Dual, Found, lyapunov_mean
from polefence.solve.layout import stacked_pencil
from polefence.solve.nominal import common_point, nominal_start
from polefence.solve.scaling import Scaling, balanced
from polefence.solve.smallest import TOLERANCE, WIDE, Outcome
from polefence.solve.stacked import Stacked

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
    """Find the least radius at which the condition is feasible.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    sigma : float
        The centre is -sigma [1/s].
    method : str or Scheduled
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
    enough = max(enough, FLOOR * sigma)
    search = _Search(A, B, sigma, method, balanced(A, B, sigma), enough, engine)
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


@dataclass(frozen=True, eq=False)
class _Search:
    A: Array
    B: Array
    sigma: float
    method: Method
    plain: Scaling
    enough: float
    engine: str | None

    def first(self) -> Found:
        """Return a nominal design, or a rough solution of Lemma 1 where that is a start."""
        if self.method == "quadratic":
            start = nominal_start(self.A, self.B, self.sigma, self.plain)
            return Found(start.radius, {"W": start.W, "Z": start.K @ start.W})
        lemma_1 = replace(self, method="quadratic", enough=FLOOR * self.sigma)
        nominal = lemma_1.first()
        return lemma_1.run(nominal, WIDE, ROUGH) or nominal

    def run(self, start: Found, wide: float, tolerance: float = TOLERANCE) -> Found | None:
        """Run from a point, in the coordinates of its Lyapunov matrix; None if it is no start."""
        scaling = self._coordinates(start)
        A, B = scaling.apply(self.A, self.B)
        s = self.sigma / scaling.rate
        pencil, stacked = stacked_pencil(self.method, A, B, s, scaling.unit)
        start = replace(start, radius=max(start.radius, FLOOR * self.sigma))
        x = pencil.pack(self._scaled(start, scaling, pencil.variables, wide))
        outcome = self._outcome(stacked, x, wide * start.radius / scaling.rate, scaling, tolerance)
        if outcome is None:
            return None
        return Found(
            scaling.rate * outcome.r,
            scaling.restore(pencil.unpack(outcome.x), pencil.variables),
            _dual(outcome, stacked, scaling),
            outcome.converged,
            outcome.iterations,
        )

    def _outcome(
        self, stacked: Stacked, x: Array, r: float, scaling: Scaling, tolerance: float
    ) -> Outcome | None:
        for _ in range(WIDENINGS):
            try:
                outcome = run(stacked, x, r, self.enough / scaling.rate, tolerance, self.engine)
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


def _dual(outcome: Outcome, stacked: Stacked, scaling: Scaling) -> Dual:
    """Sort the duals of the disk blocks, the largest, as the pencil has them."""
    Y = outcome.Y[-1]
    return Dual(Y[np.argsort(stacked.sequence[-len(Y) :])], scaling.T)
