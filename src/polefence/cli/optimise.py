"""``polefence optimise``: one signal as small as can be, others within limits, all proved."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, SpecError
from polefence.cli.bounds import Row, document_of, figure_of, lines_of, require_agreement, rows_of
from polefence.cli.common import (
    PROVED,
    check_results,
    check_targets,
    say,
    spec_argument,
    write_figure,
    write_json,
)
from polefence.cli.methods import method_of
from polefence.design.design import FILE_NAME
from polefence.design.requirements.gain_norm import GainNorm
from polefence.design.requirements.rms import Rms
from polefence.design.requirements.specification import Specification, disturbance
from polefence.design.requirements.text import (
    RoadSpectrum,
    load_specifications,
    parse_specification,
    spec_road,
)
from polefence.design.signals.optimise import Optimised, optimise
from polefence.law.laws import FixedGain
from polefence.lmi.conditions.methods import Method, Scheduled, method_label
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load
from polefence.region.regions import Region
from polefence.region.text import load_region, parse_region

METHODS = ("quadratic", "scheduled")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `optimise`."""
    spec_argument(parser)
    specification_arguments(parser)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="write DIR/design.json: the law with its region and bounds",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write a summary; -: stdout")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw bounds and sampled values (.png, .svg, .pdf)",
    )


def specification_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what is asked, and by which method."""
    parser.add_argument(
        "--minimise",
        metavar="TEXT",
        help="'rms of sprung-mass acceleration'; default: the spec's with minimise = true",
    )
    parser.add_argument(
        "--limit",
        action="append",
        default=[],
        metavar="TEXT",
        help="'rms of actuator force <= 700'; repeat for more; takes the place of the spec's of "
        "this kind and signal",
    )
    parser.add_argument("--road", metavar="CLASS", help="A to H of ISO 8608; default: the spec's")
    parser.add_argument("--speed", type=float, metavar="V", help="over that road [m/s]")
    parser.add_argument(
        "--region", metavar="TEXT", help="for the poles; default: the spec's, else stability"
    )
    parser.add_argument("--method", choices=METHODS, default="scheduled", help="default: scheduled")
    parser.add_argument(
        "--degree", type=int, metavar="N", help="scheduled: degree of W and Z in alpha; default: 1"
    )
    parser.add_argument(
        "--elevation", type=int, metavar="N", help="scheduled: of the design's inequalities; "
        "default: 0",
    )  # fmt: skip
    parser.add_argument(
        "--on",
        choices=("simplex", "box"),
        help="scheduled; default: box, simplex for a plant without parameters",
    )


def optimise_command(options: Any) -> int:
    """Minimise the worst case of one signal within limits on others, and prove all of it."""
    plant = load(options.spec)
    road = road_of(options)
    least, limits = wanted(plant, options, road)
    region, method = region_of_options(options), method_of_options(plant, options)
    check_results(options)
    check_targets(folder=options.output, names=(FILE_NAME,))
    done = optimise(plant, least, limits, region, method)
    rows = rows_of(done)
    require_agreement(rows)
    _finish(done, rows, method, options)
    return PROVED


def _finish(done: Optimised, rows: Sequence[Row], method: Method, options: Any) -> None:
    """Write files, then print: nobody need read the output to its end."""
    saved = None if options.output is None else done.save(options.output)
    label = "quadratic" if isinstance(done.law, FixedGain) else method_label(method)
    if options.json is not None:
        write_json(options.json, document_of(done, rows, label))
    if options.plot is not None:
        write_figure(options.plot, figure_of(done, rows))
    say(*lines_of(done, rows, label))
    # of one vertex one gain is every law
    if label != method_label(method) and len(done.plant.vertices) > 1:
        say(f"  one gain: no law of {method_label(method)} that was found is better")
    if saved is not None:
        say(f"saved: {saved}")


def road_of(options: Any) -> RoadSpectrum | None:
    """Return the road that the options name, None where they do not."""
    if (options.road is None) != (options.speed is None):
        there, missing = ("road", "speed V") if options.speed is None else ("speed", "road CLASS")
        raise InputError(f"--{there} needs --{missing} too, as in --road C --speed 20")
    if options.road is None:
        return None
    road = RoadSpectrum(options.road, options.speed)
    try:
        _ = road.density
    except InputError as error:
        raise InputError(f"--road {options.road} --speed {options.speed:g}: {error}") from error
    return road


def asked(
    plant: UncertainPlant, options: Any, road: RoadSpectrum | None
) -> tuple[Specification, tuple[Specification, ...]]:
    """Return what `wanted` returns, where something must be minimised."""
    least, limits = wanted(plant, options, road)
    if least is None:
        raise InputError(
            f"{options.spec}: nothing is to be minimised; give --minimise 'rms of SIGNAL', or "
            "write minimise = true in one [[specification]]"
        )
    return least, limits


def wanted(
    plant: UncertainPlant, options: Any, road: RoadSpectrum | None
) -> tuple[Specification | None, tuple[Specification, ...]]:
    """Return what is to be minimised, if anything, and the limits, of the spec and the options.

    Raises
    ------
    InputError
        Naming the specification that cannot be used.
    """
    least, limits = load_specifications(options.spec, road)
    road = road or spec_road(options.spec)
    if road is not None and (count := disturbance(plant).shape[-1]) != 1:
        raise InputError(f"{plant.name} has {count} disturbances; a road is one; give density")
    written = (*limits, *([least] if least else []))
    for own in written:
        _known(plant, own, options.spec)
    known = densities_of(written)
    if options.minimise is not None:
        least = in_units(_parsed(plant, options.minimise, "--minimise", road, known), limits)
        if least.at_most is not None:
            raise InputError(f"--minimise {options.minimise!r} has a limit; give it by --limit")
    found = {(own.kind, own.name): own for own in limits}
    if len(found) < len(limits):
        raise SpecError(f"{options.spec}: two limits on one kind and signal; keep the lower one")
    given = set[tuple[str, str]]()
    for text in options.limit:
        own = in_units(_parsed(plant, text, "--limit", road, known), limits)
        if own.at_most is None:
            raise InputError(f"--limit {text!r} has no limit; write for example {text!r} <= 1")
        if (own.kind, own.name) in given:
            raise InputError(f"--limit: {own.kind} of {own.name} is given twice; give it once")
        given.add((own.kind, own.name))
        found[own.kind, own.name] = own
    if least is None and not found:
        raise InputError(
            f"{options.spec}: nothing is asked; give --minimise 'rms of SIGNAL' or --limit 'rms of "
            "SIGNAL <= LIMIT', or write [[specification]] tables"
        )
    return least, tuple(found.values())


def densities_of(written: Sequence[Specification]) -> dict[str, float]:
    """Return the density by signal, as the spec's tables have it."""
    return {own.name: own.density for own in written if isinstance(own, Rms)}


def in_units(own: Specification, limits: Sequence[Specification]) -> Specification:
    """Return a gain norm in the units of the spec's own, if it has one: a line has none."""
    if isinstance(own, GainNorm):
        for other in limits:
            if isinstance(other, GainNorm):
                return replace(own, rows=other.rows, columns=other.columns)
    return own


def _parsed(
    plant: UncertainPlant,
    text: str,
    option: str,
    road: RoadSpectrum | None,
    known: Mapping[str, float],
) -> Specification:
    try:
        own = parse_specification(text, road, known)
    except InputError as error:
        raise InputError(f"{option} {error}") from error
    _known(plant, own, f"{option} {text!r}")
    return own


def _known(plant: UncertainPlant, own: Specification, where: str) -> None:
    """Refuse a signal that there is not, and a plant that nothing disturbs."""
    try:
        own.require_fit(plant)
    except InputError as error:
        raise type(error)(f"{where}: {error}") from error


def region_of_options(options: Any) -> Region | None:
    """Return the region of the options, else the spec's, else None."""
    return load_region(options.spec) if options.region is None else parse_region(options.region)


def method_of_options(plant: UncertainPlant, options: Any) -> Method:
    """Return the method; degree 1, elevation 0, the box of the parameters unless told otherwise."""
    method = method_of(options.method, options)
    if method == "quadratic":
        return method
    on = options.on or ("box" if plant.parameters else "simplex")
    degree = 1 if options.degree is None else options.degree
    return Scheduled(degree, options.elevation or 0, on)
