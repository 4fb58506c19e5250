"""``polefence check``: a saved design, its margins or bounds, or an analysed table, afresh."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.base.errors import DesignFileError, InputError
from polefence.base.files import read_bytes, read_text, write_bytes
from polefence.cli.common import NOT_PROVED, PROVED, say, write_json
from polefence.design.certificate import Check
from polefence.design.design import FILE_NAME, Design, check, says_format
from polefence.design.given.table import FILE_NAME as TABLE
from polefence.design.given.table import check_table, is_table_file, table_plant
from polefence.design.margins import check_service, is_service_file, service_plant
from polefence.design.measured import read_measured, transposed
from polefence.design.observer import check_observer
from polefence.design.signals.augmented import with_weights
from polefence.design.signals.files import FILE_NAME as PERFORMANCE
from polefence.design.signals.files import check_performance, is_performance_file, performance_plant
from polefence.design.signals.text import RoadSpectrum, load_specifications
from polefence.export import check_guarantee, guarantee_plant, is_guarantee_file
from polefence.export.documents import FILE_NAME as GUARANTEE
from polefence.plant.family import UncertainPlant
from polefence.plant.names import quoted
from polefence.plant.spec import load
from polefence.plant.system import System
from polefence.proof.placement import FORMAT
from polefence.proof.reading import MAX_BYTES, parse
from polefence.proof.standalone import archive

NAMES_ARE_ITS_OWN = (
    "note: about the plant in the file. Its vertices, names, units and ranges are compared with",
    "your plant's by --spec SPEC; x1, u1, w1 are its first state, input and disturbance",
)


def _plant(path: Path) -> UncertainPlant:
    return Design.load(path, allow_unproved=True).plant


@dataclass(frozen=True)
class Kind:
    """A kind of file: what knows it, what proves it, what reads its plant.

    ``name`` is that of the file in a folder; ``letters`` the matrices that its claims are about.
    """

    is_mine: Callable[[Path], bool]
    proves: Callable[[Path], Check]
    plant: Callable[[Path], UncertainPlant]
    name: str
    letters: str = "AB"


def _is_observer(path: Path) -> bool:
    where = path / FILE_NAME if path.is_dir() else path
    if not says_format(where, FORMAT):
        return False
    return parse(read_text(where, MAX_BYTES, DesignFileError)).get("observer") is True


def _observed(path: Path) -> UncertainPlant:
    return Design.load(path, allow_unproved=True, observer=True).plant


# The last is the rest.
KINDS = (
    Kind(is_service_file, check_service, service_plant, ""),
    Kind(is_table_file, check_table, table_plant, TABLE),
    Kind(is_guarantee_file, check_guarantee, guarantee_plant, GUARANTEE),
    Kind(is_performance_file, check_performance, performance_plant, PERFORMANCE, "ABE"),
    Kind(_is_observer, check_observer, _observed, FILE_NAME, "AC"),
    Kind(lambda _: True, check, _plant, FILE_NAME),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `check`."""
    parser.add_argument(
        "file",
        type=Path,
        nargs="?",
        metavar="FILE",
        help="design.json, table.json or performance.json, or the folder with it",
    )
    parser.add_argument("--spec", metavar="SPEC", help="also require that it is about this plant")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the answer; -: stdout")
    parser.add_argument(
        "--standalone",
        type=Path,
        metavar="PYZ",
        help="write the checker alone, for `python -S PYZ FILE` without this package",
    )


def check_command(options: Any) -> int:
    """Prove a saved design or analysis afresh, in exact arithmetic."""
    if options.standalone is not None:
        write_bytes(options.standalone, archive())
        say(f"{options.standalone}: the checker alone; run it as python -S PYZ FILE")
        if options.file is None:
            return PROVED
    if options.file is None:
        raise InputError("check: name a FILE, or a folder with one")
    kind = next(kind for kind in KINDS if kind.is_mine(options.file))
    answer = kind.proves(options.file)
    path = options.file / kind.name if options.file.is_dir() else options.file
    digest = hashlib.sha256(read_bytes(path, MAX_BYTES, DesignFileError)).hexdigest()
    difference = None
    if options.spec is not None:
        plant = load(options.spec)
        if "E" in kind.letters:
            plant = _weighted(plant, options.spec)
        compare = _observer_difference if "C" in kind.letters else _difference
        difference = compare(kind.plant(options.file), plant, kind.letters)
    if options.json is not None:
        write_json(options.json, _document(options.file, answer, difference, digest))
    say(f"{options.file}: {answer.answer}: {answer.reason}")
    label = "" if answer.proved else "claimed, not proved: "
    say(*(f"  {label}{claim}" for claim in answer.claims))
    if options.spec is None:
        say(*NAMES_ARE_ITS_OWN, f"SHA-256 of the file: {digest}")
    if difference is not None:
        say(f"{options.file}: but NOT about {options.spec}: {difference}")
        return NOT_PROVED
    return PROVED if answer.proved else NOT_PROVED


def _document(path: Path, answer: Check, difference: str | None, digest: str) -> dict[str, Any]:
    return {
        "file": str(path),
        "sha256": digest,
        "answer": answer.answer,
        "reason": answer.reason,
        "claims": list(answer.claims),
        "alpha": None if answer.alpha is None else [str(a) for a in answer.alpha],
        "differs from the spec": difference,
    }


def _weighted(plant: UncertainPlant, spec: str) -> UncertainPlant:
    """Return the plant with the filters of the spec's own specifications."""
    least, limits = load_specifications(
        spec, RoadSpectrum("C", 20.0)
    )  # any road: filters are what counts
    return with_weights(plant, ([least] if least else []) + list(limits))[0]


def _difference(found: UncertainPlant, plant: UncertainPlant, letters: str = "AB") -> str | None:
    """Say how a design's plant differs from a spec's, None where it does not.

    Bounds on signals are about E too, which the digest leaves out. Names and units count: bounds
    are claimed of signals by their names.
    """
    other = _first_difference(found, plant, letters)
    if other is not None:
        return other
    if found.digest != plant.digest:
        return "other vertices"
    if found.sample_time != plant.sample_time:
        times = (_time(each.sample_time) for each in (found, plant))
        return "other time: {}, spec {}".format(*times)
    ours, theirs = (
        [(p.name, p.low, p.high, p.through) for p in each.parameters] for each in (found, plant)
    )
    if ours != theirs:
        return "other parameter ranges"
    return _other_name(found, plant)


def _observer_difference(dual: UncertainPlant, plant: UncertainPlant, _: str) -> str | None:
    """Say how the plant observed, or what is measured of it, differs from a spec's."""
    if (len(dual.vertices), dual.shape[0]) != (len(plant.vertices), plant.shape[0]):
        return "other vertices: their number or their shapes differ"
    pairs = zip(dual.vertices, plant.vertices, strict=True)
    vertices = tuple(
        System(transposed(own.exact_A), v.exact_B, v.exact_E, v.name) for own, v in pairs
    )
    inputs, disturbances = plant.inputs, plant.disturbances
    found = replace(dual, vertices=vertices, inputs=inputs, disturbances=disturbances)
    difference = _difference(found, plant, "A")
    if difference is not None or not dual.inputs:
        return difference
    try:
        expected = read_measured(plant, dual.inputs)[0]
    except InputError as error:
        return f"other measurements: {error}"
    for own, C in zip(dual.vertices, expected, strict=True):
        for k, (row, state) in enumerate(zip(transposed(own.exact_B), C, strict=True)):
            if row != state:
                return f"other measurements: C[{k + 1}] is not {quoted(dual.inputs[k])} alone"
    return None


def _other_name(found: UncertainPlant, plant: UncertainPlant) -> str | None:
    """Say which name or unit differs."""
    for key in ("states", "inputs", "disturbances"):
        ours, theirs = getattr(found, key), getattr(plant, key)
        if len(ours) != len(theirs):
            return f"other names: {len(ours)} names of {key}, spec {len(theirs)}"
        for k, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            if mine != other:
                return f"other names: {key}[{k + 1}] = {quoted(mine)}, spec {quoted(other)}"
    for p, q in zip(found.parameters, plant.parameters, strict=True):
        if p.unit != q.unit:
            return f"other units: {p.name} in {quoted(p.unit)}, spec {quoted(q.unit)}"
    return None


def _time(sample_time: Fraction | None) -> str:
    return "continuous" if sample_time is None else f"sample_time = {float(sample_time):.9g} s"


def _first_difference(found: UncertainPlant, plant: UncertainPlant, letters: str) -> str | None:
    if (len(found.vertices), found.shape) != (len(plant.vertices), plant.shape):
        return "other vertices: their number or their shapes differ"
    for mine, theirs in zip(found.vertices, plant.vertices, strict=True):
        for letter in letters:
            M, other = (getattr(each, f"exact_{letter}") or () for each in (mine, theirs))
            if len(M) != len(other) or len(M and M[0]) != len(other and other[0]):
                return f"other vertices: {theirs.name}: {letter} differs in its shape"
            for i, (row, expected) in enumerate(zip(M, other, strict=True)):
                for j, (a, b) in enumerate(zip(row, expected, strict=True)):
                    if a != b:
                        place = f"{theirs.name}: {letter}[{i + 1}][{j + 1}]"
                        return f"other vertices: {place} = {', spec '.join(_apart(a, b))}"
    return None


def _apart(a: Fraction, b: Fraction) -> tuple[str, str]:
    """Print two numbers so that they are seen to differ."""
    short = f"{float(a):.9g}", f"{float(b):.9g}"
    return short if short[0] != short[1] else (str(a), str(b))
