"""Equations of a drive for all cars at once, its controller at samples, and steps through it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.law.laws import GainTable, given_law
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.plant.outputs import inputs
from polefence.plant.system import Array
from polefence.proof.dampers import SemiActive
from polefence.response.discrete import Sampling
from polefence.vehicle.driving.parts import (
    Actuator,
    BumpStops,
    Estimated,
    Hardware,
    Measured,
)
from polefence.vehicle.driving.trajectories import Space, Trajectories
from polefence.vehicle.estimate import Belief, Estimator
from polefence.vehicle.excitation import Excitation
from polefence.vehicle.suspensions import Suspensions
from polefence.vehicle.vehicle import Ride, masses, require_ride

# Of a state or force: beyond it a car counts as lost.
LOST = 1e9
LOOK = 64  # steps between two looks for lost cars

Cross = Callable[[int, Array], tuple[Array, Callable[[], Array]]]

Row = tuple[Array, Array, Array, Array, Array | None]

# Jumps at an instant of the grid belong to the step that begins there: a step is looked at this
# share of it inside its ends, and so are its pieces.
INSIDE = 1e-8
ROUNDED = 1e-6  # of a step: what changes so near to an instant changes there

Gains = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Bounds:
    """An input of a controllable damper: its force is between two curves of a rate.

    Attributes
    ----------
    number : int
        Of the input.
    rate : (n,) array
        By the state.
    starts : (parts - 1,) array
        Rates at which a part begins, but the first; both curves are lines in each.
    lines : (parts, 4) array
        Slope and value at zero of the lower curve, then of the upper one.
    ends : pair of float
        The least and the largest coefficient.
    """

    number: int
    rate: Array
    starts: Array
    lines: Array
    ends: tuple[float, float]

    @classmethod
    def of(cls, damper: SemiActive, rate: Array) -> Self:
        """Return those of a damper."""
        lines = np.array(
            [[x for line in damper.lines(p) for x in line] for p in damper.parts], float
        )
        starts = np.array([start for start, _ in damper.parts[1:]], float)
        low, high = map(float, damper.ends)
        return cls(damper.number, rate, starts, lines, (low, high))

    def at(self, v: Array) -> tuple[Array, Array]:
        """Return both forces at rates."""
        low, low_start, high, high_start = self._lines(v)
        return low * v + low_start, high * v + high_start

    def coefficients(self, v: Array) -> tuple[Array, Array]:
        """Return both forces over the rates; at zero that of the part above it."""
        low, low_start, high, high_start = self._lines(v)
        over = np.divide(1.0, v, out=np.zeros(v.shape), where=v != 0)
        return low + low_start * over, high + high_start * over

    def _lines(self, v: Array) -> Iterator[Array]:
        found = self.lines[np.searchsorted(self.starts, v, side="right")]
        return iter(np.moveaxis(found, -1, 0))


@dataclass(frozen=True, eq=False)
class Solution:
    """States at all instants, and the demands of a controller where there is one.

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
                    if demanded is not None and used is not None:
                        demanded[k + 1 :], used[k + 1 :] = np.nan, used[k]
                    break
    if lost.any():
        _blank(z, demanded)
    return Solution(z, demanded, used, controller.beliefs if controller else ())


def _fixed(model: Model, controller: Controller | None) -> Cross:
    h, count = model.excitation.step, len(model.trajectories.cars)
    size = count * model.width * (model.width + 4) * 3
    # of a stretch whose matrices are held at once
    length = int(min(max(1, 2_000_000 // size), 1000))
    equations = Equations(*(np.zeros(0),) * 4, None)
    sampled = controller is not None and controller.held is not None
    follows = model.slew is not None and model.slew[1][0] >= 0
    plain = model.stops is None and not model.dampers and not follows
    linear = (model.folded or sampled) and plain
    maps = np.zeros(0), np.zeros(0)

    def cross(k: int, z: Array) -> tuple[Array, Callable[[], Array]]:
        nonlocal equations, maps
        if k % length == 0:
            numbers = np.arange(k, min(k + length, model.excitation.steps))
            equations = stages(model, Pieces(numbers))
            maps = _maps(equations, h) if linear else maps
        pieces, rows = (
            Pieces(np.array([k])),
            [equations.row(3 * (k % length) + s) for s in range(3)],
        )
        if controller is not None and controller.breaks(k):
            pieces = pieces.broken(controller)
            both = stages(model, pieces)
            rows = [both.row(s) for s in range(6)]
        elif linear:
            held = controller.held if controller else None
            R, r = (M[k % length if len(M) > 1 else 0] for M in maps)
            after = (R @ z[:, :, None])[:, :, 0] + r[:, :, 0]
            if held is not None:
                after += (r[:, :, 1:] @ model.limited(held, z)[:, :, None])[:, :, 0]
            return after, lambda: model.slope(after, rows[-1], held=held)
        for i, share in enumerate(pieces.lengths):
            if i and controller is not None:
                controller.change()
            gain, held = (controller.gain, controller.held) if controller else (None, None)
            z = _runge_kutta(model, z, h * share, rows[3 * i : 3 * i + 3], gain, held)
        return z, lambda: model.slope(z, rows[-1], gain, held)

    return cross


def _runge_kutta(
    model: Model, z: Array, h: float, rows: list[Row], gain: Array | None, held: Array | None
) -> Array:
    """Return z a time h later; rows are those of begin, middle and end."""
    first, middle, last = rows
    a = model.slope(z, first, gain, held)
    b = model.slope(z + h / 2 * a, middle, gain, held)
    c = model.slope(z + h / 2 * b, middle, gain, held)
    d = model.slope(z + h * c, last, gain, held)
    return np.asarray(z + h / 6 * (a + 2 * (b + c) + d))


def _maps(equations: Equations, h: float) -> tuple[Array, Array]:
    """Return R, r of z(t + h) = R z(t) + r (1, u), a Runge-Kutta step of linear z'.

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


class Pieces:
    """Steps, or pieces of them: the numbers of the steps, where each begins, and shares of it."""

    def __init__(self, numbers: Any) -> None:
        self.numbers, self.begins, self.lengths = numbers, numbers, np.ones(len(numbers))

    def broken(self, controller: Controller) -> Pieces:
        """Return them with a step in two where what the controller holds changes within it."""
        twice = np.array([controller.breaks(k) for k in self.numbers.tolist()], dtype=bool)
        broken = Pieces(np.repeat(self.numbers, 1 + twice))
        second = np.flatnonzero(np.diff(broken.numbers, prepend=-1) == 0)
        _, share = controller.changes
        broken.begins = broken.begins.astype(float)
        broken.begins[second] += share
        broken.lengths[second - 1], broken.lengths[second] = share, 1 - share
        return broken

    @property
    def inside(self) -> Array:
        """Begin, middle and end of each, one after the other, in steps."""
        within = self.lengths[:, None] * [0, 0.5, 1] + np.array([INSIDE, 0, -INSIDE])
        return np.asarray((self.begins[:, None] + within).ravel())


def stages(model: Model, pieces: Pieces) -> Equations:
    """Return the equations at beginning, middle and end of steps, one after the other."""
    return model.equations(*stage_times(model, pieces))


def stage_times(model: Model, pieces: Pieces) -> tuple[Array, Array]:
    """Return beginning, middle and end of steps, one after the other, and their numbers."""
    return pieces.inside * model.excitation.step, np.repeat(pieces.numbers, 3)


def _adaptive(model: Model, controller: Controller | None) -> Cross:
    from scipy.integrate import DOP853

    h, n = model.excitation.step, model.plant.shape[0]
    steady = None
    if model.trajectories.constant and (model.reading is None or model.reading.constant):
        steady = stages(model, Pieces(np.arange(1))).row(0)
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
        dead = np.isnan(z).any(axis=1)
        alive = np.logical_not(dead)[:, None]
        gain, held = None, None

        def slope(t: float, flat: Array) -> Array:
            now = flat.reshape(z.shape)
            return np.where(alive, model.slope(now, row_at(t, k), gain, held), 0.0).ravel()

        ends, now = [k * h, (k + 1) * h], np.where(alive, z, 0.0).ravel()
        if controller is not None and controller.breaks(k):
            ends.insert(1, (k + controller.changes[1]) * h)
        for i, (begin, end) in enumerate(pairwise(ends)):
            if i and controller is not None:
                controller.change()
            gain, held = (controller.gain, controller.held) if controller else (None, None)
            solver = DOP853(slope, begin, now, end, first_step=end - begin, rtol=1e-10, atol=1e-13)
            while solver.status == "running":
                problem = solver.step()
                if problem:
                    raise InputError(f"the adaptive step fails at {solver.t:g} s: {problem}")
            now = solver.y
        after = np.where(alive, now.reshape(z.shape), np.nan)
        return after, lambda: model.slope(after, row_at((k + 1) * h, k), gain, held)

    return cross


def _blank(z: Array, demanded: Array | None) -> None:
    """Set a lost car's values to NaN from the first bad instant on."""
    with np.errstate(invalid="ignore"):
        gone = ~np.all(np.abs(z) < LOST, axis=2)
    gone = np.maximum.accumulate(gone, axis=0)
    z[gone] = np.nan
    if demanded is not None:
        demanded[gone] = np.nan


class Learner:
    """An estimator with its sensors and its history of beliefs."""

    def __init__(self, model: Model, known: Ride, estimator: Estimator, how: Estimated) -> None:
        self.model, self.known, self.estimator, self.how = model, known, estimator, how
        self.random = np.random.default_rng(how.seed)
        self.beliefs = [estimator.begin(len(model.trajectories.cars))]

    @property
    def parameters(self) -> Array:
        """Present estimates, (count, q)."""
        return self.estimator.parameters(self.beliefs[-1].shares)

    def learn(self, z: Array, slope: Array, demand: Array) -> None:
        """Take a sample at z (count, width); one taken in the stops is not used."""
        model, known = self.model, self.known
        x, third, fourth = (known.places[i] for i in (0, 2, 3))
        acts = z[:, model.plant.shape[0] :] if model.actuator.rate else None
        force = (model.actuator.limited(demand) if acts is None else acts)[:, known.input]
        force = force if known.lag is None else z[:, known.lag]
        compression = known.sense[0] * z[:, x]
        rate = z[:, fourth] - z[:, third]
        clean = np.stack([force, rate, compression, slope[:, third]], axis=1)
        noise = self.random.normal(size=clean.shape) * self.how.sensors.deviations
        measured, free = clean + noise, None
        if model.stops is not None:
            free = model.stops.force(compression, rate) == 0
        belief = self.estimator.update(self.beliefs[-1], measured[:, :3], measured[:, 3], free)
        self.beliefs.append(self.estimator.projected(belief))


class Controller:
    """A sampling controller.

    With ``sampling`` a demand is computed and held; without, the gain is set anew at each sample
    of the learner and u = K x in between. ``underway`` (count, k, m) are the demands of the last
    samples, the newest first, and ``held`` is what acts of them.
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
        self.late = sampling.lateness.whole if sampling else 0
        self.underway = np.zeros((shape[0], 1 + self.late, shape[1]))
        self.used = self.parameters(np.zeros(1))[0]

    def sample(self, k: int, z: Array, slope: Callable[[], Array] | None) -> None:
        """Do what is due at instant k; ``slope`` gives z' just before it, None at the first."""
        sampled = self.sampling is not None
        if sampled and k and (k - 1) % self.every_demand >= self.changes[0]:
            self.change()  # which the kernel has done in its own record
        learns = isinstance(self.source, Learner) and k % self.every_estimate == 0
        if learns and isinstance(self.source, Learner) and slope is not None:
            self.source.learn(z, slope(), self.demand(z))
        if not sampled:
            if learns:
                self.used = self.parameters(np.array([k]))[0]
                self.gain = self.model.padded(self.model.gains(self.used))
        elif k % self.every_demand == 0:
            self.used = self.parameters(np.array([k]))[0]
            K = self.model.gains(self.used)
            last = self.underway[:, 0]
            demand = self.model.settings(self.model.demanded(K, z, last), z)
            self.underway = np.concatenate([demand[:, None], self.underway[:, :-1]], axis=1)
            self._hold(self.late)
        if sampled and (k % self.every_demand, 0.0) == self.changes:
            self.change()

    def change(self) -> None:
        """Have the next demand act, between two samples."""
        self._hold(self.late - 1)

    def _hold(self, late: int) -> None:
        # the rates of the law's own states act at once: its code keeps these
        driven = self.model.driven
        acting = self.underway[:, late, :driven], self.underway[:, 0, driven:]
        self.held = np.concatenate(acting, axis=1)

    @cached_property
    def changes(self) -> tuple[int, float]:
        """The step of a period in which the next demand acts, and after which share of it.

        Behind the last step where that is at no instant between two samples.
        """
        if self.sampling is None or not self.sampling.lateness.early:
            return self.every_demand, 0.0
        at = (1 - self.sampling.lateness.early) * self.every_demand
        step = math.floor(at)
        share = float(at - step)
        if share > 1 - ROUNDED:
            return step + 1, 0.0
        return step, share if share > ROUNDED else 0.0

    def breaks(self, k: int) -> bool:
        """Whether the next demand acts within step k."""
        step, share = self.changes
        return share > 0 and k % self.every_demand == step

    def demand(self, z: Array) -> Array:
        """Return the demand at z, (count, m)."""
        if self.held is not None:
            return self.model.forces(self.held, z)
        none = np.zeros(self.underway[:, 0].shape)
        return none if self.gain is None else self.model.demanded(self.gain, z)

    @property
    def beliefs(self) -> tuple[Belief, ...]:
        """Of the learner, where there is one."""
        return tuple(self.source.beliefs) if isinstance(self.source, Learner) else ()

    def parameters(self, k: Any) -> Array:
        """Return what the law reads at samples (S,), (S or 1, count, q)."""
        if isinstance(self.source, Learner):
            return self.source.parameters[None]
        excitation, trajectories = self.model.excitation, self.model.trajectories
        times = np.minimum((k + INSIDE) * excitation.step, excitation.step * excitation.steps)
        values = trajectories.space.inside(self.source.at(times))
        return np.broadcast_to(values, (len(values), len(trajectories.cars), values.shape[-1]))


@dataclass(frozen=True, eq=False)
class Equations:
    """z' = F z + g + B u + S s at times: leading axes (times or 1, count).

    z is the state, behind it the forces of an actuator with a lag. u is the limited demand and s
    the stops' forces. Where K is None the law is in F already; else u = K z.
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
    ``anti_windup`` (own, driven) is what the demand beyond the actuator's limits adds to the rates
    of the law's own states.
    """

    plant: UncertainPlant
    excitation: Excitation
    trajectories: Trajectories
    gains: Gains
    reading: Reading | None
    hardware: Hardware
    known: Ride | None
    suspensions: Suspensions | None = None
    anti_windup: Array | None = None

    @property
    def actuator(self) -> Actuator:
        """That of the hardware."""
        return self.hardware.actuator

    @property
    def stops(self) -> BumpStops | None:
        """Those of the hardware."""
        return self.hardware.stops

    @cached_property
    def stopped(self) -> Array:
        """Compression of the suspensions that have stops, by z, (k, width)."""
        if self.suspensions is None:
            return np.zeros((0, self.width))
        compression = self.suspensions.compression
        return np.concatenate(
            [compression, np.zeros((len(compression), self.width - compression.shape[1]))], axis=1
        )

    def pushed(self, A: Array, B: Array) -> Array:
        """Return how forces of stops move the state, (..., n, k)."""
        if self.suspensions is None:
            return np.zeros((*A.shape[:-1], 0))
        return self.suspensions.push(A, B)

    @property
    def gravity(self) -> float:
        """That of the hardware [m/s2]."""
        return self.hardware.gravity

    @cached_property
    def driven(self) -> int:
        """How many inputs, the first ones, an actuator has: not rates of a law's own states."""
        return self.plant.shape[1] - own_states(self.plant)

    @cached_property
    def dampers(self) -> tuple[Bounds, ...]:
        """Inputs of controllable dampers.

        Raises
        ------
        InputError
            If the plant has no such input, or its rate is not the same for all parameters.
        """
        dampers = []
        for damper in self.hardware.dampers:
            exact = damper.of(self.plant)
            if any(rate != exact.rate[0] for rate in exact.rate):
                raise InputError(f"damper {damper.force}: its rate changes with a parameter")
            rate = np.array([float(x) for x in exact.rate[0][0]])
            dampers.append(Bounds.of(exact, rate))
        return tuple(dampers)

    def limited(self, u: Array, z: Array) -> Array:
        """Return u saturated at the actuator's limits and at the dampers' bounds."""
        parts = np.split(u, [self.driven], axis=-1)
        applied = np.concatenate([self.sent(parts[0], z, None), parts[1]], axis=-1)
        for own in self.dampers:
            first, second = own.at(z[..., : len(own.rate)] @ own.rate)
            applied[..., own.number] = np.clip(
                applied[..., own.number], np.minimum(first, second), np.maximum(first, second)
            )
        return applied

    @cached_property
    def slew(self) -> tuple[Array, list[int]] | None:
        """How far an input may be from what it follows: (driven,), and which of z that is.

        -1 for what a computer sent a sample before.

        Raises
        ------
        InputError
            If an input moves at once.
        """
        most, count = self.actuator.slew, self.driven
        if most is None:
            return None
        if self.actuator.rate:
            n = self.plant.shape[0]
            return np.full(count, most / self.actuator.rate), list(range(n, n + count))
        if self.hardware.sampling is not None:
            period = self.hardware.sampling.period
            return np.full(count, most * period), [-1] * count
        pairs = [_followed(self.plant, j) for j in range(count)]
        return np.array([most / w for _, w in pairs]), [i for i, _ in pairs]

    def sent(self, demand: Array, z: Array, last: Array | None) -> Array:
        """Return a demand (..., driven) within the actuator's limits.

        Parameters
        ----------
        last : (..., driven) array, optional
            What was sent a sample before, where a computer keeps to a rate.
        """
        demand = self.actuator.limited(demand)
        if self.slew is None:
            return demand
        reach, followed = self.slew
        if followed[0] < 0 and last is None:
            return demand
        middle = z[..., followed] if last is None or followed[0] >= 0 else last
        return np.minimum(np.maximum(demand, middle - reach), middle + reach)

    def demanded(self, K: Array, z: Array, last: Array | None = None) -> Array:
        """Return u = K z; what goes beyond the limits is in the rates of the law's own states.

        Of a computer that keeps to a rate it is what it sends.

        Parameters
        ----------
        last : (..., m) array, optional
            What it sent a sample before.
        """
        u = np.asarray((K @ z[..., : K.shape[-1], None])[..., 0])
        demand = u[..., : self.driven].copy()
        if self.anti_windup is None and (last is None or self.slew is None):
            return u
        sent = self.sent(demand, z, None if last is None else last[..., : self.driven])
        if self.anti_windup is not None:
            u[..., self.driven :] += (sent - demand) @ self.anti_windup.T
        if self.slew is not None and self.slew[1][0] < 0:
            u[..., : self.driven] = sent
        return u

    def settings(self, u: Array, z: Array) -> Array:
        """Return u with dampers' forces replaced by the nearest coefficients."""
        settings = u.copy() if self.dampers else u
        for own in self.dampers:
            v = z[..., : len(own.rate)] @ own.rate
            low, high = own.coefficients(v)
            c = np.divide(settings[..., own.number], v, out=low.copy(), where=v != 0)
            settings[..., own.number] = np.clip(c, low, high)
        return settings

    def forces(self, settings: Array, z: Array) -> Array:
        """Return the forces of `settings` at z."""
        forces = settings.copy() if self.dampers else settings
        for own in self.dampers:
            forces[..., own.number] *= z[..., : len(own.rate)] @ own.rate
        return forces

    def applied(self, z: Array, demanded: Array) -> Array:
        """Return the inputs that act on the plant at z for a demand."""
        n = self.plant.shape[0]
        if self.width == n:
            return self.limited(demanded, z)
        given = np.concatenate([z[..., n:], demanded[..., self.driven :]], axis=-1)
        return self.limited(given, z)

    @property
    def width(self) -> int:
        """States, and forces of an actuator with a lag."""
        return self.plant.shape[0] + (self.driven if self.actuator.rate else 0)

    @property
    def folded(self) -> bool:
        """Whether the law acts as it is, so that the loop is linear but for the stops."""
        free = self.actuator.limit is None and self.slew is None and not self.dampers
        return self.reading is not None and free

    def open(self, times: Array, k: Array) -> tuple[Array, Array, Array]:
        """Return A, B and the forcing besides u, (times or 1, count, ...)."""
        alpha = self.trajectories.space.alpha(self.trajectories.at(times))
        A, B = self.plant.at(alpha)
        g = self.forcing(self.entry(alpha), times, k)
        if self.gravity and self.known is not None:
            place = self.known.places[2]
            share = self.first_load * self.known.push(A, B)[..., place]
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
        S = self.pushed(A, B)
        if self.width > n:
            rate, lead, d = self.actuator.rate, A.shape[:-2], self.driven
            F, G = np.zeros((*lead, n + d, n + d)), np.zeros((*lead, n + d, m))
            F[..., :n, :n], F[..., :n, n:], F[..., n:, n:] = A, B[..., :d], -rate * np.eye(d)
            G[..., :n, d:], G[..., n:, :d] = B[..., d:], rate * np.eye(d)
            g = np.concatenate([g, np.zeros((*g.shape[:-1], d))], axis=-1)
            S = np.concatenate([S, np.zeros((*S.shape[:-2], d, S.shape[-1]))], axis=-2)
            A, B = F, G
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
        u = None if held is None else self.forces(held, z)
        if u is None and K is not None:
            u = self.demanded(K, z)
        if u is not None:
            dz = dz + (B @ self.limited(u, z)[:, :, None])[:, :, 0]
        if self.stops is not None:
            force = self.stops.force(z @ self.stopped.T, dz @ self.stopped.T)
            dz = dz + (S @ force[:, :, None])[:, :, 0]
        return np.asarray(dz)


def _followed(plant: UncertainPlant, number: int) -> tuple[int, float]:
    """Return the state that follows an input u by x' = w (u - x), and w.

    Raises
    ------
    InputError
        If there is none.
    """
    B = plant.B[:, :, number]
    for i in np.flatnonzero((B > 0).all(axis=0)):
        w = B[0, i]
        row = np.zeros(sum(plant.shape))
        row[i], row[plant.shape[0] + number] = -w, w
        if np.array_equal(np.concatenate([plant.A, plant.B], axis=2)[:, i], [row] * len(B)):
            return int(i), float(w)
    raise InputError(
        f"a rate limit of {inputs(plant)[number].name}, which moves at once: give the actuator a "
        "bandwidth, or a sampling period"
    )


def gains_of(space: Space, law: Any, true: Array | None = None) -> Gains:
    """Return the function from parameter values (..., q), in or out of bounds, to K (..., m, n).

    Parameters
    ----------
    true : (count, q) array, optional
        Of each car, where they are constant: outputs that a law takes may depend on them.
    """
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
    given = given_law(plant, law)
    if given.passes:
        raise InputError(
            "a disturbance passes straight into what the law measures: drives are of laws of "
            "states; give the sensor a bandwidth"
        )
    if len(given.C) > 1:
        if true is None:
            varying = ", ".join(repr(y.name) for y in given.measured if len(y.C) > 1)
            raise InputError(
                f"the law takes {varying}, which depends on the parameters: drives along moving or "
                "estimated parameters have laws of states, or of outputs that are the same for all"
            )
        here = space.alpha(true)
        return lambda values: given.told(here, space.alpha(space.inside(values)))
    K = given.K
    if K is not None:
        return lambda values: np.broadcast_to(K, (*values.shape[:-1], m, n))
    return lambda values: given.gain(space.alpha(space.inside(values)), clamp=True)


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
        values = self.trajectories.at(np.maximum(times - self.how.delay, 0.0))
        if self.noise is not None:
            held = np.floor(times / self.period * (1 + 1e-12) + 1e-9).astype(int)
            values = values + self.noise[np.clip(held, 0, len(self.noise) - 1)]
        return values

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
        filtered, _ = lfilter([1.0], [1.0, -decay], after, axis=0, zi=decay * begin)
        return np.concatenate([begin, np.broadcast_to(filtered, (steps, *begin.shape[1:]))])


def _lagged(before: Array, start: Array, end: Array, t: Array, h: float, lag: float) -> Array:
    """Return y at t into a step of lag y' = u - y, u straight from start to end of the step."""
    decay = np.exp(-t / lag)
    slope = (end - start) / h
    return np.asarray(decay * before + start * (1 - decay) + slope * (t - lag * (1 - decay)))
