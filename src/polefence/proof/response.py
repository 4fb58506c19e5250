"""x(t) of a loop x' = A x + b at all values of its parameters: polynomials, and what they are off.

On a step of length h, with s from -1 to 1, x is nearly a sum of Chebyshev polynomials,

    X(s) = c_0 + c_1 T_1(s) + ... + c_m T_m(s),

whose c are polynomials in the parameters, in whole numbers over 2^bits. Whatever they are, how far
X is from a solution is known exactly: the residual, and the jump from where the last step ended,

    R = X' - h / 2 (A X + b),    |R(s)| <= the sum of |R_i| of its own coefficients, for |T_i| <= 1.

What drives the loop may change over time: then b is b w, with w(t) of `polefence.proof.drives` as
Chebyshev polynomials, and what these are off, times |b|_Q and h, comes to the residual.

With |e|_Q = sqrt(e'Q e) and Q A + A'Q + 2 beta Q < 0, the error e = x - X after a step is at most

    exp(-beta h) (|e|_Q + the jump) + 2 sum |R_i|_Q,

so it neither grows with the number of steps nor hangs on how stiff the loop is. The c are those for
which R has T_m alone where parameters are in the middle (the tau method of Lanczos), and its first
powers vanish beside. They are solved for with an inverse in floats, once improved: a poor one makes
R large, and nothing false.

Of a law Z W^-1 the loop is A = M W^-1 with polynomials M and W. Followed is z of x = W z, from

    R = W Z' - h / 2 (M Z + b),

which is a polynomial as well; errors are those of x.

Parameters are those of a product of simplices. Of each simplex of V corners one coordinate depends
on the others; these, less 1 / V, are the variables g of the polynomials, |g| <= 1 - 1 / V.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import pairwise, product

from polefence.proof.drives import Constant, Drive, Driven
from polefence.proof.matrices import Integers, Rationals, inverse, root_above
from polefence.proof.polynomials import Exponent, Polynomial, Sizes
from polefence.proof.work import FormatError, spend

SPLITS = 6  # of a step, one half of the last each

ZERO = Fraction(0)
Waves = Sequence[tuple[int, ...]]  # of each w, coefficients of T_0 on over 2^bits
Form = dict[Exponent, list[int]]  # of vectors: a coefficient for each monomial of g


@dataclass(frozen=True)
class Centred:
    """A matrix polynomial in g: ``terms`` are coefficients times ``whole``."""

    terms: dict[Exponent, list[list[int]]]
    whole: int

    @classmethod
    def of(cls, P: Polynomial) -> Centred:
        """Return a polynomial on simplices as one in g."""
        sizes, terms = P.sizes, dict[Exponent, list[list[int]]]()
        scale = math.prod(size**degree for size, degree in zip(sizes, P.degrees, strict=True))
        for e, M in P.terms.items():
            for g, factor in _in_centred(e, sizes).items():
                old = terms.get(g)
                own = [[factor * x for x in row] for row in M]
                terms[g] = own if old is None else _plus(old, own)
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


def _plus(left: Integers, right: Integers) -> Integers:
    return [list(map(int.__add__, a, b)) for a, b in zip(left, right, strict=True)]


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
    """How x is followed: up to T_``terms``, ``degree`` of g, ``bits`` behind the point."""

    terms: int
    degree: int
    bits: int


@dataclass(frozen=True)
class Step:
    """X on one step: forms over 2^bits, one a T_i; and how far |x - X|_Q is at most."""

    begin: Fraction
    end: Fraction
    forms: tuple[Form, ...]
    error: Fraction
    driven: tuple[Driven, ...] = ()

    @property
    def last(self) -> Form:
        """X at the end."""
        return _sum(self.forms)


@dataclass(frozen=True)
class Follower:
    """A loop x' = A x + b w, and the norm in which errors are measured.

    Attributes
    ----------
    A, b : Centred
        b has a column for each drive; A is M where there is a W.
    norm : tuple of Fraction
        Numbers with |e|_Q <= sum of norm_i |e_i|.
    rate : Fraction
        beta [1/s].
    W : Centred, optional
        Of x = W z: forms are those of z.
    drives : tuple of Drive
        w.
    """

    A: Centred
    b: Centred
    series: Series
    sizes: Sizes
    norm: tuple[Fraction, ...]
    rate: Fraction
    W: Centred | None = None
    drives: tuple[Drive, ...] = (Constant(),)

    @cached_property
    def variables(self) -> tuple[Fraction, ...]:
        """The largest size of each g."""
        return variables(self.sizes)

    @cached_property
    def monomials(self) -> tuple[Exponent, ...]:
        """Those of g up to the degree, the lowest first."""
        every = product(range(self.series.degree + 1), repeat=len(self.variables))
        return tuple(sorted((e for e in every if sum(e) <= self.series.degree), key=sum))

    def steps(
        self, x0: Form, lengths: Sequence[Fraction], error: Fraction = ZERO
    ) -> Iterator[Step]:
        """Yield steps of these lengths, from x0, which is so far off in the norm."""
        start, begin = x0, ZERO
        for h in lengths:
            end = begin + h
            driven = self.driven(begin, end)
            waves = [w for w, _ in driven]
            forms = self.solved(start, h, waves)
            off = 2 * self.residual(forms, h, waves)
            off += h * sum(size * own for size, (_, own) in zip(self.columns, driven, strict=True))
            jump = self.far(_sum([*_signed(forms), _negative(start)]))
            yield Step(begin, end, forms, error + jump + off, driven)
            x = self.rate * h
            error = (error + jump) / (1 + x + x * x / 2 + x * x * x / 6) + off
            start, begin = _sum(forms), end

    def driven(self, begin: Fraction, end: Fraction) -> tuple[Driven, ...]:
        """Return w on a step."""
        terms, bits = self.series.terms, self.series.bits
        return tuple(drive.on(begin, end, terms, bits) for drive in self.drives)

    @cached_property
    def columns(self) -> list[Fraction]:
        """How large each column of b is at most, in the norm."""
        terms = self.b.terms.items()
        return [
            self.size({e: [row[k] for row in M] for e, M in terms}) / self.b.whole
            for k in range(len(self.drives))
        ]

    def residual(self, forms: Sequence[Form], h: Fraction, waves: Waves = ()) -> Fraction:
        """Return the sum of |R_i|_Q, exactly that of these forms, rounded up."""
        whole, other, total = self.A.whole, self.b.whole, Fraction(0)
        own = 1 if self.W is None else self.W.whole
        n, q = len(self.norm), 2 * h.denominator
        terms = len(self.A.terms) + (0 if self.W is None else len(self.W.terms))
        spend(n * n * terms * sum(map(len, forms)), 64, 64)
        for i, (form, slope) in enumerate(zip(forms, _slopes(forms), strict=True)):
            rate = self._state(slope)
            left = {e: [q * whole * other * x for x in v] for e, v in rate.items()}
            moved = self.A.times(form)
            left = _less(left, moved, h.numerator * other * own)
            left = _less(left, self._wave(waves, i), h.numerator * whole * own)
            total += self.size(left)
        return total / (q * whole * other * own << self.series.bits)

    def _wave(self, waves: Waves, i: int) -> Form:
        """Return the coefficients of T_i in b w, times b's ``whole``."""
        now = [w[i] if i < len(w) else 0 for w in waves]
        if not any(now):
            return {}
        return {e: [sum(map(int.__mul__, row, now)) for row in M] for e, M in self.b.terms.items()}

    def _state(self, z: Form) -> Form:
        """Return W z, times W's ``whole``."""
        return z if self.W is None else self.W.times(z)

    def far(self, z: Form) -> Fraction:
        """Return how large x = W z of a form over 2^bits is at most, in the norm."""
        own = 1 if self.W is None else self.W.whole
        return self.size(self._state(z)) / (own << self.series.bits)

    def solved(self, start: Form, h: Fraction, waves: Waves = ()) -> tuple[Form, ...]:
        """Return forms of which R is small."""
        m, n = self.series.terms, len(self.norm)
        inverted = self._inverse(h)
        zero, none = (0,) * len(self.variables), [0] * n
        blank = [list(none) for _ in range(n)]
        middle = self.A.terms.get(zero, blank)
        turn = blank if self.W is None else self.W.terms.get(zero, blank)
        over = 2 * h.denominator * self.A.whole
        found: list[Form] = [{} for _ in range(m + 1)]
        beside = [(e, M) for e, M in self.A.terms.items() if any(e)]
        turning = [] if self.W is None else [(e, V) for e, V in self.W.terms.items() if any(e)]
        rates = dict[Exponent, list[list[int]]]()  # slopes of the coefficients, of each monomial
        spend(len(self.monomials) * (n * (m + 1)) ** 2, 64, 64)
        acting = [self._wave(waves, j) for j in range(m)]

        def moved(M: Integers, v: list[int]) -> list[int]:
            return [h.numerator * sum(map(int.__mul__, row, v)) // over for row in M]

        def turned(V: Integers, v: list[int]) -> list[int]:
            return [sum(map(int.__mul__, row, v)) // self.W.whole for row in V] if self.W else v

        def split(flat: list[int]) -> list[list[int]]:
            return [flat[k * n : (k + 1) * n] for k in range(m + 1)]

        for e in self.monomials:
            right = [list(none) for _ in range(m)]
            for f, M in beside:
                lower = tuple(map(int.__sub__, e, f))
                if min(lower) < 0:
                    continue
                for j in range(m):
                    v = found[j].get(lower)
                    if v is not None:
                        right[j] = list(map(int.__add__, right[j], moved(M, v)))
            for f, V in turning:
                lower = tuple(map(int.__sub__, e, f))
                for j, v in enumerate(rates.get(lower, [])[:m]):
                    right[j] = list(map(int.__sub__, right[j], turned(V, v)))
            for j, wave in enumerate(acting):
                if e in wave:
                    share = 2 * h.denominator * self.b.whole
                    own = [h.numerator * x // share for x in wave[e]]
                    right[j] = list(map(int.__add__, right[j], own))
            right.append(start.get(e, none))
            if not any(map(any, right)):
                continue
            c = split(_nearly(inverted, [x for v in right for x in v]))
            slope = _slopes_of(c)  # once improved
            left = [
                [
                    a - b + d
                    for a, b, d in zip(
                        right[j], turned(turn, slope[j]), moved(middle, c[j]), strict=True
                    )
                ]
                for j in range(m)
            ]
            ends = [sum(v[i] if k % 2 == 0 else -v[i] for k, v in enumerate(c)) for i in range(n)]
            left.append([a - b for a, b in zip(right[m], ends, strict=True)])
            more = split(_nearly(inverted, [x for v in left for x in v]))
            c = [list(map(int.__add__, v, own)) for v, own in zip(c, more, strict=True)]
            if turning:
                rates[e] = _slopes_of(c)
            for k, v in enumerate(c):
                if any(v):
                    found[k][e] = v
        return tuple(found)

    def _inverse(self, h: Fraction) -> list[list[float]]:
        """Return about the inverse of what R = 0 is in the middle."""
        n = len(self.norm)
        scales = [float(x) for x in self.norm]
        middle, turn = self._middle(self.A), None if self.W is None else self._middle(self.W)
        back = None if turn is None else _floats(inverse(turn, "W"))
        M = _floats(middle if back is None else _product(middle, inverse(turn or [], "W")))
        A = tuple(
            tuple(x * (scales[i] / scales[j]) for j, x in enumerate(row)) for i, row in enumerate(M)
        )
        found = _inverted(A, float(h) / 2, self.series.terms)
        every = range(len(found))
        whole = [[found[i][j] * (scales[j % n] / scales[i % n]) for j in every] for i in every]
        if back is not None and turn is not None:  # from x to z, and from where z starts to x
            last, own = range(len(found) - n, len(found)), _floats(turn)
            for row in whole:
                ends = [sum(row[k] * own[k - last[0]][j] for k in last) for j in range(n)]
                row[last[0] :] = ends
            whole = [
                [sum(back[i % n][k] * whole[i - i % n + k][j] for k in range(n)) for j in every]
                for i in every
            ]
        return whole

    def _middle(self, P: Centred) -> Rationals:
        """Return a matrix where every g is zero."""
        n = len(self.norm)
        M = P.terms.get((0,) * len(self.variables), [[0] * n for _ in range(n)])
        return [[Fraction(x, P.whole) for x in row] for row in M]

    def rate_of(self, x: Form) -> Form:
        """Return A x + b w where w stays as it is, each number rounded down twice."""
        bits, n = self.series.bits, len(self.norm)
        rate = {e: [y // self.A.whole for y in v] for e, v in self.A.times(x).items()}
        rest = [0 if drive.rests else 1 << bits for drive in self.drives]
        for e, M in self.b.terms.items():
            own = [sum(map(int.__mul__, row, rest)) // self.b.whole for row in M]
            rate[e] = list(map(int.__add__, rate.get(e, [0] * n), own))
        return rate

    def size(self, c: Form) -> Fraction:
        """Return how large a vector of whole numbers is at most, in the norm."""
        scales = {e: self._monomial(e) for e in c}
        whole = math.lcm(*(scale.denominator for scale in scales.values()))
        total = [0] * len(self.norm)
        for e, v in c.items():
            times = scales[e].numerator * (whole // scales[e].denominator)
            total = [y + times * abs(x) for x, y in zip(v, total, strict=True)]
        norm, over = self._whole_norm
        return Fraction(sum(map(int.__mul__, norm, total)), whole * over)

    @cached_property
    def _whole_norm(self) -> tuple[list[int], int]:
        """The norm's numbers in whole ones, and what these are over."""
        over = math.lcm(*(x.denominator for x in self.norm))
        return [x.numerator * (over // x.denominator) for x in self.norm], over

    def _monomial(self, e: Exponent) -> Fraction:
        """Return how large a monomial of g is at most."""
        found = self._monomials.get(e)
        if found is None:
            found = self._monomials[e] = monomial(e, self.variables)
        return found

    @cached_property
    def _monomials(self) -> dict[Exponent, Fraction]:
        return {}


ONE = Fraction(1)


def monomial(e: Exponent, most: Sequence[Fraction]) -> Fraction:
    """Return how large a monomial of g is at most."""
    return math.prod((size**power for power, size in zip(e, most, strict=True)), start=ONE)


def _nearly(inverse: list[list[float]], flat: list[int]) -> list[int]:
    """Return about the product, in floats whose sums are rounded once: the same anywhere.

    Raises
    ------
    FormatError
        If a number is too large for a float.
    """
    try:
        values = list(map(float, flat))
        return [round(math.fsum(map(float.__mul__, row, values))) for row in inverse]
    except (OverflowError, ValueError) as error:
        raise FormatError("following: numbers are too large") from error


def _slopes(forms: Sequence[Form]) -> list[Form]:
    """Return the coefficients of X', of T_0 on."""
    result: list[Form] = [{} for _ in forms]
    for j in (0, 1):  # those of odd numbers give even ones, and the other way round
        total: Form = {}
        for p in range(len(forms) - 1, 0, -1):
            if p % 2 == j:
                continue
            total = _sum([total, {e: [2 * p * x for x in v] for e, v in forms[p].items()}])
            result[p - 1] = total
    result[0] = {e: [x // 2 for x in v] for e, v in result[0].items()}
    return result


def _slopes_of(c: Sequence[list[int]]) -> list[list[int]]:
    """Return the same of vectors."""
    none = [0] * len(c[0])
    return [form.get((), none) for form in _slopes([{(): v} for v in c])]


def _floats(M: Rationals) -> list[list[float]]:
    return [[float(x) for x in row] for row in M]


def _product(A: Rationals, B: Rationals) -> Rationals:
    columns = list(zip(*B, strict=True))
    return [[sum(map(Fraction.__mul__, row, column), ZERO) for column in columns] for row in A]


def _signed(forms: Sequence[Form]) -> list[Form]:
    """Return what is summed at s = -1."""
    return [form if i % 2 == 0 else _negative(form) for i, form in enumerate(forms)]


def _negative(form: Form) -> Form:
    return {e: [-x for x in v] for e, v in form.items()}


def _less(left: Form, right: Form, times: int) -> Form:
    total = dict(left)
    for e, v in right.items():
        old = total.get(e)
        own = [-times * x for x in v]
        total[e] = own if old is None else list(map(int.__add__, old, own))
    return total


def _sum(forms: Sequence[Form]) -> Form:
    total: Form = {}
    for form in forms:
        for e, v in form.items():
            old = total.get(e)
            total[e] = list(v) if old is None else list(map(int.__add__, old, v))
    return total


@lru_cache(maxsize=32)
def _inverted(A: tuple[tuple[float, ...], ...], half: float, m: int) -> list[list[float]]:
    """Return the inverse, in floats, of c -> coefficients 0 to m - 1 of X' - h/2 A X, and X(-1)."""
    n = len(A)
    size = n * (m + 1)
    rows = [[0.0] * (2 * size) for _ in range(size)]
    for j in range(m):
        for i in range(n):
            row = rows[j * n + i]
            for p in range(j + 1, m + 1, 2):
                row[p * n + i] = float(p if j == 0 else 2 * p)
            for k in range(n):
                row[j * n + k] -= half * A[i][k]
    for i in range(n):
        for p in range(m + 1):
            rows[m * n + i][p * n + i] = 1.0 if p % 2 == 0 else -1.0
    for i in range(size):
        rows[i][size + i] = 1.0
    for k in range(size):
        pivot = max(range(k, size), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        head = rows[k][k] or 1e-300
        own = [x / head for x in rows[k]]
        rows[k] = own
        for i, row in enumerate(rows):
            x = row[k]
            if i != k and x:
                rows[i] = [a - x * b for a, b in zip(row, own, strict=True)]
    return [row[size:] for row in rows]


def norms(Q: Sequence[Rationals]) -> tuple[Fraction, ...]:
    """Return the largest sqrt(Q_ii) of all coefficients, rounded up.

    |e|_Q is at most the sum of these times |e_i|, at all values of the parameters.
    """
    return tuple(root_above(max(M[i][i] for M in Q)) for i in range(len(Q[0])))


# --- polynomials of numbers, over s and g --------------------------------------------------------


def positive(q: dict[Exponent, int], most: Sequence[Fraction], splits: int = SPLITS) -> bool:
    """Whether Bernstein coefficients show that a polynomial is positive, of halves of s if need be.

    Parameters
    ----------
    q : dict
        Of the number of T_i, and of exponents of each g.
    most : sequence of Fraction
        The largest size of each g.
    """
    degrees = [max((e[k] for e in q), default=0) for k in range(len(most) + 1)]
    values, _ = in_bernstein(q, degrees, most)
    return _is_positive(values, degrees[0] + 1, len(values) // (degrees[0] + 1), splits)


def in_bernstein(
    q: dict[Exponent, int], degrees: Sequence[int], most: Sequence[Fraction]
) -> tuple[list[int], int]:
    """Return Bernstein coefficients of a polynomial, that of s the first of its axes.

    Parameters
    ----------
    q, most
        As `positive` has them.
    degrees : sequence of int
        Of s, and of each g: no less than those of q.

    Returns
    -------
    values, scale
        The coefficients times the scale.
    """
    shape = [degree + 1 for degree in degrees]
    strides = [math.prod(shape[k + 1 :]) for k in range(len(shape))]
    values = [0] * math.prod(shape)
    for e, x in q.items():
        values[sum(map(int.__mul__, e, strides))] += x
    spend(len(values) * sum(shape), 64, 64)
    scale = 1
    for k, degree in enumerate(degrees):
        T = _chebyshev(degree) if not k else _centred(degree, most[k - 1])
        scale *= _whole(degree) * (most[k - 1].denominator ** degree if k else 1)
        values = _along(values, shape[k], strides[k], T)
    return values, scale


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
    for half, order in ((left, 1), (right[::-1], -1)):
        powers = range(count)[::order]
        scaled = [x << (count - 1 - k) for k, row in zip(powers, half, strict=True) for x in row]
        if not _is_positive(scaled, count, stride, splits - 1):
            return False
    return True


def _along(values: list[int], count: int, stride: int, T: Integers) -> list[int]:
    """Return values with a matrix applied along one axis."""
    result = [0] * len(values)
    for start in range(0, len(values), count * stride):
        for j in range(stride):
            own = values[start + j : start + count * stride : stride]
            for i, row in enumerate(T):
                result[start + j + i * stride] = sum(map(int.__mul__, row, own))
    return result


def _whole(degree: int) -> int:
    return math.lcm(*(math.comb(degree, i) for i in range(degree + 1)))


@lru_cache(maxsize=64)
def _to_bernstein(degree: int) -> Integers:
    """Return what makes Bernstein coefficients on [0, 1] of powers, times a positive number."""
    whole = _whole(degree)
    return [
        [math.comb(j, i) * whole // math.comb(degree, i) for i in range(degree + 1)]
        for j in range(degree + 1)
    ]


@lru_cache(maxsize=64)
def _chebyshev(degree: int) -> Integers:
    """Return the same of Chebyshev polynomials of s = 2 u - 1, u from 0 to 1."""
    powers = [[1], [-1, 2]]  # of u, of each T_i
    while len(powers) <= degree:
        one, other = powers[-2:]
        doubled = [0] * (len(other) + 1)
        for i, x in enumerate(other):  # 2 (2 u - 1) T_i - T_(i-1)
            doubled[i] -= 2 * x
            doubled[i + 1] += 4 * x
        for i, x in enumerate(one):
            doubled[i] -= x
        powers.append(doubled)
    columns = [[*row, *[0] * (degree + 1 - len(row))] for row in powers[: degree + 1]]
    return [
        [sum(map(int.__mul__, row, column)) for column in columns] for row in _to_bernstein(degree)
    ]


@lru_cache(maxsize=64)
def _centred(degree: int, most: Fraction) -> Integers:
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
