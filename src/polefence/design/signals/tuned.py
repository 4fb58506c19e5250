"""Laws of a structure that are searched directly, then proved as any law that is given.

A law at the edge of its limits has no proof: they are asked for somewhat tighter, and tighter still
where the law that is found has none. Of an input that is cut off, the search limits the peak that
it would have otherwise, to less and less. What is proved are limits and region as asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from polefence.base.errors import RegionError
from polefence.design.requirements.specification import Specification
from polefence.design.signals.search import Candidate, Task, candidate
from polefence.design.tune.dynamic import beside_filters, filtered, observers
from polefence.design.tune.search import Tuned, rough, tune
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Disk, Ellipse, HalfPlane, Region, Sector, Wedge, stable

# How much tighter limits and region are asked for than they are to be proved, one after the other.
TIGHTER = (5e-4, 3e-3, 2e-2)
MOVING = (8e-2, 0.25)  # then, where parameters move: the search looks at loops at rest
# How many times its limit an input that is cut off would go to, and in laws to start from.
BEYOND, BEGINNING = (np.inf, 4.0, 2.0, 1.0), 4.0
MOST = 3  # laws of one search that proofs are looked for
WORSE = 0.02  # than the best of its search, a law that proofs are still looked for


def tuned_candidates(
    task: Task, structure: Structure, starts: Sequence[Law] = ()
) -> Iterator[tuple[Candidate, Tuned]]:
    """Yield laws with proofs of region and limits, found for tighter and tighter requirements.

    With each comes what its search says of it.
    """
    asked_for = (*task.limits, *([task.minimise] if task.minimise else ()))
    cut_off = any(own.cut_off(task.plant) for own in asked_for)
    shares = (*TIGHTER, *MOVING) if task.plant.moving else TIGHTER
    for times, share in product(BEYOND if cut_off else (1.0,), shares):
        found = tune(task.plant, structure, *_asked(task, share, times), starts)
        for own in _promising(found):
            proved = candidate(task, own.law, task.region, estimate=own.level)
            if proved is not None:
                yield proved, own
        starts = (*starts, *(own.law for own in found[:1]))


def _promising(found: Sequence[Tuned]) -> Iterator[Tuned]:
    kept = [own for own in found if own.kept]
    for own in kept[:MOST]:
        if own.level <= kept[0].level * (1 + WORSE):
            yield own


def with_states(task: Task, structure: Structure, larger: UncertainPlant) -> Iterator[Law]:
    """Yield laws with states of their own, of limits that are somewhat tighter: to start from.

    The first is the best one without, so that nothing is lost by states.

    Parameters
    ----------
    task, structure : Task, Structure
        Of the law without its states.
    larger : UncertainPlant
        The plant with the law's states.
    """
    plant, order = task.plant, larger.shape[0] - task.plant.shape[0]
    asked = _asked(task, TIGHTER[0], BEGINNING)
    least, limits, region = asked
    for found in tune(plant, structure, *asked)[:1]:
        law = beside_filters(found.law, plant, larger, structure, task.region)
        yield from [law] if law is not None and found.kept else []
    own = replace(structure, order=order)
    yield from filtered(plant, own, *asked)
    whole = rough(plant, Structure(schedule=()), *asked)
    wanted = list(limits)
    if least is not None:
        most = None if whole is None else whole.level
        wanted.append(replace(least, at_most=most))
    known = () if whole is None else (whole.law,)
    yield from observers(plant, own, wanted, region, known)


def _asked(
    task: Task, share: float, times: float
) -> tuple[Specification | None, tuple[Specification, ...], Region]:
    """Return what is minimised in a search, its limits and its region, somewhat tighter."""
    least = None if task.minimise is None else next(iter(task.minimise.tuned(1.0)))
    limits = tuple(
        own if own.at_most is None else replace(own, at_most=own.at_most * (1 - share))
        for limit in task.limits
        for own in limit.tuned(times)
    )
    return least, limits, tighter(task.region, share, stable(float(task.plant.step)))


def tighter(region: Region, share: float, within: Region | None = None) -> Region:
    """Return a region within another, as much smaller as a share of its size says.

    Parameters
    ----------
    within : Region, optional
        Where loops are stable. Where that is a disk, a disk has the size of its distance from the
        edge, if that is less: of one with the same centre that is a decay rate.
    """
    kept: Region | None = None
    for part in region.parts:
        own = part
        try:
            if isinstance(part, Disk):
                size = part.radius
                if isinstance(within, Disk):
                    apart = abs(part.centre - within.centre)
                    size = max(min(size, within.radius - apart - size), 0.0)
                own = Disk(part.centre, part.radius - share * size)
            elif isinstance(part, HalfPlane):
                own = HalfPlane(part.decay + share * abs(part.decay))
            elif isinstance(part, Sector):
                own = Sector(part.damping + share * (1 - part.damping))
            elif isinstance(part, Wedge):
                own = Wedge(part.apex, part.slope * (1 - share))
            elif isinstance(part, Ellipse):
                radii = (part.real * (1 - share), part.imaginary * (1 - share))
                own = Ellipse(part.centre, *radii)
        except RegionError:  # none of that size
            own = part
        kept = own if kept is None else kept & own
    return region if kept is None else kept
