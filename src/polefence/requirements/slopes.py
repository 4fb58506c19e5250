"""What a requirement measures at points of a family, and its slopes with respect to the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from polefence.lmi.solve.common import common
from polefence.plant.system import Array
from polefence.response.modes import Modes

# Of the cost of periods in a random order, what a centre may cost more than the least: 0.25 % of
# an rms.
GAP = 5e-3
ALIKE = 0.9  # of the largest at a point: peaks in time whose slopes are asked for


class Acting(NamedTuple):
    """A disturbance of the plant, by its number."""

    number: int


class Rated(NamedTuple):
    """Which elements may have multipliers of Popov, and which those of Zames and Falb."""

    led: tuple[bool, ...]
    lagged: tuple[bool, ...]

    @property
    def any(self) -> bool:
        """Whether one may have some."""
        return any((*self.led, *self.lagged))


@dataclass(frozen=True, eq=False)
class Channel:
    """x' = A x + B u + E w, z = C x + D u + F w at ``count`` points: what one requirement is of.

    Attributes
    ----------
    A, B, E, C, D, F : (count, n, n), (count, n, m), (count, n, q), (count, p, n), (count, p, m),
        (count, p, q) arrays
    S : (disturbances, q) array, optional
        What each column of E and F is of the plant's, so that what passes through a law comes in
        alike; where there is none, nothing that does is asked for.
    filters : int
        How many of the states, the last ones, are those of filters: no gain is of them.
    more : (count,) array or zero
        What no law changes of the square of what is measured; of the largest of rows (count, p).
    length : float
        Of a period, in sample times: A and B are then of samples so far apart.
    beside : tuple of Channel
        The same for periods of other lengths, where they may follow one another in any order.
    reads : tuple of str, int or Acting
        Of opened loops: the signal of a law, or the number of the input, that each of w adds to,
        or a disturbance of the plant's own.
    rated : Rated, optional
        Of elements: those that may have multipliers, see `polefence.requirements.multipliers`.
    """

    A: Array
    B: Array
    E: Array
    C: Array
    D: Array
    F: Array
    S: Array | None = None
    filters: int = 0
    more: Any = 0.0
    length: float = 1.0
    beside: tuple[Channel, ...] = ()
    reads: tuple[str | int | Acting, ...] = ()
    rated: Rated | None = None

    def __getitem__(self, some: Any) -> Channel:
        more = self.more[some] if np.ndim(self.more) else self.more
        beside = tuple(channel[some] for channel in self.beside)
        matrices = {key: getattr(self, key)[some] for key in "ABECDF"}
        return replace(self, **matrices, more=more, beside=beside)

    def louder(self, size: float) -> Channel:
        """Return the channel with disturbances of so many times the size."""
        S = None if self.S is None else size * self.S
        return replace(self, E=size * self.E, F=size * self.F, S=S)

    def in_units(self, d: Array) -> Channel:
        """Return the channel with states in units d (n,), and filters in matching units."""
        d = self._with_filters(d)
        column = d[:, None]
        A, B, E = self.A / column * d, self.B / column, self.E / column
        beside = tuple(channel.in_units(d) for channel in self.beside)
        return replace(self, A=A, B=B, E=E, C=self.C * d, beside=beside)

    def _with_filters(self, d: Array) -> Array:
        """Return units (n,) of the plant's states with those of filters behind them.

        What the others feed into a state, over the largest of its own rates; of one that they feed
        nothing into, as of the one before it.
        """
        n = len(d)
        units = list(d)
        for i in range(n, n + self.filters):
            fed = float(np.max(np.abs(self.A[:, i, :n]) @ d))
            rate = float(np.abs(self.A[:, i, n:]).max())
            units.append(fed / rate if fed and rate else units[-1])
        return np.array(units)

    def closed(self, K: Array, modes: Modes, passing: Array | None = None) -> Loops:
        """Return the loops under u = K x + P w, with the modes of A + B K.

        Parameters
        ----------
        K : (count, m, n) array
        passing : (count, m, q) array, optional
            P; left out where it is zero.
        """
        if self.filters:
            K = np.pad(K, ((0, 0), (0, 0), (0, self.filters)))
            modes = Modes(self.A + self.B @ K, modes.step)
        beside = tuple(
            channel.closed(K, Modes(channel.A + channel.B @ K, modes.step))
            for channel in self.beside
        )
        shown, E, F = self.C + self.D @ K, self.E, self.F
        if passing is not None and self.S is not None:
            moved = passing @ self.S
            E, F = E + self.B @ moved, F + self.D @ moved
        return Loops(modes, E, shown, F, self.more, self.length, beside, self.rated)

    def slopes(self, slopes: Slopes) -> Array:
        """Return slopes with respect to K (rows, m, n)."""
        dK: Any = 0.0
        for channel, turned in zip((self, *self.beside), slopes.turned(), strict=True):
            B, D = (np.swapaxes(M[slopes.points], 1, 2) for M in (channel.B, channel.D))
            dK = dK + B @ turned.A + D @ turned.C
        return np.asarray(dK[..., : dK.shape[-1] - self.filters])

    def passing_slopes(self, slopes: Slopes) -> Array:
        """Return slopes with respect to P of `closed` (rows, m, q)."""
        (turned,) = slopes.turned()
        B, D = (np.swapaxes(M[slopes.points], 1, 2) for M in (self.B, self.D))
        parts = (M @ d for M, d in ((B, turned.E), (D, turned.F)) if d is not None)
        dP = np.sum(list(parts), axis=0)
        return np.asarray(dP if self.S is None else dP @ self.S.T)


@dataclass(frozen=True, eq=False)
class Loops:
    """x' = A x + E w, z = C x + F w: closed loops at ``count`` points.

    Attributes
    ----------
    modes : Modes
        Of A.
    E, C, F : (count, n, q), (count, p, n), (count, p, q) arrays
    more : (count,) array or zero
    length : float
    beside : tuple of Loops
    rated : tuple of bool
        See `Channel`.
    """

    modes: Modes
    E: Array
    C: Array
    F: Array
    more: Any = 0.0
    length: float = 1.0
    beside: tuple[Loops, ...] = ()
    rated: Rated | None = None

    @property
    def A(self) -> Array:
        """The closed loops' own matrices, (count, n, n)."""
        return self.modes.A

    @property
    def covariance(self) -> Array:
        """X of A X + X A' + E E' = 0."""
        return self.modes.covariance(self.E)


class Turned(NamedTuple):
    """Slopes with respect to A, C, E and F of loops, (rows, ., .); None is zero."""

    A: Array
    C: Array
    E: Array | None = None
    F: Array | None = None


@dataclass(frozen=True, eq=False)
class Slopes:
    """Values, one or more a point where more are near the worst, and their slopes.

    Attributes
    ----------
    values : (rows,) array
    points : (rows,) array of int
        Numbers of the points.
    turned : callable
        Returns the slopes with respect to the loops, and to each beside them: they take as long as
        the values, and who looks for the worst point asks for none.
    mixed : (rows, rows) array, optional
        What slopes of values are of these, where weights that are best turn with the loops.
    """

    values: Array
    points: Any
    turned: Callable[[], list[Turned]]
    mixed: Array | None = None


def of_noise(loops: Loops) -> Slopes:
    """Return the root of trace C X C' + more, A X + X A' + E E' = 0: by A' Q + Q A + C' C = 0.

    In discrete time with step A X A' and step A' Q A besides. Of loops for periods of several
    lengths, in any order, it is bounded by one Q for all.
    """
    if loops.beside:
        return _in_any_order(loops)
    X, C = loops.covariance, loops.C
    CX = C @ X
    values = np.sqrt(np.maximum((CX * C).sum(axis=(1, 2)) + loops.more, 0.0))

    def turned() -> list[Turned]:
        Q = loops.modes.observed(np.swapaxes(C, 1, 2) @ C)
        size = np.where(values > 0, values, 1.0)[:, None, None]
        step = loops.modes.step
        moved = X + step * loops.A @ X if step else X
        return [Turned(Q @ moved / size, CX / size, Q @ loops.E / size)]

    return Slopes(values, np.arange(len(values)), turned)


def of_largest(loops: Loops) -> Slopes:
    """Return roots of c X c' + more, X as `of_noise` has it, of the rows c that are times in turn.

    Those that are largest among their neighbours, and nearly so of all at the point.
    """
    X, C = loops.covariance, loops.C
    CX = C @ X
    every = np.sqrt(np.maximum((CX * C).sum(axis=2) + loops.more, 0.0))
    beside = np.pad(every, ((0, 0), (1, 1)), constant_values=-1.0)
    chosen = (every > beside[:, :-2]) & (every >= beside[:, 2:])
    points, which = np.nonzero(chosen & (every >= ALIKE * every.max(axis=1, keepdims=True)))
    values = every[points, which]

    def turned() -> list[Turned]:
        modes = Modes(loops.A[points], loops.modes.step)
        c, cX = C[points, which], CX[points, which]
        size = np.where(values > 0, values, 1.0)[:, None]
        moved = X[points] + modes.step * modes.A @ X[points]
        Q = modes.observed(c[:, :, None] * c[:, None]) / size[:, :, None]
        dC = np.zeros((len(points), *C.shape[1:]))
        dC[np.arange(len(points)), which] = cX / size
        return [Turned(Q @ moved, dC, Q @ loops.E[points])]

    return Slopes(values, points, turned)


def _in_any_order(loops: Loops) -> Slopes:
    """Return the roots of <W, Q> + more, Q the centre of what does for all loops."""
    every, step = (loops, *loops.beside), loops.modes.step
    F = np.stack([np.eye(loop.A.shape[-1]) + step * loop.A for loop in every], axis=1)
    C = np.stack([loop.C for loop in every], axis=1)
    times = step * np.array([loop.length for loop in every])[:, None, None]
    E = np.concatenate([loop.E / loop.length**0.5 for loop in every], axis=2)
    more = np.max([np.zeros(len(F)) + loop.more for loop in every], axis=0)
    W = E @ np.swapaxes(E, 1, 2) / len(every)
    found = common(F, times * np.swapaxes(C, 2, 3) @ C, W, GAP)
    values = np.sqrt(np.maximum(found.cost + more, 0.0))

    def turned() -> list[Turned]:
        dF, dM = found.slopes
        size = 2 * np.where(values > 0, values, 1.0)[:, None, None, None]
        dA, dC = step * dF / size, 2 * times * C @ dM / size
        return [Turned(dA[:, k], dC[:, k]) for k in range(len(every))]

    return Slopes(values, np.arange(len(values)), turned)
