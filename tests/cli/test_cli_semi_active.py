"""`polefence semi-active`: what it prints, writes and refuses."""

import json
import re

import pytest

from polefence.cli.main import main
from polefence.examples import spec_text
from support.commands import ran, refused

RANGE = "range = [300, 3000]"


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "damper.toml"
    path.write_text(spec_text("semi-active"))
    return path


def test_the_example_is_designed_proved_and_saved(spec, tmp_path, capsys):
    made = tmp_path / "made"
    words = ["semi-active", str(spec), "--degree", "4", "-o", str(made), "--json"]
    out = ran(capsys, *words, tmp_path / "own.json")
    number = r"(\d\.\d+)"
    law = float(re.search(rf"proved: rms of .* <= {number} for every alpha", out)[1])
    stays = float(re.search(rf"582 N s/m for damper force: {number}", out)[1])
    semi_active = float(re.search(rf"no semi-active law goes below {number} at vertex 1", out)[1])
    active = float(re.search(rf"no law goes below {number} at vertex 1", out)[1])
    assert 0.86 < active < semi_active < law < stays
    found = json.loads((tmp_path / "own.json").read_text())
    assert found["at_most"] == pytest.approx(law, rel=1e-5)
    assert found["no semi-active law below"] == pytest.approx(semi_active, rel=1e-5)
    assert found["degree"] == 4
    assert ran(capsys, "check", made, "--spec", spec).count("proved:") == 2


@pytest.mark.parametrize(
    ("old", "new", "difference"),
    [
        (RANGE, "range = [300, 4000]", "other dampers: u1 from 300 to 3000"),
        ('deflection = "suspension', 'deflection = "tyre', "other dampers"),
        ("[0, 100, 0, 0]", "[0, 90, 0, 0]", "other signals: 'tyre share'"),
        ("k = 10000", "k = 10001", "other vertices"),
    ],
)
def test_a_spec_that_differs_is_told(spec, tmp_path, capsys, old, new, difference):
    made = tmp_path / "made"
    assert main(["semi-active", str(spec), "--degree", "2", "-o", str(made)]) == 0
    other = tmp_path / "other.toml"
    other.write_text(spec.read_text().replace(old, new))
    capsys.readouterr()
    assert difference in ran(capsys, "check", made / "law.json", "--spec", other, status=1)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (RANGE, "range = [3000, 300]", "low = 3000 and high = 300"),
        (RANGE, "range = [300]", "range = a list must be [LOWEST, HIGHEST]"),
        (RANGE, "", "write range = [300, 3000], or low and high"),
        (RANGE, f"{RANGE}\ncost = 3", "unknown key 'cost'"),
        ('[damper."damper force"]', "[damper.force]", "no signal 'force'"),
        ('deflection = "suspension deflection"', "deflection = 3", "deflection must be a string"),
        (
            '= "suspension deflection"',
            '= "travel"',
            "damper.toml: damper.'damper force': no signal",
        ),
        (
            '= "suspension deflection"',
            '= "tyre deflection"',
            "damper.'damper force': an input or a",
        ),
        ("minimise = true", "at_most = 3", "nothing is to be minimised"),
        ('kind = "rms"', 'kind = "gain"', "for controllable dampers minimise an rms"),
    ],
)
def test_bad_specs_are_refused_in_one_line(spec, capsys, old, new, words):
    assert old in spec.read_text()
    spec.write_text(spec.read_text().replace(old, new))
    assert words in refused(capsys, "semi-active", spec, "--degree", "2")


def test_where_no_bound_is_proved_the_rest_is_printed_and_saved(spec, tmp_path, capsys):
    made, summary = tmp_path / "made", tmp_path / "own.json"
    spec.write_text(spec.read_text().replace(RANGE, "range = [0, 3000]"))
    words = ["semi-active", str(spec), "-o", str(made), "--json", str(summary)]
    out = ran(capsys, *words, status=1)
    assert "damper force = 0 v, vertex 1 is not stable; raise the lower bound of damper" in out
    stays = float(re.search(r"with the best fixed dampers, 582 N s/m .*: (\S+)", out)[1])
    low = float(re.search(r"no semi-active law goes below (\S+) at vertex 1", out)[1])
    assert 0.86 < low < stays
    found = json.loads(summary.read_text())
    assert (found["answer"], found["best that stay"]) == (
        "undecided",
        pytest.approx(stays, rel=1e-5),
    )
    assert found["no semi-active law below"] == pytest.approx(low, rel=1e-5)
    assert [path.name for path in made.iterdir()] == ["limit.json"]
    (made / "law.json").write_text((made / "limit.json").read_text())
    assert "law.json is that of an earlier design" in ran(capsys, *words, status=1)
    (made / "law.json").unlink()
    assert main(["check", str(made), "--spec", str(spec)]) == 0


def test_a_spec_without_dampers_is_refused(spec, capsys):
    text = spec.read_text()
    start, end = text.index("[damper"), text.index("[road]")
    spec.write_text(text[:start] + text[end:])
    assert "has no controllable damper" in refused(capsys, "semi-active", spec)


def test_dampers_of_a_spec_are_refused_by_every_command(spec, capsys):
    spec.write_text(spec.read_text().replace(RANGE, "range = 3"))
    assert "must be [LOWEST, HIGHEST]" in refused(capsys, "design", spec, "--disk", -4, 3)


def test_the_saved_law_is_driven_with_the_dampers_of_the_spec(spec, tmp_path, capsys):
    made = tmp_path / "made"
    ran(capsys, "semi-active", spec, "--degree", "2", "-o", made)
    road = ["--road", "C", "--speed", "20", "--duration", "2", "--json", "-"]
    laws = ["--law", str(made / "law.json"), "--law", "passive"]
    assert main(["simulate", str(spec), *laws, *road]) == 0
    said = capsys.readouterr()
    assert "of the time" in said.err
    own, passive = json.loads(said.out)["laws"]
    assert own["proved"].startswith("rms of [sprung-mass acceleration, tyre share] <= ")
    assert passive["proved"] == "nothing"
    other = tmp_path / "other.toml"
    other.write_text(spec.read_text().replace("k = 10000", "k = 12000"))
    own = json.loads(ran(capsys, "simulate", other, *laws[:2], *road))["laws"][0]
    assert own["proved"] == "nothing: its proof is about another plant"


def test_a_spec_says_what_is_measured(spec, tmp_path, capsys):
    keys = '[law]\nmeasured = ["suspension deflection", "sprung-mass velocity"]\n\n[damper.'
    spec.write_text(spec.read_text().replace("[damper.", keys, 1))
    words = ["semi-active", str(spec), "--degree", "2", "--json"]
    out = ran(capsys, *words, tmp_path / "own.json")
    assert "of suspension deflection, sprung-mass velocity and the rates of the dampers" in out
    found = json.loads((tmp_path / "own.json").read_text())
    assert found["K"][0][1] == 0
    assert found["measured"] == ["suspension deflection", "sprung-mass velocity"]
    ran(capsys, *words, tmp_path / "own.json", "--measured", "sprung-mass velocity")
    assert json.loads((tmp_path / "own.json").read_text())["K"][0][:2] == [0, 0]
    spec.write_text(spec.read_text().replace("measured = [", "order = 1\nmeasured = [", 1))
    said = refused(capsys, "semi-active", spec)
    assert "law: of controllable dampers it is one gain of what is measured; leave out all" in said


LOW = [[-1, -350], [-0.1, -50], [0, 0], [0.1, 80], [1, 600]]
HIGH = [[-1, -1800], [-0.1, -600], [0, 0], [0.1, 900], [1, 3000]]


@pytest.fixture
def saved_law(spec, tmp_path, capsys):
    """The folder of a law for a measured damper."""
    spec.write_text(spec.read_text().replace(RANGE, f"low = {LOW}\nhigh = {HIGH}"))
    ran(capsys, "semi-active", spec, "--degree", "2", "-o", tmp_path / "made")
    return tmp_path / "made"


def test_a_saved_law_is_driven_with_the_dampers_of_its_file(spec, saved_law, tmp_path, capsys):
    road = ("--road", "C", "--speed", "20")
    alone = ran(capsys, "simulate", saved_law, *road, "-o", tmp_path / "alone.csv")
    named = ran(capsys, "simulate", spec, "--law", saved_law, *road, "-o", tmp_path / "named.csv")
    for said in (alone, named):
        assert "proved of this law: rms of [sprung-mass acceleration, tyre share] <= 1.08" in said
        assert "damper force: the damper gives what is demanded" in said
    assert (tmp_path / "alone.csv").read_text() == (tmp_path / "named.csv").read_text()


def test_a_comparison_of_linear_laws_leaves_a_clipped_one_out(spec, saved_law, capsys):
    said = ran(capsys, "compare", spec, "--law", saved_law, "--law", "lqr")
    assert "made: a law of controllable dampers is clipped, and has no stationary" in said
    assert "note: laws are forces without limits here, passive is none; polefence concepts" in said
    assert "is clipped, and has no" in refused(capsys, "compare", spec, "--law", saved_law)
    assert "lqr" in ran(capsys, "compare", saved_law, "--law", "lqr")


def test_what_needs_a_region_says_what_a_law_of_dampers_is_for(saved_law, tmp_path, capsys):
    for words in (("report", saved_law), ("service", saved_law / "law.json")):
        said = refused(capsys, *words)
        assert "law.json: a law of controllable dampers, about no region; simulate, export" in said
    assert "law.c" in ran(capsys, "export", saved_law, "-o", tmp_path / "code")
