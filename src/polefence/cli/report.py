"""``polefence report``: one HTML page about a design."""

from __future__ import annotations

import argparse
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, shown
from polefence.base.files import check_target, make_folder, write_text
from polefence.certify.design import proved_design
from polefence.cli.options import design_argument, road_arguments
from polefence.cli.output import PROVED, saved
from polefence.requirements.text import RoadSpectrum

MAX_BYTES = 20_000_000  # of a figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `report`."""
    design_argument(parser)
    road_arguments(parser, "C", 20.0)
    parser.add_argument(
        "--front",
        type=Path,
        metavar="FIGURE",
        help="a figure of polefence tradeoff to put in, .svg or .png",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="ends in .html; default: report.html beside the design",
    )


def _figure(path: Path) -> tuple[str, bytes]:
    kind = path.suffix[1:]
    if kind not in ("svg", "png"):
        raise InputError(f"{path}: a figure for the page ends in .svg or .png")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: the figure is larger than {MAX_BYTES} bytes")
        return kind, path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def today() -> str:
    """Return the date that a page bears, SOURCE_DATE_EPOCH's where a build sets it.

    Raises
    ------
    InputError
        If that is no time.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is None:
        return f"{datetime.now(UTC):%Y-%m-%d}"
    try:
        return f"{datetime.fromtimestamp(int(epoch), UTC):%Y-%m-%d}"
    except (ValueError, OverflowError, OSError) as error:
        raise InputError(
            f"SOURCE_DATE_EPOCH = {shown(epoch)} is not a time; give seconds since 1970"
        ) from error


def report_command(options: Any) -> int:
    """Write one HTML page about a design: the answer first, then all that is behind it."""
    from polefence.show.report import html_report

    beside = options.design if options.design.is_dir() else options.design.parent
    target = options.output or beside / "report.html"
    if target.suffix != ".html":
        raise InputError(f"{target}: a report ends in .html")
    front, date = None if options.front is None else _figure(options.front), today()
    check_target(target)
    _ = RoadSpectrum(options.road, options.speed).density  # refused before the proof
    design, bounds = proved_design(options.design)
    text = html_report(design, options.road, options.speed, bounds, front, date)
    make_folder(target.parent)
    write_text(target, text)
    saved(target)
    return PROVED
