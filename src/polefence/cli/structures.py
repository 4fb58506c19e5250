"""``polefence optimise`` of several structures: a table, and the law that is recommended."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError
from polefence.certify.design import FILE_NAME
from polefence.cli.lines import law_lines, limit_lines, limit_of, samples_text
from polefence.cli.options import refuse_method_options, region_of, structure_of
from polefence.cli.output import (
    NOT_PROVED,
    PROVED,
    check_results,
    finished_rows,
    saved,
    write_figure,
    write_json,
)
from polefence.cli.terminal import say
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.requirements.specification import Specification, limit_text
from polefence.search.rows import Row
from polefence.search.structures import FILE_NAME as TABLE
from polefence.search.structures import AskedStructures, Structures, asked_of, save_row, structures

SINGLE = {"bits": "float", "fixed": "fixed"}  # options of one law alone
SIGNALS = 36  # letters of the signals in a row


def several(options: Any) -> bool:
    """Whether options name more than one structure; one in a list is taken out of it.

    Raises
    ------
    InputError
        If they name several where a law of one is asked for.
    """
    for key in ("order", "degree", "measured"):
        value = getattr(options, key)
        if isinstance(value, tuple | list) and len(value) == 1:
            setattr(options, key, value[0])
    given = [
        k for k in ("order", "degree", "measured") if isinstance(getattr(options, k), tuple | list)
    ]
    if options.resume and not given:
        raise InputError("--resume is of several structures, as --order 0..2 names them")
    if not given:
        return False
    if options.method is not None:
        raise InputError(
            f"--{given[0]} names several structures, and --method laws of an LMI, which have none; "
            "leave one out"
        )
    for key, option in SINGLE.items():
        if getattr(options, key) is not None:
            raise InputError(f"--{option} is of one law: name one --{given[0]}")
    if options.ranges:
        raise InputError("--range is for fixed-point code, of one law: leave it out")
    return True


def compare_structures(
    plant: UncertainPlant,
    least: Specification | None,
    limits: Sequence[Specification],
    options: Any,
) -> int:
    """Find the least proved bound of each structure, and recommend one."""
    if least is None:
        raise InputError(
            f"{options.spec}: structures are compared by what is minimised; give --minimise "
            "'rms of SIGNAL', or write minimise = true in one [[specification]]"
        )
    refuse_method_options(options)
    structure, sets = _structures(plant, options)
    region = region_of(options)
    directory: Path | None = options.output
    if options.resume and directory is None:
        raise InputError("--resume needs -o DIR, where the finished rows are")
    check_results(options, FILE_NAME, TABLE)
    orders, degrees = (_listed(getattr(options, key)) for key in ("order", "degree"))
    path = None if directory is None else directory / TABLE
    question = plant, least, limits, region, structure
    tables: dict[str, Any] = {"orders": orders, "degrees": degrees, "measured": sets}
    asked = asked_of(*question, **tables)
    with _finished(asked, directory) as finished:
        table = structures(*question, **tables, path=path, on_row=finished, resume=options.resume)
    if directory is not None:
        saved(*table.save(directory))
    if options.json is not None:
        write_json(
            options.json,
            table.document() | {"limit_of_any_law": limit_of(table.limit_of_any_law)},
        )
    if options.plot is not None:
        from polefence.show.plots import structures_figure

        write_figure(options.plot, structures_figure(table))
    say(*_lines(table))
    return PROVED if table.recommended is not None else NOT_PROVED


def _listed(value: Any) -> list[int] | None:
    if value is None:
        return None
    return list(value) if isinstance(value, tuple) else [value]


def _structures(
    plant: UncertainPlant, options: Any
) -> tuple[Structure, list[tuple[str, ...] | None] | None]:
    """Return what all structures have, and the sets of signals where several are named."""

    def one(measured: Any) -> Structure:
        fewest = {
            key: value[0] if isinstance(value, tuple) else value
            for key in ("order", "degree")
            if (value := getattr(options, key)) is not None
        }
        given = argparse.Namespace(**vars(options) | fewest | {"measured": measured})
        return structure_of(plant, given) or Structure()

    if not isinstance(options.measured, list):
        return one(options.measured), None
    every = [one(names) for names in options.measured]
    return every[0], [structure.measured for structure in every]


def _lines(table: Structures) -> list[str]:
    """Return the table, bounds rounded up, what is recommended, and its law."""
    asked = table.asked
    lines = [
        f"{asked.plant.name}: {asked.plant.size_text}",
        f"least {table.label} of each structure of the law",
        *(f"with {limit_text(limit)}" for limit in asked.subject_to),
        f"with poles in {asked.region}",
        *(line.strip() for line in samples_text(asked.plant, [asked.minimise, *asked.subject_to])),
        *table_lines(asked, table.rows),
    ]
    lines += [
        f"row {row['row']}: {row['reason']}" for row in table.rows if row["reason"] is not None
    ]
    best = table.best
    if best is None:
        return lines
    lines += limit_lines(table.limit_of_any_law, best["level"], "the best row")
    return [*lines, f"recommended: {table.reason}", *law_lines(table.design().law)]


def table_lines(asked: AskedStructures, rows: Sequence[Row]) -> list[str]:
    """Return the rows of a table that are finished, below its head."""
    sets = len({one.measured for one in asked.structures}) > 1
    width = max(len(_signals(row)) for row in rows) if sets else 0
    signals = f"  {'measured':<{width}}" if sets else ""
    head = (
        f"{'row':>5}  {'order':>5}  {'degree':>6}{signals}  {'numbers':>7}  {'proved':>10}  "
        f"{'sampled':>10}  {'change':>8}  {'law of':>6}  {'answer':<10}  seconds"
    )
    lines, known = [head], {row["row"]: row for row in rows}
    for row in rows:
        cells = ["-"] * 5
        if row["level"] is not None:
            below = [known[j + 1] for j in asked.every_poorer(row["row"] - 1) if j + 1 in known]
            before = min((r["level"] for r in below if r["level"]), default=None)
            change = "-" if not before else _share(row["level"] / before - 1)
            sampled = "-" if row["sampled"] is None else f"{row['sampled']:.6g}"
            proved = asked.minimise.proved_text(row["level"])
            cells = [str(row["numbers"]), proved, sampled, change, str(row["law_of"])]
        measured = f"  {_signals(row):<{width}}" if sets else ""
        numbers, proved, sampled, change, law_of = cells
        lines.append(
            f"{row['row']:>5}  {row['order']:>5}  {row['degree']:>6}{measured}  {numbers:>7}  "
            f"{proved:>10}  {sampled:>10}  {change:>8}  {law_of:>6}  {row['answer']:<10}  "
            f"{row['seconds']:.2f}"
        )
    return lines


def _signals(row: Row) -> str:
    text = "all states" if row["measured"] is None else ", ".join(row["measured"])
    return text if len(text) <= SIGNALS else f"{text[: SIGNALS - 3]}..."


@contextmanager
def _finished(asked: AskedStructures, directory: Path | None) -> Iterator[Callable[[Row], None]]:
    """Show how many rows are finished, each with its law in its folder.

    Where Ctrl-C ends the others those that are finished are printed.
    """
    rows = list[Row]()
    with finished_rows(len(asked.structures)) as told:

        def finished(row: Row) -> None:
            rows.append(row)
            if directory is not None:
                save_row(asked, row, directory)
            told(f"row {row['row']}: {row['answer']}")

        try:
            yield finished
        except KeyboardInterrupt:
            if rows:
                say(*table_lines(asked, rows))
            raise


def _share(change: float) -> str:
    """Return a change in per cent; one of less than shows is none."""
    text = f"{100 * change:+.2f} %"
    return text if text.strip("+-") != "0.00 %" else "0.00 %"
