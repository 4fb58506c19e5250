"""Roads under several wheels: later behind, alike or not on both sides, against known motion."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import coherence, welch

from polefence import InputError
from polefence.cli.main import main
from polefence.examples import family, spec_path, spec_text
from polefence.plant.spec import load_car
from polefence.response.discrete import Sampling
from polefence.response.stationary import velocity_density
from polefence.vehicle import (
    Hardware,
    Road,
    both_sides,
    drive,
    excited,
    kerb,
    on_wheels,
    random_road,
)
from polefence.vehicle.contact import static_loads
from polefence.vehicle.driving.drive import Setup, run

SPEED, STEP = 20.0, 1e-3


@pytest.fixture(scope="module")
def full():
    return family("full-car"), load_car(spec_path("full-car"))


@pytest.fixture(scope="module")
def half():
    return family("half-car"), load_car(spec_path("half-car"))


def test_wheels_behind_see_the_road_later_and_end_at_its_heights(full):
    plant, car = full
    road = random_road("C", 60, 1)
    w = on_wheels(plant, car.places, road, SPEED, STEP, 2.0).w
    xs = [float(x) for x, _ in car.places.values()]
    height = np.cumsum(w, axis=0) * STEP
    at = SPEED * STEP * np.arange(1, len(w) + 1)
    for column, x in enumerate(xs):
        own = np.interp(at - (max(xs) - x), road.distance, road.height)
        assert height[:, column] == pytest.approx(own - road.height[0], abs=1e-12)
    assert w[:, 0] == pytest.approx(w[:, 1])  # both sides alike


def test_one_road_under_both_sides_does_not_roll_a_car(full, half):
    road = random_road("C", 80, 2)
    plant, car = full
    found = drive(plant, None, on_wheels(plant, car.places, road, SPEED, STEP, 3.0))
    assert np.abs(found.of("roll over the road")).max() < 1e-12
    assert np.abs(found.of("pitch over the road")).max() > 1e-3
    # the half car is half of this one
    other, own = half
    alone = drive(other, None, on_wheels(other, own.places, road, SPEED, STEP, 3.0))
    for name in ("heave acceleration", "pitch acceleration"):
        one, two = (d.response([name]).values for d in (found, alone))
        assert one == pytest.approx(two, abs=2e-2 * np.abs(two).max())


def test_a_kerb_is_stood_on_in_the_end(full):
    plant, car = full
    road = kerb(0.05, before=1.0, after=60.0)
    found = drive(plant, None, on_wheels(plant, car.places, road, 10.0, STEP, 6.0))
    assert np.abs(found.states[0, -1]).max() < 1e-3
    rise = np.cumsum(on_wheels(plant, car.places, road, 10.0, STEP, 6.0).w, axis=0)[-1] * STEP
    assert rise == pytest.approx(np.full(4, 0.05))


def test_both_sides_are_of_the_class_and_coherent_in_long_waves():
    width = 1.2
    pairs = [both_sides(*(random_road("C", 400, 2 * k + j) for j in (0, 1)), width)
             for k in range(12)]  # fmt: skip
    rate = 1 / np.diff(pairs[0][0].distance).mean()
    slopes = [[np.diff(side.height) * rate for side in pair] for pair in pairs]
    left, right = (np.concatenate([pair[i] for pair in slopes]) for i in (0, 1))
    size = int(40 * rate)
    waves, density = welch(left, rate, nperseg=size)
    inside = (waves > 0.1) & (waves < 2)
    wanted = velocity_density("C", 1.0)
    assert np.mean(density[inside]) == pytest.approx(wanted, rel=0.1)
    assert np.mean(welch(right, rate, nperseg=size)[1][inside]) == pytest.approx(wanted, rel=0.1)
    waves, found = coherence(left, right, rate, nperseg=size)
    known = 1 / (1 + (2 * np.pi * waves * width) ** 2) ** 2  # squared
    assert np.abs(found - known)[(waves > 0.05) & (waves < 1)].mean() < 0.06


def test_a_full_car_is_driven_from_the_command_line(tmp_path, capsys):
    spec = tmp_path / "full.toml"
    spec.write_text(spec_text("full-car"))
    words = ["simulate", str(spec), "--road", "C", "--speed", "20", "--duration", "2"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "rear right tyre force variation [N]" in out
    assert "driver: comfort (ISO 2631-1): weighted rms" in out
    assert "no limit was met" in out
    assert "note: springs at their end are not looked for on several wheels" in out
    assert main(["simulate", str(spec), "--kerb", "0.1", "--speed", "10"]) == 0
    out = capsys.readouterr().out
    assert "no limit was met" not in out
    for wheel in ("front left", "front right", "rear left", "rear right"):
        assert f"the {wheel} tyre leaves the road, which the equations do not know; first at" in out
    figure = tmp_path / "full.png"
    assert main([*words, "--plot", str(figure), "--sampling", "0.002"]) == 0
    assert figure.exists()
    assert "springs at their end are not looked for" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "body", "each"), [("full-car", 965.7, 2), ("half-car", 482.85, 1)]
)
def test_static_loads_are_those_of_a_beam(name, body, each):
    """Moments about the rear axle, with the load where it sits."""
    plant, car = family(name), load_car(spec_path(name))
    front, rear, place, wheel = 1.156, 1.423, -0.9, 31.9
    for own in plant.parameters:
        if own.name == "felt":
            masses = [float(own.low), float(own.high)]
    for felt in masses:
        setup = Setup(plant, excited(plant, 1.0, 0.1), {"felt": felt, "age": 0.05})
        load = felt - float(car.body.empty)
        moment = 9.81 * (body * rear + load * (rear + place))
        ahead = moment / (front + rear)
        behind = 9.81 * (body + load) - ahead
        wanted = [force / each + 9.81 * wheel for force in (ahead, behind) for _ in range(each)]
        assert static_loads(plant, car, setup.alpha)[0] == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("hardware", [Hardware(), Hardware(sampling=Sampling(0.002))])
def test_a_wheel_lifts_where_its_tyre_would_pull_and_only_there(half, hardware):
    plant, car = half

    def driven(height):
        road = kerb(height, before=1.0, after=30.0)
        moved = on_wheels(plant, car.places, road, 10.0, STEP)
        return run(Setup(plant, moved, hardware=hardware, car=car), None)

    once = driven(1e-3)
    assert not once.events
    loads = static_loads(plant, car, once.setup.alpha)[0]
    sizes = [-once.response.of(f"{own.name} tyre force variation").min() for own in car.wheels]
    heights = 1e-3 * loads / np.array(sizes)  # at which each begins to pull
    for i, height in enumerate(heights):
        text = f"the {car.wheels[i].name} tyre leaves the road"
        for share, lifts in ((0.999, False), (1.001, True)):
            events = driven(share * height).events
            assert all(own.kind == "road" for own in events)
            assert any(own.text.startswith(text) for own in events) == lifts


def test_a_car_brakes_and_corners_on_its_road(tmp_path, capsys):
    spec, rows = tmp_path / "full.toml", tmp_path / "rows.csv"
    spec.write_text(spec_text("full-car").replace("roll_inertia", "height = 0.55\nroll_inertia"))
    words = ["simulate", str(spec), "--grade", "0.05", "40", "--speed", "20", "-o", str(rows)]
    assert main([*words, "--step-in", "braking=2", "--step-in", "cornering=-1"]) == 0
    assert "full car: grade, at 20 m/s, braking 2 m/s2, cornering -1 m/s2, 5 s" in " ".join(
        capsys.readouterr().out.split()
    )
    labels, *_, last = rows.read_text().splitlines()
    found = dict(zip(labels.split(","), map(float, last.split(",")), strict=True))
    body, a, h, apart = 965.7, 2.0, 0.55, 1.156 + 1.423
    ahead = sum(found[f"front {side} tyre force variation [N]"] for side in ("left", "right"))
    assert ahead == pytest.approx(body * a * h / apart, rel=3e-3)
    right = sum(found[f"{end} right tyre force variation [N]"] for end in ("front", "rear"))
    assert right < -300  # the turn is to the right
    assert found["road height [m]"] == pytest.approx(2.0)
    for more, said in (
        (["--step-in", "front left road velocity=1"], "beside a road a car has braking and corner"),
        (["--impulse-in", "braking=1"], "a road is all that moves a car; leave out the other"),
    ):
        assert main([*words, *more]) == 2
        assert said in capsys.readouterr().err
    flat = tmp_path / "flat.toml"
    flat.write_text(spec_text("full-car"))
    assert main(["simulate", str(flat), *words[2:], "--step-in", "braking=2"]) == 2
    assert "(--step-in braking=3 needs the height of car.body)" in capsys.readouterr().err


def test_tracks_are_not_driven(tmp_path, capsys):
    spec = tmp_path / "tracks.toml"
    text = re.sub(r"under = \[[^\]]*\]\n", "[road.tracks]\n", spec_text("half-car"))
    spec.write_text(text)
    assert main(["simulate", str(spec), "--road", "C", "--speed", "20"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"polefence: {spec}: road.tracks: a drive has the delays")
    assert said.count("\n") == 1


def test_what_is_no_road_of_the_car_is_refused(half):
    plant, car = half
    road = Road([0, 100], [0, 0])
    with pytest.raises(InputError, match="no disturbance 'front road'"):
        on_wheels(plant, {"front road": (1, 0)}, road, SPEED, STEP)
    front = dict(list(car.places.items())[:1])
    with pytest.raises(InputError, match="'rear road velocity' is a road too"):
        on_wheels(plant, front, road, SPEED, STEP)
    with pytest.raises(InputError, match="points must be the same, equally apart"):
        both_sides(random_road("C", 100, 1), random_road("C", 200, 1), 1.0)
