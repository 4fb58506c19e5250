"""Poles in a region while the gain is off as a whole: in some directions, of a norm.

All poles of A + B (K + e S D T) lie in the region for all |D| <= 1, S and T the diagonal matrices
of ``rows`` and ``columns``, or T any matrix: for each L, M = M1 M2 there is mu > 0 (Petersen 1987)
with

    [ F, mu M1 (x) B S, e M2' (x) X T' ; *, mu I, 0 ; *, 0, mu I ] > 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.bordered import Border, Bordered
from polefence.proof.claims.margins import Subject, require_numbers
from polefence.proof.laws import MAX_CELLS
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Plant
from polefence.proof.reading import MAX_SIZE, Table
from polefence.proof.remainder import SHARE
from polefence.proof.text import errors_text, region_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class GainError(Bordered):
    """The poles stay in the region while the gain is off by ``error`` S D T, |D| <= 1.

    S is diagonal, of ``rows`` (a number an input); T too, of ``columns`` (a number a state), or it
    is any matrix, with ``columns`` its rows. ``mu`` has one number for each L, M of the region, and
    of its cells one each.
    """

    kind: ClassVar[str] = "gain error"

    rows: tuple[Fraction, ...]
    columns: tuple[Fraction | tuple[Fraction, ...], ...]
    mu: tuple[Fraction, ...]

    @property
    def right(self) -> list[list[Fraction]]:
        """T in full."""
        n, zero, full = len(self.columns), Fraction(0), list[list[Fraction]]()
        for i, column in enumerate(self.columns):
            if isinstance(column, tuple):
                full.append(list(column))
            else:
                full.append([column if i == j else zero for j in range(n)])
        return full

    @classmethod
    def read_own(cls, table: Table, subject: Subject) -> dict[str, Any]:
        """Read the error and its scales; ``columns`` are numbers, or the rows of a matrix."""
        n = len(subject.design.A[0])
        columns: tuple[Any, ...]
        if isinstance(table.items("columns", MAX_SIZE)[0], list):
            columns = tuple(map(tuple, table.matrix("columns", n, n)))
        else:
            columns = table.numbers("columns")
        mu = table.numbers("mu", most=MAX_CELLS)
        rows = table.numbers("rows")
        return {"error": table.number("error"), "columns": columns, "rows": rows, "mu": mu}

    def require_own(self, count: int) -> None:
        """Refuse scales that do not fit."""
        super().require_own(count)
        design = self.subject.design
        n, m = len(design.A[0]), len(design.B[0][0])
        for key, values, length in (("rows", self.rows, m), ("mu", self.mu, self.pairs)):
            require_numbers(values, length, key, positive=True)
        numbers = tuple(c for c in self.columns if isinstance(c, Fraction))
        if numbers or len(self.columns) != n:
            require_numbers(numbers, n, "columns", positive=True)
        elif any(len(row) != n for row in self.right):
            raise FormatError(f"columns must hold {n} rows of {n} numbers")

    def border(self, pair: int) -> Border:
        """Return mu S, mu I, T and mu I."""
        mu, zero = self.mu[pair], Fraction(0)
        m, n = len(self.rows), len(self.columns)
        left = [[mu * s if i == j else zero for j in range(m)] for i, s in enumerate(self.rows)]
        return Border(left, [mu] * m, self.right, [mu] * n)

    def beside(self, sizes: Sequence[Fraction]) -> tuple[list[Fraction], Rationals, list[Fraction]]:
        """Return it for one more multiplier, of which the largest row has its share."""
        rows = [c * r for c, r in zip(sizes, self.rows, strict=True)]
        most = max((*rows, Fraction(0))) ** 2
        if not most:
            return [], [], []
        nu = SHARE / most
        return [nu * x * x for x in rows], self.right, [nu] * len(self.columns)

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say which errors leave the poles where."""
        region = region_text(self.subject.design.region)
        return f"{errors_text(self.error, self.rows, self.columns)}, poles in {region}"
