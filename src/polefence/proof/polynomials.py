"""Matrix polynomials on products of simplices, homogeneous in each, held in whole numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, combinations_with_replacement, product
from operator import mul
from typing import Any

from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    Rationals,
    bits,
    common_denominator,
    plus,
    times,
    transposed,
    whole_numbers,
)
from polefence.proof.short import Short
from polefence.proof.work import MAX_HELD, WorkError, spend

MAX_DEGREE = 16  # of any polynomial, in each simplex
COORDINATES = 2  # of an exponent, which are added at the cost of one operation

Exponent = tuple[int, ...]
Sizes = tuple[int, ...]  # corners of each simplex
Terms = dict[Exponent, Integers]


@dataclass(frozen=True)
class Polynomial(Short):
    """A matrix polynomial: ``terms`` are its monomials' coefficients times ``whole`` > 0.

    ``sizes`` has the corners of each simplex, ``degrees`` the degree in each. Exponents of all
    simplices stand one after the other; a monomial without a term has the coefficient zero.
    """

    terms: Terms
    sizes: Sizes
    degrees: tuple[int, ...]
    whole: int = 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        matrix = next(iter(self.terms.values()))
        return len(matrix), len(matrix[0])

    def __mul__(self, other: Polynomial) -> Polynomial:
        """Return the product; a polynomial of one entry multiplies matrices of any shape."""
        multiply = _weighted if self.shape == (1, 1) else _product
        return self._with(
            multiply(self.terms, other.terms),
            tuple(map(int.__add__, self.degrees, other.degrees)),
            self.whole * other.whole,
        )

    def half_times(self, other: Polynomial) -> Polynomial:
        """Return a product that is known to be symmetric: half of it is computed."""
        return self._with(
            _product(self.terms, other.terms, half=True),
            tuple(map(int.__add__, self.degrees, other.degrees)),
            self.whole * other.whole,
        )

    def inner(self, other: Polynomial) -> Polynomial:
        """Return the sum of the products of entries in the same place, tr P' R of P and R."""
        row = {e: [[x for xs in matrix for x in xs]] for e, matrix in self.terms.items()}
        column = {e: [[x] for xs in matrix for x in xs] for e, matrix in other.terms.items()}
        return self._with(row) * other._with(column)

    def __add__(self, other: Polynomial) -> Polynomial:
        degrees, whole = joint([self, other]), math.lcm(self.whole, other.whole)
        one, two = (P.raised(degrees).over(whole) for P in (self, other))
        return self._with(_sum(one, two), degrees, whole)

    def __neg__(self) -> Polynomial:
        return self.times(-1)

    def __sub__(self, other: Polynomial) -> Polynomial:
        return self + -other

    @property
    def T(self) -> Polynomial:
        """The transpose."""
        return self._with({e: transposed(matrix) for e, matrix in self.terms.items()})

    def times(self, factor: Fraction | int) -> Polynomial:
        """Return a multiple."""
        factor = Fraction(factor)
        terms = _multiple(factor.numerator, self.terms)
        return self._with(terms, whole=self.whole * factor.denominator)

    def part(self, rows: slice, columns: slice = slice(None)) -> Polynomial:
        """Return some rows and columns."""
        return self._with(
            {e: [row[columns] for row in matrix[rows]] for e, matrix in self.terms.items()}
        )

    def beside(self, M: Rationals) -> Polynomial:
        """Return the Kronecker product M (x) P with a constant matrix."""
        unit = common_denominator([M], 2 * MAX_BITS)
        left = whole_numbers(M, unit)
        entries = len(left) * len(left[0]) * math.prod(self.shape) * len(self.terms)
        spend(entries, bits(left), self.bits)
        terms = {
            e: [[m * x for m in ms for x in xs] for ms in left for xs in matrix]
            for e, matrix in self.terms.items()
        }
        return self._with(terms, whole=self.whole * unit)

    def raised(self, degrees: tuple[int, ...]) -> Polynomial:
        """Return the same polynomial times powers of the sums of coordinates, of these degrees."""
        terms, start = self.terms, 0
        for size, present, wanted in zip(self.sizes, self.degrees, degrees, strict=True):
            for _ in range(wanted - present):
                terms = _elevated(terms, range(start, start + size))
            start += size
        return self._with(terms, degrees)

    def elevated(self, by: int) -> Polynomial:
        """Return the same polynomial, raised by so much in each simplex."""
        return self.raised(tuple(degree + by for degree in self.degrees))

    def over(self, whole: int) -> Terms:
        """Return the terms times a multiple of ``self.whole``."""
        return _multiple(whole // self.whole, self.terms)

    def derivative(self, coordinate: int) -> Polynomial:
        """Return the derivative by a coordinate, of one degree less in its simplex."""
        terms: Terms = {}
        for e, matrix in self.terms.items():
            if e[coordinate]:
                lower = (*e[:coordinate], e[coordinate] - 1, *e[coordinate + 1 :])
                _add(terms, lower, times(e[coordinate], matrix))
        ends = [sum(self.sizes[: f + 1]) for f in range(len(self.sizes))]
        factor = next(f for f, end in enumerate(ends) if coordinate < end)
        return self._with(
            terms, tuple(max(d - (f == factor), 0) for f, d in enumerate(self.degrees))
        )

    def composed(self, forms: Sequence[Polynomial], sizes: Sizes) -> Polynomial:
        """Return it with forms (1 x 1, in each simplex of one degree) in place of coordinates.

        They are polynomials on simplices of ``sizes``; of degree zero none is needed.
        """
        whole, start = self.whole, 0
        powers, degrees = list[Terms](), (0,) * len(sizes)
        for size, degree in zip(self.sizes, self.degrees, strict=True):
            group, start = forms[start : start + size], start + size
            common = math.lcm(*(form.whole for form in group))
            powers += [form.over(common) for form in group] or [{}] * size
            if degree:
                pairs = zip(degrees, group[0].degrees, strict=True)
                degrees = tuple(a + degree * b for a, b in pairs)
                whole *= common**degree
        return Polynomial(_composed(self.terms, powers, sum(sizes)), sizes, degrees, whole)

    def at_end(self, last: bool) -> Polynomial:
        """Return it at one of the two corners of its last simplex, without that simplex."""
        degree = self.degrees[-1]
        kept = (0, degree) if last else (degree, 0)
        terms = {e[:-2]: M for e, M in self.terms.items() if e[-2:] == kept}
        none = [[0] * self.shape[1]] * self.shape[0]
        terms = terms or {next(iter(self.terms))[:-2]: none}
        return Polynomial(terms, self.sizes[:-1], self.degrees[:-1], self.whole)

    def widened(self) -> Polynomial:
        """Return it with a further simplex of two corners, along which it does not change."""
        terms = {(*e, 0, 0): M for e, M in self.terms.items()}
        return Polynomial(terms, (*self.sizes, 2), (*self.degrees, 0), self.whole)

    @property
    def bits(self) -> int:
        """Length of the longest entry."""
        return _longest(self.terms)

    def _with(
        self, terms: Terms, degrees: tuple[int, ...] | None = None, whole: int | None = None
    ) -> Polynomial:
        degrees = self.degrees if degrees is None else degrees
        return Polynomial(terms, self.sizes, degrees, self.whole if whole is None else whole)


def bernstein(
    coefficients: Sequence[Rationals],
    sizes: Sizes,
    degrees: int | tuple[int, ...],
    limit: int = 2 * MAX_BITS,
) -> Polynomial:
    """Return the polynomial with these Bernstein coefficients, in the order of `monomials_of`."""
    degrees = (degrees,) * len(sizes) if isinstance(degrees, int) else degrees
    whole = common_denominator(coefficients, limit)
    pairs = zip(monomials_of(sizes, degrees), coefficients, strict=True)
    terms = {e: times(multinomial(e, sizes), whole_numbers(c, whole)) for e, c in pairs}
    return Polynomial(terms, sizes, degrees, whole)


def affine(vertices: Sequence[Rationals], sizes: Sizes) -> Polynomial:
    """Return what has these values at the vertices: of degree 1, or 0 if all are the same."""
    if all(matrix == vertices[0] for matrix in vertices):
        return constant(vertices[0], sizes)
    return bernstein(vertices, sizes, 1)


def constant(matrix: Rationals, sizes: Sizes) -> Polynomial:
    """Return a matrix as a polynomial of degree zero."""
    return bernstein([matrix], sizes, 0)


def number(value: Fraction | int, sizes: Sizes) -> Polynomial:
    """Return a number as a polynomial of one entry."""
    return constant([[Fraction(value)]], sizes)


def diagonal(values: Sequence[Fraction], sizes: Sizes) -> Polynomial:
    """Return a diagonal matrix."""
    zero = Fraction(0)
    rows = [[v if i == j else zero for j in range(len(values))] for i, v in enumerate(values)]
    return constant(rows, sizes)


def form(f: int, values: tuple[int, ...], sizes: Sizes, whole: int = 1) -> Polynomial:
    """Return the form of these values at the corners of simplex f, over ``whole``."""
    start, length = sum(sizes[:f]), sum(sizes)
    terms = {
        tuple(int(j == start + c) for j in range(length)): [[value]]
        for c, value in enumerate(values)
        if value
    }
    return Polynomial(terms, sizes, tuple(int(g == f) for g in range(len(sizes))), whole)


def below(upper: Polynomial, lower: Polynomial) -> Polynomial:
    """Return one polynomial's rows above another's."""
    degrees, whole = joint([upper, lower]), math.lcm(upper.whole, lower.whole)
    one, two = (P.raised(degrees).over(whole) for P in (upper, lower))
    none = [[[0] * P.shape[1] for _ in range(P.shape[0])] for P in (upper, lower)]
    keys = dict.fromkeys([*one, *two])
    terms = {e: [*one.get(e, none[0]), *two.get(e, none[1])] for e in keys}
    return Polynomial(terms, upper.sizes, degrees, whole)


def side_by_side(polynomials: Sequence[Polynomial]) -> Polynomial:
    """Return polynomials' columns beside one another; those without columns are left out."""
    turned = [P.T for P in polynomials if P.shape[1]]
    whole = turned[0]
    for P in turned[1:]:
        whole = below(whole, P)
    return whole.T


def corners_of(sizes: Sizes) -> int:
    """Return the number of vertices of the family."""
    return math.prod(sizes)


def joint(polynomials: Sequence[Polynomial]) -> tuple[int, ...]:
    """Return the least degrees that all can be raised to."""
    return tuple(map(max, zip(*(P.degrees for P in polynomials), strict=True)))


def symmetric(
    rows: list[list[Polynomial]], degrees: tuple[int, ...]
) -> Iterator[tuple[Exponent, Integers]]:
    """Yield each coefficient of a symmetric matrix of blocks, times one positive integer.

    ``rows`` holds the blocks on the diagonal and to its right; all are raised to ``degrees``.
    """
    whole = math.lcm(*(form.whole for row in rows for form in row))
    shapes = [[form.shape for form in row] for row in rows]
    forms = {id(form): form for row in rows for form in row}  # one may stand in many places
    raised = {key: form.raised(degrees).over(whole) for key, form in forms.items()}
    upper = [[raised[id(form)] for form in row] for row in rows]

    def at(e: Exponent, i: int, k: int) -> Integers:
        high, wide = shapes[i][k]
        return upper[i][k].get(e) or [[0] * wide for _ in range(high)]

    for e in monomials_of(rows[0][0].sizes, degrees):
        matrix: Integers = []
        for i, row in enumerate(rows):
            left = [transposed(at(e, k, i - k)) for k in range(i)]
            both = [*left, *(at(e, i, k) for k in range(len(row)))]
            matrix += [list(chain(*parts)) for parts in zip(*both, strict=True)]
        yield e, matrix


def monomials(sizes: Sizes, degree: int) -> list[Exponent]:
    """Return the exponents of the monomials of a degree in each simplex, in the file's order.

    Fewest corners first, then by exponents from the largest down, then by corners; in a product
    the first simplex varies slowest.
    """
    return monomials_of(sizes, (degree,) * len(sizes))


def monomials_of(sizes: Sizes, degrees: tuple[int, ...]) -> list[Exponent]:
    """Return the exponents of the monomials of these degrees."""
    exponents = (_simplex(size, degree) for size, degree in zip(sizes, degrees, strict=True))
    return [sum(parts, ()) for parts in product(*exponents)]


def _simplex(size: int, degree: int) -> list[Exponent]:
    spend(math.comb(size - 1 + degree, degree) * (size // COORDINATES + degree + 1), 0)

    def rank(chosen: Exponent) -> Any:
        order = sorted(set(chosen), key=lambda j: (-chosen.count(j), j))
        return len(order), [-chosen.count(j) for j in order], order

    powers = []
    for chosen in sorted(combinations_with_replacement(range(size), degree), key=rank):
        power = [0] * size
        for j in chosen:
            power[j] += 1
        powers.append(tuple(power))
    return powers


def count_of(sizes: Sizes, degrees: int | tuple[int, ...]) -> int:
    """Return the number of monomials."""
    powers = (degrees,) * len(sizes) if isinstance(degrees, int) else degrees
    pairs = zip(sizes, powers, strict=True)
    return math.prod(math.comb(size - 1 + degree, degree) for size, degree in pairs)


def multinomial(exponent: Exponent, sizes: Sizes) -> int:
    """Return the multinomial coefficient of a monomial, the product over the simplices."""
    value, start = 1, 0
    for size in sizes:
        powers = exponent[start : start + size]
        start += size
        value *= math.factorial(sum(powers))
        for power in powers:
            value //= math.factorial(power)
    return value


def coordinates(alpha: list[Fraction], sizes: Sizes) -> list[Fraction]:
    """Return the coordinates in each simplex, one after the other, of weights of the vertices.

    Raises
    ------
    ValueError
        If they are those of no point of the product.
    """
    if len(sizes) == 1:
        return alpha
    ends: list[Fraction] = []
    for f in range(len(sizes)):
        bit = len(sizes) - 1 - f
        high = sum((a for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        ends += [1 - high, high]
    for a, corner in zip(alpha, monomials(sizes, 1), strict=True):
        if a != math.prod(x for x, power in zip(ends, corner, strict=True) if power):
            raise ValueError("alpha is not a product of points of the parameters' intervals")
    return ends


def basis(at: list[Fraction], sizes: Sizes, degree: int) -> list[Fraction]:
    """Return the values of the Bernstein polynomials at coordinates."""
    return [
        math.prod((x**p for x, p in zip(at, e, strict=True)), start=Fraction(1))
        * multinomial(e, sizes)
        for e in monomials(sizes, degree)
    ]


# --- terms ---------------------------------------------------------------------------------------


def _longest(P: Terms) -> int:
    entries = chain.from_iterable(chain.from_iterable(P.values()))
    return max(map(int.bit_length, entries), default=0)


def _hold(matrices: int, entries: int, length: int) -> None:
    if matrices * entries * (36 + length // 7) > MAX_HELD:
        raise WorkError("its polynomials are too large to be checked here; take fewer parameters")


def _spend_exponents(count: int, P: Terms) -> None:
    spend(count * len(next(iter(P), ())) // COORDINATES, 0)


def _add(P: Terms, exponent: Exponent, matrix: Integers) -> None:
    P[exponent] = plus(P[exponent], matrix) if exponent in P else matrix


def _sum(P: Terms, Q: Terms) -> Terms:
    result = dict(P)
    for e, matrix in Q.items():
        _add(result, e, matrix)
    return result


def _multiple(factor: int, P: Terms) -> Terms:
    if factor == 1:
        return P
    entries = sum(len(matrix) * len(matrix[0]) for matrix in P.values())
    spend(entries, factor.bit_length(), _longest(P))
    return {e: times(factor, matrix) for e, matrix in P.items()}


def _product(P: Terms, Q: Terms, half: bool = False) -> Terms:
    """Multiply matrix polynomials, entries with rows; of a symmetric product half is computed.

    The numbers of a row are digits of one number, in a base that no digit of the result exceeds.
    """
    left, right = _longest(P), _longest(Q)
    none: Integers = [[]]
    one, other = next(iter(P.values()), none), next(iter(Q.values()), none)
    columns = len(other[0])
    entries = len(one) * (len(one) + 1) // 2 if half else len(one) * columns
    spend(len(P) * len(Q) * entries * len(one[0]), left, right)
    _spend_exponents(len(P) * len(Q), P)
    # sums of at most so many products, and a sign
    width = left + right + (min(len(P), len(Q)) * len(other)).bit_length() + 1
    size = width // 8 + 1
    firsts = [i if half else 0 for i in range(len(one))]
    packed: dict[Exponent, list[int]] = {}
    rows = {e: transposed([_packed(row, size) for row in q]) for e, q in Q.items()}
    for d, p in P.items():
        for e, q in rows.items():
            target = tuple(map(int.__add__, d, e))
            both = [sum(map(mul, row, q[i])) for i, row in zip(firsts, p, strict=True)]
            known = packed.get(target)
            packed[target] = both if known is None else list(map(int.__add__, known, both))
        _hold(len(packed), len(one) * columns, left + right)
    result = {
        e: [_unpacked(x, size, columns - i) for i, x in zip(firsts, both, strict=True)]
        for e, both in packed.items()
    }
    return {e: _mirrored(upper) for e, upper in result.items()} if half else result


def _packed(row: Sequence[int], size: int) -> list[int]:
    """Return the sums of x_k 2^(8 size (k - i)) over k >= i, of each i."""
    sums = [0]
    for x in reversed(row):
        sums.append((sums[-1] << 8 * size) + x)
    return sums[:0:-1] or sums


def _unpacked(value: int, size: int, count: int) -> list[int]:
    """Return the x_k of the first sum of `_packed`, less than 2^(8 size - 1) in magnitude."""
    half = 1 << 8 * size - 1
    # with half a base added to each digit none is negative
    shifted = value + half * (((1 << 8 * size * count) - 1) // ((1 << 8 * size) - 1))
    digits = shifted.to_bytes(size * count, "little")
    return [
        int.from_bytes(digits[k : k + size], "little") - half for k in range(0, size * count, size)
    ]


def _mirrored(upper: Integers) -> Integers:
    """Return a symmetric matrix of its rows from the diagonal on."""
    every = range(len(upper))
    return [[upper[min(i, j)][abs(i - j)] for j in every] for i in every]


def _weighted(weights: Terms, X: Terms) -> Terms:
    """Multiply by a polynomial of one entry."""
    result: Terms = {}
    entries = sum(len(matrix) * len(matrix[0]) for matrix in X.values())
    spend(len(weights) * entries, _longest(weights), _longest(X))
    _spend_exponents(len(weights) * len(X), X)
    for d, ((weight,),) in weights.items():
        for e, matrix in X.items():
            _add(result, tuple(map(int.__add__, d, e)), times(weight, matrix))
    return result


def _elevated(P: Terms, simplex: range) -> Terms:
    """Multiply by the sum of a simplex's coordinates."""
    none: Integers = [[]]
    one, length = next(iter(P.values()), none), _longest(P)
    spend(len(P) * len(simplex) * len(one) * len(one[0]), length)
    _spend_exponents(len(P) * len(simplex), P)
    _hold(len(P) * len(simplex), len(one) * len(one[0]), length)
    result: Terms = {}
    for e, matrix in P.items():
        for j in simplex:
            _add(result, (*e[:j], e[j] + 1, *e[j + 1 :]), matrix)
    return result


def _composed(P: Terms, forms: list[Terms], length: int) -> Terms:
    """Put forms in place of coordinates; ``length`` is that of the result's exponents."""
    products: dict[Exponent, Terms] = {(0,) * len(forms): {(0,) * length: [[1]]}}

    def monomial(e: Exponent) -> Terms:
        if e not in products:
            j = next(j for j, power in enumerate(e) if power)
            products[e] = _product(forms[j], monomial((*e[:j], e[j] - 1, *e[j + 1 :])))
        return products[e]

    result: Terms = {}
    for e, matrix in P.items():
        values, entries = monomial(e), len(matrix) * len(matrix[0])
        spend(len(values) * entries, max(map(bits, values.values()), default=0), bits(matrix))
        _spend_exponents(len(values), values)
        for d, ((value,),) in values.items():
            _add(result, d, times(value, matrix))
    return result


def restricted(
    coefficients: Sequence[Rationals],
    degree: int,
    low: Sequence[Fraction],
    high: Sequence[Fraction],
) -> list[Rationals]:
    """Return the Bernstein coefficients, on a part of the box, of a polynomial on the box.

    Parameters
    ----------
    low, high : sequences of Fraction
        Weights of each parameter's upper end, from 0 to 1.
    """
    sizes, forms = (2,) * len(low), list[Polynomial]()
    for k, ends in enumerate(zip(low, high, strict=True)):
        unit = math.lcm(*(end.denominator for end in ends))
        upper = [int(end * unit) for end in ends]
        lower = [unit - value for value in upper]
        forms += [form(k, (a, b), sizes, unit) for a, b in (lower, upper)]
    whole = bernstein(list(coefficients), sizes, degree, MAX_BITS)
    inner, (rows, columns) = whole.composed(forms, sizes), whole.shape
    none = [[Fraction(0)] * columns] * rows
    terms = {
        e: [[Fraction(x, inner.whole * multinomial(e, sizes)) for x in row] for row in M]
        for e, M in inner.terms.items()
    }
    return [terms.get(e, none) for e in monomials(sizes, degree)]
