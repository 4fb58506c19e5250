"""Coordinates in which a pencil is well conditioned, and the way back.

x = T x_s, u = S u_s, and time in units of 1 / rate. Diagonal scalings are powers of two, hence
exactly undone; the Lyapunov coordinates are undone to rounding, and the proof, which sees only
the original vertices, decides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import SolverError
from polefence.lmi.conditions.pencil import Variable
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Scaling:
    """x = T x_s, u = S u_s, rates in units of ``rate``.

    Attributes
    ----------
    T : (n, n) array
    S : (m, m) array
    rate : float
        [1/s]
    """

    T: Array
    S: Array
    rate: float

    def apply(self, A: Array, B: Array) -> tuple[Array, Array]:
        """Return scaled vertex matrices (N, n, n), (N, n, m)."""
        inverse = self.inverse / self.rate
        return np.asarray(inverse @ A @ self.T), np.asarray(inverse @ B @ self.S)

    @cached_property
    def inverse(self) -> Array:
        """T^-1."""
        return np.asarray(np.linalg.inv(self.T), dtype=float)

    @property
    def unit(self) -> Array:
        """The identity (as a Lyapunov matrix) of the original coordinates, in the scaled ones."""
        return np.asarray(self.inverse @ self.inverse.T)

    def restore(
        self, values: Mapping[str, Array], variables: tuple[Variable, ...]
    ) -> dict[str, Array]:
        """Return scaled W, P, G (rows x), Z, L (rows u) and tau in the original coordinates."""
        restored = {}
        for v in variables:
            X = values[v.name]
            left = {"x": self.T, "u": self.S}.get(v.rows)
            # a scalar is tau, whose blocks were divided by the rate
            X = X * self.rate if left is None else left @ X @ self.T.T
            restored[v.name] = (X + X.T) / 2 if v.symmetric else X
        return restored

    def scaled(
        self, values: Mapping[str, Array], variables: tuple[Variable, ...]
    ) -> dict[str, Array]:
        """Return what `restore` takes back: the matrices in these coordinates."""
        lefts, right = {"x": self.inverse, "u": np.linalg.inv(self.S)}, self.inverse.T
        scaled = {}
        for v in variables:
            X, left = values[v.name], lefts.get(v.rows)
            scaled[v.name] = X / self.rate if left is None else left @ X @ right
        return scaled

    def refined(self, W: Array) -> Scaling:
        """Return the coordinates in which W, given in the original ones, is the identity.

        Raises
        ------
        SolverError
            If W is not numerically positive definite.
        """
        return replace(self, T=factor(W))


def factor(W: Array) -> Array:
    """Return T with T T' = W, which is brought to an even scale by powers of two first.

    Raises
    ------
    SolverError
        If W is not numerically positive definite.
    """
    scale = power_of_two(1 / np.sqrt(np.maximum(np.diag(W), np.finfo(float).tiny)))
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            T = np.linalg.cholesky(W * np.outer(scale, scale)) / scale[:, None]
    except np.linalg.LinAlgError:
        T = np.full(W.shape, np.nan)
    if not np.all(np.isfinite(T)):
        raise SolverError("a Lyapunov matrix is numerically singular")
    return np.asarray(T)


def summed(weights: Array, X: Array) -> Array:
    """Return sums of (..., count, a, b) matrices by weights (sums, count)."""
    *lead, count, a, b = X.shape
    return np.asarray((weights @ X.reshape(*lead, count, a * b)).reshape(*lead, len(weights), a, b))


def transposed(X: npt.NDArray[Any]) -> Array:
    """Return the transposes of (..., n, m) matrices."""
    return X.swapaxes(-1, -2)


def power_of_two(values: Array) -> Array:
    """Round positive numbers to powers of two, so that scaling by them is exact."""
    return np.asarray(np.exp2(np.round(np.log2(values))))


def balanced(A: Array, B: Array, sigma: float) -> Scaling:
    """Diagonal scaling from magnitudes alone: time by sigma, states balanced, inputs by max |B|."""
    from scipy.linalg.lapack import dgebal  # deferred: slow to import

    rate = 2.0 ** round(math.log2(sigma))
    n = A.shape[1]
    # beyond these magnitudes the balance's own powers of two overflow
    size = np.clip(np.abs(A).mean(axis=0) / rate, 0.0, 1e30) + np.eye(n)
    T = dgebal(size, scale=1, permute=0)[3]
    reach = np.abs(B / T[:, None]).mean(axis=0).max(axis=0) / rate
    S = power_of_two(1 / np.where(reach > 0, reach, 1.0))
    return Scaling(np.diag(T), np.diag(S), rate)
