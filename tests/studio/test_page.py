"""The page without a browser: what is shown is of the newest question, or nothing is."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from polefence import Design, Disk, HalfPlane
from polefence.proof.fitted import Data, Misfit
from polefence.studio import Page, State, answers, question, taking
from support.browser import until
from support.studios import subject

pytest.importorskip("panel")


@pytest.fixture
def page(tmp_path):
    own = Page(subject(), State.first(subject(), Disk(-40, 31)), tmp_path)
    assert until(lambda: "proved: all poles in disk(-40, 31)" in own.badge.object)
    yield own
    own.close()


def cloud(page):
    data = page.poles.cloud.data
    return np.asarray(data["x"]) + 1j * np.asarray(data["y"])


def test_the_cloud_is_of_the_region_that_the_badge_names(page):
    page.region.value = "disk(-40, 36)"
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    assert page.answer.design.region == Disk(-40, 36)
    assert Disk(-40, 36).contains(cloud(page))
    assert len(cloud(page)) == 5 * 250


def test_while_a_law_is_searched_nothing_is_said_of_the_last_one(page, monkeypatch):
    held, go, place = threading.Event(), threading.Event(), question.place

    def late(*own, **more):
        held.set()
        go.wait(20)
        return place(*own, **more)

    monkeypatch.setattr(question, "place", late)
    page.region.value = "disk(-40, 36)"
    assert held.wait(20)
    assert "being searched: disk(-40, 36)" in page.badge.object
    assert "proved" not in page.badge.object
    go.set()
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)


def test_where_there_is_no_law_no_poles_are_shown(page, monkeypatch):
    def none(*own, **more):
        raise answers.PolefenceError("there is <none>")

    monkeypatch.setattr(question, "place", none)
    page.region.value = "disk(-40, 36)"
    assert until(lambda: "there is &lt;none&gt;" in page.badge.object)
    assert len(cloud(page)) == 0
    assert len(page.poles.looked.data["x"]) == 0
    assert until(lambda: "There is no law" in page.count.object)
    assert until(lambda: "with this law" not in page.ride.object)
    assert page.service.button.disabled


def test_what_is_saved_is_what_is_shown(page, tmp_path):
    page.region.value = "disk(-40, 36)"
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    page.save.clicks += 1
    assert until(lambda: "saved" in page.message.object)
    assert Design.load(tmp_path / "design").region == Disk(-40, 36)


def test_no_design_is_saved_while_a_law_is_searched_and_none_is_lost(page, tmp_path, monkeypatch):
    page.save.clicks += 1
    assert until(lambda: (tmp_path / "design" / "design.json").is_file())
    go, place = threading.Event(), question.place
    monkeypatch.setattr(question, "place", lambda *own, **more: go.wait(20) and place(*own, **more))
    page.region.value = "disk(-40, 36)"
    page.save.clicks += 1
    assert until(lambda: "no design" in page.message.object)
    assert Design.load(tmp_path / "design").region == Disk(-40, 31)  # somebody's, as it was
    go.set()


def test_undo_keeps_the_car_that_is_looked_at(page):
    page.region.value = "disk(-40, 36)"
    page.sliders[0].value = 250.0
    page.back.clicks += 1
    assert page.history.now.region == Disk(-40, 31)
    assert dict(page.history.now.values)["m1"] == 250.0


def test_what_is_pointed_at_stays_in_the_family(page):
    page._pointed({"m1": 346.68, "beta": 10.0})
    assert dict(page.history.now.values)["m1"] <= 346.68


def test_a_region_that_implies_no_stability_is_noted(page):
    page.region.value = "disk(-40, 45)"
    assert until(lambda: "proved: all poles in disk(-40, 45)" in page.badge.object)
    assert "does not imply stability" in page.badge.object


def test_of_a_plant_from_data_it_is_said_that_it_is_not_proved_to_be_in_the_family(tmp_path):
    data = Data("time", ("a.csv",), 9, Misfit(0.02, 0.08), (("y", Misfit(0.02, 0.08)),))
    own = subject()
    own = replace(own, plant=replace(own.plant, data=data))
    page = Page(own, State.first(own, Disk(-40, 31)), tmp_path)
    assert until(lambda: "proved: all poles in disk(-40, 31)" in page.badge.object)
    assert data.note in page.badge.object
    page.close()


def test_what_is_not_proved_is_not_saved_as_a_design(page, tmp_path):
    page.region.value = "disk(-40, 20)"
    assert until(lambda: "refuted: poles of this law leave disk(-40, 20)" in page.badge.object)
    page.save.clicks += 1
    assert until(lambda: "saved" in page.message.object)
    assert (tmp_path / "session.json").is_file()
    assert not (tmp_path / "design").exists()


def test_a_slider_is_no_new_question(page):
    number = page.newest.number
    page.sliders[0].value = 250.0
    assert dict(page.history.now.values)["m1"] == 250.0
    assert page.newest.number == number
    assert "--set m1=250.0" in page.takes["drive"].object


def test_a_region_of_another_kind_has_other_handles(page):
    page.region.value = "half_plane(4)"
    assert until(lambda: "proved: all poles in half_plane(4)" in page.badge.object)
    assert {type(page.history.now.region)} == {HalfPlane}
    assert all(own.place.real == -4 for own in page.poles._handles)


def test_a_drag_whose_end_was_lost_is_a_step_to_undo_all_the_same(page):
    page._dragged(Disk(-40, 35), False)
    page._dragged(Disk(-40, 36), False)
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    assert until(lambda: "&#x27;disk(-40, 36)&#x27;" in page.takes["law"].object)
    page.sliders[0].value = 300.0
    assert "--set m1=300.0" in page.takes["drive"].object
    page.region.value = "half_plane(4)"
    page.back.clicks += 1
    assert page.history.now.region == Disk(-40, 36)
    page.back.clicks += 1
    assert page.history.now.region == Disk(-40, 31)


def test_an_answer_that_was_there_is_there_at_once(page, monkeypatch):
    page.region.value = "disk(-40, 36)"
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    monkeypatch.setattr(question, "place", lambda *own, **more: pytest.fail("searched again"))
    page.back.clicks += 1
    assert until(lambda: "proved: all poles in disk(-40, 31)" in page.badge.object)
    assert Disk(-40, 31).contains(cloud(page))


def test_a_report_and_code_are_written_of_what_is_proved(page, tmp_path):
    page.report.clicks += 1
    assert until(lambda: "report.html" in page.message.object, patience=60)
    text = (tmp_path / "report.html").read_text()
    assert "disk(-40, 31)" in text
    page.code.clicks += 1
    assert until(lambda: "law.c" in page.message.object, patience=60)
    assert "double" in (tmp_path / "code" / "law.c").read_text()
    page.region.value = "disk(-40, 20)"
    assert page.report.disabled
    assert page.code.disabled
    assert until(lambda: "refuted" in page.badge.object)
    assert page.report.disabled
    assert page.code.disabled


def test_no_report_takes_the_place_of_another_file(page, tmp_path, monkeypatch):
    monkeypatch.setattr(taking, "html_report", lambda *own: "<p>a report</p>")
    mine = "<!DOCTYPE html><title>mine</title>"
    (tmp_path / "report.html").write_text(mine)
    page.report.clicks += 1
    assert until(lambda: "is not a report" in page.message.object, patience=60)
    assert (tmp_path / "report.html").read_text() == mine


@pytest.mark.parametrize(("button", "folder"), [("save", "design"), ("code", "code")])
def test_no_folder_is_written_through_a_link(page, tmp_path, button, folder):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / folder).symlink_to(tmp_path / "elsewhere")
    getattr(page, button).clicks += 1
    assert until(lambda: "is a symbolic link" in page.message.object, patience=60)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_closing_gives_up_what_is_asked(page):
    page.region.value = "disk(-40, 36)"
    page.close()
    assert until(lambda: all(own.name != answers.THREAD for own in threading.enumerate()))
    assert "disk(-40, 36)" in page.badge.object
    assert "proved: all" not in page.badge.object
