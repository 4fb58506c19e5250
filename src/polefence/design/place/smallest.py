"""The smallest region of a kind that a method reaches: disk, decay rate, damping ratio."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

from polefence.base.errors import InputError, NotProvedError, SolverError
from polefence.base.types import require_type
from polefence.design.checks import (
    require_checkable,
    require_domain,
    require_movable,
    usable_centre,
)
from polefence.design.design import Design
from polefence.design.place.largest import STEPS, largest
from polefence.design.repair import lower_bound
from polefence.design.rounding import proved_at, rounded
from polefence.lmi.conditions.methods import Method, Scheduled, method_label, method_name, normal
from polefence.lmi.conditions.methods import options as options_of
from polefence.lmi.conditions.sizes import fitting
from polefence.lmi.solve import bisection
from polefence.lmi.solve.point import Found
from polefence.lmi.solve.radius import smallest_radius
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Disk, Region

# A search that stopped before it converged, above this share of sigma, has a second opinion.
STALLED = 1e-3

# A lower bound farther off than this share of the radius is sought again, with this tolerance.
GAP, CLOSER = 3e-6, 1e-10

# Where nothing near the infimum is proved, or no law that doubles can run: points for radii this
# much larger.
RETREATS = (1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 10.0, 100.0)


def tightest(
    plant: UncertainPlant,
    centre: float | None = None,
    method: Method = "scheduled",
    allow_unproved: bool = False,
    *,
    of: str = "disk",
    within: Region | None = None,
) -> Design:
    """Design for the smallest region of a kind that the method reaches, and prove it.

    Parameters
    ----------
    centre : float
        Real coordinate of a disk's centre, negative (-40) [1/s]; for a discrete-time plant inside
        the unit circle.
    of : str
        "disk" about the centre; "half_plane", the largest decay rate; "sector", the largest
        damping ratio.
    within : Region, optional
        For "half_plane" and "sector": a fixed region to hold besides.

    Returns
    -------
    Design
        For a disk ``design.region.radius`` is proved; where ``design.lower`` is not None, that
        radius is proved to be out of the method's reach, and where ``design.unrunnable`` is not, a
        smaller one is proved, but only of laws that doubles cannot evaluate. Otherwise
        ``design.region`` is the `HalfPlane` or `Sector`, with ``within``.

    Raises
    ------
    NotProvedError
        If none could be proved (the solver failed on this problem, or ``within`` is out of reach).
    UncontrollableError
        If a vertex has a pole that no gain moves and that is not stable, or not in ``within``.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_domain(plant, method)
    if of not in ("disk", "half_plane", "sector"):
        raise InputError(f"of = {of!r} is unknown; use 'disk', 'half_plane' or 'sector'")
    if options_of(method).degree == "auto":
        raise InputError("degree = 'auto' is for place; give tightest a number")
    method = fitting(plant, method)
    require_checkable(plant, method)
    if of != "disk":
        if centre is not None:
            raise InputError(f"of = {of!r} has no centre; leave it out")
        return largest(plant, of, method, within)
    if centre is None or within is not None:
        raise InputError("the smallest disk needs a centre, and takes no region within")
    centre = usable_centre(plant, centre)
    require_movable(plant)
    best, _ = smallest_disk(plant, centre, method)
    if not best.proved and not allow_unproved:
        raise NotProvedError(
            f"undecided: {method_label(method)} at centre {centre:g} gave no point that could be "
            "proved; check the plant's units and try another centre"
        )
    return best


def tightest_near(
    plant: UncertainPlant, centre: float, method: Method, near: Found | None, bounds: bool = True
) -> tuple[Design, Found]:
    """`tightest`, started from a neighbouring centre's point; also the point for the next one.

    Raises
    ------
    NotProvedError
        If no radius could be proved.
    """
    best, found = smallest_disk(plant, centre, method, near, bounds)
    if not best.proved:
        raise NotProvedError(f"undecided: {method_label(method)} at centre {centre:g}")
    return best, found


def smallest_disk(
    plant: UncertainPlant,
    centre: float,
    method: Method,
    near: Found | None = None,
    bounds: bool = True,
) -> tuple[Design, Found]:
    """Return the design of the smallest radius, ``proved`` or not, and its point."""
    sigma = -centre
    scale = sigma if sigma > 0 else 1.0
    try:
        found = smallest_radius(plant.A, plant.B, sigma, method, near)
    except SolverError as error:
        if sigma <= 0:
            raise NotProvedError(f"undecided: {method_label(method)}: {error}") from error
        found = _second_opinion(plant, centre, method)
    if sigma > 0 and not found.converged and found.radius > STALLED * scale:
        with suppress(NotProvedError):
            second = _second_opinion(plant, centre, method)
            found = second if second.radius < found.radius else found
    design, sharp = _chosen(_proved(plant, centre, method, found))
    if design is None:
        try:
            unproved = rounded(plant, Disk(centre, found.radius), method, found)
        except SolverError as error:
            where = f"{method_label(method)} at centre {centre:g}"
            raise NotProvedError(f"undecided: {where}: {error}") from error
        return Design(unproved, proved=False), found
    lower = _bound(plant, sigma, method, found) if bounds else None
    return replace(design, lower=lower, unrunnable=sharp), found


def _chosen(designs: Iterator[Design]) -> tuple[Design | None, float | None]:
    """Return the first design whose law doubles can run, else the first; and what it gives up.

    That is the radius of the first one, None where it is no smaller.
    """
    first = None
    for design in designs:
        first = first or design
        if design.runs:
            sharper = radius_of(first) < radius_of(design)
            return design, radius_of(first) if sharper else None
    return first, None


def _bound(plant: UncertainPlant, sigma: float, method: Method, found: Found) -> float | None:
    """Return a lower bound, from a closer run where the first one leaves a gap."""
    lower = _lower(plant, sigma, method, found)
    if found.radius > sigma or (lower is not None and lower > found.radius * (1 - GAP)):
        return lower
    with suppress(SolverError):
        closer = smallest_radius(plant.A, plant.B, sigma, method, found, tolerance=CLOSER)
        return max((b for b in (lower, _lower(plant, sigma, method, closer)) if b), default=None)
    return lower


def _second_opinion(plant: UncertainPlant, centre: float, method: Method) -> Found:
    try:
        return bisection.smallest_radius(plant.A, plant.B, -centre, method)
    except SolverError as error:
        where = f"{method_label(method)} at centre {centre:g}"
        raise NotProvedError(f"undecided: {where}: {error}") from error


def _lower(plant: UncertainPlant, sigma: float, method: Method, found: Found) -> float | None:
    """Return a radius proved infeasible for the method, None where no proof came of it."""
    rhs = isinstance(method, Scheduled) and method.right_hand_sides
    method = normal(method)
    if found.dual is None or not (isinstance(method, str) or rhs):
        return None
    A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    Y = found.dual.matrices()
    bound = lower_bound(method_name(method), A, B, Fraction(sigma), found.radius, Y, rhs)
    return None if bound is None else float(bound.r)


def _proved(plant: UncertainPlant, centre: float, method: Method, found: Found) -> Iterator[Design]:
    """Yield proved designs, from the point found outwards, roughly in the order of their radii."""
    near = _proved_near(plant, centre, method, found)
    if near is not None:
        yield near
    for step in RETREATS:
        # The point lies too near the boundary for rounding: look farther inside.
        disk, points = Disk(centre, found.radius * (1 + step)), [found]
        with suppress(SolverError):
            inner = smallest_radius(plant.A, plant.B, -centre, method, enough=disk.radius)
            near, points = _proved_near(plant, centre, method, inner), [inner, found]
            if near is not None:
                yield near
        for point in points:
            design = proved_at(plant, disk, method, point)
            if design is not None:
                yield design


def _proved_near(
    plant: UncertainPlant, centre: float, method: Method, found: Found
) -> Design | None:
    for step in STEPS:
        design = proved_at(plant, Disk(centre, found.radius * (1 + step)), method, found)
        if design is not None:
            return design
    return None


def radius_of(design: Design) -> float:
    """Return the radius of a design's disk."""
    return float(getattr(design.region, "radius", math.inf))
