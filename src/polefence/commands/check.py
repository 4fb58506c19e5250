"""``polefence check``: a saved design, its margins or bounds, or an analysed table, afresh."""

from __future__ import annotations

import argparse
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.augmented import with_weights
from polefence.commands.shared import (
    NOT_PROVED,
    PROVED,
    say,
    write_json,
)
from polefence.design import Design, check
from polefence.export import check_guarantee, guarantee_plant, is_guarantee_file
from polefence.performance_file import check_performance, is_performance_file, performance_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load
from polefence.service import check_service, is_service_file, service_plant
from polefence.specification_text import Road, load_specifications
from polefence.table_analysis import check_table, is_table_file, table_plant


def _plant(path: Path) -> UncertainPlant:
    return Design.load(path, allow_unproved=True).plant


# Of each kind of file: what knows it, what proves it, what reads its plant; the last is the rest.
KINDS: tuple[Any, ...] = (
    (is_service_file, check_service, service_plant),
    (is_table_file, check_table, table_plant),
    (is_guarantee_file, check_guarantee, guarantee_plant),
    (is_performance_file, check_performance, performance_plant),
    (lambda _: True, check, _plant),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `check`."""
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="design.json, table.json or performance.json, or the folder with it",
    )
    parser.add_argument("--spec", metavar="SPEC", help="also require that it is about this plant")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the answer")


def check_command(options: Any) -> int:
    """Prove a saved design or analysis afresh, in exact arithmetic."""
    proves, plant_of = next(do for is_mine, *do in KINDS if is_mine(options.file))
    answer = proves(options.file)
    say(f"{options.file}: {answer}")
    difference = None
    if options.spec is None:
        say("note: about the vertices in the file; --spec SPEC compares them, and the parameter")
        say("ranges that alpha is computed from, with a spec")
    else:
        plant, letters = load(options.spec), "AB"
        if proves is check_performance:
            plant, letters = _weighted(plant, options.spec), "ABE"
        difference = _difference(plant_of(options.file), plant, letters)
    if options.json is not None:
        alpha = None if answer.alpha is None else [str(a) for a in answer.alpha]
        document = {
            "file": str(options.file),
            "answer": answer.answer,
            "reason": answer.reason,
            "alpha": alpha,
            "differs from the spec": difference,
        }
        write_json(options.json, document)
    if difference is not None:
        say(f"{options.file}: but NOT about {options.spec}: {difference}")
        return NOT_PROVED
    return PROVED if answer.proved else NOT_PROVED


def _weighted(plant: UncertainPlant, spec: str) -> UncertainPlant:
    """Return the plant with the filters of the spec's own specifications."""
    least, limits = load_specifications(spec, Road("C", 20.0))  # any road: filters are what counts
    return with_weights(plant, ([least] if least else []) + list(limits))[0]


def _difference(found: UncertainPlant, plant: UncertainPlant, letters: str = "AB") -> str | None:
    """Say how a design's plant differs from a spec's, None where it does not.

    Bounds on signals are about E too, which the digest leaves out.
    """
    other = _first_difference(found, plant, letters)
    if other is not None:
        return other
    if found.digest != plant.digest:
        return "other vertices"
    if found.sample_time != plant.sample_time:
        times = (_time(each.sample_time) for each in (found, plant))
        return "other time: {}, spec {}".format(*times)
    ours, theirs = (
        [(p.name, p.low, p.high, p.through) for p in each.parameters] for each in (found, plant)
    )
    return None if ours == theirs else "other parameter ranges"


def _time(sample_time: Fraction | None) -> str:
    return "continuous" if sample_time is None else f"sample_time = {float(sample_time):.9g} s"


def _first_difference(found: UncertainPlant, plant: UncertainPlant, letters: str) -> str | None:
    if (len(found.vertices), found.shape) != (len(plant.vertices), plant.shape):
        return "other vertices: their number or their shapes differ"
    for mine, theirs in zip(found.vertices, plant.vertices, strict=True):
        for letter in letters:
            M, other = (getattr(each, f"exact_{letter}") or () for each in (mine, theirs))
            if len(M) != len(other) or len(M and M[0]) != len(other and other[0]):
                return f"other vertices: {theirs.name}: {letter} differs in its shape"
            for i, (row, expected) in enumerate(zip(M, other, strict=True)):
                for j, (a, b) in enumerate(zip(row, expected, strict=True)):
                    if a != b:
                        place = f"{theirs.name}: {letter}[{i + 1}][{j + 1}]"
                        return f"other vertices: {place} = {float(a):.9g}, spec {float(b):.9g}"
    return None
