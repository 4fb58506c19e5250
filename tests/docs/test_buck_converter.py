"""The page of the buck converter: its numbers, its impedances below the proved level."""

from __future__ import annotations

import re

import numpy as np
import pytest

from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-buck-converter.md").read_text()


@pytest.fixture(scope="module")
def example():
    return vars(docs_script("buck_converter"))


@pytest.fixture(scope="module")
def found(example):
    return example["designed"]()


def test_the_page_has_the_numbers(example, found):
    design, bound = found
    assert design.proved
    assert bound.answer == "proved"
    proved, sampled, source, load = map(
        float, re.search(r"impedance: (\S+) ohm proved, (\S+) .* (\S+), .* (\S+)}", PAGE).groups()
    )
    assert bound.bound.level == pytest.approx(proved, abs=1e-4)
    assert bound.worst == pytest.approx(sampled, abs=1e-4)
    assert bound.values == {"source": source, "load": load}
    _, volts = example["dips"](design)
    assert volts.min() == pytest.approx(float(re.search(r"of 1 A: (\S+) V", PAGE)[1]), abs=1e-3)
    assert np.abs(volts[:, -1]).max() < 1e-3


def test_impedances_lie_below_the_proved_level(example, found):
    design, bound = found
    w, ohms = example["impedances"](design, 10)
    assert 0.8 * bound.bound.level < ohms.max() < bound.bound.level
    # far above, the capacitor alone; at rest the integral leaves nothing
    assert ohms[:, -1] == pytest.approx(1 / (w[-1] * 220e-6), rel=1e-2)
    assert ohms[:, 0].max() < 0.02


def test_the_duty_cycle_of_a_step_is_what_the_page_says(example, found):
    design, worst = found[0], 0.0
    for A, E in example["random_plants"](design, 40):
        x, step = np.zeros((3, 1)), 2e-6
        for _ in range(1500):
            x = x + step * (A @ x + E)
            worst = max(worst, abs(float((design.law.K @ x)[0, 0])))
    assert worst == pytest.approx(float(re.search(r"moves it by (\S+) at", PAGE)[1]), abs=1e-3)


def test_the_figure_is_drawn(example, found, tmp_path):
    example["draw"](*found, tmp_path)
    assert (tmp_path / "buck-converter.png").stat().st_size > 20_000
