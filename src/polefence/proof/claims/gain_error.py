"""Poles in a region while the gain is off.

All poles of A + B (K + e S D T) lie in the region for all |D| <= 1, S and T the diagonal matrices
of ``rows`` and ``columns``, or T any matrix: for each L, M = M1 M2 there is mu > 0 (Petersen 1987)
with

    [ F, mu M1 (x) B S, e M2' (x) X T' ; *, mu I, 0 ; *, 0, mu I ] > 0.

Of a law that was given in the certificate's own domain and degrees, whatever parameters the plant
has; in each of its cells, if it has some.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.base import Inequality, Verdict, in_cells
from polefence.proof.claims.margins import (
    MarginClaim,
    Subject,
    cells,
    family_of,
    require_numbers,
)
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, lifted
from polefence.proof.plant import Plant
from polefence.proof.polynomials import Polynomial, constant, count_of, diagonal
from polefence.proof.reading import MAX_SIZE, Table, plain
from polefence.proof.regions import Disk, Part, factors, lyapunov
from polefence.proof.remainder import SHARE, Spread
from polefence.proof.text import errors_text, region_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class GainError(MarginClaim):
    """The poles stay in the region while the gain is off by ``error`` S D T, |D| <= 1.

    S is diagonal, of ``rows`` (a number an input); T too, of ``columns`` (a number a state), or it
    is any matrix, with ``columns`` its rows. ``mu`` has one number for each L, M of the region, and
    of its cells one each.
    """

    kind: ClassVar[str] = "gain error"
    has_remainder: ClassVar[bool] = True
    has_cells: ClassVar[bool] = True

    error: Fraction
    rows: tuple[Fraction, ...]
    columns: tuple[Fraction | tuple[Fraction, ...], ...]
    mu: tuple[Fraction, ...]

    @property
    def right(self) -> list[list[Fraction]]:
        """T in full."""
        n, zero, full = len(self.columns), Fraction(0), list[list[Fraction]]()
        for i, own in enumerate(self.columns):
            if isinstance(own, tuple):
                full.append(list(own))
            else:
                full.append([own if i == j else zero for j in range(n)])
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
        own = {key: table.numbers(key) for key in ("rows", "mu")}
        return {"error": table.number("error"), "columns": columns} | own

    def write_own(self) -> dict[str, Any]:
        """Return the error and its scales."""
        return {key: plain(getattr(self, key)) for key in ("error", "rows", "columns", "mu")}

    def require_own(self, count: int) -> None:  # noqa: ARG002
        """Refuse scales that do not fit."""
        design = self.subject.design
        n, m = len(design.A[0]), len(design.B[0][0])
        if self._of_lyapunov and any(pieces != 1 for pieces in self.subject.pieces):
            raise FormatError("pieces must be 1 for errors of a gain that was given")
        require_numbers((self.error,), 1, "error")
        pairs = sum(len(part.pairs) for part in design.region)
        if self._of_lyapunov:
            each = zip(design.region, design.evidence, strict=True)
            pairs = sum(len(part.pairs) * len(own.each) for part, own in each)
        for key, values, length in (("rows", self.rows, m), ("mu", self.mu, pairs)):
            require_numbers(values, length, key, positive=True)
        numbers = tuple(c for c in self.columns if isinstance(c, Fraction))
        if numbers or len(self.columns) != n:
            require_numbers(numbers, n, "columns", positive=True)
        elif any(len(row) != n for row in self.right):
            raise FormatError(f"columns must hold {n} rows of {n} numbers")

    @property
    def _of_lyapunov(self) -> bool:
        return self.subject.design.method == "lyapunov"

    def work(self) -> tuple[int, int]:
        """Return how many inequalities there are, and half their size."""
        design = self.subject.design
        size = 2 * len(design.A[0]) + len(self.rows)
        if not self._of_lyapunov:
            return self.pieces_work(self.subject.degree()), size
        pairs = zip(design.region, design.evidence, strict=True)
        count = sum(
            count_of(design.sizes, design.degree(own) + self.subject.elevation) * len(part.pairs)
            for part, evidence in pairs
            for own in evidence.each
        )
        return count, size

    def decided(self) -> Verdict:
        """Prove it; cells must make up the box."""
        return in_cells(self.subject.design.evidence, super().decided)

    def inequalities(self) -> Iterator[Inequality]:
        """Yield X > 0 and the bordered F > 0 of every part of the region."""
        subject, region, numbers = self.subject, self.subject.design.region, iter(self.mu)
        if self._of_lyapunov:
            design = subject.design
            for part, evidence in zip(region, design.evidence, strict=True):
                for k, piece in enumerate(evidence.cells):
                    for own in self._of_given(design.inside(piece), part, piece.evidence, numbers):
                        yield replace(own, piece=f", cell {k + 1}")
                if not evidence.cells:
                    yield from self._of_given(design, part, evidence, numbers)
            return
        family = family_of(subject)
        for cell in cells(subject):
            X, N, AB = cell.loop(family)
            degrees = cell.elevated(N.degrees, subject.elevation)
            yield from cell.positive(X, degrees, region)
            B, numbers = AB.part(slice(None), slice(family.n, None)), iter(self.mu)
            for part in region:
                for rows in self._bordered(part, X, N, B, numbers):
                    yield Inequality(part.kind, rows, degrees, cell.name)

    def _of_given(
        self, design: Poles, part: Part, evidence: Evidence, numbers: Iterator[Fraction]
    ) -> Iterator[Inequality]:
        sizes, n = design.sizes, len(design.A[0])
        AB, XKX = design.AB, lifted(design.law, evidence, sizes)
        X, N, B = XKX.part(slice(n)), AB * XKX, AB.part(slice(None), slice(n, None))
        by = self.subject.elevation + evidence.elevation
        degrees = tuple(degree + by for degree in N.degrees)
        if not isinstance(part, Disk):
            yield Inequality("of X", [[X]], degrees)
        if evidence.spread is not None:
            blocks = self._bounding(evidence.spread, XKX, X)
            yield Inequality.raised("of the remainder", blocks, by)
        for rows in self._bordered(part, X, N, B, numbers, evidence.spread):
            yield Inequality(part.kind if len(design.region) > 1 else "", rows, degrees)

    def _bounding(self, spread: Spread, XKX: Polynomial, X: Polynomial) -> list[list[Polynomial]]:
        """Return the blocks that say that Omega is more than V'V with the error in V too.

        Of u it adds D Delta R X, D = diag(columns of u times rows); D D' is a small share of one.
        """
        sizes, n, m = X.sizes, X.shape[0], len(self.rows)
        own = [c * r for c, r in zip(spread.columns[n : n + m], self.rows, strict=True)]
        most = max((*own, Fraction(0))) ** 2
        (first, side), (corner,) = spread.bounding(spread.moving(XKX))
        if not most:
            return [[first, side], [corner]]
        nu = SHARE / most
        corner = corner - diagonal([Fraction(0)] * n + [nu * x * x for x in own], sizes)
        end = (X * constant(self.right, sizes).T).times(self.error)
        none = constant([[Fraction(0)] * end.shape[1]] * corner.shape[0], sizes)
        return [[first, side, end], [corner, none], [diagonal([nu] * end.shape[1], sizes)]]

    def _bordered(
        self,
        part: Part,
        X: Polynomial,
        N: Polynomial,
        B: Polynomial,
        numbers: Iterator[Fraction],
        spread: Spread | None = None,
    ) -> Iterator[list[list[Polynomial]]]:
        """Yield the blocks of each L, M: F, and what the error puts beside and below it."""
        sizes = X.sizes
        BS, XT = B * diagonal(self.rows, sizes), X * constant(self.right, sizes).T
        for L, M in part.pairs:
            mu, (M1, M2) = next(numbers), factors(M)
            left = BS.beside(M1).times(mu)
            right = XT.beside([list(column) for column in zip(*M2, strict=True)]).times(self.error)
            one, other = (diagonal([mu] * each.shape[1], sizes) for each in (left, right))
            between = constant([[Fraction(0)] * right.shape[1]] * left.shape[1], sizes)
            F = lyapunov(L, M, X, N)
            if spread is not None:
                F = F - constant(spread.of_region((M1, M2)), sizes)
            yield [[F, left, right], [one, between], [other]]

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say which errors leave the poles where."""
        region = region_text(self.subject.design.region)
        return f"{errors_text(self.error, self.rows, self.columns)}, poles in {region}"
