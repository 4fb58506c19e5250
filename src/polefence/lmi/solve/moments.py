r"""Long-run means of piecewise linear motion under white noise, from above, by polynomials.

In a piece x' = A y + E w, y = (x, 1), wherever quadratic forms s of y are not negative. For a
polynomial V that the motion keeps finite on average, and g > 0,

    1 - y'Q y / g - (grad V)'A y - (1/2) tr E'(hess V)E = m'G m + sum s (l'H l),   G, H >= 0,

m and l monomials of x, in every piece: the long-run mean of y'Q y is at most g. What is dual to V,
G and H are the moments y of the times spent in each piece, up to the degree of V: the mean of V's
derivative is zero for every V, and the matrices of y m m' and y s l l' are positive semidefinite.
These are few unknowns, searched for; V then follows by least squares (Lasserre 2001 on moments and
sums of squares). Only even degrees occur where the motion and its mirror image are alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from polefence.base.errors import SolverError
from polefence.base.progress import stage
from polefence.lmi.conditions.pencil import Index
from polefence.lmi.solve import interior_point
from polefence.lmi.solve.interior_point import WIDE, Outcome
from polefence.lmi.solve.stacked import Blocks, Factors
from polefence.plant.system import Array
from polefence.proof.polynomials import Exponent
from polefence.proof.squares import bases, joined, known, moved

if TYPE_CHECKING:
    import scipy.sparse as sp  # imported where used: slow

# Blocks that begin below zero end inside by this share of what they lacked.
WITHIN = 0.05
SLIGHT = 1e-9  # of a block's own moments, what it may lack where they have no rank


@dataclass(frozen=True, eq=False)
class Piece:
    """What is to hold where some forms of x are not negative.

    ``weight`` - y'Q y / g less the mean derivative of each V that ``motions`` names, by its number,
    along x' = A y + E w.
    """

    weight: float
    motions: tuple[tuple[int, Array], ...]
    E: Array
    Q: Array
    forms: tuple[Array, ...]
    at_bounds: bool  # whether x' = A x is stable whatever the others are


@dataclass(frozen=True, eq=False)
class Visits:
    """Points where the motion is in a piece, with shares of the time."""

    points: Array
    shares: Array

    def moments(self, space: Space) -> Array:
        """Return their moments."""
        powers = np.array(space.monomials)
        total = np.zeros(len(powers))
        for start in range(0, len(self.points), 2000):  # many at once take much memory
            part = slice(start, start + 2000)
            values = np.prod(self.points[part, None, :] ** powers, axis=2)
            total += self.shares[part] @ values
        return total


@dataclass(frozen=True, eq=False)
class Space:
    """Even monomials of n variables up to a degree, or all; forms are of these and the constant."""

    n: int
    degree: int
    even: bool = True

    @cached_property
    def monomials(self) -> list[Exponent]:
        """The monomials, one first."""
        return known(self.n, self.degree, self.even)

    @cached_property
    def place(self) -> dict[Exponent, int]:
        """Number of each."""
        return {e: k for k, e in enumerate(self.monomials)}

    def products(self, basis: Sequence[Exponent], form: Array | None = None) -> Array:
        """Return the matrix of the basis times its transpose, times a form, by the moments."""
        size = len(basis)
        matrix = np.zeros((len(self.monomials), size, size))
        terms = [((0,) * self.n, 1.0)] if form is None else self._terms(form)
        for i, e in enumerate(basis):
            for j, f in enumerate(basis[: i + 1]):
                for g, factor in terms:
                    matrix[self.place[joined(joined(e, f), g)], i, j] += factor
        return matrix + np.tril(matrix, -1).swapaxes(1, 2)

    def generator(self, A: Array, E: Array) -> Array:
        """Return the mean derivative of each monomial but one, by the moments, row by row."""
        W = E @ E.T / 2
        rows = np.zeros((len(self.monomials) - 1, len(self.monomials)))
        for row, e in zip(rows, self.monomials[1:], strict=True):
            for i in (i for i in range(self.n) if e[i]):
                less = moved(e, i, -1)
                for k in np.flatnonzero(A[i]):
                    after = less if k == self.n else moved(less, int(k), 1)
                    row[self.place[after]] += e[i] * A[i, k]
                for j in (j for j in range(self.n) if less[j] and W[i, j]):
                    row[self.place[moved(less, j, -1)]] += e[i] * less[j] * W[i, j]
        return rows

    def gaussian(self, mean: Array, X: Array) -> Array:
        """Return the moments of a Gaussian."""
        found: dict[Exponent, float] = {(0,) * self.n: 1.0}
        # in ascending degree: E[x_i p] = mean_i E[p] + sum X_ik E[dp/dx_k]
        for e in sorted(self.monomials[1:], key=sum):
            i = next(i for i in range(self.n) if e[i])
            less = moved(e, i, -1)
            found[e] = sum(
                X[i, k] * less[k] * found[moved(less, k, -1)] for k in range(self.n) if less[k]
            )
            if not self.even:
                found[e] += mean[i] * found[less]
        return np.array([found[e] for e in self.monomials])

    def form(self, Q: Array) -> Array:
        """Return the mean of y'Q y by the moments."""
        row = np.zeros(len(self.monomials))
        for e, value in self._terms(Q):
            row[self.place[e]] += value
        return row

    def _terms(self, Q: Array) -> list[tuple[Exponent, float]]:
        """Return the terms of y'Q y."""
        one = (0,) * self.n
        each = [*(moved(one, i, 1) for i in range(self.n)), one]
        pairs = zip(*np.nonzero(Q), strict=True)
        return [(joined(each[a], each[b]), float(Q[a, b])) for a, b in pairs]


@dataclass(frozen=True, eq=False)
class Block:
    """The derivatives (count, size, size) of a block by the moments of a piece, of D and of M."""

    piece: int
    D: Array
    M: Array


@dataclass(frozen=True, eq=False)
class Conditions:
    """r D(y) - M(y) >= 0 for moments y of all pieces, one after the other, with L y = 0.

    ``row``, where there is one, is a last block of one entry, r row[0]'y - row[1]'y.
    """

    count: int
    blocks: list[Block]
    L: Array
    row: tuple[Array, Array] | None = None

    @cached_property
    def sizes(self) -> dict[int, list[int]]:
        """Numbers of the blocks of each size."""
        sizes: dict[int, list[int]] = {}
        for k, block in enumerate(self.blocks):
            sizes.setdefault(block.M.shape[1], []).append(k)
        return sizes

    @cached_property
    def order(self) -> int:
        """Sum of the blocks' sizes."""
        return sum(len(block.M[0]) for block in self.blocks) + (self.row is not None)

    @cached_property
    def operators(self) -> _Operators:
        """D and M spelt out: nearly all their entries are zero."""
        return _operators(self)

    def span(self, piece: int) -> slice:
        """Where a piece's moments are."""
        return slice(piece * self.count, (piece + 1) * self.count)

    def identity(self) -> Blocks:
        """Return the identity."""
        ones = [np.tile(np.eye(size), (len(numbers), 1, 1)) for size, numbers in self.sizes.items()]
        return ones + [np.ones((1, 1, 1))] * (self.row is not None)

    def parts(self, x: Array) -> tuple[Blocks, Blocks]:
        """Return D(x) and M(x), blocks of a size side by side."""
        D, M = (self._split(flat) for flat in np.split(self.operators.both @ x, 2))
        if self.row is not None:
            for blocks, row in zip((D, M), self.row, strict=True):
                blocks.append(np.reshape(row @ x, (1, 1, 1)))
        return D, M

    def _split(self, flat: Array) -> Blocks:
        """Return blocks from all their entries in one row."""
        blocks, start = list[Array](), 0
        for size, numbers in self.sizes.items():
            end = start + len(numbers) * size**2
            blocks.append(flat[start:end].reshape(-1, size, size))
            start = end
        return blocks

    def separate(self, X: Blocks) -> list[Array]:
        """Return the blocks one by one, in their own order."""
        by_number = dict[int, Array]()
        for numbers, stacked in zip(self.sizes.values(), X, strict=False):
            by_number |= zip(numbers, stacked, strict=True)
        return [by_number[k] for k in range(len(self.blocks))]

    def adjoint(self, r: float, P: Blocks, only_D: bool = False) -> Array:
        """Return the gradient of <P, r D(x) - M(x)> in x; with ``only_D`` that of <P, D(x)>."""
        flat = np.concatenate([stack.ravel() for stack in P[: len(self.sizes)]])
        both = [flat, np.zeros_like(flat)] if only_D else [r * flat, -flat]
        total = np.asarray(self.operators.transpose @ np.concatenate(both))
        if self.row is not None:
            D, M = self.row
            total += float(P[-1][0, 0, 0]) * (D if only_D else r * D - M)
        return total

    def newton(self, r: float, Y: Blocks, Q: Blocks, shift: float) -> _Newton:
        """Return the factors of H on the moments with L y = 0."""
        H = np.zeros((self.L.shape[1] // self.count, self.count, self.count))
        each_F, each_Y, each_Q = self.operators.rows(r), self.separate(Y), self.separate(Q)
        for block, (F, columns), y, q in zip(self.blocks, each_F, each_Y, each_Q, strict=True):
            left = (F @ y).reshape(len(columns), -1)
            right = (F @ q).reshape(len(columns), *q.shape).swapaxes(1, 2)
            H[block.piece][np.ix_(columns, columns)] += left @ right.reshape(len(columns), -1).T
        factors = [Factors.of((square + square.T) / 2, shift) for square in H]
        coupling = [factor.half(self.L[:, self.span(p)].T) for p, factor in enumerate(factors)]
        coupled = Factors.of(np.sum([C.T @ C for C in coupling], axis=0), shift)
        if self.row is None:
            return _Newton(factors, coupling, coupled)
        D, M = self.row
        return _Newton(
            factors, coupling, coupled, r * D - M, float(Y[-1][0, 0, 0] * Q[-1][0, 0, 0])
        )


@dataclass(frozen=True, eq=False)
class _Operators:
    """D and M of conditions spelt out.

    ``both`` - x to all entries of D(x), by size, then of M(x), and its ``transpose``. ``places`` -
    of each block where its derivatives, row under row, are not zero, there those of D and M, and
    the numbers of the moments that it depends on.
    """

    both: sp.csr_array
    transpose: sp.csr_array
    places: list[tuple[sp.csr_array, Array, Array, Index]]

    def rows(self, r: float) -> Iterator[tuple[sp.csr_array, Index]]:
        """Yield each block's derivatives of r D - M, row under row, each until the next."""
        for F, D, M, columns in self.places:
            F.data = r * D - M
            yield F, columns


def _operators(conditions: Conditions) -> _Operators:
    import scipy.sparse as sp

    total = sum(len(numbers) * size**2 for size, numbers in conditions.sizes.items())
    starts, start = dict[int, int](), 0
    for size, numbers in conditions.sizes.items():
        for k in numbers:
            starts[k], start = start, start + size**2
    triples, places = [], []
    for k, block in enumerate(conditions.blocks):
        size, first = block.M.shape[1], conditions.span(block.piece).start
        D, M = (part.reshape(conditions.count, -1) for part in (block.D, block.M))
        moment, entry = np.nonzero((D != 0) | (M != 0))
        D, M = D[moment, entry], M[moment, entry]
        for half, values in enumerate((D, M)):
            triples.append((half * total + starts[k] + entry, first + moment, values))
        row, column = np.divmod(entry, size)
        present, place = np.unique(moment, return_inverse=True)
        where = place * size + row, column  # in ascending order, which the pattern keeps
        pattern = sp.csr_array((np.ones(len(D)), where), shape=(len(present) * size, size))
        places.append((pattern, D, M, present))
    rows, columns, values = (np.concatenate(part) for part in zip(*triples, strict=True))
    both = sp.csr_array((values, (rows, columns)), shape=(2 * total, conditions.L.shape[1]))
    both.eliminate_zeros()
    return _Operators(both, sp.csr_array(both.T), places)


class _Newton:
    """Solves with H and L: the pieces' own, what couples them, and the last block's one row."""

    def __init__(
        self,
        factors: list[Factors],
        coupling: list[Array],
        coupled: Factors,
        row: Array | None = None,
        size: float = 0.0,
    ) -> None:
        self.factors, self.coupling, self.coupled = factors, coupling, coupled
        self.pivot = min(factor.pivot for factor in factors)
        self.row = np.zeros(len(factors) * len(factors[0].scale)) if row is None else row
        self.moved = self._kept(self.row)
        self.share = size / (1 + size * float(self.row @ self.moved))

    def solved(self, a: Array) -> Array:
        """Return x with H x = a but for L'z, and L x = 0."""
        x = self._kept(a)
        return np.asarray(x - self.share * float(self.row @ x) * self.moved)

    def _kept(self, a: Array) -> Array:
        parts = zip(self.factors, np.split(a, len(self.coupling)), strict=True)
        halves = [factors.half(part) for factors, part in parts]
        total = np.zeros(self.coupling[0].shape[1])
        for C, h in zip(self.coupling, halves, strict=True):
            total += C.T @ h
        z = self.coupled.solved(total)
        moved = []
        for factors, C, h in zip(self.factors, self.coupling, halves, strict=True):
            moved.append(factors.scale * (factors.inverse.T @ (h - C @ z)))
        return np.concatenate(moved)


@dataclass(frozen=True, eq=False)
class Mean:
    """What bounds a long-run mean.

    ``level`` is g, ``V`` has the polynomials by all monomials but one, and ``grams`` one list a
    piece: the matrices of its own bases, then of each form's.
    """

    level: float
    V: Array
    grams: list[list[Array]]


class Problem:
    """The moments of pieces."""

    def __init__(
        self, pieces: Sequence[Piece], degree: int, even: bool = True, visits: Sequence[Visits] = ()
    ) -> None:
        self.pieces, n = pieces, len(pieces[0].E)
        self.visits = visits
        self.space = space = Space(n, degree, even)
        self.count = count = len(space.monomials)
        inner, lower = bases(n, degree // 2, even), bases(n, degree // 2 - 1, even)
        self.blocks = list[tuple[int, Array]]()
        own_blocks = [space.products(basis) for basis in inner]
        for p, piece in enumerate(pieces):
            self.blocks += [(p, block) for block in own_blocks]
            for form in piece.forms:
                self.blocks += [(p, space.products(basis, form)) for basis in lower]
        most = 1 + max(i for piece in pieces for i, _ in piece.motions)
        self.generator = np.zeros((most * (count - 1), count * len(pieces)))
        for p, piece in enumerate(pieces):
            for i, A in piece.motions:
                rows = slice(i * (count - 1), (i + 1) * (count - 1))
                self.generator[rows, p * count : (p + 1) * count] += space.generator(A, piece.E)
        self.cost = np.concatenate([space.form(p.Q) for p in pieces])
        self.mass = np.zeros(count * len(pieces))
        self.mass[::count] = [p.weight for p in pieces]

    @stage("moments")
    def solved(self, tolerance: float) -> Mean:
        """Return the least level of this degree.

        Raises
        ------
        SolverError
            If the search fails.
        """
        blocks = [Block(p, 0 * f, -f) for p, f in self.blocks]
        conditions = Conditions(self.count, blocks, self.generator, (self.cost, self.mass))
        x = self.first
        r = WIDE * float(self.mass @ x / (self.cost @ x))
        outcome = _run(conditions, x, r, 0.0, tolerance)
        last = float(outcome.Y[-1][0, 0, 0])
        return self._completed([Y / last for Y in conditions.separate(outcome.Y)])

    @cached_property
    def first(self) -> Array:
        """Moments with which the search begins.

        Raises
        ------
        SolverError
            If none are found.
        """
        one = np.zeros((self.count, 1, 1))
        one[0] = 1.0
        if not self.visits:
            return inside(self.blocks, self._start(), one, self.generator)
        x = np.concatenate([own.moments(self.space) for own in self.visits])
        sizes = [
            np.tensordot(x[self._span(p)] / x[p * self.count], block, 1) for p, block in self.blocks
        ]
        sizes = [M + SLIGHT * np.trace(M) / len(M) * np.eye(len(M)) for M in sizes]
        return inside(self.blocks, self._balanced(x, sizes), one, self.generator, sizes)

    def _span(self, piece: int) -> slice:
        return slice(piece * self.count, (piece + 1) * self.count)

    def _balanced(self, x: Array, sizes: Sequence[Array]) -> Array:
        """Return moments of which V's mean derivative is zero, near some.

        In each block the change is small beside its own moments.
        """
        metric = np.zeros((len(self.pieces), self.count, self.count))
        for (p, block), size in zip(self.blocks, sizes, strict=True):
            root = np.linalg.inv(np.linalg.cholesky(size))
            rows = (root @ block @ root.T).reshape(self.count, -1) / x[p * self.count]
            metric[p] += rows @ rows.T
        parts = [self.generator[:, self._span(p)] for p in range(len(self.pieces))]
        moved = [np.linalg.solve(H, L.T) for H, L in zip(metric, parts, strict=True)]
        total = np.sum([L @ M for L, M in zip(parts, moved, strict=True)], axis=0)
        share = np.linalg.lstsq(total, self.generator @ x, rcond=None)[0]
        return np.asarray(x - np.concatenate([M @ share for M in moved]))

    def _start(self) -> Array:
        """Return moments of one Gaussian in each piece, for a share of the time.

        Raises
        ------
        SolverError
            If no mean of the pieces' motions is stable.
        """
        from scipy.linalg import solve_continuous_lyapunov

        W = np.mean([p.E @ p.E.T for p in self.pieces], axis=0)
        # shares of the time that a Gaussian begins with where forces are as demanded
        for share in 0.5 ** np.arange(40):
            factors = [1.0 if p.at_bounds else float(share) for p in self.pieces]
            pairs = [
                (s, A) for s, p in zip(factors, self.pieces, strict=True) for _, A in p.motions
            ]
            A = np.average([A for _, A in pairs], axis=0, weights=[s for s, _ in pairs])
            A, always = A[:, :-1], A[:, -1]
            if np.linalg.eigvals(A).real.max() < 0:
                X = np.asarray(solve_continuous_lyapunov(A, -W), dtype=np.float64)
                mean = -np.linalg.solve(A, always)
                moments = self.space.gaussian(mean, X)
                return np.concatenate([s * moments for s in factors]) / sum(factors)
        raise SolverError("no mean of the pieces is stable")

    def _completed(self, grams: list[Array]) -> Mean:
        """Return V and 1/g by least squares, with the matrices by pieces.

        Rounding of the search moves the matrices off the equations: first they are moved back, by
        as little as can be in proportion to themselves.
        """
        L = np.vstack([self.cost, self.generator])
        grams = self._refined(grams, L)
        solution, *_ = np.linalg.lstsq(L.T, self._rest(grams), rcond=None)
        by_piece: list[list[Array]] = [[] for _ in self.pieces]
        for (p, _), gram in zip(self.blocks, grams, strict=True):
            by_piece[p].append(gram)
        return Mean(1 / float(solution[0]), solution[1:].reshape(-1, self.count - 1), by_piece)

    def _rest(self, grams: list[Array]) -> Array:
        """Return what 1 - m'G m - ... leaves for V and 1/g, by moments."""
        rest = self.mass.copy()
        for (p, block), gram in zip(self.blocks, grams, strict=True):
            rest[p * self.count : (p + 1) * self.count] -= np.tensordot(block, gram, 2)
        return rest

    def _refined(self, grams: list[Array], L: Array) -> list[Array]:
        """Return G + G^1/2 S G^1/2 for the least S with which there are V and 1/g.

        In a piece S = Q R'^-1 (rest - L'v), Q R the factors of S's equations' transpose; v is that
        of the least sum of squares.
        """
        roots = [np.linalg.cholesky(gram) for gram in grams]
        rest, count = self._rest(grams), self.count
        factors, left, right = list[tuple[Array, Array]](), list[Array](), list[Array]()
        for p in range(len(self.pieces)):
            columns = [
                (root.T @ block @ root).reshape(count, -1)
                for (k, block), root in zip(self.blocks, roots, strict=True)
                if k == p
            ]
            Q, R = np.linalg.qr(np.hstack(columns).T)
            span = slice(p * count, (p + 1) * count)
            both = np.linalg.solve(R.T, np.column_stack([L[:, span].T, rest[span]]))
            factors.append((Q, R))
            left.append(both[:, :-1])
            right.append(both[:, -1])
        v, *_ = np.linalg.lstsq(np.vstack(left), np.concatenate(right), rcond=None)
        S = [Q @ (b - M @ v) for (Q, _), M, b in zip(factors, left, right, strict=True)]
        refined, starts = list[Array](), [0] * len(self.pieces)
        for (p, _), root, gram in zip(self.blocks, roots, grams, strict=True):
            part = S[p][starts[p] : starts[p] + gram.size].reshape(gram.shape)
            starts[p] += gram.size
            moved = root @ (part + part.T) @ root.T / 2
            refined.append(gram + (moved + moved.T) / 2)
        return refined


def inside(
    F: list[tuple[int, Array]], x: Array, mass: Array, L: Array, sizes: Sequence[Array] = ()
) -> Array:
    """Return a point with L x = 0 at which all blocks, linear in it, are positive definite.

    Parameters
    ----------
    F : list of pairs of an int and an array (count, size, size)
        Blocks by the unknowns of one piece, and that piece.
    x : (pieces * count,) array
        With L x = 0, and a positive mass in every piece.
    mass : (count, 1, 1) array
        In proportion to what a block may lack on the way.
    L : (., pieces * count) array
    sizes : sequence of arrays, optional
        What a block may lack is so much of its own; of the identity by default.

    Raises
    ------
    SolverError
        If none is found.
    """
    count, lacking = len(mass), 0.0
    own = list(sizes) or [np.eye(f.shape[1]) for _, f in F]
    for (p, f), size in zip(F, own, strict=True):
        moments = x[p * count : (p + 1) * count]
        least = _least(np.tensordot(moments, f, 1), size)
        lacking = max(lacking, -least / float(moments @ mass[:, 0, 0]))
    if lacking <= 0:
        return x
    shift = WITHIN * lacking
    D = [mass * size for size in own]
    blocks = [Block(p, d, shift * d - f) for d, (p, f) in zip(D, F, strict=True)]
    start = (1 + WITHIN) * lacking + shift
    outcome = _run(Conditions(count, blocks, L), x, start, shift, 1e-6)  # any point inside will do
    if outcome.r >= shift:
        raise SolverError("no point was found inside")
    return outcome.x


def _least(matrix: Array, size: Array) -> float:
    """Return the least eigenvalue relative to another matrix, which is positive definite."""
    root = np.linalg.inv(np.linalg.cholesky(size))
    return float(np.linalg.eigvalsh(root @ matrix @ root.T)[0])


def _run(conditions: Conditions, x: Array, r: float, enough: float, tolerance: float) -> Outcome:
    try:
        return interior_point.run(conditions, x, r, enough, tolerance)
    except np.linalg.LinAlgError as error:
        raise SolverError("the search has no start") from error
