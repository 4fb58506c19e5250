"""Specs with numbers changed: what is asked for and nothing else, exactly."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence import InputError, SpecError
from polefence.examples import SPECS, spec_text
from polefence.plant.expression import decimal, decimal_text
from polefence.plant.spec import loads, parse
from polefence.plant.varied import _key, _value, numbers_of, varied


@pytest.mark.parametrize("name", SPECS)
def test_a_spec_that_nothing_changes_is_the_same_plant(name):
    text = spec_text(name)
    again = varied(text, {})
    assert parse(again, "again") == parse(text, "text")
    assert loads(again).digest == loads(text).digest
    assert numbers_of(again) == numbers_of(text)


def test_each_number_is_changed_by_its_name_alone():
    text = spec_text("quarter-car-physical")
    every = numbers_of(text)
    assert {"m2", "kt", "m1.low", "m1.high", "beta.low"} <= set(every)
    for name in every:
        found = numbers_of(varied(text, {name: Fraction("1.2345")}))
        assert found == every | {name: Fraction("1.2345")}
    values = {"car.wheel.front left.mass": Fraction("40.5"), "kf": Fraction(20000)}
    car = parse(varied(spec_text("full-car"), values), "car")
    assert car["car"]["wheel"]["front left"]["mass"] == Fraction("40.5")
    assert car["constants"]["kf"] == 20000


def test_a_number_that_there_is_not_is_refused():
    with pytest.raises(SpecError, match="car: has no number 'm3' that could vary, neither") as said:
        varied(spec_text("quarter-car-physical"), {"m3": Fraction(1)}, "car")
    assert "m2" in str(said.value)


@given(st.text(max_size=20), st.text(max_size=20))
def test_any_text_survives(key, value):
    text = varied("a = 1\n", {})
    assert parse(text, "text") == {"a": 1}
    if "\ud800" <= max(key + value, default="a") <= "\udfff":
        return
    assert parse(f"{_key(key)} = {_value({value: [key, True, 2]})}", "text") == {
        key: {value: [key, True, 2]}
    }


@given(st.decimals(allow_nan=False, allow_infinity=False, min_value=-(10**30), max_value=10**30))
def test_decimals_are_written_exactly(number):
    value = Fraction(number)
    assert decimal(decimal_text(value)) == value
    assert decimal(decimal_text(value / 1024)) == value / 1024


def test_a_third_is_no_decimal():
    with pytest.raises(InputError, match="1/3 is not a finite decimal"):
        decimal_text(Fraction(1, 3))
