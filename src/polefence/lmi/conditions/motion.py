"""Parameters that move: what they add to a condition on a Lyapunov polynomial X.

N + N' becomes N + N' - dX/dt, or in discrete time N + N' - (X(p(t + T)) - X(p(t))) / T, at the
extremes of the rates. See `polefence.proof.motion`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from math import comb, prod

from polefence.base.errors import SolverError
from polefence.lmi.conditions.pencil import Linear
from polefence.plant.motion import Motion, Move
from polefence.plant.polynomial import Domain, Exponent

Weights = dict[Exponent, dict[Exponent, float]]  # of coefficients in those of another polynomial
Terms = list[tuple[tuple[int, int], float]]  # of a form in the two coordinates of one simplex


def halves(
    motion: Motion, X: Mapping[Exponent, Linear], domain: Domain, total: int
) -> dict[Exponent, tuple[Linear, ...]]:
    """Return half of dX/dt, or of the change of X in a sample, at every extreme of the rates.

    Parameters
    ----------
    X : mapping
        Coefficients by exponents.
    total : int
        The degree of what is returned; nothing is where X is constant.

    Raises
    ------
    SolverError
        If X is not affine in parameters that move in discrete time.
    """
    degree = sum(next(iter(X))[: domain.sizes[0]])
    if not degree or not motion.moves:
        return {}
    motion.require(domain)
    if motion.centre is None:
        tables = [change(move, domain, degree, total) for move in motion.moves]
        rates = list(product(*(move.rates or (0.0, 0.0) for move in motion.moves)))
        halved = {}
        for e in domain.monomials(total):
            slopes = [_sum(table.get(e, {}), X) for table in tables]
            halved[e] = tuple(_mixed(slopes, corner) for corner in rates)
        return halved
    if degree > 1:
        raise SolverError("in discrete time X must be affine in moving parameters")
    ends = product(range(2), repeat=len(motion.moves))
    steps = [_step(motion, corner, domain, total) for corner in ends]
    return {
        e: tuple(0.5 * _sum(table.get(e, {}), X) for table in steps)
        for e in domain.monomials(total)
    }


def _sum(weights: Mapping[Exponent, float], X: Mapping[Exponent, Linear]) -> Linear:
    total = Linear()
    for d, weight in weights.items():
        if weight:
            total = total + weight * X[d]
    return total


def _mixed(slopes: Sequence[Linear], rates: Sequence[float]) -> Linear:
    total = Linear()
    for slope, rate in zip(slopes, rates, strict=True):
        if rate:
            total = total + (rate / 2) * slope
    return total


def _step(motion: Motion, ends: tuple[int, ...], domain: Domain, total: int) -> Weights:
    """Return X(p(t + T)) - X(p(t)) as weights of the coefficients of X, of degree one."""
    end = {move.simplex: (move, k) for move, k in zip(motion.moves, ends, strict=True)}
    ones, weights = _ones(total - 1), Weights()
    for d in domain.monomials(1):
        pairs = [(d[2 * f], d[2 * f + 1]) for f in range(len(domain.sizes))]
        after = [
            _after(*end[f], pair) if f in end else [(pair, 1.0)] for f, pair in enumerate(pairs)
        ]
        for forms, sign in ((after, 1.0), ([[(pair, 1.0)] for pair in pairs], -1.0)):
            for parts in product(*(_times(form, ones) for form in forms)):
                e = sum((part for part, _ in parts), ())
                row = weights.setdefault(e, {})
                row[d] = row.get(d, 0.0) + sign * prod(w for _, w in parts)
    return weights


def _after(move: Move, end: int, pair: tuple[int, int]) -> Terms:
    """Return a coordinate of a simplex one sample later: a - d, or b + d."""
    low, high = move.ends
    if move.rates is None:
        shift = ((0.0, -1.0), (1.0, 0.0))[end]  # to either end
    elif move.inverted:
        most = max(abs(low), abs(high))
        size = -move.rates[end] * most / (high - low)
        shift = size * abs(low), size * abs(high)
    else:
        shift = (move.rates[end] / (high - low),) * 2
    sign = 1.0 if pair[1] else -1.0
    return [(k, float(k == pair) + sign * d) for k, d in zip(((1, 0), (0, 1)), shift, strict=True)]


@cache
def change(move: Move, domain: Domain, degree: int, total: int) -> Weights:
    """Return dX/dp as weights of the coefficients of X, raised to a degree of ``total``."""
    low, high = move.ends
    square: Terms = [((0, 0), 1.0)]
    if move.inverted:  # s = 1/p changes with s^2 dp/dt
        square = [((2, 0), low * low), ((1, 1), 2 * low * high), ((0, 2), high * high)]
    quadratic = _times(square, _ones(total - degree + 1 - sum(square[0][0])))
    ones, weights = _ones(total - degree), Weights()
    for d in domain.monomials(degree):
        pairs = [(d[2 * f], d[2 * f + 1]) for f in range(len(domain.sizes))]
        factors = [
            _times(_slope(*pair), quadratic) if f == move.simplex else _times([(pair, 1.0)], ones)
            for f, pair in enumerate(pairs)
        ]
        for parts in product(*factors):
            e = sum((part for part, _ in parts), ())
            row = weights.setdefault(e, {})
            row[d] = row.get(d, 0.0) + prod(w for _, w in parts) / abs(high - low)
    return weights


def _ones(power: int) -> Terms:
    """Return the terms of (a + b)^power."""
    return [((i, power - i), float(comb(power, i))) for i in range(power + 1)]


def _times(one: Terms, other: Terms) -> Terms:
    return [((a + c, b + d), w * v) for (a, b), w in one for (c, d), v in other]


def _slope(i: int, j: int) -> Terms:
    """Return the terms of (d/db - d/da) a^i b^j."""
    terms: Terms = [((i, j - 1), float(j))] if j else []
    return terms + ([((i - 1, j), -float(i))] if i else [])
