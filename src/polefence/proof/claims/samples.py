"""The plant in the file is what a computer sees of another one: its samples, the input held.

Between samples T apart the inputs and disturbances of x' = A x + B u + E w are held, and u acts
``delay`` samples late, or ``early`` T sooner; the states are then x and the inputs on their way. At
every alpha of the box of the parameters, or of the simplex where there are none, the exact
[F, G, H] of x(t + T) = F x + G u + H w is within the plant's remainder of the combination of its
vertices and the curve that is added to it.

With M(alpha) = [A, B, E] T it is [I, 0] + sum of A^(k - 1) M / k!, whose first terms are compared
coefficient by coefficient, and the others bounded: see `polefence.proof.claims.steps`. Of a plant
with bends the samples are compared at the vertices and at the nodes, and their second derivatives
bounded: see `polefence.proof.interpolation`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from operator import add, mul
from typing import Any, ClassVar, Self

from polefence.proof import intervals
from polefence.proof.claims import steps
from polefence.proof.claims.base import Claim, Inequality, Verdict, undecided
from polefence.proof.entries import Placed, read_entries, write_entries
from polefence.proof.interpolation import (
    ONE,
    Bends,
    Curves,
    bends,
    held_sample,
    terms_needed,
)
from polefence.proof.matrices import ZERO, Rationals, common_denominator, identity, longest, mix
from polefence.proof.plant import Node, Plant, held_columns, read_early, sizes_of
from polefence.proof.polynomials import (
    Polynomial,
    Sizes,
    bernstein,
    constant,
    multinomial,
    side_by_side,
)
from polefence.proof.ranges import corner_weights, corners
from polefence.proof.reading import MAX_VERTICES, Table, plain, require_shape
from polefence.proof.remainder import Remainder, Source
from polefence.proof.short import Short
from polefence.proof.text import late_text, milliseconds_text
from polefence.proof.work import MAX_IN_PARTS, RATIONAL, FormatError, spend

MAX_TERMS, MAX_DELAY = 120, 64


@dataclass(frozen=True)
class Samples(Short, Claim):
    """The plant's vertices and remainder hold the samples of x' = A x + B u + E w.

    ``units`` are of its states, inputs and disturbances, one each, in which the series is
    evaluated; ``terms`` is how many of it are.
    """

    kind: ClassVar[str] = "samples"
    letters: ClassVar[str] = ""
    of_law: ClassVar[bool] = False

    plant: Plant
    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    delay: int
    terms: int
    units: tuple[Fraction, ...]
    early: Fraction = ZERO
    source: Source | None = None

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:  # noqa: ARG003
        """Read the plant that is sampled."""
        rows = table.tables("vertices", MAX_VERTICES)
        A, B = ([row.matrix(key) for row in rows] for key in "AB")
        E = [row.matrix("E") for row in rows if "E" in row]
        delay, terms = table.whole("delay", 0), table.whole("terms", 1, MAX_TERMS)
        width = len(A[0]) + len(B[0][0]) + (len(E[0][0]) if E else 0)
        early = read_early(table, delay)
        source, shape = None, (len(A[0]), len(B[0][0]), len(E[0][0]) if E else 0)
        if "functions" in table:
            placed = read_entries(table.table("functions"), plant.ranges, shape, ())
            source = Source(placed.functions, placed.of_plant)
        units = table.numbers("units", width)
        return cls(plant, A, B, E, delay, terms, units, early, source)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        vertices = [
            {key: plain(M[j]) for key, M in (("A", self.A), ("B", self.B), ("E", self.E)) if M}
            for j in range(len(self.A))
        ]
        numbers = {"delay": self.delay, "terms": self.terms, "units": plain(self.units)}
        table = {"kind": self.kind} | numbers | ({"early": plain(self.early)} if self.early else {})
        if self.source is not None:
            placed = Placed(self.source.functions, self.source.directions, {})
            table["functions"] = write_entries(placed, (self.n, self.m, self.q))
        return table | {"vertices": vertices}

    def statement(self, plant: Plant) -> str:
        """Say what the plant is of."""
        late = f", u {late_text(self.delay - self.early)}" if self.delay else ""
        held = "u and w held" if self.E else "u held"
        time = milliseconds_text(plant.step)
        first = f" (states 1 to {self.width})" if plant.n > self.width else ""
        late += ", with functions of the parameters" if self.source else ""
        on = f", on the box of {len(self.sizes)} parameters" if len(self.sizes) > 1 else ""
        return f"plant{first}: samples every {time} ms of x' = A x + B u + E w, {held}{late}{on}"

    @property
    def allowed(self) -> int | None:
        """The most work that it may take to prove: more where samples are compared at nodes."""
        return MAX_IN_PARTS if self.bent else None

    @property
    def n(self) -> int:
        """Number of states that are sampled."""
        return len(self.A[0])

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.B[0][0])

    @property
    def q(self) -> int:
        """Number of disturbances."""
        return len(self.E[0][0]) if self.E else 0

    @property
    def width(self) -> int:
        """Number of states with the inputs on their way; others of the plant are its own.

        So are inputs behind those that are held: they move none of these states.
        """
        return self.n + self.delay * self.m

    @property
    def sizes(self) -> Sizes:
        """Of the box of the parameters, or of the simplex."""
        return sizes_of(len(self.A), "box" if self.plant.ranges else "simplex")

    def require(self) -> None:
        """Refuse what does not fit."""
        plant, n, m, q, N = self.plant, self.n, self.m, self.q, len(self.A)
        if plant.sample_time is None or plant.remainder is None:
            raise FormatError("samples: the plant has no sample_time, or no remainder")
        plant.remainder.require(plant.n, plant.m, plant.q, self.sizes)
        if not 0 <= self.delay <= MAX_DELAY or not 1 <= self.terms <= MAX_TERMS:
            raise FormatError(f"samples: delay is 0 to {MAX_DELAY}, terms 1 to {MAX_TERMS}")
        if (len(plant.A), plant.q) != (N, q) or plant.n < self.width or plant.m < m:
            raise FormatError("samples: the sampled plant is of another shape")
        for key, matrices, columns in (("A", self.A, n), ("B", self.B, m), ("E", self.E, q)):
            if matrices and len(matrices) != N:
                raise FormatError(f"samples: {key} is missing at a vertex")
            for M in matrices:
                require_shape(M, n, columns, f"samples: {key}")
        common_denominator([*self.A, *self.B, *self.E])
        if len(self.units) != n + m + q or min(self.units) <= 0:
            raise FormatError(f"samples: units must hold {n + m + q} positive numbers")
        if self.source is not None and not self.bent:
            raise FormatError("samples: of functions of the parameters the plant has bends")
        if (plant.ranges or self.bent) and 2 ** len(plant.ranges) != N:
            raise FormatError("samples: the vertices are not those of the parameters")
        if self.bent:
            points, length = N + len(plant.nodes), longest((self.units, (plant.step,)))
            spend(RATIONAL * points * n * len(self.units), length + 1000, 3 * length)

    def inequalities(self) -> Iterator[Inequality]:
        """Yield nothing: what is compared are numbers."""
        yield from ()

    def decided(self) -> Verdict:
        """Compare what goes on between samples, and how late inputs move on."""
        if not self._moves_on():
            return undecided("the inputs on their way do not move on by one sample")
        if self.bent:
            return self._decided_at_nodes()
        try:
            entries, rest = self.off()
        except FormatError as problem:
            return undecided(str(problem))
        largest = ZERO
        for values, limits in zip(entries, self._allowed(), strict=True):
            for x, most in zip(values, limits, strict=True):
                if not most:
                    return undecided("the remainder is zero where the series goes on")
                largest = max(largest, (x + rest) / most)
        if largest > 1:
            return undecided("the samples are farther from the vertices' than the remainder says")
        share = math.ceil(1000 * largest) / 10
        return Verdict("proved", f"samples within {share:g} % of the remainder")

    @property
    def bent(self) -> bool:
        """Whether the plant's remainder is that of an interpolation between nodes."""
        return self.plant.remainder is not None and bool(self.plant.remainder.bends)

    def bounds(self) -> Bends:
        """Return how much the samples bend along each parameter, in the units.

        Raises
        ------
        FormatError
            If the sample time is too long for so many terms.
        """
        return bends(self._rates(), self.terms, self._curves)

    @cached_property
    def _curves(self) -> Curves | None:
        """What functions of the parameters add between corners, in the units."""
        if self.source is None:
            return None
        known, on_box = self.source.functions.derivatives, self.source.functions.on_box[1]
        chords = [(min(f.corners), max(f.corners)) for f in on_box]
        sizes = []
        for ranges, (low, high) in zip(known, chords, strict=True):
            value = ranges[0][0]
            least, most = (Fraction(x, intervals.ONE) for x in value)
            sizes.append(max(most - low, high - least))
        along = []
        for i in range(len(self.plant.ranges)):
            derivatives = [[intervals.size(f[i][k]) for f in known] for k in (1, 2, 3)]
            steps = [_steps_along(f.corners, i, len(self.plant.ranges)) for f in on_box]
            derivatives[0] = [a + b for a, b in zip(derivatives[0], steps, strict=True)]
            first, second, third = (self._of_functions(values, True) for values in derivatives)
            along.append((first, second, third))
        size, smooth = self._of_functions(sizes, True), self._smooth
        if min(smooth) > 2:
            return Curves(size, tuple(along))
        chosen = [
            [Fraction(j == k and bounded < 2) for j in range(len(smooth))]
            for k, bounded in enumerate(smooth)
        ]
        kinks = (self._of_functions(values, True) for values in chosen)
        return Curves(size, tuple(along), tuple(kinks))

    @property
    def _smooth(self) -> list[int]:
        """How many derivatives of each function are bounded on the box."""
        count = len(self.plant.ranges)
        ends = (ZERO,) * count, (Fraction(1),) * count
        return [k for k, _ in self.source.functions.knotted(*ends)] if self.source else []

    def _of_functions(self, values: Sequence[Fraction], sizes: bool = False) -> Rationals:
        """Return so many times the functions' directions, in the units; or of their magnitudes."""
        directions = () if self.source is None else self.source.directions
        width = len(self.units)
        total = [[ZERO] * width for _ in range(self.n)]
        for value, M in zip(values, directions, strict=True):
            for i, row in enumerate(M):
                for j, x in enumerate(row):
                    total[i][j] += value * (abs(x) if sizes else x)
        return self._scaled(total)

    def _at(self, at: tuple[Fraction, ...], M: list[Rationals]) -> Rationals:
        """Return [A, B, E] T in the units at a point of the box."""
        weights = corner_weights(at)
        matrix = mix(weights, M)
        if self.source is None:
            return matrix
        functions = self.source.functions
        values = [
            value - sum(map(mul, weights, f.corners), ZERO)
            for value, f in zip(functions.values(at), functions.on_box[1], strict=True)
        ]
        return [
            list(map(add, *rows)) for rows in zip(matrix, self._of_functions(values), strict=True)
        ]

    def _inexact(self, at: tuple[Fraction, ...], missing: Fraction) -> Fraction:
        """Return what a sample at a point is off by, with what the functions there are."""
        if self.source is None:
            return missing
        functions = self.source.functions
        off = self._of_functions([functions.widest(at)] * len(functions.trees), True)
        rows = max((sum(row) for row in off), default=ZERO)
        size = max(sum(map(abs, row)) for row in self._at(at, self._rates()))
        return missing + rows * steps.exponential(math.ceil(size) + Fraction(1))

    def terms_needed(self) -> int:
        """Return how many terms of the series at a point miss next to nothing.

        Raises
        ------
        FormatError
            If the sample time is too long for as many as are computed.
        """
        return terms_needed(self._rates(), self._curves)

    def _decided_at_nodes(self) -> Verdict:
        """Compare the samples at vertices and nodes, and how much they bend between them."""
        remainder = self.plant.remainder
        if remainder is None:
            return undecided("the plant has no remainder")
        try:
            bounds = self.bounds()
        except FormatError as problem:
            return undecided(str(problem))
        kinks = remainder.kinks.sizes if remainder.kinks and bounds.kinks else ()
        if bounds.kinks and not self._same_functions(remainder):
            return undecided("a table has a knot inside the range, of which the plant says nothing")
        claimed = (*remainder.bends, *remainder.third, *kinks)
        rounding, *along = self._in_units(list(map(self._held, (remainder.rounding, *claimed))))
        # what inputs do in a part of the period bends no more than in all of it
        third = bounds.third if remainder.third else ()
        every = map(self._twice, (*bounds.along, *third, *bounds.kinks))
        missing = 2 * bounds.missing if self.early else bounds.missing
        for most, bend in zip(along, every, strict=True):
            if any(
                x > y for rows in zip(bend, most, strict=True) for x, y in zip(*rows, strict=True)
            ):
                return undecided("the samples bend more than the plant says")
        M = self._rates()
        for at, matrix in self._known_samples():
            series = held_sample(self._at(at, M), self.terms, self.early, self.m)
            off = self._inexact(at, missing)
            for i, (row, terms) in enumerate(zip(self._in_units([matrix])[0], series, strict=True)):
                for j, (x, y) in enumerate(zip(row, terms, strict=True)):
                    apart = abs(x - (i == j) - Fraction(y, ONE)) + off
                    if apart > rounding[i][j]:
                        return undecided("a sample is farther off than the plant says")
        count = len(self.plant.A) + len(self.plant.nodes)
        return Verdict("proved", f"samples compared at {count} points, and bounded between them")

    def _same_functions(self, remainder: Remainder) -> bool:
        """Whether the plant's kinks are those of the functions of what is sampled."""
        if remainder.kinks is None or self.source is None:
            return False
        return remainder.kinks.functions == self.source.functions

    def _known_samples(self) -> Iterator[tuple[tuple[Fraction, ...], Rationals]]:
        """Yield the points of the box at which F, G and H are known, with these."""
        count = len(self.plant.ranges)
        vertices = zip(self.plant.A, self.plant.B, self.plant.E or [[]] * len(self.A), strict=True)
        for at, ABE in zip(corners((ZERO,) * count, (Fraction(1),) * count), vertices, strict=True):
            yield at, self._step(*ABE)
        for node in self.plant.nodes:
            yield node.at, self._step(node.A, node.B, node.E)

    def _allowed(self) -> Rationals:
        """Return what [F, G, H] may be off by, in the units."""
        remainder = self.plant.remainder
        entries = () if remainder is None else remainder.entries
        return self._in_units([self._held(entries)])[0]

    def _held(self, matrix: Sequence[Sequence[Fraction]]) -> Rationals:
        """Return the rows and columns of [A, B, E] that are of what is sampled."""
        rest = slice(self.plant.n + self.plant.m, None)
        return [
            [*row[: self.n], *(row[k] for k in self._acting), *row[rest]]
            for row in matrix[: self.n]
        ]

    @property
    def _acting(self) -> list[int]:
        """Columns of [A, B] of the inputs that act."""
        return held_columns(self.n, self.m, self.delay, self.early, self.plant.n)

    def _twice(self, rows: Rationals) -> Rationals:
        """Return rows of [A, B, E] with the inputs' columns once more where two act."""
        if not self.early:
            return rows
        n, m = self.n, self.m
        return [[*row[: n + m], *row[n : n + m], *row[n + m :]] for row in rows]

    def off(self) -> tuple[Rationals, Fraction]:
        """Return the largest magnitude of each entry's coefficients in the units, and the rest.

        Raises
        ------
        FormatError
            If the series has too few terms for this sample time, or would take too long.
        """
        apart, left, rest = self._compared()
        rows, columns = apart.shape
        terms = [
            (matrix, apart.whole * multinomial(e, apart.sizes)) for e, matrix in apart.terms.items()
        ]

        def largest(i: int, j: int) -> Fraction:
            most = max((Fraction(abs(M[i][j]), whole) for M, whole in terms), default=ZERO)
            return most + left[i][j]

        return [[largest(i, j) for j in range(columns)] for i in range(rows)], rest

    def _compared(self) -> tuple[Polynomial, Rationals, Fraction]:
        """Return the samples less the series, and bounds on what that leaves out: see `steps`."""
        n, width = self.n, len(self.units)
        steps.require_moderate(len(self.A), n, width, self.terms, self.sizes)
        length = longest((self.units, (self.plant.step,)))
        # an entry may have a thousand bits, about
        spend(RATIONAL * 2 * len(self.A) * n * width, length + 1000, 3 * length)
        series, left, rest = steps.series_by_entries(self._rates(), self.terms, self.sizes)
        if self.early:
            steps.require_moderate(len(self.A), n, width, self.terms, self.sizes)
            soon = steps.series_by_entries(self._rates(self.early), self.terms, self.sizes)
            inputs = slice(n, n + self.m)
            now = soon[0].part(slice(None), inputs)
            before = series.part(slice(None), inputs) - now
            parts = (series.part(slice(None), slice(n)), before, now)
            series = side_by_side([*parts, series.part(slice(None), slice(n + self.m, None))])
            left = [
                [*x[:n], *map(add, x[inputs], y[inputs]), *y[inputs], *x[n + self.m :]]
                for x, y in zip(left, soon[1], strict=True)
            ]
            rest += soon[2]
        eye = [row + [ZERO] * (series.shape[1] - n) for row in identity(n)]
        apart = bernstein(self._in_units(self._steps()), self.sizes, 1)
        remainder = self.plant.remainder
        if remainder is not None and remainder.curve:
            curve = self._in_units(list(map(self._held, remainder.curve)))
            apart = apart + bernstein(curve, self.sizes, remainder.degree)
        return apart - constant(eye, self.sizes) - series, left, rest

    def _in_units(self, matrices: list[Rationals], time: Fraction | int = 1) -> list[Rationals]:
        """Return matrices of the columns of `_held` in the units, times a time."""
        units = self._twice([list(self.units)])[0]
        return [
            [
                [value * time * u / unit for value, u in zip(row, units, strict=True)]
                for row, unit in zip(matrix, units[: self.n], strict=True)
            ]
            for matrix in matrices
        ]

    def _rates(self, share: Fraction | int = 1) -> list[Rationals]:
        """Return [A, B, E] of a share of T in the units, at every vertex."""
        return [self._scaled(matrix, share) for matrix in _beside(self.A, self.B, self.E)]

    def _scaled(self, matrix: Rationals, share: Fraction | int = 1) -> Rationals:
        """Return [A, B, E] of a share of T in the units."""
        time = share * self.plant.step
        return [
            [value * time * u / unit for value, u in zip(row, self.units, strict=True)]
            for row, unit in zip(matrix, self.units[: self.n], strict=True)
        ]

    def _steps(self) -> list[Rationals]:
        """Return F, G, H side by side at every vertex, as the plant has them."""
        none: list[Rationals] = [[]] * len(self.plant.A)
        vertices = zip(self.plant.A, self.plant.B, self.plant.E or none, strict=True)
        return [self._step(*vertex) for vertex in vertices]

    def _step(self, A: Rationals, B: Rationals, E: Rationals) -> Rationals:
        """Return F, G, H side by side."""
        n, E = self.n, E or [[] for _ in A]
        both = [a + b for a, b in zip(A, B, strict=True)]
        return [both[i][:n] + [both[i][k] for k in self._acting] + E[i] for i in range(n)]

    def _moves_on(self) -> bool:
        """Whether what is not between samples is exact: inputs move on, and no sooner."""
        n, m, width = self.n, self.m, self.width
        zero_row = [ZERO] * self.plant.n
        for M in () if self.plant.remainder is None else self.plant.remainder.curve:
            if _filled(M) != _filled(self._held(M)):  # something is of what is not sampled
                return False
        none: list[Rationals] = [[]] * len(self.plant.A)
        points = list(zip(self.plant.A, self.plant.B, self.plant.E or none, strict=True))
        points += [(node.A, node.B, node.E) for node in self.plant.nodes]
        for A, B, E in points:
            if any(any(a[width:] + b[m:]) for a, b in zip(A[:width], B[:width], strict=True)):
                return False
            if not self.delay:
                continue
            acting = self._acting
            both = [a + b for a, b in zip(A[:n], B[:n], strict=True)]
            if any(x for row in both for k, x in enumerate(row) if k >= n and k not in acting):
                return False
            for i in range(width - n):
                moved = list(zero_row)
                if i >= m:
                    moved[n + i - m] = Fraction(1)
                into = [Fraction(int(i == k < m)) for k in range(self.plant.m)]
                if A[n + i] != moved or B[n + i] != into:
                    return False
            if any(map(any, E[n:width])):
                return False
        return all(map(self._is_between, self.plant.nodes))

    def _is_between(self, node: Node) -> bool:
        """Whether what is not sampled, states of a law or of filters, is as between vertices."""
        weights, plant = corner_weights(node.at), self.plant
        pairs = ((node.A, plant.A), (node.B, plant.B), (node.E, plant.E))
        return all(
            M[self.width :] == mix(weights, [vertex[self.width :] for vertex in vertices])
            for M, vertices in pairs
            if vertices and plant.n > self.width
        )


def _steps_along(values: Sequence[Fraction], i: int, count: int) -> Fraction:
    """Return the largest change of values at the corners along a parameter."""
    half = 1 << (count - 1 - i)
    lower = (j for j in range(len(values)) if not j // half % 2)
    return max(abs(values[j + half] - values[j]) for j in lower)


def _filled(rows: Sequence[Sequence[Fraction]]) -> int:
    """Return how many entries are not zero."""
    return sum(x != 0 for row in rows for x in row)


def _beside(A: list[Rationals], B: list[Rationals], E: list[Rationals]) -> list[Rationals]:
    empty: list[Rationals] = [[[] for _ in M] for M in A]
    vertices = zip(A, B, E or empty, strict=True)
    return [[a + b + e for a, b, e in zip(*rows, strict=True)] for rows in vertices]
