"""Steps of Runge-Kutta in the compiled kernel: a stretch of them for all cars in one call.

What is the case at every instant is recorded on the way.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.base.kernel import kernel
from polefence.base.processors import spare_processors
from polefence.plant.system import Array
from polefence.vehicle.driving.integration import (
    INSIDE,
    Controller,
    Learner,
    Model,
    Pieces,
    stage_times,
)
from polefence.vehicle.driving.result import (
    Record,
    instants,
    loads_over_time,
    parameters_over_time,
)

# Numbers held at once for what changes from step to step.
CHUNK = 2_000_000
BY_GAIN, HELD, SAMPLED = range(3)  # the kernel's modes


def compiled() -> Any:
    """Return the kernel's function, None where it was not built."""
    return getattr(kernel(), "drive", None)


def recorded(model: Model, controller: Controller | None, start: Array) -> Record:
    """Integrate in the kernel; return the same record as `driving.result.record`.

    Parameters
    ----------
    start : (count, width) array
    """
    way = _Way(model, controller, start)
    if controller is not None and way.learner is not None:
        used = way.learned(controller, way.learner)
    else:
        way.go(0, model.excitation.steps)
        way.end()
        used = way.used
    return Record(
        model.excitation.disturbance(*instants(model)),
        way.states[..., : model.plant.shape[0]],
        way.rates,
        way.demanded,
        way.applied,
        way.stops,
        parameters_over_time(model),
        used,
        loads_over_time(model),
    )


def _hardware(model: Model) -> dict[str, Any]:
    """Return the kernel's arguments about plant and hardware, by name."""
    plant, known, actuator = model.plant, model.known, model.actuator
    corners = np.eye(len(plant.vertices))
    A, B = plant.at(corners)
    S, stops, weight, load, heavy = model.pushed(A, B), list[float](), np.zeros(0), np.zeros(0), 0
    if model.stops is not None:
        ends = model.stops
        stops = [ends.bump, ends.rebound, ends.stiffness, ends.damping]
    if model.gravity and known is not None:
        load, heavy = model.first_load, known.places[2]
        weight = known.push(A, B)[:, heavy]
    # a row for each part of a damper's curves, from the rate at which it begins
    parts = [
        (own.number, start, *line)
        for own in model.dampers
        for start, line in zip((-np.inf, *own.starts), own.lines, strict=True)
    ]
    rates = [own.rate for own in model.dampers]
    arrays = {
        "A": A,
        "B": B,
        "E": model.entry(corners),
        "S": S,
        "dampers": np.array(parts, float).reshape(-1, 6),
        "damper_rates": np.array(rates, float).reshape(-1, plant.shape[0]),
        "anti_windup": np.zeros((0, 0)) if model.anti_windup is None else model.anti_windup,
        "stops": np.array(stops, float),
        "compression": model.stopped[:, : plant.shape[0]],
        "per_mass": weight,
        "first_load": load,
    }
    return {name: np.ascontiguousarray(values) for name, values in arrays.items()} | {
        "h": model.excitation.step,
        "driven": model.driven,
        "lag": actuator.rate,
        "limit": np.inf if actuator.limit is None else actuator.limit,
        "reach": np.zeros(0) if model.slew is None else model.slew[0],
        "followed": np.zeros(0) if model.slew is None else np.array(model.slew[1], float),
        "gravity": model.gravity if known is not None else 0.0,
        "heavy": heavy,
        "threads": spare_processors(),
    }


class _Way:
    """The kernel's steps, and its record (count, time, ...)."""

    def __init__(self, model: Model, controller: Controller | None, start: Array) -> None:
        self.model, self.controller = model, controller
        (n, m), count, total = model.plant.shape, len(start), model.excitation.steps + 1
        self.z, self.after = np.array(start, dtype=float), np.zeros(start.shape)
        self.underway = np.zeros((count, 1, m))
        if controller is not None:
            self.underway = np.zeros(controller.underway.shape)
        self.states = np.empty((count, total, model.width))
        self.rates = np.empty((count, total, n))
        self.demanded, self.applied = np.empty((count, total, m)), np.empty((count, total, m))
        self.stops = np.empty((count, total, len(model.stopped)))
        self.words = _hardware(model)

    @property
    def learner(self) -> Learner | None:
        """The estimator of the parameters, where there is one."""
        source = None if self.controller is None else self.controller.source
        return source if isinstance(source, Learner) else None

    @property
    def every(self) -> int:
        """Steps from one sample of the controller to the next."""
        return 1 if self.controller is None else self.controller.every_demand

    def learned(self, controller: Controller, learner: Learner) -> Array:
        """Go through all steps with an estimator; return the parameters that the law was given."""
        steps = self.model.excitation.steps
        paces = [controller.every_estimate]
        if controller.sampling is not None:
            paces.append(controller.every_demand)
        used, k = np.empty((len(self.z), steps + 1, learner.parameters.shape[-1])), 0
        while True:
            controller.sample(k, self.z, (lambda: self.after) if k else None)
            until = min(steps, *((k // pace + 1) * pace for pace in paces))
            used[:, k : until + 1] = controller.used[:, None]
            if controller.held is not None:
                self.underway = np.ascontiguousarray(controller.underway)
            if k == steps:
                self.end()
                return used
            self.go(k, until)
            k = until

    def go(self, first: int, until: int) -> None:
        """Go through steps, in stretches."""
        k = first
        while k < until:
            end = min(until, k + self.length)
            pieces = Pieces(np.arange(k, end))
            if self.controller is not None:
                pieces = pieces.broken(self.controller)
            self._call(k, end - k, *stage_times(self.model, pieces))
            k = end

    def end(self) -> None:
        """Record the last instant; the road there is that of the last step."""
        step, steps = self.model.excitation.step, self.model.excitation.steps
        self._call(steps, 0, np.array([(steps - INSIDE) * step]), np.array([steps - 1]))

    @property
    def length(self) -> int:
        """Steps in one call."""
        model, count = self.model, len(self.z)
        n, m = model.plant.shape
        numbers = 3 * (count * (len(model.plant.vertices) + m * n) + model.plant.disturbance_count)
        # multiplications in one call, after which Ctrl-C is heard
        return max(1, min(CHUNK // numbers, 200_000_000 // (4 * count * model.width**2)))

    def _call(self, first: int, steps: int, times: Array, numbers: Array) -> None:
        model = self.model
        alpha = model.trajectories.space.alpha(model.trajectories.at(times))
        noise = model.excitation.disturbance(times, numbers)[:, : self.words["E"].shape[-1]]
        mode, K = self._law(first, steps, times)
        change, share = self.controller.changes if self.controller else (self.every, 0.0)
        compiled()(
            alpha=np.ascontiguousarray(alpha), noise=np.ascontiguousarray(noise, dtype=float),
            K=K, first=first, steps=steps, mode=mode, every=self.every, change=change, share=share,
            z=self.z, after=self.after, underway=self.underway, states=self.states,
            rates=self.rates, demanded=self.demanded, applied=self.applied, pushes=self.stops,
            **self.words,
        )  # fmt: skip

    def _law(self, first: int, steps: int, times: Array) -> tuple[int, Array]:
        """Return the mode, and the gains at the stages or samples: one row if constant."""
        model, controller = self.model, self.controller
        n, m = model.plant.shape
        none = np.zeros((1, len(self.z), m, n))
        if model.reading is not None:
            gains = model.gains(model.reading.at(times))
        elif controller is None:
            gains = none
        elif self.learner is None:
            until = first + max(1, steps)
            samples = np.arange(-(-first // self.every) * self.every, until, self.every)
            gains = none if not len(samples) else model.gains(controller.parameters(samples))
        elif controller.held is not None:
            return HELD, none
        else:
            gains = none if controller.gain is None else controller.gain[None, :, :, :n]
        if gains.strides[0] == 0:  # a law that does not look at the parameters
            gains = gains[:1]
        gains = np.broadcast_to(gains, (len(gains), *none.shape[1:]))
        return BY_GAIN if controller is None or self.learner else SAMPLED, np.ascontiguousarray(
            gains
        )

    @property
    def used(self) -> Array:
        """The parameters that the law was given, where it does not learn them."""
        model, controller = self.model, self.controller
        if controller is None:
            return parameters_over_time(model, model.reading)
        steps = model.excitation.steps
        given = controller.parameters(np.arange(0, steps + 1, self.every))
        rows = np.arange(steps + 1) // self.every if len(given) > 1 else np.zeros(steps + 1, int)
        return np.swapaxes(given[rows], 0, 1)
