"""Measured roads, read from a file of distance and height."""

from __future__ import annotations

from pathlib import Path

from polefence.base.errors import InputError
from polefence.plant.outputs import split
from polefence.response.columns import read_columns
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
    remedy = "cut the profile into shorter roads"
    found = read_columns(path, MAX_BYTES, remedy, ("distance", "height"))
    for label in found.labels:
        unit = split(label)[1]
        if unit not in ("", "m"):
            raise InputError(f"{path}: row 1: {label!r} is in {unit}; give metres, [m]")
    if len(found.lines) < 2:
        raise InputError(f"{path}: {len(found.lines)} points; a road needs two or more")
    distance, height = found.values.T.copy()
    fault = first_fault(distance, height)
    if fault:
        raise InputError(f"{path}: row {found.lines[fault[0]]}: {fault[1]}")
    road = Road(distance, height, path.stem)
    return road if spacing is None else road.resample(spacing)
