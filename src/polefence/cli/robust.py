"""``polefence robust``: how far the parameters' ranges may grow before a law fails."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.certify.certificate import Certificate
from polefence.certify.design import FILE_NAME, read_document
from polefence.certify.robust import MARGINS, REFUTED, Attained, Reach, Robustness, robust
from polefence.cli.given import NONE, SPEC, Given, law_arguments, read_given
from polefence.cli.lines import image_text, samples_text
from polefence.cli.options import (
    limit_argument,
    region_arguments,
    region_of,
    result_arguments,
    sampling_arguments,
)
from polefence.cli.output import NOT_PROVED, PROVED, check_results, saved, write_json
from polefence.cli.subjects import claims_file
from polefence.cli.terminal import say
from polefence.plant.points import values_text
from polefence.plant.spec import load_dampers
from polefence.proof.claims.failure import Error
from polefence.proof.text import digits_down, digits_up
from polefence.region.regions import Region
from polefence.requirements.disk_margin import TO, DiskMargin
from polefence.requirements.specification import limit_text
from polefence.search.rows import plant_summary

DIGITS = 7  # of a factor: all that it has


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `robust`."""
    law_arguments(parser, ("--gain", "--law"))
    parser.set_defaults(lyapunov=None)
    region_arguments(parser, "disk(-40, 31) & sector(0.3)")
    limit_argument(
        parser,
        "a bound that is to be kept: 'gain of y1 <= 2', or 'gain of y1' for its worst case alone; "
        "repeat for more; none: the poles alone; default: all that the spec asks for",
    )
    sampling_arguments(parser, "ask about the loop of a", clock=True)
    result_arguments(
        parser,
        f"write proofs: DIR/{FILE_NAME} of the largest box, {REFUTED} of the plant that fails, "
        f"{MARGINS} of errors of loops that do",
    )


def robust_command(options: Any) -> int:
    """Find how far the parameters' ranges may grow before a region or a limit is lost."""
    given = read_given(options)
    check_results(options, FILE_NAME, REFUTED, MARGINS)
    region = _region(given, options)
    limits = given.limits(options.limit or [SPEC], options)
    found = robust(given.plant, given.law, region, limits)
    say(*_lines(found), verdict="refuted" if found.refuted else "")
    proved = found.largest.proved is not None
    say(*image_text(given.plant, region, proved), *samples_text(given.plant, limits))
    say(*given.text(options), *_of_dampers(given, options))
    if options.output is not None:
        names = [FILE_NAME] * (found.largest.design is not None) + [*found.failures]
        if not names:
            say("not saved: nothing was proved")
        else:
            found.save(options.output)
            saved(*(Path(options.output) / name for name in names))
    if options.json is not None:
        write_json(options.json, _summary(found))
    return PROVED if found.proved else NOT_PROVED


def _region(given: Given, options: Any) -> Region:
    """Return the region of the options, of the spec, else of the design, else stability."""
    known = given.region(options)
    if options.gain is None or given.arrays is not None or region_of(options) is not None:
        return known
    path = claims_file(Path(options.gain))
    return known if path is None else Certificate.of(read_document(path)).region


def _of_dampers(given: Given, options: Any) -> Iterator[str]:
    """Say of a spec with controllable dampers that they give nothing without a law."""
    if options.gain == NONE and given.arrays is None and load_dampers(options.spec):
        yield (
            "note: without a law the controllable dampers give no force; a fixed damper is a gain "
            "on its rate, --gain, and polefence semi-active bounds what any law of them does"
        )


def _lines(found: Robustness) -> Iterator[str]:
    plant = found.plant
    asked = ", ".join([str(found.region), *map(limit_text, found.limits)])
    if found.refuted:
        yield f"refuted: at the centre of all ranges {found.refuted}"
        return
    if found.largest.names:
        yield f"{plant.name}: {asked}, for ranges so many times as wide about their centres"
        yield from _factors(found)
    else:
        yield f"{'proved' if found.proved else 'not proved'}: {plant.name}: {asked}"
    if found.worst:
        yield "worst cases on the ranges as they are:" if found.largest.names else "worst cases:"
    for worst in found.worst:
        yield f"  {_worst_text(found, worst)}"


def _factors(found: Robustness) -> Iterator[str]:
    """Yield a table of factors."""
    names = ["all ranges", *(f"{name} alone" for name in found.alone)]
    width = max(map(len, names))
    yield f"{'':<{width}}  {'proved':>18}  {'fails at':>10}"
    yield _line(found, "all ranges", found.largest, width)
    for name, reach in found.alone.items() if len(found.alone) > 1 else ():
        yield _line(found, f"{name} alone", reach, width)


def _line(found: Robustness, name: str, reach: Reach, width: int) -> str:
    proved = "none" if reach.proved is None else digits_down(reach.proved, DIGITS)
    if reach.whole:
        proved = f"at least {proved}"
    fails = "-" if reach.refuted is None else digits_up(reach.refuted, DIGITS)
    line = f"{name:<{width}}  {proved:>18}  {fails:>10}"
    if reach.values is not None:
        where = values_text(found.plant, {k: float(v) for k, v in reach.values.items()})
        line += f"  at {where}: {reach.reason}" + ", computed in floats" * (not reach.exact)
    elif reach.whole:
        line += f"  {reach.end}"
    else:
        upto = reach.end or f"up to {digits_down(reach.top)}"
        line += f"  no plant that fails was found {upto}"
    return line.rstrip()


def _worst_text(found: Robustness, worst: Attained) -> str:
    bound, reached, asked = worst.bound, worst.attained, worst.specification
    proved = (
        "no bound is proved" if bound is None else f"{asked.proved_text(bound.level)} is proved"
    )
    if reached is None:
        return f"{asked.title}: {proved}; the loop is not stable on all of the box"
    where = f" at {values_text(found.plant, dict(worst.values))}" if worst.values else ""
    if worst.failure is not None and worst.size is not None:
        size, cause = digits_up(worst.size, DIGITS), worst.failure.cause_text
        if bound is not None:
            proved = f"{digits_down(1 / Fraction(bound.level), DIGITS)} is proved"
        return f"{asked.title}: {proved}, {size} fails{where}, {cause}"
    how = "attained" if worst.exact else "sampled"
    if worst.frequency is not None:
        where += f"{',' if where else ''} at {worst.frequency:.4g} rad/s"
    return f"{asked.title}: {proved}, {asked.sampled_text(reached)} {how}{where}"


def _summary(found: Robustness) -> dict[str, Any]:
    return {
        "plant": plant_summary(found.plant),
        "region": found.region.document(),
        "limits": [limit_text(limit) for limit in found.limits],
        "answer": "refuted" if found.refuted else "proved" if found.proved else "not proved",
        "reason": found.refuted,
        "largest": _reach(found.largest),
        "alone": {name: _reach(reach) for name, reach in found.alone.items()},
        "worst": [_worst(worst) for worst in found.worst],
    }


def _reach(reach: Reach) -> dict[str, Any]:
    return {
        "proved": None if reach.proved is None else float(reach.proved),
        "refuted": None if reach.refuted is None else float(reach.refuted),
        "at least": reach.whole,
        "at": None if reach.values is None else {k: float(v) for k, v in reach.values.items()},
        "reason": reach.reason,
        "exact": reach.exact,
        "end": reach.end,
    }


def _worst(worst: Attained) -> dict[str, Any]:
    asked, reached = worst.specification, worst.attained
    row: dict[str, Any] = {
        "signal": asked.title,
        "proved": None if worst.bound is None else worst.bound.number,
        "refuted" if asked.is_margin else "attained": None
        if reached is None
        else asked.read_as(reached),
        "exact": worst.exact,
        "at": None if worst.values is None else dict(worst.values),
    }
    if worst.frequency is not None:
        row["frequency"] = worst.frequency
    if worst.failure is not None and worst.size is not None:
        errors, elements = worst.failure.errors, worst.failure.elements
        row["refuted"] = float(worst.size)
        if elements is None:
            paths = asked.names if isinstance(asked, DiskMargin) else ()
            names = [*worst.failure.names, *(name for name in paths if TO in name)]
            pairs = zip(names, errors, strict=True)
            row["errors"] = [{"loop": name, **_error(error)} for name, error in pairs]
        else:
            numbered = zip(elements.signals, elements.sectors, strict=True)
            row["elements"] = [{"signal": y.name, "number": float(k)} for y, (k, _) in numbered]
    return row


def _error(error: Error) -> dict[str, Any]:
    pole = {} if error.pole is None else {"pole": float(error.pole)}
    return {"gain": float(error.gain), **pole}
