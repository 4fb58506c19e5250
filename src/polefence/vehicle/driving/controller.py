"""A controller that does something at samples: it learns the parameters, sets gain or demand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from polefence.plant.system import Array
from polefence.vehicle.driving.model import Model
from polefence.vehicle.driving.parts import Estimated, Sampling
from polefence.vehicle.driving.scheduling import INSIDE, Reading
from polefence.vehicle.recursion import Belief, Estimator
from polefence.vehicle.vehicle import Ride


class Learner:
    """An estimator with its sensors; it keeps what it has believed."""

    def __init__(self, model: Model, known: Ride, own: Estimator, how: Estimated) -> None:
        self.model, self.known, self.own, self.how = model, known, own, how
        self.random = np.random.default_rng(how.seed)
        self.beliefs = [own.begin(len(model.courses.cars))]

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
        shape = (len(model.courses.cars), model.plant.shape[1])
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
        grid, courses = self.model.grid, self.model.courses
        at = min((k + INSIDE) * grid.step, grid.step * grid.steps)
        found = courses.space.inside(self.source.at(np.array([at]))[0])
        return np.asarray(np.broadcast_to(found, (len(courses.cars), found.shape[-1])))
