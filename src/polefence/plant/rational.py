"""Exact rational functions of the scheduling variables, enough to decide multi-affinity.

A value is numerator / denominator, each a polynomial held as ``{exponents: coefficient}``. Common
monomials are cancelled, common polynomials are not: equality is decided by cross multiplication.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational
from typing import Any

from polefence.base.errors import PlantError

Polynomial = dict[tuple[int, ...], Fraction]

MAX_TERMS = 2000
MAX_BITS = 8192
MAX_POWER = 32
MAX_DEGREE = 64
MAX_WORK = 2_000_000  # operations on coefficients, of all expressions of a plant

_LEFT: ContextVar[list[int] | None] = ContextVar("left", default=None)


@contextmanager
def counted(most: int = MAX_WORK) -> Iterator[None]:
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
            raise PlantError("an expression has a coefficient out of all proportion; simplify it")
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


Box = Sequence[tuple[Fraction, Fraction]]
