"""Laws for a region alone: by an LMI, or tuned where a structure is asked for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial, reduce
from operator import and_
from typing import Any

from polefence.base import effort
from polefence.base.errors import InputError, NotProvedError, require_type
from polefence.base.explained import explained
from polefence.certify.checks import in_time_of, require_domain, require_moderate
from polefence.certify.design import Design
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method, Scheduled
from polefence.plant.family import UncertainPlant
from polefence.region.regions import HalfPlane, Region
from polefence.region.z_plane import MOST_DAMPING, z_plane
from polefence.search import by_lmi, estimated, structured
from polefence.search.driver import Kind, Source, kept, kept_simply, on_the_box, placed
from polefence.search.structured import Sought

DAMPINGS = 9  # halvings to the largest damping ratio in discrete time: to 0.002


@explained
def place(
    plant: UncertainPlant,
    region: Region,
    method: Method | None = None,
    allow_unproved: bool = False,
    *,
    structure: Structure | None = None,
    errors: Mapping[str, Any] | None = None,
) -> Design:
    """Design a law that keeps all poles of the whole family in a region, and prove it.

    Parameters
    ----------
    plant : UncertainPlant
    region : Region
        `Disk`, `HalfPlane`, `Sector`, `VerticalStrip`, `HorizontalStrip`, `Ellipse`, or several
        joined by ``&``.
    method : str, Scheduled or Slack, optional
        "quadratic" (Lemma 1), "slack" (Lemma 2), "scheduled" (Theorem 1, the default).
    allow_unproved : bool
        Return the numerical answer even where its proof fails (``Design.proved`` tells).
    structure : Structure, optional
        What the law may be, in place of a method: the smallest gain is searched, in typical units
        of signals and inputs. Where it has states of its own the answer's plant has them too.
    errors : mapping, optional
        Of a parameter's name to how far the estimate that the law is given of it may be off, in
        its unit: the region is kept for all such estimates.

    Raises
    ------
    NotProvedError
        If the region is not proved; for a disk, its ``best`` is the smallest disk of this centre
        that is.
    InputError
        If the structure does not fit the plant, or method and structure are both given.
    RegionError
        If the region does not fit the plant's time (continuous or discrete).
    UncontrollableError
        If a vertex has a pole that no gain moves and that is not in the region.
    """
    with effort.bounded(effort.MOST_WORK):
        return _place(plant, region, method, allow_unproved, structure, errors).checkable


def _place(
    plant: UncertainPlant,
    region: Region,
    method: Method | None = None,
    allow_unproved: bool = False,
    structure: Structure | None = None,
    errors: Mapping[str, Any] | None = None,
) -> Design:
    """Return what `place` does, before it is known that its file is proved."""
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_moderate(plant)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    region = in_time_of(plant, region)
    if errors:
        if structure is not None:
            raise InputError(
                "errors of estimates belong to laws that a method gives; leave them out, or the "
                "structure"
            )
        return placed(region, *estimated.sources(plant, region, method, errors))
    if structure is not None:
        require_structure_alone(method, allow_unproved)
    method = on_the_box(plant, method)
    if structure is None:
        require_domain(plant, method)
    if structure is None and isinstance(method, Scheduled) and method.degree == "auto":
        return by_lmi.climb(plant.combinations, region, method, partial(_place, plant, region))
    try:
        return placed(region, *_sources(plant, region, method, structure))
    except NotProvedError:
        if not allow_unproved:
            raise
        return by_lmi.unproved(plant, method, region)


def _sources(
    plant: UncertainPlant, region: Region, method: Method, structure: Structure | None
) -> list[Source]:
    """Return laws of the combinations of a plant's vertices, to be proved of the whole plant.

    Of a structure and a plant with a remainder one gain besides, which depends on it less.
    """
    bare = plant.combinations
    if structure is None:
        central = plant.remainder is not None
        return [_whole(plant, by_lmi.source(bare, method, region, central))]
    every = [structure]
    if plant.remainder is not None and structure.degree and structure.schedule != ():
        every.append(replace(structure, schedule=()))
    return [
        _whole(combination.extended(plant)[0], Sought.of(bare, combination, region).source)
        for combination in every
    ]


def _whole(plant: UncertainPlant, source: Source) -> Source:
    """Return a source of laws of a plant's combinations, which are proved of the whole plant."""
    if plant.remainder is None:
        return source
    return replace(
        source,
        plant=plant,
        certified=lambda point, region: kept(plant, point.law, region),
        refusal=lambda region: NotProvedError(
            f"not proved: the law keeps {region} for what is interpolated between the vertices of "
            f"{plant.name}, but not within the interpolation-error bound; take narrower ranges, or "
            "of samples a shorter sample time"
        ),
    )


@explained
def tightest(
    plant: UncertainPlant,
    centre: float | None = None,
    method: Method | None = None,
    allow_unproved: bool = False,
    *,
    of: str = "disk",
    within: Region | None = None,
    structure: Structure | None = None,
) -> Design:
    """Design for the smallest region of a kind, and prove it.

    Parameters
    ----------
    centre : float
        Real coordinate of a disk's centre, negative (-40) [1/s]; for a discrete-time plant inside
        the unit circle.
    method : str, Scheduled or Slack, optional
        As `place` has it.
    of : str
        "disk" about the centre; "half_plane", the largest decay rate; "sector", the largest
        damping ratio, in discrete time by a search to 0.002.
    within : Region, optional
        For "half_plane" and "sector" in continuous time: a fixed region to hold besides.
    structure : Structure, optional
        What the law may be, in place of a method.

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
    InputError
        If the structure does not fit the plant, or method and structure are both given.
    UncontrollableError
        If a vertex has a pole that no gain moves and that is not stable, or not in ``within``.
    """
    with effort.bounded(effort.MOST_WORK):
        kind = Kind(of, centre, within)
        return _tightest(plant, kind, method, allow_unproved, structure).checkable


def _tightest(
    plant: UncertainPlant,
    kind: Kind,
    method: Method | None = None,
    allow_unproved: bool = False,
    structure: Structure | None = None,
) -> Design:
    """Return what `tightest` does, before it is known that its file is proved."""
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_moderate(plant)
    kind.require()
    plant.require_on_time(
        "with which no smallest region is sought", "ask place or optimise for half_plane(a)"
    )
    if structure is not None:
        require_structure_alone(method, allow_unproved)
    if kind.centre is None and plant.sample_time is not None:
        if kind.within is not None:
            raise InputError(
                f"{plant.name} is in discrete time, where a {kind.of} has no region within"
            )
        search = _fastest if kind.of == "half_plane" else _most_damped
        return search(plant, method, structure)
    if plant.remainder is not None:
        return _with_remainder(plant, kind, method, structure)
    if structure is not None:
        return structured.tightest(plant, structure, kind)
    return by_lmi.tightest(plant, kind, method or "scheduled", proved=not allow_unproved)


def _fastest(plant: UncertainPlant, method: Method | None, structure: Structure | None) -> Design:
    """Return the law of the largest decay rate in discrete time: the smallest disk about zero."""
    design = _tightest(plant, Kind("disk", 0.0), method, structure=structure)
    radius, T = design.region.size, float(plant.sample_time or 1)
    for share in (1e-12, 1e-9, 1e-6, 1e-3):  # of which the image is no smaller than the disk
        asked = HalfPlane(max(-math.log(radius) / T * (1 - share), 0.0))
        if z_plane(asked, T).size >= radius:
            return replace(design, asked=asked, lower=None, unrunnable=None)
    return replace(design, asked=HalfPlane(0.0), lower=None, unrunnable=None)


def _most_damped(
    plant: UncertainPlant, method: Method | None, structure: Structure | None
) -> Design:
    """Return the law of the largest damping ratio whose polygon in the z-plane is proved."""

    def attempt(asked: Region) -> Design:
        return replace(_place(plant, asked, method, structure=structure), asked=asked)

    return Kind("sector").climbed(attempt, 0.0, MOST_DAMPING, halvings=DAMPINGS)


def _with_remainder(
    plant: UncertainPlant, kind: Kind, method: Method | None, structure: Structure | None
) -> Design:
    """Return the smallest disk that is proved of a plant with a remainder; one gain will do."""
    designs, failures = list[Design](), list[NotProvedError]()
    methods = (None,) if structure is not None else (on_the_box(plant, method), "quadratic")
    for chosen in dict.fromkeys(methods):
        try:
            smallest = _tightest(plant.combinations, kind, chosen, structure=structure)
            source = _sources(plant, smallest.region, chosen or "scheduled", structure)[0]
            simply = replace(source, certified=partial(kept_simply, source.plant))
            rest = smallest.region.parts[1:]
            inside = kind
            if kind.of != "disk" and rest:
                inside, simply = replace(kind, within=reduce(and_, rest)), source
            designs += filter(None, [inside.widened(simply, smallest)])
        except NotProvedError as error:
            failures.append(error)
    if not designs:
        raise next(iter(failures), None) or NotProvedError(
            f"not proved: no {kind.of} holds within the interpolation-error bound of {plant.name}; "
            "take narrower ranges, or of samples a shorter sample time"
        )
    return min(designs, key=kind.size)


def require_structure_alone(method: Method | None, allow_unproved: bool = False) -> None:
    """Refuse a method beside a structure.

    Raises
    ------
    InputError
        If there is one, or what goes with methods alone.
    """
    if method is not None or allow_unproved:
        raise InputError(
            "a method and allow_unproved belong to laws from an LMI; leave them out, or the "
            "structure"
        )
