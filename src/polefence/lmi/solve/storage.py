"""Storage functions of sampled loops in floats: Q at samples, and what it is between them.

At a point V = y'S y solves the Riccati equation of the level, back from the end of a period,

    -S' = N'S + S N + [S E, Y'] [g, -F'; -F, g]^-1 [E'S; Y],  S(T) = G'Q G,  Q = J'S(0) J

with J = L W^-1: see `polefence.proof.claims.storage`. Exponentials of its Hamiltonian matrix are
maps S(T) -> S(0) = theta + phi'S(T) (I - gamma S(T))^-1 phi, of which two make one again: doubling
gives Q (Anderson, 1978). Between points, and in time, S is interpolated, or P = S_xx^-1, c and R,
and slack makes up for what that misses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from polefence.lmi.solve.dual_problem import Dual
from polefence.lmi.solve.gramians import BARELY, OVER, ROOM, ROUNDS, SHARES, majorant
from polefence.lmi.solve.stretches import (
    DOUBLINGS,
    LARGE,
    MOST_STRETCHES,
    NODES,
    SETTLED,
    SLACK,
    STEPS,
    Cuts,
    PeriodSearch,
    along,
    halved,
    slopes,
)
from polefence.plant.system import Array
from polefence.response.discrete import exponential

# Of the levels between which the least of a point is, to 1.4 %; with 11 and 13 parts are no fewer.
HALVINGS = 8
LOWEST = 0.03  # of a level, where that search begins
ABOVE = (1e-4, 1e-3, 5e-3, 2e-2, 0.1)  # the worst sample: levels that are tried


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


def map_of(loop: Driven, level: Array, slack: Array, time: float, first: int) -> Map:
    """Return the map of a time in which N, E, Y and F act.

    ``slack`` (k, k) is what moves the ``first`` states, and shows all others, besides.
    """
    N, E, Y, F = loop
    k, (p, q) = N.shape[-1], F.shape[-2:]
    inner = np.zeros((*F.shape[:-2], p + q, p + q))
    inner[..., range(p + q), range(p + q)] = level[:, None]
    inner[..., :q, q:], inner[..., q:, :q] = -_t(F), -F
    inner = np.linalg.inv(inner)
    both = np.concatenate([E, np.zeros((*E.shape[:-1], p))], axis=-1)
    shown = np.concatenate([np.zeros((*Y.shape[:-2], q, k)), Y], axis=-2)
    own = N + both @ inner @ shown
    noise, more = np.zeros((k, k)), np.zeros((k, k))
    noise[:first, :first], more[first:, first:] = slack[:first, :first], slack[first:, first:]
    H = np.concatenate(
        [
            np.concatenate([own, both @ inner @ _t(both) + noise], axis=-1),
            np.concatenate([-(_t(shown) @ inner @ shown + more), -_t(own)], axis=-1),
        ],
        axis=-2,
    )
    X = exponential(-time * H)
    inverse = np.asarray(np.linalg.inv(X[..., :k, :k]))
    theta, gamma = X[..., k:, :k] @ inverse, -inverse @ X[..., :k, k:]
    return Map((theta + _t(theta)) / 2, inverse, (gamma + _t(gamma)) / 2)


def form_of(S: Array, first: int) -> Array:
    """Return [P, c; c', R] of S (..., k, k), or S where none is ``first``."""
    if not first:
        return S
    P = np.linalg.inv(S[..., :first, :first])
    c = -P @ S[..., :first, first:]
    R = S[..., first:, first:] + S[..., first:, :first] @ c
    top = np.concatenate([P, c], axis=-1)
    form = np.concatenate([top, np.concatenate([_t(c), R], axis=-1)], axis=-2)
    return np.asarray((form + _t(form)) / 2)


def moved(form: Array, first: int) -> Array:
    """Return T = [P, c; 0, I]: y = T [xi; k] with xi = P^-1 (x - c k)."""
    T = form.copy()
    T[..., first:, :] = np.eye(form.shape[-1])[first:]
    return T


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
class StorageSearch(PeriodSearch):
    """The search for R at one degree of Q and S in the parameters."""

    inverse: bool = False

    @property
    def first(self) -> int:
        """How many of y are in P."""
        return self.storing.first * self.inverse

    def least(self, worst: float) -> Dual | None:
        """Return the dual at the first level that has one, above the worst sample."""
        *below, most = ABOVE
        loosest = self.proving(worst * (1 + most))
        if loosest is None:
            return None
        found = (self.proving(worst * (1 + above)) for above in below)
        return next((dual for dual in found if dual is not None), loosest)

    def proving(self, level: float) -> Dual | None:
        """Return the dual of a level, of either form: inverse where the other misses along time."""
        level *= 1 - ROOM
        least = self._least(level)
        if least is None:
            return None
        dual, steep = self._of_form(level, least)
        if dual is None and steep:
            dual = replace(self, inverse=True)._of_form(level, least)[0]
        return dual

    def _of_form(self, level: float, least: Array) -> tuple[Dual | None, bool]:
        """Return the dual in as many stretches as are worth it; else whether more may be."""
        cuts: Cuts = ((0,),) * len(self._spans)
        while sum(map(len, cuts)) <= MOST_STRETCHES:
            levels, most = self._best(least, level, cuts)
            dual = self._grown(level, levels, cuts)
            if dual is not None:
                return dual, False
            # what is missed at nodes already is missed along time
            along = self._sizes(levels, level, cuts, at_nodes=True)
            chosen = [LARGE * most < size < np.inf for size in along]
            if not any(chosen):
                return None, False
            cuts = halved(cuts, chosen)
        return None, True

    # --- at the nodes of Q -----------------------------------------------------------------------

    def _solved(
        self, levels: Array, slack: tuple[Array, Array, Array], cuts: Cuts
    ) -> tuple[Array, Array] | None:
        """Return Q (count, n, n) and [P, c; c', R] (stretches, count, times, k, k) at the nodes.

        Parameters
        ----------
        slack : of the storage in each stretch; and what V falls by before and after a sample
        """
        along, before, after = slack
        G = self._nodes[-1]
        places = self._places(cuts)
        steps = [
            self._map(phase, levels, own, time / STEPS)
            for (phase, time), own in zip(places, along, strict=True)
        ]
        Q, good = self._settled([power(one, STEPS) for one in steps], before, after)
        if not good.all():
            return None
        end, S = _t(G) @ Q @ G + before, list[Array]()
        for one in reversed(steps):
            every = [end]
            for _ in range(STEPS):
                every.append(one.of(every[-1]))
            S.append(np.stack([every[STEPS - k] for k in NODES], axis=1))
            end = every[-1]
        return Q, form_of(np.array(S[::-1]), self.first)

    def _map(self, phase: int, levels: Array, slack: Array, time: float) -> Map:
        """Return the map of a part of a phase, at the nodes."""
        N, E, Y, F = (M[phase] for M in self._nodes[0])
        return map_of((N, E, Y, F), levels, slack, time, self.first)

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
        Q, good = settled(Map(theta, G @ period.phi @ J, G @ period.gamma @ _t(G)))
        S, first = _t(G) @ Q @ G + before, self.storing.first
        for one in reversed(phases):  # beyond what is finite one is negative
            S = one.of(S)
            moving = np.where(good[:, None, None], S[:, :first, :first], 0.0)
            good = np.asarray(good & (np.linalg.eigvalsh(moving).min(axis=1) > 0))
        return Q, good

    def _whole(self, levels: Array) -> list[Map]:
        """Return the maps of phases without slack."""
        none = self._none[0]
        return [self._map(k, levels, none, span) for k, span in enumerate(self._spans)]

    def _least(self, level: float) -> Array | None:
        """Return the least levels at the nodes, from above; None where one is above the level."""
        _, before, after = self._none
        count = len(self._nodes[1])
        high, low = np.full(count, level), np.full(count, level * LOWEST)
        if not self._settled(self._whole(high), before, after)[1].all():
            return None
        for _ in range(HALVINGS):
            middle = np.sqrt(low * high)
            good = self._settled(self._whole(middle), before, after)[1]
            low, high = np.where(good, low, middle), np.where(good, middle, high)
        return high

    @property
    def _none(self) -> tuple[Array, Array, Array]:
        n, m = self.problem.plant.shape
        zero = np.zeros((n + m, n + m))
        return zero, zero, zero[:n, :n]

    # --- between them ----------------------------------------------------------------------------

    def _missed(
        self, Q: Array, S: Array, level: float, cuts: Cuts
    ) -> tuple[list[Array], Array, Array]:
        """Return how each coefficient violates the inequalities: of storage, before and after."""
        domain, degree = self.problem.domain, self.degree
        Q = domain.interpolated(Q, degree)
        S = np.array([domain.interpolated(one, degree) for one in S])
        return self._of_storage(S, level, cuts, self.degree + 1), *self._at_samples(
            Q, S[-1][:, -1], S[0][:, 0]
        )

    def _of_storage(
        self, S: Array, level: float, cuts: Cuts, degree: int | None = None
    ) -> list[Array]:
        """Return how coefficients of S in time, and in the parameters, violate the inequality.

        Of no degree S are values at the nodes, and so is what it returns but for time.
        """
        domain, at_nodes = self.problem.domain, degree is None
        degree = self.degree if degree is None else degree
        at = domain.nodes(degree)
        loops = self.storing.at(at)
        basis = np.eye(len(at)) if at_nodes else domain.basis(at, self.degree)

        def coefficients(values: Array) -> Array:
            values = along(values)
            return values if at_nodes else domain.interpolated(values, degree)

        missed, places = list[Array](), self._places(cuts)
        first, q = self.first, loops[1].shape[-1]
        for (phase, time), one in zip(places, S, strict=True):
            N, E, Y, F = (M[phase][:, None] for M in loops)
            here = np.einsum("pc,ctij->ptij", basis, one)
            slope = np.einsum("st,ptij->psij", slopes(), here) / time
            if first:
                slope[..., first:, first:] *= -1
                T = moved(here, first)
                NT, driven, shown = N @ T, np.broadcast_to(E, (*T.shape[:-1], q)), Y @ T
                inner = NT + _t(NT) - slope
            else:
                RN, driven = here @ N, here @ E
                shown = np.broadcast_to(Y, (*here.shape[:2], *Y.shape[-2:]))
                inner = slope + RN + _t(RN)
            inner = coefficients(inner)
            border = coefficients(np.concatenate([driven, _t(shown)], axis=-1))
            F = (F[:, 0] if at_nodes else domain.interpolated(F[:, 0], degree))[:, None]
            supply = np.zeros((*F.shape[:2], border.shape[-1], border.shape[-1]))
            supply[..., range(border.shape[-1]), range(border.shape[-1])] = level
            supply[..., :q, q:], supply[..., q:, :q] = -_t(F), -F
            inner = inner + border @ np.linalg.inv(supply) @ _t(border)
            missed.append(inner.reshape(-1, *inner.shape[2:]))
        return missed

    def _at_samples(self, Q: Array, last: Array, start: Array) -> tuple[Array, Array]:
        """Return the same of the inequalities before and after a sample."""
        first = self.first
        law, W, G, (Qs, form), interpolated = self._known(2 * self.degree + 1, Q, last)
        if first:
            own = form.copy()
            own[:, :first, first:], own[:, first:, :first] = 0.0, 0.0
            QGT = interpolated(Qs @ G @ moved(form, first))
            before = _t(QGT) @ np.linalg.solve(interpolated(Qs), QGT) - interpolated(own)
        else:
            before = interpolated(_t(G) @ Qs @ G - form)
        degree = self.degree + 2 * max(1, self.problem.law.degree)
        law, W, G, (Qs, form), interpolated = self._known(degree, Q, start)
        held = law[:, first:]
        after = interpolated(_t(held) @ form[:, first:, first:] @ held - _t(W) @ Qs @ W)
        if first:
            off = interpolated(law[:, :first] - form[:, :first, first:] @ held)
            after = after + _t(off) @ np.linalg.solve(interpolated(form[:, :first, :first]), off)
        middle = np.linalg.inv(W.mean(axis=0))
        return before, middle.T @ after @ middle

    def _best(self, least: Array, level: float, cuts: Cuts) -> tuple[Array, float]:
        """Return levels of the nodes, and the most that is missed with them in a stretch.

        They are between the least there and the one that is claimed: of some shares of the way
        between, that is taken with which the least is missed.
        """
        low = np.minimum(least * (1 + BARELY), level)
        tried = [low ** (1 - share) * level**share for share in SHARES]
        sizes = [max(self._sizes(levels, level, cuts)) for levels in tried]
        k = int(np.argmin(sizes))
        return tried[k], sizes[k]

    def _sizes(
        self, levels: Array, level: float, cuts: Cuts, at_nodes: bool = False
    ) -> list[float]:
        """Return how much is missed in each stretch, times its length."""
        found = self._without(levels, cuts)
        if found is None:
            return [np.inf]
        units = self._units(found[1], cuts)
        if at_nodes:
            missed = self._of_storage(found[1], level, cuts)
        else:
            missed = self._missed(*found, level, cuts)[0]
        times = (time for _, time in self._places(cuts))
        every = (np.linalg.eigvalsh(M / units / units[:, None]).max() for M in missed)
        return [max(float(size), 0.0) * time for size, time in zip(every, times, strict=True)]

    def _without(self, levels: Array, cuts: Cuts) -> tuple[Array, Array] | None:
        """Return Q and S without slack."""
        R, before, after = self._none
        return self._solved(levels, (np.array([R] * sum(map(len, cuts))), before, after), cuts)

    def _units(self, S: Array, cuts: Cuts) -> Array:
        """Return the roots of the mean diagonal of S."""
        times = [time for _, time in self._places(cuts)]
        mean = np.average(S.mean(axis=(1, 2)), axis=0, weights=times)
        sizes = np.sqrt(np.maximum(np.diagonal(mean), 0.0))
        return np.where(sizes > 0, sizes, sizes.max() or 1.0)

    def _grown(self, level: float, levels: Array, cuts: Cuts) -> Dual | None:
        """Let R grow until every coefficient is positive; None if it does not end."""
        first = self._without(levels, cuts)
        if first is None:
            return None
        units, over, states = self._units(first[1], cuts), OVER, self.first
        own = np.sqrt(np.diagonal(first[0].mean(axis=0)))
        square, squares = units * units[:, None], own * own[:, None]
        back = np.diag(units)
        if states:  # before a sample V is told of [xi; k]
            back = units[:, None] * np.linalg.inv(moved(first[1][-1][:, -1].mean(axis=0), states))
        slack = np.zeros((len(first[1]), *square.shape))
        before, after = SLACK * back.T @ back, SLACK * np.diag(own**2)
        for _ in range(ROUNDS):
            found = self._solved(levels, (slack, before, after), cuts)
            if found is None:
                return None
            stored, late, early = self._missed(*found, level, cuts)
            stored, late, early = [M / square for M in stored], late / square, early / squares
            if max(np.linalg.eigvalsh(M).max() for M in (*stored, late, early)) < 0:
                return self._dual(*found, level, cuts)
            for k, M in enumerate(stored):
                room = ROOM * np.abs(M).max()
                slack[k] += (over * majorant(M) + room * np.eye(len(units))) * square
            before = before + over * back.T @ majorant(late) @ back
            after = after + over * majorant(early) * squares
            over *= OVER
        return None

    def _dual(self, Q: Array, S: Array, level: float, cuts: Cuts) -> Dual:
        Q = self.problem.domain.interpolated(Q, self.degree)
        storage = self._stretches(S, cuts)
        return Dual(Q, self.degree, level, storage=storage, inverse=self.inverse)
