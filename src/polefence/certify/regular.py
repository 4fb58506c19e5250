"""A plant of fewer states, exactly, whose best law is as good as that of the plant it is of.

Inputs that no output shows cost nothing. What they move at once is as good as an input itself: with
B2 their columns and T B2 = 0, y = T x and x = Y y + B2 v,

    y' = T A Y y + T A B2 v + T B1 u1 + T E w.

Repeated until no input is left that no output shows. Then motions along which some u = F x keeps
all outputs zero cost nothing either, and those that neither grow nor fade, the zeros at s = 0, have
no regulator: with T zero along them, y = T x has A + B F and C + D F. No law of the plant does
better than the best of this one; of means of squares, for a P of this one the inequality holds with
T'P T of the plant, and of gains for a Z of this one with [T, 0; 0, I]'Z [T, 0; 0, I].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from polefence.proof.matrices import Rationals, identity
from polefence.proof.short import Short

_ZERO, _ONE = Fraction(0), Fraction(1)


def lifted(P: Rationals, T: Rationals) -> Rationals:
    """Return T'P T."""
    columns = list(zip(*T, strict=True))
    half = [[dot(row, column) for column in columns] for row in P]
    return [[dot(left, right) for right in zip(*half, strict=True)] for left in columns]


@dataclass(frozen=True)
class Regular(Short):
    """x' = A x + B u + E w, y = C x + D u with D of full column rank, x = T times the plant's."""

    A: Rationals
    B: Rationals
    E: Rationals
    C: Rationals
    D: Rationals
    T: Rationals


def regular(A: Rationals, B: Rationals, E: Rationals, C: Rationals, D: Rationals) -> Regular | None:
    """Return the plant of fewer states; None if no state or input is left."""
    plant = _without_unseen(Regular(A, B, E, C, D, identity(len(A))))
    while hidden := null_space(plant.D):
        fewer = _without_inputs(plant, hidden)
        if fewer is None:
            return None
        plant = fewer
    return without_zeros(plant)


def _without_unseen(plant: Regular) -> Regular:
    """Return the plant without states, such as a sensor's, that no output depends on, if stable."""
    size = range(len(plant.A))
    kept = {i for i in size if any(row[i] for row in plant.C)}
    while more := {k for i in kept for k in size if plant.A[i][k]} - kept:
        kept |= more
    left = sorted(set(size) - kept)
    if not (left and kept):
        return plant
    dropped = np.array([[float(plant.A[i][k]) for k in left] for i in left])
    if np.linalg.eigvals(dropped).real.max() >= 0:
        return plant
    rows = sorted(kept)
    A, C = ([[row[k] for k in rows] for row in M] for M in (plant.A, plant.C))
    B, E, T = ([M[i] for i in rows] for M in (plant.B, plant.E, plant.T))
    return Regular([A[i] for i in rows], B, E, C, plant.D, T)


def _without_inputs(plant: Regular, hidden: Rationals) -> Regular | None:
    """Return the plant with what hidden inputs move as inputs in their place."""
    n, (_, shown) = len(plant.A), _reduced(plant.D)
    G, pivots = _reduced(transposed(product(plant.B, transposed(hidden))))
    if len(pivots) == n or not (pivots or shown):
        return None
    T, Y = _quotient(G, pivots, n)
    V = [[g[i] for g in G] for i in range(n)]
    moved = [
        [*a, *(b[j] for j in shown)] for a, b in zip(product(plant.A, V), plant.B, strict=True)
    ]
    seen = [[*c, *(d[j] for j in shown)] for c, d in zip(product(plant.C, V), plant.D, strict=True)]
    A, C = product(T, product(plant.A, Y)), product(plant.C, Y)
    return Regular(A, product(T, moved), product(T, plant.E), C, seen, product(T, plant.T))


def without_zeros(plant: Regular, every: bool = False) -> Regular | None:
    """Return the plant without the motions of zeros at s = 0, or of every zero if one is stable."""
    n, m = len(plant.A), len(plant.B[0])
    DT = transposed(plant.D)
    both = [[*a, *b] for a, b in zip(product(DT, plant.D), product(DT, plant.C), strict=True)]
    F = [[-x for x in row[m:]] for row in _reduced(both)[0]]
    A, C = _sum(plant.A, product(plant.B, F)), _sum(plant.C, product(plant.D, F))
    seen = _settled(_reduced(C)[0], A, C)
    power = [] if every else _settled(_reduced(A)[0], A, [])
    G, pivots = _reduced(null_space([*seen, *power]) if seen or power else identity(n))
    if not pivots:
        return plant
    if every:
        moved = [[dot(row, g) for row in A] for g in G]
        if np.linalg.eigvals([[float(v[p]) for p in pivots] for v in moved]).real.min() > 0:
            return plant
    if len(pivots) == n:
        return None
    T, Y = _quotient(G, pivots, n)
    return Regular(
        product(T, product(A, Y)),
        product(T, plant.B),
        product(T, plant.E),
        product(C, Y),
        plant.D,
        product(T, plant.T),
    )


def _settled(rows: Rationals, A: Rationals, first: Rationals) -> Rationals:
    """Return ``first`` and rows times A, reduced, again and again until their number stays."""
    while rows and len(rows) < len(A):
        more = _reduced([*first, *product(rows, A)])[0]
        if len(more) == len(rows):
            break
        rows = more
    return rows


def _quotient(G: Rationals, pivots: list[int], n: int) -> tuple[Rationals, Rationals]:
    """Return T with T g = 0 for the rows g of a reduced basis, and Y with T Y = I."""
    others = [q for q in range(n) if q not in pivots]
    T = [[_ONE * (q == j) for j in range(n)] for q in others]
    for row, q in zip(T, others, strict=True):
        for g, p in zip(G, pivots, strict=True):
            row[p] -= g[q]
    return T, [[_ONE * (i == q) for q in others] for i in range(n)]


def transposed(matrix: Rationals) -> Rationals:
    """Return the transpose."""
    return [list(row) for row in zip(*matrix, strict=True)]


def product(a: Rationals, b: Rationals) -> Rationals:
    """Return the product of two matrices."""
    columns = list(zip(*b, strict=True))
    return [[dot(row, column) for column in columns] for row in a]


def _sum(a: Rationals, b: Rationals) -> Rationals:
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    """Return the sum of products."""
    return sum((x * y for x, y in zip(a, b, strict=True)), _ZERO)


def _reduced(matrix: Rationals) -> tuple[Rationals, list[int]]:
    """Return the reduced row echelon form without rows of zeros, and its pivots' columns."""
    rows, done, pivots = [row[:] for row in matrix], list[list[Fraction]](), list[int]()
    for j in range(len(matrix[0]) if matrix else 0):
        k = next((k for k, row in enumerate(rows) if row[j]), None)
        if k is None:
            continue
        first = rows.pop(k)
        first = [x / first[j] for x in first]
        rows, done = (
            [[x - row[j] * f for x, f in zip(row, first, strict=True)] for row in others]
            for others in (rows, done)
        )
        done.append(first)
        pivots.append(j)
    return done, pivots


def null_space(matrix: Rationals) -> Rationals:
    """Return a basis, as rows."""
    rows, pivots = _reduced(matrix)
    width = len(matrix[0])
    basis = []
    for j in (j for j in range(width) if j not in pivots):
        vector = [_ONE * (i == j) for i in range(width)]
        for row, p in zip(rows, pivots, strict=True):
            vector[p] = -row[j]
        basis.append(vector)
    return basis
