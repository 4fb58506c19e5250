"""Poles in a region while the gain is off: F > 0 with a border for what the error adds.

With F of each L, M = M1 M2 of the region, X and C of what the error is times (of all states I),

    [ F, M1 (x) B G, e M2' (x) X C' H' ; *, P, 0 ; *, 0, Q ] > 0

says that F - M1 M1' (x) B G P^-1 G' B' - e^2 M2' M2 (x) X C' H' Q^-1 H C X > 0. Which errors of
size e that covers is said by a kind of error: by G and H, and the diagonals P and Q.

Of a law that was given in the certificate's own domain and degrees, whatever parameters the plant
has; in each of its cells, if it has some.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import count
from typing import ClassVar

from polefence.proof.claims.base import Inequality, Verdict, in_cells
from polefence.proof.claims.margins import MarginClaim, cells, family_of, require_numbers
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, lifted
from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import Polynomial, affine, constant, count_of, diagonal
from polefence.proof.regions import Part, factors, lyapunov
from polefence.proof.remainder import Spread
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Border:
    """G, P, H and Q: ``left`` (m, a), ``first`` (a numbers), ``right`` (b, r) and ``second``."""

    left: Rationals
    first: list[Fraction]
    right: Rationals
    second: list[Fraction]


@dataclass(frozen=True)
class Bordered(MarginClaim):
    """The poles stay in the region while the gain is off by ``error`` times some errors."""

    has_remainder: ClassVar[bool] = True
    has_cells: ClassVar[bool] = True
    of_signals: ClassVar[bool] = False  # whether what the law measures is multiplied, or states are

    error: Fraction

    def value(self, name: str) -> Fraction:  # noqa: ARG002
        """Return the error, whatever gains it is of."""
        return self.error

    def border(self, pair: int) -> Border:
        """Return what stands beside F of one L, M of the region, and of its cells of each."""
        raise NotImplementedError

    def beside(self, sizes: Sequence[Fraction]) -> tuple[list[Fraction], Rationals, list[Fraction]]:
        """Return what the error does to V of a remainder, whose rows of inputs have these sizes.

        It is what it takes of V's own diagonal, a small share of one for each input; H and Q.
        """
        raise NotImplementedError

    @property
    def of_lyapunov(self) -> bool:
        """Whether the design is of a law that was given."""
        return self.subject.design.method == "lyapunov"

    @property
    def pairs(self) -> int:
        """How many L, M there are, those of cells one each."""
        design = self.subject.design
        if not self.of_lyapunov:
            return sum(len(part.pairs) for part in design.region)
        parts = zip(design.region, design.evidence, strict=True)
        return sum(len(part.pairs) * len(evidence.per_cell) for part, evidence in parts)

    def require_own(self, count: int) -> None:  # noqa: ARG002
        """Refuse pieces and errors that do not fit."""
        if self.of_lyapunov and any(pieces != 1 for pieces in self.subject.pieces):
            raise FormatError("pieces must be 1 for errors of a gain that was given")
        require_numbers((self.error,), 1, "error")

    def work(self) -> tuple[int, int]:
        """Return how many inequalities there are, and half their size."""
        design = self.subject.design
        size = 2 * len(design.A[0]) + len(design.B[0][0])
        if self.of_signals and design.law.C:
            size += max(0, len(design.law.C[0]) - len(design.A[0]))
        if not self.of_lyapunov:
            return self.pieces_work(self.subject.degree()), size
        pairs = zip(design.region, design.evidence, strict=True)
        count = sum(
            count_of(design.sizes, design.degree(cell) + self.subject.elevation) * len(part.pairs)
            for part, evidence in pairs
            for cell in evidence.per_cell
        )
        return count, size

    def decided(self) -> Verdict:
        """Prove it; cells must make up the box."""
        return in_cells(self.subject.design.evidence, super().decided)

    def inequalities(self) -> Iterator[Inequality]:
        """Yield X > 0 and the bordered F > 0 of every part of the region."""
        subject, region, numbers = self.subject, self.subject.design.region, count()
        if self.of_lyapunov:
            design = subject.design
            for part, evidence in zip(region, design.evidence, strict=True):
                for k, piece in enumerate(evidence.cells):
                    for F in self._of_given(design.inside(piece), part, piece.evidence, numbers):
                        yield replace(F, piece=f", cell {k + 1}")
                if not evidence.cells:
                    yield from self._of_given(design, part, evidence, numbers)
            return
        family = family_of(subject)
        for cell in cells(subject):
            X, N, AB = cell.loop(family)
            degrees = cell.elevated(N.degrees, subject.elevation)
            yield from cell.positive(X, degrees, region)
            B, numbers = AB.part(slice(None), slice(family.n, None)), count()
            for part in region:
                for rows in self._bordered(part, (X, X, N, B), numbers):
                    yield Inequality(part.kind, rows, degrees, cell.name)

    def _of_given(
        self, design: Poles, part: Part, evidence: Evidence, numbers: Iterator[int]
    ) -> Iterator[Inequality]:
        sizes, n = design.sizes, len(design.A[0])
        AB, XKX = design.AB, lifted(design.law, evidence, sizes)
        X, N, B = XKX.part(slice(n)), AB * XKX, AB.part(slice(None), slice(n, None))
        by = self.subject.elevation + evidence.elevation
        degrees = tuple(degree + by for degree in N.degrees)
        law, Y = design.law, X
        if self.of_signals and law.C:
            Y = X * affine(law.C, sizes).T
        if not part.definite:
            yield Inequality("of X", [[X]], degrees)
        if evidence.spread is not None:
            blocks = self._bounding(evidence.spread, XKX, Y)
            yield Inequality.raised("of the remainder", blocks, by)
        for rows in self._bordered(part, (X, Y, N, B), numbers, evidence.spread):
            yield Inequality(part.kind if len(design.region) > 1 else "", rows, degrees)

    def _bounding(self, spread: Spread, XKX: Polynomial, Y: Polynomial) -> list[list[Polynomial]]:
        """Return the blocks that say that Omega is more than V'V with the error in V too.

        Of u it adds D Delta C X, D = diag(columns of u); Y is X C'.
        """
        sizes, n = Y.sizes, Y.shape[0]
        m = XKX.shape[0] - n
        (first, side), (corner,) = spread.bounding(spread.moving(XKX))
        less, right, below = self.beside(spread.columns[n : n + m])
        if not below:
            return [[first, side], [corner]]
        corner = corner - diagonal([Fraction(0)] * n + less, sizes)
        end = (Y * constant(right, sizes).T).times(self.error)
        none = constant([[Fraction(0)] * end.shape[1]] * corner.shape[0], sizes)
        return [[first, side, end], [corner, none], [diagonal(below, sizes)]]

    def _bordered(
        self,
        part: Part,
        loop: tuple[Polynomial, Polynomial, Polynomial, Polynomial],
        numbers: Iterator[int],
        spread: Spread | None = None,
    ) -> Iterator[list[list[Polynomial]]]:
        """Yield the blocks of each L, M: F, and what the error puts beside and below it."""
        X, Y, N, B = loop
        sizes = X.sizes
        for L, M in part.pairs:
            border, (M1, M2) = self.border(next(numbers)), factors(M)
            left = (B * constant(border.left, sizes)).beside(M1)
            right = (Y * constant(border.right, sizes).T).times(self.error)
            right = right.beside([list(column) for column in zip(*M2, strict=True)])
            one = diagonal(border.first * len(M1[0]), sizes)
            other = diagonal(border.second * len(M2), sizes)
            between = constant([[Fraction(0)] * right.shape[1]] * left.shape[1], sizes)
            F = lyapunov(L, M, X, N)
            if spread is not None:
                F = F - constant(spread.of_region((M1, M2)), sizes)
            yield [[F, left, right], [one, between], [other]]
