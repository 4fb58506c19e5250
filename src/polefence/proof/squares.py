"""Polynomials of even degree that are sums of squares, in exact arithmetic.

A polynomial is a table of exponents and rationals. It is m'G m with m the odd monomials up to half
its degree, plus another with the even ones: every even monomial is a product of two of a basis, so
that matrices which say this nearly are changed a little to say it exactly.
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
    """Return the exponents of n variables up to a degree whose sums are all even, or all odd."""
    return [
        tuple(places.count(i) for i in range(n))
        for d in range(parity, degree + 1, 2)
        for places in combinations_with_replacement(range(n), d)
    ]


def bases(n: int, degree: int) -> list[list[Exponent]]:
    """Return the odd monomials and the even ones up to a degree, where there are any."""
    return [basis for parity in (1, 0) if (basis := monomials(n, degree, parity))]


def count_of(n: int, degree: int) -> int:
    """Return how many even monomials there are up to an even degree."""
    return sum(comb(n + d - 1, d) for d in range(0, degree + 1, 2))


def joined(e: Exponent, f: Exponent) -> Exponent:
    """Return the exponents of the product."""
    return tuple(a + b for a, b in zip(e, f, strict=True))


def of_form(Q: Rationals) -> Sparse:
    """Return x'Q x."""
    n = len(Q)
    return of_matrix(Q, [tuple(int(i == j) for j in range(n)) for i in range(n)])


def of_matrix(G: Rationals, basis: Sequence[Exponent]) -> Sparse:
    """Return m'G m."""
    found: Sparse = {}
    for i, row in enumerate(G):
        for j, value in enumerate(row):
            if value:
                e = joined(basis[i], basis[j])
                found[e] = found.get(e, Fraction(0)) + value
    return found


def times(f: Sparse, g: Sparse) -> Sparse:
    """Return the product."""
    found: Sparse = {}
    for e, a in f.items():
        for own, b in g.items():
            k = joined(e, own)
            found[k] = found.get(k, Fraction(0)) + a * b
    return found


def less(f: Sparse, g: Sparse) -> Sparse:
    """Return the difference."""
    found = dict(f)
    for e, b in g.items():
        found[e] = found.get(e, Fraction(0)) - b
    return found


def drift(V: Sparse, A: Rationals, W: Rationals) -> Sparse:
    """Return (grad V)'A x + (1/2) tr W (hess V)."""
    found: Sparse = {}
    for e, value in V.items():
        for i, row in enumerate(A):
            if not e[i]:
                continue
            once = moved(e, i, -1)
            for k, a in enumerate(row):
                if a:
                    _add(found, moved(once, k, 1), value * e[i] * a)
            for j, w in enumerate(W[i]):
                if w and once[j]:
                    _add(found, moved(once, j, -1), value * e[i] * once[j] * w / 2)
    return found


def moved(e: Exponent, i: int, by: int) -> Exponent:
    """Return the exponents with so much more of one variable."""
    return (*e[:i], e[i] + by, *e[i + 1 :])


def _add(found: Sparse, e: Exponent, value: Fraction) -> None:
    found[e] = found.get(e, Fraction(0)) + value


def completed(
    f: Sparse, grams: Sequence[Rationals], each: Sequence[Sequence[Exponent]]
) -> Iterator[Rationals]:
    """Yield the matrices, changed so that the sum of m'G m over the bases is exactly f.

    What is missing at a monomial is spread evenly over the entries that make it up. The bases are
    those of half the degree, so that every monomial of f has such entries.
    """
    often = Counter(joined(e, own) for basis in each for e in basis for own in basis)
    rest = dict(f)
    for G, basis in zip(grams, each, strict=True):
        rest = less(rest, of_matrix(G, basis))
    share = {e: value / often[e] for e, value in rest.items() if value}
    none = Fraction(0)
    for G, basis in zip(grams, each, strict=True):
        pairs = zip(G, basis, strict=True)
        yield [
            [g + share.get(joined(e, own), none) for g, own in zip(row, basis, strict=True)]
            for row, e in pairs
        ]
