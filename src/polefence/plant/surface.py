"""Tables of two arguments, as sums of products of tables of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

from polefence.base.errors import PlantError, shown
from polefence.base.explained import explained_fields
from polefence.proof.functions import MAX_KNOTS, Table, Tree
from polefence.proof.short import Short
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Surface(Short):
    """Values over two arguments, interpolated linearly along each.

    With rows f_j, tables of the second argument, it is f_1(y) plus the sum of
    r_j(x) (f_j+1(y) - f_j(y)), where r_j rises from 0 to 1 between knots j and j + 1.

    Parameters
    ----------
    first, second : sequence of number
        Knots, rising.
    values : sequence of sequences of number
        One row for each of the first knots.

    Raises
    ------
    PlantError
        If there is something else than numbers.
    """

    first: Sequence[Any]
    second: Sequence[Any]
    values: Sequence[Sequence[Any]]

    @explained_fields
    def __post_init__(self) -> None:
        for key in ("first", "second"):
            object.__setattr__(self, key, _numbers(getattr(self, key), key))
        rows = tuple(_numbers(row, "a row of values") for row in self.values)
        object.__setattr__(self, "values", rows)

    def require(self, name: str) -> None:
        """Refuse knots that do not rise, and values that are not theirs.

        Raises
        ------
        FormatError
        """
        for knots in map(tuple, (self.first, self.second)):
            Table(knots, knots).require(name)
        if len(self.values) != len(self.first) or any(
            len(row) != len(self.second) for row in self.values
        ):
            raise FormatError(
                f"table {name}: values must have {len(self.first)} rows of {len(self.second)}, one "
                f"for each of the first arguments; at most {MAX_KNOTS}"
            )

    def tables(self, name: str) -> dict[str, Table]:
        """Return the tables of one argument, by names of their own."""
        steps = [
            tuple(b - a for a, b in zip(low, high, strict=True))
            for low, high in pairwise(self.values)
        ]
        rows = {f"{name}_row_1": Table(tuple(self.second), tuple(self.values[0]))}
        for j, step in enumerate(steps, 1):
            risen = tuple(Fraction(k >= j) for k in range(len(self.first)))
            rows |= {
                f"{name}_ramp_{j}": Table(tuple(self.first), risen),
                f"{name}_step_{j}": Table(tuple(self.second), step),
            }
        return rows

    def called(self, name: str, x: Tree, y: Tree) -> Tree:
        """Return it as a function of two arguments."""
        total = y.called(f"{name}_row_1")
        for j in range(1, len(self.first)):
            total = total + x.called(f"{name}_ramp_{j}") * y.called(f"{name}_step_{j}")
        return total


def _numbers(values: Sequence[Any], what: str) -> tuple[Fraction, ...]:
    try:
        return tuple(map(Fraction, values))
    except (ValueError, OverflowError) as error:
        raise PlantError(f"{what} = {shown(values)} must be finite numbers") from error


def of_one_argument(tables: Mapping[str, Table | Surface]) -> dict[str, Table]:
    """Return all tables of one argument, those of surfaces among them."""
    every = dict[str, Table]()
    for name, table in tables.items():
        every |= {name: table} if isinstance(table, Table) else table.tables(name)
    return every
