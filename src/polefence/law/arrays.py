"""Laws from the files of other tools."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.law.compensator import Compensator
from polefence.law.fields import is_fields, known_fields, names_of
from polefence.law.laws import FixedGain, Law, PolynomialGain, ScheduledGain, given_law
from polefence.plant.arrays import Arrays
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Exact, as_array

ALONE = (("A", "B", "C", "D"), ("a", "b", "c", "d"))  # in a file that has no plant


@explained
def law_from(arrays: Arrays, plant: UncertainPlant, alone: bool = False) -> Law:
    """Return the law of a file: K, one or one a vertex, or Z and W of K = Z W^-1, one each.

    Where the file has the plant too, and that has no B, its A are closed loops, with no law.

    Parameters
    ----------
    alone : bool
        Whether the file is named for its law.

    Raises
    ------
    InputError
        If there is none, or it does not fit.
    """
    law = _law(arrays, plant, alone)
    try:
        return given_law(plant, law)
    except InputError as problem:
        raise type(problem)(f"{arrays.place}: {problem}") from problem


@explained
def compensator_from(arrays: Arrays, alone: bool) -> tuple[Compensator, tuple[str, ...]] | None:
    """Return the compensator of a file and the names that it has there; None where there is none.

    A structure K, or Ac, Bc, Cc and Dc, or Ak and so on; in a file without a plant also any one
    structure, and A, B, C and D.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    if "K" in arrays.matrices:
        return None
    try:
        for names, fields in _found(arrays, alone):
            what = names[0] if len(names) == 1 else ""
            return Compensator.from_fields(known_fields(fields), what), names
    except InputError as problem:
        if str(problem).startswith(arrays.place):
            raise
        raise type(problem)(f"{arrays.place}: {problem}") from problem
    return None


def _found(arrays: Arrays, alone: bool) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    called = arrays.names.get("K", "K")
    structures = {name: own for name, own in arrays.structures.items() if is_fields(own)}
    if called in structures:
        yield (called,), structures[called]
    lettered = names_of(arrays.__contains__)
    if lettered:
        yield _of_matrices(arrays, lettered, alone)
    if not alone:
        return
    if len(structures) == 1:
        ((name, own),) = structures.items()
        yield (name,), own
    for letters in ALONE:
        if all(letter in arrays for letter in letters[:3]):
            yield _of_matrices(arrays, letters, alone)
    if is_fields(arrays.matrices):
        yield tuple(arrays.matrices), {name: own[0] for name, own in arrays.matrices.items()}


def _of_matrices(
    arrays: Arrays, names: tuple[str, ...], alone: bool
) -> tuple[tuple[str, ...], Mapping[str, Any]]:
    """Return matrices by their letters; the sample time is the plant's where there is one."""
    there = [name for name in names if name in arrays]
    fields: dict[str, Any] = {
        letter: arrays[name] if len(arrays.matrices.get(name, ())) > 1 else arrays.one(name)
        for letter, name in zip("ABCD", names, strict=True)
        if name in there
    }
    times = ("sample_time", "Ts", "dt") if alone else ("sample_time",)
    known = [name for name in times if arrays.holds(name)]
    if known:
        fields["sample_time"] = arrays.one(known[0])[0][0]
    if arrays.words.get("measured"):
        fields["measured"] = arrays.words["measured"]
    return (*there, *known[: int(alone)]), fields


def _law(arrays: Arrays, plant: UncertainPlant, alone: bool) -> Law:
    if "K" in arrays or (len(arrays.matrices) == 1 and not arrays.systems):
        K = _floats(arrays.only("K"))
        if len(K) == 1:
            return FixedGain(K[0])
        return PolynomialGain(tuple(map(tuple, np.eye(len(K), dtype=int))), K)
    if "W" in arrays and "Z" in arrays:
        return ScheduledGain(_floats(arrays["W"]), _floats(arrays["Z"]))
    if "B" not in arrays and not alone:
        return FixedGain(np.zeros(plant.shape[::-1]))
    several = [name for name, own in arrays.structures.items() if is_fields(own)]
    if arrays.systems:
        raise InputError(arrays.faults[arrays.systems[0]])
    raise InputError(
        f"{arrays.place}: holds neither a gain K nor W and Z, nor a compensator Ac, Bc, Cc and Dc; "
        + (
            f"name one of the systems {', '.join(several)} K"
            if several
            else "name a file that does, or write none"
        )
    )


def _floats(matrices: list[Exact]) -> Any:
    return np.array([as_array(M) for M in matrices])
