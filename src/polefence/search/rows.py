"""Rows of a sweep: computed side by side, kept in a file after each, resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from polefence.base.files import make_folder
from polefence.plant.family import UncertainPlant

Row = dict[str, Any]
Key = tuple[float, str]


def plant_summary(plant: UncertainPlant) -> dict[str, Any]:
    """Return what identifies a plant in a result file."""
    n, m = plant.shape
    return {
        "name": plant.name,
        "states": n,
        "inputs": m,
        "vertices": len(plant.vertices),
        "digest": plant.digest,
    } | ({} if plant.data is None else {"unproved": plant.data.note})


class RunOptions(TypedDict, total=False):
    """The fields of `Run` but its path, as keyword arguments."""

    executor: Executor | None
    resume: bool
    on_row: Callable[[Any], None] | None
    on_kept: Callable[[Row], None] | None


@dataclass(frozen=True, eq=False)
class Run:
    """Computing and keeping of the rows of a sweep.

    Attributes
    ----------
    executor : concurrent.futures.Executor, optional
        Where to run; without one, here and one after the other.
    path : Path, optional
        A JSON file that is kept up to date after every row.
    resume : bool
        Keep the proved rows that are in the file already.
    on_row : callable, optional
        Called with each row as it is finished.
    on_kept : callable, optional
        Called with each row of the file that is kept.
    """

    executor: Executor | None = None
    path: Path | None = None
    resume: bool = False
    on_row: Callable[[Any], None] | None = None
    on_kept: Callable[[Row], None] | None = None

    def complete(
        self,
        done: dict[Key, Row],
        order: Sequence[Key],
        fresh: Iterable[tuple[Key, Row, Any]],
        write: Callable[[Path, list[Row]], None],
    ) -> None:
        """Add rows as they are finished, each written and told of before the next.

        They are written in their order, then any others that are done.
        """
        for key, row, told in fresh:
            done[key] = row
            self.keep(done, order, write)
            if self.on_row is not None:
                self.on_row(told)
        self.keep(done, order, write)

    def keep(
        self,
        done: dict[Key, Row],
        order: Sequence[Key],
        write: Callable[[Path, list[Row]], None],
    ) -> None:
        """Write the rows that are done, where there is a file."""
        if self.path is not None:
            make_folder(self.path.parent)
            write(self.path, [done[key] for key in dict.fromkeys((*order, *done)) if key in done])
