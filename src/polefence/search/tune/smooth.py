"""Regions kept smoothly: a bound on a Lyapunov matrix in place of the poles themselves.

Where poles meet they have no slope. Take a half-plane or a disk, where a + b z + b' z' + e |z|^2 is
negative. The trace of X, a X + b A X + b' X A' + e A X A' + s I = 0, is smooth as long as all poles
lie inside, and infinite at the edge. Of a region that grows with r, the least r at which that trace
is at most kappa n is therefore smooth in A, never less than that of the poles, and nears it as
kappa grows (Vanbiervliet et al., 2009, for the half-plane).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.lmi.conditions.target import Side
from polefence.plant.system import Array
from polefence.response.modes import Modes
from polefence.search.tune.poles import growth

CLOSE = 1e-8


@dataclass(frozen=True)
class Curve:
    """{ z : a + b z + b' z' + e |z|^2 < 0 }, its numbers polynomials in r: lowest power first.

    Attributes
    ----------
    a, b, e : tuple of number
    s : float
        What X solves its equation with.
    """

    a: tuple[float, ...]
    b: tuple[complex, ...]
    e: float
    s: float

    def at(self, r: Array) -> tuple[Any, Any]:
        """Return a and b."""
        powers = np.asarray(r)[..., None] ** np.arange(3)
        return powers[..., : len(self.a)] @ self.a, powers[..., : len(self.b)] @ self.b

    def powers(self, z: Array) -> list[Any]:
        """Return the coefficients of a + b z_i + b' z_j' + e z_i z_j', lowest power of r first."""
        left, right = z[:, :, None], z.conj()[:, None, :]
        coefficients = []
        for k in range(max(len(self.a), len(self.b))):
            constant = complex(self.a[k]) if k < len(self.a) else 0j
            b = self.b[k] if k < len(self.b) else 0.0
            coefficients.append(constant + b * left + np.conj(b) * right)
        coefficients[0] = coefficients[0] + self.e * left * right
        return coefficients

    def turn(self, r: Array) -> tuple[Any, Any]:
        """Return their derivatives."""
        a = sum(k * x * r ** (k - 1) for k, x in enumerate(self.a) if k)
        b = sum(k * x * r ** (k - 1) for k, x in enumerate(self.b) if k)
        return a, b


def curve_of(side: Side, rate: float) -> Curve | None:
    """Return the half-plane or disk that a side is, in the upper half-plane; None if it is neither.

    Parameters
    ----------
    rate : float
        Typical of the plant [1/s].
    """
    L0, L1, M0, M1 = side.L0, side.L1, side.M0, side.M1
    diagonal = all(np.array_equal(M, M[0, 0] * np.eye(len(M))) for M in (L0, L1, M1))
    if diagonal and np.allclose(M0 @ M0.T, M0.T @ M0):
        turns = np.linalg.eigvals(M0)
        # that which bounds poles above the real axis
        mu = turns[np.argmin(turns.imag)]
        l0, l1, m1 = (float(M[0, 0]) for M in (L0, L1, M1))
        size = max(abs(complex(mu)), abs(m1))
        return Curve((l0, l1), (complex(mu), complex(m1)), 0.0, rate * size)
    if len(L0) == 2 and not M1.any() and np.array_equal(M0, [[0, 1], [0, 0]]):
        c, radius, more = -float(L0[0, 1]), -float(L0[0, 0]), -float(L1[0, 0])
        if L0[0, 0] == L0[1, 1] and np.array_equal(L1, L1[0, 0] * np.eye(2)):
            a = c * c - radius**2, -2 * radius * more, -(more**2)
            return Curve(a, (complex(-c),), 1.0, max(abs(c), radius) ** 2)
    return None


def smooth_growth(side: Side, curve: Curve, modes: Modes, kappa: float) -> tuple[Array, Array]:
    """Return the least r of each loop (count,), and its slopes with respect to A (count, n, n)."""
    z, V, U = modes.poles, modes.right, modes.left
    up, down = np.swapaxes(V.conj(), 1, 2), np.swapaxes(U.conj(), 1, 2)
    P, G, n = U @ down, up @ V, z.shape[1]
    S = P * np.swapaxes(G, 1, 2) * curve.s
    powers = curve.powers(z)

    def inside(r: Array) -> Any:
        value, length = powers[-1], r[:, None, None]
        for coefficient in powers[-2::-1]:
            value = value * length + coefficient
        return value

    def trace(r: Array) -> Array:
        return np.asarray(-(S / inside(r)).real.sum(axis=(1, 2)))

    upper = np.where(z.imag >= 0, z, z.conj())
    low = growth(side, upper)[0].max(axis=1)
    with np.errstate(all="ignore"):
        r = _least(trace, low, kappa * n)
    _, b = curve.at(r)
    D = inside(r)
    X = V @ (curve.s * P / -D) @ up
    Q = down @ (G / -np.swapaxes(D, 1, 2)) @ U
    A = modes.A
    both = b[:, None, None] * (X @ Q) + curve.e * (X @ np.swapaxes(A, 1, 2) @ Q)
    dA = 2 * np.swapaxes(both, 1, 2).real
    da, db = curve.turn(r)
    da, db = (np.broadcast_to(derivative, r.shape)[:, None, None] for derivative in (da, db))
    change = da * X + 2 * db * (A @ X)
    fall = np.einsum("aij,aji->a", Q, change).real
    return r, np.asarray(dA / -fall[:, None, None])


def _least(trace: Any, low: Array, most: float) -> Array:
    """Return the least r above low at which the trace, which falls, is at most a number.

    One over the trace rises from zero at low; it is followed by secants, kept between bounds.
    """
    aim, size = 1 / most, np.maximum(np.abs(low), 1e-12)
    below, under = low, np.zeros_like(low)
    step = 1e-3 * size
    above = low + step
    over = 1 / trace(above)
    for _ in range(40):
        out = ~(over >= aim)
        if not out.any():
            break
        below, under = np.where(out, above, below), np.where(out, over, under)
        step = np.where(out, 16 * step, step)
        above = np.where(out, low + step, above)
        over = 1 / trace(above)
    for k in range(40):
        share: Array | float = 0.5  # every third time, so that it ends
        if k % 3 != 2:
            share = (aim - under) / np.maximum(over - under, np.finfo(float).tiny)
            share = np.minimum(np.maximum(share, 1e-3), 1 - 1e-3)
        new = below + (above - below) * share
        value = 1 / trace(new)
        out = ~(value >= aim)
        below, under = np.where(out, new, below), np.where(out, value, under)
        above, over = np.where(out, above, new), np.where(out, over, value)
        near = np.abs(over - aim) <= CLOSE * aim
        if (near | (above - below <= CLOSE * size)).all():
            break
    return above
