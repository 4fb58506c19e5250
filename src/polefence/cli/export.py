"""``polefence export``: a design as C99, an FMU or a MATLAB file."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError
from polefence.certify.design import Design, read_document
from polefence.cli.options import design_argument, range_argument, ranges_of
from polefence.cli.output import NOT_PROVED, PROVED, saved
from polefence.cli.subjects import claims_file
from polefence.cli.terminal import say
from polefence.export import export_c99, with_board, with_fmus
from polefence.export.board import require_drivable
from polefence.export.damper import damper_sources
from polefence.export.ends import proved_ends
from polefence.export.exported import Exported, check_folder, marks, require_fmus, write_folder
from polefence.export.matlab import HEADER, mat_bytes
from polefence.export.sources import check_c_name
from polefence.law.control import GIVEN
from polefence.proof.claims.clipped import Clipped
from polefence.proof.document import Document
from polefence.region.text import digits_down, digits_up
from polefence.response.discrete import Sampling
from polefence.search.observer import Observer

BITS = 64
OF_CODE = ("given", "limit", "rate", "sample_time", "observer", "board", "fixed", "ranges")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `export`."""
    design_argument(parser, "; or law.json of semi-active")
    parser.add_argument(
        "--lang",
        choices=("c99", "fmu", "mat"),
        default="c99",
        help="c99; fmu: C with FMUs of FMI 2.0 and 3.0; mat: the numbers for MATLAB; default: c99",
    )
    numbers = parser.add_mutually_exclusive_group()
    numbers.add_argument(
        "--float",
        type=int,
        choices=(32, 64),
        default=BITS,
        dest="bits",
        help="numbers of the code; default: 64",
    )
    numbers.add_argument(
        "--fixed",
        type=int,
        choices=(16, 32),
        help="integers of so many bits in their place, no floats; needs the signals' ranges",
    )
    range_argument(parser)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="folder to write"
    )
    parser.add_argument(
        "--name", default="law", metavar="NAME", help="begins the names of files and functions"
    )
    parser.add_argument(
        "--given", choices=GIVEN, help="what the code is given; default: parameters, if any"
    )
    parser.add_argument(
        "--limit",
        type=float,
        action="append",
        default=[],
        metavar="U",
        help="saturate each input at +-U, in its unit; repeat for one value per input; default: of "
        "a law with anti-windup where its saturation is proved, else none",
    )
    parser.add_argument(
        "--rate",
        type=float,
        action="append",
        default=[],
        metavar="R",
        help="move each input by at most R a second, in its unit, from one update to the next; "
        "repeat for one value per input; default: where the saturation of it is proved, else none",
    )
    parser.add_argument(
        "--sample-time",
        type=float,
        metavar="TS",
        help="analyse the loop as a computer closes it every TS seconds; required of a law with "
        "states of its own",
    )
    parser.add_argument(
        "--delay",
        type=int,
        choices=(0, 1),
        help="sample times from measuring x to applying u; default: 1",
    )
    parser.add_argument(
        "--observer",
        type=Path,
        metavar="OBSERVER",
        help="design.json of `observe`, or its folder: adds its code; needs --sample-time",
    )
    parser.add_argument(
        "--board",
        action="store_true",
        help="add a program that drives the law over random roads, on an emulated processor",
    )
    parser.add_argument(
        "--allow-unproved", action="store_true", help="export even where nothing is proved"
    )


def export_command(options: Any) -> int:
    """Write a design as code for a microprocessor, with what is proved of it."""
    check_c_name(options.name)
    if options.delay is not None and options.sample_time is None:
        raise InputError(
            "--delay counts samples: give --sample-time too, or neither for a design at one"
        )
    if options.lang == "mat":
        return _matlab(options)
    check_folder(options.output, marks(options.name))
    path = claims_file(options.design)
    document = None if path is None else read_document(path)
    if document is not None and document.first(Clipped) is not None:
        return _dampers(document, options)
    design = Design.read(options.design, document=document)  # proved by `export_c99`
    claims = () if document is None else document.claims
    compiler = os.environ.get("CC") or "cc"
    if options.lang == "fmu":
        require_fmus(compiler, options.observer is not None)
    if options.board:
        timed = design.plant.sample_time is not None or options.sample_time is not None
        require_drivable(claims, timed, options.observer is not None)
    limits = options.limit[0] if len(options.limit) == 1 else options.limit
    rates = options.rate[0] if len(options.rate) == 1 else options.rate
    proved = proved_ends(design, claims)
    if not options.rate and proved.rates:
        rates = list(proved.rates)
        _say_ends("rates", rates)
    if not options.limit and proved.limits and (rates or design.law.anti_windup is not None):
        limits = list(proved.limits)
        _say_ends("limits", limits)
    exported = export_c99(
        design,
        options.bits,
        name=options.name,
        given=options.given,
        limits=limits,
        rates=rates,
        sampling=_sampling(options),
        observer=_observer(design, options),
        allow_unproved=options.allow_unproved,
        fixed=options.fixed,
        ranges=ranges_of(options),
    )
    if options.lang == "fmu":
        exported = with_fmus(exported, compiler=compiler)
    if options.board:
        exported = with_board(exported, claims)
    paths = exported.save(options.output)
    _print(exported)
    saved(*paths)
    return PROVED if exported.proved else NOT_PROVED


def _dampers(document: Document, options: Any) -> int:
    """Write a law of controllable dampers."""
    unused = [key for key in _unused(options) if key not in ("--fixed", "--range")]
    if options.lang != "c99" or unused:
        raise InputError(
            f"{', '.join(unused) or f'--lang {options.lang}'}: a law of controllable dampers is "
            "exported without it; leave it out"
        )
    words = {"fixed": options.fixed, "ranges": ranges_of(options)}
    files = damper_sources(document, options.bits, name=options.name, **words)
    paths = write_folder(options.output, files, marks(options.name))
    numbers = (
        f"{options.bits} bits" if options.fixed is None else f"integers of {options.fixed} bits"
    )
    say(f"{document.plant.name}: coefficients of controllable dampers, {numbers}")
    saved(*paths)
    return PROVED


def _say_ends(what: str, numbers: Sequence[float]) -> None:
    """Say which limits or rates the code has without being asked."""
    say(f"  {what}: {', '.join(f'{x:g}' for x in numbers)}, as the saturation is proved")


def _sampling(options: Any) -> Sampling | None:
    late = options.delay is None or options.delay == 1
    return None if options.sample_time is None else Sampling(options.sample_time, late)


def _observer(design: Design, options: Any) -> Observer | None:
    if options.observer is None:
        return None
    dual = Design.load(options.observer, options.allow_unproved, observer=True)
    try:
        return Observer(design.plant, dual)
    except InputError as error:
        raise InputError(f"{options.observer}: {error}") from error


def _unused(options: Any) -> list[str]:
    """Return options of code that are given."""
    given = (key for key in OF_CODE if getattr(options, key))
    return ["--range" if key == "ranges" else f"--{key.replace('_', '-')}" for key in given]


def _matlab(options: Any) -> int:
    """Write the design's own numbers: no code, so no rounding to prove."""
    unused = _unused(options)
    if options.bits != BITS or unused:
        told = ", ".join(unused) or "--float"
        raise InputError(f"{told}: applies to code, which --lang mat does not write; leave it out")
    files = {f"{options.name}.mat": HEADER}
    check_folder(options.output, files)
    design = Design.load(options.design, allow_unproved=options.allow_unproved)
    content = dict.fromkeys(files, mat_bytes(design))
    saved(*write_folder(options.output, content, files))
    return PROVED if design.proved else NOT_PROVED


def _print(exported: Exported) -> None:
    made = exported.guarantee
    say(f"{exported.texts.title}: {exported.program.number.kind}")
    for line in exported.texts.statement:
        say(f"  {line}")
    if made.tolerated > 0:
        room = f"tolerated {digits_down(made.tolerated, 3)}"
        if made.claim is not None:
            proved = digits_down(made.claim.gain.error, 3)
            room = f"proved up to {proved}; by floats up to {digits_down(made.tolerated, 3)}"
        say(f"  rounding {digits_up(made.rounding, 3)}, {room}")
