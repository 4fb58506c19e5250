"""docs/cars.md and docs/semi-active.md: their Python runs, and prints what they say."""

from __future__ import annotations

import re

import pytest

from support.paths import DOCS


def snippet(page):
    return re.search(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)[1]


def test_the_semi_active_page_prints_what_it_shows(capsys):
    exec(snippet("semi-active.md"), {})
    page, said = (DOCS / "semi-active.md").read_text(), capsys.readouterr().out
    assert f"prints\n\n```text\n{said}```" in page
    limit, stays, proved = re.findall(r"(\d\.\d{4}) m/s2", said)
    row = re.search(r"\| 4,000 \| (.*) \|", page)[1].split(" | ")
    assert [row[0], row[1], row[3]] == [f"{float(x):.3f}" for x in (stays, proved, limit)]


def test_the_page_of_cars_builds_one():
    names = {}
    exec(snippet("cars.md"), names)
    plant = names["plant"]
    assert plant.shape == (8, 2)
    x, m, J = -0.9, 483, 783  # where the load is
    assert float(names["empty"]) == pytest.approx(1 / (1 / m + x**2 / J))
