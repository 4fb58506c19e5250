"""Files that name measurements and say what is sought: TOML, parsed and never executed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained
from polefence.base.files import read_text
from polefence.data.fit import MOST_MEASUREMENTS, identify, over_values
from polefence.data.grey import refined_ranges
from polefence.data.identified import Identified
from polefence.data.measured import FrequencyResponse, Measurement, Response
from polefence.data.table import Columns, read_columns
from polefence.plant.outputs import split
from polefence.plant.parameters import Parameter
from polefence.plant.spec import MAX_BYTES, parse
from polefence.plant.system import Array

TIMES = {"s": 1.0, "ms": 1e-3}
FREQUENCIES = {"Hz": 2 * np.pi, "rad/s": 1.0}
ANGLES = {"deg": np.pi / 180, "rad": 1.0}
_BOTH = {"name", "inputs", "outputs", "hold", "columns", "measurement"}
_BLACK = {"order", "degree", "disturbances", "direct", "unstable", "parameter"}
_GREY = {"spec", "unknown", "margin"}


@dataclass(frozen=True)
class Question:
    """What a file of measurements asks.

    Attributes
    ----------
    source : str
        The file, for messages.
    measurements : tuple of Measurement
    asked : mapping
        Of `identify`, or of `refined_ranges` where there is a spec.
    spec : Path, optional
        Whose unknown parameters are sought.
    """

    source: str
    measurements: tuple[Measurement, ...]
    asked: Mapping[str, Any]
    spec: Path | None = None

    def answer(self) -> Identified:
        """Return the family.

        Raises
        ------
        InputError
            If there is none; the file is named.
        """
        try:
            if self.spec is None:
                return identify(self.measurements, **self.asked)
            return refined_ranges(self.spec, self.measurements, **self.asked)
        except InputError as error:
            raise type(error)(f"{self.source}: {error}") from error


@explained
def load_measurements(path: str | Path) -> Question:
    """Read a file that names measurements, and these.

    Raises
    ------
    InputError
        If a file is missing, or says something that cannot be used: one line that names it.
    """
    path = Path(path)
    data = parse(read_text(path, MAX_BYTES, SpecError), str(path))
    try:
        return _question(path, data)
    except InputError as error:
        named = str(error).startswith(str(path.parent / "")) and path.parent != Path(".")
        text = str(error) if named else f"{path}: {error}"
        raise InputError(text) from error


def _question(path: Path, data: Mapping[str, Any]) -> Question:
    grey = "spec" in data
    _known(data, _BOTH | (_GREY if grey else _BLACK), "")
    labels = {key: _texts(data, key) for key in ("inputs", "outputs")}
    acting = labels["inputs"] + (() if grey else _texts(data, "disturbances", ()))
    read = _Reader(
        path.parent,
        tuple(map(split, acting)),
        tuple(map(split, labels["outputs"])),
        _strings(data.get("columns", {}), "columns"),
        _word(data, "hold", ("linear", "held"), "linear"),
    )
    measurements = tuple(read.each(data.get("measurement")))
    asked: dict[str, Any] = dict(labels)
    if grey:
        asked |= {"unknown": _texts(data, "unknown"), "margin": _number(data, "margin", 0.0)}
        return Question(str(path), measurements, asked, path.parent / _text(data, "spec"))
    asked |= {key: _texts(data, key, ()) for key in ("disturbances", "direct")}
    asked |= {"name": _text(data, "name", "plant"), "order": _whole(data, "order", None)}
    asked |= {"degree": _whole(data, "degree", 1)}
    unstable = data.get("unstable", False)
    if not isinstance(unstable, bool):
        raise InputError(f"unstable = {shown(unstable)} must be true or false")
    asked |= {"unstable": unstable, "parameters": _parameters(data, measurements)}
    return Question(str(path), measurements, asked)


def _parameters(
    data: Mapping[str, Any], measurements: Sequence[Measurement]
) -> tuple[Parameter, ...]:
    tables, found = data.get("parameter", {}), list[Parameter]()
    if not isinstance(tables, dict):
        raise InputError("parameter must be a table; write [parameter.NAME]")
    used = dict.fromkeys(name for own in measurements for name in own.at)
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(f"parameter.{name} must be a table; write [parameter.{name}]")
        _known(table, {"unit", "label", "through"}, f"parameter.{name}: ")
        words = _strings(table, f"parameter.{name}")
        if name not in used:
            raise InputError(
                f"parameter.{name}: no measurement has its value; write at = {{{name} = ...}}"
            )
        found.append(over_values(name, measurements, **words))
    for name in used:
        if name not in tables:
            found.append(over_values(name, measurements))
    return tuple(found)


@dataclass(frozen=True)
class _Reader:
    """What reads measurements.

    Attributes
    ----------
    folder : Path
        In which files are.
    acting, measured : tuple of (name, unit)
        Signals.
    columns : mapping
        Names that a file has for them.
    hold : str
    """

    folder: Path
    acting: tuple[tuple[str, str], ...]
    measured: tuple[tuple[str, str], ...]
    columns: Mapping[str, str]
    hold: str

    def each(self, tables: Any) -> list[Measurement]:
        """Return measurements, a table each."""
        if not isinstance(tables, list) or not tables:
            raise InputError("measurement is missing; write [[measurement]], file = ...")
        if len(tables) > MOST_MEASUREMENTS:
            raise InputError(f"{len(tables)} measurements; at most {MOST_MEASUREMENTS}")
        found = list[Measurement]()
        for k, table in enumerate(tables, 1):
            where = f"measurement {k}"
            if not isinstance(table, dict):
                raise InputError(f"{where} must be a table; write [[measurement]]")
            _known(table, {"file", "at"}, f"{where}: ")
            found.append(self._one(_text(table, "file", None, f"{where}: "), _at(table, where)))
        return found

    def _one(self, file: str, at: dict[str, float]) -> Measurement:
        columns = read_columns(self.folder / file)
        unit = columns.units[columns.first]
        if unit in TIMES:
            return self._response(columns, at, file)
        if unit in FREQUENCIES:
            return self._frequency_response(columns, at, file)
        raise InputError(
            f"{columns.source}: the first column is {columns.first!r}; a response has 'time [s]', "
            "a frequency response 'frequency [Hz]' or 'frequency [rad/s]'"
        )

    def _response(self, columns: Columns, at: dict[str, float], file: str) -> Response:
        time = columns.values[columns.first] * TIMES[columns.units[columns.first]]
        u, y = (
            np.array([columns.of(self.columns.get(name, name), unit) for name, unit in signals])
            for signals in (self.acting, self.measured)
        )
        inputs, outputs = (tuple(name for name, _ in s) for s in (self.acting, self.measured))
        hold = "held" if self.hold == "held" else "linear"
        return Response(time, u, y, at, inputs, outputs, hold, file)  # type: ignore[arg-type]

    def _frequency_response(
        self, columns: Columns, at: dict[str, float], file: str
    ) -> FrequencyResponse:
        frequency = columns.values[columns.first] * FREQUENCIES[columns.units[columns.first]]
        values = np.full((len(self.measured), len(self.acting), len(frequency)), np.nan + 0j)
        for i, (output, of_output) in enumerate(self.measured):
            for j, (inside, of_input) in enumerate(self.acting):
                pair = f"{output} from {inside}"
                unit = f"{of_output}/{of_input}" if of_output and of_input else ""
                found = self._pair(columns, self.columns.get(pair, pair), unit)
                if found is not None:
                    values[i, j] = found
        if np.isnan(values).all():
            raise InputError(
                f"{columns.source}: no column such as 'magnitude of {pair}' and 'phase of {pair} "
                f"[deg]', or 'real part of {pair}' and 'imaginary part of {pair}'"
            )
        inputs, outputs = (tuple(name for name, _ in s) for s in (self.acting, self.measured))
        return FrequencyResponse(frequency, values, at, inputs, outputs, file)

    def _pair(self, columns: Columns, pair: str, unit: str) -> Array | None:
        """Return the values of one pair, in this unit; None of one that is not in the file."""
        for first, second in (("real part", "imaginary part"), ("magnitude", "phase")):
            names = f"{first} of {pair}", f"{second} of {pair}"
            there = [name for name in names if name in columns.values]
            if len(there) == 1:
                (gone,) = {*names} - {*there}
                raise InputError(
                    f"{columns.source}: has {there[0]!r} and no {gone!r}; a fit needs both"
                )
            if not there:
                continue
            one, two = (columns.values[name] for name in names)
            own = columns.units[names[0]]
            if own and own != "dB" and not _alike(own, unit):
                raise InputError(
                    f"{columns.source}: {names[0]!r} is in {shown(own)}, the pair in "
                    f"{shown(unit)}; convert it"
                )
            if first == "real part":
                return np.asarray(one + 1j * two)
            angle = columns.units[names[1]] or "deg"
            if angle not in ANGLES:
                raise InputError(
                    f"{columns.source}: {names[1]!r} is in {shown(angle)}; give deg or rad"
                )
            size = 10 ** (one / 20) if own == "dB" else one
            return np.asarray(size * np.exp(1j * ANGLES[angle] * two))
        return None


def _alike(own: str, unit: str) -> bool:
    """Whether two units of a gain are written alike, but for brackets; so is one of none."""
    bare = (text.translate(str.maketrans("", "", "() ")) for text in (own, unit))
    return not unit or len(set(bare)) == 1


def _at(table: Mapping[str, Any], where: str) -> dict[str, float]:
    at = table.get("at", {})
    if not isinstance(at, dict):
        raise InputError(f"{where}: at = {shown(at)} must be a table; write at = {{load = 200}}")
    return {name: _finite(value, f"{where}: at.{name}") for name, value in at.items()}


def _finite(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | Fraction):
        raise InputError(f"{where} = {shown(value)} must be a finite number")
    return float(value)


def _number(data: Mapping[str, Any], key: str, default: float) -> float:
    return _finite(data[key], key) if key in data else default


def _whole(data: Mapping[str, Any], key: str, default: int | None) -> int:
    if key not in data and default is not None:
        return default
    if type(data.get(key)) is not int:
        raise InputError(f"{key} = {shown(data.get(key))} must be a whole number")
    return int(data[key])


def _text(data: Mapping[str, Any], key: str, default: str | None = None, where: str = "") -> str:
    value = data.get(key, default)
    if not isinstance(value, str):
        raise InputError(f"{where}{key} = {shown(value)} must be text")
    return value


def _word(data: Mapping[str, Any], key: str, known: Sequence[str], default: str) -> str:
    value = _text(data, key, default)
    if value not in known:
        raise InputError(f"{key} = {shown(value)} is unknown; {suggest(value, known)}")
    return value


def _texts(
    data: Mapping[str, Any], key: str, default: tuple[str, ...] | None = None
) -> tuple[str, ...]:
    value = data.get(key, default)
    if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
        raise InputError(f'{key} = {shown(value)} must be a list of names, ["force [N]"]')
    return tuple(value)


def _strings(table: Any, where: str) -> dict[str, str]:
    if not isinstance(table, dict) or not all(isinstance(item, str) for item in table.values()):
        raise InputError(f"{where} must be a table of texts")
    return dict(table)


def _known(table: Mapping[str, Any], known: set[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise InputError(f"{where}unknown key {shown(key)}; {suggest(key, known)}")
