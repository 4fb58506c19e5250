"""The second solver that other tests ask, and what is said where a search fails."""

import numpy as np

from polefence import build, limits
from polefence.base.errors import SolverError
from support.margin import largest_margin


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


def test_a_search_without_a_start_leaves_a_row_undecided(monkeypatch, make_random):
    def fail(*_, **__):
        raise SolverError("no point to start from")

    monkeypatch.setattr("polefence.search.by_lmi.smallest", fail)
    plant = make_random(1, 2, 1, 2)
    rows = limits(plant, [-2.0, -3.0], ["quadratic", "scheduled"])
    assert [row.answer for row in rows] == ["undecided"] * 4
    assert [row.radius for row in rows] == [row.lower for row in rows] == [None] * 4
