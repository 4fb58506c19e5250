"""Laws with states of their own from gains of what is measured and of one signal filtered.

All numbers of such a law at once are a hard search: most starts end where a state is of little use.
With a filter that stays as it is, a slow one of an acceleration or a quick one of a position, the
law is a plain gain of one signal more, and a good one is found: a start for all numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np

from polefence.design.requirements.specification import Specification
from polefence.design.tune.search import Tuned, tune
from polefence.law.laws import FixedGain, Law, PolynomialGain
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_dynamics
from polefence.plant.outputs import padded, states
from polefence.region.regions import Disk, HalfPlane, Region

SPEEDS = 0.3, 4.0  # a filter's pole, beside the slowest of the plant
TRIED, FACTOR = 40, 1.3  # of poles, until one is in the region
MOST = 4  # signals that are filtered, one after the other


def filtered(
    plant: UncertainPlant,
    structure: Structure,
    minimise: Specification | None,
    limits: Sequence[Specification] = (),
    region: Region | None = None,
) -> tuple[PolynomialGain, ...]:
    """Return laws of a structure's order whose states are filters, the best first: for starts.

    Parameters
    ----------
    plant : UncertainPlant
        Without the law's states.
    structure : Structure
        With its order; there are none for order zero.
    minimise, limits, region
        As `polefence.design.tune.search.tune` has them.

    Returns
    -------
    tuple of PolynomialGain
        Of the larger plant and the gain that `Structure.extended` returns; that keep everything.
    """
    if not structure.order or plant.sample_time is not None:
        return ()
    poles = dict.fromkeys(_pole(plant, region or HalfPlane(0.0), speed) for speed in SPEEDS)
    found = list[tuple[float, PolynomialGain]]()
    for (i, own), pole in product(enumerate(structure.outputs(plant)[:MOST]), poles):
        if pole is None:
            continue
        label = f"{own.name}, filtered"
        larger = with_dynamics(plant, (own,), ((-pole,),), ((pole,),), (label,))
        static = _with_signal(structure, plant, label)
        best = tune(larger, static, minimise, limits, region)[:1]
        for each in best:
            if each.kept:
                law = _of_order(each, static, larger, structure, plant, i, float(pole))
                found += [(each.level, law)] if law is not None else []
    return tuple(law for _, law in sorted(found, key=lambda each: each[0]))


def beside_filters(
    law: Law, plant: UncertainPlant, larger: UncertainPlant, structure: Structure, region: Region
) -> Law | None:
    """Return a law as one of a plant that has states of the law's own, which filter what it sees.

    They follow the signals y, each at a rate of its own, and are not fed back: the loop is as it
    was, and what feeding them back would bring has a slope. None where the region has no room for
    them, or a law in alpha has terms that this cannot be written in.

    Parameters
    ----------
    structure : Structure
        That of the law, without states.
    region : Region
        Where the filters' poles are to be.
    """
    k, (m, n), names = larger.shape[0] - plant.shape[0], plant.shape[::-1], states(larger)
    y = structure.outputs(plant)
    found = [_pole(plant, region, speed) for speed in np.geomspace(*SPEEDS, k)]
    if None in found:
        return None
    rates = np.array(found, dtype=float)
    if isinstance(law, FixedGain):
        C = np.array([[float(x) for x in own.C[0]] for own in y])
        gains = np.zeros((1, m + k, n + k))
        gains[0, :m, :n] = law.K
        gains[0, m:, :n] = rates[:, None] * C[np.arange(k) % len(C)]
        gains[0, m:, n:] = -np.diag(rates)
        return FixedGain(gains[0])
    if not isinstance(law, PolynomialGain) or (not law.parameters and law.degree > 1):
        return None
    r = law.gains.shape[2]
    gains = np.zeros((len(law.gains), m + k, r + k))
    gains[:, :m, :r] = law.gains
    whole = [e for e in law.powers if not any(e)] or law.powers  # alpha sums to one
    for j in (law.powers.index(e) for e in whole):
        gains[j, m + np.arange(k), np.arange(k) % r] = rates
        gains[j, m:, r:] = -np.diag(rates)
    measured = (*(padded(own, k) for own in law.measured or states(plant)), *names[n:])
    return PolynomialGain(law.powers, gains, measured, law.parameters)


def _pole(plant: UncertainPlant, region: Region, speed: float) -> Fraction | None:
    """Return a filter's pole, its sign turned, that lies in the region; None where none does."""
    speeds = np.abs(np.linalg.eigvals(plant.A)).ravel()
    speeds = speeds[speeds > 1e-3 * speeds.max()] if speeds.max() > 0 else np.ones(1)
    tried = [speed * float(speeds.min()) * FACTOR**k for k in range(TRIED)]
    tried += [-part.centre for part in region.parts if isinstance(part, Disk)]
    for pole in tried:
        if region.distance(np.array([-pole + 0j]))[0] < -1e-3 * pole:
            return Fraction(f"{pole:.6g}")
    return None


def _with_signal(structure: Structure, plant: UncertainPlant, label: str) -> Structure:
    """Return a structure without states, of one free signal more."""
    names = structure.measured or tuple(own.name for own in states(plant))
    pattern, most = structure.pattern, structure.largest_gain
    if pattern is not None:
        pattern = tuple((*row, f"{label} {i}") for i, row in enumerate(pattern))
    if most is not None:
        limits = structure.largest(plant)
        most = tuple((*row, np.inf) for row in limits.tolist())
    return replace(structure, order=0, measured=(*names, label), pattern=pattern, largest_gain=most)


def _of_order(
    found: Tuned,
    static: Structure,
    larger: UncertainPlant,
    structure: Structure,
    plant: UncertainPlant,
    filtered: int,
    pole: float,
) -> PolynomialGain | None:
    """Return a law of the order whose first state is the filter; others follow, and do nothing."""
    (m, r), k = (plant.shape[1], len(structure.outputs(plant))), structure.order
    powers = static.powers(larger)
    whole = [j for j, e in enumerate(powers) if not any(e)]
    if not plant.parameters and max(map(sum, powers)) == 1:
        whole = list(range(len(powers)))  # alpha sums to one
    if not whole:
        return None
    every = np.zeros((len(powers), m + k, r + k))
    if isinstance(found.law, PolynomialGain):
        every[:, :m, : r + 1] = found.law.gains
    else:
        K = found.law.gain(np.eye(len(plant.vertices))[0])
        every[whole, :m, : r + 1] = K @ np.linalg.pinv(static.rows(larger)[0])
    for j in whole:
        for i, poles in enumerate(pole * FACTOR ** np.arange(k)):
            every[j, m + i, (filtered + i) % r] = poles
            every[j, m + i, r + i] = -poles
    bigger, own = structure.extended(plant)
    return own.law(bigger, every)
