"""The page on inputs that end: its numbers are those of its script, and its spec the script's."""

from __future__ import annotations

import re

import pytest

import polefence as pf
from polefence.plant.spec import loads
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "input-limits.md").read_text()
TABLE = re.findall(
    r"^\| [^|]* \| ([\d.]+) (?:rad|times) \| ([\d.]+) (?:rad|times) \|", PAGE, re.MULTILINE
)


@pytest.fixture(scope="module")
def script():
    return vars(docs_script("input_limits"))


def test_the_table_is_that_of_the_script(script):
    plant = script["balance"]()
    spec = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)[1]
    assert loads(spec).digest == plant.digest
    cut = script["designed"](pf.Saturation, plant)
    (least, _), sizes = TABLE[0], TABLE[1]
    assert cut.bounds[0].level == pytest.approx(float(TABLE[0][1]), abs=1e-4)
    assert float(least) > 1.9 * cut.bounds[0].level
    for kind, size in zip((pf.InitialPeak, pf.Saturation), sizes, strict=True):
        assert script["caught"](kind, cut.law, plant) == pytest.approx(float(size), abs=2e-3)
