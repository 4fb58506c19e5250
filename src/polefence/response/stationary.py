"""Stationary covariances and rms values of a closed loop under white noise; roads as such noise.

With w white of two-sided density S, the covariance X of the state solves the Lyapunov equation
A X + X A' + E S E' = 0 (Kwakernaak & Sivan, Linear Optimal Control Systems, 1972, section 1.11).
Of a plant in discrete time A and E are those of its delta form, the equation is
A X + X A' + T A X A' + E S E' = 0, and noise of that density has a variance of S / T a sample.
Densities here are one-sided, as roads are described: S is half of them. Roads have
the classes of ISO 8608.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, choose, output_matrices, pick
from polefence.plant.system import Array, floats
from polefence.proof.short import Short
from polefence.response.closed import Loops, close, point_text
from polefence.response.discrete import BUFFER, balancing
from polefence.response.weighting import positive

Numbers = npt.NDArray[np.intp]
# A pole counts as stable if it is so by more than this share of the fastest: rounding.
STABLE = 1e-12
# Doublings at most, and the size of a power P^k after which P^2k adds nothing, not even to states
# behind a chain of others, which are small in balanced units.
POWERS, LEFT = 64, 1e-9
# Of the largest entry, what the shift is at least; and doublings after which rounding alone may
# have made a pole at zero stable: that of P = 1 is off by 1e-16 of the entry over the shift.
FLOOR, MANY = 1e-8, 20

# ISO 8608: Gd(n0) [m3] at n0 = 0.1 cycles/m, geometric means of the classes; Gd falls as n^-2.
ROUGHNESS = {letter: 16e-6 * 4**i for i, letter in enumerate("ABCDEFGH")}
REFERENCE = 0.1


@dataclass(frozen=True, eq=False)
class Stationary(Short):
    """Rms of every signal at every point.

    Attributes
    ----------
    plant : UncertainPlant
    alpha : (count, N) array
    signals : tuple of Output
        p of them.
    psd : (q,) array
        One-sided density of each disturbance [its unit squared per Hz].
    rms : (count, p) array
        In the signals' units.
    """

    plant: UncertainPlant
    alpha: Array
    signals: tuple[Output, ...]
    psd: Array
    rms: Array

    def of(self, name: str) -> Array:
        """Return the rms of one signal, (count,)."""
        return np.asarray(self.rms[:, self.signals.index(pick(self.signals, name))])


@explained
def stationary(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    psd: Any,
    signals: Sequence[Output | str] | None = None,
) -> Stationary:
    """Return the rms that white disturbances keep every signal at.

    States on which no asked signal depends, directly or through other states, are dropped first:
    a passive suspension has a stationary deflection, but no stationary integral of it.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
    alpha : (count, N) or (N,) array
    psd : float or (q,) array
        One-sided density of each disturbance, independent of one another [unit squared per Hz];
        of a road's velocity, see `velocity_psd`.
    signals : sequence of Output or str, optional
        Outputs, or names of the plant's signals; all states and inputs by default.

    Raises
    ------
    InputError
        If a loop is not asymptotically stable in the states that are left, a signal has white
        noise in it, a density is negative, or as `close` raises.
    """
    loops = close(plant, law, alpha)
    asked = choose(plant, signals)
    psd = _densities(psd, loops.E.shape[-1])
    C, D = output_matrices(plant, asked, loops.alpha, loops.K, loops.passed)
    white = np.flatnonzero(np.any(D * psd, axis=(0, 2)))
    if len(white):
        raise InputError(
            f"{asked[white[0]].name!r} follows the white disturbance itself: its rms has no bound; "
            "leave it out"
        )
    keep = needed(C, loops.closed)
    A = loops.closed[:, keep][:, :, keep]
    bad = unstable(A, loops.step)
    if len(bad):
        poles = np.linalg.eigvals(A[bad[0]])
        worst = complex(poles[np.argmax(growth(poles, loops.step))])
        _refuse_unstable(loops, int(bad[0]), asked, C, worst)
    X = covariance(A, loops.E[:, keep], psd, loops.step)
    C = C[:, :, keep]
    variance = np.einsum("apn,anm,apm->ap", C, X, C, optimize=True)
    return Stationary(plant, loops.alpha, asked, psd, np.sqrt(np.maximum(variance, 0.0)))


@explained
def velocity_psd(roughness: float, speed: float, reference: float = 0.1) -> float:
    """Return the one-sided white density of a road's vertical velocity [m2/s2 per Hz].

    (2 pi n0)^2 Gd(n0) v of a road with displacement density Gd(n) = Gd(n0) (n / n0)^-2, ISO 8608.

    Parameters
    ----------
    roughness : float
        Gd(n0) [m3]; 256e-6 is class C.
    speed : float
        Of the vehicle, v [m/s].
    reference : float
        n0 [1/m].

    Raises
    ------
    InputError
        If one of them is not above zero.
    """
    turn = 2 * math.pi * positive(reference, "reference [1/m]")
    density = positive(roughness, "roughness Gd(n0) [m3]") * positive(speed, "speed [m/s]")
    return turn * turn * density


def needed(C: Array, closed: Array) -> Numbers:
    """Return the numbers of the states that outputs C (count, p, n) depend on at some point.

    By structure: entries that are zero at every point, no cancellation.
    """
    follows = np.any(closed, axis=0)
    kept = np.any(C, axis=(0, 1))
    for _ in range(len(kept)):
        kept = kept | np.any(follows[kept], axis=0)
    return np.flatnonzero(kept)


def growth(poles: Any, step: float = 0.0) -> Array:
    """Return the growth rates of modes [1/s]: Re p, or (|1 + step p| - 1) / step."""
    return np.asarray((2 * poles.real + step * np.abs(poles) ** 2) / (1 + np.abs(1 + step * poles)))


def unstable(A: Array, step: float = 0.0) -> Numbers:
    """Return the numbers of the matrices (count, n, n) that are not asymptotically stable."""
    if not A.shape[-1]:
        return np.zeros(0, dtype=int)
    poles = np.linalg.eigvals(A)
    return np.flatnonzero(growth(poles, step).max(axis=1) >= -STABLE * np.abs(poles).max(axis=1))


def covariance(A: Array, E: Array, psd: Any, step: float = 0.0) -> Array:
    """Return the stationary covariance of x' = A x + E w, (count, n, n); A must be stable.

    Parameters
    ----------
    A : (count, n, n) array
    E : (count, n, q) array
    psd : float or (q,) array
        One-sided densities of independent white w [unit squared per Hz].
    step : float, optional
        Of a delta form [s].
    """
    return lyapunov(A, E * (np.asarray(psd, dtype=float) / 2) @ np.swapaxes(E, -1, -2), step)


def bilinear(A: Array, step: float) -> tuple[Array, Array]:
    """Return M^-1 A and M^-1 with M = I + step A / 2.

    x' = M^-1 A x + M^-1 E w, y = C M^-1 x + (F - step C M^-1 E / 2) w has the Gramians and the gain
    of the delta form of A, E, C, F.
    """
    inverse = np.linalg.inv(np.eye(A.shape[-1]) + step / 2 * A)
    return np.asarray(inverse @ A), np.asarray(inverse)


def lyapunov(A: Array, Q: Array, step: float = 0.0) -> Array:
    """Return the symmetric X of A X + X A' + step A X A' + Q = 0, (count, n, n), Q symmetric.

    A Cayley transform in balanced coordinates makes it X = P X P' + J Q J', whose sum of
    P^k J Q J' P'^k is doubled (Smith, SIAM J. Appl. Math. 16 (1968) 198). What is left of the
    equation is solved for once more.

    Parameters
    ----------
    A : (count, n, n) array
        Stable: X is NaN where it is not.
    Q : (count, n, n) array
    """
    count, n = A.shape[:2]
    X = np.empty((count, n, n))
    if not X.size:
        return X
    d = balancing(A)
    A, Q = A * (d / d[:, None]), Q / (d * d[:, None])
    group = max(1, BUFFER // (8 * n * n * POWERS))
    for first in range(0, count, group):
        part = slice(first, first + group)
        X[part] = _doubled(A[part], Q[part], step)
    return X * (d * d[:, None])


def _doubled(A: Array, Q: Array, step: float) -> Array:
    """Return X of `lyapunov` for balanced A."""
    n = A.shape[-1]
    # Half of the poles' geometric mean: at it P of equal poles were zero but for what they couple.
    shift = np.exp(np.linalg.slogdet(A)[1] / n)[:, None, None] / 2
    shift = np.maximum(shift, FLOOR * np.abs(A).max(axis=(1, 2), keepdims=True))
    turn, eye = shift * (step / 2), np.eye(n)
    inverse = np.linalg.inv(shift * eye - (1 - turn) * A)
    J = np.sqrt(2 * shift) * inverse

    def summed(Q: Array) -> Array:
        X = J @ Q @ np.swapaxes(J, 1, 2)
        for P in powers:
            X = X + P @ X @ np.swapaxes(P, 1, 2)
        return _symmetric(X) / 2

    with np.errstate(over="ignore", invalid="ignore"):
        P = (2 * shift * inverse - (1 + turn) * eye) / (1 - turn)
        powers = [P]
        doublings = np.zeros(len(A))
        while np.any((left := n * np.abs(P).max(axis=(1, 2))) > LEFT) and len(powers) < POWERS:
            powers.append(P := P @ P)
            doublings += left > LEFT
        X = summed(Q)
        # Without it the covariance of slow modes beside fast ones loses half of its digits.
        half = A @ X
        half = half + step / 2 * half @ np.swapaxes(A, 1, 2)
        X = X + summed(Q + _symmetric(half))
    slow = np.flatnonzero(doublings > MANY)
    X[slow[unstable(A[slow], step)]] = np.nan
    X[~(left <= LEFT)] = np.nan
    return X


def _symmetric(M: Array) -> Array:
    return np.asarray(M + np.swapaxes(M, 1, 2))


def filtered_variance(
    A: Array, X: Array, C: Array, weighting: tuple[Array, Array, Array], step: float = 0.0
) -> Array:
    """Return the variances of signals behind a filter z' = a z + b y, c z: (count, p).

    Each signal's filter is solved for by itself, behind the loop whose covariance is known: of
    many signals that costs little more than of one.

    Parameters
    ----------
    A, X : (count, n, n) array
        The loop and its covariance.
    C : (count, p, n) array
        Of the signals y = C x.
    weighting : a (k, k), b (k, 1), c (1, k)
        Of the filter; in its delta form where the loop is.
    step : float, optional
        Of a delta form [s].
    """
    from scipy.linalg import schur

    a, b, c = weighting
    count, n = X.shape[:2]
    triangle, turn = schur(a, output="complex")
    moves = np.eye(n) + step * A
    variances = np.empty(C.shape[:2])
    for p in range(C.shape[1]):
        y = C[:, p]
        seen = (X @ y[..., None])[..., 0]  # covariance of state and signal
        # M Y (a' with its step) + A Y + M seen b' = 0, column by column of a's Schur form
        driven = (moves @ seen[..., None]) * (b[:, 0] @ turn.conj())
        W = np.zeros((count, n, len(a)), dtype=complex)
        for j in reversed(range(len(a))):
            known = W[..., j + 1 :] @ triangle[j, j + 1 :]
            right = driven[..., j] + (moves @ known[..., None])[..., 0]
            W[..., j] = np.linalg.solve(A + triangle[j, j] * moves, -right[..., None])[..., 0]
        Y = (W @ turn.T).real
        crossed = np.einsum("cn,cnk->ck", y, Y)
        half = b * crossed[:, None, :]
        noise = half + np.swapaxes(half, 1, 2)
        if step:
            straight, both = np.einsum("cn,cn->c", y, seen), half @ a.T
            noise += step * (both + np.swapaxes(both, 1, 2) + straight[:, None, None] * (b @ b.T))
        Z = lyapunov(np.broadcast_to(a, (count, *a.shape)), noise, step)
        variances[:, p] = np.einsum("i,cij,j->c", c[0], Z, c[0])
    return variances


def _densities(psd: Any, q: int) -> Array:
    try:
        densities = np.asarray(psd, dtype=float)
    except (TypeError, ValueError, OverflowError):
        densities = np.full(1, np.nan)
    if (
        densities.shape not in ((), (q,))
        or not np.all(np.isfinite(densities))
        or np.any(densities < 0)
    ):
        raise InputError(f"psd = {psd!r}; give {q} finite densities, zero or more, one each")
    return np.array(np.broadcast_to(densities, q))


def _refuse_unstable(
    loops: Loops, row: int, signals: Sequence[Output], C: Array, pole: complex
) -> None:
    """Raise for the unstable loop of that row; name the signals that depend on its pole."""
    bound = []
    for signal, weights in zip(signals, np.swapaxes(C, 0, 1), strict=True):
        keep = needed(weights[:, None], loops.closed)
        if len(unstable(loops.closed[row, keep][:, keep][None], loops.step)):
            bound.append(repr(signal.name))
    inside, unit = "the left half-plane", " 1/s"
    if loops.step:
        pole, inside, unit = 1 + loops.step * pole, "the unit disk", ""
    at = f"{pole.real:.3g}" if not pole.imag else f"{pole.real:.3g} +- {abs(pole.imag):.3g}j"
    remedy = f"close it with a law that keeps its poles in {inside}"
    if len(bound) < len(signals):
        remedy = f"leave out {', '.join(bound)}, or give a law that stabilises what they depend on"
    where = point_text(loops.plant, loops.alpha[row])
    raise InputError(
        f"{loops.plant.name} has a pole at {at}{unit} at {where}, so nothing there is "
        f"stationary; {remedy}"
    )


@explained
def roughness(road_class: str) -> float:
    """Return Gd(n0) [m3] of a class "A" to "H" of ISO 8608, its geometric mean.

    Raises
    ------
    InputError
        If there is no such class.
    """
    value = ROUGHNESS.get(str(road_class).upper())
    if value is None:
        raise InputError(f"no road class {road_class!r}; {suggest(str(road_class), ROUGHNESS)}")
    return float(value)


@explained
def displacement_density(road_class: str, n: Any) -> Array:
    """Return the one-sided density of height [m3] at spatial frequencies n [cycles/m]."""
    return np.asarray(roughness(road_class) * (floats(n, "n") / REFERENCE) ** -2)


@explained
def velocity_density(road_class: str, speed: float) -> float:
    """Return the one-sided, white density of road velocity at a speed [m2/s2 per Hz].

    That of `velocity_psd` for a class, from Gd(n) = Gd(n0) (n / n0)^-2 at n = f / v.
    Half of it is two-sided, as in the Lyapunov equation A X + X A' + E (density / 2) E' = 0.

    Raises
    ------
    InputError
        If there is no such class, or the speed [m/s] is not above zero.
    """
    return velocity_psd(roughness(road_class), speed, REFERENCE)
