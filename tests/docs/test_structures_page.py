"""docs/structures.md: its specs are read, its Python runs, its errors are said."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest

from polefence import load_structure
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.law.structure import Structure
from polefence.plant.spec import load
from support.paths import DOCS

PAGE = (DOCS / "structures.md").read_text()
HARDWARE, PI = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def spec(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "active.toml"
    path.write_text(spec_text("quarter-car-ride") + HARDWARE)
    (tmp_path / "ride.toml").write_text(spec_text("quarter-car-ride"))
    return path


def test_the_python_runs(spec, capsys):
    scope = {}
    for text in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(text, scope)
    said = capsys.readouterr().out.splitlines()
    assert "measured suspension deflection [m]" in said[0]
    assert said[1] == "('noise of sprung-mass acceleration', 'noise of suspension deflection')"
    assert float(said[2]) == pytest.approx(0.05)
    assert "9 states, 3 inputs" in said[3]
    assert scope["gain"].free(scope["larger"]).shape == (3, 4)
    assert np.linalg.eigvals(scope["plant"].A[0]).real.max() < 0


def test_every_command_has_the_hardware(spec, capsys):
    assert main(["compare", str(spec), "--law", "passive", "--law", "skyhook"]) == 0
    assert "skyhook" in capsys.readouterr().out


def test_the_pi_law_has_two_gains(spec):
    spec.write_text(spec_text("quarter-car-ride") + PI)
    plant = load(spec)
    larger, gain = load_structure(spec).extended(plant)
    assert gain.free(larger).tolist() == [[0, 1, -1]]
    assert len(gain.powers(larger)) == 1


def test_every_key_has_its_row():
    table = PAGE.split("## The law")[1].split("##")[0]
    for key in Structure.__dataclass_fields__:
        assert f"| `{key}` |" in table


def test_the_command_prints_about_what_the_page_shows(spec, capsys):
    """Digits of a search that is not convex are those of a machine: a bound is near the page's."""
    (shown,) = re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)
    command = next(line for line in shown.splitlines() if " optimise " in line)
    assert main(shlex.split(command)[2:]) == 0
    said = capsys.readouterr().out
    assert shown.splitlines()[2] == said.splitlines()[0]
    row = re.compile(r"rms of sprung-mass acceleration \[m/s2\] +([0-9.]+) +([0-9.]+)")
    (page,), (here,) = row.findall(shown), row.findall(said)
    assert [*map(float, here)] == pytest.approx([*map(float, page)], rel=2e-3)
