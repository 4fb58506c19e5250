"""States, their history, and the commands and the Python that give what is shown."""

import shlex
from dataclasses import replace

import pytest

from polefence import METHODS, Disk, HalfPlane, Structure, parse_region, place
from polefence.certify.design import read_document
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.studio import History, State
from polefence.studio.rides import EVERY, ridden, wheels_of
from polefence.studio.state import MOST_BACK
from support.once import searched_once  # noqa: F401
from support.studios import subject, written


@pytest.fixture(scope="module")
def state():
    return State.first(subject(), Disk(-40, 31))


def test_a_session_begins_in_the_middle_of_all_intervals(state):
    assert dict(state.values) == {"m1": pytest.approx(288.9), "beta": 0}


def test_undoing_and_doing_again(state):
    other = state.at("m1", 300.0)
    own = History(state).then(other).then(other)
    assert own.past == (state,)
    assert own.back().now == state
    assert own.back().back() == own.back()
    assert own.back().forward() == own
    assert own.forward() == own
    assert own.back().then(state.at("beta", 1.0)).future == ()


def test_so_many_steps_are_kept(state):
    own = History(state)
    for k in range(MOST_BACK + 10):
        own = own.then(state.at("m1", 250.0 + k / 10))
    assert len(own.past) == MOST_BACK


def test_the_command_and_the_python_design_what_is_shown(state, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = written("", spec_text("quarter-car-physical"), "my car.toml")
    region = parse_region("half_plane(4) & sector(0.2) & disk(-30, 30)")
    state = State.first(own, region, method="quadratic")
    words = shlex.split(state.question.command(own))
    assert words[0] == "polefence"
    assert main(words[1:]) == 0
    found = {}
    exec(state.python(own), found)
    assert found["design"].region == region
    assert found["design"].method == "quadratic"
    assert (tmp_path / "design" / "design.json").is_file()


FREE = """
[law]
measured = ["suspension deflection", "sprung-mass velocity", "unsprung-mass velocity"]
schedule = []
"""
ASKED = {
    "one gain": ("", {"method": "quadratic", "ride": True}),
    "scheduled": ("", {"ride": True}),
    "fewer sensors": ("", {"measured": ("suspension deflection", "sprung-mass velocity")}),
    "limit": ("", {"ride": True, "over": "rms of actuator force", "limit": 200.0}),
    "law": (FREE, {"ride": True}),
    "law, other sensors": (FREE, {"measured": ("tyre deflection", "unsprung-mass velocity")}),
}


@pytest.mark.parametrize("name", ASKED)
def test_all_that_is_asked_has_its_command_and_its_python(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    more, changed = ASKED[name]
    own = written("", spec_text("quarter-car-ride") + more)
    region = parse_region("half_plane(0.5) & sector(0.1)")
    asked = State.first(own, region).asking(**{"method": "quadratic"} | changed).question
    shown = asked.search(own).design.law
    assert main(shlex.split(asked.command(own))[1:]) == 0
    document = read_document(tmp_path / "design" / "design.json")
    assert len(document.claims) == (5 if asked.ride else 1)
    found = {}
    exec(asked.python(own), found)
    alpha = [0.1, 0.2, 0.3, 0.4]
    assert found["design"].law.gain(alpha) == pytest.approx(shown.gain(alpha), rel=1e-9)
    from polefence import Design

    again = Design.load(tmp_path / "design")
    assert again.law.gain(alpha) == pytest.approx(shown.gain(alpha), rel=1e-9)


RIDES = {
    "quarter-car-physical": ("class B", 0.0),
    "half-car": ("kerb, 40 mm", 0.03),
    "full-car": ("class C", 0.0),
}


@pytest.mark.parametrize("name", RIDES)
def test_the_python_of_a_ride_drives_what_is_shown(name):
    own = subject(name)
    road, limit = RIDES[name]
    state = replace(State.first(own, HalfPlane(0.5)), road=road, travel_limit=limit)
    found = {}
    exec(f"{state.python(own)}\n{state.drive_python(own)}".replace("design.save", "str"), found)
    shown = ridden(
        own.plant, own.car, found["design"], dict(state.values), road, state.speed, limit
    )
    names = wheels_of(own.car)[0]
    force = "actuator force" if own.car is None else f"{names[0]} force"
    driven = found["ride"].of(force)[0, ::EVERY]
    size = abs(shown.force[:, 0]).max()
    assert size > 1
    assert driven == pytest.approx(shown.force[:, 0], abs=2e-3 * size)


def test_a_limit_takes_the_place_of_that_of_the_spec():
    own = subject("quarter-car-ride")
    asked = State.first(own, HalfPlane(0)).asking(ride=True).question
    other = State.first(own, HalfPlane(0)).asking(
        ride=True, over="rms of actuator force", limit=100.0
    )
    free = [bound.rpartition("<= ")[2] for bound in asked.search(own).bounds]
    held = other.question.search(own).bounds
    assert float(held[0].rpartition("<= ")[2]) > float(free[0])
    assert "rms of actuator force <= 100" in held
    assert len(held) == 4


def test_every_signal_is_an_lmi_and_fewer_are_tuned():
    own = subject()
    asked = State.first(own, Disk(-40, 31)).question
    assert asked.structure(own) is None
    fewer = State.first(own, Disk(-40, 31)).asking(measured=own.measured[:2], method="quadratic")
    assert fewer.question.structure(own) == Structure(measured=own.measured[:2], schedule=())


def test_of_a_law_that_is_given_the_file_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = written("", spec_text("quarter-car-physical"))
    design = place(own.plant, Disk(-40, 36), "quadratic")
    design.save("my law")
    state = State.first(own, Disk(-40, 36), given="my law")
    assert main(shlex.split(state.question.command(own))[1:]) == 0
    assert "--law 'my law'" in state.drive(own)
    found = {}
    exec(state.python(own), found)
    assert (found["design"].law.K == design.law.K).all()
    assert not state.asking(method="slack").question.given


def test_names_with_commas_are_quoted(tmp_path):
    text = spec_text("servo").replace("load speed", "speed, of the load")
    own = written(tmp_path, text)
    asked = State.first(own, HalfPlane(1)).asking(measured=own.measured[:2]).question
    words = shlex.split(asked.command(own))
    assert words[words.index("--measured") + 1] == 'load angle, "speed, of the load"'


def test_the_python_of_a_plant_without_parameters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own, found = written("", spec_text("f4e"), "f4e.toml"), {}
    assert not own.plant.parameters
    exec(State.first(own, HalfPlane(0.5)).python(own), found)
    assert found["K"].shape == own.plant.shape[::-1]


def test_methods_are_those_of_the_package(state):
    assert state.question.method == METHODS[-1]
