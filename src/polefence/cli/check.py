"""``polefence check``: files of claims, or the folder of any command, proved afresh."""

from __future__ import annotations

import argparse
import hashlib
import io
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence import proof
from polefence.base.errors import DesignFileError, InputError
from polefence.base.files import read_bytes, write_bytes
from polefence.certify.certificate import plant_of, sampling_of
from polefence.certify.design import check_document, is_proof_file, read_document
from polefence.certify.measured import read_measured
from polefence.cli.options import result_arguments
from polefence.cli.output import NOT_PROVED, PROVED, write_json
from polefence.cli.subjects import with_law_of
from polefence.cli.terminal import say
from polefence.export import check_guarantee
from polefence.export.documents import FILE_NAME
from polefence.plant.dead_time import on_time
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load, load_dampers
from polefence.plant.system import System
from polefence.proof.claims.base import Claim
from polefence.proof.claims.clipped import Clipped
from polefence.proof.claims.delay_margin import DelayMargin
from polefence.proof.claims.failure import Failure
from polefence.proof.claims.observer import Observer
from polefence.proof.claims.refutation import Refuted
from polefence.proof.claims.samples import Samples
from polefence.proof.claims.sector import SectorBound
from polefence.proof.claims.signal import SignalClaim
from polefence.proof.dampers import SemiActive
from polefence.proof.document import Document
from polefence.proof.laws import Law
from polefence.proof.plant import Output, Plant
from polefence.proof.reading import MAX_BYTES
from polefence.proof.text import milliseconds_text, output_text, quoted
from polefence.requirements.specification import Specification
from polefence.requirements.text import RoadSpectrum, load_specifications
from polefence.requirements.weights import filter_of, named, with_weights
from polefence.response.samples import at_sample_time

NAMES_ARE_ITS_OWN = (
    "note: about the plant in the file. Its vertices, names, units and ranges are compared with",
    "your plant's by --spec SPEC; x1, u1, w1 are its first state, input and disturbance",
)

# The application in a zip file that a bare Python runs.
MAIN = """import sys

if sys.version_info < (3, 11):
    sys.stderr.write("polefence-check.pyz needs Python 3.11 or later\\n")
    sys.exit(2)

from polefence.proof.__main__ import main

sys.exit(main(sys.argv[1:]))
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `check`."""
    parser.add_argument(
        "file",
        type=Path,
        nargs="?",
        metavar="FILE",
        help="a file of claims that a command wrote, or the folder with it",
    )
    parser.add_argument("--spec", metavar="SPEC", help="also require that it is about this plant")
    result_arguments(parser, json="write the answer; -: stdout")
    parser.add_argument(
        "--standalone",
        type=Path,
        metavar="PYZ",
        help="write the checker alone, for `python -S PYZ FILE` without this package",
    )


def check_command(options: Any) -> int:
    """Prove files of claims afresh, in exact arithmetic."""
    if options.standalone is not None:
        write_bytes(options.standalone, archive())
        say(f"{options.standalone}: the checker alone; run it as python -S PYZ FILE")
        if options.file is None:
            return PROVED
    if options.file is None:
        raise InputError("check: name a FILE, or a folder with one")
    plant = None if options.spec is None else load(options.spec)
    documents = {path: read_document(path) for path in _files(options.file)}
    alone, rows = len(documents) == 1, list[dict[str, Any]]()
    for path, document in documents.items():
        name = options.file if alone else path
        rows.append(_row(name, path, document, plant, options.spec))
        _say(rows[-1], options.spec)
    if options.json is not None:
        write_json(options.json, rows[0] if alone else {"file": str(options.file), "files": rows})
    if options.spec is None:
        say(*NAMES_ARE_ITS_OWN)
        for path, row in zip(documents, rows, strict=True):
            say(f"SHA-256 of {'the file' if alone else path.name}: {row['sha256']}")
    about = all(row["differs from the spec"] is None for row in rows)
    return PROVED if about and all(row["answer"] == "proved" for row in rows) else NOT_PROVED


def _files(path: Path) -> list[Path]:
    """Return a file, or those of claims in a folder."""
    if not path.is_dir():
        return [path]
    if is_proof_file(path / FILE_NAME):
        return [path / FILE_NAME]  # of an export, which names what else is there
    claims = [file for file in sorted(path.glob("*.json")) if is_proof_file(file)]
    if not claims:
        others = sorted(other.name for other in path.glob("*.json"))[:3]
        has = f"; it has {', '.join(others)}" if others else ""
        raise DesignFileError(
            f"{path}: has no file of claims; name the folder that `polefence design -o` wrote{has}"
        )
    return claims


def _row(
    name: Path, path: Path, document: Document, plant: UncertainPlant | None, spec: str | None
) -> dict[str, Any]:
    """Prove one file, and compare it with the plant of a spec."""
    exported = document.export is not None
    answer = check_guarantee(path) if exported else check_document(document, path)
    data = document.plant.data
    return {
        "file": str(name),
        "sha256": hashlib.sha256(read_bytes(path, MAX_BYTES, DesignFileError)).hexdigest(),
        "answer": answer.answer,
        "reason": answer.reason,
        "inequalities": sum(verdict.count for verdict in answer.verdicts),
        "claims": list(answer.claims),
        "unproved": None if data is None else data.note,
        "alpha": None if answer.alpha is None else [str(a) for a in answer.alpha],
        "differs from the spec": None if plant is None else _against(document, plant, str(spec)),
    }


def _say(row: dict[str, Any], spec: str | None) -> None:
    say(f"{row['file']}: {row['answer']}: {row['reason']}", verdict=row["answer"])
    label = "" if row["answer"] == "proved" else "claimed, not proved: "
    say(*(f"  {label}{claim}" for claim in row["claims"]))
    if row["differs from the spec"] is not None:
        say(f"{row['file']}: but NOT about {spec}: {row['differs from the spec']}")


def _against(document: Document, plant: UncertainPlant, spec: str) -> str | None:
    """Say how the plant of a file differs from a spec's in what the file's claims are about."""
    about = {letter for claim in document.claims for letter in claim.letters}
    if any(isinstance(claim, Failure) and claim.elements for claim in document.claims):
        about.add("E")
    letters = "".join(sorted(about))
    claimed, samples = plant_of(document.plant), document.first(Samples)
    sampled = samples is not None and plant.sample_time is None
    known = claimed.remainder
    if known is not None and (known.curve or known.bends) and not (sampled or known.source):
        return "its plant is no function of the parameters that a spec says"
    difference = _other_functions(document, samples if sampled else None, plant)
    if difference is not None:
        return difference
    if samples is not None and sampled:
        plant, late = on_time(plant)
        if samples.delay - samples.early < late / document.plant.step:
            return f"its input acts less than the {milliseconds_text(late)} ms of dead_time late"
        difference = _other_samples(samples, claimed, plant)
        if difference is not None:
            return difference
        plant = at_sample_time(plant, document.plant.step, samples.delay - samples.early)
    if document.first(Refuted) or document.first(Clipped):
        plant = _weighted(plant, claimed, spec)
    plant = with_law_of(plant, claimed, spec)
    if samples is not None and sampled and plant.shape == claimed.shape:
        # of the same plant, as the claim proves: equal but for rounding
        pairs = zip(claimed.vertices, plant.vertices, strict=True)
        plant = replace(plant, vertices=tuple(_beside(*pair, samples.width) for pair in pairs))
    difference = _difference(claimed, plant, letters)
    for claim in document.claims:
        if difference is None and isinstance(claim, Observer):
            difference = _other_measured(claim, plant)
        if difference is None:
            difference = _other_filter(claim, document.plant.step, spec)
        if difference is None:
            difference = _other_signal(_outputs_of(claim), document.plant, file_plant(plant))
        if difference is None and isinstance(claim, Clipped | Refuted) and claim.dampers:
            difference = _other_damper(claim.dampers, plant, spec)
    if difference is None and isinstance(document.law, Law) and document.law.measured:
        measured = [document.plant.signal(name) for name in document.law.measured]
        difference = _other_signal(filter(None, measured), document.plant, file_plant(plant))
    return difference


def _other_functions(
    document: Document, samples: Samples | None, plant: UncertainPlant
) -> str | None:
    """Say how the functions of the parameters in a file's plant differ from a spec's."""
    remainder = document.plant.remainder
    claimed = remainder and remainder.source
    if samples is not None:
        claimed = samples.source
    known = plant.remainder and plant.remainder.source
    if bool(claimed) != bool(known):
        ours, theirs = ("has functions of the parameters", "has none")
        one, other = (ours, theirs) if claimed else (theirs, ours)
        return f"its plant {one}, the spec's {other}"
    if claimed and known:
        n, width = len(known.directions[0]), len(known.directions[0][0])
        cut = tuple(tuple(tuple(row[:width]) for row in M[:n]) for M in claimed.directions)
        same = claimed.functions.trees == known.functions.trees
        if not same or claimed.functions.tables != known.functions.tables:
            return "its plant has other functions of the parameters"
        if samples is not None and cut != known.directions:
            return "its functions of the parameters stand in other entries"
    return None


def _outputs_of(claim: Claim) -> Sequence[Output]:
    """Return the signals that a claim is about."""
    if isinstance(claim, SectorBound | Failure):
        return [] if claim.elements is None else claim.elements.signals
    if isinstance(claim, SignalClaim):
        return claim.outputs
    if isinstance(claim, Clipped):
        return claim.limit.outputs
    limits = claim.limits if isinstance(claim, Refuted) else ()
    return [output for limit in limits for output in limit.outputs]


def _other_damper(claimed: Sequence[SemiActive], plant: UncertainPlant, spec: str) -> str | None:
    """Say how a claim's dampers differ from the spec's."""
    try:
        expected = {damper.number: damper for damper in (d.of(plant) for d in load_dampers(spec))}
    except InputError as error:
        return f"other dampers: {error}"
    if sorted(damper.number for damper in claimed) != sorted(expected):
        return f"other dampers: {len(claimed)}, spec {len(expected)}"
    for damper in claimed:
        if damper != expected[damper.number]:
            return f"other dampers: {damper.range_text}, spec {expected[damper.number].range_text}"
    return None


def _weighted(plant: UncertainPlant, claimed: UncertainPlant, spec: str) -> UncertainPlant:
    """Return the plant with the filters of the spec's specifications that a file's plant has."""
    known = {output.name for output in claimed.outputs}
    asked = [
        specification
        for specification in _specifications(spec)
        if {
            f"{y.name}, {w.name}"
            for y, w in zip(specification.outputs(plant), specification.filters, strict=True)
            if w
        }
        <= known
    ]
    return with_weights(plant, asked)[0]


def _specifications(spec: str) -> list[Specification]:
    """Return all that a spec asks for, on any road: filters and signals are what counts."""
    least, limits = load_specifications(spec, RoadSpectrum("C", 20.0))
    return [*([least] if least else []), *limits]


def _other_filter(claim: Claim, step: Fraction, spec: str) -> str | None:
    """Say that a filter of a claim is not the one of its name."""
    for weighting in claim.filters if isinstance(claim, SignalClaim) else ():
        if weighting is None or isinstance(claim, DelayMargin):  # whose filter is its level's
            continue
        every = _specifications(spec)
        asked = (w for s in every for w in (*s.filters, *getattr(s, "shapes", ())) if w)
        expected = named(weighting.name) or {w.name: w for w in asked}.get(weighting.name)
        if expected is None or weighting != filter_of(expected, step):
            return f"its filter {quoted(weighting.name)} is not what its name says"
    return None


def _beside(first: System, rest: System, n: int) -> System:
    """Return a vertex with the first n rows of one and the other rows of another."""
    A = (*first.exact_A[:n], *rest.exact_A[n:])
    B, E = (*first.exact_B[:n], *rest.exact_B[n:]), None
    if first.exact_E is not None and rest.exact_E is not None:
        E = (*first.exact_E[:n], *rest.exact_E[n:])
    return System(A, B, E, rest.name)


def _other_samples(samples: Samples, claimed: UncertainPlant, plant: UncertainPlant) -> str | None:
    """Say how the continuous plant behind a file's sampled one differs from a spec's."""
    sampled = replace(sampling_of(samples, claimed).plant, outputs=())
    bare = replace(plant, outputs=(), vehicle=None, noise=())
    return _difference(sampled, bare, "ABE" if samples.E else "AB")


def _difference(claimed: UncertainPlant, plant: UncertainPlant, letters: str = "AB") -> str | None:
    """Say how a design's plant differs from a spec's; None if it does not.

    Bounds on signals depend on E too, which the digest leaves out. Names and units count, because
    a bound names its signal.
    """
    other = _first_difference(claimed, plant, letters)
    if other is not None:
        return other
    if claimed.digest != plant.digest:
        return "other vertices"
    if claimed.sample_time != plant.sample_time:
        times = (_time(side.sample_time) for side in (claimed, plant))
        return "other time: {}, spec {}".format(*times)
    ours, theirs = (
        [(p.name, p.low, p.high, p.through) for p in side.parameters] for side in (claimed, plant)
    )
    if ours != theirs:
        return "other parameter ranges"
    if claimed.data != plant.data:
        return "other data: what the plant was fitted to"
    if [p.rate for p in claimed.parameters] != [p.rate for p in plant.parameters]:
        return "other rates of parameters"
    return _other_name(claimed, plant)


def _other_measured(observer: Observer, plant: UncertainPlant) -> str | None:
    """Say how an observer's measurements differ from the states of the same names."""
    if not observer.measured:
        return None
    try:
        expected = read_measured(plant, observer.measured)[0]
    except InputError as error:
        return f"other measurements: {error}"
    for measured, C in zip(observer.C, expected, strict=True):
        for k, (row, state) in enumerate(zip(measured, C, strict=True)):
            if tuple(row) != state:
                return f"other measurements: C[{k + 1}] is not {quoted(observer.measured[k])} alone"
    return None


def _other_signal(outputs: Iterable[Output], claimed: Plant, plant: Plant) -> str | None:
    """Say which output of a claim, or of a law, differs from the spec's of the same name.

    An output that neither plant names is defined in the claim, which prints it.
    """
    for output in outputs:
        mine, theirs = claimed.signal(output.name), plant.signal(output.name)
        if mine is None and theirs is None:
            continue
        if theirs is None:
            return f"other signals: {quoted(output.name)} is not a signal of the spec"
        if output.rows != theirs.rows:
            ours, other = (output_text(y.C, y.D, y.F) for y in (output, theirs))
            other = other if other != ours else f"the same to six digits: {other}"
            return f"other signals: {quoted(output.name)} = {ours}, spec {other}"
        if mine is not None and mine.unit != theirs.unit:
            units = f"{quoted(mine.unit)}, spec {quoted(theirs.unit)}"
            return f"other units: {quoted(output.name)} in {units}"
    return None


def _other_name(claimed: UncertainPlant, plant: UncertainPlant) -> str | None:
    """Say which name or unit differs."""
    for key in ("states", "inputs", "disturbances"):
        ours, theirs = getattr(claimed, key), getattr(plant, key)
        if len(ours) != len(theirs):
            return f"other names: {len(ours)} names of {key}, spec {len(theirs)}"
        for k, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            if mine != other:
                return f"other names: {key}[{k + 1}] = {quoted(mine)}, spec {quoted(other)}"
    for p, q in zip(claimed.parameters, plant.parameters, strict=True):
        if p.unit != q.unit:
            return f"other units: {p.name} in {quoted(p.unit)}, spec {quoted(q.unit)}"
        if p.label != q.label:
            return f"other names: {p.name} is {quoted(p.label)}, spec {quoted(q.label)}"
    return None


def _time(sample_time: Fraction | None) -> str:
    return "continuous" if sample_time is None else f"sample_time = {float(sample_time):.9g} s"


def _first_difference(claimed: UncertainPlant, plant: UncertainPlant, letters: str) -> str | None:
    if (len(claimed.vertices), claimed.shape) != (len(plant.vertices), plant.shape):
        return "other vertices: their number or their shapes differ"
    for mine, theirs in zip(claimed.vertices, plant.vertices, strict=True):
        for letter in letters:
            M, other = (getattr(side, f"exact_{letter}") or () for side in (mine, theirs))
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


def archive() -> bytes:
    """Return the checker as an application, the same bytes from the same sources."""
    here = Path(proof.__file__).parent
    files = {"__main__.py": MAIN, "polefence/__init__.py": ""}
    for path in sorted(here.rglob("*.py")):
        files[f"polefence/proof/{path.relative_to(here).as_posix()}"] = path.read_text("utf-8")
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archived:
        for name in sorted(files):
            # the same bytes whenever it is written
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.create_system = 3  # wherever it is written
            entry.external_attr = 0o644 << 16
            archived.writestr(entry, files[name].encode())
    return whole.getvalue()
