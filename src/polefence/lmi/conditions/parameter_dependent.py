"""W(alpha), Z(alpha) polynomials in alpha; gain K(alpha) = Z(alpha) W(alpha)^-1.

One theorem for all regions, degrees and domains. For X = W and N = A W + B Z, polynomials of
alpha, -(L (x) X + M (x) N + M' (x) N') > 0 for every part of the region places the poles (Chilali &
Gahinet, 1996); it holds for all alpha if, times (sum of alpha)^elevation, all of its coefficients
are positive definite (Polya). Degree 0 is Lemma 1, quadratic stabilisability, equation (8) of Leite
& Peres (2005); degree 1 and elevation 1 on the simplex, for a disk, Theorem 1, (15)-(17).
The paper's right-hand sides (+I, -I/(N-1)^2, -6 I/(N-1)^2 here, on the first block) are kept
homogeneous by a free scalar tau in place of 1, which scales with (W, Z) and changes nothing.
"""

from __future__ import annotations

import numpy as np

from polefence.lmi.conditions.linear import Linear, multiple
from polefence.lmi.conditions.pencil import Builder, Pencil
from polefence.lmi.conditions.target import Target
from polefence.plant.polynomial import Domain, Exponent
from polefence.plant.system import Array


def parameter_dependent(
    A: Array,
    B: Array | None,
    target: Target,
    domain: Domain,
    degree: int = 1,
    elevation: int = 1,
    right_hand_side: Array | None = None,
) -> Pencil:
    """Build the condition for vertices A (N, n, n), B (N, n, m) and regions that grow with r.

    Parameters
    ----------
    B : (N, n, m) array, optional
        Without it A is a closed loop, and the condition one of analysis, W its Lyapunov matrix.
    right_hand_side : (n, n) array, optional
        The paper's I, in the coordinates of A; without it the right-hand sides are zero.
    """
    n, m = A.shape[1], 0 if B is None else B.shape[2]
    pencil = Builder("quadratic" if degree == 0 else "scheduled")
    names = [str(k + 1) for k in range(domain.count(degree))] if degree else [""]
    W, Z = list[Linear](), list[Linear]()
    for name in names:
        W.append(pencil.symmetric(f"W{name}", n))
        if m:
            Z.append(pencil.full(f"Z{name}", (m, n), "u"))
    tau = None if right_hand_side is None else multiple(pencil.positive("tau"), right_hand_side)
    exponents = domain.monomials(degree + 1 + elevation)
    tables = domain.pairs(degree, elevation), domain.elevated(degree, 1 + elevation)
    for exponent, products, sums in zip(exponents, *tables, strict=True):
        X, N = Linear(), Linear()
        for k, weight in sums.items():
            X = X + float(weight) * W[k]
        for k in sums:
            # all corners that meet this coefficient, at once
            weights = {j: w for (j, other), w in products.items() if other == k}
            N = N + sum(w * A[j] for j, w in weights.items()) @ W[k]
            if B is not None and m:
                N = N + sum(w * B[j] for j, w in weights.items()) @ Z[k]
        name = block_name(exponent, domain, degree, elevation)
        floor = None if tau is None else right_hand_share(exponent) * tau
        for number, side in enumerate(target.sides):
            label = name if len(target.sides) == 1 else f"{name}, part {number + 1}"
            pencil.region(label, X, N, side, floor)
        if target.positive:
            pencil.positive_definite(f"W at {name}", X)
    return pencil.build()


def right_hand_share(exponent: Exponent) -> float:
    """Return what (15), (16), (17) have on their right-hand sides, of I."""
    square = max(len(exponent) - 1, 1) ** 2
    return {3: 1.0, 2: -1 / square, 1: -6 / square}[max(exponent)]


def block_name(exponent: Exponent, domain: Domain, degree: int, elevation: int) -> str:
    """Name a block as the paper does where it has it, else by its monomial."""
    order = sorted((j for j, p in enumerate(exponent) if p), key=lambda j: (-exponent[j], j))
    if len(domain.sizes) == 1:
        number = {(0, 0): "8", (1, 1): str(14 + len(order))}.get((degree, elevation))
        if number is not None:
            indices = zip("jkl", order, strict=False)
            return f"({number}) " + " ".join(f"{letter}={j + 1}" for letter, j in indices)
    return "alpha^" + "".join(str(p) for p in exponent)


def closed_loops(A: Array, B: Array, K: Array) -> Array:
    """Return A_j + B_j K, (N, n, n)."""
    return np.asarray(A + B @ K)
