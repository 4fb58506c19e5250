"""Checks that a claim is complete and consistent, and asks for no more work than is done here."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from polefence.proof import definite, placement
from polefence.proof.definite import least_work
from polefence.proof.matrices import LONGEST, Rationals, _denominator, _integers, _is_symmetric
from polefence.proof.performance.claims import (
    MAX_POINTS,
    EnergyPeak,
    Gain,
    GainNorm,
    InitialPeak,
    PerformanceClaim,
    RelativeRms,
    Rms,
    Subject,
)
from polefence.proof.placement import Claim, Evidence
from polefence.proof.polynomials import MAX_DEGREE, _number
from polefence.proof.regions import Part
from polefence.proof.work import MAX_WORK, FormatError


def simplices(subject: Subject) -> tuple[int, ...]:
    """Return the number of corners of each simplex."""
    return placement.simplices(_design(subject))


def _design(subject: Subject) -> Claim:
    """Return a claim of the same loop and evidence about the half-plane Re z < 0."""
    evidence = subject.evidence
    if not evidence.X and subject.law.W is not None:
        evidence, method = replace(evidence, multiple=()), "scheduled"
    else:
        method = "lyapunov"
    region = (Part("half_plane", (Fraction(0),)),)
    return Claim(method, subject.A, subject.B, region, subject.law, (evidence,), subject.on)


def require_consistent(claim: PerformanceClaim) -> None:
    """Refuse what is incomplete, of shapes that do not fit, or out of all proportion.

    Raises
    ------
    FormatError
        Saying what.
    """
    subject = claim.subject
    if not subject.A or not subject.A[0] or not subject.B or not subject.B[0]:
        raise FormatError("vertices are missing")
    N, n, m = len(subject.A), len(subject.A[0]), len(subject.B[0][0])
    q = len(subject.E[0][0]) if subject.E and subject.E[0] else 0
    _shapes(subject.A, N, n, n, "A")
    _shapes(subject.B, N, n, m, "B")
    if isinstance(claim, GainNorm):
        _gain_norm(claim, n, m)
        return
    _shapes(claim.output.C, N, 1, n, "C")
    _shapes(claim.output.D, N, 1, m, "D")
    if q:
        _shapes(subject.E, N, n, q, "E")
    _law_and_evidence(subject, n, m)
    for key in ("level", "intensity", "norm"):
        if getattr(claim, key, 0) < 0:
            raise FormatError(f"{key} must be zero or more")
    if isinstance(claim, Rms | RelativeRms | EnergyPeak | Gain) and not q:
        raise FormatError("E is missing: no disturbance acts on the loop")
    if isinstance(claim, InitialPeak):
        _initial(claim, n, q)
    if isinstance(claim, Gain) and claim.F:
        _shapes(list(claim.F), N, 1, q, "F")
    if isinstance(claim, RelativeRms):
        _baseline(claim, N, q)
    if _work(claim, n + q + 1) > MAX_WORK:
        raise FormatError("these are more inequalities, or larger ones, than are checked here")


def _shapes(matrices: list[Rationals], count: int, rows: int, columns: int, where: str) -> None:
    if len(matrices) != count:
        raise FormatError(f"{where} holds {len(matrices)} matrices, not {count}")
    for k, matrix in enumerate(matrices):
        if not columns or len(matrix) != rows or any(len(row) != columns for row in matrix):
            raise FormatError(f"{where} {k + 1} is not {rows} x {columns}")


def _law_and_evidence(subject: Subject, n: int, m: int) -> None:
    law, evidence = subject.law, subject.evidence
    for matrices, rows, where in (
        (law.K, m, "K"),
        (law.W, n, "W"),
        (law.Z, m, "Z"),
        (evidence.X, n, "X"),
    ):
        _shapes(matrices or [], len(matrices or []), rows, n, where)
    if evidence.epsilon:
        raise FormatError("epsilon belongs to designs of the method slack")
    if not evidence.X and (evidence.degree or len(evidence.multiple) > 1):
        raise FormatError("the law's own W has its own degree, and at most one multiple")
    placement._require_consistent(_design(subject))


def _gain_norm(claim: GainNorm, n: int, m: int) -> None:
    subject = claim.subject
    if replace(subject.evidence, elevation=0) != Evidence([]):
        raise FormatError("a gain's norm is proved with nothing but an elevation")
    evidence = subject.evidence
    if subject.law.K is not None:  # any X of the right shape
        evidence = replace(evidence, X=[[[Fraction(0)] * n] * n])
    _law_and_evidence(replace(subject, evidence=evidence), n, m)
    if claim.level < 0:
        raise FormatError("level must be zero or more")
    for key, units, count in (("rows", claim.rows, m), ("columns", claim.columns, n)):
        if len(units) != count or any(unit <= 0 for unit in units):
            raise FormatError(f"{key} must hold {count} positive numbers")
    law = subject.law
    degree = 2 * (law.degree if law.K is None else int(len(law.K) > 1))
    count = _number(simplices(subject), degree + subject.evidence.elevation)
    if least_work(count, n + m) > MAX_WORK:
        raise FormatError("these are more inequalities, or larger ones, than are checked here")


def is_semidefinite(matrix: Rationals) -> bool:
    """Whether a symmetric matrix has no negative eigenvalue."""
    common = _denominator([matrix], LONGEST)
    return definite.is_semidefinite(_integers(matrix, common))


def _initial(claim: InitialPeak, n: int, q: int) -> None:
    ellipsoid = claim.ellipsoid
    if ellipsoid:
        X0 = list(map(list, ellipsoid))
        _shapes([X0], 1, n, n, "ellipsoid")
        if not _is_symmetric(X0) or not is_semidefinite(X0):
            raise FormatError("ellipsoid must be symmetric, without negative eigenvalues")
    if not claim.points and not any(claim.impulses) and not any(map(any, ellipsoid)):
        raise FormatError("points and impulses are missing: there is no initial state")
    if any(len(point) != n for point in claim.points):
        raise FormatError(f"points must hold {n} numbers each")
    if claim.impulses and len(claim.impulses) != q:
        raise FormatError(f"impulses must hold {q} numbers, one a column of E")
    if len(claim.points) + len(claim.impulses) > MAX_POINTS:
        raise FormatError(f"there are more than {MAX_POINTS} points and impulses")


def _baseline(claim: RelativeRms, N: int, q: int) -> None:
    baseline, sizes = claim.baseline, simplices(claim.subject)
    if not baseline.A or not baseline.A[0]:
        raise FormatError("the baseline is missing")
    n = len(baseline.A[0])
    _shapes(baseline.A, N, n, n, "the baseline's A")
    _shapes(baseline.E, N, n, q, "the baseline's E")
    _shapes(baseline.C, N, 1, n, "the baseline's C")
    for name, each in (("X", baseline.stability), ("P", baseline.covariance)):
        if any(not 0 <= degree <= MAX_DEGREE for degree in (each.degree, each.elevation)):
            raise FormatError(f"degrees must be 0 to {MAX_DEGREE}")
        if replace(each, X=[], degree=0, elevation=0) != Evidence([]):
            raise FormatError(f"the baseline's {name} is a polynomial and no more")
        _shapes(each.X, _number(sizes, each.degree), n, n, f"the baseline's {name}")


def _work(claim: PerformanceClaim, size: int) -> int:
    """Return a bound on the work, from degrees that are reached at most."""
    subject, sizes = claim.subject, simplices(claim.subject)
    evidence, blocks, more = subject.evidence, 2, 0
    natural = placement._degree(_design(subject), replace(evidence, elevation=0))
    needed = natural
    if isinstance(claim, InitialPeak):
        blocks += len(claim.points) + len(claim.impulses) + bool(claim.ellipsoid)
    elif not isinstance(claim, Gain):  # E E'
        needed = max(natural, 2 * _varies(subject.E))
    if isinstance(claim, RelativeRms):
        stability, covariance = claim.baseline.stability, claim.baseline.covariance
        needed = max(needed, covariance.degree + 2 * _varies(claim.baseline.C))
        degrees = [stability.degree + 1 + stability.elevation] * 2
        degrees.append(max(covariance.degree + 1, 2) + covariance.elevation)
        rows = len(claim.baseline.A[0]) + len(subject.E[0][0])
        more = least_work(sum(_number(sizes, degree) for degree in degrees), rows)
    count = _number(sizes, needed + evidence.elevation)
    return least_work(count * blocks, size) + more


def _varies(matrices: list[Rationals]) -> bool:
    return any(matrix != matrices[0] for matrix in matrices)
