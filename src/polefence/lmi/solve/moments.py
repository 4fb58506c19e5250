r"""Long-run means of piecewise linear motion under white noise, from above, by polynomials.

In a piece x' = A x + E w, wherever quadratic forms s of x are not negative. For a polynomial V that
the motion keeps finite on average, and g > 0,

    1 - x'Q x / g - (grad V)'A x - (1/2) tr E'(hess V)E = m'G m + sum s (l'H l),   G, H >= 0,

m and l monomials of x, in every piece: the long-run mean of x'Q x is at most g. What is dual to V,
G and H are the moments y of the times spent in each piece, up to the degree of V: the mean of V's
derivative is zero for every V, and the matrices of y m m' and y s l l' are positive semidefinite.
These are few unknowns, searched for; V then follows by least squares (Lasserre 2001 on moments and
sums of squares). Only even degrees occur: the motion and its mirror image are alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from polefence.base.errors import SolverError
from polefence.base.progress import stage
from polefence.lmi.solve import interior_point
from polefence.lmi.solve.interior_point import Outcome
from polefence.lmi.solve.stacked import Blocks
from polefence.plant.system import Array
from polefence.proof.polynomials import Exponent
from polefence.proof.squares import bases, joined, monomials

# Blocks that begin below zero end inside by this share of what they lacked.
WITHIN = 0.05
WIDE = 1.3  # the first r over the least of the first moments
RANK = 1e-10  # of the largest singular value, what is taken for zero
COARSE = 1e-6  # tolerance where no more than a point inside is wanted


@dataclass(frozen=True, eq=False)
class Piece:
    """x' = A x + E w with cost x'Q x, where x's forms are not negative.

    ``share`` is how much of the time the search begins with here, of all pieces one.
    """

    A: Array
    E: Array
    Q: Array
    forms: tuple[Array, ...]
    share: float


@dataclass(frozen=True, eq=False)
class Space:
    """Even monomials of n variables up to a degree; bases whose products they are."""

    n: int
    degree: int

    @cached_property
    def monomials(self) -> list[Exponent]:
        """The monomials, one first."""
        return monomials(self.n, self.degree, 0)

    @cached_property
    def place(self) -> dict[Exponent, int]:
        """Number of each."""
        return {e: k for k, e in enumerate(self.monomials)}

    def products(self, basis: Sequence[Exponent], form: Array | None = None) -> Array:
        """Return the matrix of the basis times its transpose, times a form, by the moments."""
        size = len(basis)
        found = np.zeros((len(self.monomials), size, size))
        terms = [((0,) * self.n, 1.0)] if form is None else self._terms(form)
        for i, e in enumerate(basis):
            for j, f in enumerate(basis[: i + 1]):
                for own, factor in terms:
                    found[self.place[joined(joined(e, f), own)], i, j] += factor
        return found + np.tril(found, -1).swapaxes(1, 2)

    def generator(self, A: Array, E: Array) -> Array:
        """Return the mean derivative of each monomial but one, by the moments, row by row."""
        W = E @ E.T / 2
        rows = np.zeros((len(self.monomials) - 1, len(self.monomials)))
        for row, e in zip(rows, self.monomials[1:], strict=True):
            for i in (i for i in range(self.n) if e[i]):
                less = _less(e, i)
                for k in np.flatnonzero(A[i]):
                    row[self.place[_more(less, int(k))]] += e[i] * A[i, k]
                for j in (j for j in range(self.n) if less[j] and W[i, j]):
                    row[self.place[_less(less, j)]] += e[i] * less[j] * W[i, j]
        return rows

    def gaussian(self, X: Array) -> Array:
        """Return the moments of a Gaussian of zero mean."""
        known: dict[Exponent, float] = {(0,) * self.n: 1.0}
        for e in self.monomials[1:]:  # in ascending degree: E[x_i p] = sum X_ik E[dp/dx_k]
            i = next(i for i in range(self.n) if e[i])
            less = _less(e, i)
            known[e] = sum(
                X[i, k] * less[k] * known[_less(less, k)] for k in range(self.n) if less[k]
            )
        return np.array([known[e] for e in self.monomials])

    def form(self, Q: Array) -> Array:
        """Return the mean of x'Q x by the moments."""
        row = np.zeros(len(self.monomials))
        for e, value in self._terms(Q):
            row[self.place[e]] += value
        return row

    def _terms(self, Q: Array) -> list[tuple[Exponent, float]]:
        """Return the terms of x'Q x."""
        one, pairs = (0,) * self.n, zip(*np.nonzero(Q), strict=True)
        return [(_more(_more(one, int(a)), int(b)), float(Q[a, b])) for a, b in pairs]


def _less(e: Exponent, i: int) -> Exponent:
    return (*e[:i], e[i] - 1, *e[i + 1 :])


def _more(e: Exponent, i: int) -> Exponent:
    return (*e[:i], e[i] + 1, *e[i + 1 :])


@dataclass(frozen=True, eq=False)
class Spelt:
    """r D(x) - M(x) >= 0 with the derivatives of each block by all unknowns, as `Stacked` is used.

    ``D`` and ``M`` have arrays (unknowns, size, size), one a block.
    """

    D: list[Array]
    M: list[Array]

    @cached_property
    def order(self) -> int:
        """Sum of the blocks' sizes."""
        return sum(M.shape[1] for M in self.M)

    def identity(self) -> Blocks:
        """Return the identity."""
        return [np.eye(M.shape[1])[None] for M in self.M]

    def parts(self, x: Array) -> tuple[Blocks, Blocks]:
        """Return D(x) and M(x)."""
        D, M = ([np.tensordot(x, own, 1)[None] for own in each] for each in (self.D, self.M))
        return D, M

    def adjoint(self, r: float, P: Blocks, only_D: bool = False) -> Array:
        """Return the gradient of <P, r D(x) - M(x)> in x; with ``only_D`` that of <P, D(x)>."""
        total = np.zeros(len(self.M[0]))
        for D, M, own in zip(self.D, self.M, P, strict=True):
            F = D if only_D else r * D - M
            total += np.tensordot(F, own[0], 2)
        return total

    def hessian(self, r: float, Y: Blocks, Q: Blocks) -> Array:
        """Return H_ij = sum of tr(F_i Y F_j Q) over blocks."""
        count = len(self.M[0])
        H = np.zeros((count, count))
        for D, M, y, q in zip(self.D, self.M, Y, Q, strict=True):
            F = r * D - M
            left, right = (F @ y[0]).reshape(count, -1), (F @ q[0]).swapaxes(1, 2)
            H += left @ right.reshape(count, -1).T
        return (H + H.T) / 2


@dataclass(frozen=True, eq=False)
class Mean:
    """What bounds a long-run mean.

    ``level`` is g, ``V`` the polynomial by all monomials but one, and ``grams`` has one list a
    piece: the matrices of its own bases, then of each form's.
    """

    level: float
    V: Array
    grams: list[list[Array]]


class Problem:
    """The moments of pieces that share V."""

    def __init__(self, pieces: Sequence[Piece], degree: int) -> None:
        self.pieces, n = pieces, len(pieces[0].A)
        self.space = Space(n, degree)
        self.count = len(self.space.monomials)
        inner, lower = bases(n, degree // 2), bases(n, degree // 2 - 1)
        self.blocks = list[tuple[int, Array]]()
        for p, piece in enumerate(pieces):
            self.blocks += [(p, self.space.products(basis)) for basis in inner]
            for form in piece.forms:
                self.blocks += [(p, self.space.products(basis, form)) for basis in lower]
        self.generator = np.hstack([self.space.generator(p.A, p.E) for p in pieces])
        self.cost = np.concatenate([self.space.form(p.Q) for p in pieces])
        self.mass = np.zeros(self.count * len(pieces))
        self.mass[:: self.count] = 1.0

    @stage("moments")
    def solved(self, tolerance: float) -> Mean:
        """Return the least level of this degree.

        Raises
        ------
        SolverError
            If the search fails.
        """
        _, size, V = np.linalg.svd(self.generator)
        T = V[int((size > RANK * size[0]).sum()) :].T  # moments with which no V moves on average
        count = self.count
        F = [np.tensordot(T[p * count : (p + 1) * count], own, (0, 0)) for p, own in self.blocks]
        cost, mass = self.cost @ T, self.mass @ T
        x = inside(F, T.T @ self._start(), mass)
        rising, falling = cost[:, None, None], mass[:, None, None]
        spelt = Spelt([rising, *(0 * f for f in F)], [falling, *(-f for f in F)])
        found = _run(spelt, x, WIDE * float(mass @ x / (cost @ x)), 0.0, tolerance)
        first, *grams = (own[0] for own in found.Y)
        return self._completed([own / first[0, 0] for own in grams])

    def _start(self) -> Array:
        """Return moments of a Gaussian that is in each piece for its share of the time.

        Raises
        ------
        SolverError
            If the mean of the pieces' motions is not stable.
        """
        from scipy.linalg import solve_continuous_lyapunov

        shares = [p.share for p in self.pieces]
        A, W = (
            np.tensordot(shares, np.array(each), 1)
            for each in ([p.A for p in self.pieces], [p.E @ p.E.T for p in self.pieces])
        )
        if np.linalg.eigvals(A).real.max() >= 0:
            raise SolverError("the mean of the pieces is not stable")
        own = self.space.gaussian(np.asarray(solve_continuous_lyapunov(A, -W), dtype=float))
        return np.concatenate([share * own for share in shares])

    def _completed(self, grams: list[Array]) -> Mean:
        """Return V and 1/g by least squares, with the matrices by pieces.

        Rounding of the search moves the matrices off the equations: first they are moved back, by
        as little as can be in proportion to themselves.
        """
        L = np.vstack([self.cost, self.generator])
        grams = self._refined(grams, L)
        found, *_ = np.linalg.lstsq(L.T, self._rest(grams), rcond=None)
        each: list[list[Array]] = [[] for _ in self.pieces]
        for (p, _), own in zip(self.blocks, grams, strict=True):
            each[p].append(own)
        return Mean(1 / float(found[0]), np.asarray(found[1:]), each)

    def _rest(self, grams: list[Array]) -> Array:
        """Return what 1 - m'G m - ... leaves for V and 1/g, by moments."""
        rest = self.mass.copy()
        for (p, block), own in zip(self.blocks, grams, strict=True):
            rest[p * self.count : (p + 1) * self.count] -= np.tensordot(block, own, 2)
        return rest

    def _refined(self, grams: list[Array], L: Array) -> list[Array]:
        """Return G + G^1/2 S G^1/2 for the least S with which there are V and 1/g."""
        _, size, V = np.linalg.svd(L)
        Z = V[int((size > RANK * size[0]).sum()) :]
        roots = [np.linalg.cholesky(own) for own in grams]
        columns = []
        for (p, block), root in zip(self.blocks, roots, strict=True):
            own = Z[:, p * self.count : (p + 1) * self.count]
            scaled = root.T @ np.tensordot(own, block, 1) @ root
            columns.append(scaled.reshape(len(Z), -1))
        found, *_ = np.linalg.lstsq(np.hstack(columns), Z @ self._rest(grams), rcond=None)
        refined, start = list[Array](), 0
        for root, own in zip(roots, grams, strict=True):
            S = found[start : start + own.size].reshape(own.shape)
            start += own.size
            moved = root @ (S + S.T) @ root.T / 2
            refined.append(own + (moved + moved.T) / 2)
        return refined


def inside(F: list[Array], x: Array, mass: Array) -> Array:
    """Return a point at which all blocks, linear in it, are positive definite.

    Parameters
    ----------
    F : list of arrays (unknowns, size, size)
    x : (unknowns,) array
        With a positive mass.
    mass : (unknowns,) array
        In proportion to what a block may lack on the way.

    Raises
    ------
    SolverError
        If none is found.
    """
    lacking = -min(float(np.linalg.eigvalsh(np.tensordot(x, f, 1))[0]) for f in F)
    if lacking < 0:
        return x
    lacking /= float(mass @ x)
    shift = WITHIN * lacking
    D = [mass[:, None, None] * np.eye(f.shape[1]) for f in F]
    spelt = Spelt(D, [shift * d - f for d, f in zip(D, F, strict=True)])
    found = _run(spelt, x, (1 + WITHIN) * lacking + shift, shift / 2, COARSE)
    if found.r >= shift:
        raise SolverError("no point was found inside")
    return found.x


def _run(spelt: Spelt, x: Array, r: float, enough: float, tolerance: float) -> Outcome:
    try:
        return interior_point.run(spelt, x, r, enough, tolerance)
    except np.linalg.LinAlgError as error:
        raise SolverError("the search has no start") from error
