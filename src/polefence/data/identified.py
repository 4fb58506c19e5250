"""A family that was fitted to measurements: what it says in their place, and misses them by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polefence.base.errors import InputError, PlantError
from polefence.base.explained import explained
from polefence.base.files import write_text
from polefence.data.linear import transfer
from polefence.data.local import Signals, sizes
from polefence.data.measured import FrequencyResponse, Measurement
from polefence.data.read_back import model_at
from polefence.data.residual import Missed, misfits, missed, rest
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import data_lines, loads
from polefence.plant.system import Array
from polefence.proof.fitted import TIME, Data, Misfit
from polefence.proof.short import Short
from polefence.proof.text import digits_up


@dataclass(frozen=True, eq=False, repr=False)
class Identified(Short):
    """A family fitted to measurements, and what it misses them by.

    Attributes
    ----------
    plant : UncertainPlant
        With ``data``: whatever is said of it says that this is unproved.
    text : str
        Its spec.
    measurements : tuple of Measurement
    inputs, outputs : tuple of str
        Names of what acts, and of what is measured.
    unknowns : int
        How many coefficients were sought.
    values : tuple of mapping
        For each measurement the values of the parameters that the family has it at.
    missed : tuple of Misfit
        Of each measurement.
    """

    plant: UncertainPlant
    text: str
    measurements: tuple[Measurement, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    unknowns: int
    values: tuple[Mapping[str, float], ...]
    missed: tuple[Misfit, ...]

    @property
    def data(self) -> Data:
        """What it was fitted to, and what it misses that by."""
        if self.plant.data is None:
            raise PlantError(f"{self.plant.name} is not from data")
        return self.plant.data

    def __str__(self) -> str:
        return self.data.note

    def __repr__(self) -> str:
        return f"<Identified {self.plant!r}, {self.data.all.text}>"

    @explained
    def response(self, number: int) -> Array:
        """Return what the family says in place of a measurement, from 0.

        Returns
        -------
        (p, count) or (p, m, count) array
            Of ``outputs``, in time with the initial state and the constants that miss it least; of
            a frequency response from ``inputs``, complex.
        """
        own = self.measurements[number]
        model = model_at(self.plant, self._signals, self.values[number])
        if isinstance(own, FrequencyResponse):
            return np.asarray(transfer(model.A, model.B, model.C, model.D, own.frequency))
        left = rest(self._signals, model, own, sizes(self._signals, self.measurements))
        y = self._signals.sampled(own)[1]
        return np.full_like(y, np.nan) if left is None else y - left

    def measured(self, number: int) -> Array:
        """Return a measurement in the same order, from 0; nan where a pair was not measured."""
        own = self.measurements[number]
        if isinstance(own, FrequencyResponse):
            return self._signals.values(own)
        return self._signals.sampled(own)[1]

    @property
    def _signals(self) -> Signals:
        none = np.zeros((len(self.outputs), len(self.inputs)), dtype=bool)
        return Signals(self.inputs, self.outputs, none, self.plant.shape[0])

    @explained
    def save(self, path: str | Path) -> Path:
        """Write the spec, which every command and `load` read; return its path.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        path = Path(path)
        write_text(path, self.text)
        return path


def scale_of(signals: Signals, measurements: Sequence[Measurement]) -> Array | None:
    """Return the sizes of outputs in time; None of frequency responses."""
    if measurements[0].kind != TIME:
        return None
    scale = sizes(signals, measurements)
    for size, name in zip(scale, signals.outputs, strict=True):
        if not size > 0:
            raise InputError(f"output {name!r} does not move in any measurement; leave it out")
    return scale


def with_data(
    text: str,
    signals: Signals,
    measurements: Sequence[Measurement],
    values: Sequence[Mapping[str, float]],
    left_out: Sequence[Missed],
    unknowns: int,
) -> Identified:
    """Return the family that a spec says, and the spec with what it misses measurements by.

    The plant is read back from the text, so that the misfit is that of what is written.
    """
    plant, scale = loads(text), scale_of(signals, measurements)
    found = [
        missed(signals, model_at(plant, signals, at), own, scale)
        for own, at in zip(measurements, values, strict=True)
    ]
    every, outputs, place = misfits(signals, found)
    data = Data(
        measurements[0].kind,
        tuple(own.name for own in measurements),
        sum(own.count for own in measurements),
        _rounded(every),
        tuple((name, _rounded(own)) for name, own in outputs),
        place,
        _rounded(misfits(signals, left_out)[0]) if left_out else None,
    )
    text = text + "\n".join(data_lines(data)) + "\n"
    each = tuple(misfits(signals, [one])[0] for one in found)
    return Identified(
        loads(text), text, tuple(measurements), signals.inputs, signals.outputs, unknowns,
        tuple(values), each,
    )  # fmt: skip


def _rounded(misfit: Misfit) -> Misfit:
    """Return it with three digits, rounded up."""
    return Misfit(*(float(digits_up(value, 3)) for value in (misfit.rms, misfit.largest)))
