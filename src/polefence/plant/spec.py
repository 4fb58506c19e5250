"""TOML spec files: read into an UncertainPlant, written from one. Parsed, never executed."""

from __future__ import annotations

import itertools
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

from polefence.base.beside import say_beside
from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.explained import explained
from polefence.base.files import read_text
from polefence.plant.cars import Bar, Body, Car, Wheel, car_family
from polefence.plant.dampers import Damper
from polefence.plant.dead_time import require_sound, with_dead_time
from polefence.plant.expression import MAX_LENGTH, decimal, decimal_text, evaluate
from polefence.plant.family import Scope, UncertainPlant
from polefence.plant.larger import with_actuator, with_sensor
from polefence.plant.outputs import Output, split, weighted_sum
from polefence.plant.parameters import Parameter, check_label, exact
from polefence.plant.surface import Surface
from polefence.plant.system import Exact, System
from polefence.plant.tracks import Tracks
from polefence.plant.vehicle import Vehicle
from polefence.plant.weights import KEYS, with_reference, with_weight
from polefence.proof.dead_time import DeadTime
from polefence.proof.fitted import Data
from polefence.proof.functions import Table
from polefence.proof.ranges import ANY
from polefence.proof.reading import Table as Entries
from polefence.proof.remainder import Remainder
from polefence.proof.work import FormatError

MAX_BYTES = 1_000_000
# The parser's work grows with the square of a key's parts (a.b.c), of which ours have two.
DEEPEST = 16
DEEP_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{DEEPEST}}}")
_NAMES = ("states", "inputs", "disturbances", "noise")
QUARTER_CAR = "quarter car"  # the one model of a vehicle
SUM = "sum"  # the key of an output that is a sum of signals
_TOP = {"name", "region", "sample_time", "specification", "road", *_NAMES}
_TOP |= {"outputs", "vehicle", "constants", "parameter", "definitions", "matrices", "vertex"}
_TOP |= {"actuator", "dead_time", "sensor", "damper", "law", "car", "table", "reference", "weight"}
_TOP |= {"data"}
_OF_BODY = {"mass": "mass", "pitch_inertia": "pitch", "roll_inertia": "roll"}
_OF_BODY |= {"felt": "felt", "height": "height"}
_OF_WHEEL = ("mass", "spring", "damper", "tyre")
# What is put around a plant, in this order: its function, the keys that it needs, and others.
_HARDWARE: dict[str, tuple[Callable[..., UncertainPlant], tuple[str, ...], set[str]]] = {
    "actuator": (with_actuator, ("bandwidth",), {"order", "damping"}),
    "dead_time": (with_dead_time, ("time",), {"order", "decay"}),
    "sensor": (with_sensor, (), {"bandwidth", "noise"}),
}


@explained
def load(path: str | Path) -> UncertainPlant:
    """Read a plant family from a TOML spec, with its actuators and sensors; decimals are exact.

    Raises
    ------
    SpecError
        If the file is missing, too long, no TOML, or says something that cannot be used. The
        message is one line with file, key, value and remedy.
    """
    return loads(read_text(Path(path), MAX_BYTES, SpecError), str(path))


def loads(text: str, source: str = "spec") -> UncertainPlant:
    """Read a plant family from the text of a spec; see `load`."""
    data = parse(text, source)
    try:
        plant = _with_sums(_plant(data), data)
        require_sound(plant)
        plant = _with_weights(_with_hardware(plant, data), data)
    except InputError as error:
        raise type(error)(f"{source}: {_one_line(error)}") from error
    if plant.data is not None:
        say_beside(plant.data.note)
    return plant


def region_text(path: str | Path) -> str | None:
    """Return the region that a spec asks for as it is written, None where it asks for none.

    Raises
    ------
    SpecError
        If the file is missing, too long, no TOML, or its region is no text.
    """
    text = parse(read_text(Path(path), MAX_BYTES, SpecError), str(path)).get("region")
    try:
        return None if text is None else _text(text, "region")
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error


def specification_tables(path: str | Path) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """Return the tables ``[[specification]]`` of a spec and its ``[road]``, as they are written.

    Raises
    ------
    SpecError
        If the file is missing, too long, no TOML, or these are no tables.
    """
    data = parse(read_text(Path(path), MAX_BYTES, SpecError), str(path))
    try:
        return _requirements(data)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error


def law_table(path: str | Path) -> dict[str, Any] | None:
    """Return the table ``[law]`` of a spec as it is written, None where it has none.

    Raises
    ------
    SpecError
        If the file is missing, too long, no TOML, or this is no table.
    """
    data = parse(read_text(Path(path), MAX_BYTES, SpecError), str(path))
    try:
        return _law(data)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error


@explained
def load_dampers(path: str | Path) -> tuple[Damper, ...]:
    """Return the controllable dampers of a spec's tables ``[damper."FORCE"]``.

    Raises
    ------
    SpecError
        If the file is missing, too long, no TOML, or a table says something that cannot be used.
    """
    data = parse(read_text(Path(path), MAX_BYTES, SpecError), str(path))
    try:
        return _dampers(data)
    except InputError as error:
        raise SpecError(f"{path}: {error}") from error


def _points(value: Any, where: str) -> list[tuple[Any, Any]]:
    """Return the points of a damper's curve."""
    if not isinstance(value, list) or not value:
        raise SpecError(f"{where} = {shown(value)} must be points, [[RATE, FORCE], ...]")
    points = list[tuple[Any, Any]]()
    for k, pair in enumerate(value):
        said = f"{where}: point {k + 1}"
        if not isinstance(pair, list) or len(pair) != 2:
            raise SpecError(f"{said} must be [RATE in m/s, FORCE in N]")
        points.append((_finite(pair[0], said), _finite(pair[1], said)))
    return points


def _dampers(data: Mapping[str, Any]) -> tuple[Damper, ...]:
    tables, dampers = data.get("damper", {}), list[Damper]()
    if not isinstance(tables, dict):
        raise SpecError('damper must be a table; write [damper."FORCE"]')
    for name, table in tables.items():
        where = f"damper.{shown(name)}"
        if not isinstance(table, dict):
            raise SpecError(f'{where} must be a table; write [damper."FORCE"], range = [300, 3000]')
        _known(table, {"deflection", "range", "low", "high"}, f"{where}: ")
        _need(table, ("deflection",), where)
        low: Any
        high: Any
        straight = "range" in table
        if straight == ("low" in table) or ("low" in table) != ("high" in table):
            raise SpecError(
                f"{where}: write range = [300, 3000], or low and high, each [[RATE, FORCE], ...]"
            )
        if straight:
            bounds = table["range"]
            if not isinstance(bounds, list) or len(bounds) != 2:
                raise SpecError(
                    f"{where}: range = {shown(bounds)} must be [LOWEST, HIGHEST] in N s/m"
                )
            low, high = (_finite(c, f"{where}: range") for c in bounds)
        else:
            low, high = (_points(table[key], f"{where}: {key}") for key in ("low", "high"))
        dampers.append(Damper(name, _text(table["deflection"], f"{where}: deflection"), low, high))
    return tuple(dampers)


def _law(data: Mapping[str, Any]) -> dict[str, Any] | None:
    table = data.get("law")
    if table is not None and not isinstance(table, dict):
        raise SpecError("law must be a table; write [law]")
    return table


def _requirements(data: Mapping[str, Any]) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    tables, road = data.get("specification", []), data.get("road")
    if not isinstance(tables, list):
        raise SpecError("specification must be an array of tables; write [[specification]]")
    if road is not None and not isinstance(road, dict):
        raise SpecError("road must be a table; write [road]")
    return _tables(tables, "specification"), road


def parse(text: str, source: str) -> dict[str, Any]:
    """Return a spec as tables, decimals exact; says nothing of what they mean.

    Raises
    ------
    SpecError
        If it is no TOML.
    """
    quoted = re.findall(r"[\"'][ \t]*\.", text)
    if DEEP_KEY.search(text) or len(quoted) > 200:
        raise SpecError(f"{source}: a key of more than {DEEPEST} parts; a spec has at most 2")
    try:
        return tomllib.loads(text, parse_float=_number)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        hint = "expressions go in quotes, units in comments, decimals take a point"
        if text.lstrip().startswith("{"):
            hint = "this looks like a design file; a spec is TOML, see polefence example"
        raise SpecError(f"{source}: not valid TOML: {_one_line(error)}; {hint}") from error


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _number(text: str) -> Decimal | Fraction:
    # nan and inf stay what they are here and are refused where their key is known.
    return Decimal(text) if text.lstrip("+-") in ("nan", "inf") else decimal(text)


def _plant(data: Mapping[str, Any]) -> UncertainPlant:
    _known(data, _TOP, "")
    names: dict[str, Any] = {key: _strings(data[key], key) for key in _NAMES if key in data}
    names["name"] = _text(data.get("name", "plant"), "name")
    _text(data.get("region", ""), "region")
    _requirements(data)
    _law(data)
    _dampers(data)
    if "sample_time" in data:
        names["sample_time"] = _sample_time(data["sample_time"])
    if "vehicle" in data:
        names["vehicle"] = _vehicle(data["vehicle"])
    if "data" in data:
        names["data"] = _fitted(data["data"])
    if "vertex" in data:
        for key in ("constants", "parameter", "definitions", "matrices", "car", "table"):
            if key in data:
                raise SpecError(f"{key} and vertex exclude each other; keep one")
        _without_tracks(data)
        return _from_vertices(data["vertex"], names | {"outputs": _outputs(data)})
    if "car" in data:
        for key in ("matrices", "states", "inputs", "disturbances", "table"):
            if key in data:
                raise SpecError(f"{key} and car exclude each other; keep one")
        return _from_car(data, names)
    _without_tracks(data)
    if "matrices" not in data:
        raise SpecError(
            "neither [[vertex]] nor [matrices] nor [car] is given; give A and B, or a car"
        )
    return _from_expressions(data, names)


def _with_hardware(plant: UncertainPlant, data: Mapping[str, Any]) -> UncertainPlant:
    """Return the plant behind the actuators and sensors of a spec."""
    for key, (put, needed, others) in _HARDWARE.items():
        tables = data.get(key, {})
        if not isinstance(tables, dict):
            raise SpecError(f"{key} must be a table; write [{key}.NAME]")
        for name, table in tables.items():
            where = f"{key}.{shown(name)}"
            if not isinstance(table, dict):
                example = "time = 0.02" if key == "dead_time" else "bandwidth = 30"
                raise SpecError(f'{where} must be a table; write [{key}."NAME"], {example}')
            _known(table, others.union(needed), f"{where}: ")
            _need(table, needed, where)
            values = {k: _number_of(v, f"{where}: {k}") for k, v in table.items()}
            plant = put(plant, name, **values)
    return plant


def _number_of(value: Any, where: str) -> Any:
    """Return a number, a whole one as such, or the two ends of an interval."""
    if isinstance(value, list):
        return [_finite(end, where) for end in value]
    number = _finite(value, where)
    return int(number) if isinstance(value, int) else number


def _with_weights(plant: UncertainPlant, data: Mapping[str, Any]) -> UncertainPlant:
    """Return the plant with the references and the weights of a spec."""
    for name, table in _table(data, "reference").items():
        where = f"reference.{shown(name)}"
        if not isinstance(table, dict):
            raise SpecError(f'{where} must be a table; write [reference."NAME"], signal = "..."')
        _known(table, {"signal"}, f"{where}: ")
        _need(table, ("signal",), where)
        given = table["signal"]
        plant = with_reference(
            plant, name, _strings([given] if isinstance(given, str) else given, f"{where}: signal")
        )
    tables = data.get("weight", [])
    if not isinstance(tables, list):
        raise SpecError("weight must be an array of tables; write [[weight]]")
    for k, table in enumerate(_tables(tables, "weight")):
        where = f"weight {k + 1}"
        _known(table, {"signal", "name", *KEYS}, f"{where}: ")
        _need(table, ("signal",), where)
        signal, name = (_text(table.get(key, ""), f"{where}: {key}") for key in ("signal", "name"))
        rest = {key: value for key, value in table.items() if key in KEYS}
        plant = with_weight(plant, signal, rest, name)
    return plant


def _sample_time(value: Any) -> Fraction:
    if isinstance(value, str):
        value = _constant(value, "sample_time")
    seconds = _finite(value, "sample_time")
    if seconds <= 0:
        raise SpecError(f"sample_time = {float(seconds):g} must be positive, in seconds")
    return seconds


def _text(value: Any, key: str) -> str:
    if not isinstance(value, str):
        raise SpecError(f"{key} must be a string")
    return value


def _vehicle(table: Any) -> Vehicle:
    if not isinstance(table, dict):
        raise SpecError("vehicle must be a table; write [vehicle]")
    known = {field.name for field in fields(Vehicle)}
    _known(table, {"model", *known}, "vehicle: ")
    _need(table, ("model",), "vehicle")
    model = _text(table["model"], "vehicle.model")
    if model != QUARTER_CAR:
        raise SpecError(f"vehicle.model = {shown(model)} is unknown; use {QUARTER_CAR!r}")
    return Vehicle(**{k: _text(table[k], f"vehicle.{k}") for k in known & set(table)})


def _outputs(data: Mapping[str, Any]) -> tuple[Output, ...]:
    """Return outputs in numbers: one row for all vertices, or one a vertex."""
    return tuple(
        Output(*split(label), **{k: _constant_matrix(M, f"outputs.{label}.{k}") for k, M in rows})
        for label, rows in ((label, rows.items()) for label, rows in _output_tables(data).items())
    )


def _with_sums(plant: UncertainPlant, data: Mapping[str, Any]) -> UncertainPlant:
    """Return the plant with the outputs that are sums of its signals, one after the other."""
    for label, table in data.get("outputs", {}).items():
        if SUM not in table:
            continue
        where, terms = f"outputs.{shown(label)}", table[SUM]
        if len(table) > 1 or not isinstance(terms, dict) or not terms:
            raise SpecError(f'{where}: write {{sum = {{"SIGNAL" = 0.5}}}}, and nothing beside it')
        weights = {name: _finite(_constant(x, where), where) for name, x in terms.items()}
        try:
            pairs = [(x, plant.signal(name)) for name, x in weights.items()]
            plant = replace(
                plant, outputs=(*plant.outputs, weighted_sum(*split(label), terms=pairs))
            )
        except InputError as error:
            raise SpecError(f"{where}: {error}") from error
    return plant


def _output_tables(data: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return outputs by their label, with lists of rows."""
    tables, outputs = data.get("outputs", {}), dict[str, dict[str, Any]]()
    if not isinstance(tables, dict):
        raise SpecError('outputs must be a table; write [outputs], "name [unit]" = {C = [...]}')
    for label, table in tables.items():
        where = f"outputs.{shown(label)}"
        if not isinstance(table, dict):
            raise SpecError(f"{where} must be a table, {{C = [...], D = [...], F = [...]}}")
        if SUM in table:
            continue
        _known(table, set("CDF"), f"{where}: ")
        if not table:
            raise SpecError(f"{where} is empty; give a row C, D or F, or a sum")
        outputs[label] = {}
        for key, value in table.items():
            rows = value if isinstance(value, list) and value and _is_rows(value) else [value]
            outputs[label][key] = _rows(rows, f"{where}.{key}")
    return outputs


def _is_rows(value: list[Any]) -> bool:
    return all(isinstance(row, list) for row in value)


def _from_vertices(tables: Any, names: dict[str, Any]) -> UncertainPlant:
    if not isinstance(tables, list):
        raise SpecError("vertex must be an array of tables; write [[vertex]]")
    matrices: dict[str, list[Any]] = {"A": [], "B": [], "E": []}
    for j, table in enumerate(_tables(tables, "vertex")):
        _known(table, {"A", "B", "E"}, f"vertex {j + 1}: ")
        _need(table, ("A", "B"), f"vertex {j + 1}")
        for letter, where in matrices.items():
            if letter in table:
                where.append(_constant_matrix(table[letter], f"vertex {j + 1}: {letter}"))
    if matrices["E"] and len(matrices["E"]) < len(matrices["A"]):
        raise SpecError("E is given for some vertices only; give it for all or for none")
    return UncertainPlant.from_vertices(
        matrices["A"], matrices["B"], matrices["E"] or None, **names
    )


def _from_expressions(data: Mapping[str, Any], names: dict[str, Any]) -> UncertainPlant:
    parameters, constants, definitions = _names_of(data)
    matrices = _table(data, "matrices")
    _known(matrices, {"A", "B", "E"}, "matrices: ")
    _need(matrices, ("A", "B"), "matrices")
    return UncertainPlant.from_expressions(
        parameters,
        _rows(matrices["A"], "matrices.A"),
        _rows(matrices["B"], "matrices.B"),
        _rows(matrices["E"], "matrices.E") if "E" in matrices else None,
        constants=constants,
        definitions=definitions,
        outputs={label: _single(label, rows) for label, rows in _output_tables(data).items()},
        tables=_interpolated(data),
        **names,
    )


def _interpolated(data: Mapping[str, Any]) -> dict[str, Table | Surface]:
    """Return the tables that expressions interpolate in, by name."""
    tables = dict[str, Table | Surface]()
    for name, row in _table(data, "table").items():
        where = f"table.{shown(name)}"
        if not isinstance(row, dict):
            raise SpecError(f"{where} must be a table; write [table.NAME], arguments = [0, 1]")
        _known(row, {"arguments", "values", "interpolation"}, f"{where}: ")
        _need(row, ("arguments", "values"), where)
        arguments, values = (row[key] for key in ("arguments", "values"))
        kind = _text(row.get("interpolation", "linear"), f"{where}: interpolation")
        if kind not in ("linear", "cubic"):
            raise SpecError(f"{where}: interpolation = {shown(kind)} must be 'linear' or 'cubic'")
        table: Table | Surface
        if isinstance(arguments, list) and arguments and isinstance(arguments[0], list):
            if kind != "linear" or len(arguments) != 2:
                raise SpecError(
                    f"{where}: a table of two arguments has two lists of them, and is 'linear'"
                )
            first, second = (_listed(x, f"{where}: arguments") for x in arguments)
            rows = values if isinstance(values, list) else [values]
            table = Surface(first, second, tuple(_listed(x, f"{where}: values") for x in rows))
        else:
            knots, heights = (_listed(row[k], f"{where}: {k}") for k in ("arguments", "values"))
            table = Table(knots, heights, kind == "cubic")
        tables[name] = table
    return tables


def _listed(values: Any, where: str) -> tuple[Fraction, ...]:
    if not isinstance(values, list):
        raise SpecError(f"{where} = {shown(values)} must be a list of numbers")
    return tuple(_finite(_constant(x, where), where) for x in values)


def _names_of(
    data: Mapping[str, Any],
) -> tuple[list[Parameter], dict[str, Fraction], dict[str, str]]:
    """Return parameters, constants and definitions."""
    constants, definitions = _table(data, "constants"), _table(data, "definitions")
    for key, value in definitions.items():
        if not isinstance(value, str):
            raise SpecError(f"definitions.{key} = {shown(value)} must be an expression in quotes")
    parameters = [_parameter(key, table) for key, table in _table(data, "parameter").items()]
    numbers = {k: _finite(v, f"constants.{k}") for k, v in constants.items()}
    return parameters, numbers, definitions


def _table(data: Mapping[str, Any], key: str, where: str = "") -> dict[str, Any]:
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise SpecError(f"{where}{key} must be a table; write [{where}{key}]")
    return table


# --- cars ----------------------------------------------------------------------------------------


@explained
def load_car(path: str | Path) -> Car | None:
    """Return the car of a spec's table ``[car]`` at its parameters' low ends, None without one.

    Raises
    ------
    SpecError
        If the file is missing, too long, no TOML, or says something that cannot be used.
    """
    data = parse(read_text(Path(path), MAX_BYTES, SpecError), str(path))
    if "car" not in data:
        return None
    try:
        make, parameters, _ = _car(data)
        return make(**{parameter.name: parameter.low for parameter in parameters})
    except InputError as error:
        raise type(error)(f"{path}: {_one_line(error)}") from error


def _car(
    data: Mapping[str, Any],
) -> tuple[Callable[..., Car], tuple[Parameter, ...], Callable[[], dict[str, dict[str, Any]]]]:
    """Return what makes the car for values of the parameters, these, and its further outputs."""
    car = _table(data, "car")
    _known(car, {"body", "wheel", "seat", "bar"}, "car: ")
    _need(car, ("body", "wheel"), "car")
    keys = ("body", "wheel", "seat", "bar")
    body, wheels, seats, bars = (_table(car, key, "car.") for key in keys)
    _known(body, {*_OF_BODY, "load"}, "car.body: ")
    _need(body, ("mass",), "car.body")
    for name in wheels:
        wheel = _table(wheels, name, "car.wheel.")
        _known(wheel, {*_OF_WHEEL, "x", "y"}, f"car.wheel.{shown(name)}: ")
        _need(wheel, _OF_WHEEL, f"car.wheel.{shown(name)}")
    between = {name: _between(_table(bars, name, "car.bar."), name) for name in bars}
    parameters, constants, definitions = _names_of(data)
    scope = Scope(parameters, constants, definitions)
    outputs = {label: _single(label, rows) for label, rows in _output_tables(data).items()}

    def number(value: Any, where: str) -> Any:
        return scope.value(value if isinstance(value, str) else _finite(value, where), where)

    def point(value: Any, where: str) -> tuple[Any, Any]:
        if not isinstance(value, list) or len(value) != 2:
            raise SpecError(f"{where} must be two numbers, [x, y]")
        return number(value[0], where), number(value[1], where)

    def make(**values: Any) -> Car:
        scope.bind_all(values)
        inertia = {_OF_BODY[k]: number(v, f"car.body.{k}") for k, v in body.items() if k != "load"}
        if "load" in body:
            inertia["load"] = point(body["load"], "car.body.load")
        turning = [
            Wheel(name, **{k: number(v, f"car.wheel.{name}.{k}") for k, v in table.items()})
            for name, table in wheels.items()
        ]
        places = {name: point(place, f"car.seat.{name}") for name, place in seats.items()}
        twisted = [
            Bar(name, pair, number(bars[name]["stiffness"], f"car.bar.{name}.stiffness"))
            for name, pair in between.items()
        ]
        return Car(Body(**inertia), turning, places, twisted)

    def more() -> dict[str, dict[str, Any]]:
        return {
            label: {
                key: [scope.entry(e, f"outputs.{label}.{key}[{j + 1}]") for j, e in enumerate(row)]
                for key, row in rows.items()
            }
            for label, rows in outputs.items()
        }

    return make, tuple(parameters), more


def _from_car(data: Mapping[str, Any], names: dict[str, Any]) -> UncertainPlant:
    make, parameters, more = _car(data)
    plant, tracks = car_family(make, parameters, more, **names), _tracks(data)
    car = make(**{parameter.name: parameter.low for parameter in parameters})
    if tracks is not None:
        plant = tracks.under(plant, car.places)
    return replace(plant, car=car)


def _between(table: Mapping[str, Any], name: str) -> tuple[str, ...]:
    """Return the wheels that an anti-roll bar is between."""
    where = f"car.bar.{shown(name)}"
    _known(table, {"between", "stiffness"}, f"{where}: ")
    _need(table, ("between", "stiffness"), where)
    return _strings(table["between"], f"{where}: between")


def _without_tracks(data: Mapping[str, Any]) -> None:
    if "tracks" in data.get("road", {}):
        raise SpecError("road.tracks without [car]: places of wheels are unknown; leave it out")


def _tracks(data: Mapping[str, Any]) -> Tracks | None:
    """Return what ``[road.tracks]`` says."""
    road = data.get("road", {})
    if "tracks" not in road:
        return None
    table = _table(road, "tracks", "road.")
    _known(table, {"order", "width"}, "road.tracks: ")
    _need(road, ("speed",), "road")
    speed, settings = _finite(road["speed"], "road: speed"), dict(table)
    if "order" in settings:
        order = _finite(settings["order"], "road.tracks: order")
        settings["order"] = int(order) if order.denominator == 1 else order
    if "width" in settings:
        settings["width"] = _finite(settings["width"], "road.tracks: width")
    return Tracks(speed, **settings)


def _single(label: str, rows: Mapping[str, Any]) -> dict[str, Any]:
    """Return rows of an output whose entries are expressions: one of each letter."""
    for key, lines in rows.items():
        if len(lines) != 1:
            where = f"outputs.{shown(label)}.{key}"
            raise SpecError(f"{where} has {len(lines)} rows; an output is one row, [...]")
    return {key: lines[0] for key, lines in rows.items()}


def _fitted(table: Any) -> Data:
    """Return what a plant was fitted to."""
    try:
        entries = Entries.of(_in_doubles(table), "data")
        data = Data.read(entries)
        entries.done()
    except FormatError as error:
        raise SpecError(str(error)) from error
    for label in (*data.files, *(name for name, _ in data.outputs), data.place):
        check_label(label, "data: a name")
    return data


def _in_doubles(value: Any) -> Any:
    """Return a table as those of files are, whose numbers are rounded anyway."""
    if isinstance(value, dict):
        return {key: _in_doubles(item) for key, item in value.items()}
    return float(value) if isinstance(value, Fraction | Decimal) else value


def _parameter(name: str, table: Any) -> Parameter:
    where = f"parameter.{name}"
    if not isinstance(table, dict):
        raise SpecError(f"{where} must be a table; write [{where}]")
    _known(table, {"label", "range", "unit", "through", "rate", "dead_time"}, f"{where}: ")
    _need(table, ("range",), where)
    bounds = table["range"]
    if not isinstance(bounds, list) or len(bounds) != 2:
        raise SpecError(f"{where}: range must be two numbers, [low, high]")
    low, high = (_finite(b, f"{where}: range") for b in bounds)
    unit, through, label = texts = [table.get(key, "") for key in ("unit", "through", "label")]
    if not all(isinstance(text, str) for text in texts):
        raise SpecError(f"{where}: unit, through and label must be strings")
    rate = table.get("rate")
    if isinstance(rate, list) and len(rate) == 2:
        rate = tuple(_finite(end, f"{where}: rate") for end in rate)
    dead_time = None
    if "dead_time" in table:
        try:
            dead_time = DeadTime.read(_entries_of(table["dead_time"]))
        except FormatError as error:
            raise SpecError(f"{where}: {error}") from error
    return Parameter(name, low, high, unit, through, label, rate, dead_time)


def _entries_of(table: Any) -> Entries:
    """Return a table as those of files are, without other keys than are known."""
    if not isinstance(table, dict):
        raise SpecError("dead_time must be a table")
    _known(table, {field.name for field in fields(DeadTime)} | {"parameter"}, "dead_time: ")
    numbers = {k: str(x) if isinstance(x, Fraction) else x for k, x in table.items()}
    return Entries.of(numbers, "dead_time")


def _rows(value: Any, where: str) -> list[list[Any]]:
    """Check a matrix of numbers and expressions; expressions are evaluated later."""
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        raise SpecError(f"{where} must be a list of rows, [[...], [...]]")
    for i, row in enumerate(value):
        if len(row) != len(value[0]):
            raise SpecError(
                f"{where} is ragged: row {i + 1} has {len(row)} entries, row 1 has {len(value[0])}"
            )
    return [
        [
            e if isinstance(e, str) else _finite(e, f"{where}[{i + 1}][{j + 1}]")
            for j, e in enumerate(row)
        ]
        for i, row in enumerate(value)
    ]


def _constant_matrix(value: Any, where: str) -> Any:
    rows = _rows(value, where)
    return [
        [_constant(e, f"{where}[{i + 1}][{j + 1}]") for j, e in enumerate(row)]
        for i, row in enumerate(rows)
    ]


def _constant(entry: Any, where: str) -> Any:
    try:
        return evaluate(entry, {}) if isinstance(entry, str) else entry
    except InputError as error:
        raise SpecError(f"{where}: {error}") from error


def _finite(value: Any, where: str) -> Fraction:
    if isinstance(value, bool) or not isinstance(value, int | Fraction):
        raise SpecError(f"{where} = {shown(value)} must be a finite number, without quotes or unit")
    return exact(Fraction(value), where)


def _strings(value: Any, key: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise SpecError(f"{key} must be a list of strings")
    return tuple(value)


def _tables(values: list[Any], key: str) -> list[dict[str, Any]]:
    if not all(isinstance(value, dict) for value in values):
        raise SpecError(f"{key} must be an array of tables; write [[{key}]]")
    return values


def _known(table: Mapping[str, Any], known: set[str], where: str) -> None:
    for key in table:
        if key not in known:
            if where and key in _TOP:
                raise SpecError(
                    f"{where}unknown key {shown(key)}; it belongs to the top of the file, above "
                    "the first [table]"
                )
            raise SpecError(f"{where}unknown key {shown(key)}; {suggest(key, known)}")


def _need(table: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in keys:
        if key not in table:
            raise SpecError(f"{where}: {key} is missing")


# --- writing --------------------------------------------------------------------------------------


def dumps(plant: UncertainPlant) -> str:
    """Write a plant as the text of a spec, from which `loads` returns it exactly.

    With its parameters where it has some: entries are expressions, multi-affine in the scheduling
    variables. Where no spec says so, the vertices are written in numbers and parameters are lost:
    where an end of an interval is no finite decimal (1/3), a parameter changes nothing, an
    expression is longer than `MAX_LENGTH`, or the text than `MAX_BYTES`.

    Raises
    ------
    SpecError
        If no spec says so, and functions of the parameters would be lost.
    """
    if plant.parameters:
        try:
            text = _written(plant, _expression_lines(plant))
            if len(text.encode()) <= MAX_BYTES:
                loads(text)  # the reader knows its own limits
                return text
        except InputError as error:
            if plant.functions is not None:
                raise SpecError(f"{plant.name} is not written as a spec: {error}") from error
    if plant.functions is not None:
        raise SpecError(f"{plant.name} is not written as a spec: its text would be too long")
    return _written(plant, _vertex_lines(plant))


def _written(plant: UncertainPlant, lines: list[str]) -> str:
    """Return a spec of these lines, with what they do not say."""
    head = [f"name = {toml_text(plant.name)}"]
    if plant.sample_time is not None:
        head.append(f"sample_time = {_entry(plant.sample_time)}")
    given = {key: getattr(plant, key) for key in _NAMES if getattr(plant, key)}
    head += [f"{key} = [{', '.join(map(toml_text, names))}]" for key, names in given.items()]
    return "\n".join([*head, *lines, *_vehicle_lines(plant), *data_lines(plant.data)]) + "\n"


def data_lines(data: Data | None) -> list[str]:
    """Return the table of what a plant was fitted to; nothing of others."""
    if data is None:
        return []
    table = data.write()
    outputs = table.pop("outputs")
    lines = [f"{key} = {_plain_text(value)}" for key, value in table.items()]
    return [
        "\n[data]",
        *lines,
        "\n[data.outputs]",
        *(f"{toml_text(name)} = {_plain_text(own)}" for name, own in outputs.items()),
    ]


def _plain_text(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_plain_text(item)}' for key, item in value.items())}}}"
    if isinstance(value, list):
        return _row_text(map(_plain_text, value))
    return toml_text(value) if isinstance(value, str) else repr(value)


def _vertex_lines(plant: UncertainPlant) -> list[str]:
    """Return tables of vertices, and outputs with one row for all or one a vertex."""
    lines = []
    for vertex in plant.vertices:
        lines.append("\n[[vertex]]")
        for letter, matrix in _letters(vertex).items():
            lines.append(f"{letter} = {_matrix_text([list(map(_entry, row)) for row in matrix])}")

    def rows_text(_: Output, __: str, rows: Exact) -> str:
        texts = [_row_text(map(_entry, row)) for row in rows]
        return texts[0] if len(texts) == 1 else _row_text(texts)

    return [*lines, *_output_lines(plant, rows_text)]


def _expression_lines(plant: UncertainPlant) -> list[str]:
    """Return parameters, and matrices and outputs whose entries are expressions.

    Raises
    ------
    SpecError
        If an end of an interval is no finite decimal, or an expression is too long.
    """
    lines = []
    for parameter in plant.parameters:
        bounds = _row_text(map(decimal_text, (parameter.low, parameter.high)))
        lines += [f"\n[parameter.{parameter.name}]", f"range = {bounds}"]
        lines += [f"label = {toml_text(parameter.label)}"] if parameter.label else []
        lines += [f"unit = {toml_text(parameter.unit)}"] if parameter.unit else []
        lines += [f"through = {toml_text(parameter.through)}"] if parameter.inverted else []
        if parameter.rate is not None:
            ends = (
                parameter.rate
                if parameter.rate == ANY
                else _row_text(map(decimal_text, parameter.rate))
            )
            lines.append(f"rate = {toml_text(ends) if ends == ANY else ends}")
        if parameter.dead_time is not None:
            entries = parameter.dead_time.write().items()
            keys = (f"{k} = {toml_text(x) if isinstance(x, str) else x}" for k, x in entries)
            lines.append(f"dead_time = {{{', '.join(keys)}}}")
    lines += _table_lines(plant)
    lines.append("\n[matrices]")
    tables = [_letters(vertex) for vertex in plant.vertices]
    first = dict(zip("ABE", (0, plant.shape[0], sum(plant.shape)), strict=True))
    for letter in tables[0]:
        rows = zip(*(table[letter] for table in tables), strict=True)  # a row of each vertex
        texts = [
            _expressions(
                row, plant.parameters, _functions_in(plant, plant.remainder, i, first[letter])
            )
            for i, row in enumerate(rows)
        ]
        lines.append(f"{letter} = {_matrix_text(texts)}")
    return [*lines, *_output_lines(plant, partial(_function_row, plant))]


def _function_row(plant: UncertainPlant, output: Output, key: str, rows: Exact) -> str:
    """Return a row of an output as expressions."""
    first = {"C": 0, "D": plant.shape[0], "F": sum(plant.shape)}[key]
    more = _functions_in(plant, output.near, 0, first)
    return _row_text(_expressions(rows, plant.parameters, more))


def _functions_in(
    plant: UncertainPlant, remainder: Remainder | None, row: int, first: int
) -> Callable[[int], list[tuple[Fraction, str, Sequence[Fraction]]]]:
    """Return the functions of each column: times what, as which text, with which corners."""
    source = remainder and remainder.source
    if not source or plant.functions is None:
        return lambda _: []
    known = zip(source.directions, source.functions.trees, source.functions.on_box[1], strict=True)
    every = [(M[row], tree.text, f.corners) for M, tree, f in known]
    return lambda j: [(x[first + j], text, c) for x, text, c in every if x[first + j]]


def _table_lines(plant: UncertainPlant) -> list[str]:
    """Return tables that functions interpolate in."""
    lines = list[str]()
    for name, table in () if plant.functions is None else plant.functions.tables:
        lines.append(f"\n[table.{name}]")
        for key in ("arguments", "values"):
            lines.append(f"{key} = {_row_text(map(_entry, getattr(table, key)))}")
        lines += ['interpolation = "cubic"'] if table.cubic else []
    return lines


def _letters(vertex: System) -> dict[str, Exact]:
    """Return the matrices that a vertex has."""
    given = {letter: getattr(vertex, f"exact_{letter}") for letter in "ABE"}
    return {letter: matrix for letter, matrix in given.items() if matrix is not None}


def _output_lines(
    plant: UncertainPlant, rows_text: Callable[[Output, str, Exact], str]
) -> list[str]:
    """Return outputs with explicit rows; a vehicle's follow from the matrices."""
    lines = []
    for output in plant.outputs:
        known = zip("CDF", output.exact(plant), strict=True)
        acts = {"C": plant.shape[0], "D": plant.shape[1], "F": plant.disturbance_count}
        rows = {
            key: values if output.near else getattr(output, key)
            for key, values in known
            if getattr(output, key) or (output.near and acts[key])
        }
        texts = (f"{key} = {rows_text(output, key, values)}" for key, values in rows.items())
        lines.append(f"{toml_text(_label(output))} = {{{', '.join(texts)}}}")
    return ["\n[outputs]", *lines] if lines else []


def _label(output: Output) -> str:
    """Return what `split` reads as the output's name and unit: one may end as if in a unit."""
    plain = split(output.label) == (output.name, output.unit)
    return output.label if plain else f"{output.name} [{output.unit}]"


def _vehicle_lines(plant: UncertainPlant) -> list[str]:
    if plant.vehicle is None:
        return []
    names = ((field.name, getattr(plant.vehicle, field.name)) for field in fields(Vehicle))
    lines = [f"{key} = {toml_text(value)}" for key, value in names]
    return ["\n[vehicle]", f"model = {toml_text(QUARTER_CAR)}", *lines]


def _expressions(
    rows: Exact,
    parameters: Sequence[Parameter],
    functions: Callable[[int], list[tuple[Fraction, str, Sequence[Fraction]]]],
) -> list[str]:
    """Return entries that have these values at the vertices, or one for all."""
    columns = enumerate(zip(*rows, strict=True))
    return [_expression(values, parameters, functions(j)) for j, values in columns]


def _expression(
    values: Sequence[Fraction],
    parameters: Sequence[Parameter],
    functions: Sequence[tuple[Fraction, str, Sequence[Fraction]]] = (),
) -> str:
    """Return an entry with these values at the vertices: a number where they are all the same."""
    if functions:
        rest = [
            value - sum((x * corners[j] for x, _, corners in functions), Fraction(0))
            for j, value in enumerate(values)
        ]
        sums = [text if x == 1 else f"{_number_text(x)}*({text})" for x, text, _ in functions]
        if any(rest):
            sums.insert(0, _expression(rest, parameters).strip('"'))
        whole = " + ".join(sums)
        if len(whole) > MAX_LENGTH:
            raise SpecError(f"an expression is longer than {MAX_LENGTH} characters")
        return f'"{whole}"'
    if all(value == values[0] for value in values):
        return _entry(values[0])
    box = [(p.scheduling(p.low), p.scheduling(p.high)) for p in parameters]
    factors = itertools.product((False, True), repeat=len(box))
    terms = (
        _term(c, list(itertools.compress(parameters, factor)))
        for c, factor in zip(_coefficients(values, box), factors, strict=True)
        if c
    )
    text = " + ".join(terms).replace(" + -", " - ")
    if len(text) > MAX_LENGTH:  # seen here, before a dense matrix of such is written
        raise SpecError(f"an expression is longer than {MAX_LENGTH} characters")
    return f'"{text}"'


def _coefficients(
    values: Sequence[Fraction], box: Sequence[tuple[Fraction, Fraction]]
) -> list[Fraction]:
    """Return those of the multi-affine polynomial with these values at the corners of a box.

    Both in the order of vertices: in that of values a variable is low, then high; in that of
    coefficients it is no factor, then one.
    """
    if not box:
        return list(values)
    (low, high), rest = box[0], box[1:]
    pairs = list(zip(values[: len(values) // 2], values[len(values) // 2 :], strict=True))
    slopes = [(end - begin) / (high - low) for begin, end in pairs]
    constants = [begin - slope * low for (begin, _), slope in zip(pairs, slopes, strict=True)]
    return _coefficients(constants, rest) + _coefficients(slopes, rest)


def _term(coefficient: Fraction, factors: Sequence[Parameter]) -> str:
    times = [p.name for p in factors if not p.inverted]
    over = "".join(f"/{p.name}" for p in factors if p.inverted)
    if times and abs(coefficient) == 1:
        return "-" * (coefficient < 0) + "*".join(times) + over
    return "*".join([_number_text(coefficient), *times]) + over


def _matrix_text(texts: list[list[str]]) -> str:
    """Return rows of entries on one line, or on a line each where that is too long."""
    rows = [_row_text(row) for row in texts]
    line = _row_text(rows)
    return line if len(line) <= 80 else "[\n" + "".join(f"    {row},\n" for row in rows) + "]"


def _row_text(texts: Iterable[str]) -> str:
    return f"[{', '.join(texts)}]"


def toml_text(text: str) -> str:
    """Return a text in quotes, as TOML has it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    # eight digits, for some are beyond four
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _entry(value: Fraction) -> str:
    """Return a number, in quotes where TOML has none that is it."""
    text = _number_text(value)
    plain = value.denominator > 1 or math.log2(abs(value.numerator) + 1) < 60
    return text if plain and "/" not in text else f'"{text}"'


def _number_text(value: Fraction) -> str:
    """Return a decimal, or a fraction where there is none or it is longer, quotes counted.

    Raises
    ------
    SpecError
        If it is longer than any expression; Python itself writes no more than 4300 digits.
    """
    if max(value.numerator.bit_length(), value.denominator.bit_length()) > 4 * MAX_LENGTH:
        raise SpecError(f"a number is longer than {MAX_LENGTH} characters")
    fraction = str(value)
    try:
        plain = decimal_text(value)
    except SpecError:
        return fraction
    return plain if len(plain) <= len(fraction) + 2 else fraction
