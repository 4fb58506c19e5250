"""Responses as values, arrays (alpha, time or frequency, signal), and what is measured on them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal, pick
from polefence.plant.system import Array
from polefence.response.discrete import BUFFER

Reference = Literal["final", "peak"]
Flags = npt.NDArray[np.bool_]
# A final value below this share of the peak is zero but for rounding.
ZERO = 1e-9


@dataclass(frozen=True, eq=False)
class Response:
    """Signals over time, at many points of a family.

    Attributes
    ----------
    plant : UncertainPlant
    alpha : (count, N) array
    time : (T,) array
        From 0 in equal steps [s].
    signals : tuple of Output
        p of them.
    values : (count, T, p) array
        In the signals' units.
    final : (count, p) array, optional
        What each signal tends to, where that is known: NaN where it tends to nothing.
    """

    plant: UncertainPlant
    alpha: Array
    time: Array
    signals: tuple[Output, ...]
    values: Array
    final: Array | None = None

    def __post_init__(self) -> None:
        _read_only(self)

    def __repr__(self) -> str:
        count, T, p = self.values.shape
        return f"<Response of {self.plant.name!r}: {count} points, {T} samples, {p} signals>"

    def of(self, name: str) -> Array:
        """Return one signal, (count, T)."""
        return np.asarray(self.values[:, :, self.signals.index(pick(self.signals, name))])

    def settling(self, share: float = 0.02, of: Reference | None = None) -> Array:
        """Return settling times [s], (count, p); see the function."""
        return settling(self.time, self.values, self.final, share, of)

    def overshoot(self) -> Array:
        """Return overshoot as a share of the final value, (count, p); see the function."""
        return overshoot(self.values, self.final)

    def peaks(self) -> tuple[Array, Array]:
        """Return peaks and their times [s], two (count, p); see the function."""
        return peaks(self.time, self.values)

    def rms(self, since: float = 0.0) -> Array:
        """Return rms values from a time [s] on, (count, p)."""
        return rms(self.time, self.values, since)


@dataclass(frozen=True, eq=False)
class Frequency:
    """Transfer functions from disturbances or an input to signals, at many points of a family.

    Attributes
    ----------
    plant : UncertainPlant
    alpha : (count, N) array
    frequency : (F,) array
        [Hz].
    signals : tuple of Output
        p of them.
    sources : tuple of Signal
        q of them: names and units of what is exciting.
    gain : (count, F, p, q) complex array
        [signal's unit / source's unit].
    """

    plant: UncertainPlant
    alpha: Array
    frequency: Array
    signals: tuple[Output, ...]
    sources: tuple[Signal, ...]
    gain: npt.NDArray[np.complex128]

    def __post_init__(self) -> None:
        _read_only(self)

    def __repr__(self) -> str:
        count, F, p, q = self.gain.shape
        return (
            f"<Frequency of {self.plant.name!r}: {count} points, {F} frequencies, {p} signals, "
            f"{q} sources>"
        )

    def of(self, name: str) -> npt.NDArray[np.complex128]:
        """Return the gains to one signal, (count, F, q)."""
        return np.asarray(self.gain[:, :, self.signals.index(pick(self.signals, name))])


def _read_only(result: Any) -> None:
    """Make the arrays of a frozen result read-only, as seen through it."""
    for entry in fields(result):
        value = getattr(result, entry.name)
        if isinstance(value, np.ndarray):
            value = value.view()
            value.flags.writeable = False
            object.__setattr__(result, entry.name, value)


def settling(
    time: Array,
    values: Array,
    final: Array | None = None,
    share: float = 0.02,
    of: Reference | None = None,
) -> Array:
    """Return when each signal comes within a share of its final value for good [s], (count, p).

    The band is that share of the final value; of the largest absolute value for responses that
    return to zero. Between samples the response is taken as straight: what it does there is not
    seen. NaN where a signal is outside the band at the last sample, or its final value is NaN.

    Parameters
    ----------
    time : (T,) array
        [s].
    values : (count, T, p) array
    final : (count, p) array, optional
        What the signals tend to; zero by default, and NaN for those that tend to nothing.
    share : float
        Of the final value (or peak), above 0 and below 1.
    of : "final" or "peak", optional
        What the band is a share of; by default as above.

    Raises
    ------
    InputError
        If share or ``of`` is none of these, or ``of`` is "final" and no final value is known.
    """
    if not 0 < share < 1:
        raise InputError(f"share = {share!r} of the final value; use one in 0 < share < 1")
    if of not in (None, "final", "peak"):
        raise InputError(f"of = {of!r}; use 'final' or 'peak'")
    if of == "final" and final is None:
        raise InputError("of = 'final': no final value of this response is known; use 'peak'")
    count, _, p = values.shape
    end = np.zeros((count, p)) if final is None else np.asarray(final, dtype=float)
    found = np.empty((count, p))
    for part, rows in _chunks(values):
        size = np.abs(rows).max(axis=-1)
        to = end[part]
        goes = np.abs(to) if of == "final" else np.where(_returns(to, size), size, np.abs(to))
        band = share * (size if of == "peak" else goes)
        rows -= to[..., None]
        found[part] = _last_crossing(time, rows, band)
    return found


def _last_crossing(time: Array, rows: Array, band: Array) -> Array:
    """Return when |rows| (count, p, T) last falls to the band (count, p), NaN where it has not."""
    T = len(time)
    # What is no number is outside.
    outside: Flags = np.logical_not(np.abs(rows) <= band[..., None])
    last = T - 1 - np.argmax(outside[..., ::-1], axis=-1)
    never = np.logical_not(outside.any(axis=-1))
    k = np.minimum(last, max(T - 2, 0))[..., None]
    next_k = np.minimum(k + 1, T - 1)
    here, there = (np.take_along_axis(rows, i, axis=-1)[..., 0] for i in (k, next_k))
    side = np.sign(here)
    drop = side * (here - there)
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.where(drop > 0, (side * here - band) / drop, 0.0)
    at = time[k[..., 0]] + part * (time[next_k[..., 0]] - time[k[..., 0]])
    return np.where(never, time[0], np.where(last == T - 1, np.nan, at))


def overshoot(values: Array, final: Array | None = None) -> Array:
    """Return how far each signal goes beyond its final value, as a share of it, (count, p).

    0.1 is 10 %. NaN where the final value is zero or not known: then see the function.

    Parameters
    ----------
    values : (count, T, p) array
    final : (count, p) array, optional
        What the signals tend to.
    """
    count, _, p = values.shape
    found = np.full((count, p), np.nan)
    if final is None:
        return found
    for part, rows in _chunks(values):
        size, to = np.abs(rows).max(axis=-1), np.asarray(final, dtype=float)[part]
        beyond = np.where(to > 0, rows.max(axis=-1), -rows.min(axis=-1))
        usable = ~_returns(to, size) & np.isfinite(to)
        known = np.where(usable, np.abs(to), 1.0)
        found[part] = np.where(usable, np.maximum(beyond / known - 1, 0.0), np.nan)
    return found


def peaks(time: Array, values: Array) -> tuple[Array, Array]:
    """Return each signal's sample of largest absolute value, with its sign, and its time [s].

    Returns
    -------
    peak, at : (count, p) arrays
    """
    count, _, p = values.shape
    peak, at = np.empty((count, p)), np.empty((count, p))
    for part, rows in _chunks(values):
        k = np.argmax(np.abs(rows), axis=-1)
        peak[part] = np.take_along_axis(rows, k[..., None], axis=-1)[..., 0]
        at[part] = time[k]
    return peak, at


def rms(time: Array, values: Array, since: float = 0.0) -> Array:
    """Return the root of each signal's mean square from ``since`` [s] on, (count, p).

    Raises
    ------
    InputError
        If no sample is that late.
    """
    first = int(np.searchsorted(time, since))
    if first >= len(time):
        raise InputError(f"since = {since:g} s; the response ends at {time[-1]:g} s")
    late = values[:, first:]
    return np.asarray(np.sqrt(np.einsum("atp,atp->ap", late, late) / late.shape[1]))


def _returns(final: Array, size: Array) -> Flags:
    return np.asarray(np.abs(final) <= ZERO * size, dtype=np.bool_)


def _chunks(values: Array) -> Iterator[tuple[slice, Array]]:
    """Yield slices of the batch with their values as (some, p, T), the caller's to change."""
    count, T, p = values.shape
    some = max(1, BUFFER // (8 * max(1, T * p)))
    for first in range(0, count, some):
        part = slice(first, min(first + some, count))
        yield part, np.array(np.swapaxes(values[part], 1, 2), order="C")
