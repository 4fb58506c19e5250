"""Frequency weightings of ISO 2631-1:1997, and band filters.

Wk of vertical vibration, Wd of horizontal and We of rotational vibration, Wf of motion sickness.
Source: the parameters of annex A of the standard (ISO 8041 repeats them), every stage of second
order: band limits, transition from acceleration to velocity, upward step.

Band filters are Butterworth's, as those of octave bands in IEC 61260-1 usually are.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError
from polefence.plant.system import Array, floats
from polefence.proof.short import Short
from polefence.proof.text import exactly

Gains = npt.NDArray[np.complex128]

# A one-third-octave band reaches from its centre by this factor up and down (base ten).
HALF_BAND = 10**0.05
# Samples filtered at once: bounds the memory of a large batch.
BLOCK = 4_000_000


class Stages(ABC):
    """A filter of stages of second order in series: b(s) / (s^2 + s w0/Q + w0^2).

    Attributes
    ----------
    name : str
        What it is called in a claim.
    top : float
        A frequency [Hz] in the highest one-third-octave band that it is meant for.
    """

    name: str
    top: float

    @abstractmethod
    def stages(self) -> Iterator[tuple[Array, float, float]]:
        """Yield b (3,), highest power first, w0 [rad/s] and Q of every stage."""

    def gain(self, frequency: Any) -> Gains:
        """Return the complex gain at frequencies [Hz]."""
        s = 2j * np.pi * np.asarray(frequency, dtype=float)
        gain = np.ones_like(s)
        for top, w0, Q in self.stages():
            gain *= np.polyval(top, s) / (s * s + s * (w0 / Q) + w0 * w0)
        return gain

    def transfer_function(self) -> tuple[Array, Array]:
        """Return numerator and denominator in s, highest power first."""
        above: Array = np.ones(1)
        below: Array = np.ones(1)
        for top, w0, Q in self.stages():
            above = np.asarray(np.polymul(above, np.trim_zeros(top, "f")))
            below = np.asarray(np.polymul(below, [1.0, w0 / Q, w0 * w0]))
        return above, below

    def state_space(self) -> tuple[Array, Array, Array, Array]:
        """Return A, B, C, D of the weighting, two states a stage."""
        A, B, C, D = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
        for (b2, b1, b0), w0, Q in self.stages():
            # x1 = w0^2 / den, x2 = w0 s / den: states of one size, so A is well scaled.
            a = np.array([[0.0, w0], [-w0, -w0 / Q]])
            b = np.array([[0.0], [w0]])
            c = np.array([[b0 / w0**2 - b2, b1 / w0 - b2 / Q]])
            A = np.block([[A, np.zeros((len(A), 2))], [b @ C, a]])
            B, C, D = np.vstack([B, b @ D]), np.hstack([b2 * C, c]), b2 * D
        return A, B, C, D

    @property
    def settling(self) -> float:
        """Time [s] in which the slowest free motion falls to e^-20 of itself."""
        # Slowest real part of s^2 + s w0/Q + w0^2; every Q is above a half.
        return 20 / min(w0 / (2 * Q) for _, w0, Q in self.stages())

    def apply(self, signal: Any, step: float) -> Array:
        """Weight sampled signals, at rest before their first sample.

        The spectrum of the record, prolonged by zeros until the filter has come to rest, is
        multiplied by the gain of the analogue filter: every frequency below half the sampling
        rate gets the weighting itself, no discrete approximation of it.

        Parameters
        ----------
        signal : (..., T) array
        step : float
            Sampling step [s].

        Returns
        -------
        (..., T) array

        Raises
        ------
        InputError
            If the step is too long for the band of the weighting, or the signal is no record.
        """
        signal = sampled(signal, step, self.top, f"weighting {self.name}")
        from scipy import fft

        count = signal.shape[-1]
        length = fft.next_fast_len(count + math.ceil(self.settling / step), real=True)
        gain = self.gain(fft.rfftfreq(length, step))
        rows = signal.reshape(-1, count)
        weighted = np.empty_like(rows)
        many = max(1, BLOCK // length)
        for first in range(0, len(rows), many):
            block = slice(first, first + many)
            spectrum = fft.rfft(rows[block], length)
            weighted[block] = fft.irfft(spectrum * gain, length)[:, :count]
        return np.asarray(weighted.reshape(signal.shape))


@dataclass(frozen=True)
class Weighting(Stages, Short):
    """A frequency weighting: high-pass, low-pass, transition and step in series.

    Attributes
    ----------
    name : str
    high_pass, low_pass : float
        Band limits f1, f2 [Hz], of Butterworth filters of second order.
    transition : (float, float, float)
        f3, f4 [Hz] and Q4: (1 + s/w3) / (1 + s/(Q4 w4) + (s/w4)^2); f3 may be infinite.
    step : (float, float, float, float) or None
        f5 [Hz], Q5, f6 [Hz] and Q6: (s^2 + s w5/Q5 + w5^2) / (s^2 + s w6/Q6 + w6^2).
    top : float
        Nominal centre [Hz] of the highest one-third-octave band it is meant for.
    """

    name: str
    high_pass: float
    low_pass: float
    transition: tuple[float, float, float]
    step: tuple[float, float, float, float] | None
    top: float

    def stages(self) -> Iterator[tuple[Array, float, float]]:
        """Yield b, w0 [rad/s] and Q of every stage: eight states, or six without a step."""
        turn = 2 * math.pi
        w1, w2 = turn * self.high_pass, turn * self.low_pass
        w3, w4 = turn * self.transition[0], turn * self.transition[1]
        yield np.array([1.0, 0.0, 0.0]), w1, math.sqrt(0.5)
        yield np.array([0.0, 0.0, w2**2]), w2, math.sqrt(0.5)
        yield np.array([0.0, w4**2 / w3, w4**2]), w4, self.transition[2]
        if self.step is not None:
            w5, w6 = turn * self.step[0], turn * self.step[2]
            yield np.array([1.0, w5 / self.step[1], w5**2]), w6, self.step[3]


@dataclass(frozen=True)
class BandFilter(Stages, Short):
    """A Butterworth filter of a band: of third order at each end, half the power at both.

    Of white noise it passes 4.7 % more power than an ideal one. A band from zero is a low-pass of
    fourth order, which passes 2.6 % more.

    Attributes
    ----------
    low, high : float
        The ends [Hz]; the lower one may be zero.
    """

    low: float
    high: float
    name: str = field(init=False)
    top: float = field(init=False)

    def __post_init__(self) -> None:
        name = f"{exactly(self.low)} to {exactly(self.high)} Hz"
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "top", self.high)

    @classmethod
    def named(cls, name: str) -> BandFilter | None:
        """Return the one of a name, None where that is none of a band."""
        match = re.fullmatch(r"(\S+) to (\S+) Hz", name)
        try:
            found = None if match is None else cls(float(match[1]), float(match[2]))
        except ValueError:
            return None
        return found if found is not None and found.name == name else None

    def stages(self) -> Iterator[tuple[Array, float, float]]:
        """Yield b, w0 [rad/s] and Q of every stage."""
        turn = 2 * math.pi
        w1, w2 = turn * self.low, turn * self.high
        if not self.low:
            half = math.sqrt(0.5)
            for damping in (math.sqrt((1 + half) / 2), math.sqrt((1 - half) / 2)):
                yield np.array([0.0, 0.0, w2**2]), w2, 0.5 / damping
            return
        # s becomes (s^2 + w0^2) / (B s) in 1 / ((s + 1)(s^2 + s + 1))
        B, w0 = w2 - w1, math.sqrt(w1 * w2)
        yield np.array([0.0, B, 0.0]), w0, w0 / B
        # s^2 - q B s + w0^2 = 0 for q = (-1 + j sqrt(3)) / 2: s = q B / 2 +- root
        real, imaginary = -(B**2) / 8 - w0**2, -math.sqrt(3) * B**2 / 8
        up = math.sqrt((math.sqrt(real**2 + imaginary**2) - real) / 2)
        across = -imaginary / (2 * up)
        middle = -B / 4, math.sqrt(3) * B / 4
        for sign in (1, -1):
            x, y = middle[0] - sign * across, middle[1] + sign * up
            w = math.sqrt(x**2 + y**2)
            yield np.array([0.0, B, 0.0]), w, w / (-2 * x)


@dataclass(frozen=True)
class Series(Stages, Short):
    """Filters in series."""

    filters: tuple[Weighting | BandFilter, ...]
    name: str = field(init=False)
    top: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", ", ".join(one.name for one in self.filters))
        object.__setattr__(self, "top", min(one.top for one in self.filters))

    def stages(self) -> Iterator[tuple[Array, float, float]]:
        """Yield b, w0 [rad/s] and Q of every stage."""
        for one in self.filters:
            yield from one.stages()


def in_series(filters: Sequence[Weighting | BandFilter]) -> Stages | None:
    """Return filters in series as one; None where there are none."""
    if len(filters) < 2:
        return filters[0] if filters else None
    return Series(tuple(filters))


def sampled(signal: Any, step: float, top: float, what: str) -> Array:
    """Return the signal as an array; refuse a step too long for bands up to ``top`` [Hz].

    Raises
    ------
    InputError
        If the step is no positive number or too long, or the signal has fewer than two samples
        or one that is no finite number.
    """
    step = positive(step, "sampling step [s]")
    edge: float = 10 ** (round(10 * math.log10(top)) / 10) * HALF_BAND
    if step > 1 / (2 * edge):
        raise InputError(
            f"{what}: a sampling step of {step:g} s is too long for bands up to {top:g} Hz; sample "
            f"at least every {1 / (2 * edge):.3g} s (twice the upper edge {edge:.4g} Hz)"
        )
    record: Array = floats(signal, f"{what}: a record")
    if record.ndim == 0 or record.shape[-1] < 2:
        raise InputError(f"{what}: a record needs two samples or more")
    finite = np.isfinite(record)
    if not finite.all():
        where = np.argwhere(~finite)[0][-1]
        raise InputError(f"{what}: sample {where + 1} is not a finite number; mend the record")
    return record


def positive(value: Any, what: str) -> float:
    """Return a positive finite number.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise InputError(f"{what} = {value!r}; give a number above zero")
    return number


WK = Weighting("Wk", 0.4, 100.0, (12.5, 12.5, 0.63), (2.37, 0.91, 3.35, 0.91), 80.0)
WD = Weighting("Wd", 0.4, 100.0, (2.0, 2.0, 0.63), None, 80.0)
WE = Weighting("We", 0.4, 100.0, (1.0, 1.0, 0.63), None, 80.0)
WF = Weighting("Wf", 0.08, 0.63, (math.inf, 0.25, 0.86), (0.0625, 0.80, 0.10, 0.80), 0.63)
