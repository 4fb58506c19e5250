"""Rows of a trade-off kept in a JSON file, so that it can be interrupted and resumed."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from polefence import __version__
from polefence.errors import InputError
from polefence.files import make_folder, read_text, write_text
from polefence.performance import exact_law
from polefence.proof.certificate import Certificate
from polefence.proof.exact import FormatError
from polefence.proof.performance import prove_performance, read_performance
from polefence.specification import claim_of
from polefence.sweep import LABEL, MAX_BYTES, Row
from polefence.tradeoff_front import Asked, head


def write_rows(
    path: Path, asked: Asked, rows: Sequence[Row], references: Sequence[Row] = ()
) -> None:
    """Write a trade-off, whole or not at all."""
    document = head(asked) | {"references": list(references), "rows": list(rows)}
    make_folder(path.parent)
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def finished(path: Path, asked: Asked) -> dict[tuple[float, str], Row]:
    """Return the proved rows of an earlier run by value and method, all proved afresh.

    Raises
    ------
    InputError
        If the file is unreadable, damaged, of another question, or by another version.
    """
    if not path.exists():
        return {}
    again = "remove the file to start anew, or name another one"
    try:
        document = json.loads(read_text(path, MAX_BYTES, InputError))
        found = {key: document[key] for key in ("polefence", "plant", "question")}
        rows = {(row["value"], row["method"]): row for row in document["rows"]}
        proved = {key: row for key, row in rows.items() if row["status"] == "proved"}
        sound = found == head(asked) and all(_sound(row, asked) for row in proved.values())
    except (ValueError, KeyError, TypeError, RecursionError, FormatError) as error:
        raise InputError(f"{path}: no trade-off to resume; {again}") from error
    if found["polefence"] != __version__:
        raise InputError(f"{path}: a trade-off by polefence {found['polefence']}; {again}")
    if found != head(asked):
        raise InputError(f"{path}: a trade-off of another plant or other limits; {again}")
    if not sound:
        raise InputError(f"{path}: a row is damaged; {again}")
    return proved


def _sound(row: Row, asked: Asked) -> bool:
    """Whether a row says what it should, and its evidence proves that afresh."""
    worst = 0.0 if row["sampled"] is None else row["sampled"]
    numbers = (row["value"], row["proved"], row["law_of"], row["seconds"], worst)
    real = all(isinstance(x, float | int) and math.isfinite(x) and x >= 0 for x in numbers)
    own = row["own"] is None or row["own"] >= row["proved"]
    named = LABEL.fullmatch(row["method"]) is not None
    return real and own and named and _proves(row, asked)


def _proves(row: Row, asked: Asked) -> bool:
    """Prove the region and every bound of a row, as being about this plant and these signals."""
    claims, document = read_performance(json.dumps(row["performance"]))
    design = Certificate.loads(json.dumps(document["design"]))
    if design.plant.digest != asked.plant.digest or design.region != asked.region:
        return False
    limits = [row["value"], *(own.at_most for own in asked.subject_to)]
    levels = [row["proved"], *(bound["proved"] for bound in row["bounds"])]
    if any(proved > limit for proved, limit in zip(levels[1:], limits, strict=True)):
        return False
    wanted = (asked.minimise, asked.over, *asked.subject_to)
    law = exact_law(design.law)
    for claim, own, level in zip(claims, wanted, levels, strict=True):
        subject = claim.subject
        same = claim_of(asked.plant, law, subject.on, own, subject.evidence, Fraction(level))
        if claim != same or not prove_performance(claim).proved:
            return False
    return design.prove().proved
