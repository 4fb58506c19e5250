"""Dual polynomials by interpolation: equations against SciPy, levels against samples, parts."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from polefence import Parameter, UncertainPlant
from polefence.law.laws import FixedGain, PolynomialGain, ScheduledGain
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.lmi.solve.duals import duals, in_parts
from polefence.lmi.solve.gramians import has_stabilising, made_up, majorant, riccati
from polefence.response.modes import of_modes


def stable(random, count, n):
    A = random.normal(size=(count, n, n))
    return A - (np.linalg.eigvals(A).real.max() + 1) * np.eye(n)


def gain_of(A, E, Y, F):
    """Largest singular value over frequencies: at roots, and on a grid that closes in."""
    roots = np.abs(np.linalg.eigvals(A))
    grid = np.concatenate([[0], roots, np.geomspace(roots.min() / 10, 10 * roots.max(), 300)])
    for _ in range(4):
        s = 1j * grid[:, None, None] * np.eye(len(A))
        values = np.linalg.norm(Y @ np.linalg.solve(s - A, E + 0 * s[:, :, :1]) + F, 2, axis=(1, 2))
        best = grid[values.argmax()]
        near = np.diff(np.sort(grid))
        width = near[max(np.searchsorted(np.sort(grid), best) - 1, 0)]
        grid = np.append(np.linspace(max(best - width, 0), best + width, 50), best)
    return values.max()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_riccati_s_equation_is_scipy_s_and_has_a_threshold(n):
    """It has a stabilising solution just above the gain, and none just below."""
    random = np.random.default_rng(n)
    A, E, C = stable(random, 3, n), random.normal(size=(3, n, n)), random.normal(size=(3, 2, n))
    gains = np.array([gain_of(*own, np.zeros((2, n))) for own in zip(A, E, C, strict=True)])
    EE, CC = E @ E.swapaxes(1, 2), C.swapaxes(1, 2) @ C
    for factor, there in ((1 + 1e-4, True), (1 - 1e-4, False), (2.0, True)):
        g = (gains * factor)[:, None, None]
        assert np.all(has_stabilising(A, EE / g, CC / g) == there)
    X = riccati(A, EE / g, CC / g)
    for k in range(3):
        S = np.linalg.cholesky(EE[k] / g[k])
        own = -solve_continuous_are(A[k], S, -CC[k] / g[k], np.eye(n))
        np.testing.assert_allclose(X[k], own, rtol=1e-7, atol=1e-9)
        assert np.linalg.eigvals(A[k] + EE[k] / g[k] @ X[k]).real.max() < 0
    assert riccati(A, EE / gains.max() * 2, CC / gains.max() * 2) is None


def test_a_majorant_is_above_each_of_nearly_least_trace():
    random = np.random.default_rng(0)
    for count, n in product((1, 2, 30), (1, 3)):
        half = random.normal(size=(count, n, n))
        M = half + half.swapaxes(1, 2)
        R = majorant(M)
        scale = np.abs(M).max()
        assert np.linalg.eigvalsh(R - M).min() > -1e-9 * scale
        assert np.linalg.eigvalsh(R).min() > -1e-9 * scale
        positive = [np.maximum(np.linalg.eigvalsh(own), 0).sum() for own in M]
        assert max(positive) - 1e-9 <= np.trace(R) <= sum(positive) + 1e-9
    assert np.allclose(majorant(-np.eye(2)[None]), 0)


# --- levels --------------------------------------------------------------------------------------

LAWS = ("fixed", "polynomial", "scheduled")


def problem(law, seed, gain=False, through=False, count=2, spread=0.08):
    random, n, N = np.random.default_rng(seed), 3, 2**count
    parameters = tuple(Parameter(f"p{k}", -1, 1) for k in range(count))
    signs = np.array(list(product((-1, 1), repeat=count)), dtype=float)
    A = stable(random, 1, n)[0] + np.tensordot(signs, spread * random.normal(size=(count, n, n)), 1)
    B, C = random.normal(size=(n, 1)), random.normal(size=(2, n))
    D, E, F = random.normal(size=(2, 1)), random.normal(size=(n, 2)), random.normal(size=(2, 2))
    plant = UncertainPlant.from_vertices(list(A), [B] * N)
    K = 0.03 * random.normal(size=(3, 1, n))
    powers = ((0,) * count, (1, *(0,) * (count - 1)), (2, *(0,) * (count - 1)))
    half = 0.1 * random.normal(size=(N, n, n))
    own = {
        "fixed": lambda: FixedGain(K[0]),
        "polynomial": lambda: PolynomialGain(powers, K, (), parameters),
        "scheduled": lambda: ScheduledGain(
            np.eye(n) + half @ half.swapaxes(1, 2), 0.03 * random.normal(size=(N, 1, n)),
            parameters, 1, (2,) * count,
        ),
    }[law]()  # fmt: skip
    each = (np.array([M] * N) for M in (C, D, E, 0.2 * F * (through and gain)))
    plant = replace(plant, parameters=parameters)
    return DualProblem(plant, own, *each, np.ones(2), gain=gain)


def worst_of(own, count=25):
    """What is bounded, at corners and points between, by SciPy."""
    random, sizes = np.random.default_rng(5), own.domain.sizes
    points = np.array(
        [np.concatenate([random.dirichlet(np.ones(s)) for s in sizes]) for _ in range(count)]
    )
    alpha = np.concatenate([np.eye(own.domain.corners), own.domain.alpha(points)])
    found = []
    for A, Y, E, F in zip(*own.closed(alpha), strict=True):
        if own.gain:
            found.append(gain_of(A, E, Y, F))
        else:
            Q = solve_continuous_lyapunov(A.T, -Y.T @ Y)
            found.append(np.sqrt(np.trace(E.T @ Q @ E)))
    return max(found)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", ["rms", "gain", "gain through"])
@pytest.mark.parametrize("law", LAWS)
def test_levels_are_above_samples_and_near_them(law, kind, seed):
    """And the inequality holds at points that are no nodes, as Q of the level says."""
    own = problem(law, seed, kind != "rms", kind == "gain through")
    worst = worst_of(own)
    found = list(duals(own, worst, 1e-3))
    assert found
    levels = [dual.level for dual in found]
    assert min(levels) >= worst * (1 - 1e-9)
    assert min(levels) <= worst * 1.02
    best = min(found, key=lambda dual: dual.level)
    random = np.random.default_rng(9)
    points = np.array(
        [np.concatenate([random.dirichlet(np.ones(2)) for _ in range(2)]) for _ in range(20)]
    )
    alpha = own.domain.alpha(points)
    Q = np.tensordot(own.domain.basis(alpha, best.degree), best.Q, 1)
    A, Y, E, F = own.closed(alpha)
    for q, a, y, e, f in zip(Q, A, Y, E, F, strict=True):
        assert np.linalg.eigvalsh(q).min() > 0
        left, g = q @ a + a.T @ q, best.level
        if kind == "rms":
            assert np.linalg.eigvalsh(left + y.T @ y).max() < 0
            assert np.trace(e.T @ q @ e) <= g**2 * (1 + 1e-9)
        else:
            corner = np.block([[-g * np.eye(2), f.T], [f, -g * np.eye(2)]])
            side = np.hstack([q @ e, y.T])
            assert np.linalg.eigvalsh(np.block([[left, side], [side.T, corner]])).max() < 0


@pytest.mark.parametrize(("gain", "spread"), [(False, 0.1), (True, 0.2)])
def test_a_higher_degree_comes_nearer(gain, spread):
    """The gap falls at least tenfold from degree 1 to degree 4."""
    own = problem("fixed", 1, gain, spread=spread)
    worst = worst_of(own, 100)
    gaps = [dual.level / worst - 1 for dual in duals(own, worst, 0.0)]
    assert min(gaps) < 3e-3
    assert min(gaps) <= gaps[0] / 10


@pytest.mark.parametrize("gain", [False, True])
def test_parts_make_up_the_box_where_one_polynomial_is_not_enough(gain):
    """Two masses and a spring from 0.5 to 2: no degree up to 4 comes near on all of it."""
    A = [np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-k, k, 0, 0], [k, -k, 0, 0]]) for k in (0.5, 2.0)]
    B, E = np.array([[0, 0, 1.0, 0]]).T, np.array([[0, 0, 0, 1.0]]).T
    middle = (A[0] + A[1]) / 2
    K = -B.T @ solve_continuous_are(middle, B, np.eye(4), np.eye(1))
    plant = UncertainPlant.from_vertices(A, [B] * 2)
    parameters = (Parameter("k", 0.5, 2),)
    law = PolynomialGain(((0,),), K[None], (), parameters)
    row, none = np.array([[[0, 1.0, 0, 0]]] * 2), np.zeros((2, 1, 1))
    own = DualProblem(
        replace(plant, parameters=parameters),
        law, row, none, np.array([E] * 2), none, np.ones(1), gain=gain,
    )  # fmt: skip
    worst = worst_of(own, 80)
    assert all(dual.level > worst * 1.01 for dual in duals(own, worst, 1e-3))
    assert in_parts(own, worst * 0.99, 4) is None
    parts = in_parts(own, worst * 1.01)
    assert parts is not None
    assert len(parts) > 1
    ends = sorted((part.low[0], part.high[0]) for part in parts)
    assert ends[0][0] == 0
    assert ends[-1][1] == 1
    assert all(a[1] == b[0] for a, b in pairwise(ends))
    assert all(part.dual.level <= worst * 1.01 for part in parts)


def test_modes_make_up_for_what_is_missed_at_about_the_least_cost():
    """A share of each mode exceeds what is missed, and costs less than shares without costs do."""
    random = np.random.default_rng(5)
    n, count = 6, 4
    half = random.normal(size=(count, n, n)) * np.geomspace(1, 30, n)
    missed = half + half.swapaxes(1, 2)
    V = np.linalg.eig(random.normal(size=(n, n)))[1]
    inside, E = np.geomspace(0.1, 10, n), random.normal(size=(n, 2))
    E *= np.geomspace(1, 1e-2, n)[:, None]
    shares = made_up(missed, V, inside, E)
    R = of_modes(V, inside * shares)
    assert np.linalg.eigvalsh(R - missed).min() > -1e-9 * np.abs(missed).max()

    cost = np.square(np.abs(V.conj().T @ E)).sum(axis=1)
    P = np.linalg.inv(V).conj().T / np.sqrt(inside)
    evenly = np.abs(P.conj().T @ missed @ P).sum(axis=-1).max(axis=0)
    assert cost @ shares < cost @ evenly
