"""Rows of a trade-off kept in a JSON file, so that it can be interrupted and resumed."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from polefence.base import VERSION
from polefence.base.errors import InputError
from polefence.base.files import make_folder, read_text, write_text
from polefence.design.certificate import Certificate
from polefence.design.place.limits import LABEL
from polefence.design.requirements.specification import Specification, claim_of
from polefence.design.rows import Row
from polefence.design.signals.bounds import exact_law
from polefence.design.signals.files import bounds_file
from polefence.design.signals.sampled import sampled
from polefence.design.signals.tradeoff_front import Asked, head
from polefence.law.laws import FixedGain, Law, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof import reading, work
from polefence.proof.claims.base import prove
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.document import from_plain

SAMPLES = 2000  # points of the family that each law is looked at


def write_rows(path: Path, asked: Asked, rows: Sequence[Row]) -> None:
    """Write a trade-off, whole or not at all."""
    document = head(asked) | {"references": [], "rows": list(rows)}
    make_folder(path.parent)
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def keep_references(path: Path, references: Sequence[Row]) -> None:
    """Add reference laws to a file of rows that `write_rows` wrote."""
    document = reading.parse(read_text(path, reading.MAX_BYTES, InputError))
    write_text(path, json.dumps(document | {"references": list(references)}, indent=1) + "\n")


def finished(path: Path, asked: Asked) -> dict[tuple[float, str], Row]:
    """Return the proved rows of an earlier run by value and method, all proved afresh.

    What a row says is taken from what was proved of it, and its law sampled again.

    Raises
    ------
    InputError
        If the file is unreadable, damaged, of another question, or by another version.
    """
    if not path.exists():
        return {}
    again = "remove the file to start anew, or name another one"
    try:
        document = reading.parse(read_text(path, reading.MAX_BYTES, InputError))
        found = {key: document[key] for key in ("polefence", "plant", "question")}
        rows = {(row["value"], row["method"]): row for row in document["rows"]}
        same = found == head(asked)
        with work.counted():  # one count for the file, however many its rows
            proved = {
                key: _again(row, asked) if same else None
                for key, row in rows.items()
                if row["status"] == "proved"
            }
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: no trade-off to resume; {again}") from error
    if found["polefence"] != VERSION:
        raise InputError(
            f"{path}: a trade-off by polefence {str(found['polefence'])[:40]}; {again}"
        )
    if not same:
        raise InputError(f"{path}: a trade-off of another plant or other limits; {again}")
    sound = {key: row for key, row in proved.items() if row is not None}
    if len(sound) < len(proved):
        raise InputError(f"{path}: a row is damaged; {again}")
    return sound


def _again(row: Row, asked: Asked) -> Row | None:
    """Return what is proved of a row, None where that is not what it says."""
    numbers = (row["value"], row["proved"], row["law_of"], row["seconds"])
    real = all(isinstance(x, float | int) and math.isfinite(x) and x >= 0 for x in numbers)
    own = row["own"] is None or row["own"] >= row["proved"]
    if not (real and own and LABEL.fullmatch(row["method"])):
        return None
    document = from_plain(row["performance"])
    claims = [claim for claim in document.claims if isinstance(claim, BoundClaim)]
    certificate = _of_plant(Certificate.of(document), asked.plant)
    fixed = isinstance(certificate.law, FixedGain)
    if not _proves(row, asked, certificate, claims) or (row["method"] == "quadratic" and not fixed):
        return None
    kept = {key: row[key] for key in ("value", "method")}
    seen = {key: row[key] for key in ("law_of", "own", "seconds")}
    return kept | proved_row(asked, certificate, claims, row["value"]) | seen


def _of_plant(certificate: Certificate, plant: UncertainPlant) -> Certificate:
    """Return the claim as one about the plant asked for, of the same vertices."""
    law = certificate.law
    if isinstance(law, ScheduledGain):
        law = replace(law, parameters=plant.parameters)
    return replace(certificate, plant=plant, law=law) if _same(certificate, plant) else certificate


def _same(certificate: Certificate, plant: UncertainPlant) -> bool:
    return certificate.plant.digest == plant.digest


def _proves(row: Row, asked: Asked, certificate: Certificate, claims: list[BoundClaim]) -> bool:
    """Prove the region and every bound of a row, as being about this plant and these signals."""
    if not _same(certificate, asked.plant) or certificate.region != asked.region:
        return False
    limits = [row["value"], *(own.at_most for own in asked.subject_to)]
    levels = [row["proved"], *(bound["proved"] for bound in row["bounds"])]
    if any(proved > limit for proved, limit in zip(levels[1:], limits, strict=True)):
        return False
    wanted = (asked.minimise, asked.over, *asked.subject_to)
    law = exact_law(certificate.law)
    for claim, own, level in zip(claims, wanted, levels, strict=True):
        subject = claim.subject
        same = claim_of(asked.plant, law, subject.on, own, subject.evidence, Fraction(level))
        if claim != same or not prove(claim).proved:
            return False
    return certificate.prove().proved


def proved_row(
    asked: Asked, certificate: Certificate, claims: Sequence[BoundClaim], value: float
) -> Row:
    """Return what a row says of a law: what is proved, and its worst at sampled parameters."""
    plant, law, alpha = asked.plant, certificate.law, seeded(asked.plant, SAMPLES)
    wanted = (asked.minimise, replace(asked.over, at_most=value), *asked.subject_to)
    levels = [float(claim.level) for claim in claims]
    worst = [_worst(plant, law, own, alpha) for own in wanted]
    bounds = zip(wanted[1:], levels[1:], worst[1:], strict=True)
    return {
        "status": "proved",
        "proved": levels[0],
        "sampled": worst[0],
        "bounds": [
            {
                "specification": f"{own.kind} of {own.name}",
                "at_most": own.at_most,
                "proved": level,
                "sampled": seen,
            }
            for own, level, seen in bounds
        ],
        "law_of": value,
        "own": levels[0],
        "reason": None,
        "performance": bounds_file(certificate, claims).write(),
    }


def _worst(plant: UncertainPlant, law: Law, own: Specification, alpha: Array) -> float | None:
    """Return the worst sampled value; what is proved does not depend on there being one."""
    with suppress(InputError):
        return sampled(plant, law, own, alpha).worst
    return None
