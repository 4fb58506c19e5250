"""``polefence simulate``: signals over time, and where the guarantee does not hold."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, ParameterValueError, shown, suggest
from polefence.base.progress import counted
from polefence.certify.margins import estimation_error, parameter_rate
from polefence.cli.laws import (
    Named,
    at_samples_of,
    distinct,
    law_of,
    of_design,
    read_law,
)
from polefence.cli.options import result_arguments
from polefence.cli.output import (
    PROVED,
    check_results,
    saved,
    write_figure,
    write_json,
)
from polefence.cli.subjects import Subject, read_subject
from polefence.cli.terminal import say
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances, split
from polefence.plant.system import Array
from polefence.search.rows import plant_summary

if TYPE_CHECKING:  # imported where used: with scipy behind them
    from polefence.plant.cars import Car
    from polefence.response.columns import Table
    from polefence.response.discrete import Sampling
    from polefence.show.plots import Panel
    from polefence.vehicle.driving.drive import Run, Setup
    from polefence.vehicle.excitation import Excitation
    from polefence.vehicle.roads import Road

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
SET = re.compile(rf"(?P<name>\w+)=(?P<value>{NUMBER})")
JUMP = re.compile(rf"(?P<name>\w+)=(?P<value>{NUMBER})@(?P<begin>{NUMBER})")
DRIFT = re.compile(rf"{JUMP.pattern}\.\.(?P<end>{NUMBER})")
STEPS = 1000  # of a response at least

# What most drives are looked at for: the first signal whose name has one of these words in it.
OFTEN = (
    ("driver acceleration", "sprung-mass acceleration", "acceleration"),
    ("suspension deflection",),
    ("tyre force",),
)
DEMANDED, ESTIMATED = " demanded", " estimated"  # drawn into the panel of what they are of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `simulate`."""
    parser.add_argument(
        "subject", metavar="DESIGN|SPEC", help="a design, with its law; or a TOML spec"
    )
    parser.add_argument(
        "--law",
        action="append",
        default=[],
        metavar="LAW",
        help="passive, skyhook, lqr, a design, or a gain as for analyse; repeat for more, beside "
        "that of DESIGN; default for SPEC: passive",
    )
    add_excitation_arguments(parser)
    add_car_arguments(parser)
    parser.add_argument("--signals", metavar="NAMES", help='which to draw: "NAME, NAME", or all')
    result_arguments(parser, "write all signals (.csv, .parquet)", "four signals", into="FILE")


def simulate_command(options: Any) -> int:
    """Follow a car on a road, or any plant: signals over time, and where no guarantee holds."""
    from polefence.response.columns import check_format
    from polefence.vehicle.driving.drive import run

    if options.output is not None:
        check_format(options.output)
    check_results(options)
    subject, sampling = read_subject(options.subject), None
    sampled = _at_samples(subject, options)
    designed = None if sampled else law_of(subject)
    if sampled is not None:
        subject, law, sampling = sampled
        options = argparse.Namespace(**{**vars(options), "sampling": sampling.period})
        laws = [law]
    else:
        words = options.law if options.law or designed else ["passive"]
        given = [read_law(subject.plant, word) for word in words]
        laws = distinct([*([designed] if designed else []), *given])
    setup = setup_of(subject, options, laws[0].law, sampling)
    runs = {law.name: run(setup, law.law, _margins(setup, law)) for law in counted(laws, "law")}
    panels = [] if options.plot is None else picked(panels_of(setup, runs), options.signals)
    summaries = [summary_of(law, runs[law.name]) for law in laws]
    _write(setup, runs, panels, summaries, options)
    say(_head(setup))
    for summary in summaries:
        say("", *text_of(summary))
    _require_end(runs)
    return PROVED


def _at_samples(subject: Subject, options: Any) -> tuple[Subject, Named, Sampling] | None:
    """Return plant, law and sampling of a design at a sample time, subject or --law; else None.

    The plant is in continuous time then, with the states that the law's computer keeps.

    Raises
    ------
    InputError
        If there are other laws besides, or the options have another period.
    """
    from polefence.certify.running import running

    plant, read = subject.plant, subject.design
    words = [*([] if read is None else [options.subject]), *options.law]
    designs = [at_samples_of(plant, word) for word in options.law]
    if read is not None and read.plant.sampling is not None:
        plant, designs = read.plant.sampling.plant, [read, *designs]
    design = next(filter(None, designs), None)
    if design is None:
        return None
    if len(words) > 1:
        raise InputError(
            "--law: a design at a sample time is simulated alone, with the states that its "
            "computer keeps; leave out the other laws"
        )
    run, named = running(plant, design), of_design(plant, design, Path(words[0]))
    period = run.sampling.period
    if options.sampling not in (None, period):
        raise InputError(f"--sampling: the design has {period:g} s; leave it out")
    law = replace(named, law=run.law, judged=lambda: (None, named.proved))
    return replace(subject, plant=run.plant), law, run.sampling


def _require_end(runs: Mapping[str, Run]) -> None:
    """Reject a simulation that diverged."""
    lost = {name: run.lost.first for name, run in runs.items() if run.lost is not None}
    if lost:
        when = ", ".join(f"{name!r} at {first:.4g} s" for name, first in lost.items())
        raise NotProvedError(
            f"not simulated to the end: the loop diverges under {when}; later values do not hold"
        )


def _margins(setup: Setup, law: Named) -> Any:
    """Return the proved margins for moving and wrongly known parameters, where these occur."""
    if setup.still or law.design is None:
        return None
    return (*estimation_error(law.design), *parameter_rate(law.design), law.design)


def _write(
    setup: Setup,
    runs: Mapping[str, Run],
    panels: Sequence[Panel],
    summaries: list[dict[str, Any]],
    options: Any,
) -> None:
    """Write all files, before anything is printed: a reader may close the output early."""
    if options.output is not None:
        from polefence.response.columns import write_table

        write_table(options.output, table_of(setup, runs))
        saved(options.output)
    if options.plot is not None:
        from polefence.show.plots import signals_figure

        one = next(iter(runs.values())) if len(runs) == 1 else None
        outside = None if one is None or one.covered is None else ~one.covered
        title = f"{setup.plant.name}: {setup.excitation.name}"
        write_figure(options.plot, signals_figure(setup.time, panels, title, outside))
    if options.json is not None:
        write_json(
            options.json,
            {
                "plant": plant_summary(setup.plant),
                "excitation": setup.excitation.name,
                "road": setup.excitation.road,
                "speed": options.speed,
                "duration": float(setup.time[-1]),
                "step": setup.step,
                "parameters": _starting(setup),
                "laws": summaries,
            },
        )


def _starting(setup: Setup) -> dict[str, float]:
    """Return the parameters, or the weights of the vertices, at time 0."""
    values = setup.trajectories.at(np.zeros(1))[0, 0]
    return dict(zip(setup.trajectories.space.names, values.tolist(), strict=True))


def _head(setup: Setup) -> str:
    space = setup.trajectories.space
    values = zip(_starting(setup).items(), space.units, strict=True)
    shown = ", ".join(f"{name} = {value:.6g} {unit}".rstrip() for (name, value), unit in values)
    moving = "" if setup.trajectories.constant else " at first"
    return (
        f"{setup.plant.name}: {setup.excitation.name}, {setup.time[-1]:g} s "
        f"in steps of {setup.step:g} s; {shown}{moving}"
    )


def add_excitation_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare roads, other excitations, and time."""
    road = parser.add_argument_group("a road, under a vehicle").add_mutually_exclusive_group()
    road.add_argument("--road", metavar="CLASS", help="random, of class A to H of ISO 8608")
    road.add_argument(
        "--bump",
        type=float,
        nargs=2,
        metavar=("HEIGHT", "LENGTH"),
        help="a cosine bump, or a hill [m]",
    )
    road.add_argument(
        "--pothole", type=float, nargs=2, metavar=("DEPTH", "LENGTH"), help="a hole [m]"
    )
    road.add_argument("--kerb", type=float, metavar="HEIGHT", help="a step [m]")
    road.add_argument(
        "--grade",
        type=float,
        nargs=2,
        metavar=("SLOPE", "LENGTH"),
        help="up, or down, from one level to another; 0.05 is 5 %% [m]",
    )
    road.add_argument(
        "--profile", type=Path, metavar="FILE", help="measured: CSV of distance and height [m]"
    )
    parser.add_argument("--speed", type=float, metavar="V", help="on a road [m/s]")
    parser.add_argument("--seed", type=int, metavar="N", help="of a random road; default: 0")
    other = parser.add_argument_group("what moves any plant; all of it adds up")
    for name, metavar, text in (
        ("--step-in", "NAME=SIZE", "a step of a disturbance at time 0"),
        ("--impulse-in", "NAME=SIZE", "an impulse of a disturbance at time 0 [its unit times s]"),
        ("--initial", "NAME=VALUE", "a state at time 0; the others are zero"),
    ):
        other.add_argument(name, action="append", default=[], metavar=metavar, help=text)
    other.add_argument(
        "--input",
        type=Path,
        metavar="FILE",
        help="recorded: CSV of time [s] and disturbances, named in its first row",
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="T",
        help="[s]; default: 10 on a random road, 3 over an obstacle or more, all of a file, else "
        "ten of the first law's slowest time constants",
    )
    parser.add_argument(
        "--step",
        type=float,
        metavar="H",
        help="between instants [s]; default: 0.001 or less; without a road a thousandth of the "
        "duration, or less",
    )


def add_car_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare parameters and hardware."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter (m1=300); default: the middle of its interval",
    )
    parser.add_argument(
        "--jump",
        action="append",
        default=[],
        metavar="NAME=VALUE@TIME",
        help="it has this value from a time on [s] (m1=340@5)",
    )
    parser.add_argument(
        "--drift",
        action="append",
        default=[],
        metavar="NAME=VALUE@BEGIN..END",
        help="it goes to this value in a straight line (beta=10@2..8)",
    )
    parser.add_argument(
        "--outside", action="store_true", help="drive on where a parameter leaves its interval"
    )
    parser.add_argument(
        "--estimate",
        action="store_true",
        help="schedule the law on parameters that recursive least squares estimate along the way",
    )
    for name, metavar, text in (
        ("--sampling", "TS", "the controller samples at this period [s] and holds"),
        ("--bandwidth", "HZ", "of the actuator [Hz]; default: no lag"),
        ("--force-limit", "N", "of the actuator [N]; default: none"),
        ("--force-rate", "N_S", "how fast the force may move [N/s]; default: at once"),
        ("--travel-limit", "M", "bump stops at this deflection, either way [m]; default: none"),
    ):
        parser.add_argument(name, type=float, metavar=metavar, help=text)


def setup_of(subject: Subject, options: Any, law: Any, sampling: Sampling | None = None) -> Setup:
    """Return the simulation that the options describe.

    Parameters
    ----------
    law : law
        Its loop gives duration and step where the options do not.
    sampling : Sampling, optional
        Of the law's design.

    Raises
    ------
    InputError
        Naming the option that cannot be used.
    """
    from polefence.response.discrete import Sampling
    from polefence.vehicle.driving.drive import Setup
    from polefence.vehicle.driving.parts import Actuator, BumpStops, Estimated, Hardware

    stops = None
    if options.travel_limit is not None:
        stops = BumpStops(options.travel_limit, options.travel_limit)
    setup = Setup(
        subject.plant,
        _excitation(subject, options, law),
        _parameters(subject.plant, options),
        options.outside,
        Hardware(
            Estimated() if options.estimate else None,
            sampling if sampling or options.sampling is None else Sampling(options.sampling),
            Actuator(options.bandwidth, options.force_limit, options.force_rate),
            stops,
            dampers=subject.dampers,
        ),
        subject.car,
    )
    try:
        setup.trajectories.check(setup.time, options.outside)
    except ParameterValueError as error:
        raise ParameterValueError(str(error).replace("outside=True", "--outside")) from error
    return setup


def _excitation(subject: Subject, options: Any, law: Any) -> Excitation:
    """Return what moves the plant."""
    from polefence.vehicle import excitation

    plant, car = subject.plant, subject.car
    roads = [
        getattr(options, key) for key in ("road", "bump", "pothole", "kerb", "grade", "profile")
    ]
    others = {key: getattr(options, key) for key in ("step_in", "impulse_in", "initial")}
    if any(road is not None for road in roads):
        turns = _manoeuvres(car, options)
        subject.require_road(
            " (of a design name the spec, and the design as --law), or use --step-in, "
            "--impulse-in, --initial or --input"
        )
        if options.speed is None:
            raise InputError("--speed is missing: a road needs it [m/s]")
        road, duration = _road(options)
        step = _road_step(plant, options, law)
        if car is not None:
            wheels = _on_wheels(plant, car, road, duration, options, step)
            return _also(plant, wheels, turns)
        return excitation.on_road(plant, road, options.speed, step, duration)
    if not any(others.values()) and options.input is None:
        raise InputError(
            "nothing moves the plant: give --step-in, --impulse-in, --initial or --input, or for a "
            "vehicle a road such as --pothole 0.05 0.4 --speed 10"
        )
    for key in ("speed", "seed"):
        if getattr(options, key) is not None:
            raise InputError(f"--{key} belongs to a road; leave it out")
    if options.input is not None:
        if any(others.values()) or options.duration is not None:
            raise InputError("--input says what moves the plant, and how long; leave the rest out")
        return excitation.recorded(plant, options.input, options.step)
    duration, step = _time(plant, options, law)
    steps, impulses, start = (_sizes(texts, key) for key, texts in others.items())
    return excitation.excited(plant, duration, step, steps, impulses, start)


def _manoeuvres(car: Car | None, options: Any) -> dict[str, float]:
    """Return sizes of braking and cornering, which alone may be added to a car's road."""
    known = [] if car is None else [split(label)[0] for label in car.manoeuvres]
    if options.impulse_in or options.initial or options.input or (options.step_in and not known):
        of_car = options.step_in and car is not None
        remedy = " (--step-in braking=3 needs the height of car.body)" if of_car else ""
        raise InputError(f"a road is all that moves a car; leave out the other excitation{remedy}")
    sizes = _sizes(options.step_in, "step_in")
    for name in sizes:
        if name not in known:
            raise InputError(
                f"--step-in {name!r}: beside a road a car has {' and '.join(known)} alone"
            )
    return sizes


def _also(plant: UncertainPlant, moved: Excitation, sizes: Mapping[str, float]) -> Excitation:
    """Return an excitation with steps of disturbances beside it."""
    names = [disturbance.name for disturbance in disturbances(plant)]
    w = np.array(moved.w)
    for name, size in sizes.items():
        w[:, names.index(name)] += size
    words = "".join(f", {name} {size:g} m/s2" for name, size in sizes.items())
    return replace(moved, name=moved.name + words, w=w)


def _on_wheels(
    plant: UncertainPlant,
    car: Car,
    road: Road,
    duration: float | None,
    options: Any,
    step: float,
) -> Excitation:
    """Return a road under all wheels; left and right of a random road differ in short waves."""
    from polefence.plant.tracks import SHARE, STATE
    from polefence.vehicle.excitation import on_wheels
    from polefence.vehicle.roads import both_sides, random_road

    if any(state.startswith(STATE) for state in plant.states):
        raise InputError(
            f"{options.subject}: road.tracks: a drive has the delays and both sides in its road; "
            "take [road.tracks] out of the spec that is driven"
        )
    across = [float(y) for _, y in car.places.values()]
    wide, pair = max(across) - min(across), (road, road)
    if wide and options.road is not None:
        other = random_road(options.road, road.length, (options.seed or 0) + 1)
        pair = both_sides(road, other, float(SHARE) * wide)
    return on_wheels(plant, car.places, pair, options.speed, step, duration)


def _sizes(texts: list[str], key: str) -> dict[str, float]:
    """Read NAME=SIZE; names of signals may contain blanks."""
    option, sizes = f"--{key.replace('_', '-')}", dict[str, float]()
    for text in texts:
        name, equal, value = text.rpartition("=")
        if not equal or not re.fullmatch(NUMBER, value.strip()):
            raise InputError(f"{option} {text!r}; write NAME=SIZE, as in {option} 'gust=1.5'")
        _once(sizes, name := split(name)[0], option)
        sizes[name] = float(value)
    return sizes


def _time(plant: UncertainPlant, options: Any, law: Any) -> tuple[float, float]:
    """Return duration and step [s]; by default from the loop at the middle of the family."""
    from polefence.response.closed import close
    from polefence.response.grid import longest_step
    from polefence.response.stationary import growth
    from polefence.response.weighting import positive
    from polefence.vehicle.reference_laws import nominal

    loops = close(plant, law, nominal(plant), disturbed=False)
    duration, step = options.duration, options.step
    if duration is None:
        slowest = -float(growth(loops.poles(), loops.step).max())
        if slowest <= 0:
            raise InputError("--duration is missing: the response does not decay")
        duration = 10 / slowest  # ten time constants
    duration = positive(duration, "--duration [s]")
    if step is None:
        if loops.step:
            return duration, loops.step
        if options.sampling is not None:
            return duration, _step(options, duration / STEPS)
        # a quarter of the longest step that keeps a response exact enough, for the whole family
        step = duration / max(STEPS, math.ceil(4 * duration / longest_step(loops)))
    return duration, positive(step, "--step [s]")


def _road(options: Any) -> tuple[Road, float | None]:
    """Return a road that is long enough, and the duration; None for a measured road's length."""
    from polefence.response.weighting import positive
    from polefence.vehicle import roads

    speed = positive(options.speed, "--speed [m/s]")
    if options.seed is not None and options.road is None:
        raise InputError("--seed belongs to --road, whose roads are random")
    duration = options.duration
    if duration is not None:
        duration = positive(duration, "--duration [s]")
    if options.profile is not None:
        return roads.measured_road(options.profile), duration
    if options.road is not None:
        duration = duration or roads.SECONDS
        length = roads.length_of(speed, duration)
        return roads.random_road(options.road, length, options.seed or 0), duration
    _, extent = options.bump or options.pothole or options.grade or (0.0, 0.0)
    duration = duration or roads.seconds_over(extent, speed)
    level = roads.level_of(speed, duration)
    if options.bump is not None:
        return roads.bump(*options.bump, **level), duration
    if options.pothole is not None:
        return roads.pothole(*options.pothole, **level), duration
    if options.grade is not None:
        return roads.grade(*options.grade, **level), duration
    return roads.kerb(options.kerb, **level), duration


def _road_step(plant: UncertainPlant, options: Any, law: Any) -> float:
    """Return the step on a road [s]: shorter where the loop has poles that are too fast for it."""
    from polefence.response.closed import close
    from polefence.response.grid import longest_step
    from polefence.vehicle.reference_laws import nominal

    step = _step(options)
    if options.step is not None or options.sampling is not None or plant.sample_time is not None:
        return step
    longest = longest_step(close(plant, law, nominal(plant), disturbed=False))
    return step if step <= longest else longest / 2  # other parameters may have faster ones


def _step(options: Any, longest: float = math.inf) -> float:
    """Return the step of a drive [s], at most ``longest``."""
    from polefence.response.weighting import positive
    from polefence.vehicle.roads import LONGEST_STEP

    if options.step is not None:
        return positive(options.step, "--step [s]")
    if options.sampling is None:
        return LONGEST_STEP
    # so that the controller's period is a multiple of the step
    period = positive(options.sampling, "--sampling [s]")
    longest = min(longest, LONGEST_STEP)
    return period / max(1, math.ceil(period / longest * (1 - 1e-9)))


def _parameters(plant: UncertainPlant, options: Any) -> Any:
    """Return values, jumps and ramps by name; weights alpha for a plant without parameters."""
    from polefence.vehicle.driving.parts import Jump, Ramp
    from polefence.vehicle.driving.trajectories import Space

    space, given = Space(plant), dict[str, Any]()
    for text in options.set:
        match = _read(SET, text, "--set", "NAME=VALUE, as in m1=300", space.names)
        _once(given, match["name"], "--set")
        given[match["name"]] = float(match["value"])
    changes = dict[str, Any]()
    if (options.jump or options.drift) and not plant.parameters:
        raise InputError(f"{plant.name} has no parameters that could move; give it some")
    middle = {p.name: float(p.low + p.high) / 2 for p in plant.parameters}
    start = middle | given
    for text in options.jump:
        match = _read(JUMP, text, "--jump", "NAME=VALUE@TIME, as in m1=340@5", space.names)
        _once(changes, name := match["name"], "--jump or --drift")
        changes[name] = Jump(float(match["begin"]), start[name], float(match["value"]))
    for text in options.drift:
        match = _read(
            DRIFT, text, "--drift", "NAME=VALUE@BEGIN..END, as in beta=10@2..8", space.names
        )
        _once(changes, name := match["name"], "--jump or --drift")
        begin, end = float(match["begin"]), float(match["end"])
        changes[name] = Ramp(start[name], float(match["value"]), begin, end)
    if plant.parameters:
        return start | changes
    if not given:
        return None
    weights = [given.get(name, 0.0) for name in space.names]
    if min(weights) < 0 or abs(sum(weights) - 1) > 1e-9:
        raise InputError(
            f"--set: the weights {', '.join(space.names)} must be zero or more and sum to one; "
            f"they sum to {sum(weights):g}"
        )
    return weights


def _read(
    pattern: re.Pattern[str], text: str, option: str, form: str, names: tuple[str, ...]
) -> re.Match[str]:
    match = pattern.fullmatch(text.replace(" ", ""))
    if match is None:
        raise InputError(f"{option} {text!r}; write {form}")
    if match["name"] not in names:
        name = match["name"]
        raise InputError(f"{option} {text!r}: no parameter {name!r}; {suggest(name, names)}")
    return match


def _once(known: dict[str, Any], name: str, option: str) -> None:
    if name in known:
        raise InputError(f"{option}: {name} is given twice; give it once")


def table_of(setup: Setup, runs: Mapping[str, Run]) -> Table:
    """Return time, disturbances and all signals; with several laws their names come first."""
    from polefence.response.columns import Table

    moved = setup.excitation
    labels, columns = ["time [s]"], [setup.time]
    if moved.height is not None:
        labels.append("road height [m]")
        columns.append(moved.height)
    taken = {signal.label for signal in setup.plant.signals}
    for disturbance, values in zip(disturbances(setup.plant), moved.samples.T, strict=True):
        labels.append(
            f"disturbance {disturbance.label}" if disturbance.label in taken else disturbance.label
        )
        columns.append(values)
    for name, run in runs.items():
        before = f"{name}: " if len(runs) > 1 else ""
        for signal, unit, values in run.columns:
            labels.append(before + _label(signal, unit))
            columns.append(values)
    return Table(tuple(labels), np.stack(columns, axis=1))


def panels_of(setup: Setup, runs: Mapping[str, Run]) -> list[Panel]:
    """Return panels for excitation, signals and moving parameters; all laws share a panel."""
    from polefence.show.plots import BESIDE, Panel
    from polefence.vehicle.driving.drive import static_load

    moved, curves = setup.excitation, dict[str, dict[str, Array]]()
    if moved.height is not None:
        curves["road height [m]"] = {"": moved.height}
    else:
        pairs = zip(disturbances(setup.plant), moved.samples.T, strict=True)
        curves |= {source.label: {"": values} for source, values in pairs if values.any()}
    for law, run in runs.items():
        for name, unit, values in run.columns:
            of = name.removesuffix(DEMANDED).removesuffix(ESTIMATED)
            common = name in setup.trajectories.space.names
            if setup.hardware.learns and (common or name.endswith(ESTIMATED)):
                of = f"{of}, true and estimated"
            wheel = _wheel_of(setup, of)
            if wheel:
                of = of.removeprefix(f"{wheel} ")
            panel = curves.setdefault(_label(of, unit), {})
            curve = f"{law}, {wheel}" if wheel and len(runs) > 1 else wheel or law
            if name.endswith(DEMANDED):
                panel[curve + BESIDE] = values
            else:  # a parameter is the same for all laws, only its estimates are not
                panel["" if common else curve] = values
    floors = dict[str, dict[str, Array]]()
    for name, load in static_load(setup).items():
        wheel = _wheel_of(setup, name)
        label = _label(name.removeprefix(f"{wheel} "), "N")
        floors.setdefault(label, {})[f"{wheel} tyre off the road".strip()] = -load
    return [Panel(label, panel, floors.get(label, {})) for label, panel in curves.items()]


def usual(panels: Sequence[Panel]) -> list[Panel]:
    """Return the four panels that tell most about a drive, and those of moving parameters.

    These are the excitation, an acceleration, a deflection and the tyre's force; where the plant
    lacks one, the first of the other signals.
    """
    first, *others = panels
    usual = [
        next((p for word in words for p in others if word in p.label), None) for words in OFTEN
    ]
    chosen = [panel for panel in usual if panel is not None]
    chosen += [panel for panel in others if panel not in chosen][: 3 - len(chosen)]
    return [first, *(p for p in others if p in chosen or "" in p.curves)]


def picked(panels: Sequence[Panel], text: str | None) -> list[Panel]:
    """Return the panels of --signals: "all", or names with commas between.

    Raises
    ------
    InputError
        If no signal has a name.
    """
    if text is None:
        return usual(panels)
    known = {panel.label.split(" [")[0]: panel for panel in panels}
    names = list(known) if text == "all" else [name.strip() for name in text.split(",")]
    for name in names:
        if name not in known:
            raise InputError(f"--signals: no signal {shown(name)}; {suggest(name, known)}")
    return [known[name] for name in names]


def _wheel_of(setup: Setup, name: str) -> str:
    """Return the wheel that a signal of a car belongs to, or ""."""
    names = [] if setup.car is None else [wheel.name for wheel in setup.car.wheels]
    return max((wheel for wheel in names if name.startswith(f"{wheel} ")), key=len, default="")


def summary_of(law: Named, run: Run) -> dict[str, Any]:
    """Return peaks, rms, comfort, and where the guarantee does not hold, as plain data."""
    car = run.setup.car
    return {
        "law": law.name,
        "proved": law.proved,
        "exact": run.setup.exact,
        "signals": [_signal(run.setup.time, *column) for column in run.columns],
        "comfort": _comfort(run),
        **({"comfort at seats": {name: _at_seat(run, name) for name in car.seats}} if car else {}),
        "events": [asdict(event) for event in run.events],
        "notes": list(run.notes),
        "report": run.report(),
    }


def text_of(summary: Mapping[str, Any]) -> list[str]:
    """Return a summary in lines."""
    how = "exact at every instant" if summary["exact"] else "Runge-Kutta of order 4"
    head = f"{summary['law']} ({how})"
    lines = [f"{head:<46}{'peak':>12}{'at [s]':>10}{'rms':>12}"]
    for row in summary["signals"]:
        numbers = f"{_digits(row['peak']):>12}{_digits(row['at']):>10}{_digits(row['rms']):>12}"
        lines.append(f"  {_label(row['signal'], row['unit']):<44}{numbers}")
    lines += [f"  {line}" for line in _comfort_lines(summary["comfort"])]
    for name, comfort in summary.get("comfort at seats", {}).items():
        lines += [f"  {name}: {line}" for line in _comfort_lines(comfort)]
    lines.append(f"  proved of this law: {summary['proved']}")
    return lines + [f"  {line}" for line in summary["report"]]


def _signal(time: Array, name: str, unit: str, values: Array) -> dict[str, Any]:
    """Return the signed peak, its time and the rms; null if the loop diverged."""
    row = {"signal": name, "unit": unit, "peak": None, "at": None, "rms": None}
    if not np.all(np.isfinite(values)):
        return row
    k = int(np.argmax(np.abs(values)))
    size = float(np.abs(values[k])) or 1.0
    rms = size * math.sqrt(float(np.mean((values / size) ** 2)))
    return row | {"peak": float(values[k]), "at": float(time[k]), "rms": rms}


def _comfort(run: Run) -> dict[str, Any]:
    """Return the ISO 2631-1 comfort of a quarter car; empty for other plants."""
    from polefence.vehicle.vehicle import ride

    known = ride(run.setup.plant)
    return {} if known is None else _felt(run, known.acceleration.name)


def _at_seat(run: Run, name: str) -> dict[str, Any]:
    """Return the ISO 2631-1 comfort of a seat, with the body's rotations."""
    from polefence.vehicle.comfort import ROTATIONS, vibration_total

    felt, car = _felt(run, f"{name} acceleration"), run.setup.car
    turns = [motion for motion in ROTATIONS if car is not None and motion in car.body.motions]
    if "weighted rms" not in felt or not turns:
        return felt
    record = {motion: run.response.of(f"{motion} acceleration")[0] for motion in turns}
    total = vibration_total(run.response.of(f"{name} acceleration")[0], run.setup.step, **record)
    return felt | {"total": float(total), "rotations": turns}


def _felt(run: Run, acceleration: str) -> dict[str, Any]:
    """Return the ISO 2631-1 comfort of an acceleration, or why it is not evaluated."""
    from polefence.vehicle.comfort import comfort, comfort_reading

    try:
        with np.errstate(over="ignore", invalid="ignore"):
            felt = comfort(run.response.of(acceleration)[0], run.setup.step)
        reading = comfort_reading(float(felt.weighted_rms))
    except InputError as error:
        return {"not evaluated": str(error)}
    return {
        "weighted rms": float(felt.weighted_rms),
        "mtvv": float(felt.mtvv),
        "vdv": float(felt.vdv),
        "msdv": float(felt.msdv),
        "reading": list(reading),
        "shocks": bool(felt.shocks),
    }


def _comfort_lines(comfort: Mapping[str, Any]) -> Sequence[str]:
    if not comfort:
        return ()
    if "not evaluated" in comfort:
        return [f"comfort: not evaluated ({comfort['not evaluated']})"]
    shocks = "; shocks: the rms says too little" if comfort["shocks"] else ""
    turns = " and ".join(comfort.get("rotations", ()))
    total = [f"  with {turns}: vibration total value {comfort['total']:.4g} m/s2"] if turns else []
    return (
        f"comfort (ISO 2631-1): weighted rms {comfort['weighted rms']:.4g} m/s2, "
        f"{' to '.join(comfort['reading'])}{shocks}",
        f"  MTVV {comfort['mtvv']:.4g} m/s2, VDV {comfort['vdv']:.4g} m/s1.75, "
        f"MSDV {comfort['msdv']:.4g} m/s1.5",
        *total,
    )


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _digits(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
