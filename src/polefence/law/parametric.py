"""Entries that are polynomials in a plant's parameters, in the coordinates of laws."""

from __future__ import annotations

from fractions import Fraction

from polefence.base.errors import InputError, PlantError, SpecError, shown
from polefence.law.structure import MAX_DEGREE
from polefence.plant.expression import RationalFunction, counted, evaluate
from polefence.plant.family import UncertainPlant
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

    def term(self, entry: Entry, place: str) -> Term:
        """Return exponents and coefficients."""
        zero = (0,) * self.count
        if not isinstance(entry, str):
            return {zero: entry} if entry else {}
        try:
            with counted():
                value = self._shifted(evaluate(entry, self.names, self.one), entry)
        except (SpecError, PlantError) as problem:
            raise type(problem)(f"{place}: {problem}") from problem
        if value.is_constant:
            number = value([ZERO] * value.count)
            return {zero: number} if number else {}
        degree = max(map(sum, value.numerator))
        if degree > MAX_DEGREE:
            raise InputError(
                f"{place} = {shown(entry)} has degree {degree} in the parameters; at most "
                f"{MAX_DEGREE} is supported: give a table of gains at knots"
            )
        return value.numerator

    def _shifted(self, value: RationalFunction, entry: str) -> RationalFunction:
        (constant, *others) = [*value.denominator]
        if others or any(constant):
            through = ", ".join(p.through for p in self.plant.parameters)
            raise PlantError(
                f"{shown(entry)} is no polynomial in {through}; give a polynomial near to it, or a "
                "table at knots, {grid: {name: knots}, gains: ...}"
            )
        total = RationalFunction.constant(ZERO, value.count)
        for e, c in value.numerator.items():
            term = self.one * (c / value.denominator[constant])
            for variable, power in zip(self.shifted, e, strict=True):
                term = term * variable**power
            total = total + term
        return total
