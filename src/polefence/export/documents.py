"""``guarantee.json``: what is proved of exported code; written, and checked afresh."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.design import Design, says_format
from polefence.errors import DesignFileError, InputError
from polefence.export.again import program_again, texts_again, texts_document
from polefence.export.c99.sources import Texts, sources
from polefence.export.sampled.document import sampling_document
from polefence.files import read_text
from polefence.plant.family import UncertainPlant
from polefence.proof import exact
from polefence.proof.certificate import Certificate, Check
from polefence.proof.exact import Rationals, Verdict
from polefence.proof.rounding import FORMAT, Code, Rounded, prove_rounding, read_rounded
from polefence.proof.sampling import Sampled, covers_rounding, prove_sampling, read_sampling
from polefence.proof.statement import milliseconds_text, region_text
from polefence.region_text import digits_down
from polefence.service.files import claim_document, plain

FILE_NAME = "guarantee.json"
LONGEST = 100  # characters of a file's name


def guarantee_text(
    design: Design,
    claim: Rounded,
    texts: Texts,
    files: Mapping[str, bytes],
    sampled: Sampled | None = None,
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
    """
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": exact.VERSION,
        "design": design.certificate.document(),
        "service": claim_document(claim.gain),
        "code": _code(claim),
        "text": texts_document(texts),
        "files": {name: _digest(text) for name, text in files.items()},
    }
    if sampled is not None:
        document["sampling"] = sampling_document(sampled)
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
        verdict = prove_rounding(claim)
        said = [_claimed(claim)]
        if verdict.proved and "sampling" in document:
            sampled, verdict = _sampled(claim, document["sampling"], verdict)
            said.append(sampled)
        changed = _other(where, claim, document) if verdict.proved else ""
    except (exact.FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error
    if changed:
        return Check("undecided", changed, claims=tuple(said))
    answer = "proved" if verdict.proved else "undecided"
    return Check(answer, verdict.reason, claims=tuple(said))


def _claimed(claim: Rounded) -> str:
    region = region_text(claim.gain.subject.design.region)
    return f"poles in {region} with the gain as the float{claim.code.bits} code computes it"


def _sampled(claim: Rounded, table: Any, verdict: Verdict) -> tuple[str, Verdict]:
    """Prove what is claimed of the sampled loop too; return it in words."""
    subject = claim.gain.subject
    found = read_sampling(table, subject.design, subject.ranges)
    late = ", u one step late" if found.delay else ""
    time = milliseconds_text(found.sample_time)
    text = f"run every {time} ms{late}, decay {digits_down(found.decay, 3)} 1/s"
    own = prove_sampling(found)
    if own.proved and not covers_rounding(found, claim):
        own = Verdict(False, "the sampled loop is not proved with the code's rounding")
    return text, Verdict(
        own.proved, f"{verdict.reason}; {own.reason}" if own.proved else own.reason
    )


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
    text = read_text(path, exact.MAX_BYTES, DesignFileError)
    try:
        return read_rounded(text)
    except exact.FormatError as error:
        raise DesignFileError(f"{path}: {error}") from error


def _other(path: Path, claim: Rounded, document: dict[str, Any]) -> str:
    """Name a source beside the file that is not what it is about; "" where there is none."""
    certificate = Certificate.loads(json.dumps(document["design"]))
    texts = texts_again(document.get("text"), certificate)
    if (texts.sample_time is not None) != ("sampling" in document) and (
        certificate.plant.sample_time is None
    ):
        return "the code states a sample time of which nothing is proved here, or the other way"
    files = document.get("files", {})
    if not isinstance(files, dict):
        raise InputError("files must be a table of names and digests")
    own = sources(program_again(claim.code, certificate), texts)
    for name, digest in {**files, **{name: _digest(t.encode()) for name, t in own.items()}}.items():
        if Path(name).name != name or len(name) > LONGEST:
            raise InputError(f"files: {name!r} is no name in this folder")
        try:
            there = _digest((path.parent / name).read_bytes())
        except OSError:
            return f"{name} is missing beside it; keep the folder of an export together"
        if there != digest:
            return f"{name} is not what this version writes of these constants; export it again"
    return ""


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
