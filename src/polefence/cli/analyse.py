"""``polefence analyse``: does a gain that is given keep a region, and how far does it go."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.base.files import read_text
from polefence.base.progress import stage
from polefence.certify.certificate import Certificate
from polefence.certify.checks import example_centre
from polefence.certify.design import FILE_NAME, Design, is_proof_file, require_kind
from polefence.certify.given import Analysis, WorstCase, analyse, worst_case
from polefence.certify.table import FILE_NAME as TABLE_NAME
from polefence.certify.table import TableAnalysis, analyse_table
from polefence.cli.common import (
    NOT_PROVED,
    PROVED,
    at_samples,
    check_figure,
    check_targets,
    every_alpha,
    image_text,
    samples_text,
    sampling_arguments,
    saved,
    spec_argument,
    write_figure,
    write_json,
)
from polefence.cli.terminal import say
from polefence.cli.tightest import KINDS
from polefence.law.arrays import law_from
from polefence.law.laws import FixedGain, GainTable, Law, given_law, table_from
from polefence.plant.arrays import NO_NAMES, read_arrays
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded, values_text, where_text
from polefence.plant.spec import load
from polefence.proof import reading, work
from polefence.proof.claims.cells import Cell
from polefence.proof.document import FORMAT
from polefence.proof.text import exactly, plural
from polefence.region.regions import Region
from polefence.region.text import digits_down, digits_up, load_region, parse_region
from polefence.search.rows import plant_summary

OTHERS = (".mat", ".npz", ".npy", ".csv")  # files of other tools
WANTED = 'give a matrix, a design.json, or a table {"grid": {name: knots}, "gains": nested lists}'
MOST_TEXT = 100_000  # characters of a matrix on the command line
SHOWN = 3  # counterexamples printed
BETWEEN = 200  # points beside the vertices, where the other sign is tried
PRINTED = re.compile(r"\[([-+.0-9eE\s,;]+)\]")
CUT = "note: cut by --budget; a faster machine, or more time, may prove more"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `analyse`."""
    spec_argument(parser)
    parser.add_argument(
        "--gain",
        required=True,
        metavar="WHAT",
        help="u = K x: '[[...]]', '[1 2; 3 4]', or a file: JSON with a matrix, a design or a "
        "table; .mat, .npz, .npy or .csv with a K",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--region",
        metavar="TEXT",
        help="'disk(-40, 31) & sector(0.3)'; default: the region that the spec names",
    )
    where.add_argument(
        "--of",
        type=lambda word: word.lower().replace("-", "_"),
        choices=KINDS,
        help="instead: the smallest disk about --centre, or the largest decay rate or damping "
        "ratio, that the gain keeps",
    )
    parser.add_argument("--centre", "--center", type=float, metavar="CENTRE", help="--of disk")
    parser.add_argument(
        "--budget",
        type=float,
        metavar="SECONDS",
        help="begin no harder step after this time; the answer then depends on the machine. "
        "Default: no limit in seconds, only in counted work",
    )
    parser.add_argument(
        "--depth",
        type=int,
        default=4,
        metavar="N",
        help="halve a cell of a table up to N times; default: 4",
    )
    sampling_arguments(parser, "analyse the loop of a")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="write DIR/design.json, or DIR/table.json"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write a summary; -: stdout")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the poles, or the table's cells (.png, ...)"
    )


def analyse_command(options: Any) -> int:
    """Prove or refute that a given gain, or table of gains, keeps a region."""
    plant = load(options.spec)
    if (options.budget or 0) < 0 or options.depth < 0:
        raise InputError("--budget and --depth must be zero or more")
    if (options.of == "disk") != (options.centre is not None):
        centre = example_centre(plant)
        raise InputError(
            f"--of disk needs --centre CENTRE (--centre {centre}, say); no other has one"
        )
    plant, law = _read(plant, options)
    check_figure(options.plot)
    table = law if isinstance(law, GainTable) else None
    name = FILE_NAME if table is None else TABLE_NAME
    check_targets(options.json, options.plot, folder=options.output, names=(name,))
    if options.of is None:
        region = _region(options)
        if table is not None:
            return _table(plant, table, region, options)
        return _one(analyse(plant, law, region, options.budget), region, options)
    if table is not None:
        raise InputError("--of is for one gain or law; analyse a table with --region")
    return _worst(
        plant, worst_case(plant, law, options.of, options.centre, options.budget), options
    )


def _read(plant: UncertainPlant, options: Any) -> tuple[UncertainPlant, Law | GainTable]:
    """Return plant and law, as a computer has them where the options ask for it.

    A gain of the plant is zero of inputs that are on their way; one of a design at a sample time
    has them.
    """
    seen = at_samples(plant, options)
    if seen is plant:
        return plant, read_gain(plant, options.gain)
    try:
        law = read_gain(seen, options.gain)
    except InputError:  # of the plant, not of what is on its way
        law = read_gain(plant, options.gain)
        if isinstance(law, FixedGain):
            return seen, law.with_states(seen.shape[0] - plant.shape[0])
    else:
        if not isinstance(law, GainTable):
            return seen, law
    raise InputError(
        "--sample-time judges one gain, and laws that are designed so; of any other "
        "`polefence export --sample-time` says how fast the loop decays"
    )


def read_gain(
    plant: UncertainPlant, what: str, names: Mapping[str, str] = NO_NAMES, option: str = "--gain"
) -> Law | GainTable:
    """Read a gain: JSON text, or a file with a matrix, a design or a table; never executed.

    Parameters
    ----------
    names : mapping
        What a file of another tool calls K, Z or W.
    option : str
        What says it, for messages.

    Raises
    ------
    InputError
        If it cannot be read, or does not fit the plant; the file is named.
    """
    if what.lstrip().startswith(("[", "{")):
        name, text = option, what
        if len(text) > MOST_TEXT:
            raise InputError(f"{option} has {len(text)} characters; write a file")
    else:
        path = Path(what)
        path = path / FILE_NAME if (path / FILE_NAME).is_file() else path
        if path.is_dir() or path.suffix.lower() in OTHERS:
            return law_from(read_arrays(path, names), plant)
        name, text = str(path), read_text(path, reading.MAX_BYTES, InputError)
    try:
        data = reading.parse(_as_json(text))
    except work.FormatError as error:
        raise InputError(f"{name}: {error}") from error
    try:
        if isinstance(data, dict) and data.get("format") == FORMAT:
            certificate = Certificate.loads(text)
            require_kind(certificate)
            return given_law(plant, certificate.law)
        if isinstance(data, dict) and "grid" not in data and {"K", "W", *names} & data.keys():
            return law_from(read_arrays(name, names), plant)
        if isinstance(data, dict) and "format" in data:
            raise InputError(f"format = {shown(data['format'])} is not read here; {WANTED}")
        if isinstance(data, dict):
            return table_from(plant.parameters, data)
        return given_law(plant, data)
    except InputError as error:
        raise type(error)(f"{name}: {error}") from error


def _as_json(text: str) -> str:
    """Return a matrix as commands print it, ``[1 2; 3 4]``, as JSON; any other text as it is."""
    found = PRINTED.fullmatch(text.strip())
    if found is None:
        return text
    rows = (re.split(r"[\s,]+", row.strip(" ,\t\r\n")) for row in found[1].split(";"))
    return "[" + ", ".join(f"[{', '.join(row)}]" for row in rows) + "]"


def _region(options: Any) -> Region:
    region = load_region(options.spec) if options.region is None else parse_region(options.region)
    if region is None:
        raise InputError(
            f"{options.spec}: names no region; give --region TEXT, or --of for the best one"
        )
    return region


def _one(analysis: Analysis, asked: Region, options: Any) -> int:
    if analysis.proved:
        say(
            f"proved: the given law keeps all poles of {analysis.plant.name!r} in "
            f"{analysis.region} for {every_alpha(analysis.design)}; {analysis.reason}",
            verdict="proved",
        )
    else:
        say(f"{analysis.answer}: {analysis.reason}", verdict=analysis.answer)
        note_the_sign(analysis, options.gain, "give -K")
    say(*image_text(analysis.plant, asked, analysis.proved), *samples_text(analysis.plant))
    pole, alpha = analysis.pole, analysis.alpha
    _finish(
        options,
        analysis.design if analysis.proved else None,
        {
            "plant": plant_summary(analysis.plant),
            "region": analysis.region.document(),
            "answer": analysis.answer,
            "reason": analysis.reason,
            "alpha": None if alpha is None else [str(a) for a in alpha],
            "values": analysis.values,
            "pole": None if pole is None else [pole.real, pole.imag],
        },
    )
    if options.plot is not None:
        from polefence.show.plots import analysis_figure

        write_figure(options.plot, analysis_figure(analysis))
    return PROVED if analysis.proved else NOT_PROVED


def _worst(plant: UncertainPlant, worst: WorstCase, options: Any) -> int:
    name = {"disk": "radius", "half_plane": "decay rate", "sector": "damping ratio"}[options.of]
    unit = "" if options.of == "sector" or plant.sample_time is not None else " 1/s"
    safe, beyond = (digits_up, digits_down) if options.of == "disk" else (digits_down, digits_up)
    about = f" about {exactly(options.centre)}" if options.of == "disk" else ""
    value = None if worst.region is None else _value(worst.region, options.of)
    if value is None:
        say(f"undecided: no {name}{about} was proved", verdict="undecided")
    else:
        alpha = (
            "every alpha" if worst.certificate is None else every_alpha(Design(worst.certificate))
        )
        said = f"proved: {name} {safe(value)}{unit}{about} for {alpha} of {plant.name!r}"
        say(said, verdict="proved")
    if options.of != "disk" and worst.bound < 0:
        say("note: below zero: the given law does not stabilise every plant of the family")
    where = where_text(plant, worst.alpha)
    if worst.cut:
        say(CUT)
    say(f"sampled: {name} {beyond(worst.bound)}{unit}{where}; no proof can pass it")
    say(*samples_text(plant))
    design = None if worst.certificate is None else Design(worst.certificate)
    _finish(
        options,
        design,
        {
            "plant": plant_summary(plant),
            "of": options.of,
            "proved": value,
            "sampled": worst.bound,
            "region": None if worst.region is None else worst.region.document(),
            "alpha": list(worst.alpha),
            "values": worst.values,
        },
    )
    if options.plot is not None and design is None:
        say("not drawn: nothing was proved")
    elif options.plot is not None and design is not None:
        from polefence.show.plots import poles_figure, sampled

        write_figure(
            options.plot,
            poles_figure(
                {plant.name: sampled(design)}, design.region, discrete=plant.sample_time is not None
            ),
        )
    return NOT_PROVED if value is None else PROVED


def note_the_sign(analysis: Analysis, gain: str | None, remedy: str, other: str = "-K") -> None:
    """Say of a gain that is refuted where the other sign keeps the poles: lqr has u = -K x.

    The sign of a design's own file is known.
    """
    law, plant = analysis.law, analysis.plant
    if analysis.answer != "refuted" or law.K is None or _is_design(gain):
        return
    alpha = seeded(plant, len(plant.vertices) + BETWEEN)
    A, B = (np.tensordot(alpha, M, 1) for M in (plant.A, plant.B))
    if analysis.region.contains(np.linalg.eigvals(A - B @ law.K)):
        more = len(alpha) - len(plant.vertices)
        between = f", and of {plural(more, 'point')} between" if more else ""
        say(
            f"note: {other} keeps the poles{' of all vertices' * (more > 0)} there{between}; "
            f"if the law is u = {other} x, {remedy}"
        )


def _is_design(gain: str | None) -> bool:
    """Whether a gain is a file of claims, or a folder with one."""
    if gain is None or gain.lstrip().startswith(("[", "{")):
        return False
    path = Path(gain)
    return (path / FILE_NAME).is_file() or (path.is_file() and is_proof_file(path))


def _value(region: Region, of: str) -> float:
    return region.numbers[{"disk": "radius", "half_plane": "decay", "sector": "damping"}[of]]


def _finish(options: Any, design: Design | None, summary: dict[str, Any]) -> None:
    """Save what was proved, and the summary."""
    if options.output is not None:
        path = None if design is None else design.save(options.output)
        if path is None:
            say("not saved: nothing was proved")
        else:
            saved(path)
    if options.json is not None:
        write_json(options.json, summary)


def _table(plant: UncertainPlant, table: GainTable, region: Region, options: Any) -> int:
    if options.plot is not None and len(plant.parameters) > 2:
        raise InputError(f"--plot draws one or two parameters; {plant.name} has more")
    with _finished_cells(table) as finished:
        found = analyse_table(plant, table, region, options.depth, options.budget, finished)
    say(f"{found.answer}: {found.summary}", verdict=found.answer)
    say(*image_text(plant, region, found.answer == "proved"))
    if found.cut:
        say(CUT)
    for values in found.counterexamples[:SHOWN]:
        say(f"  a pole is not in {region} at {values_text(plant, values)}")
    if len(found.counterexamples) > SHOWN:
        say(f"  and in {len(found.counterexamples) - SHOWN} more cells")
    if options.output is not None:
        saved(found.save(options.output))
    if options.json is not None:
        write_json(options.json, _table_summary(found))
    if options.plot is not None:
        from polefence.show.plots import table_figure

        write_figure(options.plot, table_figure(found))
    return PROVED if found.proved else NOT_PROVED


def _table_summary(found: TableAnalysis) -> dict[str, Any]:
    return {
        "plant": plant_summary(found.plant),
        "region": found.region.document(),
        "answer": found.answer,
        "shares": found.shares,
        "cells": len(found.cells),
        "counterexamples": found.counterexamples,
    }


@contextmanager
def _finished_cells(table: GainTable) -> Iterator[Callable[[Cell], None]]:
    """Show how much of the box is finished."""
    whole = float(prod(p.high - p.low for p in table.parameters))
    count, done = 0, 0.0

    with stage("0 % of the box") as own:

        def finished(cell: Cell) -> None:
            nonlocal count, done
            count, done = count + 1, done + float(cell.volume) / whole
            own.now(f"{count} cells, {100 * done:.0f} % of the box")

        yield finished
