"""Linear-quadratic regulators for weighted sums of mean squares, and the weights that cost most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.base.errors import SolverError
from polefence.plant.system import Array

LEAST = 1e-7  # of a weight, of their sum: without any the control may be free
CLOSE = 1e-7  # to the largest value, at which the search ends
ROUNDS = 60
REACH = 4.0  # times a weight or a share of it, from one round to the next
TINY = 1e-11  # of the loop's norm: a pole nearer to the imaginary axis is on it


@dataclass(frozen=True, eq=False)
class Regulated:
    """Arrays A, B, E of a plant, and C, D of its outputs, each over the limit on its rms."""

    A: Array
    B: Array
    E: Array
    C: Array
    D: Array

    def riccati(self, weights: Array, decay: float = 0.0, less: Array | None = None) -> Array:
        """Return P of the regulator, for the plant with this much more decay, less so much cost.

        Raises
        ------
        SolverError
            If there is none.
        """
        from scipy.linalg import solve_continuous_are

        A = self.A - decay * np.eye(len(self.A))
        root = np.sqrt(weights)[:, None]
        C, D = root * self.C, root * self.D
        Q = C.T @ C if less is None else C.T @ C - less
        try:
            with np.errstate(all="ignore"):
                P = solve_continuous_are(A, self.B, Q, D.T @ D, s=C.T @ D)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise SolverError(f"no regulator: {error}") from error
        if not np.isfinite(P).all():
            raise SolverError("no regulator: its matrix is not finite")
        return np.asarray((P + P.T) / 2)

    def cost(self, P: Array) -> float:
        """Return the least sum of the outputs' mean squares that P stands for."""
        return float(np.trace(self.E.T @ P @ self.E))

    def mean_squares(self, weights: Array, P: Array) -> Array:
        """Return those of the outputs under the regulator.

        Raises
        ------
        SolverError
            If its loop is not stable.
        """
        from scipy.linalg import solve_continuous_lyapunov

        D = weights[:, None] * self.D
        K = -np.linalg.solve(self.D.T @ D, self.B.T @ P + D.T @ self.C)
        loop = self.A + self.B @ K
        poles = np.linalg.eigvals(loop)
        if poles.real.max() >= -TINY * np.linalg.norm(loop):
            raise SolverError("the regulator leaves a pole on the imaginary axis")
        X = solve_continuous_lyapunov(loop, -self.E @ self.E.T)
        Y = self.C + self.D @ K
        return np.asarray(np.maximum(np.einsum("ij,jk,ik->i", Y, X, Y), 0.0))


def heaviest(plant: Regulated, decay: float) -> tuple[Array, float]:
    """Return the weights of sum 1 for which the regulator costs most, and how much; 0 if nothing.

    The cost is concave in the weights and its slopes are the mean squares: cutting planes, each an
    upper bound everywhere, within a factor of the best weights so far.
    """
    count, reach = len(plant.C), REACH
    slower = replace(plant, A=plant.A - decay * np.eye(len(plant.A)))
    weights = best = np.full(count, 1 / count)
    most, cuts = 0.0, list[Array]()
    for _ in range(ROUNDS):
        try:
            P = slower.riccati(weights)
            value, slopes = slower.cost(P), slower.mean_squares(weights, P)
        except (SolverError, np.linalg.LinAlgError):
            reach = np.sqrt(reach)
        else:
            cuts.append(slopes)
            if value > most:
                best, most = weights, value
        if most <= 0:
            break
        weights, bound = _highest(np.array(cuts) / most, best, reach)
        if not bound > 1 + CLOSE:
            break
    return best, most


def _highest(cuts: Array, centre: Array, reach: float) -> tuple[Array, float]:
    """Return the weights of the largest t with t <= cuts @ weights, and t; 0 if not found."""
    from scipy.optimize import linprog

    count = len(centre)
    bounds = [(max(LEAST, x / reach), min(1.0, x * reach)) for x in centre]
    found = linprog(
        np.append(np.zeros(count), -1.0),
        np.hstack([-cuts, np.ones((len(cuts), 1))]),
        np.zeros(len(cuts)),
        np.append(np.ones(count), 0.0)[None],
        [1.0],
        [*bounds, (None, None)],
    )
    if not found.success or found.x is None:
        return centre, 0.0
    return np.asarray(found.x[:-1]), float(found.x[-1])
