"""Dual matrices of a floating-point solver made exactly feasible: lower bounds on an infimum.

Small changes of X solve the equations of Z, L and the skew part of G's, as `polefence.proof.lower`
has them, and P and R of a few blocks take up those of W. Where r is a little below the
radius that Y belongs to these only grow, which pays for all the changes. Nothing here is trusted:
`prove_infeasible` decides.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
import numpy.typing as npt

from polefence.certify.candidates import first
from polefence.proof.lower import (
    Infeasible,
    Pairs,
    _bracket,
    _parts,
    _Plant,
    _plus,
    _products,
    _weights,
    block_pairs,
    prove_infeasible,
)
from polefence.proof.matrices import Integers, Rationals, times, transposed
from polefence.proof.work import FormatError

Floats = npt.NDArray[np.float64]

SHORTFALLS = (1e-9, 1e-8, 1e-7, 3e-7, 1e-6, 2e-6, 4e-6, 8e-6, 2e-5, 5e-5, 1e-4, 1e-3, 1e-2)
IDLE = (0.0, 1e-6, 1e-4, 1e-2)  # shares of the dual weight below which a vertex may be left out
INDEPENDENT = 1e-10  # least part of a unit vector outside the span of others


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
    n, m = len(A[0]), len(B[0][0])
    if method == "slack" and m * n + n * (n - 1) // 2 > 40:  # more exact equations take seconds
        return None
    start = Infeasible(method, A, B, sigma, Fraction(1), [], right_hand_sides)
    radii = [Fraction(upper * (1 - shortfall)) for shortfall in SHORTFALLS]
    # what is plausible at a radius is at smaller ones
    begun = [
        (repair, bisect_left(radii, True, key=repair.plausible)) for repair in _repairs(start, Y)
    ]
    pairs = ((repair, r) for k, r in enumerate(radii) for repair, begin in begun if k >= begin)
    return first(repair.proved(r) for repair, r in pairs if r > 0)


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
    start = Infeasible(method, A, B, sigma, r, [], right_hand_sides)
    return first(repair.proved(r) for repair in _repairs(start, Y)) if r > 0 else None


def _repairs(start: Infeasible, Y: Iterable[npt.ArrayLike]) -> Iterator[_Repair]:
    """Yield repairs of Y, with all its blocks and without those that touch idle vertices.

    A vertex without part in the optimum has dual matrices as small as the solver's errors; they
    cannot be repaired, but zeros in their place need no repair.
    """
    dual = np.array([np.asarray(y, dtype=float) for y in Y])
    n, N = len(start.A[0]), len(start.A)
    pairs = block_pairs(start.method, N)
    if dual.shape != (len(pairs), 2 * n, 2 * n) or not np.isfinite(dual).all():
        return
    diagonal = np.einsum("bii->bi", dual)
    if not (diagonal > 0).all():
        return
    dual = (dual + dual.swapaxes(1, 2)) / (2 * diagonal.max())
    part = np.zeros((1 + max(k for block in pairs for _, k in block), 2 * n))
    for block, d in zip(pairs, diagonal, strict=True):
        for _, k in block:
            part[k] += d
    share = (part / part.max(axis=0)).max(axis=1)
    tried: list[set[int]] = []
    for least in IDLE:
        idle = set(np.flatnonzero(share < least).tolist())
        if idle not in tried:
            tried.append(idle)
            kept = np.array([not any(k in idle for _, k in block) for block in pairs])
            repair = _Repair.of(start, pairs, dual * kept[:, None, None])
            if repair:
                yield repair


@dataclass(frozen=True)
class _Repair:
    """Data that all radii share: integers Y over ``scale``, balanced but for the equations of W, G.

    Both diagonal parts of each block of one group of ``anchors`` take these up, in equal shares of
    constant[k] + slope[k] / r, over ``scale`` and the plant's ``denominator``.
    """

    start: Infeasible
    Y: list[Integers]
    scale: int
    anchors: list[list[int]]
    constant: list[Integers]
    slope: list[Integers]
    denominator: int

    @classmethod
    def of(cls, start: Infeasible, pairs: list[Pairs], dual: Floats) -> _Repair | None:
        n, N = len(start.A[0]), len(start.A)
        if start.method == "slack":
            dual = dual.copy()
            dual[:, :n, :n] = dual[:, n:, n:] = (dual[:, :n, :n] + dual[:, n:, n:]) / 2
        try:
            plant = _Plant.of(start.A, start.B, start.sigma)
            system = _System.of(start.method, plant, pairs, dual)
            solved = system.exactly(_rounded(system.approximately(dual))[0])
        except (np.linalg.LinAlgError, FormatError, OverflowError):
            return None
        if solved is None:
            return None
        Y, scale = solved
        P, X, R = _parts(Y, n)
        weights = _weights(pairs, [_plus(p, r) for p, r in zip(P, R, strict=True)])
        V = [V for V, _ in _products(plant, pairs, X)]
        several = start.method == "scheduled"
        return cls(
            start,
            Y,
            scale,
            [[j] for j in range(N) if any(map(any, Y[j]))] if several else [list(range(N))],
            [times(-plant.denominator, w) for w in weights],
            [_plus(v, transposed(v)) for v in V],
            plant.denominator,
        )

    def at(self, r: Fraction) -> Iterator[tuple[int, Integers, int]]:
        """Yield each anchor's block at this radius, as integers over a denominator."""
        n = len(self.start.A[0])
        for anchors in self.anchors:
            k = anchors[0] if self.start.method == "scheduled" else 0
            excess = _plus(
                times(r.numerator, self.constant[k]), times(r.denominator, self.slope[k])
            )
            factor = 2 * len(anchors) * self.denominator * r.numerator
            for b in anchors:
                block = times(factor, self.Y[b])
                for i, row in enumerate(excess):
                    for c, value in enumerate(row):
                        block[i][c] += value
                        block[n + i][n + c] += value
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
        return replace(self.start, r=r, Y=Y)

    def proved(self, r: Fraction) -> Infeasible | None:
        """Return the claim at this radius where it is proved."""
        claim = self.claim(r)
        return claim if prove_infeasible(claim).proved else None

    def plausible(self, r: Fraction) -> bool:
        """Whether all blocks are positive definite in floats: cheap, and mostly right."""
        Y = self.fixed[1].copy()
        for b, block, denominator in self.at(r):
            Y[b] = [[e / denominator for e in row] for row in block]
        n, N = len(self.start.A[0]), len(self.start.A)
        traces = np.einsum("bii->b", Y[:, :n, :n]).tolist()
        if self.start.right_hand_sides and _bracket(N, traces) < 0:
            return False
        Y = Y[Y.any(axis=(1, 2))]
        diagonal = np.einsum("bii->bi", Y)
        if not (diagonal > 0).all():
            return False
        unit = 1 / np.sqrt(diagonal)
        try:
            np.linalg.cholesky(Y * unit[:, :, None] * unit[:, None, :])
        except np.linalg.LinAlgError:
            return False
        return True


def _over(block: Integers, denominator: int) -> Rationals:
    """Divide a symmetric matrix; each pair of entries is made once."""
    rows: Rationals = []
    for i, row in enumerate(block):
        rows.append([rows[j][i] for j in range(i)] + [Fraction(e, denominator) for e in row[i:]])
    return rows


def _rounded(dual: Floats) -> tuple[list[Integers], int]:
    """Return symmetric integers close to the matrices times a power of two, and its logarithm.

    States in units far apart make entries of very different magnitudes: each is rounded in
    proportion to its two diagonal entries.
    """
    diagonal = np.einsum("bii->bi", dual)
    half = np.floor(np.log2(np.where(diagonal > 0, diagonal, 1.0)) / 2).astype(int)
    exponents = half[:, :, None] + half[:, None, :] - 60
    least = int(exponents.min())
    mantissas = np.rint(np.ldexp(dual, -exponents)).tolist()
    shifts = (exponents - least).tolist()
    integers = [
        [[int(v) << e for v, e in zip(*rows, strict=True)] for rows in zip(*both, strict=True)]
        for both in zip(mantissas, shifts, strict=True)
    ]
    return integers, -least


# --- the equations of Z, L, and of the skew part of G --------------------------------------------

Position = tuple[int, int, slice]  # block, row and columns of X
Column = dict[int, int]  # coefficients of one unknown by equation


@dataclass(frozen=True)
class _System:
    """Linear equations in changes of X: of its rows, or for the slack condition of its entries.

    ``metric`` holds for each block a factor L: changes L z with small z are small relative to
    what the block gains where the radius is smaller.
    """

    method: str
    plant: _Plant
    pairs: list[Pairs]
    unknowns: list[tuple[Position, Column]]
    C: Floats
    metric: Floats

    @classmethod
    def of(cls, method: str, plant: _Plant, pairs: list[Pairs], dual: Floats) -> _System:
        """Raise numpy.linalg.LinAlgError where Y is too close to singular."""
        n, m = plant.n, len(plant.B[0][0])
        unknowns = _entries(plant) if method == "slack" else _rows(plant, pairs)
        vertices = 1 + max(k for block in pairs for _, k in block)
        C = np.zeros(
            (m * n + n * (n - 1) // 2 if method == "slack" else vertices * m, len(unknowns))
        )
        for u, (_, column) in enumerate(unknowns):
            for equation, value in column.items():
                C[equation, u] = value / plant.denominator
        sums = dual[:, :n, :n] + dual[:, n:, n:]
        weight = np.array(
            [
                sum(s for s, block in zip(sums, pairs, strict=True) for _, j in block if j == k)
                for k in range(vertices)
            ]
        )
        return cls(method, plant, pairs, unknowns, C, _metric(method, pairs, dual, weight))

    def right(self, Y: list[Integers]) -> list[list[int]]:
        """Right-hand sides at Y, times the plant's denominator."""
        n = self.plant.n
        products = _products(self.plant, self.pairs, _parts(Y, n)[1])
        if self.method != "slack":
            return [[-e for e in row] for _, residual in products for row in residual]
        V, residual = products[0]
        skew = [V[a][c] - V[c][a] for c in range(n) for a in range(c)]
        return [[-e] for row in residual for e in row] + [[-e] for e in skew]

    def approximately(self, dual: Floats) -> Floats:
        """Solve by the smallest change in the metric, in floats."""
        n, count = self.plant.n, len(self.pairs)
        Y, exponent = _rounded(dual)
        unit = self.plant.denominator << exponent
        right = np.array([[e / unit for e in row] for row in self.right(Y)])
        C = self.C.reshape(len(self.C), count, -1)
        weighted = np.einsum("ebu,buv->ebv", C, self.metric).reshape(self.C.shape)
        size = np.maximum(np.abs(weighted).max(axis=1), np.finfo(float).tiny)[:, None]
        z = np.linalg.lstsq(weighted / size, right / size, rcond=INDEPENDENT)[0]
        change = (self.metric @ z.reshape(count, self.metric.shape[1], -1)).reshape(count, n, n)
        dual = dual.copy()
        dual[:, :n, n:] += change
        dual[:, n:, :n] += change.swapaxes(1, 2)
        return dual

    def exactly(self, Y: list[Integers]) -> tuple[list[Integers], int] | None:
        """Solve in as few unknowns as there are equations; return Y over a denominator."""
        n = self.plant.n
        C = self.C * np.linalg.norm(self.metric, axis=2).ravel()
        C /= np.maximum(np.abs(C).max(axis=1), np.finfo(float).tiny)[:, None]
        chosen = _independent(C)
        equations = sorted(_independent(C[:, chosen].T))
        right = self.right(Y)
        table = [[self.unknowns[u][1].get(e, 0) for u in chosen] + right[e] for e in equations]
        solved = _solved(table)
        if solved is None:
            return None
        values, scale = solved
        Y = [times(scale, block) for block in Y]
        for u, row in zip(chosen, values, strict=True):
            b, i, where = self.unknowns[u][0]
            for c, value in zip(range(n)[where], row, strict=True):
                Y[b][i][n + c] += value
                Y[b][n + c][i] += value
        return Y, scale


def _metric(method: str, pairs: list[Pairs], dual: Floats, weight: Floats) -> Floats:
    factors = []
    for block, y in zip(pairs, dual, strict=True):
        L = np.zeros_like(weight[0])
        if y.any():
            W = sum(weight[k] for k in {k for _, k in block})
            unit = np.sqrt(np.diag(W))
            L = unit[:, None] * np.linalg.cholesky(
                W / np.outer(unit, unit) + 1e-13 * np.eye(len(W))
            )
        # only blocks of one pair gain at a smaller radius
        L = np.kron(L, L) if method == "slack" else L * (1.0 if len(block) == 1 else 1e-7)
        factors.append(L)
    return np.array(factors)


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
