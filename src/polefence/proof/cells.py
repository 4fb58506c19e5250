"""Prove, in exact arithmetic, where an interpolated table of gains keeps the poles in a region.

The gain is multi-affine in the physical parameters p between the knots of a grid. On a cell of the
box that lies between neighbouring knots, each parameter is p = (1 - t) low + t high; a plant affine
in 1/p is, times |p|, affine in t. So with q(t) the product of these |p|, q A and q B are
multi-affine in t, the closed loop is (q A + q B K) / q, and
`polefence.proof.placement` proves it as a claim about corners with weights q. Points where a pole
leaves are checked exactly, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product
from math import prod
from typing import Any

from polefence.proof import definite, placement, reading, regions, roots
from polefence.proof.matrices import Rationals, mix, quotient
from polefence.proof.placement import Evidence
from polefence.proof.regions import Part
from polefence.proof.roots import Outside
from polefence.proof.work import MAX_WORK, FormatError, counted, spend

FORMAT = "polefence-table"
MAX_CELLS, MAX_PARAMETERS, MAX_KNOTS = 2000, 6, 200
RATIONAL = 20  # operations on integers that one on rationals is

Point = tuple[Fraction, ...]


@dataclass(frozen=True)
class Axis:
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
class Table:
    """A plant's vertices, its axes, and the gain at each knot (by index, first axis slowest)."""

    A: list[Rationals]
    B: list[Rationals]
    axes: tuple[Axis, ...]
    gains: list[Rationals]

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
        claim = placement.Claim("lyapunov", self.A, self.B, (), placement.Law(K=[K]), ())
        return placement.closed_loop(claim, alpha) or []


def _spend_products(p: Point) -> None:
    """Count the products of weights at one point, in rationals."""
    long = sum(v.denominator.bit_length() for v in p)
    spend(RATIONAL * len(p) << len(p), long, long)


@dataclass(frozen=True)
class Cell:
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
    table: Table,
    region: tuple[Part, ...],
    low: Point,
    high: Point,
    evidence: tuple[Evidence, ...],
) -> placement.Claim:
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
    law = placement.Law(K=K)
    return placement.Claim("lyapunov", A, B, region, law, evidence, "box", tuple(weights))


def prove_cell(table: Table, region: tuple[Part, ...], cell: Cell) -> placement.Verdict:
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
        return placement.prove(cell_claim(table, region, cell.low, cell.high, cell.evidence))
    if cell.answer == "refuted" and cell.point is not None:
        sides = zip(cell.low, cell.point, cell.high, strict=True)
        if not all(a <= p <= b for a, p, b in sides):
            return placement.Verdict(False, "the counterexample lies outside its cell")
        loop = table.loop(cell.point)
        if cell.outside is not None:
            shown = roots.is_outside(quotient(loop), region, cell.outside)
            return placement.Verdict(shown, "its P does not show that a pole is outside")
        inside = roots.all_inside(loop, region)
        return placement.Verdict(not inside, "the counterexample's poles are all in the region")
    return placement.Verdict(cell.answer == "undecided", "an answer without its evidence")


@dataclass(frozen=True)
class Summary:
    """Shares of the parameters' box by answer; ``fault`` names the first cell that is not right."""

    proved: Fraction
    refuted: Fraction
    undecided: Fraction
    fault: str = ""


def summarise(table: Table, region: tuple[Part, ...], cells: list[Cell]) -> Summary:
    """Check every cell and that together they tile the box; return the shares.

    Raises
    ------
    FormatError
        If a cell is malformed.
    """
    whole = prod((axis.high - axis.low for axis in table.axes), start=Fraction(1))
    shares = dict.fromkeys(("proved", "refuted", "undecided"), Fraction(0))
    fault = ""
    with counted():
        _require_moderate(table, cells)
        for k, cell in enumerate(cells):
            try:
                verdict = prove_cell(table, region, cell)
            except FormatError as error:
                raise FormatError(f"cells[{k + 1}]: {error}") from error
            if not verdict.proved:
                fault = fault or f"cell {k + 1}: {verdict.reason}"
            shares[cell.answer] += cell.volume / whole
    fault = fault or _untiled(cells, sum(shares.values()))
    return Summary(shares["proved"], shares["refuted"], shares["undecided"], fault)


def _require_moderate(table: Table, cells: list[Cell]) -> None:
    """Refuse, before any is proved, more cells than can be checked."""
    total = sum(work(table, e.degree, e.elevation) for cell in cells for e in cell.evidence)
    for cell in cells:
        if cell.point is not None and cell.outside is None:
            total += roots.inside_work(table.loop(cell.point))
        if total > MAX_WORK:
            raise FormatError("the cells are more inequalities, or larger, than are checked here")


def work(table: Table, degree: int, elevation: int) -> int:
    """Return the least that one part of a cell costs to check."""
    blocks = (degree + 2 + elevation + 1) ** len(table.axes)
    return definite.least_work(blocks, 2 * len(table.A[0]))


def _untiled(cells: list[Cell], total: Fraction | int) -> str:
    """Say how the cells, each in the box, fail to tile it."""
    active: list[Cell] = []
    for cell in sorted(cells, key=lambda c: c.low):
        active = [c for c in active if c.high[0] > cell.low[0]]
        if any(_overlap(cell, other) for other in active):
            return "two cells overlap"
        active.append(cell)
    return "" if total == 1 else "the cells do not fill the box"


def _overlap(one: Cell, other: Cell) -> bool:
    sides = zip(one.low, one.high, other.low, other.high, strict=True)
    return all(max(a, c) < min(b, d) for a, b, c, d in sides)


# --- reading -------------------------------------------------------------------------------------

_CARRIES: dict[str, tuple[str, ...]] = {"proved": ("parts",), "refuted": ("at",), "undecided": ()}


def read(text: str) -> tuple[Table, tuple[Part, ...], list[Cell], dict[str, Any]]:
    """Parse a file of an analysed table; return table, region, cells and the document.

    Raises
    ------
    FormatError
        If it is no such file, or its shapes do not fit.
    """
    document = placement.read_document(text, FORMAT)
    A, B = placement.read_vertices(document)
    region = placement.read_region(document.get("region"))
    table = _table(document, A, B)
    entries = _list(document.get("cells"), "cells", MAX_CELLS)
    n, count = len(A[0]), len(table.axes)
    cells = [_cell(entry, f"cells[{k + 1}]", count, n) for k, entry in enumerate(entries)]
    return table, region, cells, document


def _table(document: dict[str, Any], A: list[Rationals], B: list[Rationals]) -> Table:
    n, m = len(A[0]), len(B[0][0])
    parameters = _list(document["plant"].get("parameters"), "plant.parameters", MAX_PARAMETERS)
    tables = document.get("table")
    if not isinstance(tables, dict) or set(tables) != {"grid", "gains"}:
        raise FormatError("table must have grid and gains")
    grid = _list(tables["grid"], "table.grid", MAX_PARAMETERS)
    if len(grid) != len(parameters) or len(A) != 2 ** len(parameters):
        raise FormatError("table.grid must have one list of knots a parameter of the plant")
    axes = tuple(
        _axis(p, knots, k) for k, (p, knots) in enumerate(zip(parameters, grid, strict=True))
    )
    total = prod(len(axis.knots) for axis in axes)
    rows = _list(tables["gains"], "table.gains", MAX_KNOTS**2)
    if len(rows) != total:
        raise FormatError(f"table.gains holds {len(rows)} gains; the grid needs {total}")
    gains = [reading.read_matrix(row, f"table.gains[{k + 1}]", m, n) for k, row in enumerate(rows)]
    return Table(A, B, axes, gains)


def _axis(parameter: Any, knots: Any, k: int) -> Axis:
    where = f"plant.parameters[{k + 1}]"
    if not isinstance(parameter, dict) or not {"name", "range", "through"} <= set(parameter):
        raise FormatError(f"{where} must have name, range and through")
    name, through = parameter["name"], parameter["through"]
    bounds = _list(parameter["range"], f"{where}.range", 2)
    low, high = (reading.read_number(v, f"{where}.range") for v in (bounds[0], bounds[-1]))
    values = _list(knots, f"table.grid[{k + 1}]", MAX_KNOTS)
    found = tuple(reading.read_number(v, f"table.grid[{k + 1}]") for v in values)
    if not isinstance(name, str) or through not in (name, f"1/{name}") or low >= high:
        raise FormatError(f"{where} is no parameter")
    if through != name and low <= 0 <= high:
        raise FormatError(f"{where}: 1/{name} has no value at zero")
    rising = all(a < b for a, b in pairwise(found))
    if len(found) < 2 or not rising or found[0] > low or found[-1] < high:
        raise FormatError(f"table.grid[{k + 1}] must rise and cover the range of {name}")
    return Axis(name, low, high, through != name, found)


def _cell(entry: Any, where: str, count: int, n: int) -> Cell:
    answer = entry.get("answer") if isinstance(entry, dict) else None
    if not isinstance(answer, str) or answer not in _CARRIES:
        raise FormatError(f"{where}.answer must be proved, refuted or undecided")
    wanted = {"low", "high", "answer", *_CARRIES[answer]}
    if set(entry) - ({"outside"} if answer == "refuted" else set()) != wanted:
        raise FormatError(f"{where}: a cell {answer} must have {', '.join(sorted(wanted))}")
    low, high = (_point(entry[key], f"{where}.{key}", count) for key in ("low", "high"))
    evidence: tuple[Evidence, ...] = ()
    if "parts" in entry:
        tables = _list(entry["parts"], f"{where}.parts", regions.MAX_PARTS)
        if not all(isinstance(t, dict) and set(t) <= {"X", "degree", "elevation"} for t in tables):
            raise FormatError(f"{where}.parts must have X, degree and elevation")
        evidence = tuple(placement.read_evidence(t, where, "X", n, (2,) * count) for t in tables)
    point = _point(entry["at"], f"{where}.at", count) if "at" in entry else None
    outside = _outside(entry["outside"], f"{where}.outside", n) if "outside" in entry else None
    return Cell(low, high, answer, evidence, point, outside)


def _outside(table: Any, where: str, n: int) -> Outside:
    if not isinstance(table, dict) or set(table) not in ({"line", "S"}, {"line", "S", "T"}):
        raise FormatError(f"{where} must have line, S and perhaps T")
    line = _list(table["line"], f"{where}.line", 3)
    if len(line) != 3:
        raise FormatError(f"{where}.line must have 3 numbers")
    p, q, c = (reading.read_number(v, f"{where}.line") for v in line)
    none = [[0] * n for _ in range(n)]
    S, T = (reading.read_matrix(table.get(k, none), f"{where}.{k}", n, n) for k in "ST")
    return Outside(p, q, c, S, T)


def _point(value: Any, where: str, count: int) -> Point:
    entries = _list(value, where, MAX_PARAMETERS)
    if len(entries) != count:
        raise FormatError(f"{where} must have {count} numbers")
    return tuple(reading.read_number(v, where) for v in entries)


def _list(value: Any, where: str, limit: int) -> list[Any]:
    if not isinstance(value, list) or not 1 <= len(value) <= limit:
        raise FormatError(f"{where} must be a list of 1 to {limit} entries")
    return value
