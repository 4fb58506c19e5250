"""Where a run may begin: the reference in NumPy.

Of x + share most, what grows with r holds from some r on; the rest holds from some share on down.
Both are looked for among powers of two.
"""

from __future__ import annotations

import numpy as np

from polefence.lmi.solve.stacked import Stacked
from polefence.plant.system import Array

HALVINGS = 80
POWERS, STRIDE = [2.0**k for k in range(-14, 60)], 8

Pairs = list[tuple[Array, Array]]


def inside(stacked: Stacked, x: Array, most: Array | None = None) -> tuple[float, float] | None:
    """Return a share and an r at which F(x + share most, r) is positive definite, None without one.

    Parameters
    ----------
    x : (unknowns,) array
    most : (unknowns,) array, optional
        Of which the largest of 1, 1/2, 1/4, ... is to be added that makes x interior.

    Returns
    -------
    share, r : float
        The share, zero without ``most``, and the least of `POWERS` for it.
    """
    alone = stacked.at(x)
    if most is None:
        r = least_power(alone)
        return None if r is None else (0.0, r)
    rising = stacked.at(most)
    fixed = [
        ~np.any([D, dD], axis=(0, 2, 3)) for (D, _), (dD, _) in zip(alone, rising, strict=True)
    ]
    pairs = list(zip(alone, rising, fixed, strict=True))
    plain = [(M[there], dM[there]) for (_, M), (_, dM), there in pairs if there.any()]
    grown = [
        (D[~there], dD[~there], M[~there], dM[~there])
        for (D, M), (dD, dM), there in pairs
        if not there.all()
    ]
    share = most_share(plain)
    for _ in range(HALVINGS):
        if _positive([-M - share * dM for M, dM in plain]):
            blocks = [(D + share * dD, M + share * dM) for D, dD, M, dM in grown]
            r = least_power(blocks)
            if r is not None:
                return share, r
        share /= 2
    return None


def most_share(pairs: Pairs) -> float:
    """Return a power of 1/2 at which -M - share dM fails, if 1 does, and not by far.

    Of the blocks that hold at none: a generalised eigenvalue says how far each goes.
    """
    top = 0.0
    for M, dM in pairs:
        some = np.all(np.diagonal(M, axis1=1, axis2=2) < 0, axis=1)
        if some.any():
            top = max(top, _largest(-M[some], dM[some]))
    return 1.0 if not 1 < top < np.inf else float(2.0 ** -(np.floor(np.log2(top))))


def _largest(B: Array, D: Array) -> float:
    """Return the largest generalised eigenvalue of (D, B); infinite where B is not positive."""
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(B))
        return float(np.linalg.eigvalsh(inverse @ D @ inverse.swapaxes(1, 2)).max())
    except np.linalg.LinAlgError:
        return np.inf


def least_power(blocks: Pairs) -> float | None:
    """Return the least of `POWERS` at which all r D - M are positive definite, None if none is.

    D >= 0, so that they only grow with r: one in `STRIDE` is tried, and those next to where a
    generalised eigenvalue says that the blocks below the first end.
    """
    for start in range(0, len(POWERS), STRIDE):
        few = POWERS[start : start + STRIDE]
        if _holds(blocks, few[-1]):
            top = max((_largest(few[-1] * D - M, D) for D, M in blocks), default=0.0)
            end = few[-1] - 1 / top if top > 0 else 0.0
            place = min(sum(r <= end for r in few), len(few) - 1)
            while place < len(few) - 1 and not _holds(blocks, few[place]):
                place += 1
            while place and _holds(blocks, few[place - 1]):
                place -= 1
            return few[place]
    return None


def _holds(blocks: Pairs, r: float) -> bool:
    return _positive([r * D - M for D, M in blocks])


def _positive(blocks: list[Array]) -> bool:
    try:
        for block in blocks:
            np.linalg.cholesky(block)
    except np.linalg.LinAlgError:
        return False
    return True
