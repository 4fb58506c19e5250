"""Plants with a filter in series: against plain block matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import InputError
from polefence.design.requirements.rms import Rms
from polefence.design.signals.augmented import with_filter, without_feedback
from polefence.design.signals.bounds import best_bound
from polefence.examples import family
from polefence.law.laws import FixedGain
from polefence.response.weighting import WK
from polefence.vehicle.vehicle import ride


@pytest.fixture(scope="module")
def car():
    return family("quarter-car-ride")


def test_a_filter_is_in_series(car):
    known = ride(car)
    a, b, c, _ = WK.state_space()
    larger, signal = with_filter(car, known.acceleration, WK.state_space(), "Wk")
    for vertex, own in zip(larger.vertices, car.vertices, strict=True):
        assert np.array_equal(vertex.A[:4, :4], own.A)
        assert not vertex.A[:4, 4:].any()
        assert np.allclose(vertex.A[4:, :4], b @ own.A[2:3], rtol=1e-15)
        assert np.array_equal(vertex.A[4:, 4:], a)
        assert np.allclose(vertex.B[4:], b @ own.B[2:3], rtol=1e-15)
        assert not vertex.E[4:].any()
    assert [float(x) for x in signal.C[0]] == [0.0] * 4 + c[0].tolist()
    assert ride(larger).places == known.places


def test_a_weighted_rms_is_that_of_the_series(car):
    larger, signal = with_filter(car, ride(car).acceleration, WK.state_space(), "Wk")
    law = without_feedback(FixedGain([[0, 0, -1500.0, 0]]), larger)
    assert law.K.shape == (1, 12)
    bound = best_bound(larger, law, Rms(signal, density=1e-3))
    worst = 0.0
    for alpha in np.random.default_rng(1).dirichlet(np.ones(4), 20).tolist() + np.eye(4).tolist():
        A, B = larger.at(alpha)
        E = larger.vertices[0].E
        X = solve_continuous_lyapunov(A + B @ law.K, -0.5e-3 * E @ E.T)
        c = np.array(signal.C[0], dtype=float)
        worst = max(worst, float(np.sqrt(c @ X @ c)))
    assert worst < bound.level < worst * 1.01


def test_a_filter_with_a_direct_way_is_refused(car):
    with pytest.raises(InputError, match="direct way"):
        with_filter(car, ride(car).travel, ([[-1.0]], [[1.0]], [[1.0]], [[1.0]]), "lead")
