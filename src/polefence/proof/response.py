"""x(t) of a loop x' = A x + b at all values of its parameters: polynomials, and what they are off.

On each step of length h, with s from 0 to 1, x is nearly

    X(s) = c_0 + c_1 s + ... + c_m s^m,    c_(i+1) = h (A c_i + [i = 0] b) / (i + 1),

the series of the solution from where the last step ended. The c are polynomials in the parameters,
of few degrees and of fixed point: what is left out, and every rounding, is a defect

    X' = h (A X + b) + d(s),

whose size |d|_P = sqrt(d'P d) is known. Where A'P + P A + 2 beta P < 0, the error e = x - X has

    |e(s)|_P <= |e(0)|_P exp(-beta h s) + the integral of |d|_P from 0 to s,

so it neither grows with the number of steps nor hangs on how stiff the loop is.

Parameters are those of a product of simplices. Of each simplex of V corners one coordinate depends
on the others; these, less 1 / V, are the variables g of the polynomials, |g| <= 1 - 1 / V.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise, product

from polefence.proof.claims.signal import root_above
from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import Exponent, Polynomial, Sizes
from polefence.proof.work import spend

SPLITS = 6  # of a step, one half of the last each

Form = dict[Exponent, list[int]]  # of vectors: a coefficient for each monomial of g


@dataclass(frozen=True)
class Centred:
    """A matrix polynomial in g: ``terms`` are coefficients times ``whole``."""

    terms: dict[Exponent, list[list[int]]]
    whole: int

    @classmethod
    def of(cls, P: Polynomial) -> Centred:
        """Return a polynomial on simplices as one in g."""
        sizes, terms, rows = P.sizes, dict[Exponent, list[list[int]]](), P.shape[0]
        scale = 1
        for size, degree in zip(sizes, P.degrees, strict=True):
            scale *= size**degree
        for e, M in P.terms.items():
            for g, factor in _in_centred(e, sizes).items():
                old = terms.get(g)
                if old is None:
                    terms[g] = [[factor * x for x in row] for row in M]
                    continue
                for i in range(rows):
                    own = M[i]
                    old[i] = [x + factor * y for x, y in zip(old[i], own, strict=True)]
        kept = {g: M for g, M in terms.items() if any(map(any, M))}
        return cls(kept, P.whole * scale)

    def times(self, c: Form) -> Form:
        """Return the product with a vector, times ``whole``."""
        total: Form = {}
        for e, M in self.terms.items():
            for f, v in c.items():
                key = tuple(map(int.__add__, e, f))
                own = [sum(map(int.__mul__, row, v)) for row in M]
                old = total.get(key)
                total[key] = own if old is None else list(map(int.__add__, old, own))
        return total


def _in_centred(e: Exponent, sizes: Sizes) -> dict[Exponent, int]:
    """Return a monomial of alpha in g, times V^degree of each simplex."""
    first, result = 0, dict[Exponent, int]({(): 1})
    for size in sizes:
        own = e[first : first + size]
        first += size
        forms = dict.fromkeys([(0,) * (size - 1)], 1)
        for j, power in enumerate(own):
            for _ in range(power):
                forms = _times_coordinate(forms, j, size)
        result = {(*a, *b): x * y for (a, x), (b, y) in product(result.items(), forms.items())}
    return result


def _times_coordinate(forms: dict[Exponent, int], j: int, size: int) -> dict[Exponent, int]:
    """Return V alpha_j times a polynomial: 1 + V g_j, or 1 - V (sum of g) of the first."""
    total = dict[Exponent, int]()
    for e, x in forms.items():
        total[e] = total.get(e, 0) + x
        for k in range(size - 1):
            if j and k != j - 1:
                continue
            up = (*e[:k], e[k] + 1, *e[k + 1 :])
            total[up] = total.get(up, 0) + (size if j else -size) * x
    return {e: x for e, x in total.items() if x}


def variables(sizes: Sizes) -> tuple[Fraction, ...]:
    """Return the largest size of each g."""
    return tuple(Fraction(size - 1, size) for size in sizes for _ in range(size - 1))


@dataclass(frozen=True)
class Series:
    """How x is followed: steps of length ``step``, ``terms`` of s, ``degree`` of g, ``bits``."""

    step: Fraction
    terms: int
    degree: int
    bits: int


@dataclass(frozen=True)
class Step:
    """X on one step: forms over 2^bits, one a power of s; and how far |x - X|_P is at most."""

    number: int
    forms: tuple[Form, ...]
    error: Fraction


@dataclass(frozen=True)
class Follower:
    """A loop x' = A x + b, from forms x0 over 2^bits, and the norm in which errors are measured.

    Attributes
    ----------
    A, b : Centred
        b of one column.
    norm : tuple of Fraction
        Numbers with |e|_P <= sum of norm_i |e_i|.
    fades : Fraction
        No less than exp(-beta h).
    """

    A: Centred
    b: Centred
    series: Series
    sizes: Sizes
    norm: tuple[Fraction, ...]
    fades: Fraction

    @property
    def variables(self) -> tuple[Fraction, ...]:
        """The largest size of each g."""
        return variables(self.sizes)

    def rate_of(self, x: Form) -> Form:
        """Return A x + b, each number rounded down twice."""
        bits, n = self.series.bits, len(self.norm)
        rate = {e: [y // self.A.whole for y in v] for e, v in self.A.times(x).items()}
        for e, M in self.b.terms.items():
            own = [(row[0] << bits) // self.b.whole for row in M]
            rate[e] = list(map(int.__add__, rate.get(e, [0] * n), own))
        return rate

    def steps(self, x0: Form, error: Fraction, count: int) -> Iterator[Step]:
        """Yield so many steps, from what is off by ``error`` at the begin."""
        start = x0
        for k in range(count):
            forms, defect = self._series(start)
            yield Step(k, forms, error + defect)
            error = error * self.fades + defect
            start = end_of(forms)

    def _series(self, start: Form) -> tuple[tuple[Form, ...], Fraction]:
        """Return c_0 to c_m, and the integral of the defect at most."""
        series, h = self.series, self.series.step
        c, forms, defect = start, [start], Fraction(0)
        n = len(self.norm)
        for i in range(series.terms + 1):
            spend(n * n * len(self.A.terms) * max(1, len(c)), 64, 64)
            whole = self.A.times(c)
            if i == 0:
                for e, M in self.b.terms.items():
                    up = [(row[0] * self.A.whole << series.bits) // self.b.whole for row in M]
                    old = whole.get(e, [0] * n)
                    whole[e] = list(map(int.__add__, old, up))
            over = self.A.whole * h.denominator
            if i == series.terms:  # all that is left
                off = self.size(whole) * h.numerator / over
                defect += off / (i + 1)
                break
            over *= i + 1
            kept, left, rounded = dict[Exponent, list[int]](), dict[Exponent, list[int]](), 0
            for e, v in whole.items():
                if sum(e) > series.degree:
                    left[e] = v
                    continue
                own = [(2 * h.numerator * x + over) // (2 * over) for x in v]
                rounded += 1
                if any(own):
                    kept[e] = own
            off = self.size(left) * h.numerator / over if left else Fraction(0)
            off += Fraction(rounded, 2) * sum(self.norm)
            if i == 0:  # b itself is rounded down
                off += Fraction(len(self.b.terms) * h.numerator, over) * sum(self.norm)
            defect += off  # (i + 1) times it, integrated over s^i
            c = kept
            forms.append(c)
            if not c:
                break
        return tuple(forms), defect / 2**series.bits

    def size(self, c: Form) -> Fraction:
        """Return how large a vector is at most, in the norm."""
        most, total = self.variables, [Fraction(0)] * len(self.norm)
        for e, v in c.items():
            scale = Fraction(1)
            for power, size in zip(e, most, strict=True):
                scale *= size**power
            for i, x in enumerate(v):
                total[i] += abs(x) * scale
        return sum((w * x for w, x in zip(self.norm, total, strict=True)), Fraction(0))


def end_of(forms: Sequence[Form]) -> Form:
    """Return X at the end of a step."""
    total: Form = {}
    for form in forms:
        for e, v in form.items():
            old = total.get(e)
            total[e] = list(v) if old is None else list(map(int.__add__, old, v))
    return total


def norms(P: Rationals) -> tuple[Fraction, ...]:
    """Return sqrt(P_ii), rounded up: |e|_P is at most the sum of these times |e_i|."""
    return tuple(root_above(P[i][i]) for i in range(len(P)))


# --- polynomials of numbers, over s from 0 to 1 and g --------------------------------------------


def positive(q: dict[Exponent, int], most: Sequence[Fraction], splits: int = SPLITS) -> bool:
    """Whether Bernstein coefficients show that a polynomial is positive, of halves of s if need be.

    Parameters
    ----------
    q : dict
        Of exponents of s and of each g.
    most : sequence of Fraction
        The largest size of each g.
    """
    degrees = [max((e[k] for e in q), default=0) for k in range(len(most) + 1)]
    shape = [degree + 1 for degree in degrees]
    strides = [math.prod(shape[k + 1 :]) for k in range(len(shape))]
    values = [0] * math.prod(shape)
    for e, x in q.items():
        values[sum(map(int.__mul__, e, strides))] += x
    spend(len(values) * sum(shape), 64, 64)
    for k, degree in enumerate(degrees):
        T = _to_bernstein(degree) if not k else _centred_to_bernstein(degree, most[k - 1])
        values = _moved(values, shape[k], strides[k], T)
    return _is_positive(values, shape[0], strides[0], splits)


def _is_positive(values: list[int], count: int, stride: int, splits: int) -> bool:
    if min(values) > 0:
        return True
    corners = [*values[:stride], *values[-stride:]]
    if splits == 0 or (stride == 1 and min(corners) <= 0) or count == 1:
        return False
    rows = [values[i * stride : (i + 1) * stride] for i in range(count)]
    left, right, last = [rows[0]], [rows[-1]], rows
    for _ in range(count - 1):
        last = [list(map(int.__add__, a, b)) for a, b in pairwise(last)]
        left.append(last[0])
        right.append(last[-1])
    halves = (left, right[::-1])
    for half, order in zip(halves, (1, -1), strict=True):
        powers = range(count)[::order]
        scaled = [x << (count - 1 - k) for k, row in zip(powers, half, strict=True) for x in row]
        if not _is_positive(scaled, count, stride, splits - 1):
            return False
    return True


def _moved(values: list[int], count: int, stride: int, T: list[list[int]]) -> list[int]:
    """Return values with a matrix applied along one axis."""
    result = [0] * len(values)
    for start in range(0, len(values), count * stride):
        for j in range(stride):
            own = values[start + j : start + count * stride : stride]
            for i, row in enumerate(T):
                result[start + j + i * stride] = sum(map(int.__mul__, row, own))
    return result


@lru_cache(maxsize=64)
def _to_bernstein(degree: int) -> list[list[int]]:
    """Return what makes Bernstein coefficients on [0, 1] of powers, times a positive number."""
    whole = math.lcm(*(math.comb(degree, i) for i in range(degree + 1)))
    return [
        [math.comb(j, i) * whole // math.comb(degree, i) for i in range(degree + 1)]
        for j in range(degree + 1)
    ]


@lru_cache(maxsize=64)
def _centred_to_bernstein(degree: int, most: Fraction) -> list[list[int]]:
    """Return the same of powers of g = most (2 u - 1), u from 0 to 1."""
    a, b = most.numerator, most.denominator
    powers = [
        [
            math.comb(e, i) * 2**i * (-1) ** (e - i) * a**e * b ** (degree - e) if i <= e else 0
            for e in range(degree + 1)
        ]
        for i in range(degree + 1)
    ]
    return [
        [sum(map(int.__mul__, row, column)) for column in zip(*powers, strict=True)]
        for row in _to_bernstein(degree)
    ]
