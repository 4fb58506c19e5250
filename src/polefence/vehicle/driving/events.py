"""Events of a drive: the guarantee or the hardware at its end, each reported, none hidden."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.plant.system import Array
from polefence.vehicle.driving.margins import Claims, measured_by, share_of_claim
from polefence.vehicle.driving.trajectories import Space


@dataclass(frozen=True)
class Event:
    """One thing that happened to one car.

    Attributes
    ----------
    kind : str
        "interval": a parameter outside its own; "rate", "estimate": above what is proved; "rate
        and estimate": both not zero at once, which no margin covers; "limit" of the actuator,
        "stops", "road": the tyre leaves it; "lost": the state runs away.
    car : int
        Number of the car, from 0.
    first : float
        When it first was so [s].
    duration : float
        For how long in all [s], in whole steps; 0 for what is so at an instant only.
    text : str
        In words, with the worst of it.
    """

    kind: str
    car: int
    first: float
    duration: float
    text: str

    def __str__(self) -> str:
        lasting = f", for {self.duration:.6g} s in all" if self.duration else ""
        return f"{self.text}; first at {self.first:.6g} s{lasting}"


@dataclass(frozen=True, eq=False)
class Motion:
    """What the parameters did: (count, time, q) arrays, in their units."""

    space: Space
    true: Array
    errors: Array
    rates: Array

    def words(self, values: Array, per_second: bool) -> str:
        """Print one row of values with names and units."""
        per = "/s" if per_second else ""
        units = [f"{u or ('1' if per else '')}{per}" for u in self.space.units]
        parts = [
            f"{name} jumps" if np.isinf(v) else f"{name} {v:.4g} {unit}".rstrip()
            for name, v, unit in zip(self.space.names, values, units, strict=True)
            if v > 0
        ]
        return ", ".join(parts)

    def largest(self, what: str) -> str:
        """Print the largest values of "errors" or "rates" over all cars and times."""
        values = getattr(self, what)
        return self.words(values.max(axis=(0, 1)), what == "rates") or "none"


def claim_events(
    motion: Motion, claims: Claims, step: float, times: Array
) -> tuple[list[Event], Any]:
    """Return where the margins do not cover what the parameters did, and the mask where they do.

    Returns
    -------
    events : list of Event
    covered : (count, time) array of bool
    """
    space = motion.space
    rates = measured_by(space, motion.rates, step)
    errors = measured_by(space, motion.errors)
    found, covered = list[Event](), np.ones(rates.shape[:2], dtype=bool)
    for kind, values, own, bounds, shown in (
        ("rate", rates, "rate of change", claims.rates, motion.rates),
        ("estimate", errors, "error of the scheduling", claims.errors, motion.errors),
    ):
        share = share_of_claim(values, bounds)

        def words(
            car: int, k: int, own: str = own, share: Array = share, shown: Array = shown,
            kind: str = kind,
        ) -> str:  # fmt: skip
            much = share[car, k]
            by = f"{much:.4g} times what is proved" if np.isfinite(much) else "beyond any margin"
            return (
                f"{own} above what is proved: {motion.words(shown[car, k], kind == 'rate')}, {by}"
            )

        found += spans(kind, share > 1, share, times, words)
        covered &= share <= 1
    both = (rates.max(axis=-1) > 0) & (errors.max(axis=-1) > 0) & covered
    found += spans(
        "rate and estimate",
        both,
        errors.max(axis=-1),
        times,
        lambda car, k: (
            "parameters move while the scheduling is wrong, each margin is proved without the "
            f"other: error {motion.words(motion.errors[car, k], False)}"
        ),
    )
    return found, covered & ~both


def interval_events(motion: Motion, times: Array) -> tuple[list[Event], Any]:
    """Return where parameters are outside their intervals, and the mask of it (count, time)."""
    space, found = motion.space, list[Event]()
    away = space.distance(motion.true)
    for i, name in enumerate(space.names):
        own = away[..., i]

        def words(car: int, k: int, i: int = i, name: str = name) -> str:
            value, unit = motion.true[car, k, i], space.units[i]
            bounds = f"[{space.low[i]:g}, {space.high[i]:g}]"
            return f"{name} = {value:.6g} {unit}".rstrip() + f" outside {bounds}, at worst"

        found += spans("interval", own > 0, own, times, words)
    return found, (away > 0).any(axis=-1)


def spans(
    kind: str, mask: Any, size: Array, times: Array, words: Callable[[int, int], str]
) -> list[Event]:
    """Return an event for every car for which ``mask`` (count, time) is somewhere true.

    ``words`` gets the car and the instant where ``size`` (count, time) is largest in the mask.
    """
    step, events = times[1] - times[0], list[Event]()
    for car in np.flatnonzero(mask.any(axis=1)):
        own = mask[car]
        worst = int(np.argmax(np.where(own, size[car], -np.inf)))
        first, lasting = times[int(np.argmax(own))], np.count_nonzero(own[:-1]) * step
        text = words(int(car), worst)
        events.append(Event(kind, int(car), float(first), float(lasting), text))
    return events


def summary(events: Sequence[Event], count: int) -> list[str]:
    """Return a line for every kind of event; of many cars, that which it meets first."""
    if count == 1:
        return [str(event) for event in events]
    lines = []
    for kind in dict.fromkeys(event.kind for event in events):
        own = [event for event in events if event.kind == kind]
        cars = len({event.car for event in own})
        early = min(own, key=lambda event: event.first)
        lines.append(f"{kind}: {cars} of {count} cars; car {early.car}: {early}")
    return lines
