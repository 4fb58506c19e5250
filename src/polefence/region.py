"""Regions of the complex plane for closed-loop poles. For now: the disk."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.errors import RegionError
from polefence.plant.system import Array


def check_centre(centre: float) -> float:
    """Return a usable disk centre as a float.

    Raises
    ------
    RegionError
        If it is not finite, or not on the negative real axis.
    """
    try:
        value = float(centre)
    except (TypeError, ValueError) as error:
        raise RegionError(f"centre = {centre!r} is not a number") from error
    if not math.isfinite(value):
        raise RegionError(f"centre = {value} is not finite; give a negative real number")
    if value and not 1e-100 <= abs(value) <= 1e100:
        raise RegionError(f"centre = {value:g} is out of range; use -1e100 to -1e-100")
    if value >= 0:
        raise RegionError(
            f"centre = {value:g} is not in the left half-plane; give the real coordinate, "
            "negative on the left (-40)"
        )
    return value


@dataclass(frozen=True)
class Disk:
    """The open disk |z - centre| < radius, centre on the negative real axis.

    Parameters
    ----------
    centre : float
        Real coordinate of the centre [1/s], negative (the paper's -sigma).
    radius : float
        Radius r [1/s], positive. A radius of at least |centre| reaches into the right half-plane:
        poles in such a disk need not be stable, see `stable`.

    Raises
    ------
    RegionError
        If the centre is not negative, the radius not positive, or either not finite.
    """

    centre: float
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", check_centre(self.centre))
        try:
            radius = float(self.radius)
        except (TypeError, ValueError) as error:
            raise RegionError(f"radius = {self.radius!r} is not a number") from error
        if not (math.isfinite(radius) and radius > 0):
            raise RegionError(f"radius = {radius:g} must be positive and finite")
        object.__setattr__(self, "radius", radius)

    @property
    def sigma(self) -> float:
        """Distance of the centre from the imaginary axis."""
        return -self.centre

    @property
    def stable(self) -> bool:
        """Whether the disk lies in the open left half-plane."""
        return self.radius < self.sigma

    def distance(self, poles: Any) -> Array:
        """Signed distance of each pole to the boundary, negative inside [1/s]."""
        return np.abs(np.asarray(poles) - self.centre) - self.radius

    def contains(self, poles: Any) -> bool:
        """Whether every pole lies in the open disk, to float rounding."""
        return bool(np.all(self.distance(poles) < 0))

    def __str__(self) -> str:
        return f"disk({_exactly(self.centre)}, {_exactly(self.radius)})"


def _exactly(value: float) -> str:
    """Print a float so that it reads back the same: a rounded radius would be another claim."""
    short = f"{value:g}"
    return short if float(short) == value else repr(value)
