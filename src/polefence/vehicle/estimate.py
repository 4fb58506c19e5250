"""Mass, damping, stiffness and parameters that recursive least squares make of a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.vehicle.recursion import STEPS, Belief, Estimator, Tuning, estimator


@dataclass(frozen=True, eq=False)
class Estimate:
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
    own = estimator(plant, period, tuning)
    named = {
        "acceleration": acceleration, "force": force, "velocity": velocity, "deflection": deflection
    }  # fmt: skip
    y, u, rate, x = (_samples(name, value) for name, value in named.items())
    if not y.shape == u.shape == rate.shape == x.shape:
        shapes = ", ".join(f"{k} {np.shape(v)}" for k, v in named.items())
        raise InputError(f"samples must have one shape; got {shapes}")
    phi = np.stack([u, rate, x], axis=-1)
    belief, beliefs = own.begin(len(y)), list[Belief]()
    for k in range(y.shape[1]):
        belief = own.update(belief, phi[:, k], y[:, k])
        beliefs.append(belief)
    return collected(own, period * np.arange(y.shape[1]), beliefs)


def collected(own: Estimator, time: Any, beliefs: Sequence[Belief]) -> Estimate:
    """Return beliefs at times as one value, all brought onto the box of parameters."""
    theta, R, shares = (
        np.stack([getattr(b, name) for b in beliefs], axis=1)
        for name in ("theta", "information", "shares")
    )
    on_box = own.projected(Belief(theta, R, shares), STEPS).shares
    values, deviation = own.physical(theta), own.deviation(theta, R)
    return Estimate(np.asarray(time), values, deviation, own.parameters(on_box))


def _samples(name: str, value: Any) -> Array:
    try:
        found = np.atleast_2d(np.asarray(value, dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers") from error
    bad = np.argwhere(~np.isfinite(found))
    if len(bad):
        raise InputError(f"{name}: sample {bad[0][-1] + 1} is not finite; mend or cut it")
    if found.ndim != 2 or not found.shape[1]:
        raise InputError(f"{name} must have shape (time,) or (count, time); got {found.shape}")
    return found
