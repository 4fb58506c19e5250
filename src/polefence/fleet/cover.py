"""The question which few laws cover all variants: laws sought here, proofs found by workers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from polefence.base.errors import PolefenceError
from polefence.base.processors import small_matrices
from polefence.certify.checks import in_time_of, require_region
from polefence.fleet.questions import DIED, ERROR, LOST, NOT_PROVED, PROVED, Answer, Cover
from polefence.fleet.shared import Fleet
from polefence.fleet.study import Study
from polefence.fleet.workers import Workers
from polefence.law.laws import FixedGain
from polefence.plant.family import UncertainPlant
from polefence.plant.joined import require_alike
from polefence.plant.spec import loads
from polefence.plant.system import Array
from polefence.plant.varied import numbers_of
from polefence.region.regions import Region
from polefence.requirements.specification import Specification

_Known = tuple[UncertainPlant, Region, tuple[Specification, ...]]


@dataclass(frozen=True)
class _Given:
    """Variants of which a gain is to be proved."""

    question: Cover
    K: tuple[tuple[float, ...], ...]
    variants: tuple[int, ...]
    specs: tuple[str, ...]


def covered(
    study: Study, question: Cover, done: frozenset[tuple[int, str]], workers: Workers
) -> Iterator[dict[int, Answer]]:
    """Yield answers, law by law, until each variant that is not done has one.

    A variant of which a law is not proved waits for the next law.
    """
    asked = [n for n in range(len(study.variants)) if (n, question.name) not in done]
    known, bad = _read(study, question, asked)
    if bad:
        yield bad
    if not known:
        return
    variants = list(known)
    fleet = Fleet(
        tuple(plant for plant, _, _ in known.values()),
        tuple(limits for _, _, limits in known.values()),
        next(region for _, region, _ in known.values()),
        _numbers(study, variants),
    )
    left = list(range(len(variants)))
    while left:
        with small_matrices():
            law, those = fleet.next(left)
        reason = "no gain was found that keeps this variant, even alone"
        answers = {variants[those[0]]: Answer(NOT_PROVED, reason=reason)}
        if law is not None:
            answers = _proofs(study, question, law, [variants[k] for k in those], workers)
        yield answers
        left = [k for k in left if variants[k] not in answers]


def _read(
    study: Study, question: Cover, asked: list[int]
) -> tuple[dict[int, _Known], dict[int, Answer]]:
    """Return plants with their region and limits, and answers for those that have none."""
    known, bad = dict[int, _Known](), dict[int, Answer]()
    for n in asked:
        text = study.spec(n)
        try:
            plant = loads(text, "variant")
            require_alike([*(first for first, _, _ in list(known.values())[:1]), plant])
            region, limits = question.kept(text)
            require_region(plant, in_time_of(plant, region))
        except PolefenceError as error:
            bad[n] = Answer(ERROR, reason=" ".join(str(error).split()))
        else:
            known[n] = plant, region, limits
    return known, bad


def _numbers(study: Study, variants: list[int]) -> Array:
    """Return the numbers that differ between variants, one row a variant."""
    base, names = numbers_of(study.base), study.variants.names
    by_name = (dict.fromkeys(names) | study.variants.values(n) for n in variants)
    return np.array(
        [[float(base[k] if x is None else x) for k, x in numbers.items()] for numbers in by_name]
    )


def _proofs(
    study: Study, question: Cover, law: FixedGain, those: list[int], workers: Workers
) -> dict[int, Answer]:
    """Return the answers of the variants for which the law is proved, else of the first."""
    K = tuple(tuple(float(x) for x in row) for row in law.K)
    groups = (tuple(those[k : k + question.group]) for k in range(0, len(those), question.group))
    tasks = (_Given(question, K, group, tuple(map(study.spec, group))) for group in groups)
    every = dict[int, Answer]()
    for task, answers in workers.done(_proved, tasks):
        lost = [Answer(LOST, reason=DIED)] * len(task.variants)
        every |= zip(task.variants, answers or lost, strict=True)
    proved = {n: every[n] for n in those if every[n].status == PROVED}
    return proved or {those[0]: every[those[0]]}


def _proved(task: _Given) -> list[Answer]:
    return [task.question.proved(task.K, spec) for spec in task.specs]
