"""README's animation: its script draws it, and what it shows is so."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from support.paths import DOCS, ROOT
from support.scripts import docs_script

IMAGES = DOCS / "images"


@pytest.fixture(scope="module")
def script():
    return docs_script("moving_poles")


def test_the_proved_law_keeps_the_disk_and_the_nominal_gain_does_not(script, physical):
    values = script.way(physical, 60)
    fixed, proved = script.poles(physical, values)
    assert (script.DISK.distance(fixed) > 1).any()
    assert (script.DISK.distance(proved) < 0).all()
    for own, reached in zip(physical.parameters, values.T, strict=True):
        assert (reached.min(), reached.max()) == pytest.approx((float(own.low), float(own.high)))


def opened(path):
    """The number of frames, the size and the first frame."""
    with Image.open(path) as own:
        return getattr(own, "n_frames", 1), own.size, np.asarray(own.convert("RGB"))


def test_the_script_draws_the_animation_and_its_still(script, tmp_path):
    script.main(tmp_path, 2)
    drawn, still = (opened(tmp_path / f"moving-poles.{own}") for own in ("gif", "png"))
    assert (drawn[0], still[0]) == (3, 1)
    assert drawn[1] == still[1] == script.SIZE
    assert np.array_equal(drawn[2], still[2])


def test_readme_shows_one_small_animation_with_a_still(script):
    assert opened(IMAGES / "moving-poles.gif")[:2] == (1 + script.FRAMES, script.SIZE)
    assert (IMAGES / "moving-poles.gif").stat().st_size < 500_000
    readme = (ROOT / "README.md").read_text()
    assert readme.count(".gif") == 1
    assert 'reduce)" srcset="docs/images/moving-poles.png"' in readme
