"""Regions that are dragged: their boundary as points, and handles that move edges and corners."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from operator import and_

import numpy as np

from polefence.base.errors import RegionError
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
from polefence.show.plots import Curve, View, curves

DIGITS = 4  # of numbers that are dragged
NEAR = 0.02  # of the view's width: of an edge and a corner so near, the corner is enough
ANGLES = 361
HALVINGS = 40
LEAST_DAMPING, MOST_DAMPING = 1e-3, 0.999


@dataclass(frozen=True)
class Handle:
    """A point that can be dragged.

    Attributes
    ----------
    place : complex
        Where it is, above the real axis or on it [1/s].
    parts : tuple of int
        Numbers of the region's parts whose boundaries go through it: one of an edge, two of a
        corner. Of a centre, the part that moves as a whole.
    centre : bool
    """

    place: complex
    parts: tuple[int, ...]
    centre: bool = False


def handles(region: Region, view: View) -> list[Handle]:
    """Return the handles of a region within a view (least and largest real part, height)."""
    corners = list(_corners(region, view))
    low, high, height = view
    near = NEAR * (high - low)
    edges = (
        own
        for own in _edges(region, view)
        if all(abs(own.place - corner.place) > near for corner in corners)
    )
    found = [*edges, *corners, *_centres(region)]
    return [own for own in found if low <= own.place.real <= high and own.place.imag <= height]


def moved(region: Region, handle: Handle, place: complex) -> Region:
    """Return the region with a handle dragged to a place.

    Raises
    ------
    RegionError
        If that makes no region: a disk with its centre in the right half-plane, say.
    """
    place = complex(place.real, abs(place.imag))
    parts = list(region.parts)
    for k in handle.parts:
        parts[k] = _dragged(parts[k], handle, place)
    return reduce(and_, parts)


def outline(region: Region, view: View) -> Array:
    """Return the boundary of what of a region is in a view, a closed curve of complex points.

    Empty where nothing of it is.
    """
    low, high, height = view
    grid = np.linspace(low, high, 201) + 1j * np.linspace(0, height, 101)[:, None]
    depth = np.maximum(region.distance(grid), _beyond(grid, view))
    inside = complex(grid.flat[int(depth.argmin())])
    if depth.min() >= 0:
        return np.empty(0, dtype=complex)
    inside = complex(inside.real, 0.0)  # regions are convex, and symmetric about the real axis
    rays = np.exp(1j * np.linspace(-np.pi, np.pi, ANGLES))
    near, far = np.zeros(ANGLES), np.full(ANGLES, 2 * (high - low + height))
    for _ in range(HALVINGS):
        middle = (near + far) / 2
        points = inside + middle * rays
        out = np.maximum(region.distance(points), _beyond(points, view)) >= 0
        near, far = np.where(out, near, middle), np.where(out, middle, far)
    return np.asarray(inside + near * rays)


def _beyond(points: Curve, view: View) -> Array:
    low, high, height = view
    x, y = points.real, np.abs(points.imag)
    return np.asarray(np.maximum(np.maximum(low - x, x - high), y - height))


def _edges(region: Region, view: View) -> Iterator[Handle]:
    """Yield a point or two of each edge, on the real axis or above it."""
    for k, part in enumerate(region.parts):
        for curve in curves(part, view):
            upper = curve[(curve.imag >= -1e-12) & (_beyond(curve, view) <= 0)]
            own = upper[region.distance(upper) <= _close(view)]
            if not len(own):
                continue
            if isinstance(part, Disk | Ellipse):  # its top and its right end
                ends = int(own.imag.argmax()), int(own.real.argmax())
                yield from (Handle(complex(own[end]), (k,)) for end in dict.fromkeys(ends))
            else:
                middle = np.argsort(np.abs(own))[len(own) // 2]
                yield Handle(complex(own[middle]), (k,))


def _corners(region: Region, view: View) -> Iterator[Handle]:
    """Yield where the boundaries of two parts meet, above the real axis."""
    for k, part in enumerate(region.parts):
        for other in range(k + 1, len(region.parts)):
            for curve in curves(part, view):
                level = region.parts[other].distance(curve)
                for i in np.flatnonzero(np.diff(level < 0)):
                    share = level[i] / (level[i] - level[i + 1])
                    place = complex(curve[i] + share * (curve[i + 1] - curve[i]))
                    if place.imag > _close(view) and region.distance(place) <= _close(view):
                        yield Handle(place, (k, other))


def _centres(region: Region) -> Iterator[Handle]:
    for k, part in enumerate(region.parts):
        if isinstance(part, Disk | Ellipse):
            yield Handle(complex(part.centre), (k,), centre=True)


def _close(view: View) -> float:
    low, high, height = view
    return 1e-3 * max(high - low, height)


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _dragged(part: Region, handle: Handle, place: complex) -> Region:
    """Return a part with its boundary, or its centre, at a place."""
    if handle.centre and isinstance(part, Disk | Ellipse):
        return replace(part, centre=_short(place.real))
    x, y = place.real, place.imag
    if isinstance(part, Disk):
        return replace(part, radius=_short(abs(place - part.centre)))
    if isinstance(part, HalfPlane):
        return replace(part, decay=_short(-x))
    if isinstance(part, Sector):
        damping = -x / abs(place) if place else 1.0
        return Sector(_short(min(max(damping, LEAST_DAMPING), MOST_DAMPING)))
    if isinstance(part, VerticalStrip):
        begin = handle.place.real
        first = abs(begin - part.low) < abs(begin - part.high)
        return replace(part, low=_short(x)) if first else replace(part, high=_short(x))
    if isinstance(part, HorizontalStrip):
        return replace(part, height=_short(y))
    if isinstance(part, Ellipse):
        size = float(np.hypot((x - part.centre) / part.real, y / part.imaginary))
        return replace(part, real=_short(size * part.real), imaginary=_short(size * part.imaginary))
    raise RegionError(f"{part} cannot be dragged")
