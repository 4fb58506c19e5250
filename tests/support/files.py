"""Files of claims, as tests look at them."""

from __future__ import annotations

import json
from typing import Any

from polefence.proof.claims import BoundClaim, Poles
from polefence.proof.claims.base import Claim, prove
from polefence.proof.document import loads


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


def first(document: dict[str, Any]) -> dict[str, Any]:
    """The table of a file's first claim."""
    table: dict[str, Any] = document["claims"][0]
    return table
