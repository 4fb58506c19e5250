"""Roads under several wheels: later behind, alike or not on both sides, against known motion."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import coherence, welch

from polefence import InputError
from polefence.cli.main import main
from polefence.examples import family, spec_path, spec_text
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_states
from polefence.plant.outputs import states
from polefence.plant.spec import load_car
from polefence.response.discrete import Sampling
from polefence.response.stationary import velocity_density
from polefence.vehicle import (
    Body,
    BumpStops,
    Car,
    Hardware,
    Ramp,
    Road,
    Wheel,
    both_sides,
    car_family,
    disturbed,
    drive,
    excited,
    kerb,
    on_wheels,
    random_road,
)
from polefence.vehicle.contact import static_loads
from polefence.vehicle.driving.drive import Setup, run, signals
from polefence.vehicle.vehicle import SIGNALS, quarter_car
from support.commands import ran, refused

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
    out = ran(capsys, *words)
    assert "rear right tyre force variation [N]" in out
    assert "driver: comfort (ISO 2631-1): weighted rms" in out
    assert "driver:   with roll and pitch: vibration total value " in out
    assert "no limit was met" in out
    out = ran(capsys, "simulate", spec, "--kerb", "0.1", "--speed", "10")
    assert "no limit was met" not in out
    for wheel in ("front left", "front right", "rear left", "rear right"):
        assert f"the {wheel} tyre leaves the road, which the equations do not know; first at" in out
    figure = tmp_path / "full.png"
    assert main([*words, "--plot", str(figure), "--sampling", "0.002"]) == 0
    assert figure.exists()
    capsys.readouterr()
    rows = tmp_path / "rows.csv"
    kerb_at_speed = ["--kerb", "0.1", "--speed", "10", "--travel-limit", "0.05"]
    assert "front left bump stop hit, " in ran(capsys, *words[:2], *kerb_at_speed, "-o", rows)
    head = rows.read_text().partition("\n")[0]
    for wheel in ("front left", "front right", "rear left", "rear right"):
        assert f"{wheel} stop force [N]" in head


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
        # states of a law are at rest
        larger = static_loads(with_states(plant, 2), car, setup.alpha)[0]
        assert larger == pytest.approx(wanted, rel=1e-9)


def test_stops_push_between_each_wheel_and_the_body(half):
    """Newton and Euler for the body, and every wheel, of the car without a load."""
    plant, car = half
    mass, inertia, seat = 482.85, 783.0, 0.1
    k, c, tyre, m = [24445, 19629], [1786, 1649], 158240, 31.9
    x = np.array([1.156, -1.423])
    stops = BumpStops(0.02, 0.015, 2e5, 500.0)
    moved = on_wheels(plant, car.places, kerb(0.08, before=1.0, after=20.0), 10.0, STEP)
    own = {"felt": float(car.body.empty), "age": 0.0}
    found = drive(plant, None, moved, own, Hardware(stops=stops), outside=True, car=car)
    of = {signal.name: found.of(signal.name)[0] for signal in signals(plant)}
    s = np.stack([of[f"{end} suspension deflection"] for end in ("front", "rear")])
    wheel = np.stack([of[f"{end} wheel velocity"] for end in ("front", "rear")])
    speed = wheel - (of["heave rate"] - x[:, None] * of["pitch rate"])
    stop = found.stop_forces[0].T
    assert stop == pytest.approx(stops.force(s, speed), abs=1e-6)
    assert (np.abs(stop).max(axis=1) > 100).all()
    force = np.array(k)[:, None] * s + np.array(c)[:, None] * speed + stop
    heave, pitch = force.sum(axis=0) / mass, -(x @ force) / inertia
    assert of["heave acceleration"] == pytest.approx(heave, rel=1e-9, abs=1e-9)
    assert of["pitch acceleration"] == pytest.approx(pitch, rel=1e-9, abs=1e-9)
    assert of["driver acceleration"] == pytest.approx(heave - seat * pitch, rel=1e-9, abs=1e-9)
    for i, end in enumerate(("front", "rear")):
        place = [own.name for own in states(plant)].index(f"{end} wheel velocity")
        moves = (tyre * of[f"{end} tyre deflection"] - force[i]) / m
        assert found.rates[0, :, place] == pytest.approx(moves, rel=1e-9, abs=1e-9)
    said = [event.text for event in found.events if event.kind == "stops"]
    assert [text.partition(" stop hit, ")[0] for text in said] == ["front bump", "rear bump"]


def test_one_wheel_with_stops_is_a_quarter_car():
    parts = {"spring": 10000, "damper": 850, "tyre": 155900}
    car = Car(Body(mass=288.9), [Wheel("w", mass=28.58, **parts)])
    plant = car_family(lambda: car, ())
    A, B, E = (np.array(M, float) for M in quarter_car(288.9, 28.58, 10000, 155900, 850))
    other = UncertainPlant.from_vertices([A], [B], [E], **SIGNALS)
    stops, w = BumpStops(0.02, 0.015, 2e5, 500.0), np.repeat([2.0, -1.5, 0.0], 100)
    own, theirs = (
        drive(one, None, disturbed(one, w, STEP), None, Hardware(stops=stops), car=known)
        for one, known in ((plant, car), (other, None))
    )
    assert np.abs(theirs.stop_force).max() > 1000
    assert own.stop_force == pytest.approx(theirs.stop_force, rel=1e-6, abs=1e-4)
    lift = own.of("heave acceleration")
    assert lift == pytest.approx(theirs.of("sprung-mass acceleration"), rel=1e-6, abs=1e-6)


def test_a_car_with_stops_must_be_the_plants(half):
    plant, _ = half
    other = Car(Body(mass=300), [Wheel("w", mass=30, spring=1e4, damper=1e3, tyre=1e5)])
    moved = excited(plant, 0.1, STEP)
    with pytest.raises(InputError, match="half car is not the plant of this car: it has no 'w "):
        drive(plant, None, moved, None, Hardware(stops=BumpStops()), car=other)
    with pytest.raises(InputError, match="half car is not described as a car"):
        drive(replace(plant, car=None), None, moved, None, Hardware(stops=BumpStops()))


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


def test_a_drive_of_several_cars_says_which_wheel_lifts(half):
    """What each car's own drive says, at its own load; of loads that move too."""
    plant, car = half
    moved = on_wheels(plant, car.places, kerb(0.1), SPEED, STEP)
    loads = ({"felt": 330.0, "age": 0.0}, {"felt": 420.0, "age": 0.0})
    both = drive(plant, None, moved, list(loads), car=car)
    lifted = [own for own in both.events if own.kind == "road"]
    assert {own.car for own in lifted} == {0, 1}
    for k, load in enumerate(loads):
        (alone, *_), mine = run(Setup(plant, moved, load, car=car), None).events, lifted
        first = next(own for own in mine if own.car == k)
        assert (first.first, first.text) == (alone.first, alone.text)
    moving = {"felt": Ramp(330, 420, 0.0, 0.1), "age": 0.0}
    (own, *_) = drive(plant, None, moved, moving, car=car).events
    assert "tyre leaves the road" in own.text
    assert not drive(plant, None, moved, loads[0]).events


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
        assert said in refused(capsys, *words, *more)
    flat = tmp_path / "flat.toml"
    flat.write_text(spec_text("full-car"))
    assert main(["simulate", str(flat), *words[2:], "--step-in", "braking=2"]) == 2
    assert "(--step-in braking=3 needs the height of car.body)" in capsys.readouterr().err


def test_tracks_are_not_driven(tmp_path, capsys):
    spec = tmp_path / "tracks.toml"
    text = re.sub(r"under = \[[^\]]*\]\n", "[road.tracks]\n", spec_text("half-car"))
    spec.write_text(text)
    said = refused(capsys, "simulate", spec, "--road", "C", "--speed", "20")
    assert said.startswith(f"polefence: {spec}: road.tracks: a drive has the delays")


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
