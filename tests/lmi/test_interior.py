"""The first point of a search: the least power of two at which a pencil is positive definite."""

from __future__ import annotations

import numpy as np
import pytest

from polefence.lmi.conditions.pencil import Variable
from polefence.lmi.solve import search


def blocks(seed):
    """Blocks r D - M that hold from some r on, D of any rank, and M < 0 where D is zero."""
    source = np.random.default_rng(seed)
    U = np.linalg.qr(source.normal(size=(4, 4)))[0]
    rank = int(source.integers(0, 5))
    D = U[:, :rank] @ np.diag(2.0 ** source.uniform(-3, 3, rank)) @ U[:, :rank].T
    M = source.normal(size=(4, 4)) * 2.0 ** source.uniform(-10, 20)
    return [(D[None], (U[:, :rank] @ U[:, :rank].T @ (M + M.T) @ U[:, :rank] @ U[:, :rank].T
        - U[:, rank:] @ U[:, rank:].T)[None])]  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_the_least_power_is_the_first_of_all(seed):
    own = blocks(seed)
    holds = [search._positive([r * D - M for D, M in own]) for r in search.POWERS]
    first = next((r for r, yes in zip(search.POWERS, holds, strict=True) if yes), None)
    assert first is not None
    assert search.least_power(own) == first


class Line:
    """A pencil of one scalar t, whose only block is never positive: M has a direction without D."""

    variables = (Variable("t", (1, 1), rows=""),)

    def pack(self, values):
        return np.zeros(1)

    def at(self, x):
        return [(np.diag([1.0, 0.0])[None], np.diag([1.0, 1.0])[None])]


def test_where_there_is_no_point_few_are_tried(monkeypatch):
    """Five of six evaluations in a search of the least gain norm of a large law were these."""
    tried = []
    positive = search._positive
    monkeypatch.setattr(search, "_positive", lambda own: tried.append(1) or positive(own))
    assert search.interior(Line(), Line(), {}, {}) == (None, 0.0)
    assert len(tried) < search.HALVINGS * 12
