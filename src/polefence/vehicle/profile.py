"""Measured roads, read from a file of distance and height."""

from __future__ import annotations

import csv
import io
from array import array
from pathlib import Path

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.base.files import read_text
from polefence.plant.system import Array
from polefence.response.signals import split
from polefence.vehicle.road import Road, first_fault

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
    distance, height, lines = _columns(path)
    if len(lines) < 2:
        raise InputError(f"{path}: {len(lines)} points; a road needs two or more")
    fault = first_fault(distance, height)
    if fault:
        raise InputError(f"{path}: row {lines[fault[0]]}: {fault[1]}")
    road = Road(distance, height, path.stem)
    return road if spacing is None else road.resample(spacing)


def _columns(path: Path) -> tuple[Array, Array, array[int]]:
    """Return distances and heights, and the line of the file each point stands in."""
    text = _text(path).rstrip()
    distance, height, lines = array("d"), array("d"), array("q")
    reader = csv.reader(io.StringIO(text))
    try:
        for cells in reader:
            if reader.line_num == 1 and _is_header(path, cells):
                continue
            try:
                x, h = map(float, cells)
            except ValueError as problem:
                raise _refusal(f"{path}: row {reader.line_num}", cells) from problem
            distance.append(x)
            height.append(h)
            lines.append(reader.line_num)
    except csv.Error as problem:
        raise InputError(f"{path}: row {reader.line_num}: {problem}") from problem
    return np.frombuffer(distance), np.frombuffer(height), lines


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


def _refusal(where: str, cells: list[str]) -> InputError:
    """Say why a row is no point."""
    if len(cells) != 2:
        found = f"{len(cells)} cells" if len(cells) != 1 else "one cell"
        return InputError(
            f"{where}: {found if cells else 'empty'}; give distance and height, a comma between"
        )
    k = 0 if _number(cells[0]) is None else 1
    name, cell = ("distance", "height")[k], cells[k].strip()
    if not cell:
        return InputError(f"{where}: no {name}; fill the gap or leave the row out")
    return InputError(f"{where}: {name} {shown(cell)} is no number")


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
