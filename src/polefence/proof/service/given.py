"""Errors of the gain of a law that was given: each part of the region has its own evidence X.

In the certificate's own domain and degrees, whatever parameters the plant has.
"""

from __future__ import annotations

from collections.abc import Iterator

from polefence.proof import placement
from polefence.proof.matrices import MAX_BITS, Integers, _denominator, _is_symmetric
from polefence.proof.placement import (
    Claim,
    Evidence,
    _block,
    _integral,
    _loop,
    _name,
    _plant,
    simplices,
)
from polefence.proof.polynomials import Polynomial, _elevated, _number, monomials
from polefence.proof.regions import _characteristic_pairs
from polefence.proof.service.border import border_of
from polefence.proof.service.claims import Gain
from polefence.proof.work import FormatError


def require_given(design: Claim) -> None:
    """Refuse laws given whose evidence does not fit, tables of gains, and plants with weights.

    Raises
    ------
    FormatError
    """
    placement._require_consistent(design)
    if design.weights:
        raise FormatError("plants with weights have no proofs for service")
    if len(design.law.K or [()]) > 1:
        raise FormatError("tables of gains have no proofs for service")


def asymmetric(design: Claim) -> str:
    """Name the first matrix that ought to be symmetric and is not; "" where there is none."""
    for k, evidence in enumerate(design.evidence):
        if not all(_is_symmetric(X) for X in evidence.X):
            return f"a Lyapunov matrix of part {k + 1}"
    return "a matrix W" if not all(_is_symmetric(W) for W in design.law.W or []) else ""


def count_given(claim: Gain) -> int:
    """Return how many inequalities there are, X > 0 left out."""
    design, sizes = claim.subject.design, simplices(claim.subject.design)
    return sum(
        _number(sizes, _degree(claim, evidence)) * len(_characteristic_pairs(part))
        for part, evidence in zip(design.region, design.evidence, strict=True)
    )


def perturbed(claim: Gain) -> Iterator[tuple[str, Integers]]:
    """Yield each inequality's name and its matrix, times a positive integer."""
    design, numbers = claim.subject.design, iter(claim.mu)
    sizes, plant = simplices(design), _plant(design)
    one: Polynomial = {(0,) * sum(sizes): [[1]]}
    n = len(design.A[0])
    inputs: Polynomial = {e: [row[n:] for row in AB] for e, AB in plant.AB.items()}
    for part, evidence in zip(design.region, design.evidence, strict=True):
        degree, power = _degree(claim, evidence), claim.subject.elevation + evidence.elevation
        order = monomials(sizes, degree)
        X, N = (_elevated(P, sizes, power) for P in _loop(design, plant, sizes, evidence))
        B, unit = _elevated(inputs, sizes, degree - 1), _elevated(one, sizes, degree)
        if part.kind != "disk":
            for e in order:
                yield f"of X at {_name(e, sizes, design)}", X[e]
        own = _unit(design, plant.law, evidence)
        for L, M in _characteristic_pairs(part):
            L_, M_, common = _integral(L, M, plant.denominator)
            border = border_of(claim, next(numbers), M, (common, plant.denominator, own))
            for e in order:
                F = _block(L_, M_, X[e], N[e])
                where = _name(e, sizes, design, part)
                yield where, border.around(F, X[e], B[e], unit[e][0][0])


def _degree(claim: Gain, evidence: Evidence) -> int:
    return placement._degree(claim.subject.design, evidence) + claim.subject.elevation


def _unit(design: Claim, law: int, evidence: Evidence) -> int:
    """Return what X of `_loop` comes times: the denominators of the law and of the evidence."""
    own = _denominator([*evidence.X, [list(evidence.multiple)]], 2 * MAX_BITS)
    return own * law if design.law.K is not None else own * law**2
