"""Classical margins of loops that are opened at one place, at many points of a family at once.

They follow from S alone, of the stable closed loop: L is real where S is, and |L| = 1 where
Re S = 1/2. Both are zeros of functions with a state-space form, so eigenvalues say where they lie,
and no peak or crossing is missed between the frequencies of a grid. Disk margins are peaks of
|S + (sigma - 1) / 2| (Seiler, Packard & Gahinet, IEEE Control Systems 40 (2020), no. 5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError, shown
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.closed import point_text
from polefence.response.discrete import balancing
from polefence.response.modes import Modes
from polefence.response.opened import Opened, opened
from polefence.response.peaks import largest, peaks
from polefence.response.stationary import bilinear, unstable

Rows = npt.NDArray[np.intp]
NEAR = 1e-9  # of frequencies that are one, relative
FAR = 1e5  # times the fastest pole: crossings beyond are rounding
MOST = 1e9  # factors of the gain beyond are rounding, too
MOST_SAMPLES = 40  # of delay that are looked at one by one
STEPS = 60  # of the search for a crossing, at most: bisection alone needs so many


@dataclass(frozen=True, eq=False)
class MarginValues(Short):
    """A margin at points of a family, and the frequencies at which the loop would begin to swing.

    Attributes
    ----------
    value : (count,) array
    frequency : (count,) array
        [Hz]; NaN where no error of this kind makes the loop unstable.
    """

    value: Array
    frequency: Array


@dataclass(frozen=True, eq=False)
class LoopMargins(Short):
    """Margins of one loop at points of a family: sampled, so that no proof is in them.

    Where the closed loop itself is not stable, none is left: factors are 1, the others zero.

    Attributes
    ----------
    opened : Opened
    sigma : float
        Skew of the disk margin: 0 is balanced, 1 is of S alone, -1 of T = 1 - S alone.
    stable : (count,) array of bool
    lower : MarginValues
        Factor of the gain below 1; 0 where none makes it unstable.
    upper : MarginValues
        Factor of the gain above 1; infinite where none makes it unstable.
    phase : MarginValues
        [deg], of either sign; at most 180.
    delay : MarginValues
        [s] at which the loop is late enough to be unstable; infinite where none does. In discrete
        time it is exact at whole samples, between these that of L e^(-jwt).
    disk : MarginValues
        1 over the peak of the size of S + (sigma - 1) / 2.
    """

    opened: Opened
    sigma: float
    stable: npt.NDArray[np.bool_]
    lower: MarginValues
    upper: MarginValues
    phase: MarginValues
    delay: MarginValues
    disk: MarginValues

    def __repr__(self) -> str:
        place = self.opened.place
        return f"<LoopMargins of {place.name!r}: {len(self.stable)} points, sampled>"

    @property
    def least(self) -> tuple[LeastMargin, ...]:
        """The least of each over the points, and where that is."""
        return tuple(self._least())

    def _least(self) -> Iterator[LeastMargin]:
        for name in ("lower", "upper", "phase", "delay", "disk"):
            values: MarginValues = getattr(self, name)
            k = int(values.value.argmax() if name == "lower" else values.value.argmin())
            alpha = self.opened.alpha[k]
            yield LeastMargin(name, float(values.value[k]), float(values.frequency[k]), k, alpha)

    def where(self, least: LeastMargin) -> str:
        """Say at which parameters the least one is."""
        return point_text(self.opened.plant, least.alpha)


@dataclass(frozen=True, eq=False)
class LeastMargin(Short):
    """The least of a margin over sampled points: ``name`` is a field of `LoopMargins`.

    Attributes
    ----------
    value : float
        As `LoopMargins` has it.
    frequency : float
        [Hz]
    number : int
        Of the point.
    alpha : (N,) array
    """

    name: str
    value: float
    frequency: float
    number: int
    alpha: Array


@dataclass(frozen=True)
class DiskRanges(Short):
    """What a disk margin leaves to gain and phase, each alone.

    Attributes
    ----------
    lower : float
        Factor of the gain; below zero where the disk has those.
    upper : float
        Factor of the gain; infinite where the disk has all.
    phase : float
        [deg]; 180 where no phase leaves the disk.
    """

    lower: float
    upper: float
    phase: float


@explained
def margins(loop: Opened, sigma: float = 0.0) -> LoopMargins:
    """Return the classical margins of an opened loop, at all of its points.

    Parameters
    ----------
    sigma : float
        Skew of the disk margin.

    Raises
    ------
    InputError
        If sigma is not a finite number.
    """
    disk = _disk(loop, sigma)
    count, stable = len(loop.A), np.ones(len(loop.A), dtype=bool)
    stable[unstable(loop.A, loop.step)] = False
    lower, upper = (_filled(count, value) for value in (0.0, math.inf))
    phase, delay = _filled(count, 180.0), _filled(count, math.inf)
    own = np.flatnonzero(stable)
    curve = _Curve.of(loop.take(own))
    for rows, w, R in _real(curve):
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = (1 + R) / R
        factor = np.where(np.abs(factor) < 1 / MOST, 0.0, factor)
        above = (factor > 1) & (factor < MOST)
        _lessen(upper, own[rows[above]], factor[above], w[above])
        below = (factor < 1) & (factor >= 0)
        _lessen(lower, own[rows[below]], factor[below], w[below], sign=-1)
    for rows, w, R in _of_size_one(curve):
        behind = (math.pi - 2 * np.arctan2(R.imag, 1 + R.real)) % (2 * math.pi)
        angle = np.degrees(np.minimum(behind, 2 * math.pi - behind))
        _lessen(phase, own[rows], angle, w)
        with np.errstate(divide="ignore"):
            _lessen(delay, own[rows], behind / w, w)
    _lessen(delay, own, *_of_samples(loop.take(own), delay.value[own]))
    for values, none in ((lower, 1.0), (upper, 1.0), (phase, 0.0), (delay, 0.0)):
        values.value[~stable], values.frequency[~stable] = none, np.nan
    for values in (lower, upper, phase, delay):
        values.frequency[:] /= 2 * math.pi
    return LoopMargins(loop, float(sigma), stable, lower, upper, phase, delay, disk)


@explained
def disk_margin(
    plant: UncertainPlant,
    law: Any,
    loop: str | None = None,
    sigma: float = 0.0,
    alpha: Any = None,
) -> MarginValues:
    """Return the disk margin of one loop at points of a family: sampled, not proved.

    It is 1 over the peak of the size of S + (sigma - 1) / 2, which a Hamiltonian matrix decides to
    seven digits; zero where the loop is not stable. Arguments are those of `opened`.

    Raises
    ------
    InputError
        As `opened` raises, or if sigma is not a finite number.
    """
    return _disk(opened(plant, law, loop, alpha), sigma)


@explained
def disk_ranges(margin: float, sigma: float = 0.0) -> DiskRanges:
    """Return by which factors the gain, and by how much the phase, may change within a disk margin.

    The disk holds f = (1 + (1 - sigma)/2 d) / (1 - (1 + sigma)/2 d), d smaller than the margin.

    Raises
    ------
    InputError
        If the margin is negative or no number.
    """
    if not margin >= 0 or not math.isfinite(sigma):
        raise InputError(f"a disk margin of {shown(margin)}: give a number, zero or more")
    up, down = margin * (1 - sigma) / 2, margin * (1 + sigma) / 2
    # where the disk's edge meets the real axis, and the circle of size one
    across = (1 - up) * (1 - down) + (1 + up) * (1 + down)
    inner = (1 + down) * (1 - down) + (1 - up) * (1 + up)
    lower = (1 - up) / (1 + down) if down > -1 else -math.inf
    upper = (1 + up) / (1 - down) if down < 1 else math.inf
    phase = math.degrees(math.acos(inner / across)) if abs(inner) <= abs(across) else 180.0
    return DiskRanges(lower, upper, phase)


def _filled(count: int, value: float) -> MarginValues:
    return MarginValues(np.full(count, value), np.full(count, np.nan))


def _lessen(values: MarginValues, rows: Rows, value: Array, w: Array, sign: int = 1) -> None:
    """Put values in that are below those that are there; above with sign -1."""
    for row, new, at in zip(rows.tolist(), value.tolist(), w.tolist(), strict=True):
        if sign * new < sign * values.value[row] or (
            new == values.value[row] and math.isnan(values.frequency[row]) and math.isfinite(new)
        ):
            values.value[row], values.frequency[row] = new, at


def _disk(loop: Opened, sigma: float) -> MarginValues:
    if not isinstance(sigma, int | float | np.number) or not math.isfinite(sigma):
        raise InputError(f"sigma = {shown(sigma)} must be a finite number: 0, 1 of S, -1 of T")
    values = _filled(len(loop.A), 0.0)
    own = np.setdiff1d(np.arange(len(loop.A)), unstable(loop.A, loop.step))
    if not len(own):
        return values
    part = loop.take(own)
    F = part.F + (sigma - 1) / 2
    rows, w, top = peaks(Modes(part.A, loop.step), part.E, part.C, F)
    end = largest(_bilinear(part)[3] + (sigma - 1) / 2)
    peak, at = end, np.full(len(own), math.pi / loop.step if loop.step else math.inf)
    for row, frequency, height in zip(rows.tolist(), w.tolist(), top.tolist(), strict=True):
        if height > peak[row]:
            peak[row], at[row] = height, _physical(frequency, loop.step)
    with np.errstate(divide="ignore"):
        values.value[own], values.frequency[own] = 1 / peak, at / (2 * math.pi)
    return values


def _bilinear(loop: Opened) -> tuple[Array, Array, Array, Array]:
    """Return A, E, C and F in continuous time: of a delta form by the bilinear transform."""
    A, E, C, F = loop.A, loop.E, loop.C, loop.F
    if not loop.step:
        return A, E, C, F
    A, inverse = bilinear(A, loop.step)
    return A, inverse @ E, C @ inverse, F - loop.step / 2 * C @ inverse @ E


def _physical(w: Any, step: float) -> Any:
    """Return frequencies [rad/s] of those of the bilinear transform."""
    return 2 / step * np.arctan(np.asarray(w) * step / 2) if step else w


@dataclass(frozen=True, eq=False)
class _Curve:
    """R = S - 1 over the frequency of the bilinear transform, of loops in balanced coordinates.

    R is small where L is, and has its digits there.
    """

    A: Array
    E: Array
    C: Array
    F: Array
    step: float

    @classmethod
    def of(cls, loop: Opened) -> _Curve:
        A, E, C, F = _bilinear(loop)
        if len(A):
            d = balancing(np.abs(A).max(axis=0, keepdims=True))
            A, E, C = A / d[:, None] * d, E / d[:, None], C * d
            # both ends of one size
            size = [np.abs(M).max(axis=(1, 2), keepdims=True) for M in (E, C)]
            scale = np.sqrt(np.maximum(size[1], 1e-200) / np.maximum(size[0], 1e-200))
            E, C = E * scale, C / scale
        return cls(A, E, C, F - 1, loop.step)

    def at(self, rows: Rows, w: Array) -> tuple[Any, Any]:
        """Return R and its slope over w, of some loops, each at a frequency."""
        A, E, C = self.A[rows], self.E[rows], self.C[rows]
        s = 1j * w[:, None, None] * np.eye(A.shape[-1])
        X = np.linalg.solve(s - A, E.astype(complex))
        slope = -1j * (C @ np.linalg.solve(s - A, X))[:, 0, 0]
        return (C @ X)[:, 0, 0] + self.F[rows, 0, 0], slope

    def both(self) -> tuple[Array, Array]:
        """Return [A 0; 0 -A'] and [E; C'], of R(s) and R(-s)."""
        none = np.zeros_like(self.A)
        A = np.block([[self.A, none], [none, -np.swapaxes(self.A, 1, 2)]])
        return A, np.concatenate([self.E, np.swapaxes(self.C, 1, 2)], axis=1)

    @cached_property
    def poles(self) -> Any:
        """Poles of each loop."""
        return np.linalg.eigvals(self.A)

    @property
    def fastest(self) -> Array:
        """The size of each loop's fastest pole."""
        return np.asarray(np.abs(self.poles).max(axis=1))

    @property
    def middle(self) -> Array:
        """A frequency amid each loop's poles, and minus no pole."""
        sizes = np.abs(self.poles)
        some = np.sqrt(sizes.max(axis=1) * sizes.min(axis=1))[:, None] * np.array([1, 1.3, 1.7])
        away = np.abs(some[:, :, None] + self.poles[:, None]).min(axis=2) / some
        return np.asarray(some[np.arange(len(some)), away.argmax(axis=1)])


Found = Iterator[tuple[Rows, Array, Any]]


def _real(curve: _Curve) -> Found:
    """Yield loops, frequencies [rad/s] and values of R where it is real: at both ends, too."""
    count = len(curve.A)
    if not count:
        return
    every = np.arange(count)
    yield every, np.zeros(count), curve.at(every, np.zeros(count))[0].real
    end = np.full(count, math.pi / curve.step if curve.step else math.inf)
    yield every, end, curve.F[:, 0, 0]
    A, E = curve.both()
    C = np.concatenate([curve.C, np.swapaxes(curve.E, 1, 2)], axis=2)
    # R(s) - R(-s) at s = a (z - 1) / (z + 1): as a function of z it has an inverse
    a = curve.middle[:, None, None]
    one = np.eye(A.shape[-1])
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(a * one - A)
        moved, E = inverse @ (a * one + A), inverse @ E
        zeros = _eigenvalues(moved - E @ (C @ (one + moved)) / (C @ E))
        candidates = np.abs((a[:, 0] * (zeros - 1) / (zeros + 1)).imag)
    for rows, w, R in _crossings(curve, candidates, lambda R: R.imag):
        yield rows, w, R.real


def _of_size_one(curve: _Curve) -> Found:
    """Yield loops, frequencies [rad/s] and values of R where L has the size one."""
    if not len(curve.A):
        return
    A, E = curve.both()
    C = np.concatenate([curve.C, -np.swapaxes(curve.E, 1, 2)], axis=2)
    with np.errstate(all="ignore"):
        zeros = _eigenvalues(A - E @ C / (2 * curve.F + 1))
    yield from _crossings(curve, np.abs(zeros.imag), lambda R: R.real + 0.5)


def _eigenvalues(A: Array) -> Any:
    """Return eigenvalues, none (NaN) of what is no finite matrix."""
    finite = np.isfinite(A).all(axis=(1, 2))
    values = np.full(A.shape[:2], np.nan, dtype=complex)
    values[finite] = np.linalg.eigvals(A[finite])
    return values


def _crossings(curve: _Curve, candidates: Array, of: Any) -> Found:
    """Yield where a function of R changes its sign, which is near candidates alone.

    Parameters
    ----------
    candidates : (count, k) array
        Frequencies; between two of them there is none, but rounding: the signs in the middles
        between them tell those that are.
    """
    sizes = (np.abs(curve.poles), np.abs(curve.poles.imag))
    every = np.concatenate([candidates, *sizes], axis=1)
    rows, low, near, high = (
        np.concatenate(parts) for parts in zip(*_brackets(curve, every), strict=True)
    )
    first, last = (of(curve.at(rows, w)[0]) for w in (low, high))
    some = first * last < 0
    rows, low, near, high, first = (x[some] for x in (rows, low, near, high, first))
    if not len(rows):
        return
    w = near
    for _ in range(STEPS):
        R, slope = curve.at(rows, w)
        value, change = of(R), of(R + slope) - of(R)
        before = value * first > 0
        low, high = np.where(before, w, low), np.where(before, high, w)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = w - value / change
        new = np.where((step > low) & (step < high), step, (low + high) / 2)
        close = np.abs(new - w) <= 1e-13 * w
        w = new
        if close.all():
            break
    yield rows, _physical(w, curve.step), curve.at(rows, w)[0]


def _brackets(curve: _Curve, every: Array) -> Iterator[tuple[Rows, Array, Array, Array]]:
    """Yield for each loop its number, and a frequency below, at and above each candidate."""
    for k, (row, fast) in enumerate(zip(every, curve.fastest, strict=True)):
        w = np.sort(row[np.isfinite(row) & (row > 0) & (row < FAR * fast)])
        w = w[np.append(True, np.diff(w) > NEAR * w[1:])] if len(w) else np.array([fast])
        edges = np.concatenate([[w[0] / 2], np.sqrt(w[1:] * w[:-1]), [2 * w[-1]]])
        yield np.full(len(w), k), edges[:-1], w, edges[1:]


def _of_samples(loop: Opened, most: Array) -> tuple[Array, Array]:
    """Return the first whole number of samples [s] that a loop may not be late, and that of poles.

    By poles, where L has a size of one or more at half of the samples' frequency: there the phase
    of a delay between samples says nothing. In continuous time such an L may not be late at all.

    Parameters
    ----------
    most : (count,) array
        What crossings leave [s]: no more is looked at.
    """
    T, count = loop.step, len(loop.A)
    S = _bilinear(loop)[3][:, 0, 0]
    found = np.where(S > 0.5, math.inf, 0.0)
    if T:
        for k in np.flatnonzero(S <= 0.5):
            found[k] = _first_unstable(loop.take(k), min(most[k] / T, MOST_SAMPLES)) * T
    return found, np.full(count, math.pi / T if T else math.inf)


def _first_unstable(loop: Opened, most: float) -> float:
    """Return how many samples later one loop is unstable first; infinite if there are more."""
    T, F = loop.step, float(loop.F[0, 0])
    A = np.eye(len(loop.A)) + T * (loop.A - loop.E @ loop.C / F)
    E, C, n = T * loop.E / F, loop.C / F, len(A)
    for late in range(1, math.ceil(most) + 1):
        # v, which L is late by, in so many states; L of what is opened is C ... E + 1 - 1/F, less
        chain = np.diag(np.ones(late - 1), -1)
        Z = np.zeros((n + late, n + late))
        Z[:n, :n], Z[n:, n:] = A, chain
        Z[:n, -1:] = E
        Z[n, :n], Z[n, -1] = C[0], 1 - 1 / F
        if np.abs(np.linalg.eigvals(Z)).max() >= 1:
            return late
    return math.inf
