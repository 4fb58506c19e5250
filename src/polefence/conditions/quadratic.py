"""Lemma 1, quadratic stabilisability: one W and one Z for the whole polytope; K = Z W^-1.

Leite & Peres (2005), equation (8), in disk form: [[r W, M_j], [M_j', r W]] > 0 at every vertex,
M_j = A_j W + B_j Z + sigma W.
"""

from __future__ import annotations

from polefence.conditions.pencil import Builder, Pencil
from polefence.plant.system import Array


def quadratic(A: Array, B: Array, sigma: float) -> Pencil:
    """Build Lemma 1 for vertices A (N, n, n), B (N, n, m) and centre -sigma."""
    N, n, m = B.shape
    pencil = Builder("quadratic")
    W, Z = pencil.symmetric("W", n), pencil.full("Z", (m, n), "u")
    for j in range(N):
        pencil.disk(f"(8) j={j + 1}", W, A[j] @ W + B[j] @ Z + sigma * W)
    return pencil.build()
