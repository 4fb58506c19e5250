"""Laws for a region alone: by an LMI, or tuned where a structure is asked for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from polefence.base import effort
from polefence.base.errors import InputError, NotProvedError, RegionError, require_type
from polefence.base.explained import explained
from polefence.certify.checks import (
    in_time_of,
    require_movable,
    require_region,
    stable_region,
    usable_centre,
)
from polefence.certify.design import Design
from polefence.certify.given import analyse
from polefence.certify.measured import require_detectable
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method
from polefence.lmi.conditions.target import Decays, Disks, Goal, Sectors
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.delta import delta_form, sampled_form
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.region.regions import Disk, HalfPlane, Region, Sector, bounded, stable
from polefence.region.z_plane import MOST_DAMPING, delta_plane, z_plane
from polefence.response.closed import close
from polefence.search import estimated, nearby
from polefence.search import place as lmi
from polefence.search.tune.dynamic import observers
from polefence.search.tune.tuner import tune, tune_region
from polefence.search.tune.worth import NEAR

TIGHTER = (1e-3, 1e-2, 5e-2)  # shares by which a region is asked for smaller than it is to be
STEPS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # from the worst sample to what is to be proved
SLACKER = (2e-2, 4e-2, 8e-2)  # more, where doubles cannot run what is proved
NUMBERS = {"disk": "radius", "half_plane": "decay", "sector": "damping"}
SAMPLES = 500
SLOWER = 1e-12, 1e-9, 1e-6, 1e-3  # shares of a decay rate, for the rounding of its image
CLOSE = 2e-3  # how closely the largest damping ratio is found in discrete time


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
    if errors:
        if structure is not None:
            raise InputError(
                "errors of estimates belong to laws that a method gives; leave them out, or the "
                "structure"
            )
        remainder = getattr(plant, "remainder", None)
        more = () if remainder is None else nearby.narrower(in_time_of(plant, region))
        return estimated.placed(plant, region, method, errors, more)
    if getattr(plant, "remainder", None) is not None:
        bare = plant.combinations
        if structure is None:
            method = nearby.on_the_box(plant, method)
        if structure is None:
            return nearby.placed(
                plant,
                in_time_of(plant, region),
                lambda own: _place(bare, own, method),
                lambda centre: _tightest(bare, centre, method),
            )
        return _structured(plant, in_time_of(plant, region), structure)
    if structure is None:
        return lmi.place(plant, region, method or "scheduled", allow_unproved)
    require_structure_alone(method, allow_unproved)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    asked = region = in_time_of(plant, region)
    sought = _Sought.of(plant, structure, region)
    if plant.sample_time is not None:
        region = delta_plane(region, plant.sample_time)
    starts = sought.starts(region)
    for share in TIGHTER:
        inside = region.tighter(share, stable(float(sought.plant.step)))
        found = tune(sought.plant, sought.gain, None, (), inside, starts)
        for own in (own for own in found if own.kept):
            answer = analyse(sought.plant, own.law, region)
            if answer.certificate is not None and answer.proved:
                return as_sampled(Design(answer.certificate), asked)
        starts += [own.law for own in found[:1]]
        if effort.ended():
            break
    raise NotProvedError(
        f"no {sought} was found that is proved to keep all poles in {asked}{effort.stopped()}"
    )


def _structured(plant: UncertainPlant, region: Region, structure: Structure) -> Design:
    """Return a law of a structure for a plant with a remainder: one gain where no other is proved.

    What is scheduled is found for the combinations of the vertices; one gain depends on them less.
    """
    bare = plant.combinations

    def placed(own: Structure) -> Design:
        return nearby.placed(
            own.extended(plant)[0],
            region,
            lambda searched: _place(bare, searched, structure=own),
            lambda centre: _tightest(bare, centre, structure=own),
        )

    try:
        return placed(structure)
    except NotProvedError as problem:
        if structure.schedule == () or not structure.degree:
            raise
        with suppress(NotProvedError):
            return placed(replace(structure, schedule=()))
        raise problem


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
        return _tightest(plant, centre, method, allow_unproved, of, within, structure).checkable


def _tightest(
    plant: UncertainPlant,
    centre: float | None = None,
    method: Method | None = None,
    allow_unproved: bool = False,
    of: str = "disk",
    within: Region | None = None,
    structure: Structure | None = None,
) -> Design:
    """Return what `tightest` does, before it is known that its file is proved."""
    if of != "disk" and getattr(plant, "sample_time", None) is not None:
        lmi.require_kind(of)
        if within is not None or centre is not None:
            raise InputError(
                f"{plant.name} is in discrete time, where a {of} has no centre and no region within"
            )
        found = _fastest if of == "half_plane" else _most_damped
        return found(plant, method, structure)
    if getattr(plant, "remainder", None) is not None:
        return _tightest_nearby(plant, centre, method, of, within, structure)
    if structure is None:
        own = method or "scheduled"
        return lmi.tightest(plant, centre, own, allow_unproved, of=of, within=within)
    require_structure_alone(method, allow_unproved)
    lmi.require_kind(of)
    if (of == "disk") != (centre is not None) or (of == "disk" and within is not None):
        raise InputError("a disk needs a centre and takes no region within, others have no centre")
    sought, T = _Sought.of(plant, structure, within), plant.sample_time
    asked_centre, given = centre, within
    if of != "disk":
        within = bounded(within, lmi.SPEED * typical_rate(sought.plant.A))
    if centre is not None and T is not None:
        centre = (usable_centre(sampled_form(sought.plant), centre) - 1) / float(T)
    best = sought.tightest(of, centre, within, sought.starts(within))
    if structure.order:  # more states are more room, and more places to get stuck
        lower = replace(structure, order=structure.order - 1)
        with suppress(NotProvedError):
            below = _tightest(plant, asked_centre, None, of=of, within=given, structure=lower)
            best = _better(below, best, of)
    if best is None:
        raise NotProvedError(f"no {sought} with a proved {of} was found{effort.stopped()}")
    return best


def _better(below: Design, found: Design | None, of: str) -> Design:
    """Return the design of the higher order where it is better by a thousandth."""
    if found is None:
        return below
    one, other = (own.region.parts[0].numbers[NUMBERS[of]] for own in (below, found))
    gain = one - other if of == "disk" else other - one
    return found if gain > NEAR * abs(one) else below


def _fastest(plant: UncertainPlant, method: Method | None, structure: Structure | None) -> Design:
    """Return the law of the largest decay rate in discrete time: the smallest disk about zero."""
    design, T = _tightest(plant, 0.0, method, structure=structure), float(plant.sample_time or 1)
    radius = design.region.size
    for share in SLOWER:  # of which the image is no smaller than the disk
        asked = HalfPlane(max(-math.log(radius) / T * (1 - share), 0.0))
        if z_plane(asked, T).size >= radius:
            return replace(design, asked=asked, lower=None, unrunnable=None)
    return replace(design, asked=HalfPlane(0.0), lower=None, unrunnable=None)


def _most_damped(
    plant: UncertainPlant, method: Method | None, structure: Structure | None
) -> Design:
    """Return the law of the largest damping ratio whose polygon in the z-plane is proved."""
    best: Design | None = None
    low, high = 0.0, MOST_DAMPING
    failure = NotProvedError("not proved: no positive damping ratio could be proved")
    while high - low > CLOSE:
        middle = (low + high) / 2
        try:
            found = _place(plant, Sector(middle), method, structure=structure)
            best, low = replace(found, asked=Sector(middle)), middle
        except NotProvedError as error:
            failure, high = error, middle
    if best is None:
        raise failure
    return best


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


def _tightest_nearby(
    plant: UncertainPlant,
    centre: float | None,
    method: Method | None,
    of: str,
    within: Region | None,
    structure: Structure | None,
) -> Design:
    """Return the smallest disk that is proved of a plant with a remainder; one gain will do."""
    bare, best = plant.combinations, None
    larger = plant if structure is None else structure.extended(plant)[0]
    failure: NotProvedError | None = None
    plain = "quadratic" if structure is None else None
    method = method if structure is not None else nearby.on_the_box(plant, method)
    for each in dict.fromkeys((method, plain)):
        try:
            found = _tightest(bare, centre, each, of=of, within=within, structure=structure)
            own = nearby.tightened(
                larger, found, partial(_place, bare, method=each, structure=structure)
            )
        except NotProvedError as error:
            failure = failure or error
            continue
        if best is None or own.region.size < best.region.size:
            best = own
    if best is None:
        raise failure or NotProvedError("not proved")
    return best


@dataclass(frozen=True, eq=False)
class _Sought:
    """A law of a structure that is sought, of a plant in its delta form.

    Attributes
    ----------
    bare : UncertainPlant
        Without the law's own states.
    structure : Structure
    plant : UncertainPlant
        With them: the law is a gain of it.
    gain : Structure
        That gain's.
    """

    bare: UncertainPlant
    structure: Structure
    plant: UncertainPlant
    gain: Structure

    @classmethod
    def of(cls, plant: UncertainPlant, structure: Structure, region: Region | None) -> _Sought:
        """Return it; refuse a plant, a structure and a region that do not fit."""
        require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
        structure.require_fit(plant)
        require_region(plant, stable_region(plant) if region is None else region)
        require_movable(plant, region)
        require_detectable(plant, structure.outputs(plant), region)
        larger, gain = structure.extended(plant)
        return cls(delta_form(plant), structure, delta_form(larger), gain)

    def __str__(self) -> str:
        return self.gain.words(self.plant)

    def starts(self, region: Region | None) -> list[Law]:
        """Return laws from which a search for a region of the delta form begins."""
        return list(observers(self.bare, self.structure, (), region))

    def tightest(
        self, of: str, centre: float | None, within: Region | None, starts: list[Law]
    ) -> Design | None:
        """Return the smallest region of a kind that is proved, of the plant in its own time."""
        step = float(self.plant.step)
        for share in (0.0, *TIGHTER) if within is not None else (0.0,):
            goal = _goal(of, centre, None if within is None else within.tighter(share), step)
            tuned = tune_region(self.plant, self.gain, goal, (), starts)
            kept = [own.law for own in tuned if own.kept]
            for law in kept:
                design = _proved(self.plant, law, of, centre, within)
                if design is not None:
                    return _of_samples(design, step) if step else design
            if not kept or effort.ended():
                break
            starts = [*starts, *kept[:1]]
        return None


def as_sampled(design: Design, region: Region) -> Design:
    """Return a design that was found in the delta form as one of the plant in discrete time.

    Parameters
    ----------
    region : Region
        What was asked for, in the z-plane.

    Raises
    ------
    NotProvedError
        If a rounding of the region leaves no proof.
    """
    if not design.plant.step:
        return design
    plant = sampled_form(design.plant)
    certificate = replace(design.certificate, plant=plant, region=region)
    if certificate.holds():
        return Design(certificate)
    answer = analyse(plant, design.law, region)
    if answer.certificate is None or not answer.proved:
        raise NotProvedError(
            f"not proved: the law keeps {region} in the delta form, without a proof in the z-plane"
        )
    return Design(answer.certificate)


def _of_samples(design: Design, T: float) -> Design:
    """Return the design for the smallest disk as one of the plant in discrete time."""
    if design.region.circle is None:
        raise InputError(f"{design.region} is not a disk")
    centre, radius = design.region.circle
    for step in (0.0, *STEPS):
        with suppress(NotProvedError, RegionError):
            return as_sampled(design, Disk(1 + T * centre, T * radius * (1 + step)))
    raise NotProvedError(f"not proved: {design.region} of the delta form in the z-plane")


def _goal(of: str, centre: float | None, within: Region | None, step: float) -> Goal:
    if centre is not None:  # in discrete time, beyond that of the disk that touches the circle
        return Disks(centre, 1 / step - abs(centre + 1 / step) if step else 0.0)
    return Decays(0.0, within) if of == "half_plane" else Sectors(1.0, within)


def _proved(
    plant: UncertainPlant, law: Law, of: str, centre: float | None, within: Region | None
) -> Design | None:
    """Return the smallest region that is proved of a law, None where none near the worst is."""
    poles = close(plant, law, seeded(plant, SAMPLES), disturbed=False).poles()
    first: Design | None = None
    for step in (*STEPS, *SLACKER):
        if first is None and step in SLACKER:
            break
        region = _region_of(of, centre, poles, step)
        answer = analyse(plant, law, region if within is None else region & within)
        if answer.certificate is None or not answer.proved:
            continue
        design = Design(answer.certificate)
        if design.runs:
            best = None if first is None else first.region.parts[0].numbers[NUMBERS[of]]
            return replace(design, unrunnable=best)
        first = first or design
    return first


def _region_of(of: str, centre: float | None, poles: np.ndarray, step: float) -> Region:
    """Return the smallest region of a kind that has all poles, a little wider."""
    if centre is not None:
        return Disk(centre, float(np.abs(poles - centre).max()) * (1 + step))
    if of == "half_plane":
        decay = -float(poles.real.max())
        return HalfPlane(decay - step * max(abs(decay), 1e-3))
    damping = float((-poles.real / np.abs(poles)).min())
    return Sector(max(damping, 0.0) * (1 - step))
