"""What a requirement measures at points of a family, and its slopes with respect to the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.plant.system import Array
from polefence.response.modes import Modes


@dataclass(frozen=True, eq=False)
class Channel:
    """x' = A x + B u + E w, z = C x + D u + F w at ``count`` points: what one requirement is of.

    Attributes
    ----------
    A, B, E, C, D, F : (count, n, n), (count, n, m), (count, n, q), (count, p, n), (count, p, m),
        (count, p, q) arrays
    filters : int
        How many of the states, the last ones, are those of filters: no gain is of them.
    more : (count,) array or zero
        What no law changes of the square of what is measured.
    own : bool
        Whether A and B are not the plant's: those of another sample time.
    """

    A: Array
    B: Array
    E: Array
    C: Array
    D: Array
    F: Array
    filters: int = 0
    more: Any = 0.0
    own: bool = False

    def __getitem__(self, some: Any) -> Channel:
        more = self.more[some] if np.ndim(self.more) else self.more
        return replace(self, **{key: getattr(self, key)[some] for key in "ABECDF"}, more=more)

    def in_units(self, d: Array) -> Channel:
        """Return the channel with states in units d (n,), and filters in matching units."""
        d = self._with_filters(d)
        column = d[:, None]
        A, B, E = self.A / column * d, self.B / column, self.E / column
        return replace(self, A=A, B=B, E=E, C=self.C * d)

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

    def closed(self, K: Array, modes: Modes) -> Loops:
        """Return the loops under gains K (count, m, n), with the modes of A + B K."""
        if self.filters:
            K = np.pad(K, ((0, 0), (0, 0), (0, self.filters)))
            modes = Modes(self.A + self.B @ K, modes.step)
        return Loops(modes, self.E, self.C + self.D @ K, self.F, self.more)

    def slopes(self, slopes: Slopes) -> Array:
        """Return slopes with respect to K (rows, m, n)."""
        B, D = (np.swapaxes(M[slopes.points], 1, 2) for M in (self.B, self.D))
        dA, dC = slopes.turned()
        dK = np.asarray(B @ dA + D @ dC)
        return dK[..., : dK.shape[-1] - self.filters]


@dataclass(frozen=True, eq=False)
class Loops:
    """x' = A x + E w, z = C x + F w: closed loops at ``count`` points.

    Attributes
    ----------
    modes : Modes
        Of A.
    E, C, F : (count, n, q), (count, p, n), (count, p, q) arrays
    more : (count,) array or zero
        See `Channel`.
    """

    modes: Modes
    E: Array
    C: Array
    F: Array
    more: Any = 0.0

    @property
    def A(self) -> Array:
        """The closed loops' own matrices, (count, n, n)."""
        return self.modes.A

    @property
    def covariance(self) -> Array:
        """X of A X + X A' + E E' = 0."""
        return self.modes.covariance(self.E)


@dataclass(frozen=True, eq=False)
class Slopes:
    """Values, one or more a point where more are near the worst, and their slopes.

    Attributes
    ----------
    values : (rows,) array
    points : (rows,) array of int
        Numbers of the points.
    turned : callable
        Returns the slopes with respect to the loops' A and C, (rows, n, n) and (rows, p, n) arrays:
        they take as long as the values, and who looks for the worst point asks for none.
    """

    values: Array
    points: Any
    turned: Callable[[], tuple[Array, Array]]


def of_noise(loops: Loops) -> Slopes:
    """Return the root of trace C X C' + more, A X + X A' + E E' = 0: by A' Q + Q A + C' C = 0.

    In discrete time with step A X A' and step A' Q A besides.
    """
    X, C = loops.covariance, loops.C
    CX = C @ X
    values = np.sqrt(np.maximum((CX * C).sum(axis=(1, 2)) + loops.more, 0.0))

    def turned() -> tuple[Array, Array]:
        Q = loops.modes.observed(np.swapaxes(C, 1, 2) @ C)
        size = np.where(values > 0, values, 1.0)[:, None, None]
        step = loops.modes.step
        moved = X + step * loops.A @ X if step else X
        return Q @ moved / size, CX / size

    return Slopes(values, np.arange(len(values)), turned)
