"""Rms of a signal under a law of controllable dampers: a linear demand, given as far as it can be.

Forces u_k between two curves of v = r x, f1(v) and f2(v), and a demand K x: u_k is what lies in the
middle of K x, f1 and f2. Where each is, is said by a quadratic form of x:

    u_k = K x    where  -(K x - f1)(K x - f2) >= 0,
    u_k = f1     where  -(K x - f1) v >= 0,            u_k = f2     where  (K x - f2) v >= 0.

Lines f = c v are so for all v; curves that are bent, f = c v + d, from one bend a to the next, b,
which (v - a)(b - v) >= 0 says, v - a >= 0 or b - v >= 0 at the ends. Forms are of (x, 1) there.
In each piece, one of three a damper and a range of v, the motion is x' = A (x, 1) + E w, A a closed
loop, the signal z = C (x, 1); W is the intensity times E E'. With a polynomial V in x, affine in
alpha, s the forms, m and l monomials, and in every piece G > 0 and H > 0

    1 - z'z / g^2 - (grad V)'A x - (1/2) tr W (hess V) - sum s (l'H l) = m'G m,

the mean derivative of V is at most 1 - z'z / g^2. V, m and l have even monomials or odd ones only
where all curves are lines: the motion and its mirror image are alike. A matrix X > 0 with
X A + A'X < 0 for all dampers at the least or the largest coefficient u_k / v of their curves keeps
all moments of x bounded, whatever the logic; so the mean of
V's derivative over a long time is zero, and that of z'z at most g^2.

The parameters do not move: A, z, V and X are affine in alpha, on the box of the parameters where
they span the vertices. Both left sides, times the square of each sum of alpha, are forms in it of
degree two in every parameter. What is asked of them is asked of their coefficients, one for each
pair of vertices, or for the pairs that have one monomial. v, K and E are the same at all. (The
energy of a car over its sprung mass m is such an X, but for a little more, with 1/m affine in
alpha.)

Pieces are the product of what each damper may do. A quadratic V needs none of them: with u among
the variables and for each damper a form s_k of (K x, v, u, 1) that is not negative on what it does,
see `polefence.proof.sectors`, one inequality in (x, u, 1) for each pair of vertices is enough,

    1 - z'z / g^2 - (grad V)'(A x + B u) - (1/2) tr W (hess V) - sum s_k > 0,

and the regions of the dampers are added up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, reduce
from itertools import product as cartesian
from math import prod
from typing import Any, ClassVar, Self

from polefence.proof import squares
from polefence.proof.claims.base import Claim, Place, require_work
from polefence.proof.claims.refutation import RmsLimit, require_driven, require_limit
from polefence.proof.claims.signal import acting_text, misnamed, outputs_text, require_shapes
from polefence.proof.dampers import SemiActive, read_dampers
from polefence.proof.laws import add
from polefence.proof.matrices import (
    LONGEST,
    Integers,
    Rationals,
    common_denominator,
    least_work,
    longest,
    product,
    whole_numbers,
)
from polefence.proof.motion import is_moving
from polefence.proof.plant import Plant
from polefence.proof.polynomials import Sizes, corners_of, count_of
from polefence.proof.reading import MAX_SIZE, MAX_VERTICES, Table, as_list, as_number, plain
from polefence.proof.sectors import GIVEN, LOWER, UPPER, WORDS, Sector, part_text
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up, sum_text
from polefence.proof.work import RATIONAL, FormatError, WorkError, spend

MAX_DEGREE, MAX_MONOMIALS, MAX_PIECES = 8, 2000, 1000

Matrices = tuple[Rationals, ...]
Group = tuple[tuple[int, int], ...]  # ordered pairs of vertices, of one monomial in alpha


@dataclass(frozen=True)
class Case(Short):
    """What a damper does somewhere: its force by (x, 1), where forms of (x, 1) are not negative."""

    words: str
    what: int
    force: list[Fraction]
    forms: Matrices


@dataclass(frozen=True)
class Squares(Short):
    """The matrices of a piece: G of its bases, and H of the bases of each damper's forms."""

    grams: Matrices
    multipliers: tuple[Matrices, ...]


@dataclass(frozen=True)
class Clipped(Short, Claim):
    """The rms of z is at most that of the limit, for every alpha.

    Attributes
    ----------
    A, B, E : list of matrices
        For each vertex.
    limit : RmsLimit
    dampers : tuple of SemiActive
        One for each input, in order.
    K : m x n rationals
        What is demanded.
    degree : int
        Of V, even.
    units : tuple of Fraction
        V is a polynomial of the states over these.
    X : list of n x n rationals
        For each vertex.
    V : tuple of tuples of Fraction
        For each vertex, by the monomials but one: the even ones where all curves are lines.
    pieces : tuple of Squares
        For each coefficient, each choice of a case for every damper; see `pieces_of`.
        None where there are sectors.
    sectors : tuple of Sector
        One for each damper, of a V of degree two without pieces.
    scales : tuple of Fraction
        How much of each disturbance acts; all of each where there are none.
    sizes : tuple of int
        Corners of each simplex of alpha; the vertices of one where there are none.
    """

    kind: ClassVar[str] = "clipped"
    letters: ClassVar[str] = "ABE"
    of_law: ClassVar[bool] = False

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    limit: RmsLimit
    dampers: tuple[SemiActive, ...]
    K: Rationals
    degree: int
    units: tuple[Fraction, ...]
    X: list[Rationals]
    V: tuple[tuple[Fraction, ...], ...]
    pieces: tuple[Squares, ...]
    scales: tuple[Fraction, ...] = ()
    sizes: Sizes = ()
    sectors: tuple[Sector, ...] = ()

    # --- as files have it ------------------------------------------------------------------------

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:  # noqa: ARG003
        """Read the limit, the dampers, what is demanded, and the evidence."""
        plant.require_noise(table.where)
        if is_moving(plant.ranges):
            raise FormatError(f"{table.where}: needs constant parameters")
        evidence = table.table("evidence")
        degree = evidence.whole("degree", None, MAX_DEGREE, 2)
        rows = evidence.tables("pieces", MAX_PIECES) if "pieces" in evidence else []
        sectors = evidence.tables("sectors", MAX_SIZE) if "sectors" in evidence else []
        return cls(
            plant.A,
            plant.B,
            plant.E,
            RmsLimit.read(table.table("limit"), plant),
            read_dampers(table, plant),
            table.matrix("K", plant.m, plant.n),
            degree,
            evidence.numbers("units", plant.n),
            evidence.matrices("X", plant.n, plant.n, len(plant.A)),
            _read_rows(evidence, "V"),
            tuple(map(_read_squares, rows)),
            table.numbers("disturbances", plant.q) if "disturbances" in table else (),
            plant.sizes,
            tuple(map(Sector.read, sectors)),
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind, "limit": self.limit.write()}
        table |= {"disturbances": plain(self.scales)} if self.scales else {}
        table["dampers"] = [damper.write() for damper in self.dampers]
        table["K"] = plain(self.K)
        pieces = [
            {
                "squares": plain(piece.grams),
                "multipliers": [{"squares": plain(multiplier)} for multiplier in piece.multipliers],
            }
            for piece in self.pieces
        ]
        evidence: dict[str, Any] = {"degree": self.degree, "units": plain(self.units)}
        evidence |= {"X": plain(self.X), "V": plain(self.V)}
        evidence |= {"pieces": pieces} if pieces else {}
        evidence |= {"sectors": [own.write() for own in self.sectors]} if self.sectors else {}
        return table | {"evidence": evidence}

    def statement(self, plant: Plant) -> str:
        """Say what the rms is at most, and the law."""
        level, density = digits_up(self.limit.level), digits_down(2 * self.limit.intensity, 4)
        acting = acting_text(self.scales, plant)
        said = [
            f"u{damper.number + 1} = {sum_text([('x', row)])}, clipped to {damper.bounds_text}"
            for row, damper in zip(self.K, self.dampers, strict=True)
        ]
        return (
            f"rms of {outputs_text(self.limit.outputs, plant)} <= {level} at density {density}"
            f"{acting}, for every alpha, with {'; '.join(said)}; and exponential stability "
            "whatever is chosen between these bounds at any time"
        )

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that an output has the name of another signal of the plant."""
        return misnamed(self.limit.outputs, plant)

    @property
    def alpha(self) -> Sizes:
        """Corners of each simplex of alpha."""
        return self.sizes or (len(self.A),)

    @property
    def even(self) -> bool:
        """Whether the motion and its mirror image are alike."""
        return all(damper.straight for damper in self.dampers)

    @cached_property
    def cases(self) -> list[list[Case]]:
        """What each damper may do."""
        return [cases_of(row, own) for row, own in zip(self.K, self.dampers, strict=True)]

    # --- what may be asked ------------------------------------------------------------------------

    def require(self) -> None:
        """Refuse what is incomplete or inconsistent, or out of all proportion."""
        N, n, m = require_driven(self.A, self.B, self.E, self.scales)
        require_shapes([self.K], 1, m, n, "K")
        require_shapes(self.X, N, n, n, "X")
        if self.sizes and corners_of(self.sizes) != N:
            raise FormatError(f"alpha has {corners_of(self.sizes)} corners, not {N}")
        require_limit(self.limit, N, n, m)
        if self.limit.level <= 0:
            raise FormatError("the level must be positive")
        for damper in self.dampers:
            damper.require(N, n, m)
        if [damper.number for damper in self.dampers] != list(range(m)):
            raise FormatError("dampers: there must be one for each input, in order")
        if any(self.E[0] != E for E in self.E) or any(
            rate != damper.rate[0] for damper in self.dampers for rate in damper.rate
        ):
            raise FormatError("E, and the dampers' rates, must be the same at every vertex")
        if len(self.units) != n or min(self.units) <= 0:
            raise FormatError(f"units must hold {n} numbers above zero")
        self._require_evidence()

    def _require_evidence(self) -> None:
        N, n = len(self.A), len(self.A[0])
        if type(self.degree) is not int or not 2 <= self.degree <= MAX_DEGREE or self.degree % 2:
            raise FormatError(f"degree must be even, 2 to {MAX_DEGREE}")
        count = squares.count_of(n, self.degree, self.even)
        if count > MAX_MONOMIALS:
            raise WorkError("the monomials are too many to be checked here")
        if len(self.V) != N or any(len(V) != count - 1 for V in self.V):
            raise FormatError(f"V must hold {count - 1} numbers, one per monomial, for each vertex")
        if self.sectors:
            self._require_sectors()
        else:
            self._require_pieces()
        numbers: list[Rationals] = [self.K, *self.X, list(map(list, self.V)), [list(self.units)]]
        numbers += [[[self.limit.level, self.limit.intensity, *self.scales]]]
        numbers += [M for y in self.limit.outputs for M in (*y.C, *y.D)]
        numbers += [M for damper in self.dampers for M in damper.numbers]
        numbers += [
            G for piece in self.pieces for Gs in (piece.grams, *piece.multipliers) for G in Gs
        ]
        numbers += [M for own in self.sectors for M in own.numbers]
        common_denominator([*numbers, *self.A, *self.B, *self.E])

    def _require_pieces(self) -> None:
        n = len(self.A[0])
        pieces = count_of(self.alpha, (2,) * len(self.alpha))
        pieces *= prod(damper.case_count for damper in self.dampers)
        if pieces > MAX_PIECES:
            raise WorkError("the pieces are too many to be checked here")
        if len(self.pieces) != pieces:
            raise FormatError(f"pieces must be {pieces}")
        inner, lower = (squares.bases(n, self.degree // 2 - k, self.even) for k in range(2))
        if max(map(len, inner)) > MAX_SIZE:
            raise WorkError("the monomials are too many to be checked here")
        choices = pieces_of(self.alpha, list(map(len, self.cases)))
        for piece, (_, choice) in zip(self.pieces, choices, strict=True):
            _require_sizes(piece.grams, inner)
            if len(piece.multipliers) != sum(len(case.forms) for case in self._chosen(choice)):
                raise FormatError("each piece has multipliers of every damper's forms")
            for multiplier in piece.multipliers:
                _require_sizes(multiplier, lower)
        rows = len(self.pieces) * len(inner)
        require_work(least_work(rows, max(map(len, inner))))

    def _require_sectors(self) -> None:
        if self.degree != 2 or self.pieces:
            raise FormatError("sectors prove a V of degree 2, without pieces")
        if len(self.sectors) != len(self.dampers):
            raise FormatError("sectors: there must be one for each damper")
        for own, damper in zip(self.sectors, self.dampers, strict=True):
            own.require(damper)
        size = len(self.A[0]) + len(self.dampers) + 1
        require_work(least_work(count_of(self.alpha, (2,) * len(self.alpha)), size))

    # --- the proof --------------------------------------------------------------------------------

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield the evidence's matrices."""
        for j, X in enumerate(self.X):
            yield f"X {j + 1}", X
        for k, piece in enumerate(self.pieces):
            for matrices in (piece.grams, *piece.multipliers):
                for G in matrices:
                    yield f"a matrix of piece {k + 1}", G
        for k, own in enumerate(self.sectors):
            yield f"the form of sector {k + 1}", own.form

    def blocks(self) -> Iterator[tuple[Place, Integers]]:
        """Yield the matrices that are to be positive definite, with their places."""
        for j, X in enumerate(self.X):
            yield _block(f"X, vertex {j + 1}", X)
        groups = groups_of(self.alpha)
        ends = [_ends(damper) for damper in self.dampers]
        for cases in cartesian(*ends):
            loops = [self._loop(j, cases)[0] for j in range(len(self.A))]
            for group in groups:
                terms = [_decrease(self.X[j], loops[k]) for j, k in group]
                name = f"of any logic, {_vertices(group)}{_words(cases)}"
                yield _block(name, reduce(add, terms))
        yield from self._of_sectors(groups) if self.sectors else self._of_pieces()

    def _of_sectors(self, groups: Sequence[Group]) -> Iterator[tuple[Place, Integers]]:
        """Yield what the forms are to fulfil, and the inequalities with the forces free."""
        for own, damper in zip(self.sectors, self.dampers, strict=True):
            for name, matrix in own.blocks(damper):
                yield _block(name, matrix)
        rows = [self._open(j) for j in range(len(self.A))]
        self._spend_open(groups)
        for group in groups:
            yield _block(f"of forces that are free, {_vertices(group)}", self._free(group, rows))

    def _open(self, j: int) -> tuple[Rationals, Rationals, Rationals]:
        """Return the motion at a vertex, z and half the gradient of V by (x, u, 1), in the units.

        The gradient has no u.
        """
        n, m, units, none = len(self.units), len(self.dampers), self.units, Fraction(0)
        C, D = ([getattr(y, k)[j][0] for y in self.limit.outputs] for k in "CD")
        moved, z = (
            [
                [
                    *(x * s / own for x, s in zip(row, units, strict=True)),
                    *(u / own for u in push),
                    none,
                ]
                for row, push, own in zip(states, forces, owns, strict=True)
            ]
            for states, forces, owns in (
                (self.A[j], self.B[j], units),
                (C, D, [Fraction(1)] * len(C)),
            )
        )
        H = [[none] * (n + m + 1) for _ in range(n)]
        exponents = squares.known(n, 2, self.even)[1:]
        for e, value in zip(exponents, self.V[j], strict=True):
            i, *others = (k for k in range(n) for _ in range(e[k]))
            k = others[0] if others else n + m
            H[i][k] += value / 2
            if others:
                H[k][i] += value / 2
        return moved, z, H

    def _free(
        self, group: Group, rows: Sequence[tuple[Rationals, Rationals, Rationals]]
    ) -> Rationals:
        """Return the matrix of the inequality at a coefficient, by (x, u, 1) in the units."""
        n, m, noise, weight = (
            len(self.units),
            len(self.dampers),
            self._noise(),
            Fraction(len(group)),
        )
        forms: list[tuple[Fraction, Rationals]] = []
        one = weight
        for j, k in group:
            (_, z, H), (moved, other, _) = rows[j], rows[k]
            forms += [(Fraction(2), _form_of(H, moved))]
            forms += [(1 / self.limit.level**2, _form_of(z, other))]
            one -= sum((noise[a][b] * H[a][b] for a in range(n) for b in range(n)), Fraction(0))
        for sector, asked, damper in zip(self.sectors, self.K, self.dampers, strict=True):
            place = [[Fraction(0)] * (n + m + 1) for _ in range(4)]
            for row, given in zip(place, (asked, damper.rate[0][0]), strict=False):
                row[:n] = [x * s for x, s in zip(given, self.units, strict=True)]
            place[2][n + damper.number] = place[3][-1] = Fraction(1)
            forms += [(weight, _form_of(place, product(sector.form, place)))]
        total = [
            [-sum((w * M[a][b] for w, M in forms), Fraction(0)) for b in range(n + m + 1)]
            for a in range(n + m + 1)
        ]
        total[-1][-1] += one
        return total

    def _of_pieces(self) -> Iterator[tuple[Place, Integers]]:
        """Yield what each piece is to fulfil."""
        choices = pieces_of(self.alpha, list(map(len, self.cases)))
        for piece, (group, choice) in zip(self.pieces, choices, strict=True):
            cases = self._chosen(choice)
            name = f"{_vertices(group)}{_words(cases)}"
            for k, H in enumerate(H for multiplier in piece.multipliers for H in multiplier):
                yield _block(f"multiplier {k + 1}, {name}", H)
            for G in self._completed(piece, group, cases):
                yield _block(f"of squares, {name}", G)

    def _chosen(self, choice: Sequence[int]) -> tuple[Case, ...]:
        """Return the case of each damper."""
        return tuple(own[k] for own, k in zip(self.cases, choice, strict=True))

    def _loop(self, j: int, cases: Sequence[Case]) -> tuple[Rationals, Rationals]:
        """Return the closed loop at a vertex, and the rows of z, by (x, 1)."""
        gain = [case.force for case in cases]
        C, D = ([getattr(y, k)[j][0] for y in self.limit.outputs] for k in "CD")
        free = [[*row, Fraction(0)] for row in self.A[j]], [[*row, Fraction(0)] for row in C]
        return add(free[0], product(self.B[j], gain)), add(free[1], product(D, gain))

    def _completed(
        self, piece: Squares, group: Group, cases: Sequence[Case]
    ) -> Iterator[Rationals]:
        """Return the matrices G of a piece, made exact."""
        n, s = len(self.units), (*self.units, Fraction(1))
        forms = [form for case in cases for form in case.forms]
        numbers = dict.fromkeys(i for pair in group for i in pair)
        loops = {i: self._scaled(self._loop(i, cases)) for i in numbers}
        basis, noise = squares.known(n, self.degree, self.even)[1:], self._noise()
        self._spend(piece, forms, [(loops[k][0], noise) for _, k in group])
        share = 1 / self.limit.level**2
        f: squares.Sparse = {(0,) * n: Fraction(len(group))}
        for j, k in group:
            A, C = loops[k]
            both = _form_of(loops[j][1], C)
            f = squares.less(f, squares.of_form([[share * x for x in row] for row in both]))
            V = dict(zip(basis, self.V[j], strict=True))
            f = squares.less(f, squares.drift(V, A, noise))
        lower = squares.bases(n, self.degree // 2 - 1, self.even)
        for matrices, form in zip(piece.multipliers, forms, strict=True):
            scaled = [[x * s[a] * s[b] for b, x in enumerate(row)] for a, row in enumerate(form)]
            for H, own_basis in zip(matrices, lower, strict=True):
                multiple = squares.of_matrix(H, own_basis)
                f = squares.less(f, squares.times(squares.of_form(scaled), multiple))
        return squares.completed(f, piece.grams, squares.bases(n, self.degree // 2, self.even))

    def _scaled(self, loop: tuple[Rationals, Rationals]) -> tuple[Rationals, Rationals]:
        """Return a loop and its rows of z in the units."""
        (A, C), s = loop, (*self.units, Fraction(1))
        scaled = [[x * s[k] / s[i] for k, x in enumerate(row)] for i, row in enumerate(A)]
        return scaled, [[x * s[k] for k, x in enumerate(row)] for row in C]

    def _noise(self) -> Rationals:
        """Return the intensity times E E', in the units."""
        E, s = self.E[0], self.units
        scales = self.scales or (Fraction(1),) * len(E[0])
        rows = [
            [x * scale / unit for x, scale in zip(row, scales, strict=True)]
            for row, unit in zip(E, s, strict=True)
        ]
        S = self.limit.intensity
        return [
            [S * sum((a * b for a, b in zip(x, y, strict=True)), Fraction(0)) for y in rows]
            for x in rows
        ]

    def _spend_open(self, groups: Sequence[Group]) -> None:
        """Count the work on the inequalities with free forces before it begins."""
        n, size = len(self.units), len(self.units) + len(self.dampers) + 1
        matrices = [*self.A, *self.B, *(own.form for own in self.sectors), self.K]
        matrices += [M for y in self.limit.outputs for M in (*y.C, *y.D)]
        numbers = tuple(x for M in matrices for row in M for x in row)
        length = longest((numbers, *self.V, self.units))
        pairs = sum(map(len, groups))
        operations = pairs * size**2 * (n + len(self.limit.outputs))
        operations += len(groups) * len(self.dampers) * size**2 * 4
        spend(RATIONAL * operations, 2 * length, length)

    def _spend(
        self, piece: Squares, forms: list[Rationals], motions: list[tuple[Rationals, Rationals]]
    ) -> None:
        """Count the work on a piece's polynomial before it begins."""
        n = len(self.units)
        multipliers = [H for multiplier in piece.multipliers for H in multiplier]
        matrices = [*piece.grams, *multipliers, *forms, *self.A, *self.B, self.K]
        matrices += [M for y in self.limit.outputs for M in (*y.C, *y.D)]
        length = longest(
            (tuple(x for M in matrices for row in M for x in row), *self.V, self.units)
        )
        # each state is in as many monomials: what is not zero in its rows is what there is to do
        entries = sum(x != 0 for pair in motions for M in pair for row in M for x in row)
        operations = 2 * len(self.V[0]) * min(n, self.degree) * entries // n
        operations += sum(len(M) ** 2 for M in piece.grams)
        operations += sum(len(H) ** 2 * n * n for H in multipliers)
        spend(RATIONAL * operations, 2 * length, length)


def groups_of(sizes: Sizes) -> list[Group]:
    """Return the ordered pairs of vertices by what they stand for in a form of degree two.

    Vertices are numbered as products of the corners of each simplex are; the product of two of
    alpha is one monomial whichever of the two has which corner.
    """
    vertices = list(cartesian(*(range(size) for size in sizes)))
    groups: dict[tuple[tuple[int, ...], ...], list[tuple[int, int]]] = {}
    for (j, one), (k, other) in cartesian(enumerate(vertices), repeat=2):
        monomial = tuple((min(pair), max(pair)) for pair in zip(one, other, strict=True))
        groups.setdefault(monomial, []).append((j, k))
    return [tuple(pairs) for _, pairs in sorted(groups.items())]


def pieces_of(sizes: Sizes, counts: Sequence[int]) -> list[tuple[Group, tuple[int, ...]]]:
    """Return pairs of vertices with a case of each damper, in the order of a claim's pieces."""
    return list(cartesian(groups_of(sizes), list(cartesian(*map(range, counts)))))


def cases_of(demand: list[Fraction], damper: SemiActive) -> list[Case]:
    """Return what a damper may do with a demand, part by part of its curves."""
    one = Fraction(1)
    v = [*damper.rate[0][0], Fraction(0)]
    asked, cases = [*demand, Fraction(0)], []
    for part in damper.parts:
        low, high = ([*(c * x for x in v[:-1]), d] for c, d in damper.lines(part))
        above, below = ([k - f for k, f in zip(asked, own, strict=True)] for own in (low, high))
        start, end = part
        from_start = None if start is None else [*v[:-1], -start]
        to_end = None if end is None else [*(-x for x in v[:-1]), end]
        inside = [row for row in (from_start, to_end) if row is not None]
        if len(inside) == 1:
            inside.append([*(Fraction(0) for _ in demand), one])
        within = (_form(*inside),) if inside else ()
        kinds = (
            (GIVEN, asked, [-x for x in above], below),
            (LOWER, low, [-x for x in above], v),
            (UPPER, high, below, v),
        )
        # of one curve, whatever is demanded
        chosen = (
            [(LOWER, low, ())] if low == high else [(k, f, (_form(a, b),)) for k, f, a, b in kinds]
        )
        for what, force, form in chosen:
            said = f"u{damper.number + 1} {WORDS[what]}{part_text(part)}"
            cases.append(Case(said, what, force, (*form, *within)))
    return cases


def _ends(damper: SemiActive) -> list[Case]:
    """Return the loops of the least and the largest coefficient."""
    rate, words = damper.rate[0][0], ("lower", "upper")
    return [
        Case(
            f"u{damper.number + 1} at its {name} bound",
            what,
            [*(c * x for x in rate), Fraction(0)],
            (),
        )
        for what, name, c in zip((LOWER, UPPER), words, damper.ends, strict=True)
    ]


def _vertices(group: Group) -> str:
    """Name the vertices of pairs."""
    first, *others = sorted({pair for pair in group if pair[0] <= pair[1]})
    said = f"vertices {first[0] + 1} and {first[1] + 1}"
    return said + "".join(f", {j + 1} and {k + 1}" for j, k in others)


def _read_rows(table: Table, key: str) -> tuple[tuple[Fraction, ...], ...]:
    where, rows = table.path(key), []
    for k, row in enumerate(table.items(key, MAX_VERTICES)):
        place = f"{where}[{k + 1}]"
        rows.append(tuple(as_number(x, place) for x in as_list(row, place, MAX_MONOMIALS)))
    return tuple(rows)


def _read_squares(row: Table) -> Squares:
    grams = tuple(row.matrices("squares", None, None, 2))
    multipliers = row.tables("multipliers", MAX_SIZE)
    return Squares(grams, tuple(tuple(H.matrices("squares", None, None, 2)) for H in multipliers))


def _require_sizes(matrices: Matrices, bases: Sequence[Sequence[Any]]) -> None:
    sizes = [len(basis) for basis in bases]
    if [len(M) for M in matrices] != sizes or any(
        len(row) != len(M) for M in matrices for row in M
    ):
        raise FormatError(f"squares must be matrices of {' and '.join(map(str, sizes))} rows")


def _words(cases: Sequence[Case]) -> str:
    return "".join(f", {case.words}" for case in cases)


def _form(a: list[Fraction], b: list[Fraction]) -> Rationals:
    """Return the form that is the product of two rows."""
    return [[(x * b[k] + a[k] * b[i]) / 2 for k in range(len(a))] for i, x in enumerate(a)]


def _form_of(C: Rationals, other: Rationals) -> Rationals:
    """Return the symmetric part of C'other."""
    left = [list(column) for column in zip(*C, strict=True)]
    Q = product(left, other)
    return [[(Q[i][k] + Q[k][i]) / 2 for k in range(len(Q))] for i in range(len(Q))]


def _decrease(X: Rationals, A: Rationals) -> Rationals:
    """Return -(X A + A'X) of a loop by (x, 1), which has no constant."""
    XA = product(X, [row[:-1] for row in A])
    return [[-(XA[i][k] + XA[k][i]) for k in range(len(X))] for i in range(len(X))]


def _block(name: str, matrix: Rationals) -> tuple[Place, Integers]:
    return Place(name, (), (), name=name), whole_numbers(
        matrix, common_denominator([matrix], LONGEST)
    )
