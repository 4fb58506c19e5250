"""Poles in a region while each gain of a law is off by itself.

All poles of A + B (K + D) C, y = C x what the law measures or all states, lie in the region for all
D of |D_ij| <= e s_ij, if for each L, M = M1 M2 there are mu_ij > 0 with

    [ F, M1 (x) B P, e M2' (x) X C' Q ; *, P, 0 ; *, 0, Q ] > 0,

P and Q diagonal, of p_i = sum_j mu_ij and q_j = sum_i s_ij^2 / mu_ij: Petersen's lemma (1987) once
for each D_ij, mu_ij B_i B_i' + e^2 s_ij^2 / mu_ij X C_j' C_j X being more than what it adds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.bordered import Border, Bordered
from polefence.proof.claims.margins import Subject
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Plant
from polefence.proof.reading import Table
from polefence.proof.remainder import SHARE
from polefence.proof.text import each_gain_text, region_text
from polefence.proof.work import FormatError

Matrix = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True)
class EachGain(Bordered):
    """The poles stay in the region while each gain is off by up to ``error`` times its size.

    ``sizes`` (m, r) has a number a gain: of an input, and of a signal that the law measures, or a
    state where it feeds these back; a gain of size zero is not off. ``mu`` has as many numbers for
    each L, M of the region, and of its cells for each; those of gains that are not off are zero.
    """

    kind: ClassVar[str] = "error of each gain"
    of_signals: ClassVar[bool] = True

    sizes: Matrix
    mu: tuple[Matrix, ...]

    @classmethod
    def read_own(cls, table: Table, subject: Subject) -> dict[str, Any]:
        """Read the error, the sizes and the multipliers."""
        m, r = _shape(subject)
        sizes = tuple(map(tuple, table.matrix("sizes", m, r)))
        mu = tuple(tuple(map(tuple, matrix)) for matrix in table.matrices("mu", m, r))
        return {"error": table.number("error"), "sizes": sizes, "mu": mu}

    def require_own(self, count: int) -> None:
        """Refuse sizes and multipliers that do not fit."""
        super().require_own(count)
        m, r = _shape(self.subject)
        if self.subject.design.law.C and not self.of_lyapunov:
            raise FormatError("errors of gains of signals need the method lyapunov")
        for matrix in (self.sizes, *self.mu):
            if len(matrix) != m or any(len(row) != r for row in matrix):
                raise FormatError(f"sizes and mu must be {m} x {r}")
        if len(self.mu) != self.pairs:
            raise FormatError(f"mu must hold {self.pairs} matrices")
        if not any(map(any, self.sizes)) or any(s < 0 for row in self.sizes for s in row):
            raise FormatError("sizes must be zero or more, and not all zero")
        for matrix in self.mu:
            for i, j, s in self._entries:
                if matrix[i][j] <= 0 and s:
                    raise FormatError("mu must be positive wherever sizes are")

    @property
    def _entries(self) -> Iterator[tuple[int, int, Fraction]]:
        """Yield row, column and size of each gain that is off."""
        for i, row in enumerate(self.sizes):
            for j, s in enumerate(row):
                if s:
                    yield i, j, s

    def _sums(self, mu: Matrix) -> tuple[list[Fraction], list[Fraction]]:
        """Return p and q."""
        p, q = [Fraction(0)] * len(mu), [Fraction(0)] * len(mu[0])
        for i, j, s in self._entries:
            p[i] += mu[i][j]
            q[j] += s * s / mu[i][j]
        return p, q

    def border(self, pair: int) -> Border:
        """Return P and Q, of rows and columns in which a gain is off."""
        p, q = self._sums(self.mu[pair])
        left = [list(row) for row in zip(*_diagonal(p), strict=True)]
        first, second = ([x for x in sums if x] for sums in (p, q))
        return Border(left, first, _diagonal(q), second)

    def beside(self, sizes: Sequence[Fraction]) -> tuple[list[Fraction], Rationals, list[Fraction]]:
        """Return it for multipliers of which each row has the share, in equal parts."""
        rows = [sum(map(bool, row)) if c else 0 for c, row in zip(sizes, self.sizes, strict=True)]
        q = [Fraction(0)] * len(self.sizes[0])
        for i, j, s in self._entries:
            if rows[i]:
                q[j] += (s * sizes[i]) ** 2 * rows[i] / SHARE
        return [SHARE if x else Fraction(0) for x in rows], _diagonal(q), [x for x in q if x]

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say how far which gains may be off."""
        region = region_text(self.subject.design.region)
        return f"{each_gain_text(self.error, self.sizes)}, poles in {region}"


def _diagonal(values: Sequence[Fraction]) -> Rationals:
    """Return the rows of a diagonal matrix that are not zero."""
    zero = Fraction(0)
    return [[x if i == j else zero for j in range(len(values))] for i, x in enumerate(values) if x]


def _shape(subject: Subject) -> tuple[int, int]:
    """Return the number of inputs, and of what the law feeds back."""
    design = subject.design
    rows = design.law.C[0] if design.law.C else design.A[0]
    return len(design.B[0][0]), len(rows)
