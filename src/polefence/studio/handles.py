"""Regions that are dragged: their boundary as points, and handles that move edges and corners."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import reduce
from itertools import combinations
from operator import and_

import numpy as np

from polefence.plant.system import Array
from polefence.region.regions import Curve, Region, View, require_left

WIDE = 100.0  # times the view, that an outline reaches: so far one can zoom out, or pan
LITTLE = 0.02  # of the view's width: a boundary of which less is seen is not seen


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
    # where an edge is this near to a corner, the corner is enough
    near = 0.02 * (high - low)
    edges = (
        handle
        for handle in _edges(region, view)
        if all(abs(handle.place - corner.place) > near for corner in corners)
    )
    placed = [*edges, *corners, *_centres(region)]
    return [
        handle
        for handle in placed
        if low <= handle.place.real <= high and handle.place.imag <= height
    ]


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
    return require_left(reduce(and_, parts))


def outline(region: Region, view: View) -> Curve:
    """Return the boundary of a region far beyond a view, a closed curve of complex points.

    Cut off at `WIDE` times the view, about its middle; empty where nothing of it is there.
    """
    low, high, height = view
    middle, half = (low + high) / 2, WIDE * (high - low) / 2
    return _cut(region, (middle - half, middle + half, WIDE * height))


def in_sight(region: Region, view: View) -> bool:
    """Whether a view shows more than a `LITTLE` of a region's boundary."""
    points, width = _cut(region, view), view[1] - view[0]
    inner = _beyond((points[1:] + points[:-1]) / 2, view) < -1e-9 * width  # not of the frame
    return float(np.abs(np.diff(points))[inner].sum()) > LITTLE * width


def _cut(region: Region, view: View) -> Curve:
    """Return the boundary of what of a region is in a view.

    Every part is |Im z| < top(Re z) between its ends, and so is what they have in common.
    """
    low, high = np.array([view[:2], *(part.ends for part in region.parts)]).T
    low, high = low.max(), high.min()
    if low >= high:
        return np.empty(0, dtype=complex)
    x = np.unique(
        np.concatenate([[low, high], *(_curved(part, low, high) for part in region.parts)])
    )
    x = np.sort(np.concatenate([x, *_meetings(x, _tops(region, view, x))]))
    upper = x + 1j * _tops(region, view, x).min(axis=0)
    return np.concatenate([upper, upper[::-1].conj(), upper[:1]])


def _curved(part: Region, low: float, high: float) -> Array:
    """Return real parts between two, at which a round part is drawn: close where it is steep."""
    if part.half_axes is None:
        return np.empty(0)
    real, centre = part.half_axes[0], sum(part.ends) / 2
    first, last = (np.arccos(np.clip((x - centre) / real, -1, 1)) for x in (low, high))
    x = centre + real * np.cos(np.linspace(first, last, 361))
    return np.asarray(np.clip(x, low, high))


def _tops(region: Region, view: View, x: Array) -> Array:
    """Return the largest imaginary parts of the view, and of parts that bound them, at each x."""
    return np.array([np.full(len(x), view[2]), *(part.top(x) for part in region.parts)])


def _meetings(x: Array, tops: Array) -> Iterator[Array]:
    """Yield where two of the tops cross, from one x to the next: there are corners."""
    for one, other in combinations(tops, 2):
        level = one - other
        i = np.flatnonzero(level[:-1] * level[1:] < 0)
        yield x[i] + (x[i + 1] - x[i]) * level[i] / (level[i] - level[i + 1])


def _beyond(points: Curve, view: View) -> Array:
    low, high, height = view
    x, y = points.real, np.abs(points.imag)
    return np.asarray(np.maximum(np.maximum(low - x, x - high), y - height))


def _edges(region: Region, view: View) -> Iterator[Handle]:
    """Yield a point or two of each edge, on the real axis or above it."""
    for k, part in enumerate(region.parts):
        for curve in part.boundary(view):
            upper = curve[(curve.imag >= -1e-12) & (_beyond(curve, view) <= 0)]
            edge = upper[region.distance(upper) <= _close(view)]
            if not len(edge):
                continue
            if part.half_axes is not None:  # its top and its right end
                ends = int(edge.imag.argmax()), int(edge.real.argmax())
                yield from (Handle(complex(edge[end]), (k,)) for end in dict.fromkeys(ends))
            else:
                middle = np.argsort(np.abs(edge))[len(edge) // 2]
                yield Handle(complex(edge[middle]), (k,))


def _corners(region: Region, view: View) -> Iterator[Handle]:
    """Yield where the boundaries of two parts meet, above the real axis."""
    for k, part in enumerate(region.parts):
        for other in range(k + 1, len(region.parts)):
            for curve in part.boundary(view):
                level = region.parts[other].distance(curve)
                for i in np.flatnonzero(np.diff(level < 0)):
                    share = level[i] / (level[i] - level[i + 1])
                    place = complex(curve[i] + share * (curve[i + 1] - curve[i]))
                    if place.imag > _close(view) and region.distance(place) <= _close(view):
                        yield Handle(place, (k, other))


def _centres(region: Region) -> Iterator[Handle]:
    for k, part in enumerate(region.parts):
        if part.half_axes is not None:
            yield Handle(complex(sum(part.ends) / 2), (k,), centre=True)


def _close(view: View) -> float:
    low, high, height = view
    return 1e-3 * max(high - low, height)


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def _dragged(part: Region, handle: Handle, place: complex) -> Region:
    """Return a part with its boundary, or its centre, at a place."""
    centred = {"centre": place.real}
    moved = replace(part, **centred) if handle.centre else part.through(place, handle.place)
    numbers = {field.name: getattr(moved, field.name) for field in fields(part)}
    changed = {key: _short(new) for key, new in numbers.items() if new != getattr(part, key)}
    return replace(part, **changed)
