"""What `polefence studio` opens: a spec, a design with its law and its parameters, a session."""

import re
from pathlib import Path

import pytest

import polefence.studio
from polefence import (
    Design,
    Disk,
    HalfPlane,
    Structure,
    load_specifications,
    optimise,
    parse_region,
    place,
    z_plane,
)
from polefence.cli.main import main
from polefence.examples import spec_path, spec_text
from polefence.studio import Newest, Page, State, first_region, question
from polefence.studio.taking import save
from support.browser import until
from support.commands import refused
from support.studios import subject

pytest.importorskip("panel")

EVEN = [0.25] * 4


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
        return own.pop()[:3]

    return run


def answered(own, state):
    told = []
    newest = Newest(own, told.append)
    newest.ask(state.question)
    assert until(lambda: told and told[-1].final, patience=60)
    newest.close()
    return told[-1]


def test_a_spec_is_opened_as_it_stands(opened):
    Path("my car.toml").write_text(spec_text("quarter-car-physical"))
    own, state, folder = opened("my car.toml")
    assert (own.name, folder) == ("my car.toml", Path("studio"))
    assert state.region == first_region(own)
    assert not Path("studio").exists()


def test_a_region_of_continuous_time_is_shown_in_the_z_plane(opened):
    asked = "half_plane(1) & sector(0.5)"
    text = 'name = "cart"\nsample_time = 0.05\n[matrices]\n'
    matrices = "A = [[1, 0.05], [0, 1]]\nB = [[0.0005], [0.02]]\n"
    Path("cart.toml").write_text(f'region = "{asked}"\n{text}{matrices}')
    assert opened("cart.toml")[1].region == z_plane(parse_region(asked), 0.05)
    other = z_plane(parse_region("sector(0.7)"), 0.05)
    assert opened("cart.toml", "--region", "sector(0.7)")[1].region == other


def test_a_design_is_opened_with_its_law_and_its_parameters(opened, physical, monkeypatch):
    design = place(physical, Disk(-40, 36), "quadratic")
    design.save("mine")
    own, state, _ = opened("mine")
    assert own.plant.parameters == physical.parameters
    assert own.plant.digest == physical.digest
    assert Path(own.name) == Path("studio/plant.toml")
    assert Path(own.name).is_file()  # commands name it
    assert state.question.method == "quadratic"
    monkeypatch.setattr(question, "place", lambda *own, **more: pytest.fail("searched anew"))
    answer = answered(own, state)
    assert answer.proved
    assert (answer.design.law.K == design.law.K).all()


def test_a_session_of_a_design_opens_again(opened, physical):
    place(physical, Disk(-40, 33)).save("mine")
    own, state, folder = opened("mine")
    state, answer = state.at("m1", 250.0), answered(own, state)
    path, *_ = save(folder, own, state, answer)
    again, other, _ = opened(str(path))
    assert other == state.asking(given=str(folder / "design"))
    assert again.plant.digest == own.plant.digest
    assert (answered(again, other).design.law.gain(EVEN) == answer.design.law.gain(EVEN)).all()


def test_a_law_that_is_not_proved_is_shown_and_not_saved(opened, physical):
    design = place(physical, Disk(-40, 20), allow_unproved=True)
    document = design.certificate.file()
    Path("mine").mkdir()
    Path("mine/design.json").write_text(document.dumps())
    own, state, folder = opened("mine")
    answer = answered(own, state)
    assert answer.check.answer == "refuted"
    path, *more = save(folder, own, state, answer)
    assert not more
    assert not opened(str(path))[1].question.given


def test_a_design_with_bounds_shows_them(opened):
    own = subject("quarter-car-ride")
    least, limits = load_specifications(spec_path("quarter-car-ride"))
    structure = Structure(own.measured[:3], [])
    found = optimise(own.plant, least, limits, HalfPlane(0.5), structure=structure)
    found.save("ride")
    again, state, _ = opened("ride")
    assert state.question.measured == own.measured[:3]
    assert state.question.method == "quadratic"
    assert state.question.command(again) == "polefence check ride"
    answer = answered(again, state)
    bounds = answer.result.bounds
    assert len(bounds) == 4
    assert all("<=" in text and "rms of" in text for text in bounds)
    assert answer.proved
    assert len(answer.check.claims) == 5


def test_another_region_is_searched_anew(opened, physical):
    place(physical, Disk(-40, 33)).save("mine")
    _, state, _ = opened("mine", "--region", "disk(-40, 35)")
    assert not state.question.given
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
    own, state, folder = opened("mine")
    page = Page(own, state, folder)
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
    own, state, _ = opened("two.toml")
    assert own.structure is not None
    assert state.region == HalfPlane(0.0)
    assert isinstance(answered(own, state).design, Design)


def test_a_road_with_tracks_is_measured_by_no_law(opened):
    text = re.sub("under = .*", "tracks = { order = 1 }", spec_text("half-car"))
    Path("half.toml").write_text(text)
    own, state, _ = opened("half.toml", "--region", "half_plane(0)")
    assert len(own.measured) < own.plant.shape[0]
    assert state.question.measured == own.measured
    assert state.question.structure(own).measured == own.measured
    assert "--measured" in state.question.command(own)
    assert State.first(own, HalfPlane(0.0)) == state


def test_a_law_with_states_of_its_own_is_given_and_no_question(opened):
    own = subject("active-suspension-ride")
    place(own.plant, HalfPlane(0.0), structure=own.structure).save("mine")
    again, state, _ = opened("mine")
    assert again.plant.shape[0] == own.plant.shape[0] + 1
    answer = answered(again, state)
    assert answer.proved
    assert state.question.command(again) == "polefence check mine"
    assert "Design.load('mine')" in state.question.python(again)
