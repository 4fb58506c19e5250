"""Peaks of frequency responses, of many loops at once: where a Hamiltonian says that they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.kernel import kernel
from polefence.plant.system import Array
from polefence.response.modes import Modes
from polefence.response.stationary import bilinear

CLOSE = 1e-7  # to which the highest is one, relative
POINTS = 9  # of an interval that is zoomed into

Band = tuple[float, float]  # of frequencies [rad/s]


def response(A: Array, E: Array, C: Array, F: Array, s: Any) -> Any:
    """Return C (s - A)^-1 E + F, (count, f, p, q), at s (count, f) [1/s]."""
    s = s[..., None, None] * np.eye(A.shape[-1])
    right = np.broadcast_to(E[:, None], (*s.shape[:2], *E.shape[1:]))
    with np.errstate(all="ignore"):
        X = np.linalg.solve(s - A[:, None], right)
    return C[:, None] @ X + F[:, None]


def largest(G: Any) -> Array:
    """Return the largest singular values of matrices; of one row or column its length."""
    if 1 in G.shape[-2:]:
        return np.asarray(np.sqrt((np.abs(G) ** 2).sum(axis=(-2, -1))))
    H = np.swapaxes(G.conj(), -1, -2)
    squares = np.linalg.eigvalsh(H @ G if G.shape[-1] < G.shape[-2] else G @ H)[..., -1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def peaks(
    modes: Modes, E: Array, C: Array, F: Array, band: Band | None = None
) -> tuple[Array, Array, Array]:
    """Return the peaks of the largest singular value: loops, frequencies [rad/s] and heights.

    Of each loop the highest, and others near it in height. That no other is higher is decided by
    the imaginary eigenvalues of a Hamiltonian matrix (Bruinsma & Steinbuch, 1990). Of a delta form
    w is that of its bilinear transform: the response there is at s = jw / (1 - jw step / 2).

    Parameters
    ----------
    modes : Modes
        Of stable A (count, n, n).
    E, C, F : (count, n, q), (count, p, n), (count, p, q) arrays
    band : pair of float, optional
        Between which w is; at its ends there may be peaks too.
    """
    modes, E, C, F = _continuous(modes, E, C, F)
    A, height = modes.A, _Height(modes, E, C, F)
    grid = _grid(modes.poles, band)
    low, high = (0.0, np.inf) if band is None else band
    loops, w, top = height.climbed(grid)
    for _ in range(8):  # at most: each round climbs every peak that still exceeds the best
        best = np.zeros(len(A))
        np.maximum.at(best, loops, top)
        higher = _higher(A, E, C, F, best * (1 + CLOSE))
        if band is not None:
            higher = [w[(w > low) & (w < high)] for w in higher]
        missed = [k for k, crossings in enumerate(higher) if len(crossings)]
        if not missed:
            break
        gained = False
        for k in missed:
            edges = higher[k]
            middle = np.concatenate([(edges[1:] + edges[:-1]) / 2, edges])[None]
            more = height(middle, slice(k, k + 1))
            j = int(more.argmax())
            if more[0, j] > best[k] * (1 + CLOSE):
                ends = max(edges[0] / 2, low), min(2 * edges[-1], high)
                around = np.array([[ends[0], middle[0, j], ends[1]]])
                zoomed = _zoomed(height, np.array([k]), around)
                loops, w = np.append(loops, k), np.append(w, zoomed[0])
                top, gained = np.append(top, zoomed[1]), True
        if not gained:
            break
    best = np.zeros(len(A))
    np.maximum.at(best, loops, top)
    order = np.lexsort((-top, loops))
    some = list[int]()
    # peaks at least half as high as the highest
    for k in order[(top >= 0.5 * best[loops])[order]]:
        # one peak, reached twice: nearer than 1 %
        again = (j for j in some if loops[j] == loops[k] and abs(w[j] - w[k]) <= 1e-2 * w[k])
        if next(again, None) is None:
            some.append(int(k))
    some.sort(key=lambda k: (loops[k], w[k]))
    return loops[some], w[some], top[some]


def climbed(modes: Modes, E: Array, C: Array, F: Array, of: Any) -> tuple[Array, Array, Array]:
    """Return the peaks of a function of the frequency and of the largest singular value there.

    Found from a grid, as those of `peaks` first are; parameters are the same.
    """
    modes, E, C, F = _continuous(modes, E, C, F)
    height, grid = _Height(modes, E, C, F), _grid(modes.poles)

    def value(w: Array, some: Any = slice(None)) -> Array:
        return np.asarray(of(w, height(w, some)))

    # an even number: of an odd one the middle may be twice among the points, and a half is lost
    return _climbed(value, grid, value(grid), np.arange(len(modes.A)), points=10)


def on_grid(modes: Modes, E: Array, C: Array, F: Array, band: Band | None = None) -> Array:
    """Return the largest singular value on a grid of frequencies, those of the poles among them.

    Parameters are those of `peaks`, of which it is at most the height of the highest.
    """
    modes, E, C, F = _continuous(modes, E, C, F)
    return np.asarray(_Height(modes, E, C, F)(_grid(modes.poles, band)).max(axis=1))


def _continuous(modes: Modes, E: Array, C: Array, F: Array) -> tuple[Modes, Array, Array, Array]:
    """Return the loops in continuous time: those in delta form by the bilinear transform."""
    if not modes.step:
        return modes, E, C, F
    A, inverse = bilinear(modes.A, modes.step)
    F = F - modes.step / 2 * C @ inverse @ E
    return Modes(A), inverse @ E, C @ inverse, F


@dataclass(frozen=True, eq=False)
class _Height:
    """The largest singular value as a function of frequencies (count, f), and of loops.

    A sum over the modes; of matrices whose eigenvectors are too near to one another, solved.
    """

    modes: Modes
    E: Array
    C: Array
    F: Array

    def __call__(self, w: Array, some: Any = slice(None)) -> Array:
        return self._summed(w, some) if self._modal else self._solved(w, some)

    def climbed(self, grid: Array) -> tuple[Any, Array, Array]:
        """Return the highest of the local peaks on a grid, each zoomed into."""
        if kernel() is None or not self._modal:
            return _climbed(self, grid, self(grid), np.arange(len(grid)))
        poles, left, right = (np.ascontiguousarray(M, dtype=complex) for M in self._parts)
        F, grid = (np.ascontiguousarray(M, dtype=float) for M in (self.F, grid))
        found: tuple[Any, Array, Array] = kernel().climbed(poles, left, right, F, grid, POINTS)
        return found

    @cached_property
    def _parts(self) -> tuple[Any, Any, Any]:
        return self.modes.poles, self.C @ self.modes.right, self.modes.left @ self.E

    @cached_property
    def _modal(self) -> bool:
        """Whether the sum agrees with what is solved, at the frequencies of the poles."""
        w = np.abs(self.modes.poles)
        known = self._solved(w)
        off = np.abs(self._summed(w) - known)
        return bool(np.all(off <= 1e-9 * known.max(axis=1, keepdims=True)))

    def _solved(self, w: Array, some: Any = slice(None)) -> Array:
        A, E, C, F = (M[some] for M in (self.modes.A, self.E, self.C, self.F))
        return largest(response(A, E, C, F, 1j * w))

    def _summed(self, w: Array, some: Any = slice(None)) -> Array:
        poles, left, right = (M[some] for M in self._parts)
        with np.errstate(all="ignore"):
            resolvent = 1 / (1j * w[:, :, None] - poles[:, None])
            if left.shape[1] == right.shape[2] == 1:
                G = (resolvent @ (left[:, 0] * right[:, :, 0])[:, :, None])[..., None]
            else:
                G = (left[:, None] * resolvent[:, :, None]) @ right[:, None]
        return largest(G + self.F[some][:, None])


def _grid(poles: Any, band: Band | None = None) -> Array:
    """Return rising frequencies (count, f): zero, those of the poles, some between and beyond.

    In a band its ends, those of the others that are in it, and some between.
    """
    sizes = np.abs(poles)
    fast = np.maximum(sizes.max(axis=1), np.finfo(float).tiny)
    slow = np.maximum(sizes.min(axis=1), 1e-6 * fast)
    # frequencies between the slowest and the fastest rate, besides the poles' own
    share = np.linspace(0, 1, 24)
    even = (slow / 5)[:, None] * ((25 * fast / slow)[:, None]) ** share
    rates = np.concatenate([sizes, np.abs(poles.imag)], axis=1)
    ends = np.stack([0 * fast, 1e4 * fast], axis=1)
    grid = _apart(np.concatenate([even, rates, ends], axis=1))
    return grid if band is None else np.stack([_inside(row, *band) for row in grid])


def _inside(w: Array, low: float, high: float) -> Array:
    """Return rising frequencies of a band, as many as there are and a few; those given if in it.

    Where the band is far wider than what is given, its upper end is ten times as large.
    """
    high = min(high, 10 * max(w[-1], low))
    own = w[(w > low) & (w < high)]
    # in the place of those outside, and few more: in ratios as irrational as can be
    share = np.arange(1, 7 + len(w) - len(own)) * ((np.sqrt(5) - 1) / 2) % 1
    return np.sort(np.concatenate([[low, high], own, low + (high - low) * share]))


def _apart(w: Array) -> Array:
    """Return rows of frequencies, rising; near duplicates are moved beyond the others."""
    w = np.sort(w, axis=1)
    again = np.pad(np.diff(w) <= 1e-6 * w[:, 1:], ((0, 0), (1, 0)))
    return np.sort(np.where(again, w[:, -1:] * (1 + np.cumsum(again, axis=1)), w), axis=1)


def _climbed(
    height: Any, grid: Array, values: Array, loops: Any, points: int = POINTS
) -> tuple[Any, Array, Array]:
    """Return the highest of the local peaks on a grid, each zoomed into."""
    left = np.pad(values[:, :-1], ((0, 0), (1, 0)), constant_values=-1.0)
    right = np.pad(values[:, 1:], ((0, 0), (0, 1)), constant_values=-1.0)
    local = np.where((values >= left) & (values > right), values, -1.0)
    some = np.argsort(-local, axis=1, kind="stable")[:, :5]  # peaks of a loop that are looked at
    rows = np.repeat(loops, some.shape[1])
    at = some.ravel()
    real = local[rows, at] >= 0.5 * values.max(axis=1)[rows]
    rows, at = rows[real], at[real]
    last = grid.shape[1] - 1
    around = np.stack(
        [grid[rows, np.maximum(at - 1, 0)], grid[rows, at], grid[rows, np.minimum(at + 1, last)]], 1
    )
    return rows, *_zoomed(height, rows, around, points)


def _zoomed(height: Any, loops: Any, around: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Return the highest point within intervals (k, 3): low, a point inside, high."""
    low, best, high = around.T
    top = height(best[:, None], loops)[:, 0]
    share = np.linspace(0, 1, points)
    rows = np.arange(len(loops))
    for _ in range(7):  # each leaves a quarter of the interval
        w = np.sort(np.append(low[:, None] + (high - low)[:, None] * share, best[:, None], 1), 1)
        values = height(w, loops)
        j = values.argmax(axis=1)
        best, top = w[rows, j], values[rows, j]
        low, high = w[rows, np.maximum(j - 1, 0)], w[rows, np.minimum(j + 1, w.shape[1] - 1)]
    return best, top


def _higher(A: Array, E: Array, C: Array, F: Array, level: Array) -> list[Array]:
    """Return for each loop the frequencies at which a singular value has that level, rising."""
    crossings = [np.zeros(0)] * len(A)
    direct = largest(F)
    some = np.flatnonzero((level > direct * (1 + CLOSE)) & (level > 0))
    if not len(some):
        return crossings
    A, E, C, F = A[some], E[some], C[some], F[some]
    square = level[some, None, None] ** 2
    Et, Ct, Ft = (np.swapaxes(M, 1, 2) for M in (E, C, F))
    R = np.linalg.inv(square * np.eye(E.shape[2]) - Ft @ F)
    middle = A + E @ R @ Ft @ C
    # scaled so that both blocks off the diagonal are of one size
    up, down = E @ R @ Et, Ct @ (np.eye(C.shape[1]) + F @ R @ Ft) @ C
    size = [np.abs(M).max(axis=(1, 2), keepdims=True) for M in (up, down)]
    scale = np.sqrt(np.maximum(size[1], 1e-100)) / np.sqrt(np.maximum(size[0], 1e-100))
    H = np.block([[middle, up * scale], [-down / scale, -np.swapaxes(middle, 1, 2)]])
    values = np.linalg.eigvals(H)
    for k, eigenvalues in zip(some, values, strict=True):
        # on the imaginary axis but for rounding
        imaginary = np.abs(eigenvalues.real) <= 1e-7 * np.abs(eigenvalues).max()
        w = np.sort(eigenvalues.imag[imaginary & (eigenvalues.imag >= 0)])
        crossings[k] = w
    return crossings
