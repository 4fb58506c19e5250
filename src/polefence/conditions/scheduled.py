"""Theorem 1: W(alpha), Z(alpha) affine in alpha; scheduled gain K(alpha) = Z(alpha) W(alpha)^-1.

Leite & Peres (2005), equations (15)-(17), in disk form with M_jk = A_j W_k + B_j Z_k + sigma W_k.
The paper's right-hand sides (+I, -I/(N-1)^2, -6 I/(N-1)^2 here, on the first block) are kept
homogeneous by a free scalar tau in place of 1, which scales with (W, Z) and changes nothing.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations, permutations

import numpy as np

from polefence.conditions.linear import Linear, multiple
from polefence.conditions.pencil import Builder, Pencil
from polefence.plant.system import Array


def scheduled(A: Array, B: Array, sigma: float, right_hand_side: Array | None = None) -> Pencil:
    """Build Theorem 1 for vertices A (N, n, n), B (N, n, m) and centre -sigma.

    Parameters
    ----------
    right_hand_side : (n, n) array, optional
        The paper's I, in the coordinates of A; without it the right-hand sides are zero.
    """
    N, n, m = B.shape
    pencil = Builder("scheduled")
    pairs = [
        (pencil.symmetric(f"W{j + 1}", n), pencil.full(f"Z{j + 1}", (m, n), "u")) for j in range(N)
    ]
    W, Z = zip(*pairs, strict=True)
    unit, square = Linear(), max(N - 1, 1) ** 2
    if right_hand_side is not None:
        unit = multiple(pencil.positive("tau"), right_hand_side)

    shifted = A + sigma * np.eye(n)

    @cache
    def M(j: int, k: int) -> Linear:
        product: Linear = shifted[j] @ W[k] + B[j] @ Z[k]
        return product

    for j in range(N):
        pencil.disk(f"(15) j={j + 1}", W[j], M(j, j), floor=unit)
    for j, k in permutations(range(N), 2):
        pencil.disk(
            f"(16) j={j + 1} k={k + 1}",
            2.0 * W[j] + W[k],
            M(j, j) + M(j, k) + M(k, j),
            floor=(-1 / square) * unit,
        )
    for j, k, l in combinations(range(N), 3):  # noqa: E741
        total = Linear()
        for p, q in permutations((j, k, l), 2):
            total = total + M(p, q)
        pencil.disk(
            f"(17) j={j + 1} k={k + 1} l={l + 1}",
            2.0 * (W[j] + W[k] + W[l]),
            total,
            floor=(-6 / square) * unit,
        )
    return pencil.build()
