"""Pages of the gallery: each prints what its script prints, and shows the figures that it draws."""

from __future__ import annotations

import re

import pytest

from support.gallery import alike, page
from support.paths import DOCS
from support.scripts import docs_script

PAGES = sorted(path.stem.removeprefix("gallery-") for path in DOCS.glob("gallery-*.md"))
# These have tests of their own: they take longer, print more than their pages show, or are looked
# into as they run.
OWN = {
    "active-suspension",
    "buck-converter",
    "car-to-board",
    "cart-pole",
    "cortex",
    "fleet",
    "fmu",
    "half-car",
}


@pytest.mark.parametrize("name", sorted({*PAGES} - OWN))
def test_a_page_shows_what_its_script_prints_and_draws(name, tmp_path, capsys):
    docs_script(name.replace("-", "_")).main(tmp_path)
    alike(name, capsys.readouterr().out, tmp_path)


@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_found_and_says_how_it_was_made(name):
    index = (DOCS / "index.md").read_text()
    assert f"\ngallery-{name}\n" in index
    assert f"docs/examples/{name.replace('-', '_')}.py" in page(name)
    for image in re.findall(r"\(images/(.*?\.png)\)", page(name)):
        assert (DOCS / "images" / image).exists()


def test_there_are_sixteen_pages_and_more():
    assert len(PAGES) >= 16
