"""Threads that share the work of one search; what they answer does not depend on how many."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from typing import TypeVar

from polefence.base.processors import spare_processors

A = TypeVar("A")
B = TypeVar("B")


class Team:
    """As many threads as there are processors to spare; a context, at whose end they are gone.

    For functions that leave Python while they work: NumPy's, the kernel's.

    Parameters
    ----------
    count : int, optional
        How many threads; without it `spare_processors`.
    """

    def __init__(self, count: int | None = None) -> None:
        self.count = spare_processors() if count is None else count
        self._threads: Executor | None = None

    def __enter__(self) -> Team:
        if self.count > 1:
            self._threads = ThreadPoolExecutor(self.count)
        return self

    def __exit__(self, *_: object) -> None:
        with self._threads or nullcontext():
            self._threads = None

    def each(self, function: Callable[[A], B], items: Sequence[A]) -> list[B]:
        """Return what a function returns of each, in their order."""
        if self._threads is None or len(items) < 2:
            return [function(item) for item in items]
        return list(self._threads.map(function, items))


ALONE = Team(1)
