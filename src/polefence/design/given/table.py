"""Analysis of a table of gains between its knots: answer and file."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import numpy as np

from polefence.base.errors import DesignFileError, InputError, NotProvedError
from polefence.base.files import write_documents
from polefence.base.version import VERSION
from polefence.design.certificate import file_plant, plant_of
from polefence.design.design import check_document, read_document
from polefence.law.table import GainTable
from polefence.plant.family import UncertainPlant
from polefence.plant.points import weights_of
from polefence.plant.system import Array
from polefence.proof.claims.cells import ANSWERS, Axis, Cell, Cells, Interpolated, shares_text
from polefence.proof.document import Document
from polefence.proof.regions import parts_of
from polefence.region.regions import Region, region_of

FILE_NAME = "table.json"


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
            for kind in ANSWERS
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
        return shares_text(self.shares, len(self.cells))

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

    def file(self) -> Document:
        """Return the file of plant, table, region and cells."""
        plant = file_plant(self.plant)
        grid = [self.table.grid[p.name] for p in self.plant.parameters]
        pairs = zip(plant.ranges, grid, strict=True)
        axes = tuple(Axis(r.name, r.low, r.high, r.inverted, tuple(knots)) for r, knots in pairs)
        gains = [[[Fraction(e) for e in row] for row in K] for K in self.table.flat.tolist()]
        table = Interpolated(plant.A, plant.B, axes, gains)
        claim = Cells(table, parts_of(self.region.document()), self.cells)
        return Document(plant, table, (claim,), polefence=VERSION)

    def save(self, directory: str | Path) -> Path:
        """Write ``table.json`` into a folder, made if need be; return its path.

        Raises
        ------
        OutputError
            If the folder cannot be written.
        """
        return write_documents(Path(directory), {FILE_NAME: self.file().dumps(indent=None)})[0]

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
        where = Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)
        document = read_document(where)
        claim: Cells | None = document.first(Cells)
        if claim is None:
            raise DesignFileError(f"{where}: no claim of it is about a table of gains")
        answer = check_document(document, where)
        if not answer.verdicts[-1].note:  # which says what is sound
            raise NotProvedError(f"{path}: not proved: {answer.reason}")
        try:
            plant = plant_of(document.plant)
            region = region_of([(part.kind, part.numbers) for part in claim.region])
            return cls(plant, _table(plant, claim.table), region, claim.cells)
        except InputError as error:
            raise DesignFileError(f"{where}: {error}") from error


def _table(plant: UncertainPlant, exactly: Interpolated) -> GainTable:
    """Return the table that was checked, whose gains must be doubles."""
    rows = np.array(exactly.gains, dtype=float)
    if any(Fraction(float(e)) != e for gain in exactly.gains for row in gain for e in row):
        raise InputError("table.gains must be numbers that a double holds")
    shape = [len(axis.knots) for axis in exactly.axes]
    grid = {axis.name: axis.knots for axis in exactly.axes}
    return GainTable(plant.parameters, grid, rows.reshape(*shape, *rows.shape[1:]))
