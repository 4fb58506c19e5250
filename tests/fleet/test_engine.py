"""Tasks in processes that die: each done once, the one that kills its workers given up."""

import os
import signal
from collections import Counter
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from functools import partial
from multiprocessing import get_context

import pytest

from polefence.base.errors import OutputError
from polefence.base.workers import processes
from polefence.fleet.engine import carried_out


def twice(task):
    return 2 * task


def deadly(task):
    """Ends the worker for some tasks, as an operating system out of memory does."""
    if task in (5, 11):
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * task


def faulty(task):
    raise ZeroDivisionError(task)


@pytest.fixture
def quick_start(monkeypatch):
    """Have workers start at once: copies of a process that has imported what they need."""
    context = get_context("forkserver")
    context.set_forkserver_preload(["__main__", "polefence.base.workers", "polefence.fleet.engine"])
    monkeypatch.setattr("polefence.base.workers.get_context", lambda _: context)


class Pool(Executor):
    """Breaks at some submissions, and then fails all that is under way."""

    def __init__(self, breaks):
        self.breaks, self.under_way = breaks, []

    def submit(self, work, /, *of):
        future = Future()
        self.under_way.append((future, partial(work, *of)))
        if next(self.breaks, False):
            for own, _ in self.under_way:
                if not own.done():
                    own.set_exception(BrokenProcessPool("died"))
        elif len(self.under_way) >= 2:
            own, call = self.under_way.pop(0)
            if not own.done():
                own.set_result(call())
        else:
            return self._now(future)
        return future

    def _now(self, future):
        own, call = self.under_way.pop()
        own.set_result(call())
        return future


def test_without_a_pool_tasks_are_done_here():
    found = dict(carried_out(range(5), twice, lambda: nullcontext(None), 1))
    assert found == {k: 2 * k for k in range(5)}


def test_tasks_are_taken_as_they_are_needed(quick_start):
    taken = []

    def tasks():
        for k in range(100):
            taken.append(k)
            yield k

    way = carried_out(tasks(), twice, partial(processes, 2), 4)
    next(way)
    assert len(taken) <= 5  # however many there are, so many are held
    way.close()


def test_a_task_that_ends_its_workers_is_given_up_and_no_other(quick_start):
    found = Counter()
    results = {}
    for task, result in carried_out(range(16), deadly, partial(processes, 2), 4):
        found[task] += 1
        results[task] = result
    assert found == Counter(range(16))
    assert results == {k: None if k in (5, 11) else 2 * k for k in range(16)}


def test_workers_that_die_at_random_lose_nothing():
    """A pool that breaks at every fifth submission, 20 times."""
    breaks = iter([k % 5 == 4 for k in range(100)])
    found = Counter()
    for task, result in carried_out(range(60), twice, lambda: nullcontext(Pool(breaks)), 3):
        assert result in (None, 2 * task)
        found[task] += 1
    assert found == Counter(range(60))


def test_workers_that_never_start_end_it():
    breaks = iter([True] * 1000)
    with pytest.raises(OutputError, match="die as soon as they start; .* script .* if __name__"):
        list(carried_out(range(60), twice, lambda: nullcontext(Pool(breaks)), 3))


def test_a_pool_that_python_cannot_start_is_started_again(quick_start, monkeypatch):
    """As Python has it where the process that cleans up dies in the middle of a start."""
    tried = []

    class Faulty(ProcessPoolExecutor):
        def submit(self, *of):
            tried.append(of)
            if len(tried) == 2:
                raise ValueError("bad value(s) in fds_to_keep")
            return super().submit(*of)

    monkeypatch.setattr("polefence.base.workers.ProcessPoolExecutor", Faulty)
    assert dict(carried_out(range(5), twice, partial(processes, 2), 2)) == {
        k: 2 * k for k in range(5)
    }
    assert len(tried) == 2 + 2 + 5


def test_a_fault_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        list(carried_out(range(3), faulty, partial(processes, 2), 2))
