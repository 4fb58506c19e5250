"""What was measured of a plant at known values of its parameters, in time or frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.base.explained import explained, explained_fields
from polefence.base.frozen import Frozen
from polefence.plant.outputs import split
from polefence.plant.parameters import check_label
from polefence.plant.system import Array
from polefence.proof.fitted import FREQUENCY, TIME
from polefence.proof.short import Short

MOST_SAMPLES = 200_000  # of one measurement
JITTER = 0.01  # of a time between samples
LEAST = 4  # samples

At = Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Response(Short):
    """A measured response in time.

    Parameters
    ----------
    time : (count,) array
        Evenly spaced [s].
    inputs : (m, count) array
        What acted: inputs and disturbances.
    outputs : (p, count) array
        What was measured; each may be off by a constant of its own.
    at : mapping of str to float
        Values of the parameters.
    input_names, output_names : tuple of str
        Names, without units.
    hold : str
        Between samples inputs are "linear" or "held".
    name : str
        Of the measurement: of its file.

    Raises
    ------
    InputError
        If shapes do not fit, numbers are not finite, or times are not evenly spaced.
    """

    time: Array
    inputs: Array
    outputs: Array
    at: At = field(default_factory=dict)
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    hold: Literal["linear", "held"] = "linear"
    name: str = "response"

    kind = TIME

    @explained_fields
    def __post_init__(self) -> None:
        time = _grid(self.time, "time", self.name)
        steps = np.diff(time)
        mean = float(time[-1] - time[0]) / (len(time) - 1)
        if np.abs(steps - mean).max() > JITTER * mean:
            k = int(np.argmax(np.abs(steps - mean)))
            raise InputError(
                f"{self.name}: times are not evenly spaced: {steps[k]:g} s behind {time[k]:g} s, "
                f"{mean:g} s on average; interpolate at even times"
            )
        if self.hold not in ("linear", "held"):
            raise InputError(f"{self.name}: hold = {shown(self.hold)} must be 'linear' or 'held'")
        for key in ("inputs", "outputs"):
            values = np.atleast_2d(np.array(getattr(self, key), dtype=float))
            if values.ndim != 2 or values.shape[1] != len(time):
                raise InputError(
                    f"{self.name}: {key} have shape {values.shape}; {len(time)} times need a row "
                    "of so many for each"
                )
            if not np.isfinite(values).all():
                raise InputError(f"{self.name}: {key} hold what is no finite number")
            object.__setattr__(self, key, _locked(values))
        object.__setattr__(self, "time", _locked(time))
        _name(self, self.inputs.shape[0], self.outputs.shape[0])

    @property
    def step(self) -> float:
        """Time between samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def count(self) -> int:
        """How many samples it has."""
        return len(self.time)

    def __repr__(self) -> str:
        return f"<Response {self.name!r}: {self.count} samples every {self.step:g} s>"


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Short):
    """A measured frequency response.

    Parameters
    ----------
    frequency : (count,) array
        Rising [rad/s].
    values : (p, m, count) complex array
        From each input to each output; nan for a pair that was not measured.
    at : mapping of str to float
        Values of the parameters.
    input_names, output_names : tuple of str
        Names, without units.
    name : str
        Of the measurement: of its file.

    Raises
    ------
    InputError
        If shapes do not fit, numbers are not finite, or frequencies do not rise from above zero.
    """

    frequency: Array
    values: Array
    at: At = field(default_factory=dict)
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    name: str = "frequency response"

    kind = FREQUENCY

    @explained_fields
    def __post_init__(self) -> None:
        grid = _grid(self.frequency, "frequency", self.name)
        if grid[0] <= 0:
            raise InputError(f"{self.name}: frequency = {grid[0]:g} must be above zero")
        values = np.array(self.values, dtype=complex)
        values = values.reshape((1, 1, -1)) if values.ndim == 1 else values
        if values.ndim != 3 or values.shape[2] != len(grid):
            raise InputError(
                f"{self.name}: values have shape {values.shape}; {len(grid)} frequencies need "
                "(outputs, inputs, frequencies)"
            )
        gone = np.isnan(values)
        if (gone.any(axis=2) != gone.all(axis=2)).any() or np.isinf(values).any() or gone.all():
            raise InputError(f"{self.name}: values hold what is no finite number")
        object.__setattr__(self, "values", _locked(values))
        object.__setattr__(self, "frequency", _locked(grid))
        _name(self, values.shape[1], values.shape[0])

    @property
    def count(self) -> int:
        """How many frequencies it has."""
        return len(self.frequency)

    def __repr__(self) -> str:
        ends = f"{self.frequency[0]:.3g} to {self.frequency[-1]:.3g} rad/s"
        return f"<FrequencyResponse {self.name!r}: {self.count} frequencies, {ends}>"


Measurement = Response | FrequencyResponse


def _locked(values: Array) -> Array:
    values.flags.writeable = False
    return values


def _grid(values: Any, what: str, name: str) -> Array:
    grid = np.array(values, dtype=float)
    if grid.ndim != 1 or not LEAST <= len(grid) <= MOST_SAMPLES:
        raise InputError(f"{name}: {what} must be {LEAST} to {MOST_SAMPLES} numbers")
    if not np.isfinite(grid).all():
        raise InputError(f"{name}: {what} holds what is no finite number")
    falls = np.flatnonzero(np.diff(grid) <= 0)
    if len(falls):
        k = int(falls[0])
        raise InputError(
            f"{name}: {what} does not rise: sample {k + 2} is {grid[k + 1]:g}, behind {grid[k]:g}"
        )
    return grid


def _name(of: Measurement, m: int, p: int) -> None:
    """Store the names, by default u1, y1 and so on, and the values of the parameters."""
    check_label(of.name, "name of a measurement")
    for key, letter, count in (("input_names", "u", m), ("output_names", "y", p)):
        names = tuple(getattr(of, key)) or tuple(f"{letter}{k + 1}" for k in range(count))
        if len(names) != count or len(set(names)) < count:
            raise InputError(f"{of.name}: {key} must be {count} different names")
        object.__setattr__(of, key, tuple(split(name)[0] for name in names))
    values = {str(key): float(value) for key, value in of.at.items()}
    if not np.isfinite(list(values.values())).all():
        raise InputError(f"{of.name}: at holds what is no finite number")
    object.__setattr__(of, "at", Frozen(values))


@explained
def measured(response: Any, at: At | None = None, name: str = "", **more: Any) -> Measurement:
    """Return a response of python-control as a measurement.

    Parameters
    ----------
    response : FrequencyResponseData or TimeResponseData of python-control
        The second with the inputs that acted, as ``forced_response`` has them.
    at : mapping of str to float
        Values of the parameters.
    name : str
        Of the measurement.
    **more
        Of `Response` or `FrequencyResponse`: names in place of python-control's labels; ``hold``.

    Raises
    ------
    InputError
        If it is neither, or is no measurement.
    """
    labels = ("input_labels", "output_labels")
    names: dict[str, Sequence[str]] = {
        key.replace("labels", "names"): tuple(getattr(response, key, None) or ()) for key in labels
    }
    known: dict[str, Any] = {**names, **more, "at": dict(at or {})}
    if name:
        known["name"] = name
    if hasattr(response, "omega") and hasattr(response, "frdata"):
        return FrequencyResponse(response.omega, response.frdata, **known)
    if hasattr(response, "t") and hasattr(response, "y") and hasattr(response, "u"):
        y, u = np.array(response.y, dtype=float), response.u
        if u is None or getattr(response, "ntraces", 0) > 1:
            raise InputError("a time response needs the inputs that acted, in one trace")
        return Response(response.t, np.array(u, dtype=float), y, **known)
    raise InputError(
        f"{shown(response)} is no response: give FrequencyResponseData or TimeResponseData of "
        "python-control, polefence.data.Response or polefence.data.FrequencyResponse"
    )
