"""Poles in a region while the parameters are known to within errors.

F > 0 for X = X(q), N = A(p) X(q) + B(p) K(q) X(q), a polynomial, p the parameters and q their
estimates. At each q, F is multi-affine in the scheduling variables of p: p_i = q_i + e_i and
q_i - e_i, cut off at the bounds, are enough. Between the points where a bound begins to act both
are affine in q_i, and times p_i, or q_i, so is what is affine in 1/p_i, or 1/q_i. Without
parameters: p = (1 - e) a + e u, q = (1 - e) a + e v, a, v in the simplex, u its corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product
from typing import Any, ClassVar

from polefence.proof.claims.base import Inequality
from polefence.proof.claims.margins import (
    Cell,
    MarginClaim,
    Subject,
    family_of,
    listed,
    require_numbers,
    unit_rows,
)
from polefence.proof.matrices import common_denominator, whole_numbers
from polefence.proof.pieces import numbered
from polefence.proof.plant import Plant, Range
from polefence.proof.polynomials import (
    COORDINATES,
    Polynomial,
    Sizes,
    count_of,
    form,
)
from polefence.proof.reading import Table, plain
from polefence.proof.regions import lyapunov
from polefence.proof.text import digits_down, region_text
from polefence.proof.work import FormatError, spend

_Ends = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Estimate(MarginClaim):
    """The poles stay in the region while each parameter is known to within its error.

    ``errors`` in the parameters' own units; without parameters one number, the share of weight
    that is mislaid.
    """

    kind: ClassVar[str] = "estimate"

    errors: tuple[Fraction, ...]

    @classmethod
    def read_own(cls, table: Table, subject: Subject) -> dict[str, Any]:  # noqa: ARG003
        """Read the errors."""
        return {"errors": table.numbers("errors")}

    def write_own(self) -> dict[str, Any]:
        """Return the errors."""
        return {"errors": plain(self.errors)}

    def require_own(self, count: int) -> None:
        """Refuse errors that are none, and rows of what is measured that vary: u = K(q) C(p) x."""
        C = self.subject.design.law.C
        if any(rows != C[0] for rows in C):
            raise FormatError("law.measured: outputs that vary have no proofs with estimates")
        require_numbers(self.errors, count, "errors")
        if not self.subject.ranges and self.errors[0] > 1:
            raise FormatError("errors: a share is at most 1")

    def work(self) -> tuple[int, int]:
        """Return how many inequalities there are, and half their size."""
        subject, design = self.subject, self.subject.design
        degree = max(subject.degree(k) for k, _ in subject.parts)
        each = self.pieces_work(degree)
        if not subject.ranges:
            return each * len(design.A) * count_of(subject.sizes, degree), len(design.A[0])
        for pieces, error in zip(subject.pieces, self.errors, strict=True):
            each = each // pieces * 2 * (pieces + 1) if error else each
        return each, len(design.A[0])

    def inequalities(self) -> Iterator[Inequality]:
        """Yield F > 0 on the pieces on which p is affine in its estimate."""
        subject = self.subject
        for number, parts in subject.parts:
            family = family_of(subject, number)
            for cell in self.cells(family.varies):
                X, N, _ = cell.loop(family)
                degrees = cell.elevated(N.degrees, subject.elevation)
                yield from cell.positive(X, degrees, parts)
                for part in parts:
                    for L, M in part.pairs:
                        F = lyapunov(L, M, X, N)
                        yield Inequality(part.kind, [[F]], degrees, cell.name)

    def cells(self, varies: bool = True) -> Iterator[Cell]:
        """Yield the pieces, for all signs of the errors; ``varies`` is whether the law does."""
        subject, sizes = self.subject, self.subject.sizes
        if not subject.ranges:
            yield from _mislaid(len(subject.design.A), self.errors[0], varies)
            return
        pieces = [
            [_forms(f, r, *ends, sizes) for ends in segments(r, error, count)]
            for f, (r, error, count) in enumerate(
                zip(subject.ranges, self.errors, subject.pieces, strict=True)
            )
        ]
        for numbers in product(*(range(len(each)) for each in pieces)):
            chosen = [pieces[f][k] for f, k in enumerate(numbers)]
            plant, law = ([own for each in chosen for own in each[side]] for side in (0, 1))
            yield Cell(f" in piece {numbered(numbers)}", sizes, plant, law, len(sizes))

    def statement(self, plant: Plant) -> str:
        """Say which errors leave the poles where."""
        names, region = self.names(plant), region_text(self.subject.design.region)
        share = f"a share {digits_down(self.errors[0], 4)} of the weight mislaid"
        errors = listed("{} wrong by up to {} {}", names, self.errors) if names else share
        return f"{errors}, poles in {region}{self.within(plant)}"


def _forms(
    f: int, r: Range, own: _Ends, estimated: _Ends, sizes: Sizes
) -> tuple[list[Polynomial], list[Polynomial]]:
    """Return the coordinates of a parameter and of its estimate on one piece."""
    plant, law = (
        [form(f, values, sizes) for values in _at_ends(r, ends)] for ends in (own, estimated)
    )
    return plant, law


def segments(r: Range, error: Fraction, pieces: int) -> list[tuple[_Ends, _Ends]]:
    """Return the ends of p and of its estimate, for every piece and both signs of the error."""
    found = []
    for sign in (-1, 1) if error else (0,):
        bend = r.low + error if sign < 0 else r.high - error  # a bound acts on one side of it
        cuts = {r.low + (r.high - r.low) * k / pieces for k in range(pieces + 1)}
        cuts |= {bend} if r.low < bend < r.high else set()
        for ends in pairwise(sorted(cuts)):
            low, high = (min(max(q + sign * error, r.low), r.high) for q in ends)
            found.append(((low, high), ends))
    return found


def _at_ends(r: Range, ends: _Ends) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the two coordinates at the ends of a piece, times one positive integer.

    Times |p| where they are affine in 1/p: with it they are affine in p.
    """
    low, high = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
    pairs = []
    for p in ends:
        share = ((1 / p if r.inverted else p) - low) / (high - low)
        factor = abs(p) if r.inverted else Fraction(1)
        pairs.append([factor * (1 - share), factor * share])
    whole = whole_numbers(pairs, common_denominator([pairs]))
    return (whole[0][0], whole[1][0]), (whole[0][1], whole[1][1])


def _mislaid(N: int, share: Fraction, varies: bool) -> Iterator[Cell]:
    """Yield p = (1 - e) a + e u, q = (1 - e) a + e v for the corners u, in coordinates a and v.

    A law that does not vary with alpha needs no coordinates of q.
    """
    sizes = (N, N)
    spend(2 * N * (2 * N // COORDINATES), 0)
    a, v = ([form(f, row, sizes) for row in unit_rows(N)] for f in (0, 1))
    sums = [form(f, (1,) * N, sizes) for f in (0, 1)]
    law = [
        sums[1] * a[c].times(1 - share) + sums[0] * v[c].times(share)
        for c in range(N if varies else 0)
    ]
    for u in range(N):
        plant = [each.times(1 - share) for each in a]
        plant[u] = plant[u] + sums[0].times(share)
        yield Cell(f" towards vertex {u + 1}", sizes, plant, law, 1)
