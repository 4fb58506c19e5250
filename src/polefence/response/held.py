"""Plants whose inputs are held between samples, in floats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Legendre

from polefence.plant.boxes import Box
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.between import Held
from polefence.proof.plant import Output
from polefence.response.between import factor, over_time

# Polynomials of which a disturbance is made up in each phase of a period. A spring's gain is off by
# 2e-7 with 2 and by less with 3 at 20 ms; by 4e-2, 1e-5, 1e-5 and nothing with 1 to 4 at 100 ms.
POLYNOMIALS = 4


@dataclass(frozen=True, eq=False)
class Storing:
    """A plant with held inputs at the corners of its box: y' = N y + E w, z = Y y + F w.

    Attributes
    ----------
    N, E, Y, F : (phases, corners, ., .) arrays
        Of [x; u] at a sample. In a phase the same inputs act.
    ends : tuple of float
        Shares of the period at which phases end.
    first : int
        How many of the states move between samples.
    """

    N: Array
    E: Array
    Y: Array
    F: Array
    ends: tuple[float, ...]
    first: int

    def inside(self, box: Box, domain: Domain) -> Storing:
        """Return it at the corners of a part of the box."""
        alpha = box.alpha(domain, domain.nodes(1))
        N, E, Y, F = (
            np.einsum("vc,kcij->kvij", alpha, M) for M in (self.N, self.E, self.Y, self.F)
        )
        return replace(self, N=N, E=E, Y=Y, F=F)

    def at(self, alpha: Array) -> tuple[Array, Array, Array, Array]:
        """Return N, E, Y and F of all phases at points, (phases, count, ., .)."""
        N, E, Y, F = (
            np.einsum("pc,kcij->kpij", alpha, M) for M in (self.N, self.E, self.Y, self.F)
        )
        return N, E, Y, F

    def lifted(self, alpha: Array, period: float) -> tuple[Array, Array, Array]:
        """Return E, [C, D] and F of samples whose disturbances are polynomials in each phase.

        E w is what they make of the states in a period, over the period. Gains from w to C x + D u
        + F w are at most those at all times, and nearly these.
        """
        loops, count, k = self.at(alpha), len(alpha), self.N.shape[-1]
        shares, q = np.diff([0.0, *self.ends]), self.E.shape[-1]
        wide = q * POLYNOMIALS
        starts, none = np.kron(_legendre(POLYNOMIALS), np.eye(q)), np.zeros((count, k + wide, 1))
        y = np.zeros((count, k, k + wide * len(shares)))
        y[:, :, :k] = np.eye(k)
        rows = list[Array]()
        for j, share in enumerate(shares):
            N, E, Y, F = (M[j] for M in loops)
            A = np.zeros((count, k + wide, k + wide))
            A[:, :k, :k], A[:, :k, k : k + q] = N, E
            A[:, k:-q, k + q :] = np.eye(wide - q) / (period * share)
            C = np.concatenate([Y, F, np.zeros((*F.shape[:2], wide - q))], axis=2)
            nothing = A[:, :, :0], C, C[:, :, :0]
            part = over_time(A, *nothing, none, period * share, 0.0, np.ones(k + wide))
            w = np.zeros((count, wide, y.shape[-1]))
            w[:, :, k + wide * j : k + wide * (j + 1)] = share**-0.5 * starts
            both = np.concatenate([y, w], axis=1)
            rows.append(share**0.5 * np.swapaxes(factor(part.M), 1, 2) @ both)
            y = part.F[:, :k] @ both
        shown: Array = np.asarray(np.linalg.qr(np.concatenate(rows, axis=1), mode="r"))
        return y[:, :, k:] / period, shown[..., :k], shown[..., k:]

    def moved(self, alpha: Array, period: float, times: int) -> Moved:
        """Return what is at so many times of each phase, and at its begin."""
        loops, count, k = self.at(alpha), len(alpha), self.N.shape[-1]
        phi, noise = np.broadcast_to(np.eye(k), (count, k, k)), np.zeros((count, k, k))
        rows, more = list[Array](), list[Array]()
        nothing = np.zeros((count, 0, k))
        for j, share in enumerate(np.diff([0.0, *self.ends])):
            N, E, Y = (M[j] for M in loops[:3])
            time = period * share / times
            part = over_time(N, N[:, :, :0], nothing, nothing[:, :, :0], E, time, 1.0, np.ones(k))
            for i in range(times + 1):
                if i:
                    phi = part.F @ phi
                    noise = part.F @ noise @ np.swapaxes(part.F, 1, 2) + time * part.V
                rows.append(Y @ phi)
                more.append(((Y @ noise) * Y).sum(axis=2))
        return Moved(phi, noise, np.concatenate(rows, axis=1), np.concatenate(more, axis=1))


@dataclass(frozen=True, eq=False)
class Moved:
    """What a period makes of y = [x; u], under noise of intensity one.

    Attributes
    ----------
    phi, noise : (count, k, k) arrays
        Of the whole period: what is made of y, and a covariance that is added.
    rows : (count, times, k) array
        z at times in it, of y at its begin.
    more : (count, times) array
        What noise adds to the variance of z.
    """

    phi: Array
    noise: Array
    rows: Array
    more: Array


def _legendre(count: int) -> Array:
    """Return Legendre's polynomials on [0, 1], of norm one, as values and slopes at 0: columns."""
    basis = [Legendre.basis(j, domain=[0, 1]) * (2 * j + 1) ** 0.5 for j in range(count)]
    return np.array([[P.deriv(i)(0.0) if i else P(0.0) for P in basis] for i in range(count)])


def storing(
    held: Held, outputs: Sequence[Output], F: Array, scales: Array, shape: tuple[int, int]
) -> Storing:
    """Return a plant at the corners of its box, with the outputs of its samples.

    Parameters
    ----------
    outputs : sequence
        Of the samples, in exact rationals.
    F : (corners, p, q) array
        Of the outputs, of disturbances as they are scaled.
    scales : (q,) array
        How many times each disturbance acts.
    shape : pair of int
        Numbers of states and inputs of the samples.
    """
    (n, m), first, count = shape, len(held.A[0]), len(held.A)
    ends = (float(1 - held.early), 1.0) if held.early else (1.0,)
    A, B, driven = (np.array(M, dtype=float) for M in (held.A, held.B, held.E))
    N, Y = np.zeros((len(ends), count, n + m, n + m)), list[Array]()
    for k in range(len(ends)):
        N[k, :, :first, :first] = A
        N[k, :, :first, held.acting(n, later=k > 0)] += np.moveaxis(B, 2, 0)
        rows = [
            [held.shown([*y.C[v][0], *y.D[v][0]], n, k > 0) for y in outputs] for v in range(count)
        ]
        Y.append(np.array(rows, dtype=float))
    E = np.zeros((count, n + m, driven.shape[-1]))
    E[:, :first] = driven * scales
    both = np.broadcast_to
    return Storing(
        N, both(E, (len(ends), *E.shape)), np.array(Y), both(F, (len(ends), *F.shape)), ends, first
    )
