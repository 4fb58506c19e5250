"""State coordinates in which a Lyapunov matrix is the identity, to the last bit of doubles.

A Lyapunov matrix spans many decades: between the units of the states, and between directions in
which a loop is fast and slow. In doubles W^-1 then keeps no digit, while all numbers near to the
identity keep theirs. So y = T x is found by a Cholesky factor of many digits, and what goes over
into y is computed in whole numbers and rounded once. Nothing here depends on a BLAS.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import MAX_EMAX, MIN_EMIN, Decimal, localcontext
from functools import cached_property
from typing import Any

import numpy as np

from polefence.plant.system import Array
from polefence.proof.short import Short

Decimals = list[list[Decimal]]


@dataclass(frozen=True, eq=False)
class Coordinates(Short):
    """y = T x, T lower triangular, of doubles.

    Attributes
    ----------
    T : (n, n) array
    whitens : bool
        Whether T comes of a Lyapunov matrix.
    """

    T: Array
    whitens: bool = False

    @classmethod
    def whitening(cls, W: Array) -> Coordinates | None:
        """Return coordinates in which W (n, n) is the identity; None if it is not positive."""
        with _precise():
            factor = _cholesky(_decimals(W))
            if factor is None:
                return None
            T = np.array([[float(e) for e in row] for row in _inverse(factor)])
        usable = np.all(np.isfinite(T)) and np.all(np.diag(T) > 0)
        return cls(T, whitens=True) if usable else None

    @cached_property
    def inverse(self) -> Array:
        """T^-1, rounded."""
        return self._back.floats()

    @cached_property
    def _back(self) -> _Whole:
        """T^-1, exact but for some 200 bits behind the point of each entry."""
        with _precise():
            left = _inverse(_decimals(self.T))
            parts = []
            # four doubles hold an entry of T^-1 together
            for _ in range(4):
                part = np.array([[float(e) for e in row] for row in left])
                parts.append(_Whole.of(part))
                left = [
                    [e - Decimal(float(p)) for e, p in zip(es, ps, strict=True)]
                    for es, ps in zip(left, part, strict=True)
                ]
        total = parts[0]
        for other in parts[1:]:
            total = total + other
        return total

    @cached_property
    def _own(self) -> _Whole:
        return _Whole.of(self.T)

    def forms(self, W: Array) -> Array:
        """Return T W T' for matrices W (count, n, n), each entry rounded once."""
        return np.array([(self._own @ _Whole.of(w) @ self._own.T).floats() for w in W])

    def gains(self, Z: Array) -> Array:
        """Return Z T' for matrices Z (count, m, n), that belong to T W T'."""
        return np.array([(_Whole.of(z) @ self._own.T).floats() for z in Z])

    def duals(self, Q: Array) -> Array:
        """Return T'^-1 Q T^-1 for matrices Q (count, n, n)."""
        return np.array([(self._back.T @ _Whole.of(q) @ self._back).floats() for q in Q])

    def loops(self, A: Array) -> Array:
        """Return T A T^-1 for matrices A (count, n, n)."""
        return np.array([(self._own @ _Whole.of(a) @ self._back).floats() for a in A])

    def inputs(self, B: Array) -> Array:
        """Return T B for matrices B (count, n, m)."""
        return np.array([(self._own @ _Whole.of(b)).floats() for b in B])

    def feedback(self, K: Array) -> Array:
        """Return K T^-1 for matrices K (count, m, n)."""
        return np.array([(_Whole.of(k) @ self._back).floats() for k in K])


@dataclass(frozen=True, eq=False)
class _Whole:
    """A matrix of whole numbers times a power of two."""

    numbers: Any
    power: int

    @classmethod
    def of(cls, matrix: Array) -> _Whole:
        """Return the very values of doubles."""
        mantissa, exponent = np.frexp(np.asarray(matrix, dtype=float))
        used = exponent[mantissa != 0]
        power = int(used.min()) - 53 if used.size else 0
        numbers = np.empty(mantissa.shape, dtype=object)
        for place, m in np.ndenumerate(mantissa):
            shift = int(exponent[place]) - 53 - power if m else 0
            numbers[place] = int(m * 2.0**53) << shift
        return cls(numbers, power)

    @property
    def T(self) -> _Whole:
        return _Whole(self.numbers.T, self.power)

    def __matmul__(self, other: _Whole) -> _Whole:
        return _Whole(self.numbers @ other.numbers, self.power + other.power)

    def __add__(self, other: _Whole) -> _Whole:
        power = min(self.power, other.power)
        both = (x.numbers * (1 << x.power - power) for x in (self, other))
        return _Whole(sum(both), power)

    def floats(self) -> Array:
        """Return doubles, each rounded to nearest; infinite beyond their range."""
        down, up = 1 << max(-self.power, 0), 1 << max(self.power, 0)
        values = np.empty(self.numbers.shape)
        for place, number in np.ndenumerate(self.numbers):
            try:
                values[place] = number * up / down
            except OverflowError:
                values[place] = np.inf if number > 0 else -np.inf
        return values


def _precise() -> Any:
    return localcontext(prec=80, Emax=MAX_EMAX, Emin=MIN_EMIN)  # condition numbers up to 1e60


def _decimals(matrix: Array) -> Decimals:
    return [[Decimal(float(e)) for e in row] for row in matrix]


def _cholesky(W: Decimals) -> Decimals | None:
    """Return the lower factor of a symmetric matrix; None if it is not positive definite."""
    L: Decimals = []
    for i, row in enumerate(W):
        lower: list[Decimal] = []
        for j in range(i):
            rest = row[j] - sum(map(Decimal.__mul__, lower, L[j]), Decimal(0))
            lower.append(rest / L[j][j])
        pivot = row[i] - sum((e * e for e in lower), Decimal(0))
        if not pivot > 0:
            return None
        L.append([*lower, pivot.sqrt()])
    n = len(L)
    return [[*row, *[Decimal(0)] * (n - len(row))] for row in L]


def _inverse(L: Decimals) -> Decimals:
    """Return the inverse of a lower triangular matrix."""
    n = len(L)
    columns = []
    for c in range(n):
        column = [Decimal(0)] * n
        for i in range(c, n):
            rest = Decimal(int(i == c))
            rest -= sum((L[i][k] * column[k] for k in range(c, i)), Decimal(0))
            column[i] = rest / L[i][i]
        columns.append(column)
    return [list(row) for row in zip(*columns, strict=True)]
