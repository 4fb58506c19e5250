"""Cells of the parameters' box on which an interpolated table of gains keeps the poles in a region.

The gain is multi-affine in the physical parameters p between the knots of a grid. On a cell of the
box that lies between neighbouring knots, each parameter is p = (1 - t) low + t high; a plant affine
in 1/p is, times |p|, affine in t. So with q(t) the product of these |p|, q A and q B are
multi-affine in t, the closed loop is (q A + q B K) / q, and a claim about the poles, about corners
with weights q, proves it. Points where a pole leaves are checked exactly, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product
from math import prod
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, Verdict, prove, untiled
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, Law, read_evidence
from polefence.proof.matrices import Rationals, least_work, mix, quotient
from polefence.proof.plant import Plant
from polefence.proof.ranges import Range
from polefence.proof.reading import Table, as_list, as_number, plain
from polefence.proof.regions import MAX_PARTS, Part, read_whole, write_region
from polefence.proof.roots import Outside, all_inside, inside_work, is_outside
from polefence.proof.short import Short
from polefence.proof.text import (
    digits_down,
    digits_up,
    name_text,
    range_text,
    region_text,
    unit_text,
)
from polefence.proof.work import MAX_WORK, RATIONAL, FormatError, WorkError, spend

MAX_CELLS, MAX_PARAMETERS, MAX_KNOTS = 2000, 6, 200
ANSWERS = ("proved", "refuted", "undecided")

Point = tuple[Fraction, ...]


@dataclass(frozen=True)
class Axis(Short):
    """A parameter: its interval, whether the plant is affine in 1/p, and the table's knots."""

    name: str
    low: Fraction
    high: Fraction
    inverted: bool
    knots: Point

    def weights(self, p: Fraction) -> tuple[Fraction, Fraction]:
        """Return the barycentric coordinates of p in the scheduling variable."""
        low, high, s = (1 / v if self.inverted else v for v in (self.low, self.high, p))
        weight = (s - low) / (high - low)
        return 1 - weight, weight

    def place(self, p: Fraction) -> tuple[int, Fraction]:
        """Return the interval of knots that holds p, and p's place in it, 0 to 1."""
        last = len(self.knots) - 2
        i = next((k for k in range(last) if p < self.knots[k + 1]), last)
        return i, (p - self.knots[i]) / (self.knots[i + 1] - self.knots[i])


@dataclass(frozen=True)
class Interpolated(Short):
    """A plant's vertices, its axes, and the gain at each knot (by index, first axis slowest)."""

    A: list[Rationals]
    B: list[Rationals]
    axes: tuple[Axis, ...]
    gains: list[Rationals]

    def write(self, on: str) -> dict[str, Any]:  # noqa: ARG002
        """Return it as a file has it."""
        grid = [plain(axis.knots) for axis in self.axes]
        return {"kind": "table", "grid": grid, "gains": plain(self.gains)}

    def alpha(self, p: Point) -> list[Fraction]:
        """Return alpha at physical parameters."""
        _spend_products(p)
        pairs = [axis.weights(v) for axis, v in zip(self.axes, p, strict=True)]
        return [prod(choice, start=Fraction(1)) for choice in product(*pairs)]

    def gain(self, p: Point) -> Rationals:
        """Return the interpolated gain at physical parameters."""
        _spend_products(p)
        places = [axis.place(v) for axis, v in zip(self.axes, p, strict=True)]
        weights, matrices = [], []
        for corner in product((0, 1), repeat=len(self.axes)):
            index = 0
            for axis, (i, _), bit in zip(self.axes, places, corner, strict=True):
                index = index * len(axis.knots) + i + bit
            parts = (t if bit else 1 - t for (_, t), bit in zip(places, corner, strict=True))
            weights.append(prod(parts, start=Fraction(1)))
            matrices.append(self.gains[index])
        return mix(weights, matrices)

    def loop(self, p: Point) -> Rationals:
        """Return the closed loop at physical parameters."""
        alpha, K = self.alpha(p), self.gain(p)
        claim = Poles("lyapunov", self.A, self.B, (), Law(K=[K]), ())
        return claim.closed_loop(alpha) or []


def _spend_products(p: Point) -> None:
    """Count the products of weights at one point, in rationals."""
    long = sum(v.denominator.bit_length() for v in p)
    spend(RATIONAL * len(p) << len(p), long, long)


@dataclass(frozen=True)
class Cell(Short):
    """A box of physical parameters with its answer.

    ``evidence`` (one a part of the region) of "proved"; ``point``, where a pole is not in the
    region, of "refuted", with ``outside`` that proves it, none where the characteristic polynomial
    is to.
    """

    low: Point
    high: Point
    answer: str
    evidence: tuple[Evidence, ...] = ()
    point: Point | None = None
    outside: Outside | None = None

    @property
    def volume(self) -> Fraction:
        """Product of the sides."""
        sides = (b - a for a, b in zip(self.low, self.high, strict=True))
        return prod(sides, start=Fraction(1))


def cell_claim(
    table: Interpolated,
    region: tuple[Part, ...],
    low: Point,
    high: Point,
    evidence: tuple[Evidence, ...],
) -> Poles:
    """Return the claim of a cell, about its corners."""
    A, B, K, weights = [], [], [], []
    for corner in product(*zip(low, high, strict=True)):
        q = prod(
            (abs(v) for axis, v in zip(table.axes, corner, strict=True) if axis.inverted),
            start=Fraction(1),
        )
        alpha = table.alpha(corner)
        A.append([[q * e for e in row] for row in mix(alpha, table.A)])
        B.append([[q * e for e in row] for row in mix(alpha, table.B)])
        K.append(table.gain(corner))  # continuous across knots: any neighbour's will do
        weights.append(q)
    law = Law(K=K)
    return Poles("lyapunov", A, B, region, law, evidence, "box", tuple(weights))


def prove_cell(table: Interpolated, region: tuple[Part, ...], cell: Cell) -> Verdict:
    """Decide whether a cell's answer is proved by what it carries.

    Raises
    ------
    FormatError
        If the cell lies outside the box, is empty, or reaches across a knot.
    """
    for axis, a, b in zip(table.axes, cell.low, cell.high, strict=True):
        if not axis.low <= a < b <= axis.high:
            raise FormatError(f"it lies outside the range of {axis.name}, or is empty")
        if b > axis.knots[axis.place(a)[0] + 1]:
            raise FormatError(f"it reaches across a knot of {axis.name}")
    if cell.answer == "proved":
        return prove(cell_claim(table, region, cell.low, cell.high, cell.evidence))
    fault = "an answer without its evidence"
    if cell.answer == "refuted" and cell.point is not None:
        fault = _unrefuted(table, region, cell, cell.point)
    elif cell.answer == "undecided":
        fault = ""
    return Verdict("proved", "").unless(fault)


def _unrefuted(table: Interpolated, region: tuple[Part, ...], cell: Cell, point: Point) -> str:
    """Say why a cell is not refuted at its point."""
    sides = zip(cell.low, point, cell.high, strict=True)
    if not all(a <= p <= b for a, p, b in sides):
        return "the counterexample lies outside its cell"
    loop = table.loop(point)
    if cell.outside is not None:
        shown = is_outside(quotient(loop), region, cell.outside)
        return "" if shown else "its P does not show that a pole is outside"
    return "the counterexample's poles are all in the region" * all_inside(loop, region)


@dataclass(frozen=True)
class Cells(Short, Claim):
    """The table's gains keep all poles in the region where cells are proved; cells tile the box."""

    kind: ClassVar[str] = "cells"

    table: Interpolated
    region: tuple[Part, ...]
    cells: tuple[Cell, ...]

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:  # noqa: ARG003
        """Read region and cells."""
        plant.require_exact(table.where)
        if not isinstance(law, Interpolated):
            raise FormatError("law: cells need a law of kind table")
        region = read_whole(table.table("region"), plant.sample_time is not None)
        rows, count = table.tables("cells", MAX_CELLS), len(law.axes)
        return cls(law, region, tuple(_read_cell(row, count, plant.n) for row in rows))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        cells = [_write_cell(cell) for cell in self.cells]
        return {"kind": self.kind, "region": write_region(self.region), "cells": cells}

    def statement(self, plant: Plant) -> str:
        """Say where the poles are, of which parameters."""
        over = ", ".join(
            range_text(name_text(r.name), unit_text(r.unit), r.low, r.high) for r in plant.ranges
        )
        return f"poles in {region_text(self.region)} with the table's gains, {over}"

    def require(self) -> None:
        """Refuse, before any is proved, more cells than can be checked."""
        table, total = self.table, 0
        for cell in self.cells:
            total += sum(cell_work(table, part.degree, part.elevation) for part in cell.evidence)
            if cell.point is not None and cell.outside is None:
                total += inside_work(table.loop(cell.point))
            if total > MAX_WORK:
                raise WorkError(
                    "the inequalities of the cells are too many, or too large, to be checked here"
                )

    def decided(self) -> Verdict:
        """Check every cell, and that together they tile the box.

        "proved": on the whole box; "refuted": somewhere; "undecided": elsewhere, or a cell's answer
        is not backed by what it carries.
        """
        count = 0
        for k, cell in enumerate(self.cells):
            try:
                verdict = prove_cell(self.table, self.region, cell)
            except FormatError as error:
                raise FormatError(f"cells[{k + 1}]: {error}") from error
            if not verdict.proved:
                return Verdict("undecided", f"cell {k + 1}: {verdict.reason}", count, verdict.place)
            count += verdict.count
        fault = untiled(self.cells, sum(self.shares.values()))
        note = f"{shares_text(self.shares, len(self.cells))} in exact arithmetic"
        return Verdict(self.answer, note, count, note=note).unless(fault)

    @property
    def shares(self) -> dict[str, Fraction]:
        """Share of the box, in physical parameters, of the cells with each answer."""
        sides = (axis.high - axis.low for axis in self.table.axes)
        whole, shares = prod(sides, start=Fraction(1)), dict.fromkeys(ANSWERS, Fraction(0))
        for cell in self.cells:
            shares[cell.answer] += cell.volume / whole
        return shares

    @property
    def answer(self) -> str:
        """Say "proved" (on the whole box), "refuted" (somewhere) or "undecided"."""
        answers = {cell.answer for cell in self.cells}
        return next(a for a in ("refuted", "undecided", "proved") if a in answers)


def shares_text(shares: Mapping[str, float | Fraction], count: int) -> str:
    """Return shares in words, rounded so that no proof is promised that there is not."""
    proved = digits_down(100 * shares["proved"], 4)
    refuted, undecided = (digits_up(100 * shares[key], 4) for key in ANSWERS[1:])
    return (
        f"{proved} % of the parameters' box proved, {refuted} % in refuted cells, "
        f"{undecided} % undecided, {count} cells"
    )


def cell_work(table: Interpolated, degree: int, elevation: int) -> int:
    """Return the least that one part of a cell costs to check."""
    blocks = (degree + 2 + elevation + 1) ** len(table.axes)
    return least_work(blocks, 2 * len(table.A[0]))


# --- reading and writing -------------------------------------------------------------------------


def read_interpolated(table: Table, plant: Plant) -> Interpolated:
    """Read the grid and the gains of a table."""
    if not 1 <= len(plant.ranges) <= MAX_PARAMETERS or len(plant.A) != 2 ** len(plant.ranges):
        raise FormatError("law: a table needs parameters that span the vertices")
    grid, where = table.items("grid", MAX_PARAMETERS), table.path("grid")
    if len(grid) != len(plant.ranges):
        raise FormatError(f"{where} must have one list of knots a parameter of the plant")
    axes = tuple(
        _axis(r, knots, f"{where}[{k + 1}]")
        for k, (r, knots) in enumerate(zip(plant.ranges, grid, strict=True))
    )
    total = prod(len(axis.knots) for axis in axes)
    gains = table.matrices("gains", plant.m, plant.n, MAX_KNOTS**2)
    if len(gains) != total:
        raise FormatError(f"{table.path('gains')} holds {len(gains)} gains; the grid needs {total}")
    return Interpolated(plant.A, plant.B, axes, gains)


def _axis(r: Range, knots: Any, where: str) -> Axis:
    values = tuple(as_number(v, where) for v in as_list(knots, where, MAX_KNOTS))
    rising = all(a < b for a, b in pairwise(values))
    if len(values) < 2 or not rising or values[0] > r.low or values[-1] < r.high:
        raise FormatError(f"{where} must rise and cover the range of {r.name}")
    return Axis(r.name, r.low, r.high, r.inverted, values)


def _read_cell(table: Table, count: int, n: int) -> Cell:
    answer = table.word("answer", ANSWERS)
    low, high = (table.numbers(key, count) for key in ("low", "high"))
    evidence: tuple[Evidence, ...] = ()
    point, outside = None, None
    if answer == "proved":
        parts = table.tables("parts", MAX_PARTS)
        evidence = tuple(read_evidence(part, n, (2,) * count) for part in parts)
    elif answer == "refuted":
        point = table.numbers("at", count)
        outside = Outside.read(table.table("outside"), n) if "outside" in table else None
    return Cell(low, high, answer, evidence, point, outside)


def _write_cell(cell: Cell) -> dict[str, Any]:
    table = {key: plain(getattr(cell, key)) for key in ("low", "high", "answer")}
    if cell.point is not None:
        table["at"] = plain(cell.point)
    if cell.outside is not None:
        table["outside"] = cell.outside.write()
    if cell.evidence:
        table["parts"] = [part.write() for part in cell.evidence]
    return table
