"""Control laws in any form that users have: a gain, a scheduled or polynomial one, a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.base.errors import InputError, require_type
from polefence.base.explained import explained
from polefence.law.fixed import FixedGain
from polefence.law.law import ROUNDING, Law, check_alpha, right_divide
from polefence.law.polynomial import PolynomialGain
from polefence.law.scheduled import ScheduledGain
from polefence.law.table import GainTable, table_from
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import states
from polefence.plant.system import Array
from polefence.plant.weights import measurable
from polefence.proof import laws as proof

__all__ = [
    "ROUNDING",
    "FixedGain",
    "GainTable",
    "Law",
    "PolynomialGain",
    "ScheduledGain",
    "check_alpha",
    "given_law",
    "law_of",
    "law_or_table",
    "right_divide",
    "table_from",
]


@explained
def given_law(plant: UncertainPlant, law: Any) -> Law:
    """Return a law in any of the forms that users have it in, checked against the plant.

    Where alpha comes from parameters, a scheduled law of degree 1 on the simplex is returned as
    one on their box: there it is the same law, and the box is what matters.

    Raises
    ------
    InputError
        If it is none, or does not fit.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    law = law.as_law() if hasattr(law, "as_law") else law
    given = law if isinstance(law, Law) else FixedGain(_of_all(plant, _matrix(plant, law)))
    n, m = plant.shape
    if given.shape != (m, n):
        raise InputError(
            f"the gain is {given.shape[0]} x {given.shape[1]}; {plant.name} needs {m} x {n}"
        )
    return given.fitted(plant)


def _of_all(plant: UncertainPlant, K: Any) -> Any:
    """Return a gain of what can be measured as one of all states: of those of weights zero."""
    known = measurable(plant)
    if np.ndim(K) != 2 or np.shape(K)[1] != len(known) or len(known) == plant.shape[0]:
        return K
    wide = np.zeros((len(K), plant.shape[0]))
    wide[:, [x.name in known for x in states(plant)]] = K
    return wide


def law_or_table(plant: UncertainPlant, law: Any) -> Law | GainTable:
    """Return what `given_law` does, and a table as it is.

    Raises
    ------
    InputError
        If it is none, or does not fit.
    """
    return law if isinstance(law, GainTable) else given_law(plant, law)


def law_of(exact: proof.Law, plant: UncertainPlant, sizes: tuple[int, ...]) -> Law:
    """Return the law of a claim in exact rationals.

    Parameters
    ----------
    sizes : tuple of int
        Corners of the simplices of the claim.
    """
    K, W, Z = (_floats(matrices or []) for matrices in (exact.K, exact.W, exact.Z))
    if exact.polynomial:
        measured = tuple(plant.signal(name) for name in exact.measured)
        gain = None if exact.anti_windup is None else _floats([exact.anti_windup])[0]
        return PolynomialGain(exact.powers, K, measured, plant.parameters, gain)
    if exact.K is None:
        return ScheduledGain(W, Z, plant.parameters, exact.degree, sizes)
    return FixedGain(K[0])


def _floats(matrices: Any) -> Array:
    return np.array([[[float(x) for x in row] for row in M] for M in matrices])


def _matrix(plant: UncertainPlant, law: Any) -> Any:
    if hasattr(law, "nstates"):  # of python-control
        if law.nstates or not hasattr(law, "D"):
            raise InputError(
                "the controller is a dynamic system; polefence.analyse takes it, and its saved "
                "design goes on from there; here give a static gain, u = K x"
            )
        law = law.D
    try:
        K = np.asarray(law, dtype=float)
    except (TypeError, ValueError, OverflowError):
        K = np.zeros(0)
    if K.ndim != 2 or not np.all(np.isfinite(K)):
        n, m = plant.shape
        raise InputError(f"the gain must be {m} x {n} finite numbers, a list of rows: [[...]]")
    return K
