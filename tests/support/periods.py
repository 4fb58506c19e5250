"""Periods in which inputs are held: families drawn at random, and their means by quadrature."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from scipy.integrate import quad_vec
from scipy.linalg import expm

from polefence.proof.between import Changed, Period

T = Fraction(1, 50)


def some_period(rng, parameters, n=3, m=1, share=None):
    """A family drawn at random, oscillating and lightly damped; with a share B and D change."""

    def drawn(rows, columns, size, spread):
        middle = rng.normal(size=(rows, columns)) * size
        return [
            [
                [Fraction(round(64 * x), 64) for x in row]
                for row in middle + spread * size * rng.uniform(-1, 1, (rows, columns))
            ]
            for _ in range(2**parameters)
        ]

    A, B = drawn(n, n, 20.0, 0.3), drawn(n, m, 5.0, 0.2)
    C, D, E = drawn(2, n, 1.0, 0.3), drawn(2, m, 0.5, 0.3), drawn(n, 2, 1.0, 0.2)
    units = tuple(Fraction(2) ** int(k) for k in rng.integers(-3, 4, n + m))
    changed = share and Changed(share, drawn(n, m, 5.0, 0.2), drawn(2, m, 0.5, 0.3))
    return Period(A, B, C, D, E, T, Fraction(1, 3), units, changed=changed)


def by_quadrature(period, at):
    """M, V and c at a point, from their integrals."""
    weights = np.array([1.0])
    for t in at:
        weights = np.kron(weights, [1 - t, t])
    last = period.changed or Changed(Fraction(0), period.B, period.D)
    A, B, C, D, E, later, then = (
        np.tensordot(weights, np.array(M, dtype=float), 1)
        for M in (period.A, period.B, period.C, period.D, period.E, last.B, last.D)
    )
    n, m, h = len(A), B.shape[1], float(period.step)
    N, N2 = (np.block([[A, X], [np.zeros((m, n + m))]]) for X in (B, later))
    W, change = float(period.intensity) * E @ E.T, h * float(1 - last.share)

    def of(s):
        F = expm(N * min(s, change))
        shown = np.hstack([C, D if s <= change else then]) @ expm(N2 * max(s - change, 0.0)) @ F
        F = expm(A * s)
        moved = F @ W @ F.T
        lasting = (h - s) * np.trace(C @ moved @ C.T)
        return np.concatenate([(shown.T @ shown).ravel(), moved.ravel(), [lasting]]) / h

    ends = [(0.0, change), (change + 1e-15, h)] if last.share else [(0.0, h)]
    found = sum(quad_vec(of, *both, epsrel=1e-12, epsabs=0.0)[0] for both in ends)
    k = n + m
    return found[: k * k].reshape(k, k), found[k * k : -1].reshape(n, n), found[-1]
