"""``guarantee.json``: what is proved of exported code; written, and checked afresh."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.base.errors import DesignFileError, InputError
from polefence.base.files import read_text
from polefence.design.certificate import Certificate, Check
from polefence.design.design import Design, says_format
from polefence.design.margins.files import claim_document, plain
from polefence.design.observer import Observer
from polefence.design.statement import milliseconds_text, region_text
from polefence.export.again import program_again, seen_again, text_document, texts_again
from polefence.export.c99.program import Program
from polefence.export.c99.sources import Texts, sources
from polefence.export.observer import observer_sources
from polefence.export.sampled.document import sampling_document
from polefence.export.statement import README, Facts, Loop, Seen, own_readme
from polefence.plant.family import UncertainPlant
from polefence.proof import placement, reading, work
from polefence.proof.matrices import Rationals
from polefence.proof.placement import Verdict
from polefence.proof.rounding import FORMAT, Code, Rounded, prove_rounding, read_rounded
from polefence.proof.sampling import Sampled, covers_rounding, prove_sampling, read_sampling
from polefence.region.regions import region_of
from polefence.region.text import digits_down, short_text

FILE_NAME = "guarantee.json"
LONGEST = 100  # characters of a file's name


def guarantee_text(
    design: Design,
    claim: Rounded,
    texts: Texts,
    files: Mapping[str, bytes],
    sampled: Sampled | None = None,
    seen: Seen | None = None,
    observer: tuple[Design, bool] | None = None,
) -> str:
    """Return the text of ``guarantee.json``.

    Parameters
    ----------
    design : Design
        The one that the claim about the gain is of.
    texts : Texts
        What, with the constants, the law's sources are made of.
    files : mapping
        What else runs; their digests are kept.
    sampled : Sampled, optional
        What is proved of the sampled loop.
    seen : Seen, optional
        What was found of it besides.
    observer : (Design, bool), optional
        The observer's design, and whether its code is given the plant's parameters.
    """
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": placement.VERSION,
        "design": design.certificate.document(),
        "service": claim_document(claim.gain),
        "code": _code(claim),
        "text": text_document(texts, seen),
        "files": {name: _digest(text) for name, text in files.items()},
    }
    if sampled is not None:
        document["sampling"] = sampling_document(sampled)
    if observer is not None:
        dual, by_parameters = observer
        own = dual.certificate.document()
        document["observer"] = {"design": own, "by_parameters": by_parameters}
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _code(claim: Rounded) -> dict[str, Any]:
    code: Code = claim.code
    table: dict[str, Any] = {"bits": code.bits}
    if code.K is not None:
        return table | {"K": _matrix(code.K)}
    table |= {"T": _matrix(code.T or [])}
    table |= {"W": list(map(_matrix, code.W)), "Z": list(map(_matrix, code.Z))}
    if code.shares:
        table["shares"] = [
            {"low": plain(s.low), "high": plain(s.high), "scale": plain(s.scale)}
            for s in code.shares
        ]
    bounds = {"smallest": plain(claim.smallest), "size": plain(claim.size)}
    return table | bounds | {"elevation": claim.elevation}


def _matrix(matrix: Rationals) -> list[list[Any]]:
    return [[plain(Fraction(value)) for value in row] for row in matrix]


def guarantee_path(path: Path) -> Path:
    """Return the file, or that in a folder of an export."""
    return path / FILE_NAME if path.is_dir() and (path / FILE_NAME).is_file() else path


def is_guarantee_file(path: Path) -> bool:
    """Whether a file, or the one in a folder, says that it is of this format."""
    where = guarantee_path(path)
    return (where.name == FILE_NAME and where.is_file()) or says_format(where, FORMAT)


def check_guarantee(path: str | Path) -> Check:
    """Prove ``guarantee.json`` afresh, and that the sources beside it are those it is about.

    The law's sources are written again from the constants that the proof is about, and compared.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    """
    where = guarantee_path(Path(path))
    claim, document = _read(where)
    try:
        with work.counted():  # one count for the file, however many its claims
            return _prove_all(where, claim, document)
    except (work.FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error


def _prove_all(where: Path, claim: Rounded, document: dict[str, Any]) -> Check:
    verdict = prove_rounding(claim)
    said, loop = [_claimed(claim)], None
    if verdict.proved and "sampling" in document:
        loop, verdict = _sampled(claim, document["sampling"], verdict)
        said.append(_loop_text(loop))
    observer = _observer(document)
    if verdict.proved and observer is not None:
        said.append(f"poles of its observer's error in {short_text(observer.region)}")
        proof = observer.design.certificate.prove()
        reason = f"{verdict.reason}; of the observer {proof.reason}"
        verdict = Verdict(proof.proved, reason)
    changed = _other(where, claim, document, loop, observer) if verdict.proved else ""
    if changed:
        return Check("undecided", changed, claims=tuple(said))
    answer = "proved" if verdict.proved else "undecided"
    return Check(answer, verdict.reason, claims=tuple(said))


def _claimed(claim: Rounded) -> str:
    region = region_text(claim.gain.subject.design.region)
    return f"poles in {region} with the gain as the float{claim.code.bits} code computes it"


def _sampled(claim: Rounded, table: Any, verdict: Verdict) -> tuple[Sampled, Verdict]:
    """Prove what is claimed of the sampled loop too."""
    subject = claim.gain.subject
    found = read_sampling(table, subject.design, subject.ranges)
    own = prove_sampling(found)
    if own.proved and not covers_rounding(found, claim):
        own = Verdict(False, "the sampled loop is not proved with the code's rounding")
    return found, Verdict(
        own.proved, f"{verdict.reason}; {own.reason}" if own.proved else own.reason
    )


def _loop_text(found: Sampled) -> str:
    late, time = ", u one step late" if found.delay else "", milliseconds_text(found.sample_time)
    return f"run every {time} ms{late}, decay {digits_down(found.decay, 3)} 1/s"


def _observer(document: dict[str, Any]) -> Observer | None:
    """Return the observer whose code is beside the law's; proves nothing."""
    if "observer" not in document:
        return None
    table = document["observer"]
    if not isinstance(table, dict) or table.keys() != {"design", "by_parameters"}:
        raise InputError("observer must hold design and by_parameters, and nothing else")
    if type(table["by_parameters"]) is not bool:
        raise InputError("observer.by_parameters must be true or false")
    plant = Certificate.loads(json.dumps(document["design"])).plant
    return Observer(plant, Design(Certificate.loads(json.dumps(table["design"]))))


def guarantee_plant(path: str | Path) -> UncertainPlant:
    """Return the plant of ``guarantee.json``.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    """
    _, document = _read(guarantee_path(Path(path)))
    return Certificate.loads(json.dumps(document["design"])).plant


def _read(path: Path) -> tuple[Rounded, dict[str, Any]]:
    text = read_text(path, reading.MAX_BYTES, DesignFileError)
    try:
        return read_rounded(text)
    except work.FormatError as error:
        raise DesignFileError(f"{path}: {error}") from error


def _other(
    path: Path,
    claim: Rounded,
    document: dict[str, Any],
    loop: Sampled | None,
    observer: Observer | None,
) -> str:
    """Name a file beside this one that is not what it is about; "" where there is none."""
    certificate = Certificate.loads(json.dumps(document["design"]))
    table, own_time = document.get("text"), certificate.plant.sample_time
    # what is kept of the region in service may be another than the design's
    parts = [(part.kind, part.numbers) for part in claim.gain.subject.design.region]
    facts = Facts(region_of(parts), claim, own_time, limited=False, observer=observer)
    if loop is not None:
        seen = seen_again(table, observer is not None)
        held = Loop(float(loop.sample_time), loop.delay, loop.decay, seen)
        facts = replace(facts, loop=held)
    texts, program = texts_again(table, certificate, facts), program_again(claim.code, certificate)
    own = sources(program, texts)
    if observer is not None:
        own |= _observer_header(observer, program, texts, document["observer"]["by_parameters"])
    files = document.get("files", {})
    beside = {f"{texts.name}_observer.{end}" for end in "hc"} if observer else set()
    if not isinstance(files, dict) or (beside and not beside <= files.keys()):
        raise InputError("files must be a table of names and digests, the observer's among them")
    units = {f"{texts.name}_fmi{version}.fmu" for version in "23"}
    for name in files.keys() - beside - units:
        raise InputError(f"files: {str(name)[:LONGEST]!r} is no file of this export")
    readme = own_readme(program, texts, certificate, observer is not None)
    if (path.parent / README).exists():
        own |= {README: readme}
    for name, digest in {**files, **{name: _digest(t.encode()) for name, t in own.items()}}.items():
        try:
            there = _digest((path.parent / name).read_bytes())
        except OSError:
            return f"{name} is missing beside it; keep the folder of an export together"
        if there != digest:
            return f"{name} is not what this version writes of what is proved; export it again"
    return ""


def _observer_header(
    observer: Observer, program: Program, texts: Texts, by_parameters: bool
) -> dict[str, str]:
    """Return the header that says what is proved of the observer, by its name."""
    given = observer.plant.parameters if by_parameters else ()
    found = observer_sources(observer, program.number, texts, given, texts.sample_time)
    name = f"{texts.name}_observer.h"
    return {name: found[name]}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
