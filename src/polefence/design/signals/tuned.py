"""Laws of a structure that are searched directly, then proved as any law that is given.

A law at the edge of its limits has no proof: they are asked for somewhat tighter, and tighter still
where the law that is found has none. What is proved are limits and region as they were asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from polefence.base.errors import RegionError
from polefence.design.requirements.specification import Specification
from polefence.design.signals.search import Candidate, Task, candidate
from polefence.design.tune.dynamic import filtered as filters
from polefence.design.tune.search import Tuned, tune
from polefence.law.laws import FixedGain, Law, PolynomialGain
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import padded, states
from polefence.plant.system import Array
from polefence.region.regions import Disk, Ellipse, HalfPlane, Region, Sector

# How much tighter limits and region are asked for than they are to be proved, one after the other.
TIGHTER = (5e-4, 3e-3, 2e-2)
MOST = 3  # laws of one search that proofs are looked for
WORSE = 0.02  # than the best of its search, a law that proofs are still looked for


def tuned_candidates(
    task: Task, structure: Structure, starts: Sequence[Law] = ()
) -> Iterator[tuple[Candidate, str]]:
    """Yield laws with proofs of region and limits, from tighter and tighter requirements.

    Beside each stands what stopped its gain from growing further; nothing where nothing had to.
    """
    for share in TIGHTER:
        asked = task.minimise, _tighter(task, share), tighter(task.region, share)
        found = tune(task.plant, structure, *asked, starts)
        for own in _promising(found):
            proved = candidate(task, own.law, task.region, estimate=own.level)
            if proved is not None:
                yield proved, own.bounded_by
        starts = (*starts, *(own.law for own in found[:1]))


def _promising(found: Sequence[Tuned]) -> Iterator[Tuned]:
    kept = [own for own in found if own.kept]
    for own in kept[:MOST]:
        if own.level <= kept[0].level * (1 + WORSE):
            yield own


def with_filters(
    law: Law, plant: UncertainPlant, larger: UncertainPlant, structure: Structure, region: Region
) -> Law | None:
    """Return a law as one of a plant that has states of the law's own, which filter what it sees.

    They follow the signals y, each at a rate of its own, and are not fed back: the loop is as it
    was, and what feeding them back would bring has a slope. None where a law in alpha has terms
    that this cannot be written in.

    Parameters
    ----------
    structure : Structure
        That of the law, without states.
    region : Region
        Where the filters' poles are to be.
    """
    k, (m, n), names = larger.shape[0] - plant.shape[0], plant.shape[::-1], states(larger)
    y = structure.outputs(plant)
    rates = _rates(plant, region, k)
    if isinstance(law, FixedGain):
        C = np.array([[float(x) for x in own.C[0]] for own in y])
        gains = np.zeros((1, m + k, n + k))
        gains[0, :m, :n] = law.K
        gains[0, m:, :n] = rates[:, None] * C[np.arange(k) % len(C)]
        gains[0, m:, n:] = -np.diag(rates)
        return FixedGain(gains[0])
    if not isinstance(law, PolynomialGain) or (not law.parameters and law.degree > 1):
        return None
    r = law.gains.shape[2]
    gains = np.zeros((len(law.gains), m + k, r + k))
    gains[:, :m, :r] = law.gains
    whole = [e for e in law.powers if not any(e)] or law.powers  # alpha sums to one
    for j in (law.powers.index(e) for e in whole):
        gains[j, m + np.arange(k), np.arange(k) % r] = rates
        gains[j, m:, r:] = -np.diag(rates)
    measured = (*(padded(own, k) for own in law.measured or states(plant)), *names[n:])
    return PolynomialGain(law.powers, gains, measured, law.parameters)


def filtered(task: Task, structure: Structure) -> tuple[PolynomialGain, ...]:
    """Return laws whose states are filters of signals, within limits that are somewhat tighter."""
    region = tighter(task.region, TIGHTER[0])
    return filters(task.plant, structure, task.minimise, _tighter(task, TIGHTER[0]), region)


def _tighter(task: Task, share: float) -> tuple[Specification, ...]:
    return tuple(
        own if own.at_most is None else replace(own, at_most=own.at_most * (1 - share))
        for own in task.limits
    )


def _rates(plant: UncertainPlant, region: Region, count: int) -> Array:
    """Return speeds of filters whose poles lie in the region, about those of the plant."""
    speeds = np.abs(np.linalg.eigvals(plant.A)).ravel()
    speeds = speeds[speeds > 1e-3 * speeds.max()] if speeds.max() > 0 else np.ones(1)
    tried = np.geomspace(speeds.min() / 4, speeds.max() * 4, 200)
    tried = np.append(tried, [-own.centre for own in region.parts if isinstance(own, Disk)])
    inside = np.sort(tried[region.distance(-tried + 0j) < 0])
    if not len(inside):
        inside = np.array([float(speeds.mean())])
    places = np.linspace(0, len(inside) - 1, count + 2)[1:-1]
    return np.asarray(inside[places.round().astype(int)])


def tighter(region: Region, share: float) -> Region:
    """Return a region within another, as much smaller as a share of its size says."""
    kept: Region | None = None
    for part in region.parts:
        own = part
        try:
            if isinstance(part, Disk):
                own = Disk(part.centre, part.radius * (1 - share))
            elif isinstance(part, HalfPlane):
                own = HalfPlane(part.decay + share * abs(part.decay))
            elif isinstance(part, Sector):
                own = Sector(part.damping + share * (1 - part.damping))
            elif isinstance(part, Ellipse):
                radii = (part.real * (1 - share), part.imaginary * (1 - share))
                own = Ellipse(part.centre, *radii)
        except RegionError:  # none of that size
            own = part
        kept = own if kept is None else kept & own
    return region if kept is None else kept
