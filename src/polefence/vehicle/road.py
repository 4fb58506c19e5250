"""A road: a broken line of height over distance, along which a wheel runs at constant speed.

Where roads come from: `random_road`, `obstacles`, `profile` (measured).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.system import Array
from polefence.response.weighting import positive

# Points of a profile, and steps of a drive: bounds the memory.
MOST = 20_000_000
# Steps over the whole of a road where nobody asked for a duration: two points can lie far apart.
MOST_UNASKED = 300_000


@dataclass(frozen=True, eq=False)
class Road:
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


def first_fault(distance: Array, height: Array) -> tuple[int, str] | None:
    """Return number and fault of the first bad point of a profile, None where all are good."""
    for name, values in (("distance", distance), ("height", height)):
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            return int(bad[0]), f"{name} {values[bad[0]]} is no finite number"
    bad = np.flatnonzero(np.diff(distance) <= 0)
    if len(bad):
        i = int(bad[0])
        how = "repeats" if distance[i + 1] == distance[i] else "lies before"
        return i + 1, (
            f"distance {distance[i + 1]:g} m {how} that of the point before, {distance[i]:g} m; "
            "sort the points by distance and keep one of each"
        )
    return None
