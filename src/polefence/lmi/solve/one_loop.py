"""Lyapunov matrices of one loop from its modes, without any LMI: also of some hundred states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.solve.dual_problem import Dual
from polefence.lmi.solve.gramians import Interpolation
from polefence.lmi.solve.lyapunov import LyapunovPolynomial
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.response.modes import even_modes, of_modes

# Above the gain, shares at which a Riccati equation is solved; and of that, what modes are observed
# more: of 270 states, poles as slow as 5e-5 of the fastest, a tenth is 1e7 times the rounding.
ABOVE = (5e-5, 9e-5, 5e-4, 2e-3, 2e-2)
MORE = 0.1
LEAST = 1e-4  # of what most moves, or shows, a mode: what is taken for any


def modal(loop: Loop, region: Region) -> Iterator[LyapunovPolynomial]:
    """Yield X = V V* of one loop whose modes V are all in the region.

    L (x) X + M (x) A X + M' (x) X A' is then V (L + M z + M' z*) V* of all poles z, for any region.
    """
    if loop.domain.corners > 1 or loop.R is not None or loop.motion.moves:
        return
    A = loop.middle
    inside = even_modes(A, 0.0, -1.0, 0.0)  # of any pole
    if inside is None or np.max(region.distance(np.linalg.eigvals(A))) >= 0:
        return
    X, n = of_modes(inside[0], np.ones(len(A)))[None], len(A)
    yield LyapunovPolynomial(
        r=0.0, converged=True, iterations=0, Q=X, multiple=None, left=np.eye(n), scaled=X
    )


@dataclass(frozen=True, eq=False)
class RiccatiOfOne(Interpolation):
    """The dual matrix of one loop's gain, a little above it.

    In coordinates in which disturbances move each mode as much as it shows, in which A is normal.
    R adds a share of what each mode shows, for rounding.
    """

    @cached_property
    def evened(self) -> tuple[Array, Array, Array] | None:
        """Coordinates x = T z, T^-1, and what z shows of each mode; None of an unstable loop."""
        A, Y, E, _ = (M[0] for M in self.nodes)
        modes = even_modes(A, self.problem.step)
        if modes is None:
            return None
        V, inside = modes
        moved = _at_least(np.linalg.norm(np.linalg.solve(V, E), axis=1))
        shown = _at_least(np.linalg.norm(Y @ V, axis=0))
        V, shown = V * np.sqrt(moved / shown), np.sqrt(moved * shown)
        T = _real(V)
        inverse: Array = np.asarray(np.linalg.inv(T), dtype=float)
        return T, inverse, inside * _at_least(shown**2 / inside, LEAST / 100)

    def least(self, worst: float) -> Dual | None:
        """Return the dual at the first level that has one."""
        duals = (self.above(worst, share) for share in ABOVE)
        return next((dual for dual in duals if dual is not None), None)

    def above(self, worst: float, share: float) -> Dual | None:
        """Return the dual of a level above the gain by a share."""
        if self.evened is None:
            return None
        T, inverse, shown = self.evened
        level = worst * (1 + share)
        R = inverse.T @ (MORE * share / level * shown[:, None] * inverse)
        A, S, W = (M[0] for M in self._equations(R, np.full(1, level)))
        Q = stabilising(inverse @ A @ T, inverse @ S @ inverse.T, T.T @ W @ T)
        if Q is None:
            return None
        Q = inverse.T @ Q @ inverse
        Q = (Q + Q.T)[None] / 2
        missed, bound = self._missed(Q, level)
        if np.linalg.eigvalsh(T.T @ missed[0] @ T).max() >= 0:
            return None
        return Dual(Q, self.degree, bound)


def stabilising(A: Array, S: Array, Q: Array) -> Array | None:
    """Return the stabilising X of A'X + X A + X S X + Q = 0 by a Schur form; None without one."""
    from scipy.linalg import schur  # deferred: slow to import

    n = len(A)
    H = np.block([[A, S], [-Q, -A.T]])
    try:
        _, Z, count = schur(H, sort="lhp")
        if count != n:
            return None
        X = np.linalg.solve(Z[:n, :n].T, Z[n:, :n].T)
    except np.linalg.LinAlgError:  # which could not be sorted
        return None
    return np.asarray((X + X.T) / 2)


def _at_least(sizes: Array, share: float = LEAST) -> Array:
    """Return sizes, none below a share of the largest."""
    return np.maximum(sizes, share * (sizes.max() or 1.0))


def _real(V: Any) -> Array:
    """Return T with T T' = V V*, of columns that are real or beside their conjugates."""
    paired = V.imag.any(axis=0)
    second = paired & (np.cumsum(paired) % 2 == 0)
    return np.asarray(np.where(second, V.imag, V.real) * np.where(paired, np.sqrt(2), 1.0))
