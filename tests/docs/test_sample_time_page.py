"""The page on designs at a sample time: its numbers are those of its script."""

from __future__ import annotations

import re
from itertools import islice

import pytest

from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "sample-time.md").read_text()
ROW = r"^\| (\d+) ms \| ([\d.]+) 1/s \| (.*?) \| ([\d.]+) m/s² \| ([\d.]+) "
TABLE = re.findall(ROW, PAGE, re.MULTILINE)


@pytest.fixture(scope="module")
def script():
    return vars(docs_script("sample_time"))


def test_decay_rates_are_those_of_the_table(script):
    found = list(script["decays"]())
    assert len(TABLE) == len(found) == 3
    for (T, own, after), (ms, decay, sampled, *_) in zip(found, TABLE, strict=True):
        assert pytest.approx(float(ms)) == 1000 * T
        assert own == pytest.approx(float(decay), rel=1e-2)
        if sampled == "nothing proved":
            assert after == 0
        else:
            assert after == pytest.approx(float(sampled.split()[0]), rel=1e-2)


def test_remainders_are_those_of_the_table(script):
    rows = [
        re.findall(r"[\d.]+", re.search(rf"^\| {name}.*?\|(.*)$", PAGE, re.MULTILINE)[1])
        for name in ("degree", "largest entry", "largest decay rate that")
    ]
    numbers = [[float(x) for x in row if x != "1"] for row in rows[1:]]
    found = list(script["degrees"]())
    assert [str(degree) for degree, *_ in found] == rows[0]
    for (_, size, decay), largest, proved in zip(found, *numbers, strict=True):
        assert size == pytest.approx(largest, rel=0.05)
        assert decay == pytest.approx(proved, rel=1e-2)


def test_rides_at_all_times_are_those_of_the_table(script):
    """Of the two shorter times; the law of 20 ms takes half a minute.

    Several laws have the same bound at all times, and differ at the samples by a percent.
    """
    (_, best, _), *found = islice(script["rides"](), 3)
    assert f"In continuous time {best:.3f} m/s² is proved" in PAGE
    for (_, level, own), (*_, proved, alone) in zip(found, TABLE, strict=False):
        assert level == pytest.approx(float(proved), rel=3e-3)
        assert own == pytest.approx(float(alone), rel=1e-2)
