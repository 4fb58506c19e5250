"""Laws that a car's designs are compared with: none, skyhook damping, LQR.

They are designed in continuous time. Of a plant at a sample time they are what its computer is
given: laws of the plant that it samples.
"""

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
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.search.rows import Row
from polefence.search.tradeoff import SAMPLES, Asked, Front
from polefence.vehicle.suspensions import Suspensions, in_continuous_time, is_car, suspensions


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
def skyhook(plant: UncertainPlant, damping: Any = None) -> FixedGain:
    """Return u = -c_sky v at each suspension: a damper between the body above it and the sky.

    The force acts up on the body, so that against its velocity v it damps. The actuator sits
    between body and wheel, so the wheel feels + c_sky v. The force is active: no semi-active limit
    is put on it.

    Parameters
    ----------
    damping : float or sequence of float, optional
        c_sky [N s/m], one number or one for each suspension; by default 0.7 of critical for the
        nominal spring k and the mass m that the suspension's force feels, 2 * 0.7 * sqrt(k m).

    Raises
    ------
    InputError
        If the plant is no car, or the damping is not positive.
    """
    car, known = _nominal_car(plant)
    if damping is None:
        physics = known.corners(nominal(car))
        if physics.spring.min() <= 0:
            raise InputError(f"{plant.name} has no spring at its nominal values; give the damping")
        damping = 0.7 * 2 * np.sqrt(physics.spring * physics.mass)
    K = np.zeros(car.shape[::-1])
    K[list(known.inputs)] = 0.0 - _dampings(damping, len(known.names))[:, None] * known.body
    return _wide(plant, K)


def _dampings(given: Any, count: int) -> Array:
    """Return one damping for each suspension.

    Raises
    ------
    InputError
        If they are not so many, or not positive.
    """
    try:
        values = np.broadcast_to(np.asarray(given, dtype=float), (count,))
    except (TypeError, ValueError) as error:
        raise InputError(f"skyhook damping = {given!r}; give one number, or {count}") from error
    if not (np.isfinite(values).all() and values.min() > 0):
        raise InputError(f"skyhook damping = {given!r} must be a positive number [N s/m]")
    return np.asarray(values)


@explained
def lqr(plant: UncertainPlant, sizes: Sizes | None = None) -> FixedGain:
    """Return the linear-quadratic regulator of the nominal car.

    It minimises the integral of (acceleration / a)^2 + (travel / b)^2 + (tyre / d)^2 + (u / f)^2
    with the `Sizes` a, b, d, f, summed over all seats and wheels, where acceleration depends on
    states and force alike, which makes a cross term. The state is that of the car itself: the
    integral of a deflection has no cost and is not fed back, unless ``sizes.integral`` gives it
    one. An actuator's lag is not in the design: the law sets the demand as if the force were there
    at once. No claim over the family comes with it.

    Raises
    ------
    InputError
        If the plant is no car, a size is not positive, or the Riccati equation has no stabilising
        solution.
    """
    from scipy.linalg import solve_continuous_are

    sizes = sizes or Sizes()
    car, known = _nominal_car(plant)
    kept = list(known.places)
    if sizes.integral is not None:
        kept += [_integral(car, travel) for travel in known.travel]
    alpha, k = nominal(car), len(known.names)
    A, B = car.at(alpha)
    pushed = known.push(A, B)
    A, B = A[np.ix_(kept, kept)], pushed[kept]
    felt = [_felt(car, known, signal, alpha) for signal in known.felt.values()]
    still = np.zeros((k, k))
    eye = np.eye(len(kept))
    tyres = [signal.arrays(car)[0][0][kept] for signal in known.tyre]
    state = [
        *(C[kept] / sizes.acceleration for C, _ in felt),
        *(known.compression[:, kept] / sizes.travel),
        *(np.array(tyres) / sizes.tyre),
        *np.zeros((k, len(kept))),
    ]
    force = [*(D / sizes.acceleration for _, D in felt), *still, *still, *(np.eye(k) / sizes.force)]
    if sizes.integral is not None:
        state += list(eye[len(known.places) :] / sizes.integral)
        force += list(still)
    C, D = np.stack(state), np.stack(force)
    R = D.T @ D
    try:
        P = solve_continuous_are(A, B, C.T @ C, R, s=C.T @ D)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise InputError(f"{plant.name}: no linear-quadratic regulator: {error}") from error
    K = np.zeros(car.shape[::-1])
    K[np.ix_(known.inputs, kept)] = -np.linalg.solve(R, B.T @ P + D.T @ C)
    return _wide(plant, K)


def _felt(
    car: UncertainPlant, known: Suspensions, signal: Output, alpha: Array
) -> tuple[Array, Array]:
    """Return an acceleration's rows by states, and by the suspensions' forces."""
    C, D, _ = (np.tensordot(alpha, M, 1) for M in signal.arrays(car))
    pairs = zip(known.inputs, known.lags, strict=True)
    return C, np.array([D[number] if lag is None else C[lag] for number, lag in pairs])


def _nominal_car(plant: UncertainPlant) -> tuple[UncertainPlant, Suspensions]:
    car = in_continuous_time(plant)
    return car, suspensions(car)


def _wide(plant: UncertainPlant, K: Array) -> FixedGain:
    """Return a gain of a plant in continuous time as one of its samples, or of a law's states.

    Further states are not fed back, and further inputs are zero.
    """
    m, n = K.shape
    return FixedGain(np.pad(K, ((0, plant.shape[1] - m), (0, plant.shape[0] - n))))


def _integral(plant: UncertainPlant, travel: Output) -> int:
    """Return the number of the state whose rate is a suspension's deflection, and nothing else."""
    wanted = travel.arrays(plant)[0]
    for i in range(plant.shape[0]):
        if np.all(plant.A[:, i] == wanted) and not plant.B[:, i].any():
            return i
    raise InputError(f"{plant.name} has no state that is the integral of {travel.name}")


@explained
def beside_reference_laws(front: Front) -> Front:
    """Return a trade-off of a car with those reference laws that are stable over the family.

    Of any other plant it is as it was.
    """
    if not is_car(front.asked.plant):
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
