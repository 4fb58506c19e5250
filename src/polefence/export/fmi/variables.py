"""The variables of an FMU: names that every importer takes, units, starts, descriptions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from polefence.export.c99.program import Program, Scheduled
from polefence.export.c99.sources import Texts

# "suspension deflection [m]", where the unit is no more than letters, digits and signs
UNIT = re.compile(r"(.*?)\s*\[([A-Za-z0-9 ./*^()%°µμΩ·²³-]{1,30})\]\s*", re.DOTALL)


@dataclass(frozen=True)
class Variable:
    """A variable of the model description.

    Attributes
    ----------
    name : str
        Letters, digits and _, unique.
    reference : int
        Value reference.
    description, unit, start : str
        Empty for none.
    """

    name: str
    reference: int
    description: str
    unit: str = ""
    start: str = ""


def variables(program: Program, texts: Texts, common: dict[str, Any]) -> dict[str, Any]:
    """Return what the templates are told of variables.

    Value references count from 1: x, what the program is given, u, the flags.

    Parameters
    ----------
    common : dict
        `c99.context` of the two.
    """
    shares = program.shares if isinstance(program, Scheduled) else ()
    middles = [float((s.parameter.low + s.parameter.high) / 2) for s in shares]
    given = common["given"]
    starts = [0.0] * len(texts.states) + (middles or [1 / len(given) for _ in given])
    named = [split(text) for text in texts.states]
    named += [(s.parameter.name, plain(s.parameter.unit)) for s in shares] or [
        (f"alpha_{j + 1}", "") for j in range(len(given))
    ]
    named += [split(text) for text in texts.inputs]
    fallbacks = [f"x{i + 1}" for i in range(len(texts.states))]
    fallbacks += [f"{common['letter']}{j + 1}" for j in range(len(given))]
    fallbacks += [f"u{i + 1}" for i in range(len(texts.inputs))]
    names = unique([name for name, _ in named], fallbacks, ("time", "flags"))
    described = [plain(text) for text in (*texts.states, *given, *texts.inputs)]
    begins = [repr(start) for start in starts] + [""] * len(texts.inputs)
    found = [
        Variable(name, k + 1, description, unit, start)
        for k, (name, description, (_, unit), start) in enumerate(
            zip(names, described, named, begins, strict=True)
        )
    ]
    return {
        "inputs": found[: len(starts)],
        "outputs": found[len(starts) :],
        "flags": Variable("flags", len(found) + 1, _flags(common)),
        "units": sorted({v.unit for v in found if v.unit}),
        "starts": begins[: len(starts)],
    }


def _flags(common: dict[str, Any]) -> str:
    meanings = [(1, common.get("clamped")), (2, common.get("not_a_number"))]
    meanings += [(4, "x not finite, or too large to compute with: u is 0")]
    meanings += [(8, "u was cut to its limit" if common["limits"] else None)]
    return "Sum of " + "; ".join(f"{bit} {text}" for bit, text in meanings if text)


def split(text: str) -> tuple[str, str]:
    """Return name and unit of "suspension deflection [m]"; no unit where it is none to define."""
    found = UNIT.fullmatch(text)
    return (found[1], found[2].strip()) if found and found[2].strip() else (text, "")


def unique(names: list[str], fallbacks: list[str], taken: tuple[str, ...]) -> list[str]:
    """Return identifiers that no importer has to change, different in more than case."""
    used, found = set(taken), list[str]()
    for name, fallback in zip(names, fallbacks, strict=True):
        word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:60] or fallback
        base = word if word[0].isalpha() else f"{fallback}_{word}"
        word, count = base, 1
        while word.lower() in used:
            count += 1
            word = f"{base}_{count}"
        used.add(word.lower())
        found.append(word)
    return found


def plain(text: str) -> str:
    """Return text in one line, without the characters that XML cannot hold."""
    allowed = re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", text)
    return re.sub(r"\s+", " ", allowed).strip()
