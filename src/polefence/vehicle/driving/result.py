"""Result of a drive: its record and events, where the guarantee or the hardware is at its end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.margins import Margin, Margins
from polefence.law.laws import given_law, law_or_table
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, choose, inputs, rates_in
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.region.text import digits_down
from polefence.response.discrete import Sampling
from polefence.response.linear import Response
from polefence.vehicle.contact import GRAVITY
from polefence.vehicle.driving.integration import INSIDE, Learner, Model, Reading, Solution
from polefence.vehicle.driving.trajectories import Space, Trajectories
from polefence.vehicle.estimate import Estimate
from polefence.vehicle.excitation import Excitation

CHUNK = 4_000_000  # numbers held at once

RUNS_AWAY = "the state runs away"
LEAVES = "leaves the road, which the equations do not know"

# Of the range, within an instant: a jump, at no finite rate. Of the range: nothing but rounding.
JUMP, TINY = 1e-6, 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Drive(Short):
    """Outcome of a drive, for ``count`` cars at equal instants.

    Attributes
    ----------
    plant : UncertainPlant
    time : (time,) array
        From 0 [s].
    states, rates : (count, time, n) arrays
        x and dx/dt; at an instant where something jumps, just after it.
    demanded, applied : (count, time, m) arrays
        What the law asked of the inputs, and what the actuators gave. With a controller that is a
        sample late, what is asked now is the law's answer to the sample before.
    disturbance : (time, q) array
        The road's velocity, or what else was given; over a step that begins there.
    stop_forces : (count, time, k) array
        Of the bump stops of each suspension, up on the body [N]; k = 0 without any.
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
    stop_forces: Array
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

    @property
    def stop_force(self) -> Array:
        """Of all bump stops, up on the body [N], (count, time)."""
        return np.asarray(self.stop_forces.sum(axis=-1))

    def of(self, name: str) -> Array:
        """Return one state or input as it was applied, by its name, (count, time)."""
        return self.response([name]).values[:, :, 0]

    def response(self, signals: Sequence[Output | str] | None = None) -> Response:
        """Return signals over time, states and inputs by default.

        Inputs are the applied ones. An output that is made of rates of change of the state, such
        as an acceleration of a point of the body, has the force of stops and the weight of a
        changed load in it. The result's alpha is that of the first instant.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        asked = choose(self.plant, signals)
        # signal by signal in memory, as they are found and mostly looked at
        values = np.moveaxis(np.stack([self._values(output) for output in asked]), 0, -1)
        alpha = Space(self.plant).alpha(self.parameters[:, 0])
        return Response(self.plant, alpha, self.time, asked, values)

    def _values(self, output: Output) -> Array:
        """Return an output over time, (count, time)."""
        rates = rates_in(self.plant, output)
        if rates is not None:
            return np.asarray(self.rates @ rates)
        found, alpha = np.zeros(self.states.shape[:2]), None
        sources = self.states, self.applied, self.disturbance[None]
        for rows, own, source in zip(
            (output.C, output.D, output.F), output.arrays(self.plant), sources, strict=True
        ):
            if len(rows) == 1:
                found += source @ own[0]
            elif rows:
                alpha = Space(self.plant).alpha(once(self.parameters)) if alpha is None else alpha
                found += np.einsum("...j,...j->...", alpha @ own, source)
        return found


@dataclass(frozen=True, eq=False)
class Record(Short):
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
    (n, m), (total, count, _) = model.plant.shape, solution.z.shape
    x, rates = solution.z[..., :n], np.empty((total, count, n))
    demanded = np.empty((total, count, m)) if solution.demanded is None else solution.demanded
    applied, stops = np.empty((total, count, m)), np.zeros((total, count, len(model.stopped)))
    times, numbers = instants(model)
    for part in _parts(total, count * n * (n + m + 4)):
        if reading is not None and solution.used is None:
            K = model.gains(reading.at(times[part]))
            demanded[part] = (K @ x[part, :, :, None])[..., 0]
        applied[part] = model.applied(solution.z[part], demanded[part])
        A, B, g = model.open(times[part], numbers[part])
        rates[part] = (A @ x[part, :, :, None] + B @ applied[part][..., None])[..., 0] + g
        if model.stops is not None:
            d = model.stopped[:, :n]
            stops[part] = model.stops.force(x[part] @ d.T, rates[part] @ d.T)
            rates[part] += (model.pushed(A, B) @ stops[part][..., None])[..., 0]
    x, rates, demanded, applied, stops = (
        np.swapaxes(v, 0, 1) for v in (x, rates, demanded, applied, stops)
    )
    if solution.used is None:
        used = parameters_over_time(model, reading)
    else:
        used = np.swapaxes(solution.used, 0, 1)
    w = model.excitation.disturbance(times, numbers)
    true, mass = parameters_over_time(model), loads_over_time(model)
    return Record(w, x, rates, demanded, applied, stops, true, used, mass)


def _parts(total: int, each: int) -> Iterator[slice]:
    """Yield parts of so many instants, each with few enough numbers."""
    length = max(1, CHUNK // each)
    for first in range(0, total, length):
        yield slice(first, min(first + length, total))


def instants(model: Model) -> tuple[Array, Array]:
    """Return times just after all instants, the last one just before, and the steps they lie in."""
    steps = model.excitation.steps
    k = np.arange(steps + 1)
    last = np.minimum(k, steps - 1)
    return np.where(k > last, steps - INSIDE, k + INSIDE) * model.excitation.step, last


def parameters_over_time(model: Model, reading: Reading | None = None) -> Array:
    """Return the true parameters at all instants, or what a law reads, (count, time, q)."""
    (times, _), space = instants(model), model.trajectories.space
    source = model.trajectories if reading is None else reading
    found = source.at(times[:1] if source.constant else times)
    found = found if reading is None else space.inside(found)
    shape = (len(times), len(model.trajectories.cars), found.shape[-1])
    return np.swapaxes(np.broadcast_to(found, shape), 0, 1)


def loads_over_time(model: Model) -> Array:
    """Return what rests on the tyre [kg], (count, time): both masses, of them the first load."""
    times, _ = instants(model)
    shape = (len(model.trajectories.cars), len(times))
    if model.known is None:
        return np.broadcast_to(np.inf, shape)
    known, N = model.known, len(model.plant.vertices)
    push = known.push(*model.plant.at(np.eye(N)))[:, known.places[2:]]
    times = times[:1] if model.trajectories.constant else times
    found = np.empty((len(times), shape[0]))
    for part in _parts(len(times), shape[0] * N):
        alpha = model.trajectories.space.alpha(model.trajectories.at(times[part]))
        up, down = np.moveaxis(alpha @ push, -1, 0)
        found[part] = (model.first_load if model.gravity else 1 / up) - 1 / down
    return np.broadcast_to(found.T, shape)


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
    errors = np.zeros(1)
    if scheduled:
        errors = np.abs(once(own.parameters) - once(own.used))
    motion = Motion(
        space,
        own.parameters,
        np.broadcast_to(errors, own.parameters.shape),
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


def once(values: Array) -> Array:
    """Return values (count, time, ...) at one instant only, where they are the same at all."""
    return values[:, :1] if values.strides[1] == 0 else values


def throughout(model: Model, sampling: Sampling | None, learner: Learner | None) -> tuple[str, ...]:
    """Return what no claim covers and is so all the time."""
    found = []
    if sampling is not None and not sampling.designed:
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


def given(model: Model, own: Record) -> list[str]:
    """Say how often controllable dampers gave what was demanded, of cars that are not lost."""
    found = list[str]()
    there = np.isfinite(own.applied).all(axis=-1) if model.dampers else np.True_
    some: Any = ... if there.all() else there  # mostly all, which need not be copied
    for k, _, _, _ in model.dampers:
        asked, gave = own.demanded[some, k], own.applied[some, k]
        if model.hardware.sampling is None and asked.any():
            share = float(np.mean(np.abs(asked - gave) <= TINY * np.abs(asked)))
            name = inputs(model.plant)[k].name
            found.append(f"{name}: the damper gives what is demanded {share:.0%} of the time")
    return found


def _hardware(model: Model, own: Record, times: Array) -> tuple[list[Event], Any]:
    """Return events of limits met, and where any is (count, time)."""
    found = list[Event]()
    met = np.zeros(own.states.shape[:2], dtype=bool)
    limit = model.actuator.limit
    if limit is not None:
        size = reduce(np.maximum, np.abs(np.moveaxis(own.demanded[..., : model.driven], -1, 0)))
        over = size > limit
        met |= over
        found += spans(
            "limit", over, size, times,
            lambda car, k: f"{size[car, k]:.4g} demanded of an actuator that gives {limit:g}",
        )  # fmt: skip
    for i, name in enumerate(model.suspensions.names if model.suspensions else ()):
        force = own.stops[..., i]
        met |= force != 0
        found += _stops(name, force, times)
    for kind, mask, size, words in (*_contact(model, own), *_lost(own)):
        met |= mask
        found += spans(kind, mask, size, times, lambda *_, words=words: words)
    return found, met


def _stops(name: str, force: Array, times: Array) -> list[Event]:
    """Return events of one suspension's stops."""
    wheel = f"{name} " * bool(name)

    def words(car: int, k: int) -> str:
        which = "rebound" if force[car, k] < 0 else "bump"
        return f"{wheel}{which} stop hit, {abs(force[car, k]):.4g} N at most"

    return spans("stops", force != 0, np.abs(force), times, words)


def _contact(model: Model, own: Record) -> list[tuple[str, Any, Array, str]]:
    """Spans where the tyre would have to pull: the linear tyre is no tyre any more."""
    known = model.known
    if known is None or known.tyre_force is None:
        return []
    row = known.tyre_force.arrays(model.plant)[0][0]
    force = own.mass * GRAVITY
    for i in np.flatnonzero(row):
        force = force + row[i] * own.states[..., i]
    return [("road", force < 0, -force, f"the tyre {LEAVES}")]


def _lost(own: Record) -> list[tuple[str, Any, Array, str]]:
    if np.all(np.isfinite(own.states[:, -1])):  # what is lost stays so
        return []
    gone = ~np.all(np.isfinite(own.states), axis=-1)
    return [("lost", gone, gone.astype(float), RUNS_AWAY)]


@dataclass(frozen=True)
class Event(Short):
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
class Motion(Short):
    """Motion of the parameters: (count, time, q) arrays, in their units."""

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
        values = once(getattr(self, what))
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
    away = np.broadcast_to(space.distance(once(motion.true)), motion.true.shape)
    for i, name in enumerate(space.names):
        own = away[..., i]

        def words(car: int, k: int, i: int = i, name: str = name) -> str:
            value, unit = motion.true[car, k, i], space.units[i]
            bounds = f"[{space.low[i]:g}, {space.high[i]:g}]"
            return f"{name} = {value:.6g} {unit}".rstrip() + f" outside {bounds}, at worst"

        found += spans("interval", own > 0, own, times, words)
    outside = (once(away) > 0).any(axis=-1)
    return found, np.broadcast_to(outside, away.shape[:2])


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
class Claims(Short):
    """Bounds that margins prove: one row a claim, in the parameters' units, infinite for any rate.

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
    own = None if law is None else law_or_table(plant, law)
    if own is None or own.exact != theirs.exact:
        raise InputError("the margins are another law's; give those of the law that drives")


def is_scheduled(space: Space, law: Any) -> bool:
    """Whether the law looks at the parameters at all."""
    return law is not None and not law_or_table(space.plant, law).fixed


def rates_of(trajectories: Trajectories, excitation: Excitation) -> Array:
    """Return how fast the parameters move in the step after each instant, (count, time, q).

    In their units per second; infinite where they jump at the instant.
    """
    k: Any = np.arange(excitation.steps)
    start = trajectories.at((k + INSIDE) * excitation.step)
    shape = (excitation.steps + 1, *start.shape[1:])
    if trajectories.constant:
        return np.broadcast_to(0.0, (shape[1], shape[0], shape[2]))
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
