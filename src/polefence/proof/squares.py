"""Polynomials of even degree that are sums of squares, in exact arithmetic.

A polynomial is a table from exponents to rationals. It is written as a sum of two forms m'G m: one
with the odd monomials m up to half its degree, one with the even ones. Every even monomial is a
product of two monomials of a basis. So a small change of G turns an approximate identity into an
exact one. A polynomial with odd monomials too is one form, of all monomials up to half its degree.

Forms and motions may have a last entry, that of the constant 1 behind the variables.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import combinations_with_replacement
from math import comb

from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import Exponent

Sparse = dict[Exponent, Fraction]


def monomials(n: int, degree: int, parity: int) -> list[Exponent]:
    """Return the exponents in n variables up to a degree, of even (0) or odd (1) total degree."""
    return [
        tuple(places.count(i) for i in range(n))
        for d in range(parity, degree + 1, 2)
        for places in combinations_with_replacement(range(n), d)
    ]


def known(n: int, degree: int, even: bool = True) -> list[Exponent]:
    """Return the monomials up to an even degree, one first: the even ones, or all."""
    whole = monomials(n, degree, 0)
    return whole if even else whole + monomials(n, degree, 1)


def bases(n: int, degree: int, even: bool = True) -> list[list[Exponent]]:
    """Return the odd and the even monomials up to a degree, or all; no basis is empty."""
    if not even:
        return [known(n, degree, False)]
    return [basis for parity in (1, 0) if (basis := monomials(n, degree, parity))]


def count_of(n: int, degree: int, even: bool = True) -> int:
    """Return the number of monomials up to an even degree: the even ones, or all."""
    return sum(comb(n + d - 1, d) for d in range(0, degree + 1, 2 if even else 1))


def joined(e: Exponent, f: Exponent) -> Exponent:
    """Return the exponents of the product."""
    return tuple(a + b for a, b in zip(e, f, strict=True))


def of_form(Q: Rationals) -> Sparse:
    """Return (x, 1)'Q (x, 1)."""
    n = len(Q) - 1
    return of_matrix(Q, [tuple(int(i == j) for j in range(n)) for i in range(n + 1)])


def of_matrix(G: Rationals, basis: Sequence[Exponent]) -> Sparse:
    """Return m'G m."""
    terms: Sparse = {}
    for i, row in enumerate(G):
        for j, value in enumerate(row):
            if value:
                e = joined(basis[i], basis[j])
                terms[e] = terms.get(e, Fraction(0)) + value
    return terms


def times(f: Sparse, g: Sparse) -> Sparse:
    """Return the product."""
    terms: Sparse = {}
    for e, a in f.items():
        for other, b in g.items():
            k = joined(e, other)
            terms[k] = terms.get(k, Fraction(0)) + a * b
    return terms


def less(f: Sparse, g: Sparse) -> Sparse:
    """Return the difference."""
    terms = dict(f)
    for e, b in g.items():
        terms[e] = terms.get(e, Fraction(0)) - b
    return terms


def drift(V: Sparse, A: Rationals, W: Rationals) -> Sparse:
    """Return (grad V)'A (x, 1) + (1/2) tr W (hess V)."""
    terms: Sparse = {}
    for e, value in V.items():
        for i, row in enumerate(A):
            if not e[i]:
                continue
            once = moved(e, i, -1)
            for k, a in enumerate(row):
                if a:
                    after = once if k == len(A) else moved(once, k, 1)
                    _add(terms, after, value * e[i] * a)
            for j, w in enumerate(W[i]):
                if w and once[j]:
                    _add(terms, moved(once, j, -1), value * e[i] * once[j] * w / 2)
    return terms


def moved(e: Exponent, i: int, by: int) -> Exponent:
    """Return the exponents with ``by`` added to that of variable i."""
    return (*e[:i], e[i] + by, *e[i + 1 :])


def _add(terms: Sparse, e: Exponent, value: Fraction) -> None:
    terms[e] = terms.get(e, Fraction(0)) + value


def completed(
    f: Sparse, grams: Sequence[Rationals], monomials_by_parity: Sequence[Sequence[Exponent]]
) -> Iterator[Rationals]:
    """Correct the matrices G so that the sum of m'G m over the bases is exactly f; yield them.

    The residual at a monomial is divided equally among the entries that contribute to it. The
    bases have half the degree of f, so that every monomial of f has such entries.
    """
    often = Counter(
        joined(e, other) for basis in monomials_by_parity for e in basis for other in basis
    )
    rest = dict(f)
    for G, basis in zip(grams, monomials_by_parity, strict=True):
        rest = less(rest, of_matrix(G, basis))
    share = {e: value / often[e] for e, value in rest.items() if value}
    none = Fraction(0)
    for G, basis in zip(grams, monomials_by_parity, strict=True):
        pairs = zip(G, basis, strict=True)
        yield [
            [g + share.get(joined(e, other), none) for g, other in zip(row, basis, strict=True)]
            for row, e in pairs
        ]
