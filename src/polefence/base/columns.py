"""Columns of numbers in CSV files from strangers."""

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
from polefence.base.files import read_text


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
                found = list(map(float, cells))
            except ValueError as problem:
                raise _refusal(f"{path}: row {rows.line_num}", cells, names) from problem
            if len(found) != len(names):
                raise _refusal(f"{path}: row {rows.line_num}", cells, names)
            numbers.extend(found)
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
    """Say why a row holds no numbers of these names."""
    if len(cells) != len(names):
        found = f"{len(cells)} cells" if len(cells) != 1 else "one cell"
        *most, last = names
        wanted = f"{', '.join(most)} and {last}" if most else last
        return InputError(f"{where}: {found if cells else 'empty'}; give {wanted}, a comma between")
    k = next(k for k, cell in enumerate(cells) if _number(cell) is None)
    cell = cells[k].strip()
    if not cell:
        return InputError(f"{where}: no {names[k]}; fill the gap or leave the row out")
    return InputError(f"{where}: {names[k]} {shown(cell)} is no number")


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
