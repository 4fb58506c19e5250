"""Expressions: exact values, the multi-affinity verdict, and all else refused in one clear line."""

import re
from contextlib import nullcontext
from fractions import Fraction
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.base.errors import PlantError, SpecError
from polefence.plant import expression, family
from polefence.plant.expression import RationalFunction, decimal, evaluate
from polefence.plant.spec import loads

NAMES = {"k": Fraction(3), "m1": Fraction(1, 7)}

x, y = (RationalFunction.variable(i, 2) for i in range(2))
small = st.fractions(min_value=-5, max_value=5, max_denominator=7)

BOX = [(Fraction(1), Fraction(3)), (Fraction(-2), Fraction(5))]


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
        ("sqrt(k)", "sqrt is not allowed"),
        ("__import__('os').system('true')", "something without a name"),
        ("k.real", "Attribute"),
        ("k[0]", "Subscript"),
        ("k^2", "write ** for powers"),
        ("m11", "unknown name 'm11'; did you mean 'm1'"),
        ("k if k else m1", "IfExp"),
        ("(lambda: 1)()", "something without a name"),
        ("'a'", "not a number"),
        ("True", "not a number"),
        ("1j", "not a number"),
        ("0x10", "not a finite decimal"),
        ("k +", "cannot read"),
        ("k**0.5", "a power in 'k**0.5' is not a whole number"),
        ("2**m1", "is not a number"),
        ("tan(k)", "neither a function nor a table here; known: cos"),
        ("sqrt(k, 2)", "one argument"),
        ("(((((9**32)**32)**32)**32)**32)**32", "out of range"),
        ("+".join(["k"] * 490), "nested too deeply"),
        ("2**99", "beyond 32"),
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


@given(small, small, small, small)
def test_arithmetic_agrees_with_fractions(a: Fraction, b: Fraction, p: Fraction, q: Fraction):
    f = (a * x + b) * (y - 2) / (x * x + 1) - x / 3 + (y + 20) ** -2
    expected = (a * p + b) * (q - 2) / (p * p + 1) - p / 3 + (q + 20) ** -2
    assert f((p, q)) == expected


def verdict(f: RationalFunction) -> bool:
    corners = {
        side: f([pair[s] for pair, s in zip(BOX, side, strict=True)])
        for side in product((0, 1), repeat=2)
    }
    return f.equals_multiaffine(corners, BOX)


@pytest.mark.parametrize(
    "f",
    [
        x * 0 + 4,
        x,
        3 * x * y - y / 7,
        (x * x * y + x * y) / (x + 1) / 1,
        (x - y) * (x + y) / (x - y),
    ],
)
def test_multiaffine_functions_are_recognised_even_behind_cancelling_factors(f):
    assert verdict(f)


@pytest.mark.parametrize(
    "f",
    [
        x * x,
        1 / x,
        x * y * y,
        x + (x - 1) * (x - 3) / 10**12,
        (x - 1) * (x - 3) * (y + 2) * (y - 5),
    ],
)
def test_functions_that_bend_between_corners_are_told_apart(f):
    assert not verdict(f)


def runaway():
    f = x + y + 1
    for _ in range(12):
        f = f * f


REFUSED = {
    "a root": (lambda: x**0.5, "integer"),
    "a large power": (lambda: x**33, "integer"),
    "a large inverse": (lambda: x**-33, "integer"),
    "division by the zero function": (lambda: 1 / (x - x), "divides by zero"),
    "a branch": (lambda: bool(x), "branch"),
    "a float": (lambda: float(x), "only"),
    "an expression that grows": (runaway, "terms|proportion"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_no_function_of_parameters_does_is_refused(what):
    call, message = REFUSED[what]
    with pytest.raises(PlantError, match=message):
        call()


def test_work_of_all_expressions_together_is_counted():
    """Each is within the bounds on terms and degree; thousands of them took minutes."""
    with expression.counted(10_000):
        assert not ((x + y) ** 8).is_constant
    with expression.counted(10_000), pytest.raises(PlantError, match="more work than is done"):
        for _ in range(100):
            (x + y) ** 8


def test_long_coefficients_count_for_more():
    for factor, refused in ((3, False), (3**2000, True)):
        with expression.counted(1000), nullcontext() if not refused else pytest.raises(PlantError):
            for _ in range(20):
                x * factor * x


def test_a_plant_is_loaded_under_the_count(monkeypatch):
    spec = "[parameter.p]\nrange = [1, 2]\n[matrices]\nA = [['(p + 1)**9 / (p + 1)**8']]\nB = [[1]]"
    assert loads(spec).shape == (1, 1)
    own = expression.counted
    monkeypatch.setattr(family, "counted", lambda: own(100))
    with pytest.raises(PlantError, match="more work than is done"):
        loads(spec)
