"""``polefence analyse``: does a law that is given keep a region and limits; how far does it go."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.progress import stage
from polefence.certify.bounds import is_loose
from polefence.certify.checks import example_centre
from polefence.certify.design import FILE_NAME, Design
from polefence.certify.given import Analysis, WorstCase, analyse, worst_case
from polefence.certify.promised import VerifiedBound
from polefence.certify.table import FILE_NAME as TABLE_NAME
from polefence.certify.table import TableAnalysis, analyse_table
from polefence.cli.given import (
    NONE,
    SPEC,
    Given,
    is_written,
    law_arguments,
    lyapunov_argument,
    read_given,
)
from polefence.cli.lines import (
    decay_lines,
    decay_of,
    errors_text,
    every_alpha,
    image_text,
    samples_text,
)
from polefence.cli.options import (
    budget_argument,
    centre_argument,
    kind_argument,
    limit_argument,
    result_arguments,
    sampling_arguments,
)
from polefence.cli.output import (
    NOT_PROVED,
    PROVED,
    check_results,
    saved,
    write_figure,
    write_json,
    write_poles,
)
from polefence.cli.subjects import claims_file
from polefence.cli.terminal import say
from polefence.law.laws import GainTable
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.plant.points import seeded, values_text, where_text
from polefence.proof.claims.cells import Cell
from polefence.proof.text import exactly, plural
from polefence.region.regions import Region
from polefence.region.text import digits_down, digits_up
from polefence.requirements.specification import limit_text
from polefence.search.rows import plant_summary

SHOWN = 3  # counterexamples printed
CUT = "note: cut by --budget; a faster machine, or more time, may prove more"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `analyse`, which are those of `verify`."""
    law_arguments(parser)
    lyapunov_argument(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--region",
        metavar="TEXT",
        help="'disk(-40, 31) & sector(0.3)'; default: the spec's, else stability",
    )
    kind_argument(where, instead="instead, what the gain keeps; ")
    centre_argument(parser, "--of disk")
    limit_argument(
        parser,
        "a bound that is promised: 'gain of y1 <= 2', or 'gain of y1' for the least that can "
        "be proved; repeat for more; none: the poles alone; spec: all that the spec asks for. "
        "Default: analyse none, verify spec",
    )
    budget_argument(
        parser,
        "begin no harder step after this time; the answer then depends on the machine. "
        "Default: no limit in seconds, only in counted work",
    )
    parser.add_argument(
        "--depth",
        type=int,
        default=4,
        metavar="N",
        help="halve a cell of a table up to N times; default: 4",
    )
    sampling_arguments(parser, "analyse the loop of a", clock=True)
    result_arguments(
        parser, "write DIR/design.json, or DIR/table.json", "the poles, or the table's cells"
    )


def analyse_command(options: Any) -> int:
    """Prove or refute that a given gain, or table of gains, keeps a region and limits."""
    return _command(options, NONE)


def verify_command(options: Any) -> int:
    """Do the same as analyse, with all limits of the spec by default."""
    return _command(options, SPEC)


def _command(options: Any, limits: str) -> int:
    if (options.budget or 0) < 0 or options.depth < 0:
        raise InputError("--budget and --depth must be zero or more")
    given = read_given(options)
    plant, law = given.plant, given.law
    if (options.of == "disk") != (options.centre is not None):
        centre = example_centre(plant)
        raise InputError(
            f"--of disk needs --centre CENTRE (--centre {centre}, say); other --of take none"
        )
    table = law if isinstance(law, GainTable) else None
    check_results(options, FILE_NAME if table is None else TABLE_NAME)
    if options.of is None:
        return _kept(given, options.limit or [limits], options)
    if table is not None:
        raise InputError("--of is for one gain or law; analyse a table with --region")
    if options.limit or options.lyapunov is not None:
        raise InputError("--of asks how far the poles go: leave --limit and --lyapunov out")
    worst = worst_case(plant, law, options.of, options.centre, options.budget)
    return _worst(given, worst, options)


def _kept(given: Given, asked: Sequence[str], options: Any) -> int:
    """Answer whether the region and the limits are kept."""
    plant, law, region = given.plant, given.law, given.region(options)
    limits, P = given.limits(asked, options), given.lyapunov(options)
    if not isinstance(law, GainTable):
        analysis = analyse(plant, law, region, options.budget, limits=limits, lyapunov=P)
        return _one(analysis, region, given, options)
    if limits or P:
        raise InputError("of a table of gains the poles are proved alone; leave --limit and P out")
    return _table(given, law, region, options)


def _one(analysis: Analysis, asked: Region, given: Given, options: Any) -> int:
    plant, kept = analysis.plant, analysis.kept == "proved"
    if kept:
        alpha = every_alpha(analysis.design)
        where = f"all poles of {plant.name!r} in {analysis.region} for {alpha}"
        say(f"proved: {where}; {analysis.reason}", verdict="proved")
    else:
        say(f"{analysis.kept}: {analysis.reason}", verdict=analysis.kept)
        other = ("leave out --minus", "K") if options.minus else ("add --minus", "-K")
        note_the_sign(analysis, options.gain, *other)
    say(*_lyapunov_lines(analysis))
    for verified in analysis.bounds:
        say(_bound_text(plant, verified), verdict=verified.answer)
    known = (verified for verified in analysis.bounds if verified.bound is not None)
    signals = [verified.specification for verified in known]
    samples = [*_clock_text(analysis), *samples_text(plant, signals), *decay_lines(analysis.decay)]
    say(*image_text(plant, asked, kept), *samples, *given.text(options))
    _finish(options, analysis.design if kept else None, _summary(analysis))
    if options.plot is not None:
        from polefence.show.plots import analysis_figure

        write_figure(options.plot, analysis_figure(analysis))
    return PROVED if analysis.proved else NOT_PROVED


def _lyapunov_lines(analysis: Analysis) -> list[str]:
    """Say what the matrices that came with the law prove."""
    given = analysis.lyapunov
    if given is None:
        return []
    what = "P" if given.count == 1 else f"P of {given.count} vertices"
    if given.proved:
        return [f"given {what}: proves it, as {given.words}; {given.reason}"]
    return [f"given {what}: does not prove it; {given.reason}"]


def _bound_text(plant: UncertainPlant, verified: VerifiedBound) -> str:
    asked = verified.specification
    limit = limit_text(asked)
    sampled = f"sampled {asked.sampled_text(verified.worst)}{where_text(plant, verified.alpha)}"
    if verified.worst == np.inf and plant.sampling is not None and not asked.is_margin:
        sampled = "unstable where every period is the longest"
    if verified.answer == "refuted":
        return f"refuted: {limit}; {sampled}, computed in floats"
    if verified.bound is None:
        return f"{verified.answer}: {limit}; no bound is proved, {sampled}"
    level = verified.bound.level
    loose = "; not tight: the worst case lies between" * is_loose(level, verified.worst)
    taken, proved = errors_text(verified.bound), asked.proved_text(level)
    return f"{verified.answer}: {limit}; {proved} is proved, {sampled}{loose}{taken}"


def _clock_text(analysis: Analysis) -> list[str]:
    """Say how many lost samples the loop bears, where bounds for a clock are not proved."""
    for verified in analysis.bounds:
        borne = verified.specification.borne(analysis.plant, analysis.law)
        if borne is None or verified.bound is not None:
            continue
        bears = f"bears at most {plural(borne, 'lost sample')} in a row"
        if borne < 0:
            bears = "is unstable with the longest period of the jitter alone"
        return [f"  the loop {bears}: by floats, at the corners, with periods all alike"]
    return []


def _summary(analysis: Analysis) -> dict[str, Any]:
    given, pole, alpha = analysis.lyapunov, analysis.pole, analysis.alpha
    poles = {
        "reason": analysis.reason,
        "alpha": None if alpha is None else [str(a) for a in alpha],
        "values": analysis.values,
        "pole": None if pole is None else [pole.real, pole.imag],
    }
    return {
        "plant": plant_summary(analysis.plant),
        "region": analysis.region.document(),
        "answer": analysis.answer,
        **poles,
        "poles": {"answer": analysis.kept, **poles},
        "lyapunov": None
        if given is None
        else {"proved": given.proved, "form": given.form, "reason": given.reason},
        "limits": [
            {
                "of": verified.specification.title,
                "limit": verified.limit,
                "answer": verified.answer,
                "proved": None if verified.bound is None else verified.bound.number,
                "errors": None if verified.bound is None else verified.bound.errors,
                "sampled": None
                if verified.worst == np.inf
                else verified.specification.read_as(verified.worst),
                "lost samples borne": verified.specification.borne(analysis.plant, analysis.law),
                "alpha": list(verified.alpha),
                "values": verified.values,
            }
            for verified in analysis.bounds
        ],
        **decay_of(analysis.decay),
    }


def _worst(given: Given, worst: WorstCase, options: Any) -> int:
    plant = given.plant
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
    say(*samples_text(plant), *given.text(options))
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
        write_poles(options.plot, design)
    return NOT_PROVED if value is None else PROVED


def note_the_sign(analysis: Analysis, gain: str | None, remedy: str, other: str = "-K") -> None:
    """Say of a gain that is refuted where the other sign keeps the poles: lqr has u = -K x.

    The sign of a design's own file is known.
    """
    law, plant = analysis.law, analysis.plant
    if analysis.answer != "refuted":
        return
    if gain is not None and not is_written(gain) and claims_file(Path(gain)) is not None:
        return
    alpha = seeded(plant, len(plant.vertices) + 200)
    A, B = (np.tensordot(alpha, M, 1) for M in (plant.A, plant.B))
    signs = np.ones(plant.shape[1])
    signs[: plant.shape[1] - own_states(plant)] = -1  # of u, not of the law's own states
    try:
        poles = np.linalg.eigvals(A + B @ (signs[:, None] * law.gain(alpha)))
    except np.linalg.LinAlgError:  # a law without a value somewhere
        return
    if analysis.region.contains(poles):
        more = len(alpha) - len(plant.vertices)
        between = f", and of {plural(more, 'point')} between" if more else ""
        say(
            f"note: {other} keeps the poles{' of all vertices' * (more > 0)} there{between}; "
            f"if the law is u = {other} x, {remedy}"
        )


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


def _table(given: Given, table: GainTable, region: Region, options: Any) -> int:
    plant = given.plant
    if options.plot is not None and len(plant.parameters) > 2:
        raise InputError(f"--plot draws one or two parameters; {plant.name} has more")
    with _finished_cells(table) as finished:
        analysis = analyse_table(plant, table, region, options.depth, options.budget, finished)
    say(f"{analysis.answer}: {analysis.summary}", verdict=analysis.answer)
    say(*image_text(plant, region, analysis.answer == "proved"), *given.text(options))
    if analysis.cut:
        say(CUT)
    for values in analysis.counterexamples[:SHOWN]:
        say(f"  a pole is not in {region} at {values_text(plant, values)}")
    if len(analysis.counterexamples) > SHOWN:
        say(f"  and in {len(analysis.counterexamples) - SHOWN} more cells")
    if options.output is not None:
        saved(analysis.save(options.output))
    if options.json is not None:
        write_json(options.json, _table_summary(analysis))
    if options.plot is not None:
        from polefence.show.plots import table_figure

        write_figure(options.plot, table_figure(analysis))
    return PROVED if analysis.proved else NOT_PROVED


def _table_summary(analysis: TableAnalysis) -> dict[str, Any]:
    return {
        "plant": plant_summary(analysis.plant),
        "region": analysis.region.document(),
        "answer": analysis.answer,
        "shares": analysis.shares,
        "cells": len(analysis.cells),
        "counterexamples": analysis.counterexamples,
    }


@contextmanager
def _finished_cells(table: GainTable) -> Iterator[Callable[[Cell], None]]:
    """Show how much of the box is finished."""
    whole = float(prod(p.high - p.low for p in table.parameters))
    count, done = 0, 0.0

    with stage("0 % of the box") as progress:

        def finished(cell: Cell) -> None:
            nonlocal count, done
            count, done = count + 1, done + float(cell.volume) / whole
            progress.now(f"{count} cells, {100 * done:.0f} % of the box")

        yield finished
