"""Rate of the parameters: what a moving Lyapunov polynomial adds to the loop's inequality."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations, product

import numpy as np

from polefence.certify.margins.claims import BOX, SIMPLEX, Ladder, Reached, below
from polefence.certify.margins.loops import (
    Balanced,
    Points,
    alpha_of,
    are_positive,
    count_whole,
    largest_step,
    whole_points,
)
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.rate import Rate


@dataclass(frozen=True, eq=False)
class RateQuestion:
    """Rate of the parameters, together, as a share of a span of each a second.

    ``part`` is the part of the region whose Lyapunov polynomial the loop has.
    """

    loop: Balanced
    part: int
    parameters: tuple[Parameter, ...]
    span: tuple[Fraction, ...]
    decay: float

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried."""
        return BOX if self.parameters else SIMPLEX

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        N = len(self.loop.A)
        signs = 2 ** sum(s > 0 for s in self.span) if self.parameters else N * (N - 1)
        return count_whole(self.loop, pieces, elevation) * signs

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest rate proved in floats: -1 where not even 0 is, infinite if any is."""
        loop, points = self.loop, whole_points(self.loop, pieces, elevation)
        X, N, _ = loop.loop(points)
        still = -(N + N.swapaxes(-1, -2) + 2 * self.decay * X)
        if not (are_positive(X) and are_positive(still)):
            return Reached(-1.0, pieces, elevation)
        slopes = _slopes(loop, points, self.parameters, [float(s) for s in self.span])
        rate = min((largest_step(still, slope) for slope in slopes), default=np.inf)
        # where all W are equal but for rounding, no rate is too large in floats [ranges per second]
        return Reached(rate if loop.constant else min(rate, 1e9), pieces, elevation)

    def claim(self, subject: Subject, reached: Reached) -> Rate:
        """Return the claim of a rate, or a little less."""
        t, decay = reached.value, Fraction(self.decay)
        rates = None if math.isinf(t) else tuple(below(t * float(s)) for s in self.span)
        return Rate(subject, decay, rates, self.part)


def _slopes(
    design: Balanced, points: Points, parameters: Sequence[Parameter], unit: Sequence[float]
) -> list[Array]:
    """Return the coefficients of dW/dt at every extreme of the rates ``unit``."""
    if design.constant:
        return []
    if parameters:
        share = Domain(design.sizes).coordinates(points.law)[..., 1::2]
        values = [
            _moved(design, share, f, parameter, rate)
            for f, (parameter, rate) in enumerate(zip(parameters, unit, strict=True))
        ]
        signs = [np.array(s) for s in product(*((-1, 1) if rate else (0,) for rate in unit))]
    else:
        corners = np.eye(len(design.A))
        values = [_derivative(design, points.law, unit[0] * corner) for corner in corners]
        signs = [to - off for to, off in permutations(corners, 2)]
    return [
        np.einsum("ij,cjab->ciab", points.coefficients, np.tensordot(sign, np.stack(values), 1))
        for sign in signs
    ]


def _moved(design: Balanced, share: Array, f: int, parameter: Parameter, rate: float) -> Array:
    """Return dW/dt where one parameter rises at a rate, at shares of its scheduling variable."""
    low, high = (float(parameter.scheduling(end)) for end in (parameter.low, parameter.high))
    s = low + share[..., f] * (high - low)
    speed = rate / (high - low) * (s**2 if parameter.inverted else np.ones_like(s))
    low_end, high_end = share.copy(), share.copy()
    low_end[..., f], high_end[..., f] = 0, 1
    direction = alpha_of(high_end) - alpha_of(low_end)
    return np.asarray(speed[..., None, None] * _derivative(design, alpha_of(share), direction))


def _derivative(design: Balanced, alpha: Array, direction: Array) -> Array:
    """Return dW in a direction of alpha, from as many values as determine W's polynomial."""
    half = (design.degree + 1) // 2
    steps = np.arange(-half, half + 1)
    powers = np.vander(steps, increasing=True).T.astype(float)
    weights = np.linalg.solve(powers, np.eye(len(steps))[1])
    total = np.zeros((*alpha.shape[:-1], *design.T.shape))
    for k, weight in zip(steps, weights, strict=True):
        total = total + weight * design.law(alpha + k * direction)[0]
    return total
