"""One slack matrix G for a Lyapunov polynomial P(alpha); fixed gain K = L G^-1.

Disks: [[r P, N + sigma G], [*, r (G + G' - P)]] > 0 with N = A G + B L, for P affine in alpha
Lemma 2, equation (10) of Leite & Peres (2005). Other parts { z : L + M z + M' conj(z) < 0 }:
-[[L (x) P + M' (x) N + *, M (x) (P - G') + e I (x) N], [*, -e I (x) (G + G')]] > 0, which implies
the inequality of the part with A_c P in place of N (multiply by [I, I (x) A_c]); as e tends to zero
it contains Lemma 1 (Peaucelle, Arzelier, Bachelier & Bernussou, 2000).
"""

from __future__ import annotations

import numpy as np

from polefence.lmi.conditions.pencil import Builder, Linear, Pencil, Piece, block_name
from polefence.lmi.conditions.target import Side, Target
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array


def slack(
    A: Array,
    B: Array,
    target: Target,
    domain: Domain,
    degree: int = 1,
    elevation: int = 0,
    epsilon: float = 0.0,
) -> Pencil:
    """Build the condition for vertices A (N, n, n), B (N, n, m) and regions that grow with r.

    Parameters
    ----------
    epsilon : float
        The e above, in units of 1 / rate; disks do not need it.
    """
    n, m = B.shape[1:]
    pencil = Builder("slack")
    P = [pencil.symmetric(f"P{k + 1}", n) for k in range(domain.count(degree))]
    G, L = pencil.full("G", (n, n), "x"), pencil.full("L", (m, n), "u")
    top = max(degree, 1) + elevation
    exponents = domain.monomials(top)
    tables = domain.pairs(0, top - 1), domain.elevated(degree, top - degree)
    for exponent, products, sums in zip(exponents, *tables, strict=True):
        total = float(sum(products.values()))
        p = Linear()
        for k, weight in sums.items():
            p = p + float(weight) * P[k]
        N = sum(w * A[j] for (j, _), w in products.items()) @ G
        N = N + sum(w * B[j] for (j, _), w in products.items()) @ L
        g = total * G
        name = f"(10) j={exponent.index(1) + 1}" if top == 1 and len(domain.sizes) == 1 else ""
        name = name or block_name(exponent, domain)
        for label, side in target.named(name):
            if _is_disk(side):
                _disk(pencil, label, side, (p, N, g))
            else:
                _bordered(pencil, label, side, (p, N, g), epsilon)
        if target.positive:
            pencil.positive_definite(f"P at {name}", p)
    return pencil.build()


def _is_disk(side: Side) -> bool:
    """Whether the part is [[-r, z - c], [*, -r]] < 0, r perhaps shifted."""
    upper = side.M0.shape == (2, 2) and np.count_nonzero(side.M0) == 1 and side.M0[0, 1]
    return bool(upper) and not side.M1.any()


def _disk(pencil: Builder, name: str, side: Side, matrices: tuple[Linear, Linear, Linear]) -> None:
    p, N, g = matrices
    lower = 2.0 * g - p  # its symmetric part counts
    radius, shift = -side.L1[0, 0], -side.L0[0, 0]
    D: list[Piece] = [(0, 0, 0.5 * radius * p), (1, 1, 0.5 * radius * lower)]
    M: list[Piece] = [(0, 1, N + side.L0[0, 1] * g)]
    if shift:
        M += [(0, 0, -0.5 * shift * p), (1, 1, -0.5 * shift * lower)]
    pencil.block(name, 2, D, M)


def _bordered(
    pencil: Builder,
    name: str,
    side: Side,
    matrices: tuple[Linear, Linear, Linear],
    epsilon: float,
) -> None:
    p, N, g = matrices
    d = len(side.L0)
    D, M = list[Piece](), list[Piece]()
    for a in range(d):
        for b in range(d):
            if a == b:
                D.append((a, a, -0.5 * side.L1[a, a] * p))
                M.append((a, a, 0.5 * side.L0[a, a] * p))
                M.append((a, d + a, epsilon * N))
                M.append((d + a, d + a, -epsilon * g))
            elif a < b:
                D.append((a, b, -side.L1[a, b] * p))
                M.append((a, b, side.L0[a, b] * p))
            if side.M0[b, a]:
                M.append((a, b, side.M0[b, a] * N))
            if side.M0[a, b]:
                M.append((a, d + b, side.M0[a, b] * p))
                # M (x) G' above the diagonal is M' (x) G below it
                M.append((d + b, a, -side.M0[a, b] * g))
    pencil.block(name, 2 * d, D, M)
