"""Bounds on signals are proved of any law that does its work, whatever the coordinates."""

import itertools
import time

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from polefence import FixedGain, ScheduledGain, UncertainPlant
from polefence.base.errors import InputError, SolverError
from polefence.certify import bounds
from polefence.certify.bounds import best_bound, kept_bound
from polefence.lmi.solve.loops import loop_with
from polefence.lmi.solve.lyapunov import least_given
from polefence.plant.outputs import Output
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms


def lags(count, coupling=1.0):
    """One lag of 1 s after another; the last is disturbed."""
    A = -np.eye(count) + coupling * np.eye(count, k=1)
    end = np.eye(count)[:, -1:]
    return A, UncertainPlant.from_vertices([A], [end], [end])


@pytest.mark.parametrize("count", [2, 6])
@pytest.mark.parametrize("kind", [Rms, Gain])
def test_lags_in_series_are_bounded(count, kind):
    A, plant = lags(count)
    law = FixedGain(np.zeros((1, count)))
    end = np.eye(count)[:, -1:]
    X = solve_continuous_lyapunov(A, -end @ end.T)
    least = np.sqrt(X[0, 0] / 2) if kind is Rms else 1.0  # (s + 1)^-count at zero frequency
    found = best_bound(plant, law, kind("x1"))
    assert found is not None
    assert least * (1 - 1e-9) <= found.level <= least * 1.001
    assert kept_bound(plant, law, kind("x1", at_most=1.01 * least)) is not None
    assert kept_bound(plant, law, kind("x1", at_most=0.99 * least)) is None


def test_a_piezoelectric_actuator_is_bounded():
    # PAS of COMPleib (Leibfritz, 2004): a mode at 524 1/s beside integrators
    A = np.zeros((5, 5))
    A[0, 1] = A[3, 0] = A[4, 3] = 1.0
    A[1, :3], A[2, 2] = [-274921.63, -73.2915, -274921.63], -0.9597
    B = np.array([[0], [0.12841], [-3.39561e-07], [0], [0]])
    E = np.array([[0, 0], [-274921.63, 0], [0, 0], [0, -1], [0, 0]])
    P = solve_continuous_are(A, B / 0.12841, np.eye(5), np.eye(1))
    K = -B.T / 0.12841**2 @ P
    plant = UncertainPlant.from_vertices([A], [B], [E])
    found = best_bound(plant, FixedGain(K), Gain("x5"))
    static = np.linalg.norm(np.linalg.solve(A + B @ K, E)[4])
    frequencies = np.geomspace(1e-4, 1, 2000)
    worst = max(
        np.linalg.norm(np.linalg.solve(1j * w * np.eye(5) - A - B @ K, E)[4]) for w in frequencies
    )
    assert found is not None
    assert max(worst, static) * (1 - 1e-6) <= found.level <= 1.01 * max(worst, static)


def test_a_singular_law_is_a_failed_search():
    _, plant = lags(2)
    law = ScheduledGain(np.ones((1, 2, 2)), np.zeros((1, 1, 2)))
    source, output = Gain("x1").condition(plant, law.domain_of(plant))
    with pytest.raises(SolverError):
        least_given(loop_with(plant, law, output.C, output.D), source, output, 0, 0)
    assert best_bound(plant, law, Gain("x1")) is None


def test_a_slow_clock_changes_no_bound(monkeypatch):
    hours = itertools.count()
    monkeypatch.setattr(time, "perf_counter", lambda: 3600.0 * next(hours))
    As = [[[0, 1], [-k, -0.5]] for k in (1, 9)]
    plant = UncertainPlant.from_vertices(As, [[[0], [1]]] * 2, [[[0], [1]]] * 2)
    found = best_bound(plant, FixedGain(np.zeros((1, 2))), Rms("x1"))
    assert found is not None
    assert found.claim.subject.evidence.transfer  # no Lyapunov matrix is common to both


def test_a_loop_that_doubles_call_unstable_has_its_bound(monkeypatch):
    """Of a pole next to the axis the sign is lost in rounding; the proof is exact."""

    def refused(*_):
        raise InputError("it has a pole at 2.7e-07 1/s")

    monkeypatch.setattr(bounds, "sampled", refused)
    A, B = [[-1, 0], [1, -2]], [[1], [0]]
    y = Output("y", "", C=[[1.0, 0.0]])
    plant = UncertainPlant.from_vertices([A], [B], [B], outputs=(y,))
    bound = best_bound(plant, FixedGain(np.zeros((1, 2))), Rms("y", density=2))
    assert bound is not None
    assert "transfer function" in bound.reason  # a Lyapunov matrix may be too ill-conditioned
    assert bound.level == pytest.approx(0.5**0.5, rel=1e-5)  # of x' = -x + w, intensity 1
