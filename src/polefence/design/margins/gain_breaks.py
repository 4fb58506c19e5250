"""Errors of the gain that do make a pole leave the region, confirmed in exact arithmetic."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from polefence.design.counterexample import leaves
from polefence.design.design import Design
from polefence.design.margins.breaks import RETRIES, Break, least_break
from polefence.design.margins.gain import Scales
from polefence.plant.points import inside
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import definite, matrices, placement, work
from polefence.proof.matrices import rational_product as product
from polefence.region.regions import Region

CORNERS, INNER = 64, 48  # points of the family that are looked at
TURNS = 3  # times that the directions are chosen, each from where the last ones led


def gain_break(design: Design, region: Region, scales: Scales, least: float) -> Break | None:
    """Return an error of the gain, from ``least`` to 1, at which a pole is not in the region.

    The directions D are those in which a pole moves outwards fastest, to first order.
    """
    alphas = _places(design)
    points = np.array(alphas, dtype=float)
    A, B = design.plant.at(points)
    closed, left = A + B @ design.law.gain(points), B * scales.rows
    D = _outward(closed, left, scales.columns, region)[1]
    count = D.shape[1]  # one direction a pole
    closed, left = np.repeat(closed, count, axis=0), np.repeat(left, count, axis=0)
    D = D.reshape(-1, *D.shape[2:])
    best: tuple[float, int, Array] | None = None
    for _ in range(TURNS):
        loops = _Loops(closed, left @ (D * scales.columns), region)
        t = least_break(loops.leave, least)
        if t is None:
            break
        if best is None or t < best[0]:
            worst = int(loops.distance(t).argmax())
            best = t, worst, D[worst]
        poles, turned = _outward(loops.at(t), left, scales.columns, region)
        D = turned[np.arange(len(D)), region.distance(poles).argmax(axis=-1)]
    if best is None:
        return None
    error, worst, direction = best
    alpha = alphas[worst // count]
    for factor in RETRIES:
        if _leaves(design, region, scales, alpha, direction, error * factor):
            weights = ", ".join(f"{float(a):.4g}" for a in alpha)
            return Break(error * factor, f"at alpha = ({weights})")
    return None


class _Loops:
    """Closed loops with errors t times their directions."""

    def __init__(self, closed: Array, moves: Array, region: Region) -> None:
        self.closed, self.moves, self.region = closed, moves, region

    def at(self, t: float) -> Array:
        return np.asarray(self.closed + t * self.moves)

    def distance(self, t: float) -> Array:
        """Return how far the farthest pole of each is outside."""
        return np.asarray(self.region.distance(np.linalg.eigvals(self.at(t))).max(axis=-1))

    def leave(self, t: float) -> bool:
        """Whether a pole is outside."""
        return bool(self.distance(t).max() > 0)


def _places(design: Design) -> list[list[Fraction]]:
    """Return corners of the family and points between, alpha in exact weights."""
    N, q = len(design.plant.vertices), len(design.plant.parameters)
    domain = Domain((2,) * q or (N,))
    corners = [[Fraction(int(j == k)) for j in range(N)] for k in range(min(N, CORNERS))]
    samples = [inside(Domain((size,)), INNER, seed) for seed, size in enumerate(domain.sizes)]
    for point in zip(*samples, strict=True):
        alpha = [Fraction(1)]
        for own in point:
            shares = [Fraction(round(float(a) * 1024)) for a in own]
            alpha = [a * share / sum(shares) for a in alpha for share in shares]
        corners.append(alpha)
    return corners


def _outward(closed: Array, left: Array, right: Array, region: Region) -> tuple[Array, Array]:
    """Return the poles, (c, n), and for each the D, |D| = 1, that moves it outwards fastest.

    A pole with eigenvectors y' and x, y' x = 1, moves by t y' left D diag(right) x.
    """
    poles, X = np.linalg.eig(closed)
    Y = np.linalg.pinv(X)
    step = 1e-6 * region.size
    here = region.distance(poles)
    slope = region.distance(poles + step) - here - 1j * (region.distance(poles + 1j * step) - here)
    rows, columns = Y @ left, right[:, None] * X
    G = np.real(
        slope[..., None, None] * rows[..., :, None] * columns.swapaxes(-1, -2)[..., None, :]
    )
    U, _, V = np.linalg.svd(G, full_matrices=False)
    return poles, np.asarray(U @ V)


def _leaves(
    design: Design,
    region: Region,
    scales: Scales,
    alpha: list[Fraction],
    direction: Array,
    error: float,
) -> bool:
    """Whether a pole is not in the region, in exact arithmetic, for an exact |D| <= 1."""
    claim = replace(design.certificate.claim(), region=placement.read_region(region.document()))
    D = [[Fraction(float(d)) * (1 - Fraction(1, 2**30)) for d in row] for row in direction]
    scale = max(row_entry.denominator for row in D for row_entry in row)
    whole = [[int(d * scale) for d in row] for row in D]
    rest = [
        [scale**2 * (i == j) - sum(map(int.__mul__, a, b)) for j, b in enumerate(whole)]
        for i, a in enumerate(whole)
    ]
    if not definite.is_positive_definite(rest):
        return False
    columns = [Fraction(float(c)) * Fraction(error) for c in scales.columns]
    off = [
        [Fraction(float(r)) * d * c for d, c in zip(row, columns, strict=True)]
        for r, row in zip(scales.rows, D, strict=True)
    ]
    try:
        N, W = placement.fraction_at(claim, alpha)
        more = product(product(matrices.mix(alpha, claim.B), off), W)
        N = [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(N, more, strict=True)]
        return leaves((N, W), claim.region)
    except work.FormatError:  # more work than is done here
        return False
