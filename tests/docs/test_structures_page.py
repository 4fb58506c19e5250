"""docs/structures.md: its specs are read, its Python runs, its errors are said."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest

from polefence import Disk, FixedGain, HalfPlane, analyse, load_specifications, load_structure
from polefence.certify.bounds import kept_bound
from polefence.cli.main import main
from polefence.examples import spec_path, spec_text
from polefence.law.structure import Structure
from polefence.plant.spec import load
from support.commands import ran
from support.paths import DOCS

PAGE = (DOCS / "structures.md").read_text()
HARDWARE, TRACKING, PI, ERROR = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)


def block(name):
    """The console block of a command on a file of that name."""
    found = re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)
    return next(text for text in found if f" {name}" in text)


def law(shown):
    """The gain that a block shows."""
    rows = re.search(r"^  K = \[(.*)\]$", shown, re.MULTILINE)[1].split(";")
    return np.array([[*map(float, row.split())] for row in rows])


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


def test_the_tracking_loop_is_read(spec):
    spec.write_text(TRACKING)
    plant, (minimise, limits) = load(spec), load_specifications(spec)
    assert plant.disturbances == ("command [m]",)
    assert [y.name for y in load_structure(spec).outputs(plant)] == ["error of position"]
    assert minimise.signal == "weighted error of position"
    for asked in (minimise, *limits):
        asked.require_fit(plant)


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
    shown = block("ride.toml")
    command = next(line for line in shown.splitlines() if " optimise " in line)
    assert main(shlex.split(command)[2:]) == 0
    said = capsys.readouterr().out
    assert shown.splitlines()[2] == said.splitlines()[0]
    row = re.compile(r"rms of sprung-mass acceleration \[m/s2\] +([0-9.]+) +([0-9.]+)")
    (page,), (here,) = row.findall(shown), row.findall(said)
    assert [*map(float, here)] == pytest.approx([*map(float, page)], rel=2e-3)


def classic(name):
    """The plant of an example with its law's states, and the structure of that law's gain."""
    plant, structure = load(spec_path(name)), load_structure(spec_path(name))
    return *structure.extended(plant), structure.order


def test_the_compensator_of_the_two_masses_decays_as_the_page_says():
    shown = block("two.toml")
    plant, _, _ = classic("two-masses")
    decay = float(re.search(r"decay rate ([0-9.]+)", shown)[1]) - 6e-4  # the page rounds K
    K = FixedGain(law(shown))
    assert decay > 0.25
    assert analyse(plant, K, HalfPlane(decay)).proved
    alpha = np.random.default_rng(5).dirichlet([1, 1], 1000)
    A, B = plant.at(alpha)
    assert np.linalg.eigvals(A + B @ K.K).real.max() < -decay
    # of the position alone, and of the law's states
    assert not np.any(K.K[:, [0, 2, 3]])


def test_the_law_of_the_suspension_keeps_its_gains():
    shown = block("car.toml")
    plant, gain, order = classic("active-suspension")
    own = gain.law(plant, law(shown)[None])
    least, (limit,) = load_specifications(spec_path("active-suspension"))
    # the page rounds
    assert analyse(plant, own, HalfPlane(0.99) & Disk(-400, 401)).proved
    (page,) = re.findall(r"gain of suspension deflection \[.*\] +([0-9.]+)", shown)
    asked = replace(least.extended(5, order), at_most=1.03 * float(page))
    assert kept_bound(plant, own, asked) is not None
    alpha = np.random.default_rng(6).dirichlet([1, 1], (500, 2))
    alpha = np.array([np.kron(*each) for each in alpha])
    worst = least.extended(5, order).values(plant, own, alpha).max()
    assert 0.97 * float(page) < worst <= 1.001 * float(page)
    assert limit.extended(5, order).values(plant, own, alpha).max() <= 16 * 1.001
    passive = least.values(
        load(spec_path("active-suspension")), FixedGain(np.zeros((1, 5))), np.eye(4)
    )
    assert passive.max() == pytest.approx(0.396, abs=5e-4)


def test_a_law_measures_an_error(tmp_path, capsys):
    """Beside a plant of two states, of which a filtered error is to be small."""
    path = tmp_path / "error.toml"
    path.write_text(
        'name = "servo"\nstates = ["angle", "rate"]\ninputs = ["u"]\ndisturbances = ["command"]\n'
        "[matrices]\nA = [[0, 1], [0, -1]]\nB = [[0], [1]]\nE = [[0], [0]]\n"
        + ERROR.replace("order = 2", "order = 1")
    )
    words = ["--minimise", "gain of [error, u]", "--limit", "gain of angle <= 3"]
    ran(capsys, "optimise", str(path), *words, "-o", str(tmp_path / "made"))
    said = ran(capsys, "check", str(tmp_path / "made"), "--spec", str(path))
    assert "'error' = -x1 + w1" in said
