"""Result of a drive: the record, and it against what was proved and against its hardware."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, choose, rate_place
from polefence.plant.system import Array
from polefence.region.text import digits_down
from polefence.response.result import Response
from polefence.vehicle.driving.events import (
    Claims,
    Event,
    Motion,
    claim_events,
    interval_events,
    rates_of,
    spans,
    summary,
)
from polefence.vehicle.driving.integration import Learner, Solution
from polefence.vehicle.driving.model import INSIDE, Model, Reading
from polefence.vehicle.driving.parts import Sampling
from polefence.vehicle.driving.trajectories import Space
from polefence.vehicle.estimate import Estimate
from polefence.vehicle.vehicle import Ride

CHUNK = 4_000_000  # numbers held at once

GRAVITY = 9.81  # [m/s2]
RUNS_AWAY = "the state runs away"


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """What came of a drive, for ``count`` cars at equal instants.

    Attributes
    ----------
    plant : UncertainPlant
    time : (time,) array
        From 0 [s].
    states, rates : (count, time, n) arrays
        x and dx/dt; at an instant where something jumps, just after it.
    demanded, applied : (count, time, m) arrays
        What the law asked of the inputs, and what the actuators gave.
    disturbance : (time, q) array
        The road's velocity, or what else was given; over a step that begins there.
    stop_force : (count, time) array
        Of the bump stops, up on the sprung mass [N].
    parameters, used : (count, time, q) arrays
        The true ones, and what the law was told, cut off at the intervals; in their units. For a
        plant given by its vertices, weights alpha.
    events : tuple of Event
        In order of kind, then car.
    notes : tuple of str
        What is so throughout and in no claim, and what could not be compared.
    covered : (count, time) array of bool, optional
        Where the given margins cover what the parameters did and were taken for, with no limit
        met; None without margins. It says nothing of ``notes``.
    estimate : Estimate, optional
        What the estimator found.
    """

    plant: UncertainPlant
    time: Array
    states: Array
    rates: Array
    demanded: Array
    applied: Array
    disturbance: Array
    stop_force: Array
    parameters: Array
    used: Array
    events: tuple[Event, ...]
    notes: tuple[str, ...]
    covered: Any = None
    estimate: Estimate | None = None

    def __repr__(self) -> str:
        count, instants, _ = self.states.shape
        return (
            f"<Drive of {self.plant.name!r}: {count} cars, {self.time[-1]:g} s, {instants} "
            f"instants, {len(self.events)} events>"
        )

    def __str__(self) -> str:
        return "\n".join(self.report())

    def report(self) -> list[str]:
        """Return in plain lines where the guarantee does not hold, and what is in none."""
        count, end = len(self.states), self.time[-1]
        lines = [f"{self.plant.name}: {count} cars, {end:g} s"]
        if self.covered is not None:
            lasting = self.covered[:, :-1].mean(axis=1).min() * end
            lines.append(f"the margins cover {digits_down(lasting)} s of {end:g} s (the worst car)")
        lines += summary(self.events, count) or ["no limit was met"]
        return lines + [f"note: {note}" for note in self.notes]

    def of(self, name: str) -> Array:
        """Return one state or input as it was applied, by its name, (count, time)."""
        return self.response([name]).values[:, :, 0]

    def response(self, signals: Sequence[Output | str] | None = None) -> Response:
        """Return signals over time, states and inputs by default.

        Inputs are the applied ones. An output that is the rate of change of a state, such as an
        acceleration, has the force of stops and the weight of a changed load in it. The result's
        alpha is that of the first instant.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        asked = choose(self.plant, signals)
        values = np.stack([self._values(output) for output in asked], axis=-1)
        alpha = Space(self.plant).alpha(self.parameters[:, 0])
        return Response(self.plant, alpha, self.time, asked, values)

    def _values(self, output: Output) -> Array:
        """Return an output over time, (count, time)."""
        place = rate_place(self.plant, output)
        if place is not None:
            return self.rates[..., place]
        found, alpha = np.zeros(self.states.shape[:2]), None
        sources = self.states, self.applied, self.disturbance[None]
        for rows, own, source in zip(
            (output.C, output.D, output.F), output.arrays(self.plant), sources, strict=True
        ):
            if len(rows) == 1:
                found += source @ own[0]
            elif rows:
                alpha = Space(self.plant).alpha(self.parameters) if alpha is None else alpha
                found += np.einsum("...j,...j->...", alpha @ own, source)
        return found


@dataclass(frozen=True, eq=False)
class Record:
    """Arrays (count, time, ...) at all instants; see `driving.result.Drive`.

    ``disturbance`` (time, q) is that of the step which begins at an instant; ``mass`` [kg] is what
    rests on the tyre of a car, infinite for any other plant.
    """

    disturbance: Array
    states: Array
    rates: Array
    demanded: Array
    applied: Array
    stops: Array
    parameters: Array
    used: Array
    mass: Array


def record(model: Model, solution: Solution, reading: Reading | None) -> Record:
    """Return what was the case at every instant; at the last one, the road of the last step.

    Parameters
    ----------
    reading : Reading, optional
        What the law followed, where no controller has recorded what it used and demanded.
    """
    excitation, (n, m) = model.excitation, model.plant.shape
    total, count, width = solution.z.shape
    q = len(model.trajectories.space.names)
    x, rates = solution.z[..., :n], np.empty((total, count, n))
    demanded = np.empty((total, count, m)) if solution.demanded is None else solution.demanded
    used = np.empty((total, count, q)) if solution.used is None else solution.used
    true, stops = np.empty((total, count, q)), np.zeros((total, count))
    applied, mass = np.empty((total, count, m)), np.full((total, count), np.inf)
    length = max(1, CHUNK // (count * n * (n + m + 4)))
    for first in range(0, total, length):
        part = slice(first, min(first + length, total))
        k = np.arange(part.start, part.stop)
        last = np.minimum(k, excitation.steps - 1)
        times = np.where(k > last, excitation.steps - INSIDE, k + INSIDE) * excitation.step
        true[part] = model.trajectories.at(times)
        if reading is not None and solution.used is None:
            given = model.trajectories.space.inside(reading.at(times))
            used[part], K = given, model.gains(given)
            demanded[part] = (K @ x[part, :, :, None])[..., 0]
        acts = solution.z[part, :, n:] if width > n else model.actuator.limited(demanded[part])
        applied[part] = model.actuator.limited(acts)
        A, B, g = model.open(times, last)
        rates[part] = (A @ x[part, :, :, None] + B @ applied[part][..., None])[..., 0] + g
        if model.known is not None:
            mass[part] = _mass(model, model.known, B)
        if model.stops is not None and model.known is not None:
            i, sense = model.known.places[0], model.known.sense[0]
            stops[part] = model.stops.force(sense * x[part, :, i], sense * rates[part, :, i])
            rates[part] += stops[part, :, None] * B[..., :, model.known.input]
    every = np.arange(total)
    last = np.minimum(every, excitation.steps - 1)
    times = np.where(every > last, excitation.steps - INSIDE, every + INSIDE) * excitation.step
    arrays = (x, rates, demanded, applied, stops, true, used, mass)
    return Record(excitation.disturbance(times, last), *(np.swapaxes(v, 0, 1) for v in arrays))


def _mass(model: Model, known: Ride, B: Array) -> Array:
    """Return both masses together, as the force's entries in B say them; the first load's."""
    up, down = (B[..., known.places[i], known.input] for i in (2, 3))
    return np.asarray((model.first_load if model.gravity else 1 / up) - 1 / down)


def assessed(
    model: Model, own: Record, claims: Claims | None, scheduled: bool
) -> tuple[tuple[Event, ...], tuple[str, ...], Any]:
    """Return events, notes, and where the margins cover what happened (None without any).

    Parameters
    ----------
    scheduled : bool
        Whether the law looks at the parameters: else being wrong about them is no error.
    """
    times, space = model.excitation.times, model.trajectories.space
    errors = np.abs(own.parameters - own.used)
    motion = Motion(
        space,
        own.parameters,
        errors if scheduled else 0 * errors,
        rates_of(model.trajectories, model.excitation),
    )
    events, outside = interval_events(motion, times)
    hardware, met = _hardware(model, own, times)
    if claims is None:
        compared = (
            f"no margins were given to compare with; fastest change: {motion.largest('rates')}; "
            f"largest error of the scheduling: {motion.largest('errors')}"
        )
        return (*events, *hardware), (compared,), None
    left, covered = claim_events(motion, claims, model.excitation.step, times)
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
        for name, visible in zip(model.trajectories.space.names, seen, strict=False):
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
