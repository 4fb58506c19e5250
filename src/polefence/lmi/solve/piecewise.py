"""Gains along motions: a continuous Q on a grid of the box, by interpolation; no LMI is solved.

At each node of a grid Q solves the Riccati equation of a level, with a constant R that is the same
everywhere; between nodes it is multi-affine. What the interpolation misses, and dQ/dt at every
extreme of the rates, R makes up for: it grows until no coefficient is negative in any cell. Where
it does not end the grid is finer along the parameters that move.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product

import numpy as np

from polefence.lmi.solve.along_motions import slopes
from polefence.lmi.solve.dual_problem import Dual, DualProblem
from polefence.lmi.solve.duals import Part
from polefence.lmi.solve.gramians import (
    BARELY,
    OVER,
    ROOM,
    ROUNDS,
    Interpolation,
    majorant,
    riccati,
)
from polefence.plant.boxes import Box
from polefence.plant.motion import Motion
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array

GRIDS = (2, 4, 8)  # cells along each moving parameter
MOST_CELLS = 256
SHARES = (0.5, 0.75, 0.25)  # of the way from the least level of a node to what is claimed


@dataclass(frozen=True, eq=False)
class Piecewise:
    """The search for R on a grid.

    Attributes
    ----------
    problem : DualProblem
        About a gain, of a plant whose parameters move.
    counts : tuple of int
        Cells along each parameter.
    """

    problem: DualProblem
    counts: tuple[int, ...]

    @cached_property
    def nodes(self) -> Interpolation:
        """The loops at the nodes of the grid."""
        found = Interpolation(replace(self.problem, at_points=True), 1)
        found.__dict__["nodes"] = found.problem.closed(self._alpha(self._points))
        return found

    @cached_property
    def _points(self) -> list[tuple[int, ...]]:
        return list(product(*(range(count + 1) for count in self.counts)))

    def _alpha(self, points: Sequence[tuple[int, ...]]) -> Array:
        """Return weights of the corners of the box at nodes."""
        upper = np.array(points) / np.array(self.counts)
        pairs = np.stack([1 - upper, upper], axis=-1).reshape(len(points), -1)
        return self.problem.domain.alpha(pairs)

    @cached_property
    def cells(self) -> list[_Cell]:
        """The cells, each with the numbers of its corners."""
        numbers = {point: k for k, point in enumerate(self._points)}
        cells = list[_Cell]()
        for first in product(*map(range, self.counts)):
            low = tuple(k / count for k, count in zip(first, self.counts, strict=True))
            high = tuple((k + 1) / count for k, count in zip(first, self.counts, strict=True))
            box = replace(Box.whole(self.problem.domain), low=low, high=high)
            inner = Interpolation(self.problem.inside(box), 1)
            steps = product((0, 1), repeat=len(first))
            corners = [numbers[tuple(map(sum, zip(first, step, strict=True)))] for step in steps]
            cells.append(_Cell(box, inner, corners, self._slopes(box, inner)))
        return cells

    def _slopes(self, box: Box, inner: Interpolation) -> list[Array]:
        parameters = tuple(
            _narrowed(p, low, high)
            for p, low, high in zip(self.problem.plant.parameters, box.low, box.high, strict=True)
        )
        motion = Motion.of(replace(self.problem.plant, parameters=parameters))
        return slopes(motion, inner.problem.domain, 1, inner.total)

    def proving(self, level: float) -> list[Part] | None:
        """Return a dual polynomial of each cell, together continuous, that prove a level."""
        least = self.nodes._least(np.zeros_like(self.nodes.units), level, self._zero)
        if least is None:
            return None
        for share in SHARES:
            with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
                parts = self._grown(level, least, share)
                if parts is not None:
                    return parts
        return None

    @property
    def _zero(self) -> Array:
        return np.zeros(len(self._points))

    def _grown(self, level: float, least: Array, share: float) -> list[Part] | None:
        """Let R grow until every coefficient is positive; None if it does not end."""
        T = self.nodes.units
        n = len(T)
        inverse, R, over = np.linalg.inv(T), 1e-6 * level * np.eye(n), OVER
        for _ in range(ROUNDS):
            more = inverse.T @ R @ inverse
            higher = self.nodes._least(more, level, least)
            if higher is None:
                return None
            least = higher
            levels = np.minimum(least * (1 + BARELY), level) ** (1 - share) * level**share
            Q = riccati(*self.nodes._equations(more, levels))
            if Q is None or not np.all(np.isfinite(Q)):
                return None
            parts, missed = list[Part](), list[Array]()
            for cell in self.cells:
                part, off = cell.judged(Q, level)
                parts.append(part)
                missed.append(T.T @ off @ T)
            whole = np.concatenate(missed)
            if np.linalg.eigvalsh(whole).max() < 0:
                return parts
            R = R + over * majorant(whole) + ROOM * level * np.eye(n)
            over *= OVER
        return None


@dataclass(frozen=True, eq=False)
class _Cell:
    box: Box
    inner: Interpolation
    corners: list[int]
    slopes: list[Array]

    def judged(self, Q: Array, level: float) -> tuple[Part, Array]:
        """Return the dual polynomial there, and by what its coefficients miss the level."""
        inner, domain = self.inner, self.inner.problem.domain
        coefficients = domain.interpolated(self._ordered(Q), 1)
        remainder = inner.problem.plant.remainder
        cover = None if remainder is None else inner._cover(coefficients, None, level=level)
        missed, _ = inner._missed(coefficients, level * (1 - ROOM), cover)
        every = [missed + np.tensordot(D, coefficients, 1) for D in self.slopes]
        dual = Dual(coefficients, 1, level, cover)
        return Part(tuple(self.box.low), tuple(self.box.high), dual), np.concatenate(every)

    def _ordered(self, Q: Array) -> Array:
        """Return Q at the corners in the order of the domain's nodes."""
        upper = self.inner.problem.domain.nodes(1)
        coordinates = self.inner.problem.domain.coordinates(upper)[..., 1::2]
        count = coordinates.shape[-1]
        places = (np.round(coordinates) @ 2 ** np.arange(count)[::-1]).astype(int)
        return np.asarray(Q[np.array(self.corners)[places]])


def _narrowed(parameter: Parameter, low: float, high: float) -> Parameter:
    """Return a parameter on a part of its interval, as it moves."""
    first, last = parameter.scheduling(parameter.low), parameter.scheduling(parameter.high)
    ends = (first + (last - first) * Fraction(t) for t in (low, high))
    start, end = map(parameter.scheduling, ends)
    return replace(parameter, low=start, high=end)


def over_grids(problem: DualProblem, level: float) -> list[Part] | None:
    """Return cells of the coarsest grid on which a gain along motions is proved; None of none.

    Parameters
    ----------
    level : float
        Of the gain.
    """
    motion = Motion.of(problem.plant)
    still = not problem.gain or problem.law.W is not None or motion.centre is not None
    if still or motion.free or not motion.moves or set(problem.domain.sizes) != {2}:
        return None
    moving = {move.simplex for move in motion.moves}
    for count in GRIDS:
        counts = tuple(count if f in moving else 1 for f in range(len(problem.plant.parameters)))
        if np.prod(counts) > MOST_CELLS:
            return None
        parts = Piecewise(problem, counts).proving(level)
        if parts is not None:
            return parts
    return None
