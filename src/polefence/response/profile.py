"""Measured roads, read from a file of distance and height."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from polefence.errors import InputError
from polefence.files import read_text
from polefence.response.road import Road, first_fault
from polefence.response.signals import split

MAX_BYTES = 50_000_000


def measured_road(path: str | Path, spacing: float | None = None) -> Road:
    """Read a road from a CSV file: distance [m] and height [m] in two columns, comma between.

    A first row of names is allowed; a unit in it must be [m].

    Parameters
    ----------
    path : str or Path
    spacing : float, optional
        Resample at equally spaced points [m]; see `Road.resample`.

    Raises
    ------
    InputError
        Naming the file and the row, if a cell is missing or no finite number, distance does not
        increase, there are fewer than two points, or the file is too large or no text.
    """
    path = Path(path)
    rows, lines = _rows(path)
    if len(rows) < 2:
        raise InputError(f"{path}: {len(rows)} points; a road needs two or more")
    table = np.array(rows)
    fault = first_fault(table[:, 0], table[:, 1])
    if fault:
        raise InputError(f"{path}: row {lines[fault[0]]}: {fault[1]}")
    road = Road(table[:, 0], table[:, 1], path.stem)
    return road if spacing is None else road.resample(spacing)


def _rows(path: Path) -> tuple[list[tuple[float, float]], list[int]]:
    """Return the points, and the line of the file each stands in."""
    text = _text(path).rstrip()
    rows, lines = [], []
    reader = csv.reader(io.StringIO(text))
    try:
        for cells in reader:
            if reader.line_num == 1 and _is_header(path, cells):
                continue
            rows.append(_point(f"{path}: row {reader.line_num}", cells))
            lines.append(reader.line_num)
    except csv.Error as problem:
        raise InputError(f"{path}: row {reader.line_num}: {problem}") from problem
    return rows, lines


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
    except OSError as problem:
        raise InputError(f"{path}: cannot be read: {problem.strerror}") from problem
    if size > MAX_BYTES:
        raise InputError(
            f"{path}: {size} bytes; at most {MAX_BYTES} (cut the profile into shorter roads)"
        )
    return read_text(path, MAX_BYTES, InputError)


def _is_header(path: Path, cells: list[str]) -> bool:
    if len(cells) != 2 or any(_number(cell) is not None or not cell.strip() for cell in cells):
        return False
    for cell in cells:
        unit = split(cell)[1]
        if unit not in ("", "m"):
            raise InputError(f"{path}: row 1: {cell.strip()!r} is in {unit}; give metres, [m]")
    return True


def _point(where: str, cells: list[str]) -> tuple[float, float]:
    if len(cells) != 2:
        found = f"{len(cells)} cells" if len(cells) != 1 else "one cell"
        raise InputError(
            f"{where}: {found if cells else 'empty'}; give distance and height, a comma between"
        )
    values = [_number(cell) for cell in cells]
    for name, cell, value in zip(("distance", "height"), cells, values, strict=True):
        if not cell.strip():
            raise InputError(f"{where}: no {name}; fill the gap or leave the row out")
        if value is None:
            raise InputError(f"{where}: {name} {cell.strip()[:40]!r} is no number")
    return values[0], values[1]  # type: ignore[return-value]


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
