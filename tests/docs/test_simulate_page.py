"""docs/simulate.md: its commands print what it shows, its prose states what is measured."""

from __future__ import annotations

import re
import shlex
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.response.closed import close
from polefence.show.plots import signals_figure
from polefence.vehicle.compare import compare, points, standard_laws
from support.paths import DOCS

PAGE = (DOCS / "simulate.md").read_text()
# Options of every command, or written short on the page.
COMMON = {"--help", "--output", "--quiet"}
CONSOLE = re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]\d+)?(?![\w.]*\w)")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder for all commands, as a reader has it."""
    return tmp_path_factory.mktemp("page")


@pytest.mark.parametrize("block", CONSOLE, ids=["drive", "family", "moving", "servo"])
def test_the_commands_print_what_the_page_shows(block, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(  # drawing is slow, and tested elsewhere
        "polefence.show.plots.signals_figure",
        lambda time, panels, *_: signals_figure(time, panels[:1]),
    )
    for session in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        command, _, shown = session.partition("\n")
        command, _, target = command.partition(" > ")
        assert main(shlex.split(command)[1:]) == 0, command
        out = capsys.readouterr().out
        if target:
            Path(target).write_text(out)
        else:
            alike(shown, out)


def alike(shown, said):
    """Compare texts exactly and numbers to 0.2 %; a line of "..." stands for any lines."""
    parts = [part.strip("\n").splitlines() for part in re.split(r"^\.\.\.$", shown, flags=re.M)]
    lines, at = said.splitlines(), 0
    assert len(parts) > 1 or len(parts[0]) == len(lines)
    for k, part in enumerate(parts):
        if not part:
            continue
        while k and NUMBER.sub("#", lines[at]).split() != NUMBER.sub("#", part[0]).split():
            at += 1
        for wanted, line in zip(part, lines[at:], strict=False):
            assert NUMBER.sub("#", wanted).split() == NUMBER.sub("#", line).split()
            numbers = ([float(n) for n in NUMBER.findall(text)] for text in (line, wanted))
            assert next(numbers) == pytest.approx(next(numbers), rel=2e-3, abs=1e-12)
        at += len(part)
    assert not parts[-1] or at == len(lines)


def test_texts_and_numbers_that_differ_are_seen():
    alike("a 1.000 b\n...\nc 2 d\n", "a 1.001 b\nx\ny\nc 2 d\n")
    for said in ("a 1.01 b\nc 2 d\n", "a 1 q\nc 2 d\n", "a 1 b\nc 2 d\ne\n"):
        with pytest.raises((AssertionError, IndexError)):
            alike("a 1 b\n...\nc 2 d\n", said)


def test_the_prose_states_what_is_measured(physical):
    every = points(physical)  # corners and middles first, edges last
    some = np.vstack([every[:9], every[9:-36:12], every[-36:]])
    found = compare(physical, standard_laws(physical), alpha=some)
    proved = ("quadratic", "slack", "scheduled")

    def both(quantity, of, digits, scale=1.0):
        values = [scale * getattr(found.row(law, quantity), of) for law in proved]
        return f"{min(values):.{digits}f} to {max(values):.{digits}f}"

    text = re.sub(r"\s+", " ", PAGE)
    weighted = "weighted acceleration"
    assert f"weighted acceleration of {found.row('passive').worst:.2f} m/s² in the worst" in text
    assert f"in its best case, {both(weighted, 'best', 2)} m/s²" in text
    assert min(found.row(law).best for law in proved) > found.row("passive").worst
    assert f"and {both(weighted, 'worst', 2)} m/s² in its worst" in text
    load = f"{found.row('passive', 'tyre load variation').worst:.0f} N"
    assert f"by {both('tyre load variation', 'worst', 0)} N against {load}" in text
    travel = found.row("passive", "suspension travel").worst
    assert both("suspension travel", "worst", 0, 1e3) == "6 to 6"
    assert f"6 mm against {1e3 * travel:.0f} mm" in text
    taken = [
        -getattr(found.row(law, "mean power"), of) for law in proved for of in ("best", "worst")
    ]
    assert f"take {min(taken):.0f} to {max(taken):.0f} W out" in text
    assert 0.25 < max(found.row(law, "mean power drawn").worst for law in proved) < 0.3
    skyhook, lqr = (f"{found.row(law).worst:.2f}" for law in ("skyhook", "lqr"))
    assert f"for comfort, have {skyhook} and {lqr} m/s²" in text


def test_the_passive_body_is_as_slow_as_stated(physical):
    poles = close(physical, None, points(physical)).poles()
    moving = np.where(np.abs(poles) > 1e-6, poles.real, -np.inf)  # without the integral
    slowest = -moving.max(axis=1)
    assert f"that of the passive body decays at {slowest.min():.1f} to {slowest.max():.1f} 1/s" in (
        re.sub(r"\s+", " ", PAGE)
    )


def test_the_snippet_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = import_module("polefence.vehicle.compare")
    monkeypatch.setattr(module, "points", lambda plant: np.eye(4))
    Path("car.toml").write_text(spec_text("quarter-car-physical"))
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(snippet, names)
    assert names["found"].row("mine").worst > 0


def test_options_are_those_of_the_commands(capsys):
    for command in ("simulate", "compare"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        known = set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) - COMMON
        section = PAGE.split(f"## Options of `{command}`")[1].split("\n## ")[0]
        assert known == set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", section))
