"""Which entries of a plant's matrices are functions of its parameters, as files say it.

``{"tables": [{"name", "arguments", "values", "cubic"}], "functions": [{"text", "entries": [{"of",
"row", "column", "times"}]}]}``. ``of`` is A, B or E, or C, D or F with the name of an ``output``,
which has one row. The entry has so many times the function, less the combination of that one's
values at the vertices, in place of nothing: at the vertices it is what the plant says there. In a
plant that is sampled a function may have no entries: the samples are of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.proof.approximation import Functions
from polefence.proof.functions import FUNCTIONS, MAX_KNOTS, Table, parse
from polefence.proof.ranges import Range
from polefence.proof.reading import Table as Entries
from polefence.proof.reading import plain
from polefence.proof.remainder import Remainder, Source
from polefence.proof.short import Short
from polefence.proof.work import FormatError

MAX_FUNCTIONS, MAX_ENTRIES, MAX_TABLES = 64, 5000, 32

Directions = tuple[tuple[tuple[Fraction, ...], ...], ...]  # a matrix for each function


@dataclass(frozen=True)
class Placed(Short):
    """Functions, and the matrices of each: of [A, B, E], and of [C, D, F] of outputs by name."""

    functions: Functions
    of_plant: Directions
    of_outputs: Mapping[str, Directions]

    def remainder(self) -> Remainder | None:
        """Return what [A, B, E] is off by from the combination of the vertices; None if nothing."""
        return near(self.functions, self.of_plant)

    def of_output(self, name: str) -> Remainder | None:
        """Return the same of [C, D, F] of an output."""
        return near(self.functions, self.of_outputs.get(name, ()))


def near(functions: Functions, directions: Directions) -> Remainder | None:
    """Return what functions add on the whole box; None where they are in no entry."""
    if not any(x for M in directions for row in M for x in row):
        return None
    return Source(functions, directions).on_box


def read_entries(
    table: Entries, ranges: tuple[Range, ...], shape: tuple[int, int, int], outputs: Sequence[str]
) -> Placed:
    """Read the functions of a plant.

    Raises
    ------
    FormatError
        If one cannot be read, has no value somewhere, or stands where nothing is.
    """
    n, m, q = shape
    if not ranges:
        raise FormatError(f"{table.where}: functions are of parameters, and there are none")
    rows = table.tables("tables", MAX_TABLES) if "tables" in table else []
    tables = dict(map(_read_table, rows))
    names = [r.name for r in ranges]
    if len(tables) < len(rows) or any(name in names or name in FUNCTIONS for name in tables):
        raise FormatError(f"{table.path('tables')}: a name is given twice")
    trees, of_plant = [], []
    of_outputs: dict[str, list[list[list[Fraction]]]] = {}
    listed = table.tables("functions", MAX_FUNCTIONS)
    starts = {"A": 0, "B": n, "E": n + m, "C": 0, "D": n, "F": n + m}
    widths = {"A": n, "B": m, "E": q, "C": n, "D": m, "F": q}
    for k, item in enumerate(listed):
        trees.append(parse(item.text("text"), names, tables))
        of_plant.append(_zeros(n, n + m + q))
        for entry in item.tables("entries", MAX_ENTRIES, 0):
            letter = entry.word("of", starts)
            if letter in "CDF":
                name, row = entry.text("output"), 1
                if outputs.count(name) != 1:
                    raise FormatError(f"{entry.path('output')} names no output of the plant")
                blank = [_zeros(1, n + m + q) for _ in listed]
                matrix = of_outputs.setdefault(name, blank)[k]
            else:
                matrix, row = of_plant[k], entry.whole("row", None, n, 1)
            column = entry.whole("column", None, max(widths[letter], 1), 1)
            if column > widths[letter]:
                raise FormatError(f"{entry.path('column')}: there is no such column")
            matrix[row - 1][starts[letter] + column - 1] = entry.number("times", 1)
    bare = tuple(Range(r.low, r.high, r.inverted, r.name) for r in ranges)
    functions = Functions(bare, tuple(trees), tuple(tables.items()))
    functions.on_box  # noqa: B018 -- refuses what has no value somewhere
    frozen = {name: _frozen(matrices) for name, matrices in of_outputs.items()}
    return Placed(functions, _frozen(of_plant), frozen)


def write_entries(placed: Placed, shape: tuple[int, int, int]) -> dict[str, Any]:
    """Return what `read_entries` reads."""
    n, m, _ = shape
    table: dict[str, Any] = {}
    if placed.functions.tables:
        table["tables"] = [
            {
                "name": name,
                "arguments": plain(known.arguments),
                "values": plain(known.values),
            }
            | ({"cubic": True} if known.cubic else {})
            for name, known in placed.functions.tables
        ]
    listed = []
    for k, tree in enumerate(placed.functions.trees):
        entries = _entries_of(placed.of_plant[k], "ABE", n, m) if placed.of_plant else []
        for name, matrices in placed.of_outputs.items():
            rows = _entries_of(matrices[k], "CDF", n, m)
            entries += [
                {"of": row["of"], "output": name}
                | {key: row[key] for key in ("column", "times") if key in row}
                for row in rows
            ]
        listed.append({"text": tree.text, "entries": entries})
    return table | {"functions": listed}


def _entries_of(
    matrix: Sequence[Sequence[Fraction]], letters: str, n: int, m: int
) -> list[dict[str, Any]]:
    entries = list[dict[str, Any]]()
    for i, row in enumerate(matrix):
        for j, x in enumerate(row):
            if x:
                k = (j >= n) + (j >= n + m)
                entry = {"of": letters[k], "row": i + 1, "column": j + 1 - (0, n, n + m)[k]}
                entries.append(entry | ({} if x == 1 else {"times": plain(x)}))
    return entries


def _read_table(row: Entries) -> tuple[str, Table]:
    name = row.text("name")
    if not name.isidentifier():
        raise FormatError(f"{row.path('name')} must be letters, digits and _")
    arguments, values = (row.numbers(key, most=MAX_KNOTS) for key in ("arguments", "values"))
    table = Table(arguments, values, row.flag("cubic"))
    table.require(name)
    return name, table


def _zeros(rows: int, columns: int) -> list[list[Fraction]]:
    return [[Fraction(0)] * columns for _ in range(rows)]


def _frozen(matrices: Sequence[Sequence[Sequence[Fraction]]]) -> Directions:
    return tuple(tuple(map(tuple, M)) for M in matrices)
