"""``polefence optimise``: one signal as small as can be, others within limits, all proved."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError
from polefence.base.processors import small_matrices
from polefence.certify.bounds import (
    AGREED,
    Bound,
    Sampled,
    each_at_samples,
    each_sampled,
    is_loose,
    sampled,
)
from polefence.certify.checks import is_stability
from polefence.certify.design import FILE_NAME
from polefence.certify.refutation import FILE_NAME as LIMIT
from polefence.cli.lines import (
    decay_lines,
    decay_of,
    errors_text,
    every_alpha,
    gains_of,
    law_lines,
    limit_lines,
    limit_of,
    motion_lines,
    order_lines,
    samples_text,
    smaller_text,
    words_of,
)
from polefence.cli.options import (
    SIGNAL_METHODS,
    at_samples,
    given_options,
    limit_argument,
    method_arguments,
    minimise_argument,
    poles_argument,
    range_argument,
    ranges_of,
    refuse_method_options,
    region_of,
    result_arguments,
    road_arguments,
    road_of,
    sampling_arguments,
    signal_method_of,
    spec_argument,
    structure_arguments,
    structure_of,
)
from polefence.cli.output import (
    PROVED,
    check_results,
    saved,
    write_figure,
    write_json,
)
from polefence.cli.structures import compare_structures, several
from polefence.cli.terminal import say
from polefence.export import FixedCode, FloatCode
from polefence.export.held import Code
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method, Scheduled, method_label
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import split
from polefence.plant.points import seeded, values_at
from polefence.plant.spec import load
from polefence.plant.system import Array
from polefence.region.text import digits_down, digits_up
from polefence.requirements.asked import wanted
from polefence.requirements.rms import PLAIN
from polefence.requirements.specification import Specification
from polefence.requirements.text import (
    RoadSpectrum,
)
from polefence.search.optimise import Optimised, optimise
from polefence.search.rows import plant_summary
from polefence.vehicle.rest import Rest, held_words, rests

OWN = "law state ", "pid "  # begin names of a law's own states


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `optimise`."""
    spec_argument(parser)
    minimise_argument(
        parser,
        "'rms of sprung-mass acceleration'; of a vector 'rms of [NAME, NAME]', of chosen "
        "disturbances 'rms of NAME from [NAME * 0.5]'",
    )
    limit_argument(
        parser,
        "'rms of actuator force <= 700', 'disk margin of actuator force >= 1'; repeat for more; "
        "takes the place of the spec's of this kind and signal",
    )
    road_arguments(parser)
    poles_argument(parser)
    method_arguments(parser, SIGNAL_METHODS, ranges=True)
    sampling_arguments(parser, clock=True)
    structure_arguments(parser, ranges=True)
    numbers = parser.add_mutually_exclusive_group()
    numbers.add_argument(
        "--float",
        type=int,
        choices=(32, 64),
        dest="bits",
        help="take no law whose region is not proved with the rounding of its code in such floats",
    )
    numbers.add_argument(
        "--fixed",
        type=int,
        choices=(16, 32),
        help="the same of code in integers of so many bits; the signals' ranges are those of "
        "--range, or follow from limits on them: a peak, or six times an rms",
    )
    range_argument(parser)
    result_arguments(
        parser,
        "write DIR/design.json: the law with its region and bounds",
        "bounds and sampled values",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="of several structures: keep rows of an interrupted run, those of DIR",
    )


def optimise_command(options: Any) -> int:
    """Minimise the worst case of one signal within limits on others, and prove all of it."""
    plant = at_samples(load(options.spec), options)
    road = road_of(options)
    least, limits = wanted(plant, options.spec, options.minimise, options.limit, road)
    if several(options):
        return compare_structures(plant, least, limits, options)
    region, structure = region_of(options), structure_of(plant, options)
    method = _method_if_given(plant, options, structure)
    check_results(options, FILE_NAME, LIMIT)
    code = _code(plant, structure, options, limits)
    done = _found(plant, (least, limits, region, method), structure, code)
    rows = rows_of(done)
    require_agreement(rows)
    borne = [] if code is None else [_borne_line(done, code)]
    _finish(done, rows, method, options)
    say(*borne)
    say(*([] if region is None else smaller_text(plant, region)))
    say(*order_lines(done.plant, structure))
    return PROVED


def _code(
    plant: UncertainPlant,
    structure: Structure | None,
    options: Any,
    limits: Sequence[Specification],
) -> Code | None:
    """Return the code that is to bear its own rounding, None where that is not asked."""
    ranges = ranges_of(options)
    if options.fixed is None:
        if ranges:
            raise InputError("ranges of signals are for fixed-point code; give --fixed too")
        return None if options.bits is None else FloatCode(options.bits)
    code = FixedCode(options.fixed, ranges, limits)
    measured = None if structure is None else structure.measured
    states = [split(name)[0] for name in plant.states]
    for name in ranges:
        if not name.startswith(OWN):
            plant.signal(name)  # refuses what is none
    code.require(states if measured is None else measured)
    return code


def _borne_line(done: Optimised, code: Code) -> str:
    """Say that code bears its own rounding, of the law as it is saved."""
    rounded = code.guarantee(done.design)
    if rounded.claim is None:
        raise NotProvedError(f"not proved: {rounded.reason}")
    share = digits_up(100 * rounded.rounding / float(rounded.claim.gain.error), 2)
    return (
        f"  with the gain as {code.numbers} code computes it the region is proved too: rounding "
        f"is at most {share} % of what is proved to leave the poles there"
    )


def _found(
    plant: UncertainPlant,
    question: tuple[Any, Any, Any, Any],
    structure: Structure | None,
    code: Code | None,
) -> Optimised:
    """Return the law, of which code bears the rounding where that is asked.

    Raises
    ------
    NotProvedError
        If there is none; it says so where laws were found that code does not.
    """
    try:
        return optimise(plant, *question, None, structure, bears=code)
    except NotProvedError as problem:
        if code is None or not code.refused:
            raise
        count = "one law" if code.refused == 1 else f"{code.refused} laws"
        raise NotProvedError(
            f"{problem}; of {count} all was proved but that the poles stay in the region with the "
            f"rounding of {code.numbers} code: ask for a slightly larger region, or a longer "
            f"--sample-time{code.remedy}"
        ) from problem


def _finish(done: Optimised, rows: Sequence[Row], method: Method | None, options: Any) -> None:
    """Write files, then print: nobody need read the output to its end."""
    limit = done.limit_of_any_law
    if options.output is not None:
        saved(done.save(options.output))
        if limit is not None:
            saved(limit.save(options.output))
    label = label_of(done, method)
    if options.json is not None:
        write_json(options.json, document_of(done, rows, label))
    if options.plot is not None:
        write_figure(options.plot, figure_of(done, rows))
    say(*lines_of(done, rows, label), verdict="proved")
    # of one vertex one gain is every law
    scheduled = method not in (None, "quadratic") and len(done.plant.vertices) > 1
    if method is not None and scheduled and done.law.K is not None:
        say(f"  one gain: no law of {method_label(method)} that was found is better")
    if options.output is not None and limit is None and (options.output / LIMIT).exists():
        say(f"note: {options.output / LIMIT} is that of an earlier design")


def asked(
    plant: UncertainPlant, options: Any, road: RoadSpectrum | None
) -> tuple[Specification, tuple[Specification, ...]]:
    """Return what `wanted` returns, where something must be minimised."""
    least, limits = wanted(plant, options.spec, options.minimise, options.limit, road)
    if least is None:
        raise InputError(
            f"{options.spec}: nothing is to be minimised; give --minimise 'rms of SIGNAL', or "
            "write minimise = true in one [[specification]]"
        )
    return least, limits


def label_of(done: Optimised, method: Method | None) -> str:
    """Return the form of a law: of one that an LMI gave the method."""
    if done.structure is not None and done.law.W is None:
        return done.structure.words(done.plant)
    if done.law.K is not None:
        return "quadratic"
    on = "box" if done.plant.parameters else "simplex"
    return method_label(Scheduled(1, 0, on) if method is None else method)


def _method_if_given(
    plant: UncertainPlant, options: Any, structure: Structure | None
) -> Method | None:
    """Return the method that the options ask for, by name or by an option of it."""
    if structure is not None:
        refuse_method_options(options)
        return None
    if options.method is None and not given_options(options):
        return None
    return signal_method_of(plant, options.method or "scheduled", options)


@dataclass(frozen=True, eq=False)
class Row:
    """One bound, and what was sampled of it.

    Attributes
    ----------
    bound : Bound
    unit : str
    with_law : Sampled
    passive : Sampled, optional
        A quarter car's without control, where that is stable in this signal.
    at_samples : float, optional
        The worst value at the samples alone, of a bound that holds at all times.
    """

    bound: Bound
    unit: str
    with_law: Sampled
    passive: Sampled | None
    at_samples: float | None = None

    @property
    def label(self) -> str:
        """The bounded quantity, with its unit."""
        return self.words(" ")

    def words(self, between: str) -> str:
        """Return what is bounded and its unit, with something between them."""
        text = self.bound.specification.title
        return f"{text}{between}[{self.unit}]" if self.unit else text

    @property
    def minimised(self) -> bool:
        """Whether it has no limit."""
        return self.bound.specification.at_most is None

    @property
    def conservatism(self) -> float | None:
        """Ratio of the proved bound to the worst sample; None where that is zero."""
        return self.bound.level / self.with_law.worst if self.with_law.worst > 0 else None


@small_matrices()
def rows_of(done: Optimised) -> list[Row]:
    """Sample every bound of a law."""
    plant, alpha = done.plant, seeded(done.plant)
    asked = [bound.specification for bound in done.bounds]
    with_law = each_sampled(plant, done.law, asked, alpha)
    passive: Sequence[Sampled | None] = [None] * len(asked)
    if plant.vehicle is not None:
        passive = [_passive(plant, one, alpha) for one in asked]
    at_samples = each_at_samples(plant, done.law, asked, alpha)
    worst = [None if values is None else float(values.max()) for values in at_samples]
    units = [one.unit(plant) for one in asked]
    return list(map(Row, done.bounds, units, with_law, passive, worst))


def _passive(plant: UncertainPlant, asked: Specification, alpha: Array) -> Sampled | None:
    """Return what is sampled of the plant alone; None where it is not stable in the signal."""
    with suppress(InputError):
        return sampled(plant, None, asked, alpha)
    return None


def require_agreement(rows: Sequence[Row]) -> None:
    """Refuse a law that doubles do not run as it was proved.

    Raises
    ------
    NotProvedError
        If a sample passes a bound by more than its own rounding.
    """
    for row in rows:
        if row.with_law.worst > row.bound.level * (1 + AGREED):
            raise NotProvedError(
                f"{row.bound} is proved of the law as a real matrix, but evaluated in doubles it "
                f"shows {row.with_law.worst:.6g}: this law cannot run in "
                "doubles; limit the gain norm, or "
                "ask for a region that bounds the poles, such as a disk"
            )


def lines_of(done: Optimised, rows: Sequence[Row], label: str) -> list[str]:
    """Return what was proved, line by line; bounds rounded up and samples down."""
    count = len(rows[0].with_law.alpha)
    width = max(len(row.label) for row in rows)
    alone = any(row.passive is not None for row in rows)
    domains = {bound.claim.subject.on for bound in done.bounds}
    beside = any(row.at_samples is not None for row in rows)
    heads = ["proved", f"sampled {count}", "ratio", *(["passive"] if alone else [])]
    heads += ["at samples"] if beside else []
    lines = [
        f"proved: {label} keeps all poles of {done.plant.name!r} in {done.design.region} and, for "
        f"{every_alpha(done.design, *domains)},",
        " ".join([" " * (width + 2), *(f"{head:>13}" for head in heads)]),
    ]
    for row in rows:
        ratio = row.conservatism
        asked = row.bound.specification
        cells = [asked.proved_text(row.bound.level), asked.sampled_text(row.with_law.worst)]
        cells.append("-" if ratio is None else digits_up(ratio, 5))
        if alone:
            cells.append("-" if row.passive is None else asked.sampled_text(row.passive.worst))
        if beside:
            cells.append("-" if row.at_samples is None else digits_down(row.at_samples))
        note = ("maximised" if asked.is_margin else "minimised") if row.minimised else "limit"
        if row.minimised and is_loose(row.bound.level, row.with_law.worst):
            note += ", not tight: the worst case lies between"
        note += errors_text(row.bound)
        text = " ".join([f"  {row.label:<{width}}", *(f"{cell:>13}" for cell in cells), f" {note}"])
        lines.append(text)
    lines += samples_text(done.plant, [row.bound.specification for row in rows])
    lines += decay_lines(done.decay)
    lines += motion_lines(done.plant, done.design.region, bounds=True) + _design_lines(done)
    lines += limit_lines(done.limit_of_any_law, done.bounds[0].level)
    if done.cut:
        lines.append(f"  the search was cut: {done.cut}")
    if done.bounded_by:
        lines.append(
            f"  nothing but a bound of the search, {done.bounded_by}, stopped the gain from "
            "growing: limit an input or the gain (--largest-gain), or give the actuator its "
            "bandwidth"
        )
    if done.design.note:
        lines.append(done.design.note)
    elif not _samples_keep_region(done, rows[0].with_law.alpha):
        lines.append(
            "note: computed in doubles, this gain does NOT keep the poles there: it is too large; "
            "ask for a region that bounds the poles' speed, such as a disk"
        )
    lines += _rest_lines(done, rows)
    return lines + law_lines(done.law)


def _design_lines(done: Optimised) -> list[str]:
    """Say how the law came about."""
    lines = []
    if np.isfinite(done.shared) and done.bounds[0].specification.at_most is None:
        shared = digits_up(done.shared)
        lines.append(f"  one Lyapunov matrix for region and signals together proves {shared}")
    if done.designed != done.design.region:
        designed = _designed_words(done)
        lines.append(
            f"  designed for {designed}; the whole region was proved of the law afterwards"
        )
    return lines + list(_closer_lines(done))


def _closer_lines(done: Optimised) -> Iterator[str]:
    """Say what the last thousandth would cost, where that is much."""
    if done.closer is None:
        return
    times = done.closer.gain / done.closer.smaller if done.closer.smaller > 0 else 0.0
    if times >= 1.2:  # a smaller price is not worth a line
        share = digits_up(100 * (1 - done.closer.level / done.bounds[0].level), 2)
        yield f"  {share} % less would take a gain {times:.2g} times as large, in typical sizes"


def _designed_words(done: Optimised) -> str:
    """Return what the design asked of the poles; of samples the disk about 0 of a decay as that."""
    designed, T = done.designed, done.plant.sample_time
    if designed is None or is_stability(done.plant, designed):
        return "stability"
    if T is not None and designed.circle and not designed.circle[0]:
        return f"a decay rate of {digits_down(-math.log(designed.size) / float(T), 4)} 1/s"
    return str(designed)


def _rests(done: Optimised, rows: Sequence[Row]) -> tuple[Rest, ...]:
    """Return where constant disturbances leave the signals of the specifications."""
    known = [row.bound.specification for row in rows if row.bound.specification.of_signal]
    asked = {output.name: output for s in known for output in s.signals(done.plant)}
    if not asked or any(v.E is None for v in done.plant.vertices):
        return ()
    return rests(done.plant, done.law, rows[0].with_law.alpha, tuple(asked.values()))


def _rest_lines(done: Optimised, rows: Sequence[Row]) -> list[str]:
    """Say where a disturbance that stays leaves the signals, and what is beyond its limit there."""
    lines, beyond = [], dict[str, float]()
    limits = [row.bound.specification for row in rows if row.bound.specification.limits_rms]
    moved = _rests(done, rows)
    for source in dict.fromkeys(rest.source.label for rest in moved):
        here = [rest for rest in moved if rest.source.label == source]
        left = (
            ", ".join(rest.words for rest in here if rest.size) or "every signal above returns to 0"
        )
        held = held_words(done.plant, here[0].source)
        lines.append(f"  steady state under constant {held}, sampled: {left}")
        for rest in here:
            if any(rest.size > most for most in _limits_on(done, limits, rest)):
                beyond[rest.signal.name] = max(rest.size, beyond.get(rest.signal.name, 0.0))
    if beyond:
        # an integral brings a state back, but what an input must hold it holds
        inputs = {split(name)[0] for name in done.plant.inputs}
        advice = "with a signal's integral among the states nothing of it is left"
        if set(beyond) <= inputs:
            advice = "an input that has to hold the disturbance needs that beside its rms"
        lines.append(
            f"  note: that is more than is allowed of the rms of {' and '.join(beyond)}, which is "
            f"about noise; {advice}"
        )
    return lines


def _limits_on(done: Optimised, limits: Sequence[Specification], rest: Rest) -> Iterator[float]:
    """Yield the limits on the signal that this disturbance moves, and on vectors with it."""
    for limit in limits:
        acting = limit.disturbances is None or rest.source.name in dict(limit.disturbances)
        pairs = zip(limit.outputs(done.plant), limit.filters, strict=True)
        # no filter passes what stays
        names = [output.name for output, weighting in pairs if weighting is None]
        if limit.at_most is not None and acting and rest.signal.name in names:
            yield limit.at_most


def _samples_keep_region(done: Optimised, alpha: Any) -> bool:
    region = done.design.region
    distance = region.distance(done.design.poles(alpha[:1000]))
    # computed in doubles, poles may lie outside by the rounding
    return bool(np.all(distance < 1e-6 * region.size))


def _weights(specification: Specification) -> list[str] | None:
    """Return the weighting of each entry, none where no entry has one."""
    filters = specification.filters
    return [w.name if w else PLAIN for w in filters] if any(filters) else None


def document_of(done: Optimised, rows: Sequence[Row], label: str) -> dict[str, Any]:
    """Return the summary as plain data."""
    return {
        "plant": plant_summary(done.plant),
        "region": done.design.region.document(),
        "method": label,
        "answer": "proved",
        "sampled": len(rows[0].with_law.alpha),
        "bounds": [
            {
                "of": row.bound.specification.title,
                "kind": row.bound.specification.kind,
                "signal": row.bound.specification.name,
                "weight": _weights(row.bound.specification),
                "disturbances": dict(row.bound.specification.disturbances or ()) or None,
                "unit": row.unit,
                "limit": row.bound.specification.limit,
                "proved": row.bound.number,
                "degree": row.bound.degree,
                "worst sampled": row.bound.specification.read_as(row.with_law.worst),
                "conservatism": row.conservatism,
                "errors": row.bound.errors,
                "passive": None
                if row.passive is None
                else row.bound.specification.read_as(row.passive.worst),
                "at samples": row.at_samples,
            }
            for row in rows
        ],
        "held": [
            {
                "disturbance": rest.source.name,
                "at": 1.0,
                "signal": rest.signal.name,
                "unit": rest.signal.unit,
                "low": rest.low,
                "high": rest.high,
            }
            for rest in _rests(done, rows)
        ],
        **decay_of(done.decay),
        "limit_of_any_law": limit_of(done.limit_of_any_law),
        "shared": done.shared if np.isfinite(done.shared) else None,
        "designed": str(done.designed),
        "gains": gains_of(done.law),
        **words_of(done.law),
    }


def figure_of(done: Optimised, rows: Sequence[Row]) -> Any:
    """Draw bounds and samples over the first parameter, or over the first vertex's weight."""
    from polefence.show.plots import BoundsPanel, bounds_figure

    alpha, plant = rows[0].with_law.alpha, done.plant
    every = max(1, len(alpha) // 2000)
    some = alpha[::every]
    if plant.parameters:
        first = plant.parameters[0]
        x = np.array([(values_at(plant, a) or {first.name: np.nan})[first.name] for a in some])
        label = f"{first.name} [{first.unit}]" if first.unit else first.name
    else:
        x, label = some[:, 0], "weight of the first vertex"
    panels = [
        BoundsPanel(
            row.words("\n"),
            row.bound.level,
            row.with_law.values[::every],
            None if row.passive is None else row.passive.values[::every],
        )
        for row in rows
    ]
    return bounds_figure(x, label, panels)
