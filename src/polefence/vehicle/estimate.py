"""Recursive least squares for mass, damping and stiffness of a quarter car, and of a whole record.

From m1 dx3/dt = k x1 + c (x4 - x3) + u the measured acceleration is linear in what is sought,

    y = phi' theta,    phi = (u, x4 - x3, x1),    theta = (1/m1, c/m1, k/m1) ,

and the noise of the accelerometer, the largest of the four sensors', is in y and not in phi, where
it would bias the estimate. Noise of the others does bias it. Every sample does

    R <- f R + (1 - f) R0 + phi phi' / s^2,    theta <- theta + R^-1 phi (y - phi' theta) / s^2 ,

s being the standard deviation of the noise, f = exp(-period / memory), R0 the information of the
prior. R >= R0 always, so the covariance R^-1 never exceeds the prior's however long nothing moves
(no wind-up), and theta stays where it is then. S. Gunnarsson, Combining tracking and
regularization in recursive least squares identification, 35th IEEE CDC, 1996.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained, explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.weighting import positive
from polefence.vehicle.reference_laws import nominal
from polefence.vehicle.vehicle import Masses, masses, require_ride

NAMES = ("m1", "c", "k")
STEPS = 8  # of the projection onto the box, from afar


@dataclass(frozen=True)
class Tuning(Short):
    """Weights of an estimator.

    Attributes
    ----------
    memory : float
        Time constant of forgetting [s]; infinite: nothing is forgotten.
    noise : float
        Standard deviation of the measured acceleration [m/s2] that is reckoned with.
    prior : mapping of str to float, optional
        m1 [kg], c [N s/m] and k [N/m] to begin with; by default the plant's nominal values.
    spread : float, optional
        Standard deviation of 1/m1, c/m1 and k/m1 about the prior, as a share of each; by default
        the largest deviation of each over the family.

    Raises
    ------
    InputError
        If a number is not positive.
    """

    memory: float = 1.0
    noise: float = 0.1
    prior: Mapping[str, float] | None = None
    spread: float | None = None

    @explained_fields
    def __post_init__(self) -> None:
        if self.memory != math.inf:
            positive(self.memory, "memory of an estimator [s]")
        positive(self.noise, "noise of an estimator's acceleration [m/s2]")
        if self.spread is not None:
            positive(self.spread, "spread of an estimator's prior")


@dataclass(frozen=True, eq=False)
class Belief(Short):
    """Estimates and their spread at one time, for ``count`` cars.

    Attributes
    ----------
    theta : (count, 3) array
        1/m1, c/m1, k/m1 as shares of the prior's.
    information : (count, 3, 3) array
        Inverse of their covariance.
    shares : (count, q) array
        Of the way from the low to the high end of each scheduling variable.
    """

    theta: Array
    information: Array
    shares: Array


@dataclass(frozen=True, eq=False)
class Estimator(Short):
    """One sample of recursive least squares after the other; made by `estimator`."""

    plant: UncertainPlant
    scale: Array
    floor: Array
    corners: Array
    forget: float
    noise: float

    def begin(self, count: int) -> Belief:
        """Return the prior, for a number of cars."""
        q = len(self.plant.parameters)
        information = np.tile(self.floor, (count, 1, 1))
        before = Belief(np.ones((count, 3)), information, np.full((count, q), 0.5))
        return self.projected(before, STEPS)

    def update(self, belief: Belief, phi: Array, y: Array, use: Any = None) -> Belief:
        """Return the belief after one sample; its shares are as before, see `projected`.

        Parameters
        ----------
        phi : (count, 3) array
            Force [N], rate of suspension deflection [m/s], suspension deflection [m].
        y : (count,) array
            Acceleration of the sprung mass [m/s2].
        use : (count,) array of bool, optional
            Where the sample is of use; where not, forgetting goes on.
        """
        scaled, target = phi * (self.scale / self.noise), y / self.noise
        if use is not None:
            scaled, target = scaled * use[:, None], target * use
        R = self.forget * belief.information + (1 - self.forget) * self.floor
        R = R + scaled[:, :, None] * scaled[:, None, :]
        wrong = target - np.sum(scaled * belief.theta, axis=1)
        step = np.linalg.solve(R, (scaled * wrong[:, None])[..., None])[..., 0]
        return replace(belief, theta=belief.theta + step, information=R)

    def projected(self, belief: Belief, steps: int = 1) -> Belief:
        """Return the belief with the shares brought up to date, from where they are."""
        if not self.plant.parameters:
            return belief
        shares = nearest(self.corners, belief.information, belief.theta, belief.shares, steps)
        return replace(belief, shares=shares)

    def parameters(self, shares: Array) -> Array:
        """Return parameter values, in their units, at shares (..., q)."""
        values = []
        for i, p in enumerate(self.plant.parameters):
            low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
            s = low + shares[..., i] * (high - low)
            value = 1 / s if p.inverted else s
            values.append(np.clip(value, float(p.low), float(p.high)))
        return np.stack(values, axis=-1) if values else np.zeros(shares.shape)

    def physical(self, theta: Array) -> Array:
        """Return m1, c, k at theta (..., 3); infinite where 1/m1 is not positive."""
        inverse = np.where(theta[..., :1] > 0, theta[..., :1] * self.scale[0], np.nan)
        physical = np.concatenate([1 / inverse, theta[..., 1:] * self.scale[1:] / inverse], axis=-1)
        return np.where(np.isnan(physical), np.inf, physical)

    def deviation(self, theta: Array, information: Array) -> Array:
        """Return standard deviations of m1, c, k, to first order (..., 3)."""
        covariance = np.linalg.inv(information)
        values = self.physical(theta)
        slope = np.zeros((*theta.shape, 3))
        slope[..., 0, 0] = -values[..., 0] / theta[..., 0]
        for i in (1, 2):
            slope[..., i, 0] = -values[..., i] / theta[..., 0]
            slope[..., i, i] = self.scale[i] / (theta[..., 0] * self.scale[0])
        return np.asarray(np.sqrt(np.einsum("...ij,...jk,...ik->...i", slope, covariance, slope)))

    def identifiable(self) -> Array:
        """Return for each parameter whether the sprung mass's motion depends on it, (q,) bool."""
        middle = np.full((1, len(self.plant.parameters)), 0.5)
        return np.asarray(np.abs(slopes(self.corners, middle)[0]).max(axis=1) > 1e-9)


def estimator(plant: UncertainPlant, period: float, tuning: Tuning | None = None) -> Estimator:
    """Return the estimator of a quarter car that gets a sample every ``period`` [s].

    Raises
    ------
    InputError
        If the plant is no quarter car, the period is not positive, or the prior is none.
    """
    tuning = tuning or Tuning()
    period = positive(period, "period of an estimator [s]")
    known = require_ride(plant)
    middle = _theta(masses(plant, known, nominal(plant)))
    scale = middle if tuning.prior is None else _prior(tuning.prior)
    vertices = _theta(masses(plant, known, np.eye(len(plant.vertices))))
    corners = vertices / scale
    spread = np.maximum(np.abs(corners - 1).max(axis=0), 0.01)
    if tuning.spread is not None:
        spread = np.full(3, float(tuning.spread))
    forget = math.exp(-period / tuning.memory)
    return Estimator(plant, scale, np.diag(spread**-2), corners, forget, tuning.noise)


def _theta(car: Masses) -> Array:
    return np.stack([1 / car.m1, car.c / car.m1, car.k / car.m1], axis=-1)


def _prior(given: Mapping[str, float]) -> Array:
    for name in given:
        if name not in NAMES:
            raise InputError(f"prior: unknown {name!r}; {suggest(str(name), NAMES)}")
    for name, unit in zip(NAMES, ("kg", "N s/m", "N/m"), strict=True):
        value = given.get(name)
        if value is None or not (math.isfinite(value) and value > 0):
            raise InputError(f"prior: {name} = {value!r} must be a positive number [{unit}]")
    m1, c, k = (float(given[name]) for name in NAMES)
    return np.array([1 / m1, c / m1, k / m1])


def point(corners: Array, shares: Array) -> Array:
    """Return the multi-affine image of shares (..., q), with values (2^q, r) at the corners.

    The first parameter varies slowest, each from its low to its high end.
    """
    return np.asarray(corner_weights(_pairs(shares)) @ corners)


def slopes(corners: Array, shares: Array) -> Array:
    """Return the derivatives of `point` by each share, (..., q, r)."""
    pairs, turned = _pairs(shares), np.array([-1.0, 1.0])
    derivatives = []
    for i in range(shares.shape[-1]):
        turned_pairs = [*pairs]
        turned_pairs[i] = np.broadcast_to(turned, pairs[i].shape)
        derivatives.append(corner_weights(turned_pairs) @ corners)
    return np.stack(derivatives, axis=-2)


def corner_weights(pairs: list[Array]) -> Array:
    """Return the Kronecker product of pairs (..., 2), the first slowest."""
    first, *others = pairs
    for pair in others:
        product = first[..., :, None] * pair[..., None, :]
        first = product.reshape(*first.shape[:-1], -1)
    return first


def nearest(corners: Array, weight: Array, target: Array, start: Array, steps: int) -> Array:
    """Return shares in [0, 1] that minimise |point - target| in the metric of ``weight``.

    Gauss-Newton steps; one that meets the box is cut off there and followed by exact minimisation
    along every coordinate. Neither ever goes up. A share that nothing depends on stays where it is.

    Parameters
    ----------
    corners : (2^q, r) array
    weight : (..., r, r) array
        Positive definite.
    target : (..., r) array
    start : (..., q) array
        In the box.
    steps : int
        Two are enough where the start is a sample old.
    """
    shares = start
    for _ in range(steps):
        wrong = target - point(corners, shares)
        J = slopes(corners, shares)
        left = J @ weight
        H = left @ np.swapaxes(J, -1, -2)
        ridge = 1e-9 * np.max(H, axis=(-1, -2))[..., None, None] + 1e-300
        step = np.linalg.solve(H + ridge * np.eye(shares.shape[-1]), left @ wrong[..., None])
        moved = np.minimum(np.maximum(shares + step[..., 0], 0.0), 1.0)
        better = cost(weight, target - point(corners, moved)) <= cost(weight, wrong)
        shares = np.where(better[..., None], moved, shares)
        if not ((moved > 0) & (moved < 1) & better[..., None]).all():
            shares = _sweep(corners, weight, target, shares)
    return shares


def cost(weight: Array, wrong: Array) -> Array:
    """Return the squared length that `nearest` minimises, (...)."""
    return np.asarray(((wrong[..., None, :] @ weight) @ wrong[..., None])[..., 0, 0])


def _pairs(shares: Array) -> list[Array]:
    both = np.stack([1 - shares, shares], axis=-1)
    return [both[..., i, :] for i in range(shares.shape[-1])]


def _sweep(corners: Array, weight: Array, target: Array, shares: Array) -> Array:
    """Minimise along one coordinate after the other."""
    best = shares.copy()
    for i in range(shares.shape[-1]):
        line = slopes(corners, best)[..., i, :]
        pull = (weight @ line[..., None])[..., 0]
        steep = np.sum(pull * line, axis=-1)
        wrong = target - point(corners, best)
        step = np.sum(pull * wrong, axis=-1) / np.where(steep > 0, steep, np.inf)
        best[..., i] = np.minimum(np.maximum(best[..., i] + step, 0.0), 1.0)
    return best


@dataclass(frozen=True, eq=False)
class Estimate(Short):
    """Estimates over time, for ``count`` cars.

    Attributes
    ----------
    time : (time,) array
        [s]; a value is known from its time on.
    values, deviation : (count, time, 3) arrays
        m1 [kg], c [N s/m], k [N/m], free of the family; their standard deviations as far as noise
        of the accelerometer makes them, to first order.
    parameters : (count, time, q) array
        The plant's parameters, in their units: the point of their box nearest to ``values`` in
        the metric of the information.
    """

    time: Array
    values: Array
    deviation: Array
    parameters: Array

    def settled(self, true: Any, within: Any) -> Array:
        """Return from when on each parameter's error stays in a band, (count, q) [s], else nan.

        Parameters
        ----------
        true, within : array
            Broadcast against ``parameters``; in the parameters' units.
        """
        off = np.abs(self.parameters - np.asarray(true, dtype=float)) > np.asarray(within)
        last = off.shape[1] - 1 - np.argmax(off[:, ::-1], axis=1)
        first = np.where(off.any(axis=1), last + 1, 0)
        times = np.append(self.time, np.nan)
        return np.asarray(times[first])


@explained
def estimate(
    plant: UncertainPlant,
    acceleration: Any,
    deflection: Any,
    velocity: Any,
    force: Any,
    period: float,
    tuning: Tuning | None = None,
) -> Estimate:
    """Estimate m1, c, k and the plant's parameters from samples.

    Parameters
    ----------
    acceleration : (time,) or (count, time) array
        Of the sprung mass [m/s2].
    deflection, velocity : arrays of the same shape
        Suspension deflection [m], positive in compression, and its rate x4 - x3 [m/s].
    force : array of the same shape
        Of the actuator as it acts [N], up on the sprung mass.
    period : float
        Between samples [s].
    tuning : Tuning, optional

    Returns
    -------
    Estimate
        One value for each sample, that sample included.

    Raises
    ------
    InputError
        If the shapes differ, a sample is not finite, or the plant is no quarter car.

    Notes
    -----
    Without force only c/m1 and k/m1 show, and m1 keeps its prior; where one parameter moves c and
    k together, even it cannot be told from m1 then.
    """
    recursion = estimator(plant, period, tuning)
    named = {
        "acceleration": acceleration, "force": force, "velocity": velocity, "deflection": deflection
    }  # fmt: skip
    y, u, rate, x = (_samples(name, value) for name, value in named.items())
    if not y.shape == u.shape == rate.shape == x.shape:
        shapes = ", ".join(f"{k} {np.shape(v)}" for k, v in named.items())
        raise InputError(f"samples must have one shape; got {shapes}")
    phi = np.stack([u, rate, x], axis=-1)
    belief, beliefs = recursion.begin(len(y)), list[Belief]()
    for k in range(y.shape[1]):
        belief = recursion.update(belief, phi[:, k], y[:, k])
        beliefs.append(belief)
    return collected(recursion, period * np.arange(y.shape[1]), beliefs)


def collected(recursion: Estimator, time: Any, beliefs: Sequence[Belief]) -> Estimate:
    """Return beliefs at times as one value, all brought onto the box of parameters."""
    theta, R, shares = (
        np.stack([getattr(b, name) for b in beliefs], axis=1)
        for name in ("theta", "information", "shares")
    )
    on_box = recursion.projected(Belief(theta, R, shares), STEPS).shares
    values, deviation = recursion.physical(theta), recursion.deviation(theta, R)
    return Estimate(np.asarray(time), values, deviation, recursion.parameters(on_box))


def _samples(name: str, value: Any) -> Array:
    try:
        samples = np.atleast_2d(np.asarray(value, dtype=float))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be an array of numbers") from error
    bad = np.argwhere(~np.isfinite(samples))
    if len(bad):
        raise InputError(f"{name}: sample {bad[0][-1] + 1} is not finite; mend or cut it")
    if samples.ndim != 2 or not samples.shape[1]:
        raise InputError(f"{name} must have shape (time,) or (count, time); got {samples.shape}")
    return samples
