"""JSON within bounds, read as exact rationals by tables that know where they are; and written."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import MAX_DEGREE
from polefence.proof.work import FormatError

MAX_BYTES, MAX_SIZE, MAX_VERTICES = 32_000_000, 300, 256
MAX_COEFFICIENTS = 20_000
# Lists, tables and keys of a file, which take up to 300 bytes each in memory, and how deep they go.
MAX_PIECES, MAX_DEPTH = 1_000_000, 50
MAX_ENTRIES = 2_000_000  # numbers among them, each of which becomes a rational
LARGEST = 10**300  # of numbers
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
            "keys; this is not a Polefence file"
        )
    if text.count(",") > MAX_ENTRIES:
        raise FormatError(f"more than {MAX_ENTRIES} entries of lists; this is not a Polefence file")
    try:
        document = json.loads(text, parse_constant=_refuse, object_pairs_hook=_unique)
    except FormatError:
        raise
    except (ValueError, RecursionError) as error:
        raise FormatError(f"not valid JSON, or cut short: {error}") from error
    return require_shallow(document)


def require_shallow(document: Any) -> Any:
    """Return plain data that is not nested too deep.

    Raises
    ------
    FormatError
        If it is.
    """
    level: list[Any] = [[document]]
    for _ in range(MAX_DEPTH):
        inner = (holder.values() if isinstance(holder, dict) else holder for holder in level)
        level = [value for values in inner for value in values if isinstance(value, list | dict)]
        if not level:
            return document
    raise FormatError(f"nested more than {MAX_DEPTH} deep; this is not a Polefence file")


def _refuse(text: str) -> Any:
    raise FormatError(f"{text} is not a finite number")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise FormatError(f"a key is given twice among {', '.join(k for k, _ in pairs)[:80]}")
    return table


@dataclass(frozen=True)
class Table:
    """A table of a file: where it is, and which of its keys were asked for.

    What is missing, of another type or out of its bounds is a FormatError that names the place;
    `done` refuses what nobody asked for.
    """

    entries: dict[str, Any]
    where: str = ""
    _asked: set[str] = field(default_factory=set)
    _below: dict[str, Table] = field(default_factory=dict)

    @classmethod
    def of(cls, value: Any, where: str = "") -> Table:
        """Return a value as a table."""
        if not isinstance(value, dict):
            raise FormatError(f"{where or 'the file'} must be a table")
        return cls(value, where)

    def __contains__(self, key: str) -> bool:
        self._asked.add(key)
        return key in self.entries

    def path(self, key: str) -> str:
        """Say where a key is."""
        return f"{self.where}.{key}" if self.where else key

    def at(self, key: str) -> Any:
        """Return what is there."""
        if key not in self:
            raise FormatError(f"{self.path(key)} is missing")
        return self.entries[key]

    def done(self) -> None:
        """Refuse keys that nobody asked for, here and below."""
        for key in self.entries:
            if key not in self._asked:
                known = ", ".join(sorted(self._asked))
                raise FormatError(f"unknown key {self.path(key[:40])}; known: {known}")
        for table in self._below.values():
            table.done()

    def table(self, key: str) -> Table:
        """Return a table below."""
        return self._at(self.at(key), self.path(key))

    def tables(self, key: str, most: int, least: int = 1) -> list[Table]:
        """Return a list of tables."""
        where, rows = self.path(key), self.items(key, most, least)
        return [self._at(row, f"{where}[{k + 1}]") for k, row in enumerate(rows)]

    def _at(self, value: Any, where: str) -> Table:
        if where not in self._below:
            self._below[where] = Table.of(value, where)
        return self._below[where]

    def items(self, key: str, most: int, least: int = 1) -> list[Any]:
        """Return a list of so many entries."""
        return as_list(self.at(key), self.path(key), most, least)

    def word(self, key: str, known: Iterable[str], default: str | None = None) -> str:
        """Return one of the words that are known."""
        value = default if default is not None and key not in self else self.at(key)
        words = list(known)
        if not isinstance(value, str) or value not in words:
            raise FormatError(f"{self.path(key)} must be {_either(words)}, not {shown(value)}")
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """Return text."""
        value = default if default is not None and key not in self else self.at(key)
        if not isinstance(value, str):
            raise FormatError(f"{self.path(key)} must be text")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts, none where there is no such key."""
        values = self.items(key, MAX_ENTRIES, 0) if key in self else []
        if not all(isinstance(value, str) for value in values):
            raise FormatError(f"{self.path(key)} must be a list of names")
        return tuple(values)

    def flag(self, key: str, default: bool = False) -> bool:
        """Return true or false."""
        value = self.entries[key] if key in self else default
        if type(value) is not bool:
            raise FormatError(f"{self.path(key)} must be true or false")
        return value

    def whole(self, key: str, default: int | None, most: int = MAX_DEGREE, least: int = 0) -> int:
        """Return a whole number from ``least`` to ``most``."""
        value = default if default is not None and key not in self else self.at(key)
        if type(value) is not int or not least <= value <= most:
            raise FormatError(f"{self.path(key)} must be a whole number, {least} to {most}")
        return value

    def wholes(self, key: str, most: int = MAX_DEGREE) -> tuple[int, ...]:
        """Return a list of whole numbers: of exponents, unless more is allowed."""
        values = self.items(key, MAX_VERTICES)
        if any(type(value) is not int or not 0 <= value <= most for value in values):
            raise FormatError(f"{self.path(key)} must hold whole numbers, 0 to {most}")
        return tuple(values)

    def number(self, key: str, default: int | None = None) -> Fraction:
        """Return a number."""
        if default is not None and key not in self:
            return Fraction(default)
        return as_number(self.at(key), self.path(key))

    def numbers(
        self, key: str, count: int | None = None, most: int = MAX_SIZE
    ) -> tuple[Fraction, ...]:
        """Return a list of numbers, of so many where that is known."""
        values, where = self.items(key, most), self.path(key)
        if count is not None and len(values) != count:
            raise FormatError(f"{where} must hold {count} numbers")
        return tuple(as_number(value, where) for value in values)

    def matrix(self, key: str, rows: int | None = None, columns: int | None = None) -> Rationals:
        """Return a matrix, of this shape where that is known."""
        return as_matrix(self.at(key), self.path(key), rows, columns)

    def matrices(
        self, key: str, rows: int | None, columns: int | None, most: int = MAX_COEFFICIENTS
    ) -> list[Rationals]:
        """Return a list of matrices."""
        where = self.path(key)
        return [
            as_matrix(value, f"{where}[{k + 1}]", rows, columns)
            for k, value in enumerate(self.items(key, most))
        ]

    def rows(self, key: str, width: int, count: int) -> list[Rationals]:
        """Return one row a vertex, of which the file may hold one for all."""
        values, where = self.items(key, MAX_VERTICES), self.path(key)
        if len(values) not in (1, count):
            raise FormatError(f"{where} must hold one row, or {count}: one per vertex")
        matrices = [as_matrix([row], where, 1, width) for row in values]
        return matrices * count if len(matrices) < count else matrices


def _either(words: Sequence[str]) -> str:
    quoted = [f'"{word}"' for word in words]
    return " or ".join(quoted) if len(words) < 3 else f"one of {', '.join(words)}"


def shown(value: Any) -> str:
    """Quote a value in a message: cut to a part of a line, a table or a list by its kind alone."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    return repr(value[:40]) if isinstance(value, str) else repr(value)[:40]


def as_list(value: Any, where: str, most: int, least: int = 1) -> list[Any]:
    """Return a list of so many entries."""
    if not isinstance(value, list) or not least <= len(value) <= most:
        count = f"{least} to {most}" if least < most else str(most)
        raise FormatError(f"{where} must be a list of {count} entries")
    return value


def as_number(value: Any, where: str) -> Fraction:
    """Return a number of the file: a double is the rational it is, a string "p/q" is exact."""
    if isinstance(value, str) and _RATIONAL.fullmatch(value):  # which is below `LARGEST`
        return Fraction(value)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST:
        return Fraction(value)  # nan fails the comparison; integers are compared exactly
    raise FormatError(f'{where} = {shown(value)} is not a finite number or "p/q"')


def as_matrix(
    value: Any, where: str, rows: int | None = None, columns: int | None = None
) -> Rationals:
    """Return a matrix, of this shape where that is known."""
    lists = [as_list(row, where, MAX_SIZE) for row in as_list(value, where, MAX_SIZE)]
    if any(len(row) != len(lists[0]) for row in lists):
        raise FormatError(f"{where} is ragged")
    matrix = [
        [as_number(entry, f"{where}[{i + 1}][{j + 1}]") for j, entry in enumerate(row)]
        for i, row in enumerate(lists)
    ]
    require_shape(matrix, rows or len(matrix), columns or len(matrix[0]), where)
    return matrix


def require_shape(matrix: Rationals, rows: int, columns: int, where: str) -> None:
    """Refuse a matrix of another shape."""
    if len(matrix) != rows or any(len(row) != columns for row in matrix):
        size = f"{len(matrix)} x {len(matrix[0]) if matrix else 0}"
        raise FormatError(f"{where} is {size}, not {rows} x {columns}")


# --- writing -------------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """Return rationals as a file has them: a number where a double holds it, else "p/q".

    Of lists and tuples each entry.
    """
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if not isinstance(value, Fraction):
        return value
    if value.denominator == 1 and abs(value.numerator) < 2**53:
        return value.numerator
    return float(value) if is_double(value) else str(value)


def is_double(value: Fraction) -> bool:
    """Whether a double holds a number exactly."""
    try:
        return float(value).as_integer_ratio() == (value.numerator, value.denominator)
    except OverflowError:
        return False


def plain_rows(matrices: Sequence[Rationals]) -> list[list[Any]]:
    """Return one row for all vertices where it is the same, else one a vertex."""
    rows = [plain(matrix[0]) for matrix in matrices]
    return rows[:1] if all(row == rows[0] for row in rows) else rows
