"""Inputs that are cut off: what acts lies between K x and H x, and Y = H X is unknown beside X.

For every part S of the inputs that are cut off N becomes N + B_S (Y - K X)_S. See
`polefence.proof.claims.saturation`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from polefence.lmi.conditions.pencil import Linear
from polefence.plant.polynomial import Domain, Exponent, Polynomial, degree_of, elevated
from polefence.plant.system import Array

HELD = "Y"  # how the names of what is unknown beside X begin


def held_name(output: str) -> str:
    """Return the prefix of the names of an output's unknowns, of a law that is sought."""
    return f"{HELD} {output}."


Forms = Mapping[Exponent, Linear]


@dataclass(frozen=True, eq=False)
class Cut:
    """Coefficients of one exponent: Y, and the terms added to N for every subset of the inputs.

    Nothing is added for the first, of none. Rows of inputs that nothing cuts off are free, and
    those of Y - K X here.
    """

    Y: Linear
    added: tuple[Linear, ...]


def cuts(
    B: Polynomial, KX: Forms, Y: Forms, chosen: Sequence[int], domain: Domain, degree: int
) -> dict[Exponent, Cut]:
    """Return the saturation terms of a condition of a degree, by exponent.

    Parameters
    ----------
    B : polynomial
        Of degree one.
    KX, Y : mapping
        Coefficients by exponents, of one degree.
    """
    difference = {e: coefficient - KX.get(e, Linear()) for e, coefficient in Y.items()}
    degree_of_Y = sum(next(iter(Y))[: domain.sizes[0]])
    raised = elevated(B, domain, degree - degree_of_Y - degree_of(B, domain))
    excess = [_times(_column(raised, i), difference) for i in chosen]
    one = {(0,) * sum(domain.sizes): np.eye(next(iter(B.values())).shape[1])}
    free = np.diag([float(i not in chosen) for i in range(len(one[next(iter(one))]))])
    bounded = {e: P - free @ KX.get(e, Linear()) for e, P in Y.items()}
    held = _times(elevated(one, domain, degree - degree_of_Y), bounded)
    parts = [p for size in range(len(chosen) + 1) for p in combinations(range(len(chosen)), size)]
    cut: dict[Exponent, Cut] = {}
    for e in domain.monomials(degree):
        added = []
        for part in parts:
            total = Linear()
            for k in part:
                total = total + excess[k].get(e, Linear())
            added.append(total)
        cut[e] = Cut(held[e], tuple(added))
    return cut


def _column(B: Polynomial, i: int) -> Polynomial:
    """Return B with all columns but one zero."""
    keep: Array = np.zeros(next(iter(B.values())).shape[1])
    keep[i] = 1.0
    return {e: M * keep for e, M in B.items()}


def _times(P: Polynomial, Q: Forms) -> dict[Exponent, Linear]:
    product: dict[Exponent, Linear] = {}
    for c, M in P.items():
        for d, coefficient in Q.items():
            e = tuple(a + b for a, b in zip(c, d, strict=True))
            product[e] = product.get(e, Linear()) + M @ coefficient
    return product
