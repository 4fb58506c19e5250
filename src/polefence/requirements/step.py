"""Step responses: how large, how fast and how calm a signal is after a constant disturbance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.step import MEASURES, RELATIVE
from polefence.proof.text import exactly
from polefence.requirements.followed import times_of, unfollowed
from polefence.requirements.slopes import ALIKE, Loops, Slopes, Turned
from polefence.requirements.specification import Row, Specification, disturbance, is_number
from polefence.response.closed import close
from polefence.response.discrete import exponential
from polefence.response.modes import Modes

TIMES = ("settling", "rise")  # measures that are times
BANDS = {"settling": 0.02, "rise": 0.1}  # of the final value, where none is named
TINY, MOST, CLOSER = 1e-300, 3, 4  # a final value of none; times that count; steps to each


@dataclass(frozen=True)
class StepMeasure(Specification):
    """A measure of a signal's response to a constant disturbance, from rest.

    Attributes
    ----------
    measure : str
        "peak", the largest absolute value; "overshoot" and "undershoot", shares of the final value;
        "settling", the time after which the signal stays within ``band`` of its final value [s];
        "rise", a time by which it has come so near [s]; "final", the final absolute value.
    band : float, optional
        A share of the final value: 0.02 of a settling time, 0.1 of a rise time.
    disturbances : sequence of str, or mapping of str to float, optional
        Those that step, each by so much; all by one unless said.
    """

    measure: str = field(default="peak", kw_only=True)
    band: float | None = field(default=None, kw_only=True)
    kind = "step"
    keys: ClassVar[tuple[str, ...]] = ("measure", "band", "disturbances")
    direct = True
    power = 1

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if self.measure not in MEASURES:
            known = suggest(str(self.measure), list(MEASURES))
            raise InputError(f"measure = {shown(self.measure)} of a {self.kind}: {known}")
        if self.measure in TIMES and self.band is None:
            self._settle("band", BANDS[self.measure])
        if self.band is not None and self.measure not in TIMES:
            raise InputError(
                f"band = {self.band!r}: it is of settling and rise times; leave it out"
            )
        if self.band is not None and not (is_number(self.band) and 0 < self.band < 1):
            raise InputError(f"band = {self.band!r} must be above 0 and below 1, a share")

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        own = {key: row.table[key] for key in ("measure",) if key in row.table}
        return cls(row.table["signal"], **row.given(*({"band"} & set(row.table))), **own)

    @property
    def title(self) -> str:
        """Kind, signal and measure, as a line has them."""
        band = f" with band {exactly(self.band)}" if self.band is not None else ""
        return f"{super().title} with measure {self.measure}{band}"

    def unit(self, plant: UncertainPlant) -> str:
        """Return seconds, none of a share, or the signal's unit."""
        if self.measure in TIMES:
            return "s"
        return "" if self.measure in RELATIVE else super().unit(plant)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without a disturbance, or of which none is proved."""
        disturbance(plant)
        self.require_late(plant)
        self.scales(plant)
        if why := unfollowed(plant):
            raise InputError(f"{self.title}: step responses are not proved {why}")

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.StepResponse:
        """Return the claim, which is not followed yet."""
        scales = tuple(map(Fraction, self.scales(plant)))
        band = Fraction(0) if self.band is None else Fraction(repr(self.band))
        own: dict[str, Any] = {"scales": scales, "measure": self.measure, "band": band}
        return proof.StepResponse(subject, self.exact_outputs(plant), level, **own)

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has it."""
        return f"{self.title}: no LMI has it; leave out the method, so that a law is tuned"

    def tuned(self, times: float) -> tuple[Specification, ...]:  # noqa: ARG002
        """Return it, or of a time how near the signal is from the limit on.

        Raises
        ------
        InputError
            If a time is to be minimised.
        """
        if self.measure not in TIMES:
            return (self,)
        if self.at_most is None:
            raise InputError(
                f"{self.title}: a time is not minimised; give it a limit, at_most = 1.0 [s]"
            )
        own = {key: getattr(self, key) for key in ("disturbances", "measure", "band")}
        return (StepNearness(self.signal, 1.0, time=self.at_most, **own),)

    def slopes(self, loops: Loops) -> Slopes:
        """Return the measure at the times that count, with its slopes."""
        every = [_Response.of(loops, k) for k in range(len(loops.A))]
        active = [self._active(response) for response in every]
        points = np.repeat(np.arange(len(every)), [len(times) for times in active])
        t = np.concatenate(active)
        final = np.array([response.final for response in every])[points]
        A, E, C = loops.A[points], loops.E[points].sum(axis=2), loops.C[points][:, 0]
        n, F = A.shape[1], loops.F[points].sum(axis=(1, 2))
        whole = np.zeros((len(points), n + 1, n + 1))
        whole[:, :n, :n], whole[:, :n, n] = A, E
        row = np.pad(C, ((0, 0), (0, 1)))
        motion = exponential(whole * t[:, None, None])[..., n]
        y = (row * motion).sum(axis=1) + F
        values, of_y, of_final = self._of(y, final)

        def turned() -> list[Turned]:
            # the integral of e^A'(t - s) C' x0' e^A's over s, as a block of an exponential
            m = n + 1
            both = np.zeros((len(points), 2 * m, 2 * m))
            both[:, :m, :m] = both[:, m:, m:] = np.swapaxes(whole, 1, 2)
            both[:, n, m:] = row  # x0 is the last state, of one
            both[:, :m, m:] = np.swapaxes(both[:, :m, m:], 1, 2)
            d = exponential(both * t[:, None, None])[:, :m, m:] * of_y[:, None, None]
            q = np.linalg.solve(A, E[..., None])[..., 0]
            p = np.linalg.solve(np.swapaxes(A, 1, 2), C[..., None])[..., 0]
            dA = d[:, :n, :n] + of_final[:, None, None] * p[:, :, None] * q[:, None]
            dE = d[:, :n, n] - of_final[:, None] * p
            dC = of_y[:, None] * motion[:, :n] - of_final[:, None] * q
            dF = np.broadcast_to((of_y + of_final)[:, None, None], (len(t), 1, loops.F.shape[2]))
            columns = np.repeat(dE[:, :, None], loops.E.shape[2], axis=2)
            return [Turned(dA, dC[:, None], columns, dF)]

        return Slopes(values, points, turned)

    def _active(self, response: _Response) -> Array:
        """Return the times that count."""
        sign = np.sign(response.final)
        match self.measure:
            case "peak":
                return response.highest(np.abs(response.y))
            case "overshoot":
                return response.highest(sign * response.y)
            case "undershoot":
                return response.highest(-sign * response.y)
            case _:
                return response.t[-1:]

    def _of(self, y: Array, final: Array) -> tuple[Array, Array, Array]:
        """Return the measure of y at times, and its slopes to y and to the final value."""
        sign, size = np.sign(final), np.maximum(np.abs(final), TINY)
        match self.measure:
            case "peak":
                return np.abs(y), np.sign(y), np.zeros(len(y))
            case "final":
                return size, np.zeros(len(y)), sign
            case _:
                s = sign if self.measure == "overshoot" else -sign
                less = 1.0 if self.measure == "overshoot" else 0.0
                return s * y / size - less, s / size, -s * y * sign / size**2

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the measure at points alpha; infinite of a loop that is not stable, or not so."""
        loops = self.loops(plant, law, alpha)
        return np.array([_Response.of(loops, k).measured(self) for k in range(len(alpha))])

    def loops(self, plant: UncertainPlant, law: Any, alpha: Array) -> Loops:
        """Return the loops at points alpha."""
        closed = close(plant, law, alpha)
        channel = self.channel(delta_form(plant), alpha)
        return channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)


@dataclass(frozen=True)
class StepNearness(StepMeasure):
    """How near a signal is to its final value from a time on: at most one where it is in the band.

    Of a rise, how much it lacks at that time.
    """

    time: float = field(default=0.0, kw_only=True)

    def _active(self, response: _Response) -> Array:
        if self.measure == "rise":
            return np.array([self.time])
        late = response.t > self.time
        over = np.where(late, np.abs(response.y - response.final), 0.0)
        return np.append(response.highest(over), self.time)

    def _of(self, y: Array, final: Array) -> tuple[Array, Array, Array]:
        sign, size, band = np.sign(final), np.maximum(np.abs(final), TINY), self.band or 0.0
        if self.measure == "rise":
            return 2 - band - sign * y / size, -sign / size, sign * y * sign / size**2
        s, over = np.sign(y - final), np.abs(y - final)
        return over / size / band, s / size / band, (-s / size - over * sign / size**2) / band

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return it at points alpha; infinite of a loop that is not stable."""
        loops = self.loops(plant, law, alpha)
        values = np.full(len(alpha), np.inf)
        stable = np.flatnonzero(np.all(loops.modes.poles.real < 0, axis=1))
        if len(stable):
            found = self.slopes(_some(loops, stable))
            values[stable] = 0.0
            np.maximum.at(values, stable[found.points], found.values)
        return values


def _some(loops: Loops, some: Any) -> Loops:
    modes = Modes(loops.A[some], loops.modes.step)
    return replace(loops, modes=modes, E=loops.E[some], C=loops.C[some], F=loops.F[some])


@dataclass(frozen=True, eq=False)
class _Response:
    """y of one loop at its times, and where it tends to; y' = sum of weights e^(poles t)."""

    t: Array
    y: Array
    final: float
    poles: Any
    weights: Any

    @classmethod
    def of(cls, loops: Loops, k: int) -> _Response:
        """Return the response to all disturbances at once; without times of an unstable loop."""
        A, E = loops.A[k], loops.E[k].sum(axis=1)
        C, F = loops.C[k][0], float(np.sum(loops.F[k]))
        poles, V = np.linalg.eig(A)
        if poles.real.max() >= 0:
            return cls(np.zeros(0), np.zeros(0), np.nan, poles, poles)
        t = times_of(poles)
        weights = (C @ V) * np.linalg.solve(V, E.astype(complex))
        y = ((np.exp(np.multiply.outer(t, poles)) - 1) * (weights / poles)).sum(axis=1).real + F
        return cls(t, y, float(-(weights / poles).sum().real + F), poles, weights)

    def highest(self, size: Array) -> Array:
        """Return the times of the highest peaks of a number at all times, a few."""
        beside = np.pad(size, 1, constant_values=-np.inf)
        k = np.flatnonzero((size >= beside[:-2]) & (size >= beside[2:]))
        most = size[k].max()
        k = k[size[k] >= most - (1 - ALIKE) * abs(most)]
        return np.array([self._peak(int(i)) for i in k[np.argsort(-size[k])][:MOST]])

    def _peak(self, k: int) -> float:
        """Return the time near one of those at which y' is zero; that one at an end."""
        if not 0 < k < len(self.t) - 1:
            return float(self.t[k])
        t = float(self.t[k])
        for _ in range(CLOSER):
            terms = self.weights * np.exp(self.poles * t)
            slope, bend = terms.sum().real, (self.poles * terms).sum().real
            moved = t - slope / bend if bend else t
            if not self.t[k - 1] < moved < self.t[k + 1]:
                break
            t = float(moved)
        return t

    def at(self, t: Array) -> Array:
        """Return y at times."""
        rising = (np.exp(np.multiply.outer(t, self.poles)) - 1) * (self.weights / self.poles)
        still = self.final + (self.weights / self.poles).sum().real
        return np.asarray(rising.sum(axis=-1).real + still)

    def _most(self, sign: float) -> float:
        """Return the largest of a sign times y."""
        return float((sign * self.at(self.highest(sign * self.y))).max())

    def measured(self, asked: StepMeasure) -> float:
        """Return what is asked, infinite where there is none."""
        if not len(self.t) or (asked.measure in RELATIVE and not self.final):
            return np.inf
        size, sign = abs(self.final), np.sign(self.final)
        match asked.measure:
            case "peak":
                return max(self._most(1.0), self._most(-1.0), size)
            case "final":
                return size
            case "overshoot":
                return max(self._most(sign) / size - 1, 0.0)
            case "undershoot":
                return max(self._most(-sign) / size, 0.0)
            case "settling":
                return self._last(np.abs(self.y - self.final) - (asked.band or 0.0) * size)
            case _:
                return self._first((1 - (asked.band or 0.0)) * size - sign * self.y)

    def _last(self, over: Array) -> float:
        """Return the last time at which a number is above zero."""
        k = np.flatnonzero(over > 0)
        if not len(k):
            return 0.0
        return self._between(int(k[-1]), over) if k[-1] + 1 < len(over) else np.inf

    def _first(self, over: Array) -> float:
        """Return the first time at which a number is not above zero."""
        k = np.flatnonzero(over <= 0)
        if not len(k):
            return np.inf
        return self._between(int(k[0]) - 1, over) if k[0] else 0.0

    def _between(self, k: int, over: Array) -> float:
        share = over[k] / (over[k] - over[k + 1])
        return float(self.t[k] + share * (self.t[k + 1] - self.t[k]))
