"""The command line: parse, call, print. Exit 0 proved or done, 1 not proved, 2 bad input."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from polefence import __version__
from polefence.conditions.methods import METHODS, Method, Scheduled
from polefence.design import check, place, rounded_up
from polefence.errors import InputError, MissingExtraError, NotProvedError, PolefenceError
from polefence.files import make_folder, write_bytes, write_text
from polefence.law import FixedGain
from polefence.limits import Limit
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load
from polefence.region import Disk, check_centre
from polefence.suspension.quarter_car import SPECS, spec_text
from polefence.sweep import plant_summary, processes, sweep

PROVED, NOT_PROVED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = _parser()
    options = parser.parse_args(_negative_numbers(sys.argv[1:] if arguments is None else arguments))
    try:
        status: int = options.run(options)
        return status
    except NotProvedError as answer:
        print(answer, file=sys.stderr)
        return NOT_PROVED
    except (InputError, MissingExtraError) as error:
        print(f"polefence: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except PolefenceError as error:
        print(f"polefence: {error}", file=sys.stderr)
        return NOT_PROVED
    except KeyboardInterrupt:
        print("polefence: interrupted; finished rows are kept (--resume)", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return PROVED


def _negative_numbers(arguments: Sequence[str]) -> list[str]:
    """Write -4e1 as -40.0: argparse takes plain negative numbers only."""
    plain = []
    for word in arguments:
        try:
            plain.append(
                repr(float(word)) if word.startswith("-") and "e" in word.lower() else word
            )
        except ValueError:
            plain.append(word)
    return plain


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="polefence",
        description="State feedback that keeps every closed-loop pole in a region for all values "
        "of the uncertain parameters, proved in exact arithmetic.",
        epilog="exit status: 0 proved or done, 1 not proved, 2 bad input or usage. "
        "CENTRE is the real coordinate, negative on the left (-40).",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"polefence {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(name: str, run: Callable[[Any], int], text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(run=run)
        return sub

    sub = command("limits", _limits, "Find the smallest proved disk for each centre and method.")
    _spec_argument(sub)
    sub.add_argument(
        "--centre",
        type=float,
        action="append",
        default=[],
        metavar="CENTRE",
        help="real coordinate of the disk's centre; repeat for more",
    )
    sub.add_argument(
        "--centres",
        type=float,
        nargs=3,
        metavar=("FROM", "TO", "COUNT"),
        help="evenly spaced centres, for example -5 -100 60",
    )
    sub.add_argument(
        "--method", action="append", choices=METHODS, help="repeat for more; default: all three"
    )
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the rows, kept up to date")
    sub.add_argument("--plot", type=Path, metavar="FILE", help="draw d/sigma (.png, .svg, .pdf)")
    sub.add_argument("--gain", action="store_true", help="put each row's law into the JSON")
    _sweep_arguments(sub)

    sub = command("design", _design, "Design a law for a disk, prove it, and save it.")
    _spec_argument(sub)
    sub.add_argument("--disk", type=float, nargs=2, required=True, metavar=("CENTRE", "RADIUS"))
    sub.add_argument("--method", choices=METHODS, default="scheduled", help="default: scheduled")
    sub.add_argument(
        "--right-hand-sides",
        action="store_true",
        help="scheduled: keep the right-hand sides of the paper's (15)-(17)",
    )
    sub.add_argument("-o", "--output", type=Path, metavar="DIR", help="write DIR/design.json")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write a summary")

    sub = command("check", _check, "Prove a design file afresh, in exact arithmetic.")
    sub.add_argument("file", type=Path, metavar="FILE", help="design.json, or the folder with it")
    sub.add_argument("--spec", metavar="SPEC", help="also require that it is about this plant")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the answer")

    sub = command("paper", _paper, "Reproduce Leite & Peres (2005): figures 3 to 6 and a report.")
    sub.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("paper-results"),
        metavar="DIR",
        help="default: %(default)s",
    )
    _sweep_arguments(sub)

    sub = command("example", _example, "Print a spec that ships with polefence, to copy and edit.")
    sub.add_argument("name", nargs="?", metavar="NAME", help="without it: list the names")
    return parser


def _spec_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", metavar="SPEC", help="a TOML spec (see: polefence example)")


def _sweep_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--jobs", type=int, metavar="N", help="processes; default: one a processor")
    parser.add_argument("--resume", action="store_true", help="keep rows of an interrupted run")


def _plant(spec: str) -> UncertainPlant:
    """Read a spec for a design: the plant must be controllable."""
    plant = load(spec)
    try:
        plant.require_controllable()
    except InputError as error:
        raise type(error)(f"{spec}: {error}") from error
    return plant


def _limits(options: Any) -> int:
    plant = _plant(options.spec)
    centres = _centres(options)
    methods = list(dict.fromkeys(options.method or METHODS))
    if options.plot is not None and options.plot.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{options.plot}: a figure ends in .png, .svg or .pdf")
    if options.resume and options.json is None:
        raise InputError("--resume needs --json FILE, where the finished rows are")
    for path in (options.json, options.plot):
        if path is not None:
            make_folder(path.parent)
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
    print(f"{'centre':>10}  {'method':<10} {'radius':>10}  {'d/sigma':>8}  {'status':<9}  seconds")
    for row in rows:
        print(_row_line(row))
    if options.plot is not None:
        from polefence.plots import limits_figure, render

        figure = limits_figure({plant.name: rows})
        write_bytes(options.plot, render(figure, options.plot.suffix[1:]))
    return PROVED if all(row["status"] == "proved" for row in rows) else NOT_PROVED


def _centres(options: Any) -> list[float]:
    centres = list(options.centre)
    if options.centres is not None:
        first, last, count = options.centres
        if count != int(count) or not 2 <= count <= 10_000:
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
    radius = ratio = "-"
    if row["radius"] is not None:
        radius = rounded_up(row["radius"])
        ratio = f"{100 * (1 + row['radius'] / row['centre']):.2f} %"
    return (
        f"{row['centre']:>10.6g}  {row['method']:<10} {radius:>10}  {ratio:>8}  "
        f"{row['status']:<9}  {row['seconds']:.2f}"
    )


def _size(plant: UncertainPlant) -> str:
    n, m = plant.shape
    return f"{len(plant.vertices)} vertices, {n} states, {m} input{'s' if m > 1 else ''}"


def _design(options: Any) -> int:
    plant = _plant(options.spec)
    region = Disk(*options.disk)
    method: Method = options.method
    if options.right_hand_sides:
        if method != "scheduled":
            raise InputError(f"--right-hand-sides belongs to the method scheduled, not {method}")
        method = Scheduled(right_hand_sides=True)
    for folder in (options.output, options.json and options.json.parent):
        if folder is not None:
            make_folder(folder)
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


def _check(options: Any) -> int:
    answer = check(options.file)
    if options.spec is not None:
        _require_plant(options.file, load(options.spec))
    print(f"{options.file}: {answer}")
    if options.json is not None:
        alpha = None if answer.alpha is None else [str(a) for a in answer.alpha]
        _write_json(
            options.json,
            {
                "file": str(options.file),
                "answer": answer.answer,
                "reason": answer.reason,
                "alpha": alpha,
            },
        )
    return PROVED if answer.proved else NOT_PROVED


def _require_plant(path: Path, plant: UncertainPlant) -> None:
    from polefence.design import Design

    found = Design.load(path, allow_unproved=True).plant
    if found.digest != plant.digest:
        raise NotProvedError(f"{path}: about another plant than the spec: vertices differ")
    if found.parameters and found.parameters != plant.parameters:
        raise NotProvedError(f"{path}: about other parameter ranges than the spec's")


def _paper(options: Any) -> int:
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


def _example(options: Any) -> int:
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


if __name__ == "__main__":
    sys.exit(main())
