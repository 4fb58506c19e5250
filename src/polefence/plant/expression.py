"""Expressions as spec files write them: parsed by Python's grammar, evaluated here, never run."""

from __future__ import annotations

import ast
import warnings
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.plant.rational import MAX_BITS, MAX_POWER

MAX_LENGTH = 1000
MAX_EXPONENT = 400

_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_ALLOWED = "allowed: numbers, names, + - * / ** with integer powers, parentheses"


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
        if abs(int(exponent or "0")) > MAX_EXPONENT:
            raise SpecError(f"the number {shown(text)} is out of range")
        return Fraction(text)
    except (ValueError, ZeroDivisionError) as error:
        if isinstance(error, SpecError):
            raise
        raise SpecError(f"{shown(text)} is not a finite decimal number") from error


def evaluate(text: str, names: Mapping[str, Any], one: Any = None) -> Any:
    """Evaluate an expression over the named values, exactly.

    Parameters
    ----------
    text : str
        Numbers, names, ``+ - * /``, ``**`` with integer powers, parentheses.
    names : mapping
        Value of each name: a Fraction or a RationalFunction. Looked up lazily.
    one : RationalFunction, optional
        Where given, every number is lifted to a function of its variables.

    Raises
    ------
    SpecError
        On anything else: an unknown name (with the nearest known one), a call, a syntax error.
    """
    if len(text) > MAX_LENGTH:
        raise SpecError(f"the expression is longer than {MAX_LENGTH} characters")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's hints on its own style
            tree = ast.parse(text.strip(), mode="eval")
        return _Evaluator(text.strip(), names, one).visit(tree.body)
    except RecursionError as error:
        raise SpecError(f"{shown(text)} is nested too deeply; define its parts") from error
    except (SyntaxError, ValueError, MemoryError) as error:
        if isinstance(error, InputError):
            raise
        raise SpecError(f"cannot read the expression {shown(text)}; {_ALLOWED}") from error


class _Evaluator:
    def __init__(self, text: str, names: Mapping[str, Any], one: Any) -> None:
        self.text, self.names, self.one = text, names, one

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
        what = "a call" if isinstance(node, ast.Call) else f"{type(node).__name__!r}"
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor):
            what = "^ (write ** for powers)"
        raise SpecError(f"{what} is not allowed in {shown(self.text)}; {_ALLOWED}")

    def binary(self, node: ast.BinOp) -> Any:
        left = self.visit(node.left)
        power = isinstance(node.op, ast.Pow)
        right = self.power(node.right) if power else self.visit(node.right)
        try:
            value = _OPERATORS[type(node.op)](left, right)
        except ZeroDivisionError as error:
            raise SpecError(f"{shown(self.text)} divides by zero") from error
        if isinstance(value, Fraction) and value.numerator.bit_length() > MAX_BITS:
            raise SpecError(f"{shown(self.text)} is out of range")
        return value

    def power(self, node: ast.expr) -> int:
        """Return a power: a small integer, written as such."""
        sign = 1
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            sign, node = -1, node.operand
        value = node.value if isinstance(node, ast.Constant) else None
        if type(value) is not int or value > MAX_POWER:
            raise SpecError(f"a power in {shown(self.text)} is not a small integer; {_ALLOWED}")
        return sign * value

    def number(self, node: ast.Constant) -> Any:
        if type(node.value) not in (int, float):
            raise SpecError(f"{shown(node.value)} is not a number; {_ALLOWED}")
        # The literal's own text: a decimal stays the rational it is written as.
        value = decimal(ast.get_source_segment(self.text, node) or "")
        return value if self.one is None else self.one.lift(value)
