"""Lyapunov polynomials of a region's part by interpolation: no LMI is solved.

A part a + 2 b Re z + e |z|^2 < 0 asks for X > 0 with

    a X + b (A X + X A') + e A X A' = -S < 0.

At the corners of a part of the box X solves this equation, and between them it is multi-affine. S
is the same at all corners: that of which X is the sum of v v* over the modes v in the middle, so
that each mode is as far from the edge as its own pole is. The lengths of v are those with which the
loops at the corners move each mode as much by the others as it moves these.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.law.laws import Law
from polefence.lmi.solve.loops import loop_degree
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.response.discrete import balancing
from polefence.response.modes import even_modes, of_modes
from polefence.response.stationary import lyapunov

# Of a disk the inequality holds [ X, A X ; X A', X ]: its coefficients say less than those of
# X - A X A', the less the lower their degree. A full car's loop with eight sensors at 5 ms is
# proved in 26 parts with the first alone, in 6 with the second too, in 5 with all.
ELEVATIONS = (0, 1, 2)
MOST_NODES = 10_000  # beyond which no elevation is tried: of seven parameters it takes 2 s


def interpolated(plant: UncertainPlant, law: Law, part: Region) -> dict[str, Any] | None:
    """Return evidence of degree 1 whose inequality holds in floats, None where there is none.

    It is multiplied by as many powers of (sum of alpha) as it needs; a remainder is left out.

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
    modes = even_modes(centre, e, a, b, loops - centre)
    if modes is None:
        return None
    X = _solved(loops, of_modes(*modes), a, b, e)
    if not np.all(np.isfinite(X)) or np.linalg.eigvalsh(X).min() <= 0:
        return None
    lowest = 1 + loop_degree(plant, law) + law.denominator_degree
    elevations = [k for k in ELEVATIONS if not k or domain.count(lowest + k) <= MOST_NODES]
    degrees = [lowest + elevation for elevation in elevations]
    at = (_loops(plant, law, domain.nodes(degree)) * scales for degree in degrees)
    held = (_holds(X, A, domain, degree, (a, b, e)) for A, degree in zip(at, degrees, strict=True))
    elevation = next((k for k, holds in zip(elevations, held, strict=True) if holds), None)
    if elevation is None:
        return None
    X = X * units
    if law.W is not None:
        W = law.parts(corners)[0]
        inverse = np.linalg.inv(W)
        X = inverse @ X @ inverse.swapaxes(-1, -2)
    X = (X + X.swapaxes(-1, -2)) / 2
    evidence: dict[str, Any] = {"X": X, "degree": 1, "elevation": elevation}
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
    T = np.linalg.inv(np.linalg.cholesky(X.mean(axis=0)))
    X, A = T @ X @ T.T, T @ A @ np.linalg.inv(T)
    X = np.tensordot(domain.basis(domain.nodes(degree), 1), X, 1)
    if e:
        moved, square = _in_disk(A, numbers)
        AX = moved @ X / np.sqrt(square)
        F = np.block([[X, AX], [AX.swapaxes(-1, -2), X]])
    else:
        AX = A @ X
        F = -a * X - b * (AX + AX.swapaxes(-1, -2))
    try:
        np.linalg.cholesky(domain.interpolated(F, degree))
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
    moved, square = _in_disk(A, (a, b, e))
    return lyapunov(moved / np.sqrt(square) - eye, driving / (e * square), 1.0)


def _in_disk(A: Array, numbers: tuple[float, float, float]) -> tuple[Array, float]:
    """Return loops less the centre of a disk, and the square of its radius."""
    a, b, e = numbers
    return A + b / e * np.eye(A.shape[-1]), (b / e) ** 2 - a / e
