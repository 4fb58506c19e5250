"""Exact corner matrices of matrices of expressions, with the exact multi-affinity test."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from polefence.base.errors import MultiAffinityError, PlantError, SpecError, shown, suggest
from polefence.plant.expression import evaluate
from polefence.plant.parameters import Parameter, check_name, exact
from polefence.plant.rational import RationalFunction
from polefence.plant.system import Exact, read_matrix


def corners(
    letter: str, rows: Any, parameters: tuple[Parameter, ...]
) -> dict[tuple[int, ...], Exact]:
    """Evaluate a matrix of rational functions at every corner, after the multi-affinity test."""
    try:
        table = [list(row) for row in rows]
    except TypeError as error:
        raise PlantError(f"{letter} must be a list of rows, [[...], [...]]") from error
    box = [(p.scheduling(p.low), p.scheduling(p.high)) for p in parameters]
    sides = list(itertools.product((0, 1), repeat=len(box)))
    one = RationalFunction.constant(Fraction(1), len(box))
    box_corner = [low for low, _ in box]
    values: dict[tuple[int, ...], list[list[Fraction]]] = {side: [] for side in sides}
    for i, row in enumerate(table):
        for side in sides:
            values[side].append([])
        for j, given in enumerate(row):
            place = f"{letter}[{i + 1}][{j + 1}]"
            entry = _lift(one, given, place)
            if entry.is_constant:  # most entries of a large plant
                value = entry(box_corner)
                for side in sides:
                    values[side][-1].append(value)
                continue
            corner = {}
            for side in sides:
                point = [pair[s] for pair, s in zip(box, side, strict=True)]
                try:
                    corner[side] = entry(point)
                except ZeroDivisionError as error:
                    raise PlantError(f"{place} divides by zero at a corner of the box") from error
                values[side][-1].append(corner[side])
            if not entry.equals_multiaffine(corner, box):
                raise MultiAffinityError(_not_multiaffine(place, parameters))
    return {side: read_matrix(values[side], letter) for side in sides}


def _lift(one: RationalFunction, given: Any, place: str) -> RationalFunction:
    try:
        return one.lift(given if isinstance(given, RationalFunction) else exact(given, place))
    except PlantError as error:
        raise PlantError(f"{place}: {error}") from error


def _not_multiaffine(place: str, parameters: tuple[Parameter, ...]) -> str:
    variables = ", ".join(p.through for p in parameters)
    return (
        f"{place} is not multi-affine in the scheduling variables ({variables}), so the corners do "
        'not cover the family; change a parameter\'s "through" (p or 1/p), make a product or a '
        "power a parameter of its own (m2 = m**2, with its interval), or give vertices of a "
        "polytope that contains the family"
    )


class Scope(Mapping[str, Any]):
    """Names of one spec: parameters, constants, and definitions evaluated when first used."""

    def __init__(
        self,
        parameters: Sequence[Parameter],
        constants: Mapping[str, Any],
        definitions: Mapping[str, str],
    ) -> None:
        self.constants = {k: exact(v, f"constants.{k}") for k, v in constants.items()}
        self.definitions = dict(definitions)
        self.bound: dict[str, Any] = {}
        self.pending: list[str] = []
        names = [p.name for p in parameters]
        for name in [*constants, *definitions]:
            check_name(name)
            if name in names:
                raise SpecError(f"name {name!r} is given twice; rename one")
            names.append(name)
        self.names = names

    def bind(self, values: dict[str, RationalFunction]) -> None:
        """Give the parameters their symbolic values; definitions are evaluated afresh."""
        count = len(values)
        self.one = RationalFunction.constant(Fraction(1), count)
        self.bound = dict(values) | {k: self.one.lift(v) for k, v in self.constants.items()}

    def entry(self, given: Any, place: str) -> Any:
        """Return one matrix entry: a number as it is, an expression evaluated."""
        if not isinstance(given, str):
            return given
        try:
            return evaluate(given, self, self.one)
        except (SpecError, PlantError) as error:
            raise type(error)(f"{place}: {error}") from error

    def __getitem__(self, name: str) -> Any:
        if name not in self.bound:
            if name not in self.definitions:
                raise SpecError(f"unknown name {shown(name)}; {suggest(name, self.names)}")
            if name in self.pending:
                raise SpecError(f"definitions go in a circle: {' -> '.join([*self.pending, name])}")
            self.pending.append(name)
            self.bound[name] = self.entry(self.definitions[name], f"definitions.{name}")
            self.pending.pop()
        return self.bound[name]

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Any:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)
