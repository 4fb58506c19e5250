"""Variants of a base spec: grids, lists from files, random ones; each a few numbers by name."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import SpecError, shown, suggest
from polefence.base.files import read_bytes, read_text
from polefence.base.parquet import read_table
from polefence.plant.expression import decimal
from polefence.proof.short import Short

MOST = 1_000_000  # variants of a study
MAX_BYTES = 200_000_000
LABEL = "label"  # the column that names a variant
WAYS = ("latin hypercube", "uniform")


@dataclass(frozen=True)
class Variants(Short):
    """Numbers of the base spec, and their values for each variant.

    Attributes
    ----------
    names : tuple of str
        As `polefence.plant.varied` has them.
    rows : sequence of tuples
        For each variant its values; None leaves that of the base.
    labels : sequence of str
        For each variant, empty where it has none.
    """

    names: tuple[str, ...]
    rows: Sequence[tuple[Fraction | None, ...]]
    labels: Sequence[str] = field(default=())

    def __len__(self) -> int:
        return len(self.rows)

    def values(self, number: int) -> dict[str, Fraction]:
        """Return what one variant changes."""
        pairs = zip(self.names, self.rows[number], strict=True)
        return {name: value for name, value in pairs if value is not None}

    def label(self, number: int) -> str:
        """Return the name of one."""
        return self.labels[number] if self.labels else ""


def read_variants(table: Any, folder: Path, known: Mapping[str, Fraction]) -> Variants:
    """Read the table ``[variants]`` of a study.

    Parameters
    ----------
    folder : Path
        Where files that are named are looked for.
    known : mapping
        The numbers that the base has.

    Raises
    ------
    SpecError
        Naming the key, the value and the remedy.
    """
    if not isinstance(table, dict) or not table:
        raise SpecError(
            "variants must be a table with grid, list or random: [variants], "
            "grid = {NAME = [1, 2, 3]}"
        )
    readers = {"grid": _grid, "list": _listed, "random": _random}
    for key in table:
        if key not in readers:
            raise SpecError(f"variants: unknown key {shown(key)}; {suggest(key, readers)}")
    parts = [read(table[key], folder) for key, read in readers.items() if key in table]
    every = [name for part in parts for name in part.names]
    for name in every:
        if name not in known:
            words = suggest(name, known)
            raise SpecError(f"variants: the base has no number {shown(name)}; {words}")
        if every.count(name) > 1:
            raise SpecError(f"variants: {shown(name)} varies twice; let one of them have it")
    return _multiplied(parts)


def _multiplied(parts: Sequence[Variants]) -> Variants:
    """Return all combinations."""
    _require_few(math.prod(map(len, parts)))
    names = tuple(name for part in parts for name in part.names)
    labels = next((part.labels for part in parts if part.labels), ())
    which = next((k for k, part in enumerate(parts) if part.labels), 0)
    rows, kept = [], []
    for numbers in product(*(range(len(part)) for part in parts)):
        picked = (part.rows[k] for part, k in zip(parts, numbers, strict=True))
        rows.append(tuple(value for row in picked for value in row))
        kept += [labels[numbers[which]]] if labels else []
    return Variants(names, rows, kept)


def _require_few(count: int) -> None:
    if count > MOST:
        raise SpecError(f"variants: {count} of them; a study has at most {MOST}")
    if count < 1:
        raise SpecError("variants: a list is empty; give at least one value")


def _grid(table: Any, _: Path) -> Variants:
    if not isinstance(table, dict) or not table:
        raise SpecError("variants.grid must be a table: grid = {NAME = [1, 2, 3]}")
    values = []
    for name, levels in table.items():
        if not isinstance(levels, list) or not levels:
            raise SpecError(f"variants.grid.{name} must be a list of numbers, [1, 2, 3]")
        values.append([_number(x, f"variants.grid.{name}") for x in levels])
    _require_few(math.prod(map(len, values)))
    return Variants(tuple(table), list(product(*values)))


def _random(table: Any, _: Path) -> Variants:
    where = "variants.random"
    keys = ("count", "of", "seed", "by")
    if not isinstance(table, dict):
        raise SpecError(f"{where} must be a table: {{count = 500, of = {{NAME = [1, 2]}}}}")
    for key in table:
        if key not in keys:
            raise SpecError(f"{where}: unknown key {shown(key)}; {suggest(key, keys)}")
    for key in keys[:2]:
        if key not in table:
            raise SpecError(f"{where}: {key} is missing")
    count, seed = (_whole(table.get(key, 0), f"{where}.{key}") for key in ("count", "seed"))
    _require_few(count)
    by = table.get("by", WAYS[0])
    if by not in WAYS:
        raise SpecError(f"{where}.by = {shown(by)} is unknown; {suggest(str(by), WAYS)}")
    if not isinstance(table["of"], dict) or not table["of"]:
        raise SpecError(f"{where}.of must be a table: of = {{NAME = [LOW, HIGH]}}")
    ends = []
    for name, interval in table["of"].items():
        if not isinstance(interval, list) or len(interval) != 2:
            raise SpecError(f"{where}.of.{name} must be [LOW, HIGH]")
        low, high = (_number(x, f"{where}.of.{name}") for x in interval)
        if not low < high:
            raise SpecError(f"{where}.of.{name}: {float(low):g} must be below {float(high):g}")
        ends.append((float(low), float(high)))
    generator = np.random.default_rng(seed)
    shares = generator.random((count, len(ends)))
    if by == WAYS[0]:  # one in each of as many slices
        slices = [generator.permutation(count) for _ in ends]
        shares = (np.stack(slices, axis=1) + shares) / count
    low, high = np.array(ends).T
    rows = (low + (high - low) * shares).tolist()
    # six digits: a decimal that anybody can write
    return Variants(tuple(table["of"]), [tuple(Fraction(f"{x:.6g}") for x in row) for row in rows])


def _listed(name: Any, folder: Path) -> Variants:
    if not isinstance(name, str) or Path(name).suffix not in (".csv", ".parquet"):
        raise SpecError(f"variants.list = {shown(name)} must name a .csv or a .parquet file")
    path = folder / name
    labels, rows = (_csv if path.suffix == ".csv" else _parquet)(path)
    if len(set(labels)) < len(labels) or not all(labels):
        raise SpecError(f"{path}: two columns have the same name, or a column has no name")
    numbers = [k for k, label in enumerate(labels) if label != LABEL]
    if not numbers:
        raise SpecError(f"{path}: has no column of numbers")
    cells, names = [], []
    for i, row in enumerate(rows):
        if len(row) != len(labels):
            raise SpecError(f"{path}: row {i + 1} has {len(row)} cells in place of {len(labels)}")
        cells.append(tuple(_cell(row[k], f"{path}: row {i + 1}: {labels[k]}") for k in numbers))
        names += [row[labels.index(LABEL)].strip()] if LABEL in labels else []
    _require_few(len(cells))
    return Variants(tuple(labels[k] for k in numbers), cells, names)


def _csv(path: Path) -> tuple[list[str], Iterable[list[str]]]:
    text = read_text(path, MAX_BYTES, SpecError)
    try:
        head, *rows = csv.reader(io.StringIO(text), strict=True)
    except (csv.Error, ValueError) as error:
        raise SpecError(f"{path}: cannot be read: {error or 'it is empty'}") from error
    return [label.strip() for label in head], [row for row in rows if any(map(str.strip, row))]


def _parquet(path: Path) -> tuple[list[str], Iterable[list[str]]]:
    content = read_bytes(path, MAX_BYTES, SpecError)
    remedy = "pip install 'polefence[parquet]', or give a .csv"
    table = read_table(content, str(path), remedy, SpecError)
    columns = [
        ["" if x is None else str(x) for x in column.to_pylist()] for column in table.columns
    ]
    return list(table.column_names), [list(row) for row in zip(*columns, strict=True)]


def _cell(text: str, where: str) -> Fraction | None:
    if not text.strip():
        return None
    try:
        return decimal(text.strip())
    except SpecError as error:
        raise SpecError(f"{where}: {error}; write a number, or leave the cell empty") from error


def _number(value: Any, where: str) -> Fraction:
    if isinstance(value, bool) or not isinstance(value, int | Fraction):
        raise SpecError(f"{where}: {shown(value)} must be a finite number")
    return Fraction(value)


def _whole(value: Any, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise SpecError(f"{where} = {shown(value)} must be a whole number, zero or more")
    return value
