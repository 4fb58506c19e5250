r"""Prove that a method cannot reach a radius, in exact arithmetic: lower bounds on its infimum.

A condition asks for x with every block F_b(x, r) = [[r Wl - floor, -M], [-M', r Wr]] > 0, linear
in x. If matrices Y_b >= 0, not all zero, have sum_b <Y_b, F_b(x, r)> = 0 for every x, then no x
does it at r, for the sum would be positive; nor at a smaller radius, because a feasible x has
Wl, Wr > 0 and its blocks only grow with r. With Y_b = [[P_b, X_b], [X_b', R_b]], S_j = A_j + sigma
I, and M_b the sum of S_j W_k + B_j Z_k over the pairs (j, k) of block b, as for `block_pairs`:

    Z_k    sum of B_j' X_b over pairs (j, k) of all b              = 0
    W_k    r sum of (P_b + R_b) - sum of (S_j' X_b + X_b' S_j)     = 0    quadratic, scheduled
    P_b    P_b - R_b = 0;    G    r sum of R_b - sum of S_b' X_b   = 0    slack (L: as Z)
    tau    sum tr P_(15) - (sum tr P_(16) + 6 sum tr P_(17)) / (N-1)^2 >= 0

`prove_infeasible` decides these with integers and trusts nothing; `polefence.certify.repair` finds
the matrices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations, permutations
from operator import mul
from typing import Any

from polefence.proof.claims.base import Verdict, undecided
from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    Rationals,
    bits,
    common_denominator,
    is_positive_definite,
    least_work,
    times,
    transposed,
    whole_numbers,
)
from polefence.proof.work import MAX_WORK, FormatError, counted, spend

METHODS = ("quadratic", "slack", "scheduled")
Pairs = list[tuple[int, int]]


@dataclass(frozen=True)
class Infeasible:
    """No law of this method is proved at radius ``r`` or less: the claim and its evidence.

    Attributes
    ----------
    method : str
        "quadratic", "slack" or "scheduled".
    A, B : list of matrices
        For each vertex.
    sigma, r : Fraction
    Y : list of matrices
        2n x 2n, for each block as ordered by `block_pairs`.
    right_hand_sides : bool
        Whether the condition has the right-hand sides of the paper's (15)-(17).
    """

    method: str
    A: list[Rationals]
    B: list[Rationals]
    sigma: Fraction
    r: Fraction
    Y: list[Rationals]
    right_hand_sides: bool = False


def block_pairs(method: str, N: int) -> list[Pairs]:
    """Return the pairs (j, k) of each block: S_j W_k + B_j Z_k add up to M, the W_k to Wl.

    The order of blocks everywhere here: vertices; for "scheduled" all (15), then (16) by
    ``permutations(range(N), 2)``, then (17) by ``combinations(range(N), 3)``.
    """
    if method != "scheduled":
        return [[(j, 0)] for j in range(N)]
    pairs: list[Pairs] = [[(j, j)] for j in range(N)]
    pairs += [[(j, j), (j, k), (k, j)] for j, k in permutations(range(N), 2)]
    pairs += [list(permutations(triple, 2)) for triple in combinations(range(N), 3)]
    return pairs


def prove_infeasible(claim: Infeasible) -> Verdict:
    """Decide whether Y proves that the method cannot reach the radius."""
    with counted():
        try:
            return _proved(claim)
        except FormatError as error:  # more work than is done here
            return undecided(str(error))


def _proved(claim: Infeasible) -> Verdict:
    fault = _malformed(claim)
    if fault:
        return undecided(fault)
    try:
        plant = _Plant.of(claim.A, claim.B, claim.sigma)
        denominators = [common_denominator([Y], 2 * MAX_BITS) for Y in claim.Y]
    except FormatError as error:
        return undecided(str(error))
    blocks = [whole_numbers(Y, d) for Y, d in zip(claim.Y, denominators, strict=True)]
    nonzero = 0
    for b, block in enumerate(blocks):
        if any(block[i][j] != block[j][i] for i in range(len(block)) for j in range(i)):
            return undecided(f"dual matrix {b + 1} is not symmetric")
        if any(map(any, block)):
            if not is_positive_definite(block):
                return undecided(f"dual matrix {b + 1} is not positive definite")
            nonzero += 1
    if not nonzero:
        return undecided("all dual matrices are zero")
    common = math.lcm(*denominators)
    scaled = [times(common // d, block) for d, block in zip(denominators, blocks, strict=True)]
    fault = _unbalanced(claim, plant, scaled)
    if fault:
        return undecided(fault)
    return Verdict("proved", f"{nonzero} dual matrices positive definite and balanced exactly")


def _malformed(claim: Infeasible) -> str:
    if claim.method not in METHODS:
        return f"method {claim.method!r} is not one of {', '.join(METHODS)}"
    if claim.right_hand_sides and claim.method != "scheduled":
        return "right-hand sides belong to the scheduled method"
    if claim.r <= 0:
        return "the radius is not positive"
    N = len(claim.A)
    if not N or not claim.A[0] or len(claim.B) != N:
        return "vertices are missing"
    count, n = _count(claim.method, N), len(claim.A[0])
    if least_work(count, 2 * n) > MAX_WORK:
        return f"{count} dual matrices of this size are too many to be checked here"
    if len(claim.Y) != count:
        return f"{len(claim.Y)} dual matrices, not one for each of {count} blocks"
    m = len(claim.B[0][0]) if claim.B[0] else 0
    shaped = [(claim.A, n, n), (claim.B, n, m), (claim.Y, 2 * n, 2 * n)]
    for matrices, rows, columns in shaped:
        if any(len(M) != rows or any(len(row) != columns for row in M) for M in matrices):
            return "matrices do not fit together"
    return ""


def _count(method: str, N: int) -> int:
    return N + (N * (N - 1) + math.comb(N, 3) if method == "scheduled" else 0)


def _unbalanced(claim: Infeasible, plant: _Plant, Y: list[Integers]) -> str:
    """Name the first equation that Y does not satisfy, if any."""
    N, n = len(plant.A), plant.n
    P, X, R = _parts(Y, n)
    if claim.method == "slack" and P != R:
        return "the equation of a P does not hold"
    pairs = block_pairs(claim.method, N)
    top, bottom = claim.r.numerator * plant.denominator, claim.r.denominator
    sums = [_plus(p, r) for p, r in zip(P, R, strict=True)]
    weights = _weights(pairs, sums)
    for k, (V, residual) in enumerate(_products(plant, pairs, X)):
        if any(map(any, residual)):
            return f"the equation of Z or L, number {k + 1}, does not hold"
        right = _plus(V, V if claim.method == "slack" else transposed(V))
        if times(top, weights[k]) != times(bottom, right):
            return f"the equation of W or G, number {k + 1}, does not hold"
    if claim.right_hand_sides and _bracket(N, [_trace(p) for p in P]) < 0:
        return "the inequality of tau does not hold"
    return ""


def _bracket(N: int, traces: list[Any]) -> Any:
    """Return the left-hand side of tau's inequality, times (N-1)^2."""
    square, sixteen = max(N - 1, 1) ** 2, N + N * (N - 1)
    return square * sum(traces[:N]) - sum(traces[N:sixteen]) - 6 * sum(traces[sixteen:])


@dataclass(frozen=True)
class _Plant:
    """The columns of [S_j, B_j], as integers over one denominator; ``A`` holds S."""

    A: list[Integers]
    B: list[Integers]
    denominator: int
    n: int

    @classmethod
    def of(cls, A: list[Rationals], B: list[Rationals], sigma: Fraction) -> _Plant:
        common = common_denominator([*A, *B, [[sigma]]])
        S = [whole_numbers(a, common) for a in A]
        for s in S:
            for i, row in enumerate(s):
                row[i] += int(sigma * common)
        return cls(S, [whole_numbers(b, common) for b in B], common, len(A[0]))

    @cached_property
    def columns(self) -> list[list[int]]:
        """Columns of [S, B] with the vertices' rows one below the other."""
        rows = [
            s + b for S, B in zip(self.A, self.B, strict=True) for s, b in zip(S, B, strict=True)
        ]
        return transposed(rows)


def _products(
    plant: _Plant, pairs: list[Pairs], X: list[Integers]
) -> list[tuple[Integers, Integers]]:
    """Return for every k the sums of S_j' X_b and B_j' X_b over the pairs (j, k) of all blocks."""
    n, at = plant.n, dict[tuple[int, int], list[Integers]]()
    for block, x in zip(pairs, X, strict=True):
        for pair in block:
            at.setdefault(pair, []).append(x)
    none = [[0] * n] * n
    products = []
    long = max(map(bits, (*plant.A, *plant.B))), max(map(bits, X))
    spend(n * len(plant.columns) * n * sum(map(len, pairs)), *long)
    for k in range(1 + max(k for _, k in at)):
        rows = [row for j in range(len(plant.A)) for row in _plus(*at.get((j, k), [none]))]
        right = transposed(rows)
        both = [[sum(map(mul, column, x)) for x in right] for column in plant.columns]
        products.append((both[:n], both[n:]))
    return products


def _weights(pairs: list[Pairs], matrices: list[Integers]) -> list[Integers]:
    """Return for every k the sum of matrices, each as often as its block has pairs (j, k)."""
    at: dict[int, list[Integers]] = {}
    for block, matrix in zip(pairs, matrices, strict=True):
        for _, k in block:
            at.setdefault(k, []).append(matrix)
    return [_plus(*at[k]) for k in sorted(at)]


def _parts(Y: list[Integers], n: int) -> tuple[list[Integers], list[Integers], list[Integers]]:
    P = [[row[:n] for row in block[:n]] for block in Y]
    X = [[row[n:] for row in block[:n]] for block in Y]
    return P, X, [[row[n:] for row in block[n:]] for block in Y]


def _plus(*matrices: Integers) -> Integers:
    if len(matrices) == 1:
        return matrices[0]
    return [list(map(sum, zip(*rows, strict=True))) for rows in zip(*matrices, strict=True)]


def _trace(matrix: Integers) -> int:
    return sum(row[i] for i, row in enumerate(matrix))
