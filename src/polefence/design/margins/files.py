"""Service files: a design and what is claimed of it, written, and checked afresh."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

from polefence.base.errors import DesignFileError
from polefence.base.files import read_text
from polefence.design.certificate import Certificate, Check
from polefence.design.design import says_format
from polefence.design.statement import errors_text, name_text, range_text, region_text
from polefence.plant.family import UncertainPlant
from polefence.plant.names import rate_text, unit_text
from polefence.proof import reading, work
from polefence.proof.service import (
    FORMAT,
    Estimate,
    Gain,
    Rate,
    ServiceClaim,
    prove_service,
    read_service,
)
from polefence.region.text import digits_down


def claim_document(claim: ServiceClaim) -> dict[str, Any]:
    """Return the claim as plain data: numbers where doubles hold them, else strings "p/q"."""
    table: dict[str, Any] = {}
    if isinstance(claim, Estimate):
        table = {"kind": "estimate", "errors": plain(claim.errors)}
    elif isinstance(claim, Gain):
        table = {"kind": "gain", "error": plain(claim.error)}
        table |= {"rows": plain(claim.rows), "mu": plain(claim.mu)}
        table["columns"] = [plain(c) for c in claim.columns]
    elif isinstance(claim, Rate):
        rates = "any" if claim.rates is None else plain(claim.rates)
        table = {"kind": "rate", "decay": plain(claim.decay), "rates": rates}
        table |= {"part": claim.part + 1} if claim.part else {}
    if claim.subject.pieces:
        table["pieces"] = list(claim.subject.pieces)
    return table | {"elevation": claim.subject.elevation}


def plain(value: Fraction | tuple[Fraction, ...]) -> Any:
    """Return a number where a double holds it, else the string "p/q"."""
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return float(value) if Fraction(float(value)) == value else str(value)


def is_service_file(path: Path) -> bool:
    """Whether a file says that it is of this format."""
    return says_format(path, FORMAT)


def check_service(path: str | Path) -> Check:
    """Prove a service file afresh, in exact arithmetic: "proved" or "undecided".

    Raises
    ------
    DesignFileError
        If the file cannot be read as a service file.
    """
    claim, document = _read(path)
    try:
        verdict = prove_service(claim)
    except work.FormatError as error:
        raise DesignFileError(f"{path}: {error}") from error
    said = (statement(claim, document),)
    return Check("proved" if verdict.proved else "undecided", verdict.reason, claims=said)


def service_plant(path: str | Path) -> UncertainPlant:
    """Return the plant of a service file.

    Raises
    ------
    DesignFileError
        If the file cannot be read as a service file.
    """
    _, document = _read(path)
    return Certificate.loads(json.dumps(document["design"])).plant


def _read(path: str | Path) -> tuple[ServiceClaim, dict[str, Any]]:
    text = read_text(Path(path), reading.MAX_BYTES, DesignFileError)
    try:
        return read_service(text)
    except work.FormatError as error:
        raise DesignFileError(f"{path}: {error}") from error


def statement(claim: ServiceClaim, document: dict[str, Any]) -> str:
    """Say in a line what is claimed, rounded so that it says no more than is proved."""
    tables = document["design"]["plant"].get("parameters", [])
    names = [(name_text(t["name"]), unit_text(str(t.get("unit") or ""))) for t in tables]
    region = region_text(claim.subject.design.region)
    if isinstance(claim, Gain):
        return f"{errors_text(claim.error, claim.rows, claim.columns)}, poles in {region}"
    pairs = zip(names, claim.subject.ranges, strict=True)
    over = ", ".join(range_text(name, unit, r.low, r.high) for (name, unit), r in pairs)
    within = f", {over}" if over else ""
    if isinstance(claim, Estimate):
        share = f"a share {_text(claim.errors[0])} of the weight mislaid"
        errors = _listed("{} wrong by up to {} {}", names, claim.errors) if names else share
        return f"{errors}, poles in {region}{within}"
    stable = f"exponential stability, decay rate {_text(claim.decay)} 1/s{within}"
    if claim.rates is None:
        return f"parameters moving at any rate, {stable}"
    weight = f"alpha moving by up to {_text(claim.rates[0])} 1/s"
    speeds = [(name, rate_text(unit)) for name, unit in names]
    rates = _listed("{} moving by up to {} {}", speeds, claim.rates) if names else weight
    return f"{rates}, {stable}"


def _listed(text: str, names: list[tuple[str, str]], values: tuple[Fraction, ...]) -> str:
    pairs = zip(names, values, strict=True)
    return ", ".join(
        " ".join(text.format(name, _text(value), unit).split()) for (name, unit), value in pairs
    )


def _text(value: Fraction) -> str:
    return digits_down(value, 4)
