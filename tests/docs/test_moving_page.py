"""The page on parameters that move: its numbers are those of its script."""

from __future__ import annotations

import re

import pytest

from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "moving.md").read_text()
ROW = r"^\| (not at all|[\d]+ kg/s|any rate) \| ([\d.]+) m/s² \| ([\d.]+) 1/s \|"
TABLE = {row[0]: tuple(map(float, row[1:])) for row in re.findall(ROW, PAGE, re.MULTILINE)}


@pytest.fixture(scope="module")
def script():
    return vars(docs_script("moving_load"))


def test_the_table_is_that_of_the_script(script):
    assert len(TABLE) == 6
    (ride,), (decay,) = script["rides"](["any"]), script["decays"]([500])
    assert ride == pytest.approx(TABLE["any rate"][0], abs=1e-4)
    assert decay == pytest.approx(TABLE["500 kg/s"][1], abs=1e-2)
    columns = zip(*TABLE.values(), strict=True)
    assert [sorted(own) for own in columns] == [
        [row[0] for row in TABLE.values()],
        [row[1] for row in reversed(TABLE.values())],
    ]
