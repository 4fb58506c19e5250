"""Recursive least squares for mass, damping and stiffness of a quarter car, with forgetting.

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
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.response.weighting import positive
from polefence.vehicle.projection import nearest, slopes
from polefence.vehicle.reference_laws import nominal
from polefence.vehicle.vehicle import Masses, masses, require_ride

NAMES = ("m1", "c", "k")
UNITS = ("kg", "N s/m", "N/m")
STEPS = 8  # of the projection onto the box, from afar


@dataclass(frozen=True)
class Tuning:
    """How an estimator weighs what it is told.

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

    def __post_init__(self) -> None:
        if self.memory != math.inf:
            positive(self.memory, "memory of an estimator [s]")
        positive(self.noise, "noise of an estimator's acceleration [m/s2]")
        if self.spread is not None:
            positive(self.spread, "spread of an estimator's prior")


@dataclass(frozen=True, eq=False)
class Belief:
    """What an estimator holds to be true at one time, for ``count`` cars.

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
class Estimator:
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
        found = []
        for i, p in enumerate(self.plant.parameters):
            low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
            s = low + shares[..., i] * (high - low)
            value = 1 / s if p.inverted else s
            found.append(np.clip(value, float(p.low), float(p.high)))
        return np.stack(found, axis=-1) if found else np.zeros(shares.shape)

    def physical(self, theta: Array) -> Array:
        """Return m1, c, k at theta (..., 3); infinite where 1/m1 is not positive."""
        inverse = np.where(theta[..., :1] > 0, theta[..., :1] * self.scale[0], np.nan)
        found = np.concatenate([1 / inverse, theta[..., 1:] * self.scale[1:] / inverse], axis=-1)
        return np.where(np.isnan(found), np.inf, found)

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
    for name, unit in zip(NAMES, UNITS, strict=True):
        value = given.get(name)
        if value is None or not (math.isfinite(value) and value > 0):
            raise InputError(f"prior: {name} = {value!r} must be a positive number [{unit}]")
    m1, c, k = (float(given[name]) for name in NAMES)
    return np.array([1 / m1, c / m1, k / m1])
