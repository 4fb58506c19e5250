"""What notebooks show: the facts, and no name as markup."""

import re
from dataclasses import replace

import numpy as np

from polefence import Design, Disk, Rms, optimise, place
from polefence.examples import family
from polefence.plant.card import card

HOSTILE = "<script>x()</script>&\x1b"


def texts(html):
    return re.sub(r"<[^>]*>", " ", html)


def test_names_are_no_markup(physical):
    for own in (card(HOSTILE, [(HOSTILE, HOSTILE)]), replace(physical, name=HOSTILE)._repr_html_()):
        assert "<script" not in own
        assert "\x1b" not in own
        assert "&lt;script&gt;" in own


def test_a_plant_says_its_intervals(physical):
    said = texts(physical._repr_html_())
    assert "231.12 to 346.68 kg" in said
    assert "4 vertices, 5 states, 1 input" in said


def test_a_design_says_proved_where_it_is(physical):
    own = place(physical, Disk(-40, 31))
    assert "proved: in disk(-40, 31)" in texts(own._repr_html_())
    said = texts(Design(own.certificate, proved=False)._repr_html_())
    assert "not proved" in said
    assert "disk" not in said


def test_bounds_are_those_that_are_proved():
    own = optimise(family("quarter-car-ride"), Rms("tyre deflection"), method="quadratic")
    said = texts(own._repr_html_())
    assert all(str(bound).replace("<", "&lt;") in said for bound in own.bounds)
    assert "by" in texts(own.bounds[0]._repr_html_())
    assert np.isfinite(own.bounds[0].level)
