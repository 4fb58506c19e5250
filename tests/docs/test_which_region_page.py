"""The page on regions of cars: its numbers are those of the pages that compute them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from polefence.examples import family
from support.paths import DOCS

PAGE = (DOCS / "which-region.md").read_text()
RIDE = (DOCS / "ride.md").read_text()


def test_what_a_region_costs_is_what_the_page_of_the_ride_has():
    """Which tests compare with the searches themselves."""
    own = re.findall(r"^\| (passive car|stable|`.*?`) \| ([\d.]+) \| ([\d.]+) \|$", PAGE, re.M)
    theirs = {
        region.strip(): (float(level.split()[0]), float(travel))
        for law, region, level, *_, travel, _ in (
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in RIDE.splitlines()
            if line.startswith(("| passive |", "| default |"))
        )
    }
    assert len(own) == 5
    for region, level, travel in own:
        known = theirs["" if region == "passive car" else region]
        assert float(level) == pytest.approx(
            known[0], abs=6e-4 if "passive" not in region else 6e-3
        )
        assert float(travel) == known[1]


def test_the_passive_car_is_as_the_page_says():
    poles = np.linalg.eigvals(family("quarter-car-ride").A)
    ratio = -poles.real / np.abs(poles)
    decay = float(re.search(r"decays with ([\d.]+) 1/s", PAGE)[1])
    assert -poles.real.max() == pytest.approx(decay, abs=5e-3)
    least, speed = re.search(r"ratio is ([\d.]+), that of the wheel at some (\d+)", PAGE).groups()
    assert ratio.min() == pytest.approx(float(least), abs=5e-4)
    assert np.abs(poles.ravel()[ratio.ravel().argmin()]) == pytest.approx(float(speed), rel=0.05)


def test_the_published_disk_rides_as_the_page_of_the_reproduction_says():
    pair = r"([\d.]+) to\s([\d.]+\d)"
    found = re.search(rf"{pair} m/s² in place of {pair}", PAGE).groups()
    row = next(
        line
        for line in (DOCS / "reproduction.md").read_text().splitlines()
        if line.startswith("| physical") and " to " in line
    )
    assert re.findall(r"[\d.]+", row)[:4] == list(found)
