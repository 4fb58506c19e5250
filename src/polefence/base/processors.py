"""Processors: how many there are for this process, and for one thread of it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar

_SHARED = ContextVar("shared", default=False)


def processors() -> int:
    """Return how many processors this process may use: no more than ``OMP_NUM_THREADS``."""
    affinity = getattr(os, "sched_getaffinity", None)
    count = len(affinity(0)) if affinity else os.cpu_count() or 1
    with suppress(ValueError):
        count = min(count, int(os.environ.get("OMP_NUM_THREADS", count)))
    return max(count, 1)


def spare_processors() -> int:
    """Return how many of them one large piece of work in this thread may use."""
    # more than 16 share one thread's work to no avail
    return 1 if _SHARED.get() else min(processors(), 16)


def share_processors() -> None:
    """Leave the others alone in this thread from now on: there is work for each."""
    _SHARED.set(True)


@contextmanager
def small_matrices() -> Iterator[None]:
    """Have BLAS use one thread: more gain nothing there, and lose much to other processes."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
