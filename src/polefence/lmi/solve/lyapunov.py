"""Lyapunov polynomials of a given loop: the least r at which one is found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.lyapunov import Loop, lyapunov
from polefence.lmi.conditions.target import Goal
from polefence.lmi.solve.engine import run
from polefence.lmi.solve.radius import first_radius
from polefence.lmi.solve.scaling import power_of_two
from polefence.lmi.solve.smallest import TOLERANCE
from polefence.lmi.solve.stacked import stack
from polefence.plant.system import Array

FLOOR = 1e-4
ROUNDS = 3
DOUBLINGS = 12
WIDE = 1.3
LEAST, WORST = 1e-6, 1e8


@dataclass(frozen=True, eq=False)
class Proof:
    """A Lyapunov polynomial's Bernstein coefficients, original coordinates.

    Attributes
    ----------
    r : float
        At which it holds, in floats.
    Q : (count, n, n) array
    multiple : (count,) array, optional
        For scheduled laws, see `polefence.lmi.conditions.lyapunov`.
    """

    r: float
    Q: Array
    multiple: Array | None = None


def least(
    loop: Loop,
    goal: Goal,
    degree: int,
    elevation: int,
    enough: float = 0.0,
    tolerance: float = TOLERANCE,
    near: Proof | None = None,
) -> Proof:
    """Find the least r at which the loop has a Lyapunov polynomial of this degree.

    Parameters
    ----------
    near : Proof, optional
        Of this degree and another goal, to start from.

    Raises
    ------
    SolverError
        If there is no point to start from: the loop's mean is not inside at any r.
    """
    middle = _middle(loop)
    size = max(float(np.abs(np.linalg.eigvals(middle)).max()), goal.scale, 1e-100)
    rate = float(power_of_two(np.array(size)))
    X = start_matrix(middle / rate) if loop.R is None else sum_of(loop.R)
    if near is not None and loop.R is None:
        X = near.Q.mean(axis=0)
    found: Proof | None = None
    for _ in range(ROUNDS):
        try:
            begin = found or near
            again = _run(loop, goal, (degree, elevation), rate, X, begin, enough, tolerance)
        except np.linalg.LinAlgError:
            again = None
        if again is None or (found is not None and again[0].r >= found.r * (1 - 1e-6)):
            break
        found, converged = again
        if converged or found.r <= enough or loop.R is not None:
            break
        X = found.Q.mean(axis=0)
    if found is None:
        raise SolverError("no Lyapunov matrix to start from")
    return found


def _run(
    loop: Loop,
    goal: Goal,
    form: tuple[int, int],
    rate: float,
    X: Array,
    near: Proof | None,
    enough: float,
    tolerance: float,
) -> tuple[Proof, bool] | None:
    T = factor(X)
    unit = rate if goal.rated else 1.0
    pencil = lyapunov(loop.changed(T, rate), goal.target(rate), *form)
    stacked = stack(pencil)
    count = loop.domain.count(form[0])
    n = len(T)
    for Q, s in _starts(loop, T, near, n):
        values = {f"Q{k + 1}": Q[k % len(Q)] for k in range(count)}
        values |= {f"s{k + 1}": s[k % len(s)].reshape(1, 1) for k in range(count)}
        x = pencil.pack(values)
        r = WIDE * first_radius(stacked, x)
        if not np.isfinite(r):
            continue
        outcome = run(
            stacked, x, r, max(enough, FLOOR * (goal.scale if goal.rated else 1)) / unit, tolerance
        )
        if not (np.isfinite(outcome.r) and np.all(np.isfinite(outcome.x))):
            continue
        found = pencil.unpack(outcome.x)
        back = np.stack([loop.restored(found[f"Q{k + 1}"], T) for k in range(count)])
        multiple = (
            None if loop.R is None else np.array([found[f"s{k + 1}"].item() for k in range(count)])
        )
        return Proof(unit * outcome.r, back, multiple), outcome.converged
    return None


def _starts(loop: Loop, T: Array, near: Proof | None, n: int) -> list[tuple[Array, Array]]:
    """Return starting points Q, multiple: the last one; a scheduled law's own W; the identity."""
    zero, one, eye = np.zeros(1), np.ones(1), np.eye(n)[None]
    starts = [(eye, zero)] if loop.R is None else [(1e-6 * eye, one), (eye, zero)]
    if near is None:
        return starts
    inverse = np.linalg.inv(T) if loop.R is None else T.T
    again = inverse @ near.Q @ inverse.T
    return [(again, zero if near.multiple is None else near.multiple), *starts]


def _middle(loop: Loop) -> Array:
    """Return the closed loop at the middle of the domain."""
    E, C = sum_of(loop.E), sum_of(loop.C)
    return np.asarray(np.linalg.solve(E.T, C.T).T)


def sum_of(P: dict[tuple[int, ...], Array]) -> Array:
    """Return a homogeneous polynomial's value at the middle, times a power of the sizes."""
    return np.asarray(sum(P.values()))


def start_matrix(F: Array) -> Array:
    """Return the Gramian of a loop on a disk about its own modes, as coordinates to begin in.

    Where the modes are close to one multiple mode, on a wider disk: the Gramian must be a usable
    change of coordinates.
    """
    n = len(F)
    F = F - float(np.real(np.linalg.eigvals(F)).mean()) * np.eye(n)
    radius = max(1.2 * float(np.abs(np.linalg.eigvals(F)).max()), LEAST)
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
        for _ in range(DOUBLINGS):
            W = W + F @ W @ F.T
            F = F @ F
        W = (W + W.T) / 2
        even = W / np.sqrt(np.outer(np.diag(W), np.diag(W)))
    usable = np.all(np.isfinite(even)) and np.linalg.cond(even) < WORST
    return W if usable else None


def factor(X: Array) -> Array:
    """Return T with T T' = X, X equilibrated by powers of two first."""
    scale = power_of_two(1 / np.sqrt(np.maximum(np.diag(X), np.finfo(float).tiny)))
    factor = np.linalg.cholesky(X * np.outer(scale, scale))
    return np.asarray(factor / scale[:, None])
