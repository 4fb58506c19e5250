"""No answer depends on the clock, unless a budget in seconds was asked for; then it says so."""

import itertools
import time

import numpy as np
import pytest

from polefence import (
    Disk,
    GainTable,
    HalfPlane,
    NotProvedError,
    Parameter,
    Scheduled,
    UncertainPlant,
    analyse,
    place,
    worst_case,
)

AUTO = Scheduled(degree="auto")


@pytest.fixture
def slow_clock(monkeypatch):
    """Between any two looks at the clock an hour goes by."""
    hours = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: 3600.0 * next(hours))


def oscillator(stiffest=9):
    As = [[[0, 1], [-k, -0.5]] for k in (1, stiffest)]
    return UncertainPlant.from_vertices(As, [[[0], [1]]] * 2)


def spring():
    k = Parameter("k", 1, 9)
    plant = UncertainPlant.from_expressions([k], [["0", "1"], ["-k", "-0.5"]], [["0"], ["1"]])
    gains = np.array([[[0, 0]], [[0, 0]], [[0, 0.45]]])  # hardly any damping is left at the end
    return plant, GainTable(plant.parameters, {"k": [1, 3, 9]}, gains)


def test_a_slow_clock_changes_no_analysis(slow_clock):
    found = analyse(oscillator(), [[0, 0]], HalfPlane(0))  # degree 0 does not do
    assert found.proved
    assert found.certificate.evidence["parts"][0]["degree"] == 1


def test_a_slow_clock_changes_no_worst_case(slow_clock):
    found = worst_case(oscillator(), [[0, 0]])
    assert 0.99 * 0.25 < found.region.decay < 0.25
    assert not found.cut


def test_a_slow_clock_changes_no_table(slow_clock):
    found = analyse(*spring(), HalfPlane(0.1))
    assert len(found.cells) > 2  # the second had to be halved
    # damping 0.5 - 0.45 t leaves a decay rate of 0.1 up to t = 2/3
    assert 1 / 4 + 3 / 4 * 0.6 < found.shares["proved"] < 1 / 4 + 3 / 4 * 2 / 3
    assert not found.cut


def test_a_slow_clock_changes_no_degree(slow_clock):
    wide = place(oscillator(), Disk(-3, 0.5), AUTO)
    assert wide.law.degree > 0


def test_a_budget_cuts_and_says_so():
    alone = analyse(oscillator(), [[0, 0]], HalfPlane(0), budget=0)
    assert alone.answer == "undecided"
    assert alone.reason.endswith("the budget of 0 s is spent")
    assert worst_case(oscillator(), [[0, 0]], budget=0).cut
    assert analyse(*spring(), HalfPlane(0.1), budget=0).cut
    assert not analyse(*spring(), HalfPlane(0.01), budget=0).cut  # all is proved at once
    with pytest.raises(NotProvedError, match="budget of 0 s is spent"):
        place(oscillator(), Disk(-3, 0.5), Scheduled(degree="auto", budget=0))
