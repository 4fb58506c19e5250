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

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from polefence.lmi.conditions.gain_norm import add_norm
from polefence.lmi.conditions.pencil import Builder, Linear, Pencil, block_name, multiple
from polefence.lmi.conditions.performance import Demands, Form, Output, assembled
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
    n = A.shape[1]
    B = np.zeros((len(A), n, 0)) if B is None else B
    m = B.shape[2]
    pencil = Builder("quadratic" if degree == 0 else "scheduled")
    names = [str(k + 1) for k in range(domain.count(degree))] if degree else [""]
    W, Z = list[Linear](), list[Linear]()
    for name in names:
        W.append(pencil.symmetric(f"W{name}", n))
        if m:
            Z.append(pencil.full(f"Z{name}", (m, n), "u"))
    tau = None if right_hand_side is None else multiple(pencil.positive("tau"), right_hand_side)
    forms = (
        replace(
            form,
            name=block_name(form.exponent, domain, degree, elevation),
            floor=None if tau is None else right_hand_share(form.exponent) * tau,
        )
        for form in _forms((A, B), (W, Z), (), domain, degree, elevation)
    )
    return assembled(pencil, forms, Demands(target), domain, degree + 1 + elevation)


def design(
    A: Array, B: Array, demands: Demands, domain: Domain, degree: int, elevation: int
) -> Pencil:
    """Build the condition for a law K = Z W^-1 that keeps all bounds and a region.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    """
    n, m = A.shape[1], B.shape[2]
    pencil = Builder("performance")
    names = [str(k + 1) for k in range(domain.count(degree))]
    W = [pencil.symmetric(f"W{name}", n) for name in names]
    Z = [pencil.full(f"Z{name}", (m, n), "u") for name in names]
    for norm, near in demands.norms:
        add_norm(pencil, W, Z, norm, near, domain, degree, elevation)
    extra = max(degree + 1, demands.degree(domain)) - degree - 1 + elevation
    forms = _forms((A, B), (W, Z), demands.outputs, domain, degree, extra)
    return assembled(pencil, forms, demands, domain, degree + 1 + extra)


def _forms(
    plant: tuple[Array, Array],
    law: tuple[list[Linear], list[Linear]],
    outputs: tuple[Output, ...],
    domain: Domain,
    degree: int,
    extra: int,
) -> Iterator[Form]:
    """Yield the coefficients of X = W, N = A W + B Z and Y = C W + D Z."""
    (A, B), (W, Z) = plant, law
    n = A.shape[1]
    AC = np.concatenate([A, *(o.C for o in outputs)], axis=1)
    BD = np.concatenate([B, *(o.D for o in outputs)], axis=1)
    parts = np.split(np.eye(AC.shape[1]), n + np.arange(len(outputs)))
    tables = domain.pairs(degree, extra), domain.elevated(degree, 1 + extra)
    for e, pairs, sums in zip(domain.monomials(degree + 1 + extra), *tables, strict=True):
        X, NY = Linear(), Linear()
        for k, weight in sums.items():
            X = X + float(weight) * W[k]
            # all corners that meet this coefficient, at once
            weights = {j: w for (j, other), w in pairs.items() if other == k}
            NY = NY + sum(w * AC[j] for j, w in weights.items()) @ W[k]
            if np.any(BD):
                NY = NY + sum(w * BD[j] for j, w in weights.items()) @ Z[k]
        N, *Y = (part @ NY for part in parts) if outputs else (NY,)
        yield Form(e, X, N, tuple(Y))


def right_hand_share(exponent: Exponent) -> float:
    """Return what (15), (16), (17) have on their right-hand sides, of I."""
    square = max(len(exponent) - 1, 1) ** 2
    return {3: 1.0, 2: -1 / square, 1: -6 / square}[max(exponent)]
