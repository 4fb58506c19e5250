"""``polefence observe``: an observer from named measurements, proved and saved."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from polefence.certify.checks import implies_stability
from polefence.certify.design import FILE_NAME
from polefence.cli.lines import gain_lines, image_text, samples_text
from polefence.cli.options import (
    at_samples,
    method_arguments,
    method_of,
    note_sensors,
    region_arguments,
    required_region,
    result_arguments,
    sampling_arguments,
    spec_argument,
)
from polefence.cli.output import (
    PROVED,
    check_results,
    saved,
    write_json,
    write_poles,
)
from polefence.cli.terminal import say
from polefence.plant.spec import load
from polefence.requirements.text import parse_names
from polefence.search.observer import Observer, observe
from polefence.search.rows import plant_summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `observe`."""
    spec_argument(parser)
    parser.add_argument(
        "--measured",
        action="append",
        required=True,
        metavar="SIGNAL",
        help="name of a measured state or output, with or without its unit, or more with commas "
        "between; repeat for more",
    )
    region_arguments(parser, "disk(-80, 60) & sector(0.5)", required=True)
    method_arguments(parser)
    sampling_arguments(parser)
    result_arguments(parser, "write DIR/design.json", "the poles of the error")


def observe_command(options: Any) -> int:
    """Design an observer, prove where the poles of its error lie, and save it."""
    plant = at_samples(load(options.spec), options)
    region = required_region(plant, options)
    method = method_of(options.method or "scheduled", options)
    check_results(options, FILE_NAME)
    known = {name for signal in plant.signals for name in (signal.name, signal.label)}
    measured = [
        name
        for text in options.measured
        for name in ([text] if text in known or "," not in text else parse_names(text))
    ]
    note_sensors(plant, measured, "--measured")
    observer = observe(plant, measured, region, method)
    label = observer.design.label
    asked, region = region, observer.region
    say(
        f"proved: {label} keeps all poles of the observer of {plant.name!r} in {region} for every "
        "alpha",
        *image_text(plant, asked),
        *samples_text(plant),
        verdict="proved",
    )
    if not implies_stability(plant, region):
        say("note: this region reaches into the right half-plane; the error need not die out")
    names = observer.design.plant.inputs
    say(f"  measured: {', '.join(names)}")
    gains = _gains(observer)
    say(*gain_lines(gains))
    if options.output is not None:
        saved(observer.save(options.output))
    if options.plot is not None:
        write_poles(options.plot, observer.design, f"{plant.name}: error of the observer")
    if options.json is not None:
        summary = {
            "plant": plant_summary(plant),
            "measured": list(names),
            "region": region.document(),
            "method": label,
            "answer": "proved",
            "gains": gains,
        }
        write_json(options.json, summary)
    return PROVED


def _gains(observer: Observer) -> dict[str, Any]:
    """Return L, or L at each vertex, as plain data."""
    if observer.design.law.fixed:
        return {"L": observer.gain().tolist()}
    corners = np.eye(len(observer.plant.vertices))
    return {f"L at vertex {j + 1}": L.tolist() for j, L in enumerate(observer.gain(corners))}
