"""``polefence report``: one HTML page about a design."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from polefence.commands.shared import PROVED
from polefence.design import Design
from polefence.errors import InputError
from polefence.files import make_folder, write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `report`."""
    parser.add_argument(
        "design", type=Path, metavar="DESIGN", help="design.json, or the folder with it"
    )
    parser.add_argument("--road", default="C", metavar="CLASS", help="ISO 8608, A to H; default: C")
    parser.add_argument(
        "--speed", type=float, default=20.0, metavar="SPEED", help="[m/s]; default: 20"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="ends in .html; default: report.html beside the design",
    )


def report_command(options: Any) -> int:
    """Write one HTML page about a design: claim, poles, limits, responses, comfort, gain."""
    from polefence.report import html_report

    beside = options.design if options.design.is_dir() else options.design.parent
    target = options.output or beside / "report.html"
    if target.suffix != ".html":
        raise InputError(f"{target}: a report ends in .html")
    text = html_report(Design.load(options.design), options.road, options.speed)
    make_folder(target.parent)
    write_text(target, text)
    print(f"written: {target}")
    return PROVED
