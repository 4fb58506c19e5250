"""Result of a drive: its record, and events where the guarantee or the hardware is exceeded."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.design import Design
from polefence.certify.margins import Margin, Margins
from polefence.law.laws import given_law, law_or_table
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, choose, inputs, rates_in
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.proof.text import late_text
from polefence.region.regions import HalfPlane
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

# Of a parameter's range: a smaller error or change counts as rounding.
TINY = 1e-9


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
        Inputs demanded by the law, and inputs that the actuators gave. With a delay of one sample
        the demand now is the law's answer to the sample before; with one of half a sample it is
        that in the first half of a period, and the answer to the last sample in the second.
    disturbance : (time, q) array
        The road's velocity, or another given disturbance, over the step that begins at the instant.
    stop_forces : (count, time, k) array
        Of the bump stops of each suspension, up on the body [N]; k = 0 without any.
    parameters, used : (count, time, q) arrays
        True parameters, and those that the law used, limited to their intervals; in their units.
        For a plant given by its vertices these are weights alpha.
    events : tuple of Event
        In order of kind, then car.
    notes : tuple of str
        Conditions of the whole drive that no claim covers, and what could not be compared.
    covered : (count, time) array of bool, optional
        Where the given margins cover the parameters' motion and the scheduling errors, and no
        limit is met; None without margins. ``notes`` are not considered.
    estimate : Estimate, optional
        Result of the estimator.
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
        """Return lines on where the guarantee does not hold, and on what no claim covers."""
        count, end = len(self.states), self.time[-1]
        lines = [f"{self.plant.name}: {count} cars, {end:g} s"]
        if self.covered is not None:
            lasting = self.covered[:, :-1].mean(axis=1).min() * end
            lines.append(f"the margins cover {digits_down(lasting)} s of {end:g} s (the worst car)")
        lines += summary(self.events, count) or ["no limit was met"]
        return lines + [f"note: {note}" for note in self.notes]

    @property
    def stop_force(self) -> Array:
        """Sum of the forces of all bump stops, up on the body [N], (count, time)."""
        return np.asarray(self.stop_forces.sum(axis=-1))

    def of(self, name: str) -> Array:
        """Return one state, or one applied input, by its name, (count, time)."""
        return self.response([name]).values[:, :, 0]

    def response(self, signals: Sequence[Output | str] | None = None) -> Response:
        """Return signals over time, states and inputs by default.

        Inputs are the applied ones. An output that is a combination of state rates, such as the
        acceleration of a point of the body, includes the bump stops' force and the weight of a
        changed load. The result's alpha is that of the first instant.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        asked = choose(self.plant, signals)
        # each signal is contiguous in memory: it is computed, and mostly read, alone
        values = np.moveaxis(np.stack([self._values(output) for output in asked]), 0, -1)
        alpha = Space(self.plant).alpha(self.parameters[:, 0])
        return Response(self.plant, alpha, self.time, asked, values)

    def _values(self, output: Output) -> Array:
        """Return an output over time, (count, time)."""
        rates = rates_in(self.plant, output)
        if rates is not None:
            return np.asarray(self.rates @ rates)
        values, alpha = np.zeros(self.states.shape[:2]), None
        sources = self.states, self.applied, self.disturbance[None]
        for rows, matrices, source in zip(
            (output.C, output.D, output.F), output.arrays(self.plant), sources, strict=True
        ):
            if len(rows) == 1:
                values += source @ matrices[0]
            elif rows:
                alpha = Space(self.plant).alpha(once(self.parameters)) if alpha is None else alpha
                values += np.einsum("...j,...j->...", alpha @ matrices, source)
        return values


@dataclass(frozen=True, eq=False)
class Record(Short):
    """Arrays (count, time, ...) at all instants; see `driving.result.Drive`.

    ``disturbance`` (time, q) holds over the step that begins at the instant. ``mass`` [kg] is the
    mass on a car's tyre; it is infinite for other plants.
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
    """Return the record of all instants; the last instant has the disturbance of the last step.

    Parameters
    ----------
    reading : Reading, optional
        The parameters that the law used, where no controller recorded them and its demands.
    """
    (n, m), (total, count, _) = model.plant.shape, solution.z.shape
    x, rates = solution.z[..., :n], np.empty((total, count, n))
    demanded = np.empty((total, count, m)) if solution.demanded is None else solution.demanded
    applied, stops = np.empty((total, count, m)), np.zeros((total, count, len(model.stopped)))
    times, numbers = instants(model)
    for part in _parts(total, count * n * (n + m + 4)):
        if reading is not None and solution.used is None:
            K = model.gains(reading.at(times[part]))
            demanded[part] = model.demanded(K, solution.z[part])
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


def _parts(total: int, numbers: int) -> Iterator[slice]:
    """Yield slices of the instants that hold at most `CHUNK` numbers.

    An instant has ``numbers`` of them.
    """
    length = max(1, CHUNK // numbers)
    for first in range(0, total, length):
        yield slice(first, min(first + length, total))


def instants(model: Model) -> tuple[Array, Array]:
    """Return times just after the instants (just before the last), and their steps' indices."""
    steps = model.excitation.steps
    k = np.arange(steps + 1)
    last = np.minimum(k, steps - 1)
    return np.where(k > last, steps - INSIDE, k + INSIDE) * model.excitation.step, last


def parameters_over_time(model: Model, reading: Reading | None = None) -> Array:
    """Return the true parameters at all instants, or those that a law reads, (count, time, q)."""
    (times, _), space = instants(model), model.trajectories.space
    source = model.trajectories if reading is None else reading
    values = source.at(times[:1] if source.constant else times)
    values = values if reading is None else space.inside(values)
    shape = (len(times), len(model.trajectories.cars), values.shape[-1])
    return np.swapaxes(np.broadcast_to(values, shape), 0, 1)


def loads_over_time(model: Model) -> Array:
    """Return the mass on the tyre [kg], (count, time): the unsprung and the sprung mass.

    With gravity the sprung mass is that of the first load.
    """
    times, _ = instants(model)
    shape = (len(model.trajectories.cars), len(times))
    if model.known is None:
        return np.broadcast_to(np.inf, shape)
    known, N = model.known, len(model.plant.vertices)
    push = known.push(*model.plant.at(np.eye(N)))[:, known.places[2:]]
    times = times[:1] if model.trajectories.constant else times
    loads = np.empty((len(times), shape[0]))
    for part in _parts(len(times), shape[0] * N):
        alpha = model.trajectories.space.alpha(model.trajectories.at(times[part]))
        up, down = np.moveaxis(alpha @ push, -1, 0)
        loads[part] = (model.first_load if model.gravity else 1 / up) - 1 / down
    return np.broadcast_to(loads.T, shape)


def assessed(
    model: Model, drive: Record, claims: Claims | None, scheduled: bool
) -> tuple[tuple[Event, ...], tuple[str, ...], Any]:
    """Return events, notes, and where the margins cover the drive (None without margins).

    Parameters
    ----------
    scheduled : bool
        Whether the law depends on the parameters. If it does not, errors in them do not count.
    """
    times, space = model.excitation.times, model.trajectories.space
    errors = np.zeros(1)
    if scheduled:
        errors = np.abs(once(drive.parameters) - once(drive.used))
    motion = Motion(
        space,
        drive.parameters,
        np.broadcast_to(errors, drive.parameters.shape),
        rates_of(model.trajectories, model.excitation),
    )
    events, outside = interval_events(motion, times)
    hardware, met = _hardware(model, drive, times)
    if claims is None:
        compared = (
            f"no margins were given to compare with; fastest change: {motion.largest('rates')}; "
            f"largest error of the scheduling: {motion.largest('errors')}"
        )
        return (*events, *hardware), (compared,), None
    left, covered = claim_events(motion, claims, model.excitation.step, times)
    return (*events, *left, *hardware), (), covered & ~outside & ~met


def once(values: Array) -> Array:
    """Return values (count, time, ...) at the first instant alone if they are constant in time."""
    return values[:, :1] if values.strides[1] == 0 else values


def throughout(model: Model, sampling: Sampling | None, learner: Learner | None) -> tuple[str, ...]:
    """Return notes on conditions of the whole drive that no claim covers."""
    notes = []
    if sampling is not None and not sampling.designed:
        late = f", {late_text(sampling.lateness.samples)}" if sampling.delay else ""
        notes.append(f"the controller samples every {sampling.period:g} s{late}: in no claim")
    if model.actuator.bandwidth is not None:
        notes.append(f"the actuator has {model.actuator.bandwidth:g} Hz: its lag is in no claim")
    if learner is not None:
        seen = learner.estimator.identifiable()
        for name, visible in zip(model.trajectories.space.names, seen, strict=False):
            if not visible:
                notes.append(f"the estimator cannot see {name}, which keeps its first value")
    return tuple(notes)


def given(model: Model, drive: Record) -> list[str]:
    """Say how often controllable dampers gave the demanded force; diverged cars are left out."""
    lines = list[str]()
    there = np.isfinite(drive.applied).all(axis=-1) if model.dampers else np.True_
    some: Any = ... if there.all() else there  # a mask copies; mostly all cars are there
    for k in (own.number for own in model.dampers):
        asked, gave = drive.demanded[some, k], drive.applied[some, k]
        if model.hardware.sampling is None and asked.any():
            share = float(np.mean(np.abs(asked - gave) <= TINY * np.abs(asked)))
            name = inputs(model.plant)[k].name
            lines.append(f"{name}: the damper gives what is demanded {share:.0%} of the time")
    return lines


def _hardware(model: Model, drive: Record, times: Array) -> tuple[list[Event], Any]:
    """Return events of hardware limits that are met, and the mask of them (count, time)."""
    events = list[Event]()
    met = np.zeros(drive.states.shape[:2], dtype=bool)
    limit = model.actuator.limit
    if limit is not None:
        size = reduce(np.maximum, np.abs(np.moveaxis(drive.demanded[..., : model.driven], -1, 0)))
        over = size > limit
        met |= over
        events += spans(
            "limit", over, size, times,
            lambda car, k: f"{size[car, k]:.4g} demanded of an actuator that gives {limit:g}",
        )  # fmt: skip
    if model.slew is not None:
        over = _as_fast_as_it_may(model, drive)
        met |= over
        most, still = model.actuator.slew, np.zeros(over.shape)
        events += spans(
            "rate limit", over, still, times,
            lambda *_: f"the force moves as fast as it may, {most:g} a second",
        )  # fmt: skip
    for i, name in enumerate(model.suspensions.names if model.suspensions else ()):
        force = drive.stops[..., i]
        met |= force != 0
        events += _stops(name, force, times)
    for kind, mask, size, words in (*_contact(model, drive), *_lost(drive)):
        met |= mask
        events += spans(kind, mask, size, times, lambda *_, words=words: words)
    return events, met


def _as_fast_as_it_may(model: Model, drive: Record) -> Array:
    """Return where an input is held back by its rate, (count, time)."""
    if model.slew is None:
        return np.zeros(drive.states.shape[:2], dtype=bool)
    (reach, followed), d, sampling = model.slew, model.driven, model.hardware.sampling
    demand = model.actuator.limited(drive.demanded[..., :d])
    if followed[0] >= model.plant.shape[0]:
        behind = demand - drive.applied[..., :d]
    elif followed[0] >= 0:
        behind = demand - drive.states[..., followed]
    else:  # each sample's step, as long as the sample lasts
        every = 1 if sampling is None else round(sampling.period / model.excitation.step)
        behind = np.zeros(demand.shape)
        behind[:, every:] = demand[:, every:] - demand[:, :-every]
        behind[:, :every] = demand[:, :every]
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(behind) > reach * (1 - 1e-9)).any(axis=-1))


def _stops(name: str, force: Array, times: Array) -> list[Event]:
    """Return events of one suspension's stops."""
    wheel = f"{name} " * bool(name)

    def words(car: int, k: int) -> str:
        which = "rebound" if force[car, k] < 0 else "bump"
        return f"{wheel}{which} stop hit, {abs(force[car, k]):.4g} N at most"

    return spans("stops", force != 0, np.abs(force), times, words)


def _contact(model: Model, drive: Record) -> list[tuple[str, Any, Array, str]]:
    """Return spans where the linear tyre would have to pull: the wheel has left the road."""
    known = model.known
    if known is None or known.tyre_force is None:
        return []
    row = known.tyre_force.arrays(model.plant)[0][0]
    force = drive.mass * GRAVITY
    for i in np.flatnonzero(row):
        force = force + row[i] * drive.states[..., i]
    return [("road", force < 0, -force, f"the tyre {LEAVES}")]


def _lost(drive: Record) -> list[tuple[str, Any, Array, str]]:
    if np.all(np.isfinite(drive.states[:, -1])):  # a state that has diverged stays so
        return []
    gone = ~np.all(np.isfinite(drive.states), axis=-1)
    return [("lost", gone, gone.astype(float), RUNS_AWAY)]


@dataclass(frozen=True)
class Event(Short):
    """One thing that happened to one car.

    Attributes
    ----------
    kind : str
        "interval": a parameter leaves its interval; "rate", "estimate": above the proved bound;
        "rate and estimate": both nonzero at once, which no margin covers; "limit": actuator
        saturation; "stops": a bump stop is hit; "road": the tyre leaves the road; "lost": the
        state diverges.
    car : int
        Number of the car, from 0.
    first : float
        Time of its first instant [s].
    duration : float
        Total duration [s], in whole steps; 0 for a single instant.
    text : str
        The event in words, with its worst value.
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
    """Return events where the margins do not cover the parameters' motion, and the covered mask.

    Returns
    -------
    events : list of Event
    covered : (count, time) array of bool
    """
    space = motion.space
    rates = measured_by(space, motion.rates, step)
    errors = measured_by(space, motion.errors)
    events, covered = list[Event](), np.ones(rates.shape[:2], dtype=bool)
    for kind, values, what, bounds, shown in (
        ("rate", rates, "rate of change", claims.rates, motion.rates),
        ("estimate", errors, "error of the scheduling", claims.errors, motion.errors),
    ):
        share = share_of_claim(values, bounds)

        def words(
            car: int, k: int, what: str = what, share: Array = share, shown: Array = shown,
            kind: str = kind,
        ) -> str:  # fmt: skip
            much = share[car, k]
            by = f"{much:.4g} times what is proved" if np.isfinite(much) else "beyond any margin"
            return (
                f"{what} above what is proved: {motion.words(shown[car, k], kind == 'rate')}, {by}"
            )

        events += spans(kind, share > 1, share, times, words)
        covered &= share <= 1
    both = (rates.max(axis=-1) > 0) & (errors.max(axis=-1) > 0) & covered
    events += spans(
        "rate and estimate",
        both,
        errors.max(axis=-1),
        times,
        lambda car, k: (
            "parameters move while the scheduling is wrong, each margin is proved without the "
            f"other: error {motion.words(motion.errors[car, k], False)}"
        ),
    )
    return events, covered & ~both


def interval_events(motion: Motion, times: Array) -> tuple[list[Event], Any]:
    """Return events of parameters outside their intervals, and the mask of them (count, time)."""
    space, events = motion.space, list[Event]()
    away = np.broadcast_to(space.distance(once(motion.true)), motion.true.shape)
    for i, name in enumerate(space.names):
        distance = away[..., i]

        def words(car: int, k: int, i: int = i, name: str = name) -> str:
            value, unit = motion.true[car, k, i], space.units[i]
            bounds = f"[{space.low[i]:g}, {space.high[i]:g}]"
            return f"{name} = {value:.6g} {unit}".rstrip() + f" outside {bounds}, at worst"

        events += spans("interval", distance > 0, distance, times, words)
    outside = (once(away) > 0).any(axis=-1)
    return events, np.broadcast_to(outside, away.shape[:2])


def spans(
    kind: str, mask: Any, size: Array, times: Array, words: Callable[[int, int], str]
) -> list[Event]:
    """Return one event for every car whose ``mask`` (count, time) is true at some instant.

    ``words`` is called with the car and the instant of the largest ``size`` within its mask.
    """
    step, events = times[1] - times[0], list[Event]()
    for car in np.flatnonzero(mask.any(axis=1)):
        inside = mask[car]
        worst = int(np.argmax(np.where(inside, size[car], -np.inf)))
        first, lasting = times[int(np.argmax(inside))], np.count_nonzero(inside[:-1]) * step
        text = words(int(car), worst)
        events.append(Event(kind, int(car), float(first), float(lasting), text))
    return events


def summary(events: Sequence[Event], count: int) -> list[str]:
    """Return one line per kind of event; for several cars, with the earliest event."""
    if count == 1:
        return [str(event) for event in events]
    lines = []
    for kind in dict.fromkeys(event.kind for event in events):
        alike = [event for event in events if event.kind == kind]
        cars = len({event.car for event in alike})
        early = min(alike, key=lambda event: event.first)
        lines.append(f"{kind}: {cars} of {count} cars; car {early.car}: {early}")
    return lines


@dataclass(frozen=True, eq=False)
class Claims(Short):
    """Bounds proved by margins: one row per claim, in the parameters' units.

    A bound is infinite where any rate is allowed. For a plant given by its vertices a row has one
    number, the change of the weights alpha.
    """

    errors: tuple[Array, ...] = ()
    rates: tuple[Array, ...] = ()


def read_margins(given: Any, space: Space, law: Any) -> Claims | None:
    """Return the claims of margins in service; None without margins.

    Raises
    ------
    InputError
        If they are not margins, or are those of another plant or law.
    """
    if given is None:
        return None
    if isinstance(given, Margin | Design):
        given = (given,)
    if isinstance(given, Margins):
        _require_same(given, space, law)
    elif not (isinstance(given, Sequence) and all(isinstance(m, Margin | Design) for m in given)):
        raise InputError("margins must be what in_service(design) returns, or a list of its parts")
    width = len(space.plant.parameters) or 1
    bounds: dict[str, list[Array]] = {"estimate": [], "rate": [], "gain": []}
    for margin in given:
        if isinstance(margin, Design):
            bounds["rate"] += _rates_of(margin)
            continue
        claim: Any = margin.claim
        if margin.kind == "gain" or claim is None:
            continue
        values = claim.errors if margin.kind == "estimate" else claim.rates
        row = np.full(width, math.inf) if values is None else np.array([float(v) for v in values])
        if len(row) != width:
            raise InputError(f"margin {margin.name} is of another plant than {space.plant.name}")
        bounds[margin.kind].append(row)
    return Claims(tuple(bounds["estimate"]), tuple(bounds["rate"]))


def _rates_of(design: Design) -> list[Array]:
    """Return the rates of its spec, which a design with a half-plane is proved for."""
    parts = design.region.parts
    if design.plant.period or not any(isinstance(part, HalfPlane) for part in parts):
        return []
    if not design.plant.moving:
        return []
    rates = (parameter.rate for parameter in design.plant.parameters)
    return [
        np.array(
            [
                0.0 if r is None else math.inf if isinstance(r, str) else float(min(map(abs, r)))
                for r in rates
            ]
        )
    ]


def _require_same(service: Margins, space: Space, law: Any) -> None:
    plant = service.design.plant
    if plant.digest != space.plant.digest or plant.parameters != space.plant.parameters:
        raise InputError(f"the margins are of {plant.name}, not of {space.plant.name}")
    theirs = given_law(plant, service.design.law)
    driven = None if law is None else law_or_table(plant, law)
    if driven is None or driven.exact != theirs.exact:
        raise InputError("the margins are another law's; give those of the law that drives")


def is_scheduled(space: Space, law: Any) -> bool:
    """Whether the law looks at the parameters at all."""
    return law is not None and not law_or_table(space.plant, law).fixed


def rates_of(trajectories: Trajectories, excitation: Excitation) -> Array:
    """Return the parameters' rates in the step after every instant, (count, time, q).

    They are in units per second, and infinite where a parameter jumps at the instant.
    """
    k: Any = np.arange(excitation.steps)
    start = trajectories.at((k + INSIDE) * excitation.step)
    shape = (excitation.steps + 1, *start.shape[1:])
    if trajectories.constant:
        return np.broadcast_to(0.0, (shape[1], shape[0], shape[2]))
    end = trajectories.at((k + 1 - INSIDE) * excitation.step)
    rates = np.zeros(shape)
    rates[:-1] = np.abs(end - start) / excitation.step
    # a larger change at an instant is a jump
    gap = np.abs(start[1:] - end[:-1]) > 1e-6 * (trajectories.space.high - trajectories.space.low)
    rates[1:-1][gap] = math.inf
    return np.swapaxes(rates, 0, 1)


def measured_by(space: Space, values: Array, seconds: float = 1.0) -> Array:
    """Set rounding errors in values (..., q) to zero, and convert to a claim's width (q or 1).

    Parameters
    ----------
    seconds : float
        Factor from rates to changes that are compared with the range.
    """
    rounding = values * seconds <= TINY * (space.high - space.low)
    measured = np.where(rounding, 0.0, values)
    return measured if space.plant.parameters else measured.sum(axis=-1, keepdims=True) / 2


def share_of_claim(values: Array, claims: Sequence[Array]) -> Array:
    """Return the least ratio (...) of values (..., q) to a bound; above 1 no claim covers them.

    Without a claim the ratio of any nonzero value is infinite.
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
