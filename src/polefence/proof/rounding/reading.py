"""Read a file about exported code: a design, what it tolerates, the code's constants.

``{"format": "polefence-export", "version": 1, "design": {...}, "service": {...}, "code": {...}}``;
the first two tables are those of a service file of kind "gain".
"""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import Rationals
from polefence.proof.placement import read_document
from polefence.proof.polynomials import MAX_COEFFICIENTS
from polefence.proof.reading import _at, _integer, _list, _matrix, _only, read_number
from polefence.proof.rounding.claims import Code, Rounded, Share
from polefence.proof.service import FORMAT as SERVICE
from polefence.proof.service import Gain, read_service
from polefence.proof.service.reading import MAX_PARAMETERS
from polefence.proof.work import FormatError

FORMAT = "polefence-export"
_TABLES = {
    "format",
    "version",
    "polefence",
    "design",
    "service",
    "code",
    "files",
    "observer",
    "sampling",
    "text",
}
_KEYS = {"bits", "K", "T", "W", "Z", "shares", "smallest", "size", "elevation"}


def read_rounded(text: str) -> tuple[Rounded, dict[str, Any]]:
    """Parse a file about exported code; return its claim and the whole document.

    Raises
    ------
    FormatError
        If it is no JSON, cut short, of another format or version, or its shapes do not fit.
    """
    document = read_document(text, FORMAT)
    _only({"file": document}, "file", _TABLES)
    own = {key: _at(document, key) for key in ("version", "design", "service")}
    try:
        text = json.dumps({"format": SERVICE, **own}, allow_nan=False)
    except (RecursionError, ValueError) as error:
        raise FormatError(f"design or service: {error}") from error
    gain, _ = read_service(text)
    if not isinstance(gain, Gain):
        raise FormatError("service.kind must be gain")
    if "sampling" in document and own["design"]["plant"].get("sample_time") is not None:
        raise FormatError("sampling: is of plants in continuous time")
    _only(document, "code", _KEYS)
    table = _at(document, "code")
    code = Code(
        _at(document, "code", "bits"),
        _matrix(table["K"], "code.K") if "K" in table else None,
        _matrix(table["T"], "code.T") if "T" in table else None,
        _matrices(table, "W"),
        _matrices(table, "Z"),
        _shares(table),
    )
    smallest, size = (_number(table, key) for key in ("smallest", "size"))
    return Rounded(gain, code, smallest, size, _integer(table, "code", "elevation", 0)), document


def _number(table: dict[str, Any], key: str) -> Fraction:
    return read_number(table.get(key, 0), f"code.{key}")


def _matrices(table: dict[str, Any], key: str) -> tuple[Rationals, ...]:
    if key not in table:
        return ()
    each = _list(table[key], f"code.{key}", MAX_COEFFICIENTS)
    return tuple(_matrix(value, f"code.{key}") for value in each)


def _shares(table: dict[str, Any]) -> tuple[Share, ...]:
    if "shares" not in table:
        return ()
    found = list[Share]()
    for k, entry in enumerate(_list(table["shares"], "code.shares", MAX_PARAMETERS)):
        where = f"code.shares[{k + 1}]"
        _only({where: entry}, where, {"low", "high", "scale"})
        low, high, scale = (
            read_number(_at({where: entry}, where, key), where) for key in ("low", "high", "scale")
        )
        found.append(Share(low, high, scale))
    return tuple(found)
