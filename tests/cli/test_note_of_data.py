"""A plant that was fitted to data: every answer about it says so, on the screen and in files."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from dataclasses import replace

import pytest

from polefence.certify.design import Design
from polefence.cli.main import main
from polefence.plant.spec import dumps, load, loads
from polefence.proof.fitted import Data, Misfit
from polefence.response.samples import at_sample_time
from support.every_file import SPEC

TABLE = """[data]
kind = "time"
files = ["a.csv", "b.csv"]
samples = 2000
all = {rms = 0.012, largest = 0.051}
place = "a.csv, x, at 0.3 s"
left_out = {rms = 0.014, largest = 0.06}
[data.outputs]
x = {rms = 0.012, largest = 0.051}
"""
ASKED = """[[specification]]
kind = "rms"
signal = "x"
density = 1
minimise = true
[[specification]]
kind = "rms"
signal = "u"
density = 1
at_most = 2
"""
NOTE = (
    "unproved, from data: that the plant is in the family, which misses 2 measured responses by "
    "1.2 % rms, 5.1 % at most (a.csv, x, at 0.3 s); one left out of the fit, 1.4 % rms, 6 % at most"
)
COMMANDS = {
    "design": "design mass.toml -o again",
    "limits": "limits mass.toml --centre -4",
    "tightest": "tightest mass.toml --of half-plane",
    "observe": "observe mass.toml --measured x --disk -3 2.5 -o seen",
    "optimise": "optimise mass.toml -o best",
    "tradeoff": "tradeoff mass.toml --method quadratic --over 'rms of u' --value 2",
    "analyse": "analyse mass.toml --gain '[-1 -1]'",
    "verify": "verify mass.toml --gain '[-1 -1]'",
    "service": "service made -o margins",
    "loops": "loops made --samples 3",
    "simulate": "simulate made --impulse-in w=1",
    "report": "report made",
    "export": "export made -o code",
    "matlab": "export made --lang mat -o matlab",
    "check": "check made",
    "check of a spec": "check made --spec mass.toml",
}


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    (folder / "mass.toml").write_text(SPEC + TABLE + ASKED)
    assert main(["design", str(folder / "mass.toml"), "-o", str(folder / "made"), "--quiet"]) == 0
    return folder


def run(words, monkeypatch, here):
    monkeypatch.chdir(here)
    return main(shlex.split(words))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_once_what_is_unproved(name, here, monkeypatch, capsys):
    run(COMMANDS[name], monkeypatch, here)
    out, err = capsys.readouterr()
    assert not err
    assert out.count(NOTE) == 1
    assert out.splitlines().count(NOTE) == 1


def test_a_plant_that_is_not_from_data_has_no_such_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "mass.toml").write_text(SPEC)
    assert run("design mass.toml", monkeypatch, tmp_path) == 0
    assert "from data" not in capsys.readouterr().out


def test_it_survives_into_the_design_its_code_and_its_page(here, monkeypatch):
    document = json.loads((here / "made" / "design.json").read_text())
    assert document["plant"]["data"]["all"] == {"rms": 0.012, "largest": 0.051}
    assert Design.load(here / "made").plant.data == load(here / "mass.toml").data
    assert run("export made -o written --quiet", monkeypatch, here) == 0
    for name in ("law.h", "README.md"):
        text = " ".join((here / "written" / name).read_text().replace("*", " ").split())
        assert NOTE[1:] in text
    assert run("report made -o page.html --quiet", monkeypatch, here) == 0
    assert NOTE in (here / "page.html").read_text()


@pytest.mark.parametrize("words", ["design mass.toml", "service made", "loops made", "check made"])
def test_json_has_it(words, here, monkeypatch):
    assert run(f"{words} --json said.json --quiet", monkeypatch, here) == 0
    said = json.loads((here / "said.json").read_text())
    assert NOTE in (said.get("unproved"), said.get("plant", {}).get("unproved"))


def test_the_checker_alone_says_it(here, monkeypatch):
    assert run("check --standalone alone.pyz --quiet", monkeypatch, here) == 0
    words = [sys.executable, "-S", "alone.pyz", "made/design.json"]
    said = subprocess.run(words, cwd=here, capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == NOTE


@pytest.mark.parametrize(
    "change",
    [lambda table: table.pop("data"), lambda table: table["data"]["all"].update(rms=0.01)],
)
def test_a_design_without_it_is_not_about_the_spec(change, here, tmp_path, monkeypatch, capsys):
    document = json.loads((here / "made" / "design.json").read_text())
    change(document["plant"])
    (tmp_path / "design.json").write_text(json.dumps(document))
    assert run(f"check {tmp_path} --spec mass.toml", monkeypatch, here) == 1
    assert "other data" in capsys.readouterr().out


def test_a_spec_that_is_written_has_it(here):
    plant = load(here / "mass.toml")
    assert loads(dumps(plant)) == plant
    odd = replace(
        plant.data,
        files=('a "b".csv',),
        outputs=(("z [%]", Misfit(1e-9, 2.5)),),
        left_out=None,
        place="",
    )
    assert loads(dumps(replace(plant, data=odd))).data == odd
    assert odd.note.endswith("misses 1 measured response by 1.2 % rms, 5.1 % at most")


def test_samples_of_the_plant_have_it(here):
    assert at_sample_time(load(here / "mass.toml"), 0.01).data is not None


FAULTS = {
    "a number": ("[data]\n", "data = 1\n", "data must be a table"),
    "no kind": ('kind = "time"\n', "", "data.kind is missing"),
    "another kind": ('"time"', '"both"', 'data.kind must be "time" or "frequency"'),
    "no file": ('["a.csv", "b.csv"]', "[]", "data.files must name 1 to"),
    "samples": ("2000", "0", "data.samples must be a whole number"),
    "negative": ("rms = 0.014", "rms = -1", "data.left_out.rms must not be negative"),
    "not finite": ("rms = 0.014", "rms = nan", "data.left_out.rms"),
    "no outputs": ("x = {rms = 0.012, largest = 0.051}", "", "data.outputs must name 1 to"),
    "a text": ("largest = 0.06", 'largest = "much"', "data.left_out.largest"),
    "unknown": ("samples", "why = 1\nsamples", "unknown key data.why"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_table_that_says_nothing_is_one_line(fault, tmp_path, monkeypatch, capsys):
    old, new, said = FAULTS[fault]
    assert TABLE.count(old)
    table = "" if fault == "a number" else TABLE.replace(old, new, 1)
    head = new if fault == "a number" else ""
    (tmp_path / "mass.toml").write_text(head + SPEC + table)
    assert run("design mass.toml", monkeypatch, tmp_path) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_frequency_responses_are_called_so():
    misfit = Misfit(0.0, 0.001)
    data = Data("frequency", ("a",), 3, misfit, (("y", misfit),))
    assert data.note.endswith("misses 1 measured frequency response by 0 % rms, 0.1 % at most")
