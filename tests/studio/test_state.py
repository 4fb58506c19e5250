"""States, their history, and the files of sessions."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from polefence import METHODS, Disk, HalfPlane, parse_region
from polefence.base.errors import SpecError
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.plant.spec import loads
from polefence.studio import History, Session, State, is_session, read_session
from polefence.studio.state import MOST_BACK

SPEC = spec_text("quarter-car-physical")


@pytest.fixture(scope="module")
def state():
    return State.first(loads(SPEC), Disk(-40, 31))


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
    (tmp_path / "my car.toml").write_text(SPEC)
    region = parse_region("half_plane(4) & sector(0.2) & disk(-30, 30)")
    own = State(region, "quadratic", values=state.values)
    words = shlex.split(own.command("my car.toml"))
    assert words[0] == "polefence"
    assert main(words[1:]) == 0
    found = {}
    exec(own.python("my car.toml", 4), found)
    assert found["design"].region == region
    assert found["design"].method == "quadratic"
    assert (tmp_path / "design" / "design.json").is_file()


def test_the_python_of_a_plant_without_parameters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = spec_text("f4e")
    plant = loads(text)
    assert not plant.parameters
    Path("f4e.toml").write_text(text)
    state, found = State.first(plant, HalfPlane(0.5)), {}
    exec(state.python("f4e.toml", len(plant.vertices)), found)
    assert found["K"].shape == plant.shape[::-1]


def test_a_session_is_read_as_it_was_written(state, tmp_path):
    path = tmp_path / "session.json"
    own = Session(SPEC, loads(SPEC), state.at("m1", 250.0))
    path.write_text(own.dumps())
    assert is_session(path)
    found = read_session(path)
    assert (found.spec, found.state) == (SPEC, own.state)
    assert found.plant.digest == own.plant.digest


def test_a_session_may_be_written_closer(state, tmp_path):
    path = tmp_path / "session.json"
    table = json.loads(Session(SPEC, loads(SPEC), state).dumps())
    path.write_text(json.dumps(table, separators=(",", ":")))
    assert is_session(path)
    assert read_session(path).state == state


@pytest.mark.parametrize("text", ["[" * 100_000, '{"format": "polefence studio", "spec": 1'])
def test_what_is_no_json_is_said(tmp_path, text):
    (tmp_path / "session.json").write_text(text)
    with pytest.raises(SpecError, match="no JSON"):
        read_session(tmp_path / "session.json")


@pytest.mark.parametrize("end", ["low", "high"])
def test_the_ends_of_an_interval_are_values_like_others(state, tmp_path, end):
    plant, path = loads(SPEC), tmp_path / "session.json"
    for p in plant.parameters:
        state = state.at(p.name, float(getattr(p, end)))
    path.write_text(Session(SPEC, plant, state).dumps())
    assert read_session(path).state == state


FAULTS = {
    "format": ("other", "format is not"),
    "spec": (None, "spec is missing"),
    "region": ("disk(1)", "takes 2 numbers"),
    "method": ("best", "method = 'best'"),
    "values": ({"m1": 1e9}, "m1 = 1000000000.0 must be a number from 231.12 to 346.68"),
    "road": ("class Z", "road = 'class Z'"),
    "speed": (50, "speed = 50 must be a number from 5 to 40 m/s"),
    "road ": ([], "road = []"),
    "speed ": (10**400, "must be a number from 5 to 40 m/s"),
    "more": (1, "unknown key 'more'"),
}


@pytest.mark.parametrize("key", FAULTS)
def test_a_bad_session_is_named_in_one_line(state, tmp_path, key):
    path = tmp_path / "session.json"
    table = json.loads(Session(SPEC, loads(SPEC), state).dumps())
    table[key.strip()], words = FAULTS[key]
    path.write_text(json.dumps(table))
    with pytest.raises(SpecError) as caught:
        read_session(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [True, "1", None, float("nan")])
def test_a_value_that_is_no_number_is_refused(state, tmp_path, value):
    path = tmp_path / "session.json"
    table = json.loads(Session(SPEC, loads(SPEC), state).dumps())
    path.write_text(json.dumps(table | {"values": {"beta": value}}))
    with pytest.raises(SpecError, match="beta"):
        read_session(path)


def test_methods_are_those_of_the_package(state):
    assert state.method == METHODS[-1]
