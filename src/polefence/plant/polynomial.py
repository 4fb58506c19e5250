"""Matrix polynomials on a simplex, or on the product of simplices that a box of parameters is.

A family of N vertices without parameters lives on one simplex of N corners. One with p independent
parameters lives on p simplices of two corners each (an interval in barycentric coordinates), alpha
being their Kronecker product. Polynomials are homogeneous in each simplex and given by their
Bernstein coefficients, so that equal coefficients mean a constant; `Domain.monomials` says in
which order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement, product
from operator import add
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.system import Array
from polefence.proof.laws import DOMAINS
from polefence.proof.short import Short

Exponent = tuple[int, ...]
Polynomial = dict[Exponent, Array]  # coefficients of monomials


@dataclass(frozen=True)
class Domain(Short):
    """A product of simplices.

    Attributes
    ----------
    sizes : tuple of int
        Corners of each simplex.
    """

    sizes: tuple[int, ...]

    @classmethod
    def of(cls, on: str, N: int) -> Domain:
        """Return the simplex of N corners, or the box of which N vertices are the corners.

        Raises
        ------
        InputError
            If N is no power of two, for a box.
        """
        if on not in DOMAINS:
            raise InputError(f"on = {on!r} is unknown; use 'simplex' or 'box'")
        if on == "box" and N & (N - 1):
            raise InputError(
                f"on = 'box': {N} vertices are not the corners of a box; use on = 'simplex'"
            )
        return cls((N,) if on == "simplex" or N == 1 else (2,) * (N.bit_length() - 1))

    @property
    def corners(self) -> int:
        """Number of vertices of the family."""
        return math.prod(self.sizes)

    @property
    def on(self) -> str:
        """What files call it: "box", or "simplex"."""
        return "box" if len(self.sizes) > 1 else "simplex"

    def count(self, degree: int) -> int:
        """Return the number of monomials of a degree in each simplex."""
        return math.prod(math.comb(size - 1 + degree, degree) for size in self.sizes)

    def monomials(self, degree: int) -> tuple[Exponent, ...]:
        """Return the exponents of all monomials of a degree in each simplex.

        In a simplex those with fewest corners come first, then the largest exponents, then the
        first corners; in a product the first simplex varies slowest.
        """
        return _monomials(self.sizes, degree)

    def basis(self, alpha: Any, degree: int) -> Array:
        """Return the Bernstein polynomials' values at alpha (..., N), as (..., count).

        For a box, alpha is taken at its marginals: those of a product are its factors.
        """
        a = np.asarray(alpha, dtype=float)
        if degree == 1 and len(self.sizes) == 1:
            return a
        parts = np.split(self.coordinates(a), np.cumsum(self.sizes)[:-1], axis=-1)
        basis, *others = (_bernstein(part, degree) for part in parts)
        for other in others:
            basis = (basis[..., :, None] * other[..., None, :]).reshape(*a.shape[:-1], -1)
        return np.asarray(basis)

    def coordinates(self, alpha: Array) -> Array:
        """Return the coordinates in each simplex, side by side."""
        if len(self.sizes) == 1:
            return alpha
        table = alpha.reshape(*alpha.shape[:-1], *self.sizes)
        axes = range(alpha.ndim - 1, table.ndim)
        marginals = [table.sum(axis=tuple(b for b in axes if b != axis)) for axis in axes]
        return np.concatenate(marginals, axis=-1)

    def alpha(self, coordinates: Array) -> Array:
        """Return alpha for coordinates in each simplex: their Kronecker product."""
        cuts = np.cumsum(self.sizes)[:-1]
        first, *others = np.split(coordinates, cuts, axis=-1)
        for other in others:
            first = (first[..., :, None] * other[..., None, :]).reshape(*first.shape[:-1], -1)
        return np.asarray(first)

    def nodes(self, degree: int) -> Array:
        """Return as many points alpha as there are Bernstein polynomials of a degree, (count, N).

        Corners among them: extrema of Chebyshev's polynomials on each interval, a lattice on a
        simplex of more corners.
        """
        return self.alpha(_nodes(self.sizes, degree))

    def interpolated(self, values: Array, degree: int) -> Array:
        """Return the Bernstein coefficients (count, ...) of what has these values at the nodes."""
        table = values.reshape(1, -1)
        for size in self.sizes:  # the nodes are products of each simplex's
            inverse = _from_nodes(size, degree)
            table = inverse @ table.reshape(*table.shape[:-1], len(inverse), -1)
            table = table.reshape(-1, table.shape[-1])
        return np.asarray(table.reshape(values.shape))

    def elevated(self, degree: int, times: int) -> list[dict[int, int]]:
        """Return for each monomial of the raised degree which Bernstein coefficients enter it.

        That is the coefficient, as {number of a Bernstein coefficient: integer}, of the polynomial
        times (sum of coordinates)^times for each simplex.
        """
        return _elevated(self.sizes, degree, times)

    def pairs(self, degree: int, elevation: int) -> list[dict[tuple[int, int], int]]:
        """Return for each monomial of degree + 1 + elevation the weights of products A_j X_k.

        j is a corner (A is of degree 1 in each simplex), k a Bernstein coefficient of X.
        """
        return _pairs(self.sizes, degree, elevation)


def _bernstein(a: Array, degree: int) -> Array:
    """Return the Bernstein polynomials' values at points (..., size) of one simplex."""
    exponents, weights = _weighted(a.shape[-1], degree)
    return np.asarray(np.prod(a[..., None, :] ** exponents, axis=-1) * weights)


@cache
def _weighted(size: int, degree: int) -> tuple[Array, Array]:
    """Exponents (count, size) of the monomials on a simplex, and their binomial coefficients."""
    exponents = np.array(_simplex(size, degree)).reshape(-1, size)
    weights = [binomial((size,), tuple(e)) for e in exponents.tolist()]
    return _kept(exponents), _kept(np.array(weights, dtype=float))


@cache
def _from_nodes(size: int, degree: int) -> Array:
    """What takes values at the nodes of one simplex to Bernstein coefficients."""
    one = Domain((size,))
    return _kept(np.asarray(np.linalg.inv(one.basis(one.nodes(degree), degree)), dtype=float))


def _kept(array: Array) -> Array:
    """Return an array that nobody changes."""
    array.setflags(write=False)
    return array


@cache
def _nodes(sizes: tuple[int, ...], degree: int) -> Array:
    columns = []
    for size in sizes:
        if size == 2:
            turns = np.pi * np.arange(degree + 1) / degree if degree else np.full(1, np.pi / 2)
            low = (1 + np.cos(turns)) / 2
            columns.append(np.stack([low, 1 - low], axis=1))
        elif degree:
            columns.append(np.array(_simplex(size, degree)) / degree)
        else:
            columns.append(np.full((1, size), 1 / size))
    return np.array([np.concatenate(parts) for parts in product(*columns)])


@cache
def _monomials(sizes: tuple[int, ...], degree: int) -> tuple[Exponent, ...]:
    return tuple(sum(parts, ()) for parts in product(*(_simplex(size, degree) for size in sizes)))


@cache
def _simplex(size: int, degree: int) -> list[Exponent]:
    powers = [
        tuple(chosen.count(j) for j in range(size))
        for chosen in combinations_with_replacement(range(size), degree)
    ]

    def rank(power: Exponent) -> Any:
        order = sorted((j for j in range(size) if power[j]), key=lambda j: (-power[j], j))
        return len(order), [-power[j] for j in order], order

    return sorted(powers, key=rank)


def bernstein(domain: Domain, coefficients: Array, degree: int) -> Polynomial:
    """Return the polynomial with these Bernstein coefficients (count, rows, columns)."""
    pairs = zip(domain.monomials(degree), coefficients, strict=True)
    return {e: binomial(domain.sizes, e) * c for e, c in pairs}


def degree_of(P: Polynomial, domain: Domain) -> int:
    """Return the degree in each simplex."""
    return sum(next(iter(P))[: domain.sizes[0]])


def values(P: Polynomial, domain: Domain, alpha: Array) -> Array:
    """Return a polynomial's values at points alpha (..., N), as (..., rows, columns)."""
    degree = degree_of(P, domain)
    scaled = [P[e] / binomial(domain.sizes, e) for e in domain.monomials(degree)]
    return np.asarray(np.tensordot(domain.basis(alpha, degree), np.array(scaled), 1))


def times(P: Polynomial, Q: Polynomial) -> Polynomial:
    """Return the product of matrix polynomials."""
    result: Polynomial = {}
    for d, p in P.items():
        for e, q in Q.items():
            both = tuple(map(add, d, e))
            result[both] = result[both] + p @ q if both in result else p @ q
    return result


def elevated(P: Polynomial, domain: Domain, degree: int) -> Polynomial:
    """Return the polynomial times (sum of coordinates)^degree, for each simplex."""
    result: Polynomial = {}
    for raised, weight in _multinomials(domain.sizes, degree):
        for e, p in P.items():
            both = tuple(map(add, e, raised))
            result[both] = result[both] + weight * p if both in result else weight * p
    return result


def binomial(sizes: tuple[int, ...], exponent: Exponent) -> int:
    """Return the product over simplices of the multinomial coefficient of the exponents."""
    value, start = 1, 0
    for size in sizes:
        powers = exponent[start : start + size]
        value *= math.factorial(sum(powers))
        for power in powers:
            value //= math.factorial(power)
        start += size
    return value


def _multinomials(sizes: tuple[int, ...], degree: int) -> Iterator[tuple[Exponent, int]]:
    """Yield the terms of (sum of coordinates)^degree, for each simplex."""
    for e in _monomials(sizes, degree):
        yield e, binomial(sizes, e)


@cache
def _elevated(sizes: tuple[int, ...], degree: int, times: int) -> list[dict[int, int]]:
    place = {e: i for i, e in enumerate(_monomials(sizes, degree + times))}
    table: list[dict[int, int]] = [{} for _ in place]
    for k, (e, weight) in enumerate(_multinomials(sizes, degree)):
        for raised, factor in _multinomials(sizes, times):
            row = table[place[tuple(map(add, e, raised))]]
            row[k] = row.get(k, 0) + weight * factor
    return table


@cache
def _pairs(sizes: tuple[int, ...], degree: int, elevation: int) -> list[dict[tuple[int, int], int]]:
    place = {e: i for i, e in enumerate(_monomials(sizes, degree + 1 + elevation))}
    table: list[dict[tuple[int, int], int]] = [{} for _ in place]
    for k, (e, weight) in enumerate(_multinomials(sizes, degree)):
        for j, corner in enumerate(_monomials(sizes, 1)):
            both = tuple(map(add, e, corner))
            for raised, factor in _multinomials(sizes, elevation):
                row = table[place[tuple(map(add, both, raised))]]
                row[j, k] = row.get((j, k), 0) + weight * factor
    return table
