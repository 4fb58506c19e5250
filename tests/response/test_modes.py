"""Lyapunov equations through modes, against SciPy's, of defective matrices too."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence.response.discrete import balancing
from polefence.response.modes import Modes, even_modes, of_modes


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


@pytest.mark.parametrize("e", [0.0, 0.7])
def test_even_lengths_solve_the_inequality_and_even_out_what_loops_nearby_couple(e):
    """X is the sum of v v*; in coordinates of these v each two modes are coupled evenly."""
    random = np.random.default_rng(3)
    A = random.normal(size=(5, 5)) * np.geomspace(1e-2, 1e2, 5)
    A -= (np.linalg.eigvals(A).real.max() + 1) * np.eye(5)
    A, b = A / (4 * np.abs(A).sum()), 1.0  # the disk of e holds all poles
    moved = 0.1 * random.normal(size=(4, 5, 5)) * np.abs(A).max()
    S = of_modes(*even_modes(A, e, 0.0, b, moved))
    assert np.linalg.eigvalsh(S).min() > 0
    X = _solved(A, S, e, b)
    assert np.linalg.eigvalsh(X).min() > 0
    poles, V = np.linalg.eig(A)
    within = np.linalg.solve(V, np.linalg.solve(V, X).conj().T)  # diagonal where X is of these v
    lengths = np.sqrt(np.diag(within).real)
    np.testing.assert_allclose(within, np.diag(lengths**2), atol=1e-6 * lengths.max() ** 2)

    def uneven(V):
        coupled = np.abs(np.linalg.solve(V, moved @ V)).max(axis=0) + 1e-12
        np.fill_diagonal(coupled, 0)
        rows, columns = coupled.sum(axis=0), coupled.sum(axis=1)
        return np.abs(np.log2(rows / columns)).max()

    assert uneven(V * lengths) < 2.5 < uneven(V / np.linalg.norm(V / balanced(A), axis=0))
    inside = -(2 * b * poles.real + e * np.abs(poles) ** 2)
    assert even_modes(A - 1.001 * poles.real.max() * np.eye(5), e, 0.0, b, moved) is None
    assert inside.min() > 0


def balanced(A):
    return balancing(A[None])[:, None]


def _solved(A, S, e, b):
    """X of b (A X + X A') + e A X A' = -S, by its Kronecker form."""
    n, eye = len(A), np.eye(len(A))
    whole = b * (np.kron(A, eye) + np.kron(eye, A)) + e * np.kron(A, A)
    return np.linalg.solve(whole, -S.ravel()).reshape(n, n)
