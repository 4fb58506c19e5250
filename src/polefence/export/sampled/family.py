"""A sampled loop as a family in discrete time, in floats: what the search for a proof works on.

See `polefence.proof.claims.sampled` for the states and inputs; nothing of the proof rests on this.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.design.given.closed_loop import certificate_of
from polefence.design.margins.gain import Scales, largest_of
from polefence.design.margins.inequalities import balanced
from polefence.export.sampled.poles import cloud
from polefence.law.laws import FixedGain, Law, ScheduledGain, domain_of, given_law
from polefence.lmi.solve.starts import start_matrix
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.region.regions import Disk
from polefence.response.discrete import held

POINTS = 200  # at which the error of the steps is looked at
BITS = 12  # of the coordinates: short numbers make short proofs
FINE = 10  # bits by which the steps are finer than their error


@dataclass(frozen=True, eq=False)
class Coordinates:
    """y = T x, u = diag(scale) v; short numbers."""

    T: Array
    scale: Array


# Bernstein coefficients of X, N and B, see `polefence.design.margins.inequalities`; coordinates.
Proof = tuple[tuple[Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Family:
    """The loop, with short numbers for the vertices' steps [F, G], (N, n, n + m).

    ``error`` is how far their combinations are from the plant's step, as a sample shows it.
    """

    design: Design
    sample_time: float
    delay: int
    coordinates: Coordinates
    steps: Array
    error: float
    plant: UncertainPlant
    law: Law

    @property
    def rate(self) -> float:
        """The largest Frobenius norm of [A, B] in these coordinates [1/s]."""
        return float(np.linalg.norm(_rates(self.design, self.coordinates), axis=(1, 2)).max())

    def proof(self, evidence: dict[str, Any]) -> Proof | None:
        """Return what evidence has for the search; None where it is not even a Lyapunov matrix."""
        certificate = certificate_of(self.plant, self.law, Disk(0.0, 1.0), [evidence])
        with suppress(InputError):
            (own,) = balanced(Design(certificate), certificate.region)
            return own.raised(evidence["elevation"]), own.T
        return None

    def tolerated(self, proof: Proof | None, radius: float, weight: Array) -> tuple[float, float]:
        """Return the largest error of the steps that is proved in floats, and its mu.

        Zero where not even the poles are proved to lie in the disk. ``weight`` (m,) has the rows
        of v.
        """
        n, width = self.steps.shape[1], self.plant.shape[0]
        scales = Scales(np.concatenate([weight, np.ones(n)]), np.ones(width))
        if proof is not None:
            with np.errstate(invalid="ignore", divide="ignore"), suppress(np.linalg.LinAlgError):
                (found,) = largest_of(Disk(0.0, radius).pairs(), False, *proof, scales) or [(0, 1)]
                if found[0] > 0:
                    return found
        return 0.0, 1.0


def first_coordinates(design: Design) -> Coordinates:
    """Return coordinates of the loop at the middle of the family."""
    middle = np.full((1, len(design.plant.vertices)), 1 / len(design.plant.vertices))
    A, B = (each[0] for each in design.plant.at(middle))
    K = design.law.gain(middle)[0]
    closed = A + B @ K
    size = float(np.abs(np.linalg.eigvals(closed)).max()) or 1.0
    T = _whitening(start_matrix(closed / size))
    T = _evened(design.law, T)
    return _rounded(T, _size_of_gain(K, T))


def next_coordinates(family: Family, evidence: Mapping[str, Any]) -> Coordinates:
    """Return coordinates in which the Lyapunov matrix at the middle is near to the identity."""
    n, own = family.steps.shape[1], family.coordinates
    X, law = _middle(family, evidence), family.design.law
    before = _whitening(X[:n, :n]) @ own.T
    T = _evened(law, before)
    if family.delay:
        return _rounded(T, own.scale * np.sqrt(np.diag(X)[n:]) * before[0, 0] / T[0, 0])
    return _rounded(T, _size_of_gain(law.gain(np.eye(len(family.steps))), T))


def _evened(law: Law, T: Array) -> Array:
    """Return a multiple of T for which T W T' is of the identity's size: that stands beside it."""
    if not isinstance(law, ScheduledGain):
        return T
    W = T @ law.W @ T.T
    return np.asarray(T * np.sqrt(len(T) / np.trace(W.mean(axis=0))))


def _size_of_gain(K: Array, T: Array) -> Array:
    """Return what makes the rows of the gains K T^-1 one at most."""
    size = np.linalg.norm(K @ np.linalg.inv(T), axis=-1).reshape(-1, K.shape[-2]).max(axis=0)
    return np.where(size > 0, size, 1.0)


def family_of(design: Design, sample_time: float, delay: int, coordinates: Coordinates) -> Family:
    """Return the loop in these coordinates."""
    n, _ = design.plant.shape
    steps = _steps(_rates(design, coordinates), n, sample_time)
    alphas = cloud(design, POINTS)
    between = np.tensordot(alphas, _rates(design, coordinates), 1)
    off = _steps(between, n, sample_time) - np.tensordot(alphas, steps, 1)
    # their errors have signs: moving all vertices by half of the largest halves it
    shift = (off.max(axis=0) + off.min(axis=0)) / 2
    error = float(np.linalg.norm(off - shift, axis=(1, 2)).max())
    unit = 2.0 ** (math.floor(math.log2(max(error, 1e-12))) - FINE)
    steps = np.round((steps + shift) / unit) * unit
    plant = _plant(design, steps, delay, sample_time)
    law = given_law(plant, _law(design, plant, coordinates))
    return Family(design, sample_time, delay, coordinates, steps, error, plant, law)


def _rates(design: Design, coordinates: Coordinates) -> Array:
    """Return [A, B] of all vertices in these coordinates."""
    T, plant = coordinates.T, design.plant
    B = T @ plant.B * coordinates.scale
    return np.concatenate([T @ plant.A @ np.linalg.inv(T), B], axis=2)


def _steps(rates: Array, n: int, sample_time: float) -> Array:
    return np.concatenate(held(rates[..., :n], rates[..., n:], sample_time), axis=-1)


def _plant(design: Design, steps: Array, delay: int, sample_time: float) -> UncertainPlant:
    (n, m), N = design.plant.shape, len(steps)
    A, B = steps[..., :n], np.zeros((N, n, m + n))
    B[..., m:] = np.eye(n)
    if delay:
        A = np.concatenate([steps, np.zeros((N, m, n + m))], axis=1)
        below = np.zeros((N, m, m + n))
        below[..., :m] = np.eye(m)
        B = np.concatenate([B, below], axis=1)
    else:
        B[..., :m] = steps[..., n:]
    plant = UncertainPlant.from_vertices(list(A), list(B), sample_time=Fraction(sample_time))
    return replace(plant, parameters=design.plant.parameters)


def _law(design: Design, plant: UncertainPlant, coordinates: Coordinates) -> Law:
    (n, m), law, T = design.plant.shape, design.law, coordinates.T
    width = plant.shape[0]
    if isinstance(law, FixedGain):
        K = np.zeros((m + n, width))
        K[:m, :n] = law.K @ np.linalg.inv(T) / coordinates.scale[:, None]
        return FixedGain(K)
    W = np.tile(np.eye(width), (len(law.W), 1, 1))
    own = T @ law.W @ T.T
    W[:, :n, :n] = (own + own.swapaxes(1, 2)) / 2
    Z = np.zeros((len(W), m + n, width))
    Z[:, :m, :n] = law.Z @ T.T / coordinates.scale[:, None]
    return ScheduledGain(W, Z, plant.parameters, law.degree, law.sizes)


def _middle(family: Family, evidence: Mapping[str, Any]) -> Array:
    """Return the Lyapunov matrix at the middle."""
    law = family.law
    where = domain_of(family.plant, law)
    alpha = np.full(where.corners, 1 / where.corners)
    basis = where.basis(alpha, evidence["degree"])
    Q = np.tensordot(basis, np.asarray(evidence["X"]), 1)
    if not isinstance(law, ScheduledGain):
        return np.asarray(Q)
    W = np.tensordot(where.basis(alpha, law.degree), law.W, 1)
    X = W @ (basis @ np.asarray(evidence["multiple"]) * np.eye(len(W)) + Q @ W)
    return np.asarray((X + X.T) / 2)


def _whitening(X: Array) -> Array:
    """Return a lower triangular T with T X T' = I."""
    scale = np.sqrt(np.diag(X))
    factor = np.linalg.cholesky(X / np.outer(scale, scale))
    return np.asarray(np.tril(np.linalg.inv(factor)) / scale)


def _rounded(T: Array, scale: Array) -> Coordinates:
    """Return short numbers, and powers of two."""
    mantissa, exponent = np.frexp(T)
    short = np.ldexp(np.round(mantissa * 2.0**BITS), exponent - BITS)
    return Coordinates(np.asarray(short), np.asarray(2.0 ** np.round(np.log2(scale))))
