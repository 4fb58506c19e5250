"""``polefence tightest``: the largest decay rate or damping ratio, or the smallest disk."""

from __future__ import annotations

import argparse
from typing import Any

from polefence.base.errors import InputError
from polefence.certify.checks import example_centre
from polefence.certify.design import FILE_NAME, Design
from polefence.cli.lines import every_alpha, motion_lines, order_lines, samples_text
from polefence.cli.options import (
    at_samples,
    centre_argument,
    kind_argument,
    method_arguments,
    method_of,
    refuse_method_options,
    result_arguments,
    sampling_arguments,
    spec_argument,
    structure_arguments,
    structure_of,
)
from polefence.cli.output import PROVED, check_results, report
from polefence.plant.spec import load
from polefence.proof.text import exactly
from polefence.region.regions import Disk
from polefence.region.text import digits_down, digits_up, parse_region, short_text
from polefence.search.place import tightest
from polefence.search.rows import plant_summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `tightest`."""
    spec_argument(parser)
    kind_argument(parser, required=True)
    centre_argument(parser, "disk: its centre, for example -40")
    parser.add_argument(
        "--within",
        metavar="REGION",
        help="half_plane, sector: a region to keep as well, 'disk(-40, 39)'",
    )
    method_arguments(parser)
    sampling_arguments(parser)
    structure_arguments(parser)
    result_arguments(parser, "write DIR/design.json", "poles over the family, and the region")


def tightest_command(options: Any) -> int:
    """Find the largest decay rate or damping ratio, or the smallest disk, and prove it."""
    if options.of != "disk" and options.centre is not None:
        raise InputError(f"--centre belongs to --of disk; a {options.of} has none")
    if options.of == "disk" and options.within is not None:
        raise InputError("--within belongs to --of half_plane and --of sector")
    plant = at_samples(load(options.spec), options)
    centre = f"--centre CENTRE, for example --centre {example_centre(plant)}"
    if options.within is not None and plant.sample_time is not None:
        raise InputError("--within is of continuous time; leave it out")
    if options.of == "disk" and options.centre is None:
        raise InputError(f"--of disk needs {centre}")
    within = None if options.within is None else parse_region(options.within, alone=False)
    structure, method = structure_of(plant, options), None
    if structure is None:
        method = method_of(options.method or "scheduled", options)
    else:
        refuse_method_options(options)
    check_results(options, FILE_NAME)
    design = tightest(
        plant, options.centre, method, of=options.of, within=within, structure=structure
    )
    label = design.label if structure is None else structure.words(plant)
    value, text = _answer(options.of, design)
    first = 0 if design.asked is not None else 1
    rest = " & ".join(short_text(part) for part in design.region.parts[first:])
    beside = f", within {rest}" if rest else ""
    lines = [f"proved: {text}{beside}, for {every_alpha(design)} of {plant.name!r} by {label}"]
    lines += order_lines(design.plant, structure)
    lines += samples_text(plant) + motion_lines(plant, design.region)
    if (
        options.of != "disk"
        and plant.sample_time is None
        and (within is None or within.parts != design.region.parts[1:])
    ):
        for disk in [part for part in design.region.parts if part.circle][-1:]:
            half = float(f"{disk.size / 2:.2g}")
            example = Disk(-half, half)
            lines.append(
                "note: a disk was added, or the gain would grow without bound; choose your own by "
                f"--within, for example '{short_text(example)}'"
            )
    if design.unrunnable is not None:
        lines.append(
            f"note: {digits_down(design.unrunnable)} is proved too, but only of a law that doubles "
            "cannot evaluate"
        )
    summary = {
        "plant": plant_summary(plant),
        "of": options.of,
        "value": value,
        "lower": design.lower,
        "unrunnable": design.unrunnable,
        "region": design.region.document(),
        "method": label,
        "answer": "proved",
    }
    report(design, lines, summary, options)
    return PROVED


def _answer(of: str, design: Design) -> tuple[float, str]:
    """Return the number that was asked for, and a text that is true as printed."""
    first = (design.asked or design.region).parts[0]
    if of == "half_plane":
        value = first.numbers["decay"]
        return value, f"decay rate {digits_down(value)} 1/s"
    if of == "sector":
        value = first.numbers["damping"]
        return value, f"damping ratio {digits_down(value)}"
    value, centre = first.numbers["radius"], first.numbers["centre"]
    unit = " 1/s" if design.plant.sample_time is None else ""
    bound = "" if design.lower is None else f" (lower bound: {digits_down(design.lower)})"
    return value, f"radius {digits_up(value)}{unit} about {exactly(centre)}{bound}"
