"""The command line as its contract has it."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from polefence import check
from polefence.cli.main import main
from polefence.examples import SPECS, spec_text
from polefence.plant.spec import dumps
from support.commands import ran, refused
from support.files import rewritten


@pytest.fixture
def spec(tmp_path, make_random):
    path = tmp_path / "plant.toml"
    path.write_text(dumps(make_random(8, 2, 1, 2)))
    return str(path)


@pytest.fixture
def car(tmp_path):
    path = tmp_path / "car.toml"
    path.write_text(spec_text("quarter-car-as-printed"))
    return str(path)


def test_limits_prints_and_writes_rows(spec, tmp_path, capsys):
    rows, figure = tmp_path / "out" / "rows.json", tmp_path / "out" / "figure.svg"
    words = ["limits", spec, "--centre", "-2", "--centre", "-3e0", "--method", "slack", "--gain"]
    assert main([*words, "--json", str(rows), "--plot", str(figure)]) == 0
    document = json.loads(rows.read_text())
    assert [row["centre"] for row in document["rows"]] == [-2.0, -3.0]
    for row in document["rows"]:
        assert set(row) == {
            *("centre", "method", "radius", "lower", "answer", "seconds", "runs", "unrunnable"),
            *("law", "proof", "status"),
        }
        assert row["status"] == row["answer"]
        assert 0 < row["lower"] < row["radius"] < row["lower"] * (1 + 1e-5)
        assert row["answer"] == "proved"
        assert len(row["law"]["K"]) == 1
    assert document["plant"]["vertices"] == 2
    assert "<svg" in figure.read_text()
    out = capsys.readouterr().out
    assert out.count("proved") == 2


def test_evenly_spaced_centres(spec, capsys):
    assert main(["limits", spec, "--centres", "-2", "-4", "3", "--method", "quadratic"]) == 0
    lines = capsys.readouterr().out.splitlines()[2:]
    assert [float(line.split()[0]) for line in lines] == [-2, -3, -4]


def test_design_then_check(car, tmp_path, capsys):
    folder = tmp_path / "design"
    words = ["design", car, "--disk", "-40", "31", "--method", "scheduled", "-o", str(folder)]
    assert "proved" in ran(capsys, *words, "--json", tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text())["answer"] == "proved"
    assert check(folder / "design.json").proved
    assert "proved: 20 inequalities" in ran(capsys, "check", folder / "design.json", "--spec", car)


@pytest.mark.parametrize(("method", "radius"), [("quadratic", "33.64"), ("slack", "33.50")])
def test_a_disk_out_of_reach_exits_1_and_names_the_radius(car, tmp_path, capsys, method, radius):
    folder = tmp_path / "design"
    words = ["design", car, "--disk", "-40", "31", "--method", method, "-o", str(folder)]
    error = refused(capsys, *words, status=1)
    assert error.startswith("refuted for ")
    assert radius in error
    assert not (folder / "design.json").exists()


def test_a_disk_across_the_axis_is_noted(spec, capsys):
    assert main(["design", spec, "--disk", "-1", "30", "--method", "quadratic"]) == 0
    assert "does not imply stability" in capsys.readouterr().out


def test_check_refuses_another_plant(small_designs, spec, tmp_path, capsys):
    path = small_designs["slack"].save(tmp_path / "d")
    assert "NOT about" in ran(capsys, "check", path, "--spec", spec, status=1)


def test_check_refuses_other_parameter_ranges(placed, car, tmp_path, capsys):
    """alpha(p) would be wrong: the vertices are the same, their meaning is not."""
    path = placed.save(tmp_path / "d")
    with rewritten(path) as document:
        document["plant"]["parameters"][1]["range"] = [-20, 10]
    assert main(["check", str(path)]) == 0
    assert "other parameter ranges" in ran(capsys, "check", path, "--spec", car, status=1)


def test_check_reports_a_counterexample(small_designs, tmp_path, capsys):
    path = small_designs["slack"].save(tmp_path / "d")
    with rewritten(path) as document:
        document["claims"][0]["region"]["radius"] *= 0.5
    answer = tmp_path / "answer.json"
    assert "refuted: at alpha = (" in ran(capsys, "check", path, "--json", answer, status=1)
    assert json.loads(answer.read_text())["answer"] == "refuted"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"format": "polefence-proof", "version": 9}', "version 9"),
        ('{"format"', "cut short"),
        ("[1, 2]", "not a file of proofs"),
    ],
)
def test_check_names_an_unreadable_file(tmp_path, capsys, content, message):
    path = tmp_path / "design.json"
    path.write_text(content)
    error = refused(capsys, "check", path)
    assert str(path) in error
    assert message in error
    assert main(["check", str(tmp_path / "none.json")]) == 2


def test_examples_are_listed_and_printed(capsys):
    listed = ran(capsys, "example")
    for name in SPECS:
        assert name in listed
        assert ran(capsys, "example", name) == spec_text(name)


def test_help_and_version(capsys):
    for words in (["--help"], ["limits", "--help"], ["--version"]):
        with pytest.raises(SystemExit) as stop:
            main(words)
        assert stop.value.code == 0
    assert "0 proved or done, 1 not proved, 2 bad input" in capsys.readouterr().out


@pytest.mark.parametrize("words", [[], ["desing"], ["limits"], ["limits", "x", "--metod", "slack"]])
def test_usage_errors_exit_2_in_one_line(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("centre", ["-2", "-2.", "-2.0", "-2e0", "-20e-1", "-.2e1"])
def test_negative_numbers_in_any_writing(spec, capsys, centre):
    assert main(["limits", spec, "--centre", centre, "--method", "quadratic"]) == 0
    assert capsys.readouterr().out.splitlines()[2].split()[0] == "-2"


@pytest.mark.parametrize("times", [1, 2])
def test_ctrl_c_keeps_finished_rows(car, tmp_path, times):
    rows = tmp_path / "rows.json"
    words = ["limits", car, "--centres", "-30", "-50", "40", "--jobs", "2", "--json", str(rows)]
    process = subprocess.Popen(
        [sys.executable, "-m", "polefence", *words],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not rows.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    for _ in range(times):  # as a terminal does: to parent and workers
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.1)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert error.count("\n") == 1
    assert "finished rows are kept" in error
    kept = json.loads(rows.read_text())["rows"]
    assert 0 < len(kept) < 120


def test_importing_the_package_stays_light():
    """No solver, no plotting, no scipy until they are needed."""
    code = "import sys, polefence; print([m for m in sys.modules if m in ('scipy', 'clarabel', "
    code += "'matplotlib', 'control', 'threadpoolctl')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_wrong_kind_of_file_is_named(tmp_path, monkeypatch, capsys):
    """A spec for a design, a folder for a spec, a proof for a gain."""
    monkeypatch.chdir(tmp_path)
    Path("plant.toml").write_text(
        '[parameter.k]\nrange = [1, 2]\n[matrices]\nA = [[0, 1], ["-k", -1]]\nB = [[0], [1]]\n'
    )
    Path("gains.json").write_text('{"grid": {"k": [1, 2]}, "gains": [[[-1, -1]], [[-1, -2]]]}')
    region = ["--region", "half_plane(0.1)"]
    table = ["analyse", "plant.toml", "--gain", "gains.json", *region, "-o", "table"]
    ran(capsys, *table)
    cases = {
        ("check", "plant.toml"): "plant.toml: a spec, but a design is needed",
        ("report", "plant.toml"): "plant.toml: a spec, but a design is needed",
        ("service", "plant.toml"): "plant.toml: a spec, but a design is needed",
        ("export", "plant.toml", "-o", "x"): "plant.toml: a spec, but a design is needed",
        ("design", "table", "--disk", "-3", "2"): "table: cannot be read: is a folder; name a file",
        ("service", "table"): "has no design.json; name the folder that `polefence design -o` "
        "wrote; it has table.json",
        ("service", "table/table.json"): "none of its claims is about a region",
    }
    for words, said in cases.items():
        assert said in refused(capsys, *words)
    given = ["analyse", "plant.toml", "--gain", "table/table.json", *region]
    assert "none of its claims is about a region" in refused(capsys, *given)


def test_a_folder_is_checked_file_by_file(every_file, tmp_path, capsys):
    """Every proof file of it; the exit status is that of the worst."""
    folder = tmp_path / "margins"
    shutil.copytree(every_file / "service", folder)
    (folder / "note.json").write_text('{"format": "x"}')
    names = sorted(path.name for path in folder.iterdir() if path.name != "note.json")
    out = ran(capsys, "check", folder, "--json", tmp_path / "a.json")
    assert [f"{folder / name}: proved: " in out for name in names] == [True] * 3
    assert out.count("SHA-256 of ") == 3
    rows = json.loads((tmp_path / "a.json").read_text())["files"]
    assert [row["answer"] for row in rows] == ["proved"] * 3
    assert all(row["inequalities"] > 0 for row in rows)
    with rewritten(folder / "gain.json") as document:
        document["claims"][0]["error"] = 1e3
    assert "gain.json: undecided: " in ran(capsys, "check", folder, status=1)
    (folder / "gain.json").write_text('{"format": "polefence-service", "version": 1}')
    assert "polefence 0.1, which is not read any more" in refused(capsys, "check", folder)
    assert "has no file of claims" in refused(capsys, "check", every_file)


def test_check_without_a_file(capsys):
    assert "name a FILE" in refused(capsys, "check")
