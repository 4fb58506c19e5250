"""Answers: the newest question's alone, a law first and then its proof."""

import gc
import threading

import pytest

from polefence import Certificate, Design, Disk, HalfPlane, place, progress
from polefence.base.progress import counted, note, stage
from polefence.certify.design import check
from polefence.studio import Newest, answers, first_region, question
from polefence.studio.question import Found
from support.studios import asked, subject

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
def told():
    own = Told()
    own.newest = Newest(subject(), own)
    yield own
    own.newest.close()


def test_a_law_comes_first_and_then_its_proof(told):
    number = told.newest.ask(asked(Disk(-40, 31)))
    assert told.done.wait(SOON)
    first, last = told.all
    assert first.number == last.number == number
    assert first.check is None
    assert last.check.proved
    assert check(last.design).proved


def test_what_is_out_of_reach_is_refuted_with_a_car(told):
    told.newest.ask(asked(Disk(-40, 20)))
    assert told.done.wait(SOON)
    own = told.all[-1]
    assert own.check.answer == "refuted"
    poles = own.design.poles([float(x) for x in own.check.alpha])
    assert not own.question.region.contains(poles)


def test_what_makes_no_sense_is_said(told):
    told.newest.ask(asked(Disk(0.5, 0.4)))
    assert told.done.wait(SOON)
    assert told.all[-1].design is None
    assert told.all[-1].reason


def test_a_slow_proof_ends_when_something_else_is_asked(told, monkeypatch):
    began, ended = threading.Event(), threading.Event()

    prove = answers.check_document

    def slow(document, path):
        if Design(Certificate.of(document)).region != Disk(-40, 31):
            return prove(document, path)
        began.set()
        try:
            while True:
                with stage("a proof that takes for ever"):
                    pass
        finally:
            ended.set()

    monkeypatch.setattr(answers, "check_document", slow)
    told.newest.ask(asked(Disk(-40, 31)))
    assert began.wait(SOON)
    number = told.newest.ask(asked(Disk(-40, 32)))
    assert ended.wait(SOON)
    assert told.done.wait(SOON)
    assert {own.number for own in told.all if own.final} == {number}


def test_nothing_is_told_of_an_older_question(told, monkeypatch):
    held, go = threading.Event(), threading.Event()
    own_place = question.place

    def late(plant, region, *own, **more):
        found = own_place(plant, region, *own, **more)
        if region == Disk(-40, 31):
            held.set()
            go.wait(SOON)
        return found

    monkeypatch.setattr(question, "place", late)
    told.newest.ask(asked(Disk(-40, 31)))
    assert held.wait(SOON)
    number = told.newest.ask(asked(Disk(-40, 32)))
    assert told.done.wait(SOON)
    go.set()
    join()
    assert {own.number for own in told.all} == {number}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_of_ours_is_no_silence(told, monkeypatch):
    def broken(*own, **more):
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(question, "place", broken)
    told.newest.ask(asked(Disk(-40, 31)))
    assert told.done.wait(SOON)
    assert "a bug in Polefence" in told.all[-1].reason
    join()


@pytest.mark.parametrize("name", ["quarter-car-physical", "f16", "f4e", "active-suspension-ride"])
def test_a_session_begins_with_a_region_that_can_be_had(name):
    found, own = subject(name), Told()
    newest = Newest(found, own)
    newest.ask(asked(first_region(found), found))
    assert own.done.wait(SOON)
    assert own.all[-1].check.proved
    newest.close()


def test_what_is_known_is_not_searched_again_and_still_proved(told, monkeypatch):
    found = Found.of(place(subject().plant, Disk(-40, 31)))
    told.newest.know(asked(Disk(-40, 31)), found)
    monkeypatch.setattr(question, "place", lambda *own, **more: pytest.fail("searched"))
    for _ in range(2):
        told.done.clear()
        number = told.newest.ask(asked(Disk(-40, 31)))
        assert told.done.wait(SOON)
        first, last = told.all[-2:]
        assert first.number == last.number == number
        assert first.check is None
        assert last.proved
        assert last.design is found.design


def test_what_is_known_but_wrong_is_not_proved(told):
    found = place(subject().plant, Disk(-40, 20), allow_unproved=True)
    told.newest.know(asked(Disk(-40, 20)), Found.of(found))
    told.newest.ask(asked(Disk(-40, 20)))
    assert told.done.wait(SOON)
    assert told.all[-1].check.answer == "refuted"


def test_no_more_answers_are_kept_than_are_to_be(told, monkeypatch):
    monkeypatch.setattr(answers, "MOST_KNOWN", 3)
    found = Found.of(place(subject().plant, Disk(-40, 31)))
    for k in range(5):
        told.newest.know(asked(Disk(-40, 31 + k)), found)
    assert [own.region.radius for own in told.newest._known] == [33, 34, 35]


def test_limits_in_conflict_are_refuted_with_their_proof():
    own, told = subject("quarter-car-ride"), Told()
    newest = Newest(own, told)
    over = "rms of tyre deflection"
    newest.ask(asked(HalfPlane(0), own, method="quadratic", ride=True, over=over, limit=1e-4))
    assert told.done.wait(SOON)
    assert told.all[-1].refuted
    assert "refuted" in told.all[-1].reason
    newest.close()


def test_who_ends_the_work_is_told_no_more_of_it():
    told = []

    def listener(words):
        told.append(words)
        if "2 of 3" in words:
            raise KeyError(words)

    with progress(listener), pytest.raises(KeyError):
        for _ in counted([1, 2, 3], "part"):
            note("half")
    gc.collect()
    assert told[-1] == "part 2 of 3"
