"""polefence loops: what it prints and writes is what the functions say."""

import json
import math

import pytest

from polefence import HalfPlane, place
from polefence.cli.main import main
from polefence.examples import family
from polefence.response import family_points, margins, opened, places
from polefence.show.loops import margins_row


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loops") / "servo"
    design = place(family("servo"), HalfPlane(2))
    design.save(folder)
    return folder, design


def test_a_table_of_all_loops_and_its_json(servo, tmp_path, capsys):
    folder, design = servo
    target = tmp_path / "loops.json"
    words = ["loops", str(folder), "--samples", "20", "--sigma", "1", "--json", str(target)]
    assert main(words) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert "sampled, not proved" in head
    document = json.loads(target.read_text())
    known = places(design.plant, design)
    assert document["points"] == 23  # with two vertices and the middle
    assert [row["loop"] for row in document["loops"]] == [here.name for here in known]
    alpha = family_points(design.plant, 20)
    for here, said, row in zip(known, rows, document["loops"], strict=False):
        found = margins(opened(design.plant, design, here.name, alpha), 1.0)
        assert said.split("  ")[0] == f"{here.label}, {here.kind}"
        assert all(cell in said for cell in margins_row(found))
        for least in found.least:
            value = row[least.name]["value"]
            assert (math.inf if value == "any" else value) == pytest.approx(least.value)
        assert row["disk"]["gain"][0] == pytest.approx(1 / (1 + found.least[-1].value))


def test_one_loop_is_drawn(servo, tmp_path, capsys):
    folder, _ = servo
    words = ["loops", str(folder), "--samples", "5", "--plot", str(tmp_path / "loop.png")]
    assert main([*words, "--loop", "armature voltage"]) == 0
    assert (tmp_path / "loop.png").read_bytes().startswith(b"\x89PNG")
    assert len(capsys.readouterr().out.splitlines()) == 4
    assert main(words) == 2
    assert "--loop NAME, of: 'armature voltage'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--loop", "motor"], "no loop 'motor'"),
        (["--samples", "-1"], "--samples -1: give a number from 0 to"),
        (["--samples", "1000000"], "give a number from 0 to"),
        (["--sigma", "nan"], "sigma = nan"),
        (["--plot", "loop.txt"], ".png"),
    ],
)
def test_what_cannot_be_done_is_one_line(servo, capsys, options, said):
    folder, _ = servo
    assert main(["loops", str(folder), *options]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
