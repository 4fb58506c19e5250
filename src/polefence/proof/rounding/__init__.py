"""Prove that a law keeps its region as code computes it, in float32 or float64.

The design tolerates an error of the gain (`proof.service`, kind "gain"); the rounding of the code,
for every parameter value and every state, stays below it (`error`). Integers, rationals and the
standard library only.
"""

from __future__ import annotations

import math
from fractions import Fraction

from polefence.proof.definite import least_work
from polefence.proof.placement import Verdict, simplices
from polefence.proof.polynomials import MAX_DEGREE, _number
from polefence.proof.reading import _shape
from polefence.proof.rounding.claims import Code, Rounded, Share
from polefence.proof.rounding.error import rounding_error
from polefence.proof.rounding.reading import FORMAT, read_rounded
from polefence.proof.service import prove_service
from polefence.proof.service.claims import MAX_BLOCKS
from polefence.proof.work import MAX_WORK, FormatError, counted

__all__ = [
    "FORMAT",
    "Code",
    "Rounded",
    "Share",
    "prove_rounding",
    "read_rounded",
    "rounding_error",
]

DIGITS = {32: 24, 64: 53}  # binary digits of a number
# Constants of the code, and how near W' and its bound are to one: far from underflow and overflow.
LEAST, MOST, SMALLEST = Fraction(1, 10**18), Fraction(10**18), Fraction(1, 10**6)


def prove_rounding(claim: Rounded) -> Verdict:
    """Decide whether the poles stay in the region with the gain as the code computes it.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    with counted():
        _require_consistent(claim)
        return _proved(claim)


def _proved(claim: Rounded) -> Verdict:
    verdict = prove_service(claim.gain)
    if not verdict.proved:
        return verdict
    try:
        error = rounding_error(claim)
    except FormatError as problem:
        return Verdict(False, str(problem))
    if error > claim.gain.error:
        return Verdict(False, "rounding may be more than what is allowed")
    share = float(error / claim.gain.error) if error else 0.0
    percent = math.ceil(1000 * share) / 10
    return Verdict(True, f"{verdict.reason}; rounding at most {percent:g} % of what these allow")


def _require_consistent(claim: Rounded) -> None:
    code, gain = claim.code, claim.gain
    design = gain.subject.design
    m, n, law = len(design.B[0][0]), len(design.A[0]), design.law
    if type(code.bits) is not int or code.bits not in DIGITS:
        raise FormatError("code.bits must be 32 or 64")
    _require_numbers(code)
    if code.K is not None:
        own = law.K if law.K is not None else law.W or []  # of one vertex K = Z W^-1
        if len(own) != 1 or code.T is not None or code.W or code.Z:
            raise FormatError("code: the law and its constants do not belong together")
        if not all(isinstance(column, Fraction) for column in gain.columns):
            raise FormatError("columns must be numbers for one gain")
        _shape(code.K, m, n, "code.K")
        return
    if law.W is None or law.Z is None or code.T is None or not law.degree:
        raise FormatError("code: the law and its constants do not belong together")
    sizes = simplices(design)
    count = _number(sizes, law.degree)
    if len(code.W) != count or len(code.Z) != count:
        raise FormatError(f"code: {count} matrices W and Z are needed, one a coefficient")
    for name, rows, matrices in (("T", n, [code.T]), ("W", n, code.W), ("Z", m, code.Z)):
        for matrix in matrices:
            _shape(matrix, rows, n, f"code.{name}")
    if any(w[i][j] != w[j][i] for w in code.W for i in range(n) for j in range(i)):
        raise FormatError("code.W is not symmetric")
    if code.shares and len(code.shares) != len(gain.subject.ranges):
        raise FormatError("code.shares must hold one entry a parameter")
    if not 0 <= claim.elevation <= MAX_DEGREE or claim.size <= 0:
        raise FormatError("size must be positive, elevation from 0")
    if (
        claim.smallest < SMALLEST
        or max(abs(v) for w in code.W for r in w for v in r) > 1 / SMALLEST
    ):
        raise FormatError(
            f"smallest and code.W must lie between {float(SMALLEST):g} and its inverse"
        )
    if gain.columns != tuple(map(tuple, code.T)):
        raise FormatError("the columns of the gain's error must be those of T")
    number = _number(sizes, 2 * law.degree + claim.elevation)
    if number > MAX_BLOCKS or least_work(number, n + m) > MAX_WORK:
        raise FormatError("these are more inequalities, or larger ones, than are checked here")


def _require_numbers(code: Code) -> None:
    """Refuse constants that the code cannot hold, or that lead out of its numbers' range."""
    shares = [[s.low, s.high, s.scale] for s in code.shares]
    for matrix in [code.K or [], code.T or [], *code.W, *code.Z, shares]:
        for row in matrix:
            for value in row:
                if value and not (LEAST <= abs(value) <= MOST and _is_held(value, code.bits)):
                    raise FormatError(
                        f"code: a constant is no float{code.bits} from {float(LEAST):g} to "
                        f"{float(MOST):g}"
                    )


def _is_held(value: Fraction, bits: int) -> bool:
    top, bottom = abs(value.numerator), value.denominator
    odd = top // (top & -top)
    return bottom & (bottom - 1) == 0 and odd.bit_length() <= DIGITS[bits]
