"""Parts of several commands: statuses, options, methods, printing, files."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from contextvars import ContextVar
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from polefence.base.errors import InputError
from polefence.base.files import check_document, check_target, make_folder, write_bytes, write_text
from polefence.base.progress import stage
from polefence.base.renamed import with_old_keys
from polefence.certify.checks import decays, in_time_of
from polefence.certify.design import FILE_NAME, Design
from polefence.cli.terminal import aside, say
from polefence.law.laws import Law
from polefence.law.structure import Structure, load_structure
from polefence.lmi.conditions.methods import METHODS, Method, Scheduled, Slack
from polefence.plant.exact import ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states as states_of_a_law
from polefence.plant.tracks import own_states
from polefence.proof.motion import motion_text
from polefence.proof.text import digits_down, digits_up, exactly, milliseconds_text, plural
from polefence.region.regions import Region, Sector, VerticalStrip
from polefence.region.z_plane import annulus_kept, share_kept
from polefence.requirements.text import parse_names

PROVED, NOT_PROVED = 0, 1

# Poles computed in doubles may lie outside by so much of the region's size.
ROUNDING = 1e-6
TOO_LARGE = (
    "note: computed in doubles, this gain does NOT keep the poles there: it is too large; "
    "ask for a region that bounds the poles' speed, such as a disk"
)

STANDARD = Path("-")  # as a file: standard output
MOST_GAINS = 8  # vertices whose gains are printed one by one
_standard: ContextVar[TextIO | None] = ContextVar("standard output", default=None)
_saved: ContextVar[list[str] | None] = ContextVar("files that were written", default=None)

OPTIONS = ("degree", "elevation", "on")
STRUCTURE = ("measured", "schedule", "degree", "order", "largest_gain")


@contextmanager
def streams(options: Any) -> Iterator[None]:
    """Keep standard output for the JSON of ``--json -``, text going to stderr; drop it if quiet.

    Files that were written are named at the end.
    """
    token, names = _standard.set(sys.stdout), list[str]()
    listed = _saved.set(names)
    with ExitStack() as stack:
        if getattr(options, "quiet", False):
            nowhere = stack.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
            stack.enter_context(redirect_stdout(nowhere))
        elif getattr(options, "json", None) == STANDARD:
            stack.enter_context(redirect_stdout(sys.stderr))
        try:
            yield
        finally:
            _standard.reset(token)
            _saved.reset(listed)
            say(*(f"saved: {name}" for name in names))


def saved(*paths: object) -> None:
    """Have files that were written named when the command has said all else."""
    names = _saved.get()
    if names is not None:
        names += [name for name in map(str, paths) if name not in names]


def rows_file(options: Any) -> Path | None:
    """Return the file that rows are kept in as they come, None where there is none."""
    path: Path | None = options.json
    if options.resume and path in (None, STANDARD):
        raise InputError("--resume needs --json FILE, where the finished rows are")
    return None if path == STANDARD else path


def spaced(option: str, values: Sequence[float], most: int) -> list[float]:
    """Return evenly spaced numbers, both ends included, of FROM TO COUNT.

    Raises
    ------
    InputError
        If an end is not finite, or COUNT is no whole number from 2 to ``most``.
    """
    first, last, count = values
    if not (math.isfinite(first) and math.isfinite(last)):
        raise InputError(f"{option}: FROM and TO must be finite numbers")
    if not 2 <= count <= most or count != int(count):
        raise InputError(f"{option}: COUNT = {count:g} must be a whole number, 2 to {most}")
    step = (last - first) / (count - 1)
    return [first + i * step for i in range(int(count))]


def spec_argument(parser: argparse.ArgumentParser) -> None:
    """Declare SPEC."""
    parser.add_argument("spec", metavar="SPEC", help="a TOML spec (see: polefence example)")


def sampling_arguments(parser: argparse.ArgumentParser, what: str = "design for a") -> None:
    """Declare --sample-time and --delay."""
    parser.add_argument(
        "--sample-time",
        type=float,
        metavar="T",
        help=f"{what} computer that runs the law every T seconds, inputs held between",
    )
    parser.add_argument(
        "--delay",
        type=int,
        metavar="K",
        help="an input acts K samples late: 1 where computing the law takes up to a sample; "
        "default: 0",
    )


def at_samples(plant: UncertainPlant, options: Any) -> UncertainPlant:
    """Return the plant as the law sees it: its samples, where the options ask for these."""
    from polefence.response.samples import at_sample_time

    if options.sample_time is None:
        if options.delay is not None:
            raise InputError("--delay counts samples: give --sample-time too")
        return plant
    try:
        return at_sample_time(plant, options.sample_time, options.delay or 0)
    except InputError as error:
        raise InputError(
            f"{options.spec}: --sample-time {options.sample_time:g}: {error}"
        ) from error


def order_lines(plant: UncertainPlant, structure: Structure | None) -> list[str]:
    """Say that a law has fewer states than were asked for; nothing of any other."""
    order, own = 0 if structure is None else structure.order, states_of_a_law(plant)
    if own >= order:
        return []
    return [
        f"  a law of order {own}: none of order {order} that was found is better by a thousandth"
    ]


def samples_text(plant: UncertainPlant) -> list[str]:
    """Say what the samples of a plant are, that a law was designed for; nothing of any other."""
    own = plant.sampling
    if own is None or plant.sample_time is None:
        return []
    time, late = milliseconds_text(plant.sample_time), ""
    if own.delay:
        late = f", inputs act {plural(own.delay, 'sample')} late"
    return [f"  at samples every {time} ms, not between them; inputs and disturbances held{late}"]


def motion_lines(
    plant: UncertainPlant, region: Region, bounds: bool = False, exact: bool = False
) -> list[str]:
    """Say what holds while parameters move; nothing of a plant whose parameters do not.

    With ``exact`` that it does of exact estimates, where a law is for others too.
    """
    how = motion_text(ranges_of(plant))
    if not how:
        return []
    lines = ["  the poles are for constant parameters"]
    kept = ["the bounds hold"] * bounds
    if decay := _decay_text(plant, region):
        kept.append(f"the loop {decay}")
    if kept:
        estimates = ", of exact estimates," * exact
        return [f"{lines[0]}; with {how}{estimates} {' and '.join(kept)}"]
    return [
        *lines,
        f"note: nothing is proved for {how}; add & half_plane(0) to the region, or ask for bounds",
    ]


def _decay_text(plant: UncertainPlant, region: Region) -> str:
    """Say how fast motions decay in a region; "" where it says nothing of them."""
    found = decays(plant, region)
    if not found:
        return ""
    if plant.sample_time is not None:
        fast = f"decays by {digits_up(min(found))}^k in k samples"
        return fast if min(found) < 1 else "is exponentially stable"
    decay = max(found)
    if decay > 0:
        return f"decays by exp(-{digits_down(decay)} t)"
    if decay < 0:
        return f"grows by no more than exp({digits_up(-decay)} t)"
    return "is exponentially stable"


def sweep_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of a sweep over many rows."""
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="processes; default: one per processor"
    )
    parser.add_argument("--resume", action="store_true", help="keep rows of an interrupted run")


def result_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where a design goes."""
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="write DIR/design.json")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write a summary; -: stdout")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw poles over the family, and the region (.png, .svg, .pdf)",
    )


def check_targets(
    *paths: Path | None, folder: Path | None = None, names: Sequence[str] = ()
) -> None:
    """Refuse results that cannot be written, or that overwrite one another, before any work.

    Parameters
    ----------
    *paths
        Files that the user names.
    folder, names
        Where documents of ours go, and under which names.
    """
    documents = [] if folder is None else [folder / name for name in names]
    for path in documents:
        check_document(path)
    targets = [*documents, *(path for path in paths if path not in (None, STANDARD))]
    for path in targets:
        check_target(path)
    if len({path.absolute() for path in targets}) < len(targets):
        raise InputError(f"{targets[0]}: named for two results; name another file")


def check_results(options: Any) -> None:
    """Refuse places for a design, its summary or its figure, before any work."""
    check_figure(options.plot)
    check_targets(options.json, options.plot, folder=options.output, names=(FILE_NAME,))


def check_figure(path: Path | None) -> None:
    """Refuse a figure of no known format."""
    if path is not None and path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{path}: a figure ends in .png, .svg or .pdf")


def jobs_of(options: Any, rows: int) -> int | None:
    """Return the number of processes for so many rows."""
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs = {options.jobs} must be at least 1")
    # Starting processes takes longer than a few rows do.
    return 1 if rows < 8 else options.jobs


def every_alpha(design: Design, *others: str) -> str:
    """Say for which alpha a design is proved: on a box not for every point of the simplex.

    ``others`` are the domains of what is proved besides.
    """
    box = "box" in (design.certificate.claim().on, *others)
    return "every alpha of the box" if box else "every alpha"


def image_text(plant: UncertainPlant, region: Region, proved: bool = True) -> list[str]:
    """Say what stands in the z-plane for a region that is asked of a plant in discrete time."""
    if plant.sample_time is None or in_time_of(plant, region) == region:
        return []
    sectors = [
        f"; the polygon of {part} is {math.floor(100 * share_kept(part.damping))} % of its image"
        for part in region.parts
        if isinstance(part, Sector)
    ]
    T = float(plant.sample_time)
    strips = [
        f"; the right part of {part} is {math.floor(100 * annulus_kept(part, T))} % of its image"
        for part in region.parts
        if isinstance(part, VerticalStrip)
    ]
    said = "".join((*sectors, *strips))
    lines = [f"  that lies within {region} at T = {exactly(T)} s, z = exp(s T){said}"]
    if sectors and not proved:
        lines.append("  note: so a pole outside the polygon may still have the damping asked")
    if strips and not proved:
        lines.append("  note: so a pole outside that part may still be in the strip asked")
    return lines


def gains_of(law: Law) -> dict[str, Any]:
    """Return the gain, that of each term of a polynomial, or that at each vertex, as plain data."""
    return {name: K.tolist() for name, K in law.named_gains().items()}


def report(design: Design, lines: list[str], summary: Mapping[str, Any], options: Any) -> None:
    """Save a design, its summary and its figure where the options say so; print lines and gains.

    Files first: nobody need read the output to its end.
    """
    from polefence.show.plots import poles_figure, sampled

    cloud, corners = sampled(design)
    gains = gains_of(design.law)
    if options.output is not None:
        saved(design.save(options.output))
    if options.json is not None:
        write_json(options.json, {**summary, "gains": gains, **words_of(design.law)})
    if options.plot is not None:
        figure = poles_figure(
            {design.plant.name: (cloud, corners)},
            design.region,
            discrete=design.plant.sample_time is not None,
        )
        write_figure(options.plot, figure)
    if design.note:
        lines = [*lines, design.note]
    say(*lines, *law_lines(design.law), verdict="proved")


def write_figure(path: Path, figure: Any) -> None:
    """Write a figure in the format that its name asks for."""
    from polefence.show.plots import render

    make_folder(path.parent)
    write_bytes(path, render(figure, path.suffix[1:]))
    saved(path)


def words_of(law: Law) -> dict[str, Any]:
    """Return what the gains of a law stand for, as plain data; nothing where names say it."""
    return {"formula": law.formula, "where": law.definitions} if law.formula else {}


def law_lines(law: Law) -> list[str]:
    """Return a law in lines: its gains, of a polynomial what they are and stand for."""
    gains = gains_of(law)
    if not law.formula or (not law.degree and not law.measured):
        return gain_lines(gains)
    return [f"  {line}" for line in (law.formula, *law.definitions)] + _matrices(gains)


def _matrices(gains: Mapping[str, list[list[float]]]) -> list[str]:
    return [f"  {label} = {matrix_text(K)}" for label, K in gains.items()]


def gain_lines(gains: Mapping[str, list[list[float]]]) -> list[str]:
    """Return gains in lines; of many vertices the least and the greatest entries alone."""
    if len(gains) <= MOST_GAINS:
        return _matrices(gains)
    letter, every = next(iter(gains)).split()[0], np.array(list(gains.values()))
    where = f"  {letter} at {len(gains)} vertices"
    return [
        f"{where}, the least entries = {matrix_text(every.min(axis=0))}",
        f"{where}, the greatest entries = {matrix_text(every.max(axis=0))}",
        "  note: --json FILE has them all",
    ]


def matrix_text(rows: Any) -> str:
    """Print a matrix in a line, its rows separated by semicolons."""
    return "[" + "; ".join(" ".join(f"{e:.6g}" for e in row) for row in rows) + "]"


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write plain data, to standard output where the path is -."""
    text = json.dumps(with_old_keys(document), indent=1, allow_nan=False) + "\n"
    if path == STANDARD:
        stream = _standard.get() or sys.stdout
        with aside():
            stream.write(text)
            stream.flush()
        return
    make_folder(path.parent)
    write_text(path, text)
    saved(path)


@contextmanager
def finished_rows(total: int) -> Iterator[Callable[[str], None]]:
    """Show how many rows of a sweep are finished; takes the words of each as it is."""
    done = count(1)
    with stage(f"0 of {plural(total, 'row')}") as own:
        yield lambda last: own.now(f"{next(done)} of {plural(total, 'row')}, the last {last}")


def method_arguments(
    parser: argparse.ArgumentParser, several: bool = False, auto: bool = False
) -> None:
    """Declare --method, one or several, and its options; ``auto`` for what takes that degree."""
    if several:
        parser.add_argument(
            "--method", action="append", choices=METHODS, help="repeat for more; default: all three"
        )
    else:
        parser.add_argument(
            "--method",
            choices=METHODS,
            help="a law that an LMI gives; default: scheduled, unless the spec or an option asks "
            "for a structure",
        )
    parser.add_argument(
        "--degree",
        type=_degree if auto else int,
        metavar="N|auto" if auto else "N",
        help="scheduled, slack: degree of the Lyapunov matrix in alpha; of a structure: of the law "
        "in the parameters; default: 1" + ("; auto: raised until it is proved" if auto else ""),
    )
    parser.add_argument(
        "--elevation",
        type=int,
        metavar="N",
        help="scheduled, slack: degree of the multiplier; default: 1 for scheduled, 0 for slack",
    )
    parser.add_argument(
        "--on",
        choices=("simplex", "box"),
        help="scheduled, slack: box uses that the parameters are independent; default: simplex",
    )


def _degree(text: str) -> int | str:
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a whole number nor auto") from error


def add_structure_options(parser: argparse.ArgumentParser, degree: bool = True) -> None:
    """Declare the options of a law's structure; without ``degree`` the parser has that already."""
    group = parser.add_argument_group(
        "structure of the law", "each option replaces that key of the spec's [law]"
    )
    group.add_argument(
        "--measured", metavar="NAMES", help="'A, B': states or outputs; default: all states"
    )
    group.add_argument(
        "--schedule", metavar="NAMES", help="parameters in the law; none: one gain; default: all"
    )
    if degree:
        group.add_argument(
            "--degree", type=int, metavar="N", help="of the law in the parameters; default: 1"
        )
    group.add_argument("--order", type=int, metavar="N", help="states of the law's own; default: 0")
    group.add_argument(
        "--largest-gain", type=float, metavar="X", help="largest entry that the law may have"
    )


def structure_of_options(plant: UncertainPlant, options: Any) -> Structure | None:
    """Return the structure that the spec and the options ask for, None where neither does.

    With --method there is none: its laws are of all states. A road's states are measured by no law
    that does not name them.

    Raises
    ------
    InputError
        If an option cannot be used, or the structure does not fit the plant.
    """
    given = {k: v for k in STRUCTURE if (v := getattr(options, k, None)) is not None}
    method = getattr(options, "method", None)
    own = own_states(plant)
    on_road = len(own) < plant.shape[0]
    if method is not None:
        for key in given:
            if key != "degree":
                raise InputError(
                    f"--{key.replace('_', '-')} applies to laws of a structure; leave it out, or "
                    f"--method {method if isinstance(method, str) else method[0]}"
                )
        if on_road:
            raise InputError(
                "--method designs laws of all states, but the states "
                "of the road's tracks cannot be "
                "measured; leave --method out"
            )
        return None
    for key in ("measured", "schedule"):
        if key in given:
            bare = key == "schedule" and given[key].strip() == "none"
            try:
                given[key] = () if bare else parse_names(given[key])
            except InputError as error:
                raise InputError(f"--{key} {error}") from error
    written = load_structure(options.spec)
    if written is None and set(given) <= {"degree"} and not on_road:  # of a law that an LMI gives
        return None
    found = replace(written or Structure(), **given)
    if on_road and found.measured is None:
        found = replace(found, measured=own)
    try:
        found.require_fit(plant)
    except InputError as error:
        raise type(error)(f"{options.spec}: {error}") from error
    return found


def refuse_method_options(options: Any) -> None:
    """Refuse options of methods where a structure is asked for.

    Raises
    ------
    InputError
        Naming the first.
    """
    for key in ("elevation", "on", "budget", "right_hand_sides"):
        if getattr(options, key, None):
            raise InputError(
                f"--{key.replace('_', '-')} applies to laws from an LMI; leave it out, or give "
                "--method"
            )
    if getattr(options, "degree", None) == "auto":
        raise InputError("--degree auto applies to laws from an LMI; give a number")


def method_of(name: str, options: Any) -> Method:
    """Return the method with the options given.

    Raises
    ------
    InputError
        If an option does not belong to the method, or has no such value.
    """
    given = _options_given(options)
    if name == "quadratic" and given:
        raise InputError(f"--{next(iter(given))} belongs to scheduled and slack, not to quadratic")
    if given.get("degree") == "auto":
        return _climbing(name, options, given)
    if getattr(options, "budget", None) is not None:
        raise InputError("--budget belongs to --degree auto")
    if name == "slack":
        return Slack(**given)
    return Scheduled(**given) if given else name


def methods_of(names: list[str], options: Any) -> list[Method]:
    """Return several methods, the options applied to those of them that take some."""
    alone = set(names) == {"quadratic"}
    return [n if n == "quadratic" and not alone else method_of(n, options) for n in names]


def _options_given(options: Any) -> dict[str, Any]:
    return {key: getattr(options, key) for key in OPTIONS if getattr(options, key) is not None}


def _climbing(name: str, options: Any, given: dict[str, Any]) -> Scheduled:
    if name != "scheduled":
        raise InputError(f"--degree auto belongs to the method scheduled, not {name}")
    if "elevation" in given:
        raise InputError("--degree auto chooses the elevation too; leave --elevation out")
    if options.budget is not None:
        if not 0 < options.budget < float("inf"):
            raise InputError(f"--budget = {options.budget:g} must be positive, in seconds")
        given["budget"] = options.budget
    return Scheduled(**given)
