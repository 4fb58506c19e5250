"""One tree of errors: each class is one event, carrying its evidence and what to try next.

``InputError`` and its kin are the caller's to mend (command line: exit 2); ``NotProvedError``
is an honest answer (exit 1).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

LONGEST = 60  # characters of a value in a message
BEGIN, END = 500, 200  # of a message, where a value in it is longer than it should be


class PolefenceError(Exception):
    """Root of every error raised on purpose by this package."""


class InputError(PolefenceError, ValueError):
    """Something the caller gave cannot be used; the message is one line that names it."""

    def __str__(self) -> str:
        """Return the message in one line, whatever values it quotes: an array has many."""
        text = " ".join(super().__str__().split())
        return text if len(text) <= BEGIN + END else f"{text[:BEGIN]} ... {text[-END:]}"


class SpecError(InputError):
    """A spec file, or the description of a plant, is malformed."""


class PlantError(InputError):
    """A plant family is inconsistent: shapes, values, intervals."""


class MultiAffinityError(PlantError):
    """The family is not multi-affine in its scheduling variables, so its corners do not span it."""


class UncontrollableError(PlantError):
    """A pole of a vertex that no gain moves is not in the region."""


class UnobservableError(PlantError):
    """Measurements do not show the whole state of a vertex: no observer moves all poles."""


class RegionError(InputError):
    """A region is empty, unbounded where it must not be, or on the wrong side."""


class ParameterValueError(InputError):
    """Parameter values or alpha lie outside the declared set."""


class DesignFileError(InputError):
    """A design file is cut short, malformed, or of a format this version does not read."""


class OutputError(InputError):
    """A result cannot be written where it was asked for."""


class MissingExtraError(PolefenceError, ImportError):
    """An optional dependency is not installed; the message gives the command that installs it."""


class SolverError(PolefenceError):
    """A numerical solver gave no usable point; callers answer "undecided"."""


class NotProvedError(PolefenceError):
    """The region was asked for and is not proved.

    Attributes
    ----------
    best : Design or None
        The design of the same method and centre with the smallest disk that was proved.
    refutation : Refutation or None
        The proof that no law keeps the limits that were asked for.
    """

    def __init__(self, message: str, best: Any = None, refutation: Any = None) -> None:
        super().__init__(message)
        self.best, self.refutation = best, refutation


def shown(value: Any) -> str:
    """Quote a value in a message: cut to a part of a line, a table or a list by its kind alone."""
    if isinstance(value, dict | list | tuple):
        return "a table" if isinstance(value, dict) else "a list"
    if getattr(value, "shape", ()):
        return f"an array of shape {value.shape}"
    if isinstance(value, str):
        return repr(value if len(value) <= LONGEST else f"{value[: LONGEST - 3]}...")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | Fraction):
        try:
            return f"{float(value):.9g}"
        except OverflowError:
            return "a number beyond 1e308"
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def suggest(word: str, known: Iterable[str]) -> str:
    """Say which known word was probably meant, or list them all."""
    words = sorted(known)
    word = word[:LONGEST]
    lower = {w.lower(): w for w in words}
    near = difflib.get_close_matches(word.lower(), lower, n=1)
    return (
        f"did you mean {lower[near[0]]!r}?"
        if near
        else f"known: {', '.join(_listed(words)) or 'none'}"
    )


def _listed(words: Sequence[str]) -> list[str]:
    """Return words with x1, x2, ..., x270 in one: "x1 to x270"."""
    series = dict[str, list[int]]()
    for word in words:
        name = word.rstrip("0123456789")
        if name != word and not word[len(name) :].startswith("0"):
            series.setdefault(name, []).append(int(word[len(name) :]))
    long = {
        name: sorted(numbers)
        for name, numbers in series.items()
        if len(numbers) > 3 and max(numbers) - min(numbers) == len(numbers) - 1
    }
    inside = {f"{name}{k}" for name, numbers in long.items() for k in numbers}
    listed = [word for word in words if word not in inside]
    return sorted(listed + [f"{name}{k[0]} to {name}{k[-1]}" for name, k in long.items()])


def require_type(value: object, kind: type, name: str, remedy: str) -> None:
    """Refuse a value of another type, with a remedy."""
    if not isinstance(value, kind):
        given = type(value).__name__
        raise InputError(f"{name} must be of type {kind.__name__}, not {given}; {remedy}")
