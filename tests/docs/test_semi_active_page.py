"""The gallery's controllable damper: levels in their order, and a law that is the damper's own."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from polefence.plant.spec import loads
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-semi-active.md").read_text()
ROWS = ("mass [kg]", "best fixed damper", "law, in drives", "no logic goes below")


@pytest.fixture(scope="module")
def found():
    example = docs_script("semi_active")
    least, _ = pf.load_specifications(pf.examples.spec_path("semi-active"))
    rows = (re.search(rf"^{re.escape(name)} +(\d.*)$", PAGE, re.MULTILINE)[1] for name in ROWS)
    return example, loads(example.SPEC), least, [np.array(own.split(), float) for own in rows]


def test_the_levels_are_in_their_order(found):
    example, plant, least, (masses, fixed, drives, floor) = found
    assert masses == pytest.approx(example.MASSES)
    level = float(re.search(r"law: at most (\S+) m/s2", PAGE)[1])
    assert np.all(floor < drives)
    assert np.all(drives < fixed)
    assert drives.max() < level < fixed.max()
    own = np.array([example.fixed(plant, least, c) for c in np.linspace(300, 3000, 200)])
    assert np.all(own > floor)
    assert own.max(axis=1).min() == pytest.approx(fixed.max(), rel=1e-3)


def test_in_another_drive_the_law_is_as_good_and_only_damps(found):
    example, plant, least, (*_, drives, floor) = found
    law = pf.semi_active(plant, least, [example.DAMPER], degree=2)  # K is that of any degree
    drive = example.driven(plant, law, least, seed=100)
    squares = (drive.response(list(least.signal)).values ** 2).sum(axis=2).mean(axis=1)
    assert np.sqrt(squares) == pytest.approx(drives, rel=0.04)
    assert np.all(np.sqrt(squares) > floor)
    names = ["sprung-mass velocity", "unsprung-mass velocity", "damper force"]
    body, wheel, force = np.moveaxis(drive.response(names).values, 2, 0)
    v = wheel - body
    low, high = (float(c) * v for c in (example.DAMPER.low, example.DAMPER.high))
    assert np.all((force - low) * (force - high) <= 1e-6 * np.abs(force).max() ** 2)
    assert (force * v).min() > -1e-9
