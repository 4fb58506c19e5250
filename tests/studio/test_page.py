"""The page without a browser: what is shown is of the newest question, or nothing is."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from polefence import Design, Disk, HalfPlane
from polefence.examples import spec_text
from polefence.plant.spec import loads
from polefence.studio import Page, Session, State, answers
from support.browser import until

pytest.importorskip("panel")

SPEC = spec_text("quarter-car-physical")


@pytest.fixture
def page(tmp_path):
    plant = loads(SPEC)
    own = Page(Session(SPEC, plant, State.first(plant, Disk(-40, 31))), "car.toml", tmp_path)
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
    held, go, place = threading.Event(), threading.Event(), answers.place

    def late(*own, **more):
        held.set()
        go.wait(20)
        return place(*own, **more)

    monkeypatch.setattr(answers, "place", late)
    page.region.value = "disk(-40, 36)"
    assert held.wait(20)
    assert "being searched: disk(-40, 36)" in page.badge.object
    assert "proved" not in page.badge.object
    go.set()
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)


def test_where_there_is_no_law_no_poles_are_shown(page, monkeypatch):
    def none(*own, **more):
        raise answers.PolefenceError("there is <none>")

    monkeypatch.setattr(answers, "place", none)
    page.region.value = "disk(-40, 36)"
    assert until(lambda: "there is &lt;none&gt;" in page.badge.object)
    assert len(cloud(page)) == 0
    assert len(page.poles.looked.data["x"]) == 0
    assert until(lambda: "There is no law" in page.count.object)
    assert until(lambda: "with this law" not in page.ride.object)
    assert page.wrong.disabled


def test_what_is_saved_is_what_is_shown(page, tmp_path):
    page.region.value = "disk(-40, 36)"
    assert until(lambda: "proved: all poles in disk(-40, 36)" in page.badge.object)
    page.save.clicks += 1
    assert until(lambda: "saved" in page.message.object)
    assert Design.load(tmp_path / "design").region == Disk(-40, 36)


def test_what_was_proved_is_not_saved_with_another_region(page, tmp_path, monkeypatch):
    page.save.clicks += 1
    assert (tmp_path / "design" / "design.json").is_file()
    go, place = threading.Event(), answers.place
    monkeypatch.setattr(answers, "place", lambda *own, **more: go.wait(20) and place(*own, **more))
    page.region.value = "disk(-40, 36)"
    page.save.clicks += 1
    assert not (tmp_path / "design" / "design.json").exists()
    assert "no design" in page.message.object
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
    assert "--set m1=250.0" in page.take.object


def test_a_region_of_another_kind_has_other_handles(page):
    page.region.value = "half_plane(4)"
    assert until(lambda: "proved: all poles in half_plane(4)" in page.badge.object)
    assert {type(page.history.now.region)} == {HalfPlane}
    assert all(own.place.real == -4 for own in page.poles._handles)


def test_closing_gives_up_what_is_asked(page):
    page.region.value = "disk(-40, 36)"
    page.close()
    assert until(lambda: all(own.name != answers.THREAD for own in threading.enumerate()))
    assert "disk(-40, 36)" in page.badge.object
    assert "proved: all" not in page.badge.object
