r"""Between samples: the mean square of a signal while inputs are held, from that at the samples.

During a period T the signals k of a computer are constant, x' = A x + B k + E w and z = C x + D k.
With N = [A, B; 0, 0] and noise w of two-sided intensity S, the mean of E z'z over the period is
E [x; k]'M [x; k] + c of the states at its begin, and T V is the covariance that the noise adds to
that of the next sample:

    M = 1/T int_0^T exp(N's) [C, D]'[C, D] exp(N s) ds,
    V = 1/T int_0^T exp(A s) S E E' exp(A's) ds,
    c = 1/T int_0^T (T - s) tr C exp(A s) S E E' exp(A's) C' ds.

All are computed for a short part h of the period by their series, and for twice the time by

    V_2h = (V_h + F V_h F') / 2,  M_2h = (M_h + F'M_h F) / 2,  c_2h = c_h + h / 2 tr M_h V_h,

with F the exponential of the time h (Van Loan, 1978). Where the signals change on the way, as an
input that is late by a part of a period, one part is put behind the other in the same way.

At points of the box this is done in whole multiples of 2^-96, with a bound on what rounding makes.
Between points V, M and c are interpolated: their derivatives along a parameter t are at most those
that the same computation has with the largest magnitudes in place of A, B, C, D and E, and these
plus s times the largest magnitudes of their slopes: powers of s up to the third are computed,
rounded up. The diagonals of A keep their signs: exp(A h) is e^(-a h) exp((A + a I) h), of which the
latter's series has no negative term.

A clock that is not perfect makes periods theta T, theta anywhere in an interval, in any order:
theta is one more coordinate t, of [A, B] theta T, on which neither the law nor Q depends. Then

    (exp(N theta T) - 1) / T = theta int_0^1 exp(N theta T s) ds N

is computed too, by G_2h = (G_h + F G_h) / 2, for the samples that are so far apart. Where inputs
change a time a T after a sample, whatever comes after it, r = theta - a is what varies. With F, M,
V and c of the time before, of a T, and of that after it, of r T, what goes on over T is

    (F_r F_a - 1) / T = r G_r N_r F_a + (F_a - 1) / T,
    theta M = r F_a'M_r F_a + a M_a,  theta V = r V_r + a F_r V_a F_r',
    theta c = r (r c_r + a tr M_r V_a) + a^2 c_a:

r times what is interpolated, and what is interpolated beside it.

What interpolation and rounding may miss, entry by entry R, is made up for by a diagonal matrix:
with any w > 0 that of sum_j R_ij w_j / w_i exceeds every symmetric matrix of entries within R. So V
and M are nowhere below the true ones; w are about the inverse roots of the diagonals of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from operator import add, mul
from typing import Any, TypeVar

from polefence.proof.laws import on_corners
from polefence.proof.matrices import (
    ZERO,
    Integers,
    Rationals,
    bits,
    common_denominator,
    longest,
    mix,
    transposed,
)
from polefence.proof.plant import Output, held_columns, lattice, read_early, sizes_of
from polefence.proof.polynomials import (
    Polynomial,
    Sizes,
    affine,
    bernstein,
    diagonal,
    form,
    number,
)
from polefence.proof.ranges import corner_weights, corners
from polefence.proof.reading import MAX_VERTICES, Table, plain, require_shape
from polefence.proof.remainder import LARGER, THIRD, Remainder
from polefence.proof.short import Short
from polefence.proof.text import milliseconds_text
from polefence.proof.work import RATIONAL, FormatError, counted, spend, spend_once

FINE = 96  # bits after the point
ONE = 1 << FINE
KEPT = 64  # of these, bits of values at points
TERMS = 22  # of the series over h, where |N| h is 1/4 at most: what is left is below 2^-96
MOST_DOUBLINGS, MAX_DELAY = 24, 64
MOST_IN_MIDDLES = 3  # parameters of parts with nodes in their middles: 3^k; one more is the period
UNBOUNDED = 10**18  # work: what the count around it leaves
LARGE = 1 << 40  # times its units, what a period may make of a state: else too few bits are left

MOST_PERIODS, MOST_PARTS = 64, 32  # of a clock
# Numbers of what is times the last part of a period; what is beside it stands so many behind.
ENERGY, NOISE, MORE, MOVED = range(4)
BESIDE = 4

Point = tuple[Fraction, ...]
Number = TypeVar("Number", Fraction, float)
Series = list[Integers]  # coefficients of powers of s, in multiples of 2^-96


@dataclass(frozen=True)
class Mean(Short):
    """Upper bounds of M, V and c on a part of the box, as polynomials."""

    M: Polynomial
    V: Polynomial
    c: Polynomial

    def noise(self, Q: Polynomial) -> Polynomial:
        """Return c + tr Q V."""
        total, V = self.c, self.V
        for i in range(V.shape[0]):
            row = slice(i, i + 1)
            total = total + Q.part(row, slice(V.shape[0])) * V.part(slice(None), row)
        return total


@dataclass(frozen=True)
class Step(Short):
    """What a period of theta T makes of x: (exp(N theta T) - 1) [x; k] / T, and what goes on in it.

    ``moved`` (n, n + k) is off by ``off``, entry by entry; ``theta`` is the polynomial of one entry
    that is the length. ``whole`` are M, V and c times theta: integrals over the period, over T.
    """

    moved: Polynomial
    off: Rationals
    theta: Polynomial
    whole: Mean


@dataclass(frozen=True)
class Span(Short):
    """Periods of ``least`` T to ``most`` T, each anything between; looked at in ``parts``."""

    least: Fraction
    most: Fraction
    parts: int = 1

    @classmethod
    def read(cls, table: Table) -> Span:
        """Read one."""
        least, most = table.number("least"), table.number("most")
        if not 0 < least <= most <= MOST_PERIODS:
            raise FormatError(
                f"{table.path('most')}: is at least least, which is above 0, and at most "
                f"{MOST_PERIODS}"
            )
        return cls(least, most, table.whole("parts", 1, least=1))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        return {"least": plain(self.least), "most": plain(self.most), "parts": self.parts}

    @property
    def lengths(self) -> list[tuple[Fraction, Fraction]]:
        """The parts."""
        wide = (self.most - self.least) / self.parts
        return list(pairwise(self.least + wide * k for k in range(self.parts + 1)))


@dataclass(frozen=True)
class Clock(Short):
    """Periods of lengths that lie in any of ``spans``, one after the other in any order.

    The first holds a period of T; of lost samples each further one holds those with one more lost.
    """

    spans: tuple[Span, ...]

    @classmethod
    def read(cls, table: Table) -> Clock:
        """Read a clock."""
        spans = tuple(map(Span.read, table.tables("spans", MOST_PARTS)))
        if not spans or not spans[0].least <= 1 <= spans[0].most:
            raise FormatError(f"{table.path('spans')}: the first holds 1")
        if any(one.most >= other.least for one, other in pairwise(spans)):
            raise FormatError(f"{table.path('spans')}: each begins after the one before has ended")
        if sum(span.parts for span in spans) > MOST_PARTS:
            raise FormatError(f"{table.path('spans')}: there are at most {MOST_PARTS} parts")
        return cls(spans)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        return {"spans": [span.write() for span in self.spans]}

    @property
    def least(self) -> Fraction:
        """The shortest period."""
        return self.spans[0].least

    @property
    def most(self) -> Fraction:
        """The longest."""
        return self.spans[-1].most

    def some(self, share: Fraction) -> Clock | None:
        """Return a clock with a share of what this one is off by; None with nothing of it."""
        spans = (
            replace(span, least=1 + share * (span.least - 1), most=1 + share * (span.most - 1))
            for span in self.spans
        )
        return replace(self, spans=tuple(spans)) if share else None

    @property
    def lengths(self) -> list[tuple[Fraction, Fraction]]:
        """The parts of the periods."""
        return [ends for span in self.spans for ends in span.lengths]

    @property
    def jitters(self) -> bool:
        """Whether a period may be of any length between two."""
        return any(span.least < span.most for span in self.spans)

    @property
    def ends(self) -> list[Fraction]:
        """Where spans begin and end, the shortest first."""
        every = dict.fromkeys(end for span in self.spans for end in (span.least, span.most))
        return list(every)

    def text(self, step: Fraction) -> str:
        """Return the periods in milliseconds: 1.6 to 2.4 ms, or 3.2 to 4.8 ms."""
        spans = list[str]()
        for span in self.spans:
            ends = dict.fromkeys(milliseconds_text(x * step) for x in (span.least, span.most))
            spans.append(f"{' to '.join(ends)} ms")
        return " or ".join(spans)


@dataclass(frozen=True)
class _Values(Short):
    """What is interpolated, at a point, in multiples of 2^-96 of units, and what it is off by."""

    every: tuple[Integers, ...]
    off: tuple[int, ...]


@dataclass(frozen=True)
class Changed(Short):
    """B and D at every vertex in the last ``share`` of a period, where they are others then.

    Of periods of any length all but the last ``share`` of a step goes by before that.
    """

    share: Fraction
    B: list[Rationals]
    D: list[Rationals]


@dataclass(frozen=True)
class _Part:
    """What goes on in a part of a period: F, M, V, c and G N, and what each is off by."""

    F: Integers
    M: Integers
    V: Integers
    c: int
    moved: Integers
    off: tuple[int, int, int, int, int]

    def alone(self, time: Fraction) -> _Values:
        """Return the values of a period of this part alone, so many ``step`` long."""
        _, *offs, of_c, of_moved = self.off
        c, to_c = _scaled([[self.c]], of_c, time)
        every = self.M, self.V, c, self.moved
        none = (_scaled(M, 0, ZERO)[0] for M in every)
        return _Values((*every, *none), (*offs, to_c, of_moved, 0, 0, 0, 0))

    def then(self, time: Fraction, last: _Part, rest: Fraction) -> _Values:
        """Return the values of a period of this part and a last one, so many ``step`` long."""
        of_F, of_M, of_V, of_c, of_G = self.off
        by_F, by_M, by_V, by_c, by_G = last.off
        n = len(self.V)
        half, off = _multiplied(last.M, by_M, self.F, of_F)
        M, to_M = _multiplied(transposed(self.F), of_F, half, off)
        small = [row[:n] for row in last.F[:n]]
        half, off = _multiplied(self.V, of_V, transposed(small), by_F)
        V, to_V = _multiplied(small, by_F, half, off)
        inner = [row[:n] for row in last.M[:n]]
        sizes = (_sum_of(inner), _sum_of(self.V))
        by = -(-(sizes[0] * of_V + sizes[1] * by_M + n * n * of_V * by_M) // ONE) + 2
        c = math.floor(rest * last.c + time * _inner(inner, self.V))
        to_c = math.ceil(rest * by_c + time * by) + 1
        moved, to_G = _multiplied(last.moved, by_G, self.F, of_F)
        beside = (
            _scaled(self.M, of_M, time),
            _scaled(_symmetric(V), to_V, time),
            _scaled([[self.c]], of_c, time**2),
            _scaled(self.moved, of_G, time),
        )
        every = ((_symmetric(M), to_M), (last.V, by_V), ([[c]], to_c), (moved, to_G), *beside)
        matrices, offs = zip(*every, strict=True)
        return _Values(matrices, offs)


@dataclass(frozen=True)
class Period(Short):
    """x' = A x + B k + E w, z = C x + D k at every vertex, k constant for a time ``step``.

    ``units`` are of x and k. E has its columns scaled; the noise has two-sided ``intensity``. With
    ``lengths`` the time is any between these times ``step``: the last parameter.
    """

    A: list[Rationals]
    B: list[Rationals]
    C: list[Rationals]
    D: list[Rationals]
    E: list[Rationals]
    step: Fraction
    intensity: Fraction
    units: tuple[Fraction, ...]
    lengths: tuple[Fraction, Fraction] | None = None
    changed: Changed | None = None
    _known: dict[Any, tuple[Any, int]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _of_lengths: dict[Any, Period] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A[0])

    @property
    def count(self) -> int:
        """Number of states and constant signals."""
        return len(self.units)

    @property
    def parameters(self) -> int:
        """Number of parameters, whose box has its corners at the vertices; the period is one."""
        return self._plain + (self.lengths is not None)

    def on_part(self, low: Point, high: Point, sizes: Sizes) -> Mean:
        """Return upper bounds of M, V and c on a part of the box, in its own coordinates.

        Of periods of any length they are times the length.

        Raises
        ------
        FormatError
            If the period is too long for these rates.
        """
        low, high = low[: self.parameters], high[: self.parameters]  # of one vertex a point
        n, u = self.n, self.units
        noise, energy = self._noise_unit, self._energy_unit
        V = [[noise * u[i] * u[j] for j in range(n)] for i in range(n)]
        M = [[energy / (a * b) for b in u] for a in u]
        c = [[self.step * noise * energy]]
        rest = self._rest_form(sizes)
        parts = list[Polynomial]()
        for k, unit in ((ENERGY, M), (NOISE, V), (MORE, c)):
            P = rest * self._above(k, unit, low, high, sizes)
            if self.changed is not None:
                P = P + self._above(k + BESIDE, unit, low, high, sizes)
            parts.append(P)
        return Mean(*parts)

    def _above(self, k: int, unit: Rationals, low: Point, high: Point, sizes: Sizes) -> Polynomial:
        """Return an upper bound of what is interpolated, on a part of the box."""
        P, entries = self._interpolated(k, unit, low, high, sizes)
        size = _sizes(self._at(low).every[k])
        rows = [
            sum((x * b for x, b in zip(row, size, strict=True)), ZERO) * a
            for row, a in zip(entries, size, strict=True)
        ]
        less = [x * unit[i][i] / size[i] ** 2 for i, x in enumerate(rows)]
        return P + diagonal(less, sizes)

    def _interpolated(
        self, k: int, unit: Rationals, low: Point, high: Point, sizes: Sizes
    ) -> tuple[Polynomial, Rationals]:
        """Return what is interpolated on a part, and what it may miss, in units."""
        points = lattice(low, high, 2 if self._in_middles else 1)
        found = list(map(self._at, points))
        ends = set(corners(low, high))
        corner = [j for j, at in enumerate(points) if at in ends]
        values = [_kept(v.every[k], unit) for v in found]
        remainder = self._remainders[k].inside(low, high, [_one(v, unit) for v in values])
        P = affine([values[i] for i in corner], sizes)
        if remainder.curve:
            curved = [_times(rows, unit) for rows in remainder.curve]
            P = Remainder((), tuple(curved), remainder.degree).curved(P)
        rounding = _rounding(k, found) * LARGER ** (self.parameters if self._in_middles else 0)
        return P, [[x + rounding for x in row] for row in remainder.entries]

    def _rest_form(self, sizes: Sizes) -> Polynomial:
        """Return how long the last part of a period is."""
        least, most = self._rest
        if self.lengths is None:
            return number(most, sizes)
        whole = math.lcm(least.denominator, most.denominator)
        return form(len(sizes) - 1, (int(least * whole), int(most * whole)), sizes, whole)

    def _moved(
        self, unit: Rationals, low: Point, high: Point, sizes: Sizes
    ) -> tuple[Polynomial, Rationals]:
        """Return what a period of any length makes of x, and what it may miss, in units.

        It is affine in the parameters, not in the length, along which G N bends most, by far; and
        its degree counts twice. Through a value in the middle the interpolation is of degree 2
        along the length alone: it makes errors of those before it larger, by at most 5/4.
        """
        ends, more, sides = (
            corners(low[:-1], high[:-1]),
            BESIDE + MOVED,
            zip(low, high, strict=True),
        )
        moved, beside, found = list[Rationals](), list[Rationals](), list[_Values]()
        for at in ends:
            three = [self._at((*at, t)) for t in (ZERO, Fraction(1, 2), Fraction(1))]
            found += three
            beside.append(_kept(three[0].every[more], unit))
            begin, middle, end = (_kept(v.every[MOVED], unit) for v in three)
            bent = [
                [2 * y - (x + z) / 2 for x, y, z in zip(*rows, strict=True)]
                for rows in zip(begin, middle, end, strict=True)
            ]
            moved += [begin, end, bent]  # in the order of `monomials_of`
        plain = (1,) * (len(sizes) - 1)
        P = self._rest_form(sizes) * bernstein(moved, sizes, (*plain, 2))
        missed = [[LARGER * _rounding(MOVED, found)] * len(row) for row in unit]
        missed = _plus(missed, self._every[-1][MOVED][3], Fraction(6) / THIRD)
        squares = [(b - a) ** 2 for a, b in list(sides)[:-1]]
        for side, bends in zip(squares, self._bends(MOVED), strict=True):
            missed = _plus(missed, bends, side * LARGER)
        missed = [[x * self._rest[1] for x in row] for row in missed]
        if self.changed is not None:
            P = P + bernstein(beside, sizes, (*plain, 0))
            missed = [[x + _rounding(more, found) for x in row] for row in missed]
            for side, bends in zip(squares, self._bends(more), strict=True):
                missed = _plus(missed, bends, side)
        return P, missed

    def between(self, lengths: tuple[Fraction, Fraction]) -> Period:
        """Return it with periods of any length between two, times ``step``."""
        if lengths not in self._of_lengths:
            self._of_lengths[lengths] = replace(self, lengths=lengths)
        return self._of_lengths[lengths]

    def step_on(self, low: Point, high: Point, sizes: Sizes) -> Step:
        """Return what a period makes of x on a part of the box of the other parameters.

        Parameters
        ----------
        sizes : tuple of int
            Of the box with the period as its last parameter.

        Raises
        ------
        FormatError
            If the period is too long for these rates.
        """
        if self.lengths is None:
            raise FormatError("clock: the period is one")
        more, (least, most) = self.parameters - 1, self.lengths
        low, high = (*low[:more], ZERO), (*high[:more], Fraction(1))
        u = self.units
        unit = [[a / (b * self.step) for b in u] for a in u[: self.n]]
        moved, off = self._moved(unit, low, high, sizes)
        whole = math.lcm(least.denominator, most.denominator)
        theta = form(len(sizes) - 1, (int(least * whole), int(most * whole)), sizes, whole)
        off = [[x * y for x, y in zip(*rows, strict=True)] for rows in zip(off, unit, strict=True)]
        mean = self.on_part(low, high, sizes)
        if least == most:  # all of it is the same along the length
            moved, theta = moved.at_end(last=False).widened(), theta.at_end(last=False).widened()
            mean = Mean(*(P.at_end(last=False).widened() for P in (mean.M, mean.V, mean.c)))
        return Step(moved, off, theta, mean)

    def require_moderate(self) -> None:
        """Count the work on what holds for all points, and do it where that was not done.

        Raises
        ------
        FormatError
            If it is too much, or the period is too long for these rates.
        """
        self._counted("rates", self._prepared)

    def _prepared(self) -> None:
        both = [M for _, B, D in self.phases for M in (*B, *D)]
        every = [*self.A, *both, *self.C, *self.E]
        length = longest((self.units, (self.step,), *(row for M in every for row in M)))
        spend(4 * RATIONAL * sum(len(M) * len(M[0]) for M in every if M and M[0]), length, length)
        # of powers of s a product is ten; twice the slopes, and h a quarter, are 3 doublings
        products = 10 * (2 * TERMS + 5 * (self._doublings + 4) + 8) * len(self.phases)
        spend(self.parameters * products * self.count**3, FINE, FINE)
        _ = self._remainders

    def _counted(self, key: Any, computed: Callable[[], Any]) -> Any:
        """Return what is computed once, and count its work once for each claim."""
        amount = 0
        if key not in self._known:
            with counted(UNBOUNDED) as count:
                value = computed()
            self._known[key] = value, count.spent
        else:
            amount = self._known[key][1]
        spend_once(self._known, key, amount)
        return self._known[key][0]

    # --- at a point ------------------------------------------------------------------------------

    def _at(self, point: Point) -> _Values:
        """Return what is interpolated at a point."""

        def computed() -> _Values:
            products = 3 * TERMS + 5 * self._doublings
            if self.lengths is not None:
                products += TERMS + self._doublings
            spend((products + 5) * len(self.phases) * self.count**3, FINE, FINE)
            weights = corner_weights(point[: self._plain])
            A, C, E = (mix(weights, M) for M in (self.A, self.C, self.E))
            times = self.times(self._length(point))
            first, *others = (
                self._computed(time, A, mix(weights, B), C, mix(weights, D), E)
                for time, (_, B, D) in zip(times, self.phases, strict=True)
            )
            if not others:
                return first.alone(times[0])
            return first.then(times[0], others[0], times[1])

        values: _Values = self._counted(point, computed)
        return values

    def _length(self, point: Point) -> Fraction:
        """Return the period at a point, times ``step``."""
        if self.lengths is None:
            return Fraction(1)
        least, most = self.lengths
        return least + (most - least) * point[-1]

    def _computed(
        self,
        length: Fraction,
        A: Rationals,
        B: Rationals,
        C: Rationals,
        D: Rationals,
        E: Rationals,
    ) -> _Part:
        """Return what goes on in a time of so many ``step``."""
        n, N, j = self.n, self.count, self._doublings
        whole = self._rates([[*a, *b] for a, b in zip(A, B, strict=True)])
        rates = [[round(x * length * ONE / (1 << j)) for x in row] for row in whole]
        rates += [[0] * N for _ in range(N - n)]
        Q = _rounded(self._energy([[*c, *d] for c, d in zip(C, D, strict=True)]))
        W = _rounded(self._noise(E))
        F = _exponential(rates)
        M, _ = _integral(transposed(rates), Q)
        V, once_more = _integral([row[:n] for row in rates[:n]], W)
        c = _inner([row[:n] for row in Q[:n]], once_more) >> j
        # what N rounds to changes a series by N e^(1/2) / 2 at most, its 22 terms by one each
        of_F, of_M, of_V = N + TERMS + 4, 5 * N + 2 * TERMS + 6, 5 * n + 2 * TERMS + 6
        of_c = n * n * (of_V + 2)
        G, of_G = (_mean_exponential(rates), of_F) if self.lengths else ([], 0)
        for k in range(j, 0, -1):
            inner = [row[:n] for row in M[:n]]
            c += _inner(inner, V) >> k + 1
            sizes = (_sum_of(inner), _sum_of(V))
            of_c += -(-(sizes[0] * of_V + sizes[1] * of_M + n * n * of_V * of_M) // ONE) + 2
            M, of_M = _half_more(M, of_M, transposed(F), F, of_F)
            small = [row[:n] for row in F[:n]]
            V, of_V = _half_more(V, of_V, small, transposed(small), of_F)
            if G:
                more, off = _multiplied(F, of_F, G, of_G)
                G = [
                    [(x + y) // 2 for x, y in zip(*rows, strict=True)]
                    for rows in zip(G, more, strict=True)
                ]
                of_G = (of_G + off + 1) // 2 + 1
            F, of_F = _multiplied(F, of_F, F, of_F)
            if max(bits(F), bits(M), bits(V)) > FINE + LARGE.bit_length():
                raise FormatError("between samples: the sample time is too long for these rates")
        moved, of_moved = [[0] * N for _ in range(n)], 0
        if G:
            small = [row[:n] for row in G[:n]]
            moved, of_moved = _multiplied(small, of_G, _rounded(whole), 1)
        return _Part(F, M, V, c, moved, (of_F, of_M, of_V, of_c, of_moved))

    # --- in units --------------------------------------------------------------------------------

    def _rates(self, AB: Rationals) -> Rationals:
        """Return [A, B] T in the units."""
        return [
            [x * self.step * u / unit for x, u in zip(row, self.units, strict=True)]
            for row, unit in zip(AB, self.units, strict=False)
        ]

    def _energy(self, CD: Rationals) -> Rationals:
        """Return [C, D]'[C, D] in the units, over that of z'z."""
        rows = [[x * u for x, u in zip(row, self.units, strict=True)] for row in CD]
        return _square(rows, self._energy_unit)

    def _noise(self, E: Rationals) -> Rationals:
        """Return S E E' in the units, over its own."""
        columns = _columns([[x / u for x in row] for row, u in zip(E, self.units, strict=False)])
        return _square(columns, self._noise_unit, self.intensity)

    @property
    def phases(
        self,
    ) -> list[tuple[tuple[Fraction, Fraction], list[Rationals], list[Rationals]]]:
        """What a period has one after the other: for how long at least and at most, B and D."""
        least, most = self.lengths or (Fraction(1), Fraction(1))
        ends = list(zip(self.times(least), self.times(most), strict=True))
        signals = [(self.B, self.D)]
        if self.changed is not None:
            signals.append((self.changed.B, self.changed.D))
        return [(both, B, D) for both, (B, D) in zip(ends, signals, strict=True)]

    def times(self, length: Number) -> list[Number]:
        """Return for how long each phase goes on in a period so long, all times ``step``."""
        if self.changed is None:
            return [length]
        first = type(length)(1 - self.changed.share)
        return [first, length - first]

    @property
    def _rest(self) -> tuple[Fraction, Fraction]:
        """For how long the last phase goes on, at least and at most."""
        return self.phases[-1][0]

    @cached_property
    def _largest(self) -> list[tuple[Rationals, Rationals, Rationals]]:
        """The largest magnitudes of [A, B] T, [C, D] and E in units, in each phase."""
        return [(_most(AB), _most(CD), _most(E)) for AB, CD, E in self._in_units]

    @cached_property
    def _in_units(self) -> list[tuple[list[Rationals], list[Rationals], list[Rationals]]]:
        """[A, B] T, [C, D] and the columns of E at the vertices, in units, in each phase."""
        return [self._of_phase(B, D) for _, B, D in self.phases]

    def _of_phase(
        self, B: list[Rationals], D: list[Rationals]
    ) -> tuple[list[Rationals], list[Rationals], list[Rationals]]:
        AB = [_beside(a, b) for a, b in zip(self.A, B, strict=True)]
        CD = [_beside(c, d) for c, d in zip(self.C, D, strict=True)]
        u = self.units
        rows = [[[x * v for x, v in zip(row, u, strict=True)] for row in M] for M in CD]
        columns = [
            _columns([[x / v for x in row] for row, v in zip(M, u, strict=False)]) for M in self.E
        ]
        return [self._rates(M) for M in AB], rows, columns

    @cached_property
    def _energy_unit(self) -> Fraction:
        """A power of two, no entry of [C, D]'[C, D] in units is above it."""
        return max(_power_above(_square(CD, Fraction(1))) for _, CD, _ in self._largest)

    @cached_property
    def _noise_unit(self) -> Fraction:
        """A power of two, no entry of S E E' in units is above it."""
        return _power_above(_square(self._largest[0][2], Fraction(1), self.intensity))

    @cached_property
    def _doublings(self) -> int:
        """How often h is doubled, where |N| h, and that of its transpose, is 1/4 at most."""
        pairs = zip(self.phases, self._largest, strict=True)
        every = (_ints([[x * m for x in row] for row in AB]) for ((_, m), *_), (AB, *_) in pairs)
        return max(self._halvings(Fraction(1, 4), [rates]) for rates in every)

    def _halvings(self, most: Fraction, matrices: Iterable[Integers]) -> int:
        """Return how often the period is halved for sums of rows and columns to be so small."""
        size = Fraction(sum(max(_row_sum(M), _row_sum(transposed(M))) for M in matrices), ONE)
        doublings = max(0, math.ceil(size / most) - 1).bit_length()
        if doublings > MOST_DOUBLINGS:
            raise FormatError("between samples: the sample time is too long for these rates")
        return doublings

    # --- between points --------------------------------------------------------------------------

    @property
    def _in_middles(self) -> bool:
        return bool(self.parameters) and self._plain <= MOST_IN_MIDDLES

    @cached_property
    def _remainders(self) -> tuple[Remainder, ...]:
        """Of what is interpolated, in units, without what values are off by at points."""
        every = self._every
        n, N = self.n, self.count
        shapes = ((N, N), (n, n), (1, 1), (n, N)) * 2
        zeros = [tuple((ZERO,) * columns for _ in range(rows)) for rows, columns in shapes]
        remainders = list[Remainder]()
        for k, none in enumerate(zeros):
            twice, thrice = (
                [_as_rows(found[k][d], math.factorial(d)) for found in every] for d in (2, 3)
            )
            third = thrice if self._in_middles else []
            remainders.append(Remainder.between(none, twice, third))
        return tuple(remainders)

    @property
    def bends(self) -> list[Rationals]:
        """What affine interpolation of a period's step misses along each parameter.

        Over the square of a side, and in the units.
        """
        most = self._rest[1]
        return [
            [
                [(most * x + y) / ONE for x, y in zip(*rows, strict=True)]
                for rows in zip(*both, strict=True)
            ]
            for both in zip(self._bends(MOVED), self._bends(BESIDE + MOVED), strict=True)
        ]

    def _bends(self, k: int) -> list[Integers]:
        """What affine interpolation misses along each parameter, in multiples of 2^-96."""
        # powers of s are halves of second derivatives, of which it misses an eighth
        along = (derivatives[k][2] for derivatives in self._every[: self._plain])
        return [[[-(-x // 4) for x in row] for row in twice] for twice in along]

    @cached_property
    def _every(self) -> list[tuple[Series, ...]]:
        """Majorants along each parameter."""
        return [self._derivatives(i) for i in range(self.parameters)]

    def _derivatives(self, i: int) -> tuple[Series, ...]:
        """Return majorants along parameter i, as powers of s, in the order of `_Values`."""
        (F, M, V, c), moved = self._in_phase(i, 0)
        least, most = self._rest
        rest = [most, most - least if i == self._plain else ZERO]
        if self.changed is None:
            every = M, V, _mixed((rest, c)), moved
            return *every, *(_mixed(([ZERO], X)) for X in every)
        time = self.phases[0][0][0]
        (F2, M2, V2, c2), G = self._in_phase(i, 1)
        small, driven = _first(F2, self.n), _inner_series(_first(M2, self.n), V)
        last = (
            _sandwich(_turned(F), M2, F),
            V2,
            _mixed((rest, c2), ([time], driven)),
            _series_product(G, F),
        )
        spread = _sandwich(small, V, _turned(small))
        beside = zip((M, spread, c, moved), (time, time, time**2, time), strict=True)
        return *last, *(_mixed(([share], X)) for X, share in beside)

    def _in_phase(self, i: int, phase: int) -> tuple[tuple[Series, Series, Series, Series], Series]:
        """Return majorants of F, M, V and c of a part of the period, and that of G N."""
        n, N = self.n, self.count
        rates, outputs, driven = self._with_slopes(i, phase)
        least, most = self.phases[phase][0]
        along = (rates[0], most - least) if i == self._plain else (rates[1], most)
        pair = [
            _ints(_square_matrix([[x * times for x in row] for row in M], N))
            for M, times in ((rates[0], most), along)
        ]
        j = self._halvings(Fraction(1, 16), pair)
        diagonals = self._in_units[phase][0]
        tops = [
            max(math.ceil(M[k][k] * (most if M[k][k] > 0 else least) * ONE) for M in diagonals)
            for k in range(n)
        ]
        tops += [0] * (N - n)
        shift = max(0, -min(tops))
        shifted = [
            [top + shift if k == m else x for m, x in enumerate(row)]
            for k, (row, top) in enumerate(zip(pair[0], tops, strict=True))
        ]
        wide = _grown(pair, j)
        F = _over(_grown([shifted, pair[1]], j), Fraction(shift, ONE << j))
        Q = _squared(outputs, self._energy_unit)
        W = _squared(driven, self._noise_unit, self.intensity)
        M = _sandwich(_turned(wide), Q, wide)
        small = _first(wide, n)
        V = _sandwich(small, W, _turned(small))
        c = [[[-(-x[0][0] >> j + 1)]] for x in _inner_series(_first(Q, n), V)]
        G = small
        for k in range(j, 0, -1):
            more = _inner_series(_first(M, n), V)
            c = [[[x[0][0] - (-y[0][0] >> k + 1)]] for x, y in zip(c, more, strict=True)]
            M = _halved(M, _sandwich(_turned(F), M, F))
            small = _first(F, n)
            V = _halved(V, _sandwich(small, V, _turned(small)))
            G = _halved(G, _series_product(small, G))
            F = _series_product(F, F)
        known = [_ints(M) for M in rates]
        none = [[0] * N for _ in range(n)]
        moved = _series_product(G, [*known, none, none])
        return (F, M, V, c), moved

    def _with_slopes(self, i: int, phase: int) -> list[tuple[Rationals, Rationals]]:
        """Return the largest magnitudes of rates, outputs and noise, and their slopes along i."""
        largest, every = self._largest[phase], self._in_units[phase]
        if i == self._plain:  # along the period
            return [(M, [[ZERO] * len(M[0]) for _ in M]) for M in largest]
        half = 1 << (self._plain - 1 - i)
        return [
            (most, _most(_slopes(matrices, half)))
            for most, matrices in zip(largest, every, strict=True)
        ]

    @property
    def _plain(self) -> int:
        """Number of parameters without the period."""
        return len(self.A).bit_length() - 1


@dataclass(frozen=True)
class Held(Short):
    """x' = A x + B u + E w at every vertex, with u held between samples, ``delay`` samples late.

    ``units`` are of x and u. The states at a sample are x and the inputs on their way, and others
    that do not change between samples. With a ``clock`` samples are not all equally far apart.
    Inputs act sooner by the share ``early`` of ``step`` than so many samples late: with a clock so
    long after a sample that 1 - early of it has gone by, however late the next one comes.
    """

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    delay: int
    units: tuple[Fraction, ...]
    clock: Clock | None = None
    early: Fraction = ZERO
    _known: dict[Any, Period] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def read(cls, table: Table) -> Held:
        """Read what is held."""
        rows = table.tables("vertices", MAX_VERTICES)
        A, B, E = ([row.matrix(key) for row in rows] for key in "ABE")
        n, m, q = len(A[0]), len(B[0][0]), len(E[0][0])
        for key, matrices, columns in (("A", A, n), ("B", B, m), ("E", E, q)):
            for M in matrices:
                require_shape(M, n, columns, f"held: {key}")
        common_denominator([*A, *B, *E])
        clock = Clock.read(table.table("clock")) if "clock" in table else None
        delay = table.whole("delay", 0)
        early = read_early(table, delay)
        return cls(A, B, E, delay, table.numbers("units", n + m), clock, early)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        vertices = [
            {"A": plain(A), "B": plain(B), "E": plain(E)}
            for A, B, E in zip(self.A, self.B, self.E, strict=True)
        ]
        more = {} if self.clock is None else {"clock": self.clock.write()}
        more |= {"early": plain(self.early)} if self.early else {}
        return {"delay": self.delay, "units": plain(self.units)} | more | {"vertices": vertices}

    def require(self, count: int, n: int, m: int, q: int, sizes: Sizes) -> None:
        """Refuse what does not fit samples of so many vertices, states, inputs, disturbances."""
        vertices, states, inputs = len(self.A), len(self.A[0]), len(self.B[0][0])
        if not 0 <= self.delay <= MAX_DELAY:
            raise FormatError(f"held: delay is 0 to {MAX_DELAY}")
        fits = states + self.delay * inputs <= n and inputs <= m and len(self.E[0][0]) == q
        if vertices != count or not fits:
            raise FormatError("held: what is sampled is of another shape")
        if sizes != sizes_of(vertices, "box") or vertices & (vertices - 1):
            raise FormatError("held: what goes on between samples is bounded on a box")
        if self.clock is not None and self.early and self.clock.least <= 1 - self.early:
            raise FormatError("held: with this clock the next sample may come before inputs act")
        if len(self.units) != states + inputs or min(self.units) <= 0:
            raise FormatError(f"held: units must hold {states + inputs} positive numbers")

    def inside(self, low: Point, high: Point) -> Held:
        """Return what is held on a part of the box."""
        A, B, E = (on_corners(M, low, high) for M in (self.A, self.B, self.E))
        return replace(self, A=A, B=B, E=E)

    def moves(self, rows: Sequence[Sequence[Fraction]]) -> bool:
        """Whether rows of the states at a sample are of x and inputs on their way alone."""
        width = len(self.A[0]) + self.delay * len(self.B[0][0])
        return not any(any(row[width:]) for row in rows)

    def period(
        self,
        outputs: Sequence[Output],
        scales: Sequence[Fraction],
        step: Fraction,
        intensity: Fraction,
    ) -> Period:
        """Return what is between samples, with outputs in terms of the states at a sample."""
        key = (repr([(y.C, y.D) for y in outputs]), tuple(scales), step, intensity)
        if key in self._known:
            return self._known[key]
        n, m = len(self.A[0]), len(self.B[0][0])
        every, acting = self.constant(outputs), self._acting(len(outputs[0].C[0][0]))
        B = self._entering(acting[:m], every)
        rows = [[[*y.C[j][0], *y.D[j][0]] for y in outputs] for j in range(len(self.A))]
        C = [[row[:n] for row in M] for M in rows]
        D = [[[row[k] for k in every] for row in M] for M in rows]
        changed = None
        if self.early:  # what shows the inputs that act shows the next ones then
            later = [[_exchanged(row, acting[:m], acting[m:]) for row in M] for M in rows]
            shown = [[[row[k] for k in every] for row in M] for M in later]
            changed = Changed(self.early, self._entering(acting[m:], every), shown)
        E = [
            [[x * s for x, s in zip(row, scales, strict=True)] for row in M] if scales else M
            for M in self.E
        ]
        units = [self.units[n + acting.index(k) % m] if k in acting else Fraction(1) for k in every]
        every_unit = (*self.units[:n], *units)
        self._known[key] = Period(self.A, B, C, D, E, step, intensity, every_unit, changed=changed)
        return self._known[key]

    def _entering(self, acting: Sequence[int], every: Sequence[int]) -> list[Rationals]:
        """Return B with these inputs among all constant signals."""
        return [
            [[row[acting.index(k)] if k in acting else ZERO for k in every] for row in M]
            for M in self.B
        ]

    def chosen(self, outputs: Sequence[Output], form: Polynomial) -> Polynomial:
        """Return the rows of [x; u] at a sample that outputs between samples depend on."""
        chosen = self.chosen_of(outputs)
        return replace(form, terms={e: [M[k] for k in chosen] for e, M in form.terms.items()})

    def chosen_of(self, outputs: Sequence[Output]) -> list[int]:
        """Return which of [x; u] at a sample outputs between samples depend on."""
        return [*range(len(self.A[0])), *self.constant(outputs)]

    def constant(self, outputs: Sequence[Output]) -> list[int]:
        """Return which of [x; u] at a sample are constant signals that act, or that show."""
        n, acting = len(self.A[0]), self._acting(len(outputs[0].C[0][0]))
        shown = {
            k
            for y in outputs
            for C, D in zip(y.C, y.D, strict=True)
            for k, x in enumerate((*C[0], *D[0]))
            if x and k >= n
        }
        return sorted({*acting, *shown})

    def acting(self, width: int, later: bool = False) -> list[int]:
        """Return which of [x; u] at a sample, of so many states, are the inputs that act.

        ``later``: at the end of the period, where inputs act sooner by a part of it.
        """
        every, m = self._acting(width), len(self.B[0][0])
        return every[m:] if later and self.early else every[:m]

    def shown(self, row: Sequence[Fraction], width: int, later: bool) -> list[Fraction]:
        """Return a row of [x; u] at a sample, of so many states, as it is now or later."""
        if not (later and self.early):
            return list(row)
        return _exchanged(row, self.acting(width), self.acting(width, later=True))

    def _acting(self, width: int) -> list[int]:
        """Return which of [x; u] at a sample, of so many states, are the inputs that act."""
        n, m = len(self.A[0]), len(self.B[0][0])
        return held_columns(n, m, self.delay, self.early, width)


# --- rationals -----------------------------------------------------------------------------------


def _exchanged(
    row: Sequence[Fraction], first: Sequence[int], last: Sequence[int]
) -> list[Fraction]:
    """Return a row with the entries of some columns moved to others."""
    whole = list(row)
    for a, b in zip(first, last, strict=True):
        whole[a], whole[b] = ZERO, row[b] + row[a]
    return whole


def _beside(one: Rationals, other: Rationals) -> Rationals:
    return [[*a, *b] for a, b in zip(one, other, strict=True)]


def _columns(M: Rationals) -> Rationals:
    return [list(column) for column in zip(*M, strict=True)]


def _square(rows: Rationals, unit: Fraction, times: Fraction = Fraction(1)) -> Rationals:
    """Return so many times rows' rows over a unit."""
    common = common_denominator([rows])
    columns = [[int(x * common) for x in column] for column in zip(*rows, strict=True)]
    spend(len(columns) ** 2 * len(rows), bits(columns), bits(columns))
    each = times / (unit * common**2)
    return [[sum(map(mul, a, b)) * each for b in columns] for a in columns]


def _most(matrices: Sequence[Rationals]) -> Rationals:
    """Return the largest magnitudes."""
    return [
        [max(map(abs, xs)) for xs in zip(*rows, strict=True)]
        for rows in zip(*matrices, strict=True)
    ]


def _slopes(matrices: Sequence[Rationals], half: int) -> list[Rationals]:
    """Return differences of the vertices at both ends of a parameter."""
    pairs = ((matrices[j], matrices[j + half]) for j in range(len(matrices)) if not j // half % 2)
    return [
        [[b - a for a, b in zip(*rows, strict=True)] for rows in zip(one, other, strict=True)]
        for one, other in pairs
    ]


def _power_above(M: Rationals) -> Fraction:
    """Return a power of two that no entry is above; one where all are zero."""
    largest = max((x for row in M for x in row), default=ZERO)
    if not largest:
        return Fraction(1)
    above = Fraction(math.ceil(largest)) if largest >= 1 else 1 / Fraction(math.floor(1 / largest))
    whole = above >= 1
    return (
        Fraction(1 << (above.numerator - 1).bit_length())
        if whole
        else Fraction(1, 1 << above.denominator.bit_length() - 1)
    )


def _square_matrix(M: Rationals, N: int) -> Rationals:
    """Return it with rows of zeros below."""
    return [*M, *([ZERO] * N for _ in range(N - len(M)))]


def _ints(M: Rationals) -> Integers:
    """Return magnitudes in multiples of 2^-96, rounded up."""
    return [[math.ceil(x * ONE) for x in row] for row in M]


def _rounded(M: Rationals) -> Integers:
    return [[round(x * ONE) for x in row] for row in M]


def _kept(M: Integers, unit: Rationals) -> Rationals:
    """Return values with `KEPT` bits, times their units."""
    cut = FINE - KEPT
    return [
        [Fraction(x >> cut, 1 << KEPT) * y for x, y in zip(*rows, strict=True)]
        for rows in zip(M, unit, strict=True)
    ]


def _one(values: Rationals, unit: Rationals) -> Rationals:
    """Return values without their units."""
    return [[x / y for x, y in zip(*rows, strict=True)] for rows in zip(values, unit, strict=True)]


def _times(rows: Sequence[Sequence[Fraction]], unit: Rationals) -> tuple[tuple[Fraction, ...], ...]:
    return tuple(
        tuple(x * y for x, y in zip(*pair, strict=True)) for pair in zip(rows, unit, strict=True)
    )


def _rounding(k: int, found: Sequence[_Values]) -> Fraction:
    """Return what values at nodes are off by, in their units."""
    return Fraction(max(v.off[k] for v in found), ONE) + Fraction(1, 1 << KEPT)


def _plus(M: Rationals, more: Integers, times: Fraction) -> Rationals:
    """Return M and so many times a matrix in multiples of 2^-96."""
    share = times / ONE
    return [
        [x + share * y for x, y in zip(*rows, strict=True)] for rows in zip(M, more, strict=True)
    ]


def _sizes(M: Integers) -> list[Fraction]:
    """Return powers of two about the inverse roots of the diagonal; a zero counts as small."""
    least = max(M[i][i] for i in range(len(M))) >> KEPT // 2 | 1
    return [Fraction(1, 1 << max(M[i][i], least).bit_length() // 2) for i in range(len(M))]


def _as_rows(M: Integers, factor: int) -> tuple[tuple[Fraction, ...], ...]:
    return tuple(tuple(Fraction(factor * x, ONE) for x in row) for row in M)


# --- whole multiples of 2^-96 --------------------------------------------------------------------


def _product(X: Integers, Y: Integers) -> Integers:
    """Return a product, rounded down."""
    columns = transposed(Y)
    return [[sum(map(mul, row, column)) >> FINE for column in columns] for row in X]


def _inner(X: Integers, Y: Integers) -> int:
    """Return tr X'Y, rounded down."""
    return sum(sum(map(mul, *rows)) for rows in zip(X, Y, strict=True)) >> FINE


def _row_sum(M: Integers) -> int:
    return max((sum(map(abs, row)) for row in M), default=0)


def _sum_of(M: Integers) -> int:
    return sum(abs(x) for row in M for x in row)


def _exponential(rates: Integers) -> Integers:
    """Return exp N of a small N."""
    N = len(rates)
    term = total = [[ONE * (i == j) for j in range(N)] for i in range(N)]
    for k in range(1, TERMS + 1):
        term = [[x // k for x in row] for row in _product(term, rates)]
        total = _added(total, term)
    return total


def _mean_exponential(rates: Integers) -> Integers:
    """Return int_0^1 exp(N s) ds of a small N."""
    N = len(rates)
    term = total = [[ONE * (i == j) for j in range(N)] for i in range(N)]
    for k in range(1, TERMS + 1):
        term = [[x // (k + 1) for x in row] for row in _product(term, rates)]
        total = _added(total, term)
    return total


def _integral(rates: Integers, Q: Integers) -> tuple[Integers, Integers]:
    """Return int_0^1 exp(N s) Q exp(N's) ds of a small N, and the same with 1 - s besides."""
    term = total = Q
    once_more = [[x // 2 for x in row] for row in Q]
    for k in range(1, TERMS + 1):
        half = _product(rates, term)
        term = [
            [(x + y) // (k + 1) for x, y in zip(*rows, strict=True)]
            for rows in zip(half, transposed(half), strict=True)
        ]
        total = _added(total, term)
        once_more = _added(once_more, [[x // (k + 2) for x in row] for row in term])
    return total, once_more


def _added(X: Integers, Y: Integers) -> Integers:
    return [list(map(add, *rows)) for rows in zip(X, Y, strict=True)]


def _multiplied(X: Integers, of_X: int, Y: Integers, of_Y: int) -> tuple[Integers, int]:
    """Return a product, and what its entries are off by where those of X and Y are."""
    rows, columns = _row_sum(X), _row_sum(transposed(Y))
    off = -(-(rows * of_Y + columns * of_X + len(Y) * of_X * of_Y) // ONE) + 1
    return _product(X, Y), off


def _symmetric(X: Integers) -> Integers:
    """Return it with what is above the diagonal below it: rounding makes a difference."""
    rows = range(len(X))
    return [[X[min(i, j)][max(i, j)] for j in rows] for i in rows]


def _scaled(X: Integers, off: int, share: Fraction) -> tuple[Integers, int]:
    """Return a share of a matrix, and what it is off by."""
    p, q = share.numerator, share.denominator
    return [[p * x // q for x in row] for row in X], math.ceil(share * off) + 1


def _half_more(
    M: Integers, of_M: int, left: Integers, right: Integers, of_F: int
) -> tuple[Integers, int]:
    """Return (M + left M right) / 2, and what it is off by."""
    half, off = _multiplied(M, of_M, right, of_F)
    more, off = _multiplied(left, of_F, half, off)
    both = [
        [(x + y) // 2 for x, y in zip(*rows, strict=True)] for rows in zip(M, more, strict=True)
    ]
    # rounded down on either side of the diagonal: as symmetric as it is
    symmetric = [[both[min(i, j)][max(i, j)] for j in range(len(both))] for i in range(len(both))]
    return symmetric, (of_M + off + 1) // 2 + 1


# --- powers of s, rounded up ---------------------------------------------------------------------


def _series_product(X: Series, Y: Series) -> Series:
    """Return the first powers of s of a product of what is not negative."""
    columns = [transposed(M) for M in Y]
    product = Series()
    for r in range(4):
        pairs = [(X[a], columns[r - a]) for a in range(r + 1)]
        product.append(
            [
                [
                    -(-sum(sum(map(mul, M[i], of[j])) for M, of in pairs) >> FINE)
                    for j in range(len(columns[0]))
                ]
                for i in range(len(X[0]))
            ]
        )
    return product


def _sandwich(left: Series, M: Series, right: Series) -> Series:
    return _series_product(_series_product(left, M), right)


def _inner_series(X: Series, Y: Series) -> Series:
    """Return tr X'Y."""
    found = Series()
    for r in range(4):
        total = sum(
            sum(map(mul, *rows)) for a in range(r + 1) for rows in zip(X[a], Y[r - a], strict=True)
        )
        found.append([[-(-total >> FINE)]])
    return found


def _halved(X: Series, Y: Series) -> Series:
    return [
        [[-(-(x + y) // 2) for x, y in zip(*rows, strict=True)] for rows in zip(*pair, strict=True)]
        for pair in zip(X, Y, strict=True)
    ]


def _mixed(*parts: tuple[Sequence[Fraction], Series]) -> Series:
    """Return a sum of numbers times series, all powers of s, rounded up."""
    sums = Series()
    for r in range(4):
        terms = [(x, M[r - a]) for share, M in parts for a, x in enumerate(share[: r + 1]) if x]
        sums.append(
            [
                [math.ceil(sum((x * M[i][j] for x, M in terms), ZERO)) for j in range(len(row))]
                for i, row in enumerate(parts[0][1][0])
            ]
        )
    return sums


def _turned(X: Series) -> Series:
    return [transposed(M) for M in X]


def _first(X: Series, n: int) -> Series:
    return [[row[:n] for row in M[:n]] for M in X]


def _squared(
    pair: tuple[Rationals, Rationals], unit: Fraction, times: Fraction = Fraction(1)
) -> Series:
    """Return so many times (R + s S)'(R + s S) over a unit."""
    R, S = (_columns(M) for M in pair)

    def product(X: Rationals, Y: Rationals) -> Rationals:
        return [[sum(map(mul, a, b), ZERO) * times / unit for b in Y] for a in X]

    RS = product(R, S)
    pairs = zip(RS, _columns(RS), strict=True)
    cross = [[x + y for x, y in zip(*rows, strict=True)] for rows in pairs]
    return [*map(_ints, (product(R, R), cross, product(S, S))), [[0] * len(R) for _ in R]]


def _grown(pair: Sequence[Integers], halvings: int) -> Series:
    """Return exp((N + s S) / 2^halvings), N and S not negative, as `interpolation` has it."""
    N, slope = ([[-(-x >> halvings) for x in row] for row in M] for M in pair)
    size, change = (Fraction(_row_sum(M), ONE) for M in (N, slope))
    count = len(N)
    none = [[0] * count for _ in range(count)]
    one = [[ONE * (i == j) for j in range(count)] for i in range(count)]
    term, total = [one, none, none, none], [one, none, none, none]
    rates = [N, slope, none, none]
    for k in range(1, TERMS + 1):
        term = [[[-(-x // k) for x in row] for row in M] for M in _series_product(term, rates)]
        total = [_added(*both) for both in zip(total, term, strict=True)]
    for d in range(4):
        first = TERMS + 1 - d
        tail = size**first / math.factorial(first) / (1 - size / (first + 1))
        rest = math.ceil(change**d / math.factorial(d) * tail * ONE)
        total[d] = [[x + rest for x in row] for row in total[d]]
    return total


def _over(X: Series, shift: Fraction) -> Series:
    """Return a series over e^shift, rounded up."""
    whole, term = ONE, ONE
    for k in range(1, TERMS + 1):  # a little less than e^shift
        term = term * shift.numerator // (shift.denominator * k)
        whole += term
    return [[[-(-x * ONE // whole) for x in row] for row in M] for M in X]
