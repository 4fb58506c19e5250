"""The gallery: its numbers are those of its scripts and commands, its bounds above samples."""

from __future__ import annotations

import re

import numpy as np
import pytest

from polefence.certify.bounds import best_bound
from polefence.law.laws import FixedGain
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-active-suspension.md").read_text()
TABLE = {
    name.strip(): [float(x) for x in numbers.split("|")[:3]]
    for name, numbers in re.findall(r"^\| ([^|]*) \| (\d.*)$", PAGE, re.MULTILINE)
}


@pytest.fixture(scope="module")
def example():
    return vars(docs_script("active_suspension"))


@pytest.fixture(scope="module")
def found(example):
    return example["design"](1)


def test_the_laws_have_the_numbers_of_the_table(example, found):
    for name, own in (("one gain of both signals", example["design"](0)), ("order 1", found)):
        numbers = [example["sampled"](own, n) for n in (20, 10_000)]
        numbers.append(own.bounds[0].level)
        assert numbers == sorted(numbers)
        assert numbers == pytest.approx(TABLE[name], rel=1e-2)
        assert numbers[2] < 1.003 * numbers[1]


def test_the_command_prints_the_bounds_of_the_page(found):
    shown = re.findall(r"rms of (.*) \[.*\] +(\S+) +(\S+) +\S+ +(\S+)", PAGE)
    assert [name for name, *_ in shown] == [own.specification.name for own in found.bounds]
    for own, (_, proved, sampled, _) in zip(found.bounds, shown, strict=True):
        assert own.level == pytest.approx(float(proved), rel=1e-2)
        assert float(sampled) <= float(proved)


def test_the_passive_car_has_the_number_of_the_table(found):
    plant, own = found.plant, found.bounds[0].specification
    level = best_bound(plant, FixedGain(states_at_rest(plant)), own).level
    assert level == pytest.approx(TABLE["passive"][2], rel=1e-3)


def states_at_rest(plant):
    """A law whose own states decay, and which demands nothing."""
    K = np.zeros(plant.shape[::-1])
    K[1, -1] = -1.0
    return K


def test_the_figure_is_drawn_and_says_what_the_page_says(example, found, tmp_path):
    example["draw"](found, tmp_path)
    assert (tmp_path / "active-suspension.png").stat().st_size > 20_000
    drive, road = (
        example["drive"],
        example["on_road"](found.plant, example["ROAD"], 10.0, 1e-3, 1.5),
    )
    alpha = example["random_actuators"](found.plant, 20)
    signals = example["SIGNALS"]
    own, passive = (
        np.abs(drive(found.plant, law, road, alpha).response(signals).values).max(axis=(0, 1))
        for law in (found.law, None)
    )
    less, more = (float(x) / 100 for x in re.search(r"(\d+) % less .* (\d+) % more", PAGE).groups())
    assert 1 - own[0] / passive[0] == pytest.approx(less, abs=0.012)
    assert own[1] / passive[1] - 1 == pytest.approx(more, abs=0.012)
