r"""A bound on the spectral norm of the law K = Z W^-1 itself, for every alpha.

With H = C W and V = R Z, C and R being inverse units of states and inputs, R K C^-1 = V H^-1 has a
norm below g if and only if [ H' H, V' ; V, g^2 I ] > 0, which is not linear in W. For any matrix
polynomial H0 and s > 0, H' H / s >= H0' H + H' H0 - s H0' H0, so that

    [ H0' H + H' H0 - s H0' H0, V' ; V, g^2 s I ] > 0

suffices. It is homogeneous in (W, Z, s), and nothing is lost at H = s H0: with H0 = C W of the last
point that was found that stays one. Where coefficients of that square are not positive definite a
constant H0 does: C times the mean of W, or C^-T, for which H0' H = W.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.lmi.conditions.pencil import Block, Builder, Linear, Term, block_name, multiple, put
from polefence.plant.polynomial import Domain, bernstein, binomial, elevated, times
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Norm:
    """A bound on the norm of R K C^-1.

    Attributes
    ----------
    name : str
    C, R : (n, n), (m, m) arrays
    level : float
        The bound where it is fixed; else the unit in which it is measured.
    fixed : bool
        Whether the bound is fixed; else its square grows with r.
    """

    name: str
    C: Array
    R: Array
    level: float
    fixed: bool = True

    def changed(self, T: Array, S: Array) -> Norm:
        """Return the bound for states and inputs in other coordinates, x = T x_s, u = S u_s."""
        return replace(self, C=self.C @ T, R=self.R @ S)


def tangents(norm: Norm, W: Array) -> tuple[Array, ...]:
    """Return candidates of H0 near a law's W (count, n, n), the tightest first."""
    H = norm.C @ W
    plain = np.asarray(np.linalg.inv(norm.C).T)[None]
    return H, H.mean(axis=0, keepdims=True), plain


def add_norm(
    pencil: Builder,
    W: list[Linear],
    Z: list[Linear],
    norm: Norm,
    near: Array,
    domain: Domain,
    degree: int,
    elevation: int,
) -> None:
    """Add the condition to a pencil whose law has these Bernstein coefficients.

    Parameters
    ----------
    near : (count, n, n) array
        Coefficients of H0, or one.
    """
    (n, m), total = (len(norm.C), len(norm.R)), 2 * degree + elevation
    s = pencil.positive(f"s {norm.name}")
    # one congruence, by the inverse of H0's mean, makes H0 about I
    G = np.asarray(np.linalg.inv(near.mean(axis=0)))
    law_degree = degree if len(near) > 1 else 0
    H0 = elevated(bernstein(domain, near @ G, law_degree), domain, degree - law_degree)
    transposed = {e: p.T for e, p in H0.items()}
    square = elevated(times(transposed, H0), domain, elevation)
    left, below = [], []
    for e in domain.monomials(degree):
        alone = {e: binomial(domain.sizes, e) * np.eye(n)}
        both = elevated(times(transposed, alone), domain, elevation)
        left.append({d: p @ norm.C for d, p in both.items()})
        one = {e: np.full((1, 1), float(binomial(domain.sizes, e)))}
        below.append(elevated(one, domain, degree + elevation))
    x, u = np.split(np.eye(n + m), [n], axis=1)
    R = norm.R / norm.level
    for e in domain.monomials(total):
        M = put(multiple(s, square[e] / 2), x, x)
        for k in range(len(W)):
            if e in left[k]:
                M += put(-left[k][e] @ W[k], x, x @ G.T)
            if e in below[k]:
                M += put(-below[k][e].item() * (R @ Z[k]), u, x @ G.T)
        half = binomial(domain.sizes, e) / 2
        corner = put(multiple(s, half * np.eye(m)), u, u)
        name = f"{norm.name}, {block_name(e, domain)}"
        if norm.fixed:
            M += tuple(Term(t.name, -t.left, t.right) for t in corner)
            corner = ()
        pencil.blocks.append(Block(name, n + m, corner, M))
