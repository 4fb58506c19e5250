"""Laws of plants with a remainder: found for the combinations of the vertices, proved for all.

What a remainder costs is little beside what else limits a law. So the law is looked for without it,
of somewhat tighter requirements where those as they are leave no room for the proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from operator import and_

import numpy as np

from polefence.base.errors import NotProvedError
from polefence.certify.bounds import Bound, best_bound, kept_bound
from polefence.certify.candidates import Deadline
from polefence.certify.design import Design
from polefence.certify.evidence import certificate_of, evidence_at
from polefence.certify.given import analysed
from polefence.law.laws import Law
from polefence.lmi.conditions.methods import Method, Scheduled
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Disk, Region
from polefence.requirements.specification import Specification

# Shares by which requirements are asked for tighter than they are to be proved.
TIGHTER = (0.0, 1e-3, 1e-2, 5e-2)
# The same of limits, and the share of the plant's slowest rate at which laws decay that are only to
# be stable: another region leads to another law, of which there may be a proof. The first asks for
# no decay: around integrators it may cost what is minimised.
ATTEMPTS = ((1e-3, 0.0), (1e-3, 0.1), (1e-2, 0.4), (5e-2, 0.2), (5e-2, 0.5), (0.15, 0.4))
ENOUGH = 0.02  # a bound so close to that without the remainder needs no other law
SLOW = 1e-6  # of the fastest rate, what counts as none
SHARES = (0.9, 0.5, 0.1)  # of a disk, from the smallest up
# Of the way from a smallest radius to the unit circle: where laws are found, and proved besides.
FARTHER, WIDER = (0.0, 0.01, 0.03, 0.1, 0.3, 0.6), (1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3)
FORMS = ((0, 0), (1, 0))  # degree and elevation of Lyapunov polynomials of smallest disks


def on_the_box(plant: UncertainPlant, method: Method | None) -> Method | None:
    """Return the method that is meant by plain "scheduled", or none, of a plant with a curve.

    Its loop is to be a polynomial of the parameters.
    """
    if plant.curve_degree == 1 or not plant.parameters or method not in (None, "scheduled"):
        return method
    return Scheduled(1, 1, "box")


def decaying(plant: UncertainPlant, region: Region, share: float) -> Region:
    """Return a smaller region: a law on the edge of the one that is asked for has no proof.

    Stability alone is made a decay rate, a share of the plant's slowest; a decay rate grows by a
    quarter of the share, and other parts become as much smaller as `Region.tighter` makes them.
    """
    if not share:
        return region
    if region != Disk(0, 1) or plant.sample_time is None:
        parts = [
            Disk(0, part.circle[1] ** (1 + share / 4))
            if plant.sample_time is not None and part.circle and not part.circle[0]
            else part.tighter(share / 20)
            for part in region.parts
        ]
        return reduce(and_, parts)
    T = float(plant.sample_time)
    poles = np.abs(np.linalg.eigvals(plant.A))
    rates = -np.log(np.maximum(poles, np.finfo(float).tiny)) / T
    slowest = rates[rates > SLOW * rates.max()].min(initial=1 / T)
    return Disk(0, float(np.exp(-share * slowest * T)))


def kept_region(plant: UncertainPlant, law: Law, region: Region) -> Design | None:
    """Return the proof that a law keeps a region, None where there is none."""
    answer = analysed(plant, law, region, Deadline(None))
    return Design(answer.certificate) if answer.certificate is not None and answer.proved else None


def placed(
    plant: UncertainPlant,
    region: Region,
    design: Callable[[Region], Design],
    smallest: Callable[[float], Design],
) -> Design:
    """Return a law that keeps a region.

    Parameters
    ----------
    region : Region
        In the plant's kind of time.
    design : callable
        What finds a law for a region without the remainder.
    smallest : callable
        What finds one for the smallest disk about a centre.

    Raises
    ------
    NotProvedError
        If none is proved with it.
    """
    for own in _inside(region, smallest):
        try:
            law = design(own).law
        except NotProvedError:
            if own == region:
                raise
            break
        found = kept_region(plant, law, region)
        if found is not None:
            return found
    raise NotProvedError(
        f"not proved: the law keeps {region} for the interpolated samples of {plant.name}, but not "
        "within the interpolation-error bound; take a shorter sample time, or narrower ranges"
    )


def narrower(region: Region) -> tuple[Region, ...]:
    """Return regions inside one of the z-plane, the smallest last."""
    return tuple(region.tighter(share, Disk(0, 1)) for share in TIGHTER[1:])


def _inside(region: Region, smallest: Callable[[float], Design]) -> Iterator[Region]:
    """Yield a region, and smaller ones; of a disk down to the smallest that there is a law for."""
    yield region
    if region.circle is None:
        yield from narrower(region)
        return
    centre, radius = region.circle
    least = smallest(centre).region.size
    for share in SHARES:
        yield Disk(centre, least + share * (radius - least))


def tightened(
    plant: UncertainPlant, smallest: Design, design: Callable[[Region], Design]
) -> Design:
    """Return a law with the proof of the smallest disk that is found.

    Parameters
    ----------
    smallest : Design
        Of the smallest disk without the remainder.
    design : callable
        What finds a law for a disk without the remainder.

    Raises
    ------
    NotProvedError
        If none is proved.
    """
    least, best = smallest.region, None
    if least.circle is None:
        raise NotProvedError(f"not proved: {least} is not a disk")
    centre, radius = least.circle
    room = 1 - abs(centre) - radius  # up to the unit circle
    reached = np.inf
    for share in FARTHER:
        if share >= reached:
            break
        try:
            law = smallest.law if not share else design(Disk(centre, radius + share * room)).law
        except NotProvedError:  # a tuned one may be found of a wider disk
            continue
        for more in WIDER:
            if share + more >= min(reached, 1.0):
                break
            disk = Disk(centre, radius + (share + more) * room)
            found = _on_disk(plant, law, disk)
            if found is not None:
                best, reached = found, share + more
                break
    if best is None:
        raise NotProvedError(
            f"not proved: no disk about {centre:g} holds within the interpolation-error bound of "
            f"the samples of {plant.name}; take a shorter sample time, or narrower ranges"
        )
    return best


def _on_disk(plant: UncertainPlant, law: Law, disk: Disk) -> Design | None:
    """Return the proof of a disk with a Lyapunov polynomial of low degree, if there is one."""
    for form in FORMS:
        evidence = evidence_at(plant, law, disk, form)
        if evidence is not None:
            return Design(certificate_of(plant, law, disk, [evidence]))
    return None


def bounded(
    plant: UncertainPlant,
    law: Law,
    region: Region,
    minimise: Specification | None,
    limits: Sequence[Specification],
) -> tuple[Design, tuple[Bound, ...]] | None:
    """Return proofs of a region, of what is minimised, and of limits; None where one is missing."""
    design = kept_region(plant, law, region)
    if design is None:
        return None
    law = design.law
    first = None if minimise is None else best_bound(plant, law, minimise)
    if minimise is not None and first is None:
        return None
    kept = [kept_bound(plant, law, own) for own in limits]
    found = tuple(own for own in kept if own is not None)
    if len(found) < len(kept):
        return None
    return design, found if first is None else (first, *found)
