"""Entries of matrices as the corners of the box have them, and functions where these are not all.

An entry that is multi-affine in the scheduling variables is what is between its values at the
corners. Any other one is a function of the parameters that `polefence.proof.approximation` encloses
on parts of the box.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, PlantError
from polefence.plant.expression import RationalFunction
from polefence.plant.parameters import Parameter, exact
from polefence.plant.system import Exact, read_matrix
from polefence.proof.approximation import Functions
from polefence.proof.entries import MAX_FUNCTIONS, Placed
from polefence.proof.functions import Table, Tree, lift, variable
from polefence.proof.ranges import Range
from polefence.proof.work import FormatError

OUTPUTS = "outputs."
NOT_RATIONAL = object()  # an entry that holds a function or a root
Side = tuple[int, ...]
Corners = Mapping[Side, Exact]


@dataclass
class Read:
    """What is read of a family's matrices: values at corners, and functions with their places."""

    parameters: tuple[Parameter, ...]
    function: Callable[..., dict[str, Any]]
    tables: Mapping[str, Table]
    trees: dict[Tree, int] = field(default_factory=dict)
    places: dict[tuple[str, int, int], tuple[int, Fraction]] = field(default_factory=dict)
    _matrices: dict[str, Any] = field(default_factory=dict)
    _functions: list[Functions] = field(default_factory=list)

    @property
    def box(self) -> list[tuple[Fraction, Fraction]]:
        """Ends of the scheduling variables."""
        return [(p.scheduling(p.low), p.scheduling(p.high)) for p in self.parameters]

    @property
    def sides(self) -> list[Side]:
        """Corners of the box, 0 the lower end and 1 the upper one."""
        return list(itertools.product((0, 1), repeat=len(self.parameters)))

    def corners(self, letter: str, rows: Any) -> dict[Side, Exact]:
        """Return a matrix at every corner; functions among its entries are noted.

        Raises
        ------
        PlantError
            If an entry is none, or has no value somewhere.
        """
        try:
            table = [list(row) for row in rows]
        except TypeError as error:
            raise PlantError(f"{letter} must be a list of rows, [[...], [...]]") from error
        values: dict[Side, list[list[Fraction]]] = {
            side: [[] for _ in table] for side in self.sides
        }
        for i, row in enumerate(table):
            for j, given in enumerate(row):
                at = self._entry(letter, i, j, given)
                for side in self.sides:
                    values[side][i].append(at[side])
        return {side: read_matrix(values[side], letter) for side in self.sides}

    def _entry(self, letter: str, i: int, j: int, given: Any) -> Mapping[Side, Fraction]:
        """Return the values of an entry at the corners."""
        place, sides, box = f"{letter}[{i + 1}][{j + 1}]", self.sides, self.box
        if given is NOT_RATIONAL or isinstance(given, Tree):
            return self._noted(letter, i, j, place, given)
        one = RationalFunction.constant(Fraction(1), len(box))
        entry = _lift(one, given, place)
        if entry.is_constant:  # most entries of a large plant
            return dict.fromkeys(sides, entry([low for low, _ in box]))
        corner = {}
        for side in sides:
            point = [pair[s] for pair, s in zip(box, side, strict=True)]
            try:
                corner[side] = entry(point)
            except ZeroDivisionError as error:
                raise PlantError(f"{place} divides by zero at a corner of the box") from error
        if entry.equals_multiaffine(corner, box):
            return corner
        return self._noted(letter, i, j, place, given)

    def _noted(
        self, letter: str, i: int, j: int, place: str, given: Any
    ) -> Mapping[Side, Fraction]:
        """Note that an entry is a function, and return its values at the corners."""
        tree = given if isinstance(given, Tree) else self._tree(letter, i, j, place)
        factor, core = tree.factored
        if core.kind == "number":
            return dict.fromkeys(self.sides, factor * core.number)
        try:
            core.require()
            if not self.parameters:
                raise FormatError(
                    f"{core.text} is no rational number; write its digits, or give a parameter"
                )
            if core not in self.trees:
                if len(self.trees) == MAX_FUNCTIONS:
                    raise FormatError(f"at most {MAX_FUNCTIONS} functions are supported")
                one = Functions(self.ranges, (core,), tuple(self.tables.items()))
                self._functions.append(one)
                self.trees[core] = len(self.trees)
                _ = one.on_box
            number = self.trees[core]
            values = self._functions[number].on_box[1][0].corners
        except FormatError as error:
            raise PlantError(f"{place}: {error}") from error
        self.places[letter, i, j] = number, factor
        return {side: factor * x for side, x in zip(self.sides, values, strict=True)}

    def _tree(self, letter: str, i: int, j: int, place: str) -> Tree:
        """Return an entry as a tree."""
        if not self._matrices:
            trees = {p.name: variable(p.name) for p in self.parameters}
            self._matrices |= self.function(**trees)
        try:
            return lift(self._matrices[letter][i][j])
        except (TypeError, ValueError) as error:
            raise PlantError(f"{place} is no function that is known here") from error

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The parameters as proofs have them."""
        return tuple(Range(p.low, p.high, p.inverted, p.name) for p in self.parameters)

    def placed(self, table: Mapping[str, Corners]) -> Placed | None:
        """Return the functions with their places, None where there are none."""
        if not self.trees:
            return None
        functions = Functions(self.ranges, tuple(self.trees), tuple(self.tables.items()))
        widths = [len(M[0]) for M in _first(table, ("A", "B", "E"))]
        starts = dict(zip("ABE", itertools.accumulate((0, *widths)), strict=False))
        n, width = widths[0], sum(widths)
        matrices = [[[Fraction(0)] * width for _ in range(n)] for _ in self.trees]
        rows = dict[str, list[list[list[Fraction]]]]()
        for (letter, i, j), (number, factor) in self.places.items():
            if letter in starts:
                matrices[number][i][starts[letter] + j] = factor
                continue
            label, key = letter.removeprefix(OUTPUTS).rsplit(".", 1)
            row = rows.setdefault(label, [[[Fraction(0)] * width] for _ in self.trees])
            row[number][0][starts["ABE"["CDF".index(key)]] + j] = factor
        of_outputs = {
            label: tuple(tuple(map(tuple, M)) for M in blocks) for label, blocks in rows.items()
        }
        of_plant = tuple(tuple(map(tuple, M)) for M in matrices)
        try:
            return Placed(functions, of_plant, of_outputs)
        except InputError as error:
            raise PlantError(str(error)) from error

    def require_used(self, table: Mapping[str, Corners]) -> None:
        """Refuse a parameter that changes nothing: it would double the vertices, and the work."""
        for index, parameter in enumerate(self.parameters):
            if any(parameter.name in tree.names for tree in self.trees):
                continue
            pairs = (
                (M, corners[(*side[:index], 1, *side[index + 1 :])])
                for corners in table.values()
                for side, M in corners.items()
                if not side[index]
            )
            if all(low == high for low, high in pairs):
                raise PlantError(
                    f"parameter {parameter.name} changes no entry of A, B, E or an output, and "
                    "doubles the vertices; leave it out, or make it a constant"
                )


def _first(table: Mapping[str, Corners], letters: tuple[str, ...]) -> list[Exact]:
    return [next(iter(table[letter].values())) for letter in letters if letter in table]


def _lift(one: RationalFunction, given: Any, place: str) -> RationalFunction:
    try:
        return one.lift(given if isinstance(given, RationalFunction) else exact(given, place))
    except PlantError as error:
        raise PlantError(f"{place}: {error}") from error
