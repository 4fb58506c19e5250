"""Error of the gain in given directions, of a design of any method, and its proof.

Rounding a law and sampling its reference in tables put an error on the gain that is known to be
small; its rows and columns are known too. So an error far below the largest is enough, and is
proved where the proof has most room.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.design.given.analysis import analyse
from polefence.design.margins import gain
from polefence.design.margins import given_law as given
from polefence.design.margins.files import claim_document
from polefence.design.margins.inequalities import balanced, count_whole
from polefence.plant.system import Array
from polefence.proof import placement, work
from polefence.proof.service import FORMAT, Gain, Range, Subject, prove_service
from polefence.region.regions import Region

# Pieces of each parameter's interval and elevation that are tried, while they gain something.
BOX, SIMPLEX = ((1, 0), (1, 1), (2, 0), (4, 0)), ((1, 0), (1, 1), (1, 2), (1, 3))
GIVEN = ((1, 0), (1, 1), (1, 2))
GAIN = 0.01
ENOUGH, MOST = 1500, 25_000  # inequalities: no finer proof beyond the first, none beyond the second
BITS = 16  # short numbers make short proofs
LEAST = 2.0**-80  # of the largest error: what is smaller is proved as this
ROOM = 10  # times what is needed: so much makes a coarser proof, which is shorter, as good


@dataclass(frozen=True)
class _Reached:
    """The largest error for each L, M in floats, each with its mu, and how finely it is proved."""

    each: tuple[tuple[float, float], ...]
    pieces: int
    elevation: int

    @property
    def error(self) -> float:
        return min(error for error, _ in self.each)


def claimed_design(design: Design, region: Region | None = None) -> Design | None:
    """Return the design that claims about a design in service are made of.

    That is itself. For the method "slack", whose proof is about one gain but has no one Lyapunov
    matrix, the same gain over the same region with Lyapunov polynomials; likewise for the method
    "lyapunov" and another region than its own. None where these do not prove it.
    """
    kept = design.region if region is None else region
    own = ("scheduled", "quadratic", *(("lyapunov",) if kept == design.region else ()))
    if design.method in own:
        return design
    found = analyse(design.plant, design.law, kept)
    return found.design if found.proved else None


def gain_claim(
    design: Design, rows: Array, columns: Array, needed: float
) -> tuple[float, Gain | None]:
    """Return how far the gain may be off for these rows and columns, and a proof of so much.

    All poles of A + B (K + error S D T) lie in the design's region for all D of norm at most one,
    S and T the diagonal matrices of ``rows`` and ``columns`` (Petersen 1987). Every method has it.

    Parameters
    ----------
    rows : (m,) array
        Positive.
    columns : (n,) or (n, n) array
        Positive; or T itself, any matrix.
    needed : float
        The error that must be proved, zero or more.

    Returns
    -------
    largest : float
        The largest error found in floats; zero where none is.
    claim : Gain or None
        What is proved: ``error`` is at least ``needed``, and larger where there is room. Its
        design is `claimed_design`. None where nothing was proved.

    Raises
    ------
    InputError
        If rows and columns are not positive numbers, one an input and one a state, nor columns a
        matrix; or ``needed`` is no number of zero or more.
    """
    n, m = design.plant.shape
    scales = gain.Scales(_positive(rows, m, "rows"), _columns(columns, n))
    if not 0 <= needed < math.inf:
        raise InputError(f"needed = {needed!r} must be a number of zero or more")
    subject = claimed_design(design)
    found = [] if subject is None else _search(subject, scales)
    if subject is None or not found:
        return 0.0, None
    largest = found[-1].error
    for reached in found:
        if reached is not found[-1] and reached.error < ROOM * max(needed, LEAST * largest):
            continue
        for error in _targets(needed, reached.error):
            claim = _claim(subject, scales, reached, error)
            if _holds(claim):
                return largest, claim
    return largest, None


def gain_document(claim: Gain, design: Design) -> dict[str, Any]:
    """Return the service file of a claim as plain data for JSON.

    Parameters
    ----------
    design : Design
        The one that the claim is of, `claimed_design`.
    """
    own = design.certificate.document()
    service = claim_document(claim)
    return {"format": FORMAT, "version": placement.VERSION, "design": own, "service": service}


def _positive(values: Any, count: int, what: str) -> Array:
    array = np.asarray(values, dtype=float)
    if array.shape != (count,) or not np.all(np.isfinite(array) & (array > 0)):
        raise InputError(f"{what} = {values!r} must be {count} positive numbers")
    return array


def _columns(values: Any, n: int) -> Array:
    array = np.asarray(values, dtype=float)
    if array.ndim < 2:
        return _positive(values, n, "columns")
    if array.shape != (n, n) or not np.all(np.isfinite(array)) or not array.any():
        raise InputError(f"columns: a matrix must be {n} x {n}, of finite numbers, not all zero")
    return array


def _search(design: Design, scales: gain.Scales) -> list[_Reached]:
    """Search at one fineness after another while the error grows; the last is the largest."""
    found: list[_Reached] = []
    for pieces, elevation in _ladder(design):
        if _count(design, pieces, elevation) > (ENOUGH if found else MOST):
            break
        each = _largest(design, scales, pieces, elevation)
        reached = _Reached(tuple(each), pieces, elevation) if each else None
        if found and (reached is None or reached.error <= found[-1].error * (1 + GAIN)):
            break
        if reached is not None and reached.error > 0:
            found.append(reached)
    return found


def _ladder(design: Design) -> tuple[tuple[int, int], ...]:
    if design.method == "lyapunov":
        return GIVEN
    return BOX if design.plant.parameters else SIMPLEX


def _count(design: Design, pieces: int, elevation: int) -> float:
    if design.method == "lyapunov":
        return given.count_given(design, elevation)
    (own,) = balanced(design, design.region)
    return count_whole(own, pieces, elevation)


def _largest(
    design: Design, scales: gain.Scales, pieces: int, elevation: int
) -> list[tuple[float, float]]:
    if design.method == "lyapunov":
        return given.largest_given(design, scales, elevation)
    (own,) = balanced(design, design.region)
    return gain.largest_each(own, scales, pieces, elevation)


def _targets(needed: float, largest: float) -> Iterator[Fraction]:
    """Yield errors to prove, from ``needed`` up; first where there is room on both sides."""
    least = max(needed, largest * LEAST)
    if least < largest:
        yield _above(math.sqrt(least * largest))
    # the search in floats stops a little short
    if least <= largest * (1 + GAIN):
        yield _above(least)


def _claim(design: Design, scales: gain.Scales, reached: _Reached, error: Fraction) -> Gain:
    """Return the claim, with mu that leaves the most room.

    F - mu E E' - error^2 H H' / mu is positive definite at the largest error for its mu. With both
    times a share s < 1, F - s (...) is left: mu belongs to the error in proportion.
    """
    mu = tuple(_above(own * float(error) / largest) for largest, own in reached.each)
    parameters = design.plant.parameters
    ranges = tuple(Range(p.low, p.high, p.inverted) for p in parameters)
    subject = Subject(
        design.certificate.claim(), ranges, (reached.pieces,) * len(ranges), reached.elevation
    )
    columns: tuple[Fraction | tuple[Fraction, ...], ...] = (
        tuple(map(_exactly, scales.columns))
        if scales.columns.ndim == 2
        else _exactly(scales.columns)
    )
    return Gain(subject, error, _exactly(scales.rows), columns, mu)


def _exactly(values: Array) -> tuple[Fraction, ...]:
    return tuple(Fraction(float(v)) for v in values)


def _holds(claim: Gain) -> bool:
    try:
        return prove_service(claim).proved
    except work.FormatError:  # more than the checker takes on
        return False


def _above(value: float) -> Fraction:
    """Return a number that is not below, of few digits."""
    mantissa, exponent = math.frexp(value)
    return Fraction(math.ceil(mantissa * 2**BITS)) * Fraction(2) ** (exponent - BITS)
