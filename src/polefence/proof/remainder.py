"""Plants that are only near the combination of their vertices: by how much, and what that costs.

Where [A, B, E] may be off by diag(rows) Delta diag(columns), |Delta| <= 1, the products
N = A X + B K X are off by H Delta V with H = diag(rows) and V = diag(columns) [X; K X]. With a
number mu > 0 and a matrix Omega that is more than V'V at every alpha,

    a H Delta V b' + b V'Delta'H a'  <=  mu a H H' a' + b Omega b' / mu

(Petersen, 1987), for any columns a and b of blocks: what an inequality may lose is a constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from polefence.proof.matrices import Rationals, identity, product
from polefence.proof.polynomials import Polynomial, constant, diagonal
from polefence.proof.work import FormatError

NONE = Fraction(0)
# What E is off by, beside E: (E + F) (E + F)' <= (1 + SHARE) E E' + (1 + 1 / SHARE) F F'.
SHARE = Fraction(1, 4096)


@dataclass(frozen=True)
class Remainder:
    """Bounds on what [A, B, E] is off by: zeros where it is not.

    ``rows`` holds one number a state, ``columns`` one a state, input and disturbance.
    """

    rows: tuple[Fraction, ...]
    columns: tuple[Fraction, ...]

    def over(self, step: Fraction) -> Remainder:
        """Return that of the plant in its delta form."""
        return Remainder(tuple(x / step for x in self.rows), self.columns)

    def require(self, n: int, m: int, q: int) -> None:
        """Refuse numbers that do not fit."""
        if len(self.rows) != n or len(self.columns) != n + m + q:
            raise FormatError(f"remainder: rows must hold {n} numbers, columns {n + m + q}")
        if min((*self.rows, *self.columns)) < 0:
            raise FormatError("remainder: rows and columns must be zero or more")

    @property
    def squares(self) -> Rationals:
        """H H'."""
        return [
            [row * row if i == j else NONE for j in range(len(self.rows))]
            for i, row in enumerate(self.rows)
        ]

    def moving(self, XKX: Polynomial) -> Polynomial:
        """Return V."""
        return diagonal(self.columns[: XKX.shape[0]], XKX.sizes) * XKX

    def driving(self, scales: Sequence[Fraction], q: int) -> tuple[Fraction, ...]:
        """Return the columns of the disturbances, each times its scale."""
        own = self.columns[len(self.columns) - q :] if q else ()
        return tuple(x * s for x, s in zip(own, scales, strict=True)) if scales else own


@dataclass(frozen=True)
class Spread:
    """Omega, more than V'V at every alpha, and mu."""

    omega: Rationals = field(default_factory=list)
    mu: Fraction = NONE

    def require(self, n: int) -> None:
        """Refuse one that does not fit."""
        if len(self.omega) != n or any(len(row) != n for row in self.omega):
            raise FormatError(f"remainder.omega must hold {n} rows of {n} numbers")
        if any(self.omega[i][j] != self.omega[j][i] for i in range(n) for j in range(i)):
            raise FormatError("remainder.omega must be symmetric")
        if self.mu <= 0:
            raise FormatError("remainder.mu must be positive")

    def bounding(self, V: Polynomial) -> list[list[Polynomial]]:
        """Return the blocks that say that it is more: [ Omega, V'; V, I ]."""
        sizes = V.sizes
        return [[constant(self.omega, sizes), V.T], [constant(identity(V.shape[0]), sizes)]]

    def entering(self, remainder: Remainder, times: int = 1) -> Rationals:
        """Return so many times mu H H'."""
        return [[times * self.mu * x for x in row] for row in remainder.squares]

    def leaving(self, times: int = 1) -> Rationals:
        """Return so many times Omega / mu."""
        return [[times * x / self.mu for x in row] for row in self.omega]

    def of_region(self, remainder: Remainder, factors: tuple[Rationals, Rationals]) -> Rationals:
        """Return mu M1 M1' (x) H H' + M2'M2 (x) Omega / mu, of M = M1 M2."""
        M1, M2 = factors
        left = product(M1, [list(column) for column in zip(*M1, strict=True)])
        right = product([list(column) for column in zip(*M2, strict=True)], M2)
        one, other = self.entering(remainder), self.leaving()
        n = len(one)
        return [
            [
                left[a][b] * one[i][j] + right[a][b] * other[i][j]
                for b in range(len(left))
                for j in range(n)
            ]
            for a in range(len(left))
            for i in range(n)
        ]
