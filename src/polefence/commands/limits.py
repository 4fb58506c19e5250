"""``polefence limits``: the smallest proved disks."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from polefence.checks import example_centre, usable_centre
from polefence.commands.methods import method_arguments, methods_of
from polefence.commands.shared import (
    NOT_PROVED,
    PROVED,
    Progress,
    check_figure,
    check_targets,
    jobs_of,
    read_plant,
    say,
    size_of,
    spec_argument,
    sweep_arguments,
    write_figure,
)
from polefence.conditions.methods import METHODS, method_label
from polefence.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.region_text import digits_down, digits_up
from polefence.sweep import processes, sweep


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `limits`."""
    spec_argument(parser)
    parser.add_argument(
        "--centre",
        "--center",
        type=float,
        action="append",
        default=[],
        metavar="CENTRE",
        help="real coordinate of the disk's centre; repeat for more",
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
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows, kept up to date")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw d/sigma (.png, .svg, .pdf)")
    parser.add_argument("--gain", action="store_true", help="put each row's law into the JSON")
    sweep_arguments(parser)


def limits_command(options: Any) -> int:
    """Find the smallest proved disk for each centre and method."""
    plant = read_plant(options.spec)
    centres = _centres(plant, options)
    methods = methods_of(options.method or list(METHODS), options)
    methods = list({method_label(method): method for method in methods}.values())
    if options.plot is not None and plant.sample_time is not None:
        raise InputError(f"{options.plot}: d/sigma has no meaning for a discrete-time plant")
    check_figure(options.plot)
    if options.resume and options.json is None:
        raise InputError("--resume needs --json FILE, where the finished rows are")
    check_targets(options.json, options.plot)
    progress = Progress(len(centres) * len(methods))
    jobs = jobs_of(options, len(centres) * len(methods))
    with processes(jobs) as executor, progress:
        rows = sweep(
            plant,
            centres,
            methods,
            options.json,
            options.resume,
            options.gain,
            executor,
            progress.step,
        )
    if options.plot is not None:
        from polefence.plots import limits_figure

        write_figure(options.plot, limits_figure({plant.name: rows}))
    say(f"{plant.name}: {size_of(plant)}")
    width = max(10, *(len(row["method"]) for row in rows))
    say(
        f"{'centre':>10}  {'method':<{width}} {'radius':>10}  {'at least':>10}  {'d/sigma':>8}  "
        f"{'status':<9}  seconds"
    )
    for row in rows:
        say(_row_line(row, width, plant.sample_time is None))
    if any(row.get("lower_from_file") for row in rows):
        say(f"* from {options.json}, not proved again; every radius is")
    return PROVED if all(row["status"] == "proved" for row in rows) else NOT_PROVED


def _centres(plant: UncertainPlant, options: Any) -> list[float]:
    centres = list(options.centre)
    if options.centres is not None:
        first, last, count = options.centres
        if not (math.isfinite(first) and math.isfinite(last)):
            raise InputError("--centres: FROM and TO must be finite numbers")
        if not 2 <= count <= 10_000 or count != int(count):
            raise InputError(f"--centres: COUNT = {count:g} must be a whole number, 2 to 10000")
        step = (last - first) / (count - 1)
        centres += [first + i * step for i in range(int(count))]
    if not centres:
        several = "-5 -100 60" if plant.sample_time is None else "0 0.8 9"
        raise InputError(
            f"no centre given; use --centre {example_centre(plant)}, or --centres {several}"
        )
    return list(dict.fromkeys(usable_centre(plant, c) for c in centres))


def _row_line(row: dict[str, Any], width: int, continuous: bool) -> str:
    radius = lower = ratio = "-"
    mark = "*" if row.get("lower_from_file") else " "
    if row.get("lower") is not None:
        lower = digits_down(row["lower"])
    if row["radius"] is not None:
        radius = digits_up(row["radius"])
    if row["radius"] is not None and continuous:
        ratio = f"{100 * (1 + row['radius'] / row['centre']):.2f} %"
    return (
        f"{row['centre']:>10.6g}  {row['method']:<{width}} {radius:>10}  {lower:>10}{mark} "
        f"{ratio:>8}  {row['status']:<9}  {row['seconds']:.2f}"
    )
