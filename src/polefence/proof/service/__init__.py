"""Prove how much may go wrong in service, in exact arithmetic, from a design's own matrices.

With X = W (of the law K = Z W^-1; for one gain its Lyapunov matrix), or of a law that was given
(the method lyapunov) each part's own X, three claims, each about every parameter value of the
plant, or every alpha where the plant has no parameters:

    estimate  all poles of A(p) + B(p) K(q) lie in the region for all p, q with |p_i - q_i| <= e_i:
              F > 0 for X = X(q), N = A(p) X(q) + B(p) K(q) X(q), a polynomial. At each q, F is
              multi-affine in the scheduling variables of p: p_i = q_i + e_i and q_i - e_i, cut off
              at the bounds, are enough. Between the points where a bound begins to act both are
              affine in q_i, and times p_i, or q_i, so is what is affine in 1/p_i, or 1/q_i.
              Without parameters: p = (1 - e) a + e u, q = (1 - e) a + e v, a, v in the simplex, u
              its corners.
    gain      all poles of A + B (K + e S D T) lie in the region for all |D| <= 1, S and T the
              diagonal matrices of ``rows`` and ``columns``, or T any matrix: for each L, M = M1 M2
              there is mu > 0 (Petersen 1987) with
              [ F, mu M1 (x) B S, e M2' (x) W T' ; *, mu I, 0 ; *, 0, mu I ] > 0.
              Of a law that was given in the certificate's own domain and degrees; see `given`.
    rate      x' X^-1 x decreases faster than exp(-2 a t) for all |dp_i/dt| <= r_i:
              -(N + N' + 2 a X) + dX/dt > 0, X of one part of the region, all signs; d(1/p)/dt =
              -(1/p)^2 dp/dt. Without parameters alpha' = r (u - v), u and v corners.

F = -(L (x) X + M (x) N + M' (x) N') for each part of the region. Every inequality is a polynomial,
homogeneous in the coordinates of pieces of the intervals; it holds if all of its coefficients,
times (sum of coordinates)^elevation, are positive definite. Integers and the standard library only.
"""

from __future__ import annotations

import math
from fractions import Fraction

from polefence.proof.definite import is_positive_definite, least_work
from polefence.proof.matrices import _is_symmetric
from polefence.proof.placement import Claim, Verdict, simplices
from polefence.proof.polynomials import MAX_DEGREE, _number
from polefence.proof.regions import _characteristic_pairs, require_region
from polefence.proof.service.claims import (
    MAX_BLOCKS,
    MAX_PIECES,
    Estimate,
    Gain,
    Range,
    Rate,
    ServiceClaim,
    Subject,
)
from polefence.proof.service.given import asymmetric, count_given, require_given
from polefence.proof.service.inequalities import blocks
from polefence.proof.service.pieces import degree_of, parts_of
from polefence.proof.service.reading import FORMAT, read_service
from polefence.proof.work import MAX_WORK, FormatError, counted

__all__ = [
    "FORMAT",
    "MAX_PIECES",
    "Estimate",
    "Gain",
    "Range",
    "Rate",
    "ServiceClaim",
    "Subject",
    "blocks",
    "prove_service",
    "read_service",
]


def prove_service(claim: ServiceClaim) -> Verdict:
    """Decide whether the design's own matrices prove the claim; False does not refute it.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    with counted():
        _require_consistent(claim)
        return _proved(claim)


def _proved(claim: ServiceClaim) -> Verdict:
    fault = _asymmetric(claim.subject.design)
    if fault:
        return Verdict(False, f"{fault} is not symmetric")
    count = 0
    for name, matrix in blocks(claim):
        if not is_positive_definite(matrix):
            return Verdict(False, f"inequality {name} is not positive definite")
        count += 1
    return Verdict(True, f"{count} inequalities positive definite in exact arithmetic")


def _asymmetric(design: Claim) -> str:
    """Name a matrix that ought to be symmetric and is not; "" where there is none."""
    if design.method == "lyapunov":
        return asymmetric(design)
    matrices = design.law.W if design.method == "scheduled" else design.evidence[0].X
    return next((f"W {k + 1}" for k, w in enumerate(matrices or []) if not _is_symmetric(w)), "")


def _require_consistent(claim: ServiceClaim) -> None:
    subject = claim.subject
    design, count = subject.design, max(len(subject.ranges), 1)
    n, m = len(design.A[0]), len(design.B[0][0])
    require_region(design.region)
    varying = _require_method(claim)
    if subject.ranges and len(design.A) != 2 ** len(subject.ranges):
        raise FormatError(
            f"{len(subject.ranges)} parameters need {2 ** len(subject.ranges)} corners"
        )
    if not subject.ranges and len(simplices(design)) > 1:
        raise FormatError("a law on a box needs the parameters' ranges")
    for r in subject.ranges:
        if r.low >= r.high or (r.inverted and r.low <= 0 <= r.high):
            raise FormatError("a parameter's range is empty, or touches zero where 1/p is used")
    if len(subject.pieces) != len(subject.ranges):
        raise FormatError("pieces must hold one whole number a parameter")
    if any(not 1 <= pieces <= MAX_PIECES for pieces in subject.pieces):
        raise FormatError(f"pieces must be 1 to {MAX_PIECES}")
    if not 0 <= subject.elevation <= MAX_DEGREE:
        raise FormatError(f"elevation must be 0 to {MAX_DEGREE}")
    pairs = sum(len(_characteristic_pairs(part)) for part in design.region)
    if isinstance(claim, Estimate):
        _numbers(claim.errors, count, "errors")
        if not subject.ranges and claim.errors[0] > 1:
            raise FormatError("errors: a share is at most 1")
    elif isinstance(claim, Gain):
        _numbers((claim.error,), 1, "error")
        for key, length in (("rows", m), ("mu", pairs)):
            _numbers(getattr(claim, key), length, key, positive=True)
        _require_columns(claim, n)
    else:
        _numbers((claim.decay,), 1, "decay")
        if claim.rates is not None:
            _numbers(claim.rates, count, "rates")
        elif varying:
            raise FormatError("rates: only one W for all parameters holds at any rate")
    count, size = _work(claim, varying)
    if count > MAX_BLOCKS or least_work(count, 2 * size) > MAX_WORK:
        raise FormatError("these are more inequalities, or larger ones, than are checked here")


def _require_method(claim: ServiceClaim) -> bool:
    """Refuse designs that have no proofs for service; return whether X differs with alpha."""
    design = claim.subject.design
    if design.method == "lyapunov":
        require_given(design)
        if isinstance(claim, Gain) and any(pieces != 1 for pieces in claim.subject.pieces):
            raise FormatError("pieces must be 1 for errors of a gain that was given")
    elif design.method not in ("scheduled", "quadratic"):
        raise FormatError(f"the method {design.method} has no proofs for service")
    part = claim.part if isinstance(claim, Rate) else 0
    if not 0 <= part < len(design.evidence):
        raise FormatError(f"part must be 1 to {len(design.evidence)}")
    return degree_of(design, part) > 0


def _numbers(values: tuple[Fraction, ...], count: int, key: str, positive: bool = False) -> None:
    if len(values) != count:
        raise FormatError(f"{key} must hold {count} numbers")
    if any(value < 0 or (positive and not value) for value in values):
        raise FormatError(f"{key} must be {'positive' if positive else 'zero or more'}")


def _require_columns(claim: Gain, n: int) -> None:
    numbers = tuple(c for c in claim.columns if isinstance(c, Fraction))
    if numbers or len(claim.columns) != n:
        _numbers(numbers, n, "columns", positive=True)
    elif any(len(row) != n for row in claim.right):
        raise FormatError(f"columns must hold {n} rows of {n} numbers")


def _work(claim: ServiceClaim, varying: bool) -> tuple[int, int]:
    """Return how many inequalities there are at most, W > 0 left out, and half their size."""
    subject, size = claim.subject, len(claim.subject.design.A[0])
    if isinstance(claim, Gain) and subject.design.method == "lyapunov":
        return count_given(claim), 2 * size + len(claim.rows)
    N, q = len(subject.design.A), len(subject.ranges)
    numbers = [claim.part] if isinstance(claim, Rate) else [k for k, _ in parts_of(subject.design)]
    degree = max(degree_of(subject.design, k) for k in numbers)
    raised = degree + 1 + subject.elevation
    each = math.prod(subject.pieces) * len(subject.design.region)
    if isinstance(claim, Gain):
        size = 2 * size + len(claim.rows)
    elif isinstance(claim, Estimate) and q:
        for pieces, error in zip(subject.pieces, claim.errors, strict=True):
            each = each // pieces * 2 * (pieces + 1) if error else each
    elif isinstance(claim, Estimate):
        each *= N * _number((N,), degree)
    elif varying:
        each *= 2 ** sum(1 for r in claim.rates or () if r) if q else N * N
    return each * ((raised + 1) ** q if q else _number((N,), raised)), size
