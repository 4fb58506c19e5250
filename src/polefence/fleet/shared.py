"""Laws that many plants share: as few as are found for all of them, in floats.

A law is sought for all plants. Of those that it does not keep, the worst joins the few that it is
searched for, and so on. Where there is no law for these few, it is sought for the plants nearest to
one at the rim of the fleet, as many of them as have one. What is found here is proved elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from polefence.base.errors import InputError, PolefenceError
from polefence.base.progress import stage
from polefence.certify.bounds import sampled
from polefence.law.laws import FixedGain, Law
from polefence.law.structure import Structure
from polefence.lmi.conditions.target import Around
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.joined import joined
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.reading import MAX_VERTICES
from polefence.region.regions import Region, stable
from polefence.region.z_plane import delta_plane
from polefence.requirements.specification import Specification
from polefence.search.tune.tuner import at_vertices

INSIDE = 1e-3  # by which limits and region are asked for smaller than they are to be


@dataclass(frozen=True)
class _Shared:
    """A law, the plants that it keeps, and the few of them that it was searched for."""

    law: FixedGain | None
    kept: list[int]
    few: list[int]


@dataclass(frozen=True, eq=False)
class Fleet:
    """Plants, each with what a law is to keep.

    Attributes
    ----------
    plants : tuple of UncertainPlant
        Of one shape, and with the same names.
    limits : tuple of tuples of Specification
        For each plant the same kinds and signals.
    region : Region
    numbers : (V, k) array
        What tells one from another: near ones are taken together.
    """

    plants: tuple[UncertainPlant, ...]
    limits: tuple[tuple[Specification, ...], ...]
    region: Region
    numbers: Array

    @cached_property
    def _scaled(self) -> Array:
        spread = np.ptp(self.numbers, axis=0, keepdims=True)
        return np.asarray(self.numbers / np.where(spread > 0, spread, 1.0))

    @stage("laws that are shared")
    def next(self, left: Sequence[int]) -> tuple[FixedGain | None, list[int]]:
        """Return a law and the plants of some that it keeps, in floats.

        Where there is none, the one plant that has none comes alone.
        """
        best = self._for(left)
        if len(best.kept) == len(left):
            return best.law, best.kept
        if best.law is None:
            return None, [self._middle(left)]
        around = self._by_distance(left)
        low, high = 1, len(left)  # sets of these sizes have a law, and have none
        best = self._for(around[:1])
        if best.law is None:
            return None, around[:1]
        while high - low > 1:
            size = (low + high) // 2
            shared = self._for(around[:size])
            if len(shared.kept) == size:
                low, best = size, shared
            else:
                high = size
        best = self._grown(left, best)
        return best.law, best.kept

    def _grown(self, left: Sequence[int], best: _Shared) -> _Shared:
        """Return a law that also keeps plants that the present one narrowly misses."""
        shut = set[int]()
        # done after three plants that the law cannot be stretched to
        while best.law is not None and len(shut) < 3:
            excess = {k: self.excess(k, best.law) for k in left}
            best = replace(best, kept=[k for k, miss in excess.items() if miss < 0])
            outside = [k for k, miss in excess.items() if miss >= 0 and k not in shut]
            if not outside:
                break
            near = min(outside, key=excess.__getitem__)
            grown = self._for([*best.kept, near], replace(best, few=[*best.few, near]))
            if len(grown.kept) > len(best.kept):
                best = grown
            else:
                shut.add(near)
        return best

    def _by_distance(self, left: Sequence[int]) -> list[int]:
        """Return the plants by their distance from the one farthest from the middle."""
        points = self._scaled[list(left)]
        rim = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
        order = np.linalg.norm(points - points[rim], axis=1).argsort(kind="stable")
        return [left[k] for k in order]

    def _middle(self, those: Sequence[int]) -> int:
        """Return the one that is nearest to the middle of these plants."""
        points = self._scaled[list(those)]
        return those[int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]

    def _for(self, those: Sequence[int], first: _Shared | None = None) -> _Shared:
        """Return a law and those of these plants that it keeps: all, if possible.

        The search goes on from ``first``. None where the one in the middle has none.
        """
        few = [self._middle(those)] if first is None else first.few
        law = None if first is None else first.law
        best = _Shared(None, [], few)
        # one law is searched for at most 12 plants at once
        most = min(12, MAX_VERTICES // max(len(plant.vertices) for plant in self.plants))
        for _ in range(16):
            law = self._searched(few, law) if len(few) <= most else None
            if law is None:
                break
            excess = np.array([self.excess(k, law) for k in those])
            kept = [k for k, miss in zip(those, excess, strict=True) if miss < 0]
            if len(kept) > len(best.kept):
                best = _Shared(law, kept, few)
            worst = those[int(excess.argmax())]
            if len(kept) == len(those) or worst in few:
                break
            few = [*few, worst]
        return best

    def _searched(self, few: Sequence[int], start: Law | None) -> FixedGain | None:
        """Return a law that keeps a few plants, well inside the region; None where none is found.

        What lies between them may be out of reach: the plants alone count.
        """
        limits = [
            replace(
                asked_of[0], at_most=min(one.at_most or np.inf for one in asked_of) * (1 - INSIDE)
            )
            for asked_of in zip(*(self.limits[k] for k in few), strict=True)
        ]
        names = [name for limit in limits for name in _signals(limit)]
        with suppress(PolefenceError):
            plant, region = joined([self.plants[k] for k in few], names), self.region
            if plant.sample_time is not None:  # what is searched is in differences
                region = delta_plane(region, plant.sample_time)
            plant = delta_form(plant)
            asked = Around(region.tighter(INSIDE, stable(float(plant.step))))
            designed = at_vertices(plant, Structure(schedule=()), asked, limits, start)
            if designed is not None:
                law = FixedGain(designed.law.gain(np.eye(len(plant.vertices))[:1])[0])
                if max(self.excess(k, law) for k in few) < 0:
                    return law
        return None

    def excess(self, number: int, law: FixedGain) -> float:
        """Return by how much a law misses a plant's limits in floats; negative if it keeps them."""
        seen = self._seen(number)
        poles = np.linalg.eigvals(seen.A + seen.B @ law.gain(seen.alpha))
        outside = float(self.region.distance(poles).max())
        if not outside < 0 or not seen.limits:
            return outside
        try:
            return max(
                sampled(seen.plant, law, limit, seen.alpha).worst / limit.at_most - 1
                for limit in seen.limits
                if limit.at_most is not None
            )
        except InputError:
            return np.inf

    @cached_property
    def _seen(self) -> Callable[[int], _Seen]:
        """What is looked at of a plant, kept for some thousand of them."""
        return lru_cache(4096)(lambda k: _Seen.of(self.plants[k], self.limits[k]))


@dataclass(frozen=True, eq=False)
class _Seen:
    """A plant with its limits, and points of it."""

    plant: UncertainPlant
    limits: tuple[Specification, ...]
    alpha: Array
    A: Array
    B: Array

    @classmethod
    def of(cls, plant: UncertainPlant, limits: tuple[Specification, ...]) -> _Seen:
        alpha = seeded(plant, len(plant.vertices) + 40)
        return cls(plant, limits, alpha, *plant.at(alpha))


def _signals(limit: Specification) -> list[str]:
    return [entry if isinstance(entry, str) else entry.name for entry in limit.entries]
