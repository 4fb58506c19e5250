"""The adapter to Clarabel: residuals of its answer, and solvers that misbehave."""

from __future__ import annotations

import clarabel
import numpy as np
import pytest

from polefence import build, limits, place, tightest
from polefence.base.errors import NotProvedError, SolverError
from polefence.lmi.solve.conic import largest_margin, smallest_radius
from polefence.region.regions import Disk


def test_the_margin_is_the_least_eigenvalue_at_the_point(make_random):
    """Recomputed from the pencil's own matrices, with the traces that the problem fixes."""
    plant = make_random(1, 3, 2, 3)
    pencil = build("scheduled", plant.A, plant.B, 2.0)
    for r in (1.0, 4.0):
        point = largest_margin(pencil, r)
        blocks = pencil.matrices(point.x, r)
        least = min(np.linalg.eigvalsh(block)[0] for block in blocks.values())
        assert point.optimal
        assert np.isclose(point.t, least, atol=1e-6)
        D = {b.name: b for b in pencil.blocks}
        traces = sum(np.trace(m) for m in pencil.matrices(point.x, 1.0).values())
        assert np.isclose(traces, sum(b.size for b in D.values()), rtol=1e-6)


class Panic(BaseException):
    """What a Rust panic looks like from Python: no Exception."""


def break_solver(monkeypatch, misbehave):
    real = clarabel.DefaultSolver
    calls = []

    class Solver:
        def __init__(self, *arguments):
            self.inner, self.size = real(*arguments), len(arguments[1])

        def solve(self):
            calls.append(1)
            return misbehave(len(calls), self)

    monkeypatch.setattr(clarabel, "DefaultSolver", Solver)
    return calls


def test_a_panic_becomes_an_error_of_ours(monkeypatch, make_random):
    def panic(call, solver):
        raise Panic("index out of bounds")

    break_solver(monkeypatch, panic)
    plant = make_random(1, 2, 1, 2)
    with pytest.raises(SolverError, match="Panic"):
        largest_margin(build("slack", plant.A, plant.B, 2.0), 1.0)


def test_ctrl_c_is_not_swallowed(monkeypatch, make_random):
    def interrupt(call, solver):
        raise KeyboardInterrupt

    break_solver(monkeypatch, interrupt)
    plant = make_random(1, 2, 1, 2)
    with pytest.raises(KeyboardInterrupt):
        smallest_radius(plant.A, plant.B, 2.0, "slack")


def test_an_occasional_panic_costs_a_retry_and_no_radius(monkeypatch, make_random):
    plant = make_random(1, 2, 1, 3)
    plain = smallest_radius(plant.A, plant.B, 3.0, "slack").r

    def sometimes(call, solver):
        if call % 3 == 2:
            raise Panic("sometimes")
        return solver.inner.solve()

    break_solver(monkeypatch, sometimes)
    again = smallest_radius(plant.A, plant.B, 3.0, "slack").r
    assert np.isclose(again, plain, rtol=2e-3)


def break_engine(monkeypatch):
    """Leave the second opinion alone: the direct solver finds no start."""

    def fail(*_, **__):
        raise SolverError("no point to start from")

    monkeypatch.setattr("polefence.design.place.smallest", fail)


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_the_second_opinion_steps_in_and_agrees(monkeypatch, make_random, method):
    plant = make_random(1, 3, 1, 3)
    direct = tightest(plant, -3.0, method)
    break_engine(monkeypatch)
    second = tightest(plant, -3.0, method)
    assert second.certificate.prove().proved
    assert second.lower is None
    assert direct.lower < second.region.radius
    assert np.isclose(second.region.radius, direct.region.radius, rtol=2e-4)


def test_solvers_that_always_fail_never_kill_a_sweep(monkeypatch, make_random):
    def panic(call, solver):
        raise Panic("always")

    break_engine(monkeypatch)
    break_solver(monkeypatch, panic)
    plant = make_random(1, 2, 1, 2)
    rows = limits(plant, [-2.0, -3.0], ["quadratic", "scheduled"])
    assert [row.status for row in rows] == ["undecided"] * 4
    assert [row.radius for row in rows] == [row.lower for row in rows] == [None] * 4


def test_a_solver_that_lies_proves_nothing(monkeypatch, make_random):
    """It says "optimal, margin 1" with a point of noise: no radius may come of it."""

    class Lie:
        status = "Solved"

        def __init__(self, size):
            self.x = np.random.default_rng(size).normal(size=size)
            self.x[-1] = 1.0

    def lie(call, solver):
        return Lie(solver.size)

    honest = tightest(make_random(1, 2, 1, 2), -3.0, "slack").region.radius
    break_engine(monkeypatch)
    break_solver(monkeypatch, lie)
    plant = make_random(1, 2, 1, 2)
    for row in limits(plant, [-3.0], ["quadratic", "slack", "scheduled"]):
        assert row.radius is None or row.design.certificate.prove().proved
    with pytest.raises(NotProvedError):
        place(plant, Disk(-3.0, 0.9 * honest), "slack")
