"""Scaling is exactly undone, and changes no radius."""

import numpy as np
import pytest

from polefence import build
from polefence.base.errors import SolverError
from polefence.lmi.solve.scaling import balanced, power_of_two
from polefence.lmi.solve.search import common_point
from polefence.lmi.solve.starts import nominal_start
from support.margin import reach


def test_powers_of_two_are_powers_of_two():
    values = np.exp(np.random.default_rng(0).uniform(-20, 20, 100))
    exponents = np.log2(power_of_two(values))
    assert np.array_equal(exponents, np.round(exponents))
    assert np.all(np.abs(exponents - np.log2(values)) <= 0.5)


def test_balanced_scaling_is_undone_to_the_last_bit(physical):
    """Powers of two only: scaled and back gives the very same floats."""
    scaling = balanced(physical.A, physical.B, 40.0)
    A, B = scaling.apply(physical.A, physical.B)
    T, S = scaling.T, scaling.S
    assert np.array_equal(scaling.rate * (T @ A @ np.linalg.inv(T)), physical.A)
    assert np.array_equal(scaling.rate * (T @ B @ np.linalg.inv(S)), physical.B)
    assert np.ptp(np.log2(np.abs(A[A != 0]))) < np.ptp(np.log2(np.abs(physical.A[physical.A != 0])))


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_a_point_reaches_the_same_radius_in_all_coordinates(physical, method):
    scaling = balanced(physical.A, physical.B, 40.0)
    start = nominal_start(physical.A, physical.B, 40.0, scaling)
    for coordinates in (scaling, scaling.refined(start.W)):
        A, B = coordinates.apply(physical.A, physical.B)
        pencil = build(method, A, B, 40 / coordinates.rate, coordinates.unit)
        values = common_point(start.W, start.K @ start.W, pencil.variables)
        x = pencil.pack({v.name: inverse(coordinates, values[v.name], v) for v in pencil.variables})
        assert np.isclose(coordinates.rate * reach(pencil, x), start.radius, rtol=1e-6)
        back = coordinates.restore(pencil.unpack(x), pencil.variables)
        for v in pencil.variables:
            assert np.allclose(back[v.name], values[v.name], rtol=1e-6)


def inverse(scaling, X, variable):
    left = np.linalg.inv(scaling.T if variable.rows == "x" else scaling.S)
    return left @ X @ np.linalg.inv(scaling.T).T


def test_a_singular_lyapunov_matrix_is_refused(physical):
    scaling = balanced(physical.A, physical.B, 40.0)
    with pytest.raises(SolverError):
        scaling.refined(np.zeros((5, 5)))
