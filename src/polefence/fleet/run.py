"""Running a study: its tasks carried out, each row kept as soon as it is there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from polefence.base.explained import explained
from polefence.fleet.cover import covered
from polefence.fleet.engine import kept
from polefence.fleet.questions import DIED, LOST, Answer, Cover, Question
from polefence.fleet.store import Row, Store
from polefence.fleet.study import Study, Task, load_study
from polefence.fleet.workers import Workers, processes


@explained
def study(
    path: str | Path,
    results: str | Path,
    *,
    resume: bool = False,
    workers: Workers | None = None,
) -> Iterator[Row]:
    """Ask the questions of a study about all its variants; yield rows as they are kept.

    Parameters
    ----------
    path : str or Path
        A TOML file.
    results : str or Path
        The folder of results: a Parquet data set ``rows``, files of claims beside it.
    resume : bool
        Whether to go on with what the folder has.
    workers : Workers, optional
        Where tasks are carried out: by default in a process for each processor.

    Yields
    ------
    dict
        A row: its keys are the columns of the data set.

    Raises
    ------
    SpecError
        If the study cannot be read.
    OutputError
        If the folder cannot be written, is another study's, or another process adds to it.
    """
    asked = load_study(path)
    for rows in run(asked, Store(Path(results)), workers or processes(), resume):
        yield from rows


@explained
def run(study: Study, store: Store, workers: Workers, resume: bool = False) -> Iterator[list[Row]]:
    """Compute the rows that the store lacks; yield them as they are stored.

    Raises
    ------
    OutputError
        If the store cannot be written, is another study's, or another process adds to it.
    """
    with store.locked():
        store.begin(study, resume)
        for question, answers in worked_out(study, workers, store.done()):
            yield store.add(study, question, answers)


def worked_out(
    study: Study, workers: Workers, done: frozenset[tuple[int, str]] = frozenset()
) -> Iterator[tuple[int, dict[int, Answer]]]:
    """Yield numbers of questions with answers by variant, but for the rows that are done."""
    packed = (Packed.of(study, task) for task in study.tasks(done))
    with kept(workers.places) as places:
        same = replace(workers, places=places)
        for pack, answers in same.done(answered, packed):
            if answers is None and len(pack.task.variants) > 1:
                singles = [Task(pack.task.question, (n,)) for n in pack.task.variants]
                again = (Packed.of(study, one) for one in singles)
                for one, single in replace(workers, count=1).done(answered, again):
                    yield one.task.question, _by_variant(one, single)
            else:
                yield pack.task.question, _by_variant(pack, answers)
        for k, question in enumerate(study.questions):
            if isinstance(question, Cover):
                for by_variant in covered(study, question, done, same):
                    yield k, by_variant


@dataclass(frozen=True)
class Packed:
    """A task with all that it takes."""

    task: Task
    question: Question
    specs: tuple[str, ...]

    @classmethod
    def of(cls, study: Study, task: Task) -> Packed:
        """Return a task with the specs of its variants."""
        specs = tuple(study.spec(number) for number in task.variants)
        return cls(task, study.questions[task.question], specs)


def answered(pack: Packed) -> list[Answer]:
    """Return the answers of a task."""
    return pack.question.answers(pack.specs)


def _by_variant(pack: Packed, answers: list[Answer] | None) -> dict[int, Answer]:
    lost = [Answer(LOST, reason=DIED)] * len(pack.specs)
    return dict(zip(pack.task.variants, answers or lost, strict=True))
