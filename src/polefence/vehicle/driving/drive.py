"""Drives: a plant under a law over time, with parameters that move and hardware that is real.

    x' = A(p(t)) x + B(p(t)) u + E(p(t)) w,    u = K(p^(t)) x

p^ is what the law is told of p: the truth, late and noisy readings, or estimates. Between law and
plant there may be a controller that samples, an actuator with lag and limit; beside it bump stops.
What leaves the guarantee of the law is reported as events.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.vehicle.driving.assessment import judged, throughout
from polefence.vehicle.driving.controller import Controller, Learner
from polefence.vehicle.driving.integration import march
from polefence.vehicle.driving.margins import is_scheduled, read_margins
from polefence.vehicle.driving.model import Model
from polefence.vehicle.driving.parts import (
    Actuator,
    BumpStops,
    Estimated,
    Measured,
    Sampling,
    Scheduling,
)
from polefence.vehicle.driving.record import record
from polefence.vehicle.driving.result import Drive
from polefence.vehicle.driving.scheduling import Grid, Reading, gains_of
from polefence.vehicle.driving.setup import multiple, read_grid, read_start, require_step
from polefence.vehicle.driving.trajectories import Courses, read_courses
from polefence.vehicle.estimate import Estimate, collected
from polefence.vehicle.recursion import estimator
from polefence.vehicle.vehicle import Ride, require_ride, ride

ESTIMATOR_PERIOD = 0.005  # [s]


def drive(
    plant: UncertainPlant,
    law: Any,
    road: Any = None,
    *,
    speed: float | None = None,
    duration: float | None = None,
    step: float = 1e-3,
    hold: str = "linear",
    parameters: Any = None,
    outside: bool = False,
    scheduling: Scheduling | None = None,
    sampling: Sampling | None = None,
    actuator: Actuator | None = None,
    stops: BumpStops | None = None,
    gravity: float = 0.0,
    start: Any = None,
    margins: Any = None,
    adaptive: bool = False,
) -> Drive:
    """Drive one car or many.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    road : Road, samples (time,) or (time, q), function of times, or None
        Vertical velocity [m/s]; a `Road` needs ``speed`` and is held over each step as it says;
        a function needs ``duration``; None: no road, from ``start``.
    speed, duration : float, optional
        [m/s], [s]
    step : float
        Between instants [s]; also the fixed step of Runge-Kutta of order four.
    hold : "linear" or "held"
        What samples do in between: run straight to the next, or stay.
    parameters : mapping, list of mappings, array or function, optional
        For each parameter a number, `Jump`, `Ramp`, `Sine`, function of times, or array of values
        at all instants; a list has one mapping for each car. Or weights alpha, (N,) or (count,
        N), or a function of times that returns all values (time, q). Nominal values by default.
    outside : bool
        Drive on where parameters leave their intervals; it is reported.
    scheduling : Measured or Estimated, optional
        What the law is told of the parameters; by default the truth.
    sampling : Sampling, optional
        Of the controller; continuous by default.
    actuator : Actuator, optional
    stops : BumpStops, optional
        Of a quarter car.
    gravity : float
        [m/s2] Of a quarter car: deflections then count from the equilibrium of the first load,
        and a change of load pulls the car down. By default they count from that of the current
        load, as the plant has them, and a change of load moves nothing that is at rest.
    start : (n,) or (count, n) array, optional
        State at time 0; zero by default.
    margins : Service, Margin or sequence of Margin, optional
        What is proved of rates and of errors of the estimate, to compare with.
    adaptive : bool
        Error control within each step, of order eight, relative 1e-10.

    Raises
    ------
    InputError
        If an argument cannot be used; of a fixed step that is too long, the bound is named.
    """
    if plant.sample_time is not None:
        raise InputError(f"{plant.name} is in discrete time; drives are of continuous time")
    grid = read_grid(plant, road, speed, duration, step, hold)
    courses = read_courses(plant, parameters, grid.times)
    courses.check(grid.times, outside)
    space = courses.space
    claims, scheduled = read_margins(margins, space, law), is_scheduled(space, law)
    learns = isinstance(scheduling, Estimated)
    known = _vehicle(plant, stops is not None or gravity != 0 or learns)
    source = _source(courses, grid, scheduling, sampling)
    follows = source if sampling is None else None
    model = Model(
        plant, grid, courses, gains_of(space, law), follows, actuator or Actuator(), stops, known,
        gravity,
    )  # fmt: skip
    begin = read_start(start, len(courses.cars), plant.shape[0], model.width)
    controller, learned = _controller(model, source, scheduling, sampling)
    if not adaptive:
        require_step(model, courses, sampling is not None)
    marched = march(model, controller, begin, adaptive)
    own = record(model, marched, source)
    events, notes, covered = judged(model, own, claims, scheduled)
    notes = (*notes, *throughout(model, sampling, learned.learner if learned else None))
    return Drive(
        plant, grid.times, own.states, own.rates, own.demanded, own.applied, own.disturbance,
        own.stops, own.parameters, own.used, events, notes, covered,
        learned.estimate() if learned else None,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Learned:
    learner: Learner
    period: float

    def estimate(self) -> Estimate:
        beliefs = self.learner.beliefs
        return collected(self.learner.own, self.period * np.arange(len(beliefs)), beliefs)


def _vehicle(plant: UncertainPlant, needed: bool) -> Ride | None:
    """Return the ride of a plant that is a quarter car; refuse another where one is needed."""
    if not needed:
        return ride(plant)
    return require_ride(plant)


def _source(
    courses: Courses, grid: Grid, scheduling: Scheduling | None, sampling: Sampling | None
) -> Reading | None:
    """Return what the law is told where that does not depend on the state."""
    if isinstance(scheduling, Estimated):
        return None
    how = scheduling or Measured()
    held = how.period or (sampling.period if sampling else grid.step)
    return Reading(courses, how, grid, held)


def _controller(
    model: Model, source: Reading | None, scheduling: Scheduling | None, sampling: Sampling | None
) -> tuple[Controller | None, _Learned | None]:
    step = model.grid.step
    every = multiple(sampling.period, step, "sampling period") if sampling else 1
    if source is not None:
        return (Controller(model, sampling, source, (every, 1)) if sampling else None), None
    how = scheduling if isinstance(scheduling, Estimated) else Estimated()
    known = require_ride(model.plant)
    if not model.plant.parameters:
        raise InputError(f"{model.plant.name} has no parameters that could be estimated")
    period = how.period or (sampling.period if sampling else ESTIMATOR_PERIOD)
    pace = multiple(period, step, "period of the estimator")
    learner = Learner(model, known, estimator(model.plant, period, how.tuning), how)
    return Controller(model, sampling, learner, (every, pace)), _Learned(learner, period)
