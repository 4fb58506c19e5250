"""Error of the gain of a given law: each part of the region has its own X.

The coefficients of the inequalities follow from products of polynomials, in floats, in coordinates
in which X is near to the identity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.design.design import Design
from polefence.design.margins.gain import Scales, largest_of
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.polynomial import Domain, Polynomial, bernstein, binomial, elevated, times
from polefence.plant.system import Array


def largest_given(design: Design, scales: Scales, elevation: int) -> list[tuple[float, float]]:
    """Return for each L, M the largest error proved in floats, and its mu; empty where none is.

    Parameters
    ----------
    design : Design
        Of method "lyapunov".
    elevation : int
        Power of the coordinates' sum that is added to that of each part's own evidence.
    """
    found = []
    for part, evidence in zip(
        design.region.parts, design.certificate.evidence["parts"], strict=True
    ):
        loop = _loop(design, evidence)
        coefficients, T = loop.coefficients(elevation + evidence["elevation"])
        own = largest_of(part.pairs(), part.kind != "disk", coefficients, T, scales)
        if not own:
            return []
        found += own
    return found


def count_given(design: Design, elevation: int) -> float:
    """Return how many inequalities there are at most."""
    law, count = design.law, 0
    own = 2 * law.degree if isinstance(law, ScheduledGain) else 0
    for evidence in design.certificate.evidence["parts"]:
        degree = evidence["degree"] + evidence["elevation"] + own + 1 + elevation
        count += 2 * domain_of(design).count(degree)
    return float(count)


def domain_of(design: Design) -> Domain:
    """Return where the certificate's polynomials live."""
    if isinstance(design.law, ScheduledGain):
        return design.law.domain
    on = design.certificate.evidence.get("on", "simplex")
    return Domain.of(str(on), len(design.plant.vertices))


@dataclass(frozen=True, eq=False)
class _Loop:
    """X, N of one degree and B of degree 1 where x = T y, polynomials on a domain."""

    X: Polynomial
    N: Polynomial
    B: Polynomial
    T: Array
    domain: Domain
    degree: int

    def coefficients(self, elevation: int) -> tuple[tuple[Array, Array, Array], Array]:
        """Return the Bernstein coefficients, (1, count, ., .), of degree raised; and T."""
        degree = self.degree + elevation
        powers = (elevation, elevation, degree - 1)
        polynomials = zip((self.X, self.N, self.B), powers, strict=True)
        X, N, B = (
            _stacked(elevated(P, self.domain, p), self.domain, degree) for P, p in polynomials
        )
        return ((X + X.swapaxes(-1, -2)) / 2, N, B), self.T


def _stacked(P: Polynomial, domain: Domain, degree: int) -> Array:
    found = [P[e] / binomial(domain.sizes, e) for e in domain.monomials(degree)]
    return np.array(found)[None]


def _loop(design: Design, evidence: Mapping[str, Any]) -> _Loop:
    build = _fixed if isinstance(design.law, FixedGain) else _scheduled
    return build(design, evidence)


def _fixed(design: Design, evidence: Mapping[str, Any]) -> _Loop:
    """X is the evidence itself, N = (A + B K) X."""
    plant, domain, degree = design.plant, domain_of(design), int(evidence["degree"])
    Q = np.asarray(evidence["X"])
    T = _balancing(Q)
    inverse = np.linalg.inv(T)
    B = inverse @ plant.B
    closed = inverse @ plant.A @ T + B @ (design.law.gain(None) @ T)
    X = bernstein(domain, inverse @ Q @ inverse.T, degree)
    N = times(bernstein(domain, closed, 1), X)
    return _Loop(elevated(X, domain, 1), N, bernstein(domain, B, 1), T, domain, degree + 1)


def _scheduled(design: Design, evidence: Mapping[str, Any]) -> _Loop:
    """X = W V, N = (A W + B Z) V with V = multiple + Q W."""
    plant, law, domain = design.plant, design.law, domain_of(design)
    if not isinstance(law, ScheduledGain):  # for the type alone
        raise TypeError
    degree = int(evidence["degree"])
    T = _balancing(law.W)
    inverse = np.linalg.inv(T)
    A, B = inverse @ plant.A @ T, inverse @ plant.B
    W, Z = inverse @ law.W @ inverse.T, law.Z @ inverse.T
    w, AB = bernstein(domain, W, law.degree), bernstein(domain, np.concatenate([A, B], 2), 1)
    V = times(bernstein(domain, T.T @ np.asarray(evidence["X"]) @ T, degree), w)
    multiple = np.asarray(evidence.get("multiple", np.zeros(domain.count(degree))))
    scalars = bernstein(domain, multiple[:, None, None] * np.eye(len(T)), degree)
    for e, matrix in elevated(scalars, domain, law.degree).items():
        V[e] = V[e] + matrix
    X = elevated(times(w, V), domain, 1)
    N = times(times(AB, bernstein(domain, np.concatenate([W, Z], 1), law.degree)), V)
    total = degree + 2 * law.degree + 1
    S = _balancing(_stacked(X, domain, total)[0])  # X is further from the identity than W
    back = np.linalg.inv(S)
    X, N = ({e: back @ matrix @ back.T for e, matrix in P.items()} for P in (X, N))
    return _Loop(X, N, bernstein(domain, back @ B, 1), T @ S, domain, total)


def _balancing(X: Array) -> Array:
    """Return T with T T' the mean of the matrices, equilibrated first."""
    mean = X.mean(axis=0)
    mean = (mean + mean.T) / 2
    scale = np.sqrt(np.diag(mean))
    return np.asarray(scale[:, None] * np.linalg.cholesky(mean / np.outer(scale, scale)))
