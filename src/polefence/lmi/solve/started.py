"""The peak from initial states at all times, in floats: X at samples, and P between them.

At a point X is the analytic centre of the inequalities of `polefence.proof.claims.initial_peak`, a
little above the least level, with P' = N P + P N' from P = J X J' on: so it is an analytic function
of the point, and interpolated between. What that misses is made up for by noise, as of what
disturbances reach; a factor of all of it makes up for initial states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from polefence.lmi.solve.dual_problem import Dual, Starts
from polefence.lmi.solve.gramians import ROOM
from polefence.lmi.solve.reached import NEAR, Motion, ReachedSearch, motion_of, summed
from polefence.lmi.solve.stretches import DOUBLINGS, NODES, STEPS, Cuts
from polefence.plant.system import Array
from polefence.response.held import Storing

GAP = 1e-4  # of the least square of a level, by which the centre's exceeds it
# The level of a centre: so many times the least, or so far on the way from it to the level that is
# wanted. On the way 0.5 and 1 prove the same parts of a spring's box.
FAR, NEARER = 1.05, 0.8
ABOVE = 5e-4  # of the largest at the nodes, by which the square of one level for all exceeds it
HARDER = 8.0  # times, from one centre on the way to the next
MOST_CENTRES, MOST_STEPS, HALVINGS = 40, 60, 20  # of Newton's method, and of one step of it
CENTRED = 1e-9  # the square of its decrement that ends it
PULL = 10.0  # on X in its units
LESS, TINY = 1e-2, 1e-6  # of units: what a start has more of than it must; states at rest


def _t(M: Array) -> Array:
    return np.swapaxes(M, -1, -2)


class Block(NamedTuple):
    """S = sum_k x_k A_k + C > 0 at points: A (count, ..., d, p, p), C (count, ..., p, p)."""

    A: Array
    C: Array

    def at(self, x: Array) -> Array:
        """Return S."""
        return np.asarray(np.einsum("pd,p...dij->p...ij", x, self.A) + self.C)


def nearly_least(
    blocks: Sequence[Block], x: Array, pull: Array, enough: float = 0.0
) -> Array | None:
    """Return where the last entry of x is nearly as small as it can be at each point.

    Parameters
    ----------
    x : (count, d) array
        Where all blocks are positive definite.
    pull : (d - 1,) array
        Weights of the other entries.
    enough : float
        Of the last entry: a point is returned where it is less everywhere.

    Returns
    -------
    (count, d) array or None
        None where Newton's method is lost, or where the entry falls on.
    """
    parameter = sum(block.C.shape[1] * block.C.shape[-1] for block in blocks)
    weight, last = parameter / x[:, -1], np.eye(x.shape[1])[-1]
    for _ in range(MOST_CENTRES):
        weight = np.minimum(weight * HARDER, parameter / (GAP * x[:, -1]))
        found = _centred(blocks, x, np.append(pull, 0.0) + weight[:, None] * last)
        if found is None:
            return None
        x = found
        if x[:, -1].max() < enough or np.all(weight >= 0.9 * parameter / (GAP * x[:, -1])):
            return x
    return None


def _centred(
    blocks: Sequence[Block], x: Array, weights: Array, fixed: bool = False
) -> Array | None:
    """Return the analytic centre, with weights of x (count, d); ``fixed``: its last entry stays."""
    for _ in range(MOST_STEPS):
        slope, bend = np.zeros(x.shape) + weights, np.zeros((*x.shape, x.shape[1]))
        for block in blocks:
            L = np.linalg.inv(np.linalg.cholesky(block.at(x)))
            scaled = np.swapaxes(L[:, :, None] @ block.A @ _t(L)[:, :, None], 1, 2)
            slope -= np.trace(scaled, axis1=3, axis2=4).sum(axis=2)
            flat = scaled.reshape(*scaled.shape[:2], -1)
            bend += flat @ _t(flat)
        if fixed:
            slope, bend = slope[:, :-1], bend[:, :-1, :-1]
        size = np.sqrt(np.diagonal(bend, axis1=1, axis2=2))
        bend = bend / size[:, :, None] / size[:, None]
        step = -np.linalg.solve(bend, (slope / size)[:, :, None])[:, :, 0] / size
        squares = -np.einsum("pd,pd->p", step, slope)
        if not np.isfinite(squares).all():
            return None
        decrement = np.sqrt(np.maximum(squares, 0.0))[:, None]
        step *= np.where(decrement > 0.25, 1 / (1 + decrement), 1.0)
        step = np.pad(step, ((0, 0), (0, 1))) if fixed else step
        for _ in range(HALVINGS):  # rounding may lead out
            if _inside(blocks, x + step):
                break
            step = step / 2
        else:
            return None
        x = x + step
        if squares.max() < CENTRED:
            break
    return x


def _inside(blocks: Sequence[Block], x: Array) -> bool:
    """Whether all blocks are positive definite."""
    try:
        for block in blocks:
            np.linalg.cholesky(block.at(x))
    except np.linalg.LinAlgError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class StartedSearch(ReachedSearch):
    """The search for X and P at one degree of them in the parameters.

    Attributes
    ----------
    wanted : float
        The square of the level of a centre at the nodes; a little above the least if that is more.
    """

    wanted: float = 0.0

    @cached_property
    def storing(self) -> Storing:
        """The plant in continuous time, without disturbances."""
        return replace(super().storing, E=0 * super().storing.E)

    @property
    def starts(self) -> Starts:
        """The initial states."""
        if self.problem.starts is None:
            raise np.linalg.LinAlgError("there is no initial state")
        return self.problem.starts

    def least(self, worst: float) -> Dual | None:
        """Return the dual in as many stretches as bring it near the least level at nodes."""
        return self._below(max(worst, self.nearest) * (1 + NEAR))

    def proving(self, level: float) -> Dual | None:
        """Return a dual of less than the level."""
        dual = self._below(level * (1 - ROOM)) if self.nearest < level else None
        return dual if dual is not None and dual.level < level else None

    def _below(self, enough: float) -> Dual | None:
        """Return the best dual, of stretches that are halved until its level is enough.

        A centre far from the least level is tried first: between points it is smoother. Where it
        proves little, one nearer proves no more.
        """
        best, far = None, FAR * self.nearest
        near = self.nearest + NEARER * (enough - self.nearest)
        for wanted in (far, near) if near < far else (near,):
            dual = replace(self, wanted=wanted**2)._of_stretches(enough)
            if dual is not None and (best is None or dual.level < best.level):
                best = dual
            if best is None or best.level <= enough or best.level > FAR * far:
                break
        return best

    @cached_property
    def nearest(self) -> float:
        """The least level at the nodes, in one stretch of each phase."""
        cuts, (n, k) = ((0,),) * len(self._spans), self._nodes[3].shape[1:]
        chain = self._chain(np.zeros((len(cuts), k, k)), np.zeros((k, k)), cuts)
        x = self._least(self._blocks(chain, np.zeros((n, n)), cuts))
        return np.inf if x is None else float((x[:, -1].max() * (1 - GAP)) ** 0.5)

    def _solved(self, slack: tuple[Array, Array, Array], cuts: Cuts) -> tuple[Array, Array] | None:
        noise, early, late = slack
        chain = self._chain(noise, early, cuts)
        x = self._centre(chain, late, cuts)
        if x is None:
            return None
        inverse = np.asarray(np.linalg.inv(self._nodes[2]), dtype=float)
        Q = inverse @ np.tensordot(x[:, :-1], self._basis, 1) @ _t(inverse)
        every, P = [block.at(x) for block in chain], list[Array]()
        for k in range(len(self._places(cuts))):
            P.append(np.stack([every[STEPS * k + j] for j in NODES], axis=1))
        return (Q + _t(Q)) / 2, np.array(P)

    # --- inequalities at the nodes ---------------------------------------------------------------

    @cached_property
    def _J(self) -> Array:
        """[x; u] of the states at a sample."""
        _, form, W, _ = self._nodes
        return np.asarray(form @ np.linalg.inv(W), dtype=float)

    @cached_property
    def _period(self) -> Array:
        """What a period makes of the states."""
        zero = np.zeros(self._nodes[1].shape[1:2] * 2)
        whole = Motion(np.eye(len(zero)), zero)
        for phase, span in enumerate(self._spans):
            whole = whole.then(motion_of(self._nodes[0][0][phase], zero, span))
        return np.asarray(self._nodes[3] @ whole.phi @ self._J)

    @cached_property
    def _scales(self) -> Array:
        """Units of the states: of the least multiple of a covariance that holds initial states."""
        starts = self.starts
        noise = np.zeros(self._period.shape) + starts.points @ starts.points.T
        noise = noise if starts.ellipsoid is None else noise + starts.ellipsoid
        X = summed(self._period, noise + TINY * np.diag(_largest(noise) ** 2))
        if X is None:
            raise np.linalg.LinAlgError("the loop is not stable")
        X = X * self._asked_of(X).max()
        return _largest(X)

    @cached_property
    def _basis(self) -> Array:
        """Symmetric matrices of which X is made, in its units; one of zeros is the level's."""
        units = self._scales
        rows, columns = np.triu_indices(len(units))
        basis = np.zeros((len(rows), len(units), len(units)))
        every = np.arange(len(rows))
        basis[every, rows, columns] = basis[every, columns, rows] = units[rows] * units[columns]
        return basis

    @property
    def _pull(self) -> Array:
        """Weights of X: without them states that are hardly seen would make it grow on."""
        rows, columns = np.triu_indices(len(self._scales))
        return np.asarray(PULL * (rows == columns))

    def _chain(self, noise: Array, begin: Array, cuts: Cuts) -> list[Block]:
        """Return P, which begins as J X J' and more, at all steps of all stretches."""
        J, (count, k, _) = self._J, self._nodes[1].shape
        A = np.zeros((count, len(self._basis) + 1, k, k))
        A[:, :-1] = J[:, None] @ self._basis @ _t(J)[:, None]
        every = [Block(A, np.broadcast_to(begin, (count, k, k)))]
        for (phase, time), own in zip(self._places(cuts), noise, strict=True):
            N = self._nodes[0][0][phase]
            step = motion_of(N, 0 * N + own, time / STEPS)
            for _ in range(STEPS):
                A, C = every[-1]
                A = step.phi[:, None] @ A @ _t(step.phi)[:, None]
                every.append(Block(A, step.of(C)))
        return every

    def _blocks(self, chain: Sequence[Block], late: Array, cuts: Cuts) -> list[Block]:
        """Return the inequalities: of X in its units, a sample's first; and of the output."""
        G, square = self._nodes[3], self._scales * self._scales[:, None]
        A, C = chain[-1]
        X = np.zeros((len(A), 1, A.shape[1], *square.shape))
        X[:, :, :-1] = self._basis
        held = [x[:, None] * x for x in self.starts.points.T]
        held += [] if self.starts.ellipsoid is None else [self.starts.ellipsoid]
        falls = X - (G[:, None] @ A @ _t(G)[:, None])[:, None]
        left = -(G @ C @ _t(G)) - late
        every = [left, *(np.broadcast_to(-M, left.shape) for M in held)]
        states = np.concatenate([falls, *[X] * len(held)], axis=1), np.stack(every, axis=1)
        slopes, levels = list[Array](), list[Array]()
        for place, (phase, _) in enumerate(self._places(cuts)):
            Y = self._nodes[0][2][phase]
            for A, C in chain[STEPS * place : STEPS * (place + 1) + 1]:
                slopes.append(-(Y[:, None] @ A @ _t(Y)[:, None]))
                slopes[-1][:, -1] += 1.0
                levels.append(-(Y @ C @ _t(Y)))
        output = Block(np.stack(slopes, axis=1), np.stack(levels, axis=1))
        return [Block(*(M / square for M in states)), output]

    def _centre(self, chain: Sequence[Block], late: Array, cuts: Cuts) -> Array | None:
        """Return X and the square of the level at the nodes; None where there is none."""
        blocks = self._blocks(chain, late, cuts)
        found = self._least(blocks, self.wanted / (1 + ABOVE))
        if found is None:
            return None
        found[:, -1] = max((1 + ABOVE) * found[:, -1].max(), self.wanted)
        return _centred(blocks, found, np.append(self._pull, 0.0), fixed=True)

    def _least(self, blocks: Sequence[Block], enough: float = 0.0) -> Array | None:
        """Return X and the square of a level that is nearly the least at each node, or enough."""
        begun = self._begun(blocks)
        return None if begun is None else nearly_least(blocks, begun, self._pull, enough)

    def _begun(self, blocks: Sequence[Block]) -> Array | None:
        """Return a start: X that holds initial states and what they lead to, and a level."""
        units, rows = self._scales, np.triu_indices(len(self._scales))
        X = summed(
            self._period, (LESS * np.eye(len(units)) - blocks[0].C[:, 0]) * units * units[:, None]
        )
        if X is None:
            return None
        x = X[:, *rows] / (units[rows[0]] * units[rows[1]])
        x = np.concatenate([x, np.zeros((len(x), 1))], axis=1)
        for _ in range(DOUBLINGS):
            x = 2 * x
            x[:, -1] = 0.0
            x[:, -1] = 2 * -blocks[1].at(x).min(axis=(1, 2, 3))
            if _inside(blocks, x):
                return x
        return None

    # --- between nodes ---------------------------------------------------------------------------

    def _dual(self, Q: Array, P: Array, cuts: Cuts) -> Dual:
        """Return the dual, times what makes it hold initial states at every coefficient."""
        times = (1 + ROOM) * self._asked(Q)
        return super()._dual(times * Q, times * P, cuts)

    def _asked(self, Q: Array) -> float:
        """Return how many times as large X and P must be at least."""
        domain, degree = self.problem.domain, self.degree
        high = degree + 2 * self.problem.law.degree
        at = domain.nodes(high)
        W = self._loops(at)[2]
        here = np.tensordot(domain.basis(at, degree), domain.interpolated(Q, degree), 1)
        return float(self._asked_of(domain.interpolated(W @ here @ _t(W), high)).max())

    def _asked_of(self, X: Array) -> Array:
        """Return how many times as large each X must be to hold the initial states."""
        inverse, X0 = np.linalg.inv(X), self.starts.ellipsoid
        times = [np.einsum("i,pij,j->p", x, inverse, x) for x in self.starts.points.T]
        times += [] if X0 is None else [np.linalg.eigvals(inverse @ X0).real.max(axis=1)]
        return np.asarray(np.max(times, axis=0))


def _largest(M: Array) -> Array:
    """Return roots of the largest diagonal entries at points; a zero counts as the largest."""
    size = np.sqrt(np.maximum(np.diagonal(M, axis1=1, axis2=2).max(axis=0), 0.0))
    return np.where(size > 0, size, size.max() or 1.0)
