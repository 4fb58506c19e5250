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

`prove_infeasible` decides these with integers and trusts nothing. `repaired` makes an approximate
Y of a floating-point solver satisfy them: X solves the equations of Z in a few well chosen
entries, and the P of one block for each k takes up the equation of W_k. Where r is a little below
the radius of Y, that P only grows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations, permutations
from operator import mul
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.proof.exact import (
    MAX_WORK,
    METHODS,
    FormatError,
    Integers,
    Rationals,
    Verdict,
    _denominator,
    _integers,
    is_positive_definite,
)

Floats = npt.NDArray[np.float64]
Pairs = list[tuple[int, int]]

SHORTFALLS = tuple(10.0**k for k in range(-9, -1))  # of the radius, in units of the upper bound
BITS = 60  # kept of an entry of Y, relative to its diagonal entries
INDEPENDENT = 1e-10  # least part of a unit vector outside the span of others


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
    fault = _malformed(claim)
    if fault:
        return Verdict(False, fault)
    try:
        plant = _Plant.of(claim.A, claim.B, claim.sigma)
        own = [_denominator([Y]) for Y in claim.Y]
    except FormatError as error:
        return Verdict(False, str(error))
    blocks = [_integers(Y, d) for Y, d in zip(claim.Y, own, strict=True)]
    nonzero = 0
    for b, block in enumerate(blocks):
        if any(block[i][j] != block[j][i] for i in range(len(block)) for j in range(i)):
            return Verdict(False, f"dual matrix {b + 1} is not symmetric")
        if any(map(any, block)):
            if not is_positive_definite(block):
                return Verdict(False, f"dual matrix {b + 1} is not positive definite")
            nonzero += 1
    if not nonzero:
        return Verdict(False, "all dual matrices are zero")
    common = math.lcm(*own)
    scaled = [_times(common // d, block) for d, block in zip(own, blocks, strict=True)]
    fault = _unbalanced(claim, plant, scaled)
    if fault:
        return Verdict(False, fault)
    return Verdict(True, f"{nonzero} dual matrices positive definite and balanced exactly")


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
    if count * (2 * n) ** 3 > MAX_WORK:
        return f"{count} dual matrices of this size are more than is checked here"
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
    for k, (V, residual) in _products(plant, pairs, X).items():
        if any(map(any, residual)):
            return f"the equation of Z or L, number {k + 1}, does not hold"
        right = _plus(V, V if claim.method == "slack" else _transposed(V))
        if _times(top, weights[k]) != _times(bottom, right):
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
        common = _denominator([*A, *B, [[sigma]]])
        S = [_integers(a, common) for a in A]
        for s in S:
            for i, row in enumerate(s):
                row[i] += int(sigma * common)
        return cls(S, [_integers(b, common) for b in B], common, len(A[0]))

    @cached_property
    def columns(self) -> list[list[int]]:
        """Columns of [S, B] with the vertices' rows one below the other."""
        rows = [
            s + b for S, B in zip(self.A, self.B, strict=True) for s, b in zip(S, B, strict=True)
        ]
        return _transposed(rows)


def _products(
    plant: _Plant, pairs: list[Pairs], X: list[Integers]
) -> dict[int, tuple[Integers, Integers]]:
    """Return for every k the sums of S_j' X_b and B_j' X_b over the pairs (j, k) of all blocks."""
    n, at = plant.n, dict[tuple[int, int], list[Integers]]()
    for block, x in zip(pairs, X, strict=True):
        for pair in block:
            at.setdefault(pair, []).append(x)
    none = [[0] * n] * n
    products = {}
    for k in range(1 + max(k for _, k in at)):
        rows = [row for j in range(len(plant.A)) for row in _plus(*at.get((j, k), [none]))]
        right = _transposed(rows)
        both = [[sum(map(mul, column, x)) for x in right] for column in plant.columns]
        products[k] = both[:n], both[n:]
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


def _times(factor: int, matrix: Integers) -> Integers:
    return [[factor * entry for entry in row] for row in matrix]


def _transposed(matrix: Integers) -> Integers:
    return [list(column) for column in zip(*matrix, strict=True)]


def _trace(matrix: Integers) -> int:
    return sum(row[i] for i, row in enumerate(matrix))


# --- from an approximate Y to an exact one; nothing below is trusted above -----------------------


def lower_bound(
    method: str,
    A: list[Rationals],
    B: list[Rationals],
    sigma: Fraction,
    upper: float,
    Y: Iterable[npt.ArrayLike],
    right_hand_sides: bool = False,
) -> Infeasible | None:
    """Return the proof of a radius closely below ``upper`` that the method cannot reach.

    Parameters
    ----------
    A, B, sigma
        The vertices and the centre -sigma, exactly.
    upper : float
        A radius just above the infimum, at which Y solves the dual problem approximately.
    Y : matrices
        2n x 2n, in the original coordinates, in the order of `block_pairs`.

    Returns
    -------
    Infeasible or None
        A claim that `prove_infeasible` has proved, or None where no attempt succeeds.
    """
    repair = _Repair.of(method, A, B, sigma, Y, right_hand_sides)
    for shortfall in SHORTFALLS if repair else ():
        r = Fraction(upper * (1 - shortfall))
        if repair and r > 0 and repair.plausible(r):
            claim = repair.claim(r)
            if prove_infeasible(claim).proved:
                return claim
    return None


def repaired(
    method: str,
    A: list[Rationals],
    B: list[Rationals],
    sigma: Fraction,
    r: Fraction,
    Y: Iterable[npt.ArrayLike],
    right_hand_sides: bool = False,
) -> Infeasible | None:
    """Return the proof that the method cannot reach ``r``, as `lower_bound` does, or None."""
    repair = _Repair.of(method, A, B, sigma, Y, right_hand_sides)
    claim = repair.claim(r) if repair and r > 0 else None
    return claim if claim and prove_infeasible(claim).proved else None


@dataclass(frozen=True)
class _Repair:
    """What every radius shares: integers Y over ``scale``, balanced but for one P for each k.

    That P is constant[k] + slope[k] / r over ``scale * share``, in block anchors[k]; for the slack
    condition it is both diagonal parts.
    """

    start: Infeasible
    Y: list[Integers]
    scale: int
    anchors: list[int]
    constant: list[Integers]
    slope: list[Integers]
    share: int

    @classmethod
    def of(
        cls,
        method: str,
        A: list[Rationals],
        B: list[Rationals],
        sigma: Fraction,
        Y: Iterable[npt.ArrayLike],
        right_hand_sides: bool,
    ) -> _Repair | None:
        dual = np.asarray(list(Y), dtype=float)
        start = Infeasible(method, A, B, sigma, Fraction(1), [], right_hand_sides)
        n, N = len(A[0]), len(A)
        if dual.shape != (_count(method, N), 2 * n, 2 * n) or not _usable(dual):
            return None
        if method == "slack":
            dual[:, :n, :n] = dual[:, n:, n:] = (dual[:, :n, :n] + dual[:, n:, n:]) / 2
        plant, pairs = _Plant.of(A, B, sigma), block_pairs(method, N)
        blocks = _rounded(dual)
        changes = _changes(method, plant, pairs, blocks, np.sqrt(np.einsum("bii->bi", dual)))
        if changes is None:
            return None
        positions, values, scale = changes
        blocks = [_times(scale, block) for block in blocks]
        for (b, i, where), row in zip(positions, values, strict=True):
            for c, value in zip(range(n)[where], row, strict=True):
                blocks[b][i][n + c] += value
                blocks[b][n + c][i] += value
        first = positions[0][0] if positions else 0
        anchors = {"quadratic": [first], "slack": [first], "scheduled": list(range(N))}[method]
        return cls(start, blocks, scale, anchors, *_loads(method, plant, pairs, blocks, anchors))

    def at(self, r: Fraction) -> Iterable[tuple[int, Integers, int]]:
        """Yield each anchor's block at this radius, as integers over a denominator."""
        n = len(self.start.A[0])
        for b, C, E in zip(self.anchors, self.constant, self.slope, strict=True):
            factor = self.share * r.numerator
            block = _times(factor, self.Y[b])
            P = _plus(_times(r.numerator, C), _times(r.denominator, E))
            for i in range(n):
                block[i][:n] = P[i]
                if self.start.method == "slack":
                    block[n + i][n:] = P[i]
            yield b, block, self.scale * factor

    @cached_property
    def fixed(self) -> tuple[list[Rationals], Floats]:
        """All blocks as rationals, and in floats."""
        exact = [_over(block, self.scale) for block in self.Y]
        return exact, np.array([[[float(e) for e in row] for row in block] for block in exact])

    def claim(self, r: Fraction) -> Infeasible:
        Y = list(self.fixed[0])
        for b, block, denominator in self.at(r):
            Y[b] = _over(block, denominator)
        return Infeasible(**{**vars(self.start), "r": r, "Y": Y})

    def plausible(self, r: Fraction) -> bool:
        """Whether all blocks are positive definite in floats: cheap, and mostly right."""
        Y = self.fixed[1].copy()
        for b, block, denominator in self.at(r):
            Y[b] = [[e / denominator for e in row] for row in block]
        diagonal = np.einsum("bii->bi", Y)
        if not (diagonal > 0).all():
            return False
        unit = 1 / np.sqrt(diagonal)
        try:
            np.linalg.cholesky(Y * unit[:, :, None] * unit[:, None, :])
        except np.linalg.LinAlgError:
            return False
        n, N = len(self.start.A[0]), len(self.start.A)
        traces = list(np.einsum("bii->b", Y[:, :n, :n]))
        return not self.start.right_hand_sides or _bracket(N, traces) >= 0


def _usable(dual: Floats) -> bool:
    return bool(np.isfinite(dual).all() and (np.einsum("bii->bi", dual) > 0).all())


def _over(block: Integers, denominator: int) -> Rationals:
    """Divide a symmetric matrix; each pair of entries is made once."""
    rows: Rationals = []
    for i, row in enumerate(block):
        rows.append([rows[j][i] for j in range(i)] + [Fraction(e, denominator) for e in row[i:]])
    return rows


def _rounded(dual: Floats) -> list[Integers]:
    """Return symmetric integers close to the matrices, times a power of two.

    States in units far apart make entries of very different magnitudes: each is rounded in
    proportion to its two diagonal entries.
    """
    half = np.floor(np.log2(np.einsum("bii->bi", dual)) / 2).astype(int)
    exponents = half[:, :, None] + half[:, None, :] - BITS
    least = int(exponents.min())
    symmetric = (dual + dual.swapaxes(1, 2)) / 2
    return [
        [[int(v) << (e - least) for v, e in zip(*rows, strict=True)] for rows in zip(*both, strict=True)]
        for both in zip(
            np.rint(np.ldexp(symmetric, -exponents)).tolist(), exponents.tolist(), strict=True
        )
    ]


def _loads(
    method: str, plant: _Plant, pairs: list[Pairs], Y: list[Integers], anchors: list[int]
) -> tuple[list[Integers], list[Integers], int]:
    """Return P's constant and slope in 1/r that satisfy the equation of W or G for each k."""
    P, X, R = _parts(Y, plant.n)
    share = 2 if method == "slack" else 1  # P and R change there
    weights = _weights(pairs, [_plus(p, r) for p, r in zip(P, R, strict=True)])
    constant, slope = [], []
    for k, (V, _) in _products(plant, pairs, X).items():
        rest = _plus(_times(share, P[anchors[k]]), _times(-1, weights[k]))
        constant.append(_times(plant.denominator, rest))
        slope.append(_plus(V, _transposed(V)))
    return constant, slope, share * plant.denominator


# --- the equations of Z, L, and of the skew part of G --------------------------------------------

Position = tuple[int, int, slice]  # block, row and columns of X
Column = dict[int, int]  # coefficients of one unknown by equation


def _changes(
    method: str, plant: _Plant, pairs: list[Pairs], Y: list[Integers], size: Floats
) -> tuple[list[Position], list[list[int]], int] | None:
    """Return changes of a few entries of X, over a denominator, that solve the equations.

    ``size`` holds the roots of the diagonals: X's entries are judged relative to these.
    """
    n = plant.n
    products = _products(plant, pairs, _parts(Y, n)[1])
    if method == "slack":
        V, residual = products[0]
        skew = [V[a][c] - V[c][a] for c in range(n) for a in range(c)]
        right = [[-e] for row in residual for e in row] + [[-e] for e in skew]
        unknowns = _entries(plant)
    else:
        right = [[-e for e in row] for k in products for row in products[k][1]]
        unknowns = _rows(plant, pairs)
    C = np.zeros((len(right), len(unknowns)))
    largest = size[:, n:].max(axis=0)
    for u, ((b, i, where), column) in enumerate(unknowns):
        weight = size[b, i] * (size[b, n:] / largest)[where].mean()
        weight *= largest[where].max() if method == "slack" else 1.0
        for equation, value in column.items():
            C[equation, u] = weight * value / plant.denominator
        if method == "scheduled" and b >= len(plant.A):
            C[:, u] *= 1e-3  # the blocks (15) hold an equation of one k only
    C /= np.maximum(np.abs(C).max(axis=1), np.finfo(float).tiny)[:, None]
    chosen = _independent(C)
    equations = sorted(_independent(C[:, chosen].T))
    matrix = [[unknowns[u][1].get(e, 0) for u in chosen] + right[e] for e in equations]
    solved = _solved(matrix)
    return solved and ([unknowns[u][0] for u in chosen], *solved)


def _rows(plant: _Plant, pairs: list[Pairs]) -> list[tuple[Position, Column]]:
    """Rows of X_b in the equations of Z_k, for all columns alike."""
    n, m = plant.n, len(plant.B[0][0])
    unknowns = []
    for b, block in enumerate(pairs):
        for i in range(n):
            column: Column = {}
            for j, k in block:
                for q, value in enumerate(plant.B[j][i]):
                    column[k * m + q] = column.get(k * m + q, 0) + value
            unknowns.append(((b, i, slice(0, n)), column))
    return unknowns


def _entries(plant: _Plant) -> list[tuple[Position, Column]]:
    """Entries of X_j in the equations of L and in the skew part of that of G."""
    n, m = plant.n, len(plant.B[0][0])
    unknowns = []
    for j, (S, B) in enumerate(zip(plant.A, plant.B, strict=True)):
        for i in range(n):
            for c in range(n):
                column = {q * n + c: value for q, value in enumerate(B[i])}
                for a in range(n):
                    low, high = sorted((a, c))
                    if low < high:
                        pair = m * n + high * (high - 1) // 2 + low
                        column[pair] = S[i][a] if a < c else -S[i][a]
                unknowns.append(((j, i, slice(c, c + 1)), column))
    return unknowns


def _independent(C: Floats) -> list[int]:
    """Choose columns that span the others, the largest remainder first."""
    rest, chosen = C.copy(), list[int]()
    for _ in range(min(C.shape)):
        norms = np.linalg.norm(rest, axis=0)
        best = int(norms.argmax())
        if not norms[best] > INDEPENDENT:
            break
        q = rest[:, best] / norms[best]
        rest -= np.outer(q, q @ rest)
        rest[:, best] = 0.0
        chosen.append(best)
    return chosen


def _solved(table: list[list[int]]) -> tuple[list[list[int]], int] | None:
    """Solve [C | right] by fraction-free elimination: numerators and their denominator > 0."""
    table, previous, size = [row[:] for row in table], 1, len(table)
    for p in range(size):
        pivot = next((i for i in range(p, size) if table[i][p]), None)
        if pivot is None:
            return None
        table[p], table[pivot] = table[pivot], table[p]
        first = table[p]
        head = first[p]
        table = [
            row
            if i == p
            else [(head * e - row[p] * f) // previous for e, f in zip(row, first, strict=True)]
            for i, row in enumerate(table)
        ]
        previous = head
    sign = -1 if previous < 0 else 1
    return [[sign * e for e in row[size:]] for row in table], abs(previous)
