"""Cars on several wheels in the commands: roads under them, and a ride within limits."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.plant.cars import Car
from support.commands import ran, refused
from support.once import searched_once  # noqa: F401
from support.paths import DOCS

UNDER = re.compile(r"under = \[[^\]]*\]\n")
REGION = ["--region", "half_plane(1) & sector(0.1)"]


@pytest.fixture
def half(tmp_path):
    path = tmp_path / "half.toml"
    path.write_text(spec_text("half-car"))
    return path


@pytest.mark.usefixtures("hasty")
def test_a_half_car_rides_within_its_limits(half, tmp_path, capsys):
    words = ["optimise", str(half), *REGION, "--method", "quadratic", "-o", str(tmp_path / "d")]
    out = ran(capsys, *words)
    (line,) = [line for line in out.splitlines() if "driver acceleration" in line]
    proved, sampled = map(float, re.findall(r" (\d+\.\d+)", line)[:2])
    # the passive car, by its covariance: both roads act, each by itself
    plant = family("half-car")
    density = (2 * np.pi * 0.1) ** 2 * 256e-6 * 20 / 2  # two-sided
    C = np.array({o.name: o for o in plant.every_output}["driver acceleration"].C, float)
    passive = []
    for A, c in zip(plant.A, C, strict=True):
        E = np.array(plant.vertices[0].exact_E, float)
        n = len(A)
        lyapunov = np.kron(np.eye(n), A) + np.kron(A, np.eye(n))
        X = np.linalg.solve(lyapunov, -density * (E @ E.T).ravel()).reshape(n, n)
        passive.append(float(np.sqrt(c @ X @ c)))
    assert sampled <= proved < 0.9 * max(passive)
    capsys.readouterr()
    assert main(["check", str(tmp_path / "d" / "design.json")]) == 0


@pytest.mark.parametrize("sampled", [[], ["--sample-time", "0.005", "--delay", "1"]])
def test_a_design_drives_as_its_spec_does_with_it(half, sampled, tmp_path, capsys):
    design = str(tmp_path / "d")
    words = ["--region", "half_plane(0.5)", "--method", "quadratic", *sampled, "-o", design]
    assert main(["design", str(half), *words]) == 0
    road = ["--road", "C", "--speed", "20", "--duration", "1", "-o"]
    alone, both = (str(tmp_path / name) for name in ("alone.csv", "both.csv"))
    assert "vibration total value" in ran(capsys, "simulate", design, *road, alone)
    assert main(["simulate", str(half), "--law", design, *road, both]) == 0
    assert Path(alone).read_bytes() == Path(both).read_bytes()


@pytest.mark.parametrize("name", ["half-car", "full-car"])
def test_a_car_is_read_from_a_file_as_it_was_written(name):
    car = family(name).car
    assert Car.of(json.loads(json.dumps(car.document()))) == car


@pytest.mark.parametrize(("name", "wheels"), [("half-car", 2), ("full-car", 4)])
@pytest.mark.usefixtures("hasty")
def test_no_load_of_ten_thousand_exceeds_a_bound(name, wheels, tmp_path, capsys, request):
    if wheels == 4:  # to tune its law takes a minute
        request.getfixturevalue("lmi_alone")
    spec = tmp_path / "car.toml"
    spec.write_text(spec_text(name))
    out = ran(capsys, "optimise", spec, *REGION, "--method", "quadratic")
    assert "proved sampled 10000" in out
    rows = re.findall(r"rms of (.*) \[(?:m|N|m/s2)\] +(\S+) +(\S+) +\S+  (\w+)", out)
    assert [row[3] for row in rows] == ["minimised", *["limit"] * 2 * wheels]
    for signal, proved, sampled, _ in rows:
        assert 0 < float(sampled) <= float(proved), signal
    if wheels == 2:  # one matrix for everything, as an LMI has it, proves less
        assert float(rows[0][1]) < 1.003 * float(rows[0][2])


@pytest.mark.parametrize(
    ("new", "words"),
    [
        ("", "half car has 2 disturbances; a road is one; name those that are roads"),
        ('under = ["front road velocity"]\n', "half car has 2 disturbances"),
        ('under = ["kerb"]\n', "road: under: half car has no disturbance 'kerb'"),
        ('under = "front road velocity"\n', "must be a list of names"),
        ("under = [1, 2]\n", "must be a list of names"),
    ],
)
def test_roads_must_be_named(half, new, words, capsys):
    text = half.read_text()
    assert UNDER.search(text)
    half.write_text(UNDER.sub(new, text))
    message = refused(capsys, "optimise", str(half), *REGION)
    assert words in message


def test_another_road_is_under_the_same_wheels(half, capsys, lmi_alone):
    words = ["optimise", str(half), *REGION, "--method", "quadratic", "--speed", "20", "--road"]
    levels = []
    for road in "BC":
        out = ran(capsys, *words, road)
        levels.append(float(re.search(r"driver acceleration \[m/s2\] +(\S+)", out)[1]))
    assert levels[0] < 0.5 * levels[1]  # a quarter of the density, and the limits are wider for it


def test_an_rms_on_roads_is_of_roads_alone(half, capsys, lmi_alone):
    words = ["optimise", str(half), *REGION, "--method", "quadratic"]
    flat = ran(capsys, *words)
    half.write_text(
        half.read_text().replace("[car.wheel.front]", "height = 0.55\n[car.wheel.front]")
    )
    high = ran(capsys, *words)
    acting = "from [front road velocity, rear road velocity]"
    assert acting in high
    levels = [re.search(r"driver acceleration.* \[m/s2\] +(\S+)", out)[1] for out in (flat, high)]
    assert levels[0] == levels[1]


def test_a_wheel_without_a_road_is_refused_beside_manoeuvres(half, capsys):
    first = "[car.wheel.front]"
    text = half.read_text().replace(first, f"height = 0.55\n{first}")
    half.write_text(UNDER.sub('under = ["front road velocity"]\n', text))
    assert "half car has 3 disturbances" in refused(capsys, "optimise", str(half), *REGION)


@pytest.fixture
def tracked(half):
    half.write_text(UNDER.sub("[road.tracks]\norder = 2\n", half.read_text()))
    return half


def test_a_law_of_a_car_on_tracks_does_not_measure_the_road(half, tmp_path, capsys):
    out, text = tmp_path / "d", half.read_text()
    names = [own.split(" [")[0] for own in family("half-car").states]
    words = ["optimise", str(half), *REGION, "--degree", "0", "-o", str(out)]
    said = [ran(capsys, *words, "--measured", ", ".join(names))]
    half.write_text(UNDER.sub("[road.tracks]\norder = 2\n", text))
    said.append(ran(capsys, *words))
    assert f"of {', '.join(names)} keeps" in said[1]
    assert "road state" not in said[1]
    assert "steady state under constant road velocity = 1 m/s" in said[1]
    page = (DOCS / "cars.md").read_text()
    levels = [float(re.search(r"driver acceleration \[m/s2\] +(\S+)", own)[1]) for own in said]
    pattern = (
        r"proves (\S+) m/s² for the driver on independent roads, and about (\S+) m/s² on tracks"
    )
    assert levels == pytest.approx(list(map(float, re.search(pattern, page).groups())), rel=1.5e-2)
    assert main(["check", str(out / "design.json"), "--spec", str(half)]) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--method", "quadratic"], "cannot be measured; leave --method out"),
        (["--road", "C", "--speed", "30"], "later by a speed of 20 m/s"),
    ],
)
def test_tracks_refuse_what_does_not_fit(tracked, options, words, capsys):
    assert words in refused(capsys, "optimise", str(tracked), *REGION, *options)


def test_roads_are_named_or_in_tracks(tracked, capsys):
    both = 'under = ["road velocity"]\n[road.tracks]'
    tracked.write_text(tracked.read_text().replace("[road.tracks]", both))
    assert "leave under out" in refused(capsys, "optimise", str(tracked), *REGION)


def test_laws_of_dampers_need_independent_roads(tracked, capsys):
    damper = '[damper."front force"]\ndeflection = "front suspension deflection"\nrange = [1, 2]\n'
    tracked.write_text(tracked.read_text() + damper)
    assert "name independent roads by under" in refused(capsys, "semi-active", str(tracked))
