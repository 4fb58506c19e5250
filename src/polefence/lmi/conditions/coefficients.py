"""Bernstein coefficients that are unknown: as those of monomials, and on a part of the box."""

from __future__ import annotations

from collections.abc import Sequence

from polefence.lmi.conditions.pencil import Linear
from polefence.plant.boxes import Box, weights
from polefence.plant.polynomial import Domain, Exponent, binomial


def weighted(coefficients: Sequence[Linear], domain: Domain, degree: int) -> dict[Exponent, Linear]:
    """Return Bernstein coefficients as those of monomials."""
    pairs = zip(domain.monomials(degree), coefficients, strict=True)
    return {e: float(binomial(domain.sizes, e)) * own for e, own in pairs}


def inside(own: Sequence[Linear], box: Box, domain: Domain, degree: int) -> list[Linear]:
    """Return the Bernstein coefficients, on a part of the box, of those on the whole."""
    if not own:
        return []
    whole, found = weighted(own, domain, degree), []
    shares = weights(box, domain, degree)
    for e in domain.monomials(degree):
        total = Linear()
        for d, share in shares[e].items():
            total = total + share / binomial(domain.sizes, e) * whole[d]
        found.append(total)
    return found
