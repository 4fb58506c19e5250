"""The page on inputs that end: its numbers are those of its script, and its spec the script's."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from polefence.certify.bounds import best_bound
from polefence.plant.delta import delta_form
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
    written = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    spec, lag = (text for text in written if "[matrices]" in text)
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


def test_rates_are_as_the_table_has_them(script):
    plant = delta_form(pf.at_sample_time(script["balance"](), 0.02, delay=1))
    law = pf.FixedGain([[-20.0, -7.0, -0.3]])
    start = [(1.0, 0.0, 0.0)]
    cases = {
        "torque": ("torque", ()),
        "rate of torque": ("rate of torque", ()),
        "both, as shares of 20 Nm and 200 Nm/s": (["torque", "rate of torque"], (20.0, 200.0)),
    }
    for row, (signal, limits) in cases.items():
        (said,) = re.findall(rf"^\| {row} \|(.*)\|$", PAGE, re.MULTILINE)
        numbers = [float(x.split()[0].replace(",", "")) for x in said.split("|")]
        asked = pf.Saturation(signal, points=start, limits=limits)
        assert best_bound(plant, law, asked).level == pytest.approx(numbers[0], rel=1e-3)
        refuted = asked.values(plant, law, np.eye(4)).max()
        assert refuted == pytest.approx(numbers[1], rel=1e-3)
        names = [signal] if isinstance(signal, str) else signal
        free = max(
            pf.InitialPeak(name, points=start).values(plant, law, np.eye(4)).max() / limit
            for name, limit in zip(names, limits or (1.0,), strict=True)
        )
        assert free == pytest.approx(numbers[2], rel=2e-3)
