"""The equations of a drive at given times: plant, gains, actuator and stops, for all cars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.law.laws import FixedGain, given_law
from polefence.law.table import GainTable
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.vehicle.driving.parts import Actuator, BumpStops, Hardware, Measured
from polefence.vehicle.driving.trajectories import Space, Trajectories
from polefence.vehicle.excitation import Excitation
from polefence.vehicle.vehicle import Ride, masses, require_ride

Row = tuple[Array, Array, Array, Array, Array | None]

# Jumps at an instant of the grid belong to the step that begins there: a step is looked at this
# share of it inside its ends.
INSIDE = 1e-8

Gains = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Equations:
    """z' = F z + g + B u + S s at times: leading axes (times or 1, count).

    z is the state, behind it the forces of an actuator with a lag. u is the limited demand and s
    the stops' force. Where K is None the law is in F already; else u = K z.
    """

    F: Array
    g: Array
    B: Array
    S: Array
    K: Array | None

    def row(self, i: int) -> Row:
        """Return all at time number i."""
        F, g, B, S = [M[i if len(M) > 1 else 0] for M in (self.F, self.g, self.B, self.S)]
        return F, g, B, S, None if self.K is None else self.K[i if len(self.K) > 1 else 0]


@dataclass(frozen=True, eq=False)
class Model:
    """A drive's equations.

    ``reading`` gives the law's parameters where they do not depend on the state and the law is
    followed in continuous time; None where a controller sets gain or demand as it goes.
    """

    plant: UncertainPlant
    excitation: Excitation
    trajectories: Trajectories
    gains: Gains
    reading: Reading | None
    hardware: Hardware
    known: Ride | None

    @property
    def actuator(self) -> Actuator:
        """That of the hardware."""
        return self.hardware.actuator

    @property
    def stops(self) -> BumpStops | None:
        """Those of the hardware."""
        return self.hardware.stops

    @property
    def gravity(self) -> float:
        """That of the hardware [m/s2]."""
        return self.hardware.gravity

    @property
    def width(self) -> int:
        """States, and forces of an actuator with a lag."""
        n, m = self.plant.shape
        return n + (m if self.actuator.rate else 0)

    @property
    def folded(self) -> bool:
        """Whether the law acts as it is, so that the loop is linear but for the stops."""
        return self.reading is not None and self.actuator.limit is None

    def open(self, times: Array, k: Array) -> tuple[Array, Array, Array]:
        """Return A, B and all that acts besides u, (times or 1, count, ...)."""
        alpha = self.trajectories.space.alpha(self.trajectories.at(times))
        A, B = self.plant.at(alpha)
        g = self.forcing(self.entry(alpha), times, k)
        if self.gravity and self.known is not None:
            place = self.known.places[2]
            share = self.first_load * B[..., place, self.known.input]
            g[..., place] -= self.gravity * (1 - share)
        return A, B, g

    def entry(self, alpha: Array) -> Array:
        """Return E at alpha, (..., n, q)."""
        Es = [v.E for v in self.plant.vertices if v.E is not None]
        if len(Es) < len(self.plant.vertices):
            return np.zeros((*alpha.shape[:-1], self.plant.shape[0], 0))
        return np.tensordot(alpha, np.stack(Es), 1)

    def forcing(self, E: Array, times: Array, k: Array) -> Array:
        """Return E w, (times, count, n)."""
        return np.asarray((E @ self.excitation.disturbance(times, k)[:, None, :, None])[..., 0])

    @cached_property
    def first_load(self) -> Array:
        """Sprung masses of a quarter car as the drive begins, (count,) [kg]."""
        start = np.array([INSIDE * self.excitation.step])
        alpha = self.trajectories.space.alpha(self.trajectories.at(start))[0]
        return masses(self.plant, require_ride(self.plant), alpha).m1

    def equations(self, times: Array, k: Array) -> Equations:
        """Return the equations at times (T,) that lie in steps number k (T,)."""
        A, B, g = self.open(times, k)
        n, m = self.plant.shape
        S = B[..., :, self.known.input] if self.known else np.zeros(B.shape[:-1])
        if self.width > n:
            rate, lead = self.actuator.rate, A.shape[:-2]
            F = np.zeros((*lead, n + m, n + m))
            F[..., :n, :n], F[..., :n, n:], F[..., n:, n:] = A, B, -rate * np.eye(m)
            g, S = (np.concatenate([v, np.zeros((*v.shape[:-1], m))], axis=-1) for v in (g, S))
            A, B = F, np.zeros((1, 1, n + m, m))
            B[..., n:, :] = rate * np.eye(m)
        if self.reading is None:
            return Equations(A, g, B, S, None)
        K = self.padded(self.gains(self.reading.at(times)))
        return Equations(A + B @ K, g, B, S, None) if self.folded else Equations(A, g, B, S, K)

    def padded(self, K: Array) -> Array:
        """Return K with zeros for the actuator's forces."""
        extra = self.width - K.shape[-1]
        return np.concatenate([K, np.zeros((*K.shape[:-1], extra))], axis=-1) if extra else K

    def slope(
        self,
        z: Array,
        row: Row,
        gain: Array | None = None,
        held: Array | None = None,
    ) -> Array:
        """Return z' at z (count, width); ``gain`` or ``held`` demand where a controller set it."""
        F, g, B, S, K = row
        dz = (F @ z[:, :, None])[:, :, 0] + g
        if gain is not None:
            K = gain
        if held is not None or K is not None:
            u = held if held is not None else (K @ z[:, :, None])[:, :, 0]  # type: ignore[operator]
            dz = dz + (B @ self.actuator.limited(u)[:, :, None])[:, :, 0]
        if self.stops is not None and self.known is not None:
            x, sense = self.known.places[0], self.known.sense[0]
            dz = dz + S * self.stops.force(sense * z[:, x], sense * dz[:, x])[:, None]
        return np.asarray(dz)


def gains_of(space: Space, law: Any) -> Gains:
    """Return the function from parameter values (..., q), in or out of bounds, to K (..., m, n)."""
    plant = space.plant
    n, m = plant.shape
    if law is None:
        return lambda values: np.zeros((*values.shape[:-1], m, n))
    if isinstance(law, GainTable):
        names = [p.name for p in plant.parameters]
        if [p.name for p in law.parameters] != names or law.gains.shape[-2:] != (m, n):
            raise InputError(f"the table of gains does not fit {plant.name}")

        def table(values: Array) -> Array:
            points = space.inside(values).reshape(-1, values.shape[-1])
            return law.at(points).reshape(*values.shape[:-1], m, n)

        return table
    own = given_law(plant, law)
    if isinstance(own, FixedGain):
        return lambda values: np.broadcast_to(own.K, (*values.shape[:-1], m, n))
    return lambda values: own.gain(space.alpha(space.inside(values)), clamp=True)


class Reading:
    """Sensors' readings of the parameters, `Measured`, as a function of time."""

    def __init__(
        self, trajectories: Trajectories, how: Measured, excitation: Excitation, period: float
    ) -> None:
        self.trajectories, self.how, self.excitation, self.period = (
            trajectories,
            how,
            excitation,
            period,
        )
        space, end = trajectories.space, float(excitation.times[-1])
        for name in how.noise:
            if name not in space.names:
                raise InputError(f"noise: unknown parameter {name!r}; {suggest(name, space.names)}")
        deviation = np.array([how.noise.get(name, 0.0) for name in space.names])
        count = int(end / period) + 2
        random = np.random.default_rng(how.seed)
        noisy = bool(deviation.any())
        shape = (count, len(trajectories.cars), len(deviation))
        self.noise = random.normal(size=shape) * deviation if noisy else None
        self.constant = trajectories.constant and not noisy
        self.filtered = None if self.constant or not how.lag else self._filtered()

    def at(self, times: Array) -> Array:
        """Return readings at times (T,), (T, count, q) or (1, count, q)."""
        if self.constant:
            return self.trajectories.at(times)
        if self.filtered is None:
            return self._raw(times)
        h, lag = self.excitation.step, self.how.lag
        k = np.clip((times / h).astype(int), 0, self.excitation.steps - 1)
        start, end = self._ends(k)
        return _lagged(self.filtered[k], start, end, (times - k * h)[:, None, None], h, lag)

    def _raw(self, times: Array) -> Array:
        found = self.trajectories.at(np.maximum(times - self.how.delay, 0.0))
        if self.noise is not None:
            held = np.floor(times / self.period * (1 + 1e-12) + 1e-9).astype(int)
            found = found + self.noise[np.clip(held, 0, len(self.noise) - 1)]
        return found

    def _ends(self, k: Any) -> tuple[Array, Array]:
        h = self.excitation.step
        start, end = self._raw((k + INSIDE) * h), self._raw((k + 1 - INSIDE) * h)
        shape = np.broadcast_shapes(start.shape, end.shape)
        return np.broadcast_to(start, shape), np.broadcast_to(end, shape)

    def _filtered(self) -> Array:
        """Return the filter's output at the instants, exact for a straight line in each step."""
        from scipy.signal import lfilter

        h, lag, steps = self.excitation.step, self.how.lag, self.excitation.steps
        start, end = self._ends(np.arange(steps))
        begin = start[:1]
        after = _lagged(np.zeros(()), start, end, np.array(h), h, lag)
        decay = np.exp(-h / lag)
        found, _ = lfilter([1.0], [1.0, -decay], after, axis=0, zi=decay * begin)
        return np.concatenate([begin, np.broadcast_to(found, (steps, *begin.shape[1:]))])


def _lagged(before: Array, start: Array, end: Array, t: Array, h: float, lag: float) -> Array:
    """Return y at t into a step of lag y' = u - y, u straight from start to end of the step."""
    decay = np.exp(-t / lag)
    slope = (end - start) / h
    return np.asarray(decay * before + start * (1 - decay) + slope * (t - lag * (1 - decay)))
