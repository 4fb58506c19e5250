"""Responses as values: arrays (alpha, time or frequency, signal), with their names."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal, pick
from polefence.plant.system import Array
from polefence.response import measures


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

    def settling(self, share: float = 0.02, of: measures.Reference | None = None) -> Array:
        """Return settling times [s], (count, p); see `measures.settling`."""
        return measures.settling(self.time, self.values, self.final, share, of)

    def overshoot(self) -> Array:
        """Return overshoot as a share of the final value, (count, p); see `measures.overshoot`."""
        return measures.overshoot(self.values, self.final)

    def peaks(self) -> tuple[Array, Array]:
        """Return peaks and their times [s], two (count, p); see `measures.peaks`."""
        return measures.peaks(self.time, self.values)

    def rms(self, since: float = 0.0) -> Array:
        """Return rms values from a time [s] on, (count, p)."""
        return measures.rms(self.time, self.values, since)


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
