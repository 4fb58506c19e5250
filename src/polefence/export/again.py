"""The sources that belong to constants: written again, to compare with those that are there."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.certificate import Certificate
from polefence.design.design import Design
from polefence.design.measured import DUAL
from polefence.export.c99.number import number
from polefence.export.c99.program import Fixed, Program, Scheduled, Share
from polefence.export.c99.sources import Texts
from polefence.export.statement import Facts, Seen, statement
from polefence.law.laws import FixedGain, Law, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.proof.claims.rounding import Code


def require_law(design: Design) -> None:
    """Refuse an observer's design: its gain is no law of the plant."""
    if design.certificate.observer or design.plant.name.endswith(DUAL):
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


def text_document(texts: Texts, seen: Seen | None) -> dict[str, Any]:
    """Return what the sources say of themselves beside what is proved, as plain data."""
    table: dict[str, Any] = {"name": texts.name, "limits": list(texts.limits)}
    return table if seen is None else table | {"sampled": asdict(seen)}


def texts_again(table: Any, certificate: Certificate, facts: Facts) -> Texts:
    """Return the texts of what is proved and sampled.

    Raises
    ------
    InputError
        If the table is not one that `text_document` wrote.
    """
    known = {"name", "limits"} | ({"sampled"} if facts.loop else set())
    if not isinstance(table, dict) or table.keys() != known:
        raise InputError(f"text must hold {', '.join(sorted(known))}, and nothing else")
    name, limits = table["name"], table["limits"]
    if not isinstance(name, str) or not isinstance(limits, list):
        raise InputError("text: name must be text, limits a list")
    if not all(_is_number(v) and 0 < v < 1e30 for v in limits):
        raise InputError("text: limits must be positive numbers")
    facts = replace(facts, limited=bool(limits))
    loop, own = facts.loop, certificate.plant.sample_time
    time = loop.sample_time if loop else None if own is None else float(own)
    return Texts(
        name,
        certificate.plant.name,
        statement(facts),
        *names(certificate),
        tuple(map(float, limits)),
        time,
        loop.delay if loop else 0,
    )


def seen_again(table: Any, observed: bool) -> Seen:
    """Return what was sampled, as the file has it: lines about it say that it is not proved.

    Raises
    ------
    InputError
        If the table is not one that `text_document` wrote.
    """
    own = table.get("sampled") if isinstance(table, dict) else None
    if not isinstance(own, dict) or own.keys() != {field.name for field in fields(Seen)}:
        raise InputError("text.sampled: what was sampled of the loop is missing, or more is there")
    pair = own["observer"]
    beside = [0, 0.0] if pair is None else pair
    if not isinstance(beside, list) or len(beside) != 2 or (pair is not None) is not observed:
        raise InputError("text.sampled.observer must be two numbers, where there is an observer")
    counts, numbers = (own["points"], beside[0]), (own["decay"], own["region"], own["stable"])
    if not all(type(count) is int and 0 <= count < 10**9 for count in counts) or not all(
        _is_number(v) and abs(v) < 1e30 for v in (*numbers, beside[1])
    ):
        raise InputError("text.sampled: points must be a whole number, others finite numbers")
    if type(own["inside"]) is not bool:
        raise InputError("text.sampled.inside must be true or false")
    found = None if pair is None else (beside[0], float(beside[1]))
    decay, region, stable = map(float, numbers)
    return Seen(own["points"], own["inside"], decay, region, stable, found)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _floats(matrix: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([[float(value) for value in row] for row in matrix or []])
