"""What `polefence studio` opens: a spec, a design with its law and its parameters, a session."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import polefence.studio
from polefence import Design, Disk, HalfPlane, Structure, load_specifications, optimise, place
from polefence.cli.main import main
from polefence.examples import spec_path, spec_text
from polefence.studio import Newest, Page, Session, State, first_region, question
from support.browser import until
from support.commands import refused
from support.studios import subject

pytest.importorskip("panel")


@pytest.fixture
def opened(monkeypatch, tmp_path):
    """Opens what the command opens, and returns what would be served."""
    monkeypatch.chdir(tmp_path)
    own = []
    monkeypatch.setattr(
        polefence.studio, "serve", lambda *served, **more: own.append((*served, more))
    )

    def run(*words):
        assert main(["studio", *words]) == 0
        *served, more = own.pop()
        return (*served[:3], more["found"])

    return run


def answered(own, state, found=None):
    told = []
    newest = Newest(own, told.append)
    if found is not None:
        newest.know(state.question, found)
    newest.ask(state.question)
    assert until(lambda: told and told[-1].final, patience=60)
    newest.close()
    return told[-1]


def test_a_spec_is_opened_as_it_stands(opened):
    Path("my car.toml").write_text(spec_text("quarter-car-physical"))
    own, state, folder, found = opened("my car.toml")
    assert (own.name, folder, found) == ("my car.toml", Path("studio"), None)
    assert state.region == first_region(own)
    assert not Path("studio").exists()


def test_a_design_is_opened_with_its_law_and_its_parameters(opened, physical, monkeypatch):
    design = place(physical, Disk(-40, 36), "quadratic")
    design.save("mine")
    own, state, _, found = opened("mine")
    assert own.plant.parameters == physical.parameters
    assert own.plant.digest == physical.digest
    assert Path(own.name) == Path("studio/plant.toml")
    assert Path(own.name).is_file()  # commands name it
    assert state.question.method == "quadratic"
    assert (found.design.law.K == design.law.K).all()
    monkeypatch.setattr(question, "place", lambda *own, **more: pytest.fail("searched anew"))
    answer = answered(own, state, found)
    assert answer.proved
    assert (answer.design.law.K == design.law.K).all()


def test_a_session_of_a_design_opens_again(opened, physical):
    place(physical, Disk(-40, 33)).save("mine")
    own, state, folder, _ = opened("mine")
    path = Session.of(own, state.at("m1", 250.0)).save(folder)
    again, other, _, found = opened(str(path))
    assert found is None
    assert other == state.at("m1", 250.0)
    assert again.plant.digest == own.plant.digest
    place(physical, Disk(-40, 33)).save("mine")


def test_a_design_with_bounds_shows_them(opened):
    own = subject("quarter-car-ride")
    least, limits = load_specifications(spec_path("quarter-car-ride"))
    structure = Structure(own.measured[:3], [])
    found = optimise(own.plant, least, limits, HalfPlane(0.5), structure=structure)
    found.save("ride")
    again, state, _, shown = opened("ride")
    assert len(shown.bounds) == 4
    assert all("<=" in text and "rms of" in text for text in shown.bounds)
    answer = answered(again, state, shown)
    assert answer.proved
    assert len(answer.check.claims) == 5


def test_another_region_is_searched_anew(opened, physical):
    place(physical, Disk(-40, 33)).save("mine")
    _, state, _, found = opened("mine", "--region", "disk(-40, 35)")
    assert found is None
    assert state.region == Disk(-40, 35)


def test_no_spec_is_written_over(opened, physical, capsys):
    place(physical, Disk(-40, 33)).save("mine")
    Path("studio").mkdir()
    Path("studio/plant.toml").write_text("name = 'another'")
    assert "studio/plant.toml: the spec of something else" in refused(capsys, "studio", "mine")
    assert Path("studio/plant.toml").read_text() == "name = 'another'"
    own, *_ = opened("mine", "-o", "elsewhere")
    assert Path(own.name) == Path("elsewhere/plant.toml")


def test_of_a_session_that_makes_no_sense_nothing_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("bad.json").write_text('{"format": "polefence studio", "spec": "name = 3"}')
    assert "bad.json" in refused(capsys, "studio", "bad.json")
    assert not Path("studio").exists()


def test_the_law_of_a_design_is_shown_first(opened, physical, tmp_path):
    design = place(physical, Disk(-40, 36), "quadratic")
    design.save("mine")
    own, state, folder, found = opened("mine")
    page = Page(own, state, folder, found=found)
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    assert (page.answer.design.law.K == design.law.K).all()
    page.region.value = "disk(-40, 38)"
    assert until(lambda: "proved: all poles in disk(-40, 38)" in page.badge.object)
    page.back.clicks += 1
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    assert (page.answer.design.law.K == design.law.K).all()
    page.close()


def test_a_spec_with_a_law_begins_with_a_region_that_it_keeps(opened):
    Path("two.toml").write_text(spec_text("active-suspension-ride").replace("region =", "# region"))
    own, state, _, _ = opened("two.toml")
    assert own.structure is not None
    assert state.region == HalfPlane(0.0)
    assert isinstance(answered(own, state).design, Design)


def test_a_road_with_tracks_is_measured_by_no_law(opened):
    text = re.sub("under = .*", "tracks = { order = 1 }", spec_text("half-car"))
    Path("half.toml").write_text(text)
    own, state, _, _ = opened("half.toml", "--region", "half_plane(0)")
    assert len(own.measured) < own.plant.shape[0]
    assert state.question.measured == own.measured
    assert state.question.structure(own).measured == own.measured
    assert "--measured" in state.question.command(own)
    assert State.first(own, HalfPlane(0.0)) == state
