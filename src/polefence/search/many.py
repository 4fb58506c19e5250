"""The same question about many plants, one after another: laws, smallest regions, proofs.

Each answer is what `polefence.place`, `polefence.tightest` or `polefence.check` returns for that
plant alone, or the error that it raises.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
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
from polefence.region.regions import Region
from polefence.search import place as one
from polefence.search.driver import require_kind

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
        Where to work, such as `polefence.processes`. By default here, one after another.

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
    _require_one(method, structure)
    alone = partial(one.place, region=region, method=method, structure=structure)
    return _answers(alone, plants, executor)


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
        Whether designs have the lower bounds of their radii.
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
    _require_one(method, structure)
    require_kind(of)
    plants = _listed(plants, "plants")
    pairs = list(zip(plants, _centres(centre, len(plants)), strict=True))
    asked = partial(one.tightest, method=method, of=of, within=within, structure=structure)
    return _answers(partial(_tightest, asked, bounds), pairs, executor)


@explained
def check(
    sources: Iterable[str | Path | Certificate | Design], *, executor: Executor | None = None
) -> list[Check | PolefenceError]:
    """Prove files, certificates or designs afresh, as `polefence.check` does.

    Parameters
    ----------
    sources : iterable of path, Certificate or Design
    executor : concurrent.futures.Executor, optional
        Where to work, see `place`.

    Returns
    -------
    list of Check or PolefenceError
        For each source its answer, or why it cannot be read.
    """
    return _answers(check_alone, _listed(sources, "sources"), executor)


def _require_one(method: Method | None, structure: Structure | None) -> None:
    """Refuse what no plant has an answer to: a method beside a structure, or an unknown one."""
    if structure is not None:
        one.require_structure_alone(method)
    elif method is not None:
        method_name(method)


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


def _tightest(
    asked: Callable[..., Design], bounds: bool, pair: tuple[UncertainPlant, Any]
) -> Design:
    design = asked(*pair)
    return design if bounds else replace(design, lower=None)


def _answers(
    alone: Callable[[Task], Answer], tasks: Sequence[Task], executor: Executor | None
) -> list[Answer | PolefenceError]:
    answers: dict[int, Answer | PolefenceError] = {}
    work, numbered = partial(_numbered, alone), list(enumerate(tasks))
    with stage("") as progress:
        for k, answer in workers.as_finished(executor, work, numbered):
            answers[k] = answer
            progress.now(f"{len(answers)} of {len(tasks)}")
    return [answers[k] for k in range(len(tasks))]


def _numbered(
    alone: Callable[[Task], Answer], task: tuple[int, Task]
) -> tuple[int, Answer | PolefenceError]:
    number, given = task
    try:
        return number, alone(given)
    except PolefenceError as error:
        return number, error
