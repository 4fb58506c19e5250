"""What a search measures of laws at points: the level, limits, region, speed, and size of gains.

Everything comes as rows, one function at one point, scaled so that one is much. What must be kept
is kept where it is zero or less; beyond that it grows as a logarithm, so that a start far outside
does not drown the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from itertools import count
from typing import Any

import numpy as np

from polefence.base.effort import spend
from polefence.base.kernel import kernel
from polefence.base.team import ALONE, Team
from polefence.lmi.conditions.target import Side
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.requirements.slopes import Channel
from polefence.requirements.specification import Specification
from polefence.response.modes import Modes
from polefence.response.stationary import growth as growth_of
from polefence.search.tune.compiled import Plan, knows
from polefence.search.tune.descent import Rows
from polefence.search.tune.poles import growth, sides_of, slopes
from polefence.search.tune.smooth import Curve, curve_of, smooth_growth
from polefence.search.tune.starts import Sizes
from polefence.search.tune.unknowns import At, Unknowns
from polefence.search.tune.wanted import (
    AT_MOST,
    ENTRIES,
    IN_UNITS,
    KEPT,
    NOISE,
    OTHER,
    SIDE,
    SIZE,
    SMOOTH_SIDE,
    SPEED,
    Wanted,
)

REGION, LIMITS, LEVEL, SMALL = "region", "limits", "level", "small"  # phases of a search
BOUNDS = SIDE, SPEED, ENTRIES  # what loops must keep that are not stable, too
WORST = "worst"  # asks for the worst of each measure alone
MARGIN = 1e-5  # by which what must be kept is kept: 1e-4 costs the shown car as much
# Times the best level: within it the smallest law is looked for. The gain of a car's law falls from
# 7.24 to 3.48 within 1e-5 of the level, to 3.32 within 5e-4.
WIDE = 1.00005
# Operations of one point, and times n^3: 0.1 ms for n = 4, measured with three signals.
ONE, EACH = 8e4, 300.0
# The same of what the kernel knows, times n^3 of a point, of a law at all, and times the cube of
# its numbers: of a full car with 26 states and 96 numbers 3 to 5 ms, 1.6 of them in its modes.
LAW, EACH_KNOWN, EACH_NUMBER = 6e5, 90.0, 1.0
# The same of a bound for periods in any order, times n^4 of each: a quarter of 14 ms for n = 9 and
# two, so that such a search may take four times as long as others.
IN_ANY_ORDER = 200.0
# Points times n^3 that are worth a thread: 0.5 ms in the kernel.
SHARED = 2e4
AT_ONCE = 3e5  # entries of the loops that are evaluated together: beyond it takes as long


@dataclass(frozen=True, eq=False)
class Ask:
    """What a search asks of one law at points.

    Attributes
    ----------
    theta : (size,) array
    phase : str
    unit : float
        Of what is minimised, so that it is about one.
    kappa : float, optional
        Of regions that are smooth: in their own phase, and of one that is to be small.
    most : float
        What the level may be while the law is made small.
    """

    theta: Array
    phase: str
    unit: float = 1.0
    kappa: float | None = None
    most: float = np.inf


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

    @property
    def stable(self) -> bool:
        """Whether limits and level are those of stable loops alone."""
        turning = isinstance(self.minimise, tuple) and any(np.any(s.M1) for s in self.minimise)
        return bool(self.requirements) or turning

    @property
    def coupled(self) -> bool:
        """Whether what is asked at one point depends on the others."""
        return any(requirement.coupled for requirement in self.requirements)

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

    def finite(self, K: Array) -> Any:
        """Return at which points loops do not overflow, under gains of all states (count, m, n)."""
        return np.abs(self._loops(K)).max(axis=(1, 2)) < 1e100

    def _loops(self, K: Array) -> Array:
        return np.asarray(self.channels[0].A + self.channels[0].B @ K)

    def modes(self, K: Array) -> Modes:
        """Return the modes under gains of all states, at points where they do not overflow."""
        return Modes(self._loops(K), float(self.task.plant.step))

    @cached_property
    def _wide(self) -> dict[int, Points]:
        return {1: self}

    def times(self, count: int) -> Points:
        """Return the points so many times, one law after the other."""
        if count not in self._wide:
            self._wide[count] = self[np.tile(np.arange(len(self.alpha)), count)]
        return self._wide[count]

    def evaluable(self, modes: Modes) -> Any:
        """Return at which points limits and level are, (count,): most ask for stability."""
        poles = modes.poles
        if not self.task.stable:
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

    def smooth_side(self, side: Side, curve: Curve, modes: Modes, kappa: float) -> Found:
        """Return the growth of a side at each point, smoothly."""
        values, dA = smooth_growth(side, curve, modes, kappa)
        up = np.swapaxes(self.channels[0].B, 1, 2)
        return Found(values, np.arange(len(values)), lambda: up @ dA)

    def side(self, side: Side, modes: Modes) -> Found:
        """Return the growth of a side at every pole of the upper half-plane."""
        B = self.channels[0].B
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

    def wanted(self, phase: str, kappa: float | None = None) -> list[Wanted]:
        """Return the measures of a phase; with ``kappa`` regions and the objective are smooth."""
        margin, groups = 0.0 if phase == WORST else MARGIN, count()
        wanted = list[Wanted]()
        if phase == SMALL:
            wanted.append(Wanted(SIZE, next(groups), IN_UNITS))
        elif phase in (LEVEL, WORST):
            bend = IN_UNITS if phase == LEVEL else KEPT
            wanted += self._lowered(next(groups), bend, kappa)
        sides = self.task.sides
        smooth = kappa if phase == REGION else None
        wanted += [self._of_side(side, next(groups), KEPT, margin, smooth) for side in sides]
        if np.isfinite(self.task.fastest):
            wanted.append(Wanted(SPEED, next(groups), shift=-1.0))
        if np.any(np.isfinite(self.task.unknowns.largest)):
            wanted.append(Wanted(ENTRIES, next(groups), shift=margin - 1))
        if phase == REGION:
            return wanted
        first = len(self.task.requirements) - len(self.task.limits)
        for k, limit in enumerate(self.task.limits, first):
            group, most = next(groups), limit.at_most or 1.0
            wanted.append(self._of_requirement(k, group, KEPT, most, margin - 1))
        if phase == SMALL and self.task.minimise is not None:
            wanted += self._lowered(next(groups), AT_MOST)
        return wanted

    def _lowered(self, group: int, bend: int, kappa: float | None = None) -> list[Wanted]:
        """Return what is minimised."""
        minimise = self.task.minimise
        if minimise is None:
            return [Wanted(SIZE, group, bend)]
        if isinstance(minimise, tuple):
            return [self._of_side(side, group, bend, 0.0, kappa) for side in minimise]
        return [self._of_requirement(0, group, bend)]

    def _of_side(
        self, side: Side, group: int, bend: int, shift: float, kappa: float | None
    ) -> Wanted:
        curve = None if kappa is None else curve_of(side, self.task.sizes.rate)
        kind = SIDE if curve is None else SMOOTH_SIDE
        return Wanted(kind, group, bend, 1.0, shift, side, curve)

    def _of_requirement(
        self, k: int, group: int, bend: int, limit: float = 1.0, shift: float = 0.0
    ) -> Wanted:
        channel, requirement = self.channels[k + 1], self.task.requirements[k]
        F = self.unknowns.seen(channel.reads)[1]
        plain = not channel.beside and (F is None or channel.S is None)
        kind = NOISE if plain and requirement.is_of_noise(channel) else OTHER
        return Wanted(kind, group, bend, limit, shift, requirement=k, channel=channel)

    def found(
        self, wanted: Wanted, K: Array, inner: Array, modes: Modes, kappa: float | None = None
    ) -> Found:
        """Return one measure, at gains of all states, and of what is measured."""
        if wanted.side is not None:
            if wanted.curve is None or kappa is None:
                return self.side(wanted.side, modes)
            return self.smooth_side(wanted.side, wanted.curve, modes, kappa)
        if wanted.kind == SPEED:
            return self.speed(modes)
        if wanted.kind == ENTRIES:
            return self.entries(inner, self.task.unknowns.largest)
        if wanted.kind == SIZE:
            return self.size(inner)
        return self.requirement(wanted.requirement, K, inner, modes)

    def answers(self, asks: Sequence[Ask], team: Team = ALONE) -> list[Any]:
        """Return rows, or the worst, of several laws: those of one phase are evaluated together."""
        found = dict[int, Any]()
        most = max(1, int(AT_ONCE / self.channels[0].A.size))
        kinds = dict.fromkeys((ask.phase, ask.kappa) for ask in asks)
        for kind in kinds:
            alike = [k for k, ask in enumerate(asks) if (ask.phase, ask.kappa) == kind]
            size = 1 if self.task.coupled else most
            for first in range(0, len(alike), size):
                some = alike[first : first + size]
                found |= zip(some, self._answers([asks[k] for k in some], team), strict=True)
        return [found[k] for k in range(len(asks))]

    def _answers(self, asks: Sequence[Ask], team: Team) -> Sequence[Any]:
        inner = self.unknowns.gains_of([ask.theta for ask in asks])
        wide, each = self.times(len(asks)), (len(asks), len(self.alpha))
        K = inner @ wide.unknowns.C
        if asks[0].phase == WORST:
            worst = wide.worst(K, inner)
            return list(np.moveaxis(worst.reshape(-1, *each), 0, 1))
        spend(self._work(asks, K), len(asks))
        good = wide.finite(K).reshape(each).all(axis=1)
        rows = list[Rows | None]([None] * len(asks))
        if good.any():
            some = np.flatnonzero(good).tolist()
            kept = np.repeat(good, each[1])
            pairs = self._of_finite([asks[k] for k in some], K[kept], inner[kept], team)
            for k, own in zip(some, pairs, strict=True):
                rows[k] = own
        return rows

    def _work(self, asks: Sequence[Ask], K: Array) -> float:
        """Return about what one evaluation of laws takes: the same with a kernel or without."""
        n3, key = float(K.shape[-1]) ** 3, (asks[0].phase, asks[0].kappa)
        if key not in self._known:
            self._known[key] = all(map(knows, self.wanted(*key)))
        if not self._known[key]:
            return len(K) * (ONE + EACH * n3)
        of_law = LAW + EACH_NUMBER * float(len(asks[0].theta)) ** 3
        return len(K) * EACH_KNOWN * n3 + len(asks) * of_law

    @cached_property
    def _known(self) -> dict[tuple[str, float | None], bool]:
        return {}

    def _of_finite(
        self, asks: Sequence[Ask], K: Array, inner: Array, team: Team
    ) -> list[Rows | None]:
        """Return rows of laws whose loops are finite, by the kernel as far as it can."""
        plan, each = self.plan(asks[0]), len(self.alpha)
        count = min(team.count, len(asks), int(len(K) * K.shape[-1] ** 3 / SHARED))
        if plan is None or plan.rest:  # what Python measures takes turns, and counts its work
            count = 1
        parts = np.array_split(np.arange(len(asks)), max(count, 1))

        def of(laws: Any) -> list[Rows | None]:
            points = slice(laws[0] * each, (laws[-1] + 1) * each)
            return self._of_some([asks[k] for k in laws], K[points], inner[points])

        return [rows for some in team.each(of, parts) for rows in some]

    def _of_some(self, asks: Sequence[Ask], K: Array, inner: Array) -> list[Rows | None]:
        """Return rows of some of the laws."""
        wide, each = self.times(len(asks)), len(self.alpha)
        modes, plan = wide.modes(K), wide.plan(asks[0])
        if plan is None:
            return self._referred(asks, K, inner, modes)
        units, most = (np.array([getattr(ask, key) for ask in asks]) for key in ("unit", "most"))
        rows, hard = plan.rows(len(asks), inner, modes, units, most)

        def of(some: Sequence[int]) -> tuple[list[Ask], Array, Array, Modes]:
            kept = (np.array(some)[:, None] * each + np.arange(each)).ravel()
            return [asks[k] for k in some], K[kept], inner[kept], modes[kept]

        if plan.rest and (good := [k for k, own in enumerate(rows) if own is not None]):
            more = self.times(len(good)).measured(*of(good), plan.rest)
            for k, own in zip(good, more, strict=True):
                rows[k] = _joined(rows[k], own)
        if hard:
            for k, own in zip(hard, self._referred(*of(hard)), strict=True):
                rows[k] = own
        return rows

    def _referred(
        self, asks: Sequence[Ask], K: Array, inner: Array, modes: Modes
    ) -> list[Rows | None]:
        """Return rows of laws whose loops are finite, by the reference."""
        wide, each = self.times(len(asks)), (len(asks), len(self.alpha))
        good = np.isfinite(modes.left).all(axis=(1, 2))
        if asks[0].phase != REGION:
            good &= wide.evaluable(modes)
        good = good.reshape(each).all(axis=1)
        rows = list[Rows | None]([None] * len(asks))
        if not good.any():
            return rows
        kept, some = np.repeat(good, each[1]), np.flatnonzero(good).tolist()
        wide = self.times(len(some))
        asked, every = [asks[k] for k in some], wide.wanted(asks[0].phase, asks[0].kappa)
        found = wide.measured(asked, K[kept], inner[kept], modes[kept], every)
        for k, own in zip(some, found, strict=True):
            rows[k] = own
        return rows

    def measured(
        self,
        asks: Sequence[Ask],
        K: Array,
        inner: Array,
        modes: Modes,
        every: Sequence[Wanted],
    ) -> list[Rows | None]:
        """Return rows of some measures; these points are those of the first law, then the next."""
        phase, count = asks[0].phase, len(self.alpha) // len(asks)
        units, most = (np.array([getattr(ask, key) for ask in asks]) for key in ("unit", "most"))
        first, parts = phase in (LEVEL, SMALL), []
        for wanted in every:
            measure = self.found(wanted, K, inner, modes, asks[0].kappa)
            law, point = np.divmod(measure.points, count)
            if wanted.bend == IN_UNITS:
                measure = _scaled(measure, units[law])
            elif wanted.bend == AT_MOST:
                measure = _kept(_less(measure, most[law]))
            else:
                measure = _kept(_within(measure, wanted.limit, wanted.shift))
            objective = np.full(len(law), wanted.bend == IN_UNITS or not first)
            slope = self._slopes(measure)
            parts.append((measure.values, slope, point + wanted.group * count, objective, law))
        *columns, law = (np.concatenate(part) for part in zip(*parts, strict=True))
        rows = [Rows(*(M[law == k] for M in columns)) for k in range(len(asks))]
        return [own if own.finite else None for own in rows]

    def _slopes(self, measure: Found) -> Array:
        """Return slopes with respect to the law's numbers, (rows, size)."""
        dK = measure.dK
        if not measure.inner:
            dK = dK @ np.swapaxes(self.unknowns.C[measure.points], 1, 2)
        slope = self.unknowns.slopes(measure.points, dK)
        return slope if measure.mixed is None else measure.mixed @ slope

    def plan(self, ask: Ask) -> Plan | None:
        """Return the kernel's plan of a phase; None without a kernel."""
        if kernel() is None:
            return None
        key = ask.phase, ask.kappa
        if key not in self._plans:
            self._plans[key] = self._planned(*key)
        return self._plans[key]

    @cached_property
    def _plans(self) -> dict[tuple[str, float | None], Plan]:
        return {}

    def _planned(self, phase: str, kappa: float | None) -> Plan:
        unknowns, task, every = self.task.unknowns, self.task, self.wanted(phase, kappa)
        return Plan(
            every=tuple(wanted for wanted in every if knows(wanted)),
            rest=tuple(wanted for wanted in every if not knows(wanted)),
            channel=self.channels[0],
            at=self.unknowns,
            largest=unknowns.largest,
            weight=unknowns.signals / unknowns.inputs[:, None],
            step=float(task.plant.step),
            fastest=task.fastest,
            stable=phase != REGION and task.stable,
            first=phase in (LEVEL, SMALL),
            trace=0.0 if kappa is None else kappa * self.channels[0].A.shape[-1],
        )

    def rows(self, theta: Array, phase: str, **how: Any) -> Rows | None:
        """Return everything that a phase of a search minimises and keeps; None where it cannot be.

        Parameters
        ----------
        **how
            As `Ask` has them.
        """
        rows: Rows | None = self.answers([Ask(theta, phase, **how)])[0]
        return rows

    def worst(self, K: Array, inner: Array) -> Array:
        """Return the worst of each measure at each point, (measures, count): the level first.

        What must be kept follows, zero or less where it is, in shares of its limit. Infinite where
        it cannot be evaluated.
        """
        finite = self.finite(K)
        if not np.all(finite):
            found = np.full((1 + self.wanted(WORST)[-1].group, len(K)), np.inf)
            if np.any(finite):
                found[:, finite] = self[finite].worst(K[finite], inner[finite])
            return found
        modes, plan = self.modes(K), self.plan(Ask(np.zeros(0), WORST))
        if plan is not None and not plan.rest:
            worst = plan.worst(inner, modes)
            if worst is not None:
                return worst
        good = self.evaluable(modes)
        some, at = (self, modes) if np.all(good) else (self[good], modes[good])
        every = self.wanted(WORST)
        largest = np.full((1 + every[-1].group, len(K)), -np.inf)
        for wanted in every:
            row, whole = largest[wanted.group], wanted.group and wanted.kind in BOUNDS
            row[~good] = -np.inf if whole else np.inf
            if not whole and not np.any(good):
                continue
            measure = (
                self.found(wanted, K, inner, modes)
                if whole
                else some.found(wanted, K[good], inner[good], at)
            )
            points = measure.points if whole else np.flatnonzero(good)[measure.points]
            measure = _within(measure, wanted.limit, wanted.shift)
            np.maximum.at(row, points, measure.values)
        return largest

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


def _joined(one: Rows | None, other: Rows | None) -> Rows | None:
    """Return the rows of both; None where one has none that could be evaluated."""
    if one is None or other is None:
        return other
    columns = ((getattr(rows, field.name) for rows in (one, other)) for field in fields(Rows))
    return Rows(*(np.concatenate(list(parts)) for parts in columns))


def _within(measure: Found, limit: float, shift: float) -> Found:
    """Return values in shares of a limit, and moved; those at zero or less are kept."""
    values = measure.values / limit + shift
    return replace(measure, values=values, turned=lambda: measure.dK / limit)


def _kept(measure: Found) -> Found:
    """Return values that beyond zero are logarithms."""
    above = np.maximum(measure.values, 0.0)
    bent = np.where(measure.values > 0, np.log1p(above), measure.values)
    return _flatter(measure, bent, np.ones(len(bent)), 1 + above)


def _scaled(measure: Found, unit: Array) -> Found:
    """Return values in units (rows,), beyond two of them as logarithms."""
    share = measure.values / unit
    above = np.maximum(share - 1, 0.0)
    bent = np.where(share > 1, 1 + np.log1p(above), share)
    return _flatter(measure, bent, unit, 1 + above)


def _flatter(measure: Found, values: Array, unit: Array, each: Array) -> Found:
    """Return other values, whose slopes are divided by units, and each by a number of its own."""
    mixed = measure.mixed
    mixed = mixed if mixed is None else mixed * each / each[:, None]

    def turned() -> Array:
        return np.asarray(measure.dK / unit[:, None, None] / each[:, None, None])

    return replace(measure, values=values, turned=turned, mixed=mixed)


def _less(measure: Found, level: Array) -> Found:
    """Return values less levels (rows,), in shares of these."""
    size = np.where(level, np.abs(level), 1.0)
    values = (measure.values - level) / size
    return replace(measure, values=values, turned=lambda: measure.dK / size[:, None, None])
