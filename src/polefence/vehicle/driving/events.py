"""Events of a drive: the guarantee or the hardware at its end, each reported, none hidden."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.margins import Margin, Margins
from polefence.law.laws import FixedGain, given_law
from polefence.law.table import GainTable
from polefence.plant.system import Array
from polefence.vehicle.driving.model import INSIDE
from polefence.vehicle.driving.trajectories import Space, Trajectories
from polefence.vehicle.excitation import Excitation

# Of the range, within an instant: a jump, at no finite rate. Of the range: nothing but rounding.
JUMP, TINY = 1e-6, 1e-9


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


@dataclass(frozen=True, eq=False)
class Claims:
    """What margins prove: one row a claim, in the parameters' units, infinite for any rate.

    Without parameters a row has one number, of weight.
    """

    errors: tuple[Array, ...] = ()
    rates: tuple[Array, ...] = ()


def read_margins(given: Any, space: Space, law: Any) -> Claims | None:
    """Return the claims of margins in service, None where none are given.

    Raises
    ------
    InputError
        If they are none, or those of another plant or law.
    """
    if given is None:
        return None
    if isinstance(given, Margin):
        given = (given,)
    if isinstance(given, Margins):
        _require_same(given, space, law)
    elif not (isinstance(given, Sequence) and all(isinstance(m, Margin) for m in given)):
        raise InputError("margins must be what in_service(design) returns, or a list of its parts")
    width = len(space.plant.parameters) or 1
    found: dict[str, list[Array]] = {"estimate": [], "rate": [], "gain": []}
    for margin in given:
        claim: Any = margin.claim
        if margin.kind == "gain" or claim is None:
            continue
        values = claim.errors if margin.kind == "estimate" else claim.rates
        row = np.full(width, math.inf) if values is None else np.array([float(v) for v in values])
        if len(row) != width:
            raise InputError(f"margin {margin.name} is of another plant than {space.plant.name}")
        found[margin.kind].append(row)
    return Claims(tuple(found["estimate"]), tuple(found["rate"]))


def _require_same(service: Margins, space: Space, law: Any) -> None:
    plant = service.design.plant
    if plant.digest != space.plant.digest or plant.parameters != space.plant.parameters:
        raise InputError(f"the margins are of {plant.name}, not of {space.plant.name}")
    theirs = given_law(plant, service.design.law)
    own = None if law is None or isinstance(law, GainTable) else given_law(plant, law)
    names = ("K",) if isinstance(theirs, FixedGain) else ("W", "Z")
    if type(own) is not type(theirs) or not all(
        np.array_equal(getattr(own, name), getattr(theirs, name)) for name in names
    ):
        raise InputError("the margins are another law's; give those of the law that drives")


def is_scheduled(space: Space, law: Any) -> bool:
    """Whether the law looks at the parameters at all."""
    if law is None or isinstance(law, GainTable):
        return law is not None
    return not isinstance(given_law(space.plant, law), FixedGain)


def rates_of(trajectories: Trajectories, excitation: Excitation) -> Array:
    """Return how fast the parameters move in the step after each instant, (count, time, q).

    In their units per second; infinite where they jump at the instant.
    """
    k: Any = np.arange(excitation.steps)
    start = trajectories.at((k + INSIDE) * excitation.step)
    shape = (excitation.steps + 1, *start.shape[1:])
    if trajectories.constant:
        return np.zeros((shape[1], shape[0], shape[2]))
    end = trajectories.at((k + 1 - INSIDE) * excitation.step)
    found = np.zeros(shape)
    found[:-1] = np.abs(end - start) / excitation.step
    gap = np.abs(start[1:] - end[:-1]) > JUMP * (trajectories.space.high - trajectories.space.low)
    found[1:-1][gap] = math.inf
    return np.swapaxes(found, 0, 1)


def measured_by(space: Space, values: Array, seconds: float = 1.0) -> Array:
    """Return values (..., q) without rounding, in the terms of claims (..., q or 1).

    Parameters
    ----------
    seconds : float
        What a rate is to be multiplied by before it is compared with the range.
    """
    rounding = values * seconds <= TINY * (space.high - space.low)
    found = np.where(rounding, 0.0, values)
    return found if space.plant.parameters else found.sum(axis=-1, keepdims=True) / 2


def share_of_claim(values: Array, claims: Sequence[Array]) -> Array:
    """Return values (..., q) as a share of the claim that allows most (...): above 1, none does.

    Without a claim anything but zero is infinitely much.
    """
    moves = values > 0
    best = np.where(moves.any(axis=-1), math.inf, 0.0)
    for bound in claims:
        limit = np.where(moves & (bound > 0), bound, 1.0)
        with np.errstate(invalid="ignore"):
            parts = np.where(np.isinf(limit), 0.0, values / limit)
        parts = np.where(moves & (bound <= 0), math.inf, parts)
        best = np.minimum(best, np.where(moves, parts, 0.0).max(axis=-1))
    return np.asarray(best)
