"""The loop that a computer closes: its poles at many parameter values.

What is proved of it, for all values, is in `polefence.export.timing`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.base.progress import stage
from polefence.certify.candidates import edge
from polefence.certify.design import Design
from polefence.export.memory import late_inputs
from polefence.law.laws import (
    check_alpha,
)
from polefence.plant.family import UncertainPlant
from polefence.plant.points import edges, inside, values_at
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response.discrete import zero_order_hold

POINTS = 10_000  # random ones
SHORTEST, LONGEST = 1e-5, 1e2  # sample times tried, over the fastest pole's time
TINY = 1e-300

Test = Callable[[float, Array], bool]


@dataclass(frozen=True, eq=False)
class SampledPoles(Short):
    """Poles of a sampled loop.

    Attributes
    ----------
    equivalent : (..., n) array
        s = log(z) / sample_time of the n largest |z| [1/s]: where poles in continuous time have the
        same motion at the samples.
    z : (..., n) array, or (..., n + m) with a delay
        All of them, the largest first. The delay's own are near zero while samples are short, one
        for each of the inputs that are late.
    """

    equivalent: Array
    z: Array


def sampled_poles(design: Design, alpha: Array, sample_time: float, delay: int = 1) -> SampledPoles:
    """Return the poles of the loop as a computer closes it every ``sample_time``.

    The input is held between samples (zero-order hold); with ``delay`` = 1 it is u[k] = K x[k-1],
    as where the law is computed during the step. States that the law keeps itself are stepped by
    their rates at once.

    Parameters
    ----------
    design : Design
        Of a plant in continuous time.
    alpha : (..., N) array
    sample_time : float
        [s]
    delay : int
        0 or 1 samples.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, the sample time not positive, or so long that the
        plant outgrows floating point in one.
    """
    time = require_usable(design, sample_time, delay)
    alpha = check_alpha(alpha, len(design.plant.vertices))
    z = _eigenvalues(stepped(design, alpha, time, delay))
    return SampledPoles(_equivalent(z, design.plant.shape[0], time), z)


def require_usable(design: Design, sample_time: Any, delay: int) -> float:
    """Return the sample time as a float.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the numbers cannot be used.
    """
    require_continuous(design, delay)
    try:
        value = float(sample_time)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(f"sample_time = {sample_time!r} must be a positive number of seconds")
    fastest = float(np.abs(design.poles(np.eye(len(design.plant.vertices)))).max())
    # no sample time is shorter than 1e-9 of the loop's fastest time
    if value * fastest < 1e-9:
        raise InputError(
            f"sample_time = {value:g} s is too short for floating point: the "
            f"loop's fastest pole is at {fastest:.3g} 1/s"
        )
    return value


def require_continuous(design: Design, delay: int) -> None:
    """Refuse discrete-time plants, whose law is sampled by design, and unknown delays."""
    time = design.plant.sample_time
    if time is not None:
        raise InputError(
            f"{design.plant.name} is a discrete-time plant: its law runs every {float(time):g} s, "
            "without delay, and the region is proved for just that"
        )
    if delay not in (0, 1) or isinstance(delay, bool):
        raise InputError(f"delay = {delay!r} must be 0 or 1, in samples")


def stepped(design: Design, alpha: Array, sample_time: float, delay: int) -> Array:
    """Return the matrices from one sample to the next, (..., n, n), or with a delay n + m.

    Without delay x+ = (F + G K) x. With a delay of one sample the state is (x, u):
    x+ = F x + G u, u+ = K x. The rates of the law's own states act without it.
    """
    n, late, K = design.plant.shape[0], late_inputs(design, delay), design.law.gain(alpha)
    F, G = zero_order_hold(*design.plant.at(alpha), sample_time)
    if late < G.shape[-1]:
        F = np.asarray(F + G[..., late:] @ K[..., late:, :])
    if not late:
        return F
    whole = np.zeros((*F.shape[:-2], n + late, n + late))
    whole[..., :n, :n], whole[..., :n, n:], whole[..., n:, :n] = F, G[..., :late], K[..., :late, :]
    return whole


def _domain(plant: UncertainPlant, design: Design) -> Domain:
    """Return where alpha lives: on the box of the parameters where there are any."""
    if plant.parameters:
        return Domain.of("box", len(plant.vertices))
    return Domain(design.certificate.claim().sizes)


def cloud(design: Design, count: int) -> Array:
    """Return vertices, points of the edges and ``count`` random points alpha, (points, N)."""
    domain = _domain(design.plant, design)
    return domain.alpha(np.vstack([edges(domain), inside(domain, count)]))


def _eigenvalues(matrices: Array) -> Array:
    """Return eigenvalues, the largest first."""
    if not np.all(np.isfinite(matrices)):
        raise InputError("the plant outgrows floating point in one sample; take a shorter one")
    z = np.linalg.eigvals(matrices).astype(complex)
    return np.asarray(np.take_along_axis(z, np.argsort(-np.abs(z), axis=-1), axis=-1))


def _equivalent(z: Array, n: int, time: float) -> Array:
    slow = z[..., :n]
    return np.asarray(np.log(np.where(np.abs(slow) < TINY, TINY, slow)) / time)


@dataclass(frozen=True, eq=False)
class SamplingEffect(Short):
    """Poles of the sampled loop against a design's region, over a sample of the family.

    Attributes
    ----------
    sample_time : float
        [s]
    delay : int
        In samples.
    inside : bool
        Whether all equivalent poles lie in the region, at every point looked at.
    stable : bool
        Whether all |z| < 1, likewise.
    distance : float
        The largest distance of an equivalent pole from the region, negative inside [1/s].
    alpha : (N,) array
        Where that is.
    values : dict or None
        The parameters there; None for a plant without any.
    decay : float
        -log|z| / sample_time of the slowest pole of all [1/s].
    points : int
        How many alpha were looked at.
    """

    sample_time: float
    delay: int
    inside: bool
    stable: bool
    distance: float
    alpha: Array
    values: dict[str, float] | None
    decay: float
    points: int


@explained
@stage("poles of the sampled loop")
def sampling_effect(design: Design, sample_time: float, delay: int = 1) -> SamplingEffect:
    """Look where the poles of the sampled loop lie: at vertices, on edges and at random points.

    See `sampled_poles` for the loop, its parameters and errors. A sample proves nothing; for the
    decay rate see `polefence.export.decay.prove_decay`.
    """
    time = require_usable(design, sample_time, delay)
    alphas = cloud(design, POINTS)
    poles = sampled_poles(design, alphas, time, delay)
    distance = design.region.distance(poles.equivalent).max(axis=-1)
    worst = int(np.argmax(distance))
    size = float(np.abs(poles.z).max())
    alpha = alphas[worst].copy()
    alpha.flags.writeable = False
    return SamplingEffect(
        time,
        delay,
        bool(distance[worst] < 0),
        size < 1,
        float(distance[worst]),
        alpha,
        values_at(design.plant, alpha.tolist()),
        -float(np.log(max(size, TINY))) / time,
        len(alphas),
    )


@dataclass(frozen=True)
class LargestSampleTime(Short):
    """Longest sample times, found by trial over a sample of the family.

    Attributes
    ----------
    delay : int
    region : float
        At every sample time tried up to this one the equivalent poles lie in the region; zero where
        they do not even at the shortest [s].
    stable : float
        Likewise, all |z| < 1 [s].
    longest : float
        The longest sample time tried: what equals it may be longer still [s].
    """

    delay: int
    region: float
    stable: float
    longest: float


@explained
@stage("largest sample time")
def largest_sample_time(design: Design, delay: int = 1) -> LargestSampleTime:
    """Return up to which sample time the region, and stability, hold.

    Sample times are tried upwards on a logarithmic grid, at vertices, edges and a few hundred
    random points, until one fails, then by bisection; what is found is tried at as many points as
    `sampling_effect` looks at, and shortened until it holds there. What fails between two sample
    times tried is not seen.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the delay neither 0 nor 1.
    """
    require_continuous(design, delay)
    few, many = cloud(design, 300), cloud(design, POINTS)
    fastest = float(np.abs(design.poles(few)).max())
    unit = 1 / fastest if fastest else 1.0
    decades = np.log10(LONGEST / SHORTEST)
    grid = unit * np.geomspace(SHORTEST, LONGEST, round(16 * decades) + 1)
    region, stable = (
        _largest(partial(test, design, delay), grid, few, many) for test in (_is_inside, _is_stable)
    )
    return LargestSampleTime(delay, region, stable, float(grid[-1]))


def _largest(holds: Test, grid: Array, few: Array, many: Array) -> float:
    fails = next((k for k, time in enumerate(grid) if not holds(time, few)), len(grid))
    if fails == 0:
        return 0.0
    low = float(grid[fails - 1])
    if fails < len(grid):
        high = float(grid[fails])
        low, _ = edge(lambda time: holds(time, few), low, high, 10, geometric=True)  # halvings
    while low >= grid[0] and not holds(low, many):  # more points may fail earlier
        low *= 0.99
    return low if low >= grid[0] else 0.0


def _is_inside(design: Design, delay: int, time: float, alphas: Array) -> bool:
    z = _finite(stepped(design, alphas, time, delay))
    if z is None:
        return False
    return bool(design.region.contains(_equivalent(z, design.plant.shape[0], time)))


def _is_stable(design: Design, delay: int, time: float, alphas: Array) -> bool:
    z = _finite(stepped(design, alphas, time, delay))
    return z is not None and bool(np.abs(z).max() < 1)


def _finite(matrices: Array) -> Array | None:
    return _eigenvalues(matrices) if np.all(np.isfinite(matrices)) else None
