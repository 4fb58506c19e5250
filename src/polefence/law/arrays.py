"""Laws from the files of other tools."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.law.laws import FixedGain, Law, PolynomialGain, ScheduledGain, given_law
from polefence.plant.arrays import Arrays
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Exact, as_array


@explained
def law_from(arrays: Arrays, plant: UncertainPlant) -> Law:
    """Return the law of a file: K, one or one a vertex, or Z and W of K = Z W^-1, one each.

    Raises
    ------
    InputError
        If there is none, or it does not fit.
    """
    law = _law(arrays, plant)
    try:
        return given_law(plant, law)
    except InputError as problem:
        raise type(problem)(f"{arrays.place}: {problem}") from problem


def _law(arrays: Arrays, plant: UncertainPlant) -> Law:
    if "K" in arrays or len(arrays.matrices) == 1:
        K = _floats(arrays.only("K"))
        if len(K) == 1:
            return FixedGain(K[0])
        return PolynomialGain(tuple(map(tuple, np.eye(len(K), dtype=int))), K)
    if "W" in arrays and "Z" in arrays:
        return ScheduledGain(_floats(arrays["W"]), _floats(arrays["Z"]))
    if "B" not in arrays:
        return FixedGain(np.zeros(plant.shape[::-1]))
    raise InputError(f"{arrays.place}: holds neither a gain K nor W and Z; name a file that does")


def _floats(matrices: list[Exact]) -> Any:
    return np.array([as_array(M) for M in matrices])
