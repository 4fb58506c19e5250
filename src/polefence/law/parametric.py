"""Entries that are functions of a plant's parameters: polynomials, and quotients of these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, SpecError, shown
from polefence.law.scheduled import ScheduledGain
from polefence.law.structure import MAX_DEGREE
from polefence.plant.expression import RationalFunction, counted, evaluate
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.polynomial import Domain
from polefence.proof.matrices import ONE, ZERO

Entry = Fraction | str
Term = dict[tuple[int, ...], Fraction]


class Entries:
    """Entries as polynomials in the coordinates of a plant's parameters, from -1 to 1."""

    def __init__(self, plant: UncertainPlant) -> None:
        self.plant, q = plant, len(plant.parameters)
        self.count = q or len(plant.vertices)
        self.one = RationalFunction.constant(ONE, q)
        self.names, self.shifted = {}, list[RationalFunction]()
        for index, p in enumerate(plant.parameters):
            s = RationalFunction.variable(index, q)
            self.names[p.name] = 1 / s if p.inverted else s
            low, high = p.scheduling(p.low), p.scheduling(p.high)
            self.shifted.append(s * ((high - low) / 2) + (low + high) / 2)

    def value(self, entry: Entry, place: str) -> RationalFunction:
        """Return an entry as a function of the scheduling variables."""
        if not isinstance(entry, str):
            return self.one * entry
        try:
            with counted():
                value: RationalFunction = evaluate(entry, self.names, self.one)
        except (SpecError, PlantError) as problem:
            raise type(problem)(f"{place}: {problem}") from problem
        degree = max(map(sum, [*value.numerator, *value.denominator]), default=0)
        if degree > MAX_DEGREE:
            raise InputError(
                f"{place} = {shown(entry)} has degree {degree} in the parameters; at most "
                f"{MAX_DEGREE} is supported: give a table of gains at knots"
            )
        return value

    def term(self, entry: Entry, place: str) -> Term:
        """Return exponents and coefficients of a polynomial in the coordinates."""
        zero = (0,) * self.count
        if not isinstance(entry, str):
            return {zero: entry} if entry else {}
        value = self.value(entry, place)
        if not is_polynomial(value):
            through = ", ".join(p.through for p in self.plant.parameters)
            raise PlantError(
                f"{place}: {shown(entry)} is no polynomial in {through}, as entries of laws with "
                "states must be; give a polynomial near to it, or a table at knots as grid"
            )
        if value.is_constant:
            number = value([ZERO] * value.count)
            return {zero: number} if number else {}
        (constant,) = value.denominator.values()
        total = RationalFunction.constant(ZERO, value.count)
        with counted():
            for e, c in value.numerator.items():
                term = self.one * (c / constant)
                for variable, power in zip(self.shifted, e, strict=True):
                    term = term * variable**power
                total = total + term
        return total.numerator


def is_polynomial(value: RationalFunction) -> bool:
    """Whether a function has a constant denominator."""
    return not any(any(e) for e in value.denominator)


def quotient_gain(
    plant: UncertainPlant,
    values: Sequence[Sequence[RationalFunction]],
    measured: Sequence[Output],
) -> ScheduledGain:
    """Return Z W^-1 with W = d I, d the product of the entries' denominators.

    Raises
    ------
    InputError
        If d is not seen to be positive on the box, its degree is too high, or a disturbance passes
        into what is measured.
    """
    q, n = len(plant.parameters), plant.shape[0]
    every = list[Any]()
    for value in (value for row in values for value in row):
        every += [value.denominator] if value.denominator not in every else []
    one = RationalFunction.constant(ONE, q)
    with counted():
        d = math.prod((RationalFunction(p, one.numerator, q) for p in every), start=one)
        over = [[_over(value, every) for value in row] for row in values]
    varied = any(len(y.C) > 1 for y in measured)
    degree = max(max(e, default=0) for f in (d, *(f for row in over for f in row))
                 for e in f.numerator or [(0,)]) + varied  # fmt: skip
    if degree > MAX_DEGREE:
        raise InputError(
            f"the gains over one denominator have degree {degree} in a parameter; at most "
            f"{MAX_DEGREE} is supported: give a table of gains at knots"
        )
    if any(y.F for y in measured):
        raise InputError(
            "a gain with a denominator, and a disturbance that passes straight into what it "
            "measures; give a polynomial near to it"
        )
    domain = Domain((2,) * q)
    at = domain.nodes(degree)
    ends = [(p.scheduling(p.low), p.scheduling(p.high)) for p in plant.parameters]
    points = [
        [low + (high - low) * Fraction(share) for (low, high), share in zip(ends, w, strict=True)]
        for w in domain.coordinates(at)[:, 1::2].tolist()
    ]
    bottom = np.array([float(d(point)) for point in points])
    top = np.array([[[float(f(point)) for f in row] for row in over] for point in points])
    if measured:
        C = np.stack([y.arrays(plant)[0] for y in measured], axis=1)
        top = top @ np.tensordot(at, C, 1)
    sign = np.sign(bottom[0]) / np.abs(bottom).max()
    W = domain.interpolated(sign * bottom[:, None, None] * np.eye(n), degree)
    if np.diagonal(W, axis1=1, axis2=2).min() <= 1e-9:
        names = " and ".join(p.name for p in plant.parameters)
        raise InputError(
            f"the denominator of the gains is not seen to keep its sign for all {names}; give a "
            "polynomial near to it, or a table at knots as grid"
        )
    Z = domain.interpolated(sign * top, degree)
    return ScheduledGain(W, Z, plant.parameters, degree, domain.sizes)


def _over(value: RationalFunction, every: Sequence[Any]) -> RationalFunction:
    """Return the numerator of an entry over the product of all denominators."""
    one = RationalFunction.constant(ONE, value.count).numerator
    others = (p for p in every if p != value.denominator)
    start = RationalFunction(value.numerator, one, value.count)
    return math.prod((RationalFunction(p, one, value.count) for p in others), start=start)
