"""Margin of the estimates: how far off the parameters may be that the law is given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product

import numpy as np

from polefence.design.margins.claims import BOX, SIMPLEX, Ladder, Reached, below
from polefence.design.margins.inequalities import (
    Balanced,
    Points,
    alpha_of,
    are_positive,
    count_monomials,
    lattice,
    region_block,
)
from polefence.design.search import edge
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.margins import Subject

LEAST, PRECISION = 1e-6, 1e-3  # of the search: the smallest share of a range, its relative error
HALVINGS = 20  # at most, of what a quarter more breaks


def holds(design: Balanced, points: Points) -> bool:
    """Whether all coefficients are positive definite in floats."""
    X, N, _ = design.loop(points)
    if not design.disks and not are_positive(X):
        return False
    return all(are_positive(region_block(pair, X, N)) for pair in design.pairs)


def count_blocks(design: Balanced, errors: Sequence[float], pieces: int, elevation: int) -> float:
    """Return how many inequalities there are at most."""
    degree = design.degree + 1 + elevation
    if not design.q:
        each = count_monomials(design.sizes * 2, (degree, design.degree))
        return each * len(design.A) * len(design.pairs)
    cells = math.prod(2 * (pieces + 1) if error else pieces for error in errors)
    return count_monomials(design.sizes, (degree,) * design.q) * cells * len(design.pairs)


def points_of(
    design: Balanced,
    parameters: Sequence[Parameter],
    errors: Sequence[float],
    pieces: int,
    elevation: int,
) -> Points:
    """Return points of the pieces on which p is affine in its estimate, for all signs."""
    degree = design.degree + 1 + elevation
    if not parameters:
        return _mislaid(design, errors[0], degree)
    nodes, coefficients = lattice(design.sizes, (degree,) * design.q)
    segments = [_segments(*each, pieces) for each in zip(parameters, errors, strict=True)]
    cells = np.array(list(product(*segments)))  # (cells, parameters, plant or law, low or high)
    values = cells[:, None, :, :, 0] + nodes[None, :, 1::2, None] * (
        cells[:, None, :, :, 1] - cells[:, None, :, :, 0]
    )
    shares, factor = np.empty_like(values), np.ones(values.shape[:2])
    for f, parameter in enumerate(parameters):
        p = values[..., f, :]
        ends = [float(parameter.scheduling(end)) for end in (parameter.low, parameter.high)]
        s = 1 / p if parameter.inverted else p
        shares[..., f, :] = (s - ends[0]) / (ends[1] - ends[0])
        if parameter.inverted:
            factor = factor * np.abs(p[..., 0]) * np.abs(p[..., 1]) ** design.degree
    plant, law = (alpha_of(shares[..., side]) for side in (0, 1))
    return Points(plant, law, factor, coefficients)


def _segments(parameter: Parameter, error: float, pieces: int) -> list[Array]:
    low, high = float(parameter.low), float(parameter.high)
    found = []
    for sign in (-1, 1) if error else (0,):
        bend = low + error if sign < 0 else high - error
        cuts = {*np.linspace(low, high, pieces + 1), *([bend] if low < bend < high else [])}
        for ends in pairwise(sorted(cuts)):
            own = np.clip(np.array(ends) + sign * error, low, high)
            found.append(np.array([own, ends]))
    return found


def _mislaid(design: Balanced, share: float, degree: int) -> Points:
    N = len(design.A)
    nodes, coefficients = lattice((N, N), (degree, design.degree))
    kept = (1 - share) * nodes[:, :N]
    plant = kept[None] + share * np.eye(N)[:, None, :]
    law = np.broadcast_to(kept + share * nodes[:, N:], plant.shape)
    return Points(plant, law, np.ones(plant.shape[:2]), coefficients)


@dataclass(frozen=True, eq=False)
class Question:
    """How far the estimates of parameters may be off, together, as a share of a span of each."""

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
        return sum(count_blocks(own, errors, pieces, elevation) for own in self.loops)

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest share in [0, 1] that is proved in floats; -1 where not even 0 is."""
        share = min(self._largest(own, pieces, elevation) for own in self.loops)
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
            return holds(loop, points)

        if proved(1.0):
            return 1.0
        high = 1.0
        while high > LEAST:
            if proved(high / 4):
                return edge(proved, high / 4, high, HALVINGS, close=PRECISION)[0]
            high /= 4
        return 0.0 if proved(0.0) else -1.0
