"""Pages of the gallery beside what their scripts print and draw."""

from __future__ import annotations

import re

import pytest

from support.paths import DOCS

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?")


def page(name):
    """The text of a page."""
    return (DOCS / f"gallery-{name}.md").read_text()


def alike(name, said, folder):
    """Compare what a page shows with what its script has printed and drawn."""
    (shown,) = re.findall(r"```text\n(.*?)```", page(name), re.DOTALL)
    assert words(said) == words(shown)
    ours, theirs = ([float(x) for x in NUMBER.findall(text)] for text in (said, shown))
    assert ours == pytest.approx(theirs, rel=1e-2, abs=1e-9)
    drawn = {own.name for own in folder.glob("*.png")}
    assert drawn == set(re.findall(r"\(images/(.*?\.png)\)", page(name)))
    assert all((folder / own).stat().st_size > 10_000 for own in drawn)


def words(text):
    """A text without its numbers."""
    return re.sub(r"\s+", " ", NUMBER.sub("#", text))
