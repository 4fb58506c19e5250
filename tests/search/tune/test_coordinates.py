"""Coordinates of a law's own states: the same law, of the least gain."""

import numpy as np
import pytest

import polefence as pf
from polefence.search.tune.coordinates import coordinates
from polefence.search.tune.unknowns import Unknowns


def drawn(seed: int, k: int, points: int = 3) -> np.ndarray:
    random = np.random.default_rng([61, seed])
    return random.normal(size=(points, 2 + k, 3 + k))


def turned(gains: np.ndarray, T: np.ndarray) -> np.ndarray:
    k, (_, m, r) = len(T), gains.shape
    left, right = np.eye(m), np.eye(r)
    left[-k:, -k:], right[-k:, -k:] = np.linalg.inv(T), T
    return left @ gains @ right


@pytest.mark.parametrize("k", [1, 2, 4])
@pytest.mark.parametrize("seed", range(4))
def test_no_other_coordinates_have_a_smaller_gain(seed, k):
    random, gains = np.random.default_rng([62, seed]), drawn(seed, k)
    gains = turned(gains, np.diag(10.0 ** random.uniform(-3, 3, k)) @ random.normal(size=(k, k)))
    best = turned(gains, coordinates(gains, k))
    A, B, C = best[:, -k:, -k:], best[:, -k:, :-k], best[:, :-k, -k:]
    P = sum(b @ b.T + a @ a.T for a, b in zip(A, B, strict=True))
    Q = sum(c.T @ c + a.T @ a for a, c in zip(A, C, strict=True))
    assert np.allclose(P, Q, rtol=0, atol=1e-4 * np.trace(P))  # the slopes of the mean square
    for _ in range(20):
        other = turned(best, np.eye(k) + 0.1 * random.normal(size=(k, k)))
        assert (other**2).sum() >= (best**2).sum() * (1 - 1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_they_do_not_depend_on_those_before(seed):
    random, gains = np.random.default_rng([63, seed]), drawn(seed, 3)
    other = turned(gains, random.normal(size=(3, 3)))
    sizes = [np.linalg.norm(turned(K, coordinates(K, 3))) for K in (gains, other)]
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-6)


def test_a_law_of_states_that_it_does_not_use_stays_finite():
    gains = np.zeros((2, 3, 4))
    gains[:, 0, 0] = 1.0
    assert np.all(np.isfinite(coordinates(gains, 2)))


@pytest.mark.parametrize("degree", [0, 1])
def test_balanced_numbers_are_the_same_law(degree):
    A = [[[0, 1], [-2 - a, -1]] for a in (0.0, 1.0)]
    plant = pf.UncertainPlant.from_vertices(A, [[[0], [1]]] * 2, [[[0], [1]]] * 2)
    structure = pf.Structure(measured=("x1",), order=2, schedule=None if degree else ())
    larger, gain = structure.extended(plant)
    unknowns = Unknowns(larger, gain, np.full(4, 0.5), np.array([2.0, 1.0, 3.0]))
    theta = np.random.default_rng(64).normal(size=unknowns.size)
    theta[::3] *= 100
    balanced, alpha = unknowns.balanced(theta), np.array([[0.3, 0.7]])
    at = unknowns.at(alpha)
    laws = [at.gains(numbers)[0] for numbers in (theta, balanced)]
    for s in (1j, 0.3, 20j):
        answers = [
            K[0, 0] + K[0, 1:] @ np.linalg.solve(s * np.eye(2) - K[1:, 1:], K[1:, 0]) for K in laws
        ]
        assert answers[0] == pytest.approx(answers[1], rel=1e-8)
    assert np.linalg.norm(balanced) < np.linalg.norm(theta)


def test_numbers_of_a_gain_stay_as_they_are():
    plant = pf.UncertainPlant.from_vertices([[[0, 1], [-2, -1]]], [[[0], [1]]], [[[0], [1]]])
    unknowns = Unknowns(plant, pf.Structure(schedule=()), np.ones(2), np.ones(1))
    theta = np.array([1.0, 2.0])
    assert unknowns.balanced(theta) is theta
