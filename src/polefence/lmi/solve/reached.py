"""What disturbances of bounded energy reach, in floats: X at samples, and P between them.

At a point P is the least of the inequalities of `polefence.proof.claims.reached`: of a sampled loop
P' = N P + P N' + E E' from P = J Q J' on, and W Q W' = G P G' when the period ends, a Lyapunov
equation. All of it is linear. Between points and along time P is interpolated, and noise in each
stretch, and a little at samples, make up for what that misses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.lmi.solve.dual_problem import Dual
from polefence.lmi.solve.gramians import OVER, ROOM, ROUNDS, majorant
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

NEAR = 1e-3  # of the worst sample: a level so near it ends the halving of stretches
MOST_VAIN = 2  # halvings in a row that lower no level: after one, the next did of a van


def _t(M: Array) -> Array:
    return np.swapaxes(M, -1, -2)


@dataclass(frozen=True, eq=False)
class Motion:
    """P(0) -> P(T) = phi P(0) phi' + noise, at points."""

    phi: Array
    noise: Array

    def of(self, P: Array) -> Array:
        """Return P(T)."""
        P = self.phi @ P @ _t(self.phi) + self.noise
        return np.asarray((P + _t(P)) / 2)

    def then(self, later: Motion) -> Motion:
        """Return the motion of this time and, after it, a later one."""
        return Motion(later.phi @ self.phi, later.of(self.noise))


def motion_of(N: Array, square: Array, time: float) -> Motion:
    """Return the motion of a time in which P' = N P + P N' + square (Van Loan)."""
    k = N.shape[-1]
    H = np.zeros((len(N), 2 * k, 2 * k))
    H[:, :k, :k], H[:, :k, k:], H[:, k:, k:] = N, square, -_t(N)
    X = exponential(time * H)
    noise = X[:, :k, k:] @ _t(X[:, :k, :k])
    return Motion(X[:, :k, :k], (noise + _t(noise)) / 2)


def summed(M: Array, noise: Array) -> Array | None:
    """Return X = M X M' + noise at points; None where one is not stable."""
    X = noise
    for _ in range(DOUBLINGS):
        more = M @ X @ _t(M)
        X, M = X + more, M @ M
        if not (np.isfinite(X).all() and np.isfinite(M).all()):
            return None
        if np.all(np.abs(more).max(axis=(1, 2)) <= SETTLED * np.abs(X).max(axis=(1, 2))):
            break
    return X if np.abs(M).max() < 1 else None


@dataclass(frozen=True, eq=False)
class ReachedSearch(PeriodSearch):
    """The search for noise at one degree of Q and P in the parameters."""

    def least(self, worst: float) -> Dual | None:
        """Return the dual in as many stretches as bring it near the worst sample."""
        return self._of_stretches(worst * (1 + NEAR))

    def proving(self, level: float) -> Dual | None:
        """Return a dual of less than the level."""
        dual = self._of_stretches(level * (1 - ROOM))
        return dual if dual is not None and dual.level < level else None

    def _of_stretches(self, enough: float) -> Dual | None:
        """Return the best dual, of stretches that are halved until its level is enough."""
        cuts: Cuts = ((0,),) * len(self._spans)
        best: Dual | None = None
        vain = 0  # halvings after the best
        while sum(map(len, cuts)) <= MOST_STRETCHES and vain < MOST_VAIN:
            dual, vain = self._grown(cuts), vain + 1
            if dual is not None and (best is None or dual.level < best.level):
                best, vain = dual, 0
            if best is not None and best.level <= enough:
                return best
            # what is missed at nodes already is missed along time
            most, times = max(self._sizes(cuts)), self._sizes(cuts, at_nodes=True)
            chosen = [LARGE * most < size < np.inf for size in times]
            if not any(chosen):
                return best
            cuts = halved(cuts, chosen)
        return best

    # --- at the nodes of Q -----------------------------------------------------------------------

    def _solved(self, slack: tuple[Array, Array, Array], cuts: Cuts) -> tuple[Array, Array] | None:
        """Return Q (count, n, n) and P (stretches, count, times, k, k) at the nodes.

        Parameters
        ----------
        slack : noise in each stretch; and what a sample adds to P, and to X when it comes
        """
        noise, early, late = slack
        loops, form, W, G = self._nodes
        steps = list[Motion]()
        for (phase, time), own in zip(self._places(cuts), noise, strict=True):
            N, E = loops[0][phase], loops[1][phase]
            steps.append(motion_of(N, E @ _t(E) + own, time / STEPS))
        shape = form.shape[0], form.shape[1], form.shape[1]
        period = Motion(np.broadcast_to(np.eye(shape[1]), shape), np.zeros(shape) + early)
        for one in steps:
            for _ in range(STEPS):
                period = period.then(one)
        inverse: Array = np.asarray(np.linalg.inv(W), dtype=float)
        X = summed(G @ period.phi @ form @ inverse, G @ period.noise @ _t(G) + late)
        if X is None:
            return None
        Q = inverse @ X @ _t(inverse)
        begin, P = form @ Q @ _t(form) + early, list[Array]()
        for one in steps:
            every = [begin]
            for _ in range(STEPS):
                every.append(one.of(every[-1]))
            P.append(np.stack([every[k] for k in NODES], axis=1))
            begin = every[-1]
        return (Q + _t(Q)) / 2, np.array(P)

    # --- between them ----------------------------------------------------------------------------

    def _missed(self, Q: Array, P: Array, cuts: Cuts) -> tuple[list[Array], Array, Array]:
        """Return how each coefficient violates the inequalities: between samples, and at them."""
        domain, degree = self.problem.domain, self.degree
        Q, P = domain.interpolated(Q, degree), self._interpolated(P)
        high = degree + 2 * max(1, self.problem.law.degree)
        law, W, G, (Qs, first, last), interpolated = self._known(high, Q, P[0][:, 0], P[-1][:, -1])
        early = interpolated(law @ Qs @ _t(law) - first)
        late = interpolated(G @ last @ _t(G) - W @ Qs @ _t(W))
        return self._between(P, cuts, self.degree + 1), early, late

    def _interpolated(self, P: Array) -> Array:
        """Return coefficients in the parameters of values at the nodes of stretches."""
        return np.array([self.problem.domain.interpolated(one, self.degree) for one in P])

    def _between(self, P: Array, cuts: Cuts, degree: int | None = None) -> list[Array]:
        """Return how coefficients of P in time, and in the parameters, violate the inequality.

        Of no degree P are values at the nodes, and so is what it returns but for time.
        """
        domain, at_nodes = self.problem.domain, degree is None
        degree = self.degree if degree is None else degree
        at = domain.nodes(degree)
        loops, missed = self.storing.at(at), list[Array]()
        basis = np.eye(len(at)) if at_nodes else domain.basis(at, self.degree)
        for (phase, time), one in zip(self._places(cuts), P, strict=True):
            N, E = (M[phase][:, None] for M in loops[:2])
            here = np.einsum("pc,ctij->ptij", basis, one)
            NP = N @ here
            slope = np.einsum("st,ptij->psij", slopes(), here) / time
            inner = along(NP + _t(NP) + E @ _t(E) - slope)
            inner = inner if at_nodes else domain.interpolated(inner, degree)
            missed.append(inner.reshape(-1, *inner.shape[2:]))
        return missed

    def _level(self, P: Array, cuts: Cuts) -> float:
        """Return the root of the largest coefficient of Y P Y', of values at the nodes."""
        domain, degree = self.problem.domain, self.degree + 2
        at = domain.nodes(degree)
        Y, basis, largest = self.storing.at(at)[2], domain.basis(at, self.degree), 0.0
        for (phase, _), one in zip(self._places(cuts), self._interpolated(P), strict=True):
            here = along(np.einsum("pc,ctij->ptij", basis, one))
            shown = Y[phase][:, None] @ here @ _t(Y[phase][:, None])
            largest = max(largest, float(domain.interpolated(shown, degree).max()))
        return float(largest**0.5)

    def _sizes(self, cuts: Cuts, at_nodes: bool = False) -> list[float]:
        """Return how much is missed in each stretch, times its length."""
        found = self._without(cuts)
        if found is None:
            return [np.inf]
        units = self._units(found[1], cuts)
        missed = self._between(found[1], cuts) if at_nodes else self._missed(*found, cuts)[0]
        times = (time for _, time in self._places(cuts))
        every = (np.linalg.eigvalsh(M / units / units[:, None]).max() for M in missed)
        return [max(float(size), 0.0) * time for size, time in zip(every, times, strict=True)]

    def _without(self, cuts: Cuts) -> tuple[Array, Array] | None:
        """Return Q and P without noise."""
        n, m = self.problem.plant.shape
        zero = np.zeros((n + m, n + m))
        return self._solved((np.array([zero] * sum(map(len, cuts))), zero, zero[:n, :n]), cuts)

    def _units(self, P: Array, cuts: Cuts) -> Array:
        """Return the roots of the mean diagonal of P."""
        times = [time for _, time in self._places(cuts)]
        return _roots(np.average(P.mean(axis=(1, 2)), axis=0, weights=times))

    def _grown(self, cuts: Cuts) -> Dual | None:
        """Let noise grow until every coefficient is positive; None if it does not end."""
        found = self._without(cuts)
        if found is None:
            return None
        units, over = self._units(found[1], cuts), OVER
        W = self._nodes[2]
        own = _roots((W @ found[0] @ _t(W)).mean(axis=0))
        square, squares = units * units[:, None], own * own[:, None]
        noise = np.zeros((len(found[1]), *square.shape))
        early, late = SLACK * np.diag(units**2), SLACK * np.diag(own**2)
        for _ in range(ROUNDS):
            found = self._solved((noise, early, late), cuts)
            if found is None:
                return None
            stored, first, last = self._missed(*found, cuts)
            stored, first, last = [M / square for M in stored], first / square, last / squares
            if max(np.linalg.eigvalsh(M).max() for M in (*stored, first, last)) < 0:
                return self._dual(*found, cuts)
            for k, M in enumerate(stored):
                room = ROOM * np.abs(M).max()
                noise[k] += (over * majorant(M) + room * np.eye(len(units))) * square
            early = early + over * majorant(first) * square
            late = late + over * majorant(last) * squares
            over *= OVER
        return None

    def _dual(self, Q: Array, P: Array, cuts: Cuts) -> Dual:
        domain, degree = self.problem.domain, self.degree
        return Dual(
            domain.interpolated(Q, degree),
            degree,
            self._level(P, cuts),
            storage=self._stretches(P, cuts),
            reached=True,
        )


def _roots(M: Array) -> Array:
    """Return the roots of a diagonal; a zero counts as the largest."""
    sizes = np.sqrt(np.maximum(np.diagonal(M), 0.0))
    return np.where(sizes > 0, sizes, sizes.max() or 1.0)
