"""Labels of comfort and of health, by ISO 2631-1:1997, of a weighted rms or a dose.

The figures of annexes B (health) and C (comfort) are carried over, not their text.
"""

from __future__ import annotations

import math
from typing import Any

from polefence.base.errors import InputError
from polefence.response.weighting import positive

# Annex C: ranges of the weighted rms [m/s2], overlapping as the standard has them.
COMFORT = (
    (0.0, 0.315, "not uncomfortable"),
    (0.315, 0.63, "a little uncomfortable"),
    (0.5, 1.0, "fairly uncomfortable"),
    (0.8, 1.6, "uncomfortable"),
    (1.25, 2.5, "very uncomfortable"),
    (2.0, math.inf, "extremely uncomfortable"),
)
# Annex B, figure B.1: bounds of the caution zone, rms [m/s2] up to ten minutes, and VDV [m/s1.75].
CAUTION_RMS, CAUTION_DOSE = (3.0, 6.0), (8.5, 17.0)


def comfort_reading(weighted_rms: float) -> tuple[str, ...]:
    """Return what people in public transport say of a weighted rms [m/s2]: one label, or two.

    The ranges of annex C overlap: where two hold, both are given, the milder first.

    Raises
    ------
    InputError
        If it is no number, or negative.
    """
    value = _amount(weighted_rms, "weighted rms [m/s2]")
    found = [label for low, high, label in COMFORT if low <= value <= high]
    # A range ends where the next but one may begin; 0.315 itself is no longer comfortable.
    return tuple(found[1:] if value == COMFORT[0][1] else found)


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
