"""Analysis of a table of gains between its knots: answer and file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import DesignFileError, InputError, NotProvedError
from polefence.base.files import read_text, write_documents
from polefence.design.certificate import Check, plant_document, plant_from
from polefence.design.design import FILE_NAME as DESIGN_NAME
from polefence.design.design import says_format
from polefence.design.statement import range_text
from polefence.law.table import GainTable
from polefence.plant.family import UncertainPlant
from polefence.plant.names import unit_text
from polefence.plant.points import weights_of
from polefence.plant.system import Array
from polefence.proof import cells as proof
from polefence.proof import matrices, placement, reading, work
from polefence.proof.cells import Cell
from polefence.region.regions import Region, region_of
from polefence.region.text import digits_down, digits_up

FILE_NAME = "table.json"
KINDS = ("proved", "refuted", "undecided")


@dataclass(frozen=True, eq=False, repr=False)
class TableAnalysis:
    """The answer for each cell of the parameters' box.

    Attributes
    ----------
    plant, table, region
        The question.
    cells : tuple of Cell
        They tile the box, and none reaches across a knot. Each has corners ``low`` and ``high``,
        and an ``answer``: "proved" for every point of it, "refuted" at its ``point`` (which says
        nothing about its other points), or "undecided".
    cut : bool
        Whether a budget in seconds kept cells that are not proved from being halved.
    """

    plant: UncertainPlant
    table: GainTable
    region: Region
    cells: tuple[Cell, ...]
    cut: bool = False

    def __repr__(self) -> str:
        shares = ", ".join(f"{k} {100 * v:.1f} %" for k, v in self.shares.items())
        return f"<TableAnalysis of {self.plant.name!r}: {self.region}, {shares}>"

    @cached_property
    def shares(self) -> dict[str, float]:
        """Share of the box, in physical parameters, of the cells with each answer."""
        whole = sum(cell.volume for cell in self.cells)
        return {
            kind: float(sum(c.volume for c in self.cells if c.answer == kind) / whole)
            for kind in KINDS
        }

    @property
    def answer(self) -> str:
        """Say "proved" (on the whole box), "refuted" (somewhere) or "undecided"."""
        answers = {cell.answer for cell in self.cells}
        return next(a for a in ("refuted", "undecided", "proved") if a in answers)

    @property
    def proved(self) -> bool:
        """Whether the table is proved on the whole box."""
        return self.answer == "proved"

    @property
    def summary(self) -> str:
        """The shares in words, rounded so that no proof is promised that there is not."""
        proved = digits_down(100 * self.shares["proved"], 4)
        refuted, undecided = (digits_up(100 * self.shares[k], 4) for k in KINDS[1:])
        return (
            f"{proved} % of the parameters' box proved, {refuted} % in refuted cells, "
            f"{undecided} % undecided, {len(self.cells)} cells"
        )

    @property
    def counterexamples(self) -> list[dict[str, float]]:
        """Parameter values at which a pole is not in the region, one a refuted cell, worst first.

        In floats, whose last digit may make a difference on the boundary; a cell's ``point`` is
        exact.
        """
        names = [p.name for p in self.plant.parameters]
        points = [tuple(map(float, c.point)) for c in self.cells if c.point is not None]
        if not points:
            return []
        worst = self.region.distance(self.poles(np.array(points))).max(axis=1)
        return [dict(zip(names, points[i], strict=True)) for i in np.argsort(-worst, kind="stable")]

    def poles(self, points: Array) -> Array:
        """Closed-loop poles at parameter values (count, parameters), as (count, n) complex."""
        A, B = self.plant.at(weights_of(self.plant.parameters, points))
        return np.asarray(np.linalg.eigvals(A + B @ self.table.at(points)))

    def document(self) -> dict[str, Any]:
        """Return plant, table, region and cells as plain data for JSON."""
        grid = [[_plain(v) for v in self.table.grid[p.name]] for p in self.plant.parameters]
        return {
            "format": proof.FORMAT,
            "version": placement.VERSION,
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
        text = json.dumps(self.document(), allow_nan=False) + "\n"
        return write_documents(Path(directory), {FILE_NAME: text})[0]

    @classmethod
    def load(cls, path: str | Path) -> TableAnalysis:
        """Read a file that `save` wrote and check every cell of it afresh.

        Raises
        ------
        DesignFileError
            If it cannot be read.
        NotProvedError
            If a cell's answer is not backed by what it carries, or the cells do not tile the box.
        """
        analysis, fault = _read(Path(path))
        if fault:
            raise NotProvedError(f"{path}: not proved: {fault}")
        return analysis


def is_table_file(path: Path) -> bool:
    """Whether a file, or a folder without a design, holds an analysed table."""
    if path.is_dir():
        return (path / FILE_NAME).is_file() and not (path / DESIGN_NAME).exists()
    return says_format(path, proof.FORMAT)


def check_table(path: Path) -> Check:
    """Check a file that `TableAnalysis.save` wrote, in exact arithmetic.

    Returns
    -------
    Check
        "proved": on the whole box; "refuted": somewhere; "undecided": elsewhere, or a cell's answer
        is not backed by what it carries. The reason has the shares.

    Raises
    ------
    DesignFileError
        If the file cannot be read as an analysed table.
    """
    analysis, fault = _read(path)
    if fault:
        return Check("undecided", fault)
    over = ", ".join(
        range_text(p.name, unit_text(p.unit), p.low, p.high) for p in analysis.plant.parameters
    )
    said = (f"poles in {analysis.region} with the table's gains, {over}",)
    return Check(analysis.answer, f"{analysis.summary} in exact arithmetic", claims=said)


def table_plant(path: Path) -> UncertainPlant:
    """Return the plant that a file is about; checks no cell.

    Raises
    ------
    DesignFileError
        If the file cannot be read as an analysed table.
    """
    where, text = _text(path)
    try:
        return plant_from(proof.read(text)[-1]["plant"])
    except (work.FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error


def _text(path: Path) -> tuple[Path, str]:
    where = path / FILE_NAME if path.is_dir() else path
    return where, read_text(where, reading.MAX_BYTES, DesignFileError)


def _read(path: Path) -> tuple[TableAnalysis, str]:
    """Return what a file says, and what of it is not so."""
    where, text = _text(path)
    try:
        exactly, parts, cells, document = proof.read(text)
        fault = proof.summarise(exactly, parts, cells).fault
        plant = plant_from(document["plant"])
        region = region_of([(part.kind, part.numbers) for part in parts])
        return TableAnalysis(plant, _table(plant, exactly), region, tuple(cells)), fault
    except (work.FormatError, InputError) as error:
        raise DesignFileError(f"{where}: {error}") from error


def _table(plant: UncertainPlant, exactly: proof.Table) -> GainTable:
    """Return the table that was checked, whose gains must be doubles."""
    rows = np.array(exactly.gains, dtype=float)
    if any(Fraction(float(e)) != e for gain in exactly.gains for row in gain for e in row):
        raise InputError("table.gains must be numbers that a double holds")
    shape = [len(axis.knots) for axis in exactly.axes]
    grid = {axis.name: axis.knots for axis in exactly.axes}
    return GainTable(plant.parameters, grid, rows.reshape(*shape, *rows.shape[1:]))


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
    if cell.outside is not None:
        by = cell.outside
        entry["outside"] = {"line": [_plain(v) for v in (by.p, by.q, by.c)], "S": _floats(by.S)}
        if any(map(any, by.T)):
            entry["outside"]["T"] = _floats(by.T)
    if cell.evidence:
        entry["parts"] = [
            {
                "X": [_floats(X) for X in each.X],
                "degree": each.degree,
                "elevation": each.elevation,
            }
            for each in cell.evidence
        ]
    return entry


def _floats(matrix: matrices.Rationals) -> list[list[float]]:
    return [[float(e) for e in row] for row in matrix]
