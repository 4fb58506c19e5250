"""Errors that do make a pole leave the region: sampled in floats, confirmed in exact arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import permutations
from itertools import product as every_of
from typing import Protocol

import numpy as np

from polefence.certify.candidates import edge, first
from polefence.certify.counterexample import leaves
from polefence.certify.design import Design
from polefence.certify.margins.gains import MOST, Gains
from polefence.plant.parameters import Parameter
from polefence.plant.points import exact_alpha, inside, joint, weights_of
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import matrices, work
from polefence.proof.claims.poles import Poles
from polefence.proof.matrices import Rationals, product
from polefence.proof.regions import parts_of
from polefence.proof.short import Short
from polefence.region.regions import Region

GRID = {1: 65, 2: 13, 3: 6}  # points of each interval, by the number of parameters; else 4
NEAR, SPREADS = 64, (0.1, 0.03, 0.01)  # more points about the worst, within shares of the ranges
MOST_PAIRS = 2000  # of them at all
ROUNDS = 10  # of bisection
CORNERS, INNER = 64, 48  # points of the family that are looked at
TURNS = 3  # times that the directions are chosen, each from where the last ones led
RETRIES = (1.0, 1.001, 1.01)  # larger errors tried where the exact test does not confirm one


@dataclass(frozen=True)
class Break(Short):
    """An error, as a multiple of what was asked for, and where a pole leaves."""

    value: float
    example: str


class _Errors(Protocol):
    """Closed loops with errors of a size, one for each direction that is looked at."""

    def at(self, t: float) -> Array:
        """Return the loops with errors t times their directions, (count, n, n)."""


def _distance(errors: _Errors, region: Region, t: float) -> Array:
    """Return how far the farthest pole of each loop is outside."""
    return np.asarray(region.distance(np.linalg.eigvals(errors.at(t))).max(axis=-1))


def _smallest_break(
    errors: _Errors, region: Region, least: float, most: float = 1.0
) -> float | None:
    """Return a small t, from ``least`` to ``most``, that breaks; None where the latter does not."""

    def kept(t: float) -> bool:
        return not bool(_distance(errors, region, t).max() > 0)

    if kept(most):
        return None
    return edge(kept, max(least, 1e-6), most, ROUNDS, geometric=True)[1]


Exactly = Callable[[float], tuple[tuple[Rationals, Rationals] | None, str]]


def _confirmed(exactly: Exactly, claim: Poles, errors: Sequence[float]) -> Break | None:
    """Return the first error of which a pole is outside exactly; ``exactly`` has loop and place."""

    def outside(error: float) -> Break | None:
        try:
            loop, example = exactly(error)
            found = loop is not None and leaves(loop, claim.region)
        except work.FormatError:  # more work than is done here
            return None
        return Break(error, example) if found else None

    return first(map(outside, errors))


def _claim(design: Design, region: Region) -> Poles:
    return replace(design.certificate.at_rest.claim(), region=parts_of(region.document()))


# --- errors of the estimate ----------------------------------------------------------------------


def estimate_break(
    design: Design, region: Region, unit: Sequence[Fraction], least: float
) -> Break | None:
    """Return errors t * ``unit``, ``least`` <= t <= 1, at which a pole is not in the region."""
    kind = _Parameters if design.plant.parameters else _Weights
    pairs: _Parameters | _Weights = kind.of(design, unit)
    t = _smallest_break(pairs, region, least)
    if t is None:
        return None
    random = np.random.default_rng(0)
    for spread in SPREADS:
        closer = pairs.near(int(_distance(pairs, region, t).argmax()), spread, random)
        smaller = _smallest_break(closer, region, least, t)
        t, pairs = (t, pairs) if smaller is None else (smaller, closer)
    claim = _claim(design, region)

    def exactly(error: float) -> tuple[tuple[Rationals, Rationals], str]:
        """Return the loop of A(own) + B(own) K(estimated), what is measured being C(own) x."""
        worst = int(_distance(pairs, region, error).argmax())
        own, estimated, example = pairs.exactly(error, worst)
        A, B = matrices.mix(own, claim.A), matrices.mix(own, claim.B)
        N, law = len(claim.A), claim.law
        law = replace(law, C=(matrices.mix(own, list(law.C)),) * N) if law.C else law
        frozen = replace(claim, A=[A] * N, B=[B] * N, law=law)
        return frozen.fraction_at(estimated), example

    return _confirmed(exactly, claim, [min(t * factor, 1.0) for factor in RETRIES])


@dataclass(frozen=True, eq=False)
class _Parameters:
    """Pairs of parameter values, the estimates and the same off by t * unit * signs."""

    design: Design
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
        every = np.array(list(every_of(*((-1, 1) if u else (0,) for u in unit))))
        estimates = np.repeat(points, len(every), axis=0)
        signs = np.tile(every, (len(points), 1))
        kept = np.random.default_rng(0).permutation(len(estimates))[:MOST_PAIRS]
        return cls(design, tuple(unit), estimates[kept], signs[kept])

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The plant's."""
        return self.design.plant.parameters

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

    def at(self, t: float) -> Array:
        """Return the loops of parameters that are off their estimates."""
        own = self.estimates + t * self.signs * np.array([float(u) for u in self.unit])
        own = np.clip(own, *self.bounds())
        plant, law = (weights_of(self.parameters, values) for values in (own, self.estimates))
        return _closed(self.design, plant, law)

    def exactly(self, t: float, index: int) -> tuple[list[Fraction], list[Fraction], str]:
        """Return true and estimated alpha of one pair, exactly, and their parameter values."""
        own, estimated, words = [], [], []
        for p, u, value, sign in zip(
            self.parameters, self.unit, self.estimates[index], self.signs[index], strict=True
        ):
            q = min(max(Fraction(float(value)), p.low), p.high)
            true = min(max(q + Fraction(t) * u * int(sign), p.low), p.high)
            own.append(p.weights(true))
            estimated.append(p.weights(q))
            words.append(f"{p.name} = {float(true):.6g} taken for {float(q):.6g}")
        return joint(own), joint(estimated), ", ".join(words)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Pairs of points of the simplex that differ by a share t, moved between two vertices."""

    design: Design
    points: Array
    ends: Array

    @classmethod
    def of(cls, design: Design, unit: Sequence[Fraction]) -> _Weights:  # noqa: ARG003
        """Return all moves at vertices and at a sample of points."""
        N = len(design.plant.vertices)
        ends = np.array(list(permutations(range(N), 2)) or [(0, 0)])
        points = np.vstack([np.eye(N), inside(Domain((N,)), max(MOST_PAIRS // len(ends), 8))])
        return cls(design, np.repeat(points, len(ends), axis=0), np.tile(ends, (len(points), 1)))

    def near(self, index: int, spread: float, random: np.random.Generator) -> _Weights:
        """Return a pair, and others about it with the same move."""
        mates = random.dirichlet(np.full(self.points.shape[1], 0.5), NEAR)
        mates[0] = self.points[index]
        points = (1 - spread) * self.points[index] + spread * mates
        return _Weights(self.design, points, np.repeat(self.ends[index : index + 1], NEAR, axis=0))

    def at(self, t: float) -> Array:
        """Return the loops of weights that are off their estimates."""
        corners = np.eye(self.points.shape[1])
        kept = (1 - t) * self.points
        plant, law = (kept + t * corners[own] for own in self.ends.T)
        return _closed(self.design, plant, law)

    def exactly(self, t: float, index: int) -> tuple[list[Fraction], list[Fraction], str]:
        """Return both points of one pair, and what they are."""
        share, N = Fraction(t), self.points.shape[1]
        point = exact_alpha(self.points[index], (N,), lambda a: Fraction(round(a * 2**30)))
        kept = [(1 - share) * a for a in point]
        both = [[a + share * (j == k) for j, a in enumerate(kept)] for k in self.ends[index]]
        words = (f"({', '.join(f'{float(a):.4g}' for a in alpha)})" for alpha in both)
        return both[0], both[1], "alpha = {} taken for {}".format(*words)


def _closed(design: Design, plant: Array, law: Array) -> Array:
    """Return the loops of the plant at one alpha and the law at another."""
    A, B = design.plant.at(plant)
    return np.asarray(A + B @ design.law.told(plant, law))


# --- errors of the gain --------------------------------------------------------------------------


def gain_break(design: Design, region: Region, gains: Gains, least: float) -> Break | None:
    """Return an error of each gain, from ``least`` to `MOST`, at which a pole is not in the region.

    All gains are off by as much. Their signs are those that move a pole outwards fastest, to first
    order; all of one sign besides.
    """
    alphas, (n, _) = _places(design), design.plant.shape
    points = np.array(alphas, dtype=float)
    A, B = design.plant.at(points)
    closed, C = A + B @ design.law.gain(points), gains.rows(points, n)
    signs = _outward(closed, B, C, gains.sizes, region)
    same = np.broadcast_to(np.ones_like(gains.sizes), (len(points), 1, *gains.sizes.shape))
    signs = np.concatenate([signs, same, -same], axis=1)
    count = signs.shape[1]
    closed, B, C = (np.repeat(each, count, axis=0) for each in (closed, B, C))
    signs = signs.reshape(-1, *gains.sizes.shape)
    best: tuple[float, int, Array] | None = None
    for _ in range(TURNS):
        moved = _Moved(closed, B @ (signs * gains.sizes) @ C)
        t = _smallest_break(moved, region, least, MOST)
        if t is None:
            break
        if best is None or t < best[0]:
            worst = int(_distance(moved, region, t).argmax())
            best = t, worst, signs[worst]
        loops = moved.at(t)
        turned = _outward(loops, B, C, gains.sizes, region)
        worst_poles = region.distance(np.linalg.eigvals(loops)[..., None]).reshape(len(loops), n)
        signs = turned[np.arange(len(signs)), worst_poles.argmax(axis=-1)]
    if best is None:
        return None
    (error, worst, signs), claim = best, _claim(design, region)
    alpha = alphas[worst // count]

    def exactly(size: float) -> tuple[tuple[Rationals, Rationals], str]:
        weights = ", ".join(f"{float(a):.4g}" for a in alpha)
        return _off(claim, gains.sizes, alpha, signs, size), f"at alpha = ({weights})"

    return _confirmed(exactly, claim, [error * factor for factor in RETRIES])


@dataclass(frozen=True, eq=False)
class _Moved:
    """Closed loops, and what errors of the gain of size one add to them."""

    closed: Array
    moves: Array

    def at(self, t: float) -> Array:
        """Return the loops with errors t times their directions."""
        return np.asarray(self.closed + t * self.moves)


def _places(design: Design) -> list[list[Fraction]]:
    """Return corners of the family and points between, alpha in exact weights."""
    N, q = len(design.plant.vertices), len(design.plant.parameters)
    domain = Domain((2,) * q or (N,))
    corners = [[Fraction(int(j == k)) for j in range(N)] for k in range(min(N, CORNERS))]
    samples = [inside(Domain((size,)), INNER, seed) for seed, size in enumerate(domain.sizes)]
    between = np.hstack(samples)
    short = (exact_alpha(p, domain.sizes, lambda a: Fraction(round(a * 1024))) for p in between)
    return [*corners, *short]


def _outward(closed: Array, B: Array, C: Array, sizes: Array, region: Region) -> Array:
    """Return for each pole, (count, n, m, r), the signs of errors that move it outwards fastest.

    A pole with eigenvectors y' and x, y' x = 1, moves by y' B D C x.
    """
    poles, X = np.linalg.eig(closed)
    Y = np.linalg.pinv(X)
    step = 1e-6 * region.size
    here = region.distance(poles)
    slope = region.distance(poles + step) - here - 1j * (region.distance(poles + 1j * step) - here)
    rows, columns = Y @ B, (C @ X).swapaxes(-1, -2)
    G = np.real(slope[..., None, None] * rows[..., :, None] * columns[..., None, :])
    return np.where(G < 0, -1.0, 1.0) * (sizes > 0)


def _off(
    claim: Poles, sizes: Array, alpha: list[Fraction], signs: Array, error: float
) -> tuple[Rationals, Rationals]:
    """Return the loop whose gains are off, exactly."""
    off = [
        [Fraction(float(s)) * int(sign) * Fraction(error) for s, sign in zip(*rows, strict=True)]
        for rows in zip(sizes, signs, strict=True)
    ]
    N, W = claim.fraction_at(alpha)
    if claim.law.C:
        off = product(off, matrices.mix(alpha, list(claim.law.C)))
    more = product(product(matrices.mix(alpha, claim.B), off), W)
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(N, more, strict=True)], W
