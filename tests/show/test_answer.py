"""What a report says first: promises beside samples, in units that people use, nothing forged."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import Gain, Parameter, Rms, UncertainPlant, optimise
from polefence.base.readable import people, sample_text, scaled_text
from polefence.certify.bounds import sampled
from polefence.certify.design import proved_design
from polefence.examples import family
from polefence.response import family_points
from polefence.show.answer import Promise, picture, promise, rows, sentences, shared
from polefence.vehicle.vehicle import require_ride


def test_promises_stand_beside_the_same_samples_with_the_law_and_without(tmp_path, hasty):
    car = family("quarter-car-ride")
    acceleration = require_ride(car).acceleration
    asked = [Rms(acceleration, at_most=2, density=2e-3), Gain("tyre deflection", at_most=1)]
    optimise(car, None, asked, method="quadratic").save(tmp_path)
    design, document = proved_design(tmp_path)
    alpha = family_points(design.plant, 50)
    for claim, own in zip(document.claims[1:], asked, strict=True):
        found = promise(design, claim, ("it", "", "so"), alpha)
        assert found.sampled == sampled(car, design, own, alpha).worst <= found.level
        assert found.without == sampled(car, None, own, alpha).worst
        assert found.level == claim.level
    # a sample above what a claim says is none of what it is about: it is not shown
    low = replace(document.claims[1], level=document.claims[1].level / 1000)
    assert promise(design, low, ("it", "", "so"), alpha).sampled is None


@pytest.mark.parametrize(
    ("level", "unit", "text"),
    [
        (Fraction(0.005), "m", "at most 5 mm"),  # a double just above 5 mm, which reads back
        (Fraction(0.00472), "m", "at most 4.72 mm"),
        (Fraction("0.00472001"), "m", "at most 4.721 mm"),  # never less than what was proved
        (Fraction("0.5"), "m", "at most 0.5 m"),
        (Fraction("0.4999"), "m", "at most 499.9 mm"),
        (Fraction(999), "N", "at most 999 N"),
        (Fraction("1234.1"), "N", "at most 1.235 kN"),
        (Fraction("1.02076"), "m/s2", "at most 1.021 m/s2"),
        (Fraction(10**12), "", "at most 1e+12"),
    ],
)
def test_what_is_proved_is_rounded_up_in_the_unit_that_people_use(level, unit, text):
    assert Promise("it", "", "", level, unit).texts[0] == text


def test_what_has_no_level_says_what_the_claim_says():
    assert Promise("disk margin of the loop", "", "at least 0.4").texts == ("at least 0.4", "", "")


@pytest.mark.parametrize(
    ("without", "beside"),
    [(2.0, "50 % less"), (0.8, "25 % more"), (1.001, "the same"), (0.25, "4 times"), (0, ""),
     (None, "")],
)  # fmt: skip
def test_the_share_of_the_worst_without_control(without, beside):
    own = Promise("rms of 'x'", "on a road", "", Fraction(1), "m/s", 1.0, without)
    assert own.beside == beside


def test_columns_without_numbers_are_left_out_and_one_motion_is_said_once():
    some = [
        Promise("rms of 'x'", "on a road", "", Fraction(1), "m", 1.0, 2.0),
        Promise("rms of 'u'", "on a road", "", Fraction(3), "N"),
    ]
    assert shared(some) == "on a road"
    assert rows(some) == (
        ("", "proved", "worst sample", "without control", "proved beside that"),
        ("rms of x", "at most 1 m", "1", "2", "50 % less"),
        ("rms of u", "at most 3 N", "", "", ""),
    )
    other = [some[0], replace(some[1], under="in a gust")]
    assert not shared(other)
    assert rows(other)[0][-1] == "when"
    assert rows(other)[2][-1] == "in a gust"


def test_bars_are_shares_of_the_worst_without_control():
    some = [
        Promise("rms of 'x'", "", "", Fraction(1), "m", 0.9, 2.0),
        Promise("rms of 'u'", "", "", Fraction(3), "N"),  # has no samples, and no bar
    ]
    (ax,) = picture(some).axes
    assert [bar.get_width() for bar in ax.patches] == pytest.approx([100, 45])
    assert ax.lines[0].get_xdata() == pytest.approx([50])
    assert [text.get_text() for text in ax.get_yticklabels()] == ["rms of x"]
    assert picture(some[1:]) is None


def test_a_label_that_could_pass_for_a_claim_is_not_said():
    labels = {"sprung mass": True, "mass; all poles in disk(-9, 1)": False, "a" * 40: False}
    for label, said in labels.items():
        plant = UncertainPlant.from_expressions(
            [Parameter("m", 1, 2, label=label)], [["-1/m"]], [[1]], [[1]]
        )
        design = optimise(plant, None, [Rms("x1", at_most=3)], method="quadratic").design
        top = sentences(design, [])[0]
        assert (f"m ({label}) from 1 to 2" in top) is said
        assert ("m from 1 to 2" in top) is not said


def test_samples_have_few_digits_and_no_exponent_of_a_usual_size():
    assert [sample_text(x) for x in (11370.4, -1034.0, 1e-9, 0.0, np.inf, 2.5e6)] == [
        "11370", "-1034", "1e-9", "0", "inf", "2500000",
    ]  # fmt: skip
    assert scaled_text("0.004720", people(0.00472, "m")[1]) == "4.72"
    assert people(1000, "N")[0] == "kN"
    assert people(-0.2, "m")[0] == "mm"
