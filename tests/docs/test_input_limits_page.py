"""The page on inputs that end: its numbers are those of its script, and its spec the script's."""

from __future__ import annotations

import re

import pytest

import polefence as pf
from polefence.plant.spec import loads
from polefence.proof import claims as proof
from polefence.proof.document import loads as read
from support.console import blocks, follow
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "input-limits.md").read_text()
TABLE = re.findall(
    r"^\| [^|]* \| ([\d.]+) (?:rad|times) \| ([\d.]+) (?:rad|times) \|", PAGE, re.MULTILINE
)


@pytest.fixture(scope="module")
def script():
    return vars(docs_script("input_limits"))


def test_the_commands_print_what_the_page_shows_and_the_table_states_it(
    script, tmp_path, monkeypatch, capsys
):
    plant = script["balance"]()
    spec, lag = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert loads(spec).digest == plant.digest
    (tmp_path / "balance.toml").write_text(spec)
    (tmp_path / "lag.toml").write_text(lag)
    for block in blocks(PAGE):
        follow(block, tmp_path, monkeypatch, capsys)
    file = tmp_path / "balance" / "design.json"
    document = read(file.read_text())
    bound = document.first(proof.Rms)
    (least, own), sizes = TABLE[0], TABLE[1]
    assert float(bound.level) == pytest.approx(float(own), abs=1e-4)
    assert float(least) > 1.9 * bound.level
    law = script["GIVEN"]
    for kind, size in zip((pf.InitialPeak, pf.Saturation), sizes, strict=True):
        assert script["caught"](kind, law, plant) == pytest.approx(float(size), abs=1e-3)
