"""Descents to known minima."""

import numpy as np
import pytest

from polefence.base.effort import bounded, spend
from polefence.search.tune import descent
from polefence.search.tune.descent import FEASIBLE, FULL, Rows, descend


def rows(pairs, objective):
    values, slopes = (np.array(each, dtype=float) for each in zip(*pairs, strict=True))
    return Rows(values, slopes, np.arange(len(values)), np.array(objective))


def test_the_largest_of_smooth_functions_where_three_meet():
    # Charalambous & Conn: max(x^2 + y^4, (2 - x)^2 + (2 - y)^2, 2 exp(y - x)), at (1, 1)
    def evaluate(theta):
        x, y = theta
        last = 2 * np.exp(y - x)
        return rows(
            [
                (x**2 + y**4, (2 * x, 4 * y**3)),
                ((2 - x) ** 2 + (2 - y) ** 2, (2 * x - 4, 2 * y - 4)),
                (last, (-last, last)),
            ],
            [True] * 3,
        )

    theta, found = descend(evaluate, np.array([2.0, 2.0]), effort=FULL)
    assert theta == pytest.approx([1.13904, 0.89956], abs=1e-3)
    assert found.level == pytest.approx(1.9522245, abs=1e-5)


def test_a_limit_is_kept_and_active():
    # the nearest point of the unit circle's outside to (0.5, 0)
    def evaluate(theta):
        x, y = theta
        first = ((x - 0.5) ** 2 + y**2, (2 * (x - 0.5), 2 * y))
        return rows([first, (1 - x**2 - y**2, (-2 * x, -2 * y))], [True, False])

    theta, found = descend(evaluate, np.array([1.0, 2.0]), effort=FULL)
    assert found.excess <= 1e-7
    assert theta == pytest.approx([1, 0], abs=1e-2)
    assert found.level == pytest.approx(0.25, abs=1e-4)


def test_where_nothing_can_be_evaluated_is_never_gone_to():
    def evaluate(theta):
        (x,) = theta
        return None if x <= 0 else rows([(x - np.log(x), (1 - 1 / x,))], [True])

    assert descend(evaluate, np.array([-1.0])) is None
    theta, found = descend(evaluate, np.array([5.0]), effort=FULL)
    assert theta == pytest.approx([1], abs=1e-2)
    assert found.level == pytest.approx(1, abs=1e-4)


def test_a_target_ends_the_descent():
    def evaluate(theta):
        return rows([(theta @ theta, 2 * theta)], [True])

    _, found = descend(evaluate, np.array([3.0, 4.0]), target=9.0)
    assert 0 < found.level <= 9


@pytest.mark.parametrize("start", [(3.0, 2.0), (-2.0, 0.7), (5.0, -4.0)])
def test_kinks_are_found_where_only_the_highest_row_is_known(start):
    # x^2 + 3 |y - x / 2|, one side at a time: a step across the kink is seen from beyond it only
    def evaluate(theta):
        x, y = theta
        side = 3.0 if y > x / 2 else -3.0
        return rows([(x**2 + side * (y - x / 2), (2 * x - side / 2, side))], [True])

    _, found = descend(evaluate, np.array(start), effort=FULL)
    assert 0 <= found.level <= 1e-3


def test_the_norm_of_a_matrix_by_its_largest_singular_vectors_alone():
    # the least norm of [[1, a], [b, c]] is one (Parrott), where both singular values may be one
    def evaluate(theta):
        a, b, c = theta
        u, s, vt = np.linalg.svd([[1.0, a], [b, c]])
        slope = np.outer(u[:, 0], vt[0])
        return rows([(s[0], (slope[0, 1], slope[1, 0], slope[1, 1]))], [True])

    _, found = descend(evaluate, np.array([2.0, -1.0, 3.0]), effort=FULL)
    assert 1 <= found.level + 1e-12 <= 1.002


def test_poles_that_meet_at_the_edge_do_not_end_a_descent():
    # z^2 + a z + b within the unit circle is a triangle; at two corners both poles are one, and the
    # larger has no slope. Rows that are remembered from there say that no step leads further.
    random = np.random.default_rng(0)
    for cost in random.normal(size=(60, 2)):

        def evaluate(theta, cost=cost):
            a, b = theta
            poles = np.roots([1, a, b])
            poles = poles[poles.imag >= 0]
            if np.any(np.abs(2 * poles + a) < 1e-13):
                return None
            size = np.abs(poles)
            turns = -np.stack([poles, np.ones_like(poles)], axis=1) / (2 * poles + a)[:, None]
            slopes = (poles.conj()[:, None] * turns).real / size[:, None]
            first = (cost @ theta, cost)
            limits = zip(size - 1, slopes, strict=True)
            return rows([first, *limits], [True] + [False] * len(poles))

        _, found = descend(evaluate, random.uniform(-0.5, 0.5, 2), effort=FULL)
        least = min(cost @ corner for corner in ((-2, 1), (2, 1), (0, -1)))
        assert found.excess <= 1e-6
        assert found.level == pytest.approx(least, abs=2e-3 * np.linalg.norm(cost))


def curved(random=None):
    """Return the lowest point of a ball as a question, the ball among other limits of one group.

    With a source of random numbers rows come in another order each time, some that do not matter
    left out, as poles do that meet and part.
    """
    many = np.random.default_rng(3).normal(size=(8, 5))

    def evaluate(theta):
        first = (theta[0] + 0.1 * theta[1], np.array([1.0, 0.1, 0, 0, 0]))
        limits = [(theta @ theta - 1, 2 * theta)]
        limits += [(row @ theta - 9, row) for row in many]
        count = len(limits)
        if random is not None:
            count = random.integers(4, 1 + count)
            limits = [limits[k] for k in random.permutation(count)]
        values, slopes = zip(first, *limits, strict=True)
        groups = np.array([0, *[1] * count])
        return Rows(np.array(values), np.array(slopes), groups, groups == 0)

    return evaluate


def counted(evaluate, theta):
    calls = 0

    def counting(point):
        nonlocal calls
        calls += 1
        return evaluate(point)

    return descend(counting, theta, effort=FULL)[1], calls


def test_rows_of_a_group_are_found_again_in_any_order_and_number():
    # along a curved limit a step is bent as its rows are, each with itself
    start = np.array([0.1, -0.6, 0.5, -0.3, 0.4])
    known, calls = counted(curved(), start)
    assert known.level == pytest.approx(-np.hypot(1, 0.1), abs=1e-5)
    found, others = counted(curved(np.random.default_rng(0)), start)
    assert found.level == pytest.approx(known.level, abs=1e-6)
    assert others <= 1.2 * calls


@pytest.mark.parametrize("reach", [1e-3, 0.05, 0.4, 3.0])
def test_rows_out_of_reach_change_no_step(reach, monkeypatch):
    random, left_out = np.random.default_rng(1), 0
    for _ in range(20):
        objective = np.arange(40) < 6
        values = np.where(objective, random.uniform(0.9, 1, 40), random.uniform(-2, 0.02, 40))
        some = Rows(values, random.normal(size=(40, 7)), np.arange(40), objective)
        H = np.diag(random.uniform(0.01, 1, 7))

        def step(some=some, H=H):
            asking = descent._direction(some, some.values, H, 10.0, reach)
            return descent.answered(asking, lambda program: program.minimum())

        left_out += 40 - len(descent._within_reach(some, some.values, reach))
        d, z, rho, foreseen = step()
        with monkeypatch.context() as patch:
            patch.setattr(descent, "_within_reach", lambda rows, *_: np.arange(len(rows.values)))
            whole = step()
        assert d == pytest.approx(whole[0], abs=1e-3 * reach)
        assert z == pytest.approx(whole[1], abs=1e-4)
        assert (rho, foreseen) == (whole[2], pytest.approx(whole[3], rel=1e-6))
    assert (left_out > 0) == (reach < 1)


def bent(theta):
    """The highest point of a curve within a disk and beside a parabola."""
    x, y = theta
    spend(1.0)
    values = np.array([10 - 5 * y - 1.5 * x, x**2 + y**2 - 1, 4 * (x - 0.2) ** 2 + y - 1.2])
    slopes = np.array([[-1.5, -5.0], [2 * x, 2 * y], [8 * (x - 0.2), 1.0]])
    return Rows(values, slopes, np.arange(3), np.array([True, False, False]))


def test_a_search_whose_work_ends_on_its_way_returns_what_keeps_everything():
    """Its steps go beyond curved limits, and come back later; there may be no later."""
    start, best = np.array([-0.3, -0.4]), bent(np.array([-0.3, -0.4])).level
    for most in range(2, 40):
        with bounded(most):
            _, rows = descend(bent, start)
        assert rows.excess <= FEASIBLE
        assert rows.level <= best + 10 * FEASIBLE  # what an excess of so much may buy
        best = rows.level
