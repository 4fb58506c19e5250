"""Comfort of a recorded ride by ISO 2631-1:1997: rms, running rms, VDV, MSDV, in words, too.

Source: clauses 6 and 9 of the standard. Of annexes B (health) and C (comfort) the
figures are carried over, not their text.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.plant.system import Array, floats
from polefence.proof.short import Short
from polefence.response.weighting import BLOCK, WE, WF, WK, positive, sampled

# Clause 6: beyond these ratios the rms alone says too little.
CREST, MTVV_RATIO, VDV_RATIO = 9.0, 1.5, 1.75

# Annex C: ranges of the weighted rms [m/s2], overlapping as the standard has them.
COMFORT = (
    (0.0, 0.315, "not uncomfortable"),
    (0.315, 0.63, "a little uncomfortable"),
    (0.5, 1.0, "fairly uncomfortable"),
    (0.8, 1.6, "uncomfortable"),
    (1.25, 2.5, "very uncomfortable"),
    (2.0, math.inf, "extremely uncomfortable"),
)
# Clause 8.2.2: what a rotation [rad/s2] counts beside a translation [m/s2], at a seat [m/rad].
ROTATIONS = {"roll": 0.63, "pitch": 0.4}
# Annex B, figure B.1: bounds of the caution zone, rms [m/s2] up to ten minutes, and VDV [m/s1.75].
CAUTION_RMS, CAUTION_DOSE = (3.0, 6.0), (8.5, 17.0)


@dataclass(frozen=True, eq=False)
class Comfort(Short):
    """Comfort values by ISO 2631-1 of recorded vertical accelerations, one value a record.

    Attributes
    ----------
    duration : float
        Length of the records [s].
    weighted_rms : (...) array
        By Wk [m/s2].
    peak : (...) array
        Largest weighted acceleration [m/s2], either way.
    mtvv : (...) array
        Largest running rms over 1 s [m/s2].
    vdv : (...) array
        Vibration dose value [m/s1.75].
    msdv : (...) array
        Motion sickness dose value, by Wf [m/s1.5].
    """

    duration: float
    weighted_rms: Array
    peak: Array
    mtvv: Array
    vdv: Array
    msdv: Array

    @property
    def crest_factor(self) -> Array:
        """Peak over rms, (...); not a number where nothing moves."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.peak / self.weighted_rms)

    @property
    def shocks(self) -> Array:
        """Whether the rms alone says too little (crest factor, MTVV or VDV too large), (...)."""
        rms = self.weighted_rms
        large = self.peak > CREST * rms
        large |= self.mtvv > MTVV_RATIO * rms
        return np.asarray(large | (self.vdv > VDV_RATIO * rms * self.duration**0.25))


@explained
def comfort(acceleration: Any, step: float) -> Comfort:
    """Evaluate vertical accelerations at the seat, at rest before their first sample.

    Parameters
    ----------
    acceleration : (..., T) array
        Unweighted [m/s2].
    step : float
        Sampling step [s].

    Raises
    ------
    InputError
        If the step is too long for 80 Hz, the record is shorter than 1 s, or a sample is not
        finite.
    """
    record = sampled(acceleration, step, WK.top, "comfort")
    count = record.shape[-1]
    rows = record.reshape(-1, count)
    many = max(1, BLOCK // count)
    blocks = [rows[i : i + many] for i in range(0, max(1, len(rows)), many)]
    values = np.concatenate([_values(block, step) for block in blocks], axis=-1)
    return Comfort((count - 1) * step, *values.reshape(5, *record.shape[:-1]))


@explained
def vibration_total(vertical: Any, step: float, roll: Any = None, pitch: Any = None) -> Array:
    """Return the vibration total value [m/s2] of a seat: clauses 6.5 and 8.2.2.

    The root of the sum of squares of the rms values by Wk of vertical, by We of 0.63 m/rad times
    roll and 0.4 m/rad times pitch acceleration. Horizontal vibration, and yaw, are left out.

    Parameters
    ----------
    vertical : (..., T) array
        [m/s2]
    step : float
        Sampling step [s].
    roll, pitch : (..., T) array, optional
        [rad/s2]

    Raises
    ------
    InputError
        As `comfort` raises.
    """
    square = rms(WK.apply(vertical, step)) ** 2
    for rotation, share in zip((roll, pitch), ROTATIONS.values(), strict=True):
        if rotation is not None:
            square = square + (share * rms(WE.apply(rotation, step))) ** 2
    return np.asarray(np.sqrt(square))


def _values(acceleration: Array, step: float) -> Array:
    """Rms, peak, MTVV, VDV and MSDV of rows, (5, rows)."""
    weighted = WK.apply(acceleration, step)
    sickness = WF.apply(acceleration, step)
    return np.stack(
        [
            rms(weighted),
            np.abs(weighted).max(-1),
            mtvv(weighted, step),
            vdv(weighted, step),
            msdv(sickness, step),
        ]
    )


def rms(signal: Any) -> Array:
    """Return the root of the mean square over the last axis; trapezoidal, so over (T - 1) steps."""
    square = np.square(np.asarray(signal, dtype=float))
    return np.asarray(np.sqrt(_trapezoid(square) / (square.shape[-1] - 1)))


def vdv(weighted: Any, step: float) -> Array:
    """Return the vibration dose value [m/s1.75] of weighted accelerations (..., T) [m/s2]."""
    fourth = np.asarray(weighted, dtype=float) ** 4
    return np.asarray((_trapezoid(fourth) * step) ** 0.25)


def msdv(weighted: Any, step: float) -> Array:
    """Return the motion sickness dose value [m/s1.5] of accelerations (..., T) weighted by Wf."""
    return np.sqrt(_trapezoid(np.square(np.asarray(weighted, dtype=float))) * step)


def mtvv(weighted: Any, step: float, average: str = "linear") -> Array:
    """Return the largest running rms over 1 s; see `running_rms`."""
    return np.asarray(running_rms(weighted, step, average=average).max(-1))


@explained
def running_rms(weighted: Any, step: float, window: float = 1.0, average: str = "linear") -> Array:
    """Return the running rms at every sample, of a signal at rest before its first.

    Parameters
    ----------
    weighted : (..., T) array
    step : float
        Sampling step [s].
    window : float
        Integration time [s]; the standard recommends 1 s.
    average : str
        "linear": over the last ``window``; "exponential": over all the past, with this time
        constant.

    Raises
    ------
    InputError
        If the record is shorter than the window, or the average is unknown.
    """
    step, window = positive(step, "sampling step [s]"), positive(window, "window [s]")
    square = np.square(np.atleast_1d(floats(weighted, "a record")))
    count = square.shape[-1]
    if (count - 1) * step < window * (1 - 1e-9):
        raise InputError(
            f"running rms: a record of {(count - 1) * step:g} s is shorter than its window of "
            f"{window:g} s; record longer"
        )
    if average == "linear":
        return np.sqrt(_last(square, step, window) / window)
    if average == "exponential":
        return np.sqrt(_fading(square, step / window))
    raise InputError(f"running rms: average = {average!r}; use 'linear' or 'exponential'")


def _last(square: Array, step: float, window: float) -> Array:
    """Integral over the last ``window``, exact for a square linear within a step."""
    upto = np.zeros_like(square)
    np.cumsum((square[..., 1:] + square[..., :-1]) * (step / 2), axis=-1, out=upto[..., 1:])
    # Window start, counted in samples; before the record the integral is zero.
    start = np.arange(square.shape[-1]) - window / step
    i = np.clip(np.floor(start + 1e-9).astype(int), 0, square.shape[-1] - 2)
    share = np.clip(start - i, 0, 1)
    rise = square[..., i + 1] - square[..., i]
    before = upto[..., i] + step * share * (square[..., i] + rise * share / 2)
    return np.asarray(np.maximum(upto - before, 0.0))


def _fading(square: Array, ratio: float) -> Array:
    """Solve y' = (u - y) / time constant, exact for u linear within a step of ``ratio`` of it."""
    from scipy.signal import lfilter

    decay = math.exp(-ratio)
    mean = -math.expm1(-ratio) / ratio
    start = np.zeros((*square.shape[:-1], 1))
    # Nothing has been before the first sample: the mean begins at zero.
    start[..., 0] = -(1 - mean) * square[..., 0]
    mean_square, _ = lfilter([1 - mean, mean - decay], [1.0, -decay], square, axis=-1, zi=start)
    return np.maximum(mean_square, 0.0)


def _trapezoid(values: Array) -> Array:
    if values.ndim == 0 or values.shape[-1] < 2:
        raise InputError("a record needs two samples or more")
    return np.asarray(values.sum(-1) - (values[..., 0] + values[..., -1]) / 2)


@explained
def comfort_reading(weighted_rms: float) -> tuple[str, ...]:
    """Return what people in public transport say of a weighted rms [m/s2]: one label, or two.

    The ranges of annex C overlap: where two hold, both are given, the milder first.

    Raises
    ------
    InputError
        If it is no number, or negative.
    """
    value = _amount(weighted_rms, "weighted rms [m/s2]")
    labels = [label for low, high, label in COMFORT if low <= value <= high]
    # A range ends where the next but one may begin; 0.315 itself is no longer comfortable.
    return tuple(labels[1:] if value == COMFORT[0][1] else labels)


@explained
def health_reading(weighted_rms: float, hours: float) -> str:
    """Return where a daily exposure lies: below, in or above the health guidance caution zone.

    The bounds are 3 and 6 m/s2 up to ten minutes and fall with the root of the time beyond:
    0.43 and 0.87 m/s2 at eight hours. They are read from figure B.1 of the standard, which is
    meant for four to eight hours; other readings of it differ by 10 %.

    Parameters
    ----------
    weighted_rms : float
        By Wk [m/s2].
    hours : float
        Daily exposure [h], from a minute to a day.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    value = _amount(weighted_rms, "weighted rms [m/s2]")
    hours = positive(hours, "daily exposure [h]")
    if not 1 / 60 <= hours <= 24:
        raise InputError(f"daily exposure = {hours:g} h; the zone is given for 1 min to 24 h")
    fall = min(1.0, math.sqrt(1 / (6 * hours)))
    return _zone(value, CAUTION_RMS[0] * fall, CAUTION_RMS[1] * fall)


@explained
def dose_reading(daily_vdv: float) -> str:
    """Return where the vibration dose value [m/s1.75] of a whole day lies; see `health_reading`.

    Raises
    ------
    InputError
        If it is no number, or negative.
    """
    return _zone(_amount(daily_vdv, "VDV [m/s1.75]"), *CAUTION_DOSE)


def _zone(value: float, low: float, high: float) -> str:
    where = "below" if value < low else "above" if value > high else "in"
    return f"{where} the health guidance caution zone"


def _amount(value: Any, what: str) -> float:
    number = float(value)
    if not (math.isfinite(number) and number >= 0):
        raise InputError(f"{what} = {value!r}; give a number of zero or more")
    return number
