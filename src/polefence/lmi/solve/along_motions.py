"""Lyapunov polynomials of a loop whose parameters move, by interpolation: no LMI is solved.

At rest the least X of A X + X A' + E E' <= 0 is the covariance of the state. The polynomial that
has its values at nodes misses the inequality, by what interpolation misses, by dX/dt while
parameters move, and by what a remainder of the plant takes. A constant R, added to E E', makes up
for all of it: it grows until no coefficient is negative, at any extreme of the rates. Of parameters
that move slowly beside the loop the bound exceeds the truth by little. An LMI finds the least
bound, with a number for each entry of each coefficient of X: of 8 states and three parameters it
takes 7 s for one of degree 1, where this takes 0.1 s for one of degree 4.

On the cells of a grid X is a polynomial in each, and functions of the parameters are enclosed anew.
As R is the same in all, X is one function of the parameters, and cells that touch share its
coefficients on their face: so it is continuous along every motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from polefence.law.laws import Law
from polefence.lmi.conditions.motion import change
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.lmi.solve.duals import MOST
from polefence.lmi.solve.gramians import OVER, ROOM, ROUNDS, majorant, root
from polefence.lmi.solve.grids import (
    Corners,
    Cuts,
    box_of,
    cells_of,
    count_of,
    finer,
    motion_in,
    whole_box,
)
from polefence.lmi.solve.loops import loop_degree
from polefence.lmi.solve.spread import covering
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.parts import inside
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array
from polefence.proof.remainder import SHARE
from polefence.region.regions import Region
from polefence.response.modes import Modes, even_modes, of_modes

DEGREES = (1, 2, 3, 4)  # of X on the whole box
CELLS = (2, 4, 8, 16, 32)  # of a grid, along each parameter that moves or is in a function
DEGREE = 2  # of X in a cell
MOST_CELLS = 256
# Rounds in which R grows where only a region is asked for, how large it becomes beside S where it
# does not end, and the most by which what is missed is taken to fall in a round. A cart whose
# spring is a table of its mass takes 8 rounds on 64 cells; with a step that counts on no fall 30
# were not enough, on 256 cells either.
GROWING, FAR, NEAR_ONE = 12, 1e3, 0.95


@dataclass(frozen=True, eq=False)
class Along:
    """X on the cells of a grid, and the level that it proves.

    Attributes
    ----------
    cells : sequence of pairs of tuples of Fraction
        Their lower and upper corners; one cell where X is a polynomial on the whole box.
    X : sequence of (count, n, n) arrays
        Bernstein coefficients in each.
    degree : int
    level : float
    """

    cells: Sequence[Corners]
    X: Sequence[Array]
    degree: int
    level: float


def along_motions(problem: DualProblem, worst: float, near: float = 1e-3) -> Iterator[Along]:
    """Yield polynomials of rising degree until one proves a level near the worst sample.

    There are none in discrete time, of a parameter that moves at any rate, and of laws Z W^-1.
    Where entries are functions of the parameters, or no polynomial of the whole box was found,
    there are those of finer and finer grids too.

    Parameters
    ----------
    problem : DualProblem
        About white noise, or about what a bounded energy does.
    worst : float
        What is bounded, at the worst point known.
    near : float
        How far above it a level ends the climb, as a share.
    """
    motion = Motion.of(problem.plant)
    still = problem.gain or problem.share is not None or problem.law.W is not None
    if still or motion.free or motion.centre is not None or set(problem.domain.sizes) != {2}:
        return
    whole, least = whole_box(problem.plant), np.inf
    for degree in DEGREES:
        if problem.work(degree) * ROUNDS > MOST and degree > 1:
            break
        along = _found(_Driven.on_grid(problem, motion, whole, degree))
        if along is not None:
            yield along
            least = min(least, along.level)
            if least <= worst * (1 + near):
                return
    if problem.plant.functions is None and np.isfinite(least):
        return
    for cuts in grids(problem.plant, motion):
        if problem.work(DEGREE) * ROUNDS * count_of(cuts) > MOST:
            return
        along = _found(_Driven.on_grid(problem, motion, cuts, DEGREE))
        if along is not None:
            yield along
            if along.level > least * (1 - near) or along.level <= worst * (1 + near):
                return
            least = along.level


def grids(plant: UncertainPlant, motion: Motion) -> Iterator[Cuts]:
    """Yield finer and finer grids, along the parameters that move or are in a function."""
    source = plant.remainder and plant.remainder.source
    names = source.names if source else []
    divided = {move.simplex for move in motion.moves}
    divided |= {f for f, p in enumerate(plant.parameters) if p.name in names}
    for count in CELLS:
        cuts = finer(plant, divided, count)
        if count_of(cuts) > MOST_CELLS:
            return
        yield cuts


def _found(grid: _Driven) -> Along | None:
    with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
        return grid.along()
    return None


@dataclass(frozen=True, eq=False)
class Cell:
    """A cell of a grid.

    Attributes
    ----------
    ends : pair of tuples of Fraction
        Its lower and its upper corner.
    plant : UncertainPlant
        There.
    law : Law
    domain : Domain
    motion : Motion
        Of its coordinates.
    degree, total : int
        Of X, and of the inequality.
    at : sequence of int
        Which of the grid's coefficients are its own, in their order.
    loops : (count, n, n) array
        At the nodes of X.
    noise : (count, n, n) array
        E E' there.
    raised : tuple of arrays
        Loops and E E' at the nodes of the inequality.
    scales : (q,) array, optional
        Of the disturbances; none where none counts.
    """

    ends: Corners
    plant: UncertainPlant
    law: Law
    domain: Domain
    motion: Motion
    degree: int
    total: int
    at: Sequence[int]
    loops: Array
    noise: Array
    raised: tuple[Array, Array]
    scales: Array | None = None

    @cached_property
    def modes(self) -> Modes:
        """Of the loops at the nodes of X."""
        return Modes(self.loops)

    @cached_property
    def basis(self) -> Array:
        """Bernstein polynomials of X at the nodes of the inequality."""
        return self.domain.basis(self.domain.nodes(self.total), self.degree)

    @cached_property
    def slopes(self) -> list[Array]:
        """Coefficients of dX/dt at every extreme of the rates, as weights of those of X."""
        return slopes(self.motion, self.domain, self.degree, self.total)

    def solved(self, R: Array) -> Array:
        """Return the coefficients of X that has at its nodes the covariance with R."""
        return self.domain.interpolated(self.modes.lyapunov(self.noise + R), self.degree)

    def bernstein(self, values: Array) -> Array:
        """Return coefficients of the inequality's degree."""
        return self.domain.interpolated(values, self.total)

    def lifted(self, X: Array) -> Array:
        """Return the coefficients of X, of the inequality's degree."""
        return self.bernstein(np.tensordot(self.basis, X, 1))

    def missed(self, X: Array) -> Array:
        """Return the violation of the inequality by each coefficient, at each extreme."""
        A, noise = self.raised
        half = A @ np.tensordot(self.basis, X, 1)
        both = self.bernstein(half + half.swapaxes(-1, -2) + noise)
        both = both + self._lost(X)
        return np.concatenate([both - np.tensordot(D, X, 1) for D in self.slopes])

    def _lost(self, X: Array) -> Array:
        """Return what a remainder takes of each coefficient."""
        remainder = self.plant.remainder
        if remainder is None:
            return np.zeros_like(X[0])
        degree = self.degree + self.law.degree
        at = self.domain.nodes(degree)
        values = np.tensordot(self.domain.basis(at, self.degree), X, 1)
        values = np.concatenate([values, self.law.gain(at) @ values], axis=1)
        R = np.array(remainder.entries, dtype=float)
        spread = covering(R, self.domain.interpolated(values, degree), self.scales is not None)
        H: Array = np.diag(np.square(np.array(spread.rows, dtype=float)))
        lost: Array = H + np.array(spread.omega, dtype=float)
        if self.scales is None:
            return lost
        columns = np.array(spread.columns[len(spread.columns) - len(self.scales) :], dtype=float)
        most = float((columns * self.scales).max(initial=0.0))
        if most:
            share = float(SHARE)
            lost = lost + self.bernstein(share * self.raised[1]) + (1 + 1 / share) * most**2 * H
        return lost


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells of the box, in each of which X is a polynomial; it is continuous."""

    cells: Sequence[Cell]

    def shared(self, coefficients: Sequence[Array]) -> list[Array]:
        """Return the coefficients of each cell; cells that touch have the first one's on a face."""
        known = dict[int, Array]()
        for cell, X in zip(self.cells, coefficients, strict=True):
            for place, M in zip(cell.at, X, strict=True):
                known.setdefault(place, M)
        return [np.stack([known[place] for place in cell.at]) for cell in self.cells]

    def solved(self, R: Array) -> list[Array]:
        """Return X in each cell, the covariance with R."""
        return self.shared([cell.solved(R) for cell in self.cells])

    def missed(self, X: Sequence[Array]) -> Array:
        """Return the violation of the inequality by each coefficient of all cells."""
        return np.concatenate([cell.missed(own) for cell, own in zip(self.cells, X, strict=True)])

    def lifted(self, X: Sequence[Array]) -> Array:
        """Return the coefficients of X in all cells."""
        return np.concatenate([cell.lifted(own) for cell, own in zip(self.cells, X, strict=True)])


@dataclass(frozen=True, eq=False)
class _Driven:
    """The search for R of what moves under disturbances.

    Attributes
    ----------
    grid : Grid
    seen : list of arrays
        Outputs at the nodes of X in each cell.
    raised : list of arrays
        The same at the nodes of the inequality.
    """

    grid: Grid
    seen: list[Array]
    raised: list[Array]

    @classmethod
    def on_grid(cls, problem: DualProblem, motion: Motion, cuts: Cuts, degree: int) -> _Driven:
        """Return it on a grid."""
        cells, seen, raised = list[Cell](), list[Array](), list[Array]()
        plant, divided = problem.plant, problem.plant.bent or count_of(cuts) > 1
        for ends, at in cells_of(cuts, degree, problem.domain):
            own = problem.within(box_of(ends), *ends) if divided else problem
            inner = motion_in(plant, ends) if divided else motion
            inverted = any(move.inverted for move in inner.moves)
            # s^2 in dX/dt, s = 1/p
            total = max(degree + own.rows, 2 * own.driving_degree, degree - 1 + 2 * inverted)
            domain = own.domain
            A, Y, E, _ = own.closed(domain.nodes(degree))
            loops, rows, entering, _ = own.closed(domain.nodes(total))
            noise, again = (M @ M.swapaxes(-1, -2) for M in (E, entering))
            cells.append(
                Cell(
                    ends,
                    own.plant,
                    own.law,
                    domain,
                    inner,
                    degree,
                    total,
                    at,
                    A,
                    noise,
                    (loops, again),
                    own.scales,
                )
            )
            seen.append(Y)
            raised.append(rows)
        return cls(Grid(cells), seen, raised)

    def along(self) -> Along | None:
        """Let R grow until no coefficient is negative; None if it does not end.

        It is measured in what it adds to the bound: with the observability Gramian Q, tr Q R.
        """
        cells = self.grid.cells
        squares = [Y.swapaxes(-1, -2) @ Y for Y in self.seen]
        observed = [cell.modes.observed(S) for cell, S in zip(cells, squares, strict=True)]
        inverse = root(np.concatenate(observed).mean(axis=0)).T
        T, eye = np.linalg.inv(inverse), np.eye(len(inverse))
        tops = [
            np.einsum("pij,pji->p", S, cell.modes.lyapunov(cell.noise)).max()
            for cell, S in zip(cells, squares, strict=True)
        ]
        top = float(max(tops))
        loops = inverse @ np.concatenate([cell.loops for cell in cells]) @ T
        R, over = 1e-3 * top / len(T) * eye, OVER
        for _ in range(ROUNDS):
            X = self.grid.solved(T @ R @ T.T)
            if not all(np.all(np.isfinite(own)) for own in X):
                return None
            missed = inverse @ self.grid.missed(X) @ inverse.T
            level, more = self._level(X), np.zeros_like(R)
            if np.linalg.eigvalsh(missed).max() >= 0:
                more = over * majorant(missed)
            elif level is not None:
                return Along([cell.ends for cell in cells], X, cells[0].degree, level)
            if level is None:  # more than D is covariance of the noise -(A D + D A')
                low = -inverse @ self.grid.lifted(X) @ inverse.T
                D = OVER * majorant(low) + 1e-9 * top * eye
                half = loops @ D
                more = more + majorant(-half - half.swapaxes(-1, -2))
            R, over = R + more + ROOM * top * eye, over * OVER
        return None

    def _level(self, X: Sequence[Array]) -> float | None:
        """Return the least level for blocks [level^2, C X; X C', X]; None where X is not > 0."""
        largest = 0.0
        for cell, own, Y in zip(self.grid.cells, X, self.raised, strict=True):
            rows = cell.bernstein(Y @ np.tensordot(cell.basis, own, 1))
            lifted = cell.lifted(own)
            if np.linalg.eigvalsh(lifted).min() <= 0:
                return None
            solved = np.linalg.solve(lifted, rows.swapaxes(-1, -2)).swapaxes(-1, -2)
            largest = max(largest, float((rows * solved).sum((1, 2)).max()))
        return float(np.sqrt(largest))


def falling(plant: UncertainPlant, law: Law, part: Region) -> Iterator[Along]:
    """Yield X on finer and finer grids that fall along motions as a half-plane asks for.

    S is in place of E E', the same everywhere: that of which X is the sum of v v* over the modes v
    in the middle, so that each mode is as far from the edge as its own pole is.
    """
    motion, domain, numbers = Motion.of(plant), law.domain_of(plant), part.closed_form
    if numbers is None or numbers[2] or set(domain.sizes) != {2}:
        return
    if motion.free or motion.centre is not None or law.W is not None:
        return
    a, b, _ = map(float, numbers)
    middle = np.full((1, domain.corners), 1 / domain.corners)
    centre, corners = (_loops(plant, law, at) for at in (middle, domain.nodes(1)))
    modes = even_modes(centre[0], 0.0, a, b, corners - centre)
    if modes is None:
        return
    V, inside_by = modes
    S = of_modes(V, inside_by)
    T: Array = np.asarray(np.linalg.cholesky(of_modes(V, np.ones(len(V)))), dtype=float)
    for cuts in grids(plant, motion):
        cells = [
            _falling_in(plant, law, ends, at, a / b, S / b)
            for ends, at in cells_of(cuts, DEGREE, domain)
        ]
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            X = _grown(Grid(cells), T)
            if X is not None:
                yield Along([cell.ends for cell in cells], X, DEGREE, 0.0)


def _falling_in(
    plant: UncertainPlant,
    law: Law,
    ends: Corners,
    at: Sequence[int],
    shift: float,
    S: Array,
) -> Cell:
    """Return a cell in which A X + X A' + shift X - dX/dt is to be below -S."""
    own, held, domain = inside(plant, *ends), law.inside(plant, *ends), law.domain_of(plant)
    motion = motion_in(plant, ends)
    inverted = any(move.inverted for move in motion.moves)
    total = max(DEGREE + loop_degree(own, held), DEGREE - 1 + 2 * inverted)
    shifted = shift / 2 * np.eye(plant.shape[0])
    loops, raised = (
        _loops(own, held, domain.nodes(degree)) + shifted for degree in (DEGREE, total)
    )
    noise = np.broadcast_to(S, loops.shape)
    again = np.broadcast_to(S, raised.shape)
    return Cell(ends, own, held, domain, motion, DEGREE, total, at, loops, noise, (raised, again))


def _grown(grid: Grid, T: Array) -> list[Array] | None:
    """Let R grow until no coefficient is negative; None if it does not end."""
    inverse, R, last = np.linalg.inv(T), np.zeros_like(T), np.inf
    for _ in range(GROWING):
        X = grid.solved(T @ R @ T.T)
        if not all(np.all(np.isfinite(own)) for own in X):
            return None
        if np.linalg.eigvalsh(inverse @ grid.lifted(X) @ inverse.T).min() <= 0:
            return None
        missed = inverse @ grid.missed(X) @ inverse.T
        if np.linalg.eigvalsh(missed).max() < 0:
            return X
        more = majorant(missed)
        size = float(np.trace(more))
        # what is missed falls by about the same share in each round: all of it at once
        share = size / last if size < last < np.inf else 0.0
        R, last = R + OVER / (1 - min(share, NEAR_ONE)) * more + ROOM * np.eye(len(T)), size
        if np.trace(R) > FAR * len(T):
            return None
    return None


def _loops(plant: UncertainPlant, law: Law, alpha: Array) -> Array:
    A, B = plant.at(alpha)
    return np.asarray(A + B @ law.gain(alpha))


def slopes(motion: Motion, domain: Domain, degree: int, total: int) -> list[Array]:
    """Return coefficients of dX/dt at every extreme of the rates, as weights of those of X."""
    sizes = domain.sizes
    rows, columns = domain.monomials(total), domain.monomials(degree)
    by_move = []
    for move in motion.moves:
        table = change(move, domain, degree, total)
        known = [[table.get(e, {}).get(d, 0.0) for d in columns] for e in rows]
        left, right = (
            np.array([binomial(sizes, e) for e in exponents]) for exponents in (rows, columns)
        )
        by_move.append(np.array(known) / left[:, None] * right)
    ends = product(*(moving.rates or (0.0, 0.0) for moving in motion.moves))
    none = np.zeros((len(rows), len(columns)))
    return [sum((rate * D for rate, D in zip(rates, by_move, strict=True)), none) for rates in ends]
