"""Gains along motions: a continuous Q on a grid of the box, by one LMI over all of its cells.

In each cell Q is a polynomial, and functions of the parameters are enclosed anew. What is sought
are its coefficients; cells that touch share those of their face. Every coefficient of the bounded
real lemma in a cell, at each extreme of the rates, is one inequality. A parameter that moves at any
rate has cells too, of one and the same Q.

Of a published loop with functions of a moving parameter (docs/moving.md) 1, 2, 4, 8 and 16 cells
prove 3.56, 1.81, 1.55, 1.48 and 1.44, all together in 20 s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product

import numpy as np

from polefence.base.effort import ended
from polefence.base.errors import SolverError
from polefence.lmi.conditions.pencil import Block, Pencil, Term, Variable
from polefence.lmi.solve.along_motions import slopes
from polefence.lmi.solve.dual_problem import Cover, Dual, DualProblem
from polefence.lmi.solve.duals import Part
from polefence.lmi.solve.gramians import Interpolation
from polefence.lmi.solve.grids import (
    Corners,
    Cuts,
    box_of,
    cells_of,
    count_of,
    finer,
    motion_in,
    nodes_of,
)
from polefence.lmi.solve.interior_point import WIDE
from polefence.lmi.solve.search import attempt, interior
from polefence.lmi.solve.stacked import stack
from polefence.plant.boxes import Box
from polefence.plant.motion import Motion
from polefence.plant.system import Array

CELLS = (1, 2, 4, 8, 16, 32, 64)  # along each moving parameter
DEGREES = (2, 1)  # of Q in a cell; the second where the first is too much work
MOST_CELLS = 256
MOST = 3e10  # of the work on one grid [multiplications an iteration]: some 15 s
WELL_INSIDE = 0.98  # of what is allowed: at what the search for a start ends
TOLERANCE = 1e-5  # of the least level
ROUNDS = 4  # in which remainders are covered anew
WORTH = 1e-3  # by which a round lowers the level, if there is to be one more
SCALAR = "t"  # name of the unknown that multiplies all but Q


@dataclass(frozen=True, eq=False)
class OnGrid:
    """A continuous Q on a grid, and the least level that it proves to rounding.

    Attributes
    ----------
    grid : Grid
    Q : (count, n, n) array
        Its coefficients, one for each node of the grid.
    covers : list of Cover
        Of the remainder in each cell; None where there is none.
    level : float
    """

    grid: Grid
    Q: Array
    covers: list[Cover | None]
    level: float

    def parts(self, level: float) -> list[Part]:
        """Return the cells with what is to prove a level."""
        pairs = zip(self.grid.cells, self.covers, strict=True)
        return [cell.part(self.Q, cover, level) for cell, cover in pairs]


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells of the box, in each of which Q is a polynomial; it is continuous.

    Attributes
    ----------
    problem : DualProblem
        About a gain, of a plant whose parameters move.
    cuts : tuple
        Of each parameter's interval.
    degree : int
        Of Q in each cell.
    """

    problem: DualProblem
    cuts: Cuts
    degree: int = 1

    @cached_property
    def motion(self) -> Motion:
        """How the parameters move."""
        return Motion.of(self.problem.plant)

    @cached_property
    def variables(self) -> dict[tuple[int, ...], Variable]:
        """Q of each node of the grid: one for all nodes along what moves at any rate."""
        n, known = self.problem.plant.shape[0], dict[tuple[int, ...], Variable]()
        for node in product(*map(range, nodes_of(self.cuts, self.degree))):
            first = tuple(0 if f in self.motion.free else k for f, k in enumerate(node))
            like = "" if first == node else known[first].name
            known[node] = Variable(f"Q{len(known) + 1}", (n, n), symmetric=True, like=like)
        return known

    @cached_property
    def cells(self) -> list[Cell]:
        """The cells."""
        plant, cells = self.problem.plant, list[Cell]()
        for ends, at in cells_of(self.cuts, self.degree, self.problem.domain):
            inner = Interpolation(self.problem.within(box_of(ends), *ends), self.degree)
            cells.append(Cell(ends, inner, at, motion_in(plant, ends)))
        return cells

    @cached_property
    def units(self) -> Array:
        """T in which the mean covariance of the state is about the identity."""
        return Interpolation(replace(self.problem, at_points=True), 1).units

    @property
    def work(self) -> float:
        """Return about how many multiplications an iteration takes."""
        n = self.problem.plant.shape[0]
        unknowns = sum(v.size for v in self.variables.values())
        size = n + self.problem.E.shape[-1] + self.problem.C.shape[-2]
        own = 1 + self.degree + self.problem.degree
        blocks = count_of(self.cuts) * own ** len(self.cuts)
        blocks *= 2 ** len(self.motion.moves)
        known = (1 + self.degree) ** len(self.cuts) * n * (n + 1) // 2  # unknowns of one block
        return float(unknowns**3 + blocks * (known * size) ** 2)

    def least(self, worst: float) -> OnGrid | None:
        """Return nearly the least level, None where no loop in some cell comes to rest.

        Parameters
        ----------
        worst : float
            The worst sample, in units of which levels are sought; it may be zero, where all that
            is seen comes of motion.
        """
        Q, unit = self._start(), worst if worst > 0 else 1.0
        if Q is None:
            return None
        found: OnGrid | None = None
        for _ in range(ROUNDS):
            again = self._lowered(Q, unit)
            if again is None or (found is not None and again.level >= found.level):
                break
            gained = found is None or again.level < found.level * (1 - WORTH)
            found = again
            if not gained or not any(found.covers):
                break
            Q = self.units.T @ found.Q @ self.units
        return found

    def _start(self) -> Array | None:
        """Return Q, in the search's units, that falls along all motions without disturbances."""
        loops = np.concatenate([cell.values[1] for cell in self.cells])
        rate = -2 * float(np.linalg.eigvals(loops).real.max())
        if rate <= 0:
            return None
        variables, blocks = tuple(self.variables.values()), list[Block]()
        for v in variables:
            blocks.append(Block(v.name, v.shape[0], (), (_term(v, -np.eye(v.shape[0]) / 2),)))
        for cell in self.cells:
            blocks += cell.resting(self.units, rate, variables)
        start = {v.name: np.eye(v.shape[0]) for v in variables}
        found = _sought(Pencil("rest", variables, tuple(blocks)), start, WELL_INSIDE * rate)
        if found is None or found[1] >= rate:
            return None
        return np.stack([found[0][v.name] for v in variables])

    def _lowered(self, Q: Array, unit: float) -> OnGrid | None:
        """Return what is found from Q of the search's units, with covers that it is given."""
        variables, blocks = tuple(self.variables.values()), list[Block]()
        covers = [cell.cover(self._restored(Q), None, unit) for cell in self.cells]
        for cell, cover in zip(self.cells, covers, strict=True):
            blocks += cell.lemma(self.units, unit, cover, variables)
        pencil = Pencil("gain", (*variables, Variable(SCALAR, (1, 1), rows="")), tuple(blocks))
        found = _sought(pencil, {v.name: X for v, X in zip(variables, Q, strict=True)})
        if found is None:
            return None
        values, r = found
        Q = np.stack([values[v.name] for v in variables]) / values[SCALAR]
        return OnGrid(self, self._restored(Q), covers, r * unit)

    def _restored(self, Q: Array) -> Array:
        """Return Q in the plant's own coordinates."""
        inverse = np.linalg.inv(self.units)
        Q = inverse.T @ Q @ inverse
        return np.asarray((Q + Q.swapaxes(-1, -2)) / 2)


def _sought(
    pencil: Pencil, start: dict[str, Array], enough: float = 0.0
) -> tuple[dict[str, Array], float] | None:
    """Return values of nearly the least r, and that; None where there is no start."""
    stacked = stack(pencil)
    x, r = interior(pencil, stacked, start, {})
    outcome = None if x is None else attempt(stacked, x, WIDE * r, enough, TOLERANCE)
    return None if outcome is None else (pencil.unpack(outcome.x), outcome.r)


def _term(variable: Variable, left: Array) -> Term:
    return Term(variable.name, left, np.eye(variable.shape[0]))


@dataclass(frozen=True, eq=False)
class Cell:
    """A cell of the grid.

    Attributes
    ----------
    ends : pair of tuples of Fraction
        Its lower and its upper corner.
    inner : Interpolation
        Of the problem in it.
    at : sequence of int
        Which Q its corners have, in the order of coefficients.
    motion : Motion
        Of its coordinates.
    """

    ends: Corners
    inner: Interpolation
    at: Sequence[int]
    motion: Motion

    @cached_property
    def degree(self) -> int:
        """Degree of the lemma's blocks."""
        problem, degree = self.inner.problem, self.inner.degree
        entering = problem.left + degree + problem.driving_degree
        return max(degree + problem.degree, entering, problem.rows)

    @cached_property
    def values(self) -> tuple[Array, Array, Array, Array, Array]:
        """At the lemma's nodes Q's basis, the loops, outputs, E and F."""
        problem = self.inner.problem
        nodes = problem.domain.nodes(self.degree)
        return problem.domain.basis(nodes, self.inner.degree), *problem.at(nodes)[1:]

    def _bernstein(self, values: Array) -> Array:
        return self.inner.problem.domain.interpolated(values, self.degree)

    def _weighted(self, M: Array) -> Array:
        """Return what multiplies each corner's Q in Q times M', of each coefficient."""
        return self._bernstein(np.einsum("pk,p...->pk...", self.values[0], M))

    def _falling(self, T: Array) -> list[tuple[int, Array]]:
        """Return the factors of Q in N'Q + Q N + dQ/dt, (corners, n, n), of each coefficient."""
        eye = np.eye(len(T))
        loops = self._weighted((np.linalg.inv(T) @ self.values[1] @ T).swapaxes(-1, -2))
        return [
            (e, loops[e] + D[e][:, None, None] / 2 * eye)
            for D in slopes(self.motion, self.inner.problem.domain, self.inner.degree, self.degree)
            for e in range(len(loops))
        ]

    def _own(self, variables: Sequence[Variable]) -> list[Variable]:
        return [variables[k] for k in self.at]

    def resting(self, T: Array, rate: float, variables: Sequence[Variable]) -> list[Block]:
        """Return r Q - (N'Q + Q N + dQ/dt + rate Q)."""
        n, own, basis = len(T), self._own(variables), self._bernstein(self.values[0])
        first, blocks = np.eye(len(T)), list[Block]()
        for e, lefts in self._falling(T):
            shares = [share / 2 * np.eye(n) for share in basis[e]]
            D = [Term(v.name, share, first) for v, share in zip(own, shares, strict=True)]
            M = [
                Term(v.name, left + rate * share, first)
                for v, left, share in zip(own, lefts, shares, strict=True)
            ]
            blocks.append(Block(f"rest {e}", n, tuple(D), tuple(M)))
        return blocks

    def cover(self, Q: Array, known: Cover | None, level: float) -> Cover | None:
        """Return what covers the remainder, at about the least cost where none is known."""
        if self.inner.problem.plant.remainder is None:
            return None
        return self.inner.cover(Q[list(self.at)], known, level=level)

    def lemma(
        self, T: Array, unit: float, cover: Cover | None, variables: Sequence[Variable]
    ) -> list[Block]:
        """Return the bounded real lemma in the dual form, r the level in a unit.

        Rows are those of states, disturbances and outputs, and of the remainder.
        """
        _, _, Y, E, F = self.values
        n, (p, q), own = len(T), F.shape[-2:], self._own(variables)
        size = n + q + p + (0 if cover is None else n)
        Y, F = self._bernstein(Y @ T), self._bernstein(F)
        entering = self._weighted((np.linalg.inv(T) @ E).swapaxes(-1, -2))
        units = np.eye(size)
        first, columns = units[:, :n], [units[:, k : k + 1] for k in range(size)]
        lost, beside = self._lost(T, cover, columns)
        grown = tuple(Term(SCALAR, unit / 2 * columns[k], columns[k]) for k in range(n, n + q + p))
        blocks = list[Block]()
        for e, falling in self._falling(T):
            lefts = np.zeros((len(own), size, n))
            lefts[:, :n], lefts[:, n : n + q] = falling, entering[e]
            if beside is not None:
                lefts[:, n + q + p :] = beside[e]
            half = [Term(v.name, left, first) for v, left in zip(own, lefts, strict=True)]
            for j in range(p):
                seen = np.concatenate([Y[e, j], F[e, j], np.zeros(size - n - q)])[:, None]
                half.append(Term(SCALAR, seen, columns[n + q + j]))
            blocks.append(Block(f"gain {e}", size, grown, (*half, *lost[e])))
        return blocks

    def _lost(
        self, T: Array, cover: Cover | None, columns: Sequence[Array]
    ) -> tuple[list[list[Term]], Array | None]:
        """Return what a remainder takes of each coefficient, and its factors of Q."""
        count = len(self.values[0])
        if cover is None:
            return [[]] * count, None
        problem, n = self.inner.problem, len(T)
        V = problem.form(problem.domain.nodes(self.degree))
        V = cover.columns[: V.shape[1], None] * V @ T
        loss = self._bernstein(V.swapaxes(-1, -2) @ V)
        squares = self.inner.driving(cover) ** 2
        driven = zip(columns[n : n + len(squares)], squares, strict=True)
        fixed = [Term(SCALAR, x / 2 * column, column) for column, x in driven]
        fixed += [Term(SCALAR, -column / 2, column) for column in columns[-n:]]
        below = np.zeros((count, len(columns) - n, n))
        lost = [
            [*(Term(SCALAR, left[:, [i]] / 2, columns[i]) for i in range(n)), *fixed]
            for left in np.concatenate([loss, below], axis=1)
        ]
        H = (np.linalg.inv(T) * cover.rows[:n]).T
        return lost, self._weighted(np.broadcast_to(H, (count, n, n)))

    def part(self, Q: Array, known: Cover | None, level: float) -> Part:
        """Return the cell's dual polynomial for a level."""
        dual = Dual(Q[list(self.at)], self.inner.degree, level, self.cover(Q, known, level))
        return Part(*self.ends, dual)


def least_in(problem: DualProblem, cells: Sequence[Box], degree: int, worst: float) -> float | None:
    """Return the least level that Q of a degree proves on a grid, which has these cells."""
    starts = (sorted(set(ends)) for ends in zip(*(box.low for box in cells), strict=True))
    cuts = tuple((*map(Fraction, own), Fraction(1)) for own in starts)
    with suppress(np.linalg.LinAlgError, SolverError):
        found = Grid(problem, cuts, degree).least(worst)
        return None if found is None else found.level
    return None


def on_grids(problem: DualProblem, worst: float) -> Iterator[OnGrid]:
    """Yield what is found on finer and finer grids.

    There are none in discrete time, of laws Z W^-1, and of a bound that is no gain.

    Parameters
    ----------
    worst : float
        The worst sample.
    """
    motion = Motion.of(problem.plant)
    still = not problem.gain or problem.law.W is not None or motion.centre is not None
    if still or not motion or set(problem.domain.sizes) != {2}:
        return
    moving = {move.simplex for move in motion.moves} | set(motion.free)
    every = [finer(problem.plant, moving, count) for count in CELLS]
    degree = next((d for d in DEGREES if Grid(problem, every[1], d).work <= MOST), DEGREES[-1])
    for grid in (Grid(problem, cuts, degree) for cuts in dict.fromkeys(every)):
        if grid.work > MOST or count_of(grid.cuts) > MOST_CELLS or ended():
            return
        with suppress(np.linalg.LinAlgError, SolverError):
            found = grid.least(worst)
            if found is not None:
                yield found
