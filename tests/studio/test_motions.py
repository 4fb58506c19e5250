"""Motions of the cars that are shown: heights that move as their signals say."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from polefence import Disk, load, place
from polefence.base.errors import InputError
from polefence.examples import family, spec_text
from polefence.plant.cars import Body, Wheel, car_family
from polefence.plant.cars import Car as OnWheels
from polefence.plant.parameters import Parameter
from polefence.plant.spec import load_car
from polefence.studio.car import Car
from polefence.studio.palette import DARK, LIGHT
from polefence.studio.rides import EVERY, ROADS, STEP, ridden, rides, under
from polefence.studio.scene import sides_of
from polefence.vehicle import BumpStops, Hardware, drive, on_road, on_wheels
from support.commands import ran

GRAVITY = 9.81
FRESH = {"m1": 300.0, "beta": 2.0}
NAMES = ("quarter-car-physical", "half-car", "full-car")


@dataclass(frozen=True)
class Subject:
    """An example, and a law for it."""

    name: str
    plant: Any
    car: Any
    law: Any
    values: dict[str, float]

    def ridden(self, road="class C", speed=20.0, travel_limit=0.0, passive=False, **values):
        law = None if passive else self.law
        own = self.values | values
        return ridden(self.plant, self.car, law, own, road, speed, travel_limit)


@dataclass(frozen=True)
class Looked:
    """Of a state what the pane asks for."""

    values: tuple[tuple[str, float], ...]
    road: str = "class C"
    speed: float = 20.0
    travel_limit: float = 0.0
    beside: bool = False


def damped(plant, car):
    """A force at each corner against the body's velocity there, as a gain."""
    m, n, k = len(car.wheels), plant.shape[0], len(car.body.motions)
    K = np.zeros((m, n))
    K[:, k + m : 2 * k + m] = -1500 * np.array(car.G, float)
    return K


@pytest.fixture(scope="module")
def design(physical):
    return place(physical, Disk(-40, 31), "scheduled")


@pytest.fixture(scope="module")
def subjects(design, tmp_path_factory):
    found = {}
    for name in NAMES:
        path = tmp_path_factory.mktemp("cars") / "car.toml"
        path.write_text(spec_text(name))
        plant, car = load(path), load_car(path)
        law = design if car is None else damped(plant, car)
        values = FRESH if car is None else {"felt": 400.0, "age": 0.05}
        if name == "full-car":
            values = {"felt": 700.0, "age": 0.05}
        found[name] = Subject(name, plant, car, law, values)
    return found


@pytest.fixture
def quarter(subjects):
    return subjects["quarter-car-physical"]


@pytest.fixture
def full(subjects):
    return subjects["full-car"]


def stiffness(own):
    """Of a tyre of an example, and of its load when the car stands still, all wheels together."""
    if own.car is None:
        return 155900, (own.values["m1"] + 28.58) * GRAVITY
    body = own.car.body
    load = own.values["felt"] - float(body.empty)
    return 158240, (float(body.mass) + load + 31.9 * len(own.car.wheels)) * GRAVITY


@pytest.mark.parametrize("road", ROADS)
@pytest.mark.parametrize("name", NAMES)
def test_heights_are_what_tyres_and_suspensions_say(subjects, name, road):
    """A tyre carries its share of the car, and more as it is compressed."""
    own = subjects[name].ridden(road)
    kt, weight = stiffness(subjects[name])
    compressed = own.road - own.twist - own.unsprung
    assert own.tyre == pytest.approx(own.tyre[0] + kt * compressed, abs=1e-5 * weight)
    assert own.tyre[0].sum() == pytest.approx(weight)
    assert own.travel == pytest.approx(own.unsprung - own.sprung, abs=1e-12)
    assert not own.road[0].any()
    assert own.unsprung[0] == pytest.approx(0)
    assert own.sprung[0] == pytest.approx(0)


@pytest.mark.parametrize("name", NAMES)
def test_the_body_is_rigid_and_accelerates_as_it_is_felt(subjects, name):
    """Second differences of the heights, over a hill whose kinks are two."""
    known = subjects[name]
    own = known.ridden("class C")
    step = EVERY * STEP
    places = [(0.0, 0.0)] if known.car is None else known.car.seats.values()
    for place_, felt in zip(places, own.felt, strict=True):
        smooth = np.diff(own.height(*map(float, place_)), 2) / step**2
        mean = felt.acceleration
        mean = (mean[:-2] + 4 * mean[1:-1] + mean[2:]) / 6
        assert np.corrcoef(smooth, mean)[0, 1] > 0.9
    wheels = [] if known.car is None else known.car.wheels
    for i, wheel in enumerate(wheels):
        assert own.height(float(wheel.x), float(wheel.y)) == pytest.approx(own.sprung[:, i])


def test_twist_is_what_no_plane_fits(subjects, full):
    """It lifts two wheels across from each other, and lowers the others; three wheels have none."""
    assert np.abs(subjects["half-car"].ridden().twist).max() < 1e-12
    own = full.ridden()
    assert np.abs(own.twist).max() > 1e-3
    assert own.twist.sum(axis=1) == pytest.approx(0, abs=1e-12)
    flat = own.road - own.twist
    x, y = np.array([(float(w.x), float(w.y)) for w in full.car.wheels]).T
    G = np.stack([np.ones(4), x, y], axis=1)
    assert np.linalg.lstsq(G, flat.T, rcond=None)[1] == pytest.approx(0, abs=1e-20)
    # a hill twists nothing: both sides climb alike
    assert np.ptp(full.ridden("hill, 6 %").road[:, :2], axis=1).max() == 0


def test_wheels_behind_see_the_road_later(subjects):
    half = subjects["half-car"]
    speed = 25.79  # between the wheels in 0.1 s
    own = half.ridden("class B", speed)
    late = round(float(half.car.wheels[0].x - half.car.wheels[1].x) / speed / STEP / EVERY)
    assert own.road[late:, 1] == pytest.approx(own.road[:-late, 0], abs=1e-9)
    assert own.road[: late + 1, 1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_a_hill_is_climbed(subjects, name):
    own = subjects[name].ridden("hill, 6 %")
    assert own.road[-1] == pytest.approx(0.06 * 30)
    assert own.sprung[-1] == pytest.approx(own.road[-1], abs=2e-2)


def test_a_pothole_taken_fast_lifts_the_wheel_and_a_good_road_never(quarter):
    fast = quarter.ridden("pothole, 50 mm", 30.0)
    assert fast.lifted.any()
    assert (fast.tyre[fast.lifted] < 0).all()
    assert not quarter.ridden("class A", passive=True).lifted.any()


@pytest.mark.parametrize("limit", [0.0, 0.008])
@pytest.mark.parametrize("name", NAMES)
def test_the_same_as_a_drive(subjects, name, limit):
    """By Runge-Kutta, where a ride without stops is exact."""
    known = subjects[name]
    own = known.ridden("class B", travel_limit=limit)
    pair, seconds = under(known.car, "class B", 20.0), ROADS["class B"].seconds(20.0)
    if known.car is None:
        moved = on_road(known.plant, pair[0], 20.0, STEP, seconds)
    else:
        moved = on_wheels(known.plant, known.car.places, pair, 20.0, STEP, seconds)
    parts = Hardware(stops=BumpStops(limit, limit)) if limit else None
    done = drive(known.plant, known.law, moved, known.values, parts, car=known.car)
    seat = "sprung-mass" if known.car is None else "driver"
    found = done.response([f"{seat} acceleration"]).values[0, ::EVERY, 0]
    near = {"abs": 1e-9} if limit else {"abs": 1e-3 * np.abs(found).max()}
    assert own.felt[0].acceleration == pytest.approx(found, **near)
    forces = done.stop_forces[0, ::EVERY]
    if limit:
        assert own.stopped.any()
        assert np.array_equal(own.stopped, forces != 0)
        assert (own.travel[forces > 0] > limit).all()
        assert (own.travel[forces < 0] < -limit).all()
    else:
        assert not own.stopped.any()


@pytest.mark.parametrize(
    ("road", "limit"),
    [("class C", 0.0), ("class C", 0.02), ("kerb, 40 mm", 0.02), ("hill, 6 %", 0.0)],
)
@pytest.mark.parametrize("name", NAMES)
def test_the_command_drives_the_same(subjects, name, road, limit, tmp_path, monkeypatch, capsys):
    """Signals to the last digits that it writes, and its words of comfort."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(spec_text(name))
    known = subjects[name]
    words = ["simulate", "car.toml", *ROADS[road].option.split(), "--speed", "20"]
    words += [f"--set={key}={value}" for key, value in known.values.items()]
    words += ["--travel-limit", str(limit)] if limit else []
    said = ran(capsys, *words, "-o", "drive.csv")
    head, *rows = (line.split(",") for line in (tmp_path / "drive.csv").read_text().splitlines())
    table = dict(zip(head, np.array(rows, float)[::EVERY].T, strict=True))
    own = known.ridden(road, 20.0, limit, passive=True)
    wheels = [""] if known.car is None else [f"{wheel.name} " for wheel in known.car.wheels]
    for i, wheel in enumerate(wheels):
        travel = table[f"{wheel}suspension deflection [m]"]
        assert own.travel[:, i] == pytest.approx(travel, rel=1e-9, abs=1e-12)
    seat = "sprung-mass" if known.car is None else "driver"
    felt = table[f"{seat} acceleration [m/s2]"]
    assert own.felt[0].acceleration == pytest.approx(felt, rel=1e-9, abs=1e-9)
    reading = own.felt[0].text.partition(" m/s², ")[2]
    assert f"weighted rms {own.felt[0].comfort:.4g} m/s2, {reading}\n" in said


@pytest.mark.parametrize("limit", [0.0, 0.05])
def test_a_loop_that_runs_away_is_not_shown(quarter, limit):
    K = np.array([[0.0, 0.0, 1e5, 0.0, 0.0]])
    with pytest.raises(InputError, match="runs away at|outgrows"):
        ridden(quarter.plant, None, K, quarter.values, "class C", 20.0, limit)


def test_which_plants_are_driven(subjects, tmp_path):
    for own in subjects.values():
        assert rides(own.plant, own.car)
    assert not rides(family("f16"), None)
    assert not rides(family("half-car"), None)
    assert all(re.match(r"--\w+", own.option) for own in ROADS.values())
    text = spec_text("half-car")
    tracks = re.sub(r"under = \[[^]]*\]", "\n[road.tracks]\norder = 2", text)
    (tmp_path / "car.toml").write_text(tracks)
    path = tmp_path / "car.toml"
    assert not rides(load(path), load_car(path))


def test_a_car_is_seen_from_where_its_wheels_are_apart():
    left, right = sides_of(np.array([[1.2, 0.7], [1.2, -0.7], [-1.4, 0.7], [-1.4, -0.7]]))
    assert (left.title, left.wheels, left.at) == ("left", (2, 0), (-1.4, 1.2))
    assert (right.title, right.wheels) == ("right", (3, 1))
    (side,) = sides_of(np.array([[1.2, 0.0], [-1.4, 0.0]]))
    assert side.along
    assert side.wheels == (1, 0)
    (behind,) = sides_of(np.array([[0.0, -0.7], [0.0, 0.7]]))
    assert not behind.along
    assert behind.wheels == (1, 0)
    (one,) = sides_of(np.zeros((1, 2)))
    assert one.along
    assert one.span == (-2.0, 2.0)


def test_a_car_that_rolls_alone_is_driven():
    def make(mass):
        wheel = {"mass": 30, "spring": 2e4, "damper": 1500, "tyre": 160000}
        wheels = [Wheel("port", y="0.7", **wheel), Wheel("starboard", y="-0.7", **wheel)]
        return OnWheels(Body(mass=mass, roll=100), wheels)

    plant = car_family(make, Parameter("mass", 400, 500, "kg", "1/mass"), name="roll")
    own = ridden(plant, make(400), None, {"mass": 450.0}, "class C", 20.0)
    assert np.ptp(own.road, axis=1).max() > 1e-3  # two sides
    assert own.felt[0].name == "body"
    pane = Car(plant, make(400), LIGHT)
    lines = pane.show(None, Looked((("mass", 450.0),)))
    assert [who for who, _ in lines] == ["passive, body"]
    assert pane.looked.figures[0].xaxis.axis_label == "to the right [m]"


@pytest.mark.parametrize(("name", "palette"), list(zip(NAMES, (DARK, LIGHT, LIGHT), strict=True)))
def test_the_pane_shows_and_says_it(subjects, name, palette):
    known = subjects[name]
    pane = Car(known.plant, known.car, palette)
    state = Looked(tuple(known.values.items()), travel_limit=0.02)
    design = known.law
    lines = pane.show(design, state)
    seat = "" if known.car is None else ", driver"
    assert [who for who, _ in lines] == [f"passive{seat}", f"with this law{seat}"]
    own = known.ridden(travel_limit=0.02)
    assert lines[1][1].startswith(f"{own.felt[0].text}; ")
    assert lines[1][1].endswith("passive")
    frames = pane.looked.frames["law"].data
    for i in range(own.travel.shape[1]):
        assert frames[f"travel {i}"] == pytest.approx(1e3 * own.travel[:, i], abs=1e-4)
        assert np.array_equal(frames[f"stopped {i}"], own.stopped[:, i])
    assert {*pane.limits.data["y"]} > {20.0, -20.0}
    assert len(pane.looked.figures) == (2 if name == "full-car" else 1)
    pane.clear()
    assert not len(pane.looked.frames["passive"].data["time"])
    pane.show(None, Looked(state.values))
    assert not len(pane.looked.frames["law"].data["time"])
    assert not len(pane.limits.data["y"])


@pytest.mark.parametrize("name", NAMES)
def test_each_load_is_beside_the_others(subjects, name):
    known = subjects[name]
    pane = Car(known.plant, known.car, LIGHT)
    state = Looked(tuple(known.values.items()), road="class B", beside=True)
    lines = pane.show(known.law, state)
    first = known.plant.parameters[0]
    values = (float(first.low), known.values[first.name], float(first.high))
    titles = [f"{first.name} = {value:.4g} kg" for value in values]
    assert [who.partition(",")[0] for who, _ in lines] == [own for own in titles for _ in range(2)]
    for scene, title, value in zip(pane.scenes, titles, values, strict=True):
        own = known.ridden("class B", **{first.name: value})
        assert scene.figures[0].title.text.partition(",")[0] == title
        assert scene.frames["law"].data["sprung 0"] == pytest.approx(own.sprung[:, 0], abs=1e-7)
        assert (f"{title}, with this law", own.felt[0].text) in [
            (who.removesuffix(", driver"), text.rpartition("; ")[0]) for who, text in lines
        ]
    assert len(pane.views[0].children[0].children) == 3
    pane.show(known.law, Looked(state.values))
    assert len(pane.views[0].children[0].children) == 1
    assert not len(pane.scenes[0].frames["passive"].data["time"])


def test_a_plant_without_parameters_is_beside_nothing(quarter, tmp_path):
    text = spec_text("quarter-car-physical")
    text = re.sub(r"(?s)\[parameter.m1\].*?(?=\[definitions\])", "", text)
    text = text.replace("[constants]", "[constants]\nm1 = 300\nbeta = 2")
    (tmp_path / "car.toml").write_text(text)
    pane = Car(load(tmp_path / "car.toml"), None, LIGHT)
    lines = pane.show(None, Looked((), beside=True))
    assert lines == (("passive", quarter.ridden(passive=True).felt[0].text),)


def test_names_have_no_control_characters(tmp_path):
    text = spec_text("half-car").replace("driver = [", '"driver" = [')
    text = text.replace("driver", "dri\u202ever")
    path = tmp_path / "car.toml"
    path.write_text(text)
    plant, car = load(path), load_car(path)
    pane = Car(plant, car, LIGHT)
    lines = pane.show(None, Looked(tuple((p.name, float(p.low)) for p in plant.parameters)))
    assert lines[0][0] == "passive, dri\\u202ever"
    assert "\u202e" not in pane.traces[0].yaxis.axis_label
