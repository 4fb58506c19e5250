"""Uncertain parameters: an interval, a unit, and the variable through which the plant is affine."""

from __future__ import annotations

import keyword
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Rational, Real
from typing import Any, Literal

from polefence.base.errors import ParameterValueError, PlantError, SpecError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.plant.expression import decimal
from polefence.proof.dead_time import DeadTime
from polefence.proof.ranges import ANY
from polefence.proof.short import Short

# Larger or smaller magnitudes, or longer fractions, are no physical data: doubles must hold them,
# and a certificate must be able to say them.
LARGEST = 10**100
MAX_NAME = 200  # characters of a name or a unit


PLAIN_BITS = 300  # of numerator and denominator: within both bounds, seen without arithmetic


def is_plain(value: Any) -> bool:
    """Whether a value is a rational that `exact` returns as it is."""
    return (
        type(value) is Fraction
        and value.numerator.bit_length() <= PLAIN_BITS
        and value.denominator.bit_length() <= PLAIN_BITS
    )


def exact(value: Any, what: str) -> Fraction:
    """Return a number as the rational it is; a float is taken at its exact binary value.

    Raises
    ------
    PlantError
        If it is not a finite real number, or of a magnitude or length out of all proportion.
    """
    number = _rational(value, what)
    digits = max(number.numerator.bit_length(), number.denominator.bit_length()) * 0.302
    if number and not (1 <= LARGEST * abs(number) <= LARGEST**2 and digits < 300):
        raise PlantError(f"{what} is out of range; use 0, or 1e-100 to 1e100, at most 300 digits")
    return number


def _rational(value: Any, what: str) -> Fraction:
    if isinstance(value, Rational):
        return Fraction(int(value.numerator), int(value.denominator))
    if isinstance(value, str):
        try:
            return decimal(value)
        except SpecError as error:
            raise PlantError(f"{what} = {shown(value)} is not a number, or out of range") from error
    try:
        real = isinstance(value, Real) and math.isfinite(float(value))
    except (TypeError, ValueError, OverflowError):
        real = False
    if not real:
        raise PlantError(f"{what} = {shown(value)} must be a finite number")
    return Fraction(float(value))


def check_label(value: Any, what: str) -> None:
    """Refuse what cannot be a name or a unit for people.

    Raises
    ------
    PlantError
        If it is no text, or too long for a line.
    """
    if not isinstance(value, str):
        raise PlantError(f"{what} = {shown(value)} must be text")
    if len(value) > MAX_NAME:
        raise PlantError(f"{what} has {len(value)} characters; at most {MAX_NAME} are supported")


def check_name(name: Any) -> None:
    """Refuse what cannot be a name in expressions and a keyword argument.

    Raises
    ------
    PlantError
        If it is no ASCII identifier, or a word that Python or `gain_at` keeps for itself.
    """
    plain = isinstance(name, str) and name.isidentifier() and name.isascii()
    if not plain or len(name) > MAX_NAME or keyword.iskeyword(name) or name in ("self", "clamp"):
        raise PlantError(
            f"{shown(name)} is not a usable name; use letters, digits and _ (m1, beta)"
        )


# Least and largest dp/dt, "any", or None of a parameter that does not move.
Rate = tuple[Fraction, Fraction] | Literal["any"] | None


def _read_rate(name: str, rate: Any) -> Rate:
    """Return a rate in exact numbers; None where both ends are zero.

    Raises
    ------
    PlantError
    """
    if rate is None or rate == ANY:
        return rate  # type: ignore[no-any-return]
    what = f"parameter {name}: rate"
    if isinstance(rate, str) or not isinstance(rate, Sequence) or len(rate) != 2:
        several = isinstance(rate, Sequence) and not isinstance(rate, str)
        written = f"of {len(rate)} entries" if several else f"= {shown(rate)}"
        raise PlantError(f'{what} {written} must be two numbers, [lowest, highest], or "any"')
    low, high = (exact(end, what) for end in rate)
    if not low <= 0 <= high:
        raise PlantError(
            f"{what} = [{float(low):g}, {float(high):g}] does not contain 0: a bounded "
            f"parameter cannot move one way for ever; write [{min(float(low), 0):g}, "
            f"{max(float(high), 0):g}]"
        )
    return (low, high) if low or high else None


@dataclass(frozen=True)
class Parameter(Short):
    """One uncertain parameter p in [low, high].

    Parameters
    ----------
    name : str
        A Python identifier; expressions and keyword arguments use it.
    low, high : number
        The interval, in ``unit``. Strings and Fractions are exact; a float is its binary value.
    unit : str
        SI unit, for people ("kg").
    through : str
        The scheduling variable: the name itself, or ``"1/name"`` when the plant is affine in 1/p.
    label : str
        What it is, for people ("sprung mass").
    rate : tuple, "any" or None
        Least and largest dp/dt, in ``unit`` per second; "any" where nothing bounds it; None of a
        parameter that does not move.
    dead_time : DeadTime, optional
        Of one that stands for what an approximation of a dead time leaves out: see
        `with_dead_time`.

    Raises
    ------
    PlantError
        If the interval is empty, reversed or not finite, or touches zero with ``"1/name"``; or the
        interval of its rate has no zero in it.
    """

    name: str
    low: Fraction
    high: Fraction
    unit: str = ""
    through: str = ""
    label: str = ""
    rate: Rate = None
    dead_time: DeadTime | None = None

    @explained_fields
    def __post_init__(self) -> None:
        check_name(self.name)
        for key in ("unit", "through", "label"):
            check_label(getattr(self, key), f"parameter {self.name}: {key}")
        what = f"parameter {self.name}: range"
        low, high = exact(self.low, what), exact(self.high, what)
        through = self.through.replace(" ", "") or self.name
        if low >= high:
            state = "empty" if low == high else "reversed"
            raise PlantError(
                f"{what} = [{float(low):g}, {float(high):g}] is {state}; write the smaller bound "
                "first, or make a fixed value a constant"
            )
        if through not in (self.name, f"1/{self.name}"):
            raise PlantError(
                f"parameter {self.name}: through = {shown(self.through)} is unknown; "
                f"use {self.name!r} or '1/{self.name}'"
            )
        if through != self.name and low <= 0 <= high:
            raise PlantError(
                f"{what} = [{float(low):g}, {float(high):g}] touches zero, where {through} has no "
                "value; keep the interval on one side of zero"
            )
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        object.__setattr__(self, "through", through)
        object.__setattr__(self, "rate", _read_rate(self.name, self.rate))

    @property
    def inverted(self) -> bool:
        """Whether the plant is affine in 1/p rather than in p."""
        return self.through != self.name

    def scheduling(self, value: Fraction) -> Fraction:
        """Return the scheduling variable (p or 1/p) at the parameter value."""
        return 1 / value if self.inverted else value

    def weights(self, value: Any, clamp: bool = False) -> tuple[Fraction, Fraction]:
        """Barycentric coordinates of a value: the weights of the low and the high corner.

        Raises
        ------
        ParameterValueError
            If the value lies outside the interval and ``clamp`` is not set.
        """
        p = exact(value, f"parameter {self.name}")
        inside = self.low <= p <= self.high
        if not inside:
            rounding = (self.high - self.low) / 10**12  # a float bound may lie beyond the decimal
            if clamp or self.low - rounding <= p <= self.high + rounding:
                p, inside = min(max(p, self.low), self.high), True
        if not inside:
            raise ParameterValueError(
                f"parameter {self.name} = {float(p):g} {self.unit} lies outside "
                f"[{float(self.low):g}, {float(self.high):g}]; the guarantee ends there "
                "(clamp=True takes the nearest bound)"
            )
        low, length = self._scheduled
        weight = (self.scheduling(p) - low) / length
        return 1 - weight, weight

    @cached_property
    def _scheduled(self) -> tuple[Fraction, Fraction]:
        """The scheduling variable at the low bound, and how far it is to the high one."""
        low, high = self.scheduling(self.low), self.scheduling(self.high)
        return low, high - low


def simplex_weights(
    parameters: tuple[Parameter, ...], values: dict[str, Any], clamp: bool = False
) -> tuple[Fraction, ...]:
    """Return alpha for physical parameter values: the product of each one's weights, first slowest.

    Raises
    ------
    ParameterValueError
        If a value is missing, unknown, or out of its interval.
    """
    names = [p.name for p in parameters]
    if not names:
        raise ParameterValueError(
            "this plant was given by its vertices and has no parameters; give alpha itself"
        )
    for name in values:
        if name not in names:
            raise ParameterValueError(f"unknown parameter {name!r}; {suggest(name, names)}")
    missing = [name for name in names if name not in values]
    if missing:
        raise ParameterValueError(f"give a value of every parameter; missing: {', '.join(missing)}")
    alpha: tuple[Fraction, ...] = (Fraction(1),)
    for parameter in parameters:
        pair = parameter.weights(values[parameter.name], clamp)
        alpha = tuple(a * w for a in alpha for w in pair)
    return alpha
