"""Prove bounds on the signals of a closed loop, in exact arithmetic.

For x' = (A + B K) x + E w, y = C x + D u with one row y, and for every alpha of the simplex or the
box. Polynomials X(alpha), N = (A + B K) X and Y = (C + D K) X are those of
`polefence.proof.placement`: X = W of the law K = Z W^-1, or given for each claim. What proves each
is, from Boyd et al. (1994), chapters 6 and 10, and Scherer, Gahinet & Chilali (1997):

    rms       -(N + N' + S E E') > 0 and [ g^2, Y ; Y', X ] > 0: X is more than the stationary
              covariance for white noise of two-sided intensity S, and Y X^-1 Y' < g^2
    energy    the same with S = 1: x' X^-1 x is at most the integral of |w|^2 so far; e Y in place
    peak      of Y for w whose L2 norm is at most e
    initial   -(N + N') > 0, [ 1, x0' ; x0, X ] > 0 for each initial state, and
    peak      [ g^2, Y ; Y', X ] > 0: x' X^-1 x stays below 1; for all initial states of an
              ellipsoid x0' X0^-1 x0 <= 1, X - X0 > 0
    gain      X > 0 and, with y = C x + D u + F w, the bounded real lemma
              [ -(N + N'), -E, -Y' ; *, g I, -F' ; *, *, g ] > 0
    relative  rms with g^2 C0 P C0' in place of g^2, where A0 P + P A0' + S E0 E0' > 0 for a
    rms       baseline that X0 > 0, -(A0 X0 + X0 A0') > 0 show to be stable, so that P is less
              than its covariance
    gain      [ H' H, V' ; V, g^2 I ] > 0 with H = diag(columns)^-1 W, V = diag(rows)^-1 Z, W = I
    norm      and Z = K of a fixed gain: V H^-1 = diag(rows)^-1 K diag(columns)

Every inequality is a polynomial, homogeneous in each simplex; it holds if all of its coefficients,
times (sum of alpha)^elevation, are positive definite. All that is about one loop is raised to one
degree, the least that they need. Integers and the standard library only.
"""

from __future__ import annotations

from collections.abc import Iterator

from polefence.proof.definite import is_positive_definite
from polefence.proof.matrices import Integers, Rationals, _is_symmetric
from polefence.proof.performance.checks import is_semidefinite, require_consistent, simplices
from polefence.proof.performance.claims import (
    LAW,
    Baseline,
    EnergyPeak,
    Gain,
    GainNorm,
    InitialPeak,
    Output,
    PerformanceClaim,
    RelativeRms,
    Rms,
    Subject,
)
from polefence.proof.performance.inequalities import inequalities
from polefence.proof.performance.passive import baseline_loop
from polefence.proof.performance.reading import FORMAT, read_performance
from polefence.proof.placement import Verdict
from polefence.proof.work import counted

__all__ = [
    "FORMAT",
    "LAW",
    "Baseline",
    "EnergyPeak",
    "Gain",
    "GainNorm",
    "InitialPeak",
    "Output",
    "PerformanceClaim",
    "RelativeRms",
    "Rms",
    "Subject",
    "baseline_loop",
    "blocks",
    "is_semidefinite",
    "prove_performance",
    "read_performance",
]


def prove_performance(claim: PerformanceClaim) -> Verdict:
    """Decide whether the evidence proves the claim; False does not refute it.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    with counted():
        require_consistent(claim)
        return _proved(claim)


def _proved(claim: PerformanceClaim) -> Verdict:
    for name, matrix in _symmetric(claim):
        if not _is_symmetric(matrix):
            return Verdict(False, f"{name} is not symmetric")
    count = 0
    for name, block in blocks(claim):
        if not is_positive_definite(block):
            return Verdict(False, f"inequality {name} is not positive definite")
        count += 1
    return Verdict(True, f"{count} inequalities positive definite in exact arithmetic")


def blocks(claim: PerformanceClaim) -> Iterator[tuple[str, Integers]]:
    """Yield each inequality's name and its matrix, times a positive integer."""
    for inequality in inequalities(claim, simplices(claim.subject)):
        yield from inequality.blocks()


def _symmetric(claim: PerformanceClaim) -> Iterator[tuple[str, Rationals]]:
    """Yield what the theorems take to be symmetric."""
    subject = claim.subject
    families = {"W": subject.law.W or [], "Lyapunov matrix": subject.evidence.X}
    if isinstance(claim, RelativeRms):
        families["the baseline's X"] = claim.baseline.stability.X
        families["the baseline's P"] = claim.baseline.covariance.X
    for name, matrices in families.items():
        for k, matrix in enumerate(matrices):
            yield f"{name} {k + 1}", matrix
