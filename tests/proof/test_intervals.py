"""Interval arithmetic: true values, to 80 digits by the decimal module, are always inside."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.proof import intervals
from polefence.proof.intervals import ONE, NoValueError, enclosing

numbers = st.fractions(min_value=-50, max_value=50, max_denominator=10**6)
positive = st.fractions(min_value=Fraction(1, 10**6), max_value=10**6, max_denominator=10**6)


def ends(a):
    with localcontext() as context:
        context.prec = 90
        return tuple(Decimal(x) / Decimal(ONE) for x in a)


def decimal(x):
    return Decimal(x.numerator) / Decimal(x.denominator)


@pytest.fixture(autouse=True)
def digits():
    with localcontext() as context:
        context.prec = 90
        yield


@given(numbers, numbers)
def test_sums_products_and_inverses_hold_the_true_ones(x, y):
    a, b = enclosing(x), enclosing(y)
    for found, true in (
        (intervals.plus(a, b), x + y),
        (intervals.minus(a, b), x - y),
        (intervals.times(a, b), x * y),
    ):
        assert Fraction(found[0], ONE) <= true <= Fraction(found[1], ONE)
        assert found[1] - found[0] < 300  # as near as the factors' own rounding lets it be
    if abs(y) > Fraction(1, 100):
        low, high = (Fraction(end, ONE) for end in intervals.inverse(b))
        assert low <= 1 / y <= high


@given(numbers)
def test_exponentials_hold_the_true_ones(x):
    low, high = ends(intervals.exponential(enclosing(x)))
    with localcontext() as context:
        context.prec = 90
        true = decimal(x).exp()
        assert low <= true <= high
        assert high - low <= true * Decimal(2) ** -120 + Decimal(2) ** -120


@given(positive)
def test_logarithms_and_roots_hold_the_true_ones(x):
    with localcontext() as context:
        context.prec = 90
        low, high = ends(intervals.logarithm(enclosing(x)))
        assert low <= decimal(x).ln() <= high
        low, high = ends(intervals.root(enclosing(x)))
        assert low <= decimal(x).sqrt() <= high


def _cosine(x):
    """The sum of its series, in rational numbers."""
    term = total = Fraction(1)
    for k in range(2, 400, 2):
        term = -term * x * x / (k * (k - 1))
        total += term
        if abs(term) < Fraction(1, 10**60):
            return total
    raise AssertionError


@given(st.fractions(min_value=-12, max_value=12, max_denominator=1000))
def test_cosines_hold_the_sums_of_their_series(x):
    low, high = (Fraction(end, ONE) for end in intervals.cosine(enclosing(x)))
    off = Fraction(1, 10**50)
    assert low - off <= _cosine(x) <= high + off
    assert high - low < Fraction(1, 10**35)
    sine = [Fraction(end, ONE) for end in intervals.sine(enclosing(x))]
    assert sine[0] - 1e-15 <= math.sin(x) <= sine[1] + 1e-15


@given(st.floats(-20, 20), st.floats(0, 7))
def test_ranges_of_sines_have_their_extremes(start, width):
    a = enclosing(Fraction(start))[0], enclosing(Fraction(start + width))[1]
    points = [start + width * k / 500 for k in range(501)]
    for function, known in ((intervals.sine, math.sin), (intervals.cosine, math.cos)):
        low, high = (float(Fraction(end, ONE)) for end in function(a))
        values = [known(x) for x in points]
        assert low <= min(values) + 1e-14
        assert high >= max(values) - 1e-14
        # no wider than the samples, which miss an extreme by (width / 1000)^2 / 2 at most
        assert low >= min(values) - width**2 * 1e-6 - 1e-9
        assert high <= max(values) + width**2 * 1e-6 + 1e-9


@pytest.mark.parametrize(
    ("function", "at", "why"),
    [
        (intervals.inverse, (-1, 1), "zero"),
        (intervals.root, (-1, 4 * ONE), "negative"),
        (intervals.logarithm, (0, ONE), "zero or negative"),
        (intervals.exponential, (0, 10**4 * ONE), "beyond"),
        (intervals.sine, (0, 2**60 * ONE), "out of range"),
        (lambda a: intervals.times(a, a), (2**1000 * ONE, 2**1000 * ONE), "out of range"),
    ],
)
def test_what_has_no_value_is_refused(function, at, why):
    with pytest.raises(NoValueError, match=why):
        function(at)
