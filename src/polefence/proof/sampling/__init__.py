"""Prove how fast a loop decays that is closed by samples, for every parameter value.

The law is computed every Ts seconds, its output held between; with a delay of one step it acts on
the sample before. The claim, |z| < exp(-a Ts) for all poles of the sampled loop:

1. Between the vertices e^(A Ts) is no convex combination of theirs; how far off it is, is bounded
   (`error`), and with it the rounding of the vertices' own steps.
2. The loop with the combination (`loop`) tolerates such an error of its steps: a claim of kind
   "gain" of `proof.service`, built here from the design and the law themselves.

Integers, rationals and the standard library only.
"""

from __future__ import annotations

import math

from polefence.proof.matrices import MAX_BITS, Rationals, _denominator
from polefence.proof.placement import Verdict, simplices
from polefence.proof.reading import _shape
from polefence.proof.rounding import Rounded, rounding_error
from polefence.proof.sampling.claims import Off, Sampled
from polefence.proof.sampling.error import MAX_TERMS, exponential, gain_error, held_size, step_error
from polefence.proof.sampling.loop import loop_claim
from polefence.proof.sampling.reading import read_sampling
from polefence.proof.service import prove_service
from polefence.proof.work import FormatError, counted

SHORT = 2048  # bits

__all__ = [
    "Off",
    "Sampled",
    "covers_rounding",
    "loop_claim",
    "prove_sampling",
    "read_sampling",
    "step_error",
]


def prove_sampling(claim: Sampled) -> Verdict:
    """Decide whether all poles of the sampled loop are proved to have |z| < exp(-decay Ts).

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    with counted():
        _require_consistent(claim)
        return _proved(claim)


def _proved(claim: Sampled) -> Verdict:
    if claim.radius * exponential(claim.decay * claim.sample_time) > 1:
        return Verdict(False, "the radius is not below exp(-decay sample_time)")
    whole = loop_claim(claim)
    verdict = prove_service(whole)
    if not verdict.proved:
        return verdict
    sizes = simplices(whole.subject.design)
    try:
        steps = step_error(claim, sizes)
        steps *= 1 if claim.delay else held_size(claim)
    except FormatError as problem:
        return Verdict(False, str(problem))
    needed = steps**2 + gain_error(claim) ** 2
    if needed > claim.error**2:
        return Verdict(False, "the steps may be off by more than the error given")
    share = float(needed / claim.error**2) ** 0.5 if needed else 0.0
    percent = math.ceil(1000 * share) / 10
    return Verdict(True, f"{verdict.reason}; steps off by {percent:g} % of what these allow")


def covers_rounding(claim: Sampled, rounded: Rounded) -> bool:
    """Whether the error of the gain that a claim allows is at least that of the code's rounding.

    Raises
    ------
    FormatError
        If a bound that the claim about the code rests on does not hold.
    """
    off, gain, own = claim.off, rounded.gain, rounded.gain.subject.design
    same = (claim.design.A, claim.design.B, claim.design.law) == (own.A, own.B, own.law)
    if off is None or not same or off.rows != gain.rows or off.columns != gain.right:
        return False
    return off.error >= rounding_error(rounded)


def _require_consistent(claim: Sampled) -> None:
    design = claim.design
    n, m, law = len(design.A[0]), len(design.B[0][0]), design.law
    if design.weights or (law.K is not None and len(law.K) != 1):
        raise FormatError("sampling: this kind of plant or law has no proofs here")
    if claim.ranges and len(design.A) != 2 ** len(claim.ranges):
        raise FormatError("sampling: the vertices are not those of the parameters")
    if design.on == "box" and len(design.A) > 1 and not claim.ranges:
        raise FormatError("a law on a box needs the parameters' ranges")
    if claim.delay not in (0, 1):
        raise FormatError("sampling.delay must be 0 or 1")
    for key in ("sample_time", "radius", "error", "mu", "weight"):
        if getattr(claim, key) <= 0:
            raise FormatError(f"sampling.{key} must be positive")
    if claim.radius >= 1:
        raise FormatError("sampling.radius must be below one: a loop that decays")
    if not 1 <= claim.terms <= MAX_TERMS:
        raise FormatError(f"sampling.terms must be 1 to {MAX_TERMS}")
    if claim.decay < 0:
        raise FormatError("sampling.decay must be zero or more")
    _require_shapes(claim, n, m)


def _require_shapes(claim: Sampled, n: int, m: int) -> None:
    shaped: list[tuple[str, Rationals, int, int]] = [("T", claim.T, n, n)]
    shaped += [("steps", step, n, n + m) for step in claim.steps]
    width = n + m if claim.delay else n
    shaped += [("evidence.X", X, width, width) for X in claim.evidence.X]
    shaped += [("off.columns", claim.off.columns, n, n)] if claim.off else []
    for key, matrix, rows, columns in shaped:
        _shape(matrix, rows, columns, f"sampling.{key}")
    _denominator([claim.T], SHORT)  # inverted in rationals
    _denominator([*claim.steps, *(matrix for _, matrix, *_ in shaped)], MAX_BITS)
    if len(claim.steps) != len(claim.design.A):
        raise FormatError("sampling.steps must hold a matrix for each vertex")
    named = [("scale", claim.scale)] + ([("off.rows", claim.off.rows)] if claim.off else [])
    for key, values in named:
        if len(values) != m or min(values) <= 0:
            raise FormatError(f"sampling.{key} must hold {m} positive numbers")
    if claim.off and claim.off.error < 0:
        raise FormatError("sampling.off.error must be zero or more")
