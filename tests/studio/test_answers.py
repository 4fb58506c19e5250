"""Answers: the newest question's alone, a law first and then its proof."""

from __future__ import annotations

import threading

import pytest

from polefence import Disk
from polefence.base.progress import stage
from polefence.design.design import check
from polefence.examples import family
from polefence.studio import Newest, answers, first_region

SOON = 60  # [s]


class Told:
    def __init__(self):
        self.all, self.done = [], threading.Event()

    def __call__(self, own):
        self.all.append(own)
        if own.final:
            self.done.set()


def join():
    """Wait for the end of all that is under way."""
    for own in threading.enumerate():
        if own.name == answers.THREAD:
            own.join(SOON)


@pytest.fixture
def told(physical):
    own = Told()
    own.newest = Newest(physical, own)
    yield own
    own.newest.close()


def test_a_law_comes_first_and_then_its_proof(told):
    number = told.newest.ask(Disk(-40, 31), "scheduled")
    assert told.done.wait(SOON)
    first, last = told.all
    assert first.number == last.number == number
    assert first.check is None
    assert last.check.proved
    assert check(last.design).proved


def test_what_is_out_of_reach_is_refuted_with_a_car(told):
    told.newest.ask(Disk(-40, 20), "scheduled")
    assert told.done.wait(SOON)
    own = told.all[-1]
    assert own.check.answer == "refuted"
    poles = own.design.poles([float(x) for x in own.check.alpha])
    assert not own.region.contains(poles)


def test_what_makes_no_sense_is_said(told):
    told.newest.ask(Disk(0.5, 0.4), "scheduled")
    assert told.done.wait(SOON)
    assert told.all[-1].design is None
    assert told.all[-1].reason


def test_a_slow_proof_ends_when_something_else_is_asked(told, monkeypatch):
    began, ended = threading.Event(), threading.Event()

    def slow(design):
        if design.region != Disk(-40, 31):
            return check(design)
        began.set()
        try:
            while True:
                with stage("a proof that takes for ever"):
                    pass
        finally:
            ended.set()

    monkeypatch.setattr(answers, "check", slow)
    told.newest.ask(Disk(-40, 31), "scheduled")
    assert began.wait(SOON)
    number = told.newest.ask(Disk(-40, 32), "scheduled")
    assert ended.wait(SOON)
    assert told.done.wait(SOON)
    assert {own.number for own in told.all if own.final} == {number}


def test_nothing_is_told_of_an_older_question(told, monkeypatch):
    held, go = threading.Event(), threading.Event()
    place = answers.place

    def late(plant, region, *own, **more):
        found = place(plant, region, *own, **more)
        if region == Disk(-40, 31):
            held.set()
            go.wait(SOON)
        return found

    monkeypatch.setattr(answers, "place", late)
    told.newest.ask(Disk(-40, 31), "scheduled")
    assert held.wait(SOON)
    number = told.newest.ask(Disk(-40, 32), "scheduled")
    assert told.done.wait(SOON)
    go.set()
    join()
    assert {own.number for own in told.all} == {number}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_of_ours_is_no_silence(told, monkeypatch):
    def broken(*own, **more):
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(answers, "place", broken)
    told.newest.ask(Disk(-40, 31), "scheduled")
    assert told.done.wait(SOON)
    assert "a fault of ours" in told.all[-1].reason
    join()


@pytest.mark.parametrize("name", ["quarter-car-physical", "f16", "f4e", "two-masses"])
def test_a_session_begins_with_a_region_that_can_be_had(name):
    plant, own = family(name), Told()
    newest = Newest(plant, own)
    newest.ask(first_region(plant), "scheduled")
    assert own.done.wait(SOON)
    assert own.all[-1].check.proved
    newest.close()
