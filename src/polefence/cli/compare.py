"""``polefence compare``: laws on the same road, over the whole family."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from polefence.cli.common import (
    PROVED,
    check_figure,
    check_targets,
    write_figure,
    write_json,
)
from polefence.cli.laws import Named, distinct, read_law, read_subject
from polefence.cli.terminal import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `compare`."""
    parser.add_argument(
        "subject",
        metavar="SPEC|DESIGN",
        help="a TOML spec of a quarter car, or a design, whose law is then compared too",
    )
    parser.add_argument(
        "--law",
        action="append",
        metavar="LAW",
        help="passive, skyhook, lqr, quadratic, slack, scheduled, a design, or a gain as for "
        "analyse; repeat for more; default: the first six",
    )
    parser.add_argument(
        "--disk",
        type=float,
        nargs=2,
        default=(-40.0, 36.0),
        metavar=("CENTRE", "RADIUS"),
        help="that quadratic, slack and scheduled are designed for; default: -40 36",
    )
    parser.add_argument("--road", default="C", metavar="CLASS", help="ISO 8608, A to H; default: C")
    parser.add_argument(
        "--speed", type=float, default=20.0, metavar="SPEED", help="[m/s]; default: 20"
    )
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw comfort, grip, travel and force (.png, .svg, .pdf)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all rows")


def compare_command(options: Any) -> int:
    """Compare laws on a random road: comfort, tyre load, travel, force, power, over the family."""
    from polefence.vehicle.compare import NAMES, compare, standard_laws

    plant, own = read_subject(options.subject)
    check_figure(options.plot)
    check_targets(options.json, options.plot)
    words = NAMES if options.law is None else options.law
    laws = [] if own is None else [own]
    for word in words:
        if word in NAMES:
            law = standard_laws(plant, tuple(options.disk), (word,))[word]
            laws.append(Named(word, law))
        else:
            laws.append(read_law(plant, word))
    found = compare(
        plant, {law.name: law.law for law in distinct(laws)}, options.road, options.speed
    )
    if options.plot is not None:
        from polefence.show.plots import comparison_figure

        write_figure(options.plot, comparison_figure(found))
    if options.json is not None:
        write_json(options.json, found.document())
    say(*found.lines)
    return PROVED
