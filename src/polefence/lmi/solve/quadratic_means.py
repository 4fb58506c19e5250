r"""Long-run means of piecewise linear motion under white noise, from above, by quadratic functions.

What `polefence.lmi.solve.moments` does for polynomials of any degree, here with V = x'P x, P one a
vertex, and a number t >= 0 for each form s of each piece, where neither forms nor motions have
constants:

    minimise g   subject to   -(Q + P A + A'P) - sum t s > 0 in every piece,   tr E'P E < g.

There are few unknowns, and a point to begin with is known where some P falls in all pieces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polefence.base.errors import SolverError
from polefence.base.progress import stage
from polefence.lmi.solve import interior_point
from polefence.lmi.solve.moments import Block, Conditions, Mean, Piece, inside
from polefence.plant.system import Array
from polefence.proof.squares import monomials


@stage("quadratic functions")
def least_mean(pieces: Sequence[Piece], P: Sequence[Array], tolerance: float) -> Mean:
    """Return the least level of quadratic functions.

    Parameters
    ----------
    pieces : sequence of Piece
    P : sequence of (n, n) arrays
        One a vertex, falling along the motions in the pieces, where the search begins.

    Raises
    ------
    SolverError
        If the search fails.
    """
    return _Search(pieces, len(P)).least(P, tolerance)


class _Search:
    """Unknowns are 1, P of each vertex by its entries, and t of each piece."""

    def __init__(self, pieces: Sequence[Piece], vertices: int) -> None:
        n = len(pieces[0].E)
        self.pieces, self.vertices = pieces, vertices
        rows, columns = np.tril_indices(n)
        self.rows, self.columns, self.entries = rows, columns, len(rows)
        self.basis = np.zeros((len(rows), n, n))
        self.basis[range(len(rows)), rows, columns] = 1.0
        self.basis[range(len(rows)), columns, rows] = 1.0
        self.count = 1 + vertices * len(rows) + sum(len(piece.forms) for piece in pieces)
        self.falling, start = list[Array](), 1 + vertices * len(rows)
        for piece in pieces:
            block = np.zeros((self.count, n, n))
            block[0] = -piece.Q[:n, :n]
            for j, A in piece.motions:
                PA = self.basis @ A[:, :n]
                block[self.of(j)] -= PA + PA.swapaxes(1, 2)
            block[start : start + len(piece.forms)] = [-form[:n, :n] for form in piece.forms]
            self.falling.append(block)
            start += len(piece.forms)
        self.positive = list[Array]()
        for k in range(1 + vertices * len(rows), self.count):
            self.positive.append(np.zeros((self.count, 1, 1)))
            self.positive[-1][k] = 1.0
        W = pieces[0].E @ pieces[0].E.T
        self.noise = [np.zeros((self.count, 1, 1)) for _ in range(vertices)]
        for j, row in enumerate(self.noise):
            row[self.of(j), 0, 0] = np.sum(self.basis * W, axis=(1, 2))

    def of(self, j: int) -> slice:
        """Where P of a vertex is."""
        return slice(1 + j * self.entries, 1 + (j + 1) * self.entries)

    def least(self, P: Sequence[Array], tolerance: float) -> Mean:
        """Return the least level."""
        one = np.zeros((self.count, 1, 1))
        one[0] = 1.0
        none = np.zeros((0, self.count))
        kept = [*self.falling, *self.positive]
        x = inside([(0, form) for form in kept], self._first(P), one, none)
        blocks = [Block(0, 0 * form, -form) for form in kept]
        blocks += [Block(0, one, form) for form in self.noise]
        level = max(float(x @ form[:, 0, 0]) for form in self.noise) / x[0]
        try:
            outcome = interior_point.run(
                Conditions(self.count, blocks, none),
                x,
                interior_point.WIDE * level,
                tolerance=tolerance,
            )
        except np.linalg.LinAlgError as error:
            raise SolverError("the search has no start") from error
        return self._mean(outcome.x / outcome.x[0], outcome.r)

    def _first(self, P: Sequence[Array]) -> Array:
        """Return P times a number that outweighs Q, with small multipliers."""
        x = np.zeros(self.count)
        x[0] = 1.0
        for j, matrix in enumerate(P):
            x[self.of(j)] = matrix[self.rows, self.columns]
        shares = [0.0]
        for piece, block in zip(self.pieces, self.falling, strict=True):
            if piece.at_bounds:
                falls = np.tensordot(x[1:], block[1:], 1)
                with np.errstate(all="ignore"):
                    rate = np.linalg.eigvals(np.linalg.solve(falls, piece.Q[:-1, :-1])).real.max()
                shares.append(float(rate))
        scale = 2.0 * max(shares)  # twice the least multiple of P that outweighs Q
        x[1:] *= scale if np.isfinite(scale) and scale > 0 else 1.0
        x[1 + self.vertices * self.entries :] = 1.0
        return x

    def _mean(self, x: Array, level: float) -> Mean:
        """Return V, the level and the matrices by pieces as `moments` has them."""
        n = len(self.pieces[0].E)
        place = {
            tuple(np.add(np.eye(n, dtype=int)[i], np.eye(n, dtype=int)[k]).tolist()): (i, k)
            for i, k in zip(self.rows, self.columns, strict=True)
        }
        P = [np.tensordot(x[self.of(j)], self.basis, 1) / level for j in range(self.vertices)]
        V = [
            [matrix[place[e]] * (1 if place[e][0] == place[e][1] else 2) for e in _squares(n)]
            for matrix in P
        ]
        grams, start = list[list[Array]](), 1 + self.vertices * self.entries
        for piece, block in zip(self.pieces, self.falling, strict=True):
            odd, last = np.tensordot(x, block, 1) / level, np.full((1, 1), float(piece.weight))
            taus = x[start : start + len(piece.forms)] / level
            grams.append([odd, last, *(np.full((1, 1), tau) for tau in taus)])
            start += len(piece.forms)
        return Mean(level, np.array(V), grams)


def _squares(n: int) -> list[tuple[int, ...]]:
    return monomials(n, 2, 0)[1:]
