"""Pages of the gallery: each prints what its script prints, and shows the figures that it draws."""

from __future__ import annotations

import re

import pytest

from support.paths import DOCS
from support.scripts import docs_script

PAGES = sorted(path.stem.removeprefix("gallery-") for path in DOCS.glob("gallery-*.md"))
# These have tests of their own: they take longer, or print more than their pages show.
OWN = {"active-suspension", "buck-converter", "cart-pole", "cortex", "fmu"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?")


def page(name):
    return (DOCS / f"gallery-{name}.md").read_text()


@pytest.mark.parametrize("name", sorted({*PAGES} - OWN))
def test_a_page_shows_what_its_script_prints_and_draws(name, tmp_path, capsys):
    docs_script(name.replace("-", "_")).main(tmp_path)
    said = capsys.readouterr().out
    (shown,) = re.findall(r"```text\n(.*?)```", page(name), re.DOTALL)
    assert words(said) == words(shown)
    ours, theirs = ([float(x) for x in NUMBER.findall(text)] for text in (said, shown))
    assert ours == pytest.approx(theirs, rel=1e-2, abs=1e-9)
    drawn = {own.name for own in tmp_path.glob("*.png")}
    assert drawn == set(re.findall(r"\(images/(.*?\.png)\)", page(name)))
    assert all((tmp_path / own).stat().st_size > 10_000 for own in drawn)


def words(text):
    return re.sub(r"\s+", " ", NUMBER.sub("#", text))


@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_found_and_says_how_it_was_made(name):
    index = (DOCS / "index.md").read_text()
    assert f"\ngallery-{name}\n" in index
    assert f"docs/examples/{name.replace('-', '_')}.py" in page(name)
    for image in re.findall(r"\(images/(.*?\.png)\)", page(name)):
        assert (DOCS / "images" / image).exists()


def test_there_are_sixteen_pages_and_more():
    assert len(PAGES) >= 16
