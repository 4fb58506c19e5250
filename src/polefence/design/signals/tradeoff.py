"""Trade-off curves: the least bound on one signal over a sweep of the limit on another, proved."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from polefence.base import workers
from polefence.base.errors import InputError, PolefenceError, require_type
from polefence.design.checks import require_domain, require_movable, require_region
from polefence.design.requirements.specification import Specification
from polefence.design.rows import Row, Run, RunOptions
from polefence.design.signals.augmented import with_weights
from polefence.design.signals.bounds import best_bound
from polefence.design.signals.optimise import Optimised, optimise
from polefence.design.signals.tradeoff_file import finished, proved_row, write_rows
from polefence.design.signals.tradeoff_front import Asked, Front, monotone
from polefence.lmi.conditions.methods import Method, Scheduled, method_label, options
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.region.regions import HalfPlane, Region

MAX_VALUES = 1000


def tradeoff(
    plant: UncertainPlant,
    minimise: Specification,
    over: Specification,
    values: Sequence[float],
    subject_to: Sequence[Specification] = (),
    region: Region | None = None,
    methods: Sequence[Method] | None = None,
    path: Path | None = None,
    **options: Unpack[RunOptions],
) -> Front:
    """Return the least proved bound on one signal for every limit on another.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E.
    minimise, over : Specification
        What is to be small, and what is limited; limits of their own are left out of account.
    values : sequence of float
        Limits on ``over``, in its unit.
    subject_to : sequence of Specification
        Others to keep, each with its ``at_most``.
    region : Region, optional
        For the poles; stability by default.
    methods : sequence of Method, optional
        Those of `optimise`; by default "quadratic" and `Scheduled` of degree 1 and elevation 0.
    executor : concurrent.futures.Executor, optional
        Where to run; without one, here and one after the other.
    on_row : callable, optional
        Called with each row as it is finished, before laws of other limits are taken over.
    path : Path, optional
        A JSON file that is kept up to date after every row.
    resume : bool
        Keep the proved rows that are in the file already.

    Returns
    -------
    Front
        A row that fails is "not proved", with the reason, and stops nothing.

    Raises
    ------
    InputError
        If what is asked does not fit the plant, or the file is of something else.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    least, swept = (
        replace(_checked(own, name), at_most=None)
        for own, name in ((minimise, "minimise"), (over, "over"))
    )
    others = [_checked(own, "subject_to") for own in subject_to]
    plant, (least, swept, *others) = with_weights(plant, (least, swept, *others))
    asked = Asked(plant, least, swept, tuple(others), HalfPlane(0) if region is None else region)
    if methods is None:
        methods = ("quadratic", Scheduled(1, 0, "box" if plant.parameters else "simplex"))
    named = {method_label(method): method for method in methods}
    limits = list(dict.fromkeys(float(value) for value in values))
    _require(asked, limits, list(named.values()))
    run = Run(path=path, **options)
    done = finished(run.path, asked) if run.path is not None and run.resume else {}
    order = [(x, label) for x in limits for label in named]
    tasks = [(x, named[label]) for x, label in order if (x, label) not in done]
    found = workers.as_finished(run.executor, partial(_row_of, asked), tasks)

    fresh = (((row["value"], row["method"]), row, row) for row in found)
    run.complete(done, order, fresh, lambda path, rows: write_rows(path, asked, rows))
    done = monotone(done)
    run.keep(done, order, lambda path, rows: write_rows(path, asked, rows))
    return Front(asked, tuple(done[key] for key in order))


def _checked(own: Any, name: str) -> Specification:
    require_type(own, Specification, name, "for example Rms('actuator force')")
    if name == "subject_to" and own.at_most is None:
        raise InputError(f"the limit of {own.name!r} is missing; give at_most")
    found: Specification = own
    return found


def _require(asked: Asked, values: list[float], methods: list[Method]) -> None:
    """Refuse, before any work, what no row could be computed for."""
    plant = asked.plant
    if plant.sample_time is not None:
        raise InputError(f"{plant.name} is in discrete time; specifications are of continuous time")
    if not values or len(values) > MAX_VALUES or not methods:
        raise InputError(f"give 1 to {MAX_VALUES} values, and at least one method")
    for value in values:
        replace(asked.over, at_most=value)
    for method in methods:
        require_domain(plant, method)
        o = options(method)
        if not isinstance(o, Scheduled) or o.degree == "auto" or o.right_hand_sides:
            raise InputError("a trade-off goes with 'quadratic' and Scheduled(degree, elevation)")
    require_region(plant, asked.region)
    domain = Domain.of("simplex", len(plant.vertices))
    for own in (asked.minimise, asked.over, *asked.subject_to):
        own.require_fit(plant)
        if own.of_signal:
            own.condition(plant, domain)
    if _same(asked.over, asked.minimise) or any(_same(asked.over, s) for s in asked.subject_to):
        raise InputError(
            f"{asked.over.kind} of {asked.over.name!r} is what the limit is swept of; minimise or "
            "limit something else"
        )
    require_movable(plant, asked.region)


def _same(one: Specification, other: Specification) -> bool:
    return replace(one, at_most=None) == replace(other, at_most=None)


def _row_of(asked: Asked, task: tuple[float, Method]) -> Row:
    """Return one row; whatever fails in it is its reason."""
    value, method = task
    start = time.perf_counter()
    found: Row
    try:
        limits = (replace(asked.over, at_most=value), *asked.subject_to)
        done = optimise(asked.plant, asked.minimise, limits, asked.region, method)
        found = _proved(asked, done, value)
    except PolefenceError as error:  # one row's failure is not the sweep's
        reason = " ".join(str(error).split()).removeprefix("not proved: ")
        nothing = dict.fromkeys(("proved", "sampled", "law_of", "own", "performance"))
        found = {"status": "not proved", **nothing, "bounds": [], "reason": reason}
    seconds = time.perf_counter() - start
    return {"value": value, "method": method_label(method)} | found | {"seconds": seconds}


def _proved(asked: Asked, done: Optimised, value: float) -> Row:
    first, over, *others = done.bounds
    # the law may keep less than its limit: then it will do for others
    least = best_bound(done.plant, done.law, over.specification)
    if least is not None and least.level < over.level:
        over = least
    claims = [bound.claim for bound in (first, over, *others)]
    return proved_row(asked, done.design.certificate, claims, value)
