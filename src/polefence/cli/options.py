"""Options that several commands share: declared once, and read."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError
from polefence.certify.checks import example_region
from polefence.cli.output import STANDARD
from polefence.cli.terminal import say
from polefence.law.structure import MOST_STRUCTURES, Structure, load_structure
from polefence.lmi.conditions.methods import METHODS, Method, Scheduled, Slack
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import sensed
from polefence.plant.outputs import states
from polefence.plant.weights import measurable
from polefence.region.regions import Disk, Region
from polefence.region.text import load_region, parse_region
from polefence.requirements.text import RoadSpectrum, parse_names

SIGNAL_METHODS = ("quadratic", "scheduled")


# What is asked about


def spec_argument(parser: argparse.ArgumentParser) -> None:
    """Declare SPEC."""
    parser.add_argument("spec", metavar="SPEC", help="a TOML spec (see: polefence example)")


def design_argument(parser: argparse.ArgumentParser, others: str = "") -> None:
    """Declare DESIGN."""
    parser.add_argument(
        "design",
        type=Path,
        metavar="DESIGN",
        help=f"design.json, or the folder with it{others}",
    )


def sampling_arguments(
    parser: argparse.ArgumentParser, what: str = "design for a", clock: bool = False
) -> None:
    """Declare --sample-time and --delay, and what a clock may be off by."""
    parser.add_argument(
        "--sample-time",
        type=float,
        metavar="T",
        help=f"{what} computer that runs the law every T seconds, inputs held between",
    )
    parser.add_argument(
        "--delay",
        type=float,
        metavar="D",
        help="an input acts D samples late, whole or not: 1 where computing the law takes up to a "
        "sample, 0.5 where half of one; default: 0",
    )
    parser.set_defaults(jitter=None, lost=None)
    if clock:
        parser.add_argument(
            "--jitter",
            type=float,
            metavar="SHARE",
            help="each period may be longer or shorter by this share of T: an rms is bounded for "
            "periods in any order; default: 0",
        )
        parser.add_argument(
            "--lost",
            type=int,
            metavar="K",
            help="up to K samples in a row may be lost, the input held; default: 0",
        )


def at_samples(plant: UncertainPlant, options: Any) -> UncertainPlant:
    """Return the plant at --sample-time, or the plant itself without that option."""
    from polefence.response.samples import at_sample_time

    if options.sample_time is None:
        if options.delay is not None:
            raise InputError("--delay counts samples: give --sample-time too")
        for name in ("jitter", "lost"):
            if getattr(options, name) is not None:
                raise InputError(f"--{name} is of the sample time: give --sample-time too")
        return plant
    clock = {"jitter": options.jitter or 0, "lost": options.lost or 0}
    try:
        return at_sample_time(plant, options.sample_time, options.delay or 0, **clock)
    except InputError as error:
        raise InputError(
            f"{options.spec}: --sample-time {options.sample_time:g}: {error}"
        ) from error


# Regions


def region_arguments(parser: argparse.ArgumentParser, example: str, required: bool = False) -> None:
    """Declare --disk and --region, one or the other; without ``required`` the spec may say it."""
    where = parser.add_mutually_exclusive_group(required=required)
    default = "" if required else "; default: the region that the spec names"
    where.add_argument(
        "--disk",
        type=float,
        nargs=2,
        metavar=("CENTRE", "RADIUS"),
        help=f"the region is this disk{default}",
    )
    where.add_argument("--region", metavar="TEXT", help=f"any region: '{example}'")


def poles_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --region where signals are asked about."""
    parser.add_argument(
        "--region", metavar="TEXT", help="for the poles; default: the spec's, else stability"
    )


def region_of(options: Any) -> Region | None:
    """Return the region of --disk or --region, else the spec's, else None."""
    if getattr(options, "disk", None) is not None:
        return Disk(*options.disk)
    return load_region(options.spec) if options.region is None else parse_region(options.region)


def kind_argument(parser: Any, required: bool = False, instead: str = "") -> None:
    """Declare --of on a parser or a group: which number of a region is the best that there is."""
    parser.add_argument(
        "--of",
        type=lambda word: word.lower().replace("-", "_"),
        choices=("disk", "half_plane", "sector"),
        required=required,
        help=f"{instead}disk: the smallest radius about --centre; half_plane: the largest decay "
        "rate; sector: the largest damping ratio",
    )


def centre_argument(parser: argparse.ArgumentParser, text: str, **more: Any) -> None:
    """Declare --centre."""
    parser.add_argument("--centre", "--center", type=float, metavar="CENTRE", help=text, **more)


def required_region(plant: UncertainPlant, options: Any) -> Region:
    """Return what `region_of` returns, which must not be None.

    Raises
    ------
    InputError
        Naming the ways to give a region.
    """
    region = region_of(options)
    if region is None:
        raise InputError(
            f"{options.spec}: names no region; give --disk CENTRE RADIUS or --region TEXT, or "
            f"write region = '{example_region(plant)}' in the spec"
        )
    return region


# Signals, and the road under a vehicle


def minimise_argument(parser: argparse.ArgumentParser, form: str, otherwise: str = "") -> None:
    """Declare --minimise."""
    parser.add_argument(
        "--minimise",
        metavar="TEXT",
        help=f"{form}; default: the spec's with minimise = true{otherwise}",
    )


def limit_argument(parser: argparse.ArgumentParser, text: str) -> None:
    """Declare --limit."""
    parser.add_argument("--limit", action="append", default=[], metavar="TEXT", help=text)


def road_arguments(
    parser: argparse.ArgumentParser, road: str | None = None, speed: float | None = None
) -> None:
    """Declare --road and --speed, with their defaults; without these the spec's road is meant."""
    parser.add_argument(
        "--road",
        default=road,
        metavar="CLASS",
        help=f"A to H of ISO 8608; default: {road or 'that of the spec'}",
    )
    default = "" if speed is None else f"; default: {speed:g}"
    parser.add_argument(
        "--speed", type=float, default=speed, metavar="V", help=f"over that road [m/s]{default}"
    )


def road_of(options: Any) -> RoadSpectrum | None:
    """Return the road of --road and --speed, None without them."""
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


# Results, and sweeps over many rows


def result_arguments(
    parser: argparse.ArgumentParser,
    output: str = "",
    plot: str = "",
    json: str = "write a summary; -: stdout",
    into: str = "DIR",
) -> None:
    """Declare -o, --json and --plot; -o and --plot only with a text that says what they write."""
    if output:
        parser.add_argument("-o", "--output", type=Path, metavar=into, help=output)
    parser.add_argument("--json", type=Path, metavar="FILE", help=json)
    if plot:
        parser.add_argument(
            "--plot", type=Path, metavar="FILE", help=f"draw {plot} (.png, .svg, .pdf)"
        )


def sweep_arguments(
    parser: argparse.ArgumentParser, resume: str = "keep rows of an interrupted run"
) -> None:
    """Declare --jobs and --resume."""
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="processes; default: one per processor"
    )
    parser.add_argument("--resume", action="store_true", help=resume)


def rows_file(options: Any) -> Path | None:
    """Return the file that rows are kept in as they come, None where there is none."""
    path: Path | None = options.json
    if options.resume and path in (None, STANDARD):
        raise InputError("--resume needs --json FILE, where the finished rows are")
    return None if path == STANDARD else path


def jobs_of(options: Any, rows: int | None = None) -> int | None:
    """Return the number of processes, for this many rows where it is known; None: the default."""
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs = {options.jobs} must be at least 1")
    # Starting processes takes longer than a few rows do.
    few = rows is not None and rows < 8
    jobs: int | None = 1 if few else options.jobs
    return jobs


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


# Methods: laws that an LMI gives


def method_arguments(
    parser: argparse.ArgumentParser,
    methods: Sequence[str] = METHODS,
    several: bool = False,
    auto: bool = False,
    ranges: bool = False,
) -> None:
    """Declare --method and its options, for regions or, of `SIGNAL_METHODS`, for signals.

    ``several`` methods may be named at once; ``auto``: --degree auto raises the degree; ``ranges``:
    --degree may be several.
    """
    signals = tuple(methods) == SIGNAL_METHODS
    default = "scheduled, unless the spec or an option asks for a structure"
    means = "a law that an LMI gives"
    if signals:
        means, default = "how free the law is: quadratic is one gain", "scheduled"
    if several:
        every = "both" if signals else "all three"
        parser.add_argument(
            "--method",
            choices=methods,
            action="append",
            help=f"repeat for more; default: {every}",
        )
    else:
        parser.add_argument("--method", choices=methods, help=f"{means}; default: {default}")
    of = "scheduled" if signals else "scheduled, slack"
    degree = "of W and Z in alpha" if signals else "degree of the Lyapunov matrix in alpha"
    elevation = "of the inequalities; default: 0"
    on = "box, simplex for a plant without parameters"
    if not signals:
        elevation = "degree of the multiplier; default: 1 for scheduled, 0 for slack"
        on = "simplex; box uses that the parameters are independent"
    parser.add_argument(
        "--degree",
        type=_degree if auto else _numbers if ranges else int,
        metavar="N|auto" if auto else "N|N..M" if ranges else "N",
        help=f"{of}: {degree}; of a structure: of the law in the parameters; default: 1"
        + ("; auto: raised until it is proved" if auto else "")
        + ("; 0..2: a row of a table each" if ranges else ""),
    )
    parser.add_argument("--elevation", type=int, metavar="N", help=f"{of}: {elevation}")
    parser.add_argument("--on", choices=("simplex", "box"), help=f"{of}; default: {on}")


def _degree(text: str) -> int | str:
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a whole number nor auto") from error


def _numbers(text: str) -> int | tuple[int, ...]:
    """Return a whole number, or those of a range A..B."""
    first, dots, last = text.partition("..")
    try:
        low, high = int(first), int(last if dots else first)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a whole number nor a range, such as 0..2"
        ) from error
    if not dots:
        return low
    if low > high:
        raise argparse.ArgumentTypeError(f"{text!r} begins above its end; write {high}..{low}")
    if high - low >= MOST_STRUCTURES:
        raise argparse.ArgumentTypeError(
            f"{text!r} is {high - low + 1} numbers; at most {MOST_STRUCTURES} structures are "
            "compared"
        )
    return tuple(range(low, high + 1))


def budget_argument(parser: argparse.ArgumentParser, text: str) -> None:
    """Declare --budget."""
    parser.add_argument("--budget", type=float, metavar="SECONDS", help=text)


def given_options(options: Any, *names: str) -> dict[str, Any]:
    """Return the options that were given, by name: those of a method, unless others are named."""
    names = names or ("degree", "elevation", "on")
    return {key: v for key in names if (v := getattr(options, key, None)) is not None}


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
    given = given_options(options)
    if name == "quadratic" and given:
        raise InputError(f"--{next(iter(given))} belongs to scheduled and slack, not to quadratic")
    if given.get("degree") == "auto":
        return _raised_degree(name, options, given)
    if getattr(options, "budget", None) is not None:
        raise InputError("--budget belongs to --degree auto")
    if name == "slack":
        return Slack(**given)
    return Scheduled(**given) if given else name


def methods_of(names: Sequence[str], read: Callable[[str], Method]) -> list[Method]:
    """Return several methods; beside others quadratic takes none of the options."""
    alone = set(names) == {"quadratic"}
    return [n if n == "quadratic" and not alone else read(n) for n in names]


def signal_method_of(plant: UncertainPlant, name: str, options: Any) -> Method:
    """Return the method for signals: degree 1, elevation 0 and the parameters' box by default."""
    method = method_of(name, options)
    if method == "quadratic":
        return method
    box = "box" if plant.parameters else "simplex"
    return Scheduled(**{"degree": 1, "elevation": 0, "on": box, **given_options(options)})


def _raised_degree(name: str, options: Any, given: dict[str, Any]) -> Scheduled:
    """Return the method whose degree rises until a law is proved."""
    if name != "scheduled":
        raise InputError(f"--degree auto belongs to the method scheduled, not {name}")
    if "elevation" in given:
        raise InputError("--degree auto chooses the elevation too; leave --elevation out")
    if options.budget is not None:
        if not 0 < options.budget < float("inf"):
            raise InputError(f"--budget = {options.budget:g} must be positive, in seconds")
        given["budget"] = options.budget
    return Scheduled(**given)


# The structure of a law


def structure_arguments(parser: argparse.ArgumentParser, ranges: bool = False) -> None:
    """Declare the options of a law's structure; --degree is among the methods' options.

    ``ranges``: several orders and sets of signals may be named.
    """
    group = parser.add_argument_group(
        "structure of the law", "each option replaces that key of the spec's [law]"
    )
    more: dict[str, Any] = {"action": "append"} if ranges else {}
    group.add_argument(
        "--measured",
        metavar="NAMES",
        help="'A, B': states or outputs; default: all states"
        + ("; repeat for a table of such sets" if ranges else ""),
        **more,
    )
    group.add_argument(
        "--schedule", metavar="NAMES", help="parameters in the law; none: one gain; default: all"
    )
    group.add_argument(
        "--order",
        type=_numbers if ranges else int,
        metavar="N|N..M" if ranges else "N",
        help="states of the law's own; default: 0"
        + ("; 0..4: a row of a table each" if ranges else ""),
    )
    group.add_argument(
        "--largest-gain", type=float, metavar="X", help="largest entry that the law may have"
    )


def structure_of(plant: UncertainPlant, options: Any) -> Structure | None:
    """Return the structure that the spec and the options ask for, None where neither does.

    With --method there is none: its laws are of all states. A law measures the states of a road and
    of weights only where they are named. A note says where it measures a signal past its sensor.

    Raises
    ------
    InputError
        If an option cannot be used, or the structure does not fit the plant.
    """
    given = given_options(options, "measured", "schedule", "degree", "order", "largest_gain")
    method = getattr(options, "method", None)
    known = measurable(plant)
    beside = len(known) < plant.shape[0]
    if method is not None:
        for key in given:
            if key != "degree":
                raise InputError(
                    f"--{key.replace('_', '-')} applies to laws of a structure; leave it out, or "
                    f"--method {method if isinstance(method, str) else method[0]}"
                )
        if beside:
            other = next(x.name for x in states(plant) if x.name not in known)
            raise InputError(
                f"--method designs laws of all states, but {other!r} cannot be measured; leave "
                "--method out"
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
    if written is None and set(given) <= {"degree"} and not beside:  # of a law that an LMI gives
        return None
    structure = replace(written or Structure(), **given)
    if beside and structure.measured is None:
        structure = replace(structure, measured=known)
    try:
        structure.require_fit(plant)
    except InputError as error:
        raise type(error)(f"{options.spec}: {error}") from error
    key = "--measured" if "measured" in given else f"{options.spec}: law: measured"
    note_sensors(plant, structure.measured or (), key)
    return structure


def note_sensors(plant: UncertainPlant, measured: Sequence[str], key: str) -> None:
    """Say which of the signals are measured though they have a sensor, and how to measure that."""
    past = sensed(plant, measured)
    if past:
        say(
            f"note: {key} takes {_quoted(past)} without the sensor's bandwidth and noise; write "
            f"{_quoted(past.values())} for what the sensor says"
        )


def _quoted(names: Iterable[str]) -> str:
    return " and ".join(map(repr, names))


# Ranges of signals, for code in fixed point


def range_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --range."""
    parser.add_argument(
        "--range",
        action="append",
        default=[],
        dest="ranges",
        metavar="TEXT",
        help="'suspension deflection = 0.1': for --fixed the signal's largest absolute value, in "
        "its unit; repeat for each",
    )


def ranges_of(options: Any) -> dict[str, float]:
    """Return signals' ranges by their names.

    Raises
    ------
    InputError
        If one is no name with a number.
    """
    ranges = dict[str, float]()
    for text in options.ranges:
        name, equals, value = text.rpartition("=")
        try:
            ranges[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise InputError(
                f"--range {text!r} must be a name and a number, such as --range 'SIGNAL = 0.1'"
            )
    return ranges
