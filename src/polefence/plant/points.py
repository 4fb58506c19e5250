"""Points of a family: parameter values and weights; corners, edges and seeded samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from itertools import combinations, product
from math import prod
from typing import Any

import numpy as np

from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.text import unit_text

SEED = 20050801
EDGE_POINTS = 9
MOST_POINTS = 20_000


def values_at(plant: UncertainPlant, alpha: Sequence[Any]) -> dict[str, float] | None:
    """Return the parameters' values at alpha; None where none have this alpha.

    That is where the plant has no parameters, or alpha is no product of their weights.
    """
    count = len(plant.parameters)
    high = [
        sum((Fraction(a) for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        for bit in reversed(range(count))
    ]
    for j, a in enumerate(alpha):
        bits = zip(high, reversed(range(count)), strict=True)
        weight = prod((w if j >> bit & 1 else 1 - w for w, bit in bits), start=Fraction(1))
        if not count or abs(weight - Fraction(a)) > Fraction(1, 10**9):
            return None
    values = {}
    for p, w in zip(plant.parameters, high, strict=True):
        low, top = p.scheduling(p.low), p.scheduling(p.high)
        values[p.name] = float(p.scheduling(low + w * (top - low)))
    return values


def values_text(plant: UncertainPlant, values: dict[str, float]) -> str:
    """Print parameter values with their units."""
    units = {p.name: unit_text(p.unit) for p in plant.parameters}
    return ", ".join(f"{name} = {v:.6g} {units[name]}".rstrip() for name, v in values.items())


def where_text(plant: UncertainPlant, alpha: Sequence[float], digits: int = 4) -> str:
    """Return " at m1 = 300 kg", or " at alpha = (...)" where it has no values; "" of one vertex."""
    if len(plant.vertices) == 1:
        return ""
    values = values_at(plant, alpha)
    if values is not None:
        return f" at {values_text(plant, values)}"
    return f" at alpha = ({', '.join(f'{a:.{digits}g}' for a in alpha)})"


def weights_of(parameters: Sequence[Parameter], values: Array) -> Array:
    """Return alpha (count, N) of parameter values (count, q), each at its bounds beyond them."""
    alpha = np.ones((len(values), 1))
    for p, column in zip(parameters, values.T, strict=True):
        low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
        share = np.clip((p.scheduling(column) - low) / (high - low), 0, 1)
        pair = np.stack([1 - share, share], axis=-1)
        alpha = (alpha[:, :, None] * pair[:, None, :]).reshape(len(values), 2 * alpha.shape[1])
    return alpha


def exact_alpha(
    coordinates: Array, sizes: tuple[int, ...], rounded: Callable[[float], Fraction]
) -> list[Fraction]:
    """Return alpha, exactly on the simplex or exactly a product, near a point of a domain."""
    weights = []
    for part in np.split(coordinates, np.cumsum(sizes)[:-1]):
        shares = [rounded(float(c)) for c in part]
        if not any(shares):
            shares = [Fraction(int(k == 0)) for k in range(len(part))]
        weights.append([w / sum(shares) for w in shares])
    return joint(weights)


def joint(weights: Iterable[Sequence[Fraction]]) -> list[Fraction]:
    """Return alpha of exact weights on each simplex: their products, the first one slowest."""
    return [prod(choice, start=Fraction(1)) for choice in product(*weights)]


def edges(domain: Domain, points: int = EDGE_POINTS, some: Sequence[int] | None = None) -> Array:
    """Return corners and interior points of the edges, in a domain's own coordinates.

    An edge joins two corners that differ in one of the simplices.

    Parameters
    ----------
    points : int
        Of each edge.
    some : sequence of int, optional
        Numbers of the edges that are looked at; all without it.
    """
    corners = np.array(domain.monomials(1), dtype=float)
    pairs = [(a, b) for a, b in combinations(corners, 2) if np.count_nonzero(a != b) == 2]
    if some is not None:
        pairs = [pairs[i] for i in some]
    inner = np.linspace(0, 1, points + 2)[1:-1, None]
    return np.vstack([corners, *(inner * a + (1 - inner) * b for a, b in pairs)])


def inside(domain: Domain, count: int, seed: int = SEED) -> Array:
    """Return seeded points of a domain, in its own coordinates (count, coordinates).

    On each simplex half of them are uniform, half are pressed towards its faces.
    """
    columns = [_of_simplex(size, count, seed + f) for f, size in enumerate(domain.sizes)]
    if len(columns) > 1:
        random = np.random.default_rng(seed)
        columns = [random.permutation(column) for column in columns]
    return np.hstack(columns)


def _of_simplex(N: int, count: int, seed: int) -> Array:
    random = np.random.default_rng(seed)
    half = count // 2
    return np.vstack(
        [random.dirichlet(np.ones(N), count - half), random.dirichlet(np.full(N, 0.3), half)]
    )


def sample(domain: Domain, states: int = 1) -> Array:
    """Return points of a domain in its own coordinates: corners, edges and a seeded sample.

    All corners, and of the rest fewer where there are many corners or many states. On a box the
    middles between corners stand for the edges.
    """
    # what looking at a sample may cost, in cubes of the number of states
    most = int(min(MOST_POINTS, 2e8 / states**3))
    count = min(2000, max(2, most // 3))
    if domain.sizes == (1,):
        return np.ones((1, 1))
    between = inside(domain, count)
    if len(domain.sizes) == 1:
        (N,) = domain.sizes
        pairs = N * (N - 1) // 2
        points = max(1, min(EDGE_POINTS, (most - N - count) // pairs))
        room = max(0, most - N - count) // points
        kept = None
        if room < pairs:
            kept = sorted(np.random.default_rng(SEED).permutation(pairs)[:room].tolist())
        return np.vstack([edges(domain, points, kept), between])
    corners = np.array(domain.monomials(1), dtype=float)
    middles = (corners[:, None] + corners[None, :]).reshape(-1, corners.shape[1]) / 2
    return np.vstack([corners, np.unique(middles, axis=0)[:count], between])


@explained
def seeded(plant: UncertainPlant, count: int = 10_000, seed: int = 20051) -> Array:
    """Return points of a family as alpha (count, N): its vertices, and others at random.

    Where the plant has parameters the others are uniform in the box of their values; else on the
    simplex. Of one vertex it is that alone.
    """
    N = len(plant.vertices)
    if N == 1:
        return np.ones((1, 1))
    random, more = np.random.default_rng(seed), max(count - N, 0)
    if plant.parameters:
        values = [random.uniform(float(p.low), float(p.high), more) for p in plant.parameters]
        others = weights_of(plant.parameters, np.stack(values, axis=1))
    else:
        others = random.dirichlet(np.ones(N), more)
    return np.vstack([np.eye(N), others])[:count]
