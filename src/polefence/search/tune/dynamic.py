"""Laws with states of their own, to start from: observers, and gains of filtered signals.

All numbers of such a law at once are a hard search: most starts end where a state is of little use.
A regulator with an observer of the middle of the family, reduced to the law's order, uses them all.
With a filter that stays as it is, a slow one of an acceleration or a quick one of a position, the
law is a plain gain of one signal more, and a good one is found. A very quick one gives its rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product

import numpy as np

from polefence.law.laws import FixedGain, Law, PolynomialGain
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_dynamics
from polefence.plant.outputs import states
from polefence.plant.system import Array
from polefence.region.regions import Region, stable
from polefence.requirements.specification import Specification
from polefence.response.modes import Modes
from polefence.response.stationary import growth
from polefence.search.tune.starts import (
    EFFORTS,
    FASTER,
    FLOOR_NOISE,
    Sizes,
    cost_of,
    decay_of,
    middle,
    shifted,
    typical,
)
from polefence.search.tune.tuner import Tuned, rough

SPEEDS = 0.3, 4.0  # a filter's pole, beside the slowest of the plant
# The same beside the fastest: a signal less itself through so quick a filter is its derivative. A
# velocity of three masses, order 1: 0.684 without, 0.649, 0.632 and 0.627 with 10, 30 and 80.
QUICK = 80.0
FACTOR = 1.3  # from one pole of a filter to the next, until one is in the region


def observers(
    plant: UncertainPlant,
    structure: Structure,
    asked: Sequence[Specification] = (),
    region: Region | None = None,
    known: Sequence[Law] = (),
) -> tuple[FixedGain, ...]:
    """Return laws of a structure's order that are regulators with observers of the middle.

    They are the middle's own, some that decay faster, and laws of all states that are known, with
    quick and slow observers; of these those nearest to the region over the family. Of an order
    below the plant's the states that matter most to the loop are kept, of one above it the others
    filter what is measured.

    Parameters
    ----------
    plant : UncertainPlant
        Without the law's states; in discrete time its delta form.
    structure : Structure
        With its order; there are none for order zero.
    asked : sequence of Specification
        What is minimised, and limits: what the regulator is to keep small.
    known : sequence of Law
        Of all states: these have observers as well, and come first.

    Returns
    -------
    tuple of FixedGain
        Of the larger plant that `Structure.extended` returns.
    """
    if not structure.order:
        return ()
    region = region or stable(float(plant.step))
    larger, gain = structure.extended(plant)
    scales = typical(larger, gain.rows(larger).mean(axis=0)).states[plant.shape[0] :]
    even = np.full((1, len(plant.vertices)), 1 / len(plant.vertices))
    sizes = typical(plant, structure.rows(plant).mean(axis=0))
    parts = _scaled(plant, structure, sizes, asked, even)
    K = [law.gain(even)[0] * sizes.states / sizes.inputs[:, None] for law in known]
    shifts = (*(s * _slowest(plant) for s in (0.0, 0.06, 0.2)), FASTER * decay_of(region, plant))
    pairs = [(of_known, 0.0, effort) for of_known, effort in product(K, EFFORTS)]
    pairs += [(None, *point) for point in product(dict.fromkeys(shifts), EFFORTS)]
    laws = (_observer(plant, scales, structure.order, sizes, parts, pair) for pair in pairs)

    def outside(law: FixedGain) -> float:
        spectra = (np.linalg.eigvals(v.A + v.B @ law.K) for v in larger.vertices)
        return max(float(region.distance(poles).max()) for poles in spectra)

    return tuple(sorted((law for law in laws if law is not None), key=outside)[:6])


@dataclass(frozen=True, eq=False)
class _Middle:
    """The middle of a family, states, inputs and signals in their sizes.

    Attributes
    ----------
    A, B, C : (n, n), (n, m), (r, n) arrays
    cost, noise : (n + m, n + m), (n + r, n + r) arrays
        Weights of a regulator, and intensities of an observer.
    """

    A: Array
    B: Array
    C: Array
    cost: Array
    noise: Array


def _scaled(
    plant: UncertainPlant,
    structure: Structure,
    sizes: Sizes,
    asked: Sequence[Specification],
    even: Array,
) -> _Middle:
    """Return the middle, with weights of what is asked and the noise that this is of."""
    (A, B, E), d = middle(plant), sizes.states
    C = structure.rows(plant).mean(axis=0) * d
    y = np.sqrt(np.maximum(np.diag(C @ sizes.covariance @ C.T), 1e-30))
    A, B, C = A / d[:, None] * d, B / d[:, None] * sizes.inputs, C / y[:, None]
    (n, m), r = B.shape, len(C)
    cost, noise = cost_of(plant, sizes, asked), np.zeros((n + r, n + r))
    for specification in (specification for specification in asked if specification.of_signal):
        E = specification.unweighted().channel(plant, even).E[0]
    E = E / d[:, None]
    noise[:n, :n] = E @ E.T / (np.trace(E @ E.T) or 1.0) * n + FLOOR_NOISE * np.eye(n)
    return _Middle(A, B, C, cost * (n + m) / (np.trace(cost) or 1.0), noise)


def _observer(
    plant: UncertainPlant,
    scales: Array,
    order: int,
    sizes: Sizes,
    at: _Middle,
    pair: tuple[Array | None, float, float],
) -> FixedGain | None:
    """Return a regulator with its observer, both of a shift and an effort; None where none is.

    Parameters
    ----------
    scales : (order,) array
        Sizes of the law's states.
    pair : tuple
        The regulator's gain, None for that of least cost; shift and effort.
    """
    A, B, C, rate, step = at.A, at.B, at.C, sizes.rate, float(plant.step)
    K, shift, effort = pair
    if K is None:
        K = shifted(A, B, at.cost, shift, effort, rate, step)
    L = shifted(A.T, C.T * rate, at.noise, shift, effort, rate, step)
    if K is None or L is None:
        return None
    L = L.T * rate
    loop = np.block([[A, B @ K], [-L @ C, A + B @ K + L @ C]])
    reduced = _reduced(loop, len(A), order, step)
    if reduced is None:
        return None
    T, U = reduced
    parts = -U @ L, U @ loop[len(A) :, len(A) :] @ T, K @ T
    return _compensator(plant, scales, parts, C, (sizes.states, sizes.inputs))


def _reduced(loop: Array, n: int, order: int, step: float) -> tuple[Array, Array] | None:
    """Return T and U of x_c = T z, z = U x_c, of the states behind the first n that matter most."""
    modes = Modes(loop[None], step)
    if not np.all(growth(modes.poles, step) < 0):
        return None
    eye = np.eye(len(loop))[None]
    X, Q = modes.lyapunov(eye)[0], modes.observed(eye)[0]
    values, vectors = np.linalg.eigh(X[n:, n:])
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values.max()))
    _, turn = np.linalg.eigh(root.T @ Q[n:, n:] @ root)
    size = np.sqrt(np.trace(X[:n, :n]) / n)
    T = root @ turn[:, ::-1] / size
    return T[:, :order], np.linalg.inv(T)[:order]


def _compensator(
    plant: UncertainPlant,
    scales: Array,
    parts: tuple[Array, Array, Array],
    C: Array,
    units: tuple[Array, Array],
) -> FixedGain:
    """Return the gain of the larger plant that has B_c, A_c and C_c; further states filter y.

    Parameters
    ----------
    scales : (k,) array
        Sizes of the law's states.
    parts : tuple of array
        B_c, A_c and C_c, of states, signals and inputs in their sizes.
    C : (r, n) array
        Of states and signals in their sizes.
    units : tuple of array
        Sizes of states and inputs.
    """
    (b, a, c), (d, u), k = parts, units, len(scales)
    (m, n), used = (len(c), C.shape[1]), len(a)
    gains = np.zeros((m + k, n + k))
    gains[:m, n : n + used] = c * u[:, None]
    gains[m : m + used, :n] = b @ C / d
    gains[m : m + used, n : n + used] = a
    rates = np.geomspace(*SPEEDS, k)[used:] * _slowest(plant)
    rest = np.arange(used, k)
    gains[m + rest, :n] = rates[:, None] * C[rest % len(C)] / d
    gains[m + rest, n + rest] = -rates
    gains[m:] *= scales[:, None]
    gains[:, n:] /= scales
    return FixedGain(gains)


def _slowest(plant: UncertainPlant) -> float:
    """Return the slowest rate of the plant, but for what hardly moves by itself."""
    speeds = np.abs(np.linalg.eigvals(plant.A)).ravel()
    return float(speeds[speeds > 1e-3 * speeds.max()].min()) if speeds.max() > 0 else 1.0


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
        Without the law's states; in discrete time its delta form.
    structure : Structure
        With its order; there are none for order zero.
    minimise, limits, region
        As `polefence.search.tune.tuner.tune` has them.

    Returns
    -------
    tuple of PolynomialGain
        Of the larger plant and the gain that `Structure.extended` returns; that keep everything at
        the corners of the family.
    """
    if not structure.order:
        return ()
    region = region or stable(float(plant.step))
    quick = QUICK * float(np.abs(np.linalg.eigvals(plant.A)).max()) / _slowest(plant)
    poles = dict.fromkeys(_pole(plant, region, speed) for speed in (*SPEEDS, quick))
    laws = list[tuple[float, PolynomialGain]]()
    for (i, signal), pole in product(enumerate(structure.outputs(plant)[:4]), poles):
        if pole is None:
            continue
        label = f"{signal.name}, filtered"
        larger = with_dynamics(plant, (signal,), ((-pole,),), ((pole,),), (label,))
        static = _with_signal(structure, plant, label)
        n = plant.shape[0]
        least = None if minimise is None else minimise.extended(n, 1)
        best = rough(larger, static, least, [limit.extended(n, 1) for limit in limits], region)
        if best is not None:
            law = _of_order(best, static, larger, structure, plant, i, float(pole))
            laws += [(best.level, law)] if law is not None else []
    return tuple(law for _, law in sorted(laws, key=lambda pair: pair[0]))


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
    k, n, names = larger.shape[0] - plant.shape[0], plant.shape[0], states(larger)
    y = structure.outputs(plant)
    poles = [_pole(plant, region, speed) for speed in np.geomspace(*SPEEDS, k)]
    if None in poles:
        return None
    rates = np.array(poles, dtype=float)
    return law.with_filters(y, rates, states(plant), names[n:])


def _pole(plant: UncertainPlant, region: Region, speed: float) -> Fraction | None:
    """Return a filter's pole, its sign turned, that lies in the region; None where none does."""
    tried = [speed * _slowest(plant) * FACTOR**k for k in range(40)]
    tried += [-part.circle[0] for part in region.parts if part.circle]
    for pole in tried:
        if region.distance(np.array([-pole + 0j]))[0] < -1e-3 * pole:
            return Fraction(f"{pole:.6g}")
    return None


def _with_signal(structure: Structure, plant: UncertainPlant, label: str) -> Structure:
    """Return a structure without states, of one free signal more."""
    names = structure.measured or tuple(state.name for state in states(plant))
    pattern, most = structure.pattern, structure.largest_gain
    if pattern is not None:
        pattern = tuple((*row, f"{label} {i}") for i, row in enumerate(pattern))
    if most is not None:
        limits = structure.largest(plant)
        most = tuple((*row, np.inf) for row in limits.tolist())
    return replace(structure, order=0, measured=(*names, label), pattern=pattern, largest_gain=most)


def _of_order(
    tuned: Tuned,
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
    if tuned.law.K is None:
        every[:, :m, : r + 1] = tuned.law.gains
    else:
        every[whole, :m, : r + 1] = tuned.law.K @ np.linalg.pinv(static.rows(larger)[0])
    for j in whole:
        for i, poles in enumerate(pole * FACTOR ** np.arange(k)):
            every[j, m + i, (filtered + i) % r] = poles
            every[j, m + i, r + i] = -poles
    bigger, gain = structure.extended(plant)
    return gain.law(bigger, every)
