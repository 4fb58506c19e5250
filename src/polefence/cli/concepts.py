"""``polefence concepts``: suspensions for one rms, from a fixed damper to an active law."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from polefence.cli.options import note_sensors, result_arguments
from polefence.cli.output import (
    PROVED,
    check_results,
    write_figure,
    write_json,
)
from polefence.cli.semi_active import add_question, question_of
from polefence.cli.terminal import say
from polefence.region.text import digits_down, digits_up
from polefence.search.rows import plant_summary

if TYPE_CHECKING:  # imported where used: with scipy behind it
    from polefence.vehicle.concepts import Concept, Concepts, Ridden

HEAD = ("", "sensors", "proved", "drives", "acc.", "tyre", "travel", "force", "power", "gain")
UNITS = ("", "", "", "", "[m/s2]", "[N]", "[mm]", "[N]", "[W]", "")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `concepts`."""
    add_question(parser)
    parser.add_argument(
        "--measured",
        metavar="NAMES",
        help="'A, B': states or outputs, for LQG and one active law; default: what sensors of the "
        "spec say, else each suspension's deflection and the body's velocity above it",
    )
    result_arguments(parser, plot="them", json="write all rows; -: stdout")


def concepts_command(options: Any) -> int:
    """Compare suspension concepts: passive, skyhook, ADD, semi-active, LQG, active; and limits."""
    from polefence.vehicle.concepts import concepts

    check_results(options)
    subject, least = question_of(options)
    measured = None
    if options.measured is not None:
        measured = tuple(name.strip() for name in options.measured.split(","))
        note_sensors(subject.plant, measured, "--measured")
    compared = concepts(subject.plant, least, subject.dampers, measured)
    if options.plot is not None:
        from polefence.show.plots import concepts_figure

        write_figure(options.plot, concepts_figure(compared))
    if options.json is not None:
        write_json(options.json, _document(compared))
    say(*_lines(compared))
    return PROVED


def _lines(compared: Concepts) -> list[str]:
    """Return what to print."""
    from polefence.vehicle.concepts import ROADS, SECONDS

    lines = [f"{compared.plant.name}: {compared.specification.title}", ""]
    lines += [_columns(HEAD), _columns(UNITS)]
    lines += [_columns(_cells(one, ridden)) for one, ridden in compared.rows]
    lines.append("")
    for what, level in (("semi-active law", compared.semi_active), ("law", compared.active)):
        if level is not None:
            lines.append(f"proved: no {what} goes below {digits_down(level)}")
    reasons = [one.reason for one, _ in compared.rows if one.level is None and one.reason]
    lines += [f"not proved: {reason}" for reason in dict.fromkeys(reasons)]
    error = max(ride.error / ride.cost for _, ride in compared.rows if math.isfinite(ride.cost))
    away = [one.name for one, ride in compared.rows if not math.isfinite(ride.cost)]
    if away:
        why = "too fast for steps of 1 ms, or not stable at every value of the parameters"
        lines.append(f"{why}: {', '.join(away)}")
    lines.append(
        f"drives: rms, the worst of {compared.loads} values of the parameters, the mean of {ROADS} "
        f"roads of {SECONDS:g} s; standard error at most {error:.1%}"
    )
    if compared.plant.shape[1] > 1:
        lines.append("acc., tyre, travel, force: the worst seat, wheel, actuator; power: their sum")
    return lines


def _cells(one: Concept, ridden: Ridden) -> tuple[str, ...]:
    level = "-" if one.level is None else digits_up(one.level, 4)
    if not math.isfinite(ridden.cost):
        return (one.name, str(len(one.sensors)), level, *("-",) * 6, f"{one.gain:.3g}")
    return (
        one.name,
        str(len(one.sensors)),
        level,
        f"{ridden.cost:.4g}",
        f"{ridden.acceleration:.3g}",
        f"{ridden.tyre:.0f}",
        f"{1e3 * ridden.travel:.1f}",
        f"{ridden.force:.0f}",
        f"{ridden.power:.1f}",
        f"{one.gain:.3g}",
    )


def _columns(cells: tuple[str, ...]) -> str:
    first, *others = cells
    return (f"{first:<21}" + "".join(f"{cell:>9}" for cell in others)).rstrip()


def _document(compared: Concepts) -> dict[str, Any]:
    """Return all rows as plain data."""
    return {
        "plant": plant_summary(compared.plant),
        "specification": compared.specification.title,
        "rows": [
            {
                "concept": one.name,
                "sensors": list(one.sensors),
                "proved": one.level,
                "reason": one.reason or None,
                "gain": one.gain,
                "drives": asdict(ridden) if math.isfinite(ridden.cost) else None,
            }
            for one, ridden in compared.rows
        ],
        "no semi-active law below": compared.semi_active,
        "no law below": compared.active,
    }
