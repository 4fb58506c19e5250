"""Loops whose poles nearly meet: Lyapunov matrices in rationals, and laws that lead there."""

from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.certify.certificate import Certificate
from polefence.certify.given import analyse
from polefence.certify.rational import lyapunov_matrices
from polefence.search.tune.meeting import met


def chain(n):
    """n poles at -1, in controllable form; one input that the law does not use."""
    A = np.diag(np.ones(n - 1), 1)
    A[-1] = -np.poly(-np.ones(n))[:0:-1]
    return pf.UncertainPlant.from_vertices([A], [np.eye(n)[:, -1:]]), pf.FixedGain(np.zeros((1, n)))


@pytest.mark.parametrize(
    ("inside", "outside"),
    [(pf.HalfPlane(0.995), pf.HalfPlane(1.005)), (pf.Disk(-2.0, 1.01), pf.Disk(-2.0, 0.99))],
    ids=str,
)
def test_poles_that_meet_are_proved_near_the_edge_and_not_beyond(inside, outside):
    plant, law = chain(6)
    answer = analyse(plant, law, inside)
    assert answer.proved
    again = Certificate.loads(answer.certificate.dumps())
    assert again.holds()
    assert not analyse(plant, law, outside).proved


def test_the_equation_is_solved():
    plant, law = chain(3)
    (X, *_) = lyapunov_matrices(plant, law, pf.HalfPlane(0.5))
    X = [[Fraction(e) for e in row] for row in X[0]]
    M = plant.A[0] + 0.5 * np.eye(3)
    X = np.array(X, dtype=float)
    assert np.allclose(M @ X + X @ M.T, -np.eye(3))
    assert lyapunov_matrices(plant, law, pf.Sector(0.5)) == []
    two = pf.UncertainPlant.from_vertices([plant.A[0]] * 2, [plant.B[0]] * 2)
    assert lyapunov_matrices(two, law, pf.HalfPlane(0.5)) == []


def test_all_poles_are_placed_together_where_there_are_numbers_enough():
    # a chain of two integrators: any rate, so that it is raised from where it begins
    def loop(theta):
        return np.array([[0.0, 1.0], [theta[0], theta[1]]])

    theta, decay = met(loop, np.array([-1.0, -1.0]))
    assert decay > 2
    assert np.linalg.eigvals(loop(theta)) == pytest.approx([-decay] * 2, rel=1e-4)


def test_of_two_masses_they_come_to_the_known_best():
    """All six poles at -sqrt(3 k / 5), which no law of order two exceeds."""
    k = 2.5
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [-k, k, 0, 0], [k, -k, 0, 0]]
    plant = pf.UncertainPlant.from_vertices([A], [[[0], [0], [1], [0]]])
    own = pf.Structure(measured=("x2",), schedule=(), order=2)
    design = pf.tightest(plant, of="half_plane", structure=own)
    best = np.sqrt(3 * k / 5)
    assert design.runs
    assert design.proved
    assert 0.89 * best <= design.region.parts[0].decay <= best
    assert 0.97 * best <= (design.unrunnable or 0.0) <= best
