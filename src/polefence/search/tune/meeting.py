"""Poles that meet: of one plant, the law for which all poles are one, as far left as can be.

Where a law has too few numbers to place all poles, the fastest loop has mostly all of them in one
place (Blondel, Gurbuzbalaban, Megretski & Overton, 2012, for polynomials with one condition).
Descent on the slowest pole comes there slowly, as poles that meet have no slopes. The coefficients
of the characteristic polynomial are smooth: of s + d to a power they are those of Newton's steps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from polefence.plant.system import Array

Loop = Callable[[Array], Array]  # from a law's numbers to A + B K


def met(loop: Loop, theta: Array) -> tuple[Array, float] | None:
    """Return numbers of a law whose loop has all poles at -d, and d; None where none are near.

    Parameters
    ----------
    loop : callable
        The loop's matrix, of a law's numbers.
    theta : (size,) array
        Where to begin.
    """
    rate = -float(np.linalg.eigvals(loop(theta)).real.max())
    if not rate > 0:
        return None
    free = _solved(loop, np.append(theta, 1.0), rate, True)
    if free is None:
        return None
    best, tries = free, 0
    # more numbers than conditions: any rate can be placed
    for share in (0.3, 0.1, 0.03, 0.01, 0.003):
        while tries < 40:
            tries += 1
            start = np.append(best[:-1], best[-1] * (1 + share))
            placed = _solved(loop, start, rate, False)
            if placed is None:
                break
            best = placed
    return best[:-1], float(best[-1]) * rate


def _solved(loop: Loop, x: Array, rate: float, free: bool) -> Array | None:
    """Return numbers, the rate last, whose poles are all there; None where steps do not end."""
    r = _residual(loop, x, rate)
    for _ in range(40):
        if np.abs(r).max() <= 1e-10:
            return x
        J = _slopes(loop, x, rate)[:, : len(x) if free else len(x) - 1]
        d = np.zeros(len(x))
        d[: J.shape[1]] = np.linalg.lstsq(J, -r, rcond=1e-12)[0]
        share = 1.0
        for _ in range(30):
            there = _residual(loop, x + share * d, rate)
            if np.linalg.norm(there) < (1 - 0.1 * share) * np.linalg.norm(r):
                break
            share /= 2
        else:
            return None
        x, r = x + share * d, there
    return None


def _residual(loop: Loop, x: Array, rate: float) -> Array:
    """Return the coefficients of the characteristic polynomial about -d, the first one left out."""
    A = loop(x[:-1]) / rate
    return np.asarray(np.poly(A + x[-1] * np.eye(len(A))).real[1:])


def _slopes(loop: Loop, x: Array, rate: float) -> Array:
    steps = 1e-6 * np.maximum(np.abs(x), 1.0)
    columns = (
        (_residual(loop, x + h * e, rate) - _residual(loop, x - h * e, rate)) / (2 * h)
        for h, e in zip(steps, np.eye(len(x)), strict=True)
    )
    return np.stack(list(columns), axis=1)
