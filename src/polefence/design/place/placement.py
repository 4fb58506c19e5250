"""State feedback for a region: plant, region and method in; a proved design out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from polefence.base.errors import NotProvedError, SolverError, require_type
from polefence.design.checks import (
    is_checkable,
    require_checkable,
    require_domain,
    require_movable,
    require_region,
)
from polefence.design.counterexample import unplaceable
from polefence.design.design import Design
from polefence.design.place.tightest import proved_at, radius_of, rounded, runnable, smallest_disk
from polefence.design.search import Deadline
from polefence.lmi.conditions.methods import Method, Scheduled, degree_hint, fitting, method_label
from polefence.lmi.conditions.target import Around, Disks
from polefence.lmi.solve.search import Reached
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.region.regions import Disk, Region, bounded, bounds_speed
from polefence.region.text import digits_up

# How far inside a region a point is looked for first; then as far as the search goes.
INSIDE = (0.98, 0.0)

# Where nothing bounds the poles' speed: multiples of the rates of region and plant that bound it in
# the search, one after the other.
SPEEDS = (10.0, 100.0, 1000.0)
FASTEST = 1e99  # [1/s], of regions

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
        If a vertex has a pole that no gain moves and that is not in the region.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_domain(plant, method)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    require_region(plant, region, method)
    require_movable(plant, region)
    if isinstance(method, Scheduled) and method.degree == "auto":
        return _climb(plant, region, method)
    method = fitting(plant, method)
    require_checkable(plant, method, len(region.parts))
    if isinstance(region, Disk):
        return _in_disk(plant, region, method, allow_unproved)
    return _in_region(plant, region, method, allow_unproved)


def _in_disk(plant: UncertainPlant, disk: Disk, method: Method, allow_unproved: bool) -> Design:
    """Place the poles by a point inside a disk, or by the smallest disk of the same centre."""
    inside: Design | None = None
    with suppress(SolverError):
        found = smallest(plant.A, plant.B, Disks(disk.centre), method, enough=disk.radius)
        if found.r <= disk.radius:
            inside = proved_at(plant, disk, method, found)
    if inside is not None and inside.runs:
        return inside
    best = smallest_disk(plant, disk.centre, method)[0]
    wider = replace(best.certificate, region=disk)
    holds = radius_of(best) <= disk.radius and wider.prove().proved
    design = runnable((inside, Design(wider) if holds else None), radius_of)
    if design is not None:
        return design
    if allow_unproved:
        return Design(wider, proved=False)
    raise NotProvedError(_refusal(method, disk, best), best if best.proved else None)


def _refusal(method: Method, region: Disk, best: Design) -> str:
    reached = (
        f"the smallest radius found there is {digits_up(radius_of(best))} (proved)"
        if best.proved
        else "no radius was proved there"
    )
    label = method_label(method)
    if best.lower is not None and best.lower >= region.radius:
        answer = f"refuted for {label}: its inequalities have no solution for {region}"
    else:
        answer = f"not proved: {label} gives no proof for {region}"
    return f"{answer}; {reached}; try a larger disk or another method"


def _in_region(
    plant: UncertainPlant, region: Region, method: Method, allow_unproved: bool
) -> Design:
    """Place the poles in a region that is no single disk."""
    label, found = method_label(method), list[Reached]()
    points = _points(plant, region, method, found)
    try:
        design = runnable((proved_at(plant, region, method, point) for point in points), radius_of)
    except SolverError as error:
        raise NotProvedError(f"undecided: {label}: {error}") from error
    if design is not None:
        return design
    if allow_unproved:
        return Design(rounded(plant, region, method, found[-1]), proved=False)
    raise NotProvedError(
        f"not proved: {label} gives no proof for {region}; try a wider region, "
        f"fewer parts{degree_hint(method)}"
    )


def _points(
    plant: UncertainPlant, region: Region, method: Method, found: list[Reached]
) -> Iterator[Reached]:
    """Yield points of a region, of slow poles and well inside it first; ``found`` has all of them.

    Raises
    ------
    SolverError
        If there is none at all.
    """
    failure: SolverError | None = None
    rate = max(region.scale, typical_rate(plant.A))
    speeds = () if bounds_speed(region) else [s * rate for s in SPEEDS if s * rate < FASTEST]
    for searched in (*(bounded(region, speed) for speed in speeds), region):
        for enough in INSIDE:
            try:
                point = smallest(plant.A, plant.B, Around(searched), method, enough=enough)
            except SolverError as error:
                failure = error
                break
            found.append(point)
            if point.r < 1:
                yield point
            elif point.converged:
                break
    if failure is not None and not found:
        raise failure


def _climb(plant: UncertainPlant, region: Region, method: Scheduled) -> Design:
    """Raise degree and elevation until the region is proved, refuted, or too much work."""
    tried, why = list[str](), "the last that is tried"
    deadline = Deadline(method.budget)
    best: Design | None = None
    refuted = unplaceable(plant, region, method.on)
    if refuted is not None:
        raise NotProvedError(f"refuted: {refuted}")
    for degree, elevation in LADDER:
        step = Scheduled(degree, elevation, method.on)
        domain_count = _unknowns(plant, step)
        if tried and deadline.passed:
            why = str(deadline)
            break
        checkable = is_checkable(plant, step, len(region.parts))
        if not checkable or (tried and domain_count > MOST_UNKNOWNS):
            why = (
                "a higher degree is too much to check"
                if tried
                else "this plant is too large to check"
            )
            break
        tried.append(f"({degree}, {elevation})")
        try:
            return place(plant, region, step)
        except NotProvedError as answer:
            best = _better(best, answer.best)
    reached = f"; the smallest radius proved is {digits_up(radius_of(best))}" if best else ""
    raise NotProvedError(
        f"undecided: not proved for {region} with degree and elevation {', '.join(tried)}; {why}"
        f"{reached}",
        best,
    )


def _unknowns(plant: UncertainPlant, method: Scheduled) -> int:
    (n, m), domain = plant.shape, Domain.of(method.on, len(plant.vertices))
    return domain.count(int(method.degree)) * (n * (n + 1) // 2 + m * n)


def _better(best: Design | None, other: Design | None) -> Design | None:
    if best is None or other is None:
        return best or other
    return min(best, other, key=radius_of)
