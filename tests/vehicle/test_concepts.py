"""Suspension concepts: bounds above what drives have, limits below, and the page's numbers."""

import json
import re
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import Rms
from polefence.cli.main import main
from polefence.examples import family, spec_path, spec_text
from polefence.law.laws import FixedGain
from polefence.plant.spec import load_dampers
from polefence.response.closed import close
from polefence.response.stationary import stationary, velocity_density
from polefence.show.plots import concepts_figure
from polefence.vehicle import Ridden, concepts
from polefence.vehicle.suspensions import suspensions
from polefence.vehicle.vehicle import require_ride
from support.commands import ran, refused
from support.paths import DOCS
from support.questions import ROWS, commands_of, run_as_written

SIGNALS = ["sprung-mass acceleration", "tyre share", "travel share"]
DENSITY = velocity_density("C", 20)
NAMES = ["passive", "skyhook", "ADD", "semi-active", "LQG", "active, few sensors"]
NAMES += ["active, all states"]


@pytest.fixture(scope="module")
def plant():
    return family("semi-active")


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What the line of "What it does" finds."""
    kept = []

    def recorded(*words):
        kept.append(concepts(*words))
        return kept[0]

    (row,) = [row for row in ROWS if "polefence concepts" in row]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("questions"))
        patch.setattr(import_module("polefence.vehicle.concepts"), "concepts", recorded)
        run_as_written(commands_of(row))
    return kept[0]


def test_bounds_lie_above_drives_and_limits_below(found):
    assert found.specification == Rms(SIGNALS, density=DENSITY)
    assert [one.name for one, _ in found.rows] == NAMES
    for one, ridden in found.rows:
        assert one.level is not None
        assert ridden.cost < one.level + 2 * ridden.error, one.name
        damped = one.name in NAMES[:4]
        lowest = found.semi_active if damped else found.active
        assert ridden.cost > lowest - 2 * ridden.error, one.name
        assert (ridden.power == 0) == damped, one.name
        assert ridden.error < 0.015 * ridden.cost
    assert found.active <= found.semi_active
    best = found.rows[-1][0].level
    assert found.active < best < 1.001 * found.active


def test_the_page_has_these_numbers(found):
    page = (DOCS / "concepts.md").read_text()
    rows = re.findall(r"^((?:\w[\w, -]*?\w))  +([\d. e+-]+)$", page, re.MULTILINE)
    assert [name for name, _ in rows] == NAMES
    for (one, ridden), (_, numbers) in zip(found.rows, rows, strict=True):
        sensors, *shown = map(float, numbers.split())
        own = [one.level, ridden.cost, ridden.acceleration, ridden.tyre, 1e3 * ridden.travel]
        own += [ridden.force, ridden.power, one.gain]
        assert len(one.sensors) == sensors
        assert own[:2] == pytest.approx(shown[:2], rel=3e-3)
        if not one.name.startswith("active"):  # laws of one cost may share it out in other ways
            assert own == pytest.approx(shown, rel=4e-3, abs=0.06)
        assert own[2:6] == pytest.approx(shown[2:6], rel=0.2)
    cost = {one.name: ridden.cost for one, ridden in found.rows}
    (less,), (above,) = (
        re.findall(rf"(\d+) % {word}", page) for word in ("less than", "above the lower bound")
    )
    own = cost["semi-active"]
    assert 1 - own / cost["passive"] == pytest.approx(float(less) / 100, abs=7e-3)
    assert own / found.active - 1 == pytest.approx(float(above) / 100, abs=7e-3)
    for level in map(float, re.findall(r"goes below (\d\.\d+)", page)):
        assert level == pytest.approx(found.active, rel=1e-5)


def test_drives_of_linear_laws_are_as_their_covariance_says(plant, found):
    known, at = require_ride(plant), None
    shown = [*SIGNALS, known.tyre_force, known.travel, known.force]
    for one, ridden in (found.rows[0], found.rows[-1]):
        for alpha in np.eye(2):
            own = stationary(plant, one.law, [alpha], DENSITY, shown).rms[0]
            cost = float(np.linalg.norm(own[:3]))
            if at is None or cost > at[0]:
                at = (cost, *own)
        wanted = (at[0], at[1], *at[4:])
        seen = (ridden.cost, ridden.acceleration, ridden.tyre, ridden.travel, ridden.force)
        assert seen[0] == pytest.approx(wanted[0], abs=3 * ridden.error)
        assert seen[1] == pytest.approx(wanted[1], rel=0.03)
        at = None


def test_a_kalman_filter_is_the_optimal_one(plant, found):
    """Of the nominal car with the noise, any other injection has a larger error."""
    larger, law = found.rows[4][0].plant, found.rows[4][0].law
    n, alpha = 4, np.full(2, 0.5)
    alpha = plant.alpha(m1=338.9)
    A, B = plant.at(alpha)
    K, rest = law.K[:1, n:], law.K[1:, :n]
    C = np.zeros((2, n))
    C[0, 0] = C[1, 2] = 1.0
    gain = rest @ np.linalg.pinv(C)
    assert gain @ C == pytest.approx(rest)
    assert law.K[1:, n:] == pytest.approx(A + B @ K - rest)
    E = np.array(plant.vertices[0].E) * (DENSITY / 2) ** 0.5
    noise = np.diag([0.5e-3**2, 5e-3**2]) * 1e-3

    def error(L):
        return np.trace(solve_continuous_lyapunov(A - L @ C, -(E @ E.T + L @ noise @ L.T)))

    random = np.random.default_rng(0)
    for _ in range(20):
        other = gain * (1 + 0.05 * random.standard_normal(gain.shape))
        assert error(other) > error(gain)
    assert close(larger, law, np.eye(2), disturbed=False).poles().real.max() < 0


def test_the_skyhook_and_add_push_as_their_names_say(found):
    """Against the body's velocity; against the spring, which a deflection in compression pushes."""
    skyhook, add = (found.rows[k][0].law.K[0] for k in (1, 2))
    assert np.flatnonzero(skyhook).tolist() == [2]
    assert skyhook[2] < 0
    assert add == pytest.approx(np.array([-10000, 0, 0, 0]))


def test_the_figure_has_every_concept(found):
    figure = concepts_figure(found)
    left, right = figure.axes
    assert [text.get_text() for text in left.get_yticklabels()] == NAMES
    assert sorted(text.get_text() for text in right.texts) == sorted(NAMES)
    assert any("1.83" in text.get_text() for text in left.texts)  # farther than is drawn
    apart = replace(found, semi_active=1.05 * found.active)
    both = {line.get_label() for line in concepts_figure(apart).axes[0].lines}
    assert {"no semi-active law below", "no law below"} <= both
    unproved = [(replace(one, level=None), ridden) for one, ridden in found.rows]
    bare = concepts_figure(replace(found, rows=tuple(unproved), active=None, semi_active=None))
    (lines,) = bare.axes[0].collections
    assert all(len(own) < 2 for own in lines.get_segments())  # no line to a bound


# --- the command ---------------------------------------------------------------------------------


@pytest.fixture
def quick(found, monkeypatch):
    monkeypatch.setattr(import_module("polefence.vehicle.concepts"), "concepts", lambda *_: found)
    return found


def test_the_command_prints_and_writes_all_rows(quick, tmp_path, capsys):
    spec, summary, figure = (tmp_path / name for name in ("d.toml", "all.json", "all.png"))
    spec.write_text(spec_text("semi-active"))
    words = ["concepts", str(spec), "--json", str(summary), "--plot", str(figure)]
    out = ran(capsys, *words)
    page = (DOCS / "concepts.md").read_text().split("```text\n")[1].split("```")[0]
    shown, saved = out.splitlines()[:-2], out.splitlines()[-2:]
    assert [line.split()[:2] for line in shown] == [line.split()[:2] for line in page.splitlines()]
    assert saved == [f"saved: {figure}", f"saved: {summary}"]
    rows = json.loads(summary.read_text())["rows"]
    assert [row["concept"] for row in rows] == NAMES
    assert rows[3]["proved"] == quick.rows[3][0].level
    assert figure.stat().st_size > 10_000


def test_a_concept_that_runs_away_is_said_to(found, monkeypatch, tmp_path, capsys):
    lost = Ridden(*(float("nan"),) * 7)
    rows = tuple(
        (replace(one, level=None), lost) if one.name == "LQG" else (one, ridden)
        for one, ridden in found.rows
    )
    other = replace(found, rows=rows)
    monkeypatch.setattr(import_module("polefence.vehicle.concepts"), "concepts", lambda *_: other)
    spec, figure = tmp_path / "d.toml", tmp_path / "all.png"
    spec.write_text(spec_text("semi-active"))
    assert main(["concepts", str(spec), "--json", "-", "--plot", str(figure)]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["rows"][4]["drives"] is None
    (line,) = [line for line in said.err.splitlines() if line.startswith("LQG")]
    assert line.split()[1:9] == ["2", *["-"] * 7]
    assert "not stable at every value of the parameters: LQG" in said.err
    assert len(concepts_figure(other).axes[1].texts) == 6


def test_a_law_that_is_not_stable_everywhere_is_driven_to_nan(plant):
    module = import_module("polefence.vehicle.concepts")
    least, dampers = Rms(SIGNALS, density=DENSITY), load_dampers(spec_path("semi-active"))
    measured = ("suspension deflection", "sprung-mass velocity")
    own = module._Task(plant, least, dampers, suspensions(plant), measured)
    away = FixedGain([[0, 0, 9000.0, 0]])
    assert own.proved(plant, away) is None
    assert np.isnan(own._road(plant, away, (), 0)).all()


@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("quarter-car-level", [], "has no controllable damper"),
        ("semi-active", ["--measured", "damper force"], "force passes straight into"),
        ("semi-active", ["--measured", "speed"], "no signal 'speed'"),
        ("semi-active", ["--measured", "tyre force variation"], "no sensor is known for N"),
        ("semi-active", ["--plot", "a.txt"], "a figure ends in"),
    ],
)
def test_what_it_cannot_do_is_one_line(name, words, said, tmp_path, capsys):
    spec = tmp_path / "own.toml"
    spec.write_text(spec_text(name))
    assert said in refused(capsys, "concepts", str(spec), *words)


def test_it_is_for_cars(tmp_path, capsys):
    spec, text = tmp_path / "own.toml", spec_text("semi-active")
    of_a_car = '[vehicle]\nmodel = "quarter car"\nforce = "damper force"\n'
    assert of_a_car in text
    text = text.replace(of_a_car, "").replace("sprung-mass acceleration", "travel share")
    spec.write_text(text)
    said = refused(capsys, "concepts", str(spec))
    assert "is not described as a car; add a table [vehicle]" in said


def test_without_a_bound_of_dampers_the_table_is_printed_with_the_reason(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(import_module("polefence.vehicle.concepts"), "ROADS", 2)
    spec = tmp_path / "own.toml"
    spec.write_text(spec_text("semi-active").replace("range = [300, 3000]", "range = [0, 3000]"))
    out = ran(capsys, "concepts", spec, "--json", tmp_path / "rows.json")
    assert re.search(r"^semi-active +4 +- +0\.\d+", out, re.MULTILINE)
    assert out.count("vertex 1 is not stable; raise the lower bound of damper") == 1
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
    unproved = [row["concept"] for row in rows if row["proved"] is None]
    assert unproved == ["skyhook", "ADD", "semi-active"]
    assert all((row["reason"] is None) == (row["proved"] is not None) for row in rows)
