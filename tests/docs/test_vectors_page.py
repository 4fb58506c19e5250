"""docs/vectors.md: its commands print what it shows, its Python runs, its numbers are measured."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest

import polefence as pf
from polefence.certify.bounds import best_bound, sampled
from polefence.cli.main import main
from polefence.examples import family
from polefence.plant.outputs import weighted_sum
from polefence.requirements.text import parse_specification
from support.paths import DOCS

PAGE = (DOCS / "vectors.md").read_text()
COMMANDS = re.findall(r"^\$ (.*)\n((?:(?!\$ |```).*\n)*)", PAGE, re.MULTILINE)
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]\d+)?(?![\w.]*\w)")
OPTIMAL = 2e-2  # of what the optimum leaves free


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("page")
    (spec,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (found / "platform.toml").write_text(spec)
    return found


def test_the_commands_print_what_the_page_shows(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert len(COMMANDS) == 2
    for command, shown in COMMANDS:
        assert main(shlex.split(command)[1:]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert len(lines) == len(shown.splitlines())
        for wanted, line in zip(shown.splitlines(), lines, strict=True):
            if wanted.endswith(" = ..."):
                assert line.startswith(wanted.removesuffix("..."))
                continue
            assert NUMBER.sub("#", wanted).split() == NUMBER.sub("#", line).split()
            shows, says = ([float(n) for n in NUMBER.findall(part)] for part in (wanted, line))
            assert says == pytest.approx(shows, rel=OPTIMAL)
            if line.endswith("minimised"):
                assert says == pytest.approx(shows, rel=1e-3)


def test_the_python_runs(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (text,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    scope = {}
    exec(text, scope)
    said = capsys.readouterr().out
    assert said.startswith("rms of [deflection over 1 mm, force over 10 N] from [draught * 2] <= ")
    assert scope["done"].bounds[1].level == 0.06


def test_the_lines_of_the_table_mean_what_its_python_means():
    rows = [row for row in PAGE.splitlines() if row.startswith("|") and " of " in row]
    lines = [re.findall(r"`([^`]*)`", row)[1] for row in rows if "<=" in row]
    found = [parse_specification(f"{line} with density 1" if "rms" in line else line)
             for line in lines]  # fmt: skip
    assert found == [
        pf.Gain(["a", "b"], 2),
        pf.Rms("a", 2, disturbances=["road"]),
        pf.Rms("a", 2, disturbances={"road": 0.5, "wind": 20}),
    ]


def test_what_the_block_gains_is_measured():
    plant, law = family("quarter-car-ride"), pf.FixedGain(np.zeros((1, 4)))
    names = ("sprung-mass acceleration", "tyre deflection", "suspension deflection")
    pairs = zip(names, (1, 200, 40), strict=True)
    entries = [weighted_sum(f"weighted {n}", "", [(s, plant.signal(n))]) for n, s in pairs]
    own = pf.Rms(entries, density=0.002)
    level, worst = best_bound(plant, law, own).level, sampled(plant, law, own).worst
    assert worst < level < worst * (1 + 1e-4)
    apart = [best_bound(plant, law, pf.Rms(y, density=0.002)).level for y in entries]
    assert np.sqrt(np.sum(np.square(apart))) / level == pytest.approx(1.08, abs=0.005)
    assert "8 % higher" in PAGE
