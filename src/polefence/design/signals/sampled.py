"""Signals of a law at sampled parameters, in floats: how much of a proved bound is conservatism.

A sample proves nothing. Its worst value is at most the true worst case, which is at most a bound
that is proved; the ratio of the two says how far apart they can be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.requirements.specification import Specification
from polefence.design.signals.bounds import Bound, raised
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.system import Array

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
    values = specification.values(plant, law, alpha)
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
    signal, found = own.output(plant), [0.0]
    for key in "CD":
        rows = getattr(signal, key)
        for k in range(len(rows[0]) if rows else 0):
            alone = [[x if j == k else 0 for j, x in enumerate(row)] for row in rows]
            if any(map(any, alone)):
                one = Output(signal.name, signal.unit, **{key: alone})
                found.append(sampled(plant, law, replace(own, signal=one), alpha).worst)
    return max(found)
