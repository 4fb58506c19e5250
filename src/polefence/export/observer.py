"""C99 of an observer beside the law: what its templates are given, and the text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.observer import Observer
from polefence.export.c99.number import Number
from polefence.export.c99.program import LEAST, MOST, Scheduled, program
from polefence.export.c99.sources import Texts, context, environment, rows, weighing
from polefence.export.c99.text import check_c_name
from polefence.export.sampled.observer_loop import ORDER, check_sample_time
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import binomial
from polefence.plant.system import Array, Exact
from polefence.region.text import short_text

LONGEST = 20  # characters: C tells external names apart by 31


def observer_sources(
    observer: Observer,
    number: Number,
    texts: Texts,
    parameters: tuple[Parameter, ...],
    sample_time: float | None,
) -> dict[str, str]:
    """Return the observer's header and source, by the files' names; they include the law's header.

    Parameters
    ----------
    observer : Observer
    number : Number
        The law's.
    texts : Texts
        The law's: the observer's files and functions are called ``<name>_observer``.
    parameters : tuple of Parameter
        What the code is given; empty for alpha itself. A plant of one vertex needs neither.
    sample_time : float, optional
        From one update to the next [s]; in discrete time the plant's own, or None.

    Raises
    ------
    InputError
        If the sample time is too long for the observer, a name is too long for C, the texts are of
        another plant, or a number is out of the format's range.
    """
    check_c_name(texts.name)
    if len(texts.name) > LONGEST:
        raise InputError(
            f"name = {texts.name!r} is too long for the functions of an observer; use at most "
            f"{LONGEST} characters"
        )
    shape = len(texts.states), len(texts.inputs)
    if shape != observer.plant.shape:
        raise InputError(
            f"{shape[0]} states and {shape[1]} inputs are named; the observer's plant has "
            f"{observer.plant.shape[0]} and {observer.plant.shape[1]}"
        )
    step = check_sample_time(observer, sample_time)
    templates = environment()
    given = _context(observer, number, texts, parameters, step)
    return {
        f"{texts.name}_observer.{ending}": templates.get_template(f"observer.{ending}.j2").render(
            given
        )
        for ending in "hc"
    }


def _context(
    observer: Observer,
    number: Number,
    texts: Texts,
    parameters: tuple[Parameter, ...],
    sample_time: float,
) -> dict[str, Any]:
    discrete = observer.plant.sample_time is not None
    p, n = observer.C.shape[1:]
    gain, carrier = _programs(observer, parameters, number)
    tables, varying = _plant_tables(observer, number, carrier)
    L = np.zeros((n, p)) if gain is not None else _constant_gain(observer)
    tables.append(rows(number, _held(number.nearest(L), "L")))
    over = [number.text(float(v)) for v in number.nearest(sample_time / np.arange(1, ORDER + 1))]
    return _common(observer, number, texts, carrier) | {
        "equation": f"{'x^(next)' if discrete else 'd/dt x^'} = A x^ + B u + L (y - C x^),",
        "claim": _claim(observer),
        "measured": observer.design.plant.inputs or [f"measured signal {j + 1}" for j in range(p)],
        "sample_time": over[0],
        "discrete": discrete,
        "over": over,
        "still": [number.text(0.0)] * p,
        "nothing": [number.text(0.0)] * n,
        "tables": tables,
        "varying": varying,
        **_gain_tables(number, gain),
    }


def _common(
    observer: Observer, number: Number, texts: Texts, carrier: Scheduled | None
) -> dict[str, Any]:
    """Return what the law's template is given too, for the observer's names."""
    own = replace(texts, name=f"{texts.name}_observer", limits=())
    real, NAME = f"{texts.name}_real", own.name.upper()
    arguments = [
        f"{own.name} *observer",
        f"const {real} u[{texts.name.upper()}_INPUTS]",
        f"const {real} y[{NAME}_MEASURED]",
    ]
    if carrier is None:
        none = program(FixedGain(np.zeros(observer.plant.shape[::-1])), (), number)
        common = context(none, own)
    else:
        common = context(carrier, own) | {"weighing": weighing(carrier, real)}
        arguments.insert(1, f"const {real} {common['letter']}[{NAME}_{common['GIVEN']}]")
    return common | {"law": texts.name, "LAW": texts.name.upper(), "arguments": arguments}


def _gain_tables(number: Number, gain: Scheduled | None) -> dict[str, Any]:
    if gain is None:
        return {"gain_T": [], "gain_W": [], "gain_Z": []}
    lower = np.tril_indices(gain.shape[0])
    return {
        "gain_T": [number.text(v) for v in gain.T[lower]],
        "gain_W": rows(number, gain.W[:, lower[0], lower[1]].T),
        "gain_Z": rows(number, gain.Z.reshape(len(gain.Z), -1).T),
    }


def _constant_gain(observer: Observer) -> Array:
    fixed = isinstance(observer.design.law, FixedGain)
    return observer.gain(None if fixed else [1.0])  # one vertex


def _programs(
    observer: Observer, parameters: tuple[Parameter, ...], number: Number
) -> tuple[Scheduled | None, Scheduled | None]:
    """Return the program of a scheduled gain, and one that finds alpha's polynomials.

    A fixed gain has no program of its own, and a plant of one vertex needs no alpha.
    """
    law, N = observer.design.law, len(observer.plant.vertices)
    if N == 1:
        return None, None
    if isinstance(law, FixedGain):
        n = observer.plant.shape[0]
        law = ScheduledGain(np.stack([np.eye(n)] * N), np.zeros((N, 1, n)), parameters)
        found = program(law, parameters, number)
        return None, found if isinstance(found, Scheduled) else None
    found = program(law, parameters, number)
    return (found, found) if isinstance(found, Scheduled) else (None, None)


def _plant_tables(
    observer: Observer, number: Number, carrier: Scheduled | None
) -> tuple[list[list[list[str]]], list[dict[str, Any]]]:
    """Return A, B, C with the entries that do not depend on alpha, and the others."""
    vertices = observer.plant.vertices
    matrices: dict[str, Sequence[Exact]] = {
        "a": [v.exact_A for v in vertices],
        "b": [v.exact_B for v in vertices],
        "c": observer.exact_C,
    }
    tables, varying = [], list[dict[str, Any]]()
    for letter, each in matrices.items():
        table = []
        for i in range(len(each[0])):
            line = []
            for j in range(len(each[0][0])):
                corners = [M[i][j] for M in each]
                same = all(value == corners[0] for value in corners)
                line.append(corners[0] if same else Fraction(0))
                if not same and carrier is not None:
                    row = _constants(number, _coefficients(carrier, corners), letter)
                    varying.append({"place": f"{letter}[{i}][{j}]", "row": row})
            table.append(_constants(number, line, letter))
        tables.append(table)
    return tables, varying


def _coefficients(carrier: Scheduled, corners: list[Fraction]) -> list[Fraction]:
    """Return the Bernstein coefficients, in the law's degree, of what is affine in alpha."""
    domain, degree = carrier.domain, carrier.degree
    terms = zip(domain.monomials(degree), domain.elevated(1, degree - 1), strict=True)
    return [
        sum((weight * corners[j] for j, weight in row.items()), Fraction(0))
        / binomial(domain.sizes, exponent)
        for exponent, row in terms
    ]


def _constants(number: Number, values: list[Fraction], letter: str) -> list[str]:
    floats = number.nearest(np.array([float(v) for v in values]))
    return [number.text(float(v)) for v in _held(floats, letter.upper())]


def _held(values: Array, what: str) -> Array:
    size = np.abs(values[values != 0])
    if size.size and not size.max() <= MOST:
        raise InputError(
            f"{what} of the observer: numbers reach {size.max():.3g}, too large for the code; "
            "choose units in which states, inputs and measured signals are nearer to one"
        )
    return np.where(np.abs(values) < LEAST**2, 0.0, values)


def _claim(observer: Observer) -> list[str]:
    region = short_text(observer.region)
    proved = "Proved" if observer.design.proved else "NOT PROVED"
    lines = [
        f"{proved}: all poles of A - L C lie in {region} whatever the parameters, kept",
        "constant, and known to this code.",
    ]
    if observer.plant.sample_time is None:
        lines += [
            "That is about the differential equation; here y and u are held over a sample time,",
            f"and it is stepped by the Taylor series of order {ORDER}.",
        ]
    return [*lines, "Nothing is proved of this code's rounding."]
