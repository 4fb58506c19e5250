"""JSON within bounds, and its numbers and matrices as exact rationals."""

from __future__ import annotations

import json
import re
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import MAX_COEFFICIENTS, MAX_DEGREE
from polefence.proof.work import FormatError

MAX_BYTES = 32000000
MAX_SIZE = 60
MAX_VERTICES = 256
# Lists, tables and keys of a file, which take up to 300 bytes each in memory, and how deep they go.
MAX_PIECES, MAX_DEPTH = 1_000_000, 50
MAX_ENTRIES = 2_000_000  # numbers among them, each of which becomes a rational
LARGEST = 10**300
_RATIONAL = re.compile(r"-?[0-9]{1,300}(/[1-9][0-9]{0,300})?")


def parse(text: str) -> Any:
    """Parse JSON within bounds of length, pieces and depth; no key twice, no number that is none.

    Raises
    ------
    FormatError
        If it is no such text.
    """
    if len(text) > MAX_BYTES or sum(map(text.count, "[{:")) > MAX_PIECES:
        raise FormatError(
            f"longer than {MAX_BYTES} characters, or more than {MAX_PIECES} lists, tables and "
            "keys; this is no file of ours"
        )
    if text.count(",") > MAX_ENTRIES:
        raise FormatError(f"more than {MAX_ENTRIES} entries of lists; this is no file of ours")
    try:
        document = json.loads(text, parse_constant=_refuse, object_pairs_hook=_unique)
    except FormatError:
        raise
    except (ValueError, RecursionError) as error:
        raise FormatError(f"not valid JSON, or cut short: {error}") from error
    level: list[Any] = [[document]]
    for _ in range(MAX_DEPTH):
        inner = (each.values() if isinstance(each, dict) else each for each in level)
        level = [value for values in inner for value in values if isinstance(value, list | dict)]
        if not level:
            return document
    raise FormatError(f"nested more than {MAX_DEPTH} deep; this is no file of ours")


def _integer(table: dict[str, Any], where: str, key: str, default: int) -> int:
    value = table.get(key, default)
    if type(value) is not int or not 0 <= value <= MAX_DEGREE:
        raise FormatError(f"{where}.{key} must be a whole number, 0 to {MAX_DEGREE}")
    return value


def _several(value: Any, where: str, rows: int, n: int) -> list[Rationals]:
    values = _list(value, where, MAX_COEFFICIENTS)
    found = [_matrix(v, f"{where}[{k + 1}]") for k, v in enumerate(values)]
    for k, each in enumerate(found):
        _shape(each, rows, n, f"{where}[{k + 1}]")
    return found


def read_matrix(value: Any, where: str, rows: int, columns: int) -> Rationals:
    """Return a matrix of this shape."""
    matrix = _matrix(value, where)
    _shape(matrix, rows, columns, where)
    return matrix


def _refuse(text: str) -> Any:
    raise FormatError(f"{text} is not a finite number")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise FormatError(f"a key is given twice among {', '.join(k for k, _ in pairs)[:80]}")
    return table


def _shown(value: Any) -> str:
    """Quote a value in a message: cut to a part of a line, a table or a list by its kind alone."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    return repr(value[:40]) if isinstance(value, str) else repr(value)[:40]


def _at(value: Any, *keys: str) -> Any:
    for i, key in enumerate(keys):
        if not isinstance(value, dict) or key not in value:
            raise FormatError(f"{'.'.join(keys[: i + 1])} is missing")
        value = value[key]
    return value


def _only(document: dict[str, Any], section: str, known: set[str]) -> None:
    table = document.get(section)
    for key in table if isinstance(table, dict) else ():
        if key not in known:
            raise FormatError(
                f"unknown key {section}.{key[:40]}; known: {', '.join(sorted(known))}"
            )


def _list(value: Any, where: str, limit: int) -> list[Any]:
    if not isinstance(value, list) or not 1 <= len(value) <= limit:
        raise FormatError(f"{where} must be a list of 1 to {limit} entries")
    return value


def _matrix(value: Any, where: str) -> Rationals:
    rows = [_list(row, where, MAX_SIZE) for row in _list(value, where, MAX_SIZE)]
    if any(len(row) != len(rows[0]) for row in rows):
        raise FormatError(f"{where} is ragged")
    return [
        [read_number(entry, f"{where}[{i + 1}][{j + 1}]") for j, entry in enumerate(row)]
        for i, row in enumerate(rows)
    ]


def _shape(matrix: Rationals, rows: int, columns: int, where: str) -> None:
    if (len(matrix), len(matrix[0])) != (rows, columns):
        raise FormatError(f"{where} is {len(matrix)} x {len(matrix[0])}, not {rows} x {columns}")


def read_number(value: Any, where: str) -> Fraction:
    """Return a number of the file: a double is the rational it is, a string "p/q" is exact."""
    if isinstance(value, str) and _RATIONAL.fullmatch(value):  # which is below `LARGEST`
        return Fraction(value)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST:
        return Fraction(value)  # nan fails the comparison; integers are compared exactly
    raise FormatError(f'{where} = {_shown(value)} is not a finite number or "p/q"')
