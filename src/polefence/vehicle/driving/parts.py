"""Parts of a drive besides plant, law and road: trajectories of parameters, sensors, hardware."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.plant.dampers import Damper
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.discrete import Sampling
from polefence.response.weighting import positive
from polefence.vehicle.estimate import Tuning


@dataclass(frozen=True)
class Jump(Short):
    """A parameter that is ``before`` until ``time`` [s] and ``after`` from then on: a load step."""

    time: float
    before: float
    after: float

    def __call__(self, t: Array) -> Array:
        """Return the values at times."""
        return np.where(t >= self.time, float(self.after), float(self.before))


@dataclass(frozen=True)
class Ramp(Short):
    """A parameter that goes linearly from ``before`` at ``begin`` to ``after`` at ``end`` [s]."""

    before: float
    after: float
    begin: float
    end: float

    @explained_fields
    def __post_init__(self) -> None:
        if not self.end > self.begin:
            raise InputError(f"ramp from {self.begin!r} s to {self.end!r} s: it must end later")

    def __call__(self, t: Array) -> Array:
        """Return the values at times."""
        return np.interp(t, [self.begin, self.end], [self.before, self.after])


@dataclass(frozen=True)
class Sine(Short):
    """A parameter mean + amplitude sin(2 pi frequency t + phase), frequency in Hz, phase in rad."""

    mean: float
    amplitude: float
    frequency: float
    phase: float = 0.0

    def __call__(self, t: Array) -> Array:
        """Return the values at times."""
        angle = 2 * math.pi * self.frequency * t + self.phase
        return np.asarray(self.mean + self.amplitude * np.sin(angle))


@dataclass(frozen=True)
class Actuator(Short):
    """A first-order lag behind a limit on the demand.

    du/dt = 2 pi bandwidth (limited demand - u), so that the force never exceeds the limit, within
    +-slew. Without a lag of its own, ``slew`` is how fast a computer that samples moves what it
    sends, from zero on, or what the plant's own actuators give.

    Attributes
    ----------
    bandwidth : float, optional
        [Hz]; None: no lag.
    limit : float, optional
        The largest magnitude of every input, in its unit; None: no limit.
    slew : float, optional
        How fast every input may move, in its unit/s; None: at once.
    """

    bandwidth: float | None = None
    limit: float | None = None
    slew: float | None = None

    @explained_fields
    def __post_init__(self) -> None:
        if self.bandwidth is not None:
            positive(self.bandwidth, "bandwidth of the actuator [Hz]")
        if self.limit is not None:
            positive(self.limit, "limit of the actuator")
        if self.slew is not None:
            positive(self.slew, "rate limit of the actuator")

    @property
    def rate(self) -> float:
        """2 pi bandwidth [1/s], zero where there is no lag."""
        return 0.0 if self.bandwidth is None else 2 * math.pi * self.bandwidth

    def limited(self, u: Array) -> Array:
        """Return u cut off at the limit."""
        if self.limit is None:
            return u
        return np.minimum(np.maximum(u, -self.limit), self.limit)


@dataclass(frozen=True)
class BumpStops(Short):
    """One-sided springs beyond the free travel, between wheel and body beside the actuator.

    With x the suspension deflection, positive in compression, and d = x - bump > 0 the stop's
    force up on the body (down on the wheel) is max(stiffness d + damping dx/dt, 0).
    With e = -x - rebound > 0 it is -max(stiffness e - damping dx/dt, 0). It pushes, never pulls.
    With damping it jumps at contact, where a fixed step is of order one.

    Attributes
    ----------
    bump, rebound : float
        Free travel in compression and extension [m].
    stiffness : float
        [N/m]
    damping : float
        [N s/m]
    """

    bump: float = 0.08
    rebound: float = 0.08
    stiffness: float = 300e3
    damping: float = 0.0

    @explained_fields
    def __post_init__(self) -> None:
        positive(self.bump, "free travel in bump [m]")
        positive(self.rebound, "free travel in rebound [m]")
        positive(self.stiffness, "stiffness of the stops [N/m]")
        if not (math.isfinite(self.damping) and self.damping >= 0):
            raise InputError(f"damping of the stops = {self.damping!r} N s/m must not be negative")

    def force(self, deflection: Array, rate: Array) -> Array:
        """Return the force [N], up on the sprung mass."""
        if not ((deflection > self.bump) | (deflection < -self.rebound)).any():
            return np.zeros(deflection.shape)
        over, under = deflection - self.bump, -deflection - self.rebound
        up = np.where(over > 0, np.maximum(self.stiffness * over + self.damping * rate, 0.0), 0.0)
        down = np.where(
            under > 0, np.maximum(self.stiffness * under - self.damping * rate, 0.0), 0.0
        )
        return np.asarray(up - down)


@dataclass(frozen=True)
class Measured(Short):
    """The law's parameters come from sensors: late, noisy, filtered.

    The reading is the true value ``delay`` ago (the first value before that), plus white noise
    held for ``period``, through a first-order filter. The law takes it cut off at the interval.

    Attributes
    ----------
    delay, lag : float
        [s]; ``lag`` is the filter's time constant.
    noise : mapping of str to float
        Standard deviation by parameter, in its unit.
    period : float, optional
        For which a value of the noise is held [s]; by default the controller's sampling period,
        else the step.
    seed : int
    """

    delay: float = 0.0
    lag: float = 0.0
    noise: Mapping[str, float] = field(default_factory=dict)
    period: float | None = None
    seed: int = 0

    @explained_fields
    def __post_init__(self) -> None:
        named = {"delay": self.delay, "lag": self.lag}
        named |= {f"noise of {name}": value for name, value in self.noise.items()}
        for name, value in named.items():
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"{name} = {value!r} of the scheduling must not be negative")
        if self.period is not None:
            positive(self.period, "period of the noise [s]")


@dataclass(frozen=True)
class Sensors(Short):
    """Standard deviations of what an estimator measures, white from sample to sample.

    Attributes
    ----------
    acceleration : float
        Of the sprung mass [m/s2].
    deflection, velocity : float
        Suspension deflection [m] and its rate [m/s].
    force : float
        Of the actuator [N].
    """

    acceleration: float = 0.0
    deflection: float = 0.0
    velocity: float = 0.0
    force: float = 0.0

    @explained_fields
    def __post_init__(self) -> None:
        for name in ("acceleration", "deflection", "velocity", "force"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"noise of {name} = {value!r} must not be negative")

    @property
    def deviations(self) -> Array:
        """In the order force, velocity, deflection, acceleration."""
        return np.array([self.force, self.velocity, self.deflection, self.acceleration])


@dataclass(frozen=True)
class Estimated(Short):
    """The law's parameters come from recursive least squares, see `polefence.vehicle.estimate`.

    Attributes
    ----------
    period : float, optional
        Between samples [s]; by default the controller's sampling period, else 5 ms.
    tuning : Tuning
    sensors : Sensors
    seed : int
    """

    period: float | None = None
    tuning: Tuning = field(default_factory=Tuning)
    sensors: Sensors = field(default_factory=Sensors)
    seed: int = 0

    @explained_fields
    def __post_init__(self) -> None:
        if self.period is not None:
            positive(self.period, "period of the estimator [s]")


Scheduling = Measured | Estimated


@dataclass(frozen=True)
class Hardware(Short):
    """Hardware between law and plant, and beside the plant.

    Attributes
    ----------
    scheduling : Measured or Estimated, optional
        What the law is told of the parameters; by default the truth.
    sampling : Sampling, optional
        Of the controller; continuous by default.
    actuator : Actuator
    stops : BumpStops, optional
        Of every suspension of a car.
    gravity : float
        [m/s2] Of a quarter car: deflections then count from the equilibrium of the first load, and
        a change of load pulls the car down. By default they count from that of the current load,
        as the plant has them, and a change of load moves nothing that is at rest.
    dampers : tuple of Damper
        Inputs that are forces of controllable dampers: of what is demanded they give as much as
        they can at every instant, u between low v and high v. With ``sampling`` the coefficient
        of a sample's demand is held, cut off to low and high: u = c v. An actuator's limit cuts
        off what is demanded of them, never what they give.
    """

    scheduling: Scheduling | None = None
    sampling: Sampling | None = None
    actuator: Actuator = field(default_factory=Actuator)
    stops: BumpStops | None = None
    gravity: float = 0.0
    dampers: tuple[Damper, ...] = ()

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "dampers", tuple(self.dampers))
        if self.dampers and (self.actuator.bandwidth is not None or self.learns):
            what = "an estimator" if self.learns else "an actuator's bandwidth"
            raise InputError(f"controllable dampers go without {what} here; leave one of them out")

    @property
    def learns(self) -> bool:
        """Whether an estimator tells the law the parameters."""
        return isinstance(self.scheduling, Estimated)

    @property
    def of_a_quarter_car(self) -> bool:
        """Whether a part of it belongs to a quarter car."""
        return self.gravity != 0 or self.learns
