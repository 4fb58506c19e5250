"""Disks for many plants or centres: laws for one disk, or for the smallest, worked out together.

What goes as it mostly does is worked out for all of one shape at once and proved one by one; the
rest, and what is refused, alone, by `polefence.search.place`. The answers are the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import PolefenceError
from polefence.certify.checks import is_checkable, usable_centre
from polefence.certify.design import Design
from polefence.certify.evaluation import surely_run
from polefence.certify.lower_bound import is_there, lower_radii
from polefence.lmi.conditions.methods import Method, fitting, normal, step_work
from polefence.lmi.solve.many import smallest_disks
from polefence.lmi.solve.search import Reached
from polefence.lmi.solve.stacked import MOST_VERTICES
from polefence.plant.controllability import surely_controllable
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Disk
from polefence.search import place

# Those that are worked out together: at most so many, of about so many multiplications where a
# search takes so many steps; and so few that there are some such parts for processors to share.
MOST, WORK, STEPS, PARTS = 32, 1e9, 25, 8


@dataclass(frozen=True, eq=False)
class Asked:
    """A plant, and what disk: ``region``, or the smallest about ``centre``."""

    plant: UncertainPlant
    centre: float
    method: Method
    region: Disk | None = None


def parts(asked: Sequence[Asked]) -> list[list[int]]:
    """Return which to work out together; it depends on them alone, so that the answers do too."""
    most = max(1, min(MOST, len(asked) // PARTS))
    sizes: dict[Any, int] = {}
    begun: dict[Any, list[int]] = {}
    found: list[list[int]] = []
    for k, own in enumerate(asked):
        kind = _kind(own)
        if kind not in begun or len(begun[kind]) == sizes[kind]:
            size = 1 if kind is None else int(WORK / STEPS / step_work(own.plant, own.method))
            begun[kind], sizes[kind] = [], max(1, min(most, size))
            found.append(begun[kind])
        begun[kind].append(k)
    return found


def answers(asked: Sequence[Asked], bounds: bool = True) -> list[Design | PolefenceError]:
    """Return the design of each, or why there is none; of smallest disks with lower bounds."""
    found = dict[int, Design | PolefenceError]()
    for name, numbers in _groups(asked):
        own = [asked[k] for k in numbers]
        for k, design in zip(numbers, _together(own, name, bounds), strict=True):
            if design is not None:
                found[k] = design
    each = (found[k] if k in found else _alone(own, bounds) for k, own in enumerate(asked))
    return [_checkable(own) for own in each]


def _checkable(design: Design | PolefenceError) -> Design | PolefenceError:
    """Return an answer; of a design whose file would not be proved, why not."""
    try:
        return design.checkable if isinstance(design, Design) else design
    except PolefenceError as error:
        return error


def _alone(asked: Asked, bounds: bool) -> Design | PolefenceError:
    try:
        if asked.region is not None:
            return place.place(asked.plant, asked.region, asked.method)
        return place.tightest(asked.plant, asked.centre, asked.method, bounds=bounds)
    except PolefenceError as error:
        return error


def _kind(asked: Asked) -> tuple[Any, ...] | None:
    """Return what those that are worked out together have in common."""
    plant, method = asked.plant, asked.method
    plain = isinstance(plant, UncertainPlant) and plant.sample_time is None
    if not plain or not isinstance(normal(method), str):
        return None
    return normal(method), plant.shape, len(plant.vertices), len(plant.parameters)


def _groups(asked: Sequence[Asked]) -> Iterator[tuple[str, list[int]]]:
    """Yield a method's name, and which by it are worked out together."""
    alike: dict[tuple[Any, ...], list[int]] = {}
    for k, own in enumerate(asked):
        kind = _kind(own)
        if kind is not None and _is_usable(own):
            alike.setdefault(kind, []).append(k)
    for numbers in alike.values():
        name = _name(asked[numbers[0]])
        if name is None:
            continue
        n = asked[numbers[0]].plant.shape[0]
        pairs = np.array([asked[k].plant.residues for k in numbers])
        movable = surely_controllable(pairs[..., :n], pairs[..., n:])
        kept = [k for k, own in zip(numbers, movable, strict=True) if own.all()]
        if kept:
            yield name, kept


def _name(asked: Asked) -> str | None:
    """Return the name of a method whose inequalities are worked out for many plants at once."""
    plant = asked.plant
    own = normal(fitting(plant, asked.method))
    many = isinstance(own, str) and len(plant.vertices) <= MOST_VERTICES
    return str(own) if many and is_checkable(plant, own) else None


def _is_usable(asked: Asked) -> bool:
    try:
        usable_centre(asked.plant, asked.centre)
    except PolefenceError:
        return False
    return True


def _together(asked: list[Asked], name: str, bounds: bool) -> list[Design | None]:
    """Return the designs for plants of one shape; None where there is more to do."""
    A, B = (np.array([getattr(own.plant, matrix) for own in asked]) for matrix in ("A", "B"))
    sigma = np.array([-float(own.centre) for own in asked])
    enough = np.array([0.0 if own.region is None else own.region.radius for own in asked])
    found = smallest_disks(A, B, sigma, name, enough)
    pairs = [(k, point, _proved(asked[k], name, point)) for k, point in enumerate(found) if point]
    proved = [(k, point, design) for k, point, design in pairs if design is not None]
    surely = surely_run([design.certificate for _, _, design in proved])
    running = [own for own, runs in zip(proved, surely, strict=True) if runs or own[2].runs]
    designs = {k: design for k, _, design in running}
    free = [own for own in running if bounds and asked[own[0]].region is None]
    if free:
        lower = _lower([asked[k] for k, _, _ in free], name, [point for _, point, _ in free])
        for (k, _, design), radius in zip(free, lower, strict=True):
            designs[k] = replace(design, lower=radius)
    return [designs.get(k) for k in range(len(asked))]


def _proved(asked: Asked, name: str, point: Reached) -> Design | None:
    """Return the design of a point if it is proved at once."""
    region = asked.region
    if region is None:
        region = Disk(float(asked.centre), point.r * (1 + place.STEPS[0]))
    return place.proved_at(asked.plant, region, name, point) if point.r <= region.radius else None


def _lower(asked: list[Asked], name: str, points: list[Reached]) -> list[float | None]:
    """Return radii proved out of reach."""
    plants = [own.plant for own in asked]
    sigma, r = np.array([-own.centre for own in asked]), np.array([own.r for own in points])
    Y = np.array([own.dual.matrices() for own in points if own.dual is not None])
    found = []
    for own, point, lower in zip(
        asked, points, lower_radii(plants, name, sigma, r, Y), strict=True
    ):
        ends = own.plant, -own.centre, name, point
        if lower is not None or (point.r > -own.centre and is_there()):
            found.append(place.closer_bound(*ends, lower))
        else:
            found.append(place.bound_of(*ends))
    return found
