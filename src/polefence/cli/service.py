"""``polefence service``: how much may go wrong in service, proved and saved."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any

from polefence.certify.design import Design
from polefence.certify.given import analyse
from polefence.certify.margins import Margin, Margins, in_service
from polefence.certify.margins.service import require_service
from polefence.cli.options import design_argument, result_arguments
from polefence.cli.output import (
    NOT_PROVED,
    PROVED,
    check_results,
    saved,
    write_figure,
    write_json,
)
from polefence.cli.terminal import say
from polefence.proof.text import exactly
from polefence.region.text import digits_up, parse_region


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `service`."""
    design_argument(parser)
    parser.add_argument(
        "--decay",
        type=float,
        default=0.0,
        metavar="RATE",
        help="decay rate to keep while parameters move [1/s]; default: 0",
    )
    parser.add_argument(
        "--region",
        metavar="TEXT",
        help="what is to be kept: 'half_plane(0)' asks for stability; default: the design's region",
    )
    result_arguments(parser, "write one file per margin", "the margins")


def service_command(options: Any) -> int:
    """Find how wrong estimates and gain may be, and how fast parameters may move; prove it."""
    region = None if options.region is None else parse_region(options.region)
    check_results(options, "gain.json")
    design = Design.read(options.design)
    require_service(design, options.decay, region)
    design = design.afresh(options.design)
    service = in_service(design, options.decay, region=region)
    say(f"{design.plant.name}: all poles in {service.region}")
    say(f"{'':<34} {'proved':>10}  {'breaks at':>10}")
    for margin in service:
        upper = "-" if margin.upper is None else digits_up(margin.upper, 4)
        line = f"{margin.subject:<34} {margin.text:>10}  {upper:>10}  {margin.unit}"
        say(line.rstrip() + _whole_interval_text(margin, design))
    say(*_explained(service))
    if options.output is not None:
        for path in service.save(options.output):
            saved(path)
    if options.plot is not None:
        from polefence.show.plots import margins_figure

        write_figure(options.plot, margins_figure(service))
    if options.json is not None:
        rows = [_row(margin) for margin in service]
        document: dict[str, Any] = {
            "region": service.region.document(),
            "decay": service.decay,
            "margins": rows,
        }
        if design.plant.data is not None:
            document["unproved"] = design.plant.data.note
        write_json(options.json, document)
    return PROVED if service.proved else NOT_PROVED


def _explained(service: Margins) -> Iterator[str]:
    """Say what rates are about, and where the law itself leaves the region that was asked for."""
    yield (
        "error of each gain: all gains that are not zero are off at once, each by up to this share "
        "of its largest size"
    )
    if any(margin.name == "gain-law-states" for margin in service):
        yield (
            "  first the gains of the inputs, then those of the law's own states (A_c, B_c); "
            "either takes the others as exact"
        )
    rates = [margin for margin in service if margin.kind == "rate"]
    stable = "the loop is exponentially stable"
    if service.decay:
        stable += f", with a decay rate of {exactly(service.decay)} 1/s"
    exact = service["gain"].design
    if exact is not None and exact.certificate.in_parts:
        yield (
            "note: the region is proved in parts of the box; rates, and errors of the estimate, "
            "need one Lyapunov polynomial of all of it"
        )
    elif any(margin.proved for margin in rates):
        yield f"at these rates of change {stable}"
    elif rates:
        yield (
            f"no rate of change is proved at which {stable}; ask for a lower decay rate by --decay"
        )
    if service.region != service.design.region and not service["gain"].proved:
        answer = analyse(service.design.plant, service.design.law, service.region)
        if answer.answer == "refuted":
            yield f"note: even without an error {answer.reason}"


def _whole_interval_text(margin: Margin, design: Design) -> str:
    """Say where an estimate may be any value at all: the interval is no wider."""
    if margin.kind != "estimate":
        return ""
    if not margin.parameter and design.plant.parameters and margin.value == 1:
        return ", the whole intervals: no parameter need be known"
    widths = {p.name: float(p.high - p.low) for p in design.plant.parameters}
    width = widths.get(margin.parameter)
    if width is None or margin.value < width * (1 - 1e-9):  # but for rounding
        return ""
    return ", the whole interval: it need not be known"


def _row(margin: Margin) -> dict[str, Any]:
    return {
        "kind": margin.kind,
        "parameter": margin.parameter or None,
        "answer": margin.answer,
        "value": "any" if math.isinf(margin.value) else margin.value,
        "unit": margin.unit,
        "breaks at": margin.upper,
        "where": margin.example or None,
    }
