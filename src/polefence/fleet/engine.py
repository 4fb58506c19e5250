"""Tasks carried out by processes that may die: each once, or given up with its reason."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any, Generic, TypeVar

from polefence.base.errors import OutputError

T = TypeVar("T")
R = TypeVar("R")

STRIKES = 4  # times that a task may end the worker that has it alone
Work = Callable[[Any], Any]
Places = Callable[[], AbstractContextManager[Executor | None]]
Dead = tuple[type[BaseException], ...]


class _Died(Exception):  # noqa: N818
    """Signal that the pool is to be closed, for a worker died."""


@contextmanager
def kept(places: Places) -> Iterator[Places]:
    """Keep a pool open from one use to the next, until a worker dies.

    Processes take a second to start.
    """
    with ExitStack() as stack:
        pools = list[Executor | None]()

        @contextmanager
        def again() -> Iterator[Executor | None]:
            if not pools:
                pools.append(stack.enter_context(places()))
            try:
                yield pools[0]
            except _Died:
                pools.clear()
                stack.close()
                raise

        yield again


@dataclass(eq=False)
class _Tried(Generic[T]):
    """A task, and how often its worker died while it ran alone."""

    task: T
    suspect: bool = False
    strikes: int = 0


class _Queue(Generic[T]):
    """Tasks that are left; suspects, which were under way when a worker died, come first."""

    def __init__(self, tasks: Iterable[T]) -> None:
        self.fresh, self.suspects = iter(tasks), deque[_Tried[T]]()

    def next(self) -> _Tried[T] | None:
        """Take one, None where none is left."""
        if self.suspects:
            return self.suspects.popleft()
        for task in self.fresh:
            return _Tried(task)
        return None

    def suspect(self, tried: _Tried[T]) -> None:
        """Put a task back whose worker died; a strike if it ran alone."""
        if tried.suspect:  # once more at once, to be sure
            tried.strikes += 1
            self.suspects.appendleft(tried)
            return
        tried.suspect = True
        self.suspects.append(tried)

    def given_up(self) -> list[T]:
        """Remove and return the tasks that end every worker."""
        guilty = [tried for tried in self.suspects if tried.strikes >= STRIKES]
        self.suspects = deque(tried for tried in self.suspects if tried.strikes < STRIKES)
        return [tried.task for tried in guilty]


def carried_out(
    tasks: Iterable[T], work: Callable[[T], R], places: Places, window: int, lost: Dead = ()
) -> Iterator[tuple[T, R | None]]:
    """Yield each task with its result, as they come; None for one that ends its workers.

    Where a worker dies, the tasks under way are suspects: each is then tried alone, so that it is
    known which of them it was.

    Parameters
    ----------
    work : callable
        A function that travels to other processes.
    places : callable
        Opens what tasks are carried out in; None: here. It is called again when that is broken,
        and not at all where there are no tasks.
    window : int
        Tasks under way at once.
    lost : tuple of exception classes
        What says, besides `BrokenExecutor`, that a worker or who leads them has died.

    Raises
    ------
    OutputError
        If workers die as soon as they start.
    """
    tasks = iter(tasks)
    first = list(islice(tasks, 1))
    if not first:
        return
    queue, barren = _Queue(chain(first, tasks)), 0
    broken = _Broken(BrokenExecutor, CancelledError, *lost)
    # times that workers may die, one after the other, with no result
    while barren < 40:
        with suppress(_Died), ExitStack() as stack:
            pool = broken.entered(stack, places)
            if not broken.seen and pool is None:
                while (tried := queue.next()) is not None:
                    yield tried.task, work(tried.task)
                return
            if pool is not None:
                for pair in _in_pool(pool, work, queue, window, broken):
                    barren = 0
                    yield pair
            if broken.seen:
                raise _Died
        if not broken.seen:
            return
        for task in queue.given_up():
            yield task, None
        broken.seen, barren = False, barren + 1
    raise OutputError(
        "workers die as soon as they start; nothing more can be worked out; a script has to call "
        "this below: if __name__ == '__main__':"
    )


class _Broken:
    """Whether one of some exceptions came."""

    def __init__(self, *kinds: type[BaseException]) -> None:
        self.kinds, self.seen = kinds, False

    def entered(self, stack: ExitStack, places: Places) -> Executor | None:
        """Open a pool; None where its workers die at once."""
        try:
            return stack.enter_context(places())
        except self.kinds:
            self.seen = True
            return None


def _in_pool(
    pool: Executor, work: Callable[[T], R], queue: _Queue[T], window: int, broken: _Broken
) -> Iterator[tuple[T, R]]:
    """Yield results until none are left or the pool breaks; unfinished tasks go back."""
    under_way = dict[Future[R], _Tried[T]]()
    while not broken.seen:
        _submit(pool, work, queue, window, under_way, broken)
        if not under_way:
            return
        done, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in done:
            tried = under_way.pop(future)
            try:
                result = future.result()
            except broken.kinds:
                broken.seen = True
                queue.suspect(tried)
                continue
            yield tried.task, result
    for future, lost in under_way.items():
        future.cancel()
        queue.suspect(lost)


def _submit(
    pool: Executor,
    work: Callable[[T], R],
    queue: _Queue[T],
    window: int,
    under_way: dict[Future[R], _Tried[T]],
    broken: _Broken,
) -> None:
    """Submit as many tasks as the pool takes; a suspect runs alone."""
    while not broken.seen:
        alone = bool(queue.suspects) or any(tried.suspect for tried in under_way.values())
        if len(under_way) >= (1 if alone else window):
            return
        tried = queue.next()
        if tried is None:
            return
        try:
            under_way[pool.submit(work, tried.task)] = tried
        except broken.kinds:
            broken.seen = True
            queue.suspect(tried)
