"""Parameters that move: what dX/dt adds to a condition on a Lyapunov polynomial X.

N + N' becomes N + N' - dX/dt: a condition that has N asks for all N - (dX/dt) / 2, at the extremes
of the rates. See `polefence.proof.motion`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from math import comb, prod

from polefence.lmi.conditions.pencil import Linear
from polefence.plant.motion import Motion, Move
from polefence.plant.polynomial import Domain, Exponent

Weights = dict[Exponent, dict[Exponent, float]]  # of coefficients in those of another polynomial
Terms = list[tuple[tuple[int, int], float]]  # of a form in the two coordinates of one simplex


def moved(
    motion: Motion,
    N: Mapping[Exponent, Linear],
    X: Mapping[Exponent, Linear],
    domain: Domain,
) -> dict[Exponent, tuple[Linear, ...]]:
    """Return the coefficients of N - (dX/dt) / 2 at every extreme of the rates.

    Parameters
    ----------
    N, X : mapping
        Coefficients by exponents, each of a degree of its own.
    """
    total, degree = (sum(next(iter(P))[: domain.sizes[0]]) for P in (N, X))
    if not degree:
        return {e: (P,) for e, P in N.items()}
    motion.require(domain)
    tables = [_change(own, domain, degree, total) for own in motion.moves]
    found: dict[Exponent, tuple[Linear, ...]] = {}
    for e, P in N.items():
        slopes = [_sum(table.get(e, {}), X) for table in tables]
        extremes = product(*(own.rates for own in motion.moves))
        found[e] = tuple(_less(P, slopes, rates) for rates in extremes)
    return found


def _sum(weights: Mapping[Exponent, float], X: Mapping[Exponent, Linear]) -> Linear:
    total = Linear()
    for d, weight in weights.items():
        total = total + weight * X[d]
    return total


def _less(N: Linear, slopes: Sequence[Linear], rates: Sequence[float]) -> Linear:
    for slope, rate in zip(slopes, rates, strict=True):
        if rate:
            N = N + (-rate / 2) * slope
    return N


@cache
def _change(move: Move, domain: Domain, degree: int, total: int) -> Weights:
    """Return dX/dp as weights of the coefficients of X, raised to a degree of ``total``."""
    low, high = move.ends
    square: Terms = [((0, 0), 1.0)]
    if move.inverted:  # s = 1/p changes with s^2 dp/dt
        square = [((2, 0), low * low), ((1, 1), 2 * low * high), ((0, 2), high * high)]
    own = _times(square, _ones(total - degree + 1 - sum(square[0][0])))
    ones, found = _ones(total - degree), Weights()
    for d in domain.monomials(degree):
        pairs = [(d[2 * f], d[2 * f + 1]) for f in range(len(domain.sizes))]
        each = [
            _times(_slope(*pair), own) if f == move.simplex else _times([(pair, 1.0)], ones)
            for f, pair in enumerate(pairs)
        ]
        for parts in product(*each):
            e = sum((part for part, _ in parts), ())
            row = found.setdefault(e, {})
            row[d] = row.get(d, 0.0) + prod(w for _, w in parts) / abs(high - low)
    return found


def _ones(power: int) -> Terms:
    """Return the terms of (a + b)^power."""
    return [((i, power - i), float(comb(power, i))) for i in range(power + 1)]


def _times(one: Terms, other: Terms) -> Terms:
    return [((a + c, b + d), w * v) for (a, b), w in one for (c, d), v in other]


def _slope(i: int, j: int) -> Terms:
    """Return the terms of (d/db - d/da) a^i b^j."""
    terms: Terms = [((i, j - 1), float(j))] if j else []
    return terms + ([((i - 1, j), -float(i))] if i else [])
