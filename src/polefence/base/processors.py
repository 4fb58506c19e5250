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


BLAS = "OPENBLAS_NUM_THREADS"  # which OpenBLAS reads while it is loaded


@contextmanager
def small_matrices() -> Iterator[None]:
    """Have BLAS use one thread: more gain nothing there, and lose much to other processes.

    Also a BLAS that is loaded meanwhile, as SciPy brings its own: it has all processors afterwards.
    """
    from threadpoolctl import ThreadpoolController

    before = ThreadpoolController()
    outermost = BLAS not in os.environ
    with before.limit(limits=1, user_api="blas"):
        if not outermost:
            yield
            return
        os.environ[BLAS] = "1"
        try:
            yield
        finally:
            os.environ.pop(BLAS, None)
            known = {own.filepath for own in before.lib_controllers}
            for own in ThreadpoolController().lib_controllers:
                if own.user_api == "blas" and own.filepath not in known:
                    own.set_num_threads(processors())
