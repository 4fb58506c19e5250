"""Relative rms values by dual polynomials: thresholds, values at a point, one fault at a time."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence.certify import bounds
from polefence.law.laws import FixedGain
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_actuator
from polefence.plant.parameters import Parameter
from polefence.proof.claims import RelativeRms, prove
from polefence.proof.claims.relative_rms import Baseline, baseline_loop
from polefence.proof.document import check, loads
from polefence.proof.laws import Evidence, Piece
from polefence.proof.work import FormatError
from polefence.requirements.relative_rms import RelativeRms as Ratio
from support.duals import Case, rationals

FORMS = (("fixed", 0), ("fixed", 2), ("scheduled", 2), ("polynomial", 1), ("measured", 2))
LESS = 1e-3  # of the noise, by which P is less than the covariance without control


class Shared(Case):
    """A random loop, and the same plant without control, which is stable."""

    def __init__(self, form):
        super().__init__("rms", form)
        self.C = self.C[:, :1]
        self.D, self.F = self.D[:, :1], self.F[:, :1]

    def without(self, alpha):
        """The covariance without control, of the noise and of some on every state."""
        A, E = (np.tensordot(alpha, M, 1) for M in (self.A, self.E))
        noise = E @ E.T
        every = np.trace(noise) * np.eye(len(A))
        return [solve_continuous_lyapunov(A, -own) for own in (noise - LESS * every, every)]

    def value(self, alpha):
        A, E, C = (np.tensordot(alpha, M, 1) for M in (self.A, self.E, self.C))
        own = C @ solve_continuous_lyapunov(A, -E @ E.T) @ C.T
        return super().value(alpha) / np.sqrt(own.item())

    def claim(self, level, evidence=None):
        own = super().claim(level, evidence)
        subject, nodes = own.subject, self.domain.nodes(4)
        values = np.array([self.without(alpha) for alpha in nodes])
        P, X = (self.domain.interpolated(values[:, k], 4) for k in range(2))
        both = (Evidence([rationals((M + M.T) / 2) for M in each], 4) for each in (X, P))
        loop = baseline_loop(subject, own.outputs[0], None, (0, 1))
        return RelativeRms(subject, own.outputs, own.level, Baseline(*loop, *both))


@pytest.mark.parametrize("form", FORMS)
def test_a_ratio_is_proved_a_little_above_samples_and_not_below(form):
    case = Shared(form)
    document = case.document(case.worst * 1.1)
    assert document.claims[0].subject.evidence.dual
    read = loads(document.dumps())
    assert read.claims == document.claims
    assert check(read).proved
    assert not prove(
        case.claim(case.worst * (1 - 1e-9), document.claims[0].subject.evidence)
    ).proved


@pytest.mark.parametrize("form", FORMS)
def test_the_noise_is_compared_with_that_without_control(form):
    """At a point, on both sides of the level that the polynomials there have."""
    case, random = Shared(form), np.random.default_rng(2)
    claim = case.claim(1.0)
    own = np.concatenate([random.dirichlet(np.ones(size)) for size in case.domain.sizes])
    alpha = case.domain.alpha(own)
    evidence, base = claim.subject.evidence, claim.baseline

    def at(each):
        basis = case.domain.basis(alpha, each.degree)
        return np.tensordot(basis, np.array(each.X, dtype=float), 1)

    E, C = (np.tensordot(alpha, M, 1) for M in (case.E, case.C))
    ratio = np.trace(E.T @ at(evidence) @ E) / (C @ at(base.covariance) @ C.T).item()
    for share, sign in ((1.001, 1), (0.999, -1)):
        level = Fraction(float(np.sqrt(ratio) * share))
        rows = {each.name: each for each in replace(claim, level=level).inequalities()}
        blocks = rows["of the noise"].blocks()
        value = sum(np.prod(np.power(own, e.powers)) * matrix[0][0] for e, matrix in blocks)
        assert np.sign(value) == sign


def test_what_does_not_belong_to_a_ratio_is_refused():
    case = Shared(("fixed", 2))
    claim = case.claim(case.worst * 1.1)
    own, zero, one = claim.subject.evidence, (Fraction(0),) * 2, (Fraction(1),) * 2
    cells = Evidence([], dual=True, cells=(Piece(zero, one, own),))
    with pytest.raises(FormatError, match="none here"):
        prove(replace(claim, subject=replace(claim.subject, evidence=cells)))
    # a P that is not below the covariance, and an X that shows no stability
    base = claim.baseline
    larger = [[[2 * x for x in row] for row in P] for P in base.covariance.X]
    turned = [[[-x for x in row] for row in X] for X in base.stability.X]
    for wrong, name in (
        (replace(base, covariance=replace(base.covariance, X=larger)), "noise"),
        (replace(base, stability=replace(base.stability, X=turned)), "X"),
    ):
        answer = prove(replace(claim, baseline=wrong))
        assert not answer.proved
        assert f"of the baseline's {name} at" in answer.reason


def springs(low, high):
    """A damped mass on a spring; a force moves it."""
    return UncertainPlant.from_expressions(
        [Parameter("k", low, high, "N/m")], [[0, 1], ["-k", -1]], [[0], [1]], [[0], [1]],
        states=("x [m]", "v [m/s]"), inputs=("u [N]",), disturbances=("w [N]",),
    )  # fmt: skip


@pytest.mark.parametrize("actuator", [False, True])
def test_the_search_comes_near_to_samples(actuator):
    """Also where nothing moves a state without control. u = -k0 x - d v is a stiffer spring."""
    plant, K = springs(1, 1.2), np.array([[-1.0, -1.0]])
    if actuator:
        plant, K = with_actuator(plant, "u", 10), np.array([[-1.0, -1.0, 0]])
    law, spec = FixedGain(K), Ratio("x")
    question = bounds._Question.of(plant, law, spec)
    found = list(bounds._dual_bounds(question))
    assert found
    worst = bounds.sampled(plant, law, spec).worst
    if not actuator:  # by hand: the variance of x is S / (2 d k)
        ratios = [np.sqrt(k / (2 * (k + 1))) for k in np.linspace(1, 1.2, 1000)]
        assert worst == pytest.approx(max(ratios), rel=1e-6)
    assert worst <= found[-1].level <= worst * (1 + 5e-3)
    assert prove(found[-1].claim).proved
    assert question.in_parts(worst * 2) is None
    near = replace(spec, at_most=worst * (1 + 1e-2))
    assert bounds.kept_bound(plant, law, near) is not None
    assert bounds.kept_bound(plant, law, replace(spec, at_most=worst * (1 - 1e-3))) is None
