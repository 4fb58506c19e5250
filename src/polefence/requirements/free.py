"""Free motions: how large and how calm a signal is from an initial state, or after an impulse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar, Self

import numpy as np

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import rows_at, states
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.requirements.measured import Measured, Near
from polefence.requirements.slopes import Channel
from polefence.requirements.specification import Row, disturbance, is_number, number


@dataclass(frozen=True)
class InitialMeasure(Measured):
    """A measure of a signal from an initial state, without disturbances.

    Attributes
    ----------
    measure : str
        "peak", the largest absolute value; "settling", the time after which the signal stays within
        ``band`` of zero [s]; "envelope", how many times as wide as it is an ``envelope`` must be.
    band : float, optional
        Of a settling time, in the signal's unit.
    envelope : sequence of (float, float, float), optional
        Times [s], lower and upper numbers between which the signal is to stay: linear between the
        times, the last for ever after.
    start : mapping of str to float
        States that are not zero at first, in their units. Held as pairs of name and number.
    """

    start: Any = field(default=(), kw_only=True)
    kind = "initial"
    keys: ClassVar[tuple[str, ...]] = ("measure", "band", "envelope", "start")
    moved_by = "start"
    claimed = proof.InitialResponse

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if self.disturbances is not None:
            raise InputError(f"a {self.kind} response takes no disturbances; leave them out")
        pairs = list(self.start.items()) if isinstance(self.start, Mapping) else self.start
        try:
            pairs = [(name, x) for name, x in pairs]
        except (TypeError, ValueError):
            pairs = []
        for name, x in pairs:
            if not (isinstance(name, str) and is_number(x)):
                raise InputError(f"start: {shown(name)} = {shown(x)} must be a finite number")
        if not any(x for _, x in pairs):
            raise InputError(
                f"{self.name!r}: give the states that are not zero at first, in their units: "
                'start = {"NAME" = 0.1}'
            )
        self._settle("start", tuple((name, float(x)) for name, x in pairs))

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        table, start = dict(row.table), row.table.get("start", {})
        if not isinstance(start, Mapping):
            raise SpecError(
                f'start = {shown(start)} must be a table of states and numbers: {{"NAME" = 0.1}}'
            )
        own = {name: number(x, f"start.{name}") for name, x in start.items()}
        return super().read(Row(table | {"start": own}, row.where, row.density))

    @classmethod
    def _more(cls, row: Row) -> dict[str, Any]:
        return {"start": row.table["start"]}

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse states that it has not, and a plant of which none is proved."""
        self._begun(plant)
        super().require_fit(plant)

    def _begun(self, plant: UncertainPlant) -> tuple[float, ...]:
        """Return x(0).

        Raises
        ------
        InputError
            If there is no state of a name.
        """
        names, chosen = [x.name for x in states(plant)], dict(self.start)
        for name in chosen:
            if name not in names:
                raise InputError(f"start: no state {name!r}; {suggest(name, names)}")
        return tuple(chosen.get(name, 0.0) for name in names)

    def scales(self, plant: UncertainPlant) -> tuple[float, ...]:  # noqa: ARG002
        """Return nothing: no disturbance acts."""
        return ()

    def scaled(self, plant: UncertainPlant, matrices: Any) -> Any:  # noqa: ARG002
        """Return zero: no disturbance acts."""
        return 0.0 * matrices

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return the channel with the state as the column of E."""
        C, D, _ = rows_at(plant, self.outputs(plant), alpha)
        E = np.tile(np.array(self._begun(plant))[:, None], (len(alpha), 1, 1))
        S = np.zeros((plant.disturbance_count, 1))
        return Channel(*plant.at(alpha), E, C, D, np.zeros((len(alpha), 1, 1)), S)

    def _claimed(self, plant: UncertainPlant) -> dict[str, Any]:
        return super()._claimed(plant) | {"start": tuple(map(Fraction, self._begun(plant)))}

    def near(self, **own: Any) -> InitialNearness:
        """Return how near the signal is from a time on."""
        return InitialNearness(**own)


@dataclass(frozen=True)
class InitialNearness(Near, InitialMeasure):
    """How near a signal is to zero from a time on: at most one where it is in the band."""


@dataclass(frozen=True)
class ImpulseMeasure(Measured):
    """A measure of a signal's response to an impulse of the disturbances, from rest.

    Attributes
    ----------
    measure, band, envelope
        As `InitialMeasure` has them.
    disturbances : sequence of str, or mapping of str to float, optional
        Those that have an impulse, at once, each of so much [its unit times s]; all of one unless
        said.
    """

    kind = "impulse"
    claimed = proof.ImpulseResponse

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without a disturbance, or of which none is proved."""
        disturbance(plant)
        self.scales(plant)
        self.exact_outputs(plant)
        super().require_fit(plant)

    def near(self, **own: Any) -> ImpulseNearness:
        """Return how near the signal is from a time on."""
        return ImpulseNearness(**own)


@dataclass(frozen=True)
class ImpulseNearness(Near, ImpulseMeasure):
    """How near a signal is to zero from a time on: at most one where it is in the band."""
