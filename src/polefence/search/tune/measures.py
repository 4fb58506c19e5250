"""What a search measures of laws at points: the level, limits, region, speed, and size of gains.

Everything comes as rows, one function at one point, scaled so that one is much. What must be kept
is kept where it is zero or less; beyond that it grows as a logarithm, so that a start far outside
does not drown the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from polefence.base.effort import spend
from polefence.lmi.conditions.target import Side
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.requirements.slopes import Channel
from polefence.requirements.specification import Specification
from polefence.response.modes import Modes
from polefence.response.stationary import growth as growth_of
from polefence.search.tune.descent import Rows
from polefence.search.tune.poles import growth, sides_of, slopes
from polefence.search.tune.smooth import curve_of, smooth_growth
from polefence.search.tune.starts import Sizes
from polefence.search.tune.unknowns import At, Unknowns

REGION, LIMITS, LEVEL, SMALL = "region", "limits", "level", "small"  # phases of a search
MARGIN = 1e-5  # by which what must be kept is kept: 1e-4 costs the shown car as much
# Times the best level: within it the smallest law is looked for. The gain of a car's law falls from
# 7.24 to 3.48 within 1e-5 of the level, to 3.32 within 5e-4.
WIDE = 1.00005
# Operations of one point, and times n^3: 0.1 ms for n = 4, measured with three signals.
ONE, EACH = 8e4, 300.0
# The same of a bound for periods in any order, times n^4 of each: a quarter of 14 ms for n = 9 and
# two, so that such a search may take four times as long as others.
IN_ANY_ORDER = 200.0


@dataclass(frozen=True, eq=False)
class Found:
    """Values of one measure, with slopes.

    Attributes
    ----------
    values : (rows,) array
    points : (rows,) array of int
    turned : callable
        Returns `dK`, which is worked out only where it is asked for.
    inner : bool
    mixed : (rows, rows) array, optional
        What slopes with respect to the law are of these.
    """

    values: Array
    points: Any
    turned: Callable[[], Array]
    inner: bool = False
    mixed: Array | None = None

    @cached_property
    def dK(self) -> Array:
        """Slopes with respect to the gain, (rows, m, n), or (rows, m, r).

        To that of all states, or to that of what is measured where ``inner``.
        """
        return self.turned()


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked of a law.

    Attributes
    ----------
    plant : UncertainPlant
    unknowns : Unknowns
    minimise : Specification, tuple of Side, or None
        Sides are of a region that grows; None is for the law's own size.
    limits : tuple of Specification
    region : Region
    sizes : Sizes
        Typical of the plant.
    fastest : float
        What poles must not exceed [1/s]; infinite where something else bounds the gain.
    """

    plant: UncertainPlant
    unknowns: Unknowns
    minimise: Specification | tuple[Side, ...] | None
    limits: tuple[Specification, ...]
    region: Region
    sizes: Sizes
    fastest: float

    @cached_property
    def sides(self) -> list[Side]:
        """The region's inequalities."""
        return sides_of(self.region, self.sizes.rate, float(self.plant.step))

    @property
    def requirements(self) -> tuple[Specification, ...]:
        """Those on signals or the law, what is minimised first."""
        first = (self.minimise,) if isinstance(self.minimise, Specification) else ()
        return (*first, *self.limits)

    def unit(self, level: float) -> float:
        """Return what a level is measured in; a decay rate about zero in a rate of the plant."""
        minimise = self.minimise
        rated = isinstance(minimise, tuple) and not any(np.any(side.M1) for side in minimise)
        if not np.isfinite(level):  # of a start for which there is none
            return 1.0
        return max(abs(level), self.sizes.rate) if rated else abs(level) or 1.0

    def at(self, alpha: Array) -> Points:
        """Return what is asked at points alpha (count, N)."""
        d = self.unknowns.states
        none = np.zeros((len(alpha), 0, self.plant.shape[0]))
        empty = np.zeros((len(alpha), 0, 0))
        asked = [requirement.channel(self.plant, alpha) for requirement in self.requirements]
        A, B = self.plant.at(alpha)
        D = np.zeros((len(alpha), 0, self.plant.shape[1]))
        bare = Channel(A, B, np.swapaxes(none, 1, 2), none, D, empty)
        scaled = _shared([channel.in_units(d) for channel in (bare, *asked)])
        return Points(self, alpha, self.unknowns.at(alpha), scaled)


@dataclass(frozen=True, eq=False)
class Points:
    """A task at points of the family.

    Attributes
    ----------
    task : Task
    alpha : (count, N) array
    unknowns : At
    channels : tuple of Channel
        The plant alone, and that of each requirement; states in their sizes.
    """

    task: Task
    alpha: Array
    unknowns: At
    channels: tuple[Channel, ...]

    def modes(self, K: Array) -> Modes | None:
        """Return the modes under gains of all states (count, m, n), None where they overflow."""
        A = self.channels[0].A + self.channels[0].B @ K
        good = np.all(np.isfinite(A)) and np.abs(A).max() < 1e100
        return Modes(A, float(self.task.plant.step)) if good else None

    def evaluable(self, modes: Modes) -> Any:
        """Return at which points limits and level are, (count,): most ask for stability."""
        poles, minimise = modes.poles, self.task.minimise
        turning = isinstance(minimise, tuple) and any(np.any(side.M1) for side in minimise)
        if not self.task.requirements and not turning:
            return np.full(len(poles), True)
        rates = growth_of(poles, modes.step)
        return np.all(rates < -1e-12 * np.abs(poles).max(axis=1)[:, None], axis=1)

    def requirement(self, k: int, K: Array, inner: Array, modes: Modes) -> Found:
        """Return the k-th requirement, at gains of all states, and of what is measured."""
        channel = self.channels[k + 1]
        if channel.beside:
            spend(len(K) * IN_ANY_ORDER * (1 + len(channel.beside)) * channel.A.shape[-1] ** 4)
        if channel.length != 1:  # of a clock that is not perfect
            modes = Modes(channel.A + channel.B @ K, modes.step)
        C, F = self.unknowns.seen(channel.reads)
        channel = self.unknowns.opened(channel) if channel.reads else channel
        passing = None if F is None else inner @ F
        measure = self.task.requirements[k].slopes(channel.closed(K, modes, passing))
        if F is None or channel.S is None:
            slopes = partial(channel.slopes, measure)
            return Found(measure.values, measure.points, slopes, mixed=measure.mixed)
        seen = C, F

        def turned() -> Array:
            of_C, of_F = (np.swapaxes(M[measure.points], 1, 2) for M in seen)
            return np.asarray(
                channel.slopes(measure) @ of_C + channel.passing_slopes(measure) @ of_F
            )

        return Found(measure.values, measure.points, turned, inner=True, mixed=measure.mixed)

    def side(self, side: Side, modes: Modes, kappa: float | None = None) -> Found:
        """Return the growth of a side at every pole of the upper half-plane.

        Parameters
        ----------
        kappa : float, optional
            Of one that is smooth, where the side has one.
        """
        B = self.channels[0].B
        curve = None if kappa is None else curve_of(side, self.task.sizes.rate)
        if kappa is not None and curve is not None:
            values, dA = smooth_growth(side, curve, modes, kappa)
            up = np.swapaxes(B, 1, 2)
            return Found(values, np.arange(len(values)), lambda: up @ dA)
        points, which = np.nonzero(modes.poles.imag >= 0)
        values, dx, dy = growth(side, modes.poles[points, which])
        return Found(values, points, lambda: slopes(modes, B, points, which, dx, dy))

    def speed(self, modes: Modes) -> Found:
        """Return the sizes of the poles, of the fastest that is allowed."""
        points, which = np.nonzero(modes.poles.imag >= 0)
        poles = modes.poles[points, which]
        size, fastest = np.maximum(np.abs(poles), np.finfo(float).tiny), self.task.fastest

        def turned() -> Array:
            dx, dy = poles.real / size / fastest, poles.imag / size / fastest
            return slopes(modes, self.channels[0].B, points, which, dx, dy)

        return Found(size / fastest, points, turned)

    def entries(self, K: Array, largest: Array) -> Found:
        """Return the magnitudes of the entries of gains, of the largest that is allowed of each."""
        points, i, j = np.nonzero(np.broadcast_to(np.isfinite(largest), K.shape))
        dK, most = np.zeros((len(points), *K.shape[1:])), largest[i, j]
        dK[np.arange(len(points)), i, j] = np.sign(K[points, i, j]) / most
        return Found(np.abs(K[points, i, j]) / most, points, lambda: dK, inner=True)

    def size(self, K: Array) -> Found:
        """Return the norms of gains in typical units."""
        unknowns = self.task.unknowns
        weight = unknowns.signals / unknowns.inputs[:, None]
        values = np.sqrt(((K * weight) ** 2).sum(axis=(1, 2)))
        dK = K * weight**2 / np.where(values > 0, values, 1.0)[:, None, None]
        return Found(values, np.arange(len(K)), lambda: dK, inner=True)

    def bounds(
        self, K: Array, modes: Modes, kappa: float | None = None
    ) -> list[tuple[Found, float]]:
        """Return what loops must keep, but for requirements: kept where zero or less; margins."""
        measures = [(self.side(side, modes, kappa), MARGIN) for side in self.task.sides]
        if np.isfinite(self.task.fastest):
            measure = self.speed(modes)
            measures.append((replace(measure, values=measure.values - 1), 0.0))
        largest = self.task.unknowns.largest
        if np.any(np.isfinite(largest)):
            measure = self.entries(K, largest)
            measures.append((replace(measure, values=measure.values - 1), MARGIN))
        return measures

    def limited(self, K: Array, inner: Array, modes: Modes) -> list[tuple[Found, float]]:
        """Return the limits, kept where zero or less, and their margins."""
        first = len(self.task.requirements) - len(self.task.limits)
        measures = []
        for k, specification in enumerate(self.task.limits):
            measure = self.requirement(first + k, K, inner, modes)
            measures.append((_beyond(measure, specification.at_most or 1.0), MARGIN))
        return measures

    def level(self, K: Array, inner: Array, modes: Modes, kappa: float | None = None) -> Found:
        """Return what is minimised, at gains of all states, and of what is measured."""
        if self.task.minimise is None:
            return self.size(inner)
        if isinstance(self.task.minimise, tuple):
            measures = [self.side(side, modes, kappa) for side in self.task.minimise]
            values, points = (
                np.concatenate([getattr(measure, key) for measure in measures])
                for key in ("values", "points")
            )
            return Found(
                values, points, lambda: np.concatenate([measure.dK for measure in measures])
            )
        return self.requirement(0, K, inner, modes)

    def rows(
        self,
        theta: Array,
        phase: str,
        unit: float = 1.0,
        kappa: float | None = None,
        most: float = np.inf,
    ) -> Rows | None:
        """Return everything that a phase of a search minimises and keeps; None where it cannot be.

        Parameters
        ----------
        unit : float
            Of what is minimised, so that it is about one.
        kappa : float, optional
            Of regions that are smooth: in their own phase, and of one that is to be small.
        most : float
            What the level may be while the law is made small.
        """
        inner = self.unknowns.gains(theta)
        K = inner @ self.unknowns.C
        modes = self.modes(K)
        spend(len(K) * (ONE + EACH * K.shape[-1] ** 3), 1)
        if modes is None or not np.all(np.isfinite(modes.left)):
            return None
        measures = self.bounds(inner, modes, kappa if phase == REGION else None)
        if phase != REGION:
            if not np.all(self.evaluable(modes)):
                return None
            measures += self.limited(K, inner, modes)
        kept = [_kept(measure, margin) for measure, margin in measures]
        if phase == LEVEL:
            level = self.level(K, inner, modes, kappa)
            kept.insert(0, _scaled(level, unit))
        elif phase == SMALL:
            kept.insert(0, _scaled(self.size(inner), unit))
            if self.task.minimise is not None:
                level = self.level(K, inner, modes)
                kept.append(_kept(_less(level, most), 0.0))
        return self._rows(kept, phase in (LEVEL, SMALL))

    def _rows(self, measures: Sequence[Found], first: bool) -> Rows | None:
        """Return all rows; the first alone are the objective, or all."""
        count, parts = len(self.alpha), []
        for k, measure in enumerate(measures):
            dK = (
                measure.dK
                if measure.inner
                else measure.dK @ np.swapaxes(self.unknowns.C[measure.points], 1, 2)
            )
            objective = np.full(len(measure.values), k == 0 or not first)
            slope = self.unknowns.slopes(measure.points, dK)
            slope = slope if measure.mixed is None else measure.mixed @ slope
            parts.append((measure.values, slope, measure.points + k * count, objective))
        rows = Rows(*(np.concatenate(part) for part in zip(*parts, strict=True)))
        finite = np.all(np.isfinite(rows.values)) and np.all(np.isfinite(rows.slopes))
        return rows if finite else None

    def worst(self, K: Array, inner: Array) -> Array:
        """Return the worst of each measure at each point, (measures, count): the level first.

        What must be kept follows, zero or less where it is, in shares of its limit. Infinite where
        it cannot be evaluated.
        """
        modes = self.modes(K)
        if modes is None:
            return np.full((2, len(K)), np.inf)
        good = self.evaluable(modes)
        some = self if np.all(good) else self[good]
        evaluated = Modes(modes.A[good], modes.step)
        bounds = [_largest(measure, len(K)) for measure, _ in self.bounds(inner, modes)]
        rest = [np.full(len(K), np.inf) for _ in range(1 + len(self.task.limits))]
        if np.any(good):
            measures = [some.level(K[good], inner[good], evaluated)]
            measures += [measure for measure, _ in some.limited(K[good], inner[good], evaluated)]
            for row, measure in zip(rest, measures, strict=True):
                row[good] = _largest(measure, int(good.sum()))
        return np.array([rest[0], *bounds, *rest[1:]])

    def __getitem__(self, some: Any) -> Points:
        at = self.unknowns[some]
        return replace(
            self,
            alpha=self.alpha[some],
            unknowns=at,
            channels=_shared([channel[some] for channel in self.channels]),
        )


def _shared(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """Return channels with one array for one noise, so that its covariance is found once."""
    shared = list[Channel]()
    for channel in channels:
        same = [old.E for old in shared if np.array_equal(old.E, channel.E)]
        shared.append(replace(channel, E=same[0]) if same else channel)
    return tuple(shared)


def _largest(measure: Found, count: int) -> Array:
    largest = np.full(count, -np.inf)
    np.maximum.at(largest, measure.points, measure.values)
    return largest


def _kept(measure: Found, margin: float) -> Found:
    """Return values with their margin, beyond zero as logarithms."""
    values = measure.values + margin
    above = np.maximum(values, 0.0)
    bent = np.where(values > 0, np.log1p(above), values)
    return _flatter(measure, bent, 1.0, 1 + above)


def _scaled(measure: Found, unit: float) -> Found:
    """Return values in a unit, beyond two of them as logarithms."""
    share = measure.values / unit
    above = np.maximum(share - 1, 0.0)
    bent = np.where(share > 1, 1 + np.log1p(above), share)
    return _flatter(measure, bent, unit, 1 + above)


def _flatter(measure: Found, values: Array, unit: float, each: Array) -> Found:
    """Return other values, whose slopes are divided by a unit, and each by a number of its own."""
    mixed = measure.mixed
    mixed = mixed if mixed is None else mixed * each / each[:, None]
    return replace(
        measure, values=values, turned=lambda: measure.dK / unit / each[:, None, None], mixed=mixed
    )


def _beyond(measure: Found, limit: float) -> Found:
    """Return by how much values are beyond a limit, in shares of it."""
    return replace(measure, values=measure.values / limit - 1, turned=lambda: measure.dK / limit)


def _less(measure: Found, level: float) -> Found:
    """Return values less a level, in shares of it."""
    size = abs(level) or 1.0
    values = (measure.values - level) / size
    return replace(measure, values=values, turned=lambda: measure.dK / size)
