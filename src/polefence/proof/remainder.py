"""Plants that are only near a polynomial of their parameters: by how much, and what that costs.

The polynomial is the combination of the vertices, with a curve added between them. Where
no entry of [A, B, E] is off by more than that of R, the products N = A X + B K X are off by
H Delta V, |Delta| <= 1, with H = diag(rows) and V = diag(columns) [X; K X] of any positive numbers
for which the Frobenius norm of diag(rows)^-1 R diag(columns)^-1 is at most one. With a matrix Omega
that is more than V'V at every alpha,

    a H Delta V b' + b V'Delta'H a'  <=  a H H' a' + b Omega b'

(Petersen, 1987), for any columns a and b of blocks: what an inequality may lose is a constant. In
the dual form V = diag(columns) [W; Z] is known, and a number kappa is more than H'Q H. Of a
covariance from below, P, V is diag(columns), Omega more than M P V'V P M', and kappa more than
-V P V'.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from operator import mul

from polefence.proof.approximation import Functions
from polefence.proof.matrices import (
    MAX_BITS,
    ONE,
    ZERO,
    Rationals,
    common_denominator,
    identity,
    longest,
    product,
)
from polefence.proof.polynomials import (
    Polynomial,
    Sizes,
    bernstein,
    constant,
    count_of,
    diagonal,
    monomials,
    restricted,
)
from polefence.proof.ranges import corner_weights, corners
from polefence.proof.short import Short
from polefence.proof.text import name_text
from polefence.proof.work import RATIONAL, FormatError, spend

Rows = tuple[tuple[Fraction, ...], ...]

UNIT = 2**64
MAX_CURVE = 8  # degree
# Of the interpolation of degree 2: more than 72 sqrt 3 is not, and by how much it makes what its
# nodes are off by larger; see `proof.interpolation`.
THIRD, LARGER = 124, Fraction(5, 4)
# What E is off by, beside E: (E + F) (E + F)' <= (1 + SHARE) E E' + (1 + 1 / SHARE) F F'.
SHARE = Fraction(1, 4096)


@dataclass(frozen=True)
class Source(Short):
    """Functions of the parameters, and what [A, B, E] is of them.

    [A, B, E] is the combination of the vertices and, for each function f_k, its matrix of
    ``directions`` times f_k less the combination of its own values at the corners of the box.
    """

    functions: Functions
    directions: tuple[Rows, ...]

    @property
    def names(self) -> list[str]:
        """Names of the parameters of functions that have a part in it."""
        pairs = zip(self.functions.trees, self.directions, strict=True)
        used = frozenset().union(*(tree.names for tree, M in pairs if any(map(any, M))))
        return [name_text(r.name) for r in self.functions.ranges if r.name in used]

    def on_part(
        self, low: tuple[Fraction, ...], high: tuple[Fraction, ...]
    ) -> tuple[list[Rationals], Remainder]:
        """Return what is added at the corners of a part of the box, and the remainder there.

        Raises
        ------
        NoValueError
            If a function has no value somewhere.
        """
        degree, parts = self.functions.on_part(low, high)
        whole = self.functions.on_box[1]
        weights = [corner_weights(corner) for corner in corners(low, high)]
        known = [[sum(map(mul, w, f.corners), ZERO) for w in weights] for f in whole]
        at_corners = [
            self._sum([f.corners[j] - chord[j] for f, chord in zip(parts, known, strict=True)])
            for j in range(len(weights))
        ]
        curve = [self._sum([f.curve[k] for f in parts]) for k in range(len(parts[0].curve))]
        off = self._sum([f.error for f in parts], abs)
        curve = curve if any(x for M in curve for row in M for x in row) else []
        frozen = tuple(tuple(map(tuple, M)) for M in (off, *curve))
        return at_corners, Remainder(frozen[0], frozen[1:], degree if curve else 1)

    def at(self, point: tuple[Fraction, ...]) -> tuple[Rationals, Fraction]:
        """Return what is added to the combination of the vertices at a point, and its error.

        It is exact where all functions are rational.
        """
        weights = corner_weights(point)
        values, off = self.functions.values(point), self.functions.widest(point)
        chords = (sum(map(mul, weights, f.corners), ZERO) for f in self.functions.on_box[1])
        more = self._sum([x - chord for x, chord in zip(values, chords, strict=True)])
        if not off:
            return more, ZERO
        largest = max(map(max, self._sum([off] * len(values), abs)))
        return more, largest

    @property
    def on_box(self) -> Remainder:
        """The remainder on the whole box."""
        count = len(self.functions.ranges)
        return replace(self.on_part((ZERO,) * count, (ONE,) * count)[1], source=self)

    def _sum(
        self, factors: Sequence[Fraction], of: Callable[[Fraction], Fraction] = lambda x: x
    ) -> Rationals:
        rows, columns = len(self.directions[0]), len(self.directions[0][0])
        total = [[ZERO] * columns for _ in range(rows)]
        for factor, M in zip(factors, self.directions, strict=True):
            for i, row in enumerate(M) if factor else ():
                for j, x in enumerate(row):
                    if x:
                        total[i][j] += factor * of(x)
        return total


@dataclass(frozen=True)
class Kinks(Short):
    """Functions of tables with knots, in samples.

    Where a function is off by one from the interpolation between the corners of a part, an entry of
    [A, B, E] is off by its matrix of ``sizes`` at most: zero of a function without a knot between
    straight lines.
    """

    functions: Functions
    sizes: tuple[Rows, ...]

    def inside(self, low: Sequence[Fraction], high: Sequence[Fraction]) -> list[Rationals]:
        """Return what entries are off by on a part of the box, for each function.

        Nothing, not even zeros, where no knot is inside.
        """
        known = self.functions.knotted(tuple(low), tuple(high))
        if min(smooth for smooth, _ in known) > 2:
            return []
        length = longest(row for M in self.sizes for row in M)
        spend(RATIONAL * len(known) * sum(map(len, self.sizes[0])), length, length)
        return [
            [[error * x for x in row] for row in M]
            for (_, error), M in zip(known, self.sizes, strict=True)
        ]


@dataclass(frozen=True)
class Remainder(Short):
    """What each entry of [A, B, E] may be off by, (n, n + m + q).

    ``curve`` holds the Bernstein coefficients of the same shape, of a ``degree`` in each simplex,
    of what is added to the combination of the vertices; there are none where nothing is. Where
    nodes inside the box are known, ``rounding`` is what an entry is off by there, and ``bends``
    are bounds on the second derivatives along the parameters: the smaller a part of the box, the
    smaller is its remainder. With ``third``, bounds on the third derivatives, parts have nodes in
    the middle of each parameter too, and a curve of degree 2 through them. Of such a part, with
    ``middles``, products with inputs that are the same everywhere are of the least degree. Where
    ``source`` says what functions of the parameters there are, parts have what these are there.
    ``kinks`` are of samples of functions whose second derivatives are unbounded.
    """

    entries: Rows
    curve: tuple[Rows, ...] = ()
    degree: int = 1
    rounding: Rows = ()
    bends: tuple[Rows, ...] = ()
    third: tuple[Rows, ...] = ()
    middles: bool = False
    source: Source | None = None
    kinks: Kinks | None = None

    @classmethod
    def between(
        cls,
        rounding: Rows,
        bends: Sequence[Rows],
        third: Sequence[Rows] = (),
        kinks: Kinks | None = None,
    ) -> Remainder:
        """Return that of the multi-affine interpolation between the corners of a box.

        Parameters
        ----------
        rounding : (n, n + m + q) rationals
            What an entry is off by at a corner.
        bends : sequence of (n, n + m + q) rationals
            Bounds on the second derivative along each side, from 0 to 1.
        third : sequence of (n, n + m + q) rationals, optional
            The same of the third derivative.
        kinks : Kinks, optional
            What functions with knots add.
        """
        count = len(bends)
        more = kinks.inside((ZERO,) * count, (ONE,) * count) if kinks else ()
        total = _interpolated(rounding, bends, more)
        return cls(total, rounding=rounding, bends=tuple(bends), third=tuple(third), kinks=kinks)

    @property
    def parts_degree(self) -> int:
        """Degree on a part of the box, between the nodes where there are some."""
        return 2 if self.third else self.degree

    @property
    def flat(self) -> Remainder:
        """The same without a curve, which its entries bound too."""
        if not self.curve:
            return self
        return Remainder(
            tuple(
                tuple(x + max(map(abs, on_curve)) for x, *on_curve in zip(*rows, strict=True))
                for rows in zip(self.entries, *self.curve, strict=True)
            )
        )

    def moves(self, state: int) -> bool:
        """Whether a row is known only near, or is more than the combination of the vertices."""
        return any(any(M[state]) for M in (self.entries, *self.curve))

    def mapped(
        self, change: Callable[[Rows], Rows], sizes: Callable[[Rows], Rows] | None = None
    ) -> Remainder:
        """Return it with every matrix changed, those of sizes by ``sizes`` where that is given."""
        of_sizes = sizes or change
        entries, rounding = of_sizes(self.entries), of_sizes(self.rounding) if self.bends else ()
        bends, third = (tuple(map(of_sizes, matrices)) for matrices in (self.bends, self.third))
        curve = tuple(map(change, self.curve))
        source = self.source and replace(
            self.source, directions=tuple(map(change, self.source.directions))
        )
        kinks = self.kinks and replace(self.kinks, sizes=tuple(map(of_sizes, self.kinks.sizes)))
        return Remainder(
            entries, curve, self.degree, rounding, bends, third, self.middles, source, kinks
        )

    def rows_of(self, i: int) -> list[tuple[Fraction, ...]]:
        """Return the i-th row of every matrix."""
        every = (self.entries, *self.curve, *self.bends, *self.third)
        directions = self.source.directions if self.source else ()
        return [M[i] for M in (*every, *directions) if M]

    def curved(self, P: Polynomial, first: int = 0) -> Polynomial:
        """Return [A, B], or E, with what is added to the combination of the vertices.

        Parameters
        ----------
        first : int
            Which column of [A, B, E] is its first.
        """
        if not self.curve:
            return P
        last = first + P.shape[1]
        curve = [[list(row[first:last]) for row in M] for M in self.curve]
        return P + bernstein(curve, P.sizes, self.degree, MAX_BITS)

    def same_inputs(self, B: Sequence[Rationals]) -> bool:
        """Whether B at the corners, and between them, is one; asked of a part with middles."""
        n, m = len(self.entries), len(B[0][0])
        curve = (row[n : n + m] for M in self.curve for row in M)
        return self.middles and all(B[0] == M for M in B) and not any(map(any, curve))

    def over(self, step: Fraction) -> Remainder:
        """Return that of the plant in its delta form."""
        return self.mapped(lambda M: tuple(tuple(x / step for x in row) for row in M))

    def inside(
        self,
        low: Sequence[Fraction],
        high: Sequence[Fraction],
        values: Sequence[Rationals] = (),
    ) -> Remainder:
        """Return that of a part of the box, in coordinates of that part.

        Parameters
        ----------
        low, high : sequences of Fraction
            Weights of each parameter's upper end, from 0 to 1.
        values : sequence of (n, .) rationals
            [A, B, E], or its first columns, at the nodes of a part with middles, as `lattice` has
            them.
        """
        alone, middles = self._alone(low, high)
        if not middles:
            return alone
        width = len(self.entries[0])
        curve = tuple(
            tuple((*row, *(ZERO,) * (width - len(row))) for row in M)
            for M in through(values, len(low))
        )
        return replace(alone, curve=curve, degree=2, middles=True)

    def added(
        self, low: Sequence[Fraction], high: Sequence[Fraction], columns: Sequence[int]
    ) -> list[list[Rationals]]:
        """Return what functions add at the corners of a part, in so many columns each.

        Nothing of a plant whose entries are no functions: an empty list.
        """
        if self.source is None:
            return []
        whole, first = self.source.on_part(tuple(low), tuple(high))[0], 0
        blocks = list[list[Rationals]]()
        for width in columns:
            blocks.append([[row[first : first + width] for row in M] for M in whole])
            first += width
        return blocks

    def inside_alone(self, low: Sequence[Fraction], high: Sequence[Fraction]) -> Remainder:
        """Return that of a part of the box, without the curve through its middles."""
        return self._alone(low, high)[0]

    def _alone(self, low: Sequence[Fraction], high: Sequence[Fraction]) -> tuple[Remainder, bool]:
        """Return it, and whether it is off so little from a curve through its middles."""
        if self.source is not None:
            return self.source.on_part(tuple(low), tuple(high))[1], False
        kinks = self.kinks.inside(low, high) if self.kinks else []
        if self.third and not kinks:
            grown, shares = ONE, list[Fraction]()
            for a, b in zip(low, high, strict=True):
                shares.append(grown * (b - a) ** 3 / THIRD)
                grown *= LARGER
            length = longest(row for M in self.third for row in M)
            spend(RATIONAL * len(shares) * sum(map(len, self.entries)), length, length)
            rows = tuple(
                tuple(
                    grown * x + sum(map(mul, shares, along), ZERO)
                    for x, *along in zip(*rows, strict=True)
                )
                for rows in zip(self.rounding, *self.third, strict=True)
            )
            return Remainder(rows), True
        if self.bends:
            sides = [b - a for a, b in zip(low, high, strict=True)]
            length = longest(row for M in self.bends for row in M)
            spend(RATIONAL * len(sides) * sum(map(len, self.entries)), length, length)
            bends = [
                tuple(tuple(x * side * side for x in row) for row in M)
                for side, M in zip(sides, self.bends, strict=True)
            ]
            return Remainder(_interpolated(self.rounding, bends, kinks)), False
        if not self.curve:
            return self, False
        coefficients = [list(map(list, M)) for M in self.curve]
        curve = tuple(
            tuple(map(tuple, M)) for M in restricted(coefficients, self.degree, low, high)
        )
        return Remainder(self.entries, curve, self.degree), False

    def transposed(self, n: int, p: int) -> Remainder:
        """Return that of the dual plant (A', C'), of p measured signals that are exact.

        Of one with bends it is that of the whole box on each part too: the dual has no nodes.
        """
        dual = self.mapped(
            lambda M: tuple((*(row[i] for row in M), *(ZERO,) * p) for i in range(n))
        )
        return replace(dual, rounding=(), bends=(), third=(), kinks=None)

    def padded(self, n: int, m: int, states: int, inputs: int = 0) -> Remainder:
        """Return that of the plant with more states and inputs, behind its own, that are exact."""

        def wider(M: Rows) -> Rows:
            rows = [
                (*row[:n], *(ZERO,) * states, *row[n : n + m], *(ZERO,) * inputs, *row[n + m :])
                for row in M
            ]
            return (*rows, *((ZERO,) * (len(M[0]) + states + inputs) for _ in range(states)))

        return self.mapped(wider)

    def kept(self, states: Sequence[int]) -> Remainder:
        """Return that of some of the states, counted from 0, on which the others have no part."""
        columns = [*states, *range(len(self.entries), len(self.entries[0]))]
        return self.mapped(lambda M: tuple(tuple(M[i][j] for j in columns) for i in states))

    def require(self, n: int, m: int, q: int, sizes: Sizes) -> None:
        """Refuse numbers that do not fit.

        Parameters
        ----------
        sizes : tuple of int
            Corners of each simplex that the curve is a polynomial on.
        """
        if self.curve and not 2 <= self.degree <= MAX_CURVE:
            raise FormatError(f"plant.curve.degree must be 2 to {MAX_CURVE}")
        if self.curve and len(self.curve) != count_of(sizes, self.degree):
            raise FormatError(
                f"plant.curve is of {len(self.curve)} coefficients; {count_of(sizes, self.degree)} "
                "are needed here"
            )
        for M in self.curve:
            if len(M) != n or any(len(row) != n + m + q for row in M):
                raise FormatError(f"plant.curve must hold {n} rows of {n + m + q} numbers")
        for matrix in (self.rounding, *self.bends, *self.third) if self.bends else ():
            if len(matrix) != n or any(len(row) != n + m + q for row in matrix):
                raise FormatError(f"plant.bends must hold {n} rows of {n + m + q} numbers")
            if min(map(min, matrix)) < 0:
                raise FormatError("plant.bends must hold numbers of zero or more")
        if self.bends and (self.curve or sizes != (2,) * len(self.bends)):
            raise FormatError("plant.bends must be one a parameter, without a curve")
        if self.third and len(self.third) != len(self.bends):
            raise FormatError("plant.bends.third must be one a parameter, as along is")
        if self.kinks is not None:
            self._require_kinks(n, n + m + q)
        if self.bends:
            whole = Remainder.between(self.rounding, self.bends, kinks=self.kinks)
            if self.entries != whole.entries:
                raise FormatError("plant.remainder is not that of plant.bends")
        if len(self.entries) != n or any(len(row) != n + m + q for row in self.entries):
            raise FormatError(f"plant.remainder must hold {n} rows of {n + m + q} numbers")
        if min(map(min, self.entries)) < 0:
            raise FormatError("plant.remainder must hold numbers of zero or more")

    def _require_kinks(self, n: int, width: int) -> None:
        """Refuse sizes of functions that do not fit."""
        sizes = () if self.kinks is None else self.kinks.sizes
        if not self.bends:
            raise FormatError("plant.bends.kinks belong to bends")
        if self.kinks is not None and len(sizes) != len(self.kinks.functions.trees):
            raise FormatError("plant.bends.kinks must be one a function of plant.functions")
        for matrix in sizes:
            if len(matrix) != n or any(len(row) != width for row in matrix):
                raise FormatError(f"plant.bends.kinks must hold {n} rows of {width} numbers")
            if min(map(min, matrix)) < 0:
                raise FormatError("plant.bends.kinks must hold numbers of zero or more")


def _interpolated(rounding: Rows, bends: Sequence[Rows], more: Sequence[Rationals]) -> Rows:
    """Return what entries are off by between the corners of a part, of the bends of its sides."""
    count = len(bends)
    return tuple(
        tuple(
            x + sum(others[:count], ZERO) / 8 + sum(others[count:], ZERO)
            for x, *others in zip(*rows, strict=True)
        )
        for rows in zip(rounding, *bends, *more, strict=True)
    )


def through(values: Sequence[Rationals], count: int) -> list[Rationals]:
    """Return what is added to the combination of the corners of a part, for it to have its values.

    Parameters
    ----------
    values : sequence of (n, .) rationals
        At 3^count nodes: at the ends and in the middle of each of so many sides, the last varying
        fastest.

    Returns
    -------
    list of (n, .) rationals
        Bernstein coefficients of degree 2 on the box.
    """
    rows, columns, every = len(values[0]), len(values[0][0]), range(len(values))
    length = longest(row for M in values for row in M)
    curve = [[[ZERO] * columns for _ in range(rows)] for _ in every]
    for i in range(rows):
        for j in range(columns):
            known = [M[i][j] for M in values]
            if known.count(known[0]) == len(known):
                continue
            spend(RATIONAL * 3 * (count + 1) * len(values), length, length)
            # in whole numbers, that stay whole when they are halved so many times
            whole = math.lcm(*(x.denominator for x in known)) << count
            middle = [x.numerator * (whole // x.denominator) for x in known]
            corners = list(middle)
            for axis in range(count):
                stride = 3**axis
                for k in every:
                    if k // stride % 3 == 1:
                        ends = (k - stride, k + stride)
                        # of a parabola through three points; of a straight line
                        middle[k] = 2 * middle[k] - (middle[ends[0]] + middle[ends[1]]) // 2
                        corners[k] = (corners[ends[0]] + corners[ends[1]]) // 2
            for k in every:
                curve[k][i][j] = Fraction(middle[k] - corners[k], whole)
    return [
        curve[sum(3 ** (count - 1 - axis) * e[2 * axis + 1] for axis in range(count))]
        for e in monomials((2,) * count, 2)
    ]


@dataclass(frozen=True)
class Spread(Short):
    """Omega, more than V'V at every alpha, or kappa, and the rows and columns of H and V.

    ``rows`` holds one number a state, ``columns`` one a state, input and disturbance.
    """

    omega: Rationals = field(default_factory=list)
    rows: tuple[Fraction, ...] = ()
    columns: tuple[Fraction, ...] = ()
    kappa: Fraction = ZERO

    def require(self, remainder: Remainder, omega: bool = True, kappa: bool = False) -> None:
        """Refuse one that does not fit, or does not cover the remainder.

        Parameters
        ----------
        omega, kappa : bool
            Which of the two it has.
        """
        n, width = len(remainder.entries), len(remainder.entries[0])
        if kappa != bool(self.kappa) or self.kappa < 0:
            raise FormatError("remainder.kappa is a positive number, of the dual form for example")
        size = n if omega else 0
        if len(self.omega) != size or any(len(row) != n for row in self.omega):
            raise FormatError(f"remainder.omega must hold {n} rows of {n} numbers")
        if any(self.omega[i][j] != self.omega[j][i] for i in range(size) for j in range(i)):
            raise FormatError("remainder.omega must be symmetric")
        if len(self.rows) != n or len(self.columns) != width:
            raise FormatError(f"remainder: rows must hold {n} numbers, columns {width}")
        if min((*self.rows, *self.columns)) < 0:
            raise FormatError("remainder: rows and columns must be zero or more")
        common_denominator([[[*self.rows]], [[*self.columns]], [[self.kappa]], self.omega])
        if not self._covers(remainder):
            raise FormatError("remainder: rows and columns do not cover the plant's")

    def _covers(self, remainder: Remainder) -> bool:
        parts = [self.rows, self.columns, *remainder.entries]
        length = max(max(map(int.bit_length, x.as_integer_ratio())) for rows in parts for x in rows)
        spend(RATIONAL * len(self.rows) * len(self.columns), 4 * length, 2 * length)
        total = 0
        for row, entries in zip(self.rows, remainder.entries, strict=True):
            for column, entry in zip(self.columns, entries, strict=True):
                if entry and not row * column:
                    return False
                if entry:  # rounded up, so that the sum stays short
                    total += math.ceil((entry / (row * column)) ** 2 * UNIT)
        return total <= UNIT

    def moving(self, XKX: Polynomial) -> Polynomial:
        """Return V."""
        return diagonal(self.columns[: XKX.shape[0]], XKX.sizes) * XKX

    def driving(self, scales: Sequence[Fraction], q: int) -> tuple[Fraction, ...]:
        """Return the columns of the disturbances, each times its scale."""
        columns = self.columns[len(self.columns) - q :] if q else ()
        return tuple(x * s for x, s in zip(columns, scales, strict=True)) if scales else columns

    def bounding(self, V: Polynomial) -> list[list[Polynomial]]:
        """Return the blocks that say that Omega is more: [ Omega, V'; V, I ]."""
        sizes = V.sizes
        return [[constant(self.omega, sizes), V.T], [constant(identity(V.shape[0]), sizes)]]

    def entering(self, times: Fraction | int = 1) -> Rationals:
        """Return so many times H H'."""
        return [
            [times * row * row if i == j else ZERO for j in range(len(self.rows))]
            for i, row in enumerate(self.rows)
        ]

    def of_region(self, factors: tuple[Rationals, Rationals]) -> Rationals:
        """Return M1 M1' (x) H H' + M2'M2 (x) Omega, of M = M1 M2."""
        M1, M2 = factors
        left = product(M1, [list(column) for column in zip(*M1, strict=True)])
        right = product([list(column) for column in zip(*M2, strict=True)], M2)
        one, other = self.entering(), self.omega
        n = len(one)
        return [
            [
                left[a][b] * one[i][j] + right[a][b] * other[i][j]
                for b in range(len(left))
                for j in range(n)
            ]
            for a in range(len(left))
            for i in range(n)
        ]
