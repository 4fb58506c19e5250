"""Read a service file: a design document, and what is claimed about it; proves nothing.

``{"format": "polefence-service", "version": 1, "design": {...}, "service": {"kind": ...}}``
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.proof import placement
from polefence.proof.placement import read_document, read_region
from polefence.proof.reading import MAX_SIZE, _at, _integer, _list, _only, read_matrix, read_number
from polefence.proof.service.claims import Estimate, Gain, Range, Rate, ServiceClaim, Subject
from polefence.proof.work import FormatError

FORMAT = "polefence-service"
MAX_PARAMETERS = 8
_COMMON = {"kind", "region", "pieces", "elevation"}
_KEYS = {
    "estimate": {"errors"},
    "gain": {"error", "rows", "columns", "mu"},
    "rate": {"decay", "rates", "part"},
}


def read_service(text: str) -> tuple[ServiceClaim, dict[str, Any]]:
    """Parse a service file; return its claim and the whole document.

    Raises
    ------
    FormatError
        If it is no JSON, cut short, of another format or version, or its shapes do not fit.
    """
    document = read_document(text, FORMAT)
    _only({"file": document}, "file", {"format", "version", "polefence", "design", "service"})
    try:
        # the one reader of designs reads this one too
        design, own = placement.read(json.dumps(_at(document, "design"), allow_nan=False))
    except (RecursionError, ValueError) as error:
        raise FormatError(f"design: {error}") from error
    table = _at(document, "service")
    kind = _at(document, "service", "kind")
    if not isinstance(kind, str) or kind not in _KEYS:
        raise FormatError(f"service.kind must be one of {', '.join(_KEYS)}")
    _only(document, "service", _COMMON | _KEYS[kind])
    if kind == "rate" and own["plant"].get("sample_time") is not None:
        raise FormatError("service.kind: rates are for plants in continuous time")
    if "region" in table:  # another than the one designed for
        design = replace(design, region=read_region(table["region"]))
    ranges = read_ranges(own["plant"])
    pieces = table.get("pieces", [1] * len(ranges))
    if not isinstance(pieces, list) or any(type(k) is not int for k in pieces):
        raise FormatError("service.pieces must be a list of whole numbers")
    elevation = _integer(table, "service", "elevation", 0)
    subject = Subject(design, ranges, tuple(pieces), elevation)
    return _READERS[kind](subject, document), document


def read_ranges(plant: dict[str, Any]) -> tuple[Range, ...]:
    """Return the intervals of the parameters of a design's plant."""
    tables = plant.get("parameters", [])
    if not isinstance(tables, list) or len(tables) > MAX_PARAMETERS:
        raise FormatError(f"plant.parameters must be a list of at most {MAX_PARAMETERS} tables")
    names, found = list[str](), list[Range]()
    for k, table in enumerate(tables):
        where = f"plant.parameters[{k + 1}]"
        name, through = (_at({where: table}, where, key) for key in ("name", "through"))
        if not isinstance(name, str) or name in names or through not in (name, f"1/{name}"):
            raise FormatError(f"{where}: through must be its own name, or 1/name")
        bounds = _at({where: table}, where, "range")
        if not isinstance(bounds, list) or len(bounds) != 2:
            raise FormatError(f"{where}.range must hold two numbers")
        low, high = (read_number(value, f"{where}.range") for value in bounds)
        names.append(name)
        found.append(Range(low, high, through != name))
    return tuple(found)


def _number(document: dict[str, Any], key: str) -> Fraction:
    return read_number(_at(document, "service", key), f"service.{key}")


def _numbers(document: dict[str, Any], key: str) -> tuple[Fraction, ...]:
    values = _list(_at(document, "service", key), f"service.{key}", MAX_SIZE)
    return tuple(read_number(value, f"service.{key}") for value in values)


def _estimate(subject: Subject, document: dict[str, Any]) -> Estimate:
    return Estimate(subject, _numbers(document, "errors"))


def _gain(subject: Subject, document: dict[str, Any]) -> Gain:
    rows, mu = (_numbers(document, key) for key in ("rows", "mu"))
    return Gain(subject, _number(document, "error"), rows, _columns(subject, document), mu)


def _columns(
    subject: Subject, document: dict[str, Any]
) -> tuple[Fraction | tuple[Fraction, ...], ...]:
    """Return numbers, or the rows of a matrix."""
    value = _list(_at(document, "service", "columns"), "service.columns", MAX_SIZE)
    if not isinstance(value[0], list):
        return _numbers(document, "columns")
    n = len(subject.design.A[0])
    return tuple(map(tuple, read_matrix(value, "service.columns", n, n)))


def _rate(subject: Subject, document: dict[str, Any]) -> Rate:
    any_rate = _at(document, "service", "rates") == "any"
    rates = None if any_rate else _numbers(document, "rates")
    part = document["service"].get("part", 1)
    if type(part) is not int:
        raise FormatError("service.part must be a whole number, from 1 up")
    return Rate(subject, _number(document, "decay"), rates, part - 1)


_READERS: dict[str, Callable[[Subject, dict[str, Any]], ServiceClaim]] = {
    "estimate": _estimate,
    "gain": _gain,
    "rate": _rate,
}
