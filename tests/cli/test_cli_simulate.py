"""`polefence simulate` and `polefence compare`: what they write, say, and refuse."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polefence import Disk, load, place
from polefence.cli.main import main
from polefence.cli.simulate import panels_of, picked
from polefence.examples import spec_path, spec_text
from polefence.plant.spec import dumps, load_car, loads
from polefence.response.columns import Table, write_table
from polefence.response.linear import impulse, simulate, step
from polefence.show.plots import Panel, signals_figure
from polefence.vehicle.comfort import comfort
from polefence.vehicle.driving.drive import Setup, run, signals
from polefence.vehicle.driving.parts import Estimated, Hardware, Jump, Ramp
from polefence.vehicle.excitation import on_road, on_wheels
from polefence.vehicle.roads import kerb, pothole, random_road
from support.commands import ran, refused

ROAD = ["--road", "C", "--speed", "20", "--duration", "2"]


@pytest.fixture(scope="module")
def design(physical):
    return place(physical, Disk(-40, 36), "scheduled")


@pytest.fixture
def car(tmp_path, monkeypatch, design):
    """A folder with car.toml and a design for it in car/."""
    monkeypatch.chdir(tmp_path)
    Path("car.toml").write_text(spec_text("quarter-car-physical"))
    design.save("car")
    return tmp_path


def rows(path):
    with open(path, newline="") as file:
        return list(csv.reader(file))


def table(path):
    """The numbers of a CSV file, without its first row."""
    return np.array(rows(path)[1:], dtype=float)


def test_csv_has_time_and_every_signal_exactly(car, physical, design, capsys):
    words = ["simulate", "car", *ROAD, "--seed", "3", "--set", "m1=300", "--set", "beta = 2"]
    out = ran(capsys, *words, "-o", "out/drive.csv", "--json", "drive.json")
    head, *body = rows("out/drive.csv")
    assert head[:3] == ["time [s]", "road height [m]", "road velocity [m/s]"]
    asked = signals(physical)
    assert head[3:] == [signal.label for signal in asked]
    values = np.array(body, dtype=float)
    assert values.shape == (2001, 3 + len(asked))
    # The linear answer, the file without a rounding.
    road = random_road("C", 100.0, 3)
    _, w = road.velocity(20.0, 1e-3, 2.0)
    time, alpha = 1e-3 * np.arange(len(w) + 1), physical.alpha(m1=300, beta=2)
    theirs = simulate(physical, design, alpha, np.append(w, w[-1]), time, asked, hold="held")
    size = np.abs(theirs.values[0]).max(axis=0)
    assert np.abs((values[:, 3:] - theirs.values[0]) / size).max() < 1e-12
    setup = Setup(physical, on_road(physical, road, 20.0, 1e-3, 2.0), {"m1": 300, "beta": 2})
    assert np.array_equal(values[:, 3:], run(setup, design).response.values[0])
    assert np.array_equal(values[:, 0], theirs.time)
    assert np.allclose(np.diff(values[:, 1]), values[:-1, 2] * 1e-3, atol=1e-15)
    # The summary is of the same numbers.
    document = json.loads(Path("drive.json").read_text())
    (law,) = document["laws"]
    assert law["exact"]
    assert document["parameters"] == {"m1": 300, "beta": 2}
    for row, own in zip(law["signals"], values[:, 3:].T, strict=True):
        k = np.abs(own).argmax()
        assert (row["peak"], row["at"]) == (own[k], values[k, 0])
        assert row["rms"] == pytest.approx(np.sqrt(np.mean(own**2)))
    own = comfort(values[:, head.index("sprung-mass acceleration [m/s2]")], 1e-3)
    assert law["comfort"]["weighted rms"] == pytest.approx(float(own.weighted_rms))
    assert f"weighted rms {float(own.weighted_rms):.4g} m/s2, " in out
    assert "proved of this law: all poles in disk(-40, 36), for every constant value" in out
    assert "no limit was met" in out
    assert "saved: out/drive.csv" in out


def test_parquet_has_the_same_columns(car, capsys):
    pyarrow = pytest.importorskip("pyarrow.parquet")
    words = ["simulate", "car.toml", "--law", "skyhook", "--law", "passive", *ROAD]
    ran(capsys, *words, "-o", "drive.csv")
    ran(capsys, *words, "-o", "drive.parquet")
    head, *body = rows("drive.csv")
    table = pyarrow.read_table("drive.parquet")
    assert table.column_names == head
    assert "skyhook: sprung-mass acceleration [m/s2]" in head
    columns = np.stack([c.to_numpy() for c in table.columns], axis=1)
    assert np.array_equal(columns, np.array(body, dtype=float))


def test_without_a_law_a_spec_is_passive(car, capsys):
    out = ran(capsys, "simulate", "car.toml", "--bump", "0.05", "0.5", "--speed", "5")
    assert "passive (exact at every instant)" in out
    assert "proved of this law: nothing" in out
    assert "3 s in steps" in out
    assert "written" not in out


def test_a_drive_says_what_it_met_and_what_margins_cover(car, capsys, monkeypatch):
    drawn = []

    def figure(time, panels, title, outside):
        drawn.extend([panels, outside])
        return signals_figure(time, panels[:1], title, outside)

    monkeypatch.setattr("polefence.show.plots.signals_figure", figure)
    words = ["simulate", "car", "--pothole", "0.06", "0.5", "--speed", "8", "--duration", "2"]
    words += ["--set", "m1=250", "--jump", "m1=340@1", "--drift", "beta=5@0.5..1.5"]
    words += ["--force-limit", "900", "--travel-limit", "0.03", "--sampling", "0.004"]
    out = ran(
        capsys, *words, "-o", "d.csv", "--plot", "d.png", "--signals", "all", "--json", "d.json"
    )
    for said in (
        "Runge-Kutta", "the margins cover ", "rate of change above what is proved: m1 jumps",
        "demanded of an actuator that gives 900", "stop hit", "the tyre leaves the road",
        "note: the controller samples every 0.004 s", "m1 = 250 kg, beta = 0 at first",
    ):  # fmt: skip
        assert said in out, said
    document = json.loads(Path("d.json").read_text())
    kinds = {event["kind"] for event in document["laws"][0]["events"]}
    assert kinds == {"rate", "rate and estimate", "limit", "stops", "road"}
    head, *body = rows("d.csv")
    values = dict(zip(head, np.array(body, dtype=float).T, strict=True))
    time, load = values["time [s]"], values["m1 [kg]"]
    assert set(load[time < 1 - 1e-9]) == {250.0}
    assert set(load[time >= 1 - 1e-9]) == {340.0}
    assert values["beta"][time.searchsorted(1.0)] == pytest.approx(2.5)
    assert np.abs(values["actuator force [N]"]).max() == 900
    assert np.abs(values["actuator force demanded [N]"]).max() > 900
    assert np.any(values["stop force [N]"])
    assert Path("d.png").read_bytes().startswith(b"\x89PNG")
    panels, outside = drawn
    curves = {panel.label: tuple(panel.curves) for panel in panels}
    assert curves["actuator force [N]"] == ("car", "car, demanded")
    assert curves["m1 [kg]"] == curves["road height [m]"] == ("",)
    assert len(panels) == 1 + 9 + 3  # the road, signals, stops and two parameters
    lasting = float(out.split("the margins cover ")[1].split(" s of 2 s")[0])
    assert outside[:-1].mean() * 2 == pytest.approx(2 - lasting)


def test_four_panels_are_drawn_and_those_of_parameters_that_move(physical, design):
    road = on_road(physical, pothole(0.06, 0.4), 8.0, 1e-3, 0.1)
    four = [
        "road height",
        "suspension deflection",
        "sprung-mass acceleration",
        "tyre force variation",
    ]
    still = Setup(physical, road)
    panels = panels_of(still, {"a": run(still, design)})
    assert len(panels) == 10
    assert [panel.label.split(" [")[0] for panel in picked(panels, None)] == four
    assert picked(panels, "all") == panels
    (one,) = picked(panels, " unsprung-mass velocity ")
    assert one.label == "unsprung-mass velocity [m/s]"
    moving = Setup(physical, road, {"m1": Ramp(250, 300, 0, 0.1), "beta": 0.0})
    panels = panels_of(moving, {"a": run(moving, design)})
    names = [panel.label.split(" [")[0] for panel in picked(panels, None)]
    assert names == [*four, "m1", "beta"]


def test_where_the_tyre_is_off_the_road_is_shaded(physical, design):
    """The static load is the weight of both masses, at the load of each instant."""
    road = on_road(physical, pothole(0.06, 0.4), 8.0, 1e-3, 0.5)
    setup = Setup(physical, road, {"m1": Ramp(250, 300, 0, 0.5), "beta": 0.0})
    found = run(setup, design)
    (panel,) = [own for own in panels_of(setup, {"a": found}) if own.floors]
    assert panel.label == "tyre force variation [N]"
    (level,) = panel.floors.values()
    (loads,) = [values for name, _, values in found.more if name == "m1"]
    np.testing.assert_allclose(level, -9.81 * (loads + 28.58), rtol=1e-10)
    (event,) = [own for own in found.events if own.kind == "road"]
    off = panel.curves["a"] < level
    assert setup.time[off][0] == pytest.approx(event.first)
    assert off.sum() * setup.step == pytest.approx(event.duration, abs=1.5e-3)
    (ax,) = signals_figure(setup.time, [panel]).axes
    (shade,) = ax.collections
    (corners,) = [path.vertices for path in shade.get_paths()]
    assert corners[:, 1].max() == pytest.approx(level.max())
    assert corners[:, 1].min() == ax.get_ylim()[0]


def test_a_tyre_of_uncertain_stiffness_leaves_the_road_too():
    """No output is its force, which differs from vertex to vertex: nothing is shaded."""
    text = spec_text("quarter-car-physical").replace("kt = 155900     # N/m, tyre\n", "")
    text = text.replace(
        "[definitions]", "[parameter.kt]\nrange = [150000, 160000]\n\n[definitions]"
    )
    plant = loads(text)
    setup = Setup(plant, on_road(plant, pothole(0.06, 0.4), 8.0, 1e-3, 0.5))
    found = run(setup, None)
    assert setup.exact
    assert [own.kind for own in found.events] == ["road"]
    assert not [own for own in panels_of(setup, {"a": found}) if own.floors]


def test_each_wheel_has_its_own_static_load():
    plant, car = load(spec_path("half-car")), load_car(spec_path("half-car"))
    places = {f"{wheel.name} road velocity": (wheel.x, wheel.y) for wheel in car.wheels}
    road = on_wheels(plant, places, kerb(0.05), 10.0, 1e-3, 0.6)
    setup = Setup(plant, road, {"felt": 372.0, "age": 0.0}, car=car)
    (panel,) = [own for own in panels_of(setup, {"a": run(setup, None)}) if own.floors]
    assert list(panel.floors) == ["front tyre off the road", "rear tyre off the road"]
    front, rear = (-level[0] for level in panel.floors.values())
    # by moments, about the other wheel: the load is on the rear seat
    on_seat = 372 - 1 / (1 / 482.85 + 0.9**2 / 783)
    assert front + rear == pytest.approx(9.81 * (482.85 + on_seat + 2 * 31.9), rel=1e-6)
    moment = 9.81 * (482.85 * 1.423 + on_seat * (1.423 - 0.9))
    assert front - 9.81 * 31.9 == pytest.approx(moment / (1.156 + 1.423), rel=1e-6)


def test_estimates_are_told_to_the_law_and_written(car, capsys):
    words = ["simulate", "car", "--road", "C", "--speed", "20", "--duration", "1.5"]
    out = ran(capsys, *words, "--set", "m1=330", "--estimate", "-o", "d.csv")
    assert "error of the scheduling above what is proved" in out
    head, *body = rows("d.csv")
    told = np.array(body, dtype=float)[:, head.index("m1 estimated [kg]")]
    assert told[0] == pytest.approx(288.9)
    assert told[-1] == pytest.approx(330, abs=3)


def test_estimates_stand_beside_the_truth_in_the_figure(physical, design):
    setup = Setup(
        physical,
        on_road(physical, pothole(0.06, 0.4), 8.0, 1e-3, 0.1),
        hardware=Hardware(Estimated()),
    )
    runs = {"a": run(setup, design), "b": run(setup, None)}
    curves = {panel.label: tuple(panel.curves) for panel in panels_of(setup, runs)}
    assert curves["m1, true and estimated [kg]"] == ("", "a", "b")
    assert curves["beta, true and estimated"] == ("", "a", "b")
    assert curves["actuator force [N]"] == ("a", "b")
    figure = signals_figure(setup.time, panels_of(setup, runs))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["a", "b", "true", "tyre off the road"]


def test_a_sampling_period_beyond_the_fastest_pole_is_noted(car, capsys):
    words = ["simulate", "car", "--kerb", "0.01", "--speed", "5"]
    assert "asks for a period of at most 0.0274 s" in ran(capsys, *words, "--sampling", "0.05")
    assert "asks for a period" not in ran(capsys, *words, "--sampling", "0.0125")


@pytest.mark.parametrize(("hardware", "since"), [(["--force-limit", "1e12"], 0.94), ([], 0.18)])
def test_a_loop_that_runs_away_is_no_success(car, hardware, since, capsys):
    """Stepped or exact: the drive is not done, and one line says so."""
    words = ["simulate", "car.toml", "--law", "[[0, 0, 90000, 0, 0]]", "--kerb", "0.05"]
    assert main([*words, "--speed", "5", "--duration", "1.2", *hardware]) == 1
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert f"diverges under 'gain' at {since}" in said.err
    assert f"the state runs away; first at {since}" in said.out


def test_a_loop_that_runs_away_is_written_as_it_is(car, capsys):
    words = ["simulate", "car.toml", "--law", "[[0, 0, 90000, 0, 0]]", "--kerb", "0.05"]
    words += ["--speed", "5", "--force-limit", "1e12"]
    out = ran(capsys, *words, "-o", "d.csv", "--json", "d.json", status=1)
    assert "the state runs away" in out
    assert "comfort: not evaluated" in out
    (law,) = json.loads(Path("d.json").read_text())["laws"]
    assert law["law"] == "gain"
    assert law["signals"][0]["peak"] is None
    assert rows("d.csv")[-1][3] == "nan"


def test_exact_and_stepped_agree_and_see_the_same_contact(physical, design):
    """What is not needed is not solved another way: the equations are the same."""
    for law in (None, design):
        hole = pothole(0.06, 0.4, before=0.5, after=20)
        setup = Setup(physical, on_road(physical, hole, 8.0, 1e-3, 1.0))
        exact, stepped = run(setup, law), run(replace(setup, outside=True), law)
        assert setup.exact
        assert not replace(setup, outside=True).exact
        size = np.abs(exact.response.values).max(axis=1)
        size = np.where(size > 0, size, 1)
        off = (exact.response.values - stepped.response.values) / size
        assert np.abs(off).max() < 2e-6
        assert [e.kind for e in exact.events] == ["road"]
        assert exact.events == stepped.events
        assert exact.report() == stepped.report()


def test_what_is_not_exact(physical):
    moved = on_road(physical, pothole(0.06, 0.4), 8.0, 1e-3)
    assert Setup(physical, moved, {"m1": 250, "beta": 1}).exact
    moving = Setup(physical, moved, {"m1": Jump(1, 250, 340), "beta": 1})
    assert not moving.exact
    assert not moving.still
    assert not Setup(physical, moved, hardware=Hardware(Estimated())).still


def test_designs_without_a_proof_here_are_said_to_prove_nothing(car, physical, capsys):
    document = json.loads(Path("car/design.json").read_text())
    document["claims"][0]["region"]["radius"] = 20.0
    Path("false.json").write_text(json.dumps(document))
    out = ran(capsys, "simulate", "false.json", *ROAD)
    assert "proved of this law: nothing: the proof in its file fails" in out
    text = spec_text("quarter-car-physical").replace("28.58", "30")
    Path("other.toml").write_text(text)
    out = ran(capsys, "simulate", "other.toml", "--law", "car", "--law", "car", *ROAD)
    assert out.count("proved of this law: nothing: its proof is about another plant") == 2
    assert "car (2) (exact" in out


def test_a_plant_of_vertices_takes_weights(tmp_path, physical, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("v.toml").write_text(dumps(replace(physical, parameters=())))
    out = ran(capsys, "simulate", "v.toml", *ROAD, "--set", "alpha1=0.25", "--set", "alpha2=0.75")
    assert "alpha1 = 0.25, alpha2 = 0.75, alpha3 = 0, alpha4 = 0" in out
    assert "sum to one; they sum to 0.5" in refused(
        capsys, "simulate", "v.toml", *ROAD, "--set", "alpha1=0.5"
    )
    error = refused(capsys, "simulate", "v.toml", *ROAD, "--jump", "alpha1=1@1")
    assert "no parameters that could move" in error


STAGE = """
name = "stage"
states = ["x [m]", "v [m/s]"]
inputs = ["pull [N]"]
disturbances = ["push [N]", "drift [m/s]"]
[outputs]
"acceleration [m/s2]" = {C = ["-k", "-0.4"], D = [1], F = [1, 0]}
[parameter.k]
range = [1, 3]
[matrices]
A = [[0, 1], ["-k", -0.4]]
B = [[0], [1]]
E = [[0, 1], [1, 0]]
"""


@pytest.fixture
def stage(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("stage.toml").write_text(STAGE)
    return load("stage.toml")


def test_steps_impulses_and_initial_states_move_any_plant(stage, capsys):
    words = ("simulate", "stage.toml", "--set", "k=2", "--duration", "5", "--step", "0.01")
    K = [[-1.0, -1.0]]
    alpha = stage.alpha(k=2)
    said = ran(capsys, *words, "--law", json.dumps(K), "--step-in", "push=2", "-o", "s.csv")
    assert "step of push" in said
    assert "comfort" not in said
    assert rows("s.csv")[0] == [
        "time [s]", "push [N]", "drift [m/s]", "x [m]", "v [m/s]", "acceleration [m/s2]",
        "pull [N]",
    ]  # fmt: skip
    names = ["x", "v", "acceleration", "pull"]
    given = {"signals": names, "duration": 5.0, "step": 0.01}
    found = table("s.csv")
    theirs = step(stage, np.array(K), alpha, source="push", **given)
    assert found[:, 3:] == pytest.approx(2 * theirs.values[0], rel=1e-9, abs=1e-12)
    ran(capsys, *words, "--law", json.dumps(K), "--impulse-in", "drift=0.5", "-o", "i.csv")
    theirs = impulse(stage, np.array(K), alpha, source="drift", **given)
    assert table("i.csv")[:, 3:] == pytest.approx(0.5 * theirs.values[0], rel=1e-9, abs=1e-12)
    ran(capsys, *words, "--law", json.dumps(K), "--initial", "x=0.1", "--initial", "v=-1",
        "-o", "x.csv")  # fmt: skip
    time = 0.01 * np.arange(501)
    theirs = simulate(stage, np.array(K), alpha, None, time, names, start=[0.1, -1.0])
    assert table("x.csv")[:, 3:] == pytest.approx(theirs.values[0], rel=1e-9, abs=1e-12)
    # all of it adds up, for the plant is linear
    ran(capsys, *words, "--law", json.dumps(K), "--initial", "x=0.1", "--initial", "v=-1",
        "--step-in", "push=2", "--impulse-in", "drift=0.5", "-o", "all.csv")  # fmt: skip
    parts = sum(table(f"{name}.csv")[:, 3:] for name in "six")
    assert table("all.csv")[:, 3:] == pytest.approx(parts, rel=1e-9, abs=1e-12)


def test_recorded_disturbances_come_by_name(stage, capsys):
    Path("push.csv").write_text("time [s],push [N]\n0,0\n0.5,1\n2,1\n")
    ran(capsys, "simulate", "stage.toml", "--input", "push.csv", "--step", "0.05", "-o", "o.csv")
    time = 0.05 * np.arange(41)
    w = np.stack([np.minimum(time / 0.5, 1), 0 * time], axis=1)
    names = ["x", "v", "acceleration", "pull"]
    theirs = simulate(stage, None, stage.alpha(k=2), w, time, names)
    found = table("o.csv")
    assert found[:, 1:3] == pytest.approx(w, abs=1e-12)
    assert found[:, 3:] == pytest.approx(theirs.values[0], rel=1e-9, abs=1e-12)


def test_what_moves_and_saturates_is_followed_for_any_plant(stage, capsys):
    said = ran(
        capsys, "simulate", "stage.toml", "--law", "[[-5, -3]]", "--initial", "x=1", "--duration",
        "2", "--force-limit", "0.5", "--drift", "k=3@0..1", "-o", "d.csv",
    )  # fmt: skip
    assert "demanded of an actuator that gives 0.5" in said
    x, v, a, u, k = (table("d.csv")[:, i] for i in (3, 4, 5, 6, 8))
    assert a == pytest.approx(-k * x - 0.4 * v + u, rel=1e-9)
    assert np.abs(u).max() == 0.5


def test_a_plant_without_disturbance_comes_from_its_initial_state(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("p.toml").write_text("[matrices]\nA = [[-1]]\nB = [[1]]\n")
    said = ran(capsys, "simulate", "p.toml", "--initial", "x1=2", "-o", "p.csv", "--plot", "p.svg")
    assert "10 s in steps of 0.01 s" in said
    assert table("p.csv")[:, 1] == pytest.approx(2 * np.exp(-table("p.csv")[:, 0]), rel=1e-9)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (ROAD, "stage is not described as a vehicle, and a road needs one"),
        ((), "nothing moves the plant: give --step-in"),
        (("--step-in", "gust=1"), "no disturbance of stage is called 'gust'; known: drift, push"),
        (("--initial", "push=1"), "no state of stage is called 'push'; known: v, x"),
        (("--step-in", "push"), "--step-in 'push'; write NAME=SIZE"),
        (("--step-in", "push=1", "--step-in", "push=2"), "--step-in: push is given twice"),
        (("--step-in", "push=1", "--speed", "3"), "--speed belongs to a road"),
        (("--input", "in.csv", "--initial", "x=1"), "--input says what moves the plant"),
        (("--step-in", "push=1", "--duration", "-1"), "--duration [s] = -1"),
        (("--input", "in.csv"), "in.csv: row 1: no disturbance 'gust', or twice"),
        (("--input", "unit.csv"), "'push [kN]' is in kN; push is in N"),
        (("--input", "bare.csv"), "row 1 must name the columns, as in: time [s], push [N]"),
        (("--input", "back.csv"), "row 3: numbers must be finite, and times increase"),
        (("--input", "nan.csv"), "row 2: numbers must be finite"),
        (("--input", "short.csv"), "1 rows; a disturbance needs two or more"),
    ],
)
def test_excitation_that_cannot_be_used_is_refused(stage, capsys, words, message):
    files = {
        "in.csv": "time,gust\n0,1\n1,1\n",
        "unit.csv": "time,push [kN]\n0,1\n1,1\n",
        "bare.csv": "0,1\n1,1\n",
        "back.csv": "time,push\n0,1\n0,1\n",
        "nan.csv": "time,push\n0,nan\n1,1\n",
        "short.csv": "time,push\n0,1\n",
    }
    for name, text in files.items():
        Path(name).write_text(text)
    assert message in refused(capsys, "simulate", "stage.toml", *words)


def test_a_road_moves_a_car_alone(car, capsys):
    said = refused(capsys, "simulate", "car.toml", *ROAD, "--initial", "suspension deflection=0.1")
    assert "a road is all that moves a car" in said
    assert "--speed is missing" in refused(capsys, "simulate", "car.toml", "--kerb", "0.1")


def test_a_fast_pole_shortens_the_step_on_a_road(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for bandwidth, longest in ((100, 0.001), (300, 1 / (2 * np.pi * 300))):
        sensor = f'\n[sensor."suspension deflection"]\nbandwidth = {bandwidth}\n'
        Path("car.toml").write_text(spec_text("quarter-car-physical") + sensor)
        ran(capsys, "simulate", "car.toml", *ROAD, "-o", "drive.csv")
        step = table("drive.csv")[1, 0]
        assert longest / 3 < step <= longest * 1.001
        assert (step == 0.001) == (bandwidth == 100)


def test_other_disturbances_of_a_car_are_still_on_a_road(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    spec = spec_text("quarter-car-ride")
    Path("one.toml").write_text(spec)
    spec = spec.replace('["road velocity [m/s]"]', '["wind [N]", "road velocity [m/s]"]')
    spec = spec.replace("E = [[0], [1], [0], [0]]", 'E = [[0, 0], [0, 1], ["1/m1", 0], [0, 0]]')
    Path("two.toml").write_text(spec)
    for name in ("one", "two"):
        ran(capsys, "simulate", f"{name}.toml", *ROAD, "-o", f"{name}.csv")
    assert table("two.csv")[:, 4:] == pytest.approx(table("one.csv")[:, 3:], rel=1e-9, abs=1e-15)
    assert not table("two.csv")[:, 2].any()


PROFILES = {
    "gap.csv": ("distance [m],height [m]\n0,0\n1,\n2,0\n", "gap.csv: row 3: no height"),
    "nan.csv": ("0,0\n1,nan\n2,0\n", "nan.csv: row 2: height nan is not a finite number"),
    "back.csv": ("0,0\n2,0.1\n1,0\n", "back.csv: row 3: distance 1 m lies before"),
    "short.csv": ("0,0\n1,0.1\n", "short is 1 m long; 2 s at 20 m/s need 40 m"),
    "none.csv": ("distance,height\n", "none.csv: 0 points"),
}


@pytest.mark.parametrize("name", PROFILES)
def test_bad_profiles_are_refused(car, capsys, name):
    content, message = PROFILES[name]
    Path(name).write_text(content)
    words = ["simulate", "car", "--profile", name, "--speed", "20", "--duration", "2"]
    assert message in refused(capsys, *words, "-o", "out.csv")
    assert not Path("out.csv").exists()


def test_a_measured_profile_is_driven_to_its_end(car, capsys):
    x = np.linspace(0, 30, 301)
    lines = "\n".join(f"{a:.6g},{0.01 * np.sin(a):.6g}" for a in x)
    Path("track.csv").write_text(f"distance [m],height [m]\n{lines}\n")
    out = ran(capsys, "simulate", "car", "--profile", "track.csv", "--speed", "10", "-o", "o.csv")
    assert "track, at 10 m/s, 3 s" in out
    assert float(rows("o.csv")[-1][1]) == pytest.approx(0.01 * np.sin(30), abs=1e-7)


REFUSED = {
    "speed zero": (["--road", "C", "--speed", "0"], "--speed [m/s] = 0.0; give a number above"),
    "no such class": (["--road", "I", "--speed", "9"], "no road class 'I'; known: A, B, C"),
    "slow step": ([*ROAD, "--step", "0.05"], "sample the disturbance at 0.0"),
    "slow step of a drive": (
        [*ROAD, "--step", "0.05", "--force-limit", "9"], "use at most 0.0",
    ),
    "no step": ([*ROAD, "--step", "-1"], "--step [s] = -1.0; give a number above zero"),
    "duration": (["--road", "C", "--speed", "9", "--duration", "nan"], "--duration [s] = nan"),
    "seed": (["--kerb", "0.1", "--speed", "9", "--seed", "1"], "--seed belongs to --road"),
    "bad seed": ([*ROAD, "--seed", "-1"], "seed = -1; give a whole number"),
    "no road": (["--speed", "9"], "nothing moves the plant: give --step-in"),
    "two roads": ([*ROAD, "--kerb", "0.1"], "not allowed with argument --road"),
    "flat grade": (["--grade", "0", "9", "--speed", "9"], "slope of the grade = 0"),
    "short grade": (["--grade", "0.1", "0", "--speed", "9"], "length of the grade [m] = 0"),
    "flat bump": (["--bump", "0", "1", "--speed", "9"], "height of the bump [m] = 0"),
    "form of --set": ([*ROAD, "--set", "m1"], "--set 'm1'; write NAME=VALUE"),
    "number of --set": ([*ROAD, "--set", "m1=nan"], "--set 'm1=nan'; write NAME=VALUE"),
    "parameter": ([*ROAD, "--set", "mass=300"], "no parameter 'mass'; known: beta, m1"),
    "twice": ([*ROAD, "--set", "m1=300", "--set", "m1=310"], "m1 is given twice"),
    "jump and drift": (
        [*ROAD, "--jump", "m1=300@1", "--drift", "m1=310@1..2"], "m1 is given twice",
    ),
    "form of --jump": ([*ROAD, "--jump", "m1=300"], "write NAME=VALUE@TIME, as in m1=340@5"),
    "form of --drift": ([*ROAD, "--drift", "m1=300@1"], "write NAME=VALUE@BEGIN..END"),
    "drift backwards": ([*ROAD, "--drift", "m1=300@2..1"], "it must end later"),
    "interval": ([*ROAD, "--jump", "m1=400@1"], "outside [231.12, 346.68]; the guarantee ends"),
    "sampling": ([*ROAD, "--sampling", "0"], "--sampling [s] = 0.0"),
    "sampling and step": (
        [*ROAD, "--sampling", "0.0015", "--step", "0.001"], "is not a multiple of the step",
    ),
    "force": ([*ROAD, "--force-limit", "0"], "limit of the actuator = 0.0"),
    "travel": ([*ROAD, "--travel-limit", "-1"], "free travel in bump [m] = -1.0"),
    "law": ([*ROAD, "--law", "skyhok"], "no law and no file 'skyhok'; did you mean 'skyhook'?"),
    "gain": ([*ROAD, "--law", "[[1, 2]]"], "the gain is 1 x 2; quarter car, physical needs 1 x 5"),
    "table": ([*ROAD, "-o", "out.xlsx"], "out.xlsx: signals are written as .csv or .parquet"),
    "signals": (
        [*ROAD, "--plot", "out.png", "--signals", "tyre force"],
        "--signals: no signal 'tyre force'; did you mean 'tyre force variation'?",
    ),
    "figure": ([*ROAD, "--plot", "out.csv"], "out.csv: a figure ends in .png, .svg or .pdf"),
    "one file": ([*ROAD, "-o", "x.csv", "--json", "x.csv"], "named for two results"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_one_line_and_leaves_nothing(car, capsys, case):
    words, message = REFUSED[case]
    before = sorted(car.rglob("*"))
    if "-o" not in words:
        words = [*words, "-o", "out.csv", "--json", "out.json"]
    assert message in refused(capsys, "simulate", "car.toml", *words)
    assert sorted(car.rglob("*")) == before


def test_outside_of_the_interval_is_driven_only_if_asked(car, capsys):
    words = ["simulate", "car", *ROAD, "--set", "m1=400"]
    assert "(--outside drives on)" in refused(capsys, *words)
    assert "m1 = 400 kg outside [231.12, 346.68]" in ran(capsys, *words, "--outside")


def test_parquet_without_pyarrow_names_the_extra(car, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    error = refused(capsys, "simulate", "car", *ROAD, "-o", "out.parquet")
    assert "pip install 'polefence[parquet]'" in error


def test_what_cannot_be_read_is_named(car, capsys):
    assert "nowhere.toml: cannot be read" in refused(capsys, "simulate", "nowhere.toml", *ROAD)
    Path("empty").mkdir()
    assert "empty: has no design.json" in refused(capsys, "simulate", "empty", *ROAD)
    Path("table.json").write_text('{"format": 3}')
    error = refused(capsys, "simulate", "car.toml", *ROAD, "--law", "table.json")
    assert error.startswith("polefence: table.json: ")


def test_compare_prints_the_table_and_writes_its_rows(car, capsys):
    words = ["compare", "car", "--law", "passive", "--law", "quadratic", "--disk", "-40", "34"]
    out = ran(capsys, *words, "--road", "B", "--speed", "30", "--json", "c.json")
    assert "class B (ISO 8608) at 30 m/s" in out
    assert "\nquadratic: refuted for quadratic: its inequalities have no solution" in out
    document = json.loads(Path("c.json").read_text())
    assert {row["law"] for row in document["rows"]} == {"car", "passive"}
    assert (document["road"], document["speed"]) == ("B", 30.0)
    worst = {r["law"]: r["worst"] for r in document["rows"] if r["quantity"] == "acceleration"}
    assert worst["car"] > worst["passive"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["car.toml", "--law", "[[0, 0, 9000, 0, 0]]"], "(gain: unstable: a pole at"),
        (["car.toml", "--law", "passive", "--speed", "0"], "speed [m/s] = 0.0"),
        (["car.toml", "--law", "passive", "--road", "X"], "no road class 'X'"),
        (["car.toml", "--law", "slack", "--disk", "-40", "-1"], "radius"),
        (["car.toml", "--law", "pasive"], "did you mean 'passive'?"),
        (["car.toml", "--law", "passive", "--json", "car"], "is a folder"),
    ],
)
def test_compare_refuses_in_one_line(car, capsys, words, message):
    assert message in refused(capsys, "compare", *words)


def test_a_comma_in_a_name_stays_in_its_cell(tmp_path):
    table = Table(("time [s]", 'force, "up" [N]'), np.array([[0.1, -1e-300], [0.3, np.nan]]))
    write_table(tmp_path / "t.csv", table)
    head, *body = rows(tmp_path / "t.csv")
    assert head == ["time [s]", 'force, "up" [N]']
    assert body == [["0.1", "-1e-300"], ["0.3", "nan"]]
    with pytest.raises(ValueError, match="two columns are called 'a'"):
        Table(("a", "a"), np.zeros((1, 2)))


def test_a_long_record_is_drawn_with_its_extremes():
    time = np.arange(100_000) / 1000
    values = np.sin(time)
    values[77_777], values[12_345] = 5.0, -4.0
    outside = (time > 20) & (time < 30)
    panels = [Panel("a [m]", {"one": values, "two": 0.5 * values}), Panel("road [m]", {"": time})]
    figure = signals_figure(time, [*panels, panels[0]], "title", outside)
    first, _, _, fourth = figure.axes
    drawn = first.lines[0]
    assert len(drawn.get_xdata()) < 4000
    assert np.all(np.diff(drawn.get_xdata()) >= 0)
    assert drawn.get_ydata().max() == 5
    assert drawn.get_ydata().min() == -4
    assert drawn.get_xdata()[[0, -1]].tolist() == [0, time[-1]]
    assert first.get_ylabel() == "a [m]"
    assert not fourth.axison
    shaded = first.collections[0].get_paths()[0].vertices[:, 0]
    assert (shaded.min(), shaded.max()) == pytest.approx((20.001, 30.0), abs=1e-9)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["one", "two", "outside of what is proved"]
    assert np.isnan(
        signals_figure(time, [Panel("lost", {"": np.exp(time)})]).axes[0].lines[0].get_ydata()[-1]
    )
    looks = {(line.get_linestyle(), line.get_linewidth()) for line in first.lines}
    assert len(looks) == 2


def test_compare_designs_the_law_that_a_spec_asks_for(car, capsys):
    """As `optimise` does; a spec that asks for none is said to, and no disk is made up."""
    out = ran(capsys, "compare", "car.toml")
    assert "disk(" not in out
    assert out.splitlines()[-1].startswith(
        "note: car.toml asks for no law of its own; write [[spec"
    )
    text = Path("car.toml").read_text()
    Path("region.toml").write_text(f'region = "disk(-40, 36)"\n{text}')
    out = ran(capsys, "compare", "region.toml", "--json", "c.json")
    placed = {r["law"]: r["worst"] for r in json.loads(Path("c.json").read_text())["rows"][:4]}
    assert list(placed) == ["law of the spec", "passive", "skyhook", "lqr"]
    wanted = ran(capsys, "compare", "car.toml", "--law", "scheduled", "--json", "d.json")
    assert "scheduled" in wanted
    row = json.loads(Path("d.json").read_text())["rows"][0]
    assert placed["law of the spec"] == pytest.approx(row["worst"], rel=1e-6)


def test_compare_says_where_the_law_of_a_spec_is_not_proved(car, capsys):
    text = Path("car.toml").read_text()
    Path("far.toml").write_text(f'region = "disk(-40, 2)"\n{text}')
    out = ran(capsys, "compare", "far.toml")
    assert "\nlaw of the spec: refuted for scheduled" in out or "\nlaw of the spec: not" in out
    assert "passive" in out
