"""Lyapunov polynomials along motions, by interpolation: against closed forms, LMIs, the proof."""

from fractions import Fraction

import numpy as np
import pytest

from polefence import EnergyPeak, Parameter, Rms, UncertainPlant
from polefence.certify import bounds
from polefence.law.laws import FixedGain
from polefence.lmi.solve.along_motions import along_motions
from polefence.proof.claims.base import prove
from polefence.proof.laws import Evidence
from polefence.requirements.specification import claim_of

NONE = FixedGain(np.zeros((1, 2)))


def spring(rate, inverted=False):
    """A mass on a spring k, or of stiffness 1 / k, that moves; the force is the disturbance."""
    parameter = Parameter("k", 1, 2, rate=rate, through="1/k" if inverted else "k")
    A = [[0, 1], ["-1/k" if inverted else "-k", -1]]
    return UncertainPlant.from_expressions([parameter], A, [[0], [1]], [[0], [1]])


def least(plant, own, law=NONE):
    problem = own.dual(plant, law)
    worst = bounds.sampled(plant, law, own).worst
    return list(along_motions(problem, worst, 1e-4)), worst


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("own", [Rms("x1", density=1), EnergyPeak("x1", norm=2)])
def test_of_slow_motions_it_is_nearly_the_worst_at_rest_and_proved(own, inverted):
    plant = spring([-1e-3, 1e-3], inverted)
    found, worst = least(plant, own)
    if not inverted and isinstance(own, Rms):  # by hand: the variance of x is S / (2 d k)
        assert worst == pytest.approx(np.sqrt(0.5 / 2), rel=1e-6)
    last = found[-1]
    assert worst <= last.level <= worst * 1.01
    assert len(last.cells) == 1
    every = last.X[0] / (own.norm**2 if isinstance(own, EnergyPeak) else 1)
    X = [[[Fraction(x) for x in row] for row in Q] for Q in every.tolist()]
    for factor, proved in ((1 + 1e-6, True), (1 - 1e-6, False)):
        level = Fraction(last.level * factor)
        claim = claim_of(plant, NONE.exact, "box", own, Evidence(X, last.degree), level)
        assert prove(claim).proved is proved


def test_what_moves_faster_costs_more_and_at_some_rate_all():
    """The least bound of an LMI of one degree is no more; parameters at any rate have none."""
    levels = []
    for rate in (0.01, 0.1, 0.3):
        plant = spring([-rate, rate])
        found, worst = least(plant, Rms("x1", density=1))
        assert all(own.level >= worst for own in found)
        levels.append(min(own.level for own in found))
    assert levels == sorted(levels)
    assert levels[0] < levels[-1]
    assert least(spring("any"), Rms("x1", density=1))[0] == []


def test_a_bound_along_motions_is_found_where_the_lmi_is_too_large(monkeypatch):
    """Without degree 1 an LMI has one matrix for motions of any rate, and no bound here."""
    plant, own = spring([-0.02, 0.02]), Rms("x1", density=1)
    monkeypatch.setattr(bounds, "MOST_WORK", 0.0)
    bound = bounds.best_bound(plant, NONE, own)
    assert bound.level <= bounds.sampled(plant, NONE, own).worst * 1.03
    kept = Rms("x1", density=1, at_most=bound.level * 1.01)
    assert bounds.kept_bound(plant, NONE, kept) is not None
    peak = bounds.best_bound(plant, NONE, EnergyPeak("x1", norm=2))
    assert peak.level <= bounds.sampled(plant, NONE, EnergyPeak("x1", norm=2)).worst * 1.03
