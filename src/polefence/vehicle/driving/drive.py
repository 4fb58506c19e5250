"""Drives: a plant under a law over time, with parameters that move and hardware that is real.

    x' = A(p(t)) x + B(p(t)) u + E(p(t)) w,    u = K(p^(t)) x

p^ is what the law is told of p: the truth, late and noisy readings, or estimates. Between law and
plant there may be a controller that samples, an actuator with lag and limit; beside it bump stops.
What leaves the guarantee of the law is reported as events. Where nothing changes or saturates,
`run` follows the plant exactly instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product as cartesian
from typing import Any, Literal

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.law.laws import given_law
from polefence.law.stepped import stepped
from polefence.plant.cars import Car
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.plant.outputs import Output, inputs, states
from polefence.plant.system import Array
from polefence.region.text import digits_down
from polefence.response import linear
from polefence.response.closed import close
from polefence.response.discrete import Sampling
from polefence.response.grid import longest_step
from polefence.response.linear import Response
from polefence.vehicle.contact import GRAVITY, static_loads, tyre_forces
from polefence.vehicle.driving.compiled import compiled, recorded
from polefence.vehicle.driving.integration import (
    INSIDE,
    LOST,
    Controller,
    Learner,
    Model,
    Pieces,
    Reading,
    gains_of,
    integrate,
    stages,
)
from polefence.vehicle.driving.parts import Actuator, Estimated, Hardware, Measured
from polefence.vehicle.driving.result import (
    LEAVES,
    RUNS_AWAY,
    Drive,
    Event,
    assessed,
    given,
    is_scheduled,
    read_margins,
    record,
    spans,
    summary,
    throughout,
)
from polefence.vehicle.driving.trajectories import Trajectories, read_trajectories
from polefence.vehicle.estimate import Estimate, collected, estimator
from polefence.vehicle.excitation import Excitation
from polefence.vehicle.suspensions import suspensions
from polefence.vehicle.vehicle import masses, require_ride, ride

Column = tuple[str, str, Array]


@dataclass(frozen=True, eq=False)
class Setup:
    """A plant, its excitation and its hardware.

    Attributes
    ----------
    plant : UncertainPlant
    excitation : Excitation
    parameters : mapping or array, optional
        As `drive` takes them, for one plant.
    outside : bool
        Drive on where parameters leave their intervals.
    hardware : Hardware
        As `drive` takes it.
    car : Car, optional
        Of a plant that is one on several wheels, which are then watched.
    """

    plant: UncertainPlant
    excitation: Excitation
    parameters: Mapping[str, Any] | Array | None = None
    outside: bool = False
    hardware: Hardware = field(default_factory=Hardware)
    car: Car | None = None

    @property
    def time(self) -> Array:
        """All instants [s]."""
        return self.excitation.times

    @property
    def step(self) -> float:
        """Between instants [s]."""
        return self.excitation.step

    @cached_property
    def trajectories(self) -> Trajectories:
        """Parameters over time, checked."""
        trajectories = read_trajectories(self.plant, self.parameters, self.time)
        trajectories.check(self.time, self.outside)
        return trajectories

    @cached_property
    def alpha(self) -> Array:
        """Weights of the vertices at time 0, (1, N)."""
        return self.trajectories.space.alpha(self.trajectories.at(np.zeros(1))[0])

    @property
    def still(self) -> bool:
        """Whether parameters are constant and the law is given their true values."""
        return self.trajectories.constant and not self.hardware.learns

    @property
    def exact(self) -> bool:
        """Whether the loop is linear and constant: no hardware, no moving parameter."""
        return self.hardware == Hardware() and self.still and not self.outside


@dataclass(frozen=True, eq=False)
class Run:
    """Outcome of a run.

    Attributes
    ----------
    setup : Setup
    response : Response
        All signals, of one car.
    more : tuple of (name, unit, values)
        What else there was: demands, forces of the stops, parameters.
    events : tuple of Event
    notes : tuple of str
        As those of a `Drive`.
    covered : (time,) array of bool, optional
        As that of a `Drive`; None where no margins were given.
    """

    setup: Setup
    response: Response
    more: tuple[Column, ...] = ()
    events: tuple[Event, ...] = ()
    notes: tuple[str, ...] = ()
    covered: Any = None

    @property
    def lost(self) -> Event | None:
        """The time since which a diverged loop is lost."""
        return next((event for event in self.events if event.kind == "lost"), None)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Name, unit and values (time,) of every signal."""
        signals = zip(self.response.signals, self.response.values[0].T, strict=True)
        return (*((s.name, s.unit, values) for s, values in signals), *self.more)

    def report(self) -> list[str]:
        """Return lines on where the guarantee does not hold, and on what no claim covers."""
        lines = summary(self.events, 1) or ["no limit was met"]
        if self.covered is not None:
            end = self.response.time[-1]
            lasting = self.covered[:-1].mean() * end
            lines = [f"the margins cover {digits_down(lasting)} s of {end:g} s", *lines]
        return lines + [f"note: {note}" for note in self.notes]


def run(setup: Setup, law: Any, margins: Any = None) -> Run:
    """Follow one plant under one law.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    margins : Margins, Margin, Design or sequence of these, optional
        As `drive` takes them; not looked at where nothing moves and the law is told the truth.

    Raises
    ------
    InputError
        If the step is too long for the fastest pole (the bound is named), parameters leave their
        intervals, or as `linear.simulate` and `drive` raise.
    """
    plant, asked, moved = setup.plant, signals(setup.plant), setup.excitation
    if setup.exact:
        start = moved.begin(plant, setup.alpha)
        hold: Literal["held", "linear"] = "held" if moved.held else "linear"
        w = moved.samples if plant.disturbance_count else None
        response = linear.simulate(plant, law, setup.alpha, w, setup.time, asked, hold, start)
        wheels = _wheels(setup.car, setup.alpha, response)
        events = (*_contact(response), *wheels, *_lost(response))
        return Run(setup, response, events=events)
    if setup.still:
        margins = ()
    parameters, car = setup.parameters, setup.car
    done = drive(plant, law, moved, parameters, setup.hardware, margins, setup.outside, car=car)
    more = list[Column]()
    parts = setup.hardware
    if law is not None and (
        parts.sampling is not None or parts.actuator != Actuator() or parts.dampers
    ):
        for j, signal in enumerate(_acting(plant)):
            more.append((f"{signal.name} demanded", signal.unit, done.demanded[0, :, j]))
    names = ("",) if setup.car is None else [f"{wheel.name} " for wheel in setup.car.wheels]
    for wheel, force in zip(names, done.stop_forces[0].T, strict=False):
        more.append((f"{wheel}stop force", "N", force))
    if not setup.still:
        space = setup.trajectories.space
        for i, (name, unit) in enumerate(zip(space.names, space.units, strict=True)):
            more.append((name, unit, done.parameters[0, :, i]))
            if setup.hardware.learns:
                more.append((f"{name} estimated", unit, done.used[0, :, i]))
    covered = None if setup.still or done.covered is None else done.covered[0]
    notes, response = (*done.notes, *_slow(setup, law)), done.response(asked)
    return Run(setup, response, tuple(more), done.events, notes, covered)


def signals(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return all states, outputs and inputs, but for the rates of a law's own states."""
    return (*states(plant), *plant.every_output, *_acting(plant))


def _acting(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return the inputs that act on the plant: not rates of a law's own states."""
    return tuple(inputs(plant)[: plant.shape[1] - own_states(plant)])


def _slow(setup: Setup, law: Any) -> list[str]:
    """Return a note where a controller samples more slowly than the loop's poles."""
    sampling = setup.hardware.sampling
    if sampling is None or sampling.designed or law is None:
        return []
    first = setup.trajectories.space.inside(setup.trajectories.at(np.zeros(1))[0])
    alpha = setup.trajectories.space.alpha(first)
    bound = longest_step(close(setup.plant, law, alpha, disturbed=False))
    if sampling.period <= bound:
        return []
    return [f"the fastest pole that the law sets asks for a period of at most {bound:.3g} s"]


def static_load(setup: Setup) -> dict[str, Array]:
    """Return the static load of each tyre over time [N], by the name of its force variation.

    Where the variation falls below minus this, the tyre is off the road.
    """
    plant, known, alpha = setup.plant, ride(setup.plant), setup.alpha
    if not setup.trajectories.constant:
        alpha = setup.trajectories.space.alpha(setup.trajectories.at(setup.time)[:, 0])
    if setup.car is not None:
        names = [force.name for force in tyre_forces(plant, setup.car)]
        loads = static_loads(plant, setup.car, alpha)
    elif known is not None and known.tyre_force is not None:
        car, names = masses(plant, known, alpha), [known.tyre_force.name]
        loads = ((car.m1 + car.m2) * GRAVITY)[:, None]
    else:
        return {}
    shape = (len(setup.time), len(names))
    return dict(zip(names, np.broadcast_to(loads, shape).T, strict=True))


def _contact(response: Response) -> list[Event]:
    """Return spans where a quarter car's tyre would have to pull: the wheel has left the road."""
    plant, known = response.plant, ride(response.plant)
    if known is None:
        return []
    car = masses(plant, known, response.alpha)
    weight = ((car.m1 + car.m2) * GRAVITY)[:, None]
    force = weight + known.sense[1] * car.kt[:, None] * response.of(known.tyre.name)
    return spans("road", force < 0, -force, response.time, lambda *_: f"the tyre {LEAVES}")


def _wheels(car: Car | None, alpha: Array, response: Response) -> list[Event]:
    """Return spans where a tyre of a car on several wheels would have to pull.

    ``alpha`` is (count, N), or over time (count, time, N).
    """
    if car is None:
        return []
    loads, events = static_loads(response.plant, car, alpha), list[Event]()
    loads = loads[:, None] if loads.ndim == 2 else loads
    for i, variation in enumerate(tyre_forces(response.plant, car)):
        force = loads[..., i] + response.of(variation.name)
        words = f"the {car.wheels[i].name} tyre {LEAVES}"
        with np.errstate(invalid="ignore"):
            gone = force < 0
        events += spans("road", gone, -force, response.time, lambda *_, words=words: words)
    return events


def _lost(response: Response) -> list[Event]:
    """Return the event of a state that first exceeds the limit of a drive."""
    size = np.abs(response.values[:, :, : response.plant.shape[0]]).max(axis=2)
    return spans("lost", size >= LOST, size, response.time, lambda *_: RUNS_AWAY)


@explained
def drive(
    plant: UncertainPlant,
    law: Any,
    excitation: Excitation,
    parameters: Any = None,
    hardware: Hardware | None = None,
    margins: Any = None,
    outside: bool = False,
    adaptive: bool = False,
    car: Car | None = None,
) -> Drive:
    """Drive one car or many, or any other plant.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    excitation : Excitation
        What moves it, for how long, and the fixed step of Runge-Kutta of order four: `on_road`,
        `disturbed`, `excited` or `recorded` gives one.
    parameters : mapping, list of mappings, array or function, optional
        For each parameter a number, `Jump`, `Ramp`, `Sine`, function of times, or array of values
        at all instants; a list has one mapping for each car. Or weights alpha, (N,) or (count,
        N), or a function of times that returns all values (time, q). Nominal values by default.
    hardware : Hardware, optional
        Scheduling, sampling, actuator, stops; by default none of them.
    margins : Margins, Margin, Design or sequence of these, optional
        What is proved of rates and of errors of the estimate, to compare with.
    outside : bool
        Drive on where parameters leave their intervals; it is reported.
    adaptive : bool
        Error control within each step, of order eight, relative 1e-10.
    car : Car, optional
        Of a plant that is one on several wheels: each of its suspensions has the stops.

    Raises
    ------
    InputError
        If an argument cannot be used; of a fixed step that is too long, the bound is named.
    """
    if plant.sample_time is not None:
        raise InputError(f"{plant.name} is in discrete time; drives need continuous time")
    parts = hardware or Hardware()
    asked, (plant, law, back) = plant, _recovering(plant, law, parts.sampling)
    trajectories = read_trajectories(plant, parameters, excitation.times)
    trajectories.check(excitation.times, outside)
    space, sampling = trajectories.space, parts.sampling
    claims, scheduled = read_margins(margins, space, law), is_scheduled(space, law)
    known = require_ride(plant) if parts.of_a_quarter_car else ride(plant)
    stopped = None if parts.stops is None else suspensions(plant, car)
    source = _source(trajectories, excitation, parts)
    follows = source if sampling is None else None
    constant = trajectories.constant and not parts.learns
    gains = gains_of(space, law, trajectories.at(np.zeros(1))[0] if constant else None)
    model = Model(plant, excitation, trajectories, gains, follows, parts, known, stopped, back)
    begin = np.zeros((len(trajectories.cars), model.width))
    first = np.array([INSIDE * excitation.step])
    begin[:, : plant.shape[0]] = excitation.begin(plant, space.alpha(trajectories.at(first)[0]))
    controller, learned = _controller(model, source)
    if not adaptive:
        require_step(model, trajectories, sampling is not None)
    if adaptive or compiled() is None:
        history = record(model, integrate(model, controller, begin, adaptive), source)
    else:
        history = recorded(model, controller, begin)
    events, notes, covered = assessed(model, history, claims, scheduled)
    notes = (*notes, *throughout(model, sampling, learned.learner if learned else None))
    notes = (*notes, *given(model, history))
    m = asked.shape[1]  # of a PID's own states there are no rates
    demanded, applied = (u[..., :m] for u in (history.demanded, history.applied))
    done = Drive(
        asked, excitation.times, history.states, history.rates, demanded, applied,
        history.disturbance, history.stops, history.parameters, history.used, events, notes,
        covered, learned.estimate() if learned else None,
    )  # fmt: skip
    if car is None:
        return done
    times = first if trajectories.constant else excitation.times
    alpha = np.swapaxes(space.alpha(trajectories.at(times)), 0, 1)
    lifted = _wheels(car, alpha, done.response(tyre_forces(asked, car)))
    return replace(done, events=(*events, *lifted))


def _recovering(
    plant: UncertainPlant, law: Any, sampling: Sampling | None
) -> tuple[UncertainPlant, Any, Array | None]:
    """Return a law with anti-windup as one that steps its own states, with the gain of their rates.

    So is one that was designed for inputs that are late: on its way is what will act, not the
    demand. Any other law is returned as it is, with none.
    """
    given = getattr(law, "law", law)
    late = sampling is not None and sampling.designed and sampling.delay > 0
    if given is None or (getattr(given, "anti_windup", None) is None and not late):
        return plant, law, None
    larger, own = stepped(plant, given_law(plant, given))
    kept = own_states(larger)
    driven = larger.shape[1] - kept
    gain = np.zeros((kept, driven))
    if own.anti_windup is not None:
        gain += np.asarray(own.anti_windup)[-kept:, :driven]
    if late and sampling is not None:
        gain[:driven] = np.eye(driven) / sampling.period
    return larger, own, gain


@dataclass(frozen=True, eq=False)
class _Learned:
    learner: Learner
    period: float

    def estimate(self) -> Estimate:
        beliefs = self.learner.beliefs
        return collected(self.learner.estimator, self.period * np.arange(len(beliefs)), beliefs)


def _source(trajectories: Trajectories, excitation: Excitation, parts: Hardware) -> Reading | None:
    """Return the source of the law's parameters where it does not depend on the state."""
    if isinstance(parts.scheduling, Estimated):
        return None
    how = parts.scheduling or Measured()
    held = how.period or (parts.sampling.period if parts.sampling else excitation.step)
    return Reading(trajectories, how, excitation, held)


def _controller(model: Model, source: Reading | None) -> tuple[Controller | None, _Learned | None]:
    scheduling, sampling = model.hardware.scheduling, model.hardware.sampling
    step = model.excitation.step
    every = multiple(sampling.period, step, "sampling period") if sampling else 1
    if source is not None:
        return (Controller(model, sampling, source, (every, 1)) if sampling else None), None
    how = scheduling if isinstance(scheduling, Estimated) else Estimated()
    known = require_ride(model.plant)
    if not model.plant.parameters:
        raise InputError(f"{model.plant.name} has no parameters that could be estimated")
    period = how.period or (sampling.period if sampling else 0.005)  # [s]
    pace = multiple(period, step, "period of the estimator")
    learner = Learner(model, known, estimator(model.plant, period, how.tuning), how)
    return Controller(model, sampling, learner, (every, pace)), _Learned(learner, period)


def multiple(period: float, step: float, what: str) -> int:
    """Return how many steps a period has; refuse one that is not a multiple.

    Raises
    ------
    InputError
        If it is no multiple of the step.
    """
    count = round(period / step)
    if count < 1 or abs(period - count * step) > 1e-6 * step:
        near = max(count, 1) * step
        raise InputError(
            f"{what} = {period:g} s is not a multiple of the step, "
            f"{step:g} s; use {near:.6g} s, or "
            "another step"
        )
    return count


def fastest_pole(model: Model, trajectories: Trajectories, settled: bool) -> float:
    """Return the largest |pole| [1/s] of plant, law, actuator and stops, at instants of the drive.

    Parameters
    ----------
    settled : bool
        The demand is held over a step, so that the law makes no poles; else, where the law is not
        known beforehand, it is looked at at the corners of the family.
    """
    steps = model.excitation.steps
    k = np.unique(np.linspace(0, steps - 1, 20).astype(int))
    every = stages(model, Pieces(k))
    K = every.K
    if K is None and model.reading is None and not settled:
        corners = trajectories.space.values(np.eye(len(model.plant.vertices)))
        K = model.padded(model.gains(corners))[:, None, None]
    fastest = model.actuator.rate
    for gain in _gains(model, K):
        F = every.F if gain is None else every.F + every.B @ gain
        fastest = max(fastest, _largest(F))
        if model.stops is not None:
            d, stops = model.stopped, model.stops
            fastest = max(
                fastest, _largest(F + every.S @ (stops.stiffness * d + stops.damping * d @ F))
            )
    return fastest


def _gains(model: Model, K: Array | None) -> Iterator[Array | None]:
    """Yield K for each case of the dampers: as demanded, or at either bound."""
    if not model.dampers:
        yield K
        return
    K = np.zeros((model.plant.shape[1], model.width)) if K is None else K
    for choice in cartesian(*((None, *own.ends) for own in model.dampers)):
        gain = K.copy()
        for own, c in zip(model.dampers, choice, strict=True):
            if c is not None:
                gain[..., own.number, :] = 0
                gain[..., own.number, : len(own.rate)] = c * own.rate
        yield gain


def _largest(F: Array) -> float:
    return float(np.abs(np.linalg.eigvals(F)).max())


def require_step(model: Model, trajectories: Trajectories, settled: bool) -> None:
    """Refuse a fixed step longer than the fastest time constant, 1 / |pole|.

    Runge-Kutta of order four is stable to 2.8 of it; at 1 its error in a step is below 1 %.

    Raises
    ------
    InputError
        Naming the bound.
    """
    fastest, h = fastest_pole(model, trajectories, settled), model.excitation.step
    if fastest * h > 1:
        digits = 10.0 ** (2 - math.floor(math.log10(1 / fastest)))
        bound = math.floor(digits / fastest) / digits
        raise InputError(
            f"step = {h:g} s is too long for the fastest pole, {fastest:.4g} 1/s in size; use at "
            f"most {bound:g} s"
        )
