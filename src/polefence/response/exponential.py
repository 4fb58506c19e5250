"""Matrix exponentials of many small matrices at once.

Higham, SIAM J. Matrix Anal. Appl. 26 (2005) 1179: Pade approximant of order 13 with scaling and
squaring, here in coordinates balanced by powers of two, since states have units.
"""

from __future__ import annotations

import math

import numpy as np

from polefence.plant.system import Array

# Higham's bound on the 1-norm up to which the approximant of order 13 is good to a rounding.
PADE_NORM = 5.371920351148152
PADE = tuple(
    math.factorial(26 - j) // (math.factorial(13 - j) * math.factorial(j)) for j in range(14)
)

# Of balancing: sweeps at most, and the share of the largest entry that stands for a zero row.
SWEEPS = 20
SMALL = 1e-6


def exponential(M: Array) -> Array:
    """Return e^M of finite (..., n, n) matrices; where it outgrows floating point, no numbers."""
    M = np.asarray(M, dtype=float)
    if M.size == 0:
        return M.copy()
    shape, M = M.shape, M.reshape(-1, *M.shape[-2:])
    d = balancing(M)
    M = M * (d[None, :] / d[:, None])
    norm = np.abs(M).sum(axis=-2).max(axis=-1)
    squarings = np.ceil(np.log2(np.maximum(norm / PADE_NORM, 1.0))).astype(int)
    E = _pade(M * 2.0 ** -squarings[:, None, None])
    with np.errstate(over="ignore", invalid="ignore"):
        for done in range(squarings.max()):
            more = squarings > done
            if more.all():
                E = E @ E
            else:
                E[more] = E[more] @ E[more]
        return np.asarray(E * (d[:, None] / d[None, :])).reshape(shape)


def balancing(M: Array) -> Array:
    """Return powers of two d (n,) that even out diag(d)^-1 M diag(d) of all M (count, n, n)."""
    largest = np.abs(M).max(axis=0)
    n, own = len(largest), np.diagonal(largest).max()
    # What nothing follows, or follows nothing, as a disturbance: made small beside the rest.
    small = SMALL * float(own or largest.max())
    if small == 0 or not np.isfinite(largest).all():
        return np.ones(n)
    np.fill_diagonal(largest, 0.0)
    size, d = largest.tolist(), [1.0] * n  # plain numbers: n is small
    for _ in range(SWEEPS):
        even = True
        for i in range(n):
            column, row = sum(line[i] for line in size) or small, sum(size[i]) or small
            f = 2.0 ** round(0.5 * math.log2(row / column))
            if f != 1:
                even = False
                d[i] *= f
                size[i] = [entry / f for entry in size[i]]
                for line in size:
                    line[i] *= f
        if even:
            break
    return np.array(d)


def _pade(M: Array) -> Array:
    eye = np.eye(M.shape[-1])
    b = PADE
    M2 = M @ M
    M4 = M2 @ M2
    M6 = M4 @ M2
    odd = M6 @ (b[13] * M6 + b[11] * M4 + b[9] * M2)
    odd = M @ (odd + b[7] * M6 + b[5] * M4 + b[3] * M2 + b[1] * eye)
    even = M6 @ (b[12] * M6 + b[10] * M4 + b[8] * M2)
    even = even + b[6] * M6 + b[4] * M4 + b[2] * M2 + b[0] * eye
    return np.asarray(np.linalg.solve(even - odd, even + odd))
