"""The sources that belong to constants: written again, to compare with those that are there."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.design import Design
from polefence.errors import InputError
from polefence.export.c99.number import number
from polefence.export.c99.program import Fixed, Program, Scheduled, Share
from polefence.export.c99.sources import Texts
from polefence.law import FixedGain, Law, ScheduledGain
from polefence.measured import DUAL
from polefence.plant.family import UncertainPlant
from polefence.proof.certificate import Certificate
from polefence.proof.rounding import Code


def require_law(design: Design) -> None:
    """Refuse an observer's design: its gain is no law of the plant."""
    if design.plant.name.endswith(DUAL):
        raise InputError(
            f"{design.plant.name}: the design of an observer, no law; export the state feedback's "
            "design and name this one as its observer (--observer)"
        )


def code_law(law: Law) -> Law:
    """Return the law as code computes it: that of one vertex is one gain."""
    if isinstance(law, ScheduledGain) and law.domain.corners == 1:
        return FixedGain(law.gain([1.0]))
    return law


def names(design: Design | Certificate) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of states and inputs, numbered where the plant has none."""
    plant: UncertainPlant = design.plant
    n, m = plant.shape
    states = tuple(plant.states) or tuple(f"state {j + 1}" for j in range(n))
    return states, tuple(plant.inputs) or tuple(f"input {j + 1}" for j in range(m))


def program_again(code: Code, certificate: Certificate) -> Program:
    """Return the program that has these constants."""
    form, law = number(code.bits), certificate.law
    if code.K is not None or isinstance(law, FixedGain):
        return Fixed(form, _floats(code.K))
    pairs = zip(certificate.plant.parameters, code.shares, strict=False)
    shares = tuple(Share(p, float(s.low), float(s.high), float(s.scale)) for p, s in pairs)
    W, Z = (np.array([_floats(each) for each in table]) for table in (code.W, code.Z))
    return Scheduled(form, shares, law.domain, law.degree, _floats(code.T), W, Z)


def texts_document(texts: Texts) -> dict[str, Any]:
    """Return what the sources say of themselves as plain data; the plant has the rest."""
    return {
        "name": texts.name,
        "statement": list(texts.statement),
        "limits": list(texts.limits),
        "sample_time": texts.sample_time,
        "delay": texts.delay,
    }


def texts_again(table: Any, certificate: Certificate) -> Texts:
    """Return them again.

    Raises
    ------
    InputError
        If the table is not one that `texts_document` wrote.
    """
    kinds = {"name": str, "statement": list, "limits": list, "delay": int}
    if not isinstance(table, dict) or any(type(table.get(k)) is not t for k, t in kinds.items()):
        raise InputError("text: name, statement, limits, sample_time or delay are missing")
    lines, limits, time = table["statement"], table["limits"], table.get("sample_time")
    if not all(isinstance(line, str) for line in lines):
        raise InputError("text.statement must be a list of lines")
    numbers = [*limits, 1.0 if time is None else time]
    if not all(isinstance(v, int | float) and 0 < v < 1e30 for v in numbers):
        raise InputError("text: limits and sample_time must be positive numbers")
    return Texts(
        table["name"],
        certificate.plant.name,
        tuple(lines),
        *names(certificate),
        tuple(map(float, limits)),
        None if time is None else float(time),
        table["delay"],
    )


def _floats(matrix: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([[float(value) for value in row] for row in matrix or []])
