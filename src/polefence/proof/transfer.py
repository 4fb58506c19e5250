r"""Bounds on a gain or an rms from the transfer function itself: no Lyapunov matrix.

With a scheduled law's W (W = I of other laws), N = A W + B Z and Y = C W + D Z,

    G(s) = Y (s W - N)^-1 E + F = b(s) / a(s),    a(s) = det(s W - N),

has coefficients that are polynomials in the parameters' coordinates t, each from 0 to 1. They are
computed exactly, by interpolation between as many nodes as their degrees need. A claim then says
that some polynomials are positive on a box: of t, and for a gain of the frequency too.

**Gain.** P(w^2, t) = det(g^2 I - G(jw)*G(jw)) |a(jw)|^2 is a polynomial of degree n in w^2. If it
is positive for all w >= 0, w = oo too, and all t, then the gain is less than g, and no pole lies on
the imaginary axis: where w falls from oo, at which g^2 I - F'F > 0, an eigenvalue of G*G would have
to pass g^2 before it is infinite, and a pole that G does not show makes P zero as well. So all
poles are to the left for all t if they are for one.

**Rms.** Under noise of intensity S the variance is S N(t) / D(t), with D = 2 a_0 det H and N =
-(-1)^n det H_g: H is the Hurwitz matrix of a, and H_g the same with the coefficients of b(s) b(-s)
for its first row (Newton, Gould & Kaiser, 1957, appendix E). D is not zero unless two poles add up
to zero (Orlando, 1911): where it is positive for all t, and all poles are to the left for one t,
they are for all. Then g^2 D - S N > 0 bounds the rms.

In discrete time all this is of the loop after the bilinear map of the delta form, d = w / (1 - w T
/ 2), of which the gain is the same; the variance is that of G / (1 + w T / 2).

A polynomial is positive on a box if its Bernstein coefficients there are. Where one is not, the box
is halved along the axis with the largest second difference. Coefficients are rounded down to
`DIGITS` bits below the largest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import pairwise, product
from operator import add, mul
from typing import NamedTuple

from polefence.proof.matrices import (
    LONGEST,
    MAX_BITS,
    Integers,
    Rationals,
    bits,
    common_denominator,
    is_positive_definite,
    multiplied,
    plus,
    right_divide,
    times,
    whole_numbers,
)
from polefence.proof.polynomials import Exponent, Polynomial, Terms, joint
from polefence.proof.regions import HalfPlane
from polefence.proof.roots import roots_inside
from polefence.proof.work import RATIONAL, FormatError, spend

DIGITS = 400  # bits that coefficients keep; each halving loses one part in 2^DIGITS

Row = list[Fraction]
Numbers = list[int]
Ends = tuple[Fraction, Fraction | None]  # of frequencies; the latter None where it is infinite
ALL: Ends = (Fraction(0), None)


class Tensor(NamedTuple):
    """Numbers on a grid: ``values`` over ``whole``, with the last axis fastest, of ``shape``."""

    values: Numbers
    shape: tuple[int, ...]
    whole: int = 1

    @classmethod
    def of(cls, values: Row, shape: tuple[int, ...]) -> Tensor:
        """Return the tensor of these rationals over their common denominator."""
        whole = common_denominator([[values]], LONGEST)
        return cls(whole_numbers([values], whole)[0], shape, whole)

    def along(self, axis: int, matrix: Sequence[Row]) -> Tensor:
        """Return the tensor with a matrix applied along one axis."""
        count, inner = self.shape[axis], math.prod(self.shape[axis + 1 :])
        unit = common_denominator([list(matrix)], LONGEST)
        rows, values = whole_numbers(list(matrix), unit), self.values
        spend(len(values) * len(rows), bits([values]), bits(rows))
        transformed: Numbers = []
        for start in range(0, len(values), count * inner):
            block = values[start : start + count * inner]
            lines = [block[k::inner] for k in range(inner)]
            for row in rows:
                transformed += [sum(map(mul, row, line)) for line in lines]
        shape = (*self.shape[:axis], len(rows), *self.shape[axis + 1 :])
        return Tensor(transformed, shape, self.whole * unit)

    def on_nodes(self, degrees: Sequence[int]) -> Tensor:
        """Interpolate the polynomial, and return its values at the nodes of other degrees."""
        tensor, first = self, len(self.shape) - len(degrees)
        for axis, degree in enumerate(degrees, first):
            if tensor.shape[axis] != degree + 1:
                tensor = tensor.along(axis, between(tensor.shape[axis] - 1, degree))
        return tensor


def require_few(degrees: Sequence[int], times: int = 1) -> None:
    """Refuse polynomials with too many coefficients or too high a degree."""
    count = math.prod(d + 1 for d in degrees) * times
    if count > 60_000 or max(degrees, default=0) > 60:
        raise FormatError("the transfer function has too many coefficients to be checked here")


def nodes(degree: int) -> Row:
    """Return equal nodes from 0 to 1."""
    return [Fraction(k, degree) for k in range(degree + 1)] if degree else [Fraction(0)]


@lru_cache(maxsize=256)
def between(degree: int, wanted: int) -> list[Row]:
    """Return the matrix from values at the nodes of one degree to those of another."""
    known = nodes(degree)
    return [_lagrange(known, t) for t in nodes(wanted)]


def _lagrange(known: Row, t: Fraction) -> Row:
    """Return the values at t of the Lagrange polynomials of these nodes."""
    return [
        math.prod(((t - y) / (x - y) for y in known if y != x), start=Fraction(1)) for x in known
    ]


@lru_cache(maxsize=64)
def to_bernstein(degree: int) -> list[Row]:
    """Return the matrix from values at nodes to Bernstein coefficients.

    Column j is the Lagrange polynomial of node j, in products of t and 1 - t.
    """
    known, columns, zero = nodes(degree), list[Row](), Fraction(0)
    for x in known:
        column = [Fraction(1)]
        for y in known:
            if y != x:  # times (t - y) / (x - y), t - y = (1 - y) t - y (1 - t)
                up, down = (1 - y) / (x - y), -y / (x - y)
                column = [
                    down * a + up * b for a, b in zip([*column, zero], [zero, *column], strict=True)
                ]
        columns.append([c / math.comb(degree, k) for k, c in enumerate(column)])
    return [list(row) for row in zip(*columns, strict=True)]


# --- the transfer function -----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Transfer:
    """a(s) and b(s), all outputs by all disturbances, as values at nodes of the parameters.

    Attributes
    ----------
    a : Tensor
        Of shape (n + 1, nodes ...), highest power of s first.
    b : tuple of tuples of Tensor
        b[i][j] is from disturbance j to output i, of the same shape. Its coefficient of s^n is
        F a. All have the same ``whole``.
    step : Fraction
        Sample time of the delta form that was mapped by `bilinear`; zero in continuous time.
    unit : int
        Factor on s that shortens the coefficients.
    beside : Transfer, optional
        The transfer function of another loop, to compare with.
    """

    a: Tensor
    b: tuple[tuple[Tensor, ...], ...]
    step: Fraction = Fraction(0)
    unit: int = 1
    beside: Transfer | None = None

    @property
    def n(self) -> int:
        """Degree of a in s."""
        return self.a.shape[0] - 1

    @property
    def degrees(self) -> tuple[int, ...]:
        """Degree of the coefficients in every parameter."""
        return tuple(size - 1 for size in self.a.shape[1:])

    @property
    def scale(self) -> Fraction:
        """Factor from b / a in the whole numbers of `at` to the transfer function."""
        return Fraction(self.a.whole, self.b[0][0].whole)

    def at(self, degrees: Sequence[int]) -> Iterator[tuple[Numbers, list[list[Numbers]]]]:
        """Yield whole-number multiples of a and b at every node, the last parameter fastest."""
        require_few(degrees, self.n + 1)
        count = math.prod(d + 1 for d in degrees)
        a = self.a.on_nodes(degrees)
        b = [[entry.on_nodes(degrees) for entry in row] for row in self.b]
        for k in range(count):
            yield a.values[k::count], [[entry.values[k::count] for entry in row] for row in b]

    @property
    def positive(self) -> Transfer:
        """The same transfer function with the leading coefficient of a positive at the first node.

        Both a and b are multiplied by the sign.
        """
        if self.a.values[0] >= 0:
            return self
        same = [[Fraction(-int(i == j)) for j in range(self.n + 1)] for i in range(self.n + 1)]
        return self.along(0, same)

    @cached_property
    def first(self) -> tuple[Numbers, list[list[Numbers]]]:
        """Multiples of a and b at the first node, t = 0."""
        return next(self.at(self.degrees))

    @property
    def is_stable(self) -> bool:
        """Whether all poles have Re s < 0 at the first node, for the loop ``beside`` too."""
        a = self.first[0]
        if self.beside is not None and not self.beside.is_stable:
            return False
        return bool(a[0]) and roots_inside(a, (HalfPlane(Fraction(0)),))

    @property
    def square(self) -> Fraction:
        """The sum of the variances for unit noise at the first node."""
        D, N = self.variance
        return Fraction(N.values[0] * D.whole, D.values[0] * N.whole)

    def along(self, axis: int, matrix: Sequence[Row], other: Sequence[Row] = ()) -> Transfer:
        """Apply a matrix along one axis of a and b; ``other``, where given, is applied to b."""
        b = tuple(tuple(entry.along(axis, other or matrix) for entry in row) for row in self.b)
        return replace(self, a=self.a.along(axis, matrix), b=b)

    def bilinear(self, step: Fraction) -> Transfer:
        """Substitute d = w / (1 - w step / 2); a step of zero changes nothing."""
        if not step:
            return self
        step = step / self.unit
        n, half = self.n, -step / 2
        # d^k (1 - w T/2)^n = w^k (1 - w T/2)^(n - k), the highest power of w first
        rows = [[Fraction(0)] * (n + 1) for _ in range(n + 1)]
        for j in range(n + 1):  # of d^(n - j)
            for i in range(j + 1):
                rows[j - i][j] = math.comb(j, i) * half**i
        return replace(self.along(0, rows), step=step)

    def inside(self, t: Sequence[Fraction]) -> Transfer:
        """Return the transfer function at one point of the parameters' box."""
        point = self
        for axis, x in enumerate(t, 1):
            point = point.along(axis, [_lagrange(nodes(point.a.shape[axis] - 1), x)])
        return replace(point, beside=self.beside.inside(t)) if self.beside else point

    @cached_property
    def variance(self) -> tuple[Tensor, Tensor]:
        """D and N at the nodes: for unit noise the variances sum to N / D.

        Raises
        ------
        FormatError
            If a disturbance passes straight through.
        """
        filtered = self._filtered.positive
        degrees = [(filtered.n + 1) * d for d in filtered.degrees]
        below, above = Numbers(), Numbers()
        for a, b in filtered.at(degrees):
            g = [0] * filtered.n
            for numerator in (x for row in b for x in row):
                if numerator[0]:
                    raise FormatError("white noise passes straight into an output")
                spend(len(numerator) ** 2, bits([numerator]), bits([numerator]))
                g = list(map(add, g, _even(numerator[1:])))
            one, other = _minors(_hurwitz(a), g)
            below.append(2 * a[0] * one)
            above.append((-1) ** (filtered.n + 1) * other)
        shape, scale = tuple(d + 1 for d in degrees), filtered.scale**2 / filtered.unit
        return Tensor(below, shape, scale.numerator), Tensor(above, shape, scale.denominator)

    @property
    def _filtered(self) -> Transfer:
        """The transfer function over (1 + w step / 2); a step of zero changes nothing."""
        if not self.step:
            return self
        n, half = self.n, self.step / 2
        rows = [[Fraction(0)] * (n + 1) for _ in range(n + 2)]
        for j in range(n + 1):
            rows[j][j], rows[j + 1][j] = half, Fraction(1)
        same = [[Fraction(int(i == j)) for j in range(n + 1)] for i in range(-1, n + 1)]
        return self.along(0, rows, same)


def transfer(
    W: Polynomial,
    N: Polynomial,
    Y: Polynomial,
    E: Polynomial,
    F: Polynomial | None,
    power: int = 1,
) -> Transfer:
    """Return Y (s W - N)^-1 E + F for polynomials on a box, or constants.

    Parameters
    ----------
    power : int
        Degree, in the coefficients of a and b, of the polynomial that is checked for positivity.

    Raises
    ------
    FormatError
        If W is singular at a node, or there are too many nodes.
    """
    degrees = _degrees(W, N, Y, E, F)
    n, p, q = W.shape[0], Y.shape[0], E.shape[1]
    require_few(degrees, n + 1)
    require_few([power * d for d in degrees])  # before any is computed
    resolved = []
    for t in product(*map(nodes, degrees)):
        w, m, y, e = (_value(polynomial, t) for polynomial in (W, N, Y, E))
        resolved.append(_resolved(w, m, y, e, None if F is None else _value(F, t)))
    shape, unit = (n + 1, *(d + 1 for d in degrees)), math.lcm(*(node[2] for node in resolved))
    # of a law's own W denominators of N W^-1 are far longer than those of a
    plain = common_denominator([[node[0]] for node in resolved], LONGEST)
    if unit.bit_length() > min(MAX_BITS, 1 + 2 * plain.bit_length() // n):
        unit = 1
    powers = [Fraction(1, unit**k) for k in range(n + 1)]
    a = Tensor.of([node[0][k] / powers[k] for k in range(n + 1) for node in resolved], shape)
    entries = [(i, j) for i in range(p) for j in range(q)]
    rows = [
        [node[1][i][j][k] / powers[k] for k in range(n + 1) for node in resolved]
        for i, j in entries
    ]
    whole = common_denominator([rows], LONGEST)
    b = [Tensor(row, shape, whole) for row in whole_numbers(rows, whole)]
    through = tuple(tuple(b[i * q : (i + 1) * q]) for i in range(p))
    return _trimmed(Transfer(a, through, unit=unit))


def _trimmed(loop: Transfer) -> Transfer:
    """Drop nodes that the actual degrees do not need; low rank makes these less than the bound."""
    tensors = [loop.a, *(x for row in loop.b for x in row)]
    for axis, degree in enumerate(loop.degrees, 1):
        least = max((_degree_along(x, axis) for x in tensors), default=0) if degree else 0
        if least < degree:
            loop = loop.along(axis, between(degree, least))
    return loop


def _degree_along(tensor: Tensor, axis: int) -> int:
    """Return the degree along an axis, by differences of the values at equal nodes."""
    count, inner = tensor.shape[axis], math.prod(tensor.shape[axis + 1 :])
    most = 0
    spend(len(tensor.values) * count, bits([tensor.values]))
    for start in range(0, len(tensor.values), count * inner):
        for k in range(inner):
            line, order = tensor.values[start + k : start + count * inner : inner], 0
            while any(x != line[0] for x in line):
                line, order = [y - x for x, y in pairwise(line)], order + 1
            most = max(most, order)
    return most


def _degrees(
    W: Polynomial, N: Polynomial, Y: Polynomial, E: Polynomial, F: Polynomial | None
) -> tuple[int, ...]:
    """Return a bound on the degree of a and b in each parameter.

    They are determinants of M(t) = [ s W - N, E_j; Y_i, F_ij ], and a minor. With V_k the span of
    all columns of the coefficients of t^k and higher powers, constant steps of elimination leave
    dim V_k rows of degree k or more: the degree of det M is at most dim V_1 + dim V_2 + ..., and
    likewise with rows in place of columns.
    """
    n, p, q, bounds = W.shape[0], Y.shape[0], E.shape[1], list[int]()
    both, degrees = _bordered(W, N, Y, E, F)
    for axis, degree in enumerate(degrees):
        powers = [_coefficients(both, axis, k) for k in range(degree, 0, -1)]
        columns = [
            [
                [
                    list(column)
                    for M in coefficients
                    for column in zip(*M[:n], M[n + i], strict=True)
                ]
                for coefficients in powers
            ]
            for i in range(p)
        ]
        rows = [
            [[[*row[:n], row[n + j]] for M in coefficients for row in M] for coefficients in powers]
            for j in range(q)
        ]
        bounds.append(min(max(map(_dimensions, columns)), max(map(_dimensions, rows))))
    return tuple(bounds)


def _bordered(
    W: Polynomial, N: Polynomial, Y: Polynomial, E: Polynomial, F: Polynomial | None
) -> tuple[list[Terms], tuple[int, ...]]:
    """Return the terms of [ W, 0; 0, 0 ] and [ -N, E; Y, F ], and their degrees.

    Both have one common denominator. Where there are no parameters the degrees are empty.
    """
    every = [W, N, Y, E] + ([] if F is None else [F])
    degrees, whole = joint(every), math.lcm(*(polynomial.whole for polynomial in every))
    w, m, y, x, *f = (polynomial.raised(degrees).over(whole) for polynomial in every)
    n, p, q = W.shape[0], Y.shape[0], E.shape[1]

    def entries(terms: Terms, e: Exponent, rows: int, columns: int) -> Integers:
        return terms.get(e) or [[0] * columns for _ in range(rows)]

    first = {e: [*([*row, *(0,) * q] for row in M), *([0] * (n + q),) * p] for e, M in w.items()}
    second: Terms = {}
    for e in dict.fromkeys((*m, *y, *x, *(f[0] if f else ()))):
        above = zip(entries(m, e, n, n), entries(x, e, n, q), strict=True)
        below = zip(entries(y, e, p, n), entries(f[0] if f else {}, e, p, q), strict=True)
        second[e] = [[*(-z for z in left), *right] for left, right in above]
        second[e] += [[*left, *right] for left, right in below]
    return [first, second], degrees if W.sizes != (1,) else ()


def _coefficients(blocks: list[Terms], axis: int, power: int) -> list[Integers]:
    """Return the coefficients of t^power in one parameter, one per monomial in the others.

    Terms are in powers of 1 - t and t.
    """
    sums: dict[tuple[int, Exponent], Integers] = {}
    for k, terms in enumerate(blocks):
        for e, M in terms.items():
            low, high = e[2 * axis], power - e[2 * axis + 1]
            if 0 <= high <= low:
                term = times((-1) ** high * math.comb(low, high), M)
                others = (k, (*e[: 2 * axis], *e[2 * axis + 2 :]))
                sums[others] = plus(sums[others], term) if others in sums else term
    return list(sums.values())


def _dimensions(levels: list[list[Numbers]]) -> int:
    """Return dim span(list 1) + dim span(lists 1 and 2) + ..., over all the lists."""
    basis, total = dict[int, Numbers](), 0
    for vectors in levels:
        for vector in vectors:
            if len(basis) == len(vector):
                break
            reduced = vector
            for pivot, other in basis.items():
                if reduced[pivot]:
                    spend(3 * len(reduced), bits([reduced]), bits([other]))
                    one, two = other[pivot], reduced[pivot]
                    reduced = [one * x - two * y for x, y in zip(reduced, other, strict=True)]
            if any(reduced):
                common = math.gcd(*reduced)
                reduced = [x // common for x in reduced]
                basis[next(k for k, x in enumerate(reduced) if x)] = reduced
        total += len(basis)
    return total


def _value(polynomial: Polynomial, t: Sequence[Fraction]) -> tuple[Integers, int]:
    """Return whole numbers and their denominator: the polynomial's value at a point of the box."""
    at = [x for u in t for x in (u.denominator - u.numerator, u.numerator)]
    powers = zip(t, polynomial.degrees, strict=False)
    whole = polynomial.whole * math.prod(u.denominator**d for u, d in powers)
    length = sum(u.denominator.bit_length() for u in t) * max(polynomial.degrees, default=1)
    rows, columns = polynomial.shape
    spend(len(polynomial.terms) * (len(at) + rows * columns), polynomial.bits, length)
    total = [[0] * columns for _ in range(rows)]
    for e, matrix in polynomial.terms.items():
        weight = math.prod(x**p for x, p in zip(at, e, strict=True)) if at else 1
        if weight:
            total = plus(total, times(weight, matrix))
    common = math.gcd(whole, *(x for row in total for x in row))
    return [[x // common for x in row] for row in total], whole // common


def _resolved(
    W: tuple[Integers, int],
    N: tuple[Integers, int],
    Y: tuple[Integers, int],
    E: tuple[Integers, int],
    F: tuple[Integers, int] | None,
) -> tuple[Row, list[list[Row]], int]:
    """Return a, b and N's denominator at one point, by the Faddeev-LeVerrier recursion."""
    n, scale = len(W[0]), Fraction(1)
    if any(W[0][i][j] != W[1] * (i == j) for i in range(n) for j in range(n)):
        exact_W = _over(W)
        both = right_divide(_over(N) + _over(Y), exact_W)
        if both is None:
            raise FormatError("W is singular")
        units = [common_denominator([M], LONGEST) for M in (both[:n], both[n:])]
        N = whole_numbers(both[:n], units[0]), units[0]
        Y, scale = (whole_numbers(both[n:], units[1]), units[1]), _determinant(exact_W)
    (M, whole), (left, below), (right, beside) = N, Y, E
    length = n * bits(M)
    spend(n**4, length // 2 + 1, bits(M))
    power = [[int(i == j) for j in range(n)] for i in range(n)]
    a = [scale]
    moved: list[list[Row]] = [[[Fraction(0)] for _ in right[0]] for _ in left]
    for k in range(1, n + 1):
        unit = whole ** (k - 1) * below * beside
        for i, row in enumerate(multiplied(multiplied(left, power), right)):
            for j, x in enumerate(row):
                moved[i][j].append(scale * Fraction(x, unit))
        power = multiplied(M, power)
        trace = -sum(power[i][i] for i in range(n)) // k  # divides exactly
        for i in range(n):
            power[i][i] += trace
        a.append(scale * Fraction(trace, whole**k))
    if F is not None:
        spend(RATIONAL * len(F[0]) * len(F[0][0]) * n, length, 64)
        for i, through in enumerate(_over(F)):
            for j, f in enumerate(through):
                if f:
                    moved[i][j] = [x + f * y for x, y in zip(moved[i][j], a, strict=True)]
    return a, moved, whole


def _over(scaled: tuple[Integers, int]) -> Rationals:
    """Return whole numbers over their denominator."""
    return [[Fraction(x, scaled[1]) for x in row] for row in scaled[0]]


def _determinant(matrix: Rationals) -> Fraction:
    """Return the determinant, by fraction-free elimination."""
    n, whole = len(matrix), common_denominator([matrix], LONGEST)
    rows, previous, sign = whole_numbers(matrix, whole), 1, 1
    length = n * bits(rows)
    spend(n**3, length, length // 2)
    for p in range(n):
        pivot = next((i for i in range(p, n) if rows[i][p]), None)
        if pivot is None:
            return Fraction(0)
        if pivot != p:
            rows[p], rows[pivot], sign = rows[pivot], rows[p], -sign
        pivot_row = rows[p]
        for i in range(p + 1, n):
            factor = rows[i][p]
            rows[i] = [
                (pivot_row[p] * x - factor * y) // previous
                for x, y in zip(rows[i], pivot_row, strict=True)
            ]
        previous = pivot_row[p]
    return Fraction(sign * previous, whole**n)


# --- polynomials that are to be positive ---------------------------------------------------------


def gain_polynomial(loop: Transfer, level: Fraction, ends: Ends = ALL) -> Tensor:
    """Return the Bernstein coefficients of P, in v = w^2 / (w^2 + u^2) and t.

    Parameters
    ----------
    ends : pair of Fraction
        Between which w is; the latter None where that is infinite.
    """
    degrees, square = _gain_degrees(loop), (level / loop.scale) ** 2
    return _over_frequencies(
        loop, degrees, [_difference(*x, square) for x in loop.at(degrees)], ends
    )


def pole_polynomial(loop: Transfer) -> Tensor:
    """Return the Bernstein coefficients of |a|^2, as `gain_polynomial` does those of P."""
    degrees = [2 * _degree_along(loop.a, k) for k in range(1, len(loop.degrees) + 1)]
    require_few(degrees, loop.n + 1)
    count, a = math.prod(d + 1 for d in degrees), loop.a.on_nodes(degrees)
    length = bits([a.values])
    spend(count * (loop.n + 1) ** 2, length, length)
    squares = [list(map(Fraction, _modulus(a.values[k::count]))) for k in range(count)]
    return _over_frequencies(loop, degrees, squares)


def _over_frequencies(
    loop: Transfer, degrees: Sequence[int], columns: Sequence[Row], ends: Ends = ALL
) -> Tensor:
    """Return Bernstein coefficients of what is known in powers of x = w^2 at nodes of t.

    Between two places p_0 / q_0 and p_1 / q_1 of x it is, times the n-th power of a denominator
    that is positive, a polynomial in r from 0 to 1:

        x = (p_0 (1 - r) + p_1 r) / (q_0 (1 - r) + q_1 r).
    """
    n, unit = loop.n, Fraction(4) ** _exponent(loop.first[0])
    values = [column[k] for k in range(n + 1) for column in columns]
    tensor = Tensor.of(values, (n + 1, *(d + 1 for d in degrees)))
    low, high = (_placed(None if w is None else (w * loop.unit) ** 2, unit) for w in ends)
    whole = common_denominator([[[*low, *high]]], LONGEST)
    places = [int(x * whole) for x in (*low, *high)]
    spend(n**3, n * bits([places]), bits([places]))
    tensor = tensor.along(0, _between_places(n, *places))
    for axis, d in enumerate(degrees, 1):
        tensor = tensor.along(axis, to_bernstein(d))
    return tensor


def _placed(x: Fraction | None, unit: Fraction) -> tuple[Fraction, Fraction]:
    """Return p and q with x = p / q, of which p + q unit is about unit; None is infinite.

    So r is nearly linear in x / (x + unit). A q that is a power of two keeps numbers short.
    """
    if x is None:
        return unit, Fraction(0)
    share = unit / (x + unit)
    q = Fraction(2) ** (share.numerator.bit_length() - share.denominator.bit_length())
    return x * q, q


@lru_cache(maxsize=64)
def _between_places(n: int, p_0: int, q_0: int, p_1: int, q_1: int) -> list[Row]:
    """Return the matrix from powers of x to Bernstein coefficients between two places."""
    columns = []
    for j in range(n + 1):
        column = [1]
        for first, second in [(p_0, p_1)] * j + [(q_0, q_1)] * (n - j):
            pairs = zip([*column, 0], [0, *column], strict=True)
            column = [first * a + second * b for a, b in pairs]
        columns.append([Fraction(c, math.comb(n, k)) for k, c in enumerate(column)])
    return [list(row) for row in zip(*columns, strict=True)]


def _gain_degrees(loop: Transfer) -> list[int]:
    """Return the degree of P in each parameter.

    P |a|^(2 (r - 1)) = det(g^2 |a|^2 I - b*b) of r = min(p, q) rows; degrees of factors add up.
    """
    r = min(len(loop.b), len(loop.b[0]))
    return [2 * (r * d - (r - 1) * _degree_along(loop.a, k)) for k, d in enumerate(loop.degrees, 1)]


def passes(loop: Transfer, level: Fraction) -> bool:
    """Whether g^2 I - F'F > 0 at the first node."""
    a, b = loop.first
    F = [[loop.scale * Fraction(x[0], a[0]) for x in row] for row in b]
    q, length = len(F[0]), bits([a]) + max(bits(row) for row in b)
    spend(RATIONAL * q * q * len(F), length, length)
    rest = [
        [level * level * int(i == j) - sum(row[i] * row[j] for row in F) for j in range(q)]
        for i in range(q)
    ]
    return is_positive_definite(whole_numbers(rest, common_denominator([rest], LONGEST)))


def passes_at(loop: Transfer, level: Fraction, w: Fraction) -> bool:
    """Whether g^2 I - G*G > 0 at a frequency, at the first node."""
    (a, b), x, q = loop.first, w * loop.unit, len(loop.b[0])
    G = [[imaginary_value(entry, x) for entry in row] for row in b]
    re, im = imaginary_value(a, x)
    size = (level / loop.scale) ** 2 * (re * re + im * im)
    length = loop.n * max(bits([[x.numerator, x.denominator]]), 1) + bits([a])
    spend(RATIONAL * q * q * len(G), length, length)
    columns = list(zip(*G, strict=True))
    rows, below = list[Row](), list[Row]()
    for i, u in enumerate(columns):
        inner, outer = Row(), Row()
        for v in columns:
            pairs = list(zip(u, v, strict=True))
            inner.append(sum((a * c + b * d for (a, b), (c, d) in pairs), Fraction(0)))
            outer.append(sum((a * d - b * c for (a, b), (c, d) in pairs), Fraction(0)))
        left = [size * (i == j) - x for j, x in enumerate(inner)]
        # R - j S is positive where [R, S; -S, R] is
        rows.append([*left, *outer])
        below.append([*(-x for x in outer), *left])
    rows += below
    return is_positive_definite(whole_numbers(rows, common_denominator([rows], LONGEST)))


def imaginary_value(c: Numbers, x: Fraction) -> tuple[Fraction, Fraction]:
    """Return real and imaginary part of a polynomial, highest power first, at s = j x."""
    re = im = Fraction(0)
    spend(RATIONAL * len(c), bits([c]), 64)
    for coefficient in c:
        re, im = coefficient - x * im, x * re
    return re, im


def _exponent(a: Numbers) -> int:
    """Return e such that 4^e is near the geometric mean of the poles' squared moduli."""
    if not a[0] or not a[-1]:
        return 0
    return (a[-1].bit_length() - a[0].bit_length()) // (len(a) - 1)


def _difference(a: Numbers, b: list[list[Numbers]], square: Fraction) -> Row:
    """Return the coefficients of det(g^2 I - G*G) |a|^2 in w^2, lowest power first."""
    length = bits([a]) + square.numerator.bit_length()
    spend(len(a) ** 2 * (1 + sum(map(len, b))), length, length)
    if min(len(b), len(b[0])) > 1:
        return _by_nodes(a, b, square)
    total = [square.numerator * x for x in _modulus(a)]
    for numerator in (x for row in b for x in row):
        total = [
            x - square.denominator * y for x, y in zip(total, _modulus(numerator), strict=True)
        ]
    return [Fraction(x) for x in total]


def _modulus(c: Numbers) -> Numbers:
    """Return |c(jw)|^2 in powers of w^2, lowest first; c has its highest power first."""
    low = c[::-1]
    even = [x if k % 2 == 0 else -x for k, x in enumerate(low[::2])]
    odd = [x if k % 2 == 0 else -x for k, x in enumerate(low[1::2])]
    powers = [0] * len(c)
    for part, shift in ((even, 0), (odd, 1)):
        for i, x in enumerate(part):
            if x:
                for j, y in enumerate(part):
                    powers[i + j + shift] += x * y
    return powers


def _by_nodes(a: Numbers, b: list[list[Numbers]], square: Fraction) -> Row:
    """Interpolate the same for matrices b from its values at real s, where w^2 = -s^2."""
    if len(b) < len(b[0]):  # det(g^2 I - G G*) differs by a power of g^2
        b = [list(column) for column in zip(*b, strict=True)]
    n, q, root = len(a) - 1, len(b[0]), Fraction(2) ** _exponent(a)
    at, values, k = Row(), Row(), 0
    while len(at) <= n:
        k += 1
        s = root * k / 2
        one, other = _horner(a, s), _horner(a, -s)
        if not one or not other:
            continue
        length = one.numerator.bit_length() + one.denominator.bit_length()
        spend(RATIONAL * q * q * len(b), length, length)
        ahead, back = ([[_horner(x, z) for x in row] for row in b] for z in (s, -s))
        H = [
            [
                square * one * other * int(i == j)
                - sum(u[i] * v[j] for u, v in zip(back, ahead, strict=True))
                for j in range(q)
            ]
            for i in range(q)
        ]
        at.append(-s * s)
        values.append(_determinant(H) / (one * other) ** (q - 1))
    return _interpolated(at, values)


def _horner(c: Numbers, s: Fraction) -> Fraction:
    total = Fraction(0)
    spend(RATIONAL * len(c), bits([c]), 64)
    for x in c:
        total = total * s + x
    return total


def _interpolated(at: Row, values: Row) -> Row:
    """Return the polynomial through points, lowest power first, by divided differences."""
    table, count = list(values), len(at)
    length = max(x.numerator.bit_length() + x.denominator.bit_length() for x in values)
    spend(RATIONAL * count**2, length, length)
    for order in range(1, count):
        for i in range(count - 1, order - 1, -1):
            table[i] = (table[i] - table[i - 1]) / (at[i] - at[i - order])
    powers = [table[-1]]
    for x, c in zip(at[-2::-1], table[-2::-1], strict=True):
        powers = [c - x * powers[0]] + [
            (low - x * high) for low, high in zip(powers, [*powers[1:], Fraction(0)], strict=True)
        ]
    return powers


def _even(b: Numbers) -> Numbers:
    """Return b(s) b(-s) in powers of s^2, highest first."""
    n = len(b)
    powers = [0] * n
    for i, x in enumerate(b):
        if x:
            for j, y in enumerate(b):
                if (i + j) % 2 == 0 and y:
                    powers[(i + j) // 2] += -x * y if (n - 1 - j) % 2 else x * y
    return powers


def _hurwitz(a: Numbers) -> list[Numbers]:
    """Return the Hurwitz matrix: a_(2j - i + 1) in row i and column j, counted from zero."""
    n = len(a) - 1
    return [
        [a[2 * j - i + 1] if 0 <= 2 * j - i + 1 <= n else 0 for j in range(n)] for i in range(n)
    ]


def _minors(H: list[Numbers], g: Numbers) -> tuple[int, int]:
    """Return det H, and det of H with its first row replaced by g, by one elimination.

    The leading minors of the rows below the first are positive where all poles are to the left.
    Half the rows begin with zeros: until something is taken from one, the elimination would only
    multiply it by one pivot and divide it by the one before.
    """
    n, rows, previous = len(H), [*H[1:], H[0], g], 1
    whole = [True] * (n + 1)  # rows of which nothing was taken, and which are times previous
    for p in range(n - 1):
        if whole[p]:
            rows[p] = [previous * x for x in rows[p]]
        pivot_row = rows[p]
        pivot = pivot_row[p]
        spend(3 * (n - p) * (n - p - 1), pivot.bit_length(), bits([pivot_row]))
        if not pivot:
            return tuple(int(_determinant(M)) for M in _with_first(H, g))  # type: ignore[return-value]
        after = pivot_row[p + 1 :]
        for i in range(p + 1, n + 1):
            row, factor = rows[i], rows[i][p]
            if whole[i] and not factor:
                continue
            pairs = zip(row[p + 1 :], after, strict=True)
            if whole[i]:
                ahead = [pivot * x - factor * y for x, y in pairs]
            else:
                ahead = [(pivot * x - factor * y) // previous for x, y in pairs]
            rows[i], whole[i] = row[: p + 1] + ahead, False
        previous = pivot
    for i in (n - 1, n):
        if whole[i]:
            rows[i] = [previous * x for x in rows[i]]
    sign = (-1) ** (n - 1)
    return sign * rows[n - 1][n - 1], sign * rows[n][n - 1]


def _with_first(H: list[Numbers], g: Numbers) -> tuple[Rationals, Rationals]:
    one, other = ([[Fraction(x) for x in row] for row in M] for M in (H, [g, *H[1:]]))
    return one, other


def bernstein_of(tensor: Tensor) -> Tensor:
    """Return the Bernstein coefficients of a polynomial given by its values at the nodes."""
    for axis, size in enumerate(tensor.shape):
        tensor = tensor.along(axis, to_bernstein(size - 1))
    return tensor


def combined(one: Tensor, p: Fraction, other: Tensor, q: Fraction) -> Tensor:
    """Return p times one plus q times the other, at the same nodes."""
    p, q = p / one.whole, q / other.whole
    whole = math.lcm(p.denominator, q.denominator)
    left, right = int(p * whole), int(q * whole)
    spend(2 * len(one.values), bits([one.values]), left.bit_length())
    pairs = zip(one.values, other.values, strict=True)
    return Tensor([left * x + right * y for x, y in pairs], one.shape, whole)


def product_of(one: Tensor, other: Tensor) -> Tensor:
    """Return the product at the same nodes."""
    spend(len(one.values), bits([one.values]), bits([other.values]))
    values = list(map(mul, one.values, other.values))
    return Tensor(values, one.shape, one.whole * other.whole)


# --- positive on a box ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Positive:
    """Whether a polynomial is shown to be positive on its box, and in how many parts."""

    proved: bool
    parts: int


def positive(tensor: Tensor) -> Positive:
    """Decide whether the polynomial with these Bernstein coefficients is positive on the box.

    Parts of the box are halved until all coefficients are positive. A corner where the polynomial
    is zero or negative refutes it.

    Raises
    ------
    FormatError
        If the work exceeds its bound.
    """
    degrees = tuple(size - 1 for size in tensor.shape)
    open_, parts, corners = [_cut(tensor.values)], 0, _corners(tensor.shape)
    slices = [_slices(tensor.shape, axis) for axis in range(len(degrees))]
    while open_:
        values = open_.pop()
        parts += 1
        if min(values) > 0:
            continue
        if min(values[index] for index in corners) <= 0:
            return Positive(False, parts)
        spend(len(values) * (2 * len(degrees) + max(degrees)), DIGITS)
        axis = max(range(len(degrees)), key=lambda k: _bend(values, slices[k]))
        open_ += _halved(values, slices[axis], degrees[axis])
    return Positive(True, parts)


def _cut(values: Numbers) -> Numbers:
    """Round the values down to `DIGITS` bits, up to a common power of two."""
    shift = bits([values]) - DIGITS
    spend(len(values), DIGITS + max(shift, 0))
    return [x >> shift for x in values] if shift > 0 else values


def _corners(shape: tuple[int, ...]) -> Numbers:
    """Return the index of the value at every corner."""
    places = [0]
    for size in shape:
        places = [k * size + end for k in places for end in {0, size - 1}]
    return places


Slices = list[list[slice]]


def _slices(shape: tuple[int, ...], axis: int) -> Slices:
    """Return, for each block, the slices at each place along an axis."""
    inner, count = math.prod(shape[axis + 1 :]), shape[axis]
    blocks = range(0, math.prod(shape), inner * count)
    return [
        [slice(start + k * inner, start + (k + 1) * inner) for k in range(count)]
        for start in blocks
    ]


def _bend(values: Numbers, slices: Slices) -> int:
    """Return the largest second difference along an axis, times its degree."""
    most = 0
    for block in slices:
        lines = [values[s] for s in block]
        for a, b, c in zip(lines, lines[1:], lines[2:], strict=False):
            most = max(most, *(abs(x - 2 * y + z) for x, y, z in zip(a, b, c, strict=True)))
    return most * (len(slices[0]) - 1)


def _halved(values: Numbers, slices: Slices, degree: int) -> tuple[Numbers, Numbers]:
    """Return the coefficients of both halves along an axis, rounded down (de Casteljau)."""
    first, second = values[:], values[:]
    for block in slices:
        lines = [values[s] for s in block]
        for k in range(degree + 1):
            first[block[k]] = [x >> k for x in lines[0]]
            second[block[degree - k]] = [x >> k for x in lines[-1]]
            lines = [list(map(add, a, b)) for a, b in pairwise(lines)]
    return first, second
