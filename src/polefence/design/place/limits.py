"""Sweeps: the smallest disk for many centres and methods."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from polefence.base import workers
from polefence.base.errors import NotProvedError
from polefence.design.checks import (
    require_checkable,
    require_domain,
    require_movable,
    usable_centre,
)
from polefence.design.design import Design
from polefence.design.place.shipped import radius_of
from polefence.design.place.tightest import tightest_near
from polefence.lmi.conditions.methods import (
    METHODS,
    Method,
    Scheduled,
    Slack,
    fitting,
    method_label,
)
from polefence.lmi.solve.search import Reached
from polefence.plant.family import UncertainPlant

# Rows that start from one another: at most so many, their centres at most this share apart.
CHAIN, NEAR = 6, 0.25

Task = tuple[int, float, Method]


@dataclass(frozen=True, eq=False)
class Limit:
    """One row of a sweep.

    Attributes
    ----------
    centre : float
        [1/s], negative.
    method : str
        As `method_label` writes it: "slack", or "scheduled(2, 1, box)".
    radius : float or None
        The smallest proved radius [1/s]; None where nothing was proved.
    status : str
        "proved" or "undecided".
    lower : float or None
        A radius [1/s] proved to be out of the method's reach; None where none was proved.
    unrunnable : float or None
        A smaller radius, proved of a law that doubles cannot evaluate; None where there is none.
    seconds : float
    design : Design or None
    """

    centre: float
    method: str
    radius: float | None
    status: str
    seconds: float
    lower: float | None = None
    design: Design | None = None
    unrunnable: float | None = None

    @property
    def runs(self) -> bool:
        """Whether doubles can evaluate the law of ``radius``."""
        return self.design is not None and self.design.runs

    @property
    def ratio(self) -> float | None:
        """Return d / sigma in percent, the ordinate of figures 3 and 4 of the paper."""
        return 100 * (1 + self.radius / self.centre) if self.radius and self.centre < 0 else None

    def as_row(self, gain: bool = False) -> dict[str, Any]:
        """Return the row as plain data, with its law where wanted."""
        row: dict[str, Any] = {
            key: getattr(self, key)
            for key in ("centre", "method", "radius", "lower", "status", "seconds")
        }
        row |= {"runs": self.runs, "unrunnable": self.unrunnable}
        if gain:
            row["law"] = None if self.design is None else self.design.certificate.document()["law"]
        return row


def limits(
    plant: UncertainPlant,
    centres: Iterable[float] | float,
    methods: Sequence[Method] | Method = METHODS,
    executor: Executor | None = None,
    on_row: Callable[[Limit], None] | None = None,
    bounds: bool = True,
) -> list[Limit]:
    """Return the smallest proved disk for every centre and method, in that order.

    Parameters
    ----------
    plant : UncertainPlant
    centres : float or iterable of float
        Real coordinates, negative [1/s].
    methods : str or Scheduled, or a sequence of them
    executor : concurrent.futures.Executor, optional
        Where to run; without one, here and one after the other.
    on_row : callable, optional
        Called with each row as it is finished, so that an interrupted sweep loses none.
    bounds : bool
        Whether to prove lower bounds too, which takes longer than all the rest.

    Raises
    ------
    InputError
        If a centre or method is unusable, or a vertex has an unstable pole that no gain moves. A
        row that fails otherwise is "undecided" and never stops the sweep.
    """
    if isinstance(methods, str | Scheduled | Slack):
        methods = (methods,)
    if not isinstance(centres, Iterable):
        centres = (centres,)
    methods = [fitting(plant, method) for method in methods]
    tasks = [(usable_centre(plant, c), m) for c in centres for m in methods]
    rows: dict[int, Limit] = {}
    for index, row in as_finished(plant, tasks, executor, bounds):
        rows[index] = row
        if on_row is not None:
            on_row(row)
    return [rows[index] for index in range(len(tasks))]


def as_finished(
    plant: UncertainPlant,
    tasks: Sequence[tuple[float, Method]],
    executor: Executor | None = None,
    bounds: bool = True,
) -> Iterator[tuple[int, Limit]]:
    """Yield each task's index and row as soon as it is done; see `limits`."""
    for centre, method in tasks:
        usable_centre(plant, centre)
        require_domain(plant, method)
        require_checkable(plant, method)
    require_movable(plant)
    parts = chains(tasks)
    if executor is None:
        for part in parts:
            yield from _chain(plant, part, bounds)
        return
    for finished in workers.as_finished(executor, partial(chain, plant, bounds=bounds), parts):
        yield from finished


def chains(tasks: Sequence[tuple[float, Method]]) -> list[list[Task]]:
    """Sort tasks into runs of neighbouring centres, each to be computed in order.

    They depend on the tasks alone, so that the rows do too, wherever they are computed.
    """
    order = sorted(range(len(tasks)), key=lambda i: (repr(tasks[i][1]), tasks[i][0]))
    runs: list[list[Task]] = []
    for i in order:
        centre, method = tasks[i]
        last = runs[-1][-1] if runs and len(runs[-1]) < CHAIN else None
        if last is not None and last[2] == method and centre - last[1] <= NEAR * abs(last[1]):
            runs[-1].append((i, centre, method))
        else:
            runs.append([(i, centre, method)])
    # in the order of the tasks, so that the first rows are done first
    return sorted(runs, key=min)


def chain(plant: UncertainPlant, part: list[Task], bounds: bool) -> list[tuple[int, Limit]]:
    """Return a run of rows, each started from the one before."""
    return list(_chain(plant, part, bounds))


def _chain(plant: UncertainPlant, part: list[Task], bounds: bool) -> Iterator[tuple[int, Limit]]:
    near: Reached | None = None
    for k, (index, centre, method) in enumerate(part):
        if near is not None:
            # a disk about this centre that holds the neighbour's
            near = replace(near, r=near.r + abs(centre - part[k - 1][1]))
        start = time.perf_counter()
        design: Design | None = None
        try:
            design, near = tightest_near(plant, centre, method, near, bounds)
        except NotProvedError:
            near = None
        seconds = time.perf_counter() - start
        yield index, _row(centre, method, design, seconds)


def _row(centre: float, method: Method, design: Design | None, seconds: float) -> Limit:
    name = method_label(method)
    if design is None:
        return Limit(centre, name, None, "undecided", seconds)
    radius, sharper = radius_of(design), design.unrunnable
    return Limit(centre, name, radius, "proved", seconds, design.lower, design, sharper)
