"""``polefence identify``: measurements to a family, which says that it is from data."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError
from polefence.cli.options import result_arguments
from polefence.cli.output import PROVED, check_results, saved, write_figure, write_json
from polefence.cli.terminal import say
from polefence.data.files import load_measurements
from polefence.data.identified import Identified
from polefence.proof.fitted import FREQUENCY, percent
from polefence.proof.text import plural
from polefence.search.rows import plant_summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `identify`."""
    parser.add_argument(
        "measurements",
        type=Path,
        metavar="MEASUREMENTS",
        help="a TOML file that names CSV files, and says what is sought",
    )
    result_arguments(
        parser, "write the family, a spec", "the measurements and the family", into="SPEC"
    )


def identify_command(options: Any) -> int:
    """Fit a family to measured responses or frequency responses; say what it misses them by."""
    if options.output is not None and options.output.absolute() == options.measurements.absolute():
        raise InputError(f"{options.output}: are the measurements; name another file")
    check_results(options)
    found = load_measurements(options.measurements).answer()
    if options.output is not None:
        saved(found.save(options.output))
    if options.json is not None:
        write_json(options.json, _document(found))
    if options.plot is not None:
        from polefence.show.fitted import fit_figure

        write_figure(options.plot, fit_figure(found))
    say(*_lines(found))
    return PROVED


def _lines(found: Identified) -> list[str]:
    """Return what was fitted, and what each output and each measurement is missed by."""
    plant, data = found.plant, found.data
    what = "frequencies" if data.kind == FREQUENCY else "samples"
    lines = [
        f"{plant.name}: {plant.size_text}; {found.unknowns} numbers fitted to "
        f"{plural(len(found.measurements), 'measurement')}, {data.samples} {what}"
    ]
    lines += [
        f"  {p.name} in [{float(p.low):g}, {float(p.high):g}] {p.unit}".rstrip()
        for p in plant.parameters
    ]
    names = [name for name, _ in data.outputs] + [own.name for own in found.measurements]
    rows = [own for _, own in data.outputs] + list(found.missed)
    width = max(map(len, (*names, "missed by")))
    lines.append(f"{'missed by':<{width}}  {'rms':>8}  {'at most':>8}")
    lines += [
        f"{name:<{width}}  {percent(own.rms):>8}  {percent(own.largest):>8}"
        for name, own in zip(names, rows, strict=True)
    ]
    shares = "of the family's value" if data.kind == FREQUENCY else "of the rms of each output"
    return [*lines, f"in per cent {shares}; the largest: {data.place}"]


def _document(found: Identified) -> dict[str, Any]:
    """Return the same as plain data."""
    return {
        "plant": plant_summary(found.plant),
        "numbers": found.unknowns,
        "data": found.data.write(),
        "measurements": [
            {"name": own.name, "values": dict(values), **missed.write()}
            for own, values, missed in zip(
                found.measurements, found.values, found.missed, strict=True
            )
        ],
    }
