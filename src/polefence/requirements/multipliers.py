"""Multipliers of elements that do not vary in time, with which about most is proved.

Loops G are from z to r y at s = jw. With numbers d of all elements, and M = 1 - h B / (B + s) of
each whose slope is in its sector too (Zames and Falb), 0 <= h < 1 and B of either sign, weights are
w = d sqrt(Re M), and Z = w G / w. With t = p / r of each whose rate no element enters (Popov), and
c = t s - j Im M / (L Re M), what is proved is that

    L^2 |v|^2 - 2 L^2 Re v*c Z v  >  |Z v|^2    for all v and w,

see `polefence.proof.claims.sector`: L is the level. An element has t or h, or neither. They are
looked for at frequencies that are known, and anew with the highest of what they lead to, until none
is higher.
"""

from __future__ import annotations

from collections.abc import Sequence
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
# Exchanges of known frequencies, and how many more are looked at closely in each.
EXCHANGES, MORE = 12, 8
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
CLIMBS, SAME = 12, 1e-12  # of levels with lags, each twice as exact; until none is higher than so
TINY = 1e-100  # a level, of nothing
PACES = tuple(10.0**k for k in (-2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2))  # of B that are tried
SHARES = (0.5, 0.9, 0.99)  # of h
MOST_SHARE = 0.9999  # of h: at one, Re M is zero where s is
WORTH = 1e-3  # by what share a level is lower of a lag, which is a state of the proof
HOPE = 1.05  # while a law is tuned: how much higher a lag may begin
THIN = 4  # of known frequencies, one in so many where lags begin


class Multipliers(NamedTuple):
    """Logarithms of d, t [s], B [rad/s] and h of each element; h is zero where it has no lag."""

    d: Array
    t: Array
    B: Array
    h: Array

    @classmethod
    def of(cls, d: Array) -> Multipliers:
        """Return numbers d alone."""
        none = np.zeros(len(d))
        return cls(d, none, none, none)

    @property
    def exact(self) -> tuple[tuple[Fraction, ...], ...]:
        """Numbers of few bits: d and t."""
        d, t = np.exp(self.d).tolist(), self.t.tolist()
        return tuple(map(scales.rounded, d)), tuple(map(scales.rounded, t))

    @property
    def lags(self) -> tuple[tuple[Fraction, Fraction], ...]:
        """Numbers a and b of few bits, see `polefence.proof.claims.sector`."""
        pairs = list[tuple[Fraction, Fraction]]()
        for B, h in zip(self.B.tolist(), self.h.tolist(), strict=True):
            b = scales.rounded(h * B / 2)
            own = scales.rounded(abs(B) * (1 - h)) if h else Fraction(0)
            pairs.append((abs(b) + own, b))  # a - |b| may be much smaller than both
        return tuple(pairs)

    @property
    def _lags(self) -> tuple[Array, Array]:
        b = self.h * self.B / 2
        return np.where(self.h > 0, np.abs(self.B) - np.abs(b), 0.0), b

    @property
    def alone(self) -> bool:
        """Whether there are numbers d alone."""
        return not (np.any(self.t) or np.any(self.h))

    def lag(self, s: Any) -> Any:
        """Return M (..., k) at s (...)."""
        s = s[..., None]
        with np.errstate(invalid="ignore"):  # B is zero where h is
            return np.where(self.h > 0, 1 - self.h * self.B / (self.B + s), 1.0)

    def at(self, G: Any, s: Any) -> tuple[Any, Any, Any]:
        """Return w (..., k), Z (..., k, k) and Im M / Re M (..., k), of responses G at s (...)."""
        M = self.lag(s)
        w = np.exp(self.d) * np.sqrt(M.real)
        return w, w[..., :, None] * G / w[..., None, :], M.imag / M.real

    def turned(self, s: Any, mu: Any, level: Any) -> Any:
        """Return c (..., k) for a level (...)."""
        return self.t * s[..., None] - 1j * mu / np.asarray(level)[..., None]

    def heights(self, G: Any, s: Any, level: float) -> tuple[Any, Any]:
        """Return the largest eigenvalues of Z*Z / L^2 + 2 He(c Z), below one where L is proved.

        And their vectors (..., k).
        """
        _, Z, mu = self.at(G, s)
        return _highest(Z, self.turned(s, mu, level), level)

    def levels(self, G: Any, s: Any) -> tuple[Any, Any]:
        """Return the levels that directions ask for, (..., k) rising, and these (..., k, k).

        Infinite where multipliers are too large. With v a column, v*(I - 2 He(t s Z)) v, and what
        lags add to it, is one. With lags the first alone is that of a direction; the others are 0.
        """
        if np.any(self.h):
            return self._first_levels(G, s)
        _, Z, _ = self.at(G, s)
        X = (self.t * s[..., None])[..., None] * Z
        size, turn = np.linalg.eigh(np.eye(G.shape[-1]) - X - _adjoint(X))
        good = size[..., :1] > 0
        half = turn / np.sqrt(np.where(good, size, 1.0))[..., None, :]
        _, values, vt = np.linalg.svd(Z @ half)
        v = half @ _adjoint(vt)
        return np.where(good, values, np.inf)[..., ::-1], v[..., ::-1]

    def _first_levels(self, G: Any, s: Any) -> tuple[Any, Any]:
        """Return the highest levels, last.

        Each step takes the worst direction anew; from the second on levels rise.
        """
        _, Z, mu = self.at(G, s)
        level = np.maximum(np.linalg.norm(Z, axis=(-2, -1)), TINY)
        for k in range(CLIMBS):
            before = level
            v = _highest(Z, self.turned(s, mu, level), level)[1]
            Zv = (Z @ v[..., None])[..., 0]
            square = (np.abs(Zv) ** 2).sum(axis=-1)
            of_mu = 2 * (v.conj() * mu * Zv).imag.sum(axis=-1)
            room = 1 - 2 * (v.conj() * self.t * s[..., None] * Zv).real.sum(axis=-1)
            root = np.sqrt(of_mu**2 + 4 * np.maximum(room, 0) * square)
            with np.errstate(divide="ignore", invalid="ignore"):
                level = np.where(room > 0, (of_mu + root) / (2 * room), np.inf)
            level = np.maximum(level, TINY)
            if k and np.all(level <= before * (1 + SAME)):
                break
        size = room - of_mu / (2 * level)
        v = v / np.sqrt(np.where(size > 0, size, 1.0))[..., None]
        every = np.zeros(Z.shape[:-1])
        every[..., -1] = level
        vectors = np.zeros_like(Z)
        vectors[..., -1] = v
        return every, vectors

    def loops(self, loops: Loops, level: float) -> Loops:
        """Return the loops with p y' and l fed back, to d (r y + level |p| y') or so."""
        rates, d = loops.C @ loops.A, np.exp(self.d)
        A = loops.A + (loops.E * self.t) @ rates
        C = loops.C + (level * np.abs(self.t))[:, None] * rates
        E, F, lagging = loops.E, loops.F, np.flatnonzero(self.h)
        if len(lagging):
            a, b = (x[lagging] for x in self._lags)
            sign, eye = np.sign(b), np.eye(len(d))
            below = (b / level)[:, None] * loops.C[:, lagging]
            own = np.broadcast_to(-np.diag(a), (len(A), len(a), len(a)))
            A = np.concatenate(
                [np.concatenate([A, E[..., lagging]], 2), np.concatenate([below, own], 2)], 1
            )
            driven = np.broadcast_to(np.abs(b)[:, None] * eye[lagging], (len(A), len(a), len(d)))
            E = np.concatenate([E, driven], 1)
            last = np.broadcast_to(-level * sign * eye[:, lagging], (len(A), len(d), len(a)))
            C = np.concatenate([C, last], 2)
        return replace(loops, modes=Modes(A), E=E / d, C=d[:, None] * C, F=F)


def _highest(Z: Any, c: Any, level: Any) -> tuple[Any, Any]:
    Y, square = c[..., None] * Z, np.square(np.asarray(level))[..., None, None]
    values, vectors = np.linalg.eigh(_adjoint(Z) @ Z / square + Y + _adjoint(Y))
    return values[..., -1], vectors[..., -1]


class Found(NamedTuple):
    """Multipliers, the level that is proved with them, and its peaks: loops and frequencies."""

    multipliers: Multipliers
    level: float
    at: Any
    w: Array


def found(
    loops: Loops,
    free: Any,
    lagged: Any = (),
    *,
    longer: bool = False,
    shares: Sequence[float] = (SHORT,),
) -> tuple[Found, ...]:
    """Return short multipliers with which the level is about least: infinite of no stable loops.

    Parameters
    ----------
    free : (elements,) array of bool
        Which may have t.
    lagged : (elements,) array of bool, optional
        Which may have lags.
    longer : bool, optional
        Whether t may be longer for the same: while parameters move more is proved with those.
    shares : sequence of float, optional
        By what share a level may be higher of shorter ones, for each of which some are returned.
    """
    best, search = _best(loops, free, lagged, ROUNDS)
    if search is None or best.multipliers.alone:
        return (best,)
    several = (_shortest(loops, search, best, share) for share in shares)
    return tuple(_longer(loops, short) if longer else short for short in several)


def _longer(loops: Loops, short: Found) -> Found:
    """Return multipliers with longer t where they prove the same."""
    own = short.multipliers
    more = _proved(loops, own._replace(t=LONGER * own.t), short.level)
    return more if more.level <= short.level * (1 + SHORT) else short


def _best(loops: Loops, free: Any, lagged: Any, rounds: int) -> tuple[Found, Search | None]:
    """Return the multipliers with which the level is about least, and what they were found for."""
    if not np.all(growth(loops.modes.poles, 0.0) < 0):
        none = np.zeros(0, dtype=int)
        return Found(Multipliers.of(np.zeros(len(free))), np.inf, none, np.zeros(0)), None
    best, search = _climbed(loops, *_begun(loops, np.asarray(free)), rounds)
    for k in np.flatnonzero(lagged) if best.level > 0 else ():
        start, level = search.lagged(best.multipliers, int(k), best.level)
        if rounds <= HASTY and level > HOPE * best.level:
            continue
        other, wider = _climbed(loops, _proved(loops, start, level), search, rounds)
        if other.level < best.level * (1 - WORTH):
            best, search = other, wider
    return best, search


def _climbed(loops: Loops, best: Found, search: Search, rounds: int) -> tuple[Found, Search]:
    """Return the best multipliers that a search leads to, and the search with their peaks."""
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


def _shortest(loops: Loops, search: Search, best: Found, share: float) -> Found:
    """Return the shortest multipliers that prove about the same: proofs with them are easier."""
    most = best.level * (1 + share)
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
    """Return what is proved with d alone, and the search for t."""
    count = loops.E.shape[-1]
    d = scales.scaled(loops, 0, 1.0, HASTY).scale.theta[:, 0] if count > 1 else np.zeros(1)
    start = _proved(loops, Multipliers.of(d), 0.0)
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
        if top <= level * (1 + ENOUGH) or not np.isfinite(top) or multipliers.alone:
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

    def lagged(self, start: Multipliers, k: int, level: float) -> tuple[Multipliers, float]:
        """Return them with a lag of an element in the place of its t, and about their level."""
        some = np.union1d(self.some, np.arange(0, len(self.s), THIN))
        G, s = self.G[some], self.s[some]
        pairs = [(sign * p * self.pace, h) for sign in (1, -1) for p in PACES for h in SHARES]
        if t := float(start.t[k]):  # what t is the limit of
            far = [PACES[-1] * self.pace, PACES[-3] * self.pace]
            pairs += [(-np.sign(t) * B, 1 / (1 + 1 / (B * level * abs(t)))) for B in far]
        best, least = start, np.inf
        for B, h in pairs:
            tried = start._replace(
                t=_with(start.t, k, 0.0),
                B=_with(start.B, k, B),
                h=_with(start.h, k, min(h, MOST_SHARE)),
            )
            height = float(tried.heights(G, s, level)[0].max())
            if height < least:
                best, least = tried, height
        return best, float(best.levels(G, s)[0].max())

    def _searched(
        self, start: Multipliers, level: float, most: float | None = None
    ) -> tuple[Multipliers, float]:
        """Return the best for those that are looked at; under a level the shortest that keep it."""
        from scipy.optimize import minimize  # deferred: slow to import

        G, s, size = self.G[self.some], self.s[self.some], len(self.free)
        unit = 1 / (self.pace * level)  # [s]
        chosen = _Chosen(np.arange(size) > 0, np.asarray(self.free) & (start.h == 0), start.h > 0)
        at_t, at_h = chosen.places

        def whole(x: Array) -> tuple[Multipliers, float]:
            d, t, B, h = (np.array(numbers) for numbers in start)
            of_d, of_t, of_B, of_h = chosen.split(x)
            d[chosen.d] += of_d
            t[chosen.t] = of_t * unit
            B[chosen.h] *= np.exp(of_B)
            h[chosen.h] = of_h
            return Multipliers(d, t, B, h), level / float(np.sqrt(max(x[-1], 1e-12)))

        @lru_cache(maxsize=1)  # values and slopes are asked for one after the other
        def highest(*numbers: float) -> tuple[Multipliers, float, Any, Any]:
            multipliers, own = whole(np.array(numbers))
            return multipliers, own, *multipliers.heights(G, s, own)

        def room(x: Array) -> Array:
            return np.asarray(1 - highest(*x)[2])

        def slopes(x: Array) -> Array:
            multipliers, own, _, v = highest(*x)
            along = _slopes(multipliers, G, s, own, v)
            of_t = along.t[:, chosen.t] * unit
            columns = along.d[:, chosen.d], of_t, along.B[:, chosen.h], along.h[:, chosen.h]
            return -np.hstack([*columns, along.square[:, None] / x[-1]])

        def cost(x: Array) -> tuple[float, Array]:
            own = np.zeros(len(x))
            if most is None:
                own[-1] = -1.0
                return -float(x[-1]), own
            own[at_t], own[at_h] = x[at_t], x[at_h]
            return float(own @ own) / 2, own

        square = (0.5, WIDEST) if most is None else ((level / most) ** 2,) * 2
        x = np.concatenate(
            [
                np.zeros(chosen.d.sum()),
                start.t[chosen.t] / unit,
                np.zeros(chosen.h.sum()),
                start.h[chosen.h],
                [1.0],
            ]
        )
        x[-1] = np.clip(x[-1], *square)
        ends = [(-scales.FARTHEST, scales.FARTHEST)] * int(chosen.d.sum())
        ends += [(-LONGEST, LONGEST)] * int(chosen.t.sum())
        ends += [(-scales.FARTHEST, scales.FARTHEST)] * int(chosen.h.sum())
        ends += [(0.0, MOST_SHARE)] * int(chosen.h.sum())
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


class _Chosen(NamedTuple):
    """Which numbers are looked for: d, t, and B and h, of each element; their places in x."""

    d: Any
    t: Any
    h: Any

    @property
    def _ends(self) -> tuple[int, int, int]:
        first, second = int(self.d.sum()), int(self.d.sum() + self.t.sum())
        return first, second, second + int(self.h.sum())

    @property
    def places(self) -> tuple[slice, slice]:
        """Places of t and of h."""
        first, second, third = self._ends
        return slice(first, second), slice(third, -1)

    def split(self, x: Array) -> list[Array]:
        """Return d, t, B and h of all but the last number."""
        return np.split(x[:-1], self._ends)


class _Along(NamedTuple):
    """Slopes of v*(Z*Z / L^2 + 2 He(c Z)) v, (count, k) to d, t, log B and h; to log 1 / L^2."""

    d: Array
    t: Array
    B: Array
    h: Array
    square: Array


def _slopes(multipliers: Multipliers, G: Any, s: Any, level: Any, v: Any) -> _Along:
    """Return slopes with respect to the multipliers along v (count, k)."""
    level = np.broadcast_to(level, s.shape)
    share = (1 / level**2)[:, None]
    _, Z, mu = multipliers.at(G, s)
    c = multipliers.turned(s, mu, level)
    Zv = (Z @ v[..., None])[..., 0]
    back = (_adjoint(Z) @ Zv[..., None])[..., 0]
    turned = (_adjoint(Z) @ (c.conj() * v)[..., None])[..., 0]
    square, forth = np.abs(Zv) ** 2, v.conj() * Zv
    of_d = 2 * (square - (back.conj() * v).real) * share
    of_d = of_d + 2 * ((c * forth).real - (turned.conj() * v).real)
    of_t = 2 * (s[:, None] * forth).real
    of_mu = 2 * forth.imag / level[:, None]
    of_square = (square * share + mu * forth.imag / level[:, None]).sum(axis=-1)
    B, h, M = multipliers.B, multipliers.h, multipliers.lag(s)
    far = np.where(h > 0, B + s[:, None], 1.0)
    of_numbers = []
    for dM in (-h * B * s[:, None] / far**2, -B / far):
        of_w = dM.real / (2 * M.real)
        of_numbers.append(of_d * of_w + of_mu * (dM.imag - mu * dM.real) / M.real)
    of_B, of_h = of_numbers
    return _Along(of_d, of_t, of_B, of_h, of_square)


def _with(numbers: Array, k: int, value: float) -> Array:
    return np.where(np.arange(len(numbers)) == k, value, numbers)


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


def slopes(loops: Loops, free: Any, lagged: Any = ()) -> Slopes:
    """Return levels at peaks with their slopes, multipliers found anew."""
    best, _ = _best(loops, free, lagged, HASTY)
    multipliers = best.multipliers
    if multipliers.alone and len(multipliers.t) == 1:
        return Gain("z").slopes(loops)
    G, s = _responses(loops, best.at, best.w)
    every, vectors = multipliers.levels(G, s)
    some, which = np.nonzero(every >= NEAR * every.max(axis=1, keepdims=True))
    G, s, points, levels = G[some], s[some], best.at[some], every[some, which]
    v = vectors[some, :, which]
    w, Z, mu = multipliers.at(G, s)
    c, square = multipliers.turned(s, mu, levels), levels[:, None] ** 2
    u = w * ((Z @ v[..., None])[..., 0] + square * c.conj() * v)
    A, E, C = (M[points] for M in (loops.A, loops.E, loops.C))
    highest = Highest(levels, points, u / levels[:, None], v / w, s, A, E, C)
    along, lag = _slopes(multipliers, G, s, levels, v), multipliers.h > 0
    numbers = along.d[:, 1:], along.t[:, np.asarray(free) & ~lag], along.B[:, lag], along.h[:, lag]
    moved = np.hstack(numbers) * levels[:, None] / 2
    sized = moved / np.maximum(np.abs(moved).max(axis=0), 1e-300)
    mixed = scales.following(levels, sized)

    def turned() -> list[Turned]:
        return [highest.turned()]

    return Slopes(levels, points, turned, mixed)
