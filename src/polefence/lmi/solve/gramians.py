"""Dual Lyapunov polynomials of a loop that is given, by interpolation: no LMI is solved.

At each point of a family the least Q of A'Q + Q A + C'C <= 0 is the observability Gramian, an
analytic function of the point: the polynomial that has its values at nodes misses the equation by
what falls off geometrically with its degree. A constant R, added to C'C, makes up for what it
misses: the smallest, as the bound tells sizes, of which no coefficient of the inequality is
negative. What is bounded then exceeds the truth by about what the interpolation misses.

The bound is one number for all points. Where less is true Q may be larger: it is scaled until it
tells about the same everywhere, and varies less. Of a gain Q is the solution of a Riccati equation,
at each point of a level of its own, between the gain there and the one level that is claimed, at
which it then proves more than it needs. Next to the gain itself the solution is an analytic
function of the point, as long as the frequency of the gain is; at one level for all points it has a
branch point just outside the family, where the gain comes to exceed that. Of some shares of the way
between, the best is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.lmi.solve.dual_problem import Cover, Dual, DualProblem
from polefence.plant.system import Array
from polefence.proof.remainder import SHARE
from polefence.response.modes import Modes, even_modes, of_modes
from polefence.response.stationary import bilinear

ROUNDS = 8  # in which R grows
OVER = 1.3  # times what is missed, since R moves what is missed
ROOM = 1e-7  # of the bound's square, for rounding
LOWEST = 0.03  # of a level, what a point's own is at least
# In which R makes up for a remainder too, and by how much more than is missed. A table of straight
# lines in a plant with a sensor takes 15 parts so (18 with 3.0), where 400 were not enough with
# what all modes share. A van's with another takes 70 at 5 ms (94 with 3.0, 90 with 2.0).
MODE_ROUNDS, MODE_OVER = 3, 1.5
SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way from what is least to what is claimed
BARELY = 1e-5  # by which a point's own level exceeds the least there
COVERED, TINY = 1.0001, 1e-300  # of rows and columns that cover a remainder
# Of all modes', what each is taken to cost: a van's limit at 10 ms takes 8 parts; with 1e-1 10,
# with 1e-2 9, with 1e-5 10.
LEAST_COST = 1e-3
SMALL = 1e-7  # of the largest, what a direction is taken to be moved at least


def riccati(A: Array, S: Array, Q: Array) -> Array | None:
    """Return the stabilising X of A'X + X A + X S X + Q = 0, batched; None where there is none."""
    n = A.shape[-1]
    values, V = np.linalg.eig(_hamiltonian(A, S, Q))
    if not np.all((values.real < 0).sum(axis=-1) == n):
        return None
    order = np.argsort(values.real, axis=-1)[..., :n]
    stable = np.take_along_axis(V, order[..., None, :], axis=-1)
    X = np.linalg.solve(stable[..., :n, :].swapaxes(-1, -2), stable[..., n:, :].swapaxes(-1, -2))
    real = X.swapaxes(-1, -2).real
    return np.asarray((real + real.swapaxes(-1, -2)) / 2)


def has_stabilising(A: Array, S: Array, Q: Array) -> Array:
    """Whether there is a stabilising solution, of each of a batch: no root on that axis."""
    values = np.linalg.eigvals(_hamiltonian(A, S, Q))
    # a root of 1e-7 of the largest is taken for the axis
    return np.asarray(np.abs(values.real).min(-1) > 1e-7 * np.abs(values).max(-1))


def _hamiltonian(A: Array, S: Array, Q: Array) -> Array:
    top = np.concatenate([A, S], axis=-1)
    return np.concatenate([top, np.concatenate([-Q, -A.swapaxes(-1, -2)], axis=-1)], axis=-2)


@dataclass(frozen=True, eq=False)
class Interpolation:
    """The search for R at one degree of Q."""

    problem: DualProblem
    degree: int

    @cached_property
    def nodes(self) -> tuple[Array, Array, Array, Array]:
        """The closed loops at the nodes of Q."""
        return self.problem.closed(self.problem.domain.nodes(self.degree))

    @cached_property
    def modes(self) -> Modes:
        """Their modes."""
        return Modes(self.nodes[0], self.problem.step)

    @cached_property
    def raised(self) -> tuple[Array, tuple[Array, Array, Array, Array, Array]]:
        """The values of the Bernstein polynomials of Q, and the loops, at the product's nodes."""
        domain = self.problem.domain
        at = domain.nodes(self.total)
        return domain.basis(at, self.degree), self.problem.at(at)

    @cached_property
    def bounded(self) -> tuple[int, Array, Array, Array, Array]:
        """Of what is a share: its degree; Q's basis and E at its nodes; its coefficients; more."""
        problem, domain, degree = self.problem, self.problem.domain, self.total
        if problem.share is not None:
            degree = max(problem.share_degree, self.degree + 2 * problem.driving_degree)
        at = domain.nodes(degree)
        shares = domain.interpolated(problem.shares(at), degree)
        more = problem.more(at)
        return degree, domain.basis(at, self.degree), problem.at(at)[3], shares, more

    @cached_property
    def units(self) -> Array:
        """T in which the mean covariance of the state is about the identity, X = T T'."""
        X = self.modes.covariance(self.nodes[2]).mean(axis=0)
        size = np.sqrt(np.maximum(np.diag(X), 0))
        size = np.where(size > 0, size, size.max() or 1.0)
        values, V = np.linalg.eigh(X / np.outer(size, size))
        values = np.maximum(values, SMALL * max(values.max(), SMALL))
        return np.asarray(size[:, None] * V * np.sqrt(values))

    def least(self, worst: float) -> Dual | None:
        """Return the dual, for a gain at the first level that has one."""
        if not self.problem.gain:
            return self._grown(None)
        # above the worst sample
        grown = (self._grown(worst * (1 + above)) for above in (1e-4, 1e-3, 5e-3, 2e-2, 0.1))
        return next((dual for dual in grown if dual is not None), None)

    def proving(self, level: float) -> Dual | None:
        """Return the dual below the level, for a gain somewhat below it."""
        if self.problem.gain:
            return self._grown(level * (1 - ROOM))
        dual = self._even(level) if self.problem.between and level < np.inf else None
        curved = self.problem.plant.curve_degree > 1 or self.problem.ticking
        if dual is None and (not self.problem.between or curved):
            return self._grown(None)
        return dual

    def _even(self, level: float) -> Dual | None:
        """Return the dual whose R makes up for what Gramians miss, and then is even over all modes.

        Q = Q_0 + Q_R + r Q_S. Of R each mode has a share of its own: it exceeds what Q_0 misses,
        and in a few rounds what a remainder takes. Where that does not end, or there is none, S
        makes up for the rest: Q_S is the sum of w w* over the left eigenvectors w in the middle, so
        that what is missed further may be the same share of each. Where R alone costs more than the
        level allows the part is too large.

        What Q_0 misses is mostly that of one slow pole, which costs next to nothing. With S alone
        a limit of twice the worst case took 26 parts for a van's law of order 2 at 10 ms, with R
        it takes 8, and another limit 40 where 400 were not enough.
        """
        domain = self.problem.domain
        closed, Y, *_ = self.nodes
        at_middle = self.problem.closed(np.full((1, domain.corners), 1 / domain.corners))
        modes = even_modes(at_middle[0][0].T, self.problem.step)
        if modes is None:
            return None
        least = self.modes.observed(Y.swapaxes(-1, -2) @ Y)
        whole = (level * (1 - ROOM)) ** 2 - self._largest(least, self._more_at_nodes)
        if whole <= 0:
            return None
        missed, _ = self._missed(domain.interpolated(least, self.degree), None)
        V, inside = modes
        R = of_modes(V, inside * made_up(missed, V, inside, at_middle[2][0]))
        first = self.modes.observed(0 * closed + R)
        if self.problem.plant.remainder is not None:
            dual = self._near(level, whole, R, least, modes, at_middle[2][0])
            if dual is not None:
                return dual
        S = of_modes(V, inside)
        more = self.modes.observed(0 * closed + S)
        of_first, of_more = self._largest(first), self._largest(more)
        for share in (0.9, 0.5, 0.1):  # of what is between the least and the level
            room = share * whole - of_first
            if room <= 0 or of_more <= 0:
                return None
            r = room / of_more
            Q = domain.interpolated(least + first + r * more, self.degree)
            T = np.linalg.inv(np.linalg.cholesky(R + r * S))
            cover = self.cover(Q, None, T.T)
            missed, bound = self._missed(Q, None, cover)
            if bound < level and np.linalg.eigvalsh(T @ missed @ T.T).max() < 0:
                return Dual(Q, self.degree, bound, cover)
        return None

    def _near(
        self,
        level: float,
        whole: float,
        R: Array,
        least: Array,
        modes: tuple[Any, Array],
        E: Array,
    ) -> Dual | None:
        """Return the dual whose R makes up for the remainder too, mode by mode.

        What the remainder takes grows with Q, and Q with R: a few rounds show whether that ends.
        E is that of the disturbances in the middle.
        """
        V, inside = modes
        for _ in range(MODE_ROUNDS):
            more = self.modes.observed(0 * self.nodes[0] + R)
            if self._largest(more) > whole:
                return None
            Q = self.problem.domain.interpolated(least + more, self.degree)
            cover = self.cover(Q, None)
            missed, bound = self._missed(Q, None, cover)
            if bound < level and np.linalg.eigvalsh(self.units.T @ missed @ self.units).max() < 0:
                return Dual(Q, self.degree, bound, cover)
            R = R + of_modes(V, inside * made_up(missed, V, inside, E) * MODE_OVER)
        return None

    def _largest(self, Q: Array, more: Array | float = 0.0) -> float:
        """Return the largest tr E'QE at the nodes, with what is added to it."""
        E = self.nodes[2]
        return float((np.einsum("pik,pij,pjk->p", E, Q, E) + more).max())

    @cached_property
    def _more_at_nodes(self) -> Array:
        return self.problem.more(self.problem.domain.nodes(self.degree))

    def _grown(self, level: float | None) -> Dual | None:
        """Let R grow until every coefficient is positive; None if it does not end."""
        T, n, cover = self.units, len(self.units), None
        inverse, R, over = np.linalg.inv(T), np.zeros((n, n)), OVER
        share, unit = SHARES[0], float(self.problem.shares(self.problem.domain.nodes(0))[0])
        least: Array = np.zeros(len(self.nodes[0]))
        if self.problem.plant.remainder is not None:  # what is not observed must cost a little
            R = 1e-6 * self._size(level) ** 2 * unit * inverse.T @ inverse
        for k in range(ROUNDS):
            if level is not None:
                higher = self._least(R, level, least)
                if higher is None:
                    return None
                least = higher
            share = share if k else self._share(level, least)
            Q = self._solutions(R, level, least, share)
            if Q is None:
                return None
            if self.problem.plant.remainder is not None:
                cover = self.cover(Q, cover, level=level)
            missed, bound = self._missed(Q, level, cover)
            missed = T.T @ missed @ T
            if np.linalg.eigvalsh(missed).max() < 0 < np.linalg.eigvalsh(T.T @ Q[0] @ T).min():
                return Dual(Q, self.degree, bound, cover)
            room = ROOM * bound**2 * unit
            more, over = over * majorant(missed) + room * np.eye(n), over * OVER
            R = R + inverse.T @ more @ inverse
        return None

    def _size(self, level: float | None) -> float:
        """Return an estimate of the bound."""
        if level is not None:
            return level
        _, Y, E, _ = self.nodes
        Q = self.modes.observed(Y.swapaxes(-1, -2) @ Y)
        return float(np.sqrt(np.einsum("pik,pij,pjk->p", E, Q, E).max()))

    def _solutions(self, R: Array, level: float | None, least: Array, share: float) -> Array | None:
        """Return Bernstein coefficients of solutions at a level a share above the least one."""
        Q: Array | None
        if level is None:
            _, Y, E, _ = self.nodes
            Q = self.modes.observed(Y.swapaxes(-1, -2) @ Y + R)
            at = self.problem.domain.nodes(self.degree)
            squares = np.einsum("pik,pij,pjk->p", E, Q, E) / self.problem.shares(at)
            more = self._more_at_nodes
            top = float((squares + more).max())
            if top > 0:
                wanted = np.maximum(top - more, squares)
                Q *= (wanted / np.maximum(squares, LOWEST**2 * top))[:, None, None] ** (1 - share)
        else:
            levels = np.minimum(least * (1 + BARELY), level)
            Q = riccati(*self._equations(R, levels ** (1 - share) * level**share))
        if Q is None or not np.all(np.isfinite(Q)):
            return None
        return self.problem.domain.interpolated(Q, self.degree)

    def _share(self, level: float | None, least: Array) -> float:
        """Return the share with which the least is missed before there is an R."""
        T, zero, sizes = self.units, np.zeros_like(self.units), []
        for share in SHARES:
            Q = self._solutions(zero, level, least, share)
            missed = None if Q is None else T.T @ self._missed(Q, level)[0] @ T
            sizes.append(np.inf if missed is None else float(np.trace(majorant(missed))))
        return SHARES[int(np.argmin(sizes))]

    def _equations(self, R: Array, levels: Array) -> tuple[Array, Array, Array]:
        """Return A, S and Q of the Riccati equations of levels at the nodes."""
        A, Y, E, F = self._with_outputs(R, levels)
        R = np.zeros_like(R) if self.problem.step else R
        a, b, c = _inverse(levels[:, None, None], F)
        return A + E @ b @ Y, E @ a @ E.swapaxes(-1, -2), Y.swapaxes(-1, -2) @ c @ Y + R

    def _with_outputs(self, R: Array, levels: Array) -> tuple[Array, Array, Array, Array]:
        """Return A, C, E and F of the nodes; of a delta form with R as further outputs.

        They are then those of its bilinear transform, of which the Riccati equation has the same
        solution.
        """
        A, Y, E, F = self.nodes
        step = self.problem.step
        if not step:
            return A, Y, E, F
        Y = np.concatenate([Y, np.sqrt(levels)[:, None, None] * _root(R)], axis=1)
        A, inverse = bilinear(A, step)
        F = _above_zeros(F, len(R)) - step / 2 * Y @ inverse @ E
        return A, Y @ inverse, inverse @ E, F

    def _least(self, R: Array, level: float, low: Array) -> Array | None:
        """Return the least levels at which there are solutions at the nodes, with R.

        None where one is above the level; ``low`` are known to be no more.
        """
        F = self._with_outputs(R, np.full(len(self.nodes[0]), level))[3]
        straight = np.linalg.norm(F, 2, axis=(-2, -1)) * (1 + BARELY)
        low, high = np.maximum(np.maximum(low, LOWEST * level), straight), np.full(len(F), level)
        if low.max() > level or not np.all(has_stabilising(*self._equations(R, high))):
            return None
        # the search begins this close above the last least level
        middle = np.minimum(low * (1 + 1e-3), level)
        while np.any(low < high / (1 + BARELY / 2)):
            there = has_stabilising(*self._equations(R, middle))
            low, high = np.where(there, low, middle), np.where(there, middle, high)
            middle = np.sqrt(low * high)
        return high

    def cover(
        self,
        Q: Array,
        known: Cover | None,
        units: Array | None = None,
        level: float | None = None,
    ) -> Cover:
        """Return what covers the remainder at about the least cost, with a kappa that holds.

        ``units`` are those in which what is missed is judged; by default those of the states.
        ``level`` is that of a gain.
        """
        units = self.units if units is None else units
        rows, columns = (known.rows, known.columns) if known else self._cheapest(Q, units, level)
        H = np.diag(rows)
        kappa = float(np.linalg.eigvalsh(H @ Q @ H).max()) * OVER
        return Cover(rows, columns, max(kappa, TINY))

    def _cheapest(self, Q: Array, units: Array, level: float | None) -> tuple[Array, Array]:
        """Return rows and columns that cover the remainder at about the least cost in units."""
        remainder = self.problem.plant.remainder
        entries = () if remainder is None else remainder.entries
        basis, (W, N, Y, *_) = self.raised
        P = (W + self.problem.step * N).swapaxes(-1, -2) @ np.tensordot(basis, Q, 1)
        V = self.problem.form(self.problem.domain.nodes(self.total))
        a = np.square(units.T @ P).sum(axis=-2).max(axis=0)
        b = np.square(V @ units).sum(axis=-1).max(axis=0)
        if level is None or self.problem.step:
            return cheapest(np.array(entries, dtype=float), a, b)
        # a disturbance takes of the level what a state takes of Y'Y over the level
        share = float(np.square(Y @ units).sum(axis=(-2, -1)).max()) / level**2
        return cheapest(np.array(entries, dtype=float), a, b, share)

    def driving(self, cover: Cover) -> Array:
        """Return the columns of the disturbances as they are scaled."""
        problem, (n, m) = self.problem, self.problem.plant.shape
        columns = cover.columns[n + m :] * problem.scales
        passing = problem.passing(problem.domain.nodes(problem.law.passing_degree))
        if passing is None:
            return np.asarray(columns)
        V = problem.domain.interpolated(
            cover.columns[n : n + m, None] * passing * problem.acting, problem.law.passing_degree
        )
        longest = (V**2).sum(axis=1).max(axis=0)
        return np.asarray(np.sqrt(columns**2 + np.count_nonzero(longest) * longest))

    def _cost(self, Q: Array, both: Array, cover: Cover) -> tuple[Array, Array]:
        """Return what a remainder adds to the inequality at points, and the border's P H."""
        _, (W, N, *_) = self.raised
        step, n = self.problem.step, Q.shape[-1]
        V = self.problem.form(self.problem.domain.nodes(self.total))
        V = cover.columns[: V.shape[1], None] * V
        P = (W + step * N).swapaxes(-1, -2) @ Q
        loss = self._times * (1 + step * cover.kappa) * V.swapaxes(-1, -2) @ V
        return both + loss, P * cover.rows[:n]

    @property
    def _times(self) -> int:
        """How many times what a remainder takes counts: see `proof.Gain`."""
        problem = self.problem
        return 2 if problem.gain and problem.step and problem.law.passes else 1

    def _missed(
        self, coefficients: Array, level: float | None, cover: Cover | None = None
    ) -> tuple[Array, float]:
        """Return the violation of the inequality by each coefficient, and the bound."""
        basis, (W, N, Y, E, F) = self.raised
        Q, step = np.tensordot(basis, coefficients, 1), self.problem.step
        WQ = W @ Q
        both, Yt = WQ @ N, Y.swapaxes(-1, -2)
        both = both + both.swapaxes(-1, -2)
        if step:
            both = both + step * N.swapaxes(-1, -2) @ Q @ N
        border: Array | None = None
        if cover is not None:
            both, border = self._cost(Q, both, cover)
        if level is None:
            bound = float(np.sqrt(max(self._ratios(coefficients).max(), 0.0)))
            if cover is not None:
                bound = self._more(bound, cover)
            missed = self._bernstein(both + Yt @ Y)
            if border is not None:
                PH = self._bernstein(border)
                missed = missed + PH @ PH.swapaxes(-1, -2)
        elif step:
            bound, QE = level, step * Q @ E
            U = WQ @ E + N.swapaxes(-1, -2) @ QE
            missed = self._above_step(level, both, U, QE, border, cover)
        elif not np.any(F):
            bound, QE = level, WQ @ E
            rest = level - (0.0 if cover is None else self.driving(cover) ** 2)
            if np.min(rest) <= 0:
                raise np.linalg.LinAlgError("the remainder takes more than the level")
            moved = (QE / rest) @ QE.swapaxes(-1, -2)
            missed = self._bernstein(both + Yt @ Y / level + moved)
            if border is not None:
                PH = self._bernstein(border)
                missed = missed + PH @ PH.swapaxes(-1, -2)
        else:
            bound, (N, QE, Y, F) = level, map(self._bernstein, (both, WQ @ E, Y, F))
            square = level * np.eye(F.shape[-1])
            if cover is not None:
                square = square - np.diag(self.driving(cover) ** 2)
            corner = np.broadcast_to(square, (len(F), *square.shape))
            missed = self._complement(level, N, QE, corner, Y, F)
            if border is not None:
                PH = self._bernstein(border)
                missed = missed + PH @ PH.swapaxes(-1, -2)
        if self.problem.law.W is not None:
            middle = np.linalg.inv(W.mean(axis=0))
            missed = middle.T @ missed @ middle
        return missed, bound

    def _more(self, bound: float, cover: Cover) -> float:
        """Return the bound with the remainder of the disturbances added."""
        share, driving = float(SHARE), self.driving(cover)
        if not np.any(driving):
            return bound
        more = (1 + 1 / share) * cover.kappa * float(np.sum(driving**2))
        return float(np.sqrt((1 + share) * bound**2 + more))

    def _above_step(
        self,
        level: float,
        both: Array,
        U: Array,
        QE: Array,
        border: Array | None,
        cover: Cover | None,
    ) -> Array:
        """Return the violation of the delta form's lemma by each coefficient; see `proof.Gain`."""
        _, (_, _, Y, E, F) = self.raised
        q = E.shape[-1]
        corner = level * np.eye(q) - E.swapaxes(-1, -2) @ QE
        if cover is not None and border is not None:
            share = self._times * (1 + self.problem.step * cover.kappa)
            corner = corner - share * np.diag(self.driving(cover) ** 2)
            below = QE.swapaxes(-1, -2) * cover.rows
            whole = np.concatenate([border, below], -2)
            whole = self._bernstein(whole)
            squares = whole @ whole.swapaxes(-1, -2)
            n = both.shape[-1]
            both, U, corner = map(self._bernstein, (both, U, corner))
            both, U, corner = (
                both + squares[:, :n, :n],
                U + squares[:, :n, n:],
                corner - squares[:, n:, n:],
            )
            Y, F = map(self._bernstein, (Y, F))
            return self._complement(level, both, U, corner, Y, F)
        both, U, Y, F, corner = map(self._bernstein, (both, U, Y, F, corner))
        return self._complement(level, both, U, corner, Y, F)

    @staticmethod
    def _complement(
        level: float, both: Array, U: Array, corner: Array, Y: Array, F: Array
    ) -> Array:
        """Return both + [U, Y'] [ corner, -F'; -F, level I ]^-1 [U, Y']'."""
        p = Y.shape[-2]
        below = np.concatenate([-F, np.broadcast_to(level * np.eye(p), (len(F), p, p))], -1)
        beside = np.concatenate([corner, -F.swapaxes(-1, -2)], -1)
        middle = np.concatenate([beside, below], -2)
        left = np.concatenate([U, Y.swapaxes(-1, -2)], -1)
        if np.linalg.eigvalsh(middle).min() <= 0:
            raise np.linalg.LinAlgError("the level is below the way straight through")
        return np.asarray(both + left @ np.linalg.solve(middle, left.swapaxes(-1, -2)))

    def _ratios(self, Q: Array) -> Array:
        """Return the ratios of the coefficients of tr E'QE to those of the reference variance.

        Infinite where the latter are not all positive.
        """
        degree, basis, E, shares, more = self.bounded
        squares = np.einsum("pik,pij,pjk->p", E, np.tensordot(basis, Q, 1), E) + more
        coefficients = self.problem.domain.interpolated(squares, degree)
        return coefficients / shares if shares.min() > 0 else np.full_like(coefficients, np.inf)

    def _bernstein(self, values: Array) -> Array:
        return self.problem.domain.interpolated(values, self.total)

    @property
    def total(self) -> int:
        """Degree of the inequality."""
        problem = self.problem
        entering, rows = self.degree + problem.driving_degree, problem.rows
        if not problem.gain:
            squares = [2 * rows, (self.degree + 2 * rows) * bool(problem.step)]
        elif problem.step:
            squares = [self.degree + 2 * rows, rows + entering, problem.driving_degree + entering]
            squares.append(2 * rows)
        elif problem.passes:  # as blocks, nothing is squared
            squares = [problem.left + entering]
        else:
            squares = [2 * rows, 2 * (problem.left + entering)]
        return max(self.degree + problem.degree, *squares)


def made_up(missed: Array, V: Any, inside: Array, E: Array) -> Array:
    """Return shares of modes that make up for what is missed, at about the least cost.

    In modes it is M. A diagonal t with t_i = sum_j |M_ij| y_j / y_i exceeds M for any y > 0, and
    where a mode costs c_i, sum c_i t_i is least with y_i = c_i^(1/2).

    Parameters
    ----------
    missed : (count, n, n) array
    V : (n, n) array
        Modes w as columns.
    inside : (n,) array
        What of w w* a mode's share is.
    E : (n, q) array
        w w* costs |E'w|^2.
    """
    P = np.linalg.inv(V).conj().T / np.sqrt(inside)
    M = np.abs(P.conj().T @ missed @ P)
    cost = np.square(np.abs(V.conj().T @ E)).sum(axis=1)
    y = np.sqrt(cost + LEAST_COST * cost.sum())
    return np.asarray(((M @ y) / y).max(axis=0))


def _root(R: Array) -> Array:
    """Return a root of R without negative eigenvalues, root' root = R."""
    values, V = np.linalg.eigh(R)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * V.T)


def _above_zeros(F: Array, rows: int) -> Array:
    """Return F with rows of zeros below."""
    return np.concatenate([F, np.zeros((len(F), rows, F.shape[-1]))], axis=1)


def _inverse(level: Array | float, F: Array) -> tuple[Array, Array, Array]:
    """Return the blocks a, b, c of the inverse of [g I, -F'; -F, g I]."""
    Ft = F.swapaxes(-1, -2)
    a = np.linalg.inv(level * np.eye(F.shape[-1]) - Ft @ F / level)
    c = np.linalg.inv(level * np.eye(F.shape[-2]) - F @ Ft / level)
    return np.asarray(a), np.asarray(a @ Ft / level), np.asarray(c)


def cheapest(
    entries: Array, a: Array, b: Array, driven: float | None = None
) -> tuple[Array, Array]:
    """Return rows and columns that cover a remainder, of about the least cost.

    Of u and v, their squares, with sum R_ij^2 / (u_i v_j) <= 1 those are looked for that make
    (a'u) (b'v) least, one after the other.

    Parameters
    ----------
    entries : (n, n + m + q) array
        R.
    a, b : (n,), (n + m,) arrays
        What H H' and V'V cost.
    driven : float, optional
        What each disturbance costs; by default as much as it moves.
    """
    squares, known = entries**2, len(b)
    if not entries.any():
        return np.zeros(len(entries)), np.zeros(entries.shape[1])
    moved = squares[:, known:].T @ a
    least = float(((squares[:, :known].T @ a) * b).max()) or TINY
    costs = np.where(moved > 0, least / np.where(moved > 0, moved, 1.0), 1.0)
    b = np.concatenate([b, costs if driven is None else np.full(len(moved), driven)])
    v = 1 / np.maximum(b, TINY)
    for _ in range(40):
        u = _least(squares @ (1 / v), a)
        v = _least(squares.T @ (1 / np.where(u > 0, u, np.inf)), b)
        v = np.where(v > 0, v, np.inf)
    v = np.where(np.isfinite(v), v, 0.0)
    even = np.sqrt(float(b @ v) / max(float(a @ u), TINY))
    return COVERED * np.sqrt(u * even), COVERED * np.sqrt(v / even)


def _least(s: Array, a: Array) -> Array:
    """Return the u with sum s_i / u_i = 1 that makes a'u least."""
    root = np.sqrt(s * a)
    return np.asarray(np.sqrt(s / np.maximum(a, TINY)) * root.sum())


def majorant(matrices: Array) -> Array:
    """Return a Loewner upper bound of the matrices, of nearly the least trace."""
    left = (matrices + matrices.swapaxes(-1, -2)) / 2
    R, sizes = np.zeros(matrices.shape[-2:]), _above(left).sum(axis=-1)
    left = left[np.argsort(-sizes)[: np.count_nonzero(sizes)]]
    for matrix in left:
        if not _positive(R - matrix):
            values, V = np.linalg.eigh(matrix - R)
            R = R + (V * np.maximum(values, 0)) @ V.T
    return R


def _positive(M: Array) -> bool:
    """Whether a symmetric matrix is positive definite; a fifth of the time of its eigenvalues."""
    try:
        np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        return False
    return True


def _above(matrices: Array) -> Array:
    """Eigenvalues of symmetric matrices, or zero where one is negative."""
    return np.asarray(np.maximum(np.linalg.eigvalsh(matrices), 0))


def root(X: Array) -> Array:
    """Return T with T T' = X, of no direction that is lost in rounding."""
    size = np.sqrt(np.maximum(np.diag(X), 0))
    size = np.where(size > 0, size, size.max() or 1.0)
    values, V = np.linalg.eigh(X / np.outer(size, size))
    values = np.maximum(values, SMALL * max(values.max(), SMALL))
    return np.asarray(size[:, None] * V * np.sqrt(values))
