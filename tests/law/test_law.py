"""Laws: K(alpha) against its definition, and what they refuse."""

import numpy as np
import pytest

from polefence import FixedGain, InputError, Parameter, ScheduledGain
from polefence.base.errors import ParameterValueError
from polefence.law.laws import right_divide

RANDOM = np.random.default_rng(3)
N, n, m = 4, 3, 2
ROOTS = RANDOM.normal(size=(N, n, n))
W = ROOTS @ ROOTS.transpose(0, 2, 1) + np.eye(n)
Z = RANDOM.normal(size=(N, m, n))
PARAMETERS = (Parameter("p", 1, 2), Parameter("q", 2, 4, through="1/q"))
LAW = ScheduledGain(W, Z, PARAMETERS)


def test_gain_is_z_times_inverse_w():
    alpha = RANDOM.dirichlet(np.ones(N), 50)
    K = LAW.gain(alpha)
    assert K.shape == (50, m, n)
    for a, gain in zip(alpha, K, strict=True):
        W_a, Z_a = np.einsum("j,jab->ab", a, W), np.einsum("j,jab->ab", a, Z)
        assert np.allclose(gain @ W_a, Z_a, rtol=1e-12, atol=1e-12)


def test_gain_at_physical_parameters_is_the_gain_at_their_alpha():
    # q = 3 lies at a third of [1/2, 1/4] in 1/q, counted from 1/2: weights 1/3, 2/3
    expected = LAW.gain(np.kron([0.25, 0.75], [1 / 3, 2 / 3]))
    assert np.allclose(LAW.gain_at(p=1.75, q=3), expected, rtol=1e-13)


def test_control_is_gain_times_state():
    alpha, x = RANDOM.dirichlet(np.ones(N), 5), RANDOM.normal(size=(5, n))
    u = LAW.control(alpha, x)
    assert np.allclose(u, [K @ v for K, v in zip(LAW.gain(alpha), x, strict=True)])
    assert np.allclose(FixedGain(Z[0]).control(alpha, x), x @ Z[0].T)


@pytest.mark.parametrize(
    "alpha",
    [[0.5, 0.5, 0.1, 0], [1.1, -0.1, 0, 0], [1, 0, 0], 1.0, [np.nan, 1, 0, 0], [0, 0, 0, 0]],
)
def test_alpha_off_the_simplex_is_refused(alpha):
    with pytest.raises(ParameterValueError):
        LAW.gain(alpha)


def test_rounding_of_alpha_is_forgiven_and_clamping_is_asked_for():
    assert np.allclose(LAW.gain([1 + 1e-12, -1e-12, 0, 0]), LAW.gain([1, 0, 0, 0]))
    assert np.allclose(LAW.gain([1.1, -0.1, 0, 0], clamp=True), LAW.gain([1, 0, 0, 0]))
    with pytest.raises(ParameterValueError):
        LAW.gain_at(p=3, q=3)
    assert np.allclose(LAW.gain_at(p=3, q=3, clamp=True), LAW.gain_at(p=2, q=3))


def test_division_survives_scales_of_many_decades():
    scale = np.diag(10.0 ** np.array([-6, 0, 6]))
    K = right_divide(Z[0] @ scale, scale @ W[0] @ scale) @ scale
    assert np.allclose(K, Z[0] @ np.linalg.inv(W[0]), rtol=1e-9)


def test_a_state_of_the_wrong_shape_is_refused_not_broadcast():
    alpha = [1, 0, 0, 0]
    for x in (np.ones((n, 1)), np.ones(n + 1), 1.0):
        for law in (LAW, FixedGain(Z[0])):
            with pytest.raises(InputError, match="x must end in 3 states"):
                law.control(alpha, x)


@pytest.mark.parametrize("bad", [[[np.nan]], [1.0], [[[1.0]]]])
def test_fixed_gain_must_be_a_finite_matrix(bad):
    with pytest.raises(InputError):
        FixedGain(bad)


def test_shapes_of_a_scheduled_law_must_fit():
    with pytest.raises(InputError):
        ScheduledGain(W, Z[:3])


def test_laws_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        LAW.W[0, 0, 0] = 1.0
