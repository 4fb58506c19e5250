"""Looks for an alpha whose poles leave the region; what it finds is confirmed exactly."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import numpy as np

from polefence.law import right_divide
from polefence.plant.system import Array
from polefence.proof import exact

SAMPLES = 2000
EDGE_POINTS = 9
STARTS = 4
ROUNDS = 40
SEED = 20050801


def sample_simplex(N: int, count: int, seed: int = SEED) -> Array:
    """Points of the simplex, (count, N): uniform, and as many again pressed towards its faces."""
    random = np.random.default_rng(seed)
    half = count // 2
    return np.vstack(
        [random.dirichlet(np.ones(N), count - half), random.dirichlet(np.full(N, 0.3), half)]
    )


def edges(N: int, points: int = EDGE_POINTS) -> Array:
    """The vertices and ``points`` interior points of every edge, (count, N)."""
    rows = [np.eye(N)]
    inner = np.linspace(0, 1, points + 2)[1:-1, None]
    rows += [
        inner * np.eye(N)[j] + (1 - inner) * np.eye(N)[k] for j, k in combinations(range(N), 2)
    ]
    return np.vstack(rows)


def counterexample(claim: exact.Claim) -> list[Fraction] | None:
    """Return an alpha at which a pole does not lie in the open disk, or None if none was found.

    A float search over vertices, edges and a seeded sample, refined around the worst points; the
    alpha returned was confirmed in exact arithmetic.
    """
    family = _Family(claim)
    N = len(claim.A)
    points = np.vstack([edges(N), sample_simplex(N, SAMPLES)])
    excess = family.excess(points)
    for index in np.argsort(-excess)[:STARTS]:
        alpha, worst = _climb(family, points[index], float(excess[index]))
        if worst < -1e-6 * float(claim.r):
            continue
        rational = _rational(alpha)
        if not exact.poles_inside(claim, rational):
            return rational
    return None


class _Family:
    """The claim as floats: how far the farthest pole lies outside the disk."""

    def __init__(self, claim: exact.Claim) -> None:
        self.A, self.B = (np.array(M, dtype=float) for M in (claim.A, claim.B))
        self.centre, self.r = -float(claim.sigma), float(claim.r)
        self.K = None if claim.K is None else np.array(claim.K, dtype=float)
        if claim.Z is not None:
            self.W, self.Z = np.array(claim.X, dtype=float), np.array(claim.Z, dtype=float)

    def excess(self, alpha: Array) -> Array:
        A, B = np.tensordot(alpha, self.A, 1), np.tensordot(alpha, self.B, 1)
        try:
            if self.K is not None:
                K = self.K
            else:
                K = right_divide(np.tensordot(alpha, self.Z, 1), np.tensordot(alpha, self.W, 1))
            poles = np.linalg.eigvals(A + B @ K)
        except np.linalg.LinAlgError:  # a law that is singular somewhere: look point by point
            if len(alpha) == 1:
                return np.array([np.inf])
            return np.concatenate([self.excess(a[None]) for a in alpha])
        return np.asarray(np.abs(poles - self.centre).max(axis=-1) - self.r)


def _climb(family: _Family, alpha: Array, worst: float) -> tuple[Array, float]:
    """Seeded random search with a shrinking step, on the simplex."""
    random = np.random.default_rng(SEED)
    step = 0.2
    for _ in range(ROUNDS):
        mates = random.dirichlet(np.full(alpha.size, 0.5), 16)
        trial = np.clip(
            alpha + step * random.choice([-1.0, 1.0], (16, 1)) * (mates - alpha), 0, None
        )
        trial /= trial.sum(axis=1, keepdims=True)
        excess = family.excess(trial)
        best = int(np.argmax(excess))
        if excess[best] > worst:
            alpha, worst = trial[best], float(excess[best])
        else:
            step *= 0.7
    return alpha, worst


def _rational(alpha: Array) -> list[Fraction]:
    weights = [Fraction(round(float(a) * 2**30), 2**30) for a in alpha]
    total = sum(weights)
    return [w / total for w in weights]
