"""Functions of the parameters as polynomials on a part of the box, with what these are off by.

On a part, in coordinates t from 0 to 1 of the scheduling variables, a function is interpolated in
each coordinate at the nodes (1 - cos(pi j / d)) / 2. A polynomial of no higher degree is
interpolated exactly. Of another function the error is at most the sum over its parameters of

    L^(i - 1) K max |c_i|,

with c_i the Taylor coefficient of order d + 1 along the parameter, K the largest magnitude of the
product of t - t_j, and L, the Lebesgue constant, for the interpolations that follow one another. Of
a function of one parameter, where that is not small, it is bounded on intervals of t, from its
Taylor series about their middles less the polynomial's; and of sums of products of such functions
from those of the factors.
Where a table has a knot inside, fewer derivatives are bounded. Of s of them a polynomial of degree
s - 1 is near, and the interpolation of d is off by 1 + L^q times as much at most. With straight
lines between its values the function is interpolated between the corners alone: with slopes from a
to b the error is at most (b - a) / 4.

All is computed in intervals, the same wherever the part is asked for: a file holds the functions,
and no approximation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import product as cartesian
from typing import Any

from polefence.proof import intervals
from polefence.proof.functions import MAX_POWER, SMOOTH, KinkError, Memo, Series, Table, Tree
from polefence.proof.intervals import ONE, ZERO, Interval, NoValueError, enclosing
from polefence.proof.polynomials import monomials
from polefence.proof.ranges import Range
from polefence.proof.short import Short
from polefence.proof.work import RATIONAL, FormatError, spend

Point = tuple[Fraction, ...]

HIGHEST = (0, 8, 8, 3, 2, 2, 1, 1, 1)  # degree, of so many parameters: 125 coefficients at most
ENOUGH = Fraction(1, 2**17)  # of a function's size: a smaller error asks for no higher degree
ROUNDED = 44  # bits of coefficients, of a function's size
ORDER = 11  # of Taylor series with which errors are bounded
LEAST_HALVINGS, MOST_HALVINGS = 4, 6  # of an interval of t
PIECES = 4  # along each parameter, on which coefficients are bounded
# Of degree 1, 2, ...: upper bounds on K and L.
PRODUCT = tuple(Fraction(x, 2**22) for x in (1048577, 201799, 65537, 15209, 4081, 989, 256, 63))
LEBESGUE = tuple(Fraction(x, 1000) for x in (1001, 1251, 1667, 1799, 1985, 2082, 2202, 2276))


def nodes(degree: int) -> list[Fraction]:
    """Return where it is interpolated, in whole multiples of 1/1024."""
    turns = (math.pi * j / degree for j in range(degree + 1))
    return [Fraction(round(512 * (1 - math.cos(turn))), 1024) for turn in turns]


@dataclass(frozen=True)
class Approximation(Short):
    """A function on a part of the box.

    Attributes
    ----------
    corners : tuple of Fraction
        Values at the corners of the part, the last parameter varying fastest.
    curve : tuple of Fraction
        Bernstein coefficients of what is added to their interpolation, as `monomials` orders them.
    error : Fraction
        What the sum of both is off by at most.
    """

    corners: tuple[Fraction, ...]
    curve: tuple[Fraction, ...]
    error: Fraction


@dataclass(frozen=True)
class Functions(Short):
    """Functions of the parameters of a box."""

    ranges: tuple[Range, ...]
    trees: tuple[Tree, ...]
    tables: tuple[tuple[str, Table], ...] = ()
    _known: dict[tuple[Point, Point], tuple[int, tuple[Approximation, ...]]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        """Let functions share what they have in common."""
        known = dict[Tree, Tree]()
        object.__setattr__(self, "trees", tuple(tree.shared(known) for tree in self.trees))

    @cached_property
    def by_name(self) -> Mapping[str, Table]:
        """The tables."""
        return dict(self.tables)

    @cached_property
    def derivatives(self) -> tuple[tuple[tuple[Interval, ...], ...], ...]:
        """Of each function, along each parameter: values and three derivatives on the box.

        They are those between the knots of tables.
        """
        tables = tuple((name, table.between_knots) for name, table in self.tables)
        parts, count = replace(self, tables=tables)._on_whole_box, len(self.ranges)
        return tuple(tuple(part.derivatives(i) for i in range(count)) for part in parts)

    @property
    def _on_whole_box(self) -> tuple[_Part, ...]:
        count = len(self.ranges)
        whole = (Fraction(0),) * count, (Fraction(1),) * count
        return tuple(_Part(self, tree, *whole) for tree in self.trees)

    def knotted(self, low: Point, high: Point) -> tuple[tuple[int, Fraction], ...]:
        """Return how many derivatives of each function are bounded on a part of the box.

        Where that is one, it comes with what the function is off by from the interpolation between
        its values at the corners; else with zero.
        """
        parts = [_Part(self, tree, low, high) for tree in self.trees]
        return tuple(
            (part.smooth, _short_up(part.chord_error()) if part.kinked else Fraction(0))
            for part in parts
        )

    def values(self, at: Point) -> tuple[Fraction, ...]:
        """Return the functions at a point of the box, to what `widest` says."""
        known = ((part, part.exactly(at)) for part in self._on_whole_box)
        return tuple(intervals.middle(part.value(at)) if x is None else x for part, x in known)

    def widest(self, at: Point) -> Fraction:
        """Return what `values` are off by at most."""
        known = [part.value(at) for part in self._on_whole_box if part.exactly(at) is None]
        return max((Fraction(b - a, ONE) for a, b in known), default=Fraction(0))

    @property
    def on_box(self) -> tuple[int, tuple[Approximation, ...]]:
        """The same on the whole box."""
        count = len(self.ranges)
        return self.on_part((Fraction(0),) * count, (Fraction(1),) * count)

    def on_part(self, low: Point, high: Point) -> tuple[int, tuple[Approximation, ...]]:
        """Return the degree of their polynomials on a part of the box, and these.

        Raises
        ------
        NoValueError
            If a function has no value somewhere: a denominator may be zero there.
        """
        if (low, high) not in self._known:
            memo = dict[tuple[Any, ...], Memo]()
            parts = [_Part(self, tree, low, high, memo) for tree in self.trees]
            degree = max((part.degree for part in parts), default=1)
            known = degree, tuple(part.approximation(degree) for part in parts)
            self._known[low, high] = known
        return self._known[low, high]


@dataclass(frozen=True)
class _Part:
    """A function on a part of the box."""

    functions: Functions
    tree: Tree
    low: Point
    high: Point
    # series of what functions have in common, at each box of t, parameter and order
    memo: dict[tuple[Any, ...], Memo] = field(default_factory=dict, compare=False)

    @cached_property
    def axes(self) -> list[int]:
        """Numbers of the parameters that it is a function of."""
        names = self.tree.names
        return [i for i, r in enumerate(self.functions.ranges) if r.name in names]

    def _place(self, i: int, t: Interval, along: bool, order: int) -> Series:
        """Return the series of parameter i about t, from 0 to 1 of the part."""
        r = self.functions.ranges[i]
        ends = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
        first, last = (ends[0] + (ends[1] - ends[0]) * at[i] for at in (self.low, self.high))
        value = intervals.plus(enclosing(first), intervals.times(enclosing(last - first), t))
        series = [_between(value, first, last), *[ZERO] * order]
        if along and order:
            series[1] = enclosing(last - first)
        if not r.inverted:
            return series
        value, *higher = _inverse(series)
        return [_between(value, 1 / first, 1 / last), *higher]

    def series(self, t: Sequence[Interval], along: int | None, order: int) -> Series:
        """Return the function's series along a parameter, about each point of a box of t.

        Intervals may say that a denominator has a zero where it has none. The box is halved then.
        """
        waiting, found = [(list(t), 0)], list[Series]()
        while waiting:
            box, halvings = waiting.pop()
            try:
                found.append(self._series(box, along, order))
            except NoValueError as error:
                if halvings == MOST_HALVINGS * len(self.axes):
                    raise NoValueError(f"{error}, at {self._place_text(box)}") from error
                i = max(self.axes, key=lambda axis: box[axis][1] - box[axis][0])
                a, b = box[i]
                if b - a < 2:
                    raise NoValueError(f"{error}, at {self._place_text(box)}") from error
                halves = ((a, (a + b) // 2), ((a + b) // 2, b))
                waiting += [([*box[:i], half, *box[i + 1 :]], halvings + 1) for half in halves]
        return [intervals.hull(column) for column in zip(*found, strict=True)]

    def _series(self, t: Sequence[Interval], along: int | None, order: int) -> Series:
        ranges = self.functions.ranges
        known = {r.name: self._place(i, t[i], i == along, order) for i, r in enumerate(ranges)}
        shared = self.memo.setdefault((*t, along, order), {})
        return self.tree.series(known, self.functions.by_name, shared)

    def _place_text(self, t: Sequence[Interval]) -> str:
        """Say where in the box something is."""
        places = []
        for i in self.axes:
            r = self.functions.ranges[i]
            a, b = (float(Fraction(x, ONE)) for x in self._place(i, t[i], False, 0)[0])
            about = "about " if a < b else ""
            places.append(f"{r.name} {about or '= '}{(a + b) / 2:.4g}")
        return ", ".join(places)

    def value(self, t: Sequence[Fraction]) -> Interval:
        """Return the function at a point, from 0 to 1 of the part."""
        return self.series([enclosing(x) for x in t], None, 0)[0]

    def derivatives(self, i: int) -> tuple[Interval, ...]:
        """Return the ranges of the value and of three derivatives along a parameter."""
        if i not in self.axes:
            return (self.series(self._whole, None, 0)[0], ZERO, ZERO, ZERO)
        series = [self.series(box, i, 3) for box in self._boxes(-1)]
        hulls = [intervals.hull(column) for column in zip(*series, strict=True)]
        factors = (enclosing(Fraction(math.factorial(k))) for k in range(4))
        return tuple(map(intervals.times, hulls, factors))

    def exactly(self, t: Sequence[Fraction]) -> Fraction | None:
        """Return the function at a point where it is a short rational, else None."""
        values = self._parameters(t)
        spend(RATIONAL * self.tree.size * MAX_POWER, 400, 400)
        if max(x.denominator.bit_length() for x in values.values()) > 64:
            return None
        exact = self.tree.exact(values)
        return exact if exact is not None and exact.denominator.bit_length() <= 2000 else None

    @cached_property
    def exact_degree(self) -> int | None:
        """Its degree as a polynomial in t, None where it is none that is known exactly."""
        inverted = frozenset(r.name for r in self.functions.ranges if r.inverted)
        degrees = [_degree_in(self.tree, name, inverted) for name in self.tree.names]
        return None if None in degrees else max((d for d in degrees if d is not None), default=0)

    @cached_property
    def highest(self) -> int:
        """The highest degree that is tried."""
        return HIGHEST[len(self.functions.ranges)]

    @property
    def is_exact(self) -> bool:
        """Whether it is a polynomial of a degree that is tried."""
        return self.exact_degree is not None and self.exact_degree <= self.highest

    @cached_property
    def size(self) -> Fraction:
        """Its largest magnitude, nearly."""
        ends = cartesian(*([(0, 1, 2)] * len(self.axes)))
        largest = Fraction(1, 2**60)
        for end in ends:
            t = [Fraction(0)] * len(self.low)
            for i, x in zip(self.axes, end, strict=True):
                t[i] = Fraction(x, 2)
            largest = max(largest, intervals.size(self.value(t)))
        return largest

    @cached_property
    def smooth(self) -> int:
        """How many derivatives are bounded on the part: few where a table has a knot inside.

        It is told of the whole part: pieces of it may end at a knot.
        """
        tables = [self.functions.by_name[name] for name in self.tree.tables(self.functions.by_name)]
        if tables:
            try:
                for i in self.axes:
                    self._series(self._whole, i, ORDER)
            except (KinkError, NoValueError):
                return min(table.smooth for table in tables)
        return SMOOTH

    @property
    def kinked(self) -> bool:
        """Whether a table between whose values are straight lines has a knot inside."""
        return self.smooth < 2

    @property
    def _whole(self) -> list[Interval]:
        return [(0, ONE)] * len(self.low)

    @cached_property
    def degree(self) -> int:
        """The lowest degree that is good enough, or as good as any."""
        if self.is_exact:
            return max(1, self.exact_degree or 0)
        if self.kinked or not self.axes:
            return 1
        errors, every = list[Fraction](), range(1, self.highest + 1)
        for degree in every:
            if self._by_derivatives(degree) <= ENOUGH * self.size:
                return degree
        for degree in every:
            errors.append(self.error(degree))
            if errors[-1] <= ENOUGH * self.size:
                return degree
        least = min(errors)
        return next(k + 1 for k, error in enumerate(errors) if error <= 2 * least)

    def error(self, degree: int) -> Fraction:
        """Return what the interpolation of a degree is off by, before any rounding."""
        error = self._by_derivatives(degree)
        if error <= ENOUGH * self.size or not self.axes:
            return error
        if len(self.axes) == 1:
            return min(error, self._errors[degree])
        return min(error, self._by_factors(degree))

    @cached_property
    def _products(self) -> list[list[_Part]]:
        """Summands, each as factors of no parameter in common; none where one cannot be split."""
        products, summands = list[list[_Part]](), self.tree.summands
        for tree in summands:
            groups = list[tuple[frozenset[str], Tree]]()
            for factor in tree.factors:
                names, whole = factor.names, factor
                for group in [group for group in groups if group[0] & names]:
                    groups.remove(group)
                    names, whole = names | group[0], group[1] * whole
                groups.append((names, whole))
            if len(summands) == 1 and any(group[0] == self.tree.names for group in groups):
                return []
            products.append([replace(self, tree=whole) for _, whole in groups])
        return products

    def _by_factors(self, degree: int) -> Fraction:
        """Return the bound of products f g ..., each of which is interpolated by itself.

        What f is interpolated by times that of g is what the product is: it is off by at most
        |f| E(g) + (|g| + E(g)) E(f).
        """
        if not self._products:
            return self._by_derivatives(degree)
        total = Fraction(0)
        for factors in self._products:
            size, off = Fraction(1), Fraction(0)
            for factor in factors:
                error = Fraction(0) if factor.is_exact_in(degree) else factor.error(degree)
                size, off = size * factor.bound, size * error + (factor.bound + error) * off
            total += off
        return total

    def is_exact_in(self, degree: int) -> bool:
        """Whether it is a polynomial of no higher degree."""
        return self.exact_degree is not None and self.exact_degree <= degree

    @cached_property
    def bound(self) -> Fraction:
        """At least its largest magnitude."""
        return max(intervals.size(self.series(box, None, 0)[0]) for box in self._boxes(-1))

    def _by_derivatives(self, degree: int) -> Fraction:
        """Return the bound of Taylor coefficients: less work than `_errors`, and often larger.

        Of fewer derivatives it is that of a lower degree, times one and the Lebesgue constants.
        """
        if degree >= self.smooth:
            lower = self.chord_error() if self.kinked else self._by_derivatives(self.smooth - 1)
            return lower * (1 + LEBESGUE[degree - 1] ** len(self.axes))
        grown, total = Fraction(1), Fraction(0)
        for i in self.axes:
            total += grown * PRODUCT[degree - 1] * self._coefficients[i][degree + 1]
            grown *= LEBESGUE[degree - 1]
        return total

    @cached_property
    def _coefficients(self) -> dict[int, list[Fraction]]:
        """Along each parameter the largest magnitudes of Taylor coefficients, of each order."""
        known, order = dict[int, list[Fraction]](), min(self.highest + 1, self.smooth)
        for i in self.axes:
            series = [self.series(box, i, order) for box in self._boxes(i)]
            known[i] = [max(map(intervals.size, column)) for column in zip(*series, strict=True)]
        return known

    def _boxes(self, along: int) -> Iterator[list[Interval]]:
        """Yield pieces of the part: more along one parameter than along others; -1 for all."""
        counts = [
            1 if i not in self.axes else PIECES if along in (i, -1) else 2
            for i in range(len(self.low))
        ]
        for numbers in cartesian(*map(range, counts)):
            yield [
                (ONE * k // count, -(-ONE * (k + 1) // count))
                for k, count in zip(numbers, counts, strict=True)
            ]

    @cached_property
    def _errors(self) -> list[Fraction]:
        """Of a function of one parameter, what the interpolation of each degree is off by."""
        (i,) = self.axes
        polynomials = [self._along(i, degree) for degree in range(1, self.highest + 1)]
        worst = [Fraction(0)] * len(polynomials)
        waiting = [(Fraction(0), Fraction(1), 0)]
        while waiting:
            a, b, halvings = waiting.pop()
            bounds, rest = self._off_on(i, a, b, polynomials)
            most = LEAST_HALVINGS if 10 * rest <= ENOUGH * self.size else MOST_HALVINGS
            if halvings < most:
                middle = (a + b) / 2
                waiting += [(a, middle, halvings + 1), (middle, b, halvings + 1)]
            else:
                worst = list(map(max, worst, bounds))
        return [Fraction(0), *worst]

    def _off_on(
        self,
        i: int,
        a: Fraction,
        b: Fraction,
        polynomials: Sequence[Sequence[Fraction]],
        order: int = ORDER,
    ) -> tuple[list[Fraction], Fraction]:
        """Return bounds on |function - polynomial| on an interval, and what is left."""
        middle, half = (a + b) / 2, (b - a) / 2
        at = [(0, 0)] * len(self.low)
        at[i] = enclosing(middle)
        try:
            known = self.series(at, i, order - 1)
            at[i] = enclosing(a)[0], enclosing(b)[1]
            rest = intervals.size(self.series(at, i, order)[order]) * half**order
        except KinkError as error:  # the series is as long as there are derivatives
            return self._off_on(i, a, b, polynomials, error.smooth)
        bounds = []
        for polynomial in polynomials:
            shifted, total = _shifted(polynomial, middle), rest
            for k in range(max(order, len(shifted))):
                x = known[k] if k < order else ZERO
                y = enclosing(shifted[k]) if k < len(shifted) else ZERO
                total += intervals.size(intervals.minus(x, y)) * half**k
            bounds.append(_short_up(total))
        return bounds, rest

    def _along(self, i: int, degree: int) -> list[Fraction]:
        """Return the coefficients of 1, t, t^2, ... of the interpolation, of one parameter."""
        points = nodes(degree)
        t = [Fraction(0)] * len(self.low)
        values = []
        for x in points:
            t[i] = x
            values.append(intervals.middle(self.value(t)))
        return _through(points, values)

    def approximation(self, degree: int) -> Approximation:
        """Return it as a polynomial of that degree, with its error."""
        count = len(self.low)
        sizes = (2,) * count
        unit = Fraction(1) if self.is_exact else _power_of_two(self.size) / 2**ROUNDED
        chord = not self.is_exact and self.kinked
        corners = [self._rounded(t, unit) for t in self._lattice((Fraction(0), Fraction(1)))]
        exponents = list(monomials(sizes, degree))
        if chord or degree == 1:
            curve = [Fraction(0)] * len(exponents)
        else:
            curve = self._curve(degree, corners, exponents, unit)
        if self.is_exact:
            return Approximation(tuple(corners), tuple(curve), Fraction(0))
        if chord:
            error = self.chord_error()
        elif not self.axes:
            error = Fraction(0)
        else:
            error = self.error(degree)
        # every value and every coefficient is rounded by a unit at most
        grown = math.prod([LEBESGUE[degree - 1]] * len(self.axes), start=Fraction(1))
        return Approximation(tuple(corners), tuple(curve), _short_up(error + (4 + grown) * unit))

    def chord_error(self) -> Fraction:
        """Return what it is off by from the interpolation between its values at the corners."""
        total = Fraction(0)
        for i in self.axes:
            slope = self.series(self._whole, i, 1)[1]
            total += Fraction(slope[1] - slope[0], 4 * ONE)
        return total

    def _lattice(self, points: Sequence[Fraction]) -> list[list[Fraction]]:
        return [list(t) for t in cartesian(points, repeat=len(self.low))]

    def _rounded(self, t: Sequence[Fraction], unit: Fraction) -> Fraction:
        """Return the value at a point, exactly or to the unit."""
        if self.is_exact:
            exact = self.tree.exact(self._parameters(t))
            if exact is None:
                raise FormatError("a function has no value at a corner")
            return exact
        return round(intervals.middle(self.value(t)) / unit) * unit

    def _parameters(self, t: Sequence[Fraction]) -> dict[str, Fraction]:
        values = {}
        for i, r in enumerate(self.functions.ranges):
            ends = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
            share = self.low[i] + (self.high[i] - self.low[i]) * t[i]
            s = ends[0] + (ends[1] - ends[0]) * share
            values[r.name] = 1 / s if r.inverted else s
        return values

    def _curve(
        self,
        degree: int,
        corners: Sequence[Fraction],
        exponents: Sequence[tuple[int, ...]],
        unit: Fraction,
    ) -> list[Fraction]:
        """Return the Bernstein coefficients of what is added to the corners' interpolation."""
        points, count = nodes(degree), len(self.low)
        values = {}
        for numbers in cartesian(range(degree + 1), repeat=count):
            # along what it is no function of, values are those at the first node
            key = tuple([k if i in self.axes else 0 for i, k in enumerate(numbers)])
            if key not in values:
                values[key] = self._rounded([points[k] for k in key], unit)
            values[numbers] = values[key]
        table = [values[numbers] for numbers in cartesian(range(degree + 1), repeat=count)]
        matrix = _to_bernstein(degree)
        spend(RATIONAL * count * len(table) * (degree + 1), 200, 100)
        for axis in range(count):
            table = _along_axis(table, axis, count, degree, matrix)
        corner = dict(zip(cartesian((0, 1), repeat=count), corners, strict=True))
        curve = []
        for e in exponents:
            upper = e[1::2]
            place = sum(k * (degree + 1) ** (count - 1 - i) for i, k in enumerate(upper))
            chord = sum(
                value
                * math.prod(
                    (
                        Fraction(k if c else degree - k, degree)
                        for c, k in zip(at, upper, strict=True)
                    ),
                    start=Fraction(1),
                )
                for at, value in corner.items()
            )
            more = table[place] - chord
            curve.append(more if self.is_exact else round(more / unit) * unit)
        return curve


def _between(value: Interval, first: Fraction, last: Fraction) -> Interval:
    """Return an interval without what rounding adds beyond two ends: no value of a parameter."""
    low, high = sorted((first, last))
    return max(value[0], enclosing(low)[0]), min(value[1], enclosing(high)[1])


def _inverse(series: Series) -> Series:
    """Return the series of 1 / s, where s is affine."""
    one = intervals.inverse(series[0])
    inverted, step = [one], intervals.ZERO
    step = intervals.negative(intervals.times(series[1], one)) if len(series) > 1 else step
    for _ in series[1:]:
        inverted.append(intervals.times(inverted[-1], step))
    return inverted


def _degree_in(tree: Tree, name: str, inverted: frozenset[str]) -> int | None:
    """Return the degree in a parameter, or in its inverse; None of what is no polynomial in it."""
    if tree.kind in ("number", "name"):
        return None if tree.word == name in inverted else int(tree.word == name)
    if tree.kind == "/":
        above = _degree_in(tree.of[0], name, inverted)
        power = _power_in(tree.of[1], name, inverted)
        return None if above is None or power is None else above + power
    parts = [_degree_in(part, name, inverted) for part in tree.of]
    known = [d for d in parts if d is not None]
    if len(known) < len(parts) or tree.kind == "call":
        return None
    if tree.kind == "+":
        return max(known)
    if tree.kind == "*":
        return sum(known)
    whole = tree.number.denominator == 1 and tree.number >= 0
    return known[0] * int(tree.number) if whole else None


def _power_in(tree: Tree, name: str, inverted: frozenset[str]) -> int | None:
    """Return the power of a parameter in a product of powers of those in ``inverted``."""
    if tree.kind == "number":
        return 0
    if tree.kind == "name":
        return int(tree.word == name) if tree.word in inverted else None
    powers = [_power_in(part, name, inverted) for part in tree.of]
    if None in powers or tree.kind not in ("*", "**"):
        return None
    total = sum(p for p in powers if p is not None)
    if tree.kind == "*":
        return total
    whole = tree.number.denominator == 1 and tree.number >= 0
    return total * int(tree.number) if whole else None


def _through(points: Sequence[Fraction], values: Sequence[Fraction]) -> list[Fraction]:
    """Return the coefficients of 1, t, ... of the polynomial through values (Newton)."""
    spend(RATIONAL * 2 * len(points) ** 2, 400, 200)
    divided = list(values)
    for k in range(1, len(points)):
        for j in reversed(range(k, len(points))):
            divided[j] = (divided[j] - divided[j - 1]) / (points[j] - points[j - k])
    total = [divided[-1]]
    for k in reversed(range(len(points) - 1)):
        raised = [Fraction(0), *total]
        for j, x in enumerate(total):
            raised[j] -= points[k] * x
        raised[0] += divided[k]
        total = raised
    return total


def _shifted(polynomial: Sequence[Fraction], by: Fraction) -> list[Fraction]:
    """Return the coefficients about another point."""
    spend(RATIONAL * len(polynomial) ** 2, 400, 100)
    shifted = list(polynomial)
    for k in range(len(shifted) - 1):
        for j in reversed(range(k, len(shifted) - 1)):
            shifted[j] += by * shifted[j + 1]
    return shifted


def _to_bernstein(degree: int) -> list[list[Fraction]]:
    """Return the matrix from values at the nodes to Bernstein coefficients."""
    points, columns = nodes(degree), []
    for j in range(degree + 1):
        power = _through(points, [Fraction(int(k == j)) for k in range(degree + 1)])
        columns.append(
            [
                sum(
                    (
                        Fraction(math.comb(i, k), math.comb(degree, k)) * power[k]
                        for k in range(i + 1)
                    ),
                    Fraction(0),
                )
                for i in range(degree + 1)
            ]
        )
    return [list(row) for row in zip(*columns, strict=True)]


def _along_axis(
    table: Sequence[Fraction],
    axis: int,
    count: int,
    degree: int,
    matrix: Sequence[Sequence[Fraction]],
) -> list[Fraction]:
    """Return a table (degree + 1)^count times a matrix along one axis."""
    stride, result = (degree + 1) ** (count - 1 - axis), list(table)
    for place in range(len(table)):
        k = place // stride % (degree + 1)
        first = place - k * stride
        line = (table[first + j * stride] for j in range(degree + 1))
        result[place] = sum((x * y for x, y in zip(matrix[k], line, strict=True)), Fraction(0))
    return result


def _power_of_two(x: Fraction) -> Fraction:
    return Fraction(2) ** (x.numerator.bit_length() - x.denominator.bit_length())


def _short_up(x: Fraction) -> Fraction:
    """Return a number that is no less, of 24 bits."""
    if not x:
        return x
    unit = _power_of_two(x) / 2**24
    return math.ceil(x / unit) * unit
