"""The compiled second prover: claims about poles decided in whole numbers of fixed length.

It builds the inequalities of `polefence.proof.claims.poles` from the same doubles and rationals, in
whole numbers that it has bounded beforehand, and says whether all of them are positive definite,
exactly, or that it does not know. Where it does not, or is not there, the checker proves. Searches
ask it what holds; the checker remains the judge of what is saved, loaded or checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.kernel import kernel
from polefence.base.progress import stage
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array
from polefence.proof.matrices import least_work
from polefence.proof.reading import LARGEST, is_double
from polefence.proof.regions import KINDS, MAX_PARTS, parts_of
from polefence.proof.work import MAX_WORK, FormatError
from polefence.region.regions import Region

if TYPE_CHECKING:
    from polefence.certify.certificate import Certificate

_ANSWERS = {1: True, 0: False}
# What evidence may hold: all of these are read here, and the checker refuses others.
_KEYS = {
    "quadratic": {"W"},
    "scheduled": {"tau", "elevation"},
    "lyapunov": {"on", "parts"},
    "slack": {"P", "G", "degree", "elevation", "on"},
}
_PART = {"X", "degree", "elevation"}

Pair = tuple[Array, Array]


@stage("proof")
def holds(certificate: Certificate) -> bool | None:
    """Return whether the evidence proves the claim, exactly; None where it is not known."""
    prover, ask = kernel(), _METHODS.get(certificate.method)
    if prover is None or ask is None or not hasattr(prover, "poles") or certificate.plant.remainder:
        return None
    if certificate.plant.moving:  # along motions there is more to prove
        return None
    if len(certificate.region.parts) > MAX_PARTS:  # which the checker refuses
        return None
    on = certificate.evidence.get("on", "simplex")
    boxed = "box" in (on, certificate.law.domain.on)
    if boxed and not certificate.plant.parameters:
        return None
    try:
        _require(certificate.evidence.keys() <= _KEYS[certificate.method])
        return ask(prover, certificate)
    except (AttributeError, LookupError, TypeError, ValueError):  # which the checker says better
        return None


def _quadratic(prover: Any, certificate: Certificate) -> bool | None:
    domain, evidence = Domain.of("simplex", len(certificate.plant.vertices)), certificate.evidence
    form = _polynomial(domain, 0, evidence["W"][None])
    return _poles(
        prover, certificate, domain, certificate.region.parts, (_gain(certificate, domain), form)
    )


def _scheduled(prover: Any, certificate: Certificate) -> bool | None:
    law, evidence = certificate.law, certificate.evidence
    if law.W is None:
        return None
    _require(law.domain.corners == len(certificate.plant.vertices))
    elevation, tau = _whole(evidence.get("elevation", 1)), np.asarray(evidence["tau"])
    _require(tau.dtype == np.float64 and not tau.shape)
    theorem = _whole(law.degree) == elevation == 1 == len(law.domain.sizes)
    if tau and not (theorem and certificate.region.circle):
        return None
    form = _polynomial(law.domain, law.degree, law.form)
    parts = certificate.region.parts
    return _poles(
        prover, certificate, law.domain, parts, (form, None), law.degree, elevation, float(tau)
    )


def _given(prover: Any, certificate: Certificate) -> bool | None:
    evidence, N = certificate.evidence, len(certificate.plant.vertices)
    if certificate.law.K is None or certificate.in_parts:
        return None
    domain, answers = Domain.of(str(evidence.get("on", "simplex")), N), list[bool | None]()
    for part, piece in zip(certificate.region.parts, evidence["parts"], strict=True):
        _require(piece.keys() <= _PART and piece["X"].dtype != object)  # the prover takes doubles
        degree, elevation = _whole(piece["degree"]), _whole(piece["elevation"])
        X = _polynomial(domain, degree, piece["X"])
        forms = _gain(certificate, domain), X
        answers.append(_poles(prover, certificate, domain, (part,), forms, degree, elevation))
    return False if False in answers else None if None in answers else True


def _slack(prover: Any, certificate: Certificate) -> bool | None:
    evidence, region = certificate.evidence, certificate.region
    if region.circle is None:
        return None
    domain = Domain.of(str(evidence.get("on", "simplex")), len(certificate.plant.vertices))
    degree = _whole(evidence.get("degree", 1))
    highest = max(degree, 1) + _whole(evidence.get("elevation", 0))
    forms = (
        _gain(certificate, domain),
        _polynomial(domain, degree, evidence["P"]),
        _polynomial(domain, 0, evidence["G"][None]),
    )
    count = domain.count(highest)
    if not _usual(certificate, count, forms):
        return None
    plant, ends = _plant(certificate, domain), region.circle
    raises = highest - degree, highest - 1
    return _ANSWERS.get(prover.slack(domain.sizes, plant, *forms, *ends, *raises, count))


_METHODS = {
    "quadratic": _quadratic,
    "scheduled": _scheduled,
    "lyapunov": _given,
    "slack": _slack,
}


def _poles(
    prover: Any,
    certificate: Certificate,
    domain: Domain,
    parts: Sequence[Region],
    forms: tuple[Any, Any],
    degree: int = 0,
    elevation: int = 0,
    tau: float = 0.0,
) -> bool | None:
    """Ask for [X; K X] = form V, or form alone."""
    pairs, count = _pairs(parts), domain.count(degree + 1 + elevation)
    if pairs is None or not _usual(certificate, count * len(pairs), forms):
        return None
    positive = any(not KINDS[part.kind].definite for part in parts)
    plant = _plant(certificate, domain)
    return _ANSWERS.get(
        prover.poles(domain.sizes, plant, *forms, pairs, tau, elevation, count, positive)
    )


def _usual(certificate: Certificate, count: int, forms: Sequence[Any]) -> bool:
    """Whether the checker takes such a claim for certain."""
    values = [form[2] for form in forms if form is not None]
    sides = 2 * certificate.plant.shape[0] * (2 if certificate.method == "slack" else 1)
    # what is proved here must not be more than is checked there, long numbers or not
    return least_work(count, sides) <= MAX_WORK // 8 and all(
        np.abs(entries).max() < LARGEST
        for entries in values  # nan is not
    )


def _pairs(parts: Sequence[Region]) -> list[Pair] | None:
    """Return L and M of the parts, None where doubles do not hold them."""
    pairs = [pair for part in parts for exact in parts_of(part.document()) for pair in exact.pairs]
    if not all(is_double(e) for pair in pairs for M in pair for row in M for e in row):
        return None
    return [(np.array([L], dtype=float), np.array([M], dtype=float)) for L, M in pairs]


def _gain(certificate: Certificate, domain: Domain) -> Any:
    """Return [I; K] of one gain."""
    law = certificate.law
    if law.K is None:
        raise FormatError("the law is not a gain")
    return _polynomial(domain, 0, law.form)


def _plant(certificate: Certificate, domain: Domain) -> Any:
    data, denominator, words = certificate.plant.words
    return _powers(domain.sizes, 1)[0], data, denominator, certificate.plant.shape[0], words


def _polynomial(domain: Domain, degree: int, coefficients: Array) -> Any:
    """Return a polynomial as the kernel has it: of doubles, which nothing rounds."""
    values = np.asarray(coefficients)
    _require(values.dtype == np.float64 and len(values) == domain.count(degree))
    return *_powers(domain.sizes, degree), np.ascontiguousarray(values)


def _whole(value: Any) -> int:
    _require(type(value) is int)
    return int(value)


def _require(fine: bool) -> None:
    """Leave to the checker what it may refuse."""
    if not fine:
        raise FormatError("this is no evidence as searches find it")


@lru_cache(maxsize=64)
def _powers(sizes: tuple[int, ...], degree: int) -> tuple[Any, Any]:
    """Return exponents and multinomials of all monomials."""
    monomials = Domain(sizes).monomials(degree)
    exponents = np.array(monomials, dtype=np.int64).reshape(len(monomials), -1)
    return exponents, np.array([binomial(sizes, e) for e in monomials], dtype=np.int64)
