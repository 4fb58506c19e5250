"""State feedback for a region: plant, region and method in; a proved design out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

from polefence.base.deadline import Deadline
from polefence.base.errors import NotProvedError, SolverError
from polefence.base.types import require_type
from polefence.design.certificate import Certificate
from polefence.design.checks import (
    is_checkable,
    require_checkable,
    require_domain,
    require_movable,
    require_region,
)
from polefence.design.counterexample import unplaceable
from polefence.design.design import Design
from polefence.design.place.shipped import proved_at, radius_of, rounded, runnable
from polefence.design.place.tightest import smallest_disk
from polefence.lmi.conditions.methods import Method, Scheduled, degree_hint, method_label
from polefence.lmi.conditions.sizes import fitting
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.point import Found
from polefence.lmi.solve.radius import smallest, smallest_radius, typical_rate
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.region.regions import Disk, Region
from polefence.region.speed import bounded, bounds_speed
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
        search: _InDisk | _InRegion = _InDisk(plant, region, method)
    else:
        search = _InRegion(plant, region, method, [])
    design = runnable(search.designs(), radius_of)
    if design is not None:
        return design
    if allow_unproved:
        return search.unproved
    raise search.refusal()


@dataclass(frozen=True, eq=False)
class _InDisk:
    """A point inside a disk; where that has no proof, the smallest disk of the same centre."""

    plant: UncertainPlant
    region: Disk
    method: Method

    def designs(self) -> Iterator[Design | None]:
        """Yield what is proved for the disk."""
        plant, disk, method = self.plant, self.region, self.method
        with suppress(SolverError):
            found = smallest_radius(plant.A, plant.B, disk.sigma, method, enough=disk.radius)
            yield proved_at(plant, disk, method, found) if found.radius <= disk.radius else None
        if radius_of(self.best) <= disk.radius and self._wider.prove().proved:
            yield Design(self._wider)

    @cached_property
    def best(self) -> Design:
        """The smallest disk, proved or not."""
        return smallest_disk(self.plant, self.region.centre, self.method)[0]

    @property
    def _wider(self) -> Certificate:
        return replace(self.best.certificate, region=self.region)

    @property
    def unproved(self) -> Design:
        """The law of the smallest disk, as one for this disk."""
        return Design(self._wider, proved=False)

    def refusal(self) -> NotProvedError:
        """Return why nothing is proved, and what is."""
        best, label = self.best, method_label(self.method)
        reached = (
            f"the smallest radius found there is {digits_up(radius_of(best))} (proved)"
            if best.proved
            else "no radius was proved there"
        )
        if best.lower is not None and best.lower >= self.region.radius:
            answer = f"refuted for {label}: its inequalities have no solution for {self.region}"
        else:
            answer = f"not proved: {label} gives no proof for {self.region}"
        said = f"{answer}; {reached}; try a larger disk or another method"
        return NotProvedError(said, best if best.proved else None)


@dataclass(frozen=True, eq=False)
class _InRegion:
    """Points of a region that is no single disk, kept as they are found."""

    plant: UncertainPlant
    region: Region
    method: Method
    found: list[Found | SolverError]

    def designs(self) -> Iterator[Design | None]:
        """Yield what is proved for the region, from points well inside it and of slow poles on."""
        plant, region, method = self.plant, self.region, self.method
        rate = max(region.scale, typical_rate(plant.A))
        speeds = () if bounds_speed(region) else [s * rate for s in SPEEDS if s * rate < FASTEST]
        for searched in (*(bounded(region, speed) for speed in speeds), region):
            for enough in INSIDE:
                try:
                    found = smallest(plant.A, plant.B, Around(searched), method, enough=enough)
                except SolverError as failure:
                    self.found.append(failure)
                    break
                self.found.append(found)
                if found.radius < 1:
                    yield proved_at(plant, region, method, found)
                elif found.converged:
                    break

    @property
    def unproved(self) -> Design:
        """The law of the last point."""
        points = [found for found in self.found if isinstance(found, Found)]
        if not points:
            raise self.refusal()
        return Design(rounded(self.plant, self.region, self.method, points[-1]), proved=False)

    def refusal(self) -> NotProvedError:
        """Return why nothing is proved."""
        label = method_label(self.method)
        if all(isinstance(found, SolverError) for found in self.found):
            return NotProvedError(f"undecided: {label}: {self.found[-1]}")
        return NotProvedError(
            f"not proved: {label} gives no proof for {self.region}; try a wider region, "
            f"fewer parts{degree_hint(self.method)}"
        )


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
