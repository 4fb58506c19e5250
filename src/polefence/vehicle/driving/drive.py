"""Drives: a plant under a law over time, with parameters that move and hardware that is real.

    x' = A(p(t)) x + B(p(t)) u + E(p(t)) w,    u = K(p^(t)) x

p^ is what the law is told of p: the truth, late and noisy readings, or estimates. Between law and
plant there may be a controller that samples, an actuator with lag and limit; beside it bump stops.
What leaves the guarantee of the law is reported as events.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.vehicle.driving.events import is_scheduled, read_margins
from polefence.vehicle.driving.integration import Controller, Learner, integrate, stages
from polefence.vehicle.driving.model import INSIDE, Model, Reading, gains_of
from polefence.vehicle.driving.parts import Estimated, Hardware, Measured
from polefence.vehicle.driving.result import Drive, assessed, record, throughout
from polefence.vehicle.driving.trajectories import Trajectories, read_trajectories
from polefence.vehicle.estimate import Estimate, collected, estimator
from polefence.vehicle.excitation import Excitation
from polefence.vehicle.vehicle import require_ride, ride

ESTIMATOR_PERIOD = 0.005  # [s]

LOOKS = 20  # instants at which poles are looked at


def drive(
    plant: UncertainPlant,
    law: Any,
    excitation: Excitation,
    parameters: Any = None,
    hardware: Hardware | None = None,
    margins: Any = None,
    outside: bool = False,
    adaptive: bool = False,
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
    margins : Margins, Margin or sequence of Margin, optional
        What is proved of rates and of errors of the estimate, to compare with.
    outside : bool
        Drive on where parameters leave their intervals; it is reported.
    adaptive : bool
        Error control within each step, of order eight, relative 1e-10.

    Raises
    ------
    InputError
        If an argument cannot be used; of a fixed step that is too long, the bound is named.
    """
    if plant.sample_time is not None:
        raise InputError(f"{plant.name} is in discrete time; drives are of continuous time")
    parts = hardware or Hardware()
    trajectories = read_trajectories(plant, parameters, excitation.times)
    trajectories.check(excitation.times, outside)
    space, sampling = trajectories.space, parts.sampling
    claims, scheduled = read_margins(margins, space, law), is_scheduled(space, law)
    known = require_ride(plant) if parts.of_a_car else ride(plant)
    source = _source(trajectories, excitation, parts)
    follows = source if sampling is None else None
    gains = gains_of(space, law)
    model = Model(plant, excitation, trajectories, gains, follows, parts, known)
    begin = np.zeros((len(trajectories.cars), model.width))
    first = np.array([INSIDE * excitation.step])
    begin[:, : plant.shape[0]] = excitation.begin(plant, space.alpha(trajectories.at(first)[0]))
    controller, learned = _controller(model, source)
    if not adaptive:
        require_step(model, trajectories, sampling is not None)
    solution = integrate(model, controller, begin, adaptive)
    own = record(model, solution, source)
    events, notes, covered = assessed(model, own, claims, scheduled)
    notes = (*notes, *throughout(model, sampling, learned.learner if learned else None))
    return Drive(
        plant, excitation.times, own.states, own.rates, own.demanded, own.applied, own.disturbance,
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


def _source(trajectories: Trajectories, excitation: Excitation, parts: Hardware) -> Reading | None:
    """Return what the law is told where that does not depend on the state."""
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
    period = how.period or (sampling.period if sampling else ESTIMATOR_PERIOD)
    pace = multiple(period, step, "period of the estimator")
    learner = Learner(model, known, estimator(model.plant, period, how.tuning), how)
    return Controller(model, sampling, learner, (every, pace)), _Learned(learner, period)


def multiple(period: float, step: float, what: str) -> int:
    """Return how many steps a period has.

    Raises
    ------
    InputError
        If it is no multiple of the step.
    """
    count = round(period / step)
    if count < 1 or abs(period - count * step) > 1e-6 * step:
        near = max(count, 1) * step
        raise InputError(
            f"{what} = {period:g} s is no multiple of the step, {step:g} s; use {near:.6g} s, or "
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
    k = np.unique(np.linspace(0, steps - 1, LOOKS).astype(int))
    every = stages(model, k)
    F = every.F
    if every.K is not None:
        F = F + every.B @ every.K
    elif model.reading is None and not settled:
        space = trajectories.space
        corners = space.values(np.eye(len(model.plant.vertices)))
        K = model.padded(model.gains(corners))
        F = (F + every.B @ K[:, None, None]).reshape(-1, *F.shape[-2:])
    found = _largest(F)
    if model.stops is not None and model.known is not None:
        x, sense, stops = model.known.places[0], model.known.sense[0], model.stops
        row = sense * stops.damping * F[..., x, :]
        row[..., x] += sense * stops.stiffness
        found = max(found, _largest(F + every.S[..., :, None] * row[..., None, :]))
    return max(found, model.actuator.rate)


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
