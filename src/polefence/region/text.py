"""Regions as people write them, ``disk(-40, 31) & sector(0.3)``: parsed, never executed."""

from __future__ import annotations

import re
from dataclasses import astuple, fields
from pathlib import Path

from polefence.base.errors import RegionError, suggest
from polefence.base.explained import explained
from polefence.plant.spec import region_text
from polefence.proof.regions import MAX_PARTS
from polefence.proof.text import digits_down, digits_up, exactly, plural
from polefence.region.regions import CLASSES, Intersection, Region, require_left

__all__ = ["digits_down", "digits_up", "load_region", "parse_region", "short_text"]

MAX_LENGTH = 1000

EXAMPLE = "for example disk(-40, 31) & sector(0.3)"
_PART = re.compile(r"\s*([A-Za-z][\w-]*)\s*\(([^()&]*)\)\s*", re.ASCII)
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


@explained
def parse_region(text: str, alone: bool = True) -> Region:
    """Read a region from text: parts ``kind(number, ...)`` joined by ``&``.

    ``parse_region(str(region))`` is ``region`` again.

    Parameters
    ----------
    text : str
        Kinds are ``disk(centre, radius)``, ``half_plane(decay)``, ``sector(damping)``,
        ``wedge(apex, slope)``, ``vertical_strip(low, high)``, ``horizontal_strip(height)`` and
        ``ellipse(centre, real, imaginary)``, numbers in 1/s (rad/s for imaginary parts), a damping
        ratio and a slope without a unit. Capitals do not matter, and ``-`` may stand for ``_``. At
        most 1000 characters and 16 parts.
    alone : bool
        False where the region is to be met by another one, which may keep the left half-plane.

    Raises
    ------
    RegionError
        Naming the word that cannot be used.
    """
    if not isinstance(text, str):
        raise RegionError(f"a region is written as text, {EXAMPLE}; got {type(text).__name__}")
    if len(text) > MAX_LENGTH:
        raise RegionError(f"region has {len(text)} characters; at most {MAX_LENGTH} are read")
    if not text.strip():
        raise RegionError(f"region is empty; write {EXAMPLE}")
    words = text.split("&")
    if len(words) > MAX_PARTS:
        raise RegionError(f"region has {len(words)} parts; at most {MAX_PARTS} are read")
    parts = list(dict.fromkeys(_part(word) for word in words))
    region = parts[0] if len(parts) == 1 else Intersection(tuple(parts))
    return require_left(region) if alone else region


@explained
def load_region(path: str | Path) -> Region | None:
    """Read the region that a spec file asks for, None where it has no key ``region``.

    Raises
    ------
    SpecError
        If the file is missing, too long, or no TOML.
    RegionError
        If the region cannot be used; the file is named.
    """
    text = region_text(path)
    try:
        return None if text is None else parse_region(text)
    except RegionError as error:
        raise RegionError(f"{path}: {error}") from error


def short_text(region: Region) -> str:
    """Return a region's text with six digits, rounded so that it holds the region itself."""
    return " & ".join(_short_part(part) for part in region.parts)


def _short_part(part: Region) -> str:
    # a disk's centre stays: another one would be another disk, unless its radius grew too
    names = [field.name for field in fields(part)]
    texts = [
        exactly(value)
        if name == "centre"
        else (digits_up if name in part.growing else digits_down)(value)
        for name, value in zip(names, astuple(part), strict=True)
    ]
    return f"{part.kind}({', '.join(texts)})"


def _part(word: str) -> Region:
    if not word.strip():
        raise RegionError(f"region: nothing stands on one side of '&'; write {EXAMPLE}")
    match = _PART.fullmatch(word)
    if match is None:
        raise RegionError(f"region: {_short(word)} is not of the form kind(numbers); {_hint(word)}")
    kind = match[1].lower().replace("-", "_")
    if kind not in CLASSES:
        raise RegionError(f"region: kind {_short(match[1])} is unknown; {suggest(kind, CLASSES)}")
    names = [field.name for field in fields(CLASSES[kind])]
    given = match[2].split(",") if match[2].strip() else []
    if len(given) != len(names):
        count = plural(len(names), "number")
        raise RegionError(f"{kind}({', '.join(names)}) takes {count}; got {len(given)}")
    numbers = [_number(kind, name, word) for name, word in zip(names, given, strict=True)]
    try:
        return CLASSES[kind](*numbers)
    except RegionError as error:
        raise RegionError(f"{kind}: {error}") from error


def _hint(word: str) -> str:
    """Return a hint about a part that cannot be parsed."""
    if len(_PART.findall(word)) > 1:
        return "join parts by '&'"
    if "(" in word and ")" not in word:
        return "the closing parenthesis is missing"
    return f"write {EXAMPLE}"


def _number(kind: str, name: str, word: str) -> float:
    if not _NUMBER.fullmatch(word.strip()):
        raise RegionError(f"{kind}: {name} = {_short(word)} is not a number")
    return float(word)


def _short(word: str) -> str:
    """Quote a word, shortened to fit a line."""
    word = word.strip()
    return repr(word if len(word) <= 40 else f"{word[:37]}...")
