"""Where tasks are carried out: this process, worker processes, an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any

from polefence.base import workers
from polefence.base.explained import explained
from polefence.base.processors import processors
from polefence.fleet.engine import Dead, Places, R, T, Work, carried_out
from polefence.proof.short import Short


@dataclass(frozen=True)
class Workers(Short):
    """Where tasks are carried out.

    Attributes
    ----------
    places : callable
        As `carried_out` takes it.
    count : int
        How many there are.
    lost : tuple of exception classes
        What says that one has died.
    around : callable, optional
        ``around(work, task)`` does a task there; by default the work itself does.
    """

    places: Places
    count: int
    lost: Dead = ()
    around: Callable[[Work, Any], Any] | None = None

    def done(self, work: Callable[[T], R], tasks: Iterable[T]) -> Iterator[tuple[T, R | None]]:
        """Yield tasks with their results, as `carried_out` does."""
        carried = work if self.around is None else partial(self.around, work)
        # two groups for each worker: one under way, one that waits
        return carried_out(tasks, carried, self.places, 2 * self.count, self.lost)


def here() -> Workers:
    """Return this process as a worker."""
    return Workers(nullcontext, 1)


@explained
def processes(jobs: int | None = None) -> Workers:
    """Return worker processes of this machine, by default one a processor."""
    count = jobs or processors()
    return Workers(partial(workers.processes, count), count)


@explained
def given(executor: Executor, count: int | None = None) -> Workers:
    """Return the workers of an executor, which is left open."""
    return Workers(lambda: nullcontext(executor), count or processors())
