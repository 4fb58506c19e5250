"""Files of sessions: what was written is read, and nothing that makes no sense."""

import json
from dataclasses import replace

import pytest

from polefence import Disk, HalfPlane, place
from polefence.base.errors import InputError, OutputError, SpecError
from polefence.examples import spec_text
from polefence.studio import Session, State, is_session, put_spec
from support.studios import subject


@pytest.fixture(scope="module")
def state():
    return State.first(subject(), Disk(-40, 31))


def read(path, own=None):
    return Session.read(path).state(own or subject(), path)


def test_a_session_is_read_as_it_was_written(state, tmp_path):
    state = replace(state.at("m1", 250.0), travel_limit=0.08, beside=True, road="hill, 6 %")
    path = Session.of(subject(), state).save(tmp_path)
    assert is_session(path)
    assert Session.read(path).text == subject().text
    assert read(path) == state


def test_a_session_of_the_ride_too(tmp_path):
    own = subject("quarter-car-ride")
    state = State.first(own, HalfPlane(1), method="quadratic").asking(
        ride=True, over="rms of actuator force", limit=200.0, measured=own.signals[:2]
    )
    path = Session.of(own, state).save(tmp_path)
    assert read(path, own) == state


def test_a_session_may_be_written_closer(state, tmp_path):
    path = tmp_path / "session.json"
    table = json.loads(Session.of(subject(), state).dumps())
    path.write_text(json.dumps(table, separators=(",", ":")))
    assert is_session(path)
    assert read(path) == state


def test_a_long_spec_is_written_and_read(state, tmp_path):
    own = replace(subject(), text=subject().text + "# \u00e4" * 250_000)
    path = Session.of(own, state).save(tmp_path)
    assert path.stat().st_size > 1_000_000
    assert is_session(path)
    assert Session.read(path).text == own.text


@pytest.mark.parametrize("text", ["[" * 100_000, '{"format": "polefence studio", "spec": 1'])
def test_what_is_no_json_is_said(tmp_path, text):
    (tmp_path / "session.json").write_text(text)
    with pytest.raises(SpecError, match="no JSON"):
        read(tmp_path / "session.json")


@pytest.mark.parametrize("end", ["low", "high"])
def test_the_ends_of_an_interval_are_values_like_others(state, tmp_path, end):
    for p in subject().plant.parameters:
        state = state.at(p.name, float(getattr(p, end)))
    path = Session.of(subject(), state).save(tmp_path)
    assert read(path) == state


def test_the_law_of_a_design_is_that_of_the_file_beside_the_session(state, tmp_path):
    own = state.asking(given=str(tmp_path / "mine"))
    path = Session.of(subject(), own).save(tmp_path)
    with pytest.raises(InputError, match="has no design.json|cannot be read"):
        read(path)
    place(subject().plant, Disk(-40, 31)).save(tmp_path / "design")
    assert read(path) == state.asking(given=str(tmp_path / "design"))
    place(subject("f16").plant, HalfPlane(0.5)).save(tmp_path / "design")
    with pytest.raises(SpecError, match="is of another plant"):
        read(path)


FAULTS = {
    "spec ": ("name = '\ud800'", "spec is missing, or no text"),
    "given": ("elsewhere", "given = 'elsewhere' must be true or false"),
    "format": ("other", "format is not"),
    "spec": (None, "spec is missing"),
    "region": ("disk(1)", "takes 2 numbers"),
    "region ": (3, "region = 3 must be a region"),
    "method": ("best", "method = 'best'"),
    "measured": (["speed of sound"], "measured: no signal 'speed of sound'"),
    "measured ": ([], "give at least one signal"),
    "measured  ": ("tyre deflection", "must be a list of names"),
    "ride": (1, "ride = 1 must be true or false"),
    "over": ("rms of nothing", "over = 'rms of nothing'"),
    "limit": (-1, "limit = -1 must be a positive number"),
    "limit ": (5.0, "over and limit go together"),
    "beside": ("yes", "beside = 'yes' must be true or false"),
    "travel_limit": (3.0, "travel_limit = 3.0 must be a number from 0 to 0.2"),
    "values": ({"m1": 1e9}, "m1 = 1000000000.0 must be a number from 231.12 to 346.68"),
    "road": ("class Z", "road = 'class Z'"),
    "speed": (50, "speed = 50 must be a number from 5 to 40"),
    "road ": ([], "road = a list"),
    "speed ": (10**400, "must be a number from 5 to 40"),
    "more": (1, "unknown key 'more'"),
}


@pytest.mark.parametrize("key", FAULTS)
def test_a_bad_session_is_named_in_one_line(state, tmp_path, key):
    path = tmp_path / "session.json"
    table = json.loads(Session.of(subject(), state).dumps())
    table[key.strip()], words = FAULTS[key]
    path.write_text(json.dumps(table))
    with pytest.raises(SpecError) as caught:
        read(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [True, "1", None, float("nan")])
def test_a_value_that_is_no_number_is_refused(state, tmp_path, value):
    path = tmp_path / "session.json"
    table = json.loads(Session.of(subject(), state).dumps())
    path.write_text(json.dumps(table | {"values": {"beta": value}}))
    with pytest.raises(SpecError, match="beta"):
        read(path)


def test_no_file_of_another_is_written_over(state, tmp_path):
    (tmp_path / "session.json").write_text('{"mine": 1}')
    with pytest.raises(OutputError, match="not a Polefence file"):
        Session.of(subject(), state).save(tmp_path)
    (tmp_path / "session.json").unlink()
    (tmp_path / "session.json").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="is a symbolic link"):
        Session.of(subject(), state).save(tmp_path)
    assert not (tmp_path / "elsewhere").exists()


def test_a_spec_is_put_where_no_other_is(tmp_path):
    path = put_spec(tmp_path / "studio", "name = 'a'")
    assert path.read_text() == "name = 'a'"
    assert put_spec(tmp_path / "studio", "name = 'a'") == path
    with pytest.raises(InputError, match="the spec of something else; use -o"):
        put_spec(tmp_path / "studio", spec_text("f16"))
    assert path.read_text() == "name = 'a'"
    path.unlink()
    path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="use -o"):
        put_spec(tmp_path / "studio", "name = 'a'")
    assert not (tmp_path / "elsewhere").exists()
