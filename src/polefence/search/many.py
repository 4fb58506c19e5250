"""The same question about many plants: laws for a region, smallest regions, proofs.

Each answer is what `polefence.place`, `polefence.tightest` or `polefence.check` returns for that
plant alone, or the error that it raises. Disks for plants of one shape are worked out together,
see `polefence.search.disks`; all else one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from polefence.base import workers
from polefence.base.errors import InputError, PolefenceError, require_type
from polefence.base.explained import explained
from polefence.base.progress import stage
from polefence.certify.certificate import Certificate, Check
from polefence.certify.design import Design
from polefence.certify.design import check as check_alone
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method, method_name
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Disk, Region
from polefence.search import disks, placed
from polefence.search import place as place_alone

Answer = TypeVar("Answer")
Task = TypeVar("Task")


@explained
def place(
    plants: Iterable[UncertainPlant],
    region: Region,
    method: Method | None = None,
    *,
    structure: Structure | None = None,
    executor: Executor | None = None,
) -> list[Design | PolefenceError]:
    """Design for each plant a law that keeps its poles in a region, as `polefence.place` does.

    Parameters
    ----------
    plants : iterable of UncertainPlant
    region : Region
    method : str, Scheduled or Slack, optional
    structure : Structure, optional
        What the laws may be, in place of a method.
    executor : concurrent.futures.Executor, optional
        Where to work: `polefence.processes` for laws that are tuned and for regions that are no
        disks. By default in threads of this process.

    Returns
    -------
    list of Design or PolefenceError
        For each plant, in their order, its design or the error that `polefence.place` raises.

    Raises
    ------
    InputError
        If method and structure are both given, or there is no such method.
    """
    plants = _listed(plants, "plants")
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    if structure is not None:
        placed.require_structure_alone(method)
    if structure is None and isinstance(region, Disk):
        method = _known(method)
        asked = [disks.Asked(plant, region.centre, method, region) for plant in plants]
        return _answers(disks.answers, asked, disks.parts(asked), executor)
    own = partial(placed.place, region=region, method=method, structure=structure)
    return _one_by_one(own, plants, executor)


@explained
def tightest(
    plants: Iterable[UncertainPlant],
    centre: float | Sequence[float] | None = None,
    method: Method | None = None,
    *,
    of: str = "disk",
    within: Region | None = None,
    structure: Structure | None = None,
    bounds: bool = True,
    executor: Executor | None = None,
) -> list[Design | PolefenceError]:
    """Design for the smallest region of each plant, as `polefence.tightest` does.

    Parameters
    ----------
    plants : iterable of UncertainPlant
    centre : float or sequence of float
        One for all or one a plant [1/s].
    method : str, Scheduled or Slack, optional
    of, within, structure
        See `polefence.tightest`.
    bounds : bool
        Whether to prove lower bounds of radii too.
    executor : concurrent.futures.Executor, optional
        Where to work, see `place`.

    Returns
    -------
    list of Design or PolefenceError
        For each plant, in their order, its design or the error that `polefence.tightest` raises.

    Raises
    ------
    InputError
        If method and structure are both given, there is no such method or kind of region, or there
        is not one centre for each plant.
    """
    if structure is not None:
        placed.require_structure_alone(method)
    place_alone.require_kind(of)
    plants = _listed(plants, "plants")
    centres = _centres(centre, len(plants))
    if structure is None and of == "disk" and within is None and centre is not None:
        method = _known(method)
        asked = [disks.Asked(plant, c, method) for plant, c in zip(plants, centres, strict=True)]
        work = partial(disks.answers, bounds=bounds)
        return _answers(work, asked, disks.parts(asked), executor)
    own = partial(_tightest, method=method, of=of, within=within, structure=structure)
    return _one_by_one(own, list(zip(plants, centres, strict=True)), executor)


@explained
def check(
    sources: Iterable[str | Path | Certificate | Design], *, executor: Executor | None = None
) -> list[Check | PolefenceError]:
    """Prove files, certificates or designs afresh, as `polefence.check` does.

    Parameters
    ----------
    sources : iterable of path, Certificate or Design
    executor : concurrent.futures.Executor, optional
        Where to work: `polefence.processes`, as the checker is Python alone. By default in threads
        of this process, of which one runs at a time.

    Returns
    -------
    list of Check or PolefenceError
        For each source its answer, or why it cannot be read.
    """
    return _one_by_one(check_alone, _listed(sources, "sources"), executor)


def _known(method: Method | None) -> Method:
    method = "scheduled" if method is None else method
    method_name(method)
    return method


def _listed(given: Iterable[Task], name: str) -> list[Task]:
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InputError(f"{name} must be several, as in a list, not one {type(given).__name__}")
    return list(given)


def _centres(centre: Any, count: int) -> list[Any]:
    if not isinstance(centre, Iterable):
        return [centre] * count
    centres = list(centre)
    if len(centres) != count:
        raise InputError(
            f"there are {len(centres)} centres for {count} plants; give one, or one per plant"
        )
    return centres


def _tightest(pair: tuple[UncertainPlant, Any], **options: Any) -> Design:
    plant, centre = pair
    return placed.tightest(plant, centre, **options)


def _one_by_one(
    own: Callable[[Task], Answer], tasks: Sequence[Task], executor: Executor | None
) -> list[Answer | PolefenceError]:
    return _answers(partial(_each, own), tasks, [[k] for k in range(len(tasks))], executor)


def _each(own: Callable[[Task], Answer], tasks: Sequence[Task]) -> list[Answer | PolefenceError]:
    return [_or_error(own, task) for task in tasks]


def _or_error(own: Callable[[Task], Answer], task: Task) -> Answer | PolefenceError:
    try:
        return own(task)
    except PolefenceError as error:
        return error


def _answers(
    work: Callable[[Sequence[Task]], list[Answer]],
    tasks: Sequence[Task],
    parts: list[list[int]],
    executor: Executor | None,
) -> list[Answer]:
    """Return what work makes of the tasks, in parts."""
    numbered = [(numbers, [tasks[k] for k in numbers]) for numbers in parts]
    found: dict[int, Answer] = {}
    places = workers.threads() if executor is None else nullcontext(executor)
    with places as pool, stage("") as progress:
        for numbers, own in workers.as_finished(pool, partial(_numbered, work), numbered):
            found.update(zip(numbers, own, strict=True))
            progress.now(f"{len(found)} of {len(tasks)}")
    return [found[k] for k in range(len(tasks))]


def _numbered(
    work: Callable[[Sequence[Task]], list[Answer]], part: tuple[list[int], Sequence[Task]]
) -> tuple[list[int], list[Answer]]:
    numbers, tasks = part
    return numbers, work(tasks)
