"""Step by step through a drive: Runge-Kutta or error control; a controller at samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.system import Array
from polefence.vehicle.driving.model import INSIDE, Equations, Model, Reading, Row
from polefence.vehicle.driving.parts import Estimated, Sampling
from polefence.vehicle.estimate import Belief, Estimator
from polefence.vehicle.vehicle import Ride

# Of a state or force: beyond it a car counts as lost.
LOST = 1e9
LOOK = 64  # steps between two looks for lost cars
CHUNK = 2_000_000  # numbers held at once for the matrices of a stretch of steps
MOST_CHUNK = 1000
RELATIVE, ABSOLUTE = 1e-10, 1e-13  # tolerances of the adaptive step

Cross = Callable[[int, Array], tuple[Array, Callable[[], Array]]]


@dataclass(frozen=True, eq=False)
class Solution:
    """What comes out: states at all instants, and what a controller did where one did.

    Attributes
    ----------
    z : (steps + 1, count, width) array
    demanded : (steps + 1, count, m) array, optional
    used : (steps + 1, count, q) array, optional
        The parameters that the law was given.
    beliefs : tuple of Belief
        One for each sample of an estimator, the prior first.
    """

    z: Array
    demanded: Array | None
    used: Array | None
    beliefs: tuple[Belief, ...] = ()


def integrate(
    model: Model, controller: Controller | None, start: Array, adaptive: bool
) -> Solution:
    """Go through all steps.

    Parameters
    ----------
    start : (count, width) array
    adaptive : bool
        Dormand-Prince of order 8 with error control within each step, instead of one step of
        Runge-Kutta of order 4.
    """
    steps, count = model.excitation.steps, len(start)
    z = np.empty((steps + 1, *start.shape))
    demanded = used = None
    if controller is not None:
        demanded = np.empty((steps + 1, count, model.plant.shape[1]))
        used = np.empty((steps + 1, *controller.used.shape))
    now, cross = start, (_adaptive if adaptive else _fixed)(model, controller)
    lost = np.zeros(count, dtype=bool)
    slope: Callable[[], Array] | None = None
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(steps + 1):
            z[k] = now
            if controller is not None and demanded is not None and used is not None:
                controller.sample(k, now, slope)
                demanded[k], used[k] = controller.demand(now), controller.used
            if k == steps:
                break
            now, slope = cross(k, now)
            if k % LOOK == LOOK - 1 or k == steps - 1:
                lost = lost | ~np.all(np.abs(now) < LOST, axis=1)
                now = np.where(lost[:, None], np.nan, now)
                if lost.all():
                    z[k + 1 :] = np.nan
                    break
    if lost.any():
        _blank(z, demanded)
    return Solution(z, demanded, used, controller.beliefs if controller else ())


def _fixed(model: Model, controller: Controller | None) -> Cross:
    h, count = model.excitation.step, len(model.trajectories.cars)
    size = count * model.width * (model.width + 4) * 3
    length = int(min(max(1, CHUNK // size), MOST_CHUNK))
    equations = Equations(*(np.zeros(0),) * 4, None)
    sampled = controller is not None and controller.held is not None
    linear = (model.folded or sampled) and model.stops is None
    maps = np.zeros(0), np.zeros(0)

    def cross(k: int, z: Array) -> tuple[Array, Callable[[], Array]]:
        nonlocal equations, maps
        if k % length == 0:
            equations = stages(model, np.arange(k, min(k + length, model.excitation.steps)))
            maps = _maps(equations, h) if linear else maps
        gain, held = (controller.gain, controller.held) if controller else (None, None)
        if linear:
            R, r = (M[k % length if len(M) > 1 else 0] for M in maps)
            after = (R @ z[:, :, None])[:, :, 0] + r[:, :, 0]
            if held is not None:
                after += (r[:, :, 1:] @ model.actuator.limited(held)[:, :, None])[:, :, 0]
            return after, lambda: model.slope(
                after, equations.row(3 * (k % length) + 2), gain, held
            )
        first, middle, last = (equations.row(3 * (k % length) + s) for s in range(3))
        a = model.slope(z, first, gain, held)
        b = model.slope(z + h / 2 * a, middle, gain, held)
        c = model.slope(z + h / 2 * b, middle, gain, held)
        d = model.slope(z + h * c, last, gain, held)
        after = z + h / 6 * (a + 2 * (b + c) + d)
        return after, lambda: model.slope(after, last, gain, held)

    return cross


def _maps(equations: Equations, h: float) -> tuple[Array, Array]:
    """Return R, r of z(t + h) = R z(t) + r (1, u), what a step of Runge-Kutta does to z' linear.

    u is held over the step; r is (..., width, 1 + m).
    """
    G = np.zeros((*equations.g.shape, 1 + equations.B.shape[-1]))
    G[..., 0], G[..., 1:] = equations.g, equations.B
    F, G3 = ([M[s::3] if len(M) > 1 else M for s in range(3)] for M in (equations.F, G))
    eye, R, r = np.eye(F[0].shape[-1]), F[0], G3[0]
    total, constant = R, r
    for place, weight, share in ((1, 2, h / 2), (1, 2, h / 2), (2, 1, h)):
        r = share * (F[place] @ r) + G3[place]
        R = F[place] @ (eye + share * R)
        total, constant = total + weight * R, constant + weight * r
    return eye + h / 6 * total, h / 6 * constant


def stages(model: Model, k: Any) -> Equations:
    """Return the equations at beginning, middle and end of steps number k, one after the other."""
    h = model.excitation.step
    times = (k[:, None] + np.array([INSIDE, 0.5, 1 - INSIDE])) * h
    return model.equations(times.ravel(), np.repeat(k, 3))


def _adaptive(model: Model, controller: Controller | None) -> Cross:
    from scipy.integrate import DOP853

    h, n = model.excitation.step, model.plant.shape[0]
    steady = None
    if model.trajectories.constant and (model.reading is None or model.reading.constant):
        steady = stages(model, np.arange(1)).row(0)
        E = model.entry(model.trajectories.space.alpha(model.trajectories.at(np.zeros(1))))

    def row_at(t: float, k: int) -> Row:
        inside = min(max(t, (k + INSIDE) * h), (k + 1 - INSIDE) * h)
        times, number = np.array([inside]), np.array([k])
        if steady is None:
            return model.equations(times, number).row(0)
        g = np.zeros(steady[1].shape)
        g[:, :n] = model.forcing(E, times, number)[0]
        return steady[0], g, *steady[2:]

    def cross(k: int, z: Array) -> tuple[Array, Callable[[], Array]]:
        gain, held = (controller.gain, controller.held) if controller else (None, None)
        dead = np.isnan(z).any(axis=1)
        alive = np.logical_not(dead)[:, None]

        def slope(t: float, flat: Array) -> Array:
            now = flat.reshape(z.shape)
            return np.where(alive, model.slope(now, row_at(t, k), gain, held), 0.0).ravel()

        begin, end = k * h, (k + 1) * h
        now = np.where(alive, z, 0.0).ravel()
        solver = DOP853(
            slope, begin, now, end, first_step=end - begin, rtol=RELATIVE, atol=ABSOLUTE
        )
        while solver.status == "running":
            problem = solver.step()
            if problem:
                raise InputError(f"the adaptive step fails at {solver.t:g} s: {problem}")
        after = np.where(alive, solver.y.reshape(z.shape), np.nan)
        return after, lambda: model.slope(after, row_at((k + 1) * h, k), gain, held)

    return cross


def _blank(z: Array, demanded: Array | None) -> None:
    """Put no numbers where a car is lost, from the first instant on."""
    with np.errstate(invalid="ignore"):
        gone = ~np.all(np.abs(z) < LOST, axis=2)
    gone = np.maximum.accumulate(gone, axis=0)
    z[gone] = np.nan
    if demanded is not None:
        demanded[gone] = np.nan


class Learner:
    """An estimator with its sensors; it keeps what it has believed."""

    def __init__(self, model: Model, known: Ride, own: Estimator, how: Estimated) -> None:
        self.model, self.known, self.own, self.how = model, known, own, how
        self.random = np.random.default_rng(how.seed)
        self.beliefs = [own.begin(len(model.trajectories.cars))]

    @property
    def parameters(self) -> Array:
        """What is believed now, (count, q)."""
        return self.own.parameters(self.beliefs[-1].shares)

    def learn(self, z: Array, slope: Array, demand: Array) -> None:
        """Take a sample at z (count, width); one taken in the stops is not used."""
        model, known = self.model, self.known
        x, third, fourth = (known.places[i] for i in (0, 2, 3))
        acts = z[:, model.plant.shape[0] :] if model.actuator.rate else None
        force = (model.actuator.limited(demand) if acts is None else acts)[:, known.input]
        compression = known.sense[0] * z[:, x]
        rate = z[:, fourth] - z[:, third]
        clean = np.stack([force, rate, compression, slope[:, third]], axis=1)
        noise = self.random.normal(size=clean.shape) * self.how.sensors.deviations
        measured, free = clean + noise, None
        if model.stops is not None:
            free = model.stops.force(compression, rate) == 0
        belief = self.own.update(self.beliefs[-1], measured[:, :3], measured[:, 3], free)
        self.beliefs.append(self.own.projected(belief))


class Controller:
    """What happens at samples.

    With ``sampling`` a demand is computed and held; without, the gain is set anew at each sample
    of the learner and u = K x in between.
    """

    def __init__(
        self,
        model: Model,
        sampling: Sampling | None,
        source: Reading | Learner,
        every: tuple[int, int],
    ) -> None:
        self.model, self.sampling, self.source = model, sampling, source
        self.every_demand, self.every_estimate = every
        shape = (len(model.trajectories.cars), model.plant.shape[1])
        self.gain: Array | None = None
        self.held: Array | None = np.zeros(shape) if sampling else None
        self.waiting = np.zeros(shape)
        self.used = self._parameters(0)

    def sample(self, k: int, z: Array, slope: Callable[[], Array] | None) -> None:
        """Do what is due at instant k; ``slope`` gives z' just before it, None at the first."""
        learns = isinstance(self.source, Learner) and k % self.every_estimate == 0
        if learns and isinstance(self.source, Learner) and slope is not None:
            self.source.learn(z, slope(), self.demand(z))
        if self.sampling is None:
            if learns:
                self.used = self._parameters(k)
                self.gain = self.model.padded(self.model.gains(self.used))
        elif k % self.every_demand == 0:
            self.used = self._parameters(k)
            K = self.model.gains(self.used)
            demand = (K @ z[:, : K.shape[-1], None])[..., 0]
            self.held = self.waiting if self.sampling.delayed else demand
            self.waiting = demand

    def demand(self, z: Array) -> Array:
        """Return the demand at z, (count, m)."""
        if self.held is not None:
            return self.held
        return self.waiting if self.gain is None else (self.gain @ z[:, :, None])[..., 0]

    @property
    def beliefs(self) -> tuple[Belief, ...]:
        """Of the learner, where there is one."""
        return tuple(self.source.beliefs) if isinstance(self.source, Learner) else ()

    def _parameters(self, k: int) -> Array:
        if isinstance(self.source, Learner):
            return self.source.parameters
        excitation, trajectories = self.model.excitation, self.model.trajectories
        at = min((k + INSIDE) * excitation.step, excitation.step * excitation.steps)
        found = trajectories.space.inside(self.source.at(np.array([at]))[0])
        return np.asarray(np.broadcast_to(found, (len(trajectories.cars), found.shape[-1])))
