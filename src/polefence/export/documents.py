"""``guarantee.json``: what is proved of exported code; written, and checked afresh."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.design import Design
from polefence.errors import DesignFileError
from polefence.files import read_text
from polefence.plant.family import UncertainPlant
from polefence.proof import exact
from polefence.proof.certificate import Certificate, Check
from polefence.proof.exact import Rationals
from polefence.proof.rounding import FORMAT, Code, Rounded, prove_rounding, read_rounded
from polefence.service.files import claim_document, plain, region_text

FILE_NAME = "guarantee.json"


def guarantee_text(design: Design, claim: Rounded, files: Mapping[str, bytes]) -> str:
    """Return the text of ``guarantee.json``.

    Parameters
    ----------
    design : Design
        The one that the claim about the gain is of.
    files : mapping
        The sources whose digests are kept.
    """
    document = {
        "format": FORMAT,
        "version": exact.VERSION,
        "design": design.certificate.document(),
        "service": claim_document(claim.gain),
        "code": _code(claim),
        "files": {name: hashlib.sha256(text).hexdigest() for name, text in files.items()},
    }
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
    if not where.is_file():
        return False
    try:
        document = json.loads(read_text(where, exact.MAX_BYTES, DesignFileError))
    except (ValueError, RecursionError):
        return False
    return isinstance(document, dict) and document.get("format") == FORMAT


def check_guarantee(path: str | Path) -> Check:
    """Prove ``guarantee.json`` afresh, and that the sources beside it are those it is about.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    """
    where = guarantee_path(Path(path))
    claim, document = _read(where)
    try:
        verdict = prove_rounding(claim)
    except exact.FormatError as error:
        raise DesignFileError(f"{where}: {error}") from error
    changed = _changed(where, document)
    if changed:
        return Check("undecided", changed)
    region = region_text(claim.gain.subject.design)
    what = f"all poles in {region} with the gain as the float{claim.code.bits} code computes it"
    return Check("proved" if verdict.proved else "undecided", f"{what}: {verdict.reason}")


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


def _changed(path: Path, document: dict[str, Any]) -> str:
    """Name a source beside the file that is missing or was changed; "" where there is none."""
    files = document.get("files", {})
    if not isinstance(files, dict):
        raise DesignFileError(f"{path}: files must be a table of names and digests")
    for name, digest in files.items():
        if Path(name).name != name:
            raise DesignFileError(f"{path}: files: {name!r} is no name in this folder")
        source = path.parent / name
        if not source.is_file():
            return f"{name} is missing beside it; keep the folder of an export together"
        if hashlib.sha256(source.read_bytes()).hexdigest() != digest:
            return f"{name} was changed after the export; export it again"
    return ""
