"""One-third-octave bands: rms from a density, from a record, and of a stationary ride."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.weighting import HALF_BAND, WF, WK, Gains, Weighting, positive, sampled

_NOMINAL = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)

# The integrals of a stationary ride run over the bands -20 to 30, 0.0089 to 1122 Hz: beyond, the
# weightings fall so fast that nothing counts. In every band so many Gauss-Legendre nodes in log f.
FIRST, LAST, NODES = -20, 30, 20


@dataclass(frozen=True)
class Bands(Short):
    """Neighbouring one-third-octave bands, number n about 10^(n/10) Hz (IEC 61260, base ten).

    Attributes
    ----------
    first, last : int
        Numbers of the lowest and the highest band: 0 is 1 Hz, 19 is 80 Hz.
    """

    first: int
    last: int

    @property
    def numbers(self) -> Array:
        """Numbers of the bands, (F,)."""
        return np.arange(self.first, self.last + 1, dtype=float)

    @property
    def nominal(self) -> Array:
        """Nominal centre frequencies [Hz], (F,): 1, 1.25, 1.6, 2, ..."""
        return np.array([_nominal(n) for n in range(self.first, self.last + 1)])

    @property
    def centre(self) -> Array:
        """Exact centre frequencies [Hz], (F,)."""
        return np.asarray(10 ** (self.numbers / 10))

    @property
    def edges(self) -> Array:
        """Edges of the bands [Hz], (F + 1,): every band ends where the next begins."""
        return np.append(self.centre / HALF_BAND, self.centre[-1] * HALF_BAND)

    def of_density(self, frequency: Any, density: Any) -> Array:
        """Return the rms in every band of a one-sided density, linear between its points.

        Parameters
        ----------
        frequency : (F,) array
            Increasing [Hz]; must cover the bands.
        density : (..., F) array
            Square of the signal's unit per Hz.

        Returns
        -------
        (..., bands) array
            In the signal's unit; the integral over every band is exact for the broken line.

        Raises
        ------
        InputError
            If the points are not in order, not finite, negative, or do not cover the bands.
        """
        frequency, density = np.asarray(frequency, float), np.asarray(density, float)
        if frequency.ndim != 1 or density.shape[-1:] != frequency.shape or len(frequency) < 2:
            raise InputError(
                f"density {density.shape} does not fit frequencies {frequency.shape}; give one "
                "value a frequency, two or more"
            )
        if not (np.isfinite(frequency).all() and (np.diff(frequency) > 0).all()):
            raise InputError("frequencies of a density must be finite and increase")
        if not (np.isfinite(density).all() and (density >= 0).all()):
            raise InputError("a density must be finite and nowhere negative")
        edges = self.edges
        if frequency[0] > edges[0] or frequency[-1] < edges[-1]:
            raise InputError(
                f"a density from {frequency[0]:g} to {frequency[-1]:g} Hz does not cover the bands "
                f"{edges[0]:.4g} to {edges[-1]:.4g} Hz; choose fewer bands or compute more of it"
            )
        return _root(np.diff(_integral_to(edges, frequency, density), axis=-1))

    def of_signal(self, signal: Any, step: float) -> Array:
        """Return the rms of sampled signals in every band.

        The mean square of the record is shared out over the lines of its discrete spectrum; a
        line at an edge goes to both bands in proportion. No window: the bands and what lies
        outside them add up to the mean square of the record.

        Parameters
        ----------
        signal : (..., T) array
        step : float
            Sampling step [s].

        Returns
        -------
        (..., bands) array

        Raises
        ------
        InputError
            If the step is too long for the highest band, or the record too short for the lowest.
        """
        signal = sampled(signal, step, float(self.nominal[-1]), "one-third-octave bands")
        from scipy import fft

        count, edges = signal.shape[-1], self.edges
        if count * step < 1 / (edges[1] - edges[0]):
            raise InputError(
                f"one-third-octave bands: a record of {count * step:g} s does not resolve the band "
                f"at {self.nominal[0]:g} Hz; record at least {1 / (edges[1] - edges[0]):.3g} s"
            )
        power = np.abs(fft.rfft(signal) / count) ** 2
        power[..., 1 : (count + 1) // 2] *= 2  # the lines of negative frequency
        upto = np.concatenate([np.zeros((*power.shape[:-1], 1)), power.cumsum(-1)], axis=-1)
        return _root(np.diff(_between(edges * (count * step) + 0.5, upto), axis=-1))


@explained
def thirds(low: float, high: float) -> Bands:
    """Return the bands between two nominal centre frequencies [Hz], both among them.

    Raises
    ------
    InputError
        If one is no nominal frequency (0.1, 0.125, 0.16, ..., 80), or they are out of order.
    """
    first, last = (_number(f) for f in (low, high))
    if first > last:
        raise InputError(f"bands from {low:g} to {high:g} Hz; name the lower frequency first")
    return Bands(first, last)


def _number(frequency: float) -> int:
    number = round(10 * math.log10(positive(frequency, "band [Hz]")))
    if not math.isclose(_nominal(number), frequency, rel_tol=1e-9):
        raise InputError(
            f"{frequency:g} Hz is not a one-third-octave frequency; the "
            f"nearest is {_nominal(number):g} Hz"
        )
    return number


def _nominal(number: int) -> float:
    return float(f"{_NOMINAL[number % 10]}e{number // 10}")  # the decimal itself: 0.1, not 1 x 0.1


def _integral_to(edges: Array, frequency: Array, density: Array) -> Array:
    """Integral of the broken line from its first point to every edge."""
    width = np.diff(frequency)
    pieces = width * (density[..., 1:] + density[..., :-1]) / 2
    upto = np.concatenate([np.zeros((*density.shape[:-1], 1)), pieces.cumsum(-1)], axis=-1)
    i = np.clip(np.searchsorted(frequency, edges, "right") - 1, 0, len(width) - 1)
    reach = edges - frequency[i]
    slope = (density[..., i + 1] - density[..., i]) / width[i]
    return np.asarray(upto[..., i] + reach * (density[..., i] + slope * reach / 2))


def _root(power: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(power, 0.0)))  # an empty band may round below zero


def _between(position: Array, values: Array) -> Array:
    """Linear interpolation at positions counted in samples, the ends held."""
    i = np.clip(position.astype(int), 0, values.shape[-1] - 2)
    share = np.clip(position - i, 0, 1)
    return np.asarray(values[..., i] * (1 - share) + values[..., i + 1] * share)


MOTION = thirds(0.1, 0.63)
RIDE = thirds(1, 80)


@dataclass(frozen=True, eq=False)
class StationaryRide(Short):
    """Acceleration on a random road for ever, by one-third octaves and as a whole [m/s2].

    Attributes
    ----------
    weighted_rms : (...) array
        Overall, weighted by Wk.
    sickness_rms : (...) array
        Overall, weighted by Wf.
    motion, ride : (..., 9), (..., 20) array
        Unweighted rms in the bands `MOTION` (0.1 to 0.63 Hz) and `RIDE` (1 to 80 Hz).
    """

    weighted_rms: Array
    sickness_rms: Array
    motion: Array
    ride: Array


@explained
def quadrature() -> tuple[Array, Array]:
    """Return the nodes [Hz] at which `stationary_ride` wants gains, and their weights [Hz]."""
    x, weight = np.polynomial.legendre.leggauss(NODES)
    edges = np.log(Bands(FIRST, LAST).edges)
    half = np.diff(edges)[:, None] / 2
    frequency = np.exp(edges[:-1, None] + half * (1 + x))
    return frequency.ravel(), (frequency * half * weight).ravel()


@explained
def stationary_ride(gain: Any, density: float) -> StationaryRide:
    """Return the rms of the acceleration from its frequency response to a white road velocity.

    Parameters
    ----------
    gain : (..., F) complex array
        From road velocity [m/s] to acceleration [m/s2] at the frequencies of `quadrature`.
    density : float
        One-sided density of the road velocity [m2/s2 per Hz], see `velocity_density`.

    Raises
    ------
    InputError
        If the gains are not those of the frequencies of `quadrature`, or not finite.
    """
    density = positive(density, "density of the road velocity [m2/s2 per Hz]")
    frequency, weight = quadrature()
    gain = np.asarray(gain, dtype=complex)
    if gain.shape[-1:] != frequency.shape:
        raise InputError(
            f"gains {gain.shape}: give one at each of the {len(frequency)} frequencies of "
            "quadrature()"
        )
    if not np.isfinite(gain).all():
        raise InputError("a gain is not finite: a pole lies on the imaginary axis")
    power = density * weight * (gain.real**2 + gain.imag**2)

    def overall(by: Weighting) -> Array:
        factor: Gains = by.gain(frequency)
        return np.asarray(np.sqrt((power * np.abs(factor) ** 2).sum(-1)))

    banded = np.sqrt(power.reshape(*power.shape[:-1], -1, NODES).sum(-1))
    motion, ride = (banded[..., b.first - FIRST : b.last - FIRST + 1] for b in (MOTION, RIDE))
    return StationaryRide(overall(WK), overall(WF), motion, ride)
