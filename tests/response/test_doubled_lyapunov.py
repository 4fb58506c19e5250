"""Lyapunov equations by doubling, of up to 24 states: against exact solutions and residuals."""

import math
from fractions import Fraction
from importlib import import_module

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from polefence.response.discrete import exponential
from polefence.response.stationary import lyapunov

STEP = 0.02
# Poles [1/s], and how far answers may be from the exact ones: a few roundings of the entries of A
# move them by as much. All are kept ten times better.
KINDS = {
    "random": (lambda random: (random.uniform(0.3, 3), random.uniform(0, 5)), 1e-14),
    "stiff": (lambda random: (10 ** random.uniform(-2, 5), 0.0), 1e-12),
    "nearly unstable": (lambda random: (10 ** random.uniform(-6, 0), random.uniform(0, 1)), 1e-9),
    "hardly damped": (lambda random: (1e-4, 10 ** random.uniform(-1, 3)), 1e-7),
    "defective": (lambda _: (1.0, 0.0), 1e-14),
}


def blocks(kind, n, random):
    """A block-diagonal matrix of such poles."""
    A, i = np.zeros((n, n)), 0
    while i < n:
        decay, turn = KINDS[kind][0](random)
        if i + 1 < n and turn and random.random() < 0.6:
            A[i : i + 2, i : i + 2] = [[-decay, turn], [-turn, -decay]]
            i += 2
        else:
            A[i, i] = -decay
            i += 1
    if kind == "stiff" and n > 1:
        A[0, 0], A[-1, -1] = -1e-2, -1e5
    if kind == "nearly unstable":
        A[-1, :] = A[:, -1] = 0
        A[-1, -1] = -1e-6
    return A + np.eye(n, k=1) if kind == "defective" else A


def plant(kind, n, random, step):
    """A in even units, of poles of that kind; of a step it is the delta form."""
    A = blocks(kind, n, random)
    if kind == "stiff":
        T = np.eye(n) + np.triu(random.normal(size=(n, n)), 1) / n
    else:
        turns = (np.linalg.qr(random.normal(size=(n, n)))[0] for _ in range(2))
        T = next(turns) * random.uniform(0.5, 2, n) @ next(turns)
    A = T @ A @ np.linalg.inv(T)
    return (exponential(step * A) - np.eye(n)) / step if step else A


def right_sides(n, random):
    """One of a single noise, one indefinite: symmetric to the last bit."""
    half = random.normal(size=(n, n))
    return np.outer(half[0], half[0]), half + half.T


def exact(A, Q, step):
    """X in rational numbers, as n (n + 1) / 2 linear equations."""
    n = len(A)
    a = [[Fraction(x) for x in row] for row in A.tolist()]
    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    place = {pair: k for k, (i, j) in enumerate(pairs) for pair in ((i, j), (j, i))}
    rows = []
    for i, j in pairs:
        row = [Fraction(0)] * len(pairs) + [-Fraction(float(Q[i, j]))]
        for k in range(n):
            row[place[k, j]] += a[i][k]
            row[place[i, k]] += a[j][k]
            for m in range(n) if step else ():
                row[place[k, m]] += Fraction(step) * a[i][k] * a[j][m]
        rows.append(row)
    for k in range(len(rows)):
        best = max(range(k, len(rows)), key=lambda r: abs(rows[r][k]))
        rows[k], rows[best] = rows[best], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        rows = [
            row if r == k else [x - row[k] * y for x, y in zip(row, rows[k], strict=True)]
            for r, row in enumerate(rows)
        ]
    return np.array([[float(rows[place[i, j]][-1]) for j in range(n)] for i in range(n)])


def rest(A, X, Q, step):
    """What is left of the equation over the sizes of its terms, in rational numbers."""
    a, x, q = (np.vectorize(Fraction, otypes=[object])(M) for M in (A, X, Q))
    half = a @ x
    left = half + half.T + q + (Fraction(step) * half @ a.T if step else 0)
    size = np.abs(A) @ np.abs(X) * (2 + step * np.abs(A).sum(axis=1)) + np.abs(Q)
    return np.abs(left.astype(float)).max() / size.max()


@pytest.mark.parametrize("step", [0.0, STEP])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_answers_are_the_exact_ones(kind, n, step):
    random = np.random.default_rng(n)
    for _ in range(3):
        A = plant(kind, n, random, step)
        for Q in right_sides(n, random):
            true = exact(A, Q, step)
            # States of units decades apart: powers of two, so that nothing is rounded.
            for units in (np.ones(n), 2.0 ** random.integers(-13, 14, n)):
                both = np.outer(units, units)
                (X,) = lyapunov((A * units[:, None] / units)[None], (Q * both)[None], step)
                assert np.abs(X / both - true).max() <= KINDS[kind][1] * np.abs(true).max()


@pytest.mark.parametrize("step", [0.0, STEP])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [5, 12, 24])
def test_nothing_is_left_of_the_equation(kind, n, step):
    """But roundings, in balanced units; and in these SciPy's answers are the same."""
    if kind == "defective" and n == 24:
        return  # its powers grow to 1e9 first
    random = np.random.default_rng(n)
    A = plant(kind, n, random, step)
    units = 2.0 ** random.integers(-40, 41, n)
    both = np.outer(units, units)
    for Q in right_sides(n, random):
        (X,) = lyapunov((A * units[:, None] / units)[None], (Q * both)[None], step)
        assert np.array_equal(X, X.T)
        X = X / both
        assert rest(A, X, Q, step) < 1e-15
        if step:
            theirs = solve_discrete_lyapunov(np.eye(n) + step * A, step * Q)
        else:
            theirs = solve_continuous_lyapunov(A, -Q)
        assert np.abs(X - theirs).max() <= 100 * KINDS[kind][1] * np.abs(theirs).max()


@pytest.mark.parametrize("step", [0.0, 1e-3])
def test_slow_modes_keep_their_digits_beside_fast_ones(step):
    """In closed form: a slow mode's own variance and what it has in common with a fast one."""
    slow, fast = 1e-2, 1e3
    A, Q = np.diag([-slow, -fast]), np.array([[1.0, 2.0], [2.0, -3.0]])
    poles = np.array([-slow, -fast])
    sums = poles + poles[:, None] + step * np.outer(poles, poles)
    (X,) = lyapunov(A[None], Q[None], step)
    np.testing.assert_allclose(X, -Q / sums, rtol=4e-15)


@pytest.mark.parametrize("decay", [1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_a_loop_that_is_hardly_stable_is_solved_for(decay, step):
    """Down to what counts as stable; a rounding of A moves the answer as much."""
    A = np.array([[-decay, 3.0], [-3.0, -decay]])
    if step:  # of that length a step
        A = (np.exp(-decay * step) * exponential(step * (A + decay * np.eye(2))) - np.eye(2)) / step
    (X,) = lyapunov(A[None], np.eye(2)[None], step)
    true = exact(A, np.eye(2), step)
    assert np.abs(X - true).max() <= 1e-14 / decay / (step or 1) * np.abs(true).max()


@pytest.mark.parametrize("step", [0.0, 0.01])
def test_what_is_not_stable_has_none_and_others_keep_theirs(step):
    random = np.random.default_rng(5)
    A = np.array([plant("random", 6, random, step) for _ in range(5)])
    Q = np.tile(np.eye(6), (5, 1, 1))
    alone = lyapunov(A, Q, step)
    bad = A.copy()
    bad[1, :, 0] = 0  # a pole at zero
    bad[3] += 5 * np.eye(6)  # poles to the right
    X = lyapunov(bad, Q, step)
    assert np.isnan(X[[1, 3]]).all()
    np.testing.assert_allclose(X[[0, 2, 4]], alone[[0, 2, 4]], rtol=1e-12, atol=1e-14)
    # with poles at +-3j, or of a step at z = -1
    still = np.array([[0.0, 3.0], [-3.0, 0.0]])
    still = (exponential(step * still) - np.eye(2)) / step if step else still
    grows = still + 1e-9 * np.eye(2)
    assert np.isnan(lyapunov(grows[None], np.eye(2)[None], step)).all()
    if step:
        one = np.ones((1, 1, 1))
        assert np.isnan(lyapunov(-2 / step * one, one, step)).all()
        assert np.isnan(lyapunov(-one, one, 4.0)).all()


@pytest.mark.parametrize("step", [0.0, 0.01])
@pytest.mark.parametrize("n", [2, 5, 12])
def test_rounding_makes_no_pole_at_zero_stable(n, step):
    random = np.random.default_rng(n)
    A = np.array([plant("random", n, random, step) for _ in range(100)])
    rows = random.integers(n, size=100)
    A[np.arange(100), rows] = A[np.arange(100), (rows + 1) % n] * random.choice([0, 3], (100, 1))
    assert np.isnan(lyapunov(A, np.tile(np.eye(n), (100, 1, 1)), step)).all()


@pytest.mark.parametrize("step", [0.0, 0.01])
def test_parts_and_units_of_noise_and_time_change_nothing(step, monkeypatch):
    random = np.random.default_rng(6)
    A = np.array([plant("random", 10, random, step) for _ in range(9)])
    Q = np.array([right_sides(10, random)[k % 2] for k in range(9)])
    X = lyapunov(A, Q, step)
    for power in (-600, 600):
        assert np.array_equal(lyapunov(A, Q * 2.0**power, step), X * 2.0**power)
    for unit in (2.0**-40, 2.0**40):
        faster = lyapunov(A * unit, Q * unit, step / unit)
        np.testing.assert_allclose(faster, X, rtol=1e-12, atol=1e-14)
    monkeypatch.setattr(import_module("polefence.response.stationary"), "BUFFER", 1)
    np.testing.assert_allclose(lyapunov(A, Q, step), X, rtol=1e-12, atol=1e-14)


def test_a_late_input_is_forgotten_in_a_step():
    """Poles at zero of z: A = -1 / T, defective."""
    T = 0.005
    F = np.eye(3, k=1)
    (X,) = lyapunov((F - np.eye(3))[None] / T, np.diag([0.0, 0.0, 1.0])[None] / T, T)
    np.testing.assert_allclose(X, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("shape", [(0, 3, 3), (4, 0, 0), (0, 0, 0)])
def test_nothing_has_nothing(shape):
    assert lyapunov(np.zeros(shape), np.zeros(shape)).shape == shape
    assert lyapunov(np.zeros(shape), np.zeros(shape), 0.1).shape == shape


@pytest.mark.parametrize("short", [1e-3, 1e-6])
def test_modes_that_change_sign_every_sample(short):
    """Poles at z = -(1 - short): nothing in continuous time is as fast as they."""
    T, z = 0.01, np.array([-1 + short, -1 + 2 * short])
    A, Q = np.diag((z - 1) / T), np.array([[1.0, 0.5], [0.5, 2.0]])
    (X,) = lyapunov(A[None], Q[None], T)
    true = exact(A, Q, T)
    assert np.abs(X - true).max() <= 1e-15 / short * np.abs(true).max()


@pytest.mark.parametrize(("n", "gain"), [(2, 1e-5), (5, 1e5), (14, 1e-5), (14, 1e5), (24, 1.0)])
@pytest.mark.parametrize("rate", [1.0, 300.0])
def test_a_chain_of_lags_is_known_in_closed_form(n, gain, rate):
    """The k-th lag behind white noise has C(2k, k) / 2^(2k + 1) of what it has by itself."""
    A = rate * (-np.eye(n) + gain * np.eye(n, k=-1))
    Q = np.zeros((n, n))
    Q[0, 0] = rate
    (X,) = lyapunov(A[None], Q[None])
    shares = np.array([math.comb(2 * k, k) / 2.0 ** (2 * k + 1) for k in range(n)])
    np.testing.assert_allclose(np.diag(X), shares * gain ** (2.0 * np.arange(n)), rtol=1e-11)
    # So do sensors of several rates behind them, one way: found one by one.
    rates = rate * np.geomspace(0.01, 100, n)
    A = np.diag(-rates) + np.diag(gain * rates[1:], -1)
    (X,) = lyapunov(A[None], Q[None])
    known = one_by_one(A, Q)
    sizes = np.sqrt(np.outer(np.diag(known), np.diag(known)))
    assert (np.abs(X - known) / sizes).max() < 1e-11


def one_by_one(A, Q):
    """X of a lower triangular A by substitution, in rational numbers."""
    n = len(A)
    a = [[Fraction(x) for x in row] for row in A.tolist()]
    X = [[Fraction(0)] * n for _ in range(n)]
    for i in range(n):
        for j in range(i, n):
            before = sum((a[i][k] * X[k][j] for k in range(i)), Fraction(float(Q[i, j])))
            before += sum((X[i][k] * a[j][k] for k in range(j)), Fraction(0))
            X[i][j] = X[j][i] = -before / (a[i][i] + a[j][j])
    return np.array([[float(x) for x in row] for row in X])


def test_a_chain_of_samples_is_known_in_closed_form():
    """White noise that is kept for some samples, then a lag: the same each sample."""
    T, n, z = 0.005, 12, 0.9
    F = np.eye(n, k=-1)
    F[-1, -1] = z
    (X,) = lyapunov((F - np.eye(n))[None] / T, np.diag([1.0] + (n - 1) * [0.0])[None] / T, T)
    np.testing.assert_allclose(np.diag(X)[:-1], 1.0, rtol=1e-14)
    np.testing.assert_allclose(X[-1, -1], 1 / (1 - z * z), rtol=1e-13)
    np.testing.assert_allclose(X[-1, :-1], 0.0, atol=1e-14)
