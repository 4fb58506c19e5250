"""Roads: broken lines of height over distance; random, single obstacles, and measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained, explained_fields
from polefence.plant.outputs import split
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.columns import read_columns
from polefence.response.stationary import displacement_density
from polefence.response.weighting import positive

# Points of a profile, and steps of a drive: bounds the memory.
MOST = 20_000_000
# Steps over the whole of a road where nobody asked for a duration: two points can lie far apart.
MOST_UNASKED = 300_000
MAX_BYTES = 50_000_000

SECONDS = 10.0  # on a random road, where no duration is given
LONGEST_STEP = 1e-3  # [s] of a drive


def seconds_over(extent: float, speed: float) -> float:
    """Return the time [s] of a drive over an obstacle of this extent [m], and behind it."""
    over = extent / speed
    return 3.0 + (over if over > 1.0 else 0.0)  # three seconds hold a short obstacle


def length_of(speed: float, seconds: float) -> float:
    """Return how long a random road is for a drive of so many seconds [m]."""
    return max(speed * seconds, 100.0)  # the longest wave


def level_of(speed: float, seconds: float) -> dict[str, float]:
    """Return how much level road is before an obstacle and after it [m]."""
    return {"before": 0.1 * speed, "after": speed * seconds}


@dataclass(frozen=True, eq=False)
class Road(Short):
    """Height over distance, straight between the points.

    Parameters
    ----------
    distance : (T,) array
        Increasing [m].
    height : (T,) array
        [m]; an upward step of the road is positive.
    name : str
        For titles and messages.

    Raises
    ------
    InputError
        If the points are fewer than two, not finite, or out of order.
    """

    distance: Array
    height: Array
    name: str = "road"

    @explained_fields
    def __post_init__(self) -> None:
        distance, height = (np.array(v, dtype=float) for v in (self.distance, self.height))
        if distance.ndim != 1 or distance.shape != height.shape or len(distance) < 2:
            raise InputError(
                f"{self.name}: distance {distance.shape} and height {height.shape} must be two "
                "lists of one length, two points or more"
            )
        fault = first_fault(distance, height)
        if fault:
            raise InputError(f"{self.name}: point {fault[0] + 1}: {fault[1]}")
        for field, array in (("distance", distance), ("height", height)):
            array.flags.writeable = False
            object.__setattr__(self, field, array)

    @property
    def length(self) -> float:
        """From the first point to the last [m]."""
        return float(self.distance[-1] - self.distance[0])

    def velocity(
        self, speed: float, step: float, duration: float | None = None
    ) -> tuple[Array, Array]:
        """Return the vertical velocity of the road under a wheel.

        Parameters
        ----------
        speed : float
            Of the vehicle [m/s].
        step : float
            Sampling step [s].
        duration : float, optional
            Of the drive [s], from the first point; by default as long as the road reaches, up to
            `MOST_UNASKED` steps.

        Returns
        -------
        time : (T,) array
            0, step, 2 step, ... [s].
        w : (T,) array
            Mean velocity over the step that begins then [m/s]. Held over the step, it brings the
            wheel to exactly the road's height at the end of it, wherever the points lie.

        Raises
        ------
        InputError
            If a number is not above zero, or the road is too short, or there are too many steps.
        """
        speed = positive(speed, "speed [m/s]")
        step = positive(step, "sampling step [s]")
        steps = self._steps(speed, step, duration)
        where = self.distance[0] + speed * step * np.arange(steps + 1)
        height = np.interp(where, self.distance, self.height)
        return np.asarray(step * np.arange(steps)), np.asarray(np.diff(height) / step)

    def _steps(self, speed: float, step: float, duration: float | None) -> int:
        whole = self.length / speed
        if duration is None:
            steps = whole / step
            if steps < 1 - 1e-9:
                raise InputError(
                    f"{self.name} is passed in {whole:g} s, less than a step of {step:g} s; use a "
                    "shorter step"
                )
            if steps > MOST_UNASKED:
                raise InputError(
                    f"{self.name} is passed in {whole:g} s, {steps:.3g} steps of {step:g} s; give "
                    f"a duration, without which there are at most {MOST_UNASKED}"
                )
            steps = math.floor(steps * (1 + 1e-12))
        else:
            duration = positive(duration, "duration [s]")
            if duration > whole * (1 + 1e-9):
                raise InputError(
                    f"{self.name} is {self.length:g} m long; {duration:g} s at {speed:g} m/s need "
                    f"{duration * speed:g} m"
                )
            steps = max(1, math.ceil(duration / step * (1 - 1e-12)))
        if steps > MOST:
            raise InputError(
                f"{self.name}: {steps:.3g} steps of {step:g} s; at most {MOST} (drive a shorter "
                "time, or use a longer step)"
            )
        return int(steps)

    def later(self, distance: float) -> Road:
        """Return the road under a wheel so far behind [m]; it begins level."""
        if distance <= 0:
            return self
        along = np.concatenate([self.distance[:1], self.distance + distance])
        return Road(along, np.concatenate([self.height[:1], self.height]), self.name)

    def resample(self, spacing: float) -> Road:
        """Return the road at equally spaced points [m], from its first as far as whole steps go.

        Heights are read off the broken line, not averaged: what is shorter than two spacings
        comes back as longer waves.

        Raises
        ------
        InputError
            If the spacing is not above zero, longer than the road, or gives too many points.
        """
        spacing = positive(spacing, "spacing [m]")
        count = self.length / spacing * (1 + 1e-12)
        if not 1 <= count < MOST:
            raise InputError(
                f"{self.name}: a spacing of {spacing:g} m on {self.length:g} m of road gives "
                f"{count + 1:.3g} points; use 2 to {MOST}"
            )
        along = np.minimum(spacing * np.arange(math.floor(count) + 1), self.length)
        distance = self.distance[0] + along
        return Road(distance, np.interp(distance, self.distance, self.height), self.name)


@explained
def both_sides(first: Road, second: Road, width: float) -> tuple[Road, Road]:
    """Return the road under left and right wheels, of two that are independent and of one class.

    Waves much longer than the width lift both sides alike, much shorter ones each by itself: the
    coherence is 1 / (1 + (k width)^2) at k rad/m, as in `polefence.plant.tracks.Tracks`, and each
    side has the density of the two.

    Parameters
    ----------
    first, second : Road
        With points equally apart, at the same distances.
    width : float
        [m]

    Raises
    ------
    InputError
        If the width is not above zero, or the points differ.
    """
    from scipy.signal import bilinear, lfilter

    width, same = positive(width, "width [m]"), first.distance.shape == second.distance.shape
    steps = np.diff(first.distance)
    if not same or np.any(first.distance != second.distance) or np.ptp(steps) > 1e-6 * steps[0]:
        raise InputError(f"{first.name}, {second.name}: points must be the same, equally apart")
    half, rate = 0.5**0.5, float(1 / steps.mean())
    sides = []
    for road, numerator in ((first, [half * width, 1.0]), (second, [half * width, 0.0])):
        b, a = bilinear(numerator, [width, 1.0], fs=rate)
        sides.append(lfilter(b, a, road.height - road.height[0]))
    mean, apart = sides
    left, right = (Road(first.distance, h, first.name) for h in (mean + apart, mean - apart))
    return left, right


def first_fault(distance: Array, height: Array) -> tuple[int, str] | None:
    """Return number and fault of the first bad point of a profile, None where all are good."""
    for name, values in (("distance", distance), ("height", height)):
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            return int(bad[0]), f"{name} {values[bad[0]]} is not a finite number"
    bad = np.flatnonzero(np.diff(distance) <= 0)
    if len(bad):
        i = int(bad[0])
        how = "repeats" if distance[i + 1] == distance[i] else "lies before"
        return i + 1, (
            f"distance {distance[i + 1]:g} m {how} that of the point before, {distance[i]:g} m; "
            "sort the points by distance and keep one of each"
        )
    return None


@explained
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
        which the straight equations between the points take 2.6 % off the density at ``high``,
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
        # sixteen points to the shortest wave
        spacing = 1 / (16 * high)
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


@explained
def bump(height: float, length: float, before: float = 1.0, after: float = 100.0) -> Road:
    """Return a cosine bump, h(x) = height / 2 (1 - cos(2 pi x / length)), on a level road.

    Parameters
    ----------
    height, length : float
        [m]; a negative height is a dip.
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a length is not above zero, or the height is not finite or zero.
    """
    length = positive(length, "length of the bump [m]")
    # straight pieces, which leave a cosine bump by less than 4e-5 of its height
    x = np.linspace(0, 1, 257)
    heights = _size(height, "height of the bump [m]") / 2 * (1 - np.cos(2 * np.pi * x))
    return _between_levels(x * length, heights, before, after, "bump")


@explained
def pothole(
    depth: float, length: float, contact: float = 0.1, before: float = 1.0, after: float = 100.0
) -> Road:
    """Return a hole with upright walls as a tyre feels it: height averaged over the contact.

    Walls become ramps of the length of the contact; a hole shorter than the contact is not felt
    to its bottom.

    Parameters
    ----------
    depth, length : float
        [m], both above zero.
    contact : float
        Length of the tyre's contact with the road [m].
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a number is not above zero.
    """
    depth, length = positive(depth, "depth [m]"), positive(length, "length of the hole [m]")
    contact = positive(contact, "contact [m]")
    ramp, flat = min(contact, length), abs(length - contact)
    felt = depth * min(1.0, length / contact)
    x = np.cumsum([0.0, ramp, flat, ramp])
    heights = np.array([0.0, -felt, -felt, 0.0])
    keep = np.append(True, np.diff(x) > 0)  # a hole as long as the contact has no flat
    return _between_levels(x[keep], heights[keep], before, after, "pothole")


@explained
def kerb(height: float, contact: float = 0.1, before: float = 1.0, after: float = 100.0) -> Road:
    """Return a step of the road as a tyre feels it: a ramp of the length of its contact.

    Parameters
    ----------
    height : float
        [m]; negative downwards.
    contact : float
        Length of the tyre's contact with the road [m].
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a length is not above zero, or the height is not finite or zero.
    """
    contact = positive(contact, "contact [m]")
    heights = np.array([0.0, _size(height, "height of the kerb [m]")])
    return _between_levels(np.array([0.0, contact]), heights, before, after, "kerb")


@explained
def grade(slope: float, length: float, before: float = 1.0, after: float = 100.0) -> Road:
    """Return a straight way up from one level to another, with a kink at either end.

    Parameters
    ----------
    slope : float
        Rise over length: 0.05 is 5 %; negative downhill.
    length : float
        Of the grade [m].
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a length is not above zero, or the slope is not finite or zero.
    """
    length = positive(length, "length of the grade [m]")
    heights = np.array([0.0, _size(slope, "slope of the grade") * length])
    return _between_levels(np.array([0.0, length]), heights, before, after, "grade")


def _between_levels(x: Array, height: Array, before: float, after: float, name: str) -> Road:
    before = positive(before, "road before [m]")
    after = positive(after, "road after [m]")
    distance = np.concatenate([[0.0], before + x, [before + x[-1] + after]])
    return Road(distance, np.concatenate([height[:1], height, height[-1:]]), name)


def _size(value: Any, what: str) -> float:
    return math.copysign(positive(abs(value), what), value)


@explained
def measured_road(path: str | Path, spacing: float | None = None) -> Road:
    """Read a road from a CSV file: distance [m] and height [m] in two columns, comma between.

    A first row of names is allowed; a unit in it must be [m].

    Parameters
    ----------
    path : str or Path
    spacing : float, optional
        Resample at equally spaced points [m]; see `Road.resample`.

    Raises
    ------
    InputError
        Naming the file and the row, if a cell is missing or no finite number, distance does not
        increase, there are fewer than two points, or the file is too large or no text.
    """
    path = Path(path)
    remedy = "cut the profile into shorter roads"
    rows = read_columns(path, MAX_BYTES, remedy, ("distance", "height"))
    for label in rows.labels:
        unit = split(label)[1]
        if unit not in ("", "m"):
            raise InputError(f"{path}: row 1: {label!r} is in {unit}; give metres, [m]")
    if len(rows.lines) < 2:
        raise InputError(f"{path}: {len(rows.lines)} points; a road needs two or more")
    distance, height = rows.values.T.copy()
    fault = first_fault(distance, height)
    if fault:
        raise InputError(f"{path}: row {rows.lines[fault[0]]}: {fault[1]}")
    road = Road(distance, height, path.stem)
    return road if spacing is None else road.resample(spacing)
