"""Storage functions of sampled loops in floats: Q at samples, and S between them, of a gain.

At a point S is the solution of the Riccati equation of the level, back from the end of a period,

    -S' = N'S + S N + [S E, Y'] [g, -F'; -F, g]^-1 [E'S; Y] + R,  S(T) = G'Q G,  Q = J'S(0) J

with J = [I; K]: see `polefence.proof.claims.storage`. Exponentials of its Hamiltonian matrix are
maps S(T) -> S(0) = theta + phi'S(T) (I - gamma S(T))^-1 phi, of which two make one again: doubling
gives Q (Anderson, 1978). Between points Q and S are interpolated, S in time too, and R makes up
for what that misses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from polefence.lmi.solve.dual_problem import Dual, DualProblem
from polefence.lmi.solve.gramians import (
    BARELY,
    OVER,
    ROOM,
    ROUNDS,
    SHARES,
    majorant,
)
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.response.discrete import exponential
from polefence.response.held import Storing

ALONG = 3  # degree in time
STEPS = 4  # of a stretch; the nodes of a cubic are at 0, 1, 3 and 4 of them
MOST_STRETCHES = 32  # of a period, or of each phase of it
# What twice the stretches must leave of what is missed, to be taken.
FEWER = 0.7
DOUBLINGS = 30  # of periods; what does not settle in 2^30 never does
SETTLED = 1e-13  # change of Q that ends them
HALVINGS = 8  # of the levels between which the least of a point is: to 1.4 %
LOWEST = 0.03  # of a level, where that search begins
ABOVE = (1e-4, 1e-3, 5e-3, 2e-2, 0.1)  # the worst sample: levels that are tried
SLACK = 1e-9  # of S, by which it may rise at a sample
TIME = Domain((2,))


@dataclass(frozen=True, eq=False)
class Map:
    """S(T) -> S(0) = theta + phi'S(T) (I - gamma S(T))^-1 phi, at points."""

    theta: Array
    phi: Array
    gamma: Array

    def of(self, S: Array) -> Array:
        """Return S(0)."""
        eye = np.eye(S.shape[-1])
        S = self.theta + _t(self.phi) @ S @ np.linalg.solve(eye - self.gamma @ S, self.phi)
        return np.asarray((S + _t(S)) / 2)

    def after(self, later: Map) -> Map:
        """Return the map of this time and, after it, a later one."""
        eye = np.eye(self.phi.shape[-1])
        inner = np.linalg.inv(eye - self.gamma @ later.theta)
        theta = self.theta + _t(self.phi) @ later.theta @ inner @ self.phi
        gamma = later.gamma + later.phi @ inner @ self.gamma @ _t(later.phi)
        return Map(
            (theta + _t(theta)) / 2,
            np.asarray(later.phi @ inner @ self.phi),
            (gamma + _t(gamma)) / 2,
        )


Driven = tuple[Array, Array, Array, Array]  # N, E, Y and F at points


def _t(M: Array) -> Array:
    return np.swapaxes(M, -1, -2)


def _map(loop: Driven, level: Array, R: Array, time: float) -> Map:
    """Return the map of a time in which N, E, Y and F act."""
    N, E, Y, F = loop
    k, (p, q) = N.shape[-1], F.shape[-2:]
    inner = np.zeros((*F.shape[:-2], p + q, p + q))
    inner[..., range(p + q), range(p + q)] = level[:, None]
    inner[..., :q, q:], inner[..., q:, :q] = -_t(F), -F
    inner = np.linalg.inv(inner)
    both = np.concatenate([E, np.zeros((*E.shape[:-1], p))], axis=-1)
    shown = np.concatenate([np.zeros((*Y.shape[:-2], q, k)), Y], axis=-2)
    own = N + both @ inner @ shown
    H = np.concatenate(
        [
            np.concatenate([own, both @ inner @ _t(both)], axis=-1),
            np.concatenate([-(_t(shown) @ inner @ shown + R), -_t(own)], axis=-1),
        ],
        axis=-2,
    )
    X = exponential(-time * H)
    inverse = np.asarray(np.linalg.inv(X[..., :k, :k]))
    theta, gamma = X[..., k:, :k] @ inverse, -inverse @ X[..., :k, k:]
    return Map((theta + _t(theta)) / 2, inverse, (gamma + _t(gamma)) / 2)


def power(one: Map, count: int) -> Map:
    """Return the map of so many times a time."""
    whole: Map | None = None
    while count:
        if count % 2:
            whole = one if whole is None else one.after(whole)
        one, count = one.after(one), count // 2
    if whole is None:
        raise ValueError("a map of no time")
    return whole


def settled(once: Map) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return Q = once(Q) at points, and at which there is one."""
    good: npt.NDArray[np.bool_] = np.full(len(once.phi), True)
    Q, eye = once.theta, np.eye(once.phi.shape[-1])
    for _ in range(DOUBLINGS):
        both = np.concatenate([once.phi, once.theta], axis=1)
        finite = np.asarray(np.isfinite(both).all(axis=(1, 2)))
        inner = np.where(finite[:, None, None], eye - once.gamma @ once.theta, 0.0)
        good = np.asarray(good & finite & (np.linalg.det(inner) > 0))  # where it has no root yet
        if not good.any():
            break
        calm = Map(
            *(np.where(good[:, None, None], M, 0.0) for M in (once.theta, once.phi, once.gamma))
        )
        once = calm.after(calm)
        change, Q = np.abs(once.theta - Q).max(axis=(1, 2)), once.theta
        if np.all(change <= SETTLED * np.abs(Q).max(axis=(1, 2))):
            break
    return Q, np.asarray(good & (np.abs(once.phi).max(axis=(1, 2)) < 1))


@dataclass(frozen=True, eq=False)
class StorageSearch:
    """The search for R at one degree of Q and S in the parameters."""

    problem: DualProblem
    degree: int

    @property
    def storing(self) -> Storing:
        """The plant in continuous time."""
        if self.problem.storing is None:
            raise np.linalg.LinAlgError("nothing is held between samples")
        return self.problem.storing

    def least(self, worst: float) -> Dual | None:
        """Return the dual at the first level that has one, above the worst sample."""
        *below, most = ABOVE
        loosest = self.proving(worst * (1 + most))
        if loosest is None:
            return None
        found = (self.proving(worst * (1 + above)) for above in below)
        return next((dual for dual in found if dual is not None), loosest)

    def proving(self, level: float) -> Dual | None:
        """Return the dual of a level, in as many stretches as are worth it."""
        level *= 1 - ROOM
        least = self._least(level)
        if least is None:
            return None
        levels, size, stretches = self._best(least, level), np.inf, 1
        while stretches <= MOST_STRETCHES:
            found = self._solved(levels, self._none, stretches)
            now = np.inf if found is None else self._size(*found, level)
            if now > FEWER * size:
                return None
            dual = None if found is None else self._grown(level, levels, found, stretches)
            if dual is not None:
                return dual
            size, stretches = now, 2 * stretches
        return None

    # --- at the nodes of Q -----------------------------------------------------------------------

    def _loops(self, alpha: Array) -> tuple[tuple[Array, Array, Array, Array], Array, Array, Array]:
        """Return N, E, Y and F of all phases, J = [W; Z], W and G at points."""
        problem, storing = self.problem, self.storing
        at = alpha if problem.box is None else problem.box.alpha(problem.domain, alpha)
        A, B = problem.plant.at(at)
        n, m = problem.plant.shape
        form = problem.form(alpha)
        G = np.zeros((len(alpha), n, n + m))
        G[:, :, :n] = np.eye(n)
        G[:, storing.first :] += problem.step * np.concatenate([A, B], axis=2)[:, storing.first :]
        return storing.at(alpha), form, form[:, :n], G

    @cached_property
    def _nodes(self) -> tuple[tuple[Array, Array, Array, Array], Array, Array, Array]:
        return self._loops(self.problem.domain.nodes(self.degree))

    @cached_property
    def _unit(self) -> tuple[Array, Array]:
        """Points in time of a stretch, and what takes values there to those of the slope."""
        at = TIME.nodes(ALONG)[:, 1]
        powers = np.arange(ALONG + 1)
        values = at[:, None] ** powers
        slopes = powers * at[:, None] ** np.maximum(powers - 1, 0)
        return at, slopes @ np.linalg.inv(values)

    def _solved(
        self, levels: Array, slack: tuple[Array, Array, Array], stretches: int
    ) -> tuple[Array, Array] | None:
        """Return Q (count, n, n) and S (stretches, count, times, k, k) at the nodes; None of none.

        Parameters
        ----------
        slack : R, that of the storage; and what V falls by before and after a sample
        """
        R, before, after = slack
        G, count = self._nodes[-1], STEPS * stretches
        phases = self._phases(levels, R, count)
        Q, good = self._settled([power(one, count) for one in phases], before, after)
        if not good.all():
            return None
        every = [_t(G) @ Q @ G + before]
        for one in reversed(phases):
            for _ in range(count):
                every.append(one.of(every[-1]))
        S = np.array(every[::-1])
        nodes = STEPS * np.arange(stretches * len(phases))[:, None] + STEPS * self._unit[0]
        return Q, np.swapaxes(S[np.rint(nodes).astype(int)], 1, 2)

    def _phases(self, levels: Array, R: Array, count: int) -> list[Map]:
        """Return the map of one of so many steps of each phase of a period, at the nodes."""
        N, E, Y, F = self._nodes[0]
        return [
            _map((N[k], E[k], Y[k], F[k]), levels, R, span / count)
            for k, span in enumerate(self._spans)
        ]

    @property
    def _spans(self) -> list[float]:
        """Lengths of the phases [s]."""
        return [float(x) for x in np.diff([0.0, *self.storing.ends]) * self.problem.step]

    def _settled(
        self, phases: list[Map], before: Array, after: Array
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return Q at the nodes, and at which there is one."""
        _, form, W, G = self._nodes
        shape, eye = (len(W), *before.shape), np.eye(len(before))
        period = Map(np.broadcast_to(before, shape), np.broadcast_to(eye, shape), np.zeros(shape))
        for one in reversed(phases):
            period = one.after(period)
        J = form @ np.linalg.inv(W)
        theta = _t(J) @ period.theta @ J + after
        return settled(Map(theta, G @ period.phi @ J, G @ period.gamma @ _t(G)))

    def _least(self, level: float) -> Array | None:
        """Return the least levels at the nodes, from above; None where one is above the level."""
        R, before, after = self._none
        count = len(self._nodes[1])
        high, low = np.full(count, level), np.full(count, level * LOWEST)
        if not self._settled(self._phases(high, R, 1), before, after)[1].all():
            return None
        for _ in range(HALVINGS):
            middle = np.sqrt(low * high)
            good = self._settled(self._phases(middle, R, 1), before, after)[1]
            low, high = np.where(good, low, middle), np.where(good, middle, high)
        return high

    @property
    def _none(self) -> tuple[Array, Array, Array]:
        n, m = self.problem.plant.shape
        zero = np.zeros((n + m, n + m))
        return zero, zero, zero[:n, :n]

    # --- between them ----------------------------------------------------------------------------

    def _missed(self, Q: Array, S: Array, level: float) -> tuple[Array, Array, Array]:
        """Return how each coefficient violates the inequalities: of storage, before and after."""
        domain, degree = self.problem.domain, self.degree
        Q, S = (
            domain.interpolated(Q, degree),
            np.array([domain.interpolated(one, degree) for one in S]),
        )
        return self._of_storage(S, level), *self._at_samples(Q, S[-1][:, -1], S[0][:, 0])

    def _of_storage(self, S: Array, level: float) -> Array:
        domain, degree = self.problem.domain, self.degree + 1
        at = domain.nodes(degree)
        loops, basis = self.storing.at(at), domain.basis(at, self.degree)
        each = len(S) // len(self.storing.ends)
        missed = list[Array]()
        for k, one in enumerate(S):
            N, E, Y, F = (M[k // each][:, None] for M in loops)
            here = np.einsum("pc,ctij->ptij", basis, one)
            slope = np.einsum("st,ptij->psij", self._unit[1], here) * (
                each / self._spans[k // each]
            )
            SN = here @ N
            inner = self._coefficients(slope + SN + _t(SN), degree)
            border = np.concatenate(
                [here @ E, np.broadcast_to(_t(Y), (*here.shape[:2], *_t(Y).shape[-2:]))], axis=-1
            )
            border = self._coefficients(border, degree)
            q = E.shape[-1]
            F = domain.interpolated(F[:, 0], degree)[:, None]
            supply = np.zeros((*F.shape[:2], border.shape[-1], border.shape[-1]))
            supply[..., range(border.shape[-1]), range(border.shape[-1])] = level
            supply[..., :q, q:], supply[..., q:, :q] = -_t(F), -F
            inner = inner + border @ np.linalg.inv(supply) @ _t(border)
            missed.append(inner.reshape(-1, *inner.shape[2:]))
        return np.concatenate(missed)

    def _coefficients(self, values: Array, degree: int) -> Array:
        """Return Bernstein coefficients of values at nodes of the box and of time."""
        along = np.swapaxes(values, 0, 1)
        along = np.swapaxes(TIME.interpolated(along, ALONG), 0, 1)
        return self.problem.domain.interpolated(along, degree)

    def _at_samples(self, Q: Array, last: Array, first: Array) -> tuple[Array, Array]:
        """Return the same of S(T) - G'Q G and W'Q W - [W; Z]'S(0) [W; Z]."""
        domain = self.problem.domain
        degree = self.degree + 2 * max(1, self.problem.law.degree)
        at = domain.nodes(degree)
        basis = domain.basis(at, self.degree)
        _, form, W, G = self._loops(at)
        Q, last, first = (np.tensordot(basis, M, 1) for M in (Q, last, first))
        before = domain.interpolated(_t(G) @ Q @ G - last, degree)
        after = domain.interpolated(_t(form) @ first @ form - _t(W) @ Q @ W, degree)
        middle = np.linalg.inv(W.mean(axis=0))
        return before, middle.T @ after @ middle

    def _best(self, least: Array, level: float) -> Array:
        """Return levels of the nodes, between the least there and the one that is claimed.

        Of some shares of the way between, that is taken with which the least is missed.
        """
        low = np.minimum(least * (1 + BARELY), level)
        tried = [low ** (1 - share) * level**share for share in SHARES]
        found = [self._solved(levels, self._none, 1) for levels in tried]
        sizes = [np.inf if one is None else self._size(*one, level) for one in found]
        return np.asarray(tried[int(np.argmin(sizes))])

    def _size(self, Q: Array, S: Array, level: float) -> float:
        units = self._units(S)
        missed = self._missed(Q, S, level)[0] / units / units[:, None]
        return float(np.linalg.eigvalsh(missed).max())

    @staticmethod
    def _units(S: Array) -> Array:
        """Return the roots of the mean diagonal of S."""
        sizes = np.sqrt(np.maximum(np.diagonal(S.mean(axis=(0, 1, 2))), 0.0))
        return np.where(sizes > 0, sizes, sizes.max() or 1.0)

    def _grown(
        self, level: float, levels: Array, first: tuple[Array, Array], stretches: int
    ) -> Dual | None:
        """Let R grow until every coefficient is positive; None if it does not end."""
        units, n, over = self._units(first[1]), len(first[0][0]), OVER
        own = units[:n]
        R, before, after = self._none
        before, after = SLACK * np.diag(units**2), SLACK * np.diag(own**2)
        for _ in range(ROUNDS):
            found = self._solved(levels, (R, before, after), stretches)
            if found is None:
                return None
            stored, late, early = self._missed(*found, level)
            stored, late = (M / units / units[:, None] for M in (stored, late))
            early = early / own / own[:, None]
            if max(np.linalg.eigvalsh(M).max() for M in (stored, late, early)) < 0:
                return self._dual(*found, level)
            room = ROOM * np.abs(stored).max()
            R = R + (over * majorant(stored) + room * np.eye(len(units))) * units * units[:, None]
            before = before + over * majorant(late) * units * units[:, None]
            after = after + over * majorant(early) * own * own[:, None]
            over *= OVER
        return None

    def _dual(self, Q: Array, S: Array, level: float) -> Dual:
        domain, degree = self.problem.domain, self.degree
        each = len(S) // len(self.storing.ends)
        stretches, begin = list[tuple[float, Array]](), 0.0
        for k, end in enumerate(self.storing.ends):
            for j in range(each):
                one = self._coefficients(S[k * each + j], degree)
                stretches.append((begin + (end - begin) * (j + 1) / each, one))
            begin = end
        return Dual(domain.interpolated(Q, degree), degree, level, storage=tuple(stretches))
