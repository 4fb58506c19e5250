"""Error of the gain in given directions, of a norm: what rounding and tables put on a law.

Their error is known to be small; its rows and columns are known too. So an error far below the
largest is enough, and is proved where the proof has most room.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.certify.design import Design
from polefence.certify.margins.bordered import GainQuestion
from polefence.certify.margins.claims import GAIN, above, claimed_design, climb, holds, subject_of
from polefence.certify.margins.loops import balanced
from polefence.plant.system import Array
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.remainder import SHARE

LEAST = 2.0**-80  # of the largest error: what is smaller is proved as this


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales of an error of the gain: K is off by error * diag(rows) D diag(columns).

    Or by error * diag(rows) D columns, where columns is a matrix; D has a norm of at most one.
    """

    C: ClassVar[None] = None
    most: ClassVar[float] = math.inf

    rows: Array
    columns: Array

    @property
    def right(self) -> Array:
        """Transpose of what the state is times."""
        return np.asarray(np.diag(self.columns) if self.columns.ndim == 1 else self.columns.T)

    def border(self, pair: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Return what the inputs, and the states, are times: the same for each L, M."""
        return self.rows, self.right

    def beside(self, inputs: Array) -> tuple[Array, Array]:
        """Return what it does to V of a remainder: the largest row gives up its share of one."""
        squares = (inputs * self.rows) ** 2
        share = float(SHARE) / max(float(squares.max()), np.finfo(float).tiny)
        return share * squares, self.right / math.sqrt(share)

    def claim(self, subject: Subject, error: Fraction, mu: Sequence[float]) -> GainError:
        """Return the claim of an error and its multipliers."""
        rows, columns = self.rows.tolist(), self.columns.tolist()
        right = (tuple(map(Fraction, c)) if self.columns.ndim > 1 else Fraction(c) for c in columns)
        return GainError(
            subject, error, tuple(map(Fraction, rows)), tuple(right), tuple(map(above, mu))
        )


@explained
def gain_claim(
    design: Design, rows: Array, columns: Array, needed: float, finest: int = 4
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
    finest : int
        The number of finenesses that are tried.

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
    if not 0 <= needed < math.inf:
        raise InputError(f"needed = {needed!r} must be a number of zero or more")
    claimed = claimed_design(design)
    if claimed is None:
        return 0.0, None
    question = gain_question(claimed, rows, columns, finest)
    finer = [reached for reached in climb(question) if reached.value > 0]
    largest = finer[-1].value if finer else 0.0
    for reached in finer:
        # ten times what is needed makes a coarser proof, which is shorter, as good
        if reached is not finer[-1] and reached.value < 10 * max(needed, LEAST * largest):
            continue
        subject = subject_of(claimed, claimed.region, reached)
        for error in _targets(needed, reached.value):
            claim = question.claim_of(subject, reached, error)
            if isinstance(claim, GainError) and holds(claim):
                return largest, claim
    return largest, None


def gain_question(design: Design, rows: Array, columns: Array, finest: int = 4) -> GainQuestion:
    """Return the search for the largest error in these rows and columns, see `gain_claim`."""
    n, m = design.plant.shape
    scales = Scales(_positive(rows, m, "rows"), _columns(columns, n))
    return GainQuestion(balanced(design, design.region), scales, finest)


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
