"""``polefence verify``: what another tool says of its design, proved or refuted."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, shown
from polefence.certify.bounds import is_loose, save
from polefence.certify.design import FILE_NAME, Design, is_proof_file
from polefence.certify.verify import Verified, VerifiedBound, verify
from polefence.cli.analyse import note_the_sign, read_gain
from polefence.cli.common import (
    NOT_PROVED,
    PROVED,
    check_targets,
    every_alpha,
    image_text,
    saved,
    write_json,
)
from polefence.cli.terminal import say
from polefence.law.arrays import law_from
from polefence.law.laws import GainTable, Law
from polefence.plant.arrays import Arrays, plant_from, read_arrays
from polefence.plant.family import UncertainPlant
from polefence.plant.points import where_text
from polefence.plant.spec import load
from polefence.proof.text import exactly
from polefence.region.regions import Disk, HalfPlane, Region
from polefence.region.text import digits_down, digits_up, load_region, parse_region
from polefence.requirements.asked import promised
from polefence.requirements.specification import Specification
from polefence.requirements.text import parse_specification
from polefence.search.rows import plant_summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `verify`."""
    parser.add_argument(
        "plant",
        metavar="PLANT",
        help="a file with A and B, one each or one per vertex (.mat, "
        ".npz, .json, a folder of .csv), "
        "or a TOML spec",
    )
    parser.add_argument(
        "--gain",
        metavar="WHAT",
        help="u = K x: '[1 2; 3 4]', or a file (.mat, .npz, .npy, .csv, .json); default: the K of "
        "PLANT",
    )
    parser.add_argument(
        "--minus", action="store_true", help="the law is u = -K x, as lqr and place have it"
    )
    parser.add_argument(
        "--lyapunov",
        metavar="FILE",
        help="Lyapunov matrices P, one or one per vertex; default: the P of PLANT, if it has one",
    )
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="NEW=OLD",
        help="the file calls it OLD what is called NEW here: --name P=Xopt; repeat for more",
    )
    parser.add_argument(
        "--region", metavar="TEXT", help="'disk(-40, 31)'; default: the spec's, else stability"
    )
    parser.add_argument(
        "--limit",
        action="append",
        default=[],
        metavar="TEXT",
        help="a bound that is promised: 'gain of y1 <= 2', or 'gain of y1' for the least that can "
        "be proved; repeat for more; default: all that a spec asks for",
    )
    parser.add_argument(
        "--budget",
        type=float,
        metavar="SECONDS",
        help="begin no harder step after this time; default: no limit in seconds",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="write DIR/design.json")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write a summary; -: stdout")


def verify_command(options: Any) -> int:
    """Verify a design of another tool: its law, Lyapunov matrices and bounds."""
    names = _names(options.name)
    plant, arrays, region = _read(options.plant, names)
    law = _law(plant, arrays, names, options)
    region = parse_region(options.region) if options.region is not None else region
    if region is None:
        region = HalfPlane(0) if plant.sample_time is None else Disk(0, 1)
    P = _lyapunov(arrays, names, options.lyapunov)
    limits = _limits(plant, arrays, options)
    check_targets(options.json, folder=options.output, names=(FILE_NAME,))
    found = verify(plant, law, region, P, limits, options.budget)
    _say(found, options)
    say(*image_text(plant, region, found.analysis.proved))
    if arrays is not None:
        say(_read_text(arrays, options))
    if options.output is not None:
        _save(found, options.output)
    if options.json is not None:
        write_json(options.json, _summary(found))
    return PROVED if found.proved else NOT_PROVED


def _read_text(arrays: Arrays, options: Any) -> str:
    """Say which matrices of the file stand for plant, law and Lyapunov function."""
    names = [*"ABECDF", "sample_time"]
    if options.gain is None:
        names += ["K"] if "K" in arrays else ["Z", "W"]
    names += ["P"] if options.lyapunov is None else []
    sign = "; u = -K x" if options.minus else ""
    out = arrays.left_out(names)
    rest = f"; not read, no numbers: {', '.join(out)}" if out else ""
    return f"read: {', '.join(arrays.listed(names))} from {arrays.place}{sign}{rest}"


def _names(given: Sequence[str]) -> dict[str, str]:
    names = dict[str, str]()
    for text in given:
        new, sign, old = text.partition("=")
        if not (new and sign and old):
            raise InputError(f"--name {shown(text)} is not of the form NEW=OLD; write P=Xopt")
        names[new] = old
    return names


def _read(what: str, names: dict[str, str]) -> tuple[UncertainPlant, Arrays | None, Region | None]:
    path = Path(what)
    if path.suffix == ".toml":
        return load(path), None, load_region(path)
    if (path / FILE_NAME).is_file() or (path.is_file() and is_proof_file(path)):
        raise InputError(f"{path}: a file of claims; polefence check proves it afresh")
    arrays = read_arrays(what, names)
    return plant_from(arrays), arrays, None


def _law(plant: UncertainPlant, arrays: Arrays | None, names: dict[str, str], options: Any) -> Law:
    what = options.gain
    if what is not None:
        law = read_gain(plant, what, names)
    elif arrays is None:
        raise InputError(f"{options.plant}: a spec has no gain; name one by --gain")
    else:
        law = law_from(arrays, plant)
    if isinstance(law, GainTable):
        raise InputError(f"--gain {what}: a table of gains; polefence analyse takes it")
    return law.negated() if options.minus else law


def _lyapunov(arrays: Arrays | None, names: dict[str, str], path: str | None) -> list[Any]:
    if path is not None:
        return read_arrays(path, names).only("P")
    return [] if arrays is None or "P" not in arrays else arrays["P"]


def _limits(plant: UncertainPlant, arrays: Arrays | None, options: Any) -> list[Specification]:
    """Return the limits of the options; of a spec, on its road and else its own."""
    if arrays is None:
        return list(promised(plant, options.plant, options.limit, "--limit"))
    return [_limit(text) for text in options.limit]


def _limit(text: str) -> Specification:
    try:
        return parse_specification(text)
    except InputError as error:
        raise InputError(f"--limit {shown(text)}: {error}") from error


def _say(found: Verified, options: Any) -> None:
    analysis, plant = found.analysis, found.plant
    if analysis.proved:
        alpha = every_alpha(analysis.design)
        where = f"all poles of {plant.name!r} in {analysis.region} for {alpha}"
        say(f"proved: {where}; {analysis.reason}", verdict="proved")
    else:
        say(f"{analysis.answer}: {analysis.reason}", verdict=analysis.answer)
        other = ("leave out --minus", "K") if options.minus else ("add --minus", "-K")
        note_the_sign(analysis, options.gain, *other)
    given = found.lyapunov
    if given is not None:
        what = "P" if given.count == 1 else f"P of {given.count} vertices"
        if given.proved:
            say(f"given {what}: proves it, as {given.words}; {given.reason}")
        else:
            say(f"given {what}: does not prove it; {given.reason}")
    for own in found.bounds:
        say(_bound_text(plant, own), verdict=own.answer)


def _bound_text(plant: UncertainPlant, own: VerifiedBound) -> str:
    most = own.specification.at_most
    limit = own.specification.title + ("" if most is None else f" <= {exactly(most)}")
    sampled = f"{digits_down(own.worst)}{where_text(plant, own.alpha)}"
    if own.answer == "exceeded":
        return f"exceeded: {limit}; sampled {sampled}, computed in floats"
    if own.bound is None:
        return f"{own.answer}: {limit}; no bound is proved, sampled {sampled}"
    loose = "; not tight: the worst case lies between" * is_loose(own.bound.level, own.worst)
    return (
        f"{own.answer}: {limit}; {digits_up(own.bound.level)} is proved, sampled {sampled}{loose}"
    )


def _save(found: Verified, folder: Path) -> None:
    if not found.analysis.proved:
        say("not saved: nothing was proved")
        return
    claims = [own.bound.claim for own in found.bounds if own.bound is not None]
    design = Design(found.analysis.design.certificate)
    path = save(design.certificate, claims, folder) if claims else design.save(folder)
    saved(path)


def _summary(found: Verified) -> dict[str, Any]:
    analysis, given = found.analysis, found.lyapunov
    pole = analysis.pole
    return {
        "plant": plant_summary(found.plant),
        "answer": found.answer,
        "region": analysis.region.document(),
        "poles": {
            "answer": analysis.answer,
            "reason": analysis.reason,
            "alpha": None if analysis.alpha is None else [str(a) for a in analysis.alpha],
            "values": analysis.values,
            "pole": None if pole is None else [pole.real, pole.imag],
        },
        "lyapunov": None
        if given is None
        else {"proved": given.proved, "form": given.form, "reason": given.reason},
        "limits": [
            {
                "of": own.specification.title,
                "limit": own.specification.at_most,
                "answer": own.answer,
                "proved": None if own.bound is None else own.bound.level,
                "sampled": own.worst,
                "alpha": list(own.alpha),
                "values": own.values,
            }
            for own in found.bounds
        ],
    }
