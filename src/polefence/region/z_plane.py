"""Regions of continuous time, carried over to the z-plane by z = exp(s T) for discrete-time plants.

A decay rate becomes a disk about zero, a bound on frequencies a wedge from zero, exactly. Poles of
a least damping ratio lie within a logarithmic spiral and its mirror image, |z| < exp(-k |arg z|)
with k = damping / sqrt(1 - damping^2). Where they turn back at the left that set is not convex; a
polygon whose corners lie on the spirals, and which ends where these meet, is within it. Its edges
are wedges. A vertical strip becomes an annulus, which is not convex: what lies to the right of its
inner circle is, within a wedge that is nearly a half-plane.

In the image of a disk lies the disk that meets the real axis in the same two points,
exp((centre - radius) T) and exp((centre + radius) T). Of a disk about 0, rho = radius T, its points
are those whose distance from 1 is below rho by the metric |dz| / Re z of the right half-plane
(Beardon, The Geometry of Discrete Groups, 1983, section 7.2). In s T = log z that metric is
|dz| / Re z = |d log z| / cos(Im log z), which is no shorter than |d log z|: so |log z| < rho.
Another centre scales both images by a positive number. The ends alone are rounded, towards one
another, and a disk between them lies in the other; so does that which ends at 1, where a disk
reaches into the right half-plane. Of an ellipse the image is that of the largest disk about its
centre in it.

A wedge that opens to the left from -1 or beyond has no point in common with the unit disk and is
one of continuous time: its image is that of a damping ratio, times exp(apex T).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from operator import and_
from typing import Any

import numpy as np

from polefence.base.errors import RegionError, shown
from polefence.base.explained import explained
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Intersection,
    Region,
    Sector,
    VerticalStrip,
    Wedge,
    damping_of,
    slope_of,
)

EDGES = 5  # of the polygon of a damping ratio, in the upper half-plane
MOST_EDGES = 12
MOST_DAMPING = 0.999  # beyond it the image is too thin for corners that floats tell apart
INSIDE = 1e-11  # corners are moved inwards by so much, relative to their modulus
SAFE = 1e-13  # and stay inside by so much, which floats cannot mistake
EXACT = 1e-15  # relative error of an exponential, times one more than its exponent
HALVINGS = 50
ALONG = np.linspace(0.0, 1.0, 65)[1:-1]  # points of an edge at which its damping is looked at
UPRIGHT = 100.0  # slope of the wedge that stands for a half-plane to the right of its apex
SMALLEST = 1e-100  # modulus of an end of an image


@explained
def z_plane(region: Region, sample_time: Any, edges: int = EDGES) -> Region:
    """Return a region of the z-plane, within the image of a region of continuous time.

    Disks in the unit disk, or about a point of the right half-plane, and wedges that meet the unit
    disk are of the z-plane already and stay as they are.

    Parameters
    ----------
    region : Region
    sample_time : number
        T [s].
    edges : int, optional
        Of the polygon that stands for a damping ratio, 2 to 12. More of them leave less of the
        image out, and make the search larger.

    Returns
    -------
    Region
        Disks and wedges, one disk at least.

    Raises
    ------
    RegionError
        If a part has no such image, or no poles of it are stable.
    """
    try:
        T = float(sample_time)
    except (TypeError, ValueError, OverflowError) as error:
        raise RegionError(
            f"sample_time = {shown(sample_time)} must be a number of seconds"
        ) from error
    if not 0 < T < math.inf:
        raise RegionError(f"sample_time = {T:g} must be positive and finite")
    if not 2 <= edges <= MOST_EDGES:
        raise RegionError(f"edges = {edges} must be 2 to {MOST_EDGES}")
    images = [image for part in region.parts for image in _IMAGES[part.kind](part, T, edges)]
    if not any(image.circle for image in images):
        images.insert(0, Disk(0, 1))
    return images[0] if len(images) == 1 else Intersection(tuple(images))


def _of_disk(part: Disk, T: float, edges: int) -> list[Region]:  # noqa: ARG001
    return [part] if part.discrete or part.centre >= 0 else [_disk(part, *part.ends, T)]


def _of_ellipse(part: Ellipse, T: float, edges: int) -> list[Region]:  # noqa: ARG001
    radius = min(part.real, part.imaginary)
    return [_disk(part, part.centre - radius, part.centre + radius, T)]


def _of_wedge(part: Wedge, T: float, edges: int) -> list[Region]:
    if part.slope < 0 or part.apex > -1:
        return [part]
    scale = _below_exponential(HalfPlane(-part.apex), T)
    polygon = _polygon(_damping(part), edges)
    return [Disk(0, scale), *(_scaled(wedge, scale) for wedge in polygon)]


def _damping(wedge: Wedge) -> float:
    """Return the damping ratio of a wedge that opens to the left; not less."""
    damping = damping_of(wedge.slope)
    while slope_of(damping) > wedge.slope:
        damping = math.nextafter(damping, 1)
    return damping


def _scaled(wedge: Wedge, scale: float) -> Wedge:
    """Return a wedge whose apex is nearer to zero, rounded to where that makes it smaller."""
    return Wedge(math.nextafter(wedge.apex * scale, -wedge.slope * math.inf), wedge.slope)


def _disk(part: Region, low: float, high: float, T: float) -> Disk:
    """Return the disk about a point of the real axis between two exponentials, up to one."""
    begin = max(_exponential(low * T, 1), SMALLEST)
    end = min(_exponential(high * T, -1), 1.0)
    if begin >= end * (1 - INSIDE):
        raise RegionError(f"{part}: its image has no size in floats at {T:g} s")
    centre = (begin + end) / 2
    radius = min(end - centre, centre - begin)
    while not (
        Fraction(begin) <= Fraction(centre) - Fraction(radius)
        and Fraction(centre) + Fraction(radius) <= Fraction(end)
    ):
        radius = math.nextafter(radius, 0)
    return Disk(centre, radius)


def _exponential(x: float, side: int) -> float:
    """Return exp(x), a little more or less; zero below, of nothing that doubles hold."""
    return 1.0 if not x else math.exp(min(x, 200.0)) * (1 + side * EXACT * (1 + abs(x)))


def _of_half_plane(part: HalfPlane, T: float, edges: int) -> list[Region]:  # noqa: ARG001
    return [Disk(0, _below_exponential(part, T))]


def _of_vertical_strip(part: VerticalStrip, T: float, edges: int) -> list[Region]:  # noqa: ARG001
    apex = _exponential(part.low * T, 1)
    outer = _below_exponential(HalfPlane(-part.high), T)
    if apex >= outer * (1 - INSIDE):
        raise RegionError(f"{part}: is too narrow at {T:g} s")
    return [Disk(0, outer), Wedge(apex, -UPRIGHT)]


def _of_horizontal_strip(part: HorizontalStrip, T: float, edges: int) -> list[Region]:  # noqa: ARG001
    angle = part.height * T
    if angle >= math.pi / 2:
        raise RegionError(
            f"{part}: height must be below {math.pi / 2 / T:.4g} rad/s, a quarter of the "
            f"sampling frequency at {T:g} s"
        )
    return [Wedge(0, -math.tan(angle) * (1 - INSIDE))]


def _of_sector(part: Sector, T: float, edges: int) -> list[Region]:  # noqa: ARG001
    return list(_polygon(part.damping, edges))


_IMAGES: dict[str, Callable[[Any, float, int], list[Region]]] = {
    Disk.kind: _of_disk,
    Ellipse.kind: _of_ellipse,
    Wedge.kind: _of_wedge,
    HalfPlane.kind: _of_half_plane,
    VerticalStrip.kind: _of_vertical_strip,
    HorizontalStrip.kind: _of_horizontal_strip,
    Sector.kind: _of_sector,
}


def _below_exponential(part: HalfPlane, T: float) -> float:
    """Return exp(-decay T), a little less."""
    if part.decay < 0:
        raise RegionError(f"{part} holds unstable poles; use half_plane(0) or more")
    radius = _exponential(-part.decay * T, -1)
    if radius <= SMALLEST:
        raise RegionError(f"{part}: nothing decays so fast at {T:g} s; ask for a lower rate")
    return radius


# --- damping -------------------------------------------------------------------------------------
def share_kept(damping: float, edges: int = EDGES) -> float:
    """Return which share of the image's area `z_plane` keeps of a damping ratio, in floats."""
    angle = np.linspace(0.0, math.pi, 2001)
    whole = np.exp(-_pitch(damping) * angle)
    kept = whole
    for wedge in _polygon(damping, edges):  # the ray r exp(i angle) meets s x + y = s a
        along = wedge.slope * np.cos(angle) + np.sin(angle)
        with np.errstate(divide="ignore"):
            end = wedge.slope * wedge.apex / along
        kept = np.where(end > 0, np.minimum(kept, end), kept)
    return float(np.sum(kept**2) / np.sum(whole**2))


def annulus_kept(strip: VerticalStrip, sample_time: float) -> float:
    """Return which share of the image's area `z_plane` keeps of a vertical strip, in floats."""
    a, b = (math.exp(end * sample_time) for end in (strip.low, strip.high))
    y = np.linspace(0.0, b, 20001)
    width = np.sqrt(np.maximum(b * b - y * y, 0.0)) - a - y / UPRIGHT
    kept = 2 * b * float(np.maximum(width, 0.0).mean())
    return kept / (math.pi * (b * b - a * a))


def disk_kept(part: Disk | Ellipse, sample_time: float) -> float:
    """Return which share of the image's area `z_plane` keeps of a disk or an ellipse, in floats.

    Of an image that covers a part of the plane twice, twice that part counts; what lies to the
    right of 1 counts too.
    """
    a, b = (axis * sample_time for axis in part.half_axes or (0.0, 0.0))
    centre, rho = part.centre * sample_time, min(a, b)
    angle = np.linspace(0.0, math.pi, 20001)
    # |exp s|^2 over the ellipse, s = a cos(angle) + i y, and the disk, relative to its largest
    whole = 2 * a * b * np.mean(np.sin(angle) ** 2 * np.exp(2 * a * (np.cos(angle) - 1)))
    low, high = (math.exp(end - centre - a) for end in (centre - rho, min(centre + rho, 0.0)))
    return float(((high - low) / 2) ** 2 / whole)


@dataclass(frozen=True)
class Share(Short):
    """What stands for a part in the z-plane, where that is less than its image.

    Attributes
    ----------
    part : Region
        As it was asked for.
    name : str
        Of what stands for it.
    kept : float
        Its share of the image's area, in floats.
    beyond : str
        Where a pole outside it may still be.
    """

    part: Region
    name: str
    kept: float
    beyond: str

    def __str__(self) -> str:
        return f"the {self.name} of {self.part} is {math.floor(100 * self.kept)} % of its image"


def shares(region: Region, sample_time: float) -> tuple[Share, ...]:
    """Return for each part of a region what stands for it where that is less than its image."""
    T = float(sample_time)
    return tuple(
        Share(part, name, kept(part, T), beyond)
        for part in region.parts
        if part.kind in _KEPT and _IMAGES[part.kind](part, T, EDGES) != [part]
        for name, kept, beyond in [_KEPT[part.kind]]
    )


_KEPT: dict[str, tuple[str, Callable[[Any, float], float], str]] = {
    Disk.kind: ("inner disk", disk_kept, "the disk"),
    Ellipse.kind: ("inner disk", disk_kept, "the ellipse"),
    Wedge.kind: ("polygon", lambda part, _: share_kept(_damping(part)), "the wedge"),
    VerticalStrip.kind: ("right part", annulus_kept, "the strip"),
    Sector.kind: ("polygon", lambda part, _: share_kept(part.damping), "the sector"),
}


def _polygon(damping: float, edges: int) -> list[Wedge]:
    """Return the wedges whose intersection is the polygon, of six digits, rounded inwards.

    Slow poles are near 1, so there the first one begins.

    Raises
    ------
    RegionError
        If a corner is not inside the spirals by more than rounding.
    """
    if damping > MOST_DAMPING:
        raise RegionError(f"sector({damping:g}): a polygon is made up to {MOST_DAMPING}")
    *corners, tip = (corner * (1 - INSIDE) for corner in _corners(damping, edges))
    corners.append(complex(min(tip.real + INSIDE, 0.0), 0.0))
    wedges = []
    for one, other in pairwise(corners):
        slope = (other.imag - one.imag) / (one.real - other.real)
        inwards = digits_down if slope > 0 else digits_up
        numbers = (float(inwards(v)) for v in (one.real + one.imag / slope, slope))
        wedges.append(Wedge(*numbers))
    wedges[0] = Wedge(1.0, wedges[0].slope)
    _require_inside(damping, wedges)
    return wedges


def _require_inside(damping: float, wedges: list[Wedge]) -> None:
    """Refuse a polygon of which a corner, of the numbers as they are rounded, is not inside.

    The part of the spirals' set to the right of where they meet is convex, so corners suffice.
    """
    k, tip = _pitch(damping), -math.exp(-_pitch(damping) * math.pi)
    lines = [
        (Fraction(wedge.slope), Fraction(wedge.slope) * Fraction(wedge.apex)) for wedge in wedges
    ]
    ends = [(Fraction(wedges[-1].apex), Fraction(0))]  # the other is 1 itself
    for (s, c), (t, d) in pairwise(lines):  # s x + y = c, t x + y = d
        x = (c - d) / (s - t)
        ends.append((x, c - s * x))
    for x, y in ends:
        z = complex(float(x), float(y))
        if abs(z) > math.exp(-k * abs(math.atan2(z.imag, z.real))) * (1 - SAFE) or z.real < tip:
            raise RegionError(f"sector({damping:g}) has no polygon in the z-plane")


def _pitch(damping: float) -> float:
    return damping / math.sqrt((1 - damping) * (1 + damping))


def _spiral(damping: float, angle: float) -> complex:
    size = math.exp(-_pitch(damping) * angle)
    return complex(size * math.cos(angle), size * math.sin(angle))


def _corners(damping: float, edges: int) -> list[complex]:
    """Return corners from 1 to the tip.

    On the edges between, the damping is above that asked by no more than has to be with so many.
    """
    low, high, best = 0.0, 1.0 - damping, None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        corners = _marched(damping, middle, edges)
        if corners is None:
            low = middle
        else:
            best, high = corners, middle
    if best is None:
        raise RegionError(f"sector({damping:g}) has no polygon of {edges} edges; use more")
    return best


def _marched(damping: float, excess: float, edges: int) -> list[complex] | None:
    """Return corners whose edges exceed the damping asked by so much at most.

    None if that takes more edges. The last one, where poles are fast, may be as it comes.
    """
    tip = complex(-math.exp(-_pitch(damping) * math.pi), 0.0)
    last = _steepest(damping, tip.real)
    corners, angle = [1 + 0j], 0.0
    while angle < last and _excess(damping, corners[-1], tip) > excess:
        angle = _farthest(damping, excess, corners[-1], angle, last)
        corners.append(_spiral(damping, angle))
        if len(corners) > edges:
            return None
    return [*corners, tip]


def _farthest(damping: float, excess: float, corner: complex, angle: float, last: float) -> float:
    """Return the angle of the next corner."""
    low, high = angle, last
    if _excess(damping, corner, _spiral(damping, last)) <= excess:
        return last
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if _excess(damping, corner, _spiral(damping, middle)) <= excess:
            low = middle
        else:
            high = middle
    return low if last - low > 1e-2 * last else last  # no edge of no length


def _steepest(damping: float, tip: float) -> float:
    """Return the angle up to which corners stay far enough to the right of the tip."""
    leftmost = math.pi - math.atan(_pitch(damping))
    # nearer to zero floats leave nothing of what is SAFE
    low, high = 0.0, min(leftmost, -math.log(1e-2) / _pitch(damping))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        # the last corner before the tip lies 1 % of 1 - tip to the right of it
        if _spiral(damping, middle).real > tip + 1e-2 * (1 - tip):
            low = middle
        else:
            high = middle
    return low


def _excess(damping: float, one: complex, other: complex) -> float:
    """Return by how much the largest damping ratio on an edge is above that asked."""
    if abs(other - one) < 1e-15:
        return 0.0
    s = np.log(one + ALONG * (other - one))
    ratios = -s.real / np.abs(s)
    at_one = (one - other).real / abs(one - other) if one == 1 else 0.0
    return float(max(ratios.max(), at_one) - damping)


def delta_plane(region: Region, sample_time: Any) -> Region:
    """Return where (z - 1) / T is for z in a region: poles of a plant in its delta form.

    Parameters
    ----------
    region : Region
        Disks and wedges, of which regions of the z-plane are made up.
    sample_time : number
        T [s].

    Raises
    ------
    RegionError
        If a part is neither.
    """
    T = float(sample_time)
    return reduce(and_, (part.in_differences(T) for part in region.parts))
