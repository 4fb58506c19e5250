"""Error of the estimates of the parameters: a loop whose law is told others than the plant has."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product

import numpy as np

from polefence.certify.candidates import edge
from polefence.certify.margins.claims import BOX, SIMPLEX, Ladder, Reached, below
from polefence.certify.margins.loops import (
    Balanced,
    Points,
    alpha_of,
    are_positive,
    count_monomials,
    lattice,
    region_block,
)
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.margins import Subject


def estimate_holds(design: Balanced, points: Points) -> bool:
    """Whether all coefficients are positive definite in floats."""
    X, N, _ = design.loop(points)
    if not design.disks and not are_positive(X):
        return False
    one = points.one[..., None, None]
    return all(
        are_positive(region_block(pair, X, N) - one * design.lost(pair[1])) for pair in design.pairs
    )


def count_blocks(design: Balanced, errors: Sequence[float], pieces: int, elevation: int) -> float:
    """Return how many inequalities there are at most."""
    count = count_pairs(design.sizes, design.degrees, design.q, errors, pieces, elevation)
    return count * len(design.pairs)


def count_pairs(
    sizes: tuple[int, ...],
    degrees: tuple[int, int],
    q: int,
    errors: Sequence[float],
    pieces: int,
    elevation: int,
) -> float:
    """Return how many there are for each L, M, of X and of [A, B] of these degrees."""
    of_law, d = degrees
    degree = of_law + d + elevation
    if not q:
        if d == 1:
            return sizes[0] * count_monomials(sizes * 2, (degree, of_law))
        return count_monomials(sizes * 3, (degree, of_law, d))
    moved = sum(map(bool, errors)) if d > 1 else 0
    of_piece = count_monomials((2,) * (q + moved), (degree,) * q + (d,) * moved)
    most = pieces + 2 if moved else 2 * (pieces + 1)
    return of_piece * math.prod(most if error else pieces for error in errors)


def points_of(
    design: Balanced,
    parameters: Sequence[Parameter],
    errors: Sequence[float],
    pieces: int,
    elevation: int,
) -> Points:
    """Return points of the pieces on which p is affine in its estimate, for all signs."""
    d = design.plant_degree
    degree = design.degree + d + elevation
    if not parameters:
        return _mislaid(design, errors[0], degree)
    moved = [f for f, error in enumerate(errors) if error and d > 1]
    sizes, degrees = (2,) * (design.q + len(moved)), (degree,) * design.q + (d,) * len(moved)
    nodes, coefficients = lattice(sizes, degrees)
    pairs = zip(parameters, errors, strict=True)
    segments = [_segments(parameter, error, pieces, d > 1) for parameter, error in pairs]
    cells = np.array(list(product(*segments)))[:, None]  # (cells, 1, parameters, side, low or high)
    along = nodes[:, 1::2]
    values = cells[..., 0] + along[:, : design.q, None] * (cells[..., 1] - cells[..., 0])
    true, estimated, across = values[..., 0], values[..., 2], np.zeros((len(nodes), design.q))
    across[:, moved] = along[:, design.q :]
    true = true + across * (values[..., 1] - true)
    shares, factor = [np.empty_like(true), np.empty_like(true)], np.ones(true.shape[:2])
    for f, parameter in enumerate(parameters):
        ends = [float(parameter.scheduling(end)) for end in (parameter.low, parameter.high)]
        for share, p in zip(shares, (true[..., f], estimated[..., f]), strict=True):
            share[..., f] = ((1 / p if parameter.inverted else p) - ends[0]) / (ends[1] - ends[0])
        if parameter.inverted:
            p, q = true[..., f], estimated[..., f]
            factor = factor * np.abs(p) ** d * np.abs(q) ** design.degree
    plant, law = map(alpha_of, shares)
    return Points(plant, law, factor, coefficients)


def _segments(parameter: Parameter, error: float, pieces: int, both: bool) -> list[Array]:
    """Return the ends of the least p, the largest, and the estimate, for each piece.

    For one sign of the error after the other the two are the same, unless ``both`` count at once.
    """
    low, high = float(parameter.low), float(parameter.high)
    segments = []
    for signs in ((-1, 1),) if both else ((-1, -1), (1, 1)) if error else ((0, 0),):
        bends = {low + error if sign < 0 else high - error for sign in signs}
        cuts = {*np.linspace(low, high, pieces + 1), *(b for b in bends if low < b < high)}
        for ends in pairwise(sorted(cuts)):
            true = [np.clip(np.array(ends) + sign * error, low, high) for sign in signs]
            segments.append(np.array([*true, ends]))
    return segments


def _mislaid(design: Balanced, share: float, degree: int) -> Points:
    N, d = len(design.A), design.plant_degree
    degrees = (degree, design.degree) if d == 1 else (degree, design.degree, d)
    nodes, coefficients = lattice((N,) * len(degrees), degrees)
    kept = (1 - share) * nodes[:, :N]
    towards = np.eye(N)[:, None, :] if d == 1 else nodes[None, :, 2 * N :]
    plant = kept[None] + share * towards
    law = np.broadcast_to(kept + share * nodes[:, N : 2 * N], plant.shape)
    return Points(plant, law, np.ones(plant.shape[:2]), coefficients)


@dataclass(frozen=True, eq=False)
class EstimateQuestion:
    """Error of the estimates of parameters, together, as a share of a span of each."""

    loops: tuple[Balanced, ...]
    parameters: tuple[Parameter, ...]
    span: tuple[Fraction, ...]

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried."""
        return BOX if self.parameters else SIMPLEX

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        errors = self._errors(1.0)
        return sum(count_blocks(loop, errors, pieces, elevation) for loop in self.loops)

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest share in [0, 1] that is proved in floats; -1 where not even 0 is."""
        share = min(self._largest(loop, pieces, elevation) for loop in self.loops)
        return Reached(share, pieces, elevation)

    def claim(self, subject: Subject, reached: Reached) -> Estimate:
        """Return the claim of a share, or a little less."""
        t = reached.value
        errors = (s if t == 1 else min(below(t * float(s)), s) for s in self.span)
        return Estimate(subject, tuple(errors))

    def _errors(self, share: float) -> list[float]:
        return [share * float(s) for s in self.span]

    def _largest(self, loop: Balanced, pieces: int, elevation: int) -> float:
        def proved(t: float) -> bool:
            points = points_of(loop, self.parameters, self._errors(t), pieces, elevation)
            return estimate_holds(loop, points)

        if proved(1.0):
            return 1.0
        high = 1.0
        while high > 1e-6:  # of a range
            if proved(high / 4):
                return edge(proved, high / 4, high, 20, close=1e-3)[0]
            high /= 4
        return 0.0 if proved(0.0) else -1.0
