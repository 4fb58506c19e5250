"""Proofs about a sampled loop, as plain data for the file about exported code."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from polefence.design.margins.files import plain
from polefence.proof.sampling import Sampled


def sampling_document(claim: Sampled) -> dict[str, Any]:
    """Return the table "sampling" of a file about exported code, as plain data for JSON.

    `polefence.proof.sampling.read_sampling` reads it back, given the design.
    """
    keys = ("sample_time", "decay", "radius", "error", "mu", "weight")
    table: dict[str, Any] = {key: plain(getattr(claim, key)) for key in keys}
    table |= {"delay": claim.delay, "terms": claim.terms, "elevation": claim.elevation}
    if claim.smallest:
        table |= {"smallest": plain(claim.smallest), "energy": plain(claim.energy)}
    if claim.off:
        off = {"error": plain(claim.off.error), "rows": plain(claim.off.rows)}
        table["off"] = off | {"columns": _plain(claim.off.columns)}
    own = claim.evidence
    evidence: dict[str, Any] = {"X": [_plain(x) for x in own.X], "degree": own.degree}
    evidence["elevation"] = own.elevation
    if own.multiple:
        evidence["multiple"] = plain(own.multiple)
    steps = [_plain(step) for step in claim.steps]
    return table | {
        "T": _plain(claim.T),
        "scale": plain(claim.scale),
        "steps": steps,
        "evidence": evidence,
    }


def _plain(matrix: list[list[Fraction]]) -> list[Any]:
    return [plain(tuple(row)) for row in matrix]
