"""From car to board: the page's commands print what it shows, its laws do what it says."""

from __future__ import annotations

import io
import re
from contextlib import redirect_stdout
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import polefence as pf
from polefence.certify.bounds import kept_bound
from polefence.examples import spec_text
from polefence.vehicle.compare import compare, points
from support.console import COMMAND, alike, answer, blocks, follow
from support.cortex import missing_tools, run
from support.gallery import page
from support.needed import require
from support.once import proved_once  # noqa: F401  (a fixture)
from support.scripts import docs_script

PAGE = page("car-to-board")
PROSE = re.sub(r"\s+", " ", PAGE)
SAMPLED, BOARD, DRIVEN, WITHIN = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
ROW = re.compile(r"  rms of (.+) \[.*?\] +(\S+) +(\S+) +\S+ +(\S+)  (\w+)")
TABLE = {
    name: [float(x) for x in numbers.split("|")]
    for name, numbers in re.findall(r"^\| (passive|comfort.*?) \| (\d.*) \|$", PAGE, re.MULTILINE)
}
# What the page's second command finds: a law of a valley, another on every processor.
LATE = [
    [0, 0, 0, 0, 0, 30024.4, -1518.2, 0, -16996, 1154.39],
    [0, 0, 0, 0, 0, -1383.32, -43.29, 0, -484.926, 769.79],
    [0, 0, 0, 0, 0, 854.885, 32.8062, 0, 351.942, -521.914],
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder for all commands, as a reader has it."""
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def script():
    return docs_script("car_to_board")


def loop(folder, more, order, sampling=None):
    """The van with the states of a law of an order, and what is asked of it."""
    path = folder / "own.toml"
    path.write_text(spec_text("van") + more)
    van = pf.load(path) if sampling is None else pf.at_sample_time(pf.load(path), *sampling)
    larger, _ = replace(pf.load_structure(path), order=order).extended(van)
    least, limits = pf.load_specifications(path)
    return larger, [own.extended(van.shape[0], order) for own in (least, *limits)]


def worst(plant, law, asked):
    """The largest sample of each requirement, at the corners and amid the box."""
    return [own.values(plant, law, points(plant)[:200]).max() for own in asked]


SPEC, LAW, SERVICE, *MORE = blocks(PAGE)


@pytest.mark.parametrize("block", [SPEC, LAW, *MORE], ids=["spec", "law", "drives", "code"])
def test_the_commands_print_what_the_page_shows(block, folder, monkeypatch, capsys):
    follow(block, folder, monkeypatch, capsys)


def test_a_workshop_needs_what_the_page_says(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    ((command, shown),) = COMMAND.findall(SERVICE)
    _, said = answer(command, capsys)
    alike(shown, said)
    proved = [float(x) for x in re.findall(r"^error .*?  +(\S+) +\S+  of its size$", said, re.M)]
    for own, words in zip(
        proved, (r"may be (\S+) % off", r"states may be (\S+) % off"), strict=True
    ):
        assert float(re.search(words, PROSE)[1]) / 100 < own


@pytest.fixture(scope="module")
def ran(script, grip, folder):
    """What a run of the script said, and what it drew."""
    require(missing_tools())
    grip.design.save(folder / "grip")
    drawn, draw = [], script.draw
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as said:
        patch.setattr(script, "draw", lambda found, at: drawn.append(found) or draw(found, at))
        script.main(folder, folder / "van", folder / "grip")
    return said.getvalue(), drawn[0]


def test_the_code_drives_as_the_page_says(ran, folder):
    # another compiler makes other code
    costs = re.compile(r"gcc [0-9.]+|\d+ instructions an update, \d+ bytes")
    alike(costs.sub("...", DRIVEN), ran[0])
    assert (folder / "car-to-board.png").stat().st_size > 20_000


def test_the_board_prints_what_the_page_says(folder):
    """Drives are shorter here, and scatter more: digits of what is measured are left out."""
    require(missing_tools())
    assert "--board -o code" in PAGE
    said = run("make", "-s", "board", "SAMPLES=2000", cwd=folder / "code")
    shown = re.sub(r"(\] +\S+) .*", r"\1 ...", BOARD)
    alike(*(re.sub(" +", " ", text) for text in (shown, said)))
    rows = re.findall(r"\] +(\S+) +(\S+) +(\S+)  m1 = ", said)
    assert len(rows) == 6
    assert rows[:3] == rows[3:]
    assert [float(row[0]) for row in rows[1:3]] == [0.03, 660]
    for proved, measured, _ in rows:  # of two seconds each
        assert float(measured) < 1.2 * float(proved)
    small, large = (float(n) for n in re.findall(r"(\d+) instructions an update", said))
    assert small == pytest.approx(180, rel=0.3)
    assert large == pytest.approx(1700, rel=0.3)


def test_what_is_sent_is_the_law_to_float32(script, ran, folder):
    """The target's answers beside the law in doubles, with the states that it keeps itself."""
    van, design = pf.load(script.SPEC), pf.Design.load(folder / "van")
    _, _, sent = ran[1]["comfort alone"][script.LOADS.index(280)]
    K = design.law.gain_at(m1=280, k=script.K, kt=script.KT)[:, 5:]
    for error in (0, 1e-3):
        own, z = [], np.zeros(2)

        def law(x, K=(1 + error) * K, own=own):
            nonlocal z
            u, *rates = K @ [*x[5:], *z]
            z = z + script.PERIOD * np.array(rates)
            own.append(u)
            return u

        script.driven(van, 280, law)
        off = np.abs(np.array(own) - sent).max() / np.abs(sent).max()
        assert (off < 1e-5) == (error == 0), off


@pytest.fixture(scope="module")
def grip(script, folder):
    """The page's last law, whose gains it shows rounded: a hundredth less decay is proved."""
    plant, _ = loop(folder, script.GRIP, 1)
    rows = re.search(r"  K = \[(.*)\]", WITHIN)[1].split(";")
    law = pf.FixedGain([[float(x) for x in row.split()] for row in rows])
    return pf.analyse(plant, law, pf.HalfPlane(0.495))


def test_the_last_law_has_the_levels_that_are_shown(script, grip, folder):
    plant, asked = loop(folder, script.GRIP, 1)
    found = worst(plant, grip.law, asked)
    rows = ROW.findall(WITHIN)
    assert [own.name for own in asked] == [name for name, *_ in rows]
    for own, level, (_, proved, sampled, *_) in zip(asked, found, rows, strict=True):
        assert level == pytest.approx(float(sampled), rel=1e-4)
        assert level < (own.at_most or float(proved))
        assert kept_bound(plant, grip.law, replace(own, at_most=1.0002 * float(proved))) is not None


def test_the_table_is_what_compare_finds(grip, folder):
    laws = {"comfort within grip": grip.design, "comfort alone": pf.Design.load(folder / "van")}
    quantities = {
        "acceleration": "worst best",
        "tyre load variation": "worst",
        "actuator force": "worst",
        "mean power drawn": "worst",
    }
    for name, design in laws.items():
        plant = design.plant
        found = compare(plant, {name: design.law, "passive": None}, alpha=points(plant)[:200])
        for shown in (name, "passive"):
            ours = [
                getattr(found.row(shown, quantity), of)
                for quantity, every in quantities.items()
                for of in every.split()
            ]
            assert ours == pytest.approx(TABLE[shown], rel=0.02, abs=1e-9)


def test_the_last_law_tolerates_what_the_page_says(grip):
    """Errors of the gains of u, of every sign, at the vertices; and the loop at samples."""
    plant, K = grip.design.plant, grip.law.K
    share = float(re.search(r"for errors of the gains of (\S+) %", PROSE)[1]) / 100
    for error, stable in ((share, True), (1.05 * share, False)):
        signs = np.array(list(product((-1, 1), repeat=3)))
        near = np.repeat(K[None], len(signs), axis=0)
        near[:, 0, 5:] *= 1 + error * signs
        loops = plant.A[:, None] + plant.B[:, None] @ near
        assert (np.linalg.eigvals(loops).real.max() < 0) == stable
    decay, last = map(
        float, re.search(r"at (\S+) 1/s, and it is stable up to (\S+) ms", PROSE).groups()
    )
    for T, rate in ((1e-3, decay), (1e-3 * last, 0), (1e-3 * (last + 1), None)):
        samples, law = pf.at_samples(plant, grip.law, T, 1)
        largest = np.abs(np.linalg.eigvals(samples.A + samples.B @ law.K)).max()
        assert largest > 1 if rate is None else largest < np.exp(-rate * T)


def test_the_law_at_2_ms_has_the_level_of_the_page(folder):
    plant, asked = loop(folder, "", 2, (0.002, 1))
    assert "--sample-time 0.002 --delay 1" in SAMPLED
    least, *limits = worst(plant, pf.FixedGain(LATE), asked)
    assert float(re.search(r"(\S+) m/s² at all times are proved", PROSE)[1]) == round(least, 2)
    assert all(level < own.at_most for level, own in zip(limits, asked[1:], strict=True))


def test_the_prose_states_what_is_measured(script, folder):
    empty, gravity = 280 + script.WHEEL, 9.81
    assert f"load of the empty van's wheel is {empty * gravity / 1e3:.1f} kN" in PROSE
    peak = float(re.search(r"deflects by up to (\S+) mm", PROSE)[1]) / 1e3
    assert f"which is {peak * script.KT / 1e3:.1f} kN" in PROSE
    assert empty / 280 / 3 == pytest.approx(0.39, abs=1e-3)
    passive, law = TABLE["passive"], TABLE["comfort within grip"]
    assert f"{100 * (1 - law[0] / passive[0]):.0f} % less acceleration" in PROSE
    assert 3 * law[2] < empty * gravity
