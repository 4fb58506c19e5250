"""CSV files of measurements: a header of names, then numbers. Parsed, never executed."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.files import read_text
from polefence.data.measured import MOST_SAMPLES
from polefence.plant.outputs import split
from polefence.plant.system import Array

MAX_BYTES = 100_000_000
MOST_COLUMNS = 500
SEPARATORS = (",", ";", "\t")


@dataclass(frozen=True)
class Columns:
    """Columns of a file by their names, without units, and these."""

    source: str
    values: dict[str, Array]
    units: dict[str, str]

    @property
    def first(self) -> str:
        """The first column's name."""
        return next(iter(self.values))

    def of(self, name: str, unit: str = "") -> Array:
        """Return a column, in the unit that is given where the file gives one.

        Raises
        ------
        InputError
            If there is none, or it is in another unit.
        """
        if name not in self.values:
            raise InputError(
                f"{self.source}: no column {name!r}; {suggest(name, list(self.values))}, or say "
                f"which it is, [columns] {name!r} = ..."
            )
        own = self.units[name]
        if unit and own and own != unit:
            raise InputError(
                f"{self.source}: column {name!r} is in {shown(own)}, the signal in {shown(unit)}; "
                "convert it"
            )
        return self.values[name]


def read_columns(path: Path) -> Columns:
    """Read a CSV file; lines that begin with # are left out.

    Raises
    ------
    InputError
        If it cannot be read, or a cell is no finite number; line and column are named.
    """
    text = read_text(path, MAX_BYTES, InputError)
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1)
             if line.strip() and not line.lstrip().startswith("#")]  # fmt: skip
    if len(lines) < 2:
        raise InputError(f"{path}: has no line of numbers below a line of names")
    if len(lines) > MOST_SAMPLES + 1:
        raise InputError(f"{path}: more than {MOST_SAMPLES} lines; thin the samples out")
    head = lines[0][1]
    separator = next((mark for mark in SEPARATORS if mark in head), ",")
    labels = [split(cell.strip()) for cell in _cells(head, separator)]
    names = [name for name, _ in labels]
    if len(names) > MOST_COLUMNS:
        raise InputError(f"{path}: {len(names)} columns; at most {MOST_COLUMNS} are read")
    for k, name in enumerate(names):
        if not name or name in names[:k]:
            raise InputError(
                f"{path}: column {k + 1} has {'the name of another' if name else 'no name'}"
            )
    values = _numbers(path, lines[1:], names, separator)
    return Columns(str(path), dict(zip(names, values.T, strict=True)), dict(labels))


def _numbers(path: Path, lines: list[tuple[int, str]], names: list[str], separator: str) -> Array:
    values = np.empty((len(lines), len(names)))
    for row, (number, line) in enumerate(lines):
        cells = _cells(line, separator)
        if len(cells) != len(names):
            raise InputError(
                f"{path}: line {number} has {len(cells)} cells; its header {len(names)}"
            )
        try:
            values[row] = [float(cell) for cell in cells]
        except ValueError:
            values[row] = np.nan
        if not np.isfinite(values[row]).all():
            name, cell = next(pair for pair in zip(names, cells, strict=True)
                              if not _is_number(pair[1]))  # fmt: skip
            comma = "; write its decimals behind a point" if "," in cell else ""
            raise InputError(
                f"{path}: line {number}, column {name!r}: {shown(cell.strip())} is no finite "
                f"number{comma}"
            )
    return values


def _cells(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True))


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
