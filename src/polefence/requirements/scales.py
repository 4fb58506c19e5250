"""Scales of opened loops: D for which the gain of D M D^-1 is about least, and its slopes.

M goes from [w; w_k] to [z; v_k], the last of each those of the loops; p outputs are z, none of a
margin. D is 1 for w and z, and of loop k the number d_k, or with a lead d_k (s + a_k) / (s + b_k).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from polefence.plant.system import Array
from polefence.requirements.gain import Highest
from polefence.requirements.slopes import Loops, Slopes, Turned
from polefence.response.modes import Modes
from polefence.response.peaks import largest, peaks, response
from polefence.response.stationary import growth

# Of 60 random loops with units from 1e-3 to 1e3, 2 to 4 opened at once, none took more than 35
# steps for known peaks, more than 7 rounds, or logarithms of weights more than 13 apart.
MOST_STEPS, ROUNDS, FARTHEST = 60, 20, 30.0
ENOUGH = 1e-4  # how near the least that known peaks allow
HASTY = 3  # rounds while a law is tuned: a van with three loops has 1.737, 1.163, 1.162 at 1 to 3
ALIKE = 1e-3  # of the highest value, those that are alike where weights are best
LEAST_SHARE = 0.02  # of a peak that is of z: slopes of the others are taken as of this one
SOME, AT_ONCE = 40, 16  # loops and responses of them that scales are first found for
FEW = 4  # of those, the highest, in the middle of which a lead begins
NEAR = 0.8  # of the highest peak: those that scales are found for
BISECTIONS, NEAR_LEVEL = 20, 0.1  # towards the least level; how near its logarithm is near
BITS = 24  # of the numbers of a scale
WIDEST = 1e3  # how far beyond the frequencies of a loop's poles a lead may be
FASTEST = 1.9  # of the step of a delta form: a lead is stable below 2


class Scale(NamedTuple):
    """D at the loops.

    Attributes
    ----------
    theta : (loops, 1) or (loops, 3) array
        Logarithms of d, and of a and b of leads.
    """

    theta: Array

    @property
    def leads(self) -> bool:
        """Whether there are leads."""
        return bool(self.theta.shape[1] > 1)

    def at(self, s: Any) -> Any:
        """Return D (count, loops) at s (count,)."""
        d = np.exp(self.theta[:, 0])
        if not self.leads:
            return np.broadcast_to(d, (len(s), len(d)))
        a, b = np.exp(self.theta[:, 1:].T)
        return d * (s[:, None] + a) / (s[:, None] + b)

    def slopes(self, s: Any) -> Array:
        """Return slopes of log |D| with respect to theta, (count, loops, 1 or 3), at s (count,)."""
        ones = np.ones((len(s), len(self.theta)))
        if not self.leads:
            return ones[:, :, None]
        away = [
            x * (s.real[:, None] + x) / np.abs(s[:, None] + x) ** 2
            for x in np.exp(self.theta[:, 1:].T)
        ]
        return np.stack([ones, away[0], -away[1]], axis=2)

    def with_leads(self, w: float) -> Scale:
        """Return it with leads at a frequency, each one to begin with."""
        logarithm = np.full((len(self.theta), 2), np.log(w))
        return Scale(np.hstack([self.theta[:, :1], logarithm]))

    @property
    def middle(self) -> Array:
        """Logarithms of D between low frequencies and high ones."""
        return np.asarray(self.theta @ np.array([1.0, 0.5, -0.5])[: self.theta.shape[1]])

    def times(self, size: float) -> Scale:
        """Return so many times the scale."""
        return Scale(self.theta + np.eye(1, self.theta.shape[1]) * np.log(size))

    @property
    def exact(self) -> tuple[tuple[Fraction, ...], tuple[tuple[Fraction, Fraction], ...]]:
        """Numbers of few bits: d, and a and b of leads."""
        d, *ab = (tuple(map(rounded, column)) for column in np.exp(self.theta.T).tolist())
        return d, tuple(zip(*ab, strict=True)) if ab else ()


def rounded(weight: float, bits: int = BITS) -> Fraction:
    """Return a number of few bits."""
    share, power = math.frexp(weight)
    return Fraction(math.ldexp(round(share * 2**bits), power - bits))


class Scaled(NamedTuple):
    """What a scale leads to.

    Attributes
    ----------
    scale : Scale
    level : float
        What is least with it: infinite where there is none.
    peaks : tuple of arrays, optional
        Numbers of loops and frequencies of the peaks of loops that are scaled so, if known.
    """

    scale: Scale
    level: float
    peaks: tuple[Array, Array] | None = None


def sides(scale: Scale, p: int, q: int, level: float, s: Any) -> tuple[Any, Any]:
    """Return what outputs and disturbances are multiplied by at s (count,).

    The gain is then at most the level where the worst-case gain is.
    """
    D = scale.at(s)
    out = np.concatenate([np.ones((len(D), p)), level * D], axis=1)
    return out, np.concatenate([np.ones((len(D), q)), 1 / D], axis=1)


def scaled_loops(loops: Loops, scale: Scale, p: int, level: float) -> Loops:
    """Return loops behind and before the scale, z over the level."""
    size = len(scale.theta)
    q, d = loops.E.shape[-1] - size, np.exp(scale.theta[:, 0])
    out = np.concatenate([np.ones(p), level * d])[:, None]
    into = np.concatenate([np.ones(q), 1 / d])
    if not scale.leads:
        return replace(loops, E=loops.E * into, C=loops.C * out, F=out * loops.F * into)
    a, b = np.exp(scale.theta[:, 1:].T)
    A, E, C, F = loops.A, loops.E, loops.C, loops.F
    count, n = A.shape[:2]
    first, last = slice(n, n + size), slice(n + size, n + 2 * size)
    seen = F[:, :, q:] * ((b - a) / a)  # of the states before disturbances
    wide = np.zeros((count, n + 2 * size, n + 2 * size))
    wide[:, :n, :n], wide[:, :n, first] = A, E[:, :, q:] * ((b - a) / a)
    wide[:, first, first], wide[:, last, last] = -np.diag(a), -np.diag(b)
    wide[:, last, :n], wide[:, last, first] = b[:, None] * C[:, p:], b[:, None] * seen[:, p:]
    entering = np.concatenate([E, np.zeros((count, 2 * size, q + size))], axis=1)
    entering[:, first, q:] = np.diag(a)
    entering[:, last] = b[:, None] * F[:, p:]
    behind = np.zeros((p + size, size))
    behind[p:] = np.diag((a - b) / b)
    shown = np.concatenate([C, seen, np.broadcast_to(behind, (count, *behind.shape))], axis=2)
    modes = Modes(wide, loops.modes.step)
    return replace(loops, modes=modes, E=entering * into, C=shown * out, F=out * F * into)


def scaled(
    loops: Loops, p: int, limit: float | None, rounds: int = ROUNDS, *, leads: bool = False
) -> Scaled:
    """Return a scale of the loops, and what is least with it.

    Without a limit that is the level that the gain of loops scaled for it does not exceed, else
    the gain of those scaled for the limit. Without leads both are convex in logarithms. Peaks over
    the frequency are found anew for what is best for those found before, until none is higher.

    Parameters
    ----------
    p : int
        How many outputs are not at loops.
    """
    search = _at_some(loops, p, limit)
    starts = [Scale(search.even[:, None])]
    if leads:  # while a law is tuned no others are tried: 24 ms in place of 31
        starts = [*starts[: rounds > HASTY], starts[0].with_leads(search.highest)]
    found = [_in_rounds(loops, search, scale, rounds) for scale in starts]
    return min(found, key=lambda one: one.level)


def of_each(
    loops: Loops, p: int, limit: float | None, *, leads: bool
) -> Iterator[tuple[Array, float]]:
    """Yield the middle of the best scale of each loop alone, and the level that it leads to.

    Where some loop is not stable all levels are infinite.
    """
    stable = bool(np.all(growth(loops.modes.poles, loops.modes.step) < 0))
    for k in range(len(loops.A)):
        if not stable:
            yield np.zeros(loops.E.shape[-1]), np.inf
            continue
        modes = Modes(np.asarray(loops.A)[k : k + 1], loops.modes.step)
        E, C, F = (M[k : k + 1] for M in (loops.E, loops.C, loops.F))
        found = scaled(replace(loops, modes=modes, E=E, C=C, F=F), p, limit, leads=leads)
        yield found.scale.middle, found.level


def points(w: Array, step: float) -> Any:
    """Return s of frequencies [rad/s], those of the bilinear transform of a delta form."""
    return 1j * w / (1 - 0.5j * w * step)


def _in_rounds(loops: Loops, search: Search, scale: Scale, rounds: int) -> Scaled:
    p, limit = search.p, search.limit
    scale, level = search.least(scale)
    best = Scaled(scale, np.inf)
    for _ in range(rounds):
        if not np.isfinite(level):
            return Scaled(scale, np.inf)
        wide = scaled_loops(loops, scale, p, limit or level)
        at, w, height = peaks(wide.modes, wide.E, wide.C, wide.F)
        if not np.all(np.isfinite(height)):
            return Scaled(scale, np.inf)
        top = float(height.max())
        if limit is None or top < best.level:
            best = Scaled(scale, max(top, level) if limit is None else top, (at, w))
        if top <= level * (1 + ENOUGH):
            return best
        near = height >= NEAR * top
        s = points(w[near], loops.modes.step)
        A, E, C, F = (M[at[near]] for M in (loops.A, loops.E, loops.C, loops.F))
        found = response(A, E, C, F, s[:, None])[:, 0]
        known = np.concatenate([search.M, found]), np.concatenate([search.s, s])
        search = search._replace(M=known[0], s=known[1])
        scale, level = search.least(scale)
    return best


def _at_some(loops: Loops, p: int, limit: float | None) -> Search:
    """Return the search at those frequencies of a grid that may bound the gain."""
    some = np.unique(np.linspace(0, len(loops.A) - 1, min(len(loops.A), SOME)).astype(int))
    A, E, C, F = (M[some] for M in (loops.A, loops.E, loops.C, loops.F))
    s = points(frequencies(loops.modes.poles[some]), loops.modes.step)
    G = response(A, E, C, F, s)
    step = loops.modes.step
    sizes = np.abs(loops.modes.poles[some])
    fastest = float(sizes.max())
    span = 1e-6 * fastest, min(WIDEST * fastest, FASTEST / step if step else np.inf)
    search = Search(G.reshape(-1, *G.shape[2:]), s.ravel(), p, limit, span)
    alone = largest(search.M[:, :p, : search.q]) if p else np.zeros(len(search.s))
    height = search.heights(Scale(search.even[:, None]), limit or float(alone.max()) or 1.0)[0]
    first = np.argsort(-height)[:AT_ONCE]
    chosen = np.unique([*first, *(np.argsort(-alone)[: AT_ONCE // 4] if p else ())]).astype(int)
    return search._replace(M=search.M[chosen], s=search.s[chosen])


def frequencies(poles: Any) -> Array:
    """Return frequencies (count, f): those of the poles, and some between and beyond."""
    sizes = np.abs(poles)
    fast = np.maximum(sizes.max(axis=1, keepdims=True), 1e-300)
    slow = np.maximum(sizes.min(axis=1, keepdims=True), 1e-6 * fast)
    even = slow / 5 * (25 * fast / slow) ** np.linspace(0, 1, 32)
    return np.concatenate([0 * slow, sizes, np.abs(poles.imag), even], axis=1)


class Search(NamedTuple):
    """A scale for responses M (count, p + loops, q + loops) at s (count,) that are known.

    ``range`` is where zeros and poles of leads may be [rad/s].
    """

    M: Any
    s: Any
    p: int
    limit: float | None
    range: tuple[float, float]

    @property
    def size(self) -> int:
        """How many loops there are."""
        return int(self.M.shape[1]) - self.p

    @property
    def q(self) -> int:
        """How many disturbances are not at loops."""
        return int(self.M.shape[2]) - self.size

    @property
    def even(self) -> Array:
        """Logarithms of weights that even out what comes from loops, and what goes to them."""
        p, q = self.p, self.q
        M, x = np.abs(self.M).max(axis=0), np.zeros(self.size)
        M[:p] /= self.limit or float(M[:p, :q].max()) or 1.0
        for _ in range(MOST_STEPS):
            for i in range(self.size):
                d = np.exp(x)
                row = M[p + i] * np.concatenate([np.ones(q), 1 / d])
                column = M[:, q + i] * np.concatenate([np.ones(p), d])
                row[q + i] = column[p + i] = 0.0
                if row.sum() > 0 and column.sum() > 0:
                    x[i] = np.log(column.sum() / row.sum()) / 2
        x = x if p else x - x[0]
        return np.asarray(np.clip(x, -FARTHEST, FARTHEST))

    @property
    def highest(self) -> float:
        """Where the highest responses are, of weights that are even [rad/s]."""
        alone = largest(self.M[:, : self.p, : self.q]).max() if self.p else 1.0
        height = self.heights(Scale(self.even[:, None]), self.limit or float(alone) or 1.0)[0]
        s = np.abs(self.s[np.argsort(-height)[:FEW]])
        return float(np.exp(np.log(np.maximum(s, self.range[0])).mean()))

    def heights(self, scale: Scale, level: float) -> tuple[Array, Array, Array]:
        """Return logarithms of singular values, of z over the level, and slopes.

        With respect to theta (count, numbers), and to the logarithm of the level.
        """
        p, q = self.p, self.q
        out, into = sides(scale, p, q, 1.0, self.s)
        out = np.concatenate([out[:, :p] / level, out[:, p:]], axis=1)
        u, values, vt = np.linalg.svd(out[:, :, None] * self.M * into[:, None], full_matrices=False)
        one, other = np.abs(u[:, :, 0]) ** 2, np.abs(vt[:, 0]) ** 2
        slopes = (one[:, p:] - other[:, q:])[:, :, None] * scale.slopes(self.s)
        top = np.log(np.maximum(values[:, 0], 1e-300))
        return top, slopes.reshape(len(top), -1), -one[:, :p].sum(axis=1)

    def level(self, scale: Scale) -> float:
        """Return the least level for a scale, infinite where there is none.

        Its square is the largest eigenvalue of W^-1 Z'Z, Z the rows of z, W = diag(1, d^2) - Y'Y.
        """
        p, (out, into) = self.p, sides(scale, self.p, self.q, 1.0, self.s)
        whole = out[:, :, None] * self.M * into[:, None]
        Z, Y = whole[:, :p], whole[:, p:]
        W = np.eye(self.M.shape[2]) - np.swapaxes(Y.conj(), 1, 2) @ Y
        try:
            L = np.linalg.cholesky(W)
        except np.linalg.LinAlgError:
            return np.inf
        return float(largest(np.linalg.solve(L, np.swapaxes(Z.conj(), 1, 2))).max())

    def least(self, scale: Scale) -> tuple[Scale, float]:
        """Return the best scale, and the level or the gain that is least with it."""
        if self.limit is not None:
            scale, t = self._searched(scale, float(np.log(self.limit)))
            return scale, self.limit * float(np.exp(t))
        level = self.level(scale)
        if not np.isfinite(level):  # first those for which loops stay stable
            top = float(np.abs(self.M).max())
            scale = self._searched(scale, float(np.log(top) + FARTHEST / 2))[0]
            level = self.level(scale)
            scale, level = self._halved(scale, level)
        if np.isfinite(level):
            scale = self._searched(scale, None, float(np.log(level)))[0]
            level = self.level(scale)
        return scale, level

    def _halved(self, scale: Scale, level: float) -> tuple[Scale, float]:
        """Return a scale whose level is near the least one: from far SLSQP does not find it."""
        low = float(np.log(largest(self.M[:, : self.p, : self.q]).max()))
        for _ in range(BISECTIONS):
            if not np.isfinite(level) or np.log(level) - low < NEAR_LEVEL:
                break
            middle = (low + float(np.log(level))) / 2
            tried = self._searched(scale, middle)[0]
            if self.level(tried) < level:
                scale, level = tried, self.level(tried)
            else:
                low = middle
        return scale, level

    def _searched(self, scale: Scale, g: float | None, start: float = 0.0) -> tuple[Scale, float]:
        """Return the scale with the least height at the level e^g; without one the least level."""
        from scipy.optimize import minimize  # deferred: slow to import

        x, shape = scale.theta.ravel(), scale.theta.shape
        free: Any = np.repeat([bool(self.p), *(True,) * (shape[0] - 1)], shape[1])
        if not free.any():  # of a margin one loop's is any
            return scale, float(self.heights(scale, float(np.exp(g or 0.0)))[0].max())

        def whole(z: Array) -> Scale:
            theta = x.copy()
            theta[free] = z[:-1]
            return Scale(theta.reshape(shape))

        @lru_cache(maxsize=1)  # values and slopes are asked for one after the other
        def heights(*numbers: float) -> tuple[Array, Array]:
            z = np.array(numbers)
            top, slopes, of_level = self.heights(whole(z), float(np.exp(z[-1] if g is None else g)))
            last = -of_level if g is None else np.ones(len(top))
            margin = -top if g is None else z[-1] - top
            return margin, np.hstack([-slopes[:, free], last[:, None]])

        z = np.append(
            x[free], start if g is None else self.heights(scale, float(np.exp(g)))[0].max()
        )
        low, high = np.log(self.range)
        bounds = np.full((*shape, 2), (low, high))
        bounds[:, 0] = np.stack([scale.theta[:, 0] - FARTHEST, scale.theta[:, 0] + FARTHEST], 1)
        settings: dict[str, Any] = {
            "jac": lambda z: np.append(np.zeros(len(z) - 1), 1.0),
            "method": "SLSQP",
            "bounds": [*bounds.reshape(-1, 2)[free].tolist(), (z[-1] - FARTHEST, z[-1] + FARTHEST)],
            "constraints": {
                "type": "ineq",
                "fun": lambda z: heights(*z)[0],
                "jac": lambda z: heights(*z)[1],
            },
            "options": {"maxiter": MOST_STEPS, "ftol": 1e-10},
        }
        found = whole(minimize(_last, z, **settings).x)
        if g is None:
            return (found, 0.0) if self.level(found) <= self.level(scale) else (scale, 0.0)
        top = float(self.heights(found, float(np.exp(g)))[0].max())
        return (found, top) if top <= z[-1] else (scale, float(z[-1]))


def _last(z: Array) -> float:
    return float(z[-1])


# --- slopes with respect to the loops -----------------------------------------------------------


def slopes(loops: Loops, p: int, limit: float | None, *, leads: bool = False) -> Slopes:
    """Return what is bounded at peaks with its slopes, loops scaled anew.

    Under a limit it is the gain for a scale at that level: it exists where the loop does not
    stay stable too.
    """
    found = scaled(loops, p, limit, HASTY, leads=leads)
    if not np.isfinite(found.level) or found.peaks is None:
        return _nothing(loops)
    scale, level = found.scale, found.level
    q, s = loops.E.shape[-1] - len(scale.theta), points(found.peaks[1], loops.modes.step)
    highest = Highest.of(loops, found.peaks, sides(scale, p, q, limit or level, s))
    values, each = highest.values, np.ones(len(highest.values))
    share = each
    if limit is None:  # the level for which a peak is as high: it turns scales too
        share = np.maximum((np.abs(highest.u[:, :p]) ** 2).sum(axis=1), LEAST_SHARE)
        values = level * (highest.values / level) ** (1 / share)
        each = values / highest.values / share

    own = np.abs(highest.u[:, p:]) ** 2 - np.abs(highest.v[:, q:]) ** 2
    along = (own[:, :, None] * scale.slopes(highest.s)).reshape(len(values), -1)
    mixed = following(values, values[:, None] * along / share[:, None])

    def turned() -> list[Turned]:
        own, times = highest.turned(), each[:, None, None]
        E, F = own.E, own.F
        of_E, of_F = (None if M is None else M * times for M in (E, F))
        return [Turned(own.A * times, own.C * times, of_E, of_F)]

    return Slopes(values, highest.points, turned, mixed)


def following(values: Array, along: Array) -> Array:
    """Return what slopes of values are of those for a scale that stays, (rows, rows).

    Where a scale is best several of the highest values are alike, and stay so while it follows
    the law: without that a search ends where no law lowers all of them for a scale that stays.

    Parameters
    ----------
    along : (rows, numbers) array
        Slopes with respect to the scale.
    """
    from scipy.optimize import nnls  # deferred: slow to import

    top = float(values.max())
    high = np.flatnonzero(values >= top * (1 - ALIKE))
    size = max(float(np.abs(along[high]).max()), 1e-300)
    sides = np.vstack([along[high].T / size, np.ones(len(high))])
    kept = high[nnls(sides, np.append(np.zeros(along.shape[1]), 1.0))[0] > 1e-6]
    mixed = np.eye(len(values))
    if len(kept) > 1:
        solved = np.linalg.pinv(np.hstack([along[kept], -np.ones((len(kept), 1))]))
        mixed[:, kept] -= along @ solved[:-1]
    return mixed


def _nothing(loops: Loops) -> Slopes:
    """Return that there is no level at any point."""
    count, (n, p) = len(loops.E), (loops.A.shape[-1], loops.C.shape[1])

    def turned() -> list[Turned]:
        return [Turned(np.zeros((count, n, n)), np.zeros((count, p, n)), 0 * loops.E, 0 * loops.F)]

    return Slopes(np.full(count, np.inf), np.arange(count), turned)
