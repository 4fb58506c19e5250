"""Error of the gain in given directions, of a design of any method, and its proof.

Rounding a law and sampling its reference in tables put an error on the gain that is known to be
small; its rows and columns are known too. So an error far below the largest is enough, and is
proved where the proof has most room.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.design.margins import gain
from polefence.design.margins.claims import (
    GAIN,
    Reached,
    above,
    claimed_design,
    climb,
    holds,
    subject_of,
)
from polefence.design.margins.inequalities import balanced
from polefence.plant.system import Array
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject

FINEST = 4  # finenesses that are tried
LEAST = 2.0**-80  # of the largest error: what is smaller is proved as this
ROOM = 10  # times what is needed: so much makes a coarser proof, which is shorter, as good


def gain_claim(
    design: Design, rows: Array, columns: Array, needed: float
) -> tuple[float, GainError | None]:
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
    own = claimed_design(design)
    if own is None:
        return 0.0, None
    question = gain.Question.of(balanced(own, own.region), scales, FINEST)
    found = [reached for reached in climb(question) if reached.value > 0]
    largest = found[-1].value if found else 0.0
    for reached in found:
        if reached is not found[-1] and reached.value < ROOM * max(needed, LEAST * largest):
            continue
        subject = subject_of(own, own.region, reached)
        for error in _targets(needed, reached.value):
            claim = _claim(question, subject, reached, error)
            if holds(claim):
                return largest, claim
    return largest, None


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


def _targets(needed: float, largest: float) -> Iterator[Fraction]:
    """Yield errors to prove, from ``needed`` up; first where there is room on both sides."""
    least = max(needed, largest * LEAST)
    if least < largest:
        yield above(math.sqrt(least * largest))
    # the search in floats stops a little short
    if least <= largest * (1 + GAIN):
        yield above(least)


def _claim(
    question: gain.Question, subject: Subject, reached: Reached, error: Fraction
) -> GainError:
    """Return the claim, with mu that leaves the most room.

    F - mu E E' - error^2 H H' / mu is positive definite at the largest error for its mu. With both
    times a share s < 1, F - s (...) is left: mu belongs to the error in proportion.
    """
    mu = tuple(above(own * float(error) / largest) for largest, own in reached.each)
    return question.with_mu(subject, error, mu)
