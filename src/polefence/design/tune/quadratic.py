"""Quadratic programs with many rows, by an interior-point method."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.plant.system import Array

STEPS, CLOSE = 60, 1e-10
BACK = 0.995  # of the way to the boundary


def minimum(P: Array, q: Array, G: Array, h: Array) -> tuple[Array, Array]:
    """Return x that minimises x' P x / 2 + q' x with G x <= h, and the multipliers of the rows.

    Parameters
    ----------
    P : (n, n) array
        Without negative eigenvalues; what it leaves free the rows must bound.
    q, G, h : (n,), (m, n), (m,) arrays
    """
    from scipy.linalg.lapack import dpotrf, dpotrs  # deferred: slow to import

    size = np.maximum(np.abs(G).max(axis=1), 1e-12)
    G, h = G / size[:, None], h / size
    n, m = len(q), len(h)
    x, z = np.zeros(n), np.ones(m) * max(1.0, float(np.abs(q).max()) / m)
    s = np.maximum(h, 1.0)
    scale_d, scale_p = 1 + np.abs(q).max(), 1 + np.abs(h[h < 1]).max(initial=0.0)
    eye = 1e-13 * max(1.0, float(np.trace(P)) / n) * np.eye(n)
    for _ in range(STEPS):
        dual, primal = P @ x + q + G.T @ z, G @ x + s - h
        gap = float(s @ z) / m
        small = np.abs(dual).max() <= CLOSE * 10 * scale_d
        if small and np.abs(primal).max() <= CLOSE * scale_p and gap <= CLOSE:
            break
        w = z / s
        factor, failed = dpotrf(P + eye + (G.T * w) @ G)
        if failed:
            break

        def step(target: Any, w: Array = w, factor: Any = factor) -> tuple[Array, Array, Array]:
            right = -dual - G.T @ (w * primal + (target - s * z) / s)  # noqa: B023
            dx, _ = dpotrs(factor, right)
            ds = -primal - G @ dx  # noqa: B023
            return dx, ds, (target - s * z - z * ds) / s  # noqa: B023

        dx, ds, dz = step(0.0)
        a, b = _reach(s, ds), _reach(z, dz)
        ahead = float((s + a * ds) @ (z + b * dz)) / m
        centre = (ahead / gap) ** 3 * gap
        dx, ds, dz = step(centre - ds * dz)
        a, b = min(1.0, BACK * _reach(s, ds)), min(1.0, BACK * _reach(z, dz))
        x, s, z = x + a * dx, s + a * ds, z + b * dz
    return x, z / size


def _reach(s: Array, ds: Array) -> float:
    """Return how far along ds, up to one, s stays positive."""
    falling = ds < 0
    return float(min(1.0, (s[falling] / -ds[falling]).min(initial=np.inf)))
