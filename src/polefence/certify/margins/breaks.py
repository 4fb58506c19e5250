"""Errors that do make a pole leave the region: sampled in floats, confirmed in exact arithmetic.

One search for whatever is off: the least size at which a pole is outside in any of the directions
that are looked at, then in others that start from the worst one, until the exact test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import permutations
from itertools import product as every_of
from typing import Protocol

import numpy as np

from polefence.certify.candidates import edge, first
from polefence.certify.counterexample import leaves
from polefence.certify.design import Design
from polefence.certify.margins.each_gain import Gains
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

NEAR, SPREADS = 64, (0.1, 0.03, 0.01)  # more points about the worst, within shares of the ranges
MOST_PAIRS = 2000  # of them at all

Loop = tuple[Rationals, Rationals]  # N and W of the closed loop N W^-1


@dataclass(frozen=True)
class Break(Short):
    """An error, as a multiple of what was asked for, and where a pole leaves."""

    value: float
    example: str


class Errors(Protocol):
    """A kind of error in closed loops, in each of the directions that are looked at."""

    def at(self, size: float) -> Array:
        """Return the loops with errors of a size, (count, n, n)."""

    def closer(self, size: float, worst: int, turn: int) -> Errors:
        """Return directions from the worst at a size, to be looked at next."""

    def exactly(self, claim: Poles, size: float, worst: int) -> tuple[Loop, str]:
        """Return a loop in exact arithmetic, and where it is."""


def smallest_break(
    errors: Errors, design: Design, region: Region, least: float, most: float = 1.0
) -> Break | None:
    """Return an error, ``least`` to ``most``, at which a pole is not in the region."""
    size = _smallest(errors, region, least, most)
    if size is None:
        return None
    for turn in range(len(SPREADS)):
        closer = errors.closer(size, _worst(errors, region, size), turn)
        smaller = _smallest(closer, region, least, size)
        if smaller is not None:
            size, errors = smaller, closer
    claim = replace(design.certificate.at_rest.claim(), region=parts_of(region.document()))

    def outside(larger: float) -> Break | None:
        try:
            loop, example = errors.exactly(claim, larger, _worst(errors, region, larger))
            return Break(larger, example) if leaves(loop, claim.region) else None
        except work.FormatError:  # more work than is done here
            return None

    # where the exact test does not confirm the first
    return first(outside(min(size * factor, most)) for factor in (1.0, 1.001, 1.01))


def _distances(errors: Errors, region: Region, size: float) -> Array:
    """Return how far the farthest pole of each loop is outside."""
    return np.asarray(region.distance(np.linalg.eigvals(errors.at(size))).max(axis=-1))


def _worst(errors: Errors, region: Region, size: float) -> int:
    return int(_distances(errors, region, size).argmax())


def _smallest(errors: Errors, region: Region, least: float, most: float) -> float | None:
    """Return a small size that breaks; None where the largest does not."""

    def kept(size: float) -> bool:
        return not bool(_distances(errors, region, size).max() > 0)

    if kept(most):
        return None
    return edge(kept, max(least, 1e-6), most, 13, geometric=True)[1]  # a decade to 0.03 %


# --- errors of the estimate ----------------------------------------------------------------------


def estimate_break(
    design: Design, region: Region, unit: Sequence[Fraction], least: float
) -> Break | None:
    """Return errors t * ``unit``, ``least`` <= t <= 1, at which a pole is not in the region."""
    kind = _Parameters if design.plant.parameters else _Weights
    return smallest_break(kind.of(design, unit), design, region, least)


def _told(claim: Poles, true: list[Fraction], estimated: list[Fraction]) -> Loop:
    """Return the loop of A(true) + B(true) K(estimated), what is measured being C(true) x."""
    A, B = matrices.mix(true, claim.A), matrices.mix(true, claim.B)
    N, law = len(claim.A), claim.law
    law = replace(law, C=(matrices.mix(true, list(law.C)),) * N) if law.C else law
    return replace(claim, A=[A] * N, B=[B] * N, law=law).fraction_at(estimated)


@dataclass(frozen=True, eq=False)
class _Parameters:
    """Pairs of parameter values, the estimates and the same off by size * unit * signs."""

    design: Design
    unit: tuple[Fraction, ...]
    estimates: Array
    signs: Array

    @classmethod
    def of(cls, design: Design, unit: Sequence[Fraction]) -> _Parameters:
        """Return all signs at every point of a grid."""
        parameters = design.plant.parameters
        q = len(parameters)
        axes = [
            np.linspace(float(p.low), float(p.high), {1: 65, 2: 13, 3: 6}.get(q, 4))
            for p in parameters
        ]
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

    def closer(self, size: float, worst: int, turn: int) -> _Parameters:  # noqa: ARG002
        """Return a pair, and others about it with the same signs."""
        low, high = self.bounds()
        random = np.random.default_rng(turn)
        moves = SPREADS[turn] * (high - low) * random.uniform(-1, 1, (NEAR, len(low)))
        moves[0] = 0
        estimates = np.clip(self.estimates[worst] + moves, low, high)
        signs = np.repeat(self.signs[worst : worst + 1], NEAR, axis=0)
        return replace(self, estimates=estimates, signs=signs)

    def at(self, size: float) -> Array:
        """Return the loops of parameters that are off their estimates."""
        true = self.estimates + size * self.signs * np.array([float(u) for u in self.unit])
        true = np.clip(true, *self.bounds())
        plant, law = (weights_of(self.parameters, values) for values in (true, self.estimates))
        return _closed(self.design, plant, law)

    def exactly(self, claim: Poles, size: float, worst: int) -> tuple[Loop, str]:
        """Return the loop of one pair, and its parameter values."""
        true, estimated, words = [], [], []
        for p, u, value, sign in zip(
            self.parameters, self.unit, self.estimates[worst], self.signs[worst], strict=True
        ):
            q = min(max(Fraction(float(value)), p.low), p.high)
            off = min(max(q + Fraction(size) * u * int(sign), p.low), p.high)
            true.append(p.weights(off))
            estimated.append(p.weights(q))
            words.append(f"{p.name} = {float(off):.6g} taken for {float(q):.6g}")
        return _told(claim, joint(true), joint(estimated)), ", ".join(words)


@dataclass(frozen=True, eq=False)
class _Weights:
    """Pairs of points of the simplex that differ by a share, moved between two vertices."""

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

    def closer(self, size: float, worst: int, turn: int) -> _Weights:  # noqa: ARG002
        """Return a pair, and others about it with the same move."""
        random, spread = np.random.default_rng(turn), SPREADS[turn]
        mates = random.dirichlet(np.full(self.points.shape[1], 0.5), NEAR)
        mates[0] = self.points[worst]
        points = (1 - spread) * self.points[worst] + spread * mates
        return _Weights(self.design, points, np.repeat(self.ends[worst : worst + 1], NEAR, axis=0))

    def at(self, size: float) -> Array:
        """Return the loops of weights that are off their estimates."""
        corners = np.eye(self.points.shape[1])
        kept = (1 - size) * self.points
        plant, law = (kept + size * corners[end] for end in self.ends.T)
        return _closed(self.design, plant, law)

    def exactly(self, claim: Poles, size: float, worst: int) -> tuple[Loop, str]:
        """Return the loop of one pair, and its points."""
        share, N = Fraction(size), self.points.shape[1]
        point = exact_alpha(self.points[worst], (N,), lambda a: Fraction(round(a * 2**30)))
        kept = [(1 - share) * a for a in point]
        both = [[a + share * (j == k) for j, a in enumerate(kept)] for k in self.ends[worst]]
        words = (f"({', '.join(f'{float(a):.4g}' for a in alpha)})" for alpha in both)
        return _told(claim, *both), "alpha = {} taken for {}".format(*words)


def _closed(design: Design, plant: Array, law: Array) -> Array:
    """Return the loops of the plant at one alpha and the law at another."""
    A, B = design.plant.at(plant)
    return np.asarray(A + B @ design.law.told(plant, law))


# --- errors of the gain --------------------------------------------------------------------------


def gain_break(design: Design, region: Region, gains: Gains, least: float) -> Break | None:
    """Return an error of each gain, from ``least`` up, at which a pole is not in the region.

    All gains are off by as much. Their signs are those that move a pole outwards fastest, to first
    order; all of one sign besides.
    """
    errors = _GainsOff.of(design, region, gains)
    return smallest_break(errors, design, region, least, gains.most)


@dataclass(frozen=True, eq=False)
class _GainsOff:
    """Closed loops at points of the family, with errors of signs (count, m, r)."""

    region: Region
    gains: Gains
    alphas: list[list[Fraction]]
    closed: Array
    B: Array
    C: Array
    signs: Array

    @classmethod
    def of(cls, design: Design, region: Region, gains: Gains) -> _GainsOff:
        """Return the loops with the errors that move each of their poles outwards, and others."""
        alphas, (n, _) = _places(design), design.plant.shape
        points = np.array(alphas, dtype=float)
        A, B = design.plant.at(points)
        closed, C = A + B @ design.law.gain(points), gains.rows(points, n)
        outward = _outward(closed, B, C, gains.sizes, region)
        same = np.ones((len(points), 1, *gains.sizes.shape))
        signs = np.concatenate([outward, same, -same], axis=1)
        count = signs.shape[1]
        closed, B, C = (np.repeat(M, count, axis=0) for M in (closed, B, C))
        alphas = [alpha for alpha in alphas for _ in range(count)]
        return cls(region, gains, alphas, closed, B, C, signs.reshape(-1, *gains.sizes.shape))

    @cached_property
    def moves(self) -> Array:
        """What errors of size one add to the loops."""
        return np.asarray(self.B @ (self.signs * self.gains.sizes) @ self.C)

    def at(self, size: float) -> Array:
        """Return the loops with errors."""
        return np.asarray(self.closed + size * self.moves)

    def closer(self, size: float, worst: int, turn: int) -> _GainsOff:  # noqa: ARG002
        """Return the loops with signs that move their farthest pole outwards from where it is."""
        loops = self.at(size)
        outward = _outward(loops, self.B, self.C, self.gains.sizes, self.region)
        poles = np.linalg.eigvals(loops)
        farthest = self.region.distance(poles[..., None]).reshape(poles.shape).argmax(axis=-1)
        return replace(self, signs=outward[np.arange(len(outward)), farthest])

    def exactly(self, claim: Poles, size: float, worst: int) -> tuple[Loop, str]:
        """Return a loop whose gains are off, and its weights."""
        alpha, signs = self.alphas[worst], self.signs[worst]
        weights = ", ".join(f"{float(a):.4g}" for a in alpha)
        return _off(claim, self.gains.sizes, alpha, signs, size), f"at alpha = ({weights})"


def _places(design: Design) -> list[list[Fraction]]:
    """Return corners of the family and points between, alpha in exact weights."""
    N, q = len(design.plant.vertices), len(design.plant.parameters)
    domain = Domain((2,) * q or (N,))
    corners = [[Fraction(int(j == k)) for j in range(N)] for k in range(min(N, 64))]
    samples = [inside(Domain((size,)), 48, seed) for seed, size in enumerate(domain.sizes)]
    between = np.hstack(samples)
    short = (exact_alpha(p, domain.sizes, lambda a: Fraction(round(a * 1024))) for p in between)
    return [*corners, *short]


def _outward(closed: Array, B: Array, C: Array, sizes: Array, region: Region) -> Array:
    """Return for each pole, (count, n, m, r), the signs of errors that move it outwards fastest.

    A pole with eigenvectors y' and x, y' x = 1, moves by y' B D C x.
    """
    return np.where(_slopes(closed, B, C, region) < 0, -1.0, 1.0) * (sizes > 0)


def _slopes(closed: Array, B: Array, C: Array, region: Region) -> Array:
    """Return for each pole, (count, n, m, r), how fast each entry of D moves it outwards."""
    poles, X = np.linalg.eig(closed)
    Y = np.linalg.pinv(X)
    step = 1e-6 * region.size
    here = region.distance(poles)
    slope = region.distance(poles + step) - here - 1j * (region.distance(poles + 1j * step) - here)
    rows, columns = Y @ B, (C @ X).swapaxes(-1, -2)
    return np.asarray(np.real(slope[..., None, None] * rows[..., :, None] * columns[..., None, :]))


def breaks(design: Design, region: Region, rows: Array, right: Array, error: float) -> bool:
    """Whether the gain, off by error S D T with |D| = 1, leaves the region, as floats say.

    S has ``rows`` on its diagonal, T is the transpose of ``right``. D are those that move each pole
    outwards fastest, to first order, at points of the family. Where one breaks, no matrices prove
    that none does.
    """
    points = np.array(_places(design), dtype=float)
    A, B = design.plant.at(points)
    closed = A + B @ design.law.gain(points)
    left, C = B * rows, np.broadcast_to(right.T, (len(points), *right.T.shape))
    U, _, V = np.linalg.svd(_slopes(closed, left, C, region), full_matrices=False)
    off = closed[:, None] + error * (left[:, None] @ (U @ V) @ C[:, None])
    return bool(region.distance(np.linalg.eigvals(off)).max() > 0)


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
