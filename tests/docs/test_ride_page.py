"""docs/ride.md: its commands print what it shows, its table states what is measured."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

import polefence as pf
from polefence import Design, HalfPlane, Sector, load
from polefence.certify.bounds import sampled
from polefence.cli.main import main
from polefence.examples import spec_path, spec_text
from polefence.plant.points import seeded
from polefence.region.text import digits_up
from polefence.requirements.text import load_specifications
from polefence.response.closed import close
from polefence.response.stationary import lyapunov
from polefence.vehicle.compare import compare, points
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "ride.md").read_text()
# Options of every command, or written short on the page.
COMMON = {"--help", "--output", "--quiet"}
TEXT = re.sub(r"\s+", " ", PAGE)
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]\d+)?(?![\w.]*\w)")
COMMANDS = re.findall(r"^\$ (.*)\n((?:(?!\$ |```).*\n)*)", PAGE, re.MULTILINE)
# An optimum is told to what a round of its search is worth; what it leaves free to the square root.
OPTIMAL, FREE = 2e-4, 2e-4**0.5
CAR = "half_plane(1) & sector(0.15)"
SHOWN = [(command, shown) for command, shown in COMMANDS if shown]


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """The folder in which all commands were run, once, and what they said."""
    folder, found = tmp_path_factory.mktemp("page"), {}
    with contextlib.chdir(folder):
        for command, _ in COMMANDS:
            out, err = io.StringIO(), io.StringIO()
            words, _, target = command.partition(" > ")
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = main(shlex.split(words)[1:])
            if target:
                Path(target).write_text(out.getvalue())
                continue
            found[command] = (status, out.getvalue() + err.getvalue())
    return folder, found


@pytest.mark.parametrize(("command", "shown"), SHOWN)
def test_the_commands_print_what_the_page_shows(said, command, shown):
    status, text = said[1][command]
    assert status == int(shown.startswith(("not proved", "refuted")))
    lines = text.splitlines()
    assert len(lines) == len(shown.splitlines())
    for wanted, line in zip(shown.splitlines(), lines, strict=True):
        if wanted.endswith((" = ...", ": ...")):  # what an optimum leaves free
            assert line.startswith(wanted.removesuffix("..."))
            continue
        assert NUMBER.sub("#", wanted).split() == NUMBER.sub("#", line).split()
        shows, says = ([float(n) for n in NUMBER.findall(part)] for part in (wanted, line))
        if line.lstrip().startswith("steady state"):  # ranges, against their own size
            assert says[:3] == shows[:3]
            for k in range(3, len(shows), 2):
                size = max(map(abs, shows[k : k + 2]))
                assert says[k : k + 2] == pytest.approx(shows[k : k + 2], abs=FREE * size)
            continue
        if "no law, of any order" in line:  # what is left depends on where a search ends
            shows, says = shows[:-1], says[:-1]
        assert says == pytest.approx(shows, rel=FREE)
        if line.endswith("minimised"):
            assert says[:2] == pytest.approx(shows[:2], rel=OPTIMAL)
        elif line.endswith("limit"):
            assert says[0] == shows[0]


def rows():
    """The table's rows by law and region."""
    table = PAGE.split("### What each step bought")[1].split("\n- ")[0]
    lines = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| ")]
    return {(line[0].strip("`"), line[1].strip("`")): line[2:] for line in lines[1:]}


@pytest.mark.parametrize(
    ("key", "number"),
    [
        (("quadratic", "stable"), 0),
        (("default", "stable"), 1),
        (("default", CAR), 2),
    ],
)
def test_the_table_states_what_the_commands_print(said, key, number):
    _, text = said[1][SHOWN[number][0]]
    proved, shared, _, tyre, travel, force = rows()[key]
    printed = [[float(n) for n in NUMBER.findall(line)] for line in text.splitlines()[2:7]]
    assert [proved, shared] == [digits_up(printed[row][0], 5) for row in (0, 4)]
    for cell, line, scale, width in zip(
        (tyre, travel, force), printed[1:4], (1e3, 1e3, 1), (0.005, 0.05, 0.5), strict=True
    ):
        assert float(cell) == pytest.approx(scale * line[1], abs=1.5 * width)


def test_the_prose_states_what_is_measured(said):
    plant, design = load(said[0] / "ride.toml"), Design.load(said[0] / "ride")
    least, _ = load_specifications(said[0] / "ride.toml")
    alpha = seeded(plant)
    own, bare = (sampled(plant, law, least, alpha).values for law in (design, None))
    share = [float(n) for n in rows()["default", CAR][2].split(" to ")]
    assert share == pytest.approx([(own / bare).min(), (own / bare).max()], rel=FREE)
    assert "between 0.75 and 1.16 times" in TEXT
    poles = close(plant, None, np.vstack([alpha, points(plant)])).poles()
    assert f"slowest pole is at −{-poles.real.max():.2f} 1/s" in TEXT
    assert f"least damping ratio is {(-poles.real / np.abs(poles)).min():.3f}" in TEXT
    found = compare(plant, {"law": design, "passive": None})
    felt, passive = (found.row(name, "weighted acceleration") for name in ("law", "passive"))
    worst = re.search(r"has ([.\d]+) against ([.\d]+) m/s² by Wk", TEXT).groups()
    assert [float(n) for n in worst] == pytest.approx([felt.worst, passive.worst], rel=FREE)
    best = re.search(r"worst case, ([.\d]+) against ([.\d]+) in the best", TEXT).groups()
    assert [float(n) for n in best] == pytest.approx([felt.best, passive.best], rel=FREE)
    assert 50 < found.row("law", "mean power drawn").worst <= 52  # up to 52 W
    tyre = compare(plant, {"law": design}).row("law", "tyre deflection").worst
    assert tyre <= 0.00472
    # the sample's rms by another computation, at the worst
    A, B = plant.at(alpha[own.argmax()])
    A = A + B @ design.law.gain(alpha[own.argmax()])
    X = lyapunov(A[None], least.density / 2 * np.diag([0.0, 1.0, 0.0, 0.0])[None])[0]
    assert np.sqrt(A[2] @ X @ A[2]) == pytest.approx(own.max(), rel=1e-9)
    assert own.max() == pytest.approx(1.02121, rel=OPTIMAL)


def minimised(said, command):
    """The bound that a command proves of what it minimises."""
    (line,) = [line for line in said[1][command][1].splitlines() if line.endswith("minimised")]
    return float(NUMBER.findall(line)[0])


def test_a_part_of_the_region_that_a_law_keeps_anyway_costs_nothing(said):
    """The law for the decay alone keeps the damping too: so it is that for both."""
    spec, damped = said[0] / "level.toml", Sector(0.15)
    plant, (least, limits) = load(spec), load_specifications(spec)
    decay = Design.load(said[0] / "level")
    assert decay.region == HalfPlane(0.5)
    assert pf.analyse(plant, decay.law, damped).proved
    both = pf.optimise(plant, least, limits, HalfPlane(0.5) & damped, "quadratic")
    assert both.design.region == HalfPlane(0.5) & damped
    command = "polefence optimise level.toml --method quadratic -o level"
    assert both.bounds[0].level == pytest.approx(minimised(said, command), rel=OPTIMAL)
    (same,) = re.search(r"has the same answer, ([.\d]+)\.", TEXT).groups()
    assert both.bounds[0].level == pytest.approx(float(same), rel=OPTIMAL)
    shown = re.search(r"This gain uses ([.\d]+) mm rms .*? and (\d+) N", TEXT).groups()
    _, travel, force = (sampled(plant, both.design, own, seeded(plant)).values for own in limits)
    used = [1e3 * travel.max(), force.max()]
    assert used == pytest.approx([float(n) for n in shown], rel=FREE)


def test_the_page_shows_the_tables_of_the_example():
    shown = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0]
    assert spec_text("quarter-car-ride").endswith(shown)


def test_the_snippet_and_the_figure(said, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    shutil.copy(spec_path("quarter-car-ride"), tmp_path / "ride.toml")
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(snippet, names)
    assert str(names["done"].bounds[0]) in snippet
    example = docs_script("ride")
    assert (said[0] / "ride.png").read_bytes().startswith(b"\x89PNG")
    facts = example.facts(names["done"])
    shown = rows()["quadratic", "stable"]
    assert shown[:2] == [facts["proved"], facts["shared"]]
    assert shown[2] == "{:.3f} to {:.3f}".format(*facts["of passive"])


def test_options_are_those_of_the_command(capsys):
    with pytest.raises(SystemExit):
        main(["optimise", "--help"])
    known = set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) - COMMON
    section = PAGE.split("## Options of `optimise`")[1]
    assert known == set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", section))
