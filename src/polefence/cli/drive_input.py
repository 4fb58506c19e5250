"""Options of `simulate`: roads and other excitation, parameters over time, hardware."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polefence.base.errors import InputError, ParameterValueError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import split

if TYPE_CHECKING:  # imported where used: with scipy behind them
    from polefence.vehicle.excitation import Excitation
    from polefence.vehicle.roads import Road
    from polefence.vehicle.run import Setup

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
SET = re.compile(rf"(?P<name>\w+)=(?P<value>{NUMBER})")
JUMP = re.compile(rf"(?P<name>\w+)=(?P<value>{NUMBER})@(?P<begin>{NUMBER})")
DRIFT = re.compile(rf"{JUMP.pattern}\.\.(?P<end>{NUMBER})")
LONGEST_STEP = 1e-3  # that is chosen [s]
RANDOM, OBSTACLE = 10.0, 3.0  # durations that are chosen [s]
LASTING = 10.0  # time constants that are followed
STEPS, MARGIN = 1000, 4.0  # of a response at least; of the longest step, over the family
LEVEL = 0.1  # before an obstacle [s]
WAVE = 100.0  # the longest that a class of roads is asked for [m]


def add_excitation_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare roads, other excitations, and time."""
    road = parser.add_argument_group("a road, under a vehicle").add_mutually_exclusive_group()
    road.add_argument("--road", metavar="CLASS", help="random, of class A to H of ISO 8608")
    road.add_argument(
        "--bump", type=float, nargs=2, metavar=("HEIGHT", "LENGTH"), help="a cosine bump [m]"
    )
    road.add_argument(
        "--pothole", type=float, nargs=2, metavar=("DEPTH", "LENGTH"), help="a hole [m]"
    )
    road.add_argument("--kerb", type=float, metavar="HEIGHT", help="a step [m]")
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
        help="[s]; default: 10 on a random road, 3 over an obstacle, all of a file, else ten of "
        "the first law's slowest time constants",
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
        help="the law is told what recursive least squares make of the ride",
    )
    for name, metavar, text in (
        ("--sampling", "TS", "the controller samples at this period [s] and holds"),
        ("--bandwidth", "HZ", "of the actuator [Hz]; default: no lag"),
        ("--force-limit", "N", "of the actuator [N]; default: none"),
        ("--travel-limit", "M", "bump stops at this deflection, either way [m]; default: none"),
    ):
        parser.add_argument(name, type=float, metavar=metavar, help=text)


def setup_of(plant: UncertainPlant, options: Any, law: Any) -> Setup:
    """Return what the options ask to be followed.

    Parameters
    ----------
    law : law
        Whose loop says how long and how finely, where the options do not.

    Raises
    ------
    InputError
        Naming the option that cannot be used.
    """
    from polefence.vehicle.driving.parts import Actuator, BumpStops, Estimated, Hardware, Sampling
    from polefence.vehicle.run import Setup

    stops = None
    if options.travel_limit is not None:
        stops = BumpStops(options.travel_limit, options.travel_limit)
    setup = Setup(
        plant,
        _excitation(plant, options, law),
        _parameters(plant, options),
        options.outside,
        Hardware(
            Estimated() if options.estimate else None,
            None if options.sampling is None else Sampling(options.sampling),
            Actuator(options.bandwidth, options.force_limit),
            stops,
        ),
    )
    try:
        setup.courses.check(setup.time, options.outside)
    except ParameterValueError as error:
        raise ParameterValueError(str(error).replace("outside=True", "--outside")) from error
    return setup


def _excitation(plant: UncertainPlant, options: Any, law: Any) -> Excitation:
    """Return what moves the plant."""
    from polefence.vehicle import excitation

    roads = (options.road, options.bump, options.pothole, options.kerb, options.profile)
    others = {key: getattr(options, key) for key in ("step_in", "impulse_in", "initial")}
    if any(road is not None for road in roads):
        if any(others.values()) or options.input is not None:
            raise InputError("a road is all that moves a car; leave out the other excitation")
        if plant.vehicle is None:
            raise InputError(
                f"{plant.name} is not described as a vehicle, and a road is for one; add a table "
                "[vehicle] to its spec, or use --step-in, --impulse-in, --initial or --input"
            )
        if options.speed is None:
            raise InputError("--speed is missing: a road needs it [m/s]")
        road, duration = _road(options)
        return excitation.on_road(plant, road, options.speed, _step(options), duration)
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
    steps, impulses, start = (_sizes(own, key) for key, own in others.items())
    return excitation.excited(plant, duration, step, steps, impulses, start)


def _sizes(texts: list[str], key: str) -> dict[str, float]:
    """Return sizes by the names of signals, which may have blanks in them."""
    option, found = f"--{key.replace('_', '-')}", dict[str, float]()
    for text in texts:
        name, equal, value = text.rpartition("=")
        if not equal or not re.fullmatch(NUMBER, value.strip()):
            raise InputError(f"{option} {text!r}; write NAME=SIZE, as in {option} 'gust=1.5'")
        _once(found, name := split(name)[0], option)
        found[name] = float(value)
    return found


def _time(plant: UncertainPlant, options: Any, law: Any) -> tuple[float, float]:
    """Return duration and step [s], as the loop at the middle of the family asks for them."""
    from polefence.response.closed import close
    from polefence.response.grid import longest_step
    from polefence.response.weighting import positive
    from polefence.vehicle.reference_laws import nominal

    loops = close(plant, law, nominal(plant), disturbed=False)
    duration, step = options.duration, options.step
    if duration is None:
        slowest = -float(loops.poles().real.max())
        if slowest <= 0:
            raise InputError("--duration is missing: the loop does not come to rest by itself")
        duration = LASTING / slowest
    duration = positive(duration, "--duration [s]")
    if step is None:
        if options.sampling is not None:
            return duration, _step(options)
        step = duration / max(STEPS, math.ceil(duration / longest_step(loops) * MARGIN))
    return duration, positive(step, "--step [s]")


def _road(options: Any) -> tuple[Road, float | None]:
    """Return the road, long enough, and the duration where one is given or chosen."""
    from polefence.response.weighting import positive
    from polefence.vehicle import roads as obstacles
    from polefence.vehicle.roads import measured_road, random_road

    speed = positive(options.speed, "--speed [m/s]")
    if options.seed is not None and options.road is None:
        raise InputError("--seed belongs to --road, whose roads are random")
    duration = options.duration
    if duration is not None:
        duration = positive(duration, "--duration [s]")
    if options.profile is not None:
        return measured_road(options.profile), duration
    if options.road is not None:
        duration = duration or RANDOM
        length = max(speed * duration, WAVE)
        return random_road(options.road, length, options.seed or 0), duration
    duration = duration or OBSTACLE
    level = {"before": LEVEL * speed, "after": speed * duration}
    if options.bump is not None:
        return obstacles.bump(*options.bump, **level), duration
    if options.pothole is not None:
        return obstacles.pothole(*options.pothole, **level), duration
    return obstacles.kerb(options.kerb, **level), duration


def _step(options: Any) -> float:
    from polefence.response.weighting import positive

    if options.step is not None:
        return positive(options.step, "--step [s]")
    if options.sampling is None:
        return LONGEST_STEP
    # so that the controller's period is a multiple of the step
    period = positive(options.sampling, "--sampling [s]")
    return period / max(1, math.ceil(period / LONGEST_STEP * (1 - 1e-9)))


def _parameters(plant: UncertainPlant, options: Any) -> Any:
    """Return values, jumps and ramps by name; weights alpha for a plant without parameters."""
    from polefence.vehicle.driving.parts import Jump, Ramp
    from polefence.vehicle.driving.trajectories import Space

    space, given = Space(plant), dict[str, Any]()
    for text in options.set:
        found = _read(SET, text, "--set", "NAME=VALUE, as in m1=300", space.names)
        _once(given, found["name"], "--set")
        given[found["name"]] = float(found["value"])
    changes = dict[str, Any]()
    if (options.jump or options.drift) and not plant.parameters:
        raise InputError(f"{plant.name} has no parameters that could move; give it some")
    middle = {p.name: float(p.low + p.high) / 2 for p in plant.parameters}
    start = middle | given
    for text in options.jump:
        found = _read(JUMP, text, "--jump", "NAME=VALUE@TIME, as in m1=340@5", space.names)
        _once(changes, name := found["name"], "--jump or --drift")
        changes[name] = Jump(float(found["begin"]), start[name], float(found["value"]))
    for text in options.drift:
        found = _read(
            DRIFT, text, "--drift", "NAME=VALUE@BEGIN..END, as in beta=10@2..8", space.names
        )
        _once(changes, name := found["name"], "--jump or --drift")
        begin, end = float(found["begin"]), float(found["end"])
        changes[name] = Ramp(start[name], float(found["value"]), begin, end)
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
    found = pattern.fullmatch(text.replace(" ", ""))
    if found is None:
        raise InputError(f"{option} {text!r}; write {form}")
    if found["name"] not in names:
        name = found["name"]
        raise InputError(f"{option} {text!r}: no parameter {name!r}; {suggest(name, names)}")
    return found


def _once(known: dict[str, Any], name: str, option: str) -> None:
    if name in known:
        raise InputError(f"{option}: {name} is given twice; give it once")
