"""`polefence optimise` of several structures: table, files, what it keeps, what it refuses."""

import json
import re
from pathlib import Path

import pytest

from polefence.base.errors import PolefenceError
from polefence.cli.main import main
from polefence.search import structures as search
from support.commands import ran, refused
from support.hasty import hasty
from support.specs import TWO_STATES

SPEC = (
    TWO_STATES
    + """
[sensor.x]
bandwidth = 5
noise = 0.002
[law]
measured = ["measured x"]
[[specification]]
kind = "rms"
signal = "x"
density = 2
minimise = true
[[specification]]
kind = "rms"
signal = "force"
density = 2
at_most = 2
"""
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    (folder / "two.toml").write_text(SPEC)
    with pytest.MonkeyPatch.context() as patch, hasty():
        patch.chdir(folder)
        words = ["optimise", "two.toml", "--order", "0..1", "-o", "two", "--json", "two.json"]
        assert main([*words, "--plot", "two.png"]) == 0
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text(SPEC)
    return tmp_path


def test_the_files_are_those_of_the_table(made, capsys, monkeypatch):
    monkeypatch.chdir(made)
    document = json.loads(Path("two.json").read_text())
    assert [row["order"] for row in document["rows"]] == [0, 1]
    assert document["recommended"] == 2
    assert document["limit_of_any_law"]["least"] < document["rows"][1]["proved"]
    assert "order 1" in document["why"]
    assert Path("two.png").read_bytes().startswith(b"\x89PNG")
    kept = json.loads(Path("two/structures.json").read_text())["rows"]
    assert [row["performance"] for row in kept] == [row["performance"] for row in document["rows"]]
    for folder in ("two", "two/order-0-degree-1", "two/order-1-degree-1"):
        ran(capsys, "check", folder, "--spec", "two.toml")


def test_a_table_is_resumed_without_a_search(made, capsys, monkeypatch):
    monkeypatch.chdir(made)

    def never(*_):
        raise AssertionError("a row is searched again")

    monkeypatch.setattr(search, "_row_of", never)
    out = ran(capsys, "optimise", "two.toml", "--order", "0..1", "-o", "two", "--resume")
    lines = out.splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("  row  order"))
    rows = [line.split() for line in lines[head + 1 : head + 3]]
    assert [row[:3] for row in rows] == [["1", "0", "1"], ["2", "1", "1"]]
    assert rows[0][6] == "-"
    assert float(rows[1][6]) < 0
    assert re.search(r"^recommended: order 1: the best, of \d+ numbers; no other", out, re.M)
    assert "no law, of any order and whatever it measures, goes below" in out
    other = refused(capsys, "optimise", "two.toml", "--order", "0..2", "-o", "two", "--resume")
    assert "a table of another question or version" in other


def test_ctrl_c_keeps_and_prints_the_rows_that_are_finished(here, capsys, monkeypatch):
    real = search._row_of

    def interrupted(asked, k, chain):
        if k:
            raise KeyboardInterrupt
        return real(asked, k, chain)

    monkeypatch.setattr(search, "_row_of", interrupted)
    with hasty():
        assert main(["optimise", "two.toml", "--order", "0..1", "-o", "cut"]) == 130
    said = capsys.readouterr()
    assert "    1      0       1 " in said.out
    assert "recommended" not in said.out
    assert len(json.loads(Path("cut/structures.json").read_text())["rows"]) == 1
    ran(capsys, "check", "cut/order-0-degree-1")
    monkeypatch.setattr(search, "_row_of", real)
    with hasty():
        out = ran(capsys, "optimise", "two.toml", "--order", "0..1", "-o", "cut", "--resume")
    assert "recommended: order 1" in out


def test_a_row_without_a_law_leaves_the_others(here, capsys, monkeypatch):
    real = search.optimise_in

    def failing(*question):
        if not question[-1].order:
            raise PolefenceError("not proved: none of order 0")
        return real(*question)

    monkeypatch.setattr(search, "optimise_in", failing)
    with hasty():
        out = ran(capsys, "optimise", "two.toml", "--order", "0..1", "-o", "some")
    assert "undecided" in out
    assert "row 1: none of order 0" in out
    assert not Path("some/order-0-degree-1").exists()

    def none(*_):
        raise PolefenceError("not proved: none")

    monkeypatch.setattr(search, "optimise_in", none)
    out = ran(capsys, "optimise", "two.toml", "--order", "0..1", "-o", "none", status=1)
    assert "recommended" not in out
    assert not Path("none/design.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--order", "4..0"], "begins above its end; write 0..4"),
        (["--order", "0..99"], "is 100 numbers; at most 24 structures are compared"),
        (["--order", "0...2"], "is neither a whole number nor a range, such as 0..2"),
        (["--order", "x"], "is neither a whole number nor a range, such as 0..2"),
        (["--order", "0..21"], "order = 21 must be 0 to 20"),
        (["--degree", "0..9"], "degree = 9 must be 0 to 8"),
        (["--order", "0..4", "--degree", "0..5"], "30 structures: 1 to 24 can be asked for"),
        (["--order", "0..1", "--method", "scheduled"], "--method laws of an LMI, which have none"),
        (["--order", "0..1", "--elevation", "1"], "--elevation applies to laws from an LMI"),
        (["--order", "0..1", "--float", "32"], "--float is of one law: name one --order"),
        (["--degree", "0..1", "--fixed", "16"], "--fixed is of one law: name one --degree"),
        (["--order", "0..1", "--range", "x = 1"], "--range is for fixed-point code"),
        (["--degree", "0..1", "--schedule", "none"], "a law of one gain has no degree"),
        (["--resume"], "--resume is of several structures, as --order 0..2 names them"),
        (["--order", "0..1", "--resume"], "--resume needs -o DIR"),
        (["--measured", "v", "--measured", "nothing"], "no signal 'nothing'"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(here, capsys, words, message):
    said = refused(capsys, "optimise", "two.toml", *words)
    assert message in said
    assert said.count("\n") == 1


def test_nothing_to_minimise_is_refused(here, capsys):
    Path("two.toml").write_text(SPEC.replace("minimise = true", "at_most = 1"))
    said = refused(capsys, "optimise", "two.toml", "--order", "0..1")
    assert "structures are compared by what is minimised; give --minimise" in said


def test_one_of_a_kind_is_no_table(here, capsys):
    with hasty():
        out = ran(capsys, "optimise", "two.toml", "--measured", "v", "--order", "0")
    assert "recommended" not in out
    assert "one gain of v keeps all poles" in out
