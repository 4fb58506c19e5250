"""A drive against what was proved and against its hardware."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.plant.system import Array
from polefence.vehicle.driving.controller import Learner
from polefence.vehicle.driving.events import Event, Motion, claim_events, interval_events, spans
from polefence.vehicle.driving.margins import Claims, rates_of
from polefence.vehicle.driving.model import Model
from polefence.vehicle.driving.parts import Sampling
from polefence.vehicle.driving.record import Record

GRAVITY = 9.81  # [m/s2]
RUNS_AWAY = "the state runs away"


def judged(
    model: Model, own: Record, claims: Claims | None, scheduled: bool
) -> tuple[tuple[Event, ...], tuple[str, ...], Any]:
    """Return events, notes, and where the margins cover what happened (None without any).

    Parameters
    ----------
    scheduled : bool
        Whether the law looks at the parameters: else being wrong about them is no error.
    """
    times, space = model.grid.times, model.courses.space
    errors = np.abs(own.parameters - own.used)
    motion = Motion(
        space,
        own.parameters,
        errors if scheduled else 0 * errors,
        rates_of(model.courses, model.grid),
    )
    events, outside = interval_events(motion, times)
    hardware, met = _hardware(model, own, times)
    if claims is None:
        compared = (
            f"no margins were given to compare with; fastest change: {motion.largest('rates')}; "
            f"largest error of the scheduling: {motion.largest('errors')}"
        )
        return (*events, *hardware), (compared,), None
    left, covered = claim_events(motion, claims, model.grid.step, times)
    return (*events, *left, *hardware), (), covered & ~outside & ~met


def throughout(model: Model, sampling: Sampling | None, learner: Learner | None) -> tuple[str, ...]:
    """Return what no claim covers and is so all the time."""
    found = []
    if sampling is not None:
        delayed = ", a sample late" if sampling.delayed else ""
        found.append(f"the controller samples every {sampling.period:g} s{delayed}: in no claim")
    if model.actuator.bandwidth is not None:
        found.append(f"the actuator has {model.actuator.bandwidth:g} Hz: its lag is in no claim")
    if learner is not None:
        seen = learner.own.identifiable()
        for name, visible in zip(model.courses.space.names, seen, strict=False):
            if not visible:
                found.append(f"the estimator cannot see {name}, which keeps its first value")
    return tuple(found)


def _hardware(model: Model, own: Record, times: Array) -> tuple[list[Event], Any]:
    """Return events of limits met, and where any is (count, time)."""
    found = list[Event]()
    met = np.zeros(own.stops.shape, dtype=bool)
    limit = model.actuator.limit
    if limit is not None:
        size = np.abs(own.demanded).max(axis=-1)
        over = size > limit
        met |= over
        found += spans(
            "limit", over, size, times,
            lambda car, k: f"{size[car, k]:.4g} demanded of an actuator that gives {limit:g}",
        )  # fmt: skip
    if model.stops is not None:
        push = np.abs(own.stops)
        met |= push > 0
        found += spans(
            "stops", push > 0, push, times,
            lambda car, k: (
                f"{'rebound' if own.stops[car, k] < 0 else 'bump'} stop hit, "
                f"{push[car, k]:.4g} N at most"
            ),
        )  # fmt: skip
    for kind, mask, size, words in (*_contact(model, own), *_lost(own)):
        met |= mask
        found += spans(kind, mask, size, times, lambda *_, words=words: words)
    return found, met


def _contact(model: Model, own: Record) -> list[tuple[str, Any, Array, str]]:
    """Where the tyre would have to pull: the linear tyre is no tyre any more."""
    known = model.known
    if known is None or known.tyre_force is None:
        return []
    force = own.mass * GRAVITY
    force = force + own.states @ known.tyre_force.arrays(model.plant)[0][0]
    text = "the tyre leaves the road, which the equations do not know"
    return [("road", force < 0, -force, text)]


def _lost(own: Record) -> list[tuple[str, Any, Array, str]]:
    gone = ~np.all(np.isfinite(own.states), axis=-1)
    return [("lost", gone, gone.astype(float), RUNS_AWAY)]
