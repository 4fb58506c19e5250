"""Laws that a quarter car's designs are compared with: none, skyhook damping, LQR."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained, explained_fields
from polefence.certify.bounds import sampled
from polefence.law.laws import FixedGain
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.search.rows import Row
from polefence.search.tradeoff import SAMPLES, Asked, Front
from polefence.vehicle.vehicle import Masses, Ride, masses, require_ride


@dataclass(frozen=True)
class Sizes(Short):
    """Sizes that count as equally bad in a linear-quadratic design (Bryson's rule).

    The cost is the integral of the sum of (signal / size)^2.

    Attributes
    ----------
    acceleration : float
        Of the sprung mass [m/s2].
    travel, tyre : float
        Suspension and tyre deflection [m].
    force : float
        Of the actuator [N].
    integral : float, optional
        Of the integral of suspension deflection [m s]. By default the integral is left out: the
        law has no feedback of it.
    """

    acceleration: float = 1.0
    travel: float = 0.03
    tyre: float = 0.005
    force: float = 1000.0
    integral: float | None = None

    @explained_fields
    def __post_init__(self) -> None:
        for size in fields(self):
            value = getattr(self, size.name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"size of {size.name} = {value!r} must be a positive number")


@explained
def nominal(plant: UncertainPlant) -> Array:
    """Return alpha (N,) at the middle of every parameter's interval; without parameters, 1/N."""
    if not plant.parameters:
        count = len(plant.vertices)
        return np.full(count, 1 / count)
    middle: dict[str, Any] = {p.name: (p.low + p.high) / 2 for p in plant.parameters}
    return plant.alpha(**middle)


@explained
def passive(plant: UncertainPlant) -> FixedGain:
    """Return the law that does nothing, u = 0."""
    n, m = plant.shape
    return FixedGain(np.zeros((m, n)))


@explained
def skyhook(plant: UncertainPlant, damping: float | None = None) -> FixedGain:
    """Return u = -c_sky x3: a damper between the sprung mass and the sky.

    The force acts up on the sprung mass, B has 1/m1 there, so that against its velocity it damps:
    dx3/dt = ... - (c_sky / m1) x3. The actuator sits between the masses, so the unsprung mass
    feels + c_sky x3. The force is active: no semi-active limit is put on it.

    Parameters
    ----------
    damping : float, optional
        c_sky [N s/m]; by default 0.7 of critical for the nominal mass and spring,
        2 * 0.7 * sqrt(k m1).

    Raises
    ------
    InputError
        If the plant is no quarter car, or the damping is not positive.
    """
    known, car = _nominal_car(plant)
    if damping is None:
        if float(car.k) <= 0:
            raise InputError(f"{plant.name} has no spring at its nominal values; give the damping")
        damping = 0.7 * 2 * math.sqrt(float(car.k) * float(car.m1))
    if not (math.isfinite(damping) and damping > 0):
        raise InputError(f"skyhook damping = {damping!r} must be a positive number [N s/m]")
    K = np.zeros((plant.shape[1], plant.shape[0]))
    K[known.input, known.places[2]] = -damping
    return FixedGain(K)


@explained
def lqr(plant: UncertainPlant, sizes: Sizes | None = None) -> FixedGain:
    """Return the linear-quadratic regulator of the nominal quarter car.

    It minimises the integral of (acceleration / a)^2 + (travel / b)^2 + (tyre / d)^2 + (u / f)^2
    with the `Sizes` a, b, d, f, where acceleration depends on states and force alike, which makes
    a cross term. The state is that of the four `vehicle.STATES`: the integral of the deflection
    has no cost and is not fed back, unless ``sizes.integral`` gives it one. An actuator's lag is
    not in the design: the law sets the demand as if the force were there at once. No claim over
    the family comes with it.

    Raises
    ------
    InputError
        If the plant is no quarter car, a size is not positive, or the Riccati equation has no
        stabilising solution.
    """
    from scipy.linalg import solve_continuous_are

    sizes = sizes or Sizes()
    known, _ = _nominal_car(plant)
    kept = list(known.places)
    if sizes.integral is not None:
        kept.append(_integral(plant, known))
    A, B = plant.at(nominal(plant))
    A, B = A[np.ix_(kept, kept)], known.push(A, B)[kept][:, None]
    eye = np.eye(len(kept))
    state = [A[2] / sizes.acceleration, eye[0] / sizes.travel, eye[1] / sizes.tyre, 0 * eye[0]]
    force = [B[2] / sizes.acceleration, [0.0], [0.0], [1 / sizes.force]]
    if sizes.integral is not None:
        state.append(eye[4] / sizes.integral)
        force.append([0.0])
    C, D = np.stack(state), np.array(force, dtype=float)
    R = D.T @ D
    try:
        P = solve_continuous_are(A, B, C.T @ C, R, s=C.T @ D)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise InputError(f"{plant.name}: no linear-quadratic regulator: {error}") from error
    K = np.zeros((plant.shape[1], plant.shape[0]))
    K[known.input, kept] = -np.linalg.solve(R, B.T @ P + D.T @ C)[0]
    return FixedGain(K)


def _nominal_car(plant: UncertainPlant) -> tuple[Ride, Masses]:
    known = require_ride(plant)
    return known, masses(plant, known, nominal(plant))


def _integral(plant: UncertainPlant, known: Ride) -> int:
    """Return the number of the state whose rate is the suspension deflection, and nothing else."""
    wanted = np.eye(plant.shape[0])[known.places[0]]
    for i in range(plant.shape[0]):
        if i not in known.places and np.all(plant.A[:, i] == wanted) and not plant.B[:, i].any():
            return i
    raise InputError(f"{plant.name} has no state that is the integral of {known.travel.name}")


@explained
def beside_reference_laws(front: Front) -> Front:
    """Return a trade-off of a car with those reference laws that are stable over the family.

    Of any other plant it is as it was.
    """
    if front.asked.plant.vehicle is None:
        return front
    return replace(front, references=tuple(_references(front.asked)))


def _references(asked: Asked) -> Iterator[Row]:
    alpha = seeded(asked.plant, SAMPLES)
    for name, law_of in {"passive": passive, "skyhook": skyhook, "LQR": lqr}.items():
        with suppress(InputError):
            law = law_of(asked.plant)
            both = (asked.over, asked.minimise)
            over, least = (sampled(asked.plant, law, s, alpha).worst for s in both)
            keeps = all(
                sampled(asked.plant, law, limit, alpha).worst <= (limit.at_most or 0.0)
                for limit in asked.subject_to
            )
            yield {"name": name, "over": over, "minimise": least, "keeps": keeps}
