"""``polefence limits``: the smallest proved disks."""

from __future__ import annotations

import argparse
import math
from collections import deque
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

from polefence.base.errors import InputError
from polefence.base.workers import processes
from polefence.certify.checks import example_centre, is_checkable, usable_centre
from polefence.cli.options import (
    centre_argument,
    jobs_of,
    method_arguments,
    method_of,
    methods_of,
    result_arguments,
    rows_file,
    spaced,
    spec_argument,
    sweep_arguments,
)
from polefence.cli.output import (
    NOT_PROVED,
    PROVED,
    STANDARD,
    check_results,
    finished_rows,
    saved,
    write_figure,
    write_json,
)
from polefence.cli.terminal import say
from polefence.lmi.conditions.methods import METHODS, Method, blocks, fitting, method_label
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load
from polefence.proof.text import exactly
from polefence.region.text import digits_down, digits_up
from polefence.search.limits import Limit, sweep
from polefence.search.rows import plant_summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `limits`."""
    spec_argument(parser)
    centre_argument(
        parser, "real coordinate of the disk's centre; repeat for more", action="append", default=[]
    )
    parser.add_argument(
        "--centres",
        "--centers",
        type=float,
        nargs=3,
        metavar=("FROM", "TO", "COUNT"),
        help="evenly spaced centres, for example -5 -100 60",
    )
    method_arguments(parser, several=True)
    result_arguments(parser, plot="d/sigma", json="write the rows, kept up to date; -: stdout")
    parser.add_argument("--gain", action="store_true", help="put each row's law into the JSON")
    sweep_arguments(parser)


def limits_command(options: Any) -> int:
    """Find the smallest proved disk for each centre and method."""
    plant = load(options.spec)
    centres = _centres(plant, options)
    methods = methods_of(options.method or METHODS, partial(method_of, options=options))
    methods = _fitted(plant, methods, chosen=bool(options.method))
    if options.plot is not None and plant.sample_time is not None:
        raise InputError(f"{options.plot}: d/sigma has no meaning for a discrete-time plant")
    path = rows_file(options)
    check_results(options)
    order = [(centre, method_label(method)) for centre in centres for method in methods]
    table = _Table(plant, order)
    jobs = jobs_of(options, len(centres) * len(methods))
    with processes(jobs) as executor, finished_rows(len(order)) as finished:
        rows = sweep(
            plant,
            centres,
            methods,
            path,
            options.gain,
            executor=executor,
            resume=options.resume,
            on_row=table.followed_by(finished),
            on_kept=table.add,
        )
    if options.json == STANDARD:
        write_json(STANDARD, {"plant": plant_summary(plant), "rows": rows})
    elif options.json is not None:
        saved(options.json)
    if options.plot is not None:
        from polefence.show.plots import limits_figure

        write_figure(options.plot, limits_figure({plant.name: rows}))
    if any(row.get("lower_from_file") for row in rows):
        say(f"* from {options.json}, not proved again; every radius is")
    for row in rows:
        where = f"note: centre {row['centre']:.6g}, {row['method']}:"
        if row.get("unrunnable") is not None:
            least = digits_up(row["unrunnable"])
            say(f"{where} {least} is proved too, but only of a law that doubles cannot evaluate")
        if row["radius"] is not None and row.get("runs") is False:
            say(f"{where} no law was found that doubles can evaluate; this radius is of one that")
            say("they cannot")
    return PROVED if all(row["answer"] == "proved" for row in rows) else NOT_PROVED


def _centres(plant: UncertainPlant, options: Any) -> list[float]:
    centres = list(options.centre)
    if options.centres is not None:
        centres += spaced("--centres", options.centres, 10_000)
    if not centres:
        several = "-5 -100 60" if plant.sample_time is None else "0 0.8 9"
        raise InputError(
            f"no centre given; use --centre {example_centre(plant)}, or --centres {several}"
        )
    return list(dict.fromkeys(usable_centre(plant, c) for c in centres))


def _fitted(plant: UncertainPlant, methods: list[Method], chosen: bool) -> list[Method]:
    """Return the methods that are not too large; only those that were chosen are refused."""
    small = {}
    for method in methods:
        fitted = fitting(plant, method)
        if not (chosen or is_checkable(plant, fitted)):
            say(
                f"note: without {method_label(fitted)}: {blocks(plant, fitted)} inequalities in "
                f"{plant.shape[0]} states are too large"
            )
            continue
        if fitted != method:
            say(
                f"note: {method_label(method)} has {blocks(plant, method)} inequalities on the "
                f"simplex; {method_label(fitted)} has {blocks(plant, fitted)}"
            )
        small[method_label(fitted)] = fitted
    if not small:
        raise InputError(f"{plant.name}: {plant.size_text}: too large for every method")
    return list(small.values())


class _Table:
    """Rows printed in their order, each as soon as it and all before it are there."""

    def __init__(self, plant: UncertainPlant, order: Sequence[tuple[float, str]]) -> None:
        self.plant = plant
        self.left = deque(order)
        self.rows: dict[tuple[float, str], dict[str, Any]] = {}
        self.width = max(10, *(len(label) for _, label in order))
        self.wide = max(10, *(len(exactly(centre)) for centre, _ in order))
        self.begun = False

    def followed_by(self, finished: Callable[[str], None]) -> Callable[[Limit], None]:
        """Return what prints a row that is finished, and says so."""

        def added(row: Limit) -> None:
            self.add(row.as_row())
            finished(row.words)

        return added

    def add(self, row: dict[str, Any]) -> None:
        """Print what is there."""
        self.rows[row["centre"], row["method"]] = row
        if not self.begun:
            self._head()
        while self.left and self.left[0] in self.rows:
            next_row = self.rows[self.left.popleft()]
            say(_row_line(next_row, self.wide, self.width, self.plant.sample_time is None))

    def _head(self) -> None:
        self.begun = True
        say(f"{self.plant.name}: {self.plant.size_text}")
        say(
            f"{'centre':>{self.wide}}  {'method':<{self.width}} {'radius':>10}  {'at least':>10}  "
            f"{'d/sigma':>8}  {'answer':<9}  seconds"
        )


def _row_line(row: dict[str, Any], wide: int, width: int, continuous: bool) -> str:
    radius = lower = ratio = "-"
    mark = "*" if row.get("lower_from_file") else " "
    if row.get("lower") is not None:
        lower = digits_down(row["lower"])
    if row["radius"] is not None:
        radius = digits_up(row["radius"])
    if row["radius"] is not None and continuous:
        percent = 100 * (1 + Fraction(row["radius"]) / Fraction(row["centre"]))
        ratio = f"{math.floor(100 * percent) / 100:.2f} %"
    return (
        f"{exactly(row['centre']):>{wide}}  {row['method']:<{width}} {radius:>10}  "
        f"{lower:>10}{mark} {ratio:>8}  {row['answer']:<9}  {row['seconds']:.2f}"
    )
