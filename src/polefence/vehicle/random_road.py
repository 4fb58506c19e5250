"""Random roads of the classes of ISO 8608."""

from __future__ import annotations

import math

import numpy as np

from polefence.base.errors import InputError
from polefence.response.stationary import displacement_density
from polefence.response.weighting import positive
from polefence.vehicle.road import MOST, Road

# A random road is drawn with so many points to its shortest wave.
POINTS_A_WAVE = 16


def random_road(
    road_class: str,
    length: float,
    seed: int,
    low: float = 0.01,
    high: float = 10.0,
    spacing: float | None = None,
) -> Road:
    """Return a random road of a class of ISO 8608.

    A sum of waves of 1, 2, 3, ... periods in the length, as far as they lie between the limits,
    of random phase and of the amplitude of the class: every road has the density of its class
    at every wave, whatever the seed. The road repeats itself after its length.

    Parameters
    ----------
    road_class : str
        "A" (very good) to "H".
    length : float
        [m].
    seed : int
        Zero or more; the same seed gives the same road.
    low, high : float
        Limits in spatial frequency [cycles/m]. The defaults are what the standard says matters
        to vehicles on roads: at 20 m/s, 0.2 to 200 Hz.
    spacing : float, optional
        Of the points [m], at most half the shortest wave; a sixteenth of it by default, at
        which the straight pieces between the points take 2.6 % off the density at ``high``,
        and 0.4 % at 0.4 ``high``.

    Raises
    ------
    InputError
        If there is no such class, a number is out of range, or no wave fits between the limits.
    """
    length, low, high = (
        positive(v, f"{what} of a random road")
        for v, what in ((length, "length [m]"), (low, "low [cycles/m]"), (high, "high [cycles/m]"))
    )
    count = _points(length, high, spacing)
    waves = np.arange(
        math.ceil(low * length * (1 - 1e-12)), math.floor(high * length * (1 + 1e-12)) + 1
    )
    if not len(waves):
        raise InputError(
            f"random road: no wave of {low:g} to {high:g} cycles/m fits {length:g} m; make "
            f"the road longer than {1 / high:g} m and the limits wider"
        )
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed = {seed!r}; give a whole number of zero or more")
    phase = np.random.default_rng(int(seed)).uniform(0, 2 * np.pi, len(waves))
    amplitude = np.sqrt(2 * displacement_density(road_class, waves / length) / length)
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    spectrum[waves] = amplitude * np.exp(1j * phase) * (count / 2)
    from scipy import fft

    height = fft.irfft(spectrum, count)
    distance = length / count * np.arange(count + 1)
    name = f"ISO 8608 class {str(road_class).upper()}, seed {seed}"
    return Road(np.asarray(distance), np.append(height, height[0]), name)


def _points(length: float, high: float, spacing: float | None) -> int:
    """Points a length: more than two to the shortest wave, so that the last line is no alias."""
    if spacing is None:
        spacing = 1 / (POINTS_A_WAVE * high)
    spacing = positive(spacing, "spacing [m]")
    if spacing * high > 0.5:
        raise InputError(
            f"random road: a spacing of {spacing:g} m cannot show {high:g} cycles/m; use at most "
            f"{1 / (2 * high):g} m"
        )
    count = length / spacing
    if count > MOST:
        raise InputError(
            f"random road: {count:.3g} points; at most {MOST} (shorten it, or lower its high limit)"
        )
    return max(math.ceil(count * (1 - 1e-12)), 2 * math.floor(high * length) + 2)
