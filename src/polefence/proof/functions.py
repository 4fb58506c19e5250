"""Functions of the parameters as texts say them: parsed, never executed, and enclosed.

A tree has numbers, names of parameters, the four operations, powers and functions of one argument;
tables among these. Its value at a point, its range over a part of the box, and the coefficients of
its Taylor series along one parameter anywhere in the part are intervals that hold the true ones.

The series of g(h(t)) is that of g about the range of h_0, of which the powers of h - h_0 are taken:
so its coefficients hold those at every point.
"""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from itertools import product as product_of
from typing import Any

from polefence.proof import intervals
from polefence.proof.intervals import UNIT, ZERO, Interval, NoValueError, enclosing
from polefence.proof.short import Short
from polefence.proof.work import FormatError, spend

MAX_LENGTH = 4000  # characters of a text
MAX_NODES = 400  # operations of one
MAX_DEPTH = 60
MAX_SUMMANDS = 64
MAX_PLACES = 13  # of a decimal in a text
MAX_POWER = 32
MAX_KNOTS = 200  # of a table
MAX_DIGITS = 300
MAX_TEN = 100  # a number's exponent of ten
SMOOTH = 1000  # derivatives that most functions have

Series = list[Interval]  # coefficients of 1, t, t^2, ... along one parameter


class KinkError(FormatError):
    """A derivative of this order is unbounded: a knot of a table is inside."""

    def __init__(self, smooth: int) -> None:
        super().__init__("a table has a knot there")
        self.smooth = smooth  # derivatives that are bounded


@dataclass(frozen=True)
class Table(Short):
    """Values between which is interpolated, linearly or by cubic polynomials.

    The cubic ones have at each knot the slope of Fritsch and Butland (1984), so that values between
    two knots lie between theirs. There is no value before the first knot, nor behind the last.
    """

    arguments: tuple[Fraction, ...]
    values: tuple[Fraction, ...]
    cubic: bool = False

    def require(self, name: str) -> None:
        """Refuse knots that do not rise, and values that are not theirs."""
        if len(self.arguments) != len(self.values) or not 2 <= len(self.values) <= MAX_KNOTS:
            raise FormatError(
                f"table {name}: arguments and values must be as many, 2 to {MAX_KNOTS}"
            )
        for k, (a, b) in enumerate(pairwise(self.arguments)):
            if a >= b:
                raise FormatError(
                    f"table {name}: arguments must rise; number {k + 2} is not above number {k + 1}"
                )

    @property
    def smooth(self) -> int:
        """How many derivatives are bounded where a knot is inside."""
        return 2 if self.cubic else 1

    @property
    def between_knots(self) -> Table:
        """It with derivatives that are those between its knots, all of which are bounded."""
        return _BetweenKnots(self.arguments, self.values, self.cubic)

    @cached_property
    def pieces(self) -> tuple[tuple[Fraction, Fraction, tuple[Fraction, ...]], ...]:
        """Each knot, the next one, and the coefficients of the polynomial about the first."""
        steps = [b - a for a, b in pairwise(self.arguments)]
        rises = [(b - a) / h for (a, b), h in zip(pairwise(self.values), steps, strict=True)]
        slopes = self._slopes(steps, rises) if self.cubic else None
        pieces = list[tuple[Fraction, Fraction, tuple[Fraction, ...]]]()
        for k, (a, b) in enumerate(pairwise(self.arguments)):
            y, d, h = self.values[k], rises[k], steps[k]
            if slopes is None:
                pieces.append((a, b, (y, d)))
                continue
            s, e = slopes[k], slopes[k + 1]
            pieces.append((a, b, (y, s, (3 * d - 2 * s - e) / h, (s + e - 2 * d) / h**2)))
        return tuple(pieces)

    @staticmethod
    def _slopes(steps: Sequence[Fraction], rises: Sequence[Fraction]) -> list[Fraction]:
        slopes = [rises[0]]
        for (h, k), (d, e) in zip(pairwise(steps), pairwise(rises), strict=True):
            weights = 2 * k + h, k + 2 * h
            same = d * e > 0
            slopes.append(sum(weights) / (weights[0] / d + weights[1] / e) if same else Fraction(0))
        return [*slopes, rises[-1]]

    def coefficients(self, at: Interval, order: int) -> Series:
        """Return the Taylor coefficients at every point of an interval.

        Raises
        ------
        NoValueError
            If it reaches beyond the table.
        KinkError
            If one of that order is unbounded.
        """
        low, high = (Fraction(x, intervals.ONE) for x in at)
        first, last = self.arguments[0], self.arguments[-1]
        room = Fraction(4, intervals.ONE)  # that of the rounding of an end
        if low < first - room or high > last + room:
            raise NoValueError(
                f"a table from {float(first):g} to {float(last):g} may be asked for "
                f"{float(low if low < first else high):g}"
            )
        met = [p for p in self.pieces if p[0] < high - room and low + room < p[1]]
        met = met or [p for p in self.pieces if p[0] <= high and low <= p[1]] or [self.pieces[-1]]
        if len(met) > 1 and order > self.smooth:
            raise KinkError(self.smooth)
        series = []
        for a, b, polynomial in met:
            inside = max(low, a), min(high, b)
            about = enclosing(min(inside) - a)[0], enclosing(max(inside) - a)[1]
            series.append([_derivative(polynomial, k, about) for k in range(order + 1)])
        return [intervals.hull(column) for column in zip(*series, strict=True)]


class _BetweenKnots(Table):
    """A table whose derivatives are those between its knots."""

    @property
    def smooth(self) -> int:
        """All are bounded there."""
        return SMOOTH


def _derivative(polynomial: Sequence[Fraction], order: int, at: Interval) -> Interval:
    """Return the range of a polynomial's derivative of an order, over its factorial."""
    total = ZERO
    for k in reversed(range(order, len(polynomial))):
        term = enclosing(math.comb(k, order) * polynomial[k])
        total = intervals.plus(intervals.times(total, at), term)
    return total


# --- functions of one argument ------------------------------------------------------------------

Coefficients = Callable[[Interval, int], Series]  # of g about every point of an interval


def _of_power(power: Fraction) -> Coefficients:
    """Return the coefficients of x^power: binomial(power, k) x^(power - k)."""

    def coefficients(at: Interval, order: int) -> Series:
        value, one = _power(at, power), intervals.inverse(at)
        series, factor = [], Fraction(1)
        for k in range(order + 1):
            series.append(intervals.times(value, enclosing(factor)))
            value, factor = intervals.times(value, one), factor * (power - k) / (k + 1)
        return series

    return coefficients


def _power(x: Interval, power: Fraction) -> Interval:
    if power == Fraction(1, 2):
        return intervals.root(x)
    if power == -1:
        return intervals.inverse(x)
    try:
        exponent = intervals.times(intervals.logarithm(x), enclosing(power))
    except NoValueError as error:
        raise NoValueError(
            "the base of a power that is no whole number may be zero or less"
        ) from error
    return intervals.exponential(exponent)


def _of_exp(at: Interval, order: int) -> Series:
    value, factors = intervals.exponential(at), range(order + 1)
    return [intervals.times(value, enclosing(Fraction(1, math.factorial(k)))) for k in factors]


def _of_sine(at: Interval, order: int, first: int = 0) -> Series:
    s, c = intervals.sine(at), intervals.cosine(at)
    turns = (s, c, intervals.negative(s), intervals.negative(c))
    return [
        intervals.times(turns[(k + first) % 4], enclosing(Fraction(1, math.factorial(k))))
        for k in range(order + 1)
    ]


def _of_cosine(at: Interval, order: int) -> Series:
    return _of_sine(at, order, 1)


def _of_logarithm(at: Interval, order: int) -> Series:
    series, power, one = [intervals.logarithm(at)], UNIT, intervals.inverse(at)
    for k in range(1, order + 1):
        power = intervals.times(power, one)
        series.append(intervals.times(power, enclosing(Fraction((-1) ** (k + 1), k))))
    return series


_INVERSE, _ROOT = _of_power(Fraction(-1)), _of_power(Fraction(1, 2))
FUNCTIONS: Mapping[str, Coefficients] = {
    "sqrt": _ROOT,
    "exp": _of_exp,
    "log": _of_logarithm,
    "sin": _of_sine,
    "cos": _of_cosine,
}


def product(a: Series, b: Series) -> Series:
    """Return the series of a product."""
    return [
        _total(intervals.times(a[i], b[k - i]) for i in range(k + 1) if a[i] != ZERO)
        for k in range(len(a))
    ]


def _total(terms: Iterator[Interval]) -> Interval:
    low = high = 0
    for a, b in terms:
        low, high = low + a, high + b
    return low, high


def composed(outer: Coefficients, inner: Series) -> Series:
    """Return the series of g(h)."""
    order = len(inner) - 1
    if not any(x != ZERO for x in inner[1:]):
        return [outer(inner[0], 0)[0], *[ZERO] * order]
    series = outer(inner[0], order)
    rest, total = [ZERO, *inner[1:]], [series[-1], *[ZERO] * order]
    for coefficient in reversed(series[:-1]):
        total = product(total, rest)
        total[0] = intervals.plus(total[0], coefficient)
    return total


# --- trees ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tree(Short):
    """A function: an operation and what it is of; numbers and names are its leaves.

    ``kind`` is "number", "name", "+", "*", "/", "**" or "call"; ``word`` a name, or that of a
    function or a table; ``number`` a value, or a power.
    """

    kind: str
    of: tuple[Tree, ...] = ()
    word: str = ""
    number: Fraction = Fraction(0)
    size: int = field(default=1, compare=False)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of parameters in it."""
        if self.kind == "name":
            return frozenset([self.word])
        return frozenset().union(*(tree.names for tree in self.of))

    def tables(self, known: Mapping[str, Table]) -> frozenset[str]:
        """Names of tables in it."""
        own = frozenset([self.word] if self.kind == "call" and self.word in known else [])
        return own.union(*(tree.tables(known) for tree in self.of))

    def knots(self, name: str, known: Mapping[str, Table]) -> frozenset[Fraction]:
        """Arguments at which tables of one parameter alone have their knots."""
        own = frozenset[Fraction]()
        if self.kind == "call" and self.word in known and self.of[0] == variable(name):
            own = frozenset(known[self.word].arguments)
        return own.union(*(tree.knots(name, known) for tree in self.of))

    @property
    def factored(self) -> tuple[Fraction, Tree]:
        """A number and another function, of which it is the product."""
        factor, tree = Fraction(1), self
        while tree.kind == "*" and "number" in (tree.of[0].kind, tree.of[1].kind):
            number, tree = sorted(tree.of, key=lambda part: part.kind != "number")
            factor *= number.number
        return factor, tree

    @property
    def factors(self) -> list[Tree]:
        """Trees of which it is the product."""
        if self.kind == "*":
            return [*self.of[0].factors, *self.of[1].factors]
        if self.kind == "/":
            return [*self.of[0].factors, *(lift(1) / tree for tree in self.of[1].factors)]
        return [self]

    @property
    def summands(self) -> list[Tree]:
        """Trees of which it is the sum, where products of sums are not many."""
        if self.kind == "+":
            return [*self.of[0].summands, *self.of[1].summands]
        parts = [factor.summands if factor.kind == "+" else [factor] for factor in self.factors]
        if len(parts) < 2 or math.prod(map(len, parts)) > MAX_SUMMANDS:
            return [self]
        return [math.prod(choice, start=lift(1)) for choice in product_of(*parts)]

    @cached_property
    def text(self) -> str:
        """It as `parse` reads it."""
        return self._written[0]

    @cached_property
    def _written(self) -> tuple[str, int]:
        """Its text, and how firmly that holds together: 1 a sum, 2 a product, 3 a power, 4 all."""
        if self.kind == "number":
            return _number_text(self.number)
        if self.kind == "name":
            return self.word, 4
        if self.kind == "call":
            return f"{self.word}({self.of[0].text})", 4
        if self.kind == "**":
            exponent, firm = _number_text(self.number)
            return f"{self.of[0]._within(4)}**{exponent if firm == 4 else f'({exponent})'}", 3
        left, right = self.of
        if self.kind == "+":
            if right.kind == "number" and right.number < 0:
                return f"{left.text} - {_number_text(-right.number)[0]}", 1
            if right.kind == "*" and right.of[1] == _MINUS_ONE:
                return f"{left.text} - {right.of[0]._within(2)}", 1
            return f"{left.text} + {right._within(2)}", 1
        if self.kind == "*" and right == _MINUS_ONE:
            return f"-{left._within(3)}", 2
        return f"{left._within(2)}{self.kind}{right._within(3)}", 2

    def _within(self, firm: int) -> str:
        """Its text where it has to hold together so firmly."""
        text, own = self._written
        return text if own >= firm and not (text.startswith("-") and firm > 2) else f"({text})"

    def __add__(self, other: Any) -> Tree:
        return _joined("+", self, lift(other))

    def __mul__(self, other: Any) -> Tree:
        return _joined("*", self, lift(other))

    def __truediv__(self, other: Any) -> Tree:
        return _joined("/", self, lift(other))

    def __neg__(self) -> Tree:
        return self * Fraction(-1)

    def __sub__(self, other: Any) -> Tree:
        return self + -lift(other)

    def __radd__(self, other: Any) -> Tree:
        return lift(other) + self

    def __rmul__(self, other: Any) -> Tree:
        return lift(other) * self

    def __rsub__(self, other: Any) -> Tree:
        return lift(other) - self

    def __rtruediv__(self, other: Any) -> Tree:
        return lift(other) / self

    def __pow__(self, power: Any) -> Tree:
        value = power.number if isinstance(power, Tree) else Fraction(power)
        if isinstance(power, Tree) and power.kind != "number":
            raise FormatError("a power must be a number")
        if abs(value) > MAX_POWER or value.denominator > 1000:
            raise FormatError(f"a power must be a number from -{MAX_POWER} to {MAX_POWER}")
        if value == 1:
            return self
        if self.kind == "number" and value.denominator == 1 and (self.number or value >= 0):
            return lift(self.number ** int(value))
        return Tree("**", (self,), number=value, size=self.size + 1)

    def lift(self, value: Any) -> Tree:
        """Return a number, or a tree, as a tree."""
        return lift(value)

    def called(self, word: str) -> Tree:
        """Return a function of it."""
        return Tree("call", (self,), word, size=self.size + 1)

    def sqrt(self) -> Tree:
        """Return its square root."""
        return self.called("sqrt")

    def sin(self) -> Tree:
        """Return its sine."""
        return self.called("sin")

    def cos(self) -> Tree:
        """Return its cosine."""
        return self.called("cos")

    def exp(self) -> Tree:
        """Return e to its power."""
        return self.called("exp")

    def log(self) -> Tree:
        """Return its natural logarithm."""
        return self.called("log")

    def require(self) -> None:
        """Refuse one that takes more work than is done here."""
        if self.size > MAX_NODES or len(self.text) > MAX_LENGTH:
            raise FormatError(
                f"a function of the parameters has more than {MAX_NODES} operations, or "
                f"{MAX_LENGTH} characters; simplify it"
            )

    def shared(self, known: dict[Tree, Tree]) -> Tree:
        """Return the same tree, whose parts are those that are known."""
        if self not in known:
            of = tuple(tree.shared(known) for tree in self.of)
            known[self] = Tree(self.kind, of, self.word, self.number, self.size)
        return known[self]

    def series(
        self,
        known: Mapping[str, Series],
        tables: Mapping[str, Table],
        memo: Memo,
    ) -> Series:
        """Return its series along one parameter, from those of its names.

        ``memo`` has those of trees that are done, by their identity.

        Raises
        ------
        NoValueError
            If it has no value somewhere.
        KinkError
            If a coefficient is unbounded.
        """
        if id(self) not in memo:  # with the tree, so that no other one gets its identity
            memo[id(self)] = self, self._series(known, tables, memo)
        return memo[id(self)][1]

    def _series(
        self,
        known: Mapping[str, Series],
        tables: Mapping[str, Table],
        memo: Memo,
    ) -> Series:
        order = len(next(iter(known.values()))) - 1
        spend(4 * (order + 1) ** 2 * (1 + order * (self.kind == "call")), 256, 256)
        if self.kind == "number":
            return [enclosing(self.number), *[ZERO] * order]
        if self.kind == "name":
            return known[self.word]
        parts = [tree.series(known, tables, memo) for tree in self.of]
        if self.kind == "+":
            return [intervals.plus(*pair) for pair in zip(*parts, strict=True)]
        if self.kind == "*":
            return product(*parts)
        if self.kind == "/":
            return product(parts[0], self._composed(_INVERSE, parts[1], self.of[1].text))
        if self.kind == "**" and self.number.denominator == 1:
            return self._whole_power(parts[0], int(self.number))
        if self.kind == "**":
            return self._composed(_of_power(self.number), parts[0], self.text)
        if self.word in tables:
            return self._composed(tables[self.word].coefficients, parts[0], self.text)
        return self._composed(FUNCTIONS[self.word], parts[0], self.text)

    @staticmethod
    def _composed(outer: Coefficients, inner: Series, text: str) -> Series:
        try:
            return composed(outer, inner)
        except NoValueError as error:
            raise NoValueError(f"{error}: {text}") from error

    def _whole_power(self, base: Series, power: int) -> Series:
        if power < 0:
            base, power = self._composed(_INVERSE, base, self.of[0].text), -power
        total = [UNIT, *[ZERO] * (len(base) - 1)]
        if not any(x != ZERO for x in base[1:]):
            return [_whole_power(base[0], power), *total[1:]]
        for _ in range(power):
            total = product(total, base)
        return [_whole_power(base[0], power), *total[1:]]

    def exact(self, values: Mapping[str, Fraction]) -> Fraction | None:
        """Return its value where that is rational for all its operations, else None."""
        if self.kind == "number":
            return self.number
        if self.kind == "name":
            return values[self.word]
        parts = [tree.exact(values) for tree in self.of]
        one, *others = (x for x in parts if x is not None) if None not in parts else (None,)
        if one is None or self.kind == "call":
            return None
        if self.kind == "+":
            return one + others[0]
        if self.kind == "*":
            return one * others[0]
        if self.kind == "/":
            return one / others[0] if others[0] else None
        whole = self.number.denominator == 1 and (one or self.number >= 0)
        return one ** int(self.number) if whole else None


def _whole_power(a: Interval, power: int) -> Interval:
    """Return the range of a power, which is not negative where it is even."""
    total = UNIT
    for _ in range(power):
        total = intervals.times(total, a)
    if power % 2 or a[0] >= 0 or a[1] <= 0:
        return total
    return 0, max(total[1], 0)


Memo = dict[int, tuple[Tree, Series]]  # of trees, by their identity


def lift(value: Any) -> Tree:
    """Return a number, or a tree, as a tree."""
    return value if isinstance(value, Tree) else Tree("number", number=Fraction(value))


def variable(name: str) -> Tree:
    """Return the tree of a parameter."""
    return Tree("name", word=name)


def _joined(kind: str, a: Tree, b: Tree) -> Tree:
    """Return a tree of two, simplified where one is a number that changes nothing."""
    x, y = (tree.number if tree.kind == "number" else None for tree in (a, b))
    if kind == "/" and y is not None:
        if not y:
            raise ZeroDivisionError
        return _joined("*", a, lift(1 / y))
    if x is not None and y is not None:
        return lift({"+": x.__add__, "*": x.__mul__, "/": x.__truediv__}[kind](y))
    if kind == "*" and 0 in (x, y):
        return lift(0)
    if (kind == "+" and x == 0) or (kind == "*" and x == 1):
        return b
    if (kind == "+" and y == 0) or (kind == "*" and y == 1):
        return a
    return Tree(kind, (a, b), size=a.size + b.size + 1)


def _number_text(value: Fraction) -> tuple[str, int]:
    """Return a number as it is read, a decimal where it is a short one, and how firmly it holds."""
    top, bottom = value.as_integer_ratio()
    places = next((k for k in range(MAX_PLACES) if 10**k % bottom == 0), None)
    if bottom == 1 or places is None:
        return (str(top), 4 if top >= 0 else 2) if bottom == 1 else (f"{top}/{bottom}", 2)
    digits = f"{abs(top) * 10**places // bottom:0{places + 1}d}"
    sign = "-" if top < 0 else ""
    return f"{sign}{digits[:-places]}.{digits[-places:]}", 2 if top < 0 else 4


_MINUS_ONE = Tree("number", number=Fraction(-1))


# --- reading -------------------------------------------------------------------------------------


def parse(text: str, names: Sequence[str], tables: Mapping[str, Table]) -> Tree:
    """Read a function of these names and tables; it is never executed.

    Raises
    ------
    FormatError
        If it is anything else.
    """
    if len(text) > MAX_LENGTH:
        raise FormatError(f"a function is longer than {MAX_LENGTH} characters")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            body = ast.parse(text.strip(), mode="eval").body
        tree = _Reader(text.strip(), frozenset(names), tables).read(body, MAX_DEPTH)
    except (SyntaxError, ValueError, MemoryError, RecursionError, ZeroDivisionError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError("a function of the parameters cannot be read") from error
    tree.require()
    return tree


@dataclass(frozen=True)
class _Reader:
    text: str
    names: frozenset[str]
    tables: Mapping[str, Table]

    def read(self, node: ast.expr, depth: int) -> Tree:
        if not depth:
            raise FormatError("a function of the parameters is nested too deeply")
        if isinstance(node, ast.Constant):
            return lift(self._number(node))
        if isinstance(node, ast.Name) and node.id in self.names:
            return variable(node.id)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -self.read(node.operand, depth - 1)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1:
            known = node.func.id in FUNCTIONS or node.func.id in self.tables
            if known and not node.keywords:
                return self.read(node.args[0], depth - 1).called(node.func.id)
        if isinstance(node, ast.BinOp):
            left, right = (self.read(side, depth - 1) for side in (node.left, node.right))
            for kind, join in _JOINS:
                if isinstance(node.op, kind):
                    return join(left, right)
        raise FormatError("a function of the parameters has something else than is read here")

    def _number(self, node: ast.Constant) -> Fraction:
        said = ast.get_source_segment(self.text, node) or ""
        if type(node.value) not in (int, float) or len(said) > MAX_DIGITS:
            raise FormatError("a function of the parameters has a number that is not read here")
        exponent = said.lower().partition("e")[2]
        if abs(int(exponent or "0")) > MAX_TEN:
            raise FormatError("a function of the parameters has a number out of range")
        return Fraction(said)


_JOINS: tuple[tuple[type[ast.operator], Callable[[Tree, Tree], Tree]], ...] = (
    (ast.Add, lambda a, b: a + b),
    (ast.Sub, lambda a, b: a - b),
    (ast.Mult, lambda a, b: a * b),
    (ast.Div, lambda a, b: a / b),
    (ast.Pow, lambda a, b: a**b),
)
