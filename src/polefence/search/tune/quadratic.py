"""Quadratic programs with many rows, by an interior-point method.

It is compiled too, in src/kernel/quadratic.inc; this is the reference, and runs where that is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.kernel import kernel
from polefence.plant.system import Array

CLOSE = 1e-10
BACK = 0.995  # of the way to the boundary


@dataclass(frozen=True, eq=False)
class Program:
    """The arguments of `minimum`."""

    P: Array
    q: Array
    G: Array
    h: Array
    reach: float = np.inf
    bounded: int = 0

    def minimum(self) -> tuple[Array, Array]:
        """Return x and the multipliers, as the function of this name does."""
        return minimum(self.P, self.q, self.G, self.h, self.reach, self.bounded)


def minimum(
    P: Array, q: Array, G: Array, h: Array, reach: float = np.inf, bounded: int = 0
) -> tuple[Array, Array]:
    """Return x that minimises x' P x / 2 + q' x with G x <= h, and the multipliers of the rows.

    Parameters
    ----------
    P : (n, n) array
        Without negative eigenvalues; what it leaves free the rows must bound.
    q, G, h : (n,), (m, n), (m,) arrays
    reach : float
        What the magnitudes of the first entries of x may be.
    bounded : int
        How many of them.
    """
    compiled = kernel()
    if compiled is None:
        return reference(P, q, G, h, reach, bounded)
    arrays = (np.ascontiguousarray(array, dtype=float) for array in (P, q, G, h))
    x, z = compiled.minimum(*arrays, reach, bounded)
    return x, z


def reference(
    P: Array, q: Array, G: Array, h: Array, reach: float, bounded: int
) -> tuple[Array, Array]:
    """Return what `minimum` does, in NumPy."""
    from scipy.linalg.lapack import dpotrf, dpotrs  # deferred: slow to import

    size = np.maximum(np.abs(G).max(axis=1), 1e-12)
    rows = _Rows(G / size[:, None], bounded)
    h = np.concatenate([h / size, np.full(2 * bounded, reach)])
    n, m = len(q), len(h)
    x, z = np.zeros(n), np.ones(m) * max(1.0, float(np.abs(q).max()) / m)
    s = np.maximum(h, 1.0)
    scale_d, scale_p = 1 + np.abs(q).max(), 1 + np.abs(h[h < 1]).max(initial=0.0)
    eye = 1e-13 * max(1.0, float(np.trace(P)) / n) * np.eye(n)
    for _ in range(60):
        dual, primal = P @ x + q + rows.back(z), rows.of(x) + s - h
        gap = float(s @ z) / m
        small = np.abs(dual).max() <= CLOSE * 10 * scale_d
        if small and np.abs(primal).max() <= CLOSE * scale_p and gap <= CLOSE:
            break
        w = z / s
        factor, failed = dpotrf(P + eye + rows.gram(w))
        if failed:
            break

        def step(target: Any, w: Array = w, factor: Any = factor) -> tuple[Array, Array, Array]:
            right = -dual - rows.back(w * primal + (target - s * z) / s)  # noqa: B023
            dx, _ = dpotrs(factor, right)
            # refined once: the weights make the system ill-conditioned
            left = right - (P + eye) @ dx - rows.back(w * rows.of(dx))
            dx = dx + dpotrs(factor, left)[0]
            ds = -primal - rows.of(dx)  # noqa: B023
            return dx, ds, (target - s * z - z * ds) / s  # noqa: B023

        dx, ds, dz = step(0.0)
        a, b = _reach(s, ds), _reach(z, dz)
        ahead = float((s + a * ds) @ (z + b * dz)) / m
        centre = (ahead / gap) ** 3 * gap
        dx, ds, dz = step(centre - ds * dz)
        a, b = min(1.0, BACK * _reach(s, ds)), min(1.0, BACK * _reach(z, dz))
        x, s, z = x + a * dx, s + a * ds, z + b * dz
    return x, z[: len(G)] / size


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows G, and below them those of the identity and its negative, for the first entries of x."""

    G: Array
    bounded: int

    def of(self, x: Array) -> Array:
        """Return rows times x."""
        first = x[: self.bounded]
        return np.concatenate([self.G @ x, first, -first])

    def back(self, z: Array) -> Array:
        """Return the transpose of the rows times z."""
        m, n = len(self.G), self.bounded
        product = self.G.T @ z[:m]
        product[:n] += z[m : m + n] - z[m + n :]
        return product

    def gram(self, w: Array) -> Array:
        """Return the rows' squares, each times its weight."""
        m, n = len(self.G), self.bounded
        squares = (self.G.T * w[:m]) @ self.G
        diagonal = np.arange(n)
        squares[diagonal, diagonal] += w[m : m + n] + w[m + n :]
        return squares


def _reach(s: Array, ds: Array) -> float:
    """Return how far along ds, up to one, s stays positive."""
    falling = ds < 0
    return float(min(1.0, (s[falling] / -ds[falling]).min(initial=np.inf)))
