"""Peak of a signal from initial states, or after impulses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np

from polefence.base.errors import InputError, SpecError
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.dual_problem import DualProblem, Starts
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import rows_at, states
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.between import Held
from polefence.requirements.held import PRINTED, SEARCHED, at_times
from polefence.requirements.slopes import Channel, Loops, Slopes, Turned
from polefence.requirements.specification import (
    Row,
    Specification,
    disturbance,
    is_number,
    number,
)
from polefence.response.between import held_evenly
from polefence.response.closed import Loops as Closed
from polefence.response.closed import close
from polefence.response.discrete import exponential
from polefence.response.grid import MOST_CHOSEN
from polefence.response.linear import simulate
from polefence.response.stationary import STABLE, growth, stationary

MOST = 3  # peaks that count, of a loop
CLOSER = 100  # of the worst points
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class InitialPeak(Specification):
    """The largest value of a signal from given initial states, or after impulses.

    Attributes
    ----------
    points : tuple of tuple of float
        Initial states; with them their convex hull and their negatives.
    impulse : float
        Of the disturbance, at rest [its unit times s]; zero for none.
    ellipsoid : (n, n) nested tuple, optional
        X0, symmetric without negative eigenvalues, numbers or exact (Fraction): all initial states
        with x0' X0^-1 x0 <= 1. A diagonal X0 has the squares of the half-axes on it. A box is the
        hull of its corners: give them as ``points``.
    """

    points: tuple[tuple[float, ...], ...] = ()
    impulse: float = 0.0
    ellipsoid: tuple[tuple[float | Fraction, ...], ...] = ()
    kind = "initial peak"
    keys: ClassVar[tuple[str, ...]] = ("points", "impulse", "ellipsoid", "disturbances")
    at_all_times: ClassVar[bool] = True  # of samples: between them too

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        _require_square(self.name, self.ellipsoid)
        self._settle("ellipsoid", tuple(map(tuple, self.ellipsoid)))
        try:
            self._settle("points", tuple(map(tuple, self.points)))
        except TypeError as error:
            raise InputError(
                f"{self.name!r}: points must be a list of initial states, [[...], [...]]"
            ) from error
        if self.disturbances is not None and not any(self._sizes):
            raise InputError(
                f"{self.name!r}: disturbances only apply together with an impulse; give one, or "
                "leave them out"
            )
        numbers = [
            *self._sizes,
            *(x for points in (self.points, self.ellipsoid) for p in points for x in p),
        ]
        if not all(isinstance(x, Fraction) or is_number(x) for x in numbers) or not any(numbers):
            raise InputError(
                f"{self.name!r}: give points or an impulse, or an ellipsoid, finite numbers"
            )
        X0 = [[Fraction(x) for x in row] for row in self.ellipsoid]
        if [list(row) for row in zip(*X0, strict=True)] != X0 or not proof.is_semidefinite(X0):
            raise InputError(
                f"{self.name!r}: the ellipsoid must be symmetric, without negative eigenvalues"
            )

    @property
    def _sizes(self) -> tuple[float, ...]:
        """The sizes of the disturbances' impulses."""
        return (self.impulse,)

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        points = matrix(row, "points", "initial states", number)
        ellipsoid = matrix(row, "ellipsoid", "rows of a matrix", _exact)
        numbers = row.given(*(key for key in cls.keys if key in ("impulse", "norm")))
        return cls(row.table["signal"], points=points, ellipsoid=ellipsoid, **numbers)

    def extended(self, n: int, more: int) -> InitialPeak:
        """Return it from initial states at which the further states are at rest."""
        zeros = (0.0,) * more
        points = tuple((*point, *zeros) if len(point) == n else point for point in self.points)
        X0 = self.ellipsoid
        if len(X0) == n:
            X0 = (*((*row, *zeros) for row in X0), *((0.0,) * (n + more),) * more)
        return replace(self, points=points, ellipsoid=X0)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without the signal; one without disturbance takes no impulse.

        Initial states have as many numbers as the plant has states.
        """
        self.require_late(plant)
        self.outputs(plant)
        self._require_states(plant)
        if self.impulse:
            disturbance(plant)
        self.scales(plant)
        self._require_known_states(plant)

    def _require_known_states(self, plant: UncertainPlant) -> None:
        """Refuse an impulse that leaves a state which is not known exactly.

        At a sample time E has an interpolation error; where parameters move in discrete time and E
        varies it is another one when the impulse has acted.
        """
        if self.impulse and plant.remainder is not None:
            raise InputError(
                f"{self.title}: impulse = {self.impulse:g}: at a sample time the state that an "
                "impulse leaves is only known to within an error, of which nothing is proved; give "
                f"that state as points: E of the continuous plant times {self.impulse:g}"
            )
        if not self.impulse or not plant.moving or not plant.period:
            return
        E = disturbance(plant)
        if np.any(E[:1] != E):
            raise InputError(
                f"{self.title}: when an impulse has acted, {plant.moving[0].name} has moved, and E "
                "varies; give initial states as points"
            )

    def source(
        self,
        plant: UncertainPlant,
        domain: Domain,  # noqa: ARG002
        law: Law | None = None,
    ) -> conditions.Source:
        """Return the initial states."""
        self._require_states(plant)
        return self._starts(plant, "points", law)

    def _starts(self, plant: UncertainPlant, kind: str, law: Law | None) -> conditions.Points:
        """Return the initial states under a name that begins with a word."""
        N, degree = len(plant.vertices), 1
        if self.impulse:
            E, degree = self.driving(plant, law)
            N = len(E)
        x0 = [np.tile(np.array(p, dtype=float)[:, None], (N, 1, 1)) for p in self.points]
        if self.impulse:
            acting = self._impulses(plant)
            x0 += [self.impulse * E[:, :, k : k + 1] for k in np.flatnonzero(acting)]
        X0 = np.array(self.ellipsoid, dtype=float) if self.ellipsoid else None
        starts = self.points, self.impulse, self.ellipsoid, self.scales(plant)
        name = f"{kind} {starts!r}"  # a hash would take -1 for -2
        return conditions.Points(name, tuple(x0), X0, degree)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the peak."""
        outputs, held = self.exact_outputs(plant), self.held(plant)
        return proof.InitialPeak(subject, outputs, level, *self._exact(plant), held=held)

    def held(self, plant: UncertainPlant) -> Held | None:
        """Return what is held between samples, where the peak is that at all times."""
        if not self.at_all_times or self.impulse:
            return None
        return held_evenly(plant, self.outputs(plant))

    def has_primal(self, plant: UncertainPlant) -> bool:
        """Not of what goes on between samples: that is searched for at points of the box."""
        return self.held(plant) is None

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the closed loops between samples; there is no dual form."""
        held = self.held(plant)
        if held is None:
            return None
        problem, storing = self._dual(plant, law, 1.0), self._storing(plant, held)
        return replace(problem, storing=storing, starts=self._started(plant.shape[0]))

    def _started(self, n: int) -> Starts:
        """Return the initial states in floats."""
        points = np.array(self.points, dtype=float).reshape(-1, n).T
        X0 = np.array(self.ellipsoid, dtype=float) if self.ellipsoid else None
        return Starts(points, X0)

    def _exact(self, plant: UncertainPlant) -> tuple[Any, Any, Any]:
        """Return points, impulses and ellipsoid in exact numbers."""
        points = tuple(tuple(Fraction(x) for x in point) for point in self.points)
        impulses = tuple(map(Fraction, self._impulses(plant)))
        impulses = tuple(Fraction(self.impulse) * scale for scale in impulses)
        X0 = tuple(tuple(Fraction(x) for x in row) for row in self.ellipsoid)
        return points, impulses, X0

    def _require_states(self, plant: UncertainPlant) -> None:
        n = plant.shape[0]
        names = f": {', '.join(state.name for state in states(plant))}" if plant.states else ""
        for k, point in enumerate(self.points, 1):
            if len(point) != n:
                raise InputError(
                    f"{self.kind} of {self.name!r}: initial state {k} of points has {len(point)} "
                    f"numbers; {plant.name} has {n} states{names}"
                )
        if self.ellipsoid and len(self.ellipsoid) != n:
            raise InputError(
                f"{self.kind} of {self.name!r}: the ellipsoid is {len(self.ellipsoid)} x "
                f"{len(self.ellipsoid)}; {plant.name} has {n} states{names}"
            )

    def _impulses(self, plant: UncertainPlant) -> tuple[float, ...]:
        """Return how many times the impulse each disturbance has; nothing without an impulse."""
        if not self.impulse:
            return ()
        return self.scales(plant) or (1.0,) * plant.disturbance_count

    def passed(self, plant: UncertainPlant, F: Array) -> Array:
        """Return of what passes into a law's signals what impulses do."""
        return np.asarray(F * np.array(self._impulses(plant) or (0.0,) * F.shape[-1]))

    def begun(self, loops: Closed) -> list[Array]:
        """Return the points and what each impulse leaves, (count, n) of as many loops."""
        starts = [np.tile(np.array(x, dtype=float), (len(loops.A), 1)) for x in self.points]
        sizes = enumerate(self._impulses(loops.plant))
        return starts + [self.impulse * s * loops.E[:, :, k] for k, s in sizes if s]

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the peak by exact responses at close instants.

        From an ellipsoid X0 = L L' it is the root of the sum of squares from L's columns. Between
        samples it is looked for at times of a period, and closer at the points that are worst.
        """
        held = self.held(plant)
        if held is None:
            return self._of_samples(plant, law, alpha)
        values = self._of_times(plant, held, law, alpha, SEARCHED)
        worst = np.argsort(-values, kind="stable")[:CLOSER]
        values[worst] = self._of_times(plant, held, law, alpha[worst], PRINTED)
        return values

    def at_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array | None:
        """Return the peak at samples, where that at all times is bounded; else None."""
        return None if self.held(plant) is None else self._of_samples(plant, law, alpha)

    def _of_times(
        self, plant: UncertainPlant, held: Held, law: Any, alpha: Array, times: int
    ) -> Array:
        """Return the peak at so many times of each part of a period."""
        closed, channel = close(plant, law, alpha), self._between(plant, held, alpha, times)
        stationary(plant, law, alpha, 0.0, self.outputs(plant))  # refuses what is not stable
        A, C = channel.A + channel.B @ closed.K, channel.C + channel.D @ closed.K
        poles, step = np.linalg.eigvals(A), closed.step
        steps = _steps(poles, step, step)
        alone, squared = channel.E.shape[2] - len(self.ellipsoid), np.zeros(len(alpha))
        x, moved = channel.E, np.eye(A.shape[1]) + step * A
        for _ in range(steps):
            y = (C @ x) ** 2
            peaks = [y[..., :alone].max(axis=(1, 2), initial=0.0)]
            peaks.append(y[..., alone:].sum(axis=2).max(axis=1))
            squared, x = np.max([squared, *peaks], axis=0), moved @ x
        return np.asarray(np.sqrt(squared))

    def _of_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the peak at samples, or in continuous time at close instants."""
        (signal,) = self.outputs(plant)
        if not self.impulse and any(vertex.E is None for vertex in plant.vertices):
            plant = _moved_by_nothing(plant)
        loops = close(plant, law, alpha)
        count, starts = len(loops.closed), self.begun(loops)
        stationary(plant, law, alpha, 1.0, [signal])  # refuses what is not stable
        poles = loops.poles()
        step = loops.step or 0.25 / np.abs(poles).max()
        steps = _steps(poles, loops.step, step)
        time, size = step * np.arange(steps), max(1, 2_000_000 // steps)  # samples at once

        def squares(start: Array, part: slice) -> Array:
            one = simulate(plant, law, alpha[part], None, time, [signal], "held", start[part])
            return np.asarray(one.values[:, :, 0] ** 2)

        squared = np.zeros(count)
        axes = [np.tile(axis, (count, 1)) for axis in axes_of(self)]
        for first in range(0, count, size):
            part = slice(first, first + size)
            responses = [squares(start, part) for start in starts]
            if axes:  # c e^At L L' e^A't c' of X0 = L L'
                responses.append(np.sum([squares(axis, part) for axis in axes], axis=0))
            squared[part] = np.max([y.max(axis=1) for y in responses], axis=0)
        return np.sqrt(squared)

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with the initial states as columns of E, the ellipsoid's axes behind them.

        Between samples it is with the signal at times.
        """
        held = self.held(plant)
        if held is not None:
            return self._between(plant, held, alpha, SEARCHED)
        C, D, _ = rows_at(plant, self.outputs(plant), alpha)
        impulses, first = np.zeros((len(alpha), plant.shape[0], 0)), len(self.points)
        S = np.zeros((plant.disturbance_count, 0))
        if self.impulse:
            S = self.impulse * np.diag(self._impulses(plant))
            S = S[:, np.any(S, axis=0)]
            impulses = np.tensordot(alpha, disturbance(plant) @ S, 1)
        E = self._columns(impulses)
        S = np.pad(S, ((0, 0), (first, E.shape[2] - first - S.shape[1])))
        return Channel(*plant.at(alpha), E, C, D, np.zeros((len(alpha), 1, E.shape[2])), S)

    def _columns(self, impulses: Array) -> Array:
        """Return the points, what impulses leave (count, n, q) and the axes behind one another."""
        shape = _, n = impulses.shape[:2]
        points, axes = (
            np.broadcast_to(M.T, (*shape, len(M)))
            for M in (np.array(x, dtype=float).reshape(-1, n) for x in (self.points, axes_of(self)))
        )
        return np.concatenate([points, impulses, axes], axis=2)

    def _between(self, plant: UncertainPlant, held: Held, alpha: Array, times: int) -> Channel:
        """Return the channel of the signal at so many times of each part of a period."""
        plant = delta_form(plant)
        n, T, storing = plant.shape[0], float(plant.period), self._storing(plant, held)
        channel = at_times(super().channel(plant, alpha), storing, alpha, T, times)
        E = self._columns(np.zeros((len(alpha), n, 0)))
        F = np.zeros((len(alpha), channel.C.shape[1], E.shape[2]))
        return replace(channel, E=E, F=F, more=0.0)

    def slopes(self, loops: Loops) -> Slopes:
        """Return the peaks with their slopes."""
        q = loops.E.shape[2]
        alone = q - len(self.ellipsoid)
        groups = [slice(k, k + 1) for k in range(alone)] + [slice(alone, q)] * (q > alone)
        peaks = [row for k in range(len(loops.A)) for row in _peaks(loops, k, groups)]
        points, row, which, time = (np.array(column) for column in zip(*peaks, strict=True))
        A, C, step = loops.A[points], loops.C[points, row][:, None], loops.modes.step
        n = A.shape[1]

        def moved(M: Array, one: Array) -> Array:
            """Return e^Mt, or (I + step M)^(t / step)."""
            if not step:
                return exponential(M * time[:, None, None])
            pairs = zip(one + step * M, np.rint(time / step).astype(int).tolist(), strict=True)
            return np.stack([np.linalg.matrix_power(factor, count) for factor, count in pairs])

        motion = moved(A, np.eye(n))
        y = C @ motion @ loops.E[points]
        members = [[groups[g].start <= k < groups[g].stop for k in range(q)] for g in which]
        y *= np.array(members)[:, None]
        values = np.sqrt((y**2).sum(axis=(1, 2)))

        def turned() -> list[Turned]:
            size = np.maximum(values, TINY)[:, None, None]
            start = loops.E[points] @ np.swapaxes(y, 1, 2) / size
            # the integral of e^A'(t - s) C' x0' e^A's over s, as a block of an exponential
            both = np.zeros((len(A), 2 * n, 2 * n))
            both[:, :n, :n] = both[:, n:, n:] = np.swapaxes(A, 1, 2)
            both[:, :n, n:] = np.swapaxes(start @ C, 1, 2)
            dA = moved(both, np.eye(2 * n))[:, :n, n:]
            dC = np.zeros((len(points), *loops.C.shape[1:]))
            dC[np.arange(len(points)), row] = (motion @ start)[..., 0]
            return [Turned(dA, dC, np.swapaxes(C @ motion, 1, 2) @ y / size)]

        return Slopes(values, points, turned)


def _steps(poles: Any, step: float, apart: float) -> int:
    """Return how many instants so far apart show what slow poles do, of a delta form with step."""
    fastest, decay = np.abs(poles).max(), -growth(poles, step)
    slowest = np.where(decay > STABLE * fastest, decay, np.inf).min()
    return max(2, int(min(5.0 / slowest / apart + 1, MOST_CHOSEN)))


def _peaks(loops: Loops, k: int, groups: list[slice]) -> list[tuple[int, int, int, float]]:
    """Return loop, row, group of columns and instant of the peaks that count, the highest first."""
    poles, step = loops.modes.poles[k], loops.modes.step
    if step:  # at samples z^k = e^(log z k)
        z = (1 + step * poles).astype(complex)
        poles = np.log(np.where(z == 0, TINY, z)) / step
    instants = [np.zeros(1)]
    for pole in poles:
        lasting = 14.0 / max(-pole.real, TINY)  # time constants of the mode
        steps = int(np.clip(lasting * abs(pole) * 4, 20, 800))  # four steps a radian
        instants.append(np.linspace(0, lasting, steps))
    time = np.unique(np.concatenate(instants))
    time = np.unique(np.rint(time / step)) * step if step else time
    left, right = loops.C[k] @ loops.modes.right[k], loops.modes.left[k] @ loops.E[k]
    highest = []
    for (i, own), (g, group) in product(enumerate(left), enumerate(groups)):

        def response(t: Array, most: int, own: Any = own, modal: Any = right[:, group]) -> Any:
            terms = own * np.exp(np.outer(t, poles))
            return [((terms * poles**j) @ modal).real for j in range(most)]

        y = np.sum(response(time, 1)[0] ** 2, axis=1)
        inner = (y >= np.append(-1.0, y[:-1])) & (y > np.append(y[1:], -1.0))
        at = np.flatnonzero(inner)
        at = at[np.argsort(-y[at], kind="stable")][:MOST]
        t = time[at]
        low, high = time[np.maximum(at - 1, 0)], time[np.minimum(at + 1, len(time) - 1)]
        for _ in range(0 if step else 4):  # Newton's steps to where the square is at its highest
            y, v, a = response(t, 3)
            slope, bend = 2 * (y * v).sum(axis=1), 2 * (v * v + y * a).sum(axis=1)
            by = np.divide(slope, bend, out=np.zeros_like(t), where=bend < -1e-12 * abs(slope))
            t = np.clip(t - by, low, high)
        peaks = np.sum(response(t, 1)[0] ** 2, axis=1)
        highest += [(float(v), k, i, g, float(s)) for v, s in zip(peaks, t, strict=True)]
    highest.sort(key=lambda row: -row[0])
    return [row[1:] for row in highest[:MOST] if row[0] >= 0.8**2 * highest[0][0]]


def _require_square(name: str, ellipsoid: Any) -> None:
    try:
        widths = [len(row) for row in ellipsoid]
    except TypeError:
        widths = [-1]
    if any(width != len(widths) for width in widths):
        raise InputError(f"{name!r}: the ellipsoid must be a square matrix, [[...], [...]]")


def _exact(value: Any, where: str) -> Fraction:
    number(value, where)
    return Fraction(value)


def matrix(
    row: Row, key: str, what: str, read: Callable[[Any, str], Any]
) -> tuple[tuple[Any, ...], ...]:
    """Return a list of rows, none where it is not given.

    Raises
    ------
    SpecError
        If it is no list of lists of numbers.
    """
    value = row.table.get(key, [])
    if not isinstance(value, list) or not all(isinstance(point, list) for point in value):
        raise SpecError(f"{key} must be a list of {what}, [[...], [...]]")
    return tuple(tuple(read(x, key) for x in point) for point in value)


def _moved_by_nothing(plant: UncertainPlant) -> UncertainPlant:
    """Return the plant with a zero disturbance matrix."""
    zero = tuple((Fraction(0),) for _ in range(plant.shape[0]))
    vertices = tuple(replace(vertex, exact_E=zero) for vertex in plant.vertices)
    return replace(plant, vertices=vertices, disturbances=(), outputs=(), vehicle=None)


def axes_of(peak: InitialPeak) -> Array:
    """Return the columns of L, X0 = L L', as rows."""
    if not peak.ellipsoid:
        return np.zeros((0, 0))
    X0 = np.array(peak.ellipsoid, dtype=float)
    # scaled before its eigenvalues are taken: states' units may lie decades apart
    scale = np.sqrt(np.where(np.diag(X0) > 0, np.diag(X0), 1.0))
    values, vectors = np.linalg.eigh(X0 / np.outer(scale, scale))
    return np.asarray((scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))).T)
