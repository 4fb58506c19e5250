r"""Long-run means of motion with clipped forces under white noise, from above.

x' = A x + B u + E w, and for each force a demand q and a rate v, rows of x, of which it is a
function with several linear regions. With forms s of (q, v, u, 1) that are not negative on it, as
`polefence.proof.sectors` has them, V = x'P x + 2 p'x, P and p for each vertex,

    minimise g   subject to   g - z'z - (grad V)'(A x + B u) - tr E'P E - sum s > 0 in (x, u, 1),
                              s - sum t_ab l_a l_b > 0 in (q, v, 1) and t > 0 in every region.

The unknowns grow with the sum of the regions, not with their product. (A half car with two measured
dampers of four ranges each has 245 unknowns and takes 0.3 s, where 432 pieces did not end in 150 s;
a full car with four 789 and 2 s.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from polefence.base.errors import SolverError
from polefence.base.progress import stage
from polefence.lmi.solve import interior_point
from polefence.lmi.solve.moments import Block, Conditions, inside
from polefence.plant.system import Array

FAR = 1e3  # g at which the search begins; costs are in units of what is known to be reached


@dataclass(frozen=True, eq=False)
class Force:
    """A force by a demand and a rate, and what it is in each region.

    ``place`` has (q, v, u, 1) by (x, u, 1), all forces in u; ``regions`` the force by (q, v, 1),
    and the lines that are not negative there, 1 the last one.
    """

    place: Array
    regions: tuple[tuple[Array, tuple[Array, ...]], ...]


@dataclass(frozen=True, eq=False)
class Open:
    """Motion and signals with the forces free, rows by (x, u, 1), at every vertex.

    ``groups`` are the ordered pairs of vertices that have one inequality together.
    """

    moved: list[Array]
    signals: list[Array]
    E: Array
    groups: Sequence[Sequence[tuple[int, int]]]
    forces: Sequence[Force]


@dataclass(frozen=True, eq=False)
class QuadraticMean:
    """What bounds a long-run mean: g, (P, p) of each vertex over g, forms and shares over g."""

    level: float
    V: list[Array]
    forms: list[Array]
    shares: list[list[Array]]


@stage("quadratic functions")
def least_mean(question: Open, P: Sequence[Array], even: bool, tolerance: float) -> QuadraticMean:
    """Return the least level of quadratic functions.

    Parameters
    ----------
    question : Open
    P : sequence of (n, n) arrays
        One a vertex, where the search begins.
    even : bool
        Whether V has no linear part.

    Raises
    ------
    SolverError
        If the search fails.
    """
    return _Search(question, even).least(P, tolerance)


class _Search:
    """Unknowns are 1, P and p of each vertex by their entries, forms, and t of each region."""

    def __init__(self, question: Open, even: bool) -> None:
        n, size = question.moved[0].shape
        self.question, self.n, self.size = question, n, size
        entries = [(i, k) for i in range(n) for k in range(i + 1)]
        self.basis = _basis([*entries, *(() if even else ((i, n) for i in range(n)))], n + 1)
        self.four = _basis([(i, k) for i in range(4) for k in range(i + 1)], 4)
        self.start = 1 + len(question.moved) * len(self.basis)
        pairs = [[len(lines) for _, lines in force.regions] for force in question.forces]
        each = [[count * (count - 1) // 2 for count in own] for own in pairs]
        self.first = self.start + len(self.four) * len(each)
        self.count = self.first + sum(map(sum, each))
        self.spans, at = list[list[slice]](), self.first
        for own in each:
            self.spans.append([])
            for count in own:
                self.spans[-1].append(slice(at, at + count))
                at += count
        self.blocks = [self._free(group) for group in question.groups]
        self.blocks += [(0 * M, M) for M in self._regions()]
        for k in range(self.first, self.count):
            M = np.zeros((self.count, 1, 1))
            M[k] = 1.0
            self.blocks.append((0 * M, M))

    def of(self, j: int) -> slice:
        """Where P and p of a vertex are."""
        return slice(1 + j * len(self.basis), 1 + (j + 1) * len(self.basis))

    def form(self, k: int) -> slice:
        """Where the form of a force is."""
        return slice(self.start + k * len(self.four), self.start + (k + 1) * len(self.four))

    def _free(self, group: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
        """Return what g has in a pair's inequality, and the rest of it."""
        size, n, question = self.size, self.n, self.question
        D, M = np.zeros((self.count, size, size)), np.zeros((self.count, size, size))
        D[0, -1, -1] = len(group)
        W = question.E @ question.E.T
        noise = np.sum(self.basis[:, :n, :n] * W, axis=(1, 2))
        for j, k in group:
            both = question.signals[j].T @ question.signals[k]
            M[0] -= (both + both.T) / 2
            falls = np.zeros((len(self.basis), size, size))
            half = self.basis[:, :, :n] @ question.moved[k]
            falls[:, :n], falls[:, -1] = half[:, :n], half[:, n]
            falls = falls + falls.swapaxes(1, 2)
            falls[:, -1, -1] += noise
            M[self.of(j)] -= falls
        for k, force in enumerate(question.forces):
            M[self.form(k)] -= len(group) * (force.place.T @ self.four @ force.place)
        return D, M

    def _regions(self) -> list[Array]:
        """Return what is to be positive definite in each region."""
        found = list[Array]()
        for k, (own, spans) in enumerate(zip(self.question.forces, self.spans, strict=True)):
            for (force, lines), span in zip(own.regions, spans, strict=True):
                place = np.array([[1, 0, 0], [0, 1, 0], force, [0, 0, 1]])
                M = np.zeros((self.count, 3, 3))
                M[self.form(k)] = place.T @ self.four @ place
                products = [np.outer(a, b) for a, b in combinations(lines, 2)]
                M[span] = [-(both + both.T) / 2 for both in products]
                found.append(M)
        return found

    def least(self, P: Sequence[Array], tolerance: float) -> QuadraticMean:
        """Return the least level."""
        one, none = np.zeros((self.count, 1, 1)), np.zeros((0, self.count))
        one[0] = 1.0
        x = np.zeros(self.count)
        x[0], x[self.first :] = 1.0, 1.0
        for j, matrix in enumerate(P):
            entries = matrix[np.tril_indices(self.n)]
            x[self.of(j)][: len(entries)] = entries
        x = inside([(0, FAR * D + M) for D, M in self.blocks], x, one, none)
        blocks = [Block(0, D, -M) for D, M in self.blocks]
        try:
            conditions = Conditions(self.count, blocks, none)
            outcome = interior_point.run(conditions, x, FAR, tolerance=tolerance)
        except np.linalg.LinAlgError as error:
            raise SolverError("the search has no start") from error
        x = outcome.x / (outcome.x[0] * outcome.r)
        return QuadraticMean(
            outcome.r,
            [np.tensordot(x[self.of(j)], self.basis, 1) for j in range(len(P))],
            [np.tensordot(x[self.form(k)], self.four, 1) for k in range(len(self.spans))],
            [[x[span] for span in spans] for spans in self.spans],
        )


def _basis(entries: Sequence[tuple[int, int]], size: int) -> Array:
    """Return symmetric matrices of one entry and its mirror image each."""
    basis = np.zeros((len(entries), size, size))
    for matrix, (i, k) in zip(basis, entries, strict=True):
        matrix[i, k] = matrix[k, i] = 1.0
    return basis
