"""The page on dead times: its table is that of its script, and no proved value below the exact."""

from __future__ import annotations

import re

import pytest

from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "dead-time.md").read_text()
ROW = r"^\| (\d+) ms \| ([\d.]+) m \| ([\d.]+) m \|"
TABLE = [tuple(map(float, row)) for row in re.findall(ROW, PAGE, re.MULTILINE)]


def test_the_table_is_that_of_the_script(tmp_path):
    script = vars(docs_script("dead_time"))
    assert [row[0] for row in TABLE] == [1000 * time for time in script["TIMES"]]
    ((time, level, truth),) = script["rows"](tmp_path, [0.05])
    (shown,) = (row for row in TABLE if row[0] == 1000 * time)
    assert (level, truth) == pytest.approx(shown[1:], rel=2e-3)
    assert all(exact < proved < 1.03 * exact for _, proved, exact in TABLE)
