"""Lyapunov matrices of one loop, solved in rationals: where poles nearly meet doubles hold none.

A loop whose n poles are all about d away from an edge, and about as near to one another, has
Lyapunov matrices with a condition of about d to the power of -2 (n - 1). Of one plant and one gain
the equation is linear and has a solution where the region is kept, whatever that condition.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations_with_replacement

import numpy as np

from polefence.law.laws import Law
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Region

Rows = list[list[Fraction]]


def lyapunov_matrices(plant: UncertainPlant, law: Law, part: Region) -> list[np.ndarray]:
    """Return Lyapunov matrices (1, n, n) of a plant of one vertex, entries as text "p/q".

    The roughest comes first. There are none of other laws, larger plants and other parts of
    regions than half-planes and disks.
    """
    one = len(plant.vertices) == 1 and plant.remainder is None and not plant.moving
    if not one or law.K is None or plant.shape[0] > 10:  # the equation has n (n + 1) / 2 unknowns
        return []
    vertex, n = plant.vertices[0], plant.shape[0]
    K = [[Fraction(x) for x in row] for row in law.K.tolist()]
    A = [
        [vertex.exact_A[i][j] + sum(b * k[j] for b, k in zip(vertex.exact_B[i], K, strict=True))
         for j in range(n)]
        for i in range(n)
    ]  # fmt: skip
    X = _solution(A, part)
    if X is None or any(X[i][i] <= 0 for i in range(n)):
        return []
    size = max(abs(x) for row in X for x in row)
    texts = []
    for bits in (64, 128, 256):  # bits after the point, of the solution over its largest entry
        unit = Fraction(2) ** (size.numerator.bit_length() - size.denominator.bit_length() - bits)
        text = [[str(round(x / unit) * unit) for x in row] for row in X]
        texts.append(np.array([text], dtype=object))
    return texts


def _solution(A: Rows, part: Region) -> Rows | None:
    """Return X of a X + b (A X + X A') + e A X A' + I = 0, None where the part is no such form."""
    if part.closed_form is None:
        return None
    a, b, e = part.closed_form
    n = len(A)
    pairs = list(combinations_with_replacement(range(n), 2))
    place = {pair: k for k, pair in enumerate(pairs)}
    rows = list[list[Fraction]]()
    for i, j in pairs:
        row = [Fraction(0)] * (len(pairs) + 1)
        row[place[i, j]] += a
        for k in range(n):
            row[place[min(k, j), max(k, j)]] += b * A[i][k]
            row[place[min(i, k), max(i, k)]] += b * A[j][k]
            for m in range(n) if e else ():
                row[place[min(k, m), max(k, m)]] += e * A[i][k] * A[j][m]
        row[-1] = Fraction(-1 if i == j else 0)
        rows.append(row)
    values = _solved(rows)
    if values is None:
        return None
    return [[values[place[min(i, j), max(i, j)]] for j in range(n)] for i in range(n)]


def _solved(rows: Rows) -> list[Fraction] | None:
    """Return the solution of linear equations, the right-hand sides last; None without one."""
    count = len(rows)
    for k in range(count):
        pivot = next((i for i in range(k, count) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        pivoted = rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(count):
            if i != k and rows[i][k]:
                share = rows[i][k]
                rows[i] = [x - share * y for x, y in zip(rows[i], pivoted, strict=True)]
    return [row[-1] for row in rows]
