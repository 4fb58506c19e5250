"""Lyapunov equations through modes, against SciPy's, of defective matrices too."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence.response.modes import Modes


@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("defective", [False, True])
def test_both_equations_are_scipy_s(n, defective):
    random = np.random.default_rng(n)
    A = random.normal(size=(4, n, n))
    A -= (np.linalg.eigvals(A).real.max() + 1) * np.eye(n)
    if defective:
        A[1] = -2 * np.eye(n) + np.eye(n, k=1)
    half = random.normal(size=(4, n, n))
    W = half @ half.swapaxes(1, 2)
    modes = Modes(A)
    X = [solve_continuous_lyapunov(a, -w) for a, w in zip(A, W, strict=True)]
    Q = [solve_continuous_lyapunov(a.T, -w) for a, w in zip(A, W, strict=True)]
    np.testing.assert_allclose(modes.lyapunov(W), X, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(modes.observed(W), Q, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(modes.covariance(half), X, rtol=1e-8, atol=1e-8)
