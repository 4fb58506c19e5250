"""Products of matrix polynomials in whole numbers: term by term, or by their values at nodes.

On a box a polynomial is homogeneous in the two coordinates a, b of each interval. A product of
degree d there is known by its values at d + 1 of the nodes (a, b) = (0, 1), (1, 0), (1, 1),
(1, -1), (1, 2), (1, -2), ...: at each the two matrices are multiplied, and the coefficients are
those of the interpolation, exactly. So a product takes as many products of matrices as it has
coefficients, in place of one for each pair of those of its factors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from itertools import chain
from operator import mul

from polefence.proof.matrices import Integers, transposed
from polefence.proof.short import Short
from polefence.proof.work import MAX_HELD, WorkError, cost, spend

COORDINATES = 2  # of an exponent, which are added at the cost of one operation

Exponent = tuple[int, ...]
Terms = dict[Exponent, Integers]
Degrees = tuple[int, int]  # of both factors, in an interval


def longest_of(P: Terms) -> int:
    """Return the most bits of an entry."""
    entries = chain.from_iterable(chain.from_iterable(P.values()))
    return max(map(int.bit_length, entries), default=0)


def hold(matrices: int, entries: int, length: int) -> None:
    """Refuse to hold more than is held.

    Raises
    ------
    WorkError
        If it is.
    """
    if matrices * entries * (36 + length // 7) > MAX_HELD:
        raise WorkError("its polynomials are too large to be checked here; take fewer parameters")


def spend_exponents(count: int, P: Iterable[Exponent]) -> None:
    """Count the work on so many exponents."""
    spend(count * len(next(iter(P), ())) // COORDINATES, 0)


def multiplied(
    P: Terms, Q: Terms, degrees: Sequence[Degrees] | None = None, half: bool = False
) -> Terms:
    """Multiply matrix polynomials, entries with rows; of a symmetric product half is computed.

    The numbers of a row are digits of one number, in a base that no digit of the result exceeds.

    Parameters
    ----------
    degrees : sequence of Degrees, optional
        In each interval of a box: values at nodes are then multiplied where that is less work.
    """
    if not P or not Q:
        return {}
    shape = _Shape.of(P, Q, half)
    each = shape.entries * shape.inner * cost(longest_of(P), longest_of(Q))
    by_terms = len(P) * len(Q) * (each + len(next(iter(P))) // COORDINATES * cost(0))
    nodes = None if degrees is None else _Nodes(degrees)
    if nodes is not None and nodes.work(P, Q, shape) < by_terms:
        return nodes.multiplied(P, Q, shape)
    spend(len(P) * len(Q) * shape.entries * shape.inner, longest_of(P), longest_of(Q))
    spend_exponents(len(P) * len(Q), P)
    return _by_terms(P, Q, shape)


class _Shape:
    """Rows, columns and what is computed of a product of matrices."""

    def __init__(self, rows: int, inner: int, columns: int, half: bool) -> None:
        self.rows, self.inner, self.columns, self.half = rows, inner, columns, half
        self.entries = rows * (rows + 1) // 2 if half else rows * columns
        self.firsts = [i if half else 0 for i in range(rows)]

    @classmethod
    def of(cls, P: Terms, Q: Terms, half: bool) -> _Shape:
        one, other = next(iter(P.values())), next(iter(Q.values()))
        return cls(len(one), len(other), len(other[0]), half)

    def product(self, p: Integers, packed: list[list[int]]) -> list[int]:
        """Return the rows of a product, those of a half from the diagonal on, packed."""
        return [sum(map(mul, row, packed[i])) for i, row in zip(self.firsts, p, strict=True)]

    def unpacked(self, both: Sequence[int], size: int) -> Integers:
        """Return the product of its packed rows."""
        rows = [
            _unpacked(x, size, self.columns - i) for i, x in zip(self.firsts, both, strict=True)
        ]
        if not self.half:
            return rows
        every = range(self.rows)
        return [[rows[min(i, j)][abs(i - j)] for j in every] for i in every]


def _by_terms(P: Terms, Q: Terms, shape: _Shape) -> Terms:
    """Multiply each term with each."""
    left, right = longest_of(P), longest_of(Q)
    # sums of at most so many products, and a sign
    width = left + right + (min(len(P), len(Q)) * shape.inner).bit_length() + 1
    size = width // 8 + 1
    packed: dict[Exponent, list[int]] = {}
    rows = {e: transposed([_packed(row, size) for row in q]) for e, q in Q.items()}
    for d, p in P.items():
        for e, q in rows.items():
            target = tuple(map(int.__add__, d, e))
            both, known = shape.product(p, q), packed.get(target)
            packed[target] = both if known is None else list(map(int.__add__, known, both))
        hold(len(packed), shape.rows * shape.columns, left + right)
    return {e: shape.unpacked(both, size) for e, both in packed.items()}


Table = dict[Exponent, list[int]]  # one index an interval, and numbers


class _Nodes:
    """Nodes of each interval, of a product of some degrees of its factors."""

    def __init__(self, degrees: Sequence[Degrees]) -> None:
        self.degrees = degrees
        self.totals = [sum(pair) for pair in degrees]
        self.count = math.prod(total + 1 for total in self.totals)

    def growth(self, factor: int) -> int:
        """Return by how many bits values at nodes are longer than coefficients of a factor."""
        every = zip(self.degrees, self.totals, strict=True)
        return sum(_bits(_values(pair[factor], total)) for pair, total in every)

    @property
    def shrinking(self) -> int:
        """How many bits coefficients in between may be longer than values at nodes."""
        return sum(_bits(_inverse(total)[0]) for total in self.totals)

    def moves(self, factor: int | None) -> int:
        """Return how many numbers are multiplied to go to nodes, or back, for each entry."""
        moves, sizes = 0, [(t if factor is None else d[factor]) + 1 for d, t in self.pairs]
        for axis, (_, total) in enumerate(self.pairs):
            moves += math.prod(sizes) * (total + 1)
            sizes[axis] = total + 1
        return moves

    @property
    def pairs(self) -> list[tuple[Degrees, int]]:
        """Degrees of both factors and of their product in each interval."""
        return list(zip(self.degrees, self.totals, strict=True))

    def work(self, P: Terms, Q: Terms, shape: _Shape) -> int:
        """Return about the work of a product."""
        left, right = longest_of(P) + self.growth(0), longest_of(Q) + self.growth(1)
        back = shape.columns * (left + right + self.shrinking)
        return (
            self.count * shape.entries * shape.inner * cost(left, right)
            + self.moves(0) * shape.rows * cost(shape.inner * left)
            + self.moves(1) * shape.inner * cost(shape.columns * right)
            + self.moves(None) * shape.rows * cost(back)
        )

    def multiplied(self, P: Terms, Q: Terms, shape: _Shape) -> Terms:
        """Multiply at nodes, and return the coefficients."""
        left, right = longest_of(P) + self.growth(0), longest_of(Q) + self.growth(1)
        hold(self.count, shape.rows * shape.columns, left + right + self.shrinking)
        spend(self.count * shape.entries * shape.inner, left, right)
        size = (left + right + shape.inner.bit_length() + self.shrinking + 2) // 8 + 1
        one, other = self._at(P, 0), self._at(Q, 1)
        table: Table = {}
        for at, p in one.items():
            q = transposed([_packed(row, size) for row in other[at]])
            table[at] = shape.product(p, q)
        spend(self.moves(None) * shape.rows, shape.columns * 8 * size)
        spend(self.count * shape.entries, 8 * size)
        for axis, total in enumerate(self.totals):
            table = _along(table, axis, *_inverse(total))
        # a product that is zero keeps one term, which has its shape
        kept = {index: both for index, both in table.items() if any(both)} or dict(
            [next(iter(table.items()))]
        )
        return {self._exponent(index): shape.unpacked(both, size) for index, both in kept.items()}

    def _at(self, P: Terms, factor: int) -> dict[Exponent, Integers]:
        """Return the values of a factor at all nodes; a row is one number on the way."""
        one, length = next(iter(P.values())), longest_of(P) + self.growth(factor)
        size = (length + 1) // 8 + 1
        columns = len(one[0])
        spend(self.moves(factor) * len(one), columns * 8 * size)
        spend(self.count * len(one) * columns, 8 * size)
        table = {e[1::2]: [_packed(row, size)[0] for row in M] for e, M in P.items()}
        for axis, (pair, total) in enumerate(self.pairs):
            table = _along(table, axis, _values(pair[factor], total))
        return {at: [_unpacked(x, size, columns) for x in rows] for at, rows in table.items()}

    def _exponent(self, index: Exponent) -> Exponent:
        pairs = zip(self.totals, index, strict=True)
        return tuple(chain.from_iterable((total - power, power) for total, power in pairs))


def _along(table: Table, axis: int, rows: Sequence[Sequence[int]], divisor: int = 1) -> Table:
    """Return a table with sums along an axis, of these weights, over what divides them."""
    lines: dict[Exponent, dict[int, list[int]]] = {}
    for index, numbers in table.items():
        lines.setdefault((*index[:axis], *index[axis + 1 :]), {})[index[axis]] = numbers
    moved: Table = {}
    for rest, line in lines.items():
        columns = list(zip(*line.values(), strict=True))
        for k, weights in enumerate(rows):
            chosen = [weights[i] for i in line]
            sums = [sum(map(mul, chosen, column)) for column in columns]
            at = (*rest[:axis], k, *rest[axis:])
            moved[at] = sums if divisor == 1 else [x // divisor for x in sums]
    return moved


@cache
def _points(count: int) -> list[tuple[int, int]]:
    """Return the first nodes."""
    beyond = ((1, sign * k) for k in range(1, count) for sign in (1, -1))
    return [(0, 1), (1, 0), *beyond][:count]


@cache
def _values(degree: int, total: int) -> list[list[int]]:
    """Return a^(d - i) b^i at the nodes of a product of a total degree, for i from 0 to d."""
    return [[a ** (degree - i) * b**i for i in range(degree + 1)] for a, b in _points(total + 1)]


@cache
def _inverse(total: int) -> tuple[list[list[int]], int]:
    """Return the inverse of the values at the nodes of a total degree, over a denominator."""
    count = total + 1
    rows = [
        [*map(Fraction, values), *(Fraction(int(i == j)) for j in range(count))]
        for i, values in enumerate(_values(total, total))
    ]
    for i in range(count):
        pivot = next(k for k in range(i, count) if rows[k][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(count):
            if k != i and rows[k][i]:
                factor = rows[k][i]
                rows[k] = [x - factor * y for x, y in zip(rows[k], rows[i], strict=True)]
    inverse = [row[count:] for row in rows]
    whole = math.lcm(*(x.denominator for row in inverse for x in row))
    return [[int(x * whole) for x in row] for row in inverse], whole


def _bits(rows: Sequence[Sequence[int]]) -> int:
    """Return the bits of the largest sum of magnitudes of a row."""
    return max(sum(map(abs, row)) for row in rows).bit_length()


@dataclass(frozen=True)
class Packed(Short):
    """Matrices of a polynomial, each as the digits of one number, of so many bytes each."""

    numbers: dict[Exponent, int]
    shape: tuple[int, int]
    size: int

    @classmethod
    def of(cls, P: Terms, growth: int) -> Packed:
        """Pack matrices of which entries may become so many bits longer."""
        one, size = next(iter(P.values())), (longest_of(P) + growth + 1) // 8 + 1
        shape = len(one), len(one[0])
        spend(len(P) * math.prod(shape), 8 * size)
        packed = {e: _packed(list(chain.from_iterable(M)), size)[0] for e, M in P.items()}
        return cls(packed, shape, size)

    def elevated(self, simplex: range) -> Packed:
        """Multiply by the sum of a simplex's coordinates."""
        entries = math.prod(self.shape)
        spend(len(self.numbers) * len(simplex), 8 * self.size * entries)
        spend_exponents(len(self.numbers) * len(simplex), self.numbers)
        hold(len(self.numbers) * len(simplex), entries, 8 * self.size)
        result: dict[Exponent, int] = {}
        for e, number in self.numbers.items():
            for j in simplex:
                at = (*e[:j], e[j] + 1, *e[j + 1 :])
                result[at] = result.get(at, 0) + number
        return replace(self, numbers=result)

    @property
    def terms(self) -> Terms:
        """The matrices."""
        rows, columns = self.shape
        spend(len(self.numbers) * rows * columns, 8 * self.size)
        every = {e: _unpacked(x, self.size, rows * columns) for e, x in self.numbers.items()}
        cuts = range(0, rows * columns, columns)
        return {e: [flat[k : k + columns] for k in cuts] for e, flat in every.items()}


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
