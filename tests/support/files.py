"""Files of claims, as tests look at them."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from polefence.proof.claims import BoundClaim, Poles
from polefence.proof.claims.base import Claim, prove
from polefence.proof.document import check, from_plain, loads
from polefence.proof.work import FormatError


def poles_in(text: str) -> Poles:
    """The first claim about a region."""
    found: Poles = loads(text).first(Poles)
    return found


def bounds_in(text: str) -> list[BoundClaim]:
    """The claims about signals and the norm of the gain."""
    return [claim for claim in loads(text).claims if isinstance(claim, BoundClaim)]


def only_claim_in(text: str) -> Claim:
    """The one claim of a file."""
    (claim,) = loads(text).claims
    return claim


def is_proved(document: dict[str, Any]) -> bool:
    """Whether the one claim of a file is proved."""
    return prove(only_claim_in(json.dumps(document))).proved


def is_accepted(document: dict[str, Any]) -> bool:
    """Whether all claims of a file are proved; not where it is refused."""
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


def first(document: dict[str, Any]) -> dict[str, Any]:
    """The table of a file's first claim."""
    table: dict[str, Any] = document["claims"][0]
    return table


@contextmanager
def rewritten(path: Path) -> Iterator[dict[str, Any]]:
    """The document of a JSON file, to change; it is written back."""
    document = json.loads(path.read_text())
    yield document
    path.write_text(json.dumps(document))
