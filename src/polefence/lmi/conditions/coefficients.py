"""Bernstein coefficients that are unknown: as those of monomials, and on a part of the box."""

from __future__ import annotations

from collections.abc import Sequence

from polefence.lmi.conditions.pencil import Linear
from polefence.plant.boxes import Box, weights
from polefence.plant.polynomial import Domain, Exponent, binomial


def weighted(coefficients: Sequence[Linear], domain: Domain, degree: int) -> dict[Exponent, Linear]:
    """Return the coefficients of monomials for Bernstein coefficients."""
    pairs = zip(domain.monomials(degree), coefficients, strict=True)
    return {e: float(binomial(domain.sizes, e)) * coefficient for e, coefficient in pairs}


def inside(coefficients: Sequence[Linear], box: Box, domain: Domain, degree: int) -> list[Linear]:
    """Return the Bernstein coefficients on a part of the box, given those on the whole."""
    if not coefficients:
        return []
    whole, on_part = weighted(coefficients, domain, degree), []
    shares = weights(box, domain, degree)
    for e in domain.monomials(degree):
        total = Linear()
        for d, share in shares[e].items():
            total = total + share / binomial(domain.sizes, e) * whole[d]
        on_part.append(total)
    return on_part
