"""Lyapunov polynomials of a region's part by interpolation: no LMI is solved.

A part a + 2 b Re z + e |z|^2 < 0 asks for X > 0 with

    a X + b (A X + X A') + e A X A' = -S < 0.

At the corners of a part of the box X solves this equation, and between them it is multi-affine. S
is the same at all corners: that of which X is the sum of v v* over the modes v in the middle, so
that each mode is as far from the edge as its own pole is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.law.laws import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.response.discrete import balancing
from polefence.response.modes import even
from polefence.response.stationary import lyapunov


def interpolated(plant: UncertainPlant, law: Law, part: Region) -> dict[str, Any] | None:
    """Return evidence of degree 1 that holds at the corners and in the middle, None without.

    Parameters
    ----------
    part : Region
        One that `Region.closed_form` tells.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the law has no value at a corner.
    """
    numbers = part.closed_form
    if numbers is None:
        return None
    a, b, e = (float(x) for x in numbers)
    domain = law.domain_of(plant)
    corners = domain.nodes(1)
    middle = np.full((1, domain.corners), 1 / domain.corners)
    d = balancing(_loops(plant, law, middle))
    units, scales = d[:, None] * d, d / d[:, None]
    loops, (centre,) = (_loops(plant, law, at) * scales for at in (corners, middle))
    S = even(centre, e, a, b)
    if S is None:
        return None
    X = _solved(loops, S, a, b, e)
    if not np.all(np.isfinite(X)) or np.linalg.eigvalsh(X).min() <= 0:
        return None
    # of law and plant that are of one degree; of others about
    raised = 1 + plant.curve_degree * (2 if e else 1)
    if not _holds(X, _loops(plant, law, domain.nodes(raised)) * scales, domain, raised, (a, b, e)):
        return None
    X = X * units
    if law.W is not None:
        W = law.parts(corners)[0]
        inverse = np.linalg.inv(W)
        X = inverse @ X @ inverse.swapaxes(-1, -2)
    X = (X + X.swapaxes(-1, -2)) / 2
    evidence: dict[str, Any] = {"X": X, "degree": 1, "elevation": 0}
    return evidence if law.W is None else evidence | {"multiple": np.zeros(len(X))}


def _holds(
    X: Array, A: Array, domain: Domain, degree: int, numbers: tuple[float, float, float]
) -> bool:
    """Whether all Bernstein coefficients of the inequality are positive in floats.

    Parameters
    ----------
    X : (count, n, n) array
        At the corners.
    A : (count, n, n) array
        At the nodes of the inequality's degree.
    """
    a, b, e = numbers
    X = np.tensordot(domain.basis(domain.nodes(degree), 1), X, 1)
    AX = A @ X
    F = a * X + b * (AX + AX.swapaxes(-1, -2)) + e * AX @ A.swapaxes(-1, -2)
    try:
        np.linalg.cholesky(-domain.interpolated(F, degree))
    except np.linalg.LinAlgError:
        return False
    return True


def _loops(plant: UncertainPlant, law: Law, alpha: Array) -> Array:
    A, B = plant.at(alpha)
    return np.asarray(A + B @ law.gain(alpha))


def _solved(A: Array, S: Array, a: float, b: float, e: float) -> Array:
    """Return X at loops (count, n, n)."""
    eye, driving = np.eye(A.shape[-1]), np.broadcast_to(S, A.shape)
    if not e:
        return lyapunov(A + a / (2 * b) * eye, driving / b)
    square = (b / e) ** 2 - a / e  # of the radius
    moved = (A + b / e * eye) / np.sqrt(square)
    return lyapunov(moved - eye, driving / (e * square), 1.0)
