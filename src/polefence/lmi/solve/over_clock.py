"""Dual Lyapunov polynomials of loops whose periods have any length between two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np

from polefence.law.laws import right_divide
from polefence.lmi.solve.common import Common, common
from polefence.lmi.solve.dual_problem import ENDS, Cover, Dual, Ticks, beside
from polefence.lmi.solve.gramians import ROOM, SHARES, Interpolation, cheapest
from polefence.plant.system import Array

NARROW, WIDEST = 2e-3, 1.0  # gaps of centres; a level is then 0.1 % above the least
GAPS = (2e-3, 2e-2, 0.2)  # where no level is asked for
WIDER = (0.5, 0.1)  # of what is between the least and a level, the gap of a centre


@dataclass(frozen=True, eq=False)
class OverClock(Interpolation):
    """The search for R where Q has to do for periods of any length.

    At a node Q is the centre of those that do for the shortest and the longest period of each part
    of the clock: see `polefence.lmi.solve.common`. R makes up for what that misses.
    """

    gap: float = NARROW

    @cached_property
    def parts(self) -> list[Ticks]:
        """The parts of the periods."""
        return [] if self.problem.means is None else list(self.problem.means.ticks)

    @property
    def along(self) -> int:
        """Degree of what moves in the length of a period."""
        return max(ticks.degrees[1] for ticks in self.parts)

    def plain(self, k: int) -> int:
        """Degree in the parameters of what moves, of M, of V or of c."""
        return max(ticks.plain[k] for ticks in self.parts)

    @property
    def degrees(self) -> tuple[int, int]:
        """Of the inequality, in the parameters and in the length of a period."""
        law = self.problem.law
        rows = self.plain(0) + law.degree
        plain = max(self.degree + self.problem.left + rows, self.degree + 2 * rows)
        return max(plain, self.plain(1) + 2 * law.degree), 2 * self.along

    @property
    def degrees_of_noise(self) -> tuple[int, int]:
        """The same of what the noise adds."""
        return max(self.degree + self.plain(2), self.plain(3)), self.along

    @cached_property
    def looped(self) -> list[tuple[Array, Array, tuple[Array, ...]]]:
        """For each the weights, Q's basis and the loops at the nodes of the inequality."""
        return [self._at(ticks, self.degrees) for ticks in self.parts]

    @cached_property
    def driven(self) -> list[tuple[Array, Array, tuple[Array, ...]]]:
        """The same at those of what the noise adds."""
        return [self._at(ticks, self.degrees_of_noise) for ticks in self.parts]

    def _at(self, ticks: Ticks, degrees: tuple[int, int]) -> tuple[Array, Array, tuple[Array, ...]]:
        plain, theta = self.problem.domain.nodes(degrees[0]), ENDS.nodes(degrees[1])
        alpha = _grid(plain, theta)
        own = np.repeat(plain, len(theta), axis=0)
        basis = self.problem.domain.basis(own, self.degree)
        return own, basis, self.problem.ticked(ticks, alpha)

    def _coefficients(self, values: Array, degrees: tuple[int, int]) -> Array:
        """Return Bernstein coefficients of what has these values at the nodes."""
        plain, count = self.problem.domain, degrees[1] + 1
        table = values.reshape(-1, count, *values.shape[1:])
        table = plain.interpolated(table, degrees[0])
        turned = ENDS.interpolated(np.swapaxes(table, 0, 1), degrees[1])
        return np.asarray(np.swapaxes(turned, 0, 1).reshape(values.shape))

    def least(self, worst: float) -> Dual | None:  # noqa: ARG002
        """Return the least dual of some gaps: what is missed asks for one of its own."""
        some = (replace(self, gap=gap)._grown(None) for gap in GAPS)
        return min(filter(None, some), key=attrgetter("level"), default=None)

    def proving(self, level: float) -> Dual | None:
        """Return the dual below the level: of what is between the least and it, Q takes a share."""
        narrow = self._centres(np.zeros_like(self.units))
        if narrow is None:
            return None
        more = max(float(loops[-1].max()) for *_, loops in self.driven)
        whole = (level * (1 - ROOM)) ** 2 - float(narrow.cost.max()) - more
        if whole <= 0:
            return None
        gaps = (share * whole / float(narrow.base.max()) for share in WIDER)
        for gap in dict.fromkeys(min(max(gap, NARROW), WIDEST) for gap in gaps):
            dual = replace(self, gap=gap)._grown(None)
            if dual is not None and dual.level < level:
                return dual
        return None

    def _centres(self, R: Array) -> Common | None:
        """Return the centres at the nodes of Q, None where one has none."""
        F, M, W, times = self.ends
        step, longest = self.problem.step, times[-1]
        # a short period makes up for less
        costs = M + step * (times / longest)[:, None, None] * R
        found = common(F, costs, W, self.gap)
        return found if np.all(found.found) else None

    @cached_property
    def ends(self) -> tuple[Array, Array, Array, Array]:
        """Loops and costs of the shortest and longest periods at the nodes, noise; lengths."""
        problem = self.problem
        nodes = problem.domain.nodes(self.degree)
        every, noise, times = list[tuple[Array, Array]](), list[Array](), list[float]()
        for ticks in self.parts:
            for end, time in zip(np.eye(2), ticks.lengths, strict=True):
                if time in times[-1:]:  # where the part before ended
                    continue
                alpha = beside(nodes, np.tile(end, (len(nodes), 1)))
                W, N, Y, E, *_ = problem.ticked(ticks, alpha)
                if problem.law.W is not None:
                    N, Y = right_divide(N, W), right_divide(Y, W)
                F = np.eye(N.shape[-1]) + problem.step * N
                F = F * np.exp(problem.decay * time * problem.step)
                every.append((F, problem.step * Y.swapaxes(-1, -2) @ Y))
                noise.append(E @ E.swapaxes(-1, -2))
                times.append(time)
        F, M = (np.stack(each, axis=1) for each in zip(*every, strict=True))
        return F, M, np.mean(noise, axis=0), np.array(times)

    def _solutions(
        self,
        R: Array,
        level: float | None,
        least: Array,  # noqa: ARG002
        share: float,  # noqa: ARG002
    ) -> Array | None:
        centres = self._centres(R) if level is None else None
        if centres is None:
            return None
        return self.problem.domain.interpolated(centres.Q, self.degree)

    def _share(self, level: float | None, least: Array) -> float:  # noqa: ARG002
        return SHARES[0]

    def _cheapest(
        self,
        Q: Array,
        units: Array,
        level: float | None,  # noqa: ARG002 -- of gains, which have none of a clock
    ) -> tuple[Array, Array]:
        entries, sizes = list[Array](), list[tuple[Array, Array]]()
        for ticks, (own, basis, (W, N, *_)) in zip(self.parts, self.looped, strict=True):
            known = self.problem.entries(ticks)
            entries += [] if known is None else [known]
            P = (W + self.problem.step * N).swapaxes(-1, -2) @ np.tensordot(basis, Q, 1)
            V = self.problem.form(own)
            a = np.square(units.T @ P).sum(axis=-2).max(axis=0)
            sizes.append((a, np.square(V @ units).sum(axis=-1).max(axis=0)))
        a, b = (np.max(each, axis=0) for each in zip(*sizes, strict=True))
        return cheapest(np.max(entries, axis=0), a, b)

    def _missed(
        self, coefficients: Array, level: float | None, cover: Cover | None = None
    ) -> tuple[Array, float]:
        if level is not None:
            raise np.linalg.LinAlgError("a gain has no periods of any length")
        step, every, longest = self.problem.step, list[Array](), self.parts[-1].theta
        degrees = self.degrees
        for ticks, (own, basis, (W, N, Y, *_)) in zip(self.parts, self.looped, strict=True):
            Q = np.tensordot(basis, coefficients, 1)
            P = (W + step * N).swapaxes(-1, -2) @ Q
            both = W @ Q @ N
            both = both + both.swapaxes(-1, -2) + step * N.swapaxes(-1, -2) @ Q @ N
            both = both + Y.swapaxes(-1, -2) @ Y
            if self.problem.decay:
                both = both + self._slower(ticks, len(own))[:, None, None] * (W @ Q @ W)
            if cover is not None:
                form = self.problem.form(own)
                V = cover.columns[: form.shape[1], None] * form
                both = both + (1 + step * cover.kappa) * V.swapaxes(-1, -2) @ V
            missed = self._coefficients(both, degrees)
            if cover is not None:
                PH = self._coefficients(P * cover.rows[: P.shape[-1]], degrees)
                missed = missed + PH @ PH.swapaxes(-1, -2)
            if self.problem.law.W is not None:
                middle = np.linalg.inv(W.mean(axis=0))
                missed = middle.T @ missed @ middle
            # a short period makes up for less
            every.append(missed * (longest / ticks.theta))
        bound = float(np.sqrt(max(self._ratios(coefficients).max(), 0.0)))
        return np.concatenate(every), bound

    def _slower(self, ticks: Ticks, count: int) -> Array:
        """Return what a decay asks for beside Q, over the sample time: see `proof.Decay`."""
        rate, along = 2 * self.problem.decay * self.problem.step, self.degrees[1]
        theta, begin = ENDS.nodes(along) @ ticks.lengths, ticks.lengths[0]
        kept = np.exp(-rate * begin) * (1 - rate * (theta - begin))
        return np.tile((1 - kept) / self.problem.step, count // (along + 1))

    def _ratios(self, Q: Array) -> Array:
        every, (plain, along) = list[Array](), self.degrees_of_noise
        for ticks, (_, basis, (_, _, _, E, _, more)) in zip(self.parts, self.driven, strict=True):
            squares = np.einsum("pik,pij,pjk->p", E, np.tensordot(basis, Q, 1), E) + more
            theta = np.tile(ENDS.nodes(along) @ ticks.lengths, len(squares) // (along + 1))
            degrees = (plain, along)
            every.append(
                self._coefficients(squares * theta, degrees) / self._coefficients(theta, degrees)
            )
        return np.concatenate(every)


def _grid(plain: Array, theta: Array) -> Array:
    """Return weights of the corners of the box with the period, at every pair of nodes."""
    one = np.repeat(plain, len(theta), axis=0)
    other = np.tile(theta, (len(plain), 1))
    return beside(one, other)
