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
from polefence.response.held import Storing

ALONG = 3  # degree in time
MOST_STRETCHES = 32  # of a period, or of each phase of it
# What twice the stretches must leave of what is missed, to be taken.
FEWER = 0.7
DOUBLINGS = 60  # of periods; 2^60 are not lived to see
SETTLED = 1e-13  # change of Q that ends them
HALVINGS = 12  # of the levels between which the least of a point is: to 0.2 %
LOWEST = 1e-3  # of a level, where that search begins
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
    from scipy.linalg import expm

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
    X = expm(-time * H)
    inverse = np.linalg.inv(X[..., :k, :k])
    theta, gamma = X[..., k:, :k] @ inverse, -inverse @ X[..., :k, k:]
    return Map((theta + _t(theta)) / 2, inverse, (gamma + _t(gamma)) / 2)


def settled(once: Map) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return Q = once(Q) at points, and at which there is one."""
    good: npt.NDArray[np.bool_] = np.ones(len(once.phi), dtype=bool)
    Q = once.theta
    for _ in range(DOUBLINGS):
        bad = ~np.isfinite(once.phi).all(axis=(1, 2)) | ~np.isfinite(once.theta).all(axis=(1, 2))
        inner = np.where(bad[:, None, None], 0.0, once.gamma @ once.theta)
        good &= ~bad & (np.linalg.eigvals(inner).real.max(axis=1) < 1)
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
        grown = (self.proving(worst * (1 + above)) for above in (1e-4, 1e-3, 5e-3, 2e-2, 0.1))
        return next((dual for dual in grown if dual is not None), None)

    def proving(self, level: float) -> Dual | None:
        """Return the dual of a level."""
        level *= 1 - ROOM
        least = self._least(level)
        if least is None:
            return None
        for share in self._shares(level, least):
            for stretches in self._stretches(level, least, share):
                dual = self._grown(level, least, share, stretches)
                if dual is not None:
                    return dual
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
        G = self._nodes[-1]
        phases = self._phases(levels, R)
        Q, good = self._settled(phases, before, after)
        if not good.all():
            return None
        S, every = _t(G) @ Q @ G + before, list[Array]()
        for loop, span, one in reversed(phases):
            for k in reversed(range(stretches)):
                left = 1 - (k + self._unit[0]) / stretches  # of the phase
                here = [_map(loop, levels, R, span * x).of(S) if x > 0 else S for x in left]
                every.append(np.stack(here, axis=1))
            S = one.of(S)
        return Q, np.array(every[::-1])

    def _phases(self, levels: Array, R: Array) -> list[tuple[Driven, float, Map]]:
        """Return what acts in each phase of a period at the nodes, how long, and its map."""
        N, E, Y, F = self._nodes[0]
        phases = list[tuple[Driven, float, Map]]()
        for k, span in enumerate(self._spans):
            loop = N[k], E[k], Y[k], F[k]
            phases.append((loop, span, _map(loop, levels, R, span)))
        return phases

    @property
    def _spans(self) -> list[float]:
        """Lengths of the phases [s]."""
        return [float(x) for x in np.diff([0.0, *self.storing.ends]) * self.problem.step]

    def _settled(
        self, phases: list[tuple[Driven, float, Map]], before: Array, after: Array
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return Q at the nodes, and at which there is one."""
        _, form, W, G = self._nodes
        shape, eye = (len(W), *before.shape), np.eye(len(before))
        period = Map(np.broadcast_to(before, shape), np.broadcast_to(eye, shape), np.zeros(shape))
        for *_, one in reversed(phases):
            period = one.after(period)
        J = form @ np.linalg.inv(W)
        theta = _t(J) @ period.theta @ J + after
        return settled(Map(theta, G @ period.phi @ J, G @ period.gamma @ _t(G)))

    def _least(self, level: float) -> Array | None:
        """Return the least levels at the nodes, from above; None where one is above the level."""
        R, before, after = self._none
        count = len(self._nodes[1])
        high, low = np.full(count, level), np.full(count, level * LOWEST)
        if not self._settled(self._phases(high, R), before, after)[1].all():
            return None
        for _ in range(HALVINGS):
            middle = np.sqrt(low * high)
            good = self._settled(self._phases(middle, R), before, after)[1]
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

    def _levels(self, least: Array, level: float, share: float) -> Array:
        return np.asarray(np.minimum(least * (1 + BARELY), level) ** (1 - share) * level**share)

    def _shares(self, level: float, least: Array) -> list[float]:
        """Return the share of the way to the level with which the least is missed."""
        sizes = list[float]()
        for share in SHARES:
            found = self._solved(self._levels(least, level, share), self._none, 1)
            sizes.append(np.inf if found is None else self._size(*found, level))
        return [SHARES[int(np.argmin(sizes))]]

    def _size(self, Q: Array, S: Array, level: float) -> float:
        units = self._units(S)
        return float(np.trace(majorant(self._missed(Q, S, level)[0] / units / units[:, None])))

    @staticmethod
    def _units(S: Array) -> Array:
        """Return the roots of the mean diagonal of S."""
        sizes = np.sqrt(np.maximum(np.diagonal(S.mean(axis=(0, 1, 2))), 0.0))
        return np.where(sizes > 0, sizes, sizes.max() or 1.0)

    def _stretches(self, level: float, least: Array, share: float) -> list[int]:
        """Return how many stretches a phase is to have: twice as many while they are worth it."""
        levels, count, size = self._levels(least, level, share), 1, np.inf
        while count <= MOST_STRETCHES:
            found = self._solved(levels, self._none, count)
            now = np.inf if found is None else self._size(*found, level)
            if now > FEWER * size:
                return [count // 2]
            count, size = 2 * count, now
        return [MOST_STRETCHES]

    def _grown(self, level: float, least: Array, share: float, stretches: int) -> Dual | None:
        """Let R grow until every coefficient is positive; None if it does not end."""
        levels, over = self._levels(least, level, share), OVER
        found = self._solved(levels, self._none, stretches)
        if found is None:
            return None
        units, n = self._units(found[1]), len(found[0][0])
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
