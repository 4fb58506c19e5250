"""Regions of the complex plane for closed-loop poles: LMI regions and their intersections.

Each part is { z : L + M z + M' conj(z) < 0 } for small real matrices L (symmetric) and M (Chilali &
Gahinet, 1996), hence convex and symmetric about the real axis.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from fractions import Fraction
from functools import cached_property, reduce
from operator import and_
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from polefence.base.drawing import pictures
from polefence.base.errors import RegionError, shown
from polefence.base.explained import explained_fields
from polefence.plant.card import card
from polefence.plant.system import Array
from polefence.proof import regions as proof
from polefence.proof.matrices import ONE, ZERO
from polefence.proof.short import Short
from polefence.proof.text import exactly

Pair = tuple[Array, Array]  # L, M
Curve = npt.NDArray[np.complex128]
View = tuple[float, float, float]  # least and largest real part, largest imaginary part

POINTS = 1441  # of a curve


def check_centre(centre: float) -> float:
    """Return a usable disk centre of a continuous-time plant as a float.

    Raises
    ------
    RegionError
        If it is not finite, or not on the negative real axis.
    """
    value = _number(centre, "centre")
    if value >= 0:
        raise RegionError(
            f"centre = {value:g} is not in the left half-plane; give the real coordinate, "
            "negative on the left (-40)"
        )
    return value


def _number(value: Any, name: str) -> float:
    """Return a finite number of sensible size."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise RegionError(f"{name} = {shown(value)} is not a number that a double holds") from error
    if not math.isfinite(number):
        raise RegionError(f"{name} = {number} is not finite; give a real number")
    if number and not 1e-100 <= abs(number) <= 1e100:
        raise RegionError(f"{name} = {number:g} is out of range; use magnitudes 1e-100 to 1e100")
    return number


@dataclass(frozen=True)
class Region(Short, ABC):
    """A convex region, symmetric about the real axis; ``&`` intersects two."""

    kind: ClassVar[str] = ""
    rates: ClassVar[tuple[str, ...] | None] = None  # numbers in 1/s; all where there is None
    definite: ClassVar[bool] = False  # whether its inequalities imply that X is positive definite

    @explained_fields
    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _number(getattr(self, field.name), field.name))
        fault = self.exact.fault()
        if fault:
            raise RegionError(fault)

    @cached_property
    def exact(self) -> proof.Part:
        """A part as the checker has it."""
        return proof.KINDS[self.kind](*map(Fraction, self.numbers.values()))

    @property
    def parts(self) -> tuple[Region, ...]:
        """The regions whose intersection this is; itself for all but an `Intersection`."""
        return (self,)

    @property
    def numbers(self) -> dict[str, float]:
        """Numbers of a part that a design file keeps."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @property
    def stable(self) -> bool:
        """Whether the region lies in the open left half-plane, as far as one part tells."""
        left = ONE, ZERO, ZERO
        return any(part.exact.in_half_plane(*left) for part in self.parts)

    @property
    def discrete(self) -> bool:
        """Whether a part is a disk within the open unit disk, as discrete time requires."""
        return any(part.exact.in_unit_disk for part in self.parts)

    @property
    def circle(self) -> tuple[float, float] | None:
        """Centre and radius of a disk; None of other regions."""
        return None

    @property
    @abstractmethod
    def scale(self) -> float:
        """A rate typical of the region [1/s]; zero for a sector, which has none."""

    @property
    def size(self) -> float:
        """Length by which distances to the boundary are judged [1/s]."""
        return self.scale or 1.0

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """Least and largest real part in the region; infinite where there is none."""

    @abstractmethod
    def top(self, x: Array) -> Array:
        """Return the supremum of Im z at real parts x between the ends; it may be infinite."""

    @property
    def highest(self) -> float:
        """Largest imaginary part of the boundary, zero where no curve of it has one."""
        return 0.0

    @property
    def growing(self) -> tuple[str, ...]:
        """Names of the numbers that enlarge the region as they grow."""
        return ()

    def boundary(self, view: View) -> list[Curve]:
        """Return the boundary of a part as complex points, cut at the view.

        Parameters
        ----------
        view : (low, high, height)
            What lines and rays must reach across [1/s].
        """
        raise NotImplementedError

    @property
    def half_axes(self) -> tuple[float, float] | None:
        """Of a disk or an ellipse along the real axis and across; None of other regions."""
        return None

    @property
    def bounds_speed(self) -> bool:
        """Whether a part bounds the real parts of poles on both sides."""
        return bool(np.all(np.isfinite(self.ends)))

    def decay_rate(self, step: float = 0.0) -> float:  # noqa: ARG002
        """Return the decay rate that the region asks for [1/s], in delta form with this step."""
        return 0.0

    @property
    def closed_form(self) -> tuple[Fraction, Fraction, Fraction] | None:
        """Return a, b, e of the region a + 2 b Re z + e |z|^2 < 0; None for other regions."""
        return None

    def pairs(self, rate: float = 1.0) -> tuple[Pair, ...]:
        """Return L and M of the part, or of its two halves, in units of ``rate``."""
        scaled = {
            name: value / rate if self.rates is None or name in self.rates else value
            for name, value in self.numbers.items()
        }
        part = proof.KINDS[self.kind](*map(Fraction, scaled.values()))
        return tuple((np.array(L, dtype=float), np.array(M, dtype=float)) for L, M in part.pairs)

    def in_differences(self, T: float) -> Region:  # noqa: ARG002
        """Return where (z - 1) / T is for z in a disk or a wedge of the z-plane."""
        raise RegionError(f"{self}: a region of the z-plane is made up of disks and wedges")

    def tighter(self, share: float, within: Region | None = None, rate: float = 0.0) -> Region:
        """Return the region with each part made smaller by a share of its size, if it can be.

        Parameters
        ----------
        share : float
            0 to 1.
        within : Region, optional
            Where loops are stable. Where that is a disk, the size of a disk is at most its
            distance from that edge: of one with the same centre that is a decay rate.
        rate : float, optional
            The size of a part that asks for stability alone [1/s].
        """
        kept = list[Region]()
        for part in self.parts:
            try:
                kept.append(part.shrunk(share, within, rate))
            except RegionError:  # none of that size
                kept.append(part)
        return reduce(and_, kept)

    def shrunk(self, share: float, within: Region | None, rate: float) -> Region:  # noqa: ARG002
        """Return a part made smaller by a share of its size; itself where it has none.

        Raises
        ------
        RegionError
            If there is no region of that size.
        """
        return self

    def through(self, z: complex, begin: complex) -> Region:  # noqa: ARG002
        """Return the region with its boundary moved from one point to another.

        Raises
        ------
        RegionError
            If that makes no region.
        """
        raise RegionError(f"{self} cannot be dragged")

    @abstractmethod
    def distance(self, poles: Any) -> Array:
        """Signed distance of each pole to the boundary, negative inside [1/s]."""

    def contains(self, poles: Any) -> bool:
        """Whether every pole lies in the open region, to float rounding."""
        return bool(np.all(self.distance(poles) < 0))

    def document(self) -> dict[str, Any]:
        """Return the region as plain data for a design file."""
        return {"kind": self.kind, **self.numbers}

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        rows = [("all poles in", str(part)) for part in self.parts]
        return card("region", rows, pictures().region(self).small)

    def __and__(self, other: Region) -> Region:
        if not isinstance(other, Region):
            return NotImplemented
        both = Intersection((*self.parts, *other.parts))
        return both if len(both.parts) > 1 else both.parts[0]

    def __str__(self) -> str:
        return f"{self.kind}({', '.join(exactly(value) for value in astuple(self))})"


@dataclass(frozen=True)
class Disk(Region):
    """The open disk |z - centre| < radius.

    Parameters
    ----------
    centre : float
        Real coordinate of the centre [1/s], negative (the paper's -sigma); any, where another part
        of the region lies in the left half-plane, as in HalfPlane(1) & Disk(0, 500). For a
        discrete-time plant any, with the disk inside the open unit disk, or all of it: Disk(0, 1)
        is stability.
    radius : float
        Radius r [1/s], positive. A radius above |centre| reaches into the right half-plane: poles
        in such a disk need not be stable, see `stable`.

    Raises
    ------
    RegionError
        If the radius is not positive, or either not finite.
    """

    centre: float
    radius: float
    kind: ClassVar[str] = "disk"
    definite: ClassVar[bool] = True

    @property
    def circle(self) -> tuple[float, float]:
        return self.centre, self.radius

    @property
    def sigma(self) -> float:
        """Distance of the centre from the imaginary axis."""
        return -self.centre

    @property
    def size(self) -> float:
        return self.radius

    @property
    def scale(self) -> float:
        """Distance of the centre, or the radius where that is larger."""
        return max(abs(self.centre), self.radius)

    @property
    def ends(self) -> tuple[float, float]:
        return self.centre - self.radius, self.centre + self.radius

    @property
    def half_axes(self) -> tuple[float, float]:
        return self.radius, self.radius

    def top(self, x: Array) -> Array:
        return _arc(x, self.centre, self.radius, self.radius)

    def decay_rate(self, step: float = 0.0) -> float:
        return self.sigma - self.radius if step else 0.0

    @property
    def closed_form(self) -> tuple[Fraction, Fraction, Fraction]:
        c, r = Fraction(self.centre), Fraction(self.radius)
        return c * c - r * r, -c, Fraction(1)

    def shrunk(self, share: float, within: Region | None, rate: float) -> Disk:
        size = self.radius
        if within is not None and within.circle is not None:
            centre, radius = within.circle
            edge = max(radius - abs(self.centre - centre) - size, 0.0)
            size = min(size, edge or rate)
        return Disk(self.centre, self.radius - share * size)

    def in_differences(self, T: float) -> Disk:
        return Disk((self.centre - 1) / T, self.radius / T)

    def through(self, z: complex, begin: complex) -> Disk:  # noqa: ARG002
        return Disk(self.centre, abs(z - self.centre))

    @property
    def highest(self) -> float:
        return self.radius

    @property
    def growing(self) -> tuple[str, ...]:
        return ("radius",)

    def boundary(self, view: View) -> list[Curve]:  # noqa: ARG002
        return [_around(self.centre, self.radius, self.radius)]

    def distance(self, poles: Any) -> Array:
        return np.abs(np.asarray(poles) - self.centre) - self.radius


@dataclass(frozen=True)
class HalfPlane(Region):
    """Re z < -decay: every motion dies out at least as fast as exp(-decay t).

    Parameters
    ----------
    decay : float
        [1/s]; zero for stability alone.
    """

    decay: float
    kind: ClassVar[str] = "half_plane"

    @property
    def scale(self) -> float:
        return abs(self.decay)

    @property
    def ends(self) -> tuple[float, float]:
        return -math.inf, -self.decay

    def top(self, x: Array) -> Array:
        return np.full(np.shape(x), np.inf)

    def decay_rate(self, step: float = 0.0) -> float:  # noqa: ARG002
        return self.decay

    @property
    def closed_form(self) -> tuple[Fraction, Fraction, Fraction]:
        return 2 * Fraction(self.decay), Fraction(1), Fraction(0)

    def shrunk(self, share: float, within: Region | None, rate: float) -> HalfPlane:  # noqa: ARG002
        return HalfPlane(self.decay + share * (abs(self.decay) or rate))

    def through(self, z: complex, begin: complex) -> HalfPlane:  # noqa: ARG002
        return HalfPlane(-z.real)

    def boundary(self, view: View) -> list[Curve]:
        return [_vertical(-self.decay, view)]

    def distance(self, poles: Any) -> Array:
        return np.asarray(np.real(poles) + self.decay)


@dataclass(frozen=True)
class Sector(Region):
    """Damping ratio above ``damping``: |Im z| < slope |Re z|, Re z < 0.

    Parameters
    ----------
    damping : float
        Between 0 and 1. The slope is sqrt(1 - damping^2) / damping, rounded towards zero so that
        the region proved has at least the damping ratio asked for.
    """

    damping: float
    kind: ClassVar[str] = "sector"
    rates: ClassVar[tuple[str, ...] | None] = ()

    @property
    def slope(self) -> float:
        """Largest |Im z| / |Re z|."""
        return slope_of(self.damping)

    @property
    def wedge(self) -> Wedge:
        """The sector as a wedge, without its damping."""
        return Wedge(0.0, self.slope)

    @property
    def numbers(self) -> dict[str, float]:
        return {"damping": self.damping, "slope": self.slope}

    @property
    def scale(self) -> float:
        return 0.0

    @property
    def ends(self) -> tuple[float, float]:
        return -math.inf, 0.0

    def top(self, x: Array) -> Array:
        return self.wedge.top(x)

    def shrunk(self, share: float, within: Region | None, rate: float) -> Sector:  # noqa: ARG002
        return Sector(self.damping + share * (1 - self.damping))

    def through(self, z: complex, begin: complex) -> Sector:  # noqa: ARG002
        damping = -z.real / abs(z) if z else 1.0
        return Sector(min(max(damping, 1e-3), 0.999))

    def boundary(self, view: View) -> list[Curve]:
        return self.wedge.boundary(view)

    def distance(self, poles: Any) -> Array:
        return self.wedge.distance(poles)


@dataclass(frozen=True)
class Wedge(Region):
    """|Im z| < slope (apex - Re z): between two rays from a point of the real axis.

    Parameters
    ----------
    apex : float
        Where the rays begin [1/s]; in the z-plane without a unit.
    slope : float
        Above zero the wedge opens to the left, below zero to the right.
    """

    apex: float
    slope: float
    kind: ClassVar[str] = "wedge"
    rates: ClassVar[tuple[str, ...] | None] = ("apex",)

    @property
    def scale(self) -> float:
        return abs(self.apex)

    @property
    def ends(self) -> tuple[float, float]:
        return (-math.inf, self.apex) if self.slope > 0 else (self.apex, math.inf)

    def top(self, x: Array) -> Array:
        return np.asarray(np.maximum(self.slope * (self.apex - x), 0))

    def shrunk(self, share: float, within: Region | None, rate: float) -> Wedge:  # noqa: ARG002
        return Wedge(self.apex, self.slope * (1 - share))

    def in_differences(self, T: float) -> Wedge:
        return Wedge((self.apex - 1) / T, self.slope)

    def through(self, z: complex, begin: complex) -> Wedge:  # noqa: ARG002
        away = self.apex - z.real
        return Wedge(self.apex, z.imag / away or self.slope) if away else self

    @property
    def growing(self) -> tuple[str, ...]:
        return ("apex", "slope") if self.slope > 0 else ()

    def boundary(self, view: View) -> list[Curve]:
        # one curve through the apex, until it leaves the view
        end = view[0] if self.slope > 0 else view[1]
        far = min(abs(self.apex - end), view[2] / abs(self.slope))
        x = np.linspace(far, -far, POINTS)
        return [self.apex - math.copysign(1, self.slope) * np.abs(x) + 1j * abs(self.slope) * x]

    def distance(self, poles: Any) -> Array:
        z, s = np.asarray(poles), self.slope
        return np.asarray((s * (z.real - self.apex) + np.abs(z.imag)) / math.hypot(s, 1))


@dataclass(frozen=True)
class VerticalStrip(Region):
    """low < Re z < high [1/s]."""

    low: float
    high: float
    kind: ClassVar[str] = "vertical_strip"
    definite: ClassVar[bool] = True

    @property
    def scale(self) -> float:
        return max(abs(self.low), abs(self.high))

    @property
    def ends(self) -> tuple[float, float]:
        return self.low, self.high

    def top(self, x: Array) -> Array:
        return np.full(np.shape(x), np.inf)

    def through(self, z: complex, begin: complex) -> VerticalStrip:
        if abs(begin.real - self.low) < abs(begin.real - self.high):
            return VerticalStrip(z.real, self.high)
        return VerticalStrip(self.low, z.real)

    @property
    def growing(self) -> tuple[str, ...]:
        return ("high",)

    def boundary(self, view: View) -> list[Curve]:
        return [_vertical(self.low, view), _vertical(self.high, view)]

    def distance(self, poles: Any) -> Array:
        x = np.real(poles)
        return np.asarray(np.maximum(x - self.high, self.low - x))


@dataclass(frozen=True)
class HorizontalStrip(Region):
    """|Im z| < height [rad/s]: no faster oscillation."""

    height: float
    kind: ClassVar[str] = "horizontal_strip"
    definite: ClassVar[bool] = True

    @property
    def scale(self) -> float:
        return self.height

    @property
    def ends(self) -> tuple[float, float]:
        return -math.inf, math.inf

    def top(self, x: Array) -> Array:
        return np.full(np.shape(x), self.height)

    def through(self, z: complex, begin: complex) -> HorizontalStrip:  # noqa: ARG002
        return HorizontalStrip(z.imag)

    @property
    def highest(self) -> float:
        return self.height

    @property
    def growing(self) -> tuple[str, ...]:
        return ("height",)

    def boundary(self, view: View) -> list[Curve]:
        x = np.linspace(view[0], view[1], POINTS)
        return [np.asarray(x + 1j * y) for y in (self.height, -self.height)]

    def distance(self, poles: Any) -> Array:
        return np.asarray(np.abs(np.imag(poles)) - self.height)


@dataclass(frozen=True)
class Ellipse(Region):
    """((Re z - centre) / real)^2 + (Im z / imaginary)^2 < 1.

    Parameters
    ----------
    centre : float
        [1/s]; negative, or any where another part of the region lies in the left half-plane.
    real, imaginary : float
        Semi-axes, positive [1/s].
    """

    centre: float
    real: float
    imaginary: float
    kind: ClassVar[str] = "ellipse"
    definite: ClassVar[bool] = True

    @property
    def scale(self) -> float:
        return max(abs(self.centre), self.real, self.imaginary)

    @property
    def ends(self) -> tuple[float, float]:
        return self.centre - self.real, self.centre + self.real

    @property
    def half_axes(self) -> tuple[float, float]:
        return self.real, self.imaginary

    def top(self, x: Array) -> Array:
        return _arc(x, self.centre, self.real, self.imaginary)

    def shrunk(self, share: float, within: Region | None, rate: float) -> Ellipse:  # noqa: ARG002
        return Ellipse(self.centre, self.real * (1 - share), self.imaginary * (1 - share))

    def through(self, z: complex, begin: complex) -> Ellipse:  # noqa: ARG002
        size = math.hypot((z.real - self.centre) / self.real, z.imag / self.imaginary)
        return Ellipse(self.centre, size * self.real, size * self.imaginary)

    @property
    def highest(self) -> float:
        return self.imaginary

    @property
    def growing(self) -> tuple[str, ...]:
        return ("real", "imaginary")

    def boundary(self, view: View) -> list[Curve]:  # noqa: ARG002
        return [_around(self.centre, self.real, self.imaginary)]

    def distance(self, poles: Any) -> Array:
        """Signed, zero on the boundary; elsewhere no more than the distance."""
        z = np.asarray(poles) - self.centre
        level = np.hypot(z.real / self.real, z.imag / self.imaginary)
        return np.asarray((level - 1) * min(self.real, self.imaginary))


def _arc(x: Array, centre: float, real: float, imaginary: float) -> Array:
    """Return the upper half of an ellipse at real parts x."""
    share = (x - centre) / real
    return np.asarray(imaginary * np.sqrt(np.maximum((1 - share) * (1 + share), 0)))


def _around(centre: float, real: float, imaginary: float) -> Curve:
    """Return an ellipse."""
    angle = np.linspace(0, 2 * np.pi, POINTS)
    return np.asarray(centre + real * np.cos(angle) + 1j * imaginary * np.sin(angle))


def _vertical(x: float, view: View) -> Curve:
    return np.asarray(x + 1j * np.linspace(-view[2], view[2], POINTS))


def stable(step: float = 0.0) -> Region:
    """Return where the poles of stable loops lie; of a delta form (z - 1) / step, |z| < 1."""
    return Disk(-1 / step, 1 / step) if step else HalfPlane(0)


@dataclass(frozen=True)
class Intersection(Region):
    """Region in which all parts meet; written ``Disk(-40, 31) & Sector(0.3)``."""

    regions: tuple[Region, ...]
    kind: ClassVar[str] = "intersection"

    @explained_fields
    def __post_init__(self) -> None:
        unique = tuple(dict.fromkeys(part for region in self.regions for part in region.parts))
        if not unique:
            raise RegionError("an intersection needs at least one region")
        object.__setattr__(self, "regions", unique)

    @property
    def parts(self) -> tuple[Region, ...]:
        return self.regions

    @property
    def scale(self) -> float:
        return max(part.scale for part in self.parts)

    def pairs(self, rate: float = 1.0) -> tuple[Pair, ...]:
        return tuple(pair for part in self.parts for pair in part.pairs(rate))

    @property
    def ends(self) -> tuple[float, float]:
        low, high = zip(*(part.ends for part in self.parts), strict=True)
        return max(low), min(high)

    @property
    def bounds_speed(self) -> bool:
        return any(part.bounds_speed for part in self.parts)

    def top(self, x: Array) -> Array:
        return np.asarray(np.min([part.top(x) for part in self.parts], axis=0))

    def decay_rate(self, step: float = 0.0) -> float:
        return max(part.decay_rate(step) for part in self.parts)

    def distance(self, poles: Any) -> Array:
        """Distance to the boundary of the part that is violated most, or nearest."""
        return np.asarray(np.max([part.distance(poles) for part in self.parts], axis=0))

    def document(self) -> dict[str, Any]:
        return {"kind": self.kind, "parts": [part.document() for part in self.parts]}

    def __str__(self) -> str:
        return " & ".join(str(part) for part in self.parts)


def astray(region: Region) -> Region | None:
    """Return a disk or ellipse whose centre is not in the left half-plane, if no part is stable.

    None where there is no such part, or another part keeps the region in the left half-plane.
    """
    if region.stable:
        return None
    return next((part for part in region.parts if part.exact.fault_alone(discrete=False)), None)


def require_left(region: Region) -> Region:
    """Return a region that is one of continuous or of discrete time.

    Raises
    ------
    RegionError
        If a disk or an ellipse is about a point that is not in the left half-plane, where neither
        another part keeps it nor the disk lies in the unit disk.
    """
    part = astray(region)
    if part is None or part.discrete:
        return region
    discrete = ", nor the disk in the unit disk (disk(0.5, 0.4), discrete time)"
    raise RegionError(
        f"{part}: centre = {part.numbers['centre']:g} is not in the left half-plane (-40)"
        f"{discrete if part.circle else ''}; or add & half_plane(0)"
    )


CLASSES: dict[str, type[Region]] = {
    region.kind: region
    for region in (Disk, HalfPlane, Sector, Wedge, VerticalStrip, HorizontalStrip, Ellipse)
}


def region_of(parts: Sequence[tuple[str, Sequence[Any]]]) -> Region:
    """Return the region with these parts, each its kind and numbers as a design file has them.

    Raises
    ------
    RegionError
        If the numbers make no region.
    """
    regions = []
    for kind, numbers in parts:
        given = CLASSES[kind](*(float(v) for v in numbers[: len(fields(CLASSES[kind]))]))
        if [float(v) for v in numbers] != list(given.numbers.values()):
            raise RegionError(f"{kind}: its slope is not that of its damping ratio")
        regions.append(given)
    return regions[0] if len(regions) == 1 else Intersection(tuple(regions))


def slope_of(damping: float) -> float:
    """Return sqrt(1 - damping^2) / damping, rounded down so that damping^2 (1 + slope^2) <= 1."""
    return float(proof.slope_of(Fraction(damping)))


def damping_of(slope: float) -> float:
    """Return the damping ratio 1 / sqrt(1 + slope^2), whose own slope is at least this one."""
    damping = 1 / math.hypot(1, slope)
    while damping > 0 and slope_of(damping) < slope:
        damping = math.nextafter(damping, 0)
    return damping


def bounded(region: Region | None, fastest: float) -> Region:
    """Return the region cut by a disk of that reach that touches the imaginary axis.

    A region that bounds the speed of poles itself is returned as it is.
    """
    if region is not None and region.bounds_speed:
        return region
    # rounded, so that people can read it
    half = float(f"{fastest / 2:.2g}")
    disk = Disk(-half, half)
    return disk if region is None else region & disk
