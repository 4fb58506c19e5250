"""Where between its knots a table of gains keeps the poles in a region."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from polefence.conditions.lyapunov import Loop
from polefence.conditions.target import Around
from polefence.errors import InputError, SolverError
from polefence.files import make_folder, write_text
from polefence.gain_table import GainTable
from polefence.placement import require_region
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.polynomial import Domain, bernstein, elevated, times
from polefence.proof import cells as proof
from polefence.proof import exact
from polefence.proof.cells import Cell
from polefence.proof.certificate import plant_document
from polefence.region import Region
from polefence.solve.given import least

FORMS = ((0, 0), (1, 0))  # degree and elevation of a cell's Lyapunov polynomial
SAMPLES = 7  # along each side of a cell
INSIDE = 0.98
FILE_NAME = "table.json"


@dataclass(frozen=True, eq=False, repr=False)
class TableAnalysis:
    """The answer for each cell of the parameters' box.

    Attributes
    ----------
    cells : tuple of Cell
        They tile the box; each "proved", "refuted" (at its ``point``) or "undecided".
    """

    plant: UncertainPlant
    table: GainTable
    region: Region
    cells: tuple[Cell, ...]

    def __repr__(self) -> str:
        shares = ", ".join(f"{k} {100 * v:.1f} %" for k, v in self.shares.items())
        return f"<TableAnalysis of {self.plant.name!r}: {self.region}, {shares}>"

    @cached_property
    def shares(self) -> dict[str, float]:
        """Share of the box, in physical parameters, by answer."""
        whole = sum(cell.volume for cell in self.cells)
        kinds = ("proved", "refuted", "undecided")
        return {
            kind: float(sum(c.volume for c in self.cells if c.answer == kind) / whole)
            for kind in kinds
        }

    @property
    def answer(self) -> str:
        """Say "proved" (on the whole box), "refuted" (somewhere) or "undecided"."""
        answers = {cell.answer for cell in self.cells}
        return next(a for a in ("refuted", "undecided", "proved") if a in answers)

    @property
    def counterexamples(self) -> list[dict[str, float]]:
        """Parameter values at which a pole is not in the region, one a refuted cell."""
        names = [p.name for p in self.plant.parameters]
        points = (cell.point for cell in self.cells if cell.point is not None)
        return [dict(zip(names, map(float, point), strict=True)) for point in points]

    def document(self) -> dict[str, Any]:
        """Return plant, table, region and cells as plain data for JSON."""
        grid = [[_plain(v) for v in self.table.grid[p.name]] for p in self.plant.parameters]
        return {
            "format": proof.FORMAT,
            "version": exact.VERSION,
            "plant": plant_document(self.plant),
            "region": self.region.document(),
            "table": {"grid": grid, "gains": self.table.flat.tolist()},
            "cells": [_cell_document(cell) for cell in self.cells],
        }

    def save(self, directory: str | Path) -> Path:
        """Write ``table.json`` into a folder, made if need be; return its path.

        Raises
        ------
        OutputError
            If the folder cannot be written.
        """
        path = make_folder(Path(directory)) / FILE_NAME
        write_text(path, json.dumps(self.document(), allow_nan=False) + "\n")
        return path


def analyse_table(
    plant: UncertainPlant,
    table: GainTable,
    region: Region,
    depth: int = 4,
    budget: float = 60.0,
    on_cell: Callable[[Cell], None] | None = None,
) -> TableAnalysis:
    """Prove or refute, cell by cell, that a table of gains keeps all poles in a region.

    The cells between knots are halved, up to ``depth`` times, where they are not proved whole.

    Parameters
    ----------
    budget : float
        Time after which cells are no longer halved [s].
    on_cell : callable, optional
        Called with each finished cell.

    Raises
    ------
    InputError
        If the table does not fit the plant, or the region the plant's time.
    """
    if tuple(table.parameters) != tuple(plant.parameters):
        raise InputError(f"the table's parameters are not those of {plant.name}")
    if table.gains.shape[-2:] != plant.shape[::-1]:
        m, n = table.gains.shape[-2:]
        raise InputError(f"the gains are {m} x {n}; {plant.name} needs {plant.shape[::-1]}")
    require_region(plant, region)
    work = _Work(plant, table, region, _exact_table(plant, table))
    deadline = time.perf_counter() + budget
    queue = [(low, high, 0) for low, high in _cells(work.axes)]
    done: list[Cell] = []
    while queue:
        low, high, level = queue.pop()
        cell = work.decided(low, high)
        halved = cell.answer != "proved" and level < depth and time.perf_counter() < deadline
        if halved and len(done) + len(queue) + 2 <= proof.MAX_CELLS:
            queue += [(*half, level + 1) for half in _halves(low, high, work.axes)]
            continue
        done.append(cell)
        if on_cell is not None:
            on_cell(cell)
    return TableAnalysis(plant, table, region, tuple(done))


@dataclass(frozen=True, eq=False)
class _Work:
    plant: UncertainPlant
    table: GainTable
    region: Region
    exactly: proof.Table

    @property
    def axes(self) -> tuple[proof.Axis, ...]:
        return self.exactly.axes

    @cached_property
    def parts(self) -> tuple[exact.Part, ...]:
        return exact.read_region(self.region.document())

    def decided(self, low: proof.Point, high: proof.Point) -> Cell:
        point = self._counterexample(low, high)
        if point is not None:
            return Cell(low, high, "refuted", point=point)
        evidence = []
        for region, part in zip(self.region.parts, self.parts, strict=True):
            found = self._proof(region, part, low, high)
            if found is None:
                return Cell(low, high, "undecided")
            evidence.append(found)
        return Cell(low, high, "proved", tuple(evidence))

    def _counterexample(self, low: proof.Point, high: proof.Point) -> proof.Point | None:
        a, b = (np.array([float(v) for v in side]) for side in (low, high))
        steps = np.linspace(0, 1, SAMPLES)
        local = np.array(list(product(steps, repeat=len(a))))
        points = a + local * (b - a)
        weights = np.ones((len(points), 1))
        for axis, column in zip(self.axes, points.T, strict=True):
            s0, s1, s = (
                1 / v if axis.inverted else v for v in (float(axis.low), float(axis.high), column)
            )
            t = np.clip((s - s0) / (s1 - s0), 0, 1)
            weights = (weights[:, :, None] * np.stack([1 - t, t], 1)[:, None]).reshape(
                len(points), -1
            )
        A, B = self.plant.at(weights)
        distance = self.region.distance(np.linalg.eigvals(A + B @ self.table.at(points))).max(
            axis=1
        )
        worst = int(np.argmax(distance))
        if distance[worst] < 0:
            return None
        point = tuple(
            min(max(Fraction(float(v)), lo), hi)
            for v, lo, hi in zip(points[worst], low, high, strict=True)
        )
        inside = exact.all_inside(self.exactly.loop(point), self.parts)
        return None if inside else point

    def _proof(
        self, region: Region, part: exact.Part, low: proof.Point, high: proof.Point
    ) -> exact.Evidence | None:
        claim = proof.cell_claim(self.exactly, (part,), low, high, ())
        loop = _loop(claim)
        for form in FORMS:
            for enough in (INSIDE, 0.0):
                with suppress(SolverError):
                    found = least(loop, Around(region), *form, enough=enough)
                    if found.r >= 1:
                        break
                    X = [[[Fraction(e) for e in row] for row in Q] for Q in found.Q.tolist()]
                    evidence = exact.Evidence(X, *form)
                    cell = Cell(low, high, "proved", (evidence,))
                    if proof.prove_cell(self.exactly, (part,), cell).proved:
                        return evidence
        return None


def _loop(claim: exact.Claim) -> Loop:
    A, B, K = (np.array(M, dtype=float) for M in (claim.A, claim.B, claim.law.K))
    q = np.array(claim.weights, dtype=float)
    # weights of many parameters may be far from one; only their ratio matters
    A, B, q = A / q.mean(), B / q.mean(), q / q.mean()
    n, domain = A.shape[1], Domain.of("box", len(A))
    eye = np.tile(np.eye(n), (len(A), 1, 1))
    AB = bernstein(domain, np.concatenate([A, B], axis=2), 1)
    C = times(AB, bernstein(domain, np.concatenate([eye, K], axis=1), 1))
    return Loop(elevated(bernstein(domain, q[:, None, None] * eye, 1), domain, 1), C, domain)


def _cells(axes: tuple[proof.Axis, ...]) -> list[tuple[proof.Point, proof.Point]]:
    """Return the boxes between neighbouring knots, inside the parameters' intervals."""
    sides = []
    for axis in axes:
        inner = [k for k in axis.knots if axis.low < k < axis.high]
        sides.append(list(pairwise([axis.low, *inner, axis.high])))
    found = []
    for choice in product(*sides):
        low, high = zip(*choice, strict=True)
        found.append((low, high))
    return found


def _halves(
    low: proof.Point, high: proof.Point, axes: tuple[proof.Axis, ...]
) -> list[tuple[proof.Point, proof.Point]]:
    """Halve a cell along the side that is longest as a share of its parameter's interval."""
    shares = [(b - a) / (x.high - x.low) for a, b, x in zip(low, high, axes, strict=True)]
    i = shares.index(max(shares))
    middle = (low[i] + high[i]) / 2
    return [
        (low, (*high[:i], middle, *high[i + 1 :])),
        ((*low[:i], middle, *low[i + 1 :]), high),
    ]


def _exact_table(plant: UncertainPlant, table: GainTable) -> proof.Table:
    axes = tuple(
        proof.Axis(p.name, p.low, p.high, p.inverted, tuple(table.grid[p.name]))
        for p in plant.parameters
    )
    A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    gains = [[[Fraction(e) for e in row] for row in K] for K in table.flat.tolist()]
    return proof.Table(A, B, axes, gains)


def _plain(value: Fraction) -> float | str:
    return float(value) if Fraction(float(value)) == value else str(value)


def _cell_document(cell: Cell) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "low": [_plain(v) for v in cell.low],
        "high": [_plain(v) for v in cell.high],
        "answer": cell.answer,
    }
    if cell.point is not None:
        entry["at"] = [_plain(v) for v in cell.point]
    if cell.evidence:
        entry["parts"] = [
            {
                "X": [[[float(e) for e in row] for row in X] for X in each.X],
                "degree": each.degree,
                "elevation": each.elevation,
            }
            for each in cell.evidence
        ]
    return entry


def table_from(plant: UncertainPlant, data: Any) -> GainTable:
    """Return a table from plain data, {"grid": {name: knots}, "gains": nested lists}.

    Raises
    ------
    InputError
        If it is malformed or does not fit the plant.
    """
    if not isinstance(data, dict) or set(data) != {"grid", "gains"}:
        raise InputError('a table of gains is {"grid": {name: knots}, "gains": nested lists}')
    if not isinstance(data["grid"], dict):
        raise InputError("grid must name the knots of each parameter")
    try:
        gains: Array = np.array(data["gains"], dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError("gains must be nested lists of numbers, all of one shape") from error
    return GainTable(plant.parameters, data["grid"], gains)
