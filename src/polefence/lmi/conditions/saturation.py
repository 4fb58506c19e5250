"""Inputs that are cut off: what acts lies between K x and H x, and Y = H X is unknown beside X.

For every part S of the inputs that are cut off N becomes N + B_S (Y - K X)_S. See
`polefence.proof.claims.saturation`.

Where an anti-windup gain G is sought it meets Y - K X there. With q = u - sat(u) and a diagonal S
in which q'S^-1 (q - (K - H) x) <= 0 one inequality takes the place of those of all parts, linear in
S and G S (Gomes da Silva & Tarbouriech, 2005):

    -[ N + N',  (K X - Y)' - B S - G S ;  K X - Y - S B' - (G S)',  -2 S ] > 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from polefence.lmi.conditions.pencil import Linear, multiple, put
from polefence.plant.polynomial import Domain, Exponent, Polynomial, degree_of, elevated
from polefence.plant.system import Array

GAIN = "G S"  # the name of an anti-windup gain that is sought, times S, which is named after it
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
    added: tuple[Linear, ...] = ()
    sector: Sector | None = None


@dataclass(frozen=True, eq=False)
class Sector:
    """Coefficients of one exponent where an anti-windup gain G is sought.

    Attributes
    ----------
    entering : Linear
        B S + G S, (n, k) for k inputs that are cut off.
    excess : Linear
        K X - Y of these inputs, (k, n).
    S : Linear
        (k, k)
    """

    entering: Linear
    excess: Linear
    S: Linear


@dataclass(frozen=True, eq=False)
class Sought:
    """Unknowns of an anti-windup gain: S of each input that is cut off, and G S.

    ``rows`` (n, own) puts G into the rows of the law's own states.
    """

    S: tuple[Linear, ...]
    GS: Linear
    rows: Array


def cuts(
    B: Polynomial,
    KX: Forms,
    Y: Forms,
    chosen: Sequence[int],
    domain: Domain,
    degree: int,
    sought: Sought | None = None,
) -> dict[Exponent, Cut]:
    """Return the saturation terms of a condition of a degree, by exponent.

    Parameters
    ----------
    B : polynomial
        Of degree one.
    KX, Y : mapping
        Coefficients by exponents, of one degree.
    sought : Sought, optional
        Of an anti-windup gain.
    """
    difference = {e: coefficient - KX.get(e, Linear()) for e, coefficient in Y.items()}
    degree_of_Y = sum(next(iter(Y))[: domain.sizes[0]])
    raised = elevated(B, domain, degree - degree_of_Y - degree_of(B, domain))
    one = {(0,) * sum(domain.sizes): np.eye(next(iter(B.values())).shape[1])}
    free = np.diag([float(i not in chosen) for i in range(len(one[next(iter(one))]))])
    bounded = {e: P - free @ KX.get(e, Linear()) for e, P in Y.items()}
    ones = elevated(one, domain, degree - degree_of_Y)
    held = _times(ones, bounded)
    if sought is not None:
        beyond = _times(ones, {e: -1.0 * excess_of for e, excess_of in difference.items()})
        sectors = _sectors(B, beyond, chosen, domain, degree, sought)
        return {e: Cut(held[e], sector=sectors[e]) for e in domain.monomials(degree)}
    excess = [_times(_column(raised, i), difference) for i in chosen]
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


def _sectors(
    B: Polynomial,
    beyond: Forms,
    chosen: Sequence[int],
    domain: Domain,
    degree: int,
    sought: Sought,
) -> dict[Exponent, Sector]:
    """Return the terms of the one inequality; ``beyond`` is K X - Y, of this degree."""
    raised = elevated(B, domain, degree - degree_of(B, domain))
    ones = elevated({(0,) * sum(domain.sizes): np.eye(1)}, domain, degree)
    (n, m), units = next(iter(B.values())).shape, np.eye(len(chosen))[:, :, None]
    pairs = list(zip(chosen, sought.S, units, strict=True))
    result = dict[Exponent, Sector]()
    for e in domain.monomials(degree):
        weight = ones[e].item()
        entering, corner = weight * (sought.rows @ sought.GS), Linear()
        for i, S, unit in pairs:
            column = raised[e][:, i : i + 1] if e in raised else np.zeros((n, 1))
            entering = entering + Linear(put(multiple(S, column), np.eye(n), unit))
            corner = corner + Linear(put(weight * S, unit, unit))
        result[e] = Sector(entering, np.eye(m)[list(chosen)] @ beyond[e], corner)
    return result


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
