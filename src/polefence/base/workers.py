"""Worker processes: tasks done in them, yielded as they finish, whatever becomes of a worker."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import AbstractContextManager, contextmanager, nullcontext
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from typing import TypeVar

from polefence.base.processors import share_processors

Task = TypeVar("Task")
Result = TypeVar("Result")


def as_finished(
    executor: Executor | None, work: Callable[[Task], Result], tasks: Sequence[Task]
) -> Iterator[Result]:
    """Yield each task's result as soon as it is there; without an executor, from here.

    Where a worker is killed, which breaks the pool, the rest is done here: no task is lost.
    """
    if executor is None:
        yield from map(work, tasks)
        return
    futures = {}
    here = []
    for task in tasks:
        try:
            futures[executor.submit(work, task)] = task
        except BrokenExecutor:  # the pool may break before all is submitted
            here.append(task)
    try:
        for future in as_completed(futures):
            try:
                yield future.result()
            except BrokenExecutor:
                yield work(futures[future])
        for task in here:
            yield work(task)
    except KeyboardInterrupt:
        raise  # whoever owns the executor ends it; cancelling here would race with that
    except BaseException:
        for future in futures:
            future.cancel()
        raise


@contextmanager
def processes(jobs: int | None = None) -> Iterator[Executor | None]:
    """Worker processes for a sweep, by default one a processor; None for a single job.

    Ctrl-C is the parent's to handle; it ends the workers, whose rows under way are abandoned.
    """
    count = jobs or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    with _interrupted_once() as (hold, ignore):
        start_quiet_tracker()
        pool = ProcessPoolExecutor(count, get_context("spawn"), initializer=_start_worker)
        try:
            with hold():
                _wait_for(pool, count)
            yield pool
        except KeyboardInterrupt:
            for worker in list((pool._processes or {}).values()):
                worker.terminate()
            raise
        finally:
            with ignore():
                pool.shutdown(wait=True, cancel_futures=True)


def _wait_for(pool: Executor, count: int) -> None:
    """Start all workers of a pool.

    Raises
    ------
    BrokenExecutor
        If one dies at once; or the process beside them that cleans up, which Python hands the
        others by a number that may be another's by then.
    """
    try:
        for started in [pool.submit(os.getpid) for _ in range(count)]:
            started.result()
    except ValueError as error:
        raise BrokenExecutor("the workers did not start") from error


def start_quiet_tracker() -> None:
    """Start what cleans up after processes that are cut off, to do so without a word."""
    if sys.platform == "win32":  # where nothing is left behind
        return
    from multiprocessing import resource_tracker

    sys.warnoptions.append("ignore:resource_tracker")  # which the process that starts inherits
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.pop()


_Held = Callable[[], AbstractContextManager[None]]


@contextmanager
def _blocked() -> Iterator[None]:
    """Block Ctrl-C, where the system can."""
    if sys.platform == "win32":
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def _interrupted_once() -> Iterator[tuple[_Held, _Held]]:
    """Let the first Ctrl-C raise and ignore all later ones, so that nothing cuts the cleaning up.

    Yields two context managers: one that holds the first back to its end, and keeps it from
    processes that are started inside; and one that ignores even the first.
    """
    if threading.current_thread() is not threading.main_thread():
        yield nullcontext, nullcontext
        return

    def once(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        raise KeyboardInterrupt

    @contextmanager
    def hold() -> Iterator[None]:
        heard = threading.Event()
        before = signal.signal(signal.SIGINT, lambda *_: heard.set())
        try:
            with _blocked():  # which is inherited: a handler would not be
                yield
        finally:
            signal.signal(signal.SIGINT, before)
        if heard.is_set():
            once()

    @contextmanager
    def ignore() -> Iterator[None]:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    outside = signal.signal(signal.SIGINT, once)
    try:
        yield hold, ignore
    finally:
        signal.signal(signal.SIGINT, outside)


def _start_worker() -> None:
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    share_processors()
    threadpool_limits(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent does, however that came: nobody is left to take its rows."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
