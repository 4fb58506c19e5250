"""``polefence compare``: laws on the same road, over the whole family."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from polefence.certify.checks import require_region
from polefence.certify.design import Design, read_document
from polefence.cli.laws import WORDS, Named, distinct, law_of, law_of_spec, of_design, read_law
from polefence.cli.options import result_arguments, road_arguments
from polefence.cli.output import (
    PROVED,
    check_results,
    write_figure,
    write_json,
)
from polefence.cli.subjects import claims_file, read_subject
from polefence.cli.terminal import say
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.family import UncertainPlant
from polefence.proof.claims import Poles
from polefence.region.regions import Disk
from polefence.requirements.text import RoadSpectrum, with_wheels

NOTHING_ASKED = (
    "note: {} asks for no law of its own; write [[specification]] tables or a region in it, name "
    "laws by --law, or give --disk for quadratic, slack and scheduled"
)
OF_DAMPERS = (
    "note: laws are forces without limits here, passive is none; polefence concepts compares what "
    "the controllable dampers of a spec give"
)
CLIPPED = (
    "a law of controllable dampers is clipped, and has no stationary covariance; polefence "
    "concepts and simulate drive it"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `compare`."""
    parser.add_argument(
        "subject",
        metavar="SPEC|DESIGN",
        help="a TOML spec of a quarter, half or full car, or a design of one, at a sample time or "
        "not: its law is compared with the others",
    )
    parser.add_argument(
        "--law",
        action="append",
        metavar="LAW",
        help="passive, skyhook, lqr, quadratic, slack, scheduled, a design, or a gain as for "
        "analyse; repeat for more; default: the first three, beside the law that the spec asks for "
        "(designed as by optimise) or that of DESIGN",
    )
    parser.add_argument(
        "--disk",
        type=float,
        nargs=2,
        metavar=("CENTRE", "RADIUS"),
        help="quadratic, slack and scheduled are designed for it, and compared too; named by --law "
        "without it, for -40 36",
    )
    road_arguments(parser, "C", 20.0)
    result_arguments(parser, plot="comfort, grip, travel and force", json="write all rows")


def compare_command(options: Any) -> int:
    """Compare laws on a random road: comfort, tyre load, travel, force, power, over the family."""
    from polefence.vehicle.compare import NoLaw, compare
    from polefence.vehicle.suspensions import require_car

    subject = read_subject(options.subject)
    plant, designed = subject.plant, law_of(subject)
    require_car(plant)
    given = _given(plant, options.law or ())
    check_results(options)
    notes, road = list[str](), RoadSpectrum(options.road, options.speed)
    _ = road.density  # refused before the spec's law is designed
    if options.disk is not None:
        require_region(plant, Disk(*options.disk))
    if designed is None:  # wheels in tracks have one speed
        with_wheels(road, options.subject)
    if designed is None and options.law is None:
        plant, designed = law_of_spec(plant, options.subject)
        notes = [] if designed or options.disk else ["", NOTHING_ASKED.format(options.subject)]
    first = [] if designed is None else [designed]
    laws = [*first, *(given.get(word) or _law(plant, word, options) for word in _words(options))]
    if subject.dampers:
        notes += ["", OF_DAMPERS]
    comparison = compare(
        plant,
        {law.name: NoLaw(CLIPPED) if law.dampers else law.law for law in distinct(laws)},
        options.road,
        options.speed,
    )
    if options.plot is not None:
        from polefence.show.plots import comparison_figure

        write_figure(options.plot, comparison_figure(comparison))
    if options.json is not None:
        write_json(options.json, comparison.document())
    say(*comparison.lines, *notes)
    return PROVED


def _words(options: Any) -> Sequence[str]:
    """Return the laws that are named, or those that every car is compared with."""
    if options.law is not None:
        return list(options.law)
    return (*WORDS, *(METHODS if options.disk is not None else ()))


def _given(plant: UncertainPlant, words: Sequence[str]) -> dict[str, Named]:
    """Read designs and gains, by what names them: what is no law is none of any plant."""
    return {word: _read(plant, word) for word in words if word not in (*WORDS, *METHODS)}


def _read(plant: UncertainPlant, word: str) -> Named:
    """Read a law, or a design of the same car with a plant of its own."""
    from polefence.vehicle.compare import plant_of

    path = claims_file(Path(word))
    if path is not None and read_document(path).first(Poles) is not None:
        design = Design.read(path)
        if plant_of(plant, design) is not plant:
            return of_design(plant, design, Path(word))
    return read_law(plant, word)


def _law(plant: UncertainPlant, word: str, options: Any) -> Named:
    from polefence.vehicle.compare import standard_laws

    if word in WORDS:
        return read_law(plant, word)
    # a disk that all three methods reach for the cars of the package
    return Named(word, standard_laws(plant, tuple(options.disk or (-40.0, 36.0)), (word,))[word])
