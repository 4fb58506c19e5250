"""Sweeps: the smallest disk for many centres and methods."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from polefence.conditions.methods import METHODS, Method, Scheduled, method_name
from polefence.design import Design, tightest
from polefence.errors import NotProvedError
from polefence.plant.family import UncertainPlant
from polefence.region import check_centre


@dataclass(frozen=True, eq=False)
class Limit:
    """One row of a sweep.

    Attributes
    ----------
    centre : float
        [1/s], negative.
    method : str
    radius : float or None
        The smallest proved radius [1/s]; None where nothing was proved.
    status : str
        "proved" or "undecided".
    seconds : float
    design : Design or None
    """

    centre: float
    method: str
    radius: float | None
    status: str
    seconds: float
    design: Design | None = None

    @property
    def ratio(self) -> float | None:
        """Return d / sigma in percent, the ordinate of figures 3 and 4 of the paper."""
        return None if self.radius is None else 100 * (1 + self.radius / self.centre)

    def as_row(self, gain: bool = False) -> dict[str, Any]:
        """Return the row as plain data, with its law where wanted."""
        row: dict[str, Any] = {
            key: getattr(self, key) for key in ("centre", "method", "radius", "status", "seconds")
        }
        if gain:
            row["law"] = None if self.design is None else self.design.certificate.document()["law"]
        return row


def limits(
    plant: UncertainPlant,
    centres: Iterable[float] | float,
    methods: Sequence[Method] | Method = METHODS,
    executor: Executor | None = None,
    on_row: Callable[[Limit], None] | None = None,
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

    Raises
    ------
    InputError
        If a centre or method is unusable, or a vertex uncontrollable. A row that fails otherwise
        is "undecided" and never stops the sweep.
    """
    if isinstance(methods, str | Scheduled):
        methods = (methods,)
    if not isinstance(centres, Iterable):
        centres = (centres,)
    tasks = [(check_centre(c), m) for c in centres for m in methods]
    rows: dict[int, Limit] = {}
    for index, row in as_finished(plant, tasks, executor):
        rows[index] = row
        if on_row is not None:
            on_row(row)
    return [rows[index] for index in range(len(tasks))]


def as_finished(
    plant: UncertainPlant, tasks: Sequence[tuple[float, Method]], executor: Executor | None = None
) -> Iterator[tuple[int, Limit]]:
    """Yield each task's index and row as soon as it is done; see `limits`."""
    for centre, method in tasks:
        check_centre(centre)
        method_name(method)
    plant.require_controllable()
    if executor is None:
        yield from ((i, one_limit(plant, *task)) for i, task in enumerate(tasks))
        return
    futures = {executor.submit(one_limit, plant, *task): i for i, task in enumerate(tasks)}
    try:
        for future in as_completed(futures):
            index = futures[future]
            try:
                row = future.result()
            except BrokenExecutor:  # a worker was killed, and the pool with it: go on here
                row = one_limit(plant, *tasks[index])
            yield index, row
    except KeyboardInterrupt:
        raise  # whoever owns the executor ends it; cancelling here would race with that
    except BaseException:
        for future in futures:
            future.cancel()
        raise


def one_limit(plant: UncertainPlant, centre: float, method: Method) -> Limit:
    """Return one row of a sweep."""
    start = time.perf_counter()
    design: Design | None = None
    with suppress(NotProvedError):
        design = tightest(plant, centre, method)
    seconds = time.perf_counter() - start
    radius = None if design is None else design.region.radius
    status = "undecided" if design is None else "proved"
    return Limit(centre, method_name(method), radius, status, seconds, design)
