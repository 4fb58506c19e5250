"""Mean squares between samples, in floats, against quadrature."""

from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.plant.spec import loads
from polefence.response.between import factor, held_of, means
from support.periods import T, by_quadrature
from support.specs import SPRING


@pytest.mark.parametrize("delay", [0, 1, 0.5, 1.25])
def test_floats_are_what_the_proof_has(delay):
    seen = pf.at_sample_time(loads(SPRING), T, delay)
    held = held_of(seen)
    outputs = [pf.Rms("x", density=2.0).exact_outputs(seen)[0]]
    corners = np.eye(len(seen.vertices))
    found = means(seen, held, outputs, (), 2.0, corners)
    period = held.period(outputs, (), T, Fraction(1))
    for k, at in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        M, V, c = by_quadrature(period, at)
        assert found.M[k] == pytest.approx(M, rel=1e-9, abs=1e-12 * np.abs(M).max())
        assert found.V[k] == pytest.approx(V, rel=1e-9, abs=1e-12 * np.abs(V).max())
        assert found.c[k] == pytest.approx(c, rel=1e-9)


def test_a_plant_that_is_no_samples_holds_nothing():
    assert held_of(loads(SPRING)) is None


def test_a_factor_gives_back_its_matrix():
    rng = np.random.default_rng(2)
    R = rng.normal(size=(3, 4, 2))
    M = R @ R.swapaxes(1, 2)
    L = factor(M)
    np.testing.assert_allclose(L @ L.swapaxes(1, 2), M, atol=1e-12)
