"""Expressions as spec files write them: parsed by Python's grammar, evaluated exactly, never run.

Each is an exact rational function of the scheduling variables, enough to decide multi-affinity: a
numerator / denominator, each a polynomial held as ``{exponents: coefficient}``. Common
monomials are cancelled, common polynomials are not: equality is decided by cross multiplication.
"""

from __future__ import annotations

import ast
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from numbers import Rational
from typing import Any

from polefence.base.errors import InputError, PlantError, SpecError, shown, suggest
from polefence.plant.surface import Surface
from polefence.proof.functions import FUNCTIONS, Table, Tree

MAX_LENGTH = 1000
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_ALLOWED = (
    "allowed: numbers, names, + - * / **, parentheses, sqrt, sin, cos, exp, log, tables of the spec"
)

Polynomial = dict[tuple[int, ...], Fraction]
MAX_TERMS = 2000
MAX_BITS = 8192
MAX_POWER, MAX_ROOT = 32, 1000
MAX_DEGREE = 64
_LEFT: ContextVar[list[int] | None] = ContextVar("left", default=None)
Box = Sequence[tuple[Fraction, Fraction]]


class CallError(SpecError):
    """An expression holds a function that is no quotient of polynomials; its tree has it."""


def decimal(text: str) -> Fraction:
    """Read a decimal number exactly.

    Raises
    ------
    SpecError
        If it is no finite decimal, or its exponent is absurd (a denial of service, not a number).
    """
    if len(text) > MAX_LENGTH:
        raise SpecError(f"the number {shown(text)} is out of range")
    _, _, exponent = text.lower().partition("e")
    try:
        if abs(int(exponent or "0")) > 400:
            raise SpecError(f"the number {shown(text)} is out of range")
        return Fraction(text)
    except (ValueError, ZeroDivisionError) as error:
        if isinstance(error, SpecError):
            raise
        raise SpecError(f"{shown(text)} is not a finite decimal number") from error


def decimal_text(value: Fraction) -> str:
    """Write a number that `decimal` reads exactly.

    Raises
    ------
    SpecError
        If it is no finite decimal: a third, say.
    """
    rest, places = value.denominator, 0
    for prime in (2, 5):
        power = 0
        while rest % prime == 0:
            rest, power = rest // prime, power + 1
        places = max(places, power)
    if rest != 1:
        raise SpecError(f"{value} is not a finite decimal number")
    if places == 0:
        return str(value.numerator)
    digits = str(abs(value.numerator) * (10**places // value.denominator))
    exact = Decimal((int(value < 0), tuple(map(int, digits)), -places))
    return str(exact).lower()


def evaluate(
    text: str,
    names: Mapping[str, Any],
    one: Any = None,
    tables: Mapping[str, Table | Surface] | None = None,
) -> Any:
    """Evaluate an expression over the named values, exactly.

    Parameters
    ----------
    text : str
        Numbers, names, ``+ - * / **``, parentheses, functions of one argument, and tables.
    names : mapping
        Value of each name: a Fraction, a RationalFunction or a Tree. Looked up lazily.
    one : RationalFunction or Tree, optional
        Where given, every number is lifted to a function as it is one.
    tables : mapping, optional
        Tables by name, of one argument and of two.

    Raises
    ------
    CallError
        If it holds a function or a power that is not rational, and the values are no trees.
    SpecError
        On anything else: an unknown name (with the nearest known one), a syntax error.
    """
    if len(text) > MAX_LENGTH:
        raise SpecError(f"the expression is longer than {MAX_LENGTH} characters")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's hints on its own style
            tree = ast.parse(text.strip(), mode="eval")
        return _Evaluator(text.strip(), names, one, tables or {}).visit(tree.body)
    except RecursionError as error:
        raise SpecError(f"{shown(text)} is nested too deeply; define its parts") from error
    except (SyntaxError, ValueError, MemoryError) as error:
        if isinstance(error, InputError):
            raise
        raise SpecError(f"cannot read the expression {shown(text)}; {_ALLOWED}") from error


class _Evaluator:
    def __init__(
        self,
        text: str,
        names: Mapping[str, Any],
        one: Any,
        tables: Mapping[str, Table | Surface],
    ) -> None:
        self.text, self.names, self.one, self.tables = text, names, one, tables

    def visit(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            return self.number(node)
        if isinstance(node, ast.Name):
            if node.id not in self.names:
                raise SpecError(f"unknown name {shown(node.id)}; {suggest(node.id, self.names)}")
            return self.names[node.id]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
            value = self.visit(node.operand)
            return -value if isinstance(node.op, ast.USub) else value
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return self.binary(node)
        if isinstance(node, ast.Call):
            return self.call(node)
        what = f"{type(node).__name__!r}"
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor):
            what = "^ (write ** for powers)"
        raise SpecError(f"{what} is not allowed in {shown(self.text)}; {_ALLOWED}")

    def call(self, node: ast.Call) -> Any:
        """Return a function of an argument, or a table of one or two."""
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        known = [*FUNCTIONS, *self.tables]
        if name not in known:
            raise SpecError(
                f"{shown(self.text)} calls {shown(name or 'something without a name')}, which is "
                f"neither a function nor a table here; {suggest(name, known)}"
            )
        table = self.tables.get(name)
        count = 2 if isinstance(table, Surface) else 1
        starred = any(isinstance(argument, ast.Starred) for argument in node.args)
        if len(node.args) != count or node.keywords or starred:
            said = "one argument" if count == 1 else "two arguments"
            raise SpecError(f"{name} in {shown(self.text)} takes {said}")
        values = [self.visit(argument) for argument in node.args]
        if not all(isinstance(value, Tree) for value in values):
            raise CallError(f"{name} is not allowed in {shown(self.text)}")
        return table.called(name, *values) if isinstance(table, Surface) else values[0].called(name)

    def binary(self, node: ast.BinOp) -> Any:
        left = self.visit(node.left)
        power = isinstance(node.op, ast.Pow)
        right: Any = self.power(node.right) if power else self.visit(node.right)
        if power and right.denominator > 1 and not isinstance(left, Tree):
            raise CallError(f"a power in {shown(self.text)} is not a whole number")
        try:
            value = _OPERATORS[type(node.op)](left, right)
        except ZeroDivisionError as error:
            raise SpecError(f"{shown(self.text)} divides by zero") from error
        if isinstance(value, Fraction) and value.numerator.bit_length() > MAX_BITS:
            raise SpecError(f"{shown(self.text)} is out of range")
        return value

    def power(self, node: ast.expr) -> Fraction | int:
        """Return a power: a number, written as such or as a quotient of two."""
        try:
            value = Fraction(_Evaluator(self.text, {}, None, {}).visit(node))
        except InputError as error:
            raise SpecError(
                f"a power in {shown(self.text)} is not a number, as 2, -1, 0.5 or (1/3) are"
            ) from error
        if abs(value) > MAX_POWER or value.denominator > MAX_ROOT:
            raise SpecError(
                f"a power in {shown(self.text)} is beyond {MAX_POWER}, or a root beyond the "
                f"{MAX_ROOT}th"
            )
        return int(value) if value.denominator == 1 else value

    def number(self, node: ast.Constant) -> Any:
        if type(node.value) not in (int, float):
            raise SpecError(f"{shown(node.value)} is not a number; {_ALLOWED}")
        # The literal's own text: a decimal stays the rational it is written as.
        value = decimal(ast.get_source_segment(self.text, node) or "")
        return value if self.one is None else self.one.lift(value)


@contextmanager
def counted(most: int = 2_000_000) -> Iterator[None]:
    """Allow this many operations on coefficients in all that follows."""
    token = _LEFT.set([most])
    try:
        yield
    finally:
        _LEFT.reset(token)


def _spend(operations: int, p: Polynomial) -> None:
    """Count operations before they begin, by the length of a coefficient too."""
    left = _LEFT.get()
    if left is None:
        return
    bits = max(
        (c.denominator.bit_length() + c.numerator.bit_length() for c in p.values()), default=0
    )
    left[0] -= operations * (1 + (bits // 300))
    if left[0] < 0:
        raise PlantError("the expressions take more work than is done here; simplify them")


def _bounded(p: Polynomial) -> Polynomial:
    if len(p) > MAX_TERMS:
        raise PlantError(f"an expression has more than {MAX_TERMS} terms; simplify it")
    if max((max(e, default=0) for e in p), default=0) > MAX_DEGREE:
        raise PlantError(f"an expression has a degree above {MAX_DEGREE}; simplify it")
    for c in p.values():
        if max(c.numerator.bit_length(), c.denominator.bit_length()) > MAX_BITS:
            raise PlantError("an expression has a coefficient too large; simplify it")
    return p


def _add(p: Polynomial, q: Polynomial) -> Polynomial:
    _spend(2 + len(p) + len(q), p)
    total = dict(p)
    for e, c in q.items():
        total[e] = total.get(e, Fraction(0)) + c
    return _bounded({e: c for e, c in total.items() if c})


def _multiply(p: Polynomial, q: Polynomial) -> Polynomial:
    if len(p) * len(q) > 50 * MAX_TERMS:
        raise PlantError(f"an expression has more than {MAX_TERMS} terms; simplify it")
    _spend(3 * (2 + len(p) * len(q)), p)
    total: Polynomial = {}
    for e, c in p.items():
        for f, d in q.items():
            key = tuple(a + b for a, b in zip(e, f, strict=True))
            total[key] = total.get(key, Fraction(0)) + c * d
    return _bounded({e: c for e, c in total.items() if c})


def _evaluate(p: Polynomial, point: Sequence[Fraction]) -> Fraction:
    _spend(len(p), p)
    total = Fraction(0)
    for exponents, c in p.items():
        for value, e in zip(point, exponents, strict=True):
            if e:
                c *= value**e
        total += c
    return total


def _cancel(p: Polynomial, q: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Divide both by their largest common monomial and make q's first coefficient 1."""
    exponents = [*p, *q]
    low = tuple(min(column) for column in zip(*exponents, strict=True))
    lead = q[max(q)]

    def divided(r: Polynomial) -> Polynomial:
        return {tuple(a - b for a, b in zip(e, low, strict=True)): c / lead for e, c in r.items()}

    return divided(p), divided(q)


@dataclass(frozen=True, eq=False)
class RationalFunction:
    """A quotient of polynomials in ``count`` variables; supports ``+ - * / **`` exactly.

    Raises
    ------
    PlantError
        On division by the zero function, on powers that are not small integers, and when an
        operand is not a finite number.
    """

    numerator: Polynomial
    denominator: Polynomial
    count: int

    @classmethod
    def constant(cls, value: Fraction, count: int) -> RationalFunction:
        """Return the function that is ``value`` everywhere."""
        zero = (0,) * count
        return cls({zero: value} if value else {}, {zero: Fraction(1)}, count)

    @classmethod
    def variable(cls, index: int, count: int) -> RationalFunction:
        """Return the scheduling variable of that index."""
        unit = tuple(int(i == index) for i in range(count))
        return cls({unit: Fraction(1)}, {(0,) * count: Fraction(1)}, count)

    def lift(self, value: Any) -> RationalFunction:
        """Return ``value``, a number or a function, as a function of the same variables."""
        if isinstance(value, RationalFunction):
            return value
        try:
            exact = value if isinstance(value, Rational) else float(value)
            return RationalFunction.constant(Fraction(exact), self.count)
        except (TypeError, ValueError, OverflowError) as error:
            raise PlantError(f"{value!r} is not a finite number") from error

    @property
    def is_constant(self) -> bool:
        """Whether it is written without any variable."""
        return not any(any(e) for p in (self.numerator, self.denominator) for e in p)

    def __call__(self, point: Sequence[Fraction]) -> Fraction:
        """Evaluate at a point of the variables; raise ``ZeroDivisionError`` at a pole."""
        return _evaluate(self.numerator, point) / _evaluate(self.denominator, point)

    def _over(self, p: Polynomial, q: Polynomial) -> RationalFunction:
        if not p:
            return RationalFunction.constant(Fraction(0), self.count)
        return RationalFunction(*_cancel(p, q), self.count)

    def __add__(self, other: Any) -> RationalFunction:
        o = self.lift(other)
        if self.denominator == o.denominator:
            return self._over(_add(self.numerator, o.numerator), self.denominator)
        p = _add(_multiply(self.numerator, o.denominator), _multiply(o.numerator, self.denominator))
        return self._over(p, _multiply(self.denominator, o.denominator))

    def __mul__(self, other: Any) -> RationalFunction:
        o = self.lift(other)
        return self._over(
            _multiply(self.numerator, o.numerator), _multiply(self.denominator, o.denominator)
        )

    def __truediv__(self, other: Any) -> RationalFunction:
        o = self.lift(other)
        if not o.numerator:
            raise PlantError("an expression divides by zero")
        return self * RationalFunction(o.denominator, o.numerator, self.count)

    def __pow__(self, power: Any) -> RationalFunction:
        if isinstance(power, RationalFunction) or power != int(power) or abs(power) > MAX_POWER:
            raise PlantError(f"a power must be an integer between -{MAX_POWER} and {MAX_POWER}")
        base = self if power >= 0 else 1 / self
        result = RationalFunction.constant(Fraction(1), self.count)
        for _ in range(abs(int(power))):
            result = result * base
        return result

    def __neg__(self) -> RationalFunction:
        return self * -1

    def __pos__(self) -> RationalFunction:
        return self

    def __sub__(self, other: Any) -> RationalFunction:
        return self + -self.lift(other)

    def __rsub__(self, other: Any) -> RationalFunction:
        return self.lift(other) - self

    def __rtruediv__(self, other: Any) -> RationalFunction:
        return self.lift(other) / self

    __radd__ = __add__
    __rmul__ = __mul__

    def __float__(self) -> float:
        raise PlantError(
            "the plant function must use + - * / ** only, so that multi-affinity can be decided"
        )

    def __bool__(self) -> bool:
        raise PlantError("the plant function must not branch on parameter values")

    def equals_multiaffine(self, corners: Mapping[tuple[int, ...], Fraction], box: Box) -> bool:
        """Whether this function is the multi-affine interpolation of its corner values, exactly."""
        if len(self.denominator) == 1 and not any(next(iter(self.denominator))):
            return all(max(exponents, default=0) <= 1 for exponents in self.numerator)
        return self.numerator == _multiply(_interpolation(corners, box), self.denominator)


def _interpolation(corners: Mapping[tuple[int, ...], Fraction], box: Box) -> Polynomial:
    """Return the multi-affine polynomial with these values at the corners (sides 0 low, 1 high).

    One variable after the other, values at its two bounds become constant and slope.
    """
    table = dict(corners)
    for index, (low, high) in enumerate(box):
        for side in [side for side in table if side[index] == 0]:
            other = (*side[:index], 1, *side[index + 1 :])
            slope = (table[other] - table[side]) / (high - low)
            table[side], table[other] = table[side] - slope * low, slope
    return {exponents: c for exponents, c in table.items() if c}
