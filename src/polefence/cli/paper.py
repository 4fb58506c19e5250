"""``polefence paper``: the study of Leite and Peres again."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from polefence.base.files import make_folder
from polefence.base.workers import processes
from polefence.cli.options import jobs_of, sweep_arguments
from polefence.cli.output import NOT_PROVED, PROVED, finished_rows, saved
from polefence.cli.terminal import say
from polefence.region.text import digits_up


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `paper`."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("paper-results"),
        metavar="DIR",
        help="default: %(default)s",
    )
    sweep_arguments(parser)


def paper_command(options: Any) -> int:
    """Reproduce Leite & Peres (2005): its figures and a report."""
    from polefence.show import paper

    folder = make_folder(options.output)
    total = paper.total_rows()
    with processes(jobs_of(options, total)) as executor, finished_rows(total) as finished:
        results = paper.reproduce(folder, options.resume, executor, lambda row: finished(row.words))
    paths = paper.write(results, folder)
    for row in results["radii"]:
        printed = "" if row["published"] is None else f"published {row['published']:g}"
        say(
            f"{row['family']:<11} {row['method']:<10} {printed:<15} "
            f"{row['answer']} {digits_up(row['radius']) if row['radius'] else '-'}"
        )
    saved(f"{folder / 'report.md'}, with {len(paths) - 1} files beside it")
    rows = [row for sweep_rows in results["limits"].values() for row in sweep_rows]
    rows += [*results["radii"], *results["slow centres"]]
    return PROVED if all(row["answer"] == "proved" for row in rows) else NOT_PROVED
