"""Searches end at a bound of counted work, and the answer says so: the same one every time."""

import numpy as np
import pytest

from polefence import FixedGain, NotProvedError, Parameter, Rms, Structure, UncertainPlant
from polefence.base.effort import bounded, ended, spend
from polefence.lmi.solve import duals
from polefence.lmi.solve.duals import in_parts
from polefence.search import optimise as module
from polefence.search import tuned
from polefence.search.optimise import optimise

ONE = Structure(schedule=())


def plant():
    A = [[[0, 1], [-k, -0.2]] for k in (1, 2)]
    return UncertainPlant.from_vertices(A, [[[0], [1]]] * 2, [[[0], [1]]] * 2)


def asked(most):
    return Rms("x1", density=1), [Rms("u1", density=1, at_most=most)]


def test_inside_another_bound_there_is_what_that_leaves():
    with bounded(100.0) as outer:
        spend(30.0, 2)
        with bounded(1000.0) as inner:
            assert inner.most == 70
            spend(60.0, 1)
            assert not ended()
            spend(10.0, 1)
            assert ended()
        assert (outer.spent, outer.evaluations) == (100, 4)
        assert ended()
    assert not ended()
    spend(1.0)  # counts nothing: nobody bounds it


def test_an_answer_that_was_found_before_says_where_the_search_stopped(monkeypatch):
    whole = optimise(plant(), *asked(1.0), structure=ONE)
    assert not whole.cut
    with bounded(1e12) as effort:
        optimise(plant(), *asked(1.0), structure=ONE)
    for bound in ("MOST_WORK", "MOST_PROVING"):  # of searches, and of proofs of what they find
        monkeypatch.setattr(module, bound, 0.7 * effort.spent)
    first, again = (optimise(plant(), *asked(1.0), structure=ONE) for _ in range(2))
    assert first.cut == again.cut
    assert "stopped at its bound of work, after" in first.cut
    assert first.bounds[0].level == again.bounds[0].level
    assert first.bounds[0].level == pytest.approx(whole.bounds[0].level, rel=0.01)
    said = int(first.cut.split("after ")[1].split()[0])
    assert 0 < said < effort.evaluations


def test_where_nothing_is_found_before_that_is_the_reason(monkeypatch):
    for bound in ("MOST_WORK", "MOST_PROVING"):
        monkeypatch.setattr(module, bound, 1.0)
    with pytest.raises(
        NotProvedError, match=r"stopped at its bound of work, after \d+ evaluations of"
    ):
        optimise(plant(), *asked(2e-5), structure=ONE)


def test_parts_of_a_box_of_many_parameters_are_not_begun(monkeypatch):
    """Of six parameters one polynomial of degree 2 takes minutes: none is looked for."""
    names = [Parameter(f"p{k}", 1, 2) for k in range(6)]
    rows = [["-p0 - 3", "p1", 0], ["-p2", "-3 - p3", "p4"], [0, "-p5", -4]]
    many = UncertainPlant.from_expressions(names, rows, [[0], [0], [1]], [[1], [0], [0]])
    law = FixedGain(np.zeros((1, 3)))
    begun = []
    monkeypatch.setattr(duals, "_duals", lambda *own: begun.append(own) or iter(()))
    problem = Rms("x1", density=1).dual(many, law)
    assert in_parts(problem, 1e-6) is None
    assert not begun
    rows = [[-3, "p0"], ["-p1", -4]]
    few = UncertainPlant.from_expressions(names[:2], rows, [[0], [1]], [[1], [0]])
    assert in_parts(Rms("x1", density=1).dual(few, FixedGain(np.zeros((1, 2)))), 1e-6) is None
    assert begun


def test_what_searches_of_orders_found_is_proved_whatever_they_took(monkeypatch):
    one = Structure(order=1, measured=["x1"], schedule=())
    with bounded(1e12) as effort:
        whole = optimise(plant(), *asked(1.0), structure=one)
    assert not whole.cut
    monkeypatch.setattr(module, "MOST_WORK", 0.5 * effort.spent)
    monkeypatch.setattr(tuned, "MOST_WORK", 0.5 * effort.spent)
    some = optimise(plant(), *asked(1.0), structure=one)
    assert "stopped at its bound of work, after" in some.cut
    assert some.design.certificate.prove().proved
    assert whole.bounds[0].level < some.bounds[0].level < 1.2 * whole.bounds[0].level
