"""``polefence tradeoff``: the least proved bound on one signal over limits on another."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from polefence.base.errors import InputError
from polefence.base.workers import processes
from polefence.certify.checks import is_optimisable
from polefence.cli.lines import samples_text
from polefence.cli.optimise import (
    asked,
)
from polefence.cli.options import (
    SIGNAL_METHODS,
    at_samples,
    jobs_of,
    limit_argument,
    method_arguments,
    methods_of,
    minimise_argument,
    poles_argument,
    refuse_method_options,
    region_of,
    result_arguments,
    road_arguments,
    road_of,
    rows_file,
    sampling_arguments,
    signal_method_of,
    spaced,
    spec_argument,
    structure_arguments,
    structure_of,
    sweep_arguments,
)
from polefence.cli.output import (
    NOT_PROVED,
    PROVED,
    STANDARD,
    check_results,
    finished_rows,
    saved,
    write_figure,
    write_json,
)
from polefence.cli.terminal import say
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method, method_label
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load
from polefence.proof.text import exactly
from polefence.region.text import digits_down, digits_up
from polefence.requirements.asked import COMFORT, densities_of, in_units
from polefence.requirements.specification import Specification, limit_text
from polefence.requirements.text import load_specifications, parse_specification, with_wheels
from polefence.search.rows import Row
from polefence.search.tradeoff import DECAY, TUNED, Front, keep_references, tradeoff


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `tradeoff`."""
    spec_argument(parser)
    parser.add_argument(
        "--over",
        required=True,
        metavar="TEXT",
        help="the signal whose limit is swept: 'rms of actuator force'",
    )
    parser.add_argument(
        "--value", type=float, action="append", default=[], metavar="V", help="a limit; repeat"
    )
    parser.add_argument(
        "--values",
        type=float,
        nargs=3,
        metavar=("FROM", "TO", "COUNT"),
        help="evenly spaced limits, for example 50 300 6",
    )
    minimise_argument(parser, "'rms of SIGNAL'", f", else of a quarter car '{COMFORT}'")
    road_arguments(parser)
    poles_argument(parser)
    limit_argument(parser, "kept everywhere: 'rms of tyre deflection <= 0.0048'; repeat for more")
    method_arguments(parser, SIGNAL_METHODS, several=True)
    result_arguments(parser, plot="the curves", json="write the rows, kept up to date; -: stdout")
    sweep_arguments(parser)
    structure_arguments(parser)
    sampling_arguments(parser, clock=True)


def tradeoff_command(options: Any) -> int:
    """Find the least proved bound on one signal for each limit on another."""
    plant = at_samples(load(options.spec), options)
    minimise, over, limits = _specifications(plant, options)
    values, structure = _values(options), structure_of(plant, options)
    asked = (minimise, over, *limits)
    tuned = not options.method and any(one.beyond_lmi(plant) for one in asked)
    methods = None if tuned else _methods(plant, options, structure)
    if methods is not None and not options.method:
        methods = _fitted(plant, methods, 2 + len(limits))
    region = region_of(options)
    path = rows_file(options)
    check_results(options)
    rows = len(values) * len(methods or [TUNED])
    jobs = jobs_of(options, rows)
    with processes(jobs) as executor, _finished(rows) as finished:
        front = tradeoff(
            plant,
            minimise,
            over,
            values,
            limits,
            region,
            methods,
            structure=structure,
            executor=executor,
            on_row=finished,
            path=path,
            resume=options.resume,
        )
    from polefence.vehicle import beside_reference_laws

    front = beside_reference_laws(front)
    if options.json == STANDARD:
        write_json(STANDARD, front.document())
    elif options.json is not None:
        keep_references(options.json, front.references)
        saved(options.json)
    if options.plot is not None:
        from polefence.show.plots import front_figure

        write_figure(options.plot, front_figure(front))
    say(*_lines(front))
    return PROVED if front.proved else NOT_PROVED


def _values(options: Any) -> list[float]:
    values = list(options.value)
    if options.values is not None:
        # 0.0044, not 0.004399999999999999: the limit is exactly what is printed
        values += [float(f"{value:.12g}") for value in spaced("--values", options.values, 1000)]
    if not values:
        raise InputError("no limit given; use --value 100, or --values 50 300 6")
    return list(dict.fromkeys(values))


def _methods(
    plant: UncertainPlant, options: Any, structure: Structure | None
) -> list[Method] | None:
    if structure is not None:
        refuse_method_options(options)
        return None
    names = list(dict.fromkeys(options.method or SIGNAL_METHODS))
    return methods_of(names, lambda name: signal_method_of(plant, name, options))


def _fitted(plant: UncertainPlant, methods: list[Method], count: int) -> list[Method]:
    """Return the methods that are not too large; all where none is, to be refused."""
    small = [method for method in methods if is_optimisable(plant, method, count)]
    for method in methods if small else []:
        if method not in small:
            say(f"note: without {method_label(method)}: too large for {count} specifications")
    return small or methods


def _specifications(
    plant: UncertainPlant, options: Any
) -> tuple[Specification, Specification, list[Specification]]:
    """Return what is minimised, what is swept over, and the limits, the spec's among them."""
    road = road_of(options)
    own_road = with_wheels(road, options.spec)
    first, written = load_specifications(options.spec, road)
    known = densities_of((*written, *([first] if first else [])))
    told = options.minimise is not None or first is not None
    if not told and plant.vehicle is not None:
        options = argparse.Namespace(**vars(options) | {"minimise": COMFORT})
    least, limits = asked(plant, options, road)
    if least is None:
        raise InputError(f"{options.spec}: nothing is minimised; give --minimise 'rms of SIGNAL'")

    def parsed(text: str) -> Specification:
        specification = parse_specification(text, own_road, known)
        return specification if own_road is None else own_road.acting(specification, plant)

    over = in_units(parsed(options.over), limits)
    if over.at_most is not None:
        raise InputError(f"--over {options.over!r} has a limit; give limits by --value or --values")
    for text in options.limit:
        specification = parsed(text)
        if specification.title == over.title:
            raise InputError(f"--limit {text!r} limits what --over sweeps; leave one of them out")
    # the spec's own limit on what is swept gives way
    others = [limit for limit in limits if limit.title != over.title]
    return least, over, others


def _lines(front: Front) -> list[str]:
    """Return the table, bounds rounded up, and the reasons of what is not proved."""
    over, least = front.labels
    question = front.asked
    signals = [question.minimise, question.over, *question.subject_to]
    lines = [
        f"{question.plant.name}: {question.plant.size_text}",
        f"least {least} over limits on {over}",
        *(f"with {limit_text(s)}" for s in question.subject_to),
        f"with poles in {question.region}",
        *(line.strip() for line in samples_text(question.plant, signals)),
    ]
    width = _width(front.rows)
    lines += _table(front.rows)
    if front.references:
        lines.append("without a proof:")
    lines += [_reference_line(row, width) for row in front.references]
    lines += [
        f"at {exactly(row['value'])}, {row['method']}: {row['reason']}"
        for row in front.rows
        if row["answer"] != "proved"
    ]
    return lines


def _width(rows: Sequence[Row]) -> int:
    return max(10, *(len(row["method"]) for row in rows))


def _table(rows: Sequence[Row]) -> list[str]:
    width, clocked = _width(rows), any(row[DECAY] is not None for row in rows)
    decay = f"{'decay':>10}  " if clocked else ""
    head = (
        f"{'limit':>10}  {'method':<{width}} {'proved':>10}  {'sampled':>10}  {'keeps':>10}  "
        f"{'law of':>10}  {decay}{'answer':<10}  seconds"
    )
    lines = [head, *(_row_line(row, width, clocked) for row in rows)]
    if clocked:
        lines.append("decay: at least this rate [1/s], for these periods in any order")
    return lines


def _row_line(row: Row, width: int, clocked: bool) -> str:
    proved = sampled = keeps = law_of = "-"
    if row["proved"] is not None:
        proved, law_of = digits_up(row["proved"]), exactly(row["law_of"])
        keeps = digits_up(row["bounds"][0]["proved"])
    if row["sampled"] is not None:
        sampled = f"{row['sampled']:.6g}"
    rate = "-" if row[DECAY] is None else digits_down(row[DECAY])
    decay = f"{rate:>10}  " if clocked else ""
    return (
        f"{exactly(row['value']):>10}  {row['method']:<{width}} {proved:>10}  {sampled:>10}  "
        f"{keeps:>10}  {law_of:>10}  {decay}{row['answer']:<10}  {row['seconds']:.2f}"
    )


def _reference_line(row: Row, width: int) -> str:
    """Return a reference law's line: nothing of it is proved."""
    note = "" if row["keeps"] else "; exceeds another limit"
    return (
        f"{'-':>10}  {row['name']:<{width}} {'-':>10}  {row['minimise']:>10.6g}  "
        f"{row['over']:>10.6g}  {'-':>10}  sampled{note}"
    )


@contextmanager
def _finished(total: int) -> Iterator[Callable[[Row], None]]:
    """Show how many rows are finished; print those that are where Ctrl-C ends the others."""
    rows = list[Row]()
    with finished_rows(total) as told:

        def finished(row: Row) -> None:
            rows.append(row)
            told(f"limit {row['value']:g} {row['method']}: {row['answer']}")

        try:
            yield finished
        except KeyboardInterrupt:
            if rows:
                say(*_table(rows))
            raise
