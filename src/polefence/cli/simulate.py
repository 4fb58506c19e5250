"""``polefence simulate``: signals over time, and where the guarantee does not hold."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import NotProvedError
from polefence.cli.common import PROVED, check_figure, check_targets, say, write_figure, write_json
from polefence.cli.drive_input import add_car_arguments, add_excitation_arguments, setup_of
from polefence.cli.drive_output import panels_of, summary_of, table_of, text_of
from polefence.cli.laws import Named, distinct, read_law, read_subject
from polefence.design.margins import estimation_error, parameter_rate
from polefence.design.rows import plant_summary

if TYPE_CHECKING:  # imported where used: with scipy behind it
    from polefence.vehicle.run import Run, Setup


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `simulate`."""
    parser.add_argument(
        "subject", metavar="DESIGN|SPEC", help="a design, with its law; or a TOML spec"
    )
    parser.add_argument(
        "--law",
        action="append",
        default=[],
        metavar="LAW",
        help="passive, skyhook, lqr, a design, or a gain as for analyse; repeat for more, beside "
        "that of DESIGN; default for SPEC: passive",
    )
    add_excitation_arguments(parser)
    add_car_arguments(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write all signals (.csv, .parquet)"
    )
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw all signals (.png, .svg, .pdf)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the summary; -: stdout")


def simulate_command(options: Any) -> int:
    """Follow a car on a road, or any plant: signals over time, and where no guarantee holds."""
    from polefence.response.columns import check_format
    from polefence.vehicle.run import run

    check_figure(options.plot)
    if options.output is not None:
        check_format(options.output)
    check_targets(options.output, options.plot, options.json)
    plant, own = read_subject(options.subject)
    words = options.law if options.law or own else ["passive"]
    laws = distinct([*([own] if own else []), *(read_law(plant, word) for word in words)])
    setup = setup_of(plant, options, laws[0].law)
    runs = {law.name: run(setup, law.law, _margins(setup, law)) for law in laws}
    summaries = [summary_of(law, runs[law.name]) for law in laws]
    _write(setup, runs, summaries, options)
    say(_head(setup))
    for summary in summaries:
        say("", *text_of(summary))
    written = [path for path in (options.output, options.plot, options.json) if path is not None]
    if written:
        say("", *(f"written: {path}" for path in written))
    _require_end(runs)
    return PROVED


def _require_end(runs: Mapping[str, Run]) -> None:
    """Refuse to call driven what ran away: its numbers are none."""
    lost = {name: run.lost.first for name, run in runs.items() if run.lost is not None}
    if lost:
        when = ", ".join(f"{name!r} at {first:.4g} s" for name, first in lost.items())
        raise NotProvedError(
            f"not driven to the end: the loop runs away under {when}; from there on no value holds"
        )


def _margins(setup: Setup, law: Named) -> Any:
    """Return what is proved of moving and wrongly known parameters, where that is asked."""
    if setup.still or law.design is None:
        return None
    return (*estimation_error(law.design), *parameter_rate(law.design))


def _write(
    setup: Setup, runs: Mapping[str, Run], summaries: list[dict[str, Any]], options: Any
) -> None:
    """Write all files; first of all those: nobody need read the output to its end."""
    if options.output is not None:
        from polefence.response.columns import write_table

        write_table(options.output, table_of(setup, runs))
    if options.plot is not None:
        from polefence.show.plots.signals import signals_figure

        one = next(iter(runs.values())) if len(runs) == 1 else None
        outside = None if one is None or one.covered is None else ~one.covered
        title = f"{setup.plant.name}: {setup.excitation.name}"
        write_figure(
            options.plot, signals_figure(setup.time, panels_of(setup, runs), title, outside)
        )
    if options.json is not None:
        write_json(
            options.json,
            {
                "plant": plant_summary(setup.plant),
                "excitation": setup.excitation.name,
                "road": setup.excitation.road,
                "speed": options.speed,
                "duration": float(setup.time[-1]),
                "step": setup.step,
                "parameters": _starting(setup),
                "laws": summaries,
            },
        )


def _starting(setup: Setup) -> dict[str, float]:
    """Parameters, or weights of the vertices, at the first instant."""
    values = setup.courses.at(np.zeros(1))[0, 0]
    return dict(zip(setup.courses.space.names, values.tolist(), strict=True))


def _head(setup: Setup) -> str:
    space = setup.courses.space
    values = zip(_starting(setup).items(), space.units, strict=True)
    shown = ", ".join(f"{name} = {value:.6g} {unit}".rstrip() for (name, value), unit in values)
    moving = "" if setup.courses.constant else " at first"
    return (
        f"{setup.plant.name}: {setup.excitation.name}, {setup.time[-1]:g} s "
        f"in steps of {setup.step:g} s; {shown}{moving}"
    )
