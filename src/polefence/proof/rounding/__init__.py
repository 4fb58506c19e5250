"""Prove that a law keeps its region as code computes it, in float32 or float64.

The design tolerates an error of the gain (`proof.service`, kind "gain"); the rounding of the code,
for every parameter value and every state, stays below it (`error`). Integers, rationals and the
standard library only.
"""

from __future__ import annotations

from polefence.proof.exact import MAX_DEGREE, FormatError, Verdict, _number, _shape, simplices
from polefence.proof.rounding.claims import UNITS, Code, Rounded, Share
from polefence.proof.rounding.error import rounding_error
from polefence.proof.rounding.reading import FORMAT, read_rounded
from polefence.proof.service import prove_service

__all__ = [
    "FORMAT",
    "Code",
    "Rounded",
    "Share",
    "prove_rounding",
    "read_rounded",
    "rounding_error",
]


def prove_rounding(claim: Rounded) -> Verdict:
    """Decide whether the poles stay in the region with the gain as the code computes it.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    _require_consistent(claim)
    verdict = prove_service(claim.gain)
    if not verdict.proved:
        return verdict
    try:
        error = rounding_error(claim)
    except FormatError as problem:
        return Verdict(False, str(problem))
    if error > claim.gain.error:
        return Verdict(False, f"rounding may reach {float(error):.3g}, more than what is allowed")
    share = float(error / claim.gain.error) if error else 0.0
    return Verdict(
        True, f"{verdict.reason}; rounding at most {100 * share:.2g} % of what these allow"
    )


def _require_consistent(claim: Rounded) -> None:
    code, gain = claim.code, claim.gain
    design = gain.subject.design
    m, n, law = len(design.B[0][0]), len(design.A[0]), design.law
    if code.bits not in UNITS:
        raise FormatError("code.bits must be 32 or 64")
    if code.K is not None:
        if law.K is None or len(law.K) != 1 or code.T is not None or code.W or code.Z:
            raise FormatError("code: the law and its constants do not belong together")
        _shape(code.K, m, n, "code.K")
        return
    if law.W is None or law.Z is None or code.T is None:
        raise FormatError("code: the law and its constants do not belong together")
    count = _number(simplices(design), law.degree)
    if len(code.W) != count or len(code.Z) != count:
        raise FormatError(f"code: {count} matrices W and Z are needed, one a coefficient")
    for name, rows, matrices in (("T", n, [code.T]), ("W", n, code.W), ("Z", m, code.Z)):
        for matrix in matrices:
            _shape(matrix, rows, n, f"code.{name}")
    if any(w[i][j] != w[j][i] for w in code.W for i in range(n) for j in range(i)):
        raise FormatError("code.W is not symmetric")
    if code.shares and len(code.shares) != len(gain.subject.ranges):
        raise FormatError("code.shares must hold one entry a parameter")
    if claim.smallest <= 0 or claim.size <= 0 or not 0 <= claim.elevation <= MAX_DEGREE:
        raise FormatError("smallest and size must be positive, elevation from 0")
    if gain.columns != tuple(map(tuple, code.T)):
        raise FormatError("the columns of the gain's error must be those of T")
