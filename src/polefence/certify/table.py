"""Analysis of a table of gains between its knots, cell by cell: answer, search and file."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise, product
from math import prod
from pathlib import Path

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import DesignFileError, InputError, NotProvedError, require_type
from polefence.base.files import write_documents
from polefence.certify.candidates import Deadline
from polefence.certify.certificate import plant_of
from polefence.certify.checks import in_time_of, require_region
from polefence.certify.counterexample import shown
from polefence.certify.design import check_document, read_document
from polefence.certify.evidence import FORMS
from polefence.law.laws import GainTable
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.solve.lyapunov import points_inside
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.points import weights_of
from polefence.plant.polynomial import Domain, bernstein, elevated, times
from polefence.plant.system import Array
from polefence.proof import matrices, regions, roots
from polefence.proof.claims.base import prove
from polefence.proof.claims.cells import (
    ANSWERS,
    MAX_CELLS,
    MAX_PARAMETERS,
    Axis,
    Cell,
    Cells,
    Interpolated,
    Point,
    cell_claim,
    cell_work,
    prove_cell,
    shares_text,
)
from polefence.proof.claims.poles import Poles
from polefence.proof.document import Document
from polefence.proof.laws import Evidence
from polefence.proof.regions import parts_of
from polefence.proof.short import Short
from polefence.proof.work import MAX_WORK, FormatError, counted
from polefence.region.regions import Region, region_of

FILE_NAME = "table.json"


@dataclass(frozen=True, eq=False, repr=False)
class TableAnalysis(Short):
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
            raise DesignFileError(f"{where}: none of its claims is about a table of gains")
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


# --- the search: counterexamples, proofs, and halving where neither is ----------------------------


def analyse_table(
    plant: UncertainPlant,
    table: GainTable,
    region: Region,
    depth: int = 4,
    budget: float | None = None,
    on_cell: Callable[[Cell], None] | None = None,
) -> TableAnalysis:
    """Prove or refute, cell by cell, that a table of gains keeps all poles in a region.

    The cells between knots are halved, up to ``depth`` times, where they are not proved whole and
    some sampled points of them keep the region; the largest first.

    Parameters
    ----------
    budget : float, optional
        Time after which cells are no longer halved [s]; ``cut`` of the answer then says so.
    on_cell : callable, optional
        Called with each finished cell.

    Raises
    ------
    InputError
        If the table does not fit the plant, or has more cells than are checked; or the region does
        not fit the plant's time.
    """
    _require_fit(plant, table)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    region = in_time_of(plant, region)
    require_region(plant, region)
    work = _Work(TableAnalysis(plant, table, region, ()), _exact_table(plant, table))
    deadline = Deadline(budget)
    queue = deque((low, high, 0) for low, high in _cells(work.exactly.axes))
    most = work.most_cells
    if len(queue) > most:
        raise InputError(
            f"the grid has {len(queue)} cells; at most {most} of this size are checked"
        )
    done, cut = list[Cell](), False
    spent = 0  # of the work that checking all cells takes
    while queue:
        low, high, level = queue.popleft()
        halved = level < depth and len(done) + len(queue) + 2 <= most
        late = halved and deadline.passed
        cell: Cell | None = Cell(low, high, "undecided")
        if spent < 0.9 * MAX_WORK:  # after that no more cells are decided
            cell = work.decided(low, high, last=late or not halved)
        if cell is None:
            queue += [(*half, level + 1) for half in _halves(low, high, work.exactly.axes)]
            continue
        spent += work.checked(cell)
        cut = cut or (late and cell.answer != "proved")
        done.append(cell)
        if on_cell is not None:
            on_cell(cell)
    return TableAnalysis(plant, table, region, tuple(done), cut)


def _require_fit(plant: UncertainPlant, table: GainTable) -> None:
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    if tuple(table.parameters) != tuple(plant.parameters):
        raise InputError(f"the table's parameters, or their ranges, are not those of {plant.name}")
    if len(table.parameters) > MAX_PARAMETERS:
        count, most = len(table.parameters), MAX_PARAMETERS
        raise InputError(f"the table has {count} parameters; at most {most} are checked")
    (n, m), shape = plant.shape, table.gains.shape[-2:]
    if shape != (m, n):
        raise InputError(f"the gains are {shape[0]} x {shape[1]}; {plant.name} needs {m} x {n}")


@dataclass(frozen=True, eq=False)
class _Work:
    question: TableAnalysis
    exactly: Interpolated

    @cached_property
    def parts(self) -> tuple[regions.Part, ...]:
        return parts_of(self.question.region.document())

    @property
    def most_cells(self) -> int:
        work = max(cell_work(self.exactly, *form) for form in FORMS) * len(self.parts)
        return min(MAX_CELLS, MAX_WORK // work)

    def decided(self, low: Point, high: Point, last: bool) -> Cell | None:
        """Return a cell with its answer, or None where it is to be halved: never the last time."""
        points, distance = self._sampled(low, high)
        some = bool(distance.min() < 0)
        if distance.max() >= 0 and some and not last:
            return None
        if distance.max() >= 0:
            outside = self._counterexample(points[int(np.argmax(distance))], low, high)
            if outside is not None:
                return outside
        evidence = self._proof(low, high)
        if evidence is None:
            return Cell(low, high, "undecided") if last else None
        return Cell(low, high, "proved", evidence)

    def _sampled(self, low: Point, high: Point) -> tuple[Array, Array]:
        """Return points of a cell and how far outside the region their worst poles are."""
        a, b = (np.array([float(v) for v in side]) for side in (low, high))
        # along each side, about a thousand in a cell
        count = max(2, min(7, round(1000 ** (1 / len(a)))))
        steps = np.array(list(product(np.linspace(0, 1, count), repeat=len(a))))
        points = a + steps * (b - a)
        return points, self.question.region.distance(self.question.poles(points)).max(axis=1)

    def checked(self, cell: Cell) -> int:
        """Return what it takes to check a cell."""
        with counted() as count:
            prove_cell(self.exactly, self.parts, cell)
        return count.spent

    def _counterexample(self, point: Array, low: Point, high: Point) -> Cell | None:
        """Return a refuted cell if a pole is not in the region at a point of it, exactly."""
        sides = zip(point, low, high, strict=True)
        exactly = tuple(min(max(Fraction(float(v)), lo), hi) for v, lo, hi in sides)
        loop = self.exactly.loop(exactly)
        by = shown(matrices.quotient(loop), self.parts)
        cell = Cell(low, high, "refuted", point=exactly, outside=by)
        if by is not None:
            return cell
        with counted(MAX_WORK // 100), suppress(FormatError):
            return None if roots.all_inside(loop, self.parts) else cell
        return None

    def _proof(self, low: Point, high: Point) -> tuple[Evidence, ...] | None:
        """Return evidence for every part of the region, None where one has none."""
        claim = cell_claim(self.exactly, self.parts, low, high, ())
        loop, evidence = _loop(claim), []
        for region, part in zip(self.question.region.parts, self.parts, strict=True):
            proof = _evidence(replace(claim, region=(part,)), loop, region)
            if proof is None:
                return None
            evidence.append(proof)
        return tuple(evidence)


def _evidence(claim: Poles, loop: Loop, part: Region) -> Evidence | None:
    for form in FORMS:
        for polynomial in points_inside(loop, part, form):
            X = [[[Fraction(e) for e in row] for row in Q] for Q in polynomial.Q.tolist()]
            evidence = Evidence(X, *form)
            if prove(replace(claim, evidence=(evidence,))).proved:
                return evidence
    return None


def _loop(claim: Poles) -> Loop:
    A, B, K = (np.array(M, dtype=float) for M in (claim.A, claim.B, claim.law.K))
    q = np.array(claim.weights, dtype=float)
    # weights of many parameters may be far from one; only their ratio matters
    A, B, q = A / q.mean(), B / q.mean(), q / q.mean()
    n, domain = A.shape[1], Domain.of("box", len(A))
    eye = np.tile(np.eye(n), (len(A), 1, 1))
    AB = bernstein(domain, np.concatenate([A, B], axis=2), 1)
    C = times(AB, bernstein(domain, np.concatenate([eye, K], axis=1), 1))
    return Loop(elevated(bernstein(domain, q[:, None, None] * eye, 1), domain, 1), C, domain)


def _cells(axes: tuple[Axis, ...]) -> list[tuple[Point, Point]]:
    """Return the boxes between neighbouring knots, inside the parameters' intervals."""
    sides = []
    for axis in axes:
        inner = [k for k in axis.knots if axis.low < k < axis.high]
        sides.append(list(pairwise([axis.low, *inner, axis.high])))
    count = prod(len(side) for side in sides)
    if count > MAX_CELLS:
        raise InputError(f"the grid has {count} cells; at most {MAX_CELLS} are checked")
    boxes = []
    for choice in product(*sides):
        low, high = zip(*choice, strict=True)
        boxes.append((low, high))
    return boxes


def _halves(low: Point, high: Point, axes: tuple[Axis, ...]) -> list[tuple[Point, Point]]:
    """Halve a cell along the side that is longest as a share of its parameter's interval."""
    shares = [(b - a) / (x.high - x.low) for a, b, x in zip(low, high, axes, strict=True)]
    i = shares.index(max(shares))
    middle = (low[i] + high[i]) / 2
    return [
        (low, (*high[:i], middle, *high[i + 1 :])),
        ((*low[:i], middle, *low[i + 1 :]), high),
    ]


def _exact_table(plant: UncertainPlant, table: GainTable) -> Interpolated:
    axes = tuple(
        Axis(p.name, p.low, p.high, p.inverted, tuple(table.grid[p.name])) for p in plant.parameters
    )
    A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    gains = [[[Fraction(e) for e in row] for row in K] for K in table.flat.tolist()]
    return Interpolated(A, B, axes, gains)
