"""``polefence loops``: margins of the closed loop opened at each place, over samples; figures."""

from __future__ import annotations

import argparse
import math
from typing import Any

from polefence.base.errors import InputError
from polefence.certify.design import Design
from polefence.cli.options import design_argument, result_arguments
from polefence.cli.output import PROVED, check_results, write_figure, write_json
from polefence.cli.terminal import say
from polefence.plant.points import MOST_POINTS
from polefence.response import LoopMargins, disk_ranges, family_points, margins, opened, places
from polefence.response.opened import POINTS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `loops`."""
    design_argument(parser)
    parser.add_argument(
        "--loop",
        metavar="NAME",
        help="of an input, or of a signal that the law measures; default: all",
    )
    parser.add_argument(
        "--sigma",
        type=float,
        default=0.0,
        metavar="S",
        help="skew of the disk margin: 1 of S alone, -1 of T alone; default: 0, balanced",
    )
    parser.add_argument(
        "--samples",
        type=int,
        default=POINTS,
        metavar="N",
        help=f"points of the family beside its vertices and its middle; default: {POINTS}",
    )
    result_arguments(parser, plot="Nyquist, Bode and Nichols plots of one loop")


def loops_command(options: Any) -> int:
    """Open the loop at each input and measured signal, and sample its margins."""
    if not 0 <= options.samples <= MOST_POINTS:
        raise InputError(f"--samples {options.samples}: give a number from 0 to {MOST_POINTS}")
    check_results(options)
    design = Design.read(options.design)
    plant, alpha = design.plant, family_points(design.plant, options.samples)
    names = [options.loop] if options.loop else [here.name for here in places(plant, design)]
    found = [margins(opened(plant, design, name, alpha), options.sigma) for name in names]
    if options.plot is not None and len(found) > 1:
        known = ", ".join(f"'{name}'" for name in names)
        raise InputError(f"--plot draws one loop: give --loop NAME, of: {known}")
    say(f"{plant.name}: least margins of {len(alpha)} points of the family, sampled, not proved")
    from polefence.show.loops import HEAD, loop_figure, margins_row  # deferred: slow to import

    rows = [HEAD, *(margins_row(one) for one in found)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        say("  ".join(cells).rstrip())
    if options.plot is not None:
        write_figure(options.plot, loop_figure(found[0]))
    if options.json is not None:
        document: dict[str, Any] = {"points": len(alpha), "sigma": options.sigma}
        document |= {"answer": "sampled", "loops": [_row(one) for one in found]}
        if plant.data is not None:
            document["unproved"] = plant.data.note
        write_json(options.json, document)
    return PROVED


def _row(found: LoopMargins) -> dict[str, Any]:
    place = found.opened.place
    row: dict[str, Any] = {
        "loop": place.name,
        "kind": place.kind,
        "unit": place.unit,
        "stable": bool(found.stable.all()),
    }
    units = {"lower": "", "upper": "", "phase": "deg", "delay": "s", "disk": ""}
    for least in found.least:
        row[least.name] = {
            "value": "any" if math.isinf(least.value) else least.value,
            "unit": units[least.name],
            "frequency [Hz]": least.frequency if math.isfinite(least.frequency) else None,
            "at": found.where(least),
            "alpha": least.alpha.tolist(),
        }
    ranges = disk_ranges(found.least[-1].value, found.sigma)
    row["disk"]["gain"] = [
        "any" if math.isinf(end) else end for end in (ranges.lower, ranges.upper)
    ]
    row["disk"]["phase [deg]"] = ranges.phase
    return row
