"""What each command of the command line does, given its parsed options; returns the exit status."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from polefence.conditions.methods import METHODS, Method, Scheduled
from polefence.design import FILE_NAME, Design, check, rounded_down, rounded_up
from polefence.errors import InputError
from polefence.files import check_target, make_folder, write_bytes, write_text
from polefence.law import FixedGain
from polefence.limits import Limit
from polefence.placement import place
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load
from polefence.region import Disk, check_centre
from polefence.suspension.quarter_car import SPECS, spec_text
from polefence.sweep import plant_summary, processes, sweep

PROVED, NOT_PROVED = 0, 1


def _check_targets(*paths: Path | None) -> None:
    """Refuse results that cannot be written, or that overwrite one another, before any work."""
    targets = [path for path in paths if path is not None]
    for path in targets:
        check_target(path)
    if len({path.absolute() for path in targets}) < len(targets):
        raise InputError(f"{targets[0]}: named for two results; name another file")


def _plant(spec: str) -> UncertainPlant:
    """Read a spec for a design: the plant must be controllable."""
    plant = load(spec)
    try:
        plant.require_controllable()
    except InputError as error:
        raise type(error)(f"{spec}: {error}") from error
    return plant


def limits_command(options: Any) -> int:
    """Find the smallest proved disk for each centre and method."""
    plant = _plant(options.spec)
    centres = _centres(options)
    methods = list(dict.fromkeys(options.method or METHODS))
    if options.plot is not None and options.plot.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{options.plot}: a figure ends in .png, .svg or .pdf")
    if options.resume and options.json is None:
        raise InputError("--resume needs --json FILE, where the finished rows are")
    _check_targets(options.json, options.plot)
    progress = Progress(len(centres) * len(methods))
    jobs = _jobs(options, len(centres) * len(methods))
    with processes(jobs) as executor, progress:
        rows = sweep(
            plant,
            centres,
            methods,
            options.json,
            options.resume,
            options.gain,
            executor,
            progress.step,
        )
    print(f"{plant.name}: {_size(plant)}")
    print(
        f"{'centre':>10}  {'method':<10} {'radius':>10}  {'at least':>10}  {'d/sigma':>8}  "
        f"{'status':<9}  seconds"
    )
    for row in rows:
        print(_row_line(row))
    if options.plot is not None:
        from polefence.plots import limits_figure, render

        figure = limits_figure({plant.name: rows})
        make_folder(options.plot.parent)
        write_bytes(options.plot, render(figure, options.plot.suffix[1:]))
    return PROVED if all(row["status"] == "proved" for row in rows) else NOT_PROVED


def _centres(options: Any) -> list[float]:
    centres = list(options.centre)
    if options.centres is not None:
        first, last, count = options.centres
        if not (math.isfinite(first) and math.isfinite(last)):
            raise InputError("--centres: FROM and TO must be finite numbers")
        if not 2 <= count <= 10_000 or count != int(count):
            raise InputError(f"--centres: COUNT = {count:g} must be a whole number, 2 to 10000")
        step = (last - first) / (count - 1)
        centres += [first + i * step for i in range(int(count))]
    if not centres:
        raise InputError("no centre given; use --centre -40, or --centres -5 -100 60")
    return list(dict.fromkeys(check_centre(c) for c in centres))


def _jobs(options: Any, rows: int) -> int | None:
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs = {options.jobs} must be at least 1")
    # Starting processes takes longer than a few rows do.
    return 1 if rows < 8 else options.jobs


def _row_line(row: dict[str, Any]) -> str:
    radius = lower = ratio = "-"
    if row.get("lower") is not None:
        lower = rounded_down(row["lower"])
    if row["radius"] is not None:
        radius = rounded_up(row["radius"])
        ratio = f"{100 * (1 + row['radius'] / row['centre']):.2f} %"
    return (
        f"{row['centre']:>10.6g}  {row['method']:<10} {radius:>10}  {lower:>10}  {ratio:>8}  "
        f"{row['status']:<9}  {row['seconds']:.2f}"
    )


def _size(plant: UncertainPlant) -> str:
    n, m = plant.shape
    return f"{len(plant.vertices)} vertices, {n} states, {m} input{'s' if m > 1 else ''}"


def design_command(options: Any) -> int:
    """Design a law for a disk, prove it, and save it."""
    plant = _plant(options.spec)
    region = Disk(*options.disk)
    method: Method = options.method
    if options.right_hand_sides:
        if method != "scheduled":
            raise InputError(f"--right-hand-sides belongs to the method scheduled, not {method}")
        method = Scheduled(right_hand_sides=True)
    _check_targets(options.output and options.output / FILE_NAME, options.json)
    design = place(plant, region, method)
    print(f"proved: {design.method} keeps all poles of {plant.name!r} in {region} for every alpha")
    if not region.stable:
        print("note: this disk reaches into the right half-plane; it does not imply stability")
    gains = _gains(design.law, len(plant.vertices))
    summary = {
        "plant": plant_summary(plant),
        "region": {"centre": region.centre, "radius": region.radius},
        "method": design.method,
        "status": "proved",
        "gains": gains,
    }
    for label, gain in gains.items():
        print(f"  {label} = {_matrix(gain)}")
    if options.output is not None:
        print(f"saved: {design.save(options.output)}")
    if options.json is not None:
        _write_json(options.json, summary)
    return PROVED


def _gains(law: Any, N: int) -> dict[str, Any]:
    if isinstance(law, FixedGain):
        return {"K": law.K.tolist()}
    corner = [[float(i == j) for i in range(N)] for j in range(N)]
    return {f"K at vertex {j + 1}": law.gain(alpha).tolist() for j, alpha in enumerate(corner)}


def _matrix(rows: list[list[float]]) -> str:
    return "[" + "; ".join(" ".join(f"{e:.6g}" for e in row) for row in rows) + "]"


def check_command(options: Any) -> int:
    """Prove a design file afresh, in exact arithmetic."""
    answer = check(options.file)
    print(f"{options.file}: {answer}")
    difference = None
    if options.spec is None:
        print("note: about the vertices in the file; --spec SPEC compares them, and the parameter")
        print("ranges that alpha is computed from, with a spec")
    else:
        difference = _difference(options.file, load(options.spec))
    if options.json is not None:
        alpha = None if answer.alpha is None else [str(a) for a in answer.alpha]
        document = {
            "file": str(options.file),
            "answer": answer.answer,
            "reason": answer.reason,
            "alpha": alpha,
            "differs from the spec": difference,
        }
        _write_json(options.json, document)
    if difference is not None:
        print(f"{options.file}: but NOT about {options.spec}: {difference}")
        return NOT_PROVED
    return PROVED if answer.proved else NOT_PROVED


def _difference(path: Path, plant: UncertainPlant) -> str | None:
    """Say how a design's plant differs from a spec's, None where it does not."""
    found = Design.load(path, allow_unproved=True).plant
    if found.digest != plant.digest:
        return _first_difference(found, plant)
    ours, theirs = (
        [(p.name, p.low, p.high, p.through) for p in each.parameters] for each in (found, plant)
    )
    return None if ours == theirs else "other parameter ranges"


def _first_difference(found: UncertainPlant, plant: UncertainPlant) -> str:
    if (len(found.vertices), found.shape) != (len(plant.vertices), plant.shape):
        return "other vertices: their number or their shapes differ"
    for mine, theirs in zip(found.vertices, plant.vertices, strict=True):
        for letter in "AB":
            rows = zip(
                getattr(mine, f"exact_{letter}"), getattr(theirs, f"exact_{letter}"), strict=True
            )
            for i, (row, other) in enumerate(rows):
                for j, (a, b) in enumerate(zip(row, other, strict=True)):
                    if a != b:
                        place = f"{theirs.name}: {letter}[{i + 1}][{j + 1}]"
                        return f"other vertices: {place} = {float(a):.9g}, spec {float(b):.9g}"
    return "other vertices"


def paper_command(options: Any) -> int:
    """Reproduce Leite & Peres (2005): figures 3 to 6 and a report."""
    from polefence.suspension import paper, paper_report

    folder = make_folder(options.output)
    progress = Progress(paper.total_rows())
    with processes(_jobs(options, paper.total_rows())) as executor, progress:
        results = paper.reproduce(folder, options.resume, executor, progress.step)
    paths = paper_report.write(results, folder)
    for row in results["radii"]:
        print(
            f"{row['family']:<11} {row['method']:<10} published {row['published']:<5g} "
            f"{row['status']} {rounded_up(row['radius']) if row['radius'] else '-'}"
        )
    print(f"written: {folder / 'report.md'}, with {len(paths) - 1} files beside it")
    rows = [row for sweep_rows in results["limits"].values() for row in sweep_rows]
    rows += [*results["radii"], *results["slow centres"]]
    return PROVED if all(row["status"] == "proved" for row in rows) else NOT_PROVED


def example_command(options: Any) -> int:
    """Print a spec that ships with polefence, to copy and edit."""
    if options.name is None:
        for name, text in SPECS.items():
            print(f"{name:<24} {text}")
        print("copy one: polefence example quarter-car-physical > car.toml")
    else:
        print(spec_text(options.name), end="")
    return PROVED


def _write_json(path: Path, document: dict[str, Any]) -> None:
    make_folder(path.parent)
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


class Progress:
    """Counts finished rows on stderr, only where that is a terminal."""

    def __init__(self, total: int) -> None:
        self.total, self.done = total, 0
        self.visible = sys.stderr.isatty()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self.visible and self.done:
            print(file=sys.stderr)

    def step(self, row: Limit) -> None:
        """Show that a row is finished."""
        self.done += 1
        if self.visible:
            line = f"{self.done}/{self.total} centre {row.centre:g} {row.method}: {row.status}"
            print(f"\r{line:<60}", end="", file=sys.stderr, flush=True)
