"""Columns of numbers with names and units, as CSV or Parquet."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, MissingExtraError
from polefence.base.files import make_folder, write_bytes
from polefence.plant.names import visible
from polefence.plant.system import Array

FORMATS = (".csv", ".parquet")
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
    if path.suffix not in FORMATS:
        raise InputError(f"{path}: signals are written as .csv or .parquet; name such a file")
    if path.suffix == ".parquet":
        _pyarrow()


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
    """A cell of text, in quotes where it would be misread."""
    if any(mark in label for mark in ',"'):
        return '"' + label.replace('"', '""') + '"'
    return label


def _parquet(table: Table) -> bytes:
    pyarrow, parquet = _pyarrow()
    columns = {visible(label): np.ascontiguousarray(table.of(label)) for label in table.labels}
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), buffer)
    return buffer.getvalue()


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError(
            "Parquet needs pyarrow, which is not installed; pip install 'polefence[parquet]', or "
            "name a .csv file"
        ) from error
    return pyarrow, pyarrow.parquet
