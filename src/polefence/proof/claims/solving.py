"""Errors of a scheduled law in fixed point: its gain found by elimination in integers.

With W' = T W T', Z' = (Z - M W) T' the gain is K = M + Z' W'^-1 T, whatever T and M are: those that
the code has. Each update it finds k = W'^-1 z' for each row z' of Z', then the row of K; whatever
it is given the parameters are inside, so that nothing here depends on x, and nothing overflows.

Signals, rows, answers and rounding are those of `words`. Bits behind the point are: w of W' and of
pivots, l of factors, v_i of all that is found for row i, and t_j of the columns of T. With h half a
last bit, W'' = W' + dW what the code evaluates, and W'' = L D L':

    c_ij = w_ij - Sum l_ik c_jk + e,     |e| <= h_w,       l_ij = c_ij / d_j + f,    |f| <= h_l,

are, c_jk = d_k (l_jk - f_jk) put in, an exact factorisation of a matrix that is off by

    |e + d_j f_ij + Sum l_ik d_k f_jk| <= h_w + n b h_l,    |l_ik| sqrt(d_k) <= sqrt(b),

b the largest entry of the diagonal; so d_k > s, and |l_ik| <= sqrt(b / s), s the smallest
eigenvalue. The substitutions, one rounding each, leave a residual:

    L D L' k = z' + e1 + L D (e2 + e3),    |e1|, |e2|, |e3| <= h_v,    |L D e| <= n b |e|;

    |k - W'^-1 z'| <= (|dz| + |W'^-1 z'| |dW|) / (s - |dW|).

An entry of K is off by that times the size of its column of T, and by half its own last bit. All
that is found for a row is measured in its last bit, 2^-v_i: so is |Z' W'^-1| < size.

States that W' does not couple with others, and of which Z' has none, are idle: k has exact zeros
there. Such are inputs on their way, which the code of a loop at samples does not read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.claims.words import Scales, largest, require_sums, two
from polefence.proof.matrices import Rationals, norm, product, root, scaled
from polefence.proof.short import Short
from polefence.proof.work import FormatError

HALF = Fraction(1, 2)


@dataclass(frozen=True)
class Solving(Short):
    """Constants of the code, and what they are beside those of the law.

    ``own_W`` and ``own_Z`` are the code's coefficients, ``W`` and ``Z`` those of W' and Z'; ``L``
    is M. ``formed`` bounds the sum of the errors of Bernstein polynomials' values.
    """

    bits: int
    scales: Scales
    T: Rationals
    L: Rationals
    own_W: Sequence[Rationals]
    own_Z: Sequence[Rationals]
    W: list[Rationals]
    Z: list[Rationals]
    formed: Fraction
    smallest: Fraction
    size: Fraction

    @property
    def units(self) -> list[Fraction]:
        """The last bit of each row's solution."""
        return [two(-v) for v in self.scales.solving[2:]]

    @property
    def count(self) -> int:
        """The number of states that are not idle."""
        return len(self._used)

    @property
    def _used(self) -> list[int]:
        n = len(self.T)
        forms, rows = (*self.own_W, *self.W), (*self.own_Z, *self.Z)
        return [
            j
            for j in range(n)
            if any(M[j][i] for M in forms for i in range(n) if i != j)
            or any(row[j] for M in rows for row in M)
        ]

    @property
    def diagonal(self) -> Fraction:
        """A bound on the entries of W' as it is factorised."""
        return max(w[i][i] for w in self.W for i in range(len(w))) + self.smallest

    @property
    def largest(self) -> Fraction:
        """A bound on its eigenvalues."""
        rows = max(sum(map(abs, row), Fraction(0)) for w in self.W for row in w)
        return max(min(rows, max(map(norm, self.W))), self.diagonal) + self.smallest

    @property
    def of_W(self) -> Fraction:
        """A bound on the error of W', factorisation included.

        Raises
        ------
        FormatError
            If it may be singular.
        """
        w, factors = (two(-s - 1) for s in self.scales.solving[:2])
        n = self.count
        error = self.formed * max(map(norm, self.own_W)) + _apart(self.own_W, self.W)
        error += n * w + n * (w + n * self.diagonal * factors)
        if error >= self.smallest:
            raise FormatError(f"rounding in {self.bits} bits may make W singular")
        return error

    @property
    def of_Z(self) -> Fraction:
        """A bound on the error of a row of Z', the substitutions' residuals included."""
        n = self.count
        own, exact = ([self.in_units(z) for z in Z] for Z in (self.own_Z, self.Z))
        formed = max(norm([row]) for z in own for row in z)
        error = self.formed * formed + max(
            norm([[a - b for a, b in zip(*rows, strict=True)]])
            for pair in zip(own, exact, strict=True)
            for rows in zip(*pair, strict=True)
        )
        return error + root(Fraction(n)) * HALF * (2 + 2 * n * self.diagonal)

    def in_units(self, Z: Rationals) -> Rationals:
        """Return rows of solutions in their last bits."""
        return scaled(Z, tuple(self.units))

    @property
    def off(self) -> Fraction:
        """A bound on the error of a row's solution."""
        return (self.of_Z + self.size * self.of_W) / (self.smallest - self.of_W)

    def gain_errors(self) -> Rationals:
        """Return bounds on the errors of the entries of the gain."""
        off, columns = self.off, self.columns
        pairs = zip(self.units, self.scales.rows, strict=True)
        return [
            [
                off * unit * t + (two(s - r - 1) if t else 0)
                for t, s in zip(columns, self.scales.signals, strict=True)
            ]
            for unit, r in pairs
        ]

    @property
    def columns(self) -> list[Fraction]:
        """The sizes of the columns of T, without rows of idle states."""
        rows = [self.T[j] for j in self._used] or [[Fraction(0)] * len(self.T)]
        return [norm([list(column)]) for column in zip(*rows, strict=True)]

    def entries(self) -> Rationals:
        """Return bounds on the entries of the gain."""
        reach, columns = self.size + self.off, self.columns
        return [
            [abs(m) + reach * unit * t for m, t in zip(row, columns, strict=True)]
            for unit, row in zip(self.units, self.L, strict=True)
        ]

    def require(self) -> None:
        """Refuse constants that are no integers, or lead to numbers that have no room."""
        scales, bits, (m, n) = self.scales, self.bits, (len(self.L), len(self.T))
        if len(scales.solving) != m + 2 or len(scales.columns) != n:
            raise FormatError("code.scales: solving and columns do not fit the law")
        w, factors = scales.solving[:2]
        if not (0 <= w <= bits - 2 and 0 <= factors <= bits - 2):
            raise FormatError("code.scales.solving: W and factors have more bits than there are")
        if self.formed > HALF:
            raise FormatError("code: the weights of its coefficients are too coarse")
        units = self.units
        self._require_whole(self.own_W, [[two(-w)] * n] * n)
        self._require_whole(self.own_Z, [[unit] * n for unit in units])
        self._require_whole([self.T], [[two(-t) for t in scales.columns]] * n)
        of_rows = [[two(s - r) for s in scales.signals] for r in scales.rows]
        self._require_whole([self.L], of_rows)
        self._require_room(w, factors)
        entries, columns = self.entries(), self.columns
        for i, (row, r) in enumerate(zip(entries, scales.rows, strict=True)):
            exponents = zip(scales.columns, scales.signals, columns, strict=True)
            back = [scales.solving[i + 2] + t - r + s for t, s, used in exponents if used]
            if not all(0 <= b <= 2 * bits - 2 for b in back):
                raise FormatError("code: an entry of the gain is finer than what it is made of")
            whole = [x / unit + 1 for x, unit in zip(row, of_rows[i], strict=True)]
            require_sums(bits, whole, r - scales.answers[i])
        reach = self.size + self.off
        for t, s in zip(columns, scales.columns, strict=True):
            if reach * t * two(s) + two(2 * bits - 3) > largest(2 * bits):
                raise FormatError(f"code: a sum may take more than {2 * bits} bits")

    def _require_room(self, w: int, factors: int) -> None:
        """Refuse pivots, factors and solutions that may be no words, or whose sums have no room."""
        n, bits = self.count, self.bits
        b, most, least = self.diagonal, self.largest, self.smallest - self.of_W
        factor, reach = root(b / least), self.size + self.off + self.of_Z
        solution = reach * max(Fraction(1), most, root(most / least)) + most + 2
        for value in (b * two(w) + 1, factor * two(factors) + 1, solution):
            if value > largest(bits):
                raise FormatError(f"code: what is solved for may take more than {bits} bits")
        sums = [
            3 * b * two(w + factors),
            (solution + most * reach + n * b + 1) * two(factors),
            (solution + n * factor * reach + 1) * two(factors),
        ]
        if max(sums) > largest(2 * bits):
            raise FormatError(f"code: a sum may take more than {2 * bits} bits")

    def _require_whole(
        self, matrices: Sequence[Rationals], units: Sequence[Sequence[Fraction]]
    ) -> None:
        for matrix in matrices:
            for row, own in zip(matrix, units, strict=True):
                for value, unit in zip(row, own, strict=True):
                    whole = value / unit
                    if whole.denominator != 1 or abs(whole) > largest(self.bits):
                        raise FormatError(f"code: a constant is no integer of {self.bits} bits")


def shifted(
    Z: Sequence[Rationals], W: Sequence[Rationals], L: Rationals, T: Rationals
) -> list[Rationals]:
    """Return (Z - M W) T' of the coefficients."""
    right = [list(column) for column in zip(*T, strict=True)]
    return [
        product(
            [[a - b for a, b in zip(*r, strict=True)] for r in zip(z, product(L, w), strict=True)],
            right,
        )
        for z, w in zip(Z, W, strict=True)
    ]


def _apart(one: Sequence[Rationals], other: Sequence[Rationals]) -> Fraction:
    return max(
        norm([[a - b for a, b in zip(*rows, strict=True)] for rows in zip(*pair, strict=True)])
        for pair in zip(one, other, strict=True)
    )
