"""Boundaries of regions as curves, for pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.plant.system import Array
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Region,
    Sector,
    VerticalStrip,
)

Curve = npt.NDArray[np.complex128]
View = tuple[float, float, float]  # least and largest real part, largest imaginary part

POINTS = 1441

# An unbounded region is shown out to this many times its own scale, or that of most poles.
FARTHEST = 12.0


def curves(part: Region, view: View) -> list[Curve]:
    """Return the boundary of a region's part as complex points, unbounded curves as far as asked.

    Parameters
    ----------
    part : Region
        One of `Region.parts`.
    view : (low, high, height)
        What lines and rays must reach across.
    """
    return _CURVES[type(part)](part, view)


def _disk(part: Any, _: View) -> list[Curve]:
    return [part.centre + part.radius * np.exp(1j * np.linspace(0, 2 * np.pi, POINTS))]


def _ellipse(part: Any, _: View) -> list[Curve]:
    angle = np.linspace(0, 2 * np.pi, POINTS)
    return [part.centre + part.real * np.cos(angle) + 1j * part.imaginary * np.sin(angle)]


def _half_plane(part: Any, view: View) -> list[Curve]:
    return [_vertical(-part.decay, view)]


def _vertical_strip(part: Any, view: View) -> list[Curve]:
    return [_vertical(part.low, view), _vertical(part.high, view)]


def _horizontal_strip(part: Any, view: View) -> list[Curve]:
    x = np.linspace(view[0], view[1], POINTS)
    return [x + 1j * part.height, x - 1j * part.height]


def _sector(part: Any, view: View) -> list[Curve]:
    # one curve through the corner, as far as the view's farther side
    far = min(-view[0], view[2] / part.slope)
    x = np.linspace(far, -far, POINTS)
    return [-np.abs(x) + 1j * part.slope * x]


def _vertical(x: float, view: View) -> Curve:
    return np.asarray(x + 1j * np.linspace(-view[2], view[2], POINTS))


_CURVES: dict[type[Region], Callable[[Any, View], list[Curve]]] = {
    Disk: _disk,
    Ellipse: _ellipse,
    HalfPlane: _half_plane,
    VerticalStrip: _vertical_strip,
    HorizontalStrip: _horizontal_strip,
    Sector: _sector,
}


def view_of(region: Region, poles: Array) -> View:
    """Return a view of the poles, of the region's boundary and of the origin."""
    low, high, height = _extent(region)
    x, y = np.real(poles), np.abs(np.imag(poles))
    if np.isfinite(low):
        seen = np.ones(x.shape, dtype=bool)
    else:
        reach = FARTHEST * max(region.scale, float(np.median(np.abs(x))))
        seen = x >= -reach
        low = min(-1.3 * region.scale, float(x[seen].min(initial=0.0)))
    low, high = min(low, float(x[seen].min(initial=low))), max(high, float(x[seen].max(initial=0)))
    height = max(height, float(y[seen].max(initial=0.0)), 0.35 * (high - low))
    margin = 0.06 * max(high - low, 1e-9)
    return low - margin, high + margin, height + margin


def _extent(region: Region) -> View:
    """Return how far the boundary reaches: low is -infinity where no part bounds it."""
    low, high, height = -np.inf, 0.0, 0.0
    for part in region.parts:
        if isinstance(part, Disk | Ellipse):
            real, imaginary = (
                (part.radius, part.radius)
                if isinstance(part, Disk)
                else (part.real, part.imaginary)
            )
            low = max(low, part.centre - real)
            high, height = max(high, part.centre + real), max(height, imaginary)
        elif isinstance(part, VerticalStrip):
            low, high = max(low, part.low), max(high, part.high)
        elif isinstance(part, HorizontalStrip):
            height = max(height, part.height)
        elif isinstance(part, HalfPlane):
            high = max(high, -part.decay)
    return low, high, height
