"""``polefence design``: a law for a region, proved and saved."""

from __future__ import annotations

import argparse
from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError
from polefence.certify.checks import implies_stability
from polefence.certify.design import FILE_NAME
from polefence.cli.lines import every_alpha, image_text, motion_lines, samples_text
from polefence.cli.options import (
    at_samples,
    budget_argument,
    method_arguments,
    method_of,
    refuse_method_options,
    region_arguments,
    required_region,
    result_arguments,
    sampling_arguments,
    spec_argument,
    structure_arguments,
    structure_of,
)
from polefence.cli.output import PROVED, check_results, report
from polefence.lmi.conditions.methods import Method, Scheduled
from polefence.plant.parameters import exact
from polefence.plant.spec import load
from polefence.proof.text import digits_down, exactly
from polefence.search.place import place
from polefence.search.rows import plant_summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `design`."""
    spec_argument(parser)
    region_arguments(parser, "disk(-40, 31) & sector(0.3)")
    method_arguments(parser, auto=True)
    budget_argument(
        parser,
        "--degree auto: begin no higher degree after this time; default: no limit in seconds",
    )
    parser.add_argument(
        "--right-hand-sides",
        action="store_true",
        help="scheduled: keep the right-hand sides of the paper's (15)-(17), for a disk",
    )
    parser.add_argument(
        "--error",
        action="append",
        default=[],
        metavar="NAME=SIZE",
        help="the law's estimate of this parameter may be off by up to SIZE; repeat",
    )
    sampling_arguments(parser)
    structure_arguments(parser)
    result_arguments(parser, "write DIR/design.json", "poles over the family, and the region")


def design_command(options: Any) -> int:
    """Design a law for a region, prove it, and save it."""
    plant = at_samples(load(options.spec), options)
    region, structure = required_region(plant, options), structure_of(plant, options)
    method = None
    if structure is None:
        method = _method(options)
    else:
        refuse_method_options(options)
    if options.right_hand_sides and not region.circle:
        raise InputError(f"--right-hand-sides is for a single disk, not {region}")
    check_results(options, FILE_NAME)
    errors = errors_of(options.error)
    design = place(plant, region, method, structure=structure, errors=errors)
    if structure is not None and design.law.fixed:
        structure = replace(structure, schedule=())
    label = design.label if structure is None else structure.words(plant)
    lines = [
        f"proved: {label} keeps all poles of {plant.name!r} in {design.region} for "
        f"{every_alpha(design)}",
        *image_text(plant, region),
        *samples_text(plant),
    ]
    if not implies_stability(plant, design.region):
        shape = "disk" if region.circle else "region"
        lines.append(
            f"note: this {shape} reaches into the right half-plane; it does not imply stability"
        )
        for part in region.parts:
            if part.decay_rate() < 0:
                rate = exactly(-part.decay_rate())
                lines.append(
                    f"note: {part} lets poles go up to +{rate}; left of -{rate} is "
                    f"half_plane({rate})"
                )
    if errors:
        off = ", ".join(f"{name} by up to {digits_down(size, 6)}" for name, size in errors.items())
        still = plant.moving and plant.dead_time is None
        rest = ", for constant parameters" if still else ""
        lines.append(f"  for estimates that the law is given and that are off{rest}: {off}")
    lines += motion_lines(plant, design.region, exact=bool(errors))
    summary = {
        "plant": plant_summary(plant),
        "region": design.region.document(),
        "method": label,
        "answer": "proved",
    }
    report(design, lines, summary, options)
    return PROVED


def errors_of(texts: list[str]) -> dict[str, Fraction]:
    """Return errors of estimates by the parameters' names.

    Raises
    ------
    InputError
        If one is not NAME=SIZE, or is there twice.
    """
    errors = dict[str, Fraction]()
    for text in texts:
        name, _, size = text.partition("=")
        try:
            value = exact(size.strip(), name)
        except InputError as error:
            raise InputError(
                f"--error {text!r} is not NAME=SIZE; write for example --error m1=20"
            ) from error
        if name.strip() in errors:
            raise InputError(f"--error {name.strip()} is given twice; give it once")
        errors[name.strip()] = value
    return errors


def _method(options: Any) -> Method:
    method = method_of(options.method or "scheduled", options)
    if not options.right_hand_sides:
        return method
    if options.method not in (None, "scheduled"):
        raise InputError(f"--right-hand-sides belongs to the method scheduled, not {method}")
    if method != "scheduled":
        raise InputError("--right-hand-sides is for degree 1 on the simplex; leave the others out")
    return Scheduled(right_hand_sides=True)
