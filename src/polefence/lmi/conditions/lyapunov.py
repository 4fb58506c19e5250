"""Lyapunov polynomials of a closed loop that is given: conditions of analysis.

The loop is A + B K = C(alpha) E(alpha)^-1 in polynomials of alpha. With an unknown symmetric
Q(alpha) the Lyapunov matrix X = E Q R and N = (A + B K) X = C Q R are polynomials too, if R = I
where E is a scalar polynomial times I, and R = W where E = W (sum of alpha) is that of a scheduled
law Z W^-1. There a scalar ``multiple`` times W itself, the law's own evidence, is added to X. What
is then asked for is as in `parameter_dependent`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from operator import add

import numpy as np

from polefence.lmi.conditions.linear import Linear, Term
from polefence.lmi.conditions.parameter_dependent import block_name
from polefence.lmi.conditions.pencil import Builder, Pencil
from polefence.lmi.conditions.target import Target
from polefence.plant.polynomial import Domain, Exponent, Polynomial, binomial, elevated
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Loop:
    """The closed loop C E^-1, with R where E is no multiple of the identity.

    Attributes
    ----------
    E, C : polynomials, n x n, of one degree
    R : polynomial, n x n, optional
    domain : Domain
    """

    E: Polynomial
    C: Polynomial
    domain: Domain
    R: Polynomial | None = None

    @property
    def degree(self) -> int:
        """Degree of X in each simplex where Q is constant."""
        return _degree(self.E, self.domain) + (_degree(self.R, self.domain) if self.R else 0)

    @cached_property
    def rights(self) -> list[tuple[Exponent, Array | None]]:
        """Exponents of R and its coefficients transposed, as terms have them on the right."""
        if self.R is None:
            return [((0,) * sum(self.domain.sizes), None)]
        return [(e, p.T) for e, p in self.R.items()]

    def changed(self, T: Array, rate: float) -> Loop:
        """Return the loop in coordinates x = T x_s, rates in units of ``rate``."""
        inverse = np.linalg.inv(T)
        right = T if self.R is None else inverse.T
        E = {e: inverse @ p @ right for e, p in self.E.items()}
        C = {e: inverse @ p @ right / rate for e, p in self.C.items()}
        R = self.R and {e: inverse @ p @ inverse.T for e, p in self.R.items()}
        return Loop(E, C, self.domain, R)

    def restored(self, Q: Array, T: Array) -> Array:
        """Return Q in the original coordinates."""
        left = T if self.R is None else np.linalg.inv(T).T
        back = left @ Q @ left.T
        return np.asarray((back + back.T) / 2)


def _degree(P: Polynomial, domain: Domain) -> int:
    return sum(next(iter(P))[: domain.sizes[0]])


def lyapunov(loop: Loop, target: Target, degree: int = 0, elevation: int = 0) -> Pencil:
    """Build the condition for Lyapunov polynomials Q of a degree; see the module's text."""
    domain, n = loop.domain, len(next(iter(loop.E.values())))
    pencil = Builder("lyapunov")
    unknowns = domain.monomials(degree)
    Q = [pencil.symmetric(f"Q{k + 1}", n) for k in range(len(unknowns))]
    E, C = (elevated(P, domain, elevation) for P in (loop.E, loop.C))
    X, N = products(E, Q, loop, degree), products(C, Q, loop, degree)
    if loop.R is not None:
        scalars = [pencil.full(f"s{k + 1}", (1, 1), "") for k in range(len(unknowns))]
        extra = _degree(loop.R, domain)
        for total, P in ((X, E), (N, C)):
            for e, more in multiples(elevated(P, domain, extra), scalars, domain, degree).items():
                total[e] = total.get(e, Linear()) + more
    for e in domain.monomials(loop.degree + degree + elevation):
        name = block_name(e, domain, -1, -1)
        for number, side in enumerate(target.sides):
            label = name if len(target.sides) == 1 else f"{name}, part {number + 1}"
            pencil.region(label, X[e], N[e], side)
        if target.positive:
            pencil.positive_definite(f"X at {name}", X[e])
    return pencil.build()


def products(P: Polynomial, Q: list[Linear], loop: Loop, degree: int) -> dict[Exponent, Linear]:
    """Return the coefficients of P Q R, linear in Q."""
    found: dict[tuple[Exponent, int, int], Array] = {}
    right = loop.rights
    weights = [binomial(loop.domain.sizes, e) for e in loop.domain.monomials(degree)]
    for d, p in P.items():
        for k, own in enumerate(loop.domain.monomials(degree)):
            for i, (e, _) in enumerate(right):
                key = tuple(a + b + c for a, b, c in zip(d, own, e, strict=True)), k, i
                found[key] = found[key] + weights[k] * p if key in found else weights[k] * p
    result: dict[Exponent, Linear] = {}
    for (e, k, i), left in found.items():
        term = Term(Q[k].terms[0].name, left, right[i][1])
        result[e] = result.get(e, Linear()) + Linear((term,))
    return result


def multiples(
    P: Polynomial, scalars: list[Linear], domain: Domain, degree: int
) -> dict[Exponent, Linear]:
    """Return the coefficients of P times a scalar polynomial of these unknowns."""
    result: dict[Exponent, Linear] = {}
    units = _units(next(iter(P.values())).shape[1])
    for scalar, own in zip(scalars, domain.monomials(degree), strict=True):
        weight = binomial(domain.sizes, own)
        for d, p in P.items():
            e = tuple(map(add, d, own))
            terms = (
                Term(scalar.terms[0].name, weight * column[:, None], unit)
                for column, unit in zip(p.T, units, strict=True)
            )
            result[e] = result.get(e, Linear()) + Linear(tuple(terms))
    return result


@cache
def _units(n: int) -> tuple[Array, ...]:
    return tuple(np.eye(n)[:, k : k + 1] for k in range(n))
