"""Search for an alpha whose poles leave the region; each find is confirmed exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np

from polefence.base.errors import PlantError
from polefence.design.outside import leaves
from polefence.law.laws import right_divide
from polefence.plant.controllability import fixed_modes
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import placement, roots, work
from polefence.proof.matrices import mix
from polefence.region.regions import Region, region_of

Measure = Callable[[Any], Array]

SAMPLES = 2000
EDGE_POINTS = 9
MOST_POINTS = 20_000
# What looking at points may cost, all told and in one climb, in cubes of the number of states.
MOST_CUBES, MOST_CUBES_UP = 2e8, 2e7
CHUNK = 2000
MOST_ENTRIES = 4e6  # of vertices mixed exactly, where fixed modes are looked for
STARTS = 4
TIE = 1e-9  # share by which measures differ that rounding does not explain
ROUNDS = 40
SEED = 20050801


def sample_simplex(N: int, count: int, seed: int = SEED) -> Array:
    """Points of the simplex, (count, N): uniform, and as many again pressed towards its faces."""
    random = np.random.default_rng(seed)
    half = count // 2
    return np.vstack(
        [random.dirichlet(np.ones(N), count - half), random.dirichlet(np.full(N, 0.3), half)]
    )


def edges(N: int, points: int = EDGE_POINTS) -> Array:
    """The vertices and ``points`` interior points of every edge, (count, N)."""
    return _edges(N, list(combinations(range(N), 2)), points)


def _edges(N: int, pairs: list[tuple[int, int]], points: int) -> Array:
    rows = [np.eye(N)]
    inner = np.linspace(0, 1, points + 2)[1:-1, None]
    rows += [inner * np.eye(N)[j] + (1 - inner) * np.eye(N)[k] for j, k in pairs]
    return np.vstack(rows)


def counterexample(claim: placement.Claim) -> list[Fraction] | None:
    """Return an alpha at which a pole does not lie in the region, or None if none was found.

    A float search over corners, edges and a seeded sample, refined around the worst points; the
    alpha returned was confirmed in exact arithmetic.
    """
    region = region_of([(part.kind, part.numbers) for part in claim.region])
    for point, worst in worst_points(claim, lambda poles: region.distance(poles).max(axis=-1)):
        if worst < -1e-6 * region.size:
            continue
        alpha = _rational(point, placement.simplices(claim))
        with suppress(work.FormatError):  # more work than is done here: undecided
            if leaves(placement.fraction_at(claim, alpha), claim.region):
                return alpha
    return None


def worst_points(claim: placement.Claim, measure: Measure) -> Iterator[tuple[Array, float]]:
    """Yield points of the domain where a measure of the poles is large, and its value, in floats.

    Parameters
    ----------
    measure : callable
        Of poles (..., n), the larger the worse; infinite where the law has no value.
    """
    domain = Domain(placement.simplices(claim))
    family = _Family(claim, domain, measure)
    points = sample(domain, len(claim.A[0]))
    values = np.concatenate(
        [family.values(points[k : k + CHUNK]) for k in range(0, len(points), CHUNK)]
    )
    # of those that only rounding tells apart the first, not the one that it favours
    top = float(values.max())
    tied = values >= (top - TIE * abs(top) if np.isfinite(top) else top)
    for index in np.argsort(-np.where(tied, top, values), kind="stable")[:STARTS]:
        yield _climb(family, points[index], float(values[index]))


def first_worst(points: Iterable[tuple[Array, float]]) -> tuple[Array, float]:
    """Return the first of points whose measure is the largest, but for rounding."""
    found = list(points)
    top = max(worst for _, worst in found)
    least = top - TIE * abs(top) if np.isfinite(top) else top
    return next((point, worst) for point, worst in found if worst >= least)


def unplaceable(plant: UncertainPlant, region: Region, on: str) -> str | None:
    """Say at which alpha no gain whatever keeps all poles in the region, None if none was found.

    There the plant is uncontrollable and a mode that no gain moves does not lie in the region, both
    in exact arithmetic. Looks at corners, at the middles between them, and at simple fractions near
    the points where a float search finds the plant nearest to uncontrollable.
    """
    domain = Domain.of(on, len(plant.vertices))
    points = sample(domain, plant.shape[0])
    alphas = domain.alpha(points)
    A, B = plant.at(alphas)
    nearest = np.argsort(_controllability(A, B))[:STARTS]
    corners = domain.monomials(1)
    tried = [_simple(np.array(c, dtype=float), domain.sizes) for c in corners]
    tried += [
        _simple((np.array(c, dtype=float) + np.array(d, dtype=float)) / 2, domain.sizes)
        for c, d in combinations(corners[:16], 2)
    ]
    tried += [_simple(points[i], domain.sizes, limit) for i in nearest for limit in (2, 4, 10, 100)]
    parts = placement.read_region(region.document())
    n, m = plant.shape
    for alpha in tried[: int(MOST_ENTRIES / (n * (n + m) * len(plant.vertices)))]:
        matrices = ([getattr(v, f"exact_{x}") for v in plant.vertices] for x in "AB")
        A_, B_ = (tuple(map(tuple, mix(alpha, list(M)))) for M in matrices)
        with suppress(PlantError, work.FormatError), work.counted():
            fixed = fixed_modes(A_, B_)
            if not fixed.count or roots.roots_inside(list(fixed.polynomial), parts, fixed.whole):
                continue
            weights = ", ".join(str(a) for a in alpha)
            return f"at alpha = ({weights}) a pole outside {region} cannot be moved by any gain"
    return None


def _controllability(A: Array, B: Array) -> Array:
    """Return the least singular value of [B, AB, ...], columns scaled, at each point."""
    scale = np.maximum(np.linalg.norm(A, axis=(1, 2)), np.finfo(float).tiny)[:, None, None]
    columns = [B]
    for _ in range(A.shape[-1] - 1):
        columns.append(A @ columns[-1] / scale)
    return np.asarray(np.linalg.svd(np.concatenate(columns, axis=2), compute_uv=False)[:, -1])


def _simple(coordinates: Array, sizes: tuple[int, ...], limit: int = 2) -> list[Fraction]:
    """Return alpha at fractions of a small denominator near a point."""
    alpha, start = [Fraction(1)], 0
    for size in sizes:
        own = [Fraction(float(c)).limit_denominator(limit) for c in coordinates[start:][:size]]
        total = sum(own) or Fraction(1)
        own = own if sum(own) else [Fraction(int(k == 0)) for k in range(size)]
        alpha = [a * w / total for a in alpha for w in own]
        start += size
    return alpha


def sample(domain: Domain, states: int = 1) -> Array:
    """Return points of a domain, (count, coordinates): corners, edges and a seeded sample.

    All corners, and of the rest fewer where there are many corners or many states.
    """
    most = int(min(MOST_POINTS, MOST_CUBES / states**3))
    count = min(SAMPLES, max(2, most // 3))
    random = np.random.default_rng(SEED)
    if domain.sizes == (1,):
        return np.ones((1, 1))
    if len(domain.sizes) == 1:
        (N,) = domain.sizes
        pairs = list(combinations(range(N), 2))
        points = max(1, min(EDGE_POINTS, (most - N - count) // len(pairs)))
        room = max(0, most - N - count) // points
        if room < len(pairs):
            pairs = [pairs[i] for i in np.sort(random.permutation(len(pairs))[:room])]
        return np.vstack([_edges(N, pairs, points), sample_simplex(N, count)])
    # on a box: a point of each interval's own sample, and the corners
    columns = [sample_simplex(size, count, SEED + f) for f, size in enumerate(domain.sizes)]
    columns = [random.permutation(column) for column in columns]
    corners = np.array(domain.monomials(1), dtype=float)
    centres = (corners[:, None] + corners[None, :]).reshape(-1, corners.shape[1]) / 2
    return np.vstack([corners, np.unique(centres, axis=0)[:count], np.hstack(columns)])


class _Family:
    """The claim's closed loops as floats, and a measure of their poles."""

    def __init__(self, claim: placement.Claim, domain: Domain, measure: Measure) -> None:
        self.A, self.B = (np.array(M, dtype=float) for M in (claim.A, claim.B))
        self.domain, self.law, self.measure = domain, claim.law, measure
        self.K = None if claim.law.K is None else np.array(claim.law.K[0], dtype=float)
        if self.K is None:
            self.W, self.Z = (np.array(M, dtype=float) for M in (claim.law.W, claim.law.Z))

    def values(self, coordinates: Array) -> Array:
        alpha = self.domain.alpha(coordinates)
        A, B = np.tensordot(alpha, self.A, 1), np.tensordot(alpha, self.B, 1)
        try:
            if self.K is not None:
                K = self.K
            else:
                basis = self.domain.basis(alpha, self.law.degree)
                K = right_divide(np.tensordot(basis, self.Z, 1), np.tensordot(basis, self.W, 1))
            poles = np.linalg.eigvals(A + B @ K)
        except np.linalg.LinAlgError:  # a law that is singular somewhere: look point by point
            if len(coordinates) == 1:
                return np.array([np.inf])
            return np.concatenate([self.values(a[None]) for a in coordinates])
        return np.asarray(self.measure(poles))


def _climb(family: _Family, point: Array, worst: float) -> tuple[Array, float]:
    """Seeded random search with a shrinking step, on each simplex."""
    random = np.random.default_rng(SEED)
    cuts = np.cumsum(family.domain.sizes)[:-1]
    step = 0.2
    rounds = min(ROUNDS, int(MOST_CUBES_UP / (16 * family.A.shape[-1] ** 3)))
    for _ in range(rounds if family.A.shape[0] > 1 else 0):
        moved = []
        for own in np.split(point, cuts):
            mates = random.dirichlet(np.full(own.size, 0.5), 16)
            trial = own + step * random.choice([-1.0, 1.0], (16, 1)) * (mates - own)
            trial = np.clip(trial, 0, None)
            moved.append(trial / trial.sum(axis=1, keepdims=True))
        trials = np.hstack(moved)
        values = family.values(trials)
        best = int(np.argmax(values))
        if values[best] > worst + TIE * abs(worst):
            point, worst = trials[best], float(values[best])
        else:
            step *= 0.7
    return point, worst


def _rational(coordinates: Array, sizes: tuple[int, ...]) -> list[Fraction]:
    """Return alpha, exactly on the simplex, or exactly a product, near a point of the domain."""
    alpha, start = [Fraction(1)], 0
    for size in sizes:
        own = coordinates[start : start + size]
        weights = [Fraction(round(float(a) * 2**30), 2**30) for a in own]
        total = sum(weights)
        alpha = [a * w / total for a in alpha for w in weights]
        start += size
    return alpha
