"""Margins of polynomial laws: against samples and errors put in by hand; what has none."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence.certify.margins import estimation_error, gain_error, in_service, parameter_rate
from polefence.law.laws import PolynomialGain
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from support.polynomials import REGION, design

KINDS = ("affine", "square", "measured", "alpha")


def off_by(own, errors, sign, values):
    """Poles of the plant at values, its law told others."""
    p = own.plant.parameters
    true = {each.name: float(v) for each, v in zip(p, values, strict=True)}
    low, high = ([float(getattr(each, end)) for each in p] for end in ("low", "high"))
    told = np.clip(np.array(list(true.values())) + sign * errors, low, high)
    alpha, other = own.plant.alpha(**true), own.plant.alpha(**dict(zip(true, told, strict=True)))
    A, B = own.plant.at(alpha)
    return np.linalg.eigvals(A + B @ own.law.gain(other))


@pytest.mark.parametrize("kind", ["affine", "square", "measured"])
def test_estimates_that_are_off_keep_the_region(kind):
    own, random = design(kind), np.random.default_rng(0)
    margin = next(each for each in estimation_error(own) if not each.parameter)
    assert margin.proved
    errors = np.array([float(v) for v in margin.claim.errors])
    assert np.all(errors > 0)
    p = own.plant.parameters
    for _ in range(300):
        values = [random.uniform(float(each.low), float(each.high)) for each in p]
        sign = random.choice([-1, 1], len(p))
        assert REGION.contains(off_by(own, errors, sign, values))


@pytest.mark.parametrize("kind", [*KINDS, "one gain", "many", "varying"])
def test_gains_that_are_off_keep_the_region_and_break_it_beyond(kind):
    own, random = design(kind), np.random.default_rng(1)
    margin = gain_error(own)
    assert margin.proved
    assert margin.upper is None or margin.upper > margin.value
    law, off = own.law, float(margin.claim.error) * np.array(margin.claim.sizes, dtype=float)
    of_signals = isinstance(law, PolynomialGain) and law.measured
    gains = law.own_gain(np.eye(4)) if of_signals else law.gain(np.eye(4))
    assert np.allclose(np.abs(gains).max(axis=0) * float(margin.claim.error), off, rtol=1e-12)
    for _ in range(200):
        s, t = random.uniform(size=2)
        alpha = np.kron([1 - s, s], [1 - t, t])
        D = off * random.choice([-1.0, 1.0, random.uniform()], size=off.shape)
        A, B = own.plant.at(alpha)
        C = np.eye(4)
        if of_signals:
            C = law.C[0] if len(law.C) == 1 else np.tensordot(alpha, law.C, 1)
        assert REGION.contains(np.linalg.eigvals(A + B @ (law.gain(alpha) + D @ C)))
    if margin.upper is not None:
        assert margin.upper < 3 * margin.value


@pytest.mark.parametrize("kind", [*KINDS, "one gain", "varying"])
def test_any_rate_is_proved_by_one_lyapunov_matrix_whatever_the_law(kind):
    """X is constant here: the law's degree is none of it."""
    own = design(kind)
    assert own.certificate.evidence["parts"][0]["degree"] == 0
    (margin,) = parameter_rate(own)
    assert math.isinf(margin.value)
    assert margin.claim.rates is None
    assert prove(margin.claim).proved


def test_a_lyapunov_polynomial_that_varies_has_no_claim_of_any_rate():
    (margin,) = parameter_rate(design("affine"))
    evidence = margin.claim.subject.design.evidence
    X = [evidence[0].X[0]] * 4
    vary = (replace(evidence[0], X=X, degree=1),)
    subject = replace(
        margin.claim.subject, design=replace(margin.claim.subject.design, evidence=vary)
    )
    with pytest.raises(FormatError, match="any rate"):
        prove(replace(margin.claim, subject=subject))


def test_one_gain_of_signals_needs_no_estimate():
    assert all(each.kind != "estimate" for each in in_service(design("one gain")))


def test_signals_that_vary_have_no_proof_of_errors_of_the_estimate():
    """C is of the plant's own parameters, K of their estimates: no such loop is proved."""
    own, other = design("varying"), design("measured")
    assert not any(each.proved for each in estimation_error(own))
    claim = next(each.claim for each in estimation_error(other) if not each.parameter)
    subject = replace(claim.subject, design=own.certificate.claim())
    with pytest.raises(FormatError, match="outputs must not vary"):
        prove(replace(claim, subject=subject, errors=(Fraction(0), Fraction(0))))


def test_a_break_of_signals_that_vary_is_that_of_the_plants_own_signals():
    """Found with K told another value, and what is measured the plant's own."""
    own = design("varying")
    alpha, other = own.plant.alpha(m1=240, beta=-9), own.plant.alpha(m1=340, beta=9)
    K = own.law.told(alpha, other)
    C = np.tensordot(alpha, own.law.C, 1)
    assert np.allclose(K, own.law.own_gain(other) @ C, rtol=1e-14)
    assert not np.allclose(K, own.law.gain(other), rtol=1e-3)
