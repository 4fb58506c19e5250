"""Evidence that a pole does not lie in a region: found in floats, decided exactly."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.law.laws import right_divide
from polefence.proof import matrices, roots, work
from polefence.proof.matrices import Rationals
from polefence.proof.regions import Part
from polefence.proof.roots import Outside

Side = tuple[Fraction, Fraction, Fraction]

TRIES = 3
DIGITS = 20  # binary, of the tangent of half an angle


def leaves(loop: tuple[Rationals, Rationals], region: tuple[Part, ...]) -> bool:
    """Whether a pole of N W^-1, ``loop`` holding N and W, is proved not to lie in the region.

    By a matrix P that floats find (`exact.Outside`); where that fails, as for a pole on the
    boundary, by the characteristic polynomial. A W that is singular keeps no pole.

    Raises
    ------
    FormatError
        If that is more work than is done here.
    """
    with work.counted():
        if shown(loop, region) is not None:
            return True
        closed = matrices.right_divide(*loop)
        return closed is None or not roots.all_inside(closed, region)


def shown(loop: tuple[Rationals, Rationals], region: tuple[Part, ...]) -> Outside | None:
    """Return evidence that proves a pole outside, None where floats find none."""
    return next((by for by in evidence(loop, region) if roots.is_outside(loop, region, by)), None)


def evidence(loop: tuple[Rationals, Rationals], region: tuple[Part, ...]) -> Iterator[Outside]:
    """Yield evidence worth deciding that a pole is outside, of the one farthest outside."""
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov  # deferred: slow to import

    try:
        N, W = (np.array(M, dtype=float) for M in loop)
        A, (scale, _) = matrix_balance(right_divide(N, W), permute=False, separate=True)
        poles = np.linalg.eigvals(A)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return
    upper = [complex(z) for z in poles if z.imag >= 0]
    side, over = max(
        ((side, _over(side, z)) for z in upper for part in region for side in _sides(part, z)),
        key=lambda pair: pair[1],
    )
    if not over > 0:
        return
    p, q, c = side
    turned = (float(p) - 1j * float(q)) * A if q else float(p) * A
    for beyond in _between(np.asarray(np.linalg.eigvals(turned).real - float(c))):
        line = c + Fraction(beyond)
        R = turned - float(line) * np.eye(len(A))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of poles nearly opposite: P is decided exactly
                P = solve_continuous_lyapunov(R.conj().T, -np.eye(len(A)))
        except (np.linalg.LinAlgError, ValueError):
            continue
        with np.errstate(over="ignore", invalid="ignore"):  # only finite numbers are evidence
            P = np.asarray((P + P.conj().T) / 2 / scale[:, None] / scale)
        if np.all(np.isfinite(P)):
            yield Outside(p, q, line, _rational(np.real(P)), _rational(np.imag(P)))


def _over(side: Side, z: complex) -> float:
    """Return how far z lies beyond p x + q y = c."""
    p, q, c = map(float, side)
    return (p * z.real + q * z.imag - c) / float(np.hypot(p, q))


def _sides(part: Part, z: complex) -> list[Side]:
    """Return the half-planes p x + q y < c that hold the part and may not hold z, Im z >= 0."""
    v, zero, one = part.numbers, Fraction(0), Fraction(1)
    if part.kind == "disk":
        p, q = _direction(z - float(v[0]))
        return [(p, q, p * v[0] + v[1])]
    if part.kind == "ellipse":
        centre, a, b = v
        p, q = _direction(complex((z.real - float(centre)) / float(a), z.imag / float(b)))
        return [(p / a, q / b, 1 + p * centre / a)]
    if part.kind == "half_plane":
        return [(one, zero, -v[0])]
    if part.kind == "sector":
        return [(v[1], one, zero)]
    if part.kind == "vertical_strip":
        return [(one, zero, v[1]), (-one, zero, -v[0])]
    return [(zero, one, v[0])]


def _direction(z: complex) -> tuple[Fraction, Fraction]:
    """Return a rational point of the unit circle near the direction of z, Im z >= 0."""
    half = z.imag / (abs(z) + abs(z.real)) if z else 0.0
    t = Fraction(round(half * 2**DIGITS), 2**DIGITS)
    cosine, sine = (1 - t**2) / (1 + t**2), 2 * t / (1 + t**2)
    return (cosine if z.real >= 0 else -cosine), sine


def _between(values: npt.NDArray[Any]) -> list[float]:
    """Return numbers from zero up, below the largest of the values, far from them all."""
    levels = np.unique(values)
    lower = np.concatenate([[-np.inf], levels[:-1]])
    found = []
    for low, high in zip(lower, levels, strict=True):
        if high > 0:
            middle = max(0.0, (low + high) / 2)
            found.append((min(middle - low, high - middle), middle))
    return [middle for _, middle in sorted(found, reverse=True)[:TRIES]]


def _rational(matrix: npt.NDArray[Any]) -> Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]
