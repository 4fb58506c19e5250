"""Running a study: its tasks carried out, each row kept as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from polefence.base import workers
from polefence.base.processors import processors
from polefence.fleet.engine import Dead, Places, R, T, Work, carried_out
from polefence.fleet.questions import LOST, Answer, Question
from polefence.fleet.store import Row, Store
from polefence.fleet.study import Study, Task

AHEAD = 2  # groups for each worker that are under way or wait for it


@dataclass(frozen=True)
class Workers:
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
        own = work if self.around is None else partial(self.around, work)
        return carried_out(tasks, own, self.places, AHEAD * self.count, self.lost)


def processes(jobs: int | None = None) -> Workers:
    """Return worker processes of this machine, by default one a processor."""
    count = jobs or processors()
    return Workers(partial(workers.processes, count), count)


def given(executor: Executor, count: int | None = None) -> Workers:
    """Return the workers of an executor, which is left open."""
    return Workers(lambda: nullcontext(executor), count or processors())


def run(study: Study, store: Store, workers: Workers, resume: bool = False) -> Iterator[list[Row]]:
    """Work out what is not in the store yet; yield rows as they are kept there.

    Raises
    ------
    OutputError
        If the store cannot be written, is another study's, or another process adds to it.
    """
    with store.locked():
        store.begin(study, resume)
        tasks = study.tasks(store.done())
        packed = (Packed.of(study, task) for task in tasks)
        for own, answers in workers.done(answered, packed):
            if answers is None and len(own.task.variants) > 1:
                singles = [Task(own.task.question, (n,)) for n in own.task.variants]
                again = (Packed.of(study, one) for one in singles)
                for one, found in replace(workers, count=1).done(answered, again):
                    yield _kept(study, store, one, found)
            else:
                yield _kept(study, store, own, answers)


@dataclass(frozen=True)
class Packed:
    """A task with all that it takes."""

    task: Task
    question: Question
    specs: tuple[str, ...]

    @classmethod
    def of(cls, study: Study, task: Task) -> Packed:
        """Return it with the specs of its variants."""
        specs = tuple(study.spec(number) for number in task.variants)
        return cls(task, study.questions[task.question], specs)


def answered(own: Packed) -> list[Answer]:
    """Return the answers of a task."""
    return own.question.answers(own.specs)


def _kept(study: Study, store: Store, own: Packed, answers: list[Answer] | None) -> list[Row]:
    if answers is None:
        reason = "the process that worked on it died, each time: out of memory, or a fault of ours"
        answers = [Answer(LOST, reason=reason)] * len(own.specs)
    pairs = zip(own.task.variants, answers, strict=True)
    return store.add(study, own.task.question, dict(pairs))
