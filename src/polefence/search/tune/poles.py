"""Poles against regions: how far out each is, smoothly a pole, with slopes.

A part of a region is { z : L + M z + M' conj(z) < 0 }, one that grows with r has L = L0 + r L1 and
M = M0 + r M1. The least r of a pole is the largest eigenvalue of a small pencil: of a disk about a
centre the distance from it. A part that is fixed grows here by its own size: r <= 0 is inside.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.lmi.conditions.target import Side
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.response.modes import Modes


def sides_of(region: Region, rate: float, step: float = 0.0) -> list[Side]:
    """Return a region's inequalities, each growing by a length of its own.

    Parameters
    ----------
    rate : float
        The length where an inequality has none, as a half-plane of all that is stable [1/s]; and
        where that of a delta form is longer, as 1 / step is.
    step : float
        Of a delta form [s].
    """
    sides = []
    for part in region.parts:
        for L, M in part.pairs():
            slope = _steepest(M)
            length = float(np.linalg.norm(L, 2)) / slope or rate
            if step:
                decay = part.decay_rate(step)
                length = min(length, decay if decay > 0 else rate)
            sides.append(Side(L, -slope * length * np.eye(len(L)), M, np.zeros_like(M)))
    return sides


def _steepest(M: Array) -> float:
    """Return the largest slope of the largest eigenvalue of M z + M' conj(z)."""
    turns = np.exp(1j * np.linspace(0, np.pi, 64, endpoint=False))[:, None, None]
    return float(np.abs(np.linalg.eigvalsh(turns * M + turns.conj() * M.T)).max())


def growth(side: Side, z: Any) -> tuple[Array, Array, Array]:
    """Return the least r of each pole, and its slopes along the real and the imaginary axis."""
    x = np.asarray(z)[..., None, None]
    H0 = side.L0 + side.M0 * x + side.M0.T * x.conj()
    H1 = side.L1 + side.M1 * x + side.M1.T * x.conj()
    half = np.linalg.inv(np.linalg.cholesky(-H1))
    up = np.swapaxes(half.conj(), -1, -2)
    values, vectors = np.linalg.eigh(half @ H0 @ up)
    r, v = values[..., -1], (up @ vectors[..., -1:])[..., 0]
    dM, conj = side.M0 + r[..., None, None] * side.M1, v.conj()
    other = np.swapaxes(dM, -1, -2)

    def along(turn: complex) -> Array:
        dH = turn * dM + turn.conjugate() * other
        return np.asarray(np.einsum("...i,...ij,...j->...", conj, dH, v).real)

    return np.asarray(r), along(1.0), along(1j)


def slopes(modes: Modes, B: Array, points: Any, which: Any, dx: Array, dy: Array) -> Array:
    """Return slopes with respect to K (rows, m, n) of functions of poles of A + B K.

    Parameters
    ----------
    points, which : (rows,) arrays of int
        The loop, and which of its poles.
    dx, dy : (rows,) arrays
        Slopes along the real and the imaginary axis.
    """
    left, right = modes.left[points, which], modes.right[points, :, which]
    move = np.einsum("rn,rnm->rm", left, B[points])[:, :, None] * right[:, None, :]
    return np.asarray(dx[:, None, None] * move.real + dy[:, None, None] * move.imag)
