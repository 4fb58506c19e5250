"""Margins in service against a drive: what the parameters do, as a share of what is proved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.margins import Margin, Margins
from polefence.law.laws import FixedGain, given_law
from polefence.law.table import GainTable
from polefence.plant.system import Array
from polefence.vehicle.driving.scheduling import INSIDE
from polefence.vehicle.driving.trajectories import Courses, Space
from polefence.vehicle.excitation import Excitation

# Of the range, within an instant: a jump, at no finite rate. Of the range: nothing but rounding.
JUMP, TINY = 1e-6, 1e-9


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


def rates_of(courses: Courses, grid: Excitation) -> Array:
    """Return how fast the parameters move in the step after each instant, (count, time, q).

    In their units per second; infinite where they jump at the instant.
    """
    k: Any = np.arange(grid.steps)
    start = courses.at((k + INSIDE) * grid.step)
    shape = (grid.steps + 1, *start.shape[1:])
    if courses.constant:
        return np.zeros((shape[1], shape[0], shape[2]))
    end = courses.at((k + 1 - INSIDE) * grid.step)
    found = np.zeros(shape)
    found[:-1] = np.abs(end - start) / grid.step
    gap = np.abs(start[1:] - end[:-1]) > JUMP * (courses.space.high - courses.space.low)
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
