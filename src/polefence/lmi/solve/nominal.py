"""A first design without any LMI: Riccati gain of the mean plant and its Lyapunov matrix.

It is feasible for all three conditions at some radius, which brackets the smallest one from above,
and its Lyapunov matrix gives coordinates in which the conditions are well conditioned.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from polefence.lmi.conditions.linear import Variable
from polefence.lmi.solve.scaling import Scaling
from polefence.plant.system import Array

# Disks to aim at, as fractions of sigma, and weights of the input, until one has a design.
DOUBLINGS = 7
DESIGNS = ((0.9, 1.0), (1.0, 1.0), (0.9, 1e-4))


@dataclass(frozen=True, eq=False)
class Start:
    """A Lyapunov matrix and gain (original coordinates) that hold at ``radius`` on all vertices."""

    W: Array
    K: Array
    radius: float

    def values(self, variables: tuple[Variable, ...]) -> dict[str, Array]:
        """Return the point as values of a condition's variables."""
        return common_point(self.W, self.K @ self.W, variables)


def common_point(W: Array, Z: Array, variables: tuple[Variable, ...]) -> dict[str, Array]:
    """Return a point of Lemma 1 as a point of any condition: W for every Lyapunov matrix and G."""
    table = {"W": W, "P": W, "G": W, "Z": Z, "L": Z}
    tiny = np.array([[1e-12 * float(np.linalg.eigvalsh(W)[0])]])
    return {v.name: table.get(v.name[0], tiny) for v in variables}


def reachability(A: Array, B: Array, sigma: float, scaling: Scaling) -> Array:
    """Return the reachability Gramian of the mean plant on a disk that is stable by itself."""
    import scipy.linalg as la  # deferred: slow to import

    As, Bs = scaling.apply(A, B)
    F, H = As.mean(axis=0) + sigma / scaling.rate * np.eye(A.shape[1]), Bs.mean(axis=0)
    radius = 2 * max(float(np.abs(np.linalg.eigvals(F)).max()), np.finfo(float).tiny)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # these coordinates are tried last, and judged by the margin
        W = la.solve_discrete_lyapunov(F / radius, H @ H.T / radius**2)
    return np.asarray(scaling.T @ (W + W.T) / 2 @ scaling.T.T)


def nominal_start(
    A: Array, B: Array, sigma: float, scaling: Scaling, size: float | None = None
) -> Start:
    """Return a nominal design and the radius at which it holds on all vertices.

    It aims at radii of about ``size``, by default sigma.
    """
    As, Bs = scaling.apply(A, B)
    s = sigma / scaling.rate
    aim = (sigma if size is None else size) / scaling.rate
    n, m = Bs.shape[1:]
    T = scaling.T
    for fraction, weight in DESIGNS:
        F = (As.mean(axis=0) + s * np.eye(n)) / (fraction * aim)
        H = Bs.mean(axis=0) / (fraction * aim)
        design = _riccati(F, H, weight)
        radius = np.inf if design is None else _reach(As, Bs, s, *design)
        if design is not None and np.isfinite(radius):
            W, K = design
            K = scaling.S @ np.linalg.solve(T.T, K.T).T
            return Start(T @ W @ T.T, K, scaling.rate * radius)
    # Without control W = I holds at some radius: a start that never fails.
    W, K = np.eye(n), np.zeros((m, n))
    return Start(T @ T.T, K, scaling.rate * _reach(As, Bs, s, W, K))


def _riccati(F: Array, H: Array, weight: float) -> tuple[Array, Array] | None:
    """LQR gain and the inverse of the Riccati matrix, in which the closed loop contracts.

    By structure-preserving doubling (Chu, Fan, Lin & Wang, 2004): seven doublings are 128 steps.
    """
    n, m = H.shape
    E, G, X = F, H @ H.T / weight, np.eye(n)
    try:
        with np.errstate(all="ignore"):  # overflow shows in the results, judged below
            for _ in range(DOUBLINGS):
                left = np.linalg.solve(np.eye(n) + G @ X, np.hstack([E, G]))
                E, G, X = E @ left[:, :n], G + E @ left[:, n:] @ E.T, X + E.T @ X @ left[:, :n]
            K = -np.linalg.solve(weight * np.eye(m) + H.T @ X @ H, H.T @ X @ F)
            W = np.linalg.inv((X + X.T) / 2)
    except np.linalg.LinAlgError:
        return None
    if not (np.all(np.isfinite(W)) and np.all(np.isfinite(K))):
        return None
    return np.asarray((W + W.T) / 2), np.asarray(K)


def _reach(A: Array, B: Array, s: float, W: Array, K: Array) -> float:
    """Least radius at which W, K hold at every vertex: the largest |T^-1 (A + BK + sI) T|."""
    try:
        T = np.linalg.cholesky(W)
    except np.linalg.LinAlgError:
        return np.inf
    closed = np.linalg.solve(T, (A + B @ K + s * np.eye(A.shape[1])) @ T)
    return float(np.linalg.norm(closed, 2, axis=(1, 2)).max())
