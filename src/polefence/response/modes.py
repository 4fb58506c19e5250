"""Modes of many matrices at once: poles and their slopes, Lyapunov equations, responses."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.discrete import balancing
from polefence.response.stationary import lyapunov

# What modes count as coupled at least, beside the largest. A full car's loop with eight sensors at
# 5 ms is proved in 5 parts (6 with 0.1 or 1e-4, 30 with lengths of one), a van's at 2 ms in 3
# (4 with 1e-3 and less, or lengths of one).
LEAST_COUPLED = 1e-2


@dataclass(frozen=True, eq=False)
class Modes(Short):
    """Eigenvalues and eigenvectors of matrices A.

    Attributes
    ----------
    A : (count, n, n) array
    step : float
        Of a delta form [s]; zero in continuous time.
    """

    A: Array
    step: float = 0.0
    _covariances: dict[int, tuple[Array, Array]] = field(default_factory=dict, init=False)

    @cached_property
    def _parts(self) -> tuple[Any, Any, Any]:
        poles, right = np.linalg.eig(self.A)
        try:
            return poles, right, np.linalg.inv(right)
        except np.linalg.LinAlgError:
            each = [_of_one(A[None]) for A in self.A]
            poles, right, left = (np.concatenate(parts) for parts in zip(*each, strict=True))
            return poles, right, left

    def __getitem__(self, some: Any) -> Modes:
        """Return those of some matrices."""
        modes = Modes(self.A[some], self.step)
        modes.__dict__["_parts"] = tuple(part[some] for part in self._parts)
        return modes

    @property
    def poles(self) -> Any:
        """Eigenvalues, (count, n) complex."""
        return self._parts[0]

    @property
    def right(self) -> Any:
        """Eigenvectors as columns, (count, n, n) complex."""
        return self._parts[1]

    @property
    def left(self) -> Any:
        """The inverse of `right`: its rows are left eigenvectors."""
        return self._parts[2]

    def lyapunov(self, W: Array) -> Array:
        """Return X of A X + X A' + step A X A' + W = 0, W symmetric, (count, n, n); A is stable."""
        V, U = self.right, self.left
        X = _product(V, (U @ W @ _adjoint(U)) / -self._total, _adjoint(V))
        return _checked(self.A, X, W, self.step)

    @property
    def _total(self) -> Any:
        """p_i + p_j* + step p_i p_j* of all pairs of poles."""
        left, right = self.poles[:, :, None], self.poles.conj()[:, None, :]
        return left + right + self.step * left * right

    def covariance(self, E: Array) -> Array:
        """Return X of `lyapunov` with W = E E', computed once for an array E."""
        known = self._covariances.get(id(E))
        if known is None:
            known = E, self.lyapunov(E @ np.swapaxes(E, 1, 2))
            self._covariances[id(E)] = known
        return known[1]

    def observed(self, W: Array) -> Array:
        """Return Q of A' Q + Q A + step A' Q A + W = 0, W symmetric, (count, n, n)."""
        V, U = self.right, self.left
        Q = _product(_adjoint(U), (_adjoint(V) @ W @ V) / -self._total.conj(), U)
        return _checked(np.swapaxes(self.A, 1, 2), Q, W, self.step)


def _adjoint(M: Any) -> Any:
    return np.swapaxes(M.conj(), 1, 2)


def _product(left: Any, middle: Any, right: Any) -> Array:
    product = (left @ middle @ right).real
    return np.asarray((product + np.swapaxes(product, 1, 2)) / 2)


def _checked(A: Array, X: Array, W: Array, step: float) -> Array:
    """Return X, solved without modes where the eigenvectors are ill-conditioned."""
    half = A @ X
    left = half + np.swapaxes(half, 1, 2) + W
    if step:
        left = left + step * half @ np.swapaxes(A, 1, 2)
    rest = np.abs(left).max(axis=(1, 2))
    size = np.abs(half).max(axis=(1, 2)) + np.abs(W).max(axis=(1, 2))
    # where eigenvectors leave a larger residual, the equation is solved without them
    bad = np.flatnonzero(~(rest <= 1e-9 * size))
    if len(bad):
        X[bad] = lyapunov(A[bad], W[bad], step)
    return X


def _of_one(A: Array) -> tuple[Any, Any, Any]:
    poles, right = np.linalg.eig(A)
    try:
        return poles, right, np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return moved_modes(A)


def moved_modes(A: Array) -> tuple[Any, Any, Any]:
    """Return poles, right and left eigenvectors of matrices moved a little."""
    size = np.abs(A).max(axis=(1, 2), keepdims=True) + np.finfo(float).tiny
    n = A.shape[-1]
    # moved a little, so that it has a full set of eigenvectors
    poles, right = np.linalg.eig(A + 1e-7 * size * np.cos(np.arange(n * n).reshape(n, n)))
    return poles, right, np.linalg.inv(right)


def even_modes(
    A: Array, e: float, a: float = 0.0, b: float = 1.0, moved: Array | None = None
) -> tuple[Any, Array] | None:
    """Return right eigenvectors v of A, as columns, and how far inside a region each pole is.

    The region is a + 2 b Re z + e |z|^2 < 0. With S the sum of v v*, each times how far inside its
    pole is, X of a X + b (A X + X A') + e A X A' = -S is the sum of v v*: see `of_modes`. Lengths
    of v are one in balanced coordinates, or those in which other loops nearby move each mode as
    much by the others as it moves these.

    Parameters
    ----------
    A : (n, n) array
    moved : (count, n, n) array, optional
        Other loops less A.

    Returns
    -------
    tuple of (n, n) and (n,) arrays, or None
        None where a pole is not in the region.
    """
    d = balancing(A[None])
    units = d / d[:, None]
    poles, V = np.linalg.eig(A * units)
    inside = -(a + 2 * b * poles.real + e * np.abs(poles) ** 2)
    if inside.min() <= 0:
        return None
    if moved is not None:
        V = V * _even_lengths(V, moved * units)
    return V * d[:, None], inside


def of_modes(V: Any, shares: Array) -> Array:
    """Return the sum of v v* over modes, each its share times."""
    S = ((V * shares) @ V.conj().T).real
    return np.asarray((S + S.T) / 2)


def _even_lengths(V: Array, moved: Array) -> Array:
    """Return lengths of eigenvectors with which loops moved couple each two of them evenly."""
    try:
        coupled = np.sqrt((np.abs(np.linalg.solve(V, moved @ V)) ** 2).sum(axis=0))
    except np.linalg.LinAlgError:  # a pole of several that has one mode
        return np.ones(len(V))
    return balancing((coupled + LEAST_COUPLED * coupled.max())[None])
