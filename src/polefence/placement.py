"""The orchestrator: plant, region and method in; a proved design out."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.conditions.methods import (
    Method,
    Scheduled,
    Slack,
    method_label,
    method_name,
    normal,
    options,
)
from polefence.conditions.target import FASTEST, Around, Decays, Goal, Sectors
from polefence.design import Design, rounded_up
from polefence.errors import InputError, NotProvedError, RegionError, SolverError
from polefence.plant.family import UncertainPlant
from polefence.polynomial import Domain
from polefence.proof.refute import unplaceable
from polefence.proof.repair import lower_bound
from polefence.region import Disk, HalfPlane, Region, Sector, check_centre, damping_of
from polefence.rounding import proved_at, rounded
from polefence.solve import bisection
from polefence.solve.found import Found
from polefence.solve.radius import smallest, smallest_radius, typical_rate

# How far above the radius that a point reaches in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4)

# A search that stopped before it converged, above this share of sigma, has a second opinion.
STALLED = 1e-3

# A lower bound farther off than this share of the radius is sought again, with this tolerance.
GAP, CLOSER = 3e-6, 1e-10

# How close a search for other regions than disks goes, until a point of it is proved.
TOLERANCES = (1e-10, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2)

# Where nothing near the infimum is proved: points for radii this much larger.
RETREATS = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0)

# How far inside a region a point is looked for first; then as far as the search goes.
INSIDE = (0.98, 0.0)

# Degree and elevation that "auto" tries, while there are at most so many unknowns.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1), (4, 0), (4, 1), (5, 1))
MOST_UNKNOWNS = 1500


def place(
    plant: UncertainPlant,
    region: Region,
    method: Method = "scheduled",
    allow_unproved: bool = False,
) -> Design:
    """Design a law that keeps all poles of the whole family in a region, and prove it.

    Parameters
    ----------
    plant : UncertainPlant
    region : Region
        `Disk`, `HalfPlane`, `Sector`, `VerticalStrip`, `HorizontalStrip`, `Ellipse`, or several
        joined by ``&``.
    method : str, Scheduled or Slack
        "quadratic" (Lemma 1), "slack" (Lemma 2), "scheduled" (Theorem 1).
    allow_unproved : bool
        Return the numerical answer even where its proof fails (``Design.proved`` tells).

    Raises
    ------
    NotProvedError
        If the region is not proved; for a disk, its ``best`` is the smallest disk of this centre
        that is.
    RegionError
        If the region does not fit the plant's time (continuous or discrete).
    UncontrollableError
        If a vertex is uncontrollable.
    """
    _require(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_domain(plant, method)
    _require(region, Region, "region", "for example polefence.Disk(-40, 31)")
    require_region(plant, region)
    plant.require_controllable()
    if isinstance(method, Scheduled) and method.degree == "auto":
        return _climb(plant, region, method)
    if not isinstance(region, Disk):
        return _placed(plant, region, method, allow_unproved)
    inside = _inside(plant, region, method)
    if inside is not None:
        return inside
    best = _tightest(plant, region.centre, method)[0]
    wider = replace(best.certificate, region=region)
    if radius_of(best) <= region.radius and wider.prove().proved:
        return Design(wider)
    if allow_unproved:
        return Design(wider, proved=False)
    raise NotProvedError(_refusal(method, region, best), best if best.proved else None)


def require_domain(plant: UncertainPlant, method: Method) -> None:
    """Refuse methods that there are not, and boxes where the plant has no parameters.

    Raises
    ------
    InputError
        Naming what is wrong.
    """
    method_name(method)
    if options(method).on == "box" and not plant.parameters:
        raise InputError(
            f"on = 'box' needs parameters; {plant.name} is given by its vertices, use on='simplex'"
        )


def radius_of(design: Design) -> float:
    """Return the radius of a design's disk."""
    return float(getattr(design.region, "radius", math.inf))


def _inside(plant: UncertainPlant, region: Disk, method: Method) -> Design | None:
    """Return a proved design for this disk, from the first point found inside it."""
    with suppress(SolverError):
        found = smallest_radius(plant.A, plant.B, region.sigma, method, enough=region.radius)
        return proved_at(plant, region, method, found) if found.radius <= region.radius else None
    return None


def _placed(plant: UncertainPlant, region: Region, method: Method, allow_unproved: bool) -> Design:
    """Place the poles in a region that is no single disk."""
    found = None
    for enough in INSIDE:
        try:
            found = smallest(plant.A, plant.B, Around(region), method, enough=enough)
        except SolverError as error:
            raise NotProvedError(f"undecided: {method_label(method)}: {error}") from error
        design = proved_at(plant, region, method, found) if found.radius < 1 else None
        if design is not None:
            return design
        if found.radius >= 1 and found.converged:
            break
    if allow_unproved and found is not None:
        return Design(rounded(plant, region, method, found), proved=False)
    raise NotProvedError(
        f"not proved: {method_label(method)} gives no proof for {region}; try a wider region, "
        "fewer parts, a higher degree or another method"
    )


def _climb(plant: UncertainPlant, region: Region, method: Scheduled) -> Design:
    """Raise degree and elevation until the region is proved, refuted, or the budget is spent."""
    begin, tried = time.perf_counter(), list[str]()
    best: Design | None = None
    refuted = unplaceable(plant, region, method.on)
    if refuted is not None:
        raise NotProvedError(f"refuted: {refuted}")
    for degree, elevation in LADDER:
        step = Scheduled(degree, elevation, method.on)
        domain_count = _unknowns(plant, step)
        spent = time.perf_counter() - begin
        if tried and (spent > method.budget or domain_count > MOST_UNKNOWNS):
            break
        tried.append(f"({degree}, {elevation})")
        try:
            return place(plant, region, step)
        except NotProvedError as answer:
            best = _better(best, answer.best)
    reached = f"; the smallest radius proved is {rounded_up(radius_of(best))}" if best else ""
    raise NotProvedError(
        f"undecided: not proved for {region} with degree and elevation {', '.join(tried)} within "
        f"the budget of {method.budget:g} s and {MOST_UNKNOWNS} unknowns{reached}",
        best,
    )


def _unknowns(plant: UncertainPlant, method: Scheduled) -> int:
    (n, m), domain = plant.shape, Domain.of(method.on, len(plant.vertices))
    return domain.count(int(method.degree)) * (n * (n + 1) // 2 + m * n)


def _better(best: Design | None, other: Design | None) -> Design | None:
    if best is None or other is None:
        return best or other
    return min(best, other, key=radius_of)


def require_region(plant: UncertainPlant, region: Region) -> None:
    """Refuse regions of the other kind of time."""
    disks = [part for part in region.parts if isinstance(part, Disk)]
    if plant.sample_time is None:
        for disk in disks:
            check_centre(disk.centre)
    elif len(disks) < len(region.parts) or not all(disk.discrete for disk in disks):
        raise RegionError(
            f"{region}: {plant.name} is a discrete-time plant; give a disk inside the unit circle, "
            "for example disk(0.5, 0.4)"
        )


def usable_centre(plant: UncertainPlant, centre: float) -> float:
    """Return the centre of disks for this plant as a float.

    Raises
    ------
    RegionError
        If it is not in the left half-plane, or for a discrete-time plant not in the unit circle.
    """
    if plant.sample_time is None:
        return check_centre(centre)
    if not Disk(centre, 1e-9).discrete:
        raise RegionError(f"centre = {centre:g} is not inside the unit circle; use one nearer to 0")
    return float(centre)


def _refusal(method: Method, region: Disk, best: Design) -> str:
    reached = (
        f"the smallest radius found there is {rounded_up(radius_of(best))} (proved)"
        if best.proved
        else "no radius was proved there"
    )
    label = method_label(method)
    if best.lower is not None and best.lower >= region.radius:
        answer = f"refuted for {label}: its inequalities have no solution for {region}"
    else:
        answer = f"not proved: {label} gives no proof for {region}"
    return f"{answer}; {reached}; try a larger disk or another method"


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
        radius is proved to be out of the method's reach. Otherwise ``design.region`` is the
        `HalfPlane` or `Sector`, with ``within``.

    Raises
    ------
    NotProvedError
        If none could be proved (the solver failed on this problem, or ``within`` is out of reach).
    UncontrollableError
        If a vertex is uncontrollable.
    """
    _require(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_domain(plant, method)
    if of not in ("disk", "half_plane", "sector"):
        raise InputError(f"of = {of!r} is unknown; use 'disk', 'half_plane' or 'sector'")
    if options(method).degree == "auto":
        raise InputError("degree = 'auto' is for place; give tightest a number")
    if of != "disk":
        return _tightest_other(plant, of, method, within, centre)
    if centre is None or within is not None:
        raise InputError("the smallest disk needs a centre, and takes no region within")
    centre = usable_centre(plant, centre)
    plant.require_controllable()
    best, _ = _tightest(plant, centre, method)
    if not best.proved and not allow_unproved:
        raise NotProvedError(
            f"undecided: {method_label(method)} at centre {centre:g} gave no point that could be "
            "proved; check the plant's units and try another centre"
        )
    return best


def _tightest_other(
    plant: UncertainPlant,
    of: str,
    method: Method,
    within: Region | None,
    centre: float | None,
) -> Design:
    """Return the design of the largest decay rate, or damping ratio."""
    if centre is not None:
        raise InputError(f"of = {of!r} has no centre; leave it out")
    if isinstance(options(method), Slack):
        raise InputError(f"of = {of!r} goes with the methods quadratic and scheduled")
    require_region(plant, HalfPlane(0) if within is None else HalfPlane(0) & within)
    plant.require_controllable()
    size = (within.scale if within else 0.0) or typical_rate(plant.A)
    goal: Goal = Decays(FASTEST * size, within) if of == "half_plane" else Sectors(size, within)
    base = within if of == "half_plane" else (HalfPlane(0) & within if within else HalfPlane(0))
    try:
        start = smallest(plant.A, plant.B, Around(base), method, enough=INSIDE[0]) if base else None
        if start is not None and start.radius >= 1:
            raise NotProvedError(f"not proved: {method_label(method)} gives no proof for {base}")
    except SolverError as error:
        raise NotProvedError(f"undecided: {method_label(method)}: {error}") from error
    near = None if start is None else replace(start, radius=0.0)
    # Nearer to the optimum a Lyapunov matrix may be too ill-conditioned to be proved in doubles.
    for tolerance in TOLERANCES:
        with suppress(SolverError):
            found = smallest(plant.A, plant.B, goal, method, near, tolerance=tolerance)
            for step in (*STEPS, 1e-3, 1e-2):
                region = _region_of(of, goal, found.radius * (1 + step), step)
                whole = region if within is None or region is None else region & within
                design = whole and proved_at(plant, whole, method, found)
                if design:
                    return design
    raise NotProvedError(f"undecided: {method_label(method)} gave no point that could be proved")


def _region_of(of: str, goal: Any, r: float, step: float) -> Region | None:
    if of == "half_plane":
        decay = goal.fastest - r
        return HalfPlane(decay - step * abs(decay))
    damping = damping_of(r)
    return Sector(damping) if 1e-8 <= damping < 1 else None


def _require(value: object, kind: type, name: str, remedy: str) -> None:
    if not isinstance(value, kind):
        given = type(value).__name__
        raise InputError(f"{name} must be of type {kind.__name__}, not {given}; {remedy}")


def tightest_near(
    plant: UncertainPlant, centre: float, method: Method, near: Found | None, bounds: bool = True
) -> tuple[Design, Found]:
    """`tightest`, started from a neighbouring centre's point; also the point for the next one.

    Raises
    ------
    NotProvedError
        If no radius could be proved.
    """
    best, found = _tightest(plant, centre, method, near, bounds)
    if not best.proved:
        raise NotProvedError(f"undecided: {method_label(method)} at centre {centre:g}")
    return best, found


def _tightest(
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
    design = _proved_near(plant, centre, method, found)
    for step in RETREATS if design is None else ():
        # The point lies too near the boundary for its rounding: look farther inside.
        disk = Disk(centre, found.radius * (1 + step))
        with suppress(SolverError):
            inner = smallest_radius(plant.A, plant.B, sigma, method, enough=disk.radius)
            design = _proved_near(plant, centre, method, inner)
        design = design or proved_at(plant, disk, method, found)
        if design is not None:
            break
    if design is None:
        try:
            unproved = rounded(plant, Disk(centre, found.radius), method, found)
        except SolverError as error:
            where = f"{method_label(method)} at centre {centre:g}"
            raise NotProvedError(f"undecided: {where}: {error}") from error
        return Design(unproved, proved=False), found
    return replace(design, lower=_bound(plant, sigma, method, found) if bounds else None), found


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


def _proved_near(
    plant: UncertainPlant, centre: float, method: Method, found: Found
) -> Design | None:
    for step in STEPS:
        design = proved_at(plant, Disk(centre, found.radius * (1 + step)), method, found)
        if design is not None:
            return design
    return None
