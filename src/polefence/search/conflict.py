"""Why there is no law: limits that are refuted, or a smallest set of requirements in conflict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from polefence.base.errors import NotProvedError, SolverError
from polefence.certify.refutation import Refutation, refute_limits
from polefence.lmi.conditions.methods import method_label
from polefence.region.regions import Region
from polefence.requirements.specification import Specification, limit_text
from polefence.search.task import Task


def refusal(task: Task, reason: str) -> NotProvedError:
    """Return why there is no design: refuted limits, a smallest set in conflict, or a reason."""
    label = method_label(task.method)
    conflict = _conflict(task)
    if conflict:
        refutation = refuted(task, conflict)
        if refutation is not None:
            return NotProvedError(str(refutation), refutation=refutation)
        named = [task.parts[p] if isinstance(p, Region) else limit_text(p) for p in conflict]
        these = "this limit"
        if len(named) > 1:
            these = "all of these limits, but does if any one is dropped"
        return NotProvedError(f"not proved: {label} finds no law for {these}: {'; '.join(named)}")
    why = reason or "a bound or the region was not proved of the law that was found"
    named = [limit_text(s) for s in task.limits if s.at_most]
    return NotProvedError(
        f"not proved: {label}, {' & '.join(task.parts.values())}, "
        f"{'; '.join(named) or 'no limits'}: {why}"
    )


def refuted(task: Task, conflict: Sequence[Any] = ()) -> Refutation | None:
    """Return the proof that no law keeps the limits in conflict, or a smallest set of all limits.

    What is in conflict for the search may have a part of the region in it, and some of the limits
    be in conflict without it.
    """
    if task.asked is None or task.plant.step:
        return None
    plant, limits = task.asked
    conflicting = [
        a for a, s in zip(limits, task.limits, strict=True) if any(s is p for p in conflict)
    ]
    if (
        conflicting
        and len(conflicting) == len(conflict)
        and (refutation := refute_limits(plant, conflicting)) is not None
    ):
        return refutation
    refutation = refute_limits(plant, limits)
    if refutation is not None:
        for specification in refutation.specifications:
            fewer = [s for s in refutation.specifications if s is not specification]
            refutation = refute_limits(plant, fewer) or refutation
    return refutation


def _conflict(task: Task) -> list[Any]:
    """Return a smallest set of limits and parts of the region that the search finds no law for."""
    if _feasible(task, task.limits, task.region):
        return []
    parts: list[Any] = [*task.limits, *task.region.parts]
    for part in list(parts):
        fewer = [p for p in parts if p is not part]
        if not _feasible(task, *_split(fewer)):
            parts = fewer
    return parts


def _split(parts: Sequence[Any]) -> tuple[tuple[Specification, ...], Region | None]:
    region: Region | None = None
    for part in parts:
        if isinstance(part, Region):
            region = part if region is None else region & part
    return tuple(p for p in parts if isinstance(p, Specification)), region


def _feasible(task: Task, limits: tuple[Specification, ...], region: Region | None) -> bool:
    try:
        replace(task, limits=limits).reached(region)
    except SolverError:
        return False
    return True
