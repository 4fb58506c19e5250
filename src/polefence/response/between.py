"""Between samples, in floats: mean squares of signals while inputs are held.

What they are, and how they are computed, is in `polefence.proof.between`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output as PlantOutput
from polefence.plant.system import Array
from polefence.proof.between import Held
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Output

SMALL, TERMS = 0.25, 14  # of |N| h, and terms of its series: what is left is below 1e-17


@dataclass(frozen=True, eq=False)
class Means:
    """The mean of E z'z over a period is E y'M y + c, where y = (x, u) at its begin.

    Attributes
    ----------
    M : (count, k, k) array
        Of those of (x, u) that z depends on.
    V : (count, n, n) array
        What noise adds to the covariance of x at the next sample, over the period.
    c : (count,) array
    chosen : list of int
        Numbers of these in (x, u).
    moved : (count, n, k) array
        What the period makes of x, less x, over the sample time.
    """

    M: Array
    V: Array
    c: Array
    chosen: list[int]
    moved: Array


def held_of(plant: UncertainPlant, outputs: Sequence[PlantOutput] = ()) -> Held | None:
    """Return what is held between samples; None of a plant that is no samples, or on no box.

    What comes out of a filter is known at samples alone: there is none of such outputs either.
    """
    sampling = plant.sampling
    if sampling is None or not (plant.parameters or len(plant.vertices) == 1):
        return None
    held = sampling.held
    if held is None or not all(held.moves(y.exact(plant)[0]) for y in outputs):
        return None
    return held


def held_evenly(plant: UncertainPlant, outputs: Sequence[PlantOutput] = ()) -> Held | None:
    """Return what is held between samples that come at a perfect clock; else None.

    None too where states that are held take samples of those that move, or of a disturbance: an
    integral of a PID does.
    """
    held = held_of(plant, outputs)
    if held is None or held.clock is not None:
        return None
    first = len(held.A[0])
    for v in plant.vertices:
        if v.A[first:, :first].any() or (v.E is not None and v.E[first:].any()):
            return None
    return held


def means(
    plant: UncertainPlant,
    held: Held,
    outputs: Sequence[Output],
    scales: Sequence[float],
    density: float,
    alpha: Array,
    length: float = 1.0,
) -> Means:
    """Return the means at points of the family, over a period of so many sample times.

    Parameters
    ----------
    plant : UncertainPlant
        The samples.
    outputs : sequence
        Of the samples, in exact rationals.
    density : float
        One-sided, of the noise.
    alpha : (count, N) array
    """
    T = plant.period
    period = held.period(outputs, tuple(map(Fraction, scales)), T, Fraction(density) / 2)
    A, C, E = (_at(alpha, M) for M in (period.A, period.C, period.E))
    units, intensity, chosen = np.array(period.units, float), density / 2, held.chosen_of(outputs)
    part, *others = (
        over_time(A, _at(alpha, B), C, _at(alpha, D), E, time * float(T), intensity, units)
        for time, (_, B, D) in zip(period.times(length), period.phases, strict=True)
    )
    for other in others:
        part = part.then(other)
    moved = (part.F - np.eye(len(units)))[:, : A.shape[-1]] / float(T)
    return Means(part.M, part.V, part.c, chosen, moved)


def _at(alpha: Array, matrices: Sequence[Rationals]) -> Array:
    return np.tensordot(alpha, np.array(matrices, dtype=float), 1)


@dataclass(frozen=True, eq=False)
class Part:
    """What goes on in a time: its exponential, and the means M, V and c over it."""

    time: float
    F: Array
    M: Array
    V: Array
    c: Array

    def then(self, other: Part) -> Part:
        """Return the two, one after the other."""
        n, time = self.V.shape[-1], self.time + other.time
        one, two = self.time / time, other.time / time
        small, up = other.F[:, :n, :n], np.swapaxes(self.F, 1, 2)
        M = one * self.M + two * up @ other.M @ self.F
        V = one * small @ self.V @ np.swapaxes(small, 1, 2) + two * other.V
        driven = np.einsum("pij,pij->p", other.M[:, :n, :n], self.V) * self.time
        return Part(time, other.F @ self.F, M, V, one * self.c + two * (other.c + driven))


def over_time(
    A: Array, B: Array, C: Array, D: Array, E: Array, T: float, intensity: float, units: Array
) -> Part:
    """Return what goes on in a time T: x' = A x + B k + E w with k held, and z = C x + D k."""
    count, n, k = len(A), A.shape[-1], A.shape[-1] + B.shape[-1]
    N = np.zeros((count, k, k))
    N[:, :n] = np.concatenate([A, B], axis=2) * T * units / units[:n, None]
    size = max(np.abs(N).sum(axis=-1).max(), np.abs(N).sum(axis=-2).max())
    j = max(0, int(np.ceil(np.log2(max(size, 1e-300) / SMALL))))
    N = N / 2**j
    rows = np.concatenate([C, D], axis=2) * units
    Q = np.swapaxes(rows, 1, 2) @ rows
    E = E / units[:n, None]
    W = intensity * E @ np.swapaxes(E, 1, 2)
    F = term = np.broadcast_to(np.eye(k), N.shape)
    for i in range(1, TERMS):
        term = term @ N / i
        F = F + term
    M, _ = _integral(np.swapaxes(N, 1, 2), Q)
    V, once_more = _integral(N[:, :n, :n], W)
    c = np.einsum("pij,pij->p", Q[:, :n, :n], once_more) / 2**j
    for i in range(j, 0, -1):
        c = c + np.einsum("pij,pij->p", M[:, :n, :n], V) / 2 ** (i + 1)
        M = (M + np.swapaxes(F, 1, 2) @ M @ F) / 2
        V = (V + F[:, :n, :n] @ V @ np.swapaxes(F[:, :n, :n], 1, 2)) / 2
        F = F @ F
    V = V * units[:n] * units[:n, None]
    return Part(T, F * units[:, None] / units, M / units / units[:, None], V, T * c)


def _integral(N: Array, Q: Array) -> tuple[Array, Array]:
    """Return int_0^1 exp(N s) Q exp(N's) ds, and the same with 1 - s besides, for small N."""
    term = total = Q
    once_more = Q / 2
    for i in range(1, TERMS):
        half = N @ term
        term = (half + np.swapaxes(half, 1, 2)) / (i + 1)
        total, once_more = total + term, once_more + term / (i + 2)
    return total, once_more


def factor(M: Array) -> Array:
    """Return L with L L' = M, of matrices without negative eigenvalues but for rounding."""
    values, V = np.linalg.eigh(M)
    return np.asarray(V * np.sqrt(np.maximum(values, 0.0))[:, None, :])
