"""``guarantee.json``: what is proved of exported code; written, and checked afresh."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from polefence.base.errors import DesignFileError, InputError
from polefence.design.certificate import Certificate, Check, plant_of
from polefence.design.design import Design, check_document, read_document
from polefence.design.observer import Observer
from polefence.export.again import program_again, seen_again, text_document, texts_again
from polefence.export.c99.program import Program
from polefence.export.c99.sources import Texts, sources
from polefence.export.observer import observer_sources
from polefence.export.statement import README, Facts, Loop, Seen, own_readme
from polefence.proof.claims.base import Claim
from polefence.proof.claims.observer import Observer as ObserverClaim
from polefence.proof.claims.rounding import Rounded
from polefence.proof.claims.sampled import Sampled
from polefence.proof.document import Document
from polefence.proof.work import FormatError
from polefence.region.regions import region_of

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
    claims: list[Claim] = [claim]
    claims += [] if sampled is None else [sampled]
    export: dict[str, Any] = {"text": text_document(texts, seen)}
    if observer is not None:
        dual, export["by_parameters"] = observer
        claims.append(ObserverClaim(dual.certificate.claim(), dual.plant.inputs))
    export["files"] = {name: _digest(text) for name, text in files.items()}
    return replace(design.certificate.file(claims), export=export).dumps()


def check_guarantee(path: str | Path) -> Check:
    """Prove ``guarantee.json`` afresh, and that the sources beside it are those it is about.

    The law's sources are written again from the constants that the proof is about, and compared.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    """
    where = Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)
    document = read_document(where)
    answer = check_document(document, where)
    if not answer.proved:
        return answer
    try:
        changed = _other(where, document)
    except (FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error
    return replace(answer, answer="undecided", reason=changed) if changed else answer


def _observer(document: Document, claim: ObserverClaim | None) -> Observer | None:
    """Return the observer whose code is beside the law's."""
    if claim is None:
        return None
    design = Design(Certificate.of(replace(document, claims=(claim,))))
    return Observer(plant_of(document.plant), design)


def _other(path: Path, document: Document) -> str:
    """Name a file beside this one that is not what it is about; "" where there is none."""
    claim: Rounded | None = document.first(Rounded)
    loop: Sampled | None = document.first(Sampled)
    if claim is None or document.export is None:
        raise InputError("export: what the code says of itself is missing; export it again")
    observer = _observer(document, document.first(ObserverClaim))
    design, own = claim.gain.subject.design, document.export
    if own.keys() != {"text", "files"} | ({"by_parameters"} if observer else set()):
        raise InputError("export must hold text and files; by_parameters, with an observer")
    by_parameters = own.get("by_parameters", False)
    if type(by_parameters) is not bool:
        raise InputError("export.by_parameters must be true or false")
    certificate = Certificate.of(replace(document, claims=(design,)))
    table, own_time = own["text"], certificate.plant.sample_time
    # what is kept of the region in service may be another than the design's
    parts = [(part.kind, part.numbers) for part in design.region]
    facts = Facts(region_of(parts), claim, own_time, limited=False, observer=observer)
    if loop is not None:
        seen = seen_again(table, observer is not None)
        held = Loop(float(loop.sample_time), loop.delay, loop.decay, seen)
        facts = replace(facts, loop=held)
    texts, program = texts_again(table, certificate, facts), program_again(claim.code, certificate)
    written = sources(program, texts)
    if observer is not None:
        written |= _observer_header(observer, program, texts, by_parameters)
    files = own["files"]
    beside = {f"{texts.name}_observer.{end}" for end in "hc"} if observer else set()
    if not isinstance(files, dict) or (beside and not beside <= files.keys()):
        raise InputError("files must be a table of names and digests, the observer's among them")
    units = {f"{texts.name}_fmi{version}.fmu" for version in "23"}
    for name in files.keys() - beside - units:
        raise InputError(f"files: {str(name)[:LONGEST]!r} is no file of this export")
    readme = own_readme(program, texts, certificate, observer is not None)
    if (path.parent / README).exists():
        written |= {README: readme}
    digests = {name: _digest(text.encode()) for name, text in written.items()}
    for name, digest in {**files, **digests}.items():
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
