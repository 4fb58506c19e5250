"""Step responses: how large, how fast and how calm a signal is after a constant disturbance."""

from __future__ import annotations

from dataclasses import dataclass, field
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
from polefence.requirements.slopes import Loops
from polefence.requirements.specification import Row, Specification, disturbance, is_number
from polefence.response.closed import close
from polefence.response.modes import Modes

TIMES = ("settling", "rise")  # measures that are times
BANDS = {"settling": 0.02, "rise": 0.1}  # of the final value, where none is named
CALM, EVEN, DENSE = 12.0, 1500, 0.05  # of a response: time constants, and times that are looked at


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
        why = ""
        if plant.period or plant.sampling is not None:
            why = "at a sample time"
        elif plant.functions is not None or plant.remainder is not None:
            why = "of a plant with functions of its parameters"
        elif plant.moving:
            why = "while parameters move"
        if why:
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

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the measure at points alpha; infinite of a loop that is not stable, or not so."""
        closed = close(plant, law, alpha)
        channel = self.channel(delta_form(plant), alpha)
        loops = channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)
        return np.array([_Response.of(loops, k).measured(self) for k in range(len(alpha))])


@dataclass(frozen=True, eq=False)
class _Response:
    """y of one loop at its times, and where it tends to."""

    t: Array
    y: Array
    final: float

    @classmethod
    def of(cls, loops: Loops, k: int) -> _Response:
        """Return the response to all disturbances at once; without times of an unstable loop."""
        A, E = loops.A[k], loops.E[k].sum(axis=1)
        C, F = loops.C[k][0], float(np.sum(loops.F[k]))
        poles, V = np.linalg.eig(A)
        if poles.real.max() >= 0:
            return cls(np.zeros(0), np.zeros(0), np.nan)
        slow, fast = -poles.real.max(), np.abs(poles).max()
        last = CALM / slow
        even = np.linspace(0, last, EVEN)
        t = np.union1d(even, np.geomspace(DENSE / fast, last, EVEN))
        near = np.arange(0, min(last, 200 * np.pi / fast), 2 * np.pi / fast / 40)
        t = np.union1d(t, near)
        weights = (C @ V) * np.linalg.solve(V, E.astype(complex))
        y = ((np.exp(np.multiply.outer(t, poles)) - 1) * (weights / poles)).sum(axis=1).real + F
        return cls(t, y, float(-(weights / poles).sum().real + F))

    def measured(self, asked: StepMeasure) -> float:
        """Return what is asked, infinite where there is none."""
        if not len(self.t) or (asked.measure in RELATIVE and not self.final):
            return np.inf
        size, sign = abs(self.final), np.sign(self.final)
        match asked.measure:
            case "peak":
                return float(max(np.abs(self.y).max(), size))
            case "final":
                return size
            case "overshoot":
                return float(max((sign * self.y).max() / size - 1, 0.0))
            case "undershoot":
                return float(max(-(sign * self.y).min() / size, 0.0))
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
