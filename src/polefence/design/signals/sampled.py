"""Signals of a law at sampled parameters, in floats: how much of a proved bound is conservatism.

A sample proves nothing. Its worst value is at most the true worst case, which is at most a bound
that is proved; the ratio of the two says how far apart they can be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.signals.bounds import Bound, raised
from polefence.design.signals.gain_norm import GainNorm
from polefence.design.signals.specification import (
    EnergyPeak,
    InitialPeak,
    RelativeRms,
    Rms,
    Specification,
    signal_of,
)
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.response.closed import close, gains
from polefence.response.grid import MOST_CHOSEN
from polefence.response.linear import frequency, simulate
from polefence.response.stationary import STABLE, stationary

# Of a peak: time followed, of the slowest pole's time constant; step, of the fastest's.
FOLLOWED, STEP = 5.0, 0.25
# A sample is computed with rounding: it agrees with a bound that it passes by this share.
AGREED = 1e-6
NEARLY, NIL = 1e-2, 1e-9  # by which it passes one that is raised; of a signal that is nil
GROUP = 2_000_000  # of samples at once
COARSE, FINE, FEW = 60, 2000, 20  # frequencies at all points, and at the worst few


@dataclass(frozen=True, eq=False)
class Sampled:
    """One specification's signal at points of a family.

    Attributes
    ----------
    specification : Specification
    alpha : (count, N) array
    values : (count,) array
        In the signal's unit; of a gain, per unit of the disturbance.
    """

    specification: Specification
    alpha: Array
    values: Array

    @property
    def worst(self) -> float:
        """The largest value."""
        return float(self.values.max())


def sampled(
    plant: UncertainPlant, law: Any, specification: Specification, alpha: Array | None = None
) -> Sampled:
    """Return what a specification bounds, at points of a family.

    The rms by a Lyapunov equation at each point, and so the peak for bounded energy, which is the
    norm times the root of c P c', P the controllability Gramian; the peak from initial states by
    exact responses at close instants, from an ellipsoid of them by the largest root of
    c e^At X0 e^A't c' at those; the norm of a gain by its singular values; the gain by a sweep
    over frequency, which is fine at the worst points only.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    alpha : (count, N) array, optional
        By default `seeded`, 10,000 of them.

    Raises
    ------
    InputError
        If the loop is not stable at a point, or as `stationary` and `simulate` raise.
    """
    alpha = seeded(plant) if alpha is None else np.atleast_2d(np.asarray(alpha, dtype=float))
    if isinstance(specification, GainNorm):
        values = specification.values(plant, gains(plant, law, alpha))
        return Sampled(specification, alpha, values)
    signal = signal_of(plant, specification)
    if isinstance(specification, RelativeRms):
        values = _rms(plant, law, specification, signal, alpha)
        values /= _rms(plant, None, specification, signal, alpha)
    elif isinstance(specification, Rms):
        values = _rms(plant, law, specification, signal, alpha)
    elif isinstance(specification, EnergyPeak):
        values = stationary(plant, law, alpha, 2 * specification.norm**2, [signal]).rms[:, 0]
    elif isinstance(specification, InitialPeak):
        values = _peaks(plant, law, specification, signal, alpha)
    else:
        values = _gains(plant, law, signal, alpha)
    return Sampled(specification, alpha, np.asarray(values))


def agreed_bound(plant: UncertainPlant, law: Any, bound: Bound) -> Bound | None:
    """Return a proved bound that is no less than what doubles show of the law; None if they differ.

    The law is proved as a real matrix. One that cancels numbers far larger than what it leaves, or
    whose poles are too fast for doubles, does not keep the bound once doubles evaluate it. Where
    what is left is rounding, of the signal's own parts, the bound is raised above it.
    """
    own, alpha = bound.specification, seeded(plant, len(plant.vertices) + FEW)
    try:
        worst = sampled(plant, law, own, alpha).worst
        if worst <= bound.level * (1 + AGREED):
            return bound
        near = worst <= bound.level * (1 + NEARLY) or worst <= NIL * _parts(plant, law, own, alpha)
    except (InputError, np.linalg.LinAlgError):
        return None
    return raised(bound, worst * (1 + AGREED)) if near and own.at_most is None else None


def _parts(plant: UncertainPlant, law: Any, own: Specification, alpha: Array) -> float:
    """Return the largest worst value of the signal's terms, each alone."""
    signal, found = signal_of(plant, own), [0.0]
    for key in "CD":
        rows = getattr(signal, key)
        for k in range(len(rows[0]) if rows else 0):
            alone = [[x if j == k else 0 for j, x in enumerate(row)] for row in rows]
            if any(map(any, alone)):
                one = Output(signal.name, signal.unit, **{key: alone})
                found.append(sampled(plant, law, replace(own, signal=one), alpha).worst)
    return max(found)


def _rms(plant: UncertainPlant, law: Any, own: Rms, signal: Output, alpha: Array) -> Array:
    return np.array(stationary(plant, law, alpha, own.density, [signal]).rms[:, 0])


def _peaks(
    plant: UncertainPlant, law: Any, own: InitialPeak, signal: Output, alpha: Array
) -> Array:
    if not own.impulse and any(vertex.E is None for vertex in plant.vertices):
        plant = _moved_by_nothing(plant)
    loops = close(plant, law, alpha)
    count = len(loops.closed)
    starts = [np.tile(np.array(point, dtype=float), (count, 1)) for point in own.points]
    if own.impulse:
        starts += [own.impulse * loops.E[:, :, k] for k in range(loops.E.shape[2])]
    stationary(plant, law, alpha, 1.0, [signal])  # refuses what is not stable
    poles = loops.poles()
    fastest = np.abs(poles).max()
    slowest = np.where(-poles.real > STABLE * fastest, -poles.real, np.inf).min()
    steps = int(min(FOLLOWED / slowest * fastest / STEP + 1, MOST_CHOSEN))
    still, size = np.zeros((steps, loops.E.shape[2])), max(1, GROUP // steps)

    def squares(start: Array, part: slice) -> Array:
        one = simulate(plant, law, alpha[part], still, STEP / fastest, [signal], "held",
                       start[part])  # fmt: skip
        return np.asarray(one.values[:, :, 0] ** 2)

    found = np.zeros(count)
    axes = [np.tile(axis, (count, 1)) for axis in _axes(own)]
    for first in range(0, count, size):
        part = slice(first, first + size)
        each = [squares(start, part) for start in starts]
        if axes:  # c e^At L L' e^A't c' of X0 = L L'
            each.append(np.sum([squares(axis, part) for axis in axes], axis=0))
        found[part] = np.max([y.max(axis=1) for y in each], axis=0)
    return np.sqrt(found)


def _moved_by_nothing(plant: UncertainPlant) -> UncertainPlant:
    """Return the plant with a disturbance that does not enter: responses from states need none."""
    zero = tuple((Fraction(0),) for _ in range(plant.shape[0]))
    vertices = tuple(replace(vertex, exact_E=zero) for vertex in plant.vertices)
    return replace(plant, vertices=vertices, disturbances=(), outputs=(), vehicle=None)


def _axes(own: InitialPeak) -> Array:
    """Return the columns of L, X0 = L L', as rows."""
    if not own.ellipsoid:
        return np.zeros((0, 0))
    X0 = np.array(own.ellipsoid, dtype=float)
    # scaled before its eigenvalues are taken: states' units may lie decades apart
    scale = np.sqrt(np.where(np.diag(X0) > 0, np.diag(X0), 1.0))
    values, vectors = np.linalg.eigh(X0 / np.outer(scale, scale))
    return np.asarray((scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))).T)


def _gains(plant: UncertainPlant, law: Any, signal: Output, alpha: Array) -> Array:
    stationary(plant, law, alpha, 1.0, [signal])  # refuses what is not stable
    poles = np.abs(close(plant, law, alpha).poles())
    low, high = poles[poles > STABLE * poles.max()].min() / 10, 10 * poles.max()

    def swept(points: Array, count: int) -> Array:
        asked = np.append(0.0, np.geomspace(low, high, count)) / (2 * np.pi)
        found = frequency(plant, law, points, asked, [signal]).gain[:, :, 0]
        return np.asarray(np.sqrt((np.abs(found) ** 2).sum(axis=-1)).max(axis=1))

    values = swept(alpha, COARSE)
    worst = np.argsort(-values)[:FEW]
    values[worst] = np.maximum(values[worst], swept(alpha[worst], FINE))
    return values
