"""Lemma 2, augmented space: a Lyapunov matrix per vertex, one slack G; fixed gain K = L G^-1.

Leite & Peres (2005), equation (10): [[r P_j, A_j G + B_j L + sigma G], [*, r (G + G' - P_j)]] > 0.
"""

from __future__ import annotations

from polefence.conditions.pencil import Builder, Pencil
from polefence.plant.system import Array


def slack(A: Array, B: Array, sigma: float) -> Pencil:
    """Build Lemma 2 for vertices A (N, n, n), B (N, n, m) and centre -sigma."""
    N, n, m = B.shape
    pencil = Builder("slack")
    P = [pencil.symmetric(f"P{j + 1}", n) for j in range(N)]
    G, L = pencil.full("G", (n, n), "x"), pencil.full("L", (m, n), "u")
    for j in range(N):
        M = A[j] @ G + B[j] @ L + sigma * G
        pencil.disk(f"(10) j={j + 1}", P[j], M, right=2.0 * G - P[j])
    return pencil.build()
