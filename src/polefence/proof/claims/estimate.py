"""Poles in a region while the parameters are known to within errors.

F > 0 for X = X(q), N = A(p) X(q) + B(p) K(q) X(q), a polynomial, p the parameters and q their
estimates. At each q, F is multi-affine in the scheduling variables of p: p_i = q_i + e_i and
q_i - e_i, cut off at the bounds, are enough. Between the points where a bound begins to act both
are affine in q_i, and times p_i, or q_i, so is what is affine in 1/p_i, or 1/q_i. Without
parameters: p = (1 - e) a + e u, q = (1 - e) a + e v, a, v in the simplex, u its corners.

Of a plant with a curve F is a polynomial in p of higher degree, and all p between the two count:
p_i is affine in one more coordinate, from one to the other; u is any point of the simplex. What its
remainder costs is what it costs the design, for V = diag(columns) [X; K X] is of q alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
from polefence.proof.matrices import (
    Integers,
    Rationals,
    common_denominator,
    transposed,
    whole_numbers,
)
from polefence.proof.pieces import numbered
from polefence.proof.plant import Plant
from polefence.proof.polynomials import (
    COORDINATES,
    Polynomial,
    Sizes,
    constant,
    count_of,
    form,
)
from polefence.proof.ranges import Range
from polefence.proof.reading import Table
from polefence.proof.regions import factors, lyapunov
from polefence.proof.text import digits_down, region_text
from polefence.proof.work import FormatError, spend

_Ends = tuple[Fraction, Fraction]
_Forms = tuple[list[Polynomial], list[Polynomial]]  # of a parameter, and of its estimate


@dataclass(frozen=True)
class Estimate(MarginClaim):
    """The poles stay in the region while each parameter is known to within its error.

    ``errors`` in the parameters' own units; without parameters one number, the share of weight
    that is mislaid.
    """

    kind: ClassVar[str] = "estimate"
    has_remainder: ClassVar[bool] = True

    errors: tuple[Fraction, ...]

    @property
    def values(self) -> tuple[Fraction, ...]:
        """The errors."""
        return self.errors

    @classmethod
    def read_own(cls, table: Table, subject: Subject) -> dict[str, Any]:  # noqa: ARG003
        """Read the errors."""
        return {"errors": table.numbers("errors")}

    def require_own(self, count: int) -> None:
        """Refuse errors that are none, and rows of what is measured that vary: u = K(q) C(p) x."""
        C = self.subject.design.law.C
        if any(rows != C[0] for rows in C):
            raise FormatError("law.measured: with estimates, outputs must not vary")
        require_numbers(self.errors, count, "errors")
        if not self.subject.ranges and self.errors[0] > 1:
            raise FormatError("errors: a share is at most 1")

    def work(self) -> tuple[int, int]:
        """Return how many inequalities there are, and half their size."""
        subject, n, d = self.subject, len(self.subject.design.A[0]), self.subject.plant_degree
        degree = max(subject.degree(k) for k, _ in subject.parts)
        total = self.pieces_work(degree)
        if not subject.ranges:
            return total * count_of(subject.sizes, d) * count_of(subject.sizes, degree), n
        for pieces, error in zip(subject.pieces, self.errors, strict=True):
            most = 2 * (pieces + 1) if d == 1 else (d + 1) * (pieces + 2)
            total = total // pieces * most if error else total
        return total, n

    def inequalities(self) -> Iterator[Inequality]:
        """Yield F > 0 on the pieces on which p is affine in its estimate."""
        subject = self.subject
        for number, parts in subject.parts:
            family, evidence = family_of(subject, number), subject.design.evidence[number]
            spread = evidence.spread
            if spread is not None:
                blocks = spread.bounding(spread.moving(family.XKX))
                yield Inequality.raised("of the remainder", blocks, evidence.elevation)
            for cell in self.cells(family.varies):
                X, N, _ = cell.loop(family)
                degrees = cell.elevated(N.degrees, subject.elevation)
                yield from cell.positive(X, degrees, parts)
                for part in parts:
                    for L, M in part.pairs:
                        F = lyapunov(L, M, X, N)
                        if spread is not None:
                            lost = constant(spread.of_region(factors(M)), cell.sizes)
                            F = F - cell.one(family) * lost
                        yield Inequality(part.kind, [[F]], degrees, cell.name)

    def cells(self, varies: bool = True) -> Iterator[Cell]:
        """Yield the pieces, for all signs of the errors; ``varies`` is whether the law does."""
        subject, curved = self.subject, self.subject.plant_degree > 1
        if not subject.ranges:
            yield from _mislaid(len(subject.design.A), self.errors[0], varies, curved)
            return
        count = len(subject.ranges)
        between = sum(map(bool, self.errors)) if curved else 0
        sizes, pieces = (2,) * (count + between), list[list[_Forms]]()
        last = count
        for f, (r, error, number) in enumerate(
            zip(subject.ranges, self.errors, subject.pieces, strict=True)
        ):
            split = bands(r, error, number) if curved else segments(r, error, number)
            pieces.append([_forms((f, last), r, *ends, sizes) for ends in split])
            last += bool(error)
        for numbers in product(*(range(len(forms)) for forms in pieces)):
            chosen = [pieces[f][k] for f, k in enumerate(numbers)]
            plant, law = ([c for forms in chosen for c in forms[side]] for side in (0, 1))
            yield Cell(f" in piece {numbered(numbers)}", sizes, plant, law, count)

    def statement(self, plant: Plant) -> str:
        """Say which errors leave the poles where."""
        names, region = self.names(plant), region_text(self.subject.design.region)
        share = f"a share {digits_down(self.errors[0], 4)} of the weight mislaid"
        errors = listed("{} wrong by up to {} {}", names, self.errors) if names else share
        return f"{errors}, poles in {region}{self.within(plant)}"


def _forms(
    simplices: tuple[int, int], r: Range, sides: tuple[_Ends, ...], estimated: _Ends, sizes: Sizes
) -> _Forms:
    """Return the coordinates of a parameter and of its estimate on one piece.

    In the piece's own coordinates, the first of the simplices; where p has two sides, those of the
    second lead from one to the other.
    """
    axes = simplices[: len(sides)]
    plant = [_form(axes, row, sizes) for row in _at_ends(r, [p for ends in sides for p in ends])]
    return plant, [_form(axes[:1], row, sizes) for row in _at_ends(r, estimated)]


def _form(simplices: tuple[int, ...], values: Sequence[int], sizes: Sizes) -> Polynomial:
    """Return the form of these values at the corners of simplices of two, the last slowest."""
    terms = {}
    for corner, value in zip(product((0, 1), repeat=len(simplices)), values, strict=True):
        ones = {2 * f + c for f, c in zip(reversed(simplices), corner, strict=True)}
        if value:
            terms[tuple(int(j in ones) for j in range(2 * len(sizes)))] = [[value]]
    return Polynomial(terms, sizes, tuple(int(f in simplices) for f in range(len(sizes))))


def segments(r: Range, error: Fraction, pieces: int) -> list[tuple[tuple[_Ends, ...], _Ends]]:
    """Return the ends of p and of its estimate, for every piece and both signs of the error."""
    pairs = list[tuple[tuple[_Ends, ...], _Ends]]()
    for sign in (-1, 1) if error else (0,):
        bend = r.low + error if sign < 0 else r.high - error  # a bound acts on one side of it
        pairs += [((_off(r, ends, sign * error),), ends) for ends in _between(r, pieces, bend)]
    return pairs


def bands(r: Range, error: Fraction, pieces: int) -> list[tuple[tuple[_Ends, ...], _Ends]]:
    """Return the ends of the least and the largest p, and of its estimate, for every piece."""
    if not error:
        return segments(r, error, pieces)
    cut = _between(r, pieces, r.low + error, r.high - error)
    return [((_off(r, ends, -error), _off(r, ends, error)), ends) for ends in cut]


def _between(r: Range, pieces: int, *bends: Fraction) -> list[_Ends]:
    """Return the ends of equal pieces, cut where they bend too."""
    cuts = {r.low + (r.high - r.low) * k / pieces for k in range(pieces + 1)}
    return list(pairwise(sorted(cuts | {bend for bend in bends if r.low < bend < r.high})))


def _off(r: Range, ends: _Ends, error: Fraction) -> _Ends:
    """Return the ends of p, which stays in its range."""
    low, high = (min(max(q + error, r.low), r.high) for q in ends)
    return low, high


def _at_ends(r: Range, ends: Sequence[Fraction]) -> Integers:
    """Return the two coordinates at the ends of a piece, times one positive integer.

    Times |p| where they are affine in 1/p: with it they are affine in p.
    """
    low, high = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
    pairs: Rationals = []
    for p in ends:
        share = ((1 / p if r.inverted else p) - low) / (high - low)
        factor = abs(p) if r.inverted else Fraction(1)
        pairs.append([factor * (1 - share), factor * share])
    return transposed(whole_numbers(pairs, common_denominator([pairs])))


def _mislaid(N: int, share: Fraction, varies: bool, anywhere: bool) -> Iterator[Cell]:
    """Yield p = (1 - e) a + e u, q = (1 - e) a + e v for the corners u, in coordinates a and v.

    With ``anywhere`` for all u of the simplex, in coordinates of u too. A law that does not vary
    with alpha needs no coordinates of q.
    """
    sizes = (N,) * (3 if anywhere else 2)
    spend(sum(sizes) * (sum(sizes) // COORDINATES), 0)
    a, *others = ([form(f, row, sizes) for row in unit_rows(N)] for f in range(len(sizes)))
    sums = [form(f, (1,) * N, sizes) for f in range(len(sizes))]
    v, *u = (
        [
            sums[f] * vertex.times(1 - share) + sums[0] * x.times(share)
            for vertex, x in zip(a, to, strict=True)
        ]
        for f, to in enumerate(others, 1)
    )
    law = v if varies else []
    if anywhere:
        yield Cell("", sizes, u[0], law, 1)
        return
    for k in range(N):
        plant = [vertex.times(1 - share) for vertex in a]
        plant[k] = plant[k] + sums[0].times(share)
        yield Cell(f" towards vertex {k + 1}", sizes, plant, law, 1)
