"""Laws to start from: linear-quadratic regulators, with the covariance of their loop as W.

In the coordinates of that covariance limits on rms values are all about as tight, however far apart
the units are: most searches that begin there end in a few steps.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from polefence.lmi.conditions.gain_norm import Norm
from polefence.lmi.conditions.performance import Output
from polefence.lmi.solve.covariance import intensity
from polefence.lmi.solve.performance import Question
from polefence.lmi.solve.scaling import Scaling
from polefence.plant.system import Array
from polefence.region.regions import HalfPlane, Region

POWERS, HALVINGS = (-40.0, 40.0), 8  # of two: weights of what is minimised
CHEAP = 1e-7  # of the weights of inputs or states that nothing else weighs
SHIFTS = (0.55, 0.75, 1.0, 1.5)  # of the region's decay; a regulator mirrors slower poles there
SHAKEN = 1e-3  # of the inputs' own variance, as noise through them: W is not singular


def regulators(
    question: Question, scaling: Scaling, halvings: int = HALVINGS
) -> Iterator[dict[str, Array]]:
    """Yield W and Z of regulators of the plant in the middle, in the original coordinates.

    First one that weighs the limits alike, and what is minimised as much as they allow, found in so
    many halvings; where the region asks for decay, or the law is to be small, ones that reach it
    with little effort.
    """
    A, B = (X.mean(axis=0) for X in scaling.apply(question.A, question.B))
    inverse = np.asarray(np.linalg.inv(scaling.T), dtype=float)
    moved = {s.name: inverse @ intensity(s, question.domain) @ inverse.T for s in question.sources}
    decay = decay_of(question.region) / scaling.rate
    gains = [_balanced(question.outputs, scaling, (A, B), moved, halvings)]
    if decay > 0 or question.norms:
        gains += [_small(question.norms, scaling, A, B, shift * decay) for shift in SHIFTS]
    M = sum((own / (np.trace(own) or 1.0) for own in moved.values()), np.zeros_like(A))
    M = M if moved else np.eye(len(A))
    for K in gains:
        W = None if K is None else _covariance(A, B, K, M, decay)
        if K is not None and W is not None:
            Z = scaling.S @ K @ W @ scaling.T.T
            W = scaling.T @ W @ scaling.T.T
            yield {"W1": (W + W.T) / 2, "Z1": Z}


def decay_of(region: Region | None) -> float:
    """Return the decay rate that a region asks for by itself."""
    parts = () if region is None else region.parts
    return max((part.decay for part in parts if isinstance(part, HalfPlane)), default=0.0)


def _balanced(
    outputs: Sequence[Output],
    scaling: Scaling,
    plant: tuple[Array, Array],
    moved: dict[str, Array],
    halvings: int,
) -> Array | None:
    """Return the gain that weighs what is minimised as much as the limits allow."""
    if not outputs:
        return None
    A, B = plant
    rows = [
        np.hstack([o.C.mean(axis=0) @ scaling.T, o.D.mean(axis=0) @ scaling.S]) / o.level
        for o in outputs
    ]
    fixed = np.array([o.fixed for o in outputs])
    if fixed.all() or not fixed.any():
        sizes = [np.sum(row**2) or 1.0 for row in rows]
        return _regulator(A, B, _weighted(rows, 1 / np.array(sizes)))
    least, most = POWERS
    best: Array | None = None
    for _ in range(halvings):
        power = (least + most) / 2
        weights = np.where(fixed, 1.0, 2.0**power)
        K = _regulator(A, B, _weighted(rows, weights))
        if K is not None and _kept(outputs, rows, A + B @ K, K, moved):
            least, best = power, K
        else:
            best = K if best is None else best
            most = power
    return best


def _weighted(rows: list[Array], weights: Array) -> Array:
    Y = np.vstack(rows)
    return np.asarray((Y.T * weights) @ Y)


def _kept(
    outputs: Sequence[Output], rows: list[Array], loop: Array, K: Array, moved: dict[str, Array]
) -> bool:
    """Whether all fixed bounds are kept, as far as covariances tell."""
    covariance = {name: _lyapunov(loop, M) for name, M in moved.items()}
    for output, row in zip(outputs, rows, strict=True):
        y, X = row[:, : len(loop)] + row[:, len(loop) :] @ K, covariance[output.source]
        if output.fixed and (X is None or (y @ X @ y.T).item() > 1):
            return False
    return True


def _small(
    norms: Sequence[Norm], scaling: Scaling, A: Array, B: Array, shift: float
) -> Array | None:
    """Return a gain of little effort that mirrors what decays more slowly at that decay."""
    n, m = B.shape
    R = sum(((norm.R @ scaling.S).T @ (norm.R @ scaling.S) for norm in norms), np.zeros((m, m)))
    whole = np.zeros((n + m, n + m))
    whole[n:, n:] = R / np.trace(R) if np.trace(R) > 0 else np.eye(m)
    return _regulator(A + shift * np.eye(n), B, whole)


def _regulator(A: Array, B: Array, weights: Array) -> Array | None:
    """Return the gain of least cost [x; u]' weights [x; u]; None if there is none in floats."""
    from scipy.linalg import solve_continuous_are  # deferred: slow to import

    n, m = B.shape
    Q, R, S = weights[:n, :n], weights[n:, n:], weights[:n, n:]
    size = CHEAP * np.trace(weights) / (n + m)
    Q = Q + size * np.eye(n)
    R = R + size * np.eye(m)
    try:
        with np.errstate(all="ignore"):
            P = solve_continuous_are(A, B, Q, R, s=S)
            K = -np.linalg.solve(R, B.T @ P + S.T)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(K) if np.all(np.isfinite(K)) else None


def _covariance(A: Array, B: Array, K: Array, M: Array, decay: float) -> Array | None:
    """Return the covariance of the loop with less decay, what of it the region leaves over."""
    loop = A + B @ K
    own = -float(np.linalg.eigvals(loop).real.max())
    plain = _lyapunov(loop, M)
    if not own > decay or plain is None:
        return None
    inputs = np.diag(K @ plain @ K.T)
    inputs = np.maximum(inputs, inputs.max() * CHEAP) + np.finfo(float).tiny
    more = SHAKEN * float(np.abs(np.linalg.eigvals(loop)).mean())
    shifted = loop + (own + decay) / 2 * np.eye(len(A))
    return _lyapunov(shifted, M + more * (B * inputs) @ B.T)


def _lyapunov(loop: Array, M: Array) -> Array | None:
    """Return X of loop X + X loop' + M = 0; None where the loop is not stable."""
    from scipy.linalg import solve_continuous_lyapunov  # deferred: slow to import

    if not np.linalg.eigvals(loop).real.max() < 0:
        return None
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is nearly singular; it is judged by use
            X = solve_continuous_lyapunov(loop, -M)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray((X + X.T) / 2) if np.all(np.isfinite(X)) else None
