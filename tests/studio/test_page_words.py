"""Texts of the page: nothing in them is markup."""

import re

import pytest

from polefence import Disk, in_service, place
from polefence.certify.margins import Margin
from polefence.studio.words import code, margins_table, paragraph, safe

HOSTILE = "<b onclick='x()'>&\"\x1b[2J"


@pytest.mark.parametrize("made", [safe, paragraph, code])
def test_names_are_no_markup(made):
    text = made(HOSTILE)
    inner = re.sub(r"^<(p|pre)>|</(p|pre)>$", "", text)
    assert not set(inner) & set("<>\"'\x1b")


def test_lines_stay_lines():
    assert code("a\nb") == "<pre>a\nb</pre>"


def test_a_bar_is_the_proved_share_of_what_breaks():
    own = Margin("gain", "", 0.25, HOSTILE, upper=0.5, example=HOSTILE)
    text = margins_table([own])
    assert "width: 50.0%" in text
    assert "breaks at 0.5" in text
    assert HOSTILE not in text
    assert "<b" not in text
    assert "width" not in margins_table([Margin("rate", "", 3.0, "1/s")])


def test_what_is_said_is_what_is_proved(physical):
    found = in_service(place(physical, Disk(-40, 31)))
    text = margins_table(found)
    for own in found:
        assert f"<th>{own.subject}</th><td>{own.text} {own.unit}".rstrip() in text
