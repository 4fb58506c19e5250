"""Designs of other tools: Lyapunov matrices decided on as they are; thresholds on both sides."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import polefence as pf
from polefence import Disk, FixedGain, HalfPlane, InputError, UncertainPlant, parse_specification
from polefence.certify.given import analyse
from polefence.law.arrays import law_from
from polefence.plant.arrays import Arrays

RANDOM = np.random.default_rng(20)
A = RANDOM.standard_normal((4, 4)) - 3 * np.eye(4)
B = RANDOM.standard_normal((4, 2))
K = 0.1 * RANDOM.standard_normal((2, 4))
LOOP = A + B @ K
P = solve_continuous_lyapunov(LOOP.T, -np.eye(4))
C = -3.0


@pytest.fixture(scope="module")
def plant():
    return UncertainPlant.from_vertices([A], [B], name="one")


def least_radius(P, loop, dual=False):
    """The radius below which this P proves no disk: L' P L < r^2 P, L = loop - C."""
    moved = loop - C * np.eye(len(loop))
    moved = moved.T if dual else moved
    values = np.linalg.eigvals(np.linalg.solve(P, moved.T @ P @ moved))
    return float(np.sqrt(values.real.max()))


@pytest.mark.parametrize("dual", [False, True])
def test_matrices_prove_down_to_their_own_radius_and_no_further(plant, dual):
    own = np.linalg.inv(P) if dual else P
    radius = least_radius(own, LOOP, dual)
    other = least_radius(own, LOOP, not dual)
    assert other > radius * 1.01
    above = analyse(plant, K, Disk(C, radius * (1 + 1e-9)), lyapunov=[own])
    assert above.lyapunov.form == ("dual" if dual else "primal")
    assert above.proved
    below = analyse(plant, K, Disk(C, radius * (1 - 1e-9)), lyapunov=[own])
    assert not below.lyapunov.proved
    assert "its least eigenvalue is about -" in below.lyapunov.reason
    assert below.proved  # by others: these are not the best


def test_a_proof_by_given_matrices_is_saved_and_holds(plant, tmp_path):
    found = analyse(plant, K, HalfPlane(0), lyapunov=[P])
    assert found.lyapunov.proved
    path = found.design.save(tmp_path)
    assert pf.check(path).proved
    (own,) = found.design.certificate.evidence["parts"]
    np.testing.assert_allclose(own["X"][0], np.linalg.inv(P), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("place", [(0, 0), (1, 3), (2, 2), (3, 0)])
def test_one_wrong_entry_is_seen(plant, place):
    own, (i, j) = P.copy(), place
    own[i, j] = own[j, i] = own[i, j] - 3 * np.linalg.norm(P)
    found = analyse(plant, K, HalfPlane(0), lyapunov=[own])
    assert not found.lyapunov.proved
    assert found.proved


def test_rounding_of_one_half_is_evened_out(plant):
    own = P.copy()
    own[0, 1] *= 1 + 1e-12
    assert analyse(plant, K, HalfPlane(0), lyapunov=[own]).lyapunov.proved


def two(stiffness, damping):
    loops = [[[0.0, 1.0], [-k, -damping]] for k in (1.0, stiffness)]
    return UncertainPlant.from_vertices(loops, [[[0], [1]]] * 2, name="two")


@pytest.fixture(scope="module")
def family():
    return two(4.0, 0.2)


@pytest.mark.parametrize(
    ("stiffness", "damping", "square", "proved"),
    [(2, 0.2, 0, "6 "), (3, 0.2, 0, "8 "), (4, 0.2, 0, ""), (4, 0.2, 1, ""), (4, 0.5, 1, "6 ")],
)
def test_one_matrix_a_vertex(stiffness, damping, square, proved):
    """Proved where P(alpha) does at all points, elevated where it has to be; alone none does."""
    own, nothing = two(stiffness, damping), [[0.0, 0.0]]
    each = [solve_continuous_lyapunov(A.T, -np.eye(2) - square * A.T @ A) for A in own.A]
    worst = -np.inf
    for t in np.linspace(0, 1, 101):
        loop, P = (t * both[0] + (1 - t) * both[1] for both in (own.A, np.array(each)))
        worst = max(worst, np.linalg.eigvalsh(P @ loop + loop.T @ P).max())
    assert (worst < 0) == bool(proved)
    found = analyse(own, nothing, HalfPlane(0), lyapunov=each)
    assert found.lyapunov.count == 2
    assert found.lyapunov.proved == bool(proved)
    assert found.lyapunov.reason.startswith(proved)
    assert found.proved
    for P in each:
        alone = analyse(own, nothing, HalfPlane(0), lyapunov=[P])
        assert not alone.lyapunov.proved
        assert alone.proved


def test_what_is_refuted_names_the_car(family):
    found = analyse(family, [[0.0, 0.3]], HalfPlane(0))
    assert (found.answer, found.lyapunov, found.bounds) == ("refuted", None, ())
    assert found.pole.real > 0


def test_limits_are_proved_or_refuted():
    plant = UncertainPlant.from_vertices(
        [[[0.0, 1.0], [-1.0, -0.5]], [[0.0, 1.0], [-2.0, -0.5]]], [[[0], [1]]] * 2, [[[0], [1]]] * 2
    )
    # the static gain of x1 is 1 / stiffness; its peak, at c = 0.5, 2.07 where the stiffness is 1
    peak = 1 / (0.5 * np.sqrt(1 - 0.5**2 / 4))
    limits = [parse_specification(f"gain of x1 <= {peak * own:.9g}") for own in (1.01, 0.99)]
    found = analyse(plant, [[0.0, 0.0]], HalfPlane(0), limits=limits)
    assert [own.answer for own in found.bounds] == ["proved", "refuted"]
    assert found.bounds[0].bound.level == pytest.approx(peak, rel=3e-3)
    assert found.bounds[1].worst == pytest.approx(peak, rel=1e-4)
    assert found.bounds[1].alpha == pytest.approx((1, 0))
    assert found.answer == "refuted"


def test_laws_of_files(family):
    K = [[[-1.0, -2.0]], [[-3.0, -4.0]]]
    own = law_from(Arrays("f", {"K": K}), family)
    np.testing.assert_allclose(own.gain([0.25, 0.75]), [[-2.5, -3.5]])
    np.testing.assert_allclose(own.negated().gain([1, 0]), [[1, 2]])
    W = [[[2.0, 0.0], [0.0, 1.0]]] * 2
    other = law_from(Arrays("f", {"W": W, "Z": K}), family)
    np.testing.assert_allclose(other.gain([1, 0]), [[-0.5, -2]])
    np.testing.assert_allclose(other.negated().gain([1, 0]), [[0.5, 2]])
    (only,) = (law_from(Arrays("f", {"gain": K[:1]}), family),)
    assert isinstance(only.negated(), FixedGain)
    np.testing.assert_allclose(only.negated().K, [[1, 2]])
    assert analyse(family, other, HalfPlane(0)).proved


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"lyapunov": [P[:3]]}, "the Lyapunov matrix is 3 x 4"),
        ({"lyapunov": [P, P]}, "2 Lyapunov matrices; give one, or 1"),
        ({"lyapunov": [P * np.nan]}, "must be a finite number"),
    ],
)
def test_what_does_not_fit_is_said(given, said):
    plant = UncertainPlant.from_vertices([A], [B], [B])
    with pytest.raises(InputError, match=said):
        analyse(plant, K, HalfPlane(0), **given)


def test_without_a_limit_the_least_bound_is_proved():
    """Of x' = -x + w by hand: the H-infinity norm is 1."""
    plant = UncertainPlant.from_vertices([[[-1]], [[-2]]], [[[1]], [[1]]], [[[1]], [[1]]])
    asked = [parse_specification("gain of x1"), parse_specification("gain of x1 <= 0.9")]
    found = analyse(plant, [[0]], HalfPlane(0), limits=asked)
    free, limited = found.bounds
    assert free.answer == "proved"
    assert 1 <= free.bound.level < 1.001
    assert limited.answer == "refuted"
    assert limited.bound is None
    assert found.answer == "refuted"
    assert repr(free).startswith("<VerifiedBound: gain of x1, proved; 1")
    assert repr(limited).endswith("refuted; none proved, 1 sampled>")


def test_lyapunov_matrices_are_for_one_gain(family):
    law = law_from(Arrays("f", {"K": [[[-1.0, -2.0]], [[-3.0, -4.0]]]}), family)
    with pytest.raises(InputError, match="for one gain K"):
        analyse(family, law, HalfPlane(0), lyapunov=[np.eye(2)])
    with pytest.raises(InputError, match="holds neither a gain K nor W and Z"):
        law_from(Arrays("f", {"A": [], "B": []}), family)
