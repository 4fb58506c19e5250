"""Laws and Lyapunov matrices to start from, without any LMI: regulators, covariances, Gramians.

A Riccati gain of the mean plant meets all three conditions on disks at some radius, which brackets
the smallest one from above. For signals, in the coordinates of a regulator's covariance limits on
rms values are all about as tight, however far apart the units are: most searches that begin there
end in a few steps.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from polefence.lmi.conditions.gain_norm import Norm
from polefence.lmi.conditions.performance import Output
from polefence.lmi.solve.performance import Problem
from polefence.lmi.solve.scaling import Scaling
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.response.stationary import bilinear, growth

CHEAP = 1e-7  # of the weights of inputs or states that nothing else weighs


@dataclass(frozen=True, eq=False)
class Start:
    """Lyapunov matrix and gain (original coordinates) that hold at ``radius`` on all vertices."""

    W: Array
    K: Array
    radius: float


def nominal_start(
    A: Array, B: Array, sigma: float, scaling: Scaling, size: float | None = None
) -> Start:
    """Return a nominal design and the radius at which it holds on all vertices.

    It aims at radii of about ``size``, by default sigma.
    """
    As, Bs = scaling.apply(A, B)
    S = As + sigma / scaling.rate * np.eye(As.shape[-1])
    aim = (sigma if size is None else size) / scaling.rate
    start = _designed(S, Bs, S.mean(axis=0) / aim, Bs.mean(axis=0) / aim)
    T = scaling.T
    K = np.asarray(scaling.S @ start.K @ scaling.inverse)
    return Start(T @ start.W @ T.T, K, scaling.rate * start.radius)


def _designed(S: Array, B: Array, F: Array, H: Array) -> Start:
    """Return the first design that holds at some radius for S = A + s I."""
    # disks to aim at, as fractions of sigma, and weights of the input, until one has a design
    for fraction, weight in ((0.9, 1.0), (1.0, 1.0), (0.9, 1e-4)):
        with suppress(np.linalg.LinAlgError):
            W, K = _riccati(F / fraction, H / fraction, weight)
            radius = _reach(S, B, W, K)
            if np.isfinite(radius):
                return Start(W, K, radius)
    # Without control W = I holds at some radius: a start that never fails.
    W, K = np.eye(len(F)), np.zeros(H.T.shape)
    return Start(W, K, _reach(S, B, W, K))


def _riccati(F: Array, H: Array, weight: float) -> tuple[Array, Array]:
    """Inverse of the Riccati matrix, in which the closed loop contracts, and the LQR gain.

    By structure-preserving doubling (Chu, Fan, Lin & Wang, 2004): seven doublings are 128 steps.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is none in floats; some matrices that are not finite are returned.
    """
    n, m = H.shape
    E, G, X = F, H @ H.T / weight, np.eye(n)
    with np.errstate(all="ignore"):  # overflow shows in the results
        for _ in range(7):
            left = np.linalg.solve(np.eye(n) + G @ X, np.hstack([E, G]))
            X = X + E.T @ X @ left[:, :n]
            E, G = E @ left[:, :n], G + E @ left[:, n:] @ E.T
        HX = H.T @ X
        K = -np.linalg.solve(weight * np.eye(m) + HX @ H, HX @ F)
        W = np.linalg.inv((X + X.T) / 2)
    return np.asarray((W + W.T) / 2), np.asarray(K)


def _reach(S: Array, B: Array, W: Array, K: Array) -> float:
    """Least radius at which W, K hold at every vertex: the largest |T^-1 (S + B K) T|."""
    T = np.linalg.cholesky(W)
    with np.errstate(all="ignore"):
        closed = np.linalg.solve(T, (S + B @ K) @ T)
    if not np.isfinite(closed).all():
        return np.inf
    return float(np.linalg.svd(closed, compute_uv=False).max())


def regulators(problem: Problem, scaling: Scaling) -> Iterator[dict[str, Array]]:
    """Yield W and Z of regulators of the plant in the middle, in the original coordinates.

    First one that weighs the limits alike, and what is minimised as much as they allow, found by
    halving; where the region asks for decay, or the law is to be small, ones that reach it
    with little effort.
    """
    A, B = (X.mean(axis=0) for X in scaling.apply(problem.A, problem.B))
    inverse = scaling.inverse
    moved = {s.name: inverse @ s.intensity(problem.domain) @ inverse.T for s in problem.sources}
    decay, step = decay_of(problem.region) / scaling.rate, problem.step * scaling.rate
    gains = [_balanced(problem.outputs, scaling, (A, B, step), moved)]
    if decay > 0 or problem.norms:
        # shares of the region's decay: a regulator mirrors slower poles there
        gains += [
            _small(problem.norms, scaling, A, B, step, shift * decay)
            for shift in (0.55, 0.75, 1.0, 1.5)
        ]
    M = sum((matrix / (np.trace(matrix) or 1.0) for matrix in moved.values()), np.zeros_like(A))
    M = M if moved else np.eye(len(A))
    for K in gains:
        W = None if K is None else _covariance(A, B, K, M, decay, step)
        if K is not None and W is not None:
            Z = scaling.S @ K @ W @ scaling.T.T
            W = scaling.T @ W @ scaling.T.T
            yield {"W1": (W + W.T) / 2, "Z1": Z}


def decay_of(region: Region | None) -> float:
    """Return the decay rate that a region asks for by itself."""
    return 0.0 if region is None else region.decay_rate()


def _balanced(
    outputs: Sequence[Output],
    scaling: Scaling,
    plant: tuple[Array, Array, float],
    moved: dict[str, Array],
) -> Array | None:
    """Return the gain with the largest weight on the minimised output that keeps the limits.

    ``plant`` holds A, B and the step.
    """
    if not outputs:
        return None
    A, B, step = plant
    rows = [
        np.hstack([o.C.mean(axis=0) @ scaling.T, o.D.mean(axis=0) @ scaling.S]) / o.level
        for o in outputs
    ]
    fixed = np.array([o.fixed for o in outputs])
    if fixed.all() or not fixed.any():
        sizes = [np.sum(row**2) or 1.0 for row in rows]
        return _regulator(A, B, _weighted(rows, 1 / np.array(sizes)), step)
    least, most = (-40.0, 40.0)
    best: Array | None = None
    for _ in range(8):
        power = (least + most) / 2
        weights = np.where(fixed, 1.0, 2.0**power)
        K = _regulator(A, B, _weighted(rows, weights), step)
        if K is not None and _bounds_kept(outputs, rows, A + B @ K, K, moved, step):
            least, best = power, K
        else:
            best = K if best is None else best
            most = power
    return best


def _weighted(rows: list[Array], weights: Array) -> Array:
    Y = np.vstack(rows)
    return np.asarray((Y.T * np.repeat(weights, list(map(len, rows)))) @ Y)


def _bounds_kept(
    outputs: Sequence[Output],
    rows: list[Array],
    loop: Array,
    K: Array,
    moved: dict[str, Array],
    step: float,
) -> bool:
    """Whether all fixed bounds are kept, as far as covariances tell."""
    covariance = {name: _lyapunov(loop, M, step) for name, M in moved.items()}
    for output, row in zip(outputs, rows, strict=True):
        y, X = row[:, : len(loop)] + row[:, len(loop) :] @ K, covariance[output.source]
        if output.fixed and (X is None or np.trace(y @ X @ y.T) > 1):
            return False
    return True


def _small(
    norms: Sequence[Norm], scaling: Scaling, A: Array, B: Array, step: float, shift: float
) -> Array | None:
    """Return a gain of little effort that mirrors slow modes at that decay rate."""
    n, m = B.shape
    R = sum(((norm.R @ scaling.S).T @ (norm.R @ scaling.S) for norm in norms), np.zeros((m, m)))
    whole = np.zeros((n + m, n + m))
    whole[n:, n:] = R / np.trace(R) if np.trace(R) > 0 else np.eye(m)
    return _regulator(A + shift * np.eye(n), B, whole, step)


def _regulator(A: Array, B: Array, weights: Array, step: float) -> Array | None:
    """Return the gain of least cost [x; u]' weights [x; u]; None if there is none in floats."""
    n, m = B.shape
    Q, R, S = weights[:n, :n], weights[n:, n:], weights[:n, n:]
    size = CHEAP * np.trace(weights) / (n + m)
    Q = Q + size * np.eye(n)
    R = R + size * np.eye(m)
    return least_cost(A, B, Q, R, S, step)


def least_cost(
    A: Array, B: Array, Q: Array, R: Array, S: Array | None = None, step: float = 0.0
) -> Array | None:
    """Return the gain of least cost of x' Q x + 2 x' S u + u' R u; None where floats find none.

    Parameters
    ----------
    step : float
        Of a delta form; zero in continuous time.
    """
    from scipy.linalg import solve_continuous_are, solve_discrete_are  # deferred: slow to import

    left = np.zeros(B.shape) if S is None else S
    try:
        with np.errstate(all="ignore"):
            if step:
                F, H = np.eye(len(A)) + step * A, step * B
                P = solve_discrete_are(F, H, step * Q, step * R, s=step * left)
                K = -np.linalg.solve(step * R + H.T @ P @ H, H.T @ P @ F + step * left.T)
            else:
                P = solve_continuous_are(A, B, Q, R, s=S)
                K = -np.linalg.solve(R, B.T @ P + left.T)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(K) if np.all(np.isfinite(K)) else None


def _covariance(A: Array, B: Array, K: Array, M: Array, decay: float, step: float) -> Array | None:
    """Return the covariance of the loop with its decay reduced by the region's."""
    loop = A + B @ K
    rate = -float(growth(np.linalg.eigvals(loop), step).max())
    plain = _lyapunov(loop, M, step)
    if not rate > decay or plain is None:
        return None
    inputs = np.diag(K @ plain @ K.T)
    inputs = np.maximum(inputs, inputs.max() * CHEAP) + np.finfo(float).tiny
    more = 1e-3 * float(np.abs(np.linalg.eigvals(loop)).mean())  # of the inputs' own variance
    if step:  # |z| to its root
        stretch = 1 / np.sqrt(1 - step * rate)
        shifted = stretch * loop + (stretch - 1) / step * np.eye(len(A))
    else:
        shifted = loop + (rate + decay) / 2 * np.eye(len(A))
    return _lyapunov(shifted, M + more * (B * inputs) @ B.T, step)


def _lyapunov(loop: Array, M: Array, step: float) -> Array | None:
    """Return X of loop X + X loop' + step loop X loop' + M = 0; None if the loop is not stable."""
    from scipy.linalg import solve_continuous_lyapunov  # deferred: slow to import

    if not growth(np.linalg.eigvals(loop), step).max() < 0:
        return None
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is nearly singular; it is judged by use
            if step:
                loop, inverse = bilinear(loop, step)
                M = inverse @ M @ inverse.T
            X = solve_continuous_lyapunov(loop, -M)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray((X + X.T) / 2) if np.all(np.isfinite(X)) else None


def covariance(F: Array, Q: Array | None = None, step: float = 0.0) -> Array | None:
    """Return the covariance that noise leaves x' = F x in; None if there is none in floats.

    Parameters
    ----------
    F : (n, n) array
    Q : (n, n) array, optional
        Intensity of the noise; by default the identity in balanced states.
    step : float
        Of a delta form.
    """
    from scipy.linalg import matrix_balance  # deferred: slow to import

    n = len(F)
    balanced, (scale, _) = matrix_balance(F, permute=False, separate=True)
    intensity = np.asarray(np.eye(n) if Q is None else Q / np.outer(scale, scale), dtype=float)
    # so that no covariance is singular
    intensity = intensity + 1e-6 * np.trace(intensity) / n * np.eye(n)
    X = _lyapunov(np.asarray(balanced, dtype=float), intensity, step)
    return None if X is None else X * np.outer(scale, scale)


def start_matrix(F: Array) -> Array:
    """Return the Gramian of a loop on a disk about its own modes, as coordinates to begin in.

    Where the modes are close to one multiple mode, on a wider disk: the Gramian must be a usable
    change of coordinates.
    """
    n = len(F)
    F = F - float(np.real(np.linalg.eigvals(F)).mean()) * np.eye(n)
    radius = max(1.2 * float(np.abs(np.linalg.eigvals(F)).max()), 1e-6)
    # as wide as its modes, doubled until its Gramian is good coordinates
    while radius < float(np.abs(F).sum()):
        W = _gramian(F / radius)
        if W is not None:
            return W
        radius *= 2
    return np.eye(n)


def _gramian(F: Array) -> Array | None:
    """Return the sum of F^k F'^k, None where it is too ill-conditioned."""
    W = np.eye(len(F))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(12):
            W = W + F @ W @ F.T
            F = F @ F
        W = (W + W.T) / 2
        even = W / np.sqrt(np.outer(np.diag(W), np.diag(W)))
    usable = np.all(np.isfinite(even)) and np.linalg.cond(even) < 1e8
    return W if usable else None
