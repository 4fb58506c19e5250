"""Petersen's inequality: what an error of the gain puts beside and below a region's inequality."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    Rationals,
    _denominator,
    _integers,
    _times,
    _transposed,
    bits,
)
from polefence.proof.service.claims import Gain
from polefence.proof.work import spend


@dataclass(frozen=True)
class Border:
    """Completes F to [ F, mu M1 (x) B S, e M2' (x) X T' ; *, mu I, 0 ; *, 0, mu I ].

    ``left`` has mu M1 times the diagonal of S for each entry of M1, ``right`` the rows of e M2',
    ``across`` T; all whole numbers, F to come times ``whole``.
    """

    left: list[Integers]
    right: Integers
    across: Integers
    corner: int
    whole: int

    def around(self, F: Integers, X: Integers, B: Integers, one: int) -> Integers:
        """Return the block of one coefficient; ``one`` is that of the number 1."""
        upper = []
        spend(len(X) ** 3, bits(X), bits(self.across))
        length = max(bits(self.right), *map(bits, self.left), self.whole.bit_length())
        width = len(self.left[0]) * len(B[0]) + len(self.right[0]) * len(X) + len(F)
        spend(len(F) * width, length, max(bits(F), bits(X), bits(B)))
        XT = [[sum(map(int.__mul__, x, t)) for t in self.across] for x in X]
        for i, row in enumerate(F):
            a, k = divmod(i, len(X))
            beside = [s * b for each in self.left[a] for s, b in zip(each, B[k], strict=True)]
            beside += [s * x for s in self.right[a] for x in XT[k]]
            upper.append((_times(self.whole, [row])[0], beside))
        size, diagonal = len(upper[0][1]), self.corner * one
        lower = _transposed([beside for _, beside in upper])
        return [row + beside for row, beside in upper] + [
            column + [diagonal * (i == j) for j in range(size)] for i, column in enumerate(lower)
        ]


def border_of(claim: Gain, mu: Fraction, M: Rationals, units: tuple[int, int, int]) -> Border:
    """Return the border for one L, M; F comes times all ``units``, B and X times one each."""
    common, plant, law = units
    M1, M2 = _factors(M)
    T = claim.right
    d, rank, own = len(M), len(M2), _denominator([T])
    left = [[mu * common * law * x * s for s in claim.rows] for row in M1 for x in row]
    right = [[claim.error * common * plant * row[a] / own for row in M2] for a in range(d)]
    corner = mu * common * plant * law
    whole = _denominator([left, right, [[corner]]], 8 * MAX_BITS)
    lefts = _integers(left, whole)
    return Border(
        [lefts[a * rank : (a + 1) * rank] for a in range(d)],
        _integers(right, whole),
        _integers(T, own),
        int(corner * whole),
        whole,
    )


def _factors(M: Rationals) -> tuple[Rationals, Rationals]:
    """Return M1, M2 of full rank with M = M1 M2: M's pivot columns, its reduced rows."""
    rows, pivots = [list(row) for row in M], list[int]()
    for column in range(len(M[0])):
        r = len(pivots)
        pivot = next((i for i in range(r, len(rows)) if rows[i][column]), None)
        if pivot is None:
            continue
        rows[r], rows[pivot] = rows[pivot], rows[r]
        rows[r] = [value / rows[r][column] for value in rows[r]]
        for i, row in enumerate(rows):
            if i != r and row[column]:
                rows[i] = [x - row[column] * y for x, y in zip(row, rows[r], strict=True)]
        pivots.append(column)
    return [[row[p] for p in pivots] for row in M], rows[: len(pivots)]
