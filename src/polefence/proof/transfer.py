r"""Bounds on a gain or an rms from the transfer function itself: no Lyapunov matrix.

With a scheduled law's W (W = I of other laws), N = A W + B Z and Y = C W + D Z,

    G(s) = Y (s W - N)^-1 E + F = b(s) / a(s),    a(s) = det(s W - N),

has coefficients that are polynomials in the parameters' coordinates t, each from 0 to 1. They are
computed exactly: at as many nodes as their degrees ask for, and interpolated. What is claimed is
then that some polynomials are positive on a box: of t, and for a gain of the frequency besides.

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
is halved along the axis along which the polynomial is bent most. Coefficients are cut, downwards,
to `DIGITS` bits below the largest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import pairwise, product
from operator import add, mul
from typing import NamedTuple

from polefence.proof.matrices import (
    LONGEST,
    Rationals,
    bits,
    common_denominator,
    is_positive_definite,
    multiplied,
    right_divide,
    whole_numbers,
)
from polefence.proof.polynomials import Polynomial
from polefence.proof.regions import HalfPlane
from polefence.proof.roots import roots_inside
from polefence.proof.work import RATIONAL, FormatError, spend

DIGITS = 400  # bits that coefficients keep; each halving loses one part in 2^DIGITS
MOST_COEFFICIENTS = 60_000  # of a polynomial that is to be positive
STABLE = (HalfPlane(Fraction(0)),)

Row = list[Fraction]


class Tensor(NamedTuple):
    """Numbers on a grid: ``values`` with the last axis fastest, of ``shape``."""

    values: list[Fraction]
    shape: tuple[int, ...]

    def along(self, axis: int, matrix: Sequence[Row]) -> Tensor:
        """Return it with a matrix applied along an axis."""
        count, inner = self.shape[axis], math.prod(self.shape[axis + 1 :])
        whole = common_denominator([list(matrix)], LONGEST)
        rows = whole_numbers(list(matrix), whole)
        own = common_denominator([[self.values]], LONGEST)
        (values,) = whole_numbers([self.values], own)
        spend(len(values) * len(rows), bits([values]), bits(rows))
        found: list[Fraction] = []
        for start in range(0, len(values), count * inner):
            block = values[start : start + count * inner]
            lines = [block[k::inner] for k in range(inner)]
            for row in rows:
                found += [Fraction(sum(map(mul, row, line)), whole * own) for line in lines]
        shape = (*self.shape[:axis], len(rows), *self.shape[axis + 1 :])
        return Tensor(found, shape)

    def on_nodes(self, degrees: Sequence[int]) -> Tensor:
        """Return values at nodes of other degrees, of a polynomial that has these at its own."""
        found, first = self, len(self.shape) - len(degrees)
        for axis, degree in enumerate(degrees, first):
            if found.shape[axis] != degree + 1:
                found = found.along(axis, between(found.shape[axis] - 1, degree))
        return found


def nodes(degree: int) -> Row:
    """Return equal nodes from 0 to 1."""
    return [Fraction(k, degree) for k in range(degree + 1)] if degree else [Fraction(0)]


@lru_cache(maxsize=256)
def between(degree: int, wanted: int) -> list[Row]:
    """Return what turns values at nodes of one degree into those at nodes of another."""
    known = nodes(degree)
    return [_lagrange(known, t) for t in nodes(wanted)]


def _lagrange(known: Row, t: Fraction) -> Row:
    """Return the values at t of the polynomials that are one at one node each."""
    return [
        math.prod(((t - y) / (x - y) for y in known if y != x), start=Fraction(1)) for x in known
    ]


@lru_cache(maxsize=64)
def to_bernstein(degree: int) -> list[Row]:
    """Return what turns values at nodes into Bernstein coefficients."""
    basis = [
        [math.comb(degree, k) * t**k * (1 - t) ** (degree - k) for k in range(degree + 1)]
        for t in nodes(degree)
    ]
    eye = [[Fraction(int(i == j)) for j in range(degree + 1)] for i in range(degree + 1)]
    found = right_divide(eye, basis)
    if found is None:
        raise FormatError("the nodes of a polynomial are not apart")
    return found


# --- the transfer function -----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Transfer:
    """a(s) and b(s), all outputs by all disturbances, as values at nodes of the parameters.

    Attributes
    ----------
    a : Tensor
        Of shape (n + 1, nodes ...), highest power of s first.
    b : tuple of tuples of Tensor
        Likewise; the first coefficient is that of F a.
    step : Fraction
        Of a delta form, of which this is the bilinear map [s]; zero in continuous time.
    """

    a: Tensor
    b: tuple[tuple[Tensor, ...], ...]
    step: Fraction = Fraction(0)

    @property
    def n(self) -> int:
        """Degree of a in s."""
        return self.a.shape[0] - 1

    @property
    def degrees(self) -> tuple[int, ...]:
        """Of all coefficients, in each parameter."""
        return tuple(size - 1 for size in self.a.shape[1:])

    def at(self, degrees: Sequence[int]) -> Iterator[tuple[Row, list[list[Row]]]]:
        """Yield a and b at nodes of degrees in each parameter, last parameter fastest."""
        if math.prod(d + 1 for d in degrees) * (self.n + 1) > MOST_COEFFICIENTS:
            raise FormatError("the transfer function has more coefficients than are checked here")
        a = self.a.on_nodes(degrees)
        b = [[own.on_nodes(degrees) for own in row] for row in self.b]
        count = math.prod(d + 1 for d in degrees)
        for k in range(count):
            yield a.values[k::count], [[own.values[k::count] for own in row] for row in b]

    @cached_property
    def first(self) -> tuple[Row, list[list[Row]]]:
        """Values of a and b at the first node, of which all coordinates are zero."""
        return next(self.at(self.degrees))

    @property
    def is_stable(self) -> bool:
        """Whether all poles are to the left at the first node."""
        whole = common_denominator([[self.first[0]]], LONGEST)
        (a,) = whole_numbers([self.first[0]], whole)
        return bool(a[0]) and roots_inside(a, STABLE)

    def bilinear(self, step: Fraction) -> Transfer:
        """Return it of the variable w of d = w / (1 - w step / 2); as it is for a zero step."""
        if not step:
            return self
        n, half = self.n, -step / 2
        # d^k (1 - w T/2)^n = w^k (1 - w T/2)^(n - k), the highest power of w first
        rows = [[Fraction(0)] * (n + 1) for _ in range(n + 1)]
        for j in range(n + 1):  # of d^(n - j)
            for i in range(j + 1):
                rows[n - (n - j + i)][j] = math.comb(j, i) * half**i

        def mapped(own: Tensor) -> Tensor:
            return own.along(0, rows)

        return Transfer(mapped(self.a), tuple(tuple(map(mapped, row)) for row in self.b), step)

    def inside(self, t: Sequence[Fraction]) -> Transfer:
        """Return it at one point of the parameters' box."""

        def at(own: Tensor) -> Tensor:
            for axis, x in enumerate(t, 1):
                own = own.along(axis, [_lagrange(nodes(own.shape[axis] - 1), x)])
            return own

        return Transfer(at(self.a), tuple(tuple(map(at, row)) for row in self.b), self.step)

    @cached_property
    def variance(self) -> tuple[Tensor, Tensor]:
        """D and N at nodes of their degrees: the sum of the variances is N / D for unit noise.

        Raises
        ------
        FormatError
            If a disturbance passes straight through.
        """
        own = self._filtered
        degrees = [(own.n + 1) * d for d in own.degrees]
        below, above = list[Fraction](), list[Fraction]()
        for a, b in own.at(degrees):
            g = [Fraction(0)] * own.n
            for each in (x for row in b for x in row):
                if each[0]:
                    raise FormatError("white noise passes straight into an output")
                g = list(map(add, g, _even(each[1:])))
            H = _hurwitz(a)
            below.append(2 * a[0] * _determinant(H))
            above.append((-1) ** (own.n + 1) * _determinant([g, *H[1:]]))
        shape = tuple(d + 1 for d in degrees)
        return Tensor(below, shape), Tensor(above, shape)

    @property
    def _filtered(self) -> Transfer:
        """It over (1 + w step / 2); as it is for a zero step."""
        step = self.step
        if not step:
            return self
        n = self.n
        rows = [[Fraction(0)] * (n + 1) for _ in range(n + 2)]
        for j in range(n + 1):
            rows[j][j], rows[j + 1][j] = step / 2, Fraction(1)
        zero = [[Fraction(0)] * (n + 1)]
        same = [[Fraction(int(i == j)) for j in range(n + 1)] for i in range(n + 1)]
        b = tuple(tuple(own.along(0, zero + same) for own in row) for row in self.b)
        return Transfer(self.a.along(0, rows), b, step)


def transfer(
    W: Polynomial, N: Polynomial, Y: Polynomial, E: Polynomial, F: Polynomial | None
) -> Transfer:
    """Return Y (s W - N)^-1 E + F for polynomials on a box, or constants.

    Raises
    ------
    FormatError
        If W is singular at a node, or there are too many nodes.
    """
    count = len(W.sizes) if W.sizes != (1,) else 0
    degrees = _degrees([W, N, Y, E] + ([] if F is None else [F]), count, F is not None)
    n, total = W.shape[0], math.prod(d + 1 for d in degrees)
    if total * (n + 1) > MOST_COEFFICIENTS:
        raise FormatError("the transfer function has more coefficients than are checked here")
    found = []
    for t in product(*map(nodes, degrees)):
        at = [_value(own, t) for own in (W, N, Y, E)]
        found.append(_resolved(at[0], at[1], at[2], at[3], None if F is None else _value(F, t)))
    shape = (n + 1, *(d + 1 for d in degrees))
    a = Tensor([own[0][k] for k in range(n + 1) for own in found], shape)
    b = tuple(
        tuple(
            Tensor([own[1][i][j][k] for k in range(n + 1) for own in found], shape)
            for j in range(E.shape[1])
        )
        for i in range(Y.shape[0])
    )
    return _trimmed(Transfer(a, b))


def _trimmed(own: Transfer) -> Transfer:
    """Return it at no more nodes than its degrees ask for, which are less where ranks are."""
    each = [own.a, *(x for row in own.b for x in row)]
    least = []
    for axis, degree in enumerate(own.degrees, 1):
        last = max((_degree_along(x, axis) for x in each), default=0) if degree else 0
        least.append(last)
    if tuple(least) == own.degrees:
        return own
    a = own.a.on_nodes(least)
    return Transfer(a, tuple(tuple(x.on_nodes(least) for x in row) for row in own.b))


def _degree_along(own: Tensor, axis: int) -> int:
    """Return the degree along an axis, by differences of the values at equal nodes."""
    count, inner = own.shape[axis], math.prod(own.shape[axis + 1 :])
    most = 0
    spend(RATIONAL * len(own.values) * count, 64, 64)
    for start in range(0, len(own.values), count * inner):
        for k in range(inner):
            line, order = own.values[start + k : start + count * inner : inner], 0
            while any(x != line[0] for x in line):
                line, order = [y - x for x, y in pairwise(line)], order + 1
            most = max(most, order)
    return most


def _degrees(polynomials: list[Polynomial], count: int, direct: bool) -> tuple[int, ...]:
    """Return a bound on the degree of a and b in each parameter.

    They are determinants of [ s W - N, E_j; Y_i, F_ij ]: of the sum over its rows of the degree of
    each, and of that over its columns.
    """
    W, N, Y, E = (_entry_degrees(own, count) for own in polynomials[:4])
    F = _entry_degrees(polynomials[4], count) if direct else None
    n, found = len(W), []
    for k in range(count):
        core = [
            [max(w[k], m[k]) for w, m in zip(*rows, strict=True)] for rows in zip(W, N, strict=True)
        ]
        right = [max(x[k] for x in row) for row in E]
        below = [max(Y[i][j][k] for i in range(len(Y))) for j in range(n)]
        corner = max((x[k] for row in F for x in row), default=0) if F is not None else 0
        by_rows = sum(max(*row, e) for row, e in zip(core, right, strict=True)) + max(
            *below, corner
        )
        by_columns = sum(max(*(row[j] for row in core), below[j]) for j in range(n)) + max(
            *right, corner
        )
        found.append(min(by_rows, by_columns))
    return tuple(found)


def _entry_degrees(own: Polynomial, count: int) -> list[list[tuple[int, ...]]]:
    """Return the degree of each entry in each parameter."""
    rows, columns = own.shape
    grid = [list(nodes(own.degrees[k])) for k in range(count)]
    values = [_value(own, t) for t in product(*grid)]
    shape = tuple(len(axis) for axis in grid)
    return [
        [
            tuple(_degree_along(Tensor([v[i][j] for v in values], shape), k) for k in range(count))
            for j in range(columns)
        ]
        for i in range(rows)
    ]


def _value(own: Polynomial, t: Sequence[Fraction]) -> Rationals:
    """Return a polynomial's value at coordinates of a box."""
    at = [x for u in t for x in (1 - u, u)] if t else [Fraction(1)] * len(next(iter(own.terms)))
    length = sum(x.denominator.bit_length() for x in at) * max(own.degrees, default=1)
    entries = own.shape[0] * own.shape[1]
    spend(RATIONAL * len(own.terms) * (len(at) + entries), own.bits, length)
    total: Rationals = [[Fraction(0)] * own.shape[1] for _ in range(own.shape[0])]
    for e, matrix in own.terms.items():
        weight = (
            math.prod((x**p for x, p in zip(at, e, strict=True)), start=Fraction(1)) / own.whole
        )
        if weight:
            total = [
                [s + weight * x if x else s for s, x in zip(*rows, strict=True)]
                for rows in zip(total, matrix, strict=True)
            ]
    return total


def _resolved(
    W: Rationals, N: Rationals, Y: Rationals, E: Rationals, F: Rationals | None
) -> tuple[Row, list[list[Row]]]:
    """Return a and b at one point, by Faddeev and LeVerrier's recursion."""
    n = len(W)
    plain = all(W[i][j] == (i == j) for i in range(n) for j in range(n))
    scale = Fraction(1)
    if not plain:
        both = right_divide(N + Y, W)
        if both is None:
            raise FormatError("W is singular")
        N, Y, scale = both[:n], both[n:], _determinant(W)
    units = [common_denominator([M], LONGEST) for M in (N, Y, E)]
    M, left, right = (whole_numbers(own, unit) for own, unit in zip((N, Y, E), units, strict=True))
    length = n * bits(M)
    spend(n**4, length // 2 + 1, bits(M))
    power = [[int(i == j) for j in range(n)] for i in range(n)]
    a = [scale]
    moved: list[list[Row]] = [[[Fraction(0)] for _ in right[0]] for _ in left]
    for k in range(1, n + 1):
        unit = units[0] ** (k - 1) * units[1] * units[2]
        for i, row in enumerate(multiplied(multiplied(left, power), right)):
            for j, x in enumerate(row):
                moved[i][j].append(scale * Fraction(x, unit))
        power = multiplied(M, power)
        trace = -sum(power[i][i] for i in range(n)) // k  # divides exactly
        for i in range(n):
            power[i][i] += trace
        a.append(scale * Fraction(trace, units[0] ** k))
    if F is not None:
        spend(RATIONAL * len(F) * len(F[0]) * n, length, 64)
        for i, through in enumerate(F):
            for j, f in enumerate(through):
                if f:
                    moved[i][j] = [x + f * y for x, y in zip(moved[i][j], a, strict=True)]
    return a, moved


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
        own = rows[p]
        for i in range(p + 1, n):
            factor = rows[i][p]
            rows[i] = [
                (own[p] * x - factor * y) // previous for x, y in zip(rows[i], own, strict=True)
            ]
        previous = own[p]
    return Fraction(sign * previous, whole**n)


# --- polynomials that are to be positive ---------------------------------------------------------


def gain_polynomial(own: Transfer, level: Fraction) -> Tensor:
    """Return the Bernstein coefficients of P, in v = w^2 / (w^2 + u^2) and t."""
    degrees = [2 * d for d in own.degrees]
    square, unit = level * level, _unit(own.first[0])
    columns = []
    for a, b in own.at(degrees):
        p = _difference(a, b, square)
        n = len(p) - 1
        columns.append([c * unit**k / math.comb(n, k) for k, c in enumerate(p)])
    n = own.n
    values = [column[k] for k in range(n + 1) for column in columns]
    found = Tensor(values, (n + 1, *(d + 1 for d in degrees)))
    for axis, d in enumerate(degrees, 1):
        found = found.along(axis, to_bernstein(d))
    return found


def passes(own: Transfer, level: Fraction) -> bool:
    """Whether g^2 I - F'F > 0 at the first node."""
    a, b = own.first
    F = [[x[0] / a[0] for x in row] for row in b]
    q = len(F[0])
    rest = [
        [level * level * int(i == j) - sum(row[i] * row[j] for row in F) for j in range(q)]
        for i in range(q)
    ]
    return is_positive_definite(whole_numbers(rest, common_denominator([rest], LONGEST)))


def _unit(a: Row) -> Fraction:
    """Return a power of four near the mean of the poles' squares."""
    last, first = abs(a[-1]), abs(a[0])
    if not last or not first:
        return Fraction(1)
    ratio = last / first
    e = (ratio.numerator.bit_length() - ratio.denominator.bit_length()) // (len(a) - 1)
    return Fraction(4) ** e


def _difference(a: Row, b: list[list[Row]], square: Fraction) -> Row:
    """Return det(g^2 I - G*G) |a|^2 in powers of w^2, lowest first."""
    length = max(x.numerator.bit_length() + x.denominator.bit_length() for x in a)
    spend(RATIONAL * len(a) ** 2 * (1 + sum(map(len, b))), length, length)
    if min(len(b), len(b[0])) == 1:
        each = [x for row in b for x in row]
        found = [square * x for x in _modulus(a)]
        for own in each:
            found = [x - y for x, y in zip(found, _modulus(own), strict=True)]
        return found
    return _by_nodes(a, b, square)


def _modulus(c: Row) -> Row:
    """Return |c(jw)|^2 in powers of w^2, lowest first; c has its highest power first."""
    low = c[::-1]
    even = [x if k % 2 == 0 else -x for k, x in enumerate(low[::2])]
    odd = [x if k % 2 == 0 else -x for k, x in enumerate(low[1::2])]
    found = [Fraction(0)] * len(c)
    for part, shift in ((even, 0), (odd, 1)):
        for i, x in enumerate(part):
            if x:
                for j, y in enumerate(part):
                    found[i + j + shift] += x * y
    return found


def _by_nodes(a: Row, b: list[list[Row]], square: Fraction) -> Row:
    """Return it of several outputs and disturbances, from its values at real s: w^2 = -s^2."""
    n = len(a) - 1
    if len(b) < len(b[0]):  # det(g^2 I - G*G) has the smaller of both sizes up to powers of g
        b = [list(column) for column in zip(*b, strict=True)]
    root = Fraction(2) ** (
        (_unit(a).numerator.bit_length() - _unit(a).denominator.bit_length()) // 2
    )
    at, values, k = list[Fraction](), list[Fraction](), 0
    while len(at) <= n:
        k += 1
        s = root * k / 2
        one, other = _horner(a, s), _horner(a, -s)
        if not one or not other:
            continue
        ahead = [[_horner(x, s) for x in row] for row in b]
        back = [[_horner(x, -s) for x in row] for row in b]
        q = len(b[0])
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


def _horner(c: Row, s: Fraction) -> Fraction:
    total = Fraction(0)
    for x in c:
        total = total * s + x
    return total


def _interpolated(at: Row, values: Row) -> Row:
    """Return the polynomial through points, lowest power first, by divided differences."""
    table, count = list(values), len(at)
    spend(RATIONAL * count**2, 512, 512)
    for order in range(1, count):
        for i in range(count - 1, order - 1, -1):
            table[i] = (table[i] - table[i - 1]) / (at[i] - at[i - order])
    found = [table[-1]]
    for x, c in zip(at[-2::-1], table[-2::-1], strict=True):
        found = [c - x * found[0]] + [
            (low - x * high) for low, high in zip(found, [*found[1:], Fraction(0)], strict=True)
        ]
    return found


def _even(b: Row) -> Row:
    """Return b(s) b(-s) in powers of s^2, highest first."""
    n = len(b)
    found = [Fraction(0)] * n
    for i, x in enumerate(b):
        if x:
            for j, y in enumerate(b):
                if (i + j) % 2 == 0 and y:
                    sign = -1 if (n - 1 - j) % 2 else 1
                    found[(i + j) // 2] += sign * x * y
    return found


def _hurwitz(a: Row) -> Rationals:
    """Return the Hurwitz matrix: a_(2j - i + 1) in row i and column j, counted from zero."""
    n = len(a) - 1
    return [
        [a[2 * j - i + 1] if 0 <= 2 * j - i + 1 <= n else Fraction(0) for j in range(n)]
        for i in range(n)
    ]


def bernstein_of(own: Tensor) -> Tensor:
    """Return Bernstein coefficients of a polynomial of the parameters from its values at nodes."""
    for axis, size in enumerate(own.shape):
        own = own.along(axis, to_bernstein(size - 1))
    return own


def combined(one: Tensor, p: Fraction, other: Tensor, q: Fraction) -> Tensor:
    """Return p times one and q times the other, at the same nodes."""
    return Tensor([p * x + q * y for x, y in zip(one.values, other.values, strict=True)], one.shape)


# --- positive on a box ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Positive:
    """Whether a polynomial is positive on its box, in how many parts, and where it is not.

    ``at`` is a corner of a part, in coordinates from 0 to 1, with a value that is not positive.
    """

    proved: bool
    parts: int
    at: tuple[Fraction, ...] = ()


def positive(own: Tensor) -> Positive:
    """Decide whether a polynomial of these Bernstein coefficients is positive on the whole box.

    Raises
    ------
    FormatError
        If the parts of the box take more work than a count allows.
    """
    degrees = tuple(size - 1 for size in own.shape)
    start = (Fraction(0),) * len(degrees), (Fraction(1),) * len(degrees)
    open_, parts = [(_cut(own.values), *start)], 0
    corners = _corners(own.shape)
    spread = [_slices(own.shape, axis) for axis in range(len(degrees))]
    while open_:
        values, low, high = open_.pop()
        parts += 1
        if min(values) > 0:
            continue
        for index, ends in corners:
            if values[index] <= 0:
                at = tuple(b if end else a for a, b, end in zip(low, high, ends, strict=True))
                return Positive(False, parts, at)
        spend(len(values) * (2 * len(degrees) + max(degrees)), DIGITS)
        axis = max(range(len(degrees)), key=lambda k: _bend(values, spread[k]))
        middle = (low[axis] + high[axis]) / 2
        first, second = _halved(values, spread[axis], degrees[axis])
        between_ = tuple(middle if k == axis else x for k, x in enumerate(high))
        open_.append((second, tuple(middle if k == axis else x for k, x in enumerate(low)), high))
        open_.append((first, low, between_))
    return Positive(True, parts)


def _cut(values: list[Fraction]) -> list[int]:
    """Return whole numbers, not more than a common multiple of the values, of `DIGITS` bits."""
    most = max((abs(x) for x in values), default=Fraction(0))
    if not most:
        return [0] * len(values)
    shift = DIGITS - (most.numerator.bit_length() - most.denominator.bit_length())
    spend(2 * len(values), max(x.numerator.bit_length() for x in values), DIGITS)
    up, down = max(shift, 0), max(-shift, 0)
    return [(x.numerator << up) // (x.denominator << down) for x in values]


def _corners(shape: tuple[int, ...]) -> list[tuple[int, tuple[int, ...]]]:
    """Return the place of each corner's value, and which corner it is."""
    found = []
    for ends in product((0, 1), repeat=len(shape)):
        index = 0
        for size, end in zip(shape, ends, strict=True):
            index = index * size + (size - 1) * end
        found.append((index, ends))
    return found


Slices = list[list[slice]]


def _slices(shape: tuple[int, ...], axis: int) -> Slices:
    """Return, for each block, the slices at each place along an axis."""
    inner, count = math.prod(shape[axis + 1 :]), shape[axis]
    blocks = range(0, math.prod(shape), inner * count)
    return [
        [slice(start + k * inner, start + (k + 1) * inner) for k in range(count)]
        for start in blocks
    ]


def _bend(values: list[int], slices: Slices) -> int:
    """Return the largest second difference along an axis."""
    most = 0
    for block in slices:
        lines = [values[s] for s in block]
        for a, b, c in zip(lines, lines[1:], lines[2:], strict=False):
            most = max(most, *(abs(x - 2 * y + z) for x, y, z in zip(a, b, c, strict=True)))
    return most * (len(slices[0]) - 1)


def _halved(values: list[int], slices: Slices, degree: int) -> tuple[list[int], list[int]]:
    """Return the coefficients of both halves along an axis, cut downwards."""
    first, second = values[:], values[:]
    for block in slices:
        lines = [values[s] for s in block]
        for k in range(degree + 1):
            first[block[k]] = [x >> k for x in lines[0]]
            second[block[degree - k]] = [x >> k for x in lines[-1]]
            lines = [list(map(add, a, b)) for a, b in pairwise(lines)]
    return first, second
