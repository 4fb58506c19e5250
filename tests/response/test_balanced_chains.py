"""Balancing of matrices in which some states follow others and none follows them."""

import numpy as np
import scipy.linalg

from polefence.response.discrete import balancing, exponential


def chain(n: int, coupled: float) -> np.ndarray:
    """Return states that each follow the one before, a loop of two first."""
    A = -np.diag(np.arange(1.0, n + 1)) + coupled * np.diag(np.ones(n - 1), -1)
    A[0, 1] = 1 / coupled
    return A


def test_units_of_a_chain_are_bounded_and_do_not_drift():
    for coupled in (1e-9, 1.0, 1e9):
        M = chain(8, coupled)[None]
        d = balancing(M)
        again = balancing(M * d / d[:, None])
        assert np.isfinite(d).all()
        assert np.array_equal(again, np.ones(8))


def test_its_exponential_is_that_of_another_tool():
    for coupled in (1e-6, 1.0, 1e6):
        M = chain(6, coupled)
        units = coupled ** np.arange(6)  # in which entries are of one size
        even = scipy.linalg.expm(M * units / units[:, None])
        answer = exponential(M[None])[0] * units / units[:, None]
        assert np.abs(answer - even).max() < 1e-12


def test_matrices_beyond_floating_point_end_without_an_error():
    for large in (1e200, 1e300, np.inf, np.nan):
        M = chain(4, 1.0)
        M[2, 1] = large
        assert np.array_equal(balancing(M[None]), np.ones(4))
