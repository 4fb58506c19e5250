"""Systems as plain data: structures of MATLAB, tables of JSON, attributes of python-control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.plant.parameters import exact
from polefence.plant.transfer import Quotient, of_roots, quotient

LETTERS = ("A", "B", "C", "D")
WANTED = "give A, B, C and D, or numerator and denominator, or zeros, poles and gain"
# Keys in small letters, and the short names that others have for them.
MATRICES = {letter: (letter.lower(),) for letter in LETTERS}
FRACTION = {"numerator": ("numerator", "num"), "denominator": ("denominator", "den")}
ROOTS = {"zeros": ("zeros", "z"), "poles": ("poles", "p"), "gain": ("gain", "k")}
TIME = ("sample_time", "ts", "dt")
MORE = (*TIME, "e", "measured", "grid")


def is_fields(data: Any) -> bool:
    """Whether plain data have what makes a system."""
    return isinstance(data, Mapping) and form_of(_small(data)) is not None


def form_of(own: Mapping[str, Any]) -> Mapping[str, tuple[str, ...]] | None:
    """Return which keys a table with small letters has: matrices, coefficients or roots."""
    if {"a", "b", "c"} <= own.keys() or ({"d"} <= own.keys() and not {"z", "num"} & own.keys()):
        return MATRICES
    for keys in (FRACTION, ROOTS):
        if all(any(name in own for name in names) for names in keys.values()):
            return keys
    return None


def known_fields(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of a structure that belong to a system: workspaces hold anything beside."""
    form = form_of(_small(data)) or {}
    wanted = {name for names in form.values() for name in names} | {*MORE}
    return {key: value for key, value in data.items() if key.lower() in wanted}


def matrices_of(
    data: Mapping[str, Any], what: str
) -> tuple[dict[str, Any], list[list[Quotient]] | None]:
    """Return matrices of a system and what stands beside them, or else its quotients.

    Raises
    ------
    InputError
        If a key is missing or unknown, or a value cannot be read.
    """
    own = _small(data)
    form = form_of(own)
    if form is None:
        raise InputError(f"{what}: {WANTED}")
    known = [name for names in form.values() for name in names]
    for key in own:
        if key not in known and key not in MORE:
            words = [*form, "sample_time", "measured", "grid"]
            raise InputError(f"{what}: unknown key {shown(key)}; {suggest(key, words)}")
    given: dict[str, Any] = {"sample_time": _time(own)}
    given |= {key: own[key] for key in ("measured", "grid") if key in own}
    if form is MATRICES:
        if _is_there(own.get("e")) and not _is_identity(own["e"]):
            raise InputError(
                f"{what} is a descriptor system, with an E; ss(K, 'explicit') of MATLAB is without"
            )
        there = {x: own[x.lower()] for x in LETTERS if _is_there(own.get(x.lower()))}
        return given | there, None
    if "grid" in given:
        raise InputError(f"{what}: a table is of A, B, C and D; realise each transfer function")
    first, second, *gain = _picked(own, form)
    if form is FRACTION:
        return given, quotients(first, second, what)
    return given, [[of_roots(first, second, gain[0], what)]]


def quotients(top: Any, bottom: Any, what: str) -> list[list[Quotient]]:
    """Return quotients of coefficients: one row of them, or one row an entry of a matrix.

    Raises
    ------
    InputError
        If they are no numbers, or their shapes differ.
    """
    tops, bottoms = _cells(top), _cells(bottom)
    if len(bottoms) == 1 and len(bottoms[0]) == 1:  # one denominator for all
        bottoms = [[bottoms[0][0]] * len(row) for row in tops]
    if [len(row) for row in tops] != [len(row) for row in bottoms] or len(set(map(len, tops))) > 1:
        raise InputError(f"{what}: numerators and denominators must be matrices of one shape")
    return [
        [
            quotient(a, b, place(what, i, j, tops))
            for j, (a, b) in enumerate(zip(above, below, strict=True))
        ]
        for i, (above, below) in enumerate(zip(tops, bottoms, strict=True))
    ]


def place(what: str, i: int, j: int, rows: Sequence[Sequence[Any]]) -> str:
    """Return what an entry is called in messages; the only one by no number."""
    return f"{what}[{i + 1}][{j + 1}]" if len(rows) * len(rows[0]) > 1 else what


def names_of(known: Callable[[str], bool]) -> tuple[str, ...]:
    """Return which of the usual names of a compensator's A, B, C and D are known: Ac, A_k, KA."""
    forms = [f"{{}}{mark}{tail}" for tail in "ckCK" for mark in ("", "_")]
    for form in (*forms, "K{}", "K_{}"):
        names = tuple(form.format(letter) for letter in LETTERS)
        if all(map(known, names[:3])):
            return names
    return ()


def _small(data: Mapping[str, Any]) -> dict[str, Any]:
    return {str(key).lower(): value for key, value in data.items()}


def _time(own: Mapping[str, Any]) -> Fraction | None:
    """Return a sample time; None where it is zero or not there: continuous time."""
    given = next((own[key] for key in TIME if _is_there(own.get(key))), None)
    if given is None:
        return None
    T = exact(np.asarray(given, dtype=object).ravel()[0], "sample_time")
    if T < 0:
        raise InputError("its sample time is not said (-1); set its Ts [s]")
    return T or None


def _picked(own: Mapping[str, Any], keys: Mapping[str, tuple[str, ...]]) -> Iterator[Any]:
    return (next(own[name] for name in names if name in own) for names in keys.values())


def _cells(value: Any) -> list[list[Any]]:
    """Return rows of what is a row of coefficients each; of one such row [[it]]."""
    if isinstance(value, list | tuple):
        inner = [list(x) if isinstance(x, list | tuple) else x for x in value]
        nested = [x for x in inner if isinstance(x, list | np.ndarray)]
        if any(isinstance(y, list | np.ndarray) for x in nested for y in x):
            return [list(row) for row in inner]
        if nested and len(nested) == len(inner) and len(inner) > 1:
            return [inner]
        return [[inner[0] if nested else inner]]
    array = np.asarray(value)
    if array.dtype == object and array.ndim == 2:
        return [list(row) for row in array]
    return [[array]]


def _is_there(value: Any) -> bool:
    return value is not None and np.size(np.asarray(value, dtype=object)) > 0


def _is_identity(value: Any) -> bool:
    array = np.asarray(value, dtype=float)
    return array.ndim == 2 and bool(np.array_equal(array, np.eye(len(array))))
