"""Errors that do make a pole leave the region: sampled in floats, confirmed in exact arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import permutations, product

import numpy as np

from polefence.design.counterexample import leaves
from polefence.design.design import Design
from polefence.plant.parameters import Parameter
from polefence.plant.points import inside, weights_of
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import matrices, placement, work
from polefence.region.regions import Region

GRID = {1: 65, 2: 13, 3: 6}  # points of each interval, by the number of parameters; else 4
NEAR, SPREADS = 64, (0.1, 0.03, 0.01)  # more points about the worst, within shares of the ranges
MOST = 2000  # of them at all
ROUNDS = 10  # of bisection
RETRIES = (1.0, 1.001, 1.01)  # larger errors tried where the exact test does not confirm one


@dataclass(frozen=True)
class Break:
    """An error, as a multiple of what was asked for, and where a pole leaves."""

    value: float
    example: str


def estimate_break(
    design: Design, region: Region, unit: Sequence[Fraction], least: float
) -> Break | None:
    """Return errors t * ``unit``, ``least`` <= t <= 1, at which a pole is not in the region."""
    pairs = _Parameters.of(design, unit) if design.plant.parameters else _Weights.of(design)
    t = least_break(_breaks(design, region, pairs), least)
    if t is None:
        return None
    random = np.random.default_rng(0)
    for spread in SPREADS:
        closer = pairs.near(_worst(design, region, pairs, t)[1], spread, random)
        smaller = least_break(_breaks(design, region, closer), least, t)
        t, pairs = (t, pairs) if smaller is None else (smaller, closer)
    for larger in (min(t * factor, 1.0) for factor in RETRIES):
        own, estimated, text = pairs.exactly(larger, _worst(design, region, pairs, larger)[1])
        if _leaves(design, region, own, estimated):
            return Break(larger, text)
    return None


def least_break(breaks: Callable[[float], bool], least: float, most: float = 1.0) -> float | None:
    """Return a small t, from ``least`` to ``most``, that breaks; None where the latter does not."""
    low, high = max(least, 1e-6), most
    if not breaks(high):
        return None
    for _ in range(ROUNDS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if breaks(middle) else (middle, high)
    return high


def _breaks(
    design: Design, region: Region, pairs: _Parameters | _Weights
) -> Callable[[float], bool]:
    return lambda t: _worst(design, region, pairs, t)[0] > 0


def _worst(
    design: Design, region: Region, pairs: _Parameters | _Weights, t: float
) -> tuple[float, int]:
    """Return how far outside the farthest pole is, and of which pair."""
    plant, law = pairs.alphas(t)
    A, B = design.plant.at(plant)
    distance = region.distance(np.linalg.eigvals(A + B @ design.law.gain(law))).max(axis=-1)
    return float(distance.max()), int(distance.argmax())


def _leaves(design: Design, region: Region, own: list[Fraction], estimated: list[Fraction]) -> bool:
    """Whether a pole of A(own) + B(own) K(estimated) is not in the region, exactly."""
    claim = replace(design.certificate.claim(), region=placement.read_region(region.document()))
    A, B = matrices.mix(own, claim.A), matrices.mix(own, claim.B)
    frozen = replace(claim, A=[A] * len(claim.A), B=[B] * len(claim.A))
    try:
        return leaves(placement.fraction_at(frozen, estimated), claim.region)
    except work.FormatError:  # more work than is done here
        return False


@dataclass(frozen=True, eq=False)
class _Parameters:
    """Pairs of parameter values, the estimates and the same off by t * unit * signs."""

    parameters: tuple[Parameter, ...]
    unit: tuple[Fraction, ...]
    estimates: Array
    signs: Array

    @classmethod
    def of(cls, design: Design, unit: Sequence[Fraction]) -> _Parameters:
        """Return all signs at every point of a grid."""
        parameters = design.plant.parameters
        q = len(parameters)
        axes = [np.linspace(float(p.low), float(p.high), GRID.get(q, 4)) for p in parameters]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, q)
        every = np.array(list(product(*((-1, 1) if u else (0,) for u in unit))))
        estimates = np.repeat(points, len(every), axis=0)
        signs = np.tile(every, (len(points), 1))
        kept = np.random.default_rng(0).permutation(len(estimates))[:MOST]
        return cls(parameters, tuple(unit), estimates[kept], signs[kept])

    def bounds(self) -> tuple[Array, Array]:
        """Return the low and the high ends."""
        low = np.array([float(p.low) for p in self.parameters])
        return low, np.array([float(p.high) for p in self.parameters])

    def near(self, index: int, spread: float, random: np.random.Generator) -> _Parameters:
        """Return a pair, and others about it with the same signs."""
        low, high = self.bounds()
        moves = spread * (high - low) * random.uniform(-1, 1, (NEAR, len(low)))
        moves[0] = 0
        estimates = np.clip(self.estimates[index] + moves, low, high)
        signs = np.repeat(self.signs[index : index + 1], NEAR, axis=0)
        return replace(self, estimates=estimates, signs=signs)

    def alphas(self, t: float) -> tuple[Array, Array]:
        """Return alpha of the parameters and of their estimates."""
        own = self.estimates + t * self.signs * np.array([float(u) for u in self.unit])
        own = np.clip(own, *self.bounds())
        return weights_of(self.parameters, own), weights_of(self.parameters, self.estimates)

    def exactly(self, t: float, index: int) -> tuple[list[Fraction], list[Fraction], str]:
        """Return both alphas of one pair, and what they are."""
        own, estimated, words = [Fraction(1)], [Fraction(1)], []
        for p, u, value, sign in zip(
            self.parameters, self.unit, self.estimates[index], self.signs[index], strict=True
        ):
            q = min(max(Fraction(float(value)), p.low), p.high)
            true = min(max(q + Fraction(t) * u * int(sign), p.low), p.high)
            own = [a * w for a in own for w in p.weights(true)]
            estimated = [a * w for a in estimated for w in p.weights(q)]
            words.append(f"{p.name} = {float(true):.6g} taken for {float(q):.6g}")
        return own, estimated, ", ".join(words)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Pairs of points of the simplex that differ by a share t, moved between two vertices."""

    points: Array
    ends: Array

    @classmethod
    def of(cls, design: Design) -> _Weights:
        """Return all moves at vertices and at a sample of points."""
        N = len(design.plant.vertices)
        ends = np.array(list(permutations(range(N), 2)) or [(0, 0)])
        points = np.vstack([np.eye(N), inside(Domain((N,)), max(MOST // len(ends), 8))])
        return cls(np.repeat(points, len(ends), axis=0), np.tile(ends, (len(points), 1)))

    def near(self, index: int, spread: float, random: np.random.Generator) -> _Weights:
        """Return a pair, and others about it with the same move."""
        mates = random.dirichlet(np.full(self.points.shape[1], 0.5), NEAR)
        mates[0] = self.points[index]
        points = (1 - spread) * self.points[index] + spread * mates
        return _Weights(points, np.repeat(self.ends[index : index + 1], NEAR, axis=0))

    def alphas(self, t: float) -> tuple[Array, Array]:
        """Return alpha and its estimate."""
        corners = np.eye(self.points.shape[1])
        kept = (1 - t) * self.points
        return kept + t * corners[self.ends[:, 0]], kept + t * corners[self.ends[:, 1]]

    def exactly(self, t: float, index: int) -> tuple[list[Fraction], list[Fraction], str]:
        """Return both points of one pair, and what they are."""
        share, point = Fraction(t), [Fraction(round(a * 2**30)) for a in self.points[index]]
        kept = [(1 - share) * a / sum(point) for a in point]
        both = [[a + share * (j == k) for j, a in enumerate(kept)] for k in self.ends[index]]
        words = (f"({', '.join(f'{float(a):.4g}' for a in alpha)})" for alpha in both)
        return both[0], both[1], "alpha = {} taken for {}".format(*words)
