"""Search in a table of gains, cell by cell: counterexamples, proofs, and halving where neither is."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise, product
from math import prod

import numpy as np

from polefence.base.deadline import Deadline
from polefence.base.errors import InputError
from polefence.base.types import require_type
from polefence.design.checks import require_region
from polefence.design.counterexample import shown
from polefence.design.given.closed_loop import points_inside
from polefence.design.given.table import TableAnalysis
from polefence.law.table import GainTable
from polefence.lmi.conditions.lyapunov import Loop
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, bernstein, elevated, times
from polefence.plant.system import Array
from polefence.proof import matrices, regions, roots
from polefence.proof.claims.base import prove
from polefence.proof.claims.cells import (
    MAX_CELLS,
    MAX_PARAMETERS,
    Axis,
    Cell,
    Interpolated,
    Point,
    cell_claim,
    cell_work,
    prove_cell,
)
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence
from polefence.proof.regions import parts_of
from polefence.proof.work import MAX_WORK, FormatError, counted
from polefence.region.regions import Region

FORMS = ((0, 0), (1, 0))  # degree and elevation of a cell's Lyapunov polynomial
SHARE = 0.9  # of the work that is checked in a file, after which no more cells are decided
MOST_OF_A_CELL = MAX_WORK // 100  # by its characteristic polynomial
SAMPLES, MOST_SAMPLES = 7, 1000  # along each side of a cell; in a cell


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
        if spent < SHARE * MAX_WORK:
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
        each = max(cell_work(self.exactly, *form) for form in FORMS) * len(self.parts)
        return min(MAX_CELLS, MAX_WORK // each)

    def decided(self, low: Point, high: Point, last: bool) -> Cell | None:
        """Return a cell with its answer, or None where it is to be halved: never the last time."""
        points, distance = self._sampled(low, high)
        some = bool(distance.min() < 0)
        if distance.max() >= 0 and some and not last:
            return None
        if distance.max() >= 0:
            found = self._counterexample(points[int(np.argmax(distance))], low, high)
            if found is not None:
                return found
        evidence = self._proof(low, high)
        if evidence is None:
            return Cell(low, high, "undecided") if last else None
        return Cell(low, high, "proved", evidence)

    def _sampled(self, low: Point, high: Point) -> tuple[Array, Array]:
        """Return points of a cell and how far outside the region their worst poles are."""
        a, b = (np.array([float(v) for v in side]) for side in (low, high))
        count = max(2, min(SAMPLES, round(MOST_SAMPLES ** (1 / len(a)))))
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
        with counted(MOST_OF_A_CELL), suppress(FormatError):
            return None if roots.all_inside(loop, self.parts) else cell
        return None

    def _proof(self, low: Point, high: Point) -> tuple[Evidence, ...] | None:
        """Return evidence for every part of the region, None where one has none."""
        claim = cell_claim(self.exactly, self.parts, low, high, ())
        loop, evidence = _loop(claim), []
        for region, part in zip(self.question.region.parts, self.parts, strict=True):
            found = _evidence(replace(claim, region=(part,)), loop, region)
            if found is None:
                return None
            evidence.append(found)
        return tuple(evidence)


def _evidence(claim: Poles, loop: Loop, part: Region) -> Evidence | None:
    for form in FORMS:
        for found in points_inside(loop, part, form):
            X = [[[Fraction(e) for e in row] for row in Q] for Q in found.Q.tolist()]
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
    found = []
    for choice in product(*sides):
        low, high = zip(*choice, strict=True)
        found.append((low, high))
    return found


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
