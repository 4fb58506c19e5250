"""Starts of a search: linear-quadratic regulators of the middle, and sizes that they imply."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from polefence.lmi.solve.starts import least_cost
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.requirements.specification import Specification
from polefence.response.discrete import balancing
from polefence.response.modes import Modes
from polefence.response.stationary import growth

# What inputs cost beside states. With the first alone, of 23 laws of random plants and shown ones
# one is 0.4 % worse and one 0.05 %; one is 0.2 % better.
EFFORTS = (1.0, 1e-3, 1e3)
FASTER = 1.2  # than the region asks for
FLOOR = 1e-3  # of a size, beside the largest in balanced units
FLOOR_NOISE = 1e-2  # on every state, beside the plant's own noise


@dataclass(frozen=True, eq=False)
class Sizes:
    """Typical sizes, and the rate at which they change.

    Attributes
    ----------
    states, inputs : (n,), (m,) arrays
    covariance : (n, n) array
        Of states in these sizes.
    rate : float
        [1/s]
    """

    states: Array
    inputs: Array
    covariance: Array
    rate: float


def middle(plant: UncertainPlant) -> tuple[Array, Array, Array]:
    """Return A, B and E in the middle of the family; E has no columns where there is none."""
    N, n = len(plant.vertices), plant.shape[0]
    A, B = plant.at(np.full(N, 1 / N))
    E = [v.E for v in plant.vertices if v.E is not None]
    return A, B, np.mean(E, axis=0) if E else np.zeros((n, 0))


def typical(plant: UncertainPlant, measured: Array) -> Sizes:
    """Return sizes of states and inputs under a plain regulator, moved by the plant's own noise.

    Parameters
    ----------
    measured : (r, n) array
        Rows of what is measured.
    """
    A, B, E = middle(plant)
    n, m = B.shape
    d = _even(A, B, measured)
    A, B, E = A / d[:, None] * d, B / d[:, None], E / d[:, None]
    moved = A.any(axis=0) | A.any(axis=1) | ~A.any()  # a law's own states have no rate yet
    block = A[moved][:, moved]
    poles = np.abs(np.linalg.eigvals(block))
    if poles.max(initial=0.0) < 1e-6 * np.abs(block).max(initial=0.0):  # integrators alone
        poles = np.array([np.abs(block).max()])
    rate = float(np.exp(np.log(np.maximum(poles, 1e-3 * max(poles.max(), 1e-30))).mean()))
    rate = rate if rate > 1e-20 else 1.0
    pushes = np.linalg.norm(B, axis=0)
    u = rate / np.where(pushes > 0, pushes, rate)
    noise = E @ E.T
    noise = noise / (np.trace(noise) or 1.0) * n + FLOOR_NOISE * np.eye(n)
    K, step = None, float(plant.step) * rate
    if plant.sample_time is None:
        K = regulator(A / rate, B * u / rate, np.eye(n), np.eye(m), step=step)
    X, sizes = np.eye(n), u
    if K is not None:
        X = Modes((A / rate + B * u / rate @ K)[None], step).lyapunov(noise[None])[0]
        forces = np.sqrt(np.maximum(np.diag(K @ X @ K.T), 0.0))
        sizes = u * np.maximum(forces, FLOOR * max(float(forces.max()), FLOOR))
    deviations = np.sqrt(np.maximum(np.diag(X), FLOOR**2 * np.diag(X).max()))
    return Sizes(deviations * d, sizes, X / np.outer(deviations, deviations), rate)


def _even(A: Array, B: Array, C: Array) -> Array:
    """Return units of states in which they move one another, and signals and inputs, evenly."""
    n, m, r = len(A), B.shape[1], len(C)
    whole = np.zeros((n + m + r, n + m + r))
    whole[:n, :n], whole[:n, n : n + m], whole[n + m :, :n] = A, B, C
    rates = np.abs(np.diag(A))
    alone = np.abs(whole[:n]).sum(axis=1) == rates
    whole[:n][alone, n : n + m] = rates[alone, None]  # of a size that inputs would give it
    whole[n : n + m, n + m :] = 1.0
    return balancing(whole[None])[:n]


def regulator(
    A: Array, B: Array, Q: Array, R: Array, S: Array | None = None, step: float = 0.0
) -> Array | None:
    """Return the gain of least cost that `least_cost` has, None where its loop is not stable."""
    K = least_cost(A, B, Q, R, S, step)
    if K is None or not growth(np.linalg.eigvals(A + B @ K), step).max() < 0:
        return None
    return K


def _of_disk(A: Array, B: Array, effort: float) -> Array | None:
    """Return the gain of least cost of a sampled system: its poles are in the unit disk."""
    from scipy.linalg import solve_discrete_are  # deferred: slow to import

    n, m = B.shape
    try:
        with np.errstate(all="ignore"):
            P = solve_discrete_are(A, B, np.eye(n), effort * np.eye(m))
            K = -np.linalg.solve(effort * np.eye(m) + B.T @ P @ B, B.T @ P @ A)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(K) if np.all(np.isfinite(K)) else None


def regulators(
    plant: UncertainPlant, sizes: Sizes, region: Region, asked: Sequence[Specification]
) -> Iterator[Array]:
    """Yield gains of states in their sizes, of plants in the middle: for starts.

    Parameters
    ----------
    asked : sequence of Specification
        Their signals have a cost, with limits as what is equally bad.
    """
    A, B, _ = middle(plant)
    d, u = sizes.states, sizes.inputs
    n = len(A)
    A, B = A / d[:, None] * d, B / d[:, None] * u
    for part in region.parts:
        if part.circle is not None:
            centre, radius = part.circle
            turned = A - centre * np.eye(n)
            gains = (_of_disk(turned / radius, B / radius, e) for e in EFFORTS)
            yield from (K * u[:, None] for K in gains if K is not None)
    if plant.sample_time is not None:
        return
    cost = cost_of(plant, sizes, asked)
    for shift in dict.fromkeys((0.0, FASTER * decay_of(region, plant))):
        for effort in EFFORTS:
            K = shifted(A, B, cost, shift, effort, sizes.rate, float(plant.step))
            if K is not None:
                yield K * u[:, None]


def decay_of(region: Region, plant: UncertainPlant) -> float:
    """Return the decay rate that a region asks for; in a delta form those have disks."""
    return max(region.decay_rate(float(plant.step)), 0.0)


def shifted(
    A: Array, B: Array, cost: Array, shift: float, effort: float, rate: float, step: float = 0.0
) -> Array | None:
    """Return the gain of least cost of loops that decay faster than a shift; None where none does.

    Parameters
    ----------
    cost : (n + m, n + m) array
        Of states and inputs; a thousandth of one is added, for inputs as much more as effort says.
    rate : float
        Typical of A [1/s].
    step : float
        Of a delta form [s].
    """
    n, m = B.shape
    R = cost[n:, n:] + 1e-3 * effort * np.eye(m)
    Q = cost[:n, :n] + 1e-3 * np.eye(n)
    A = (A + shift * np.eye(n)) / rate
    return regulator(A, B / rate, Q, R, cost[:n, n:], step * rate)


def cost_of(plant: UncertainPlant, sizes: Sizes, asked: Sequence[Specification]) -> Array:
    """Return weights of states and inputs, in their sizes: of the signals that are asked for.

    One at its limit counts as one; where not all have a limit, one of its typical size.
    """
    n, m = plant.shape
    N = len(plant.vertices)
    cost = np.zeros((n + m, n + m))
    limited = all(specification.at_most for specification in asked)
    for specification in asked:
        channel = specification.unweighted().channel(plant, np.full((1, N), 1 / N))
        if not specification.of_signal:
            continue
        rows = np.hstack([channel.C[0] * sizes.states, channel.D[0] * sizes.inputs])
        spread = rows[:, :n] @ sizes.covariance @ rows[:, :n].T + rows[:, n:] @ rows[:, n:].T
        size = (
            specification.at_most**2
            if limited and specification.at_most
            else float(np.trace(spread)) or 1.0
        )
        cost += rows.T @ rows / size
    return cost if asked else np.eye(n + m)
