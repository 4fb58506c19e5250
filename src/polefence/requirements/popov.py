"""Multipliers of elements that do not vary in time, with which Popov's criterion proves about most.

Loops G are from z to r y at s = jw. With numbers d of all elements, and t = p / r of each whose
rate no element enters, what is proved is that

    L^2 |v|^2 - 2 L^2 Re v*(D T s G D^-1) v  >  |D G D^-1 v|^2    for all v and w,

see `polefence.proof.claims.sector`: L is the level. It is looked for at frequencies that are known,
and anew with the highest of what they lead to, until none is higher.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from polefence.plant.system import Array
from polefence.requirements import scales
from polefence.requirements.gain import Gain, Highest
from polefence.requirements.slopes import Loops, Slopes, Turned
from polefence.response.modes import Modes
from polefence.response.peaks import peaks, response
from polefence.response.stationary import growth

ROUNDS, HASTY = 12, 5  # of peaks that are found anew; while a law is tuned
EXCHANGES, MORE = (
    12,
    8,
)  # of known frequencies, how many are looked at more closely, in each of so many
AT_ONCE = 24  # of them to begin with
MOST_STEPS = 80  # of one search
ENOUGH, NEARLY = 1e-6, 1e-4  # how near the least that known peaks allow; while a law is tuned
WIDEST = 1e6  # how much less than the first the square of a level is looked for
SHORT = 1e-5  # by what share a level may be higher of multipliers that are as short as can be
LONGER = 2.0  # times these: of a spring that moves anyhow the factor is 2.2, of the shortest 2.0
LONGEST = 300.0  # t, in what turns the highest peak by its own size
NEAR = 0.7  # of a peak, and of the highest: those that have slopes
CLOSELY = 20  # points at which peaks are found exactly, the highest
CHUNK = 500  # points at once
FINE, ZOOMS, WITHIN = 300, 4, 9  # frequencies of a loop, where those that are known miss the worst


class Multipliers(NamedTuple):
    """Logarithms of d, and t [s], of each element."""

    d: Array
    t: Array

    @property
    def exact(self) -> tuple[tuple[Fraction, ...], tuple[Fraction, ...]]:
        """Numbers of few bits: d and t."""
        d, t = np.exp(self.d).tolist(), self.t.tolist()
        return tuple(map(scales.rounded, d)), tuple(map(scales.rounded, t))

    def at(self, G: Any, s: Any) -> tuple[Any, Any]:
        """Return D G D^-1 and D s G D^-1, (..., k, k), of responses G at s (...)."""
        d = np.exp(self.d)
        Z = d[:, None] * G / d
        return Z, s[..., None, None] * Z

    def heights(self, G: Any, s: Any, level: float) -> tuple[Any, Any]:
        """Return the largest eigenvalues of Z*Z / L^2 + 2 He(T s Z), below one where L is proved.

        And their vectors (..., k).
        """
        Z, sZ = self.at(G, s)
        X = self.t[:, None] * sZ
        whole = _adjoint(Z) @ Z / level**2 + X + _adjoint(X)
        values, vectors = np.linalg.eigh(whole)
        return values[..., -1], vectors[..., -1]

    def levels(self, G: Any, s: Any) -> tuple[Any, Any]:
        """Return the levels that directions ask for, (..., k) rising, and these (..., k, k).

        Infinite where multipliers are too large. With v a column, v*(I - 2 He(T s Z)) v is one.
        """
        Z, sZ = self.at(G, s)
        X = self.t[:, None] * sZ
        size, turn = np.linalg.eigh(np.eye(G.shape[-1]) - X - _adjoint(X))
        good = size[..., :1] > 0
        half = turn / np.sqrt(np.where(good, size, 1.0))[..., None, :]
        _, values, vt = np.linalg.svd(Z @ half)
        v = half @ _adjoint(vt)
        return np.where(good, values, np.inf)[..., ::-1], v[..., ::-1]

    def loops(self, loops: Loops, level: float) -> Loops:
        """Return the loops from d^-1 (z - p y') to d (r y + level |p| y')."""
        rates, d = loops.C @ loops.A, np.exp(self.d)
        A = loops.A + (loops.E * self.t) @ rates
        C = d[:, None] * (loops.C + (level * np.abs(self.t))[:, None] * rates)
        return replace(loops, modes=Modes(A), E=loops.E / d, C=C)


class Found(NamedTuple):
    """Multipliers, the level that is proved with them, and its peaks: loops and frequencies."""

    multipliers: Multipliers
    level: float
    at: Any
    w: Array


def found(loops: Loops, free: Any, *, longer: bool = False) -> Found:
    """Return short multipliers with which the level is about least: infinite of no stable loops.

    Parameters
    ----------
    free : (elements,) array of bool
        Which may have t.
    longer : bool, optional
        Whether they may be longer for the same: while parameters move more is proved with those.
    """
    best, search = _best(loops, free, ROUNDS)
    if search is None or not np.any(best.multipliers.t):
        return best
    short = _shortest(loops, search, best)
    if not longer:
        return short
    own = short.multipliers
    more = _proved(loops, own._replace(t=LONGER * own.t), best.level)
    return more if more.level <= short.level * (1 + SHORT) else short


def _best(loops: Loops, free: Any, rounds: int) -> tuple[Found, Search | None]:
    """Return the multipliers with which the level is about least, and what they were found for."""
    if not np.all(growth(loops.modes.poles, 0.0) < 0):
        none = np.zeros(len(free))
        return Found(Multipliers(none, none), np.inf, np.zeros(0, dtype=int), np.zeros(0)), None
    best, search = _begun(loops, np.asarray(free))
    guess, near = best, 1 + (ENOUGH if rounds > HASTY else NEARLY)
    for _ in range(rounds if best.level > 0 else 0):
        multipliers, level = search.least(guess.multipliers)
        guess = _proved(loops, multipliers, level)
        if guess.level < best.level:
            best = guess
        if guess.level <= level * near:
            break
        if not np.isfinite(guess.level):
            guess = _missed(loops, multipliers, level)
            if not len(guess.w):
                break
        search = search.beside(loops, guess)
    return best, search


def _shortest(loops: Loops, search: Search, best: Found) -> Found:
    """Return the shortest multipliers that prove about the same: proofs with them are easier."""
    most = best.level * (1 + SHORT)
    for _ in range(ROUNDS):
        multipliers, level = search.least(best.multipliers, most)
        found = _proved(loops, multipliers, level)
        if found.level <= most * (1 + SHORT):
            return found
        search = search.beside(
            loops, found if np.isfinite(found.level) else _missed(loops, multipliers, most)
        )
    return best


def _begun(loops: Loops, free: Any) -> tuple[Found, Search]:
    """Return what is proved without t, and the search for it."""
    count = loops.E.shape[-1]
    d = scales.scaled(loops, 0, 1.0, HASTY).scale.theta[:, 0] if count > 1 else np.zeros(1)
    start = _proved(loops, Multipliers(d, np.zeros(count)), 0.0)
    s = 1j * scales.frequencies(loops.modes.poles)
    G = response(loops.A, loops.E, loops.C, 0 * loops.F, s)
    fast = float(np.abs(loops.modes.poles).max())
    w = start.w[start.w > 0]
    pace = float(np.exp(np.log(w).mean())) if len(w) else fast
    search = Search(G.reshape(-1, count, count), s.ravel(), free, pace)
    return start, search.beside(loops, start)


def _proved(loops: Loops, multipliers: Multipliers, level: float) -> Found:
    """Return the least level from this on that multipliers prove, with its peaks.

    Infinite where they prove none, and then without peaks.
    """
    none = Found(multipliers, np.inf, np.zeros(0, dtype=int), np.zeros(0))
    for _ in range(4):
        whole = multipliers.loops(loops, level)
        if not np.all(growth(whole.modes.poles, 0.0) < 0):
            return none
        at, w, height = peaks(whole.modes, whole.E, whole.C, whole.F)
        if not len(w) or not np.all(np.isfinite(height)):
            return none
        top = float(multipliers.levels(*_responses(loops, at, w))[0].max())
        if top <= level * (1 + ENOUGH) or not np.isfinite(top) or not np.any(multipliers.t):
            return Found(multipliers, max(top, level), at, w)
        level = top
    return Found(multipliers, level * (1 + ENOUGH), at, w)


def _missed(loops: Loops, multipliers: Multipliers, level: float) -> Found:
    """Return the frequencies, one a loop, at which multipliers miss a level the most."""
    w, rows = _fine(loops.modes.poles), np.arange(len(loops.A))
    for _ in range(ZOOMS):
        G = response(loops.A, loops.E, loops.C, loops.F, 1j * w)
        heights = multipliers.heights(G, 1j * w, level)[0]
        j = heights.argmax(axis=1)
        ends = w[rows, np.maximum(j - 1, 0)], w[rows, np.minimum(j + 1, w.shape[1] - 1)]
        low, high = (end[:, None] for end in ends)
        highest = w[rows, j]
        w = low + (high - low) * np.linspace(0, 1, WITHIN)
    over = np.flatnonzero(heights.max(axis=1) > 1)
    return Found(multipliers, np.inf, over, highest[over])


def _fine(poles: Any) -> Array:
    sizes = np.abs(poles)
    fast, slow = sizes.max(axis=1), np.maximum(sizes.min(axis=1), 1e-6 * sizes.max(axis=1))
    return np.asarray(slow[:, None] / 100 * (1e4 * fast / slow)[:, None] ** np.linspace(0, 1, FINE))


class Search(NamedTuple):
    """Multipliers for responses G (count, k, k) at s (count,), those of ``free`` elements.

    ``some`` are the numbers of those that are looked at, and ``pace`` about their frequency.
    """

    G: Any
    s: Any
    free: Any
    pace: float
    some: Any = np.zeros(0, dtype=int)

    def beside(self, loops: Loops, known: Found) -> Search:
        """Return it with the peaks of what was found."""
        G, s = _responses(loops, known.at, known.w)
        last = np.arange(len(self.s), len(self.s) + len(s))
        some = np.concatenate([self.some, last])
        return self._replace(
            G=np.concatenate([self.G, G]), s=np.concatenate([self.s, s]), some=some
        )

    def least(self, start: Multipliers, most: float | None = None) -> tuple[Multipliers, float]:
        """Return the best multipliers, or the shortest for a level, and the least with them."""
        level = float(start.levels(self.G, self.s)[0].max())
        if not np.isfinite(level):
            start = start._replace(t=0 * start.t)
            level = float(start.levels(self.G, self.s)[0].max())
        heights = start.heights(self.G, self.s, level)[0]
        some = np.union1d(self.some, np.argsort(-heights)[:AT_ONCE])
        now = start, level
        for _ in range(EXCHANGES):
            now = self._replace(some=some)._searched(*now, most)
            heights = now[0].heights(self.G, self.s, most or now[1])[0]
            over = np.flatnonzero(heights > 1 + ENOUGH)
            over = np.setdiff1d(over, some)
            if not len(over):
                break
            some = np.union1d(some, over[np.argsort(-heights[over])[:MORE]])
        return now

    def _searched(
        self, start: Multipliers, level: float, most: float | None = None
    ) -> tuple[Multipliers, float]:
        """Return the best for those that are looked at; under a level the shortest that keep it."""
        from scipy.optimize import minimize  # deferred: slow to import

        G, s, size = self.G[self.some], self.s[self.some], len(self.free)
        open_d, open_t = np.arange(size) > 0, np.asarray(self.free)
        unit = 1 / (self.pace * level)  # [s]

        def whole(x: Array) -> tuple[Multipliers, float]:
            d, t = start.d.copy(), start.t.copy()
            d[open_d] += x[: size - 1]
            t[open_t] = x[size - 1 : -1] * unit
            return Multipliers(d, t), level / float(np.sqrt(max(x[-1], 1e-12)))

        @lru_cache(maxsize=1)  # values and slopes are asked for one after the other
        def highest(*numbers: float) -> tuple[Multipliers, float, Any, Any]:
            multipliers, own = whole(np.array(numbers))
            return multipliers, own, *multipliers.heights(G, s, own)

        def room(x: Array) -> Array:
            return np.asarray(1 - highest(*x)[2])

        def slopes(x: Array) -> Array:
            multipliers, own, _, v = highest(*x)
            of_d, of_t, of_square = _slopes(multipliers, G, s, own, v)
            columns = of_d[:, open_d], of_t[:, open_t] * unit, of_square[:, None] / x[-1]
            return -np.hstack(columns)

        def cost(x: Array) -> tuple[float, Array]:
            own = np.zeros(len(x))
            if most is None:
                own[-1] = -1.0
                return -float(x[-1]), own
            own[size - 1 : -1] = x[size - 1 : -1]
            return float(own @ own) / 2, own

        square = (0.5, WIDEST) if most is None else ((level / most) ** 2,) * 2
        x = np.concatenate([np.zeros(size - 1), start.t[open_t] / unit, [1.0]])
        x[-1] = np.clip(x[-1], *square)
        ends = [(-scales.FARTHEST, scales.FARTHEST)] * (size - 1)
        ends += [(-LONGEST, LONGEST)] * int(open_t.sum())
        settings: dict[str, Any] = {
            "jac": True,
            "method": "SLSQP",
            "bounds": [*ends, square],
            "constraints": {"type": "ineq", "fun": room, "jac": slopes},
            "options": {"maxiter": MOST_STEPS, "ftol": 1e-9},
        }
        solved = minimize(cost, x, **settings).x
        if not np.all(np.isfinite(solved)):
            return start, level
        multipliers = whole(solved)[0]
        reached = float(multipliers.levels(G, s)[0].max())
        return (multipliers, reached) if np.isfinite(reached) else (start, level)


def _slopes(
    multipliers: Multipliers, G: Any, s: Any, level: Any, v: Any
) -> tuple[Array, Array, Array]:
    """Return slopes of v*(Z*Z / L^2 + 2 He(T s Z)) v, (count, k) to d and t, and to log 1 / L^2."""
    share = np.broadcast_to(1 / np.square(level), s.shape)
    Z, sZ = multipliers.at(G, s)
    Zv, sZv = (Z @ v[..., None])[..., 0], (sZ @ v[..., None])[..., 0]
    back = (_adjoint(Z) @ Zv[..., None])[..., 0]
    turned = (_adjoint(sZ) @ (multipliers.t * v)[..., None])[..., 0]
    square = np.abs(Zv) ** 2
    of_d = 2 * (square - (back.conj() * v).real) * share[:, None]
    of_d = of_d + 2 * (multipliers.t * (v.conj() * sZv).real - (turned.conj() * v).real)
    return of_d, 2 * (v.conj() * sZv).real, square.sum(axis=-1) * share


def _responses(loops: Loops, at: Any, w: Array) -> tuple[Any, Any]:
    A, E, C, F = (M[at] for M in (loops.A, loops.E, loops.C, loops.F))
    s = 1j * w
    return response(A, E, C, F, s[:, None])[:, 0], s


def _adjoint(M: Any) -> Any:
    return np.swapaxes(M.conj(), -1, -2)


# --- at points of the family, and slopes with respect to the loops -------------------------------


def values(loops: Loops, multipliers: Multipliers) -> Array:
    """Return the level of each loop: of a grid of frequencies, and exactly at the worst points."""
    parts = [slice(k, k + CHUNK) for k in range(0, len(loops.A), CHUNK)]
    levels = np.concatenate([_on_grid(_some(loops, part), multipliers) for part in parts])
    for k in np.argsort(-levels)[:CLOSELY]:
        if np.isfinite(levels[k]):
            own = _proved(_some(loops, slice(k, k + 1)), multipliers, float(levels[k]))
            levels[k] = max(levels[k], own.level)
    return levels


def _on_grid(loops: Loops, multipliers: Multipliers) -> Array:
    s = 1j * scales.frequencies(loops.modes.poles)
    G = response(loops.A, loops.E, loops.C, loops.F, s)
    return np.asarray(multipliers.levels(G, s)[0].max(axis=(1, 2)))


def _some(loops: Loops, part: Any) -> Loops:
    modes = Modes(loops.A[part], loops.modes.step)
    return replace(loops, modes=modes, E=loops.E[part], C=loops.C[part], F=loops.F[part])


def slopes(loops: Loops, free: Any) -> Slopes:
    """Return levels at peaks with their slopes, multipliers found anew."""
    best, _ = _best(loops, free, HASTY)
    multipliers = best.multipliers
    if not np.any(multipliers.t) and len(multipliers.t) == 1:
        return Gain("z").slopes(loops)
    G, s = _responses(loops, best.at, best.w)
    every, vectors = multipliers.levels(G, s)
    some, which = np.nonzero(every >= NEAR * every.max(axis=1, keepdims=True))
    G, s, points, levels = G[some], s[some], best.at[some], every[some, which]
    v = vectors[some, :, which]
    Z, _ = multipliers.at(G, s)
    d, square = np.exp(multipliers.d), levels[:, None] ** 2
    u = d * (Z @ v[..., None])[..., 0] + square * s.conj()[:, None] * multipliers.t * d * v
    A, E, C = (M[points] for M in (loops.A, loops.E, loops.C))
    highest = Highest(levels, points, u / levels[:, None], v / d, s, A, E, C)
    of_d, of_t, _ = _slopes(multipliers, G, s, levels, v)
    along = np.hstack([of_d[:, 1:], of_t[:, np.asarray(free)]]) * levels[:, None] / 2
    sized = along / np.maximum(np.abs(along).max(axis=0), 1e-300)
    mixed = scales.following(levels, sized)

    def turned() -> list[Turned]:
        return [highest.turned()]

    return Slopes(levels, points, turned, mixed)
