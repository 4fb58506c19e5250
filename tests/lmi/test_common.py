"""One Q for loops in any order: against its inequalities, against orders, and its slopes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from polefence.lmi.solve.common import common

GAP = 1e-3


def loops(seed, count=3, k=2, n=3):
    """Loops that are stable in any order: each shrinks the same norm."""
    rng = np.random.default_rng(seed)
    T = rng.normal(size=(count, 1, n, n))
    F = rng.normal(size=(count, k, n, n))
    F *= 0.95 / np.linalg.norm(F, 2, axis=(2, 3))[..., None, None]
    C = rng.normal(size=(count, k, 2, n))
    E = rng.normal(size=(count, n, 2))
    return T @ F @ np.linalg.inv(T), np.swapaxes(C, 2, 3) @ C, E @ np.swapaxes(E, 1, 2)


def cost_of(F, M, W, order):
    """The mean cost of one order, again and again."""
    n = len(W)
    moved, noise = np.eye(n), np.zeros((n, n))
    for i in order:
        moved, noise = F[i] @ moved, F[i] @ noise @ F[i].T + W
    X = np.linalg.solve(np.eye(n * n) - np.kron(moved, moved), noise.ravel()).reshape(n, n)
    total = 0.0
    for i in order:
        total += np.trace(M[i] @ X)
        X = F[i] @ X @ F[i].T + W
    return total / len(order)


@pytest.mark.parametrize("seed", range(4))
def test_no_order_costs_more(seed):
    F, M, W = loops(seed)
    found = common(F, M, W, GAP)
    assert np.all(found.found)
    left = found.Q[:, None] - np.swapaxes(F, 2, 3) @ found.Q[:, None] @ F - M
    assert np.linalg.eigvalsh(left).min() > 0
    rng = np.random.default_rng(seed)
    for p in range(len(F)):
        orders = [[0], [1], [0, 1], *(rng.integers(0, 2, 9) for _ in range(20))]
        worst = max(cost_of(F[p], M[p], W[p], order) for order in orders)
        assert worst < found.cost[p]


def test_of_one_loop_it_is_its_own_cost():
    F, M, W = loops(5, k=1)
    found = common(F, M, W, 1e-6)
    for p in range(len(F)):
        assert found.cost[p] == pytest.approx(cost_of(F[p], M[p], W[p], [0]), rel=2e-6)


def test_the_cost_falls_to_the_least_as_the_gap_does():
    F, M, W = loops(6)
    costs = [common(F, M, W, gap) for gap in (1e-1, 1e-2, 1e-3, 1e-5)]
    assert all(np.all(a.cost > b.cost) for a, b in pairwise(costs))
    for found, gap in zip(costs, (1e-1, 1e-2, 1e-3), strict=False):
        assert np.all(found.cost - costs[-1].cost < 1.01 * gap * found.base)


@pytest.mark.parametrize("factor", [1.001, 0.999])
def test_there_is_one_as_long_as_every_order_is_stable(factor):
    """F_1 F_2 has a radius of 4 a^2 / 4 while each is nilpotent: stable in any order for a < 1."""
    F = np.array([[[[0, 2.0], [0, 0]], [[0, 0], [0.5, 0]]]]) * factor
    M, W = np.tile(np.eye(2), (1, 2, 1, 1)), np.eye(2)[None]
    found = common(F, M, W, GAP)
    assert found.found[0] == (factor < 1)
    assert np.isfinite(found.cost[0]) == (factor < 1)


def test_slopes_are_those_of_differences():
    F, M, W = loops(7)
    dF, dM = common(F, M, W, GAP).slopes
    rng = np.random.default_rng(7)
    for _ in range(3):
        D, C = rng.normal(size=F.shape), rng.normal(size=M.shape)
        C = C + np.swapaxes(C, 2, 3)
        h = 1e-6
        up, down = (common(F + s * h * D, M + s * h * C, W, GAP).cost for s in (1, -1))
        expected = (dF * D).sum(axis=(1, 2, 3)) + (dM * C).sum(axis=(1, 2, 3))
        assert (up - down) / (2 * h) == pytest.approx(expected, rel=1e-4)


def test_one_point_without_one_leaves_the_others_as_they_are():
    F, M, W = loops(8)
    alone = common(F[1:], M[1:], W[1:], GAP)
    F = F.copy()
    F[0] *= 3
    some = common(F, M, W, GAP)
    assert list(some.found) == [False, True, True]
    assert some.cost[1:] == pytest.approx(alone.cost, rel=1e-9)


def test_loops_without_a_mean_square_have_none():
    """These have radii below one, and no covariance where the next is drawn at random."""
    F = np.array([[[[0.9, 0.4, 0.01], [-4.2, 0.5, 0.04], [-97.0, -9.5, 0.6]]] * 2])
    F[0, 1] = [[0.99, 0.02, 0.0003], [-1.5, 0.83, 0.02], [-97.0, -9.5, 0.6]]
    mean = np.mean([np.kron(one, one) for one in F[0]], axis=0)
    assert np.abs(np.linalg.eigvals(mean)).max() > 1
    noise = np.diag([0.002, 6.5, 0.0])[None]
    assert not common(F, np.broadcast_to(np.eye(3), F.shape), noise, GAP).found[0]
