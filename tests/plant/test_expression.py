"""Expressions: exact values, and everything else refused in one clear line."""

from __future__ import annotations

import re
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.base.errors import SpecError
from polefence.plant.expression import decimal, evaluate

NAMES = {"k": Fraction(3), "m1": Fraction(1, 7)}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1/3", Fraction(1, 3)),
        ("0.1 + 0.2", Fraction(3, 10)),
        ("-k/m1 + 2**-2", Fraction(-21) + Fraction(1, 4)),
        ("(1 + 2)*(3 - +4)", Fraction(-3)),
        ("1e-3", Fraction(1, 1000)),
        ("-2**2", Fraction(-4)),
        ("2**(-3)", Fraction(1, 8)),
    ],
)
def test_values_are_exact(text, value):
    assert evaluate(text, NAMES) == value


@given(st.decimals(allow_nan=False, allow_infinity=False, places=6, min_value=-1e6, max_value=1e6))
def test_decimals_are_the_rationals_they_are_written_as(number):
    assert decimal(str(number)) == Fraction(number)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sqrt(k)", "a call is not allowed"),
        ("__import__('os').system('true')", "a call is not allowed"),
        ("k.real", "Attribute"),
        ("k[0]", "Subscript"),
        ("k^2", "write ** for powers"),
        ("m11", "unknown name 'm11'; did you mean 'm1'"),
        ("k if k else m1", "IfExp"),
        ("(lambda: 1)()", "a call"),
        ("'a'", "not a number"),
        ("True", "not a number"),
        ("1j", "not a number"),
        ("0x10", "not a finite decimal"),
        ("k +", "cannot read"),
        ("k**0.5", "small integer"),
        ("2**m1", "small integer"),
        ("2**3**1", "small integer"),
        ("k**1e1", "small integer"),
        ("(((((9**32)**32)**32)**32)**32)**32", "out of range"),
        ("+".join(["k"] * 490), "nested too deeply"),
        ("2**99", "small integer"),
        ("1/(k-3)", "divides by zero"),
        ("1e999999999", "out of range"),
        ("k" * 2000, "longer than"),
        ("(" * 500, "cannot read"),
        ("", "cannot read"),
        ("a := 1", "cannot read"),
    ],
)
def test_what_is_no_expression_is_refused(text, message):
    with pytest.raises(SpecError, match=re.escape(message)) as caught:
        evaluate(text, NAMES)
    assert "\n" not in str(caught.value)
