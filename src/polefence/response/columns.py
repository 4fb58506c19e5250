"""Columns of numbers: tables written as CSV or Parquet; CSV files from strangers, read."""

from __future__ import annotations

import csv
import io
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError, shown
from polefence.base.files import make_folder, read_text, write_bytes
from polefence.base.parquet import arrow, table_bytes
from polefence.plant.system import Array
from polefence.proof.text import visible

REMEDY = "pip install 'polefence[parquet]', or name a .csv file"
ROWS = 100_000  # turned into text at once


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one length.

    Attributes
    ----------
    labels : tuple of str
        "name [unit]", each once.
    values : (rows, columns) array
    """

    labels: tuple[str, ...]
    values: Array

    def __post_init__(self) -> None:
        twice = [label for label in self.labels if self.labels.count(label) > 1]
        if twice:
            raise InputError(f"two columns are called {twice[0]!r}; rename one")
        if np.ndim(self.values) != 2 or np.shape(self.values)[1] != len(self.labels):
            raise InputError(f"{len(self.labels)} labels, values {np.shape(self.values)}")

    def of(self, label: str) -> Array:
        """Return one column."""
        return np.asarray(self.values[:, self.labels.index(label)])


def check_format(path: Path) -> None:
    """Refuse, before any work, a file that a table cannot be written to.

    Raises
    ------
    InputError
        If its name ends in neither .csv nor .parquet.
    MissingExtraError
        If it is Parquet, and pyarrow is not installed.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: signals are written as .csv or .parquet; name such a file")
    if path.suffix == ".parquet":
        arrow(REMEDY)


def write_table(path: Path, table: Table) -> None:
    """Write a table whole, in the format that the name asks for; see `check_format`.

    CSV has the labels in its first row and the shortest decimals that give back the very numbers.

    Raises
    ------
    InputError, MissingExtraError
        As `check_format`.
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    check_format(path)
    content = _csv(table) if path.suffix == ".csv" else _parquet(table)
    make_folder(path.parent)
    write_bytes(path, content)


def _csv(table: Table) -> bytes:
    parts = [",".join(_cell(visible(label)) for label in table.labels)]
    for first in range(0, len(table.values), ROWS):
        rows = table.values[first : first + ROWS].tolist()
        parts.append("\n".join(",".join(map(repr, row)) for row in rows))
    return ("\n".join(parts) + "\n").encode()


def _cell(label: str) -> str:
    """Return a cell of text, quoted where a reader would split or misread it."""
    if any(mark in label for mark in ',"'):
        return '"' + label.replace('"', '""') + '"'
    return label


def _parquet(table: Table) -> bytes:
    columns = {visible(label): np.ascontiguousarray(table.of(label)) for label in table.labels}
    return table_bytes(arrow(REMEDY).table(columns), REMEDY)


@dataclass(frozen=True, eq=False)
class Columns:
    """Numbers of a file, with the line that each row stands in.

    Attributes
    ----------
    labels : tuple of str
        Of the first row; none where that holds numbers.
    values : (rows, columns) array
    lines : array of int
    """

    labels: tuple[str, ...]
    values: npt.NDArray[np.float64]
    lines: Sequence[int]


def read_columns(path: Path, limit: int, remedy: str, names: Sequence[str] = ()) -> Columns:
    """Read a CSV file of numbers, a comma between; a first row of names is allowed.

    Parameters
    ----------
    limit : int
        Bytes of the file at most.
    remedy : str
        What to do about a longer one.
    names : sequence of str, optional
        Of the columns that there must be; by default as many as the first row has.

    Raises
    ------
    InputError
        Naming the file and the row, if a cell is missing or no number, rows differ in length, or
        the file is too large or no text.
    """
    rows = csv.reader(io.StringIO(_text(path, limit, remedy).rstrip()))
    labels, numbers, lines = tuple[str, ...](), array("d"), array("q")
    try:
        for cells in rows:
            if rows.line_num == 1 and _is_header(cells):
                labels = tuple(cell.strip() for cell in cells)
                if len(labels) == len(names) or not names:
                    names = names or labels
                    continue
            names = names or [f"column {k + 1}" for k in range(len(cells))]
            try:
                row = list(map(float, cells))
            except ValueError as problem:
                raise _refusal(f"{path}: row {rows.line_num}", cells, names) from problem
            if len(row) != len(names):
                raise _refusal(f"{path}: row {rows.line_num}", cells, names)
            numbers.extend(row)
            lines.append(rows.line_num)
    except csv.Error as problem:
        raise InputError(f"{path}: row {rows.line_num}: {problem}") from problem
    return Columns(labels, np.array(numbers).reshape(len(lines), len(names)), lines)


def _text(path: Path, limit: int, remedy: str) -> str:
    try:
        size = path.stat().st_size
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror}") from problem
    if size > limit:
        raise InputError(f"{path}: {size} bytes; at most {limit} ({remedy})")
    return read_text(path, limit, InputError)


def _is_header(cells: Sequence[str]) -> bool:
    return not any(_number(cell) is not None or not cell.strip() for cell in cells)


def _refusal(where: str, cells: Sequence[str], names: Sequence[str]) -> InputError:
    """Return the error of a row that does not hold a number for each name."""
    if len(cells) != len(names):
        count = f"{len(cells)} cells" if len(cells) != 1 else "one cell"
        *most, last = names
        wanted = f"{', '.join(most)} and {last}" if most else last
        return InputError(f"{where}: {count if cells else 'empty'}; give {wanted}, a comma between")
    k = next(k for k, cell in enumerate(cells) if _number(cell) is None)
    cell = cells[k].strip()
    if not cell:
        return InputError(f"{where}: no {names[k]}; fill the gap or leave the row out")
    return InputError(f"{where}: {names[k]} {shown(cell)} is not a number")


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
