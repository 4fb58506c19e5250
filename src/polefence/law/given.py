"""Laws in any of the forms that users have them in, checked against a plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.types import require_type
from polefence.law.laws import FixedGain, Law, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain


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
    if not isinstance(law, FixedGain | ScheduledGain):
        law = FixedGain(_matrix(plant, law))
    n, m = plant.shape
    shape = law.K.shape if isinstance(law, FixedGain) else law.Z.shape[1:]
    if shape != (m, n):
        raise InputError(f"the gain is {shape[0]} x {shape[1]}; {plant.name} needs {m} x {n}")
    return law if isinstance(law, FixedGain) else _scheduled(plant, law)


def _matrix(plant: UncertainPlant, law: Any) -> Any:
    if hasattr(law, "nstates"):  # of python-control
        if law.nstates or not hasattr(law, "D"):
            raise InputError(
                "the controller is a dynamic system; give a static gain, u = K x, and put states "
                "of the controller, such as integrals, into the plant"
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


def _scheduled(plant: UncertainPlant, law: ScheduledGain) -> ScheduledGain:
    N = len(plant.vertices)
    if law.domain.corners != N:
        raise InputError(f"the law has {law.domain.corners} vertices; {plant.name} has {N}")
    theirs, ours = (_ranges(each.parameters) for each in (law, plant))
    if theirs and ours and theirs != ours:
        raise InputError(f"the law's parameters, or their ranges, are not those of {plant.name}")
    if ours and law.degree == 1:
        return replace(law, sizes=Domain.of("box", N).sizes)
    return law


def _ranges(parameters: Sequence[Parameter]) -> list[tuple[str, Fraction, Fraction, str]]:
    return [(p.name, p.low, p.high, p.through) for p in parameters]


def domain_of(plant: UncertainPlant, law: Law) -> Domain:
    """Return where a claim is made: the law's own domain; the box where there are parameters."""
    if isinstance(law, ScheduledGain):
        return law.domain
    return Domain.of("box" if plant.parameters else "simplex", len(plant.vertices))
