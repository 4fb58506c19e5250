"""Modes that no gain moves, by arithmetic modulo primes: cheap whatever the length of the entries.

Where [B, AB, ...] has rank n modulo one prime it has rank n, so (A, B) is controllable. Where it
has not, the rank is the largest that several primes show; and the characteristic polynomial of A on
the states modulo the controllable subspace, whose roots are the fixed modes, follows from its
residues by the Chinese remainder theorem. Its coefficients are whole numbers if A is one, and are
taken as found when further primes no longer change them. That a rank is too small, or a coefficient
wrong, takes entries made for it; nothing is proved from either.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import PlantError
from polefence.proof.short import Short

Exact = tuple[tuple[Fraction, ...], ...]
Residues = npt.NDArray[np.int64]

TOP = 2**31  # products of two residues fit into 63 bits
PRIME = TOP - 1
MOST_PRIMES = 400


@dataclass(frozen=True)
class FixedModes(Short):
    """Roots of ``polynomial`` over ``whole``: poles of A + B K whatever K is.

    ``polynomial`` is monic in whole numbers, the highest power first; [1] if (A, B) is
    controllable.
    """

    polynomial: tuple[int, ...] = (1,)
    whole: int = 1

    @property
    def count(self) -> int:
        """Number of modes."""
        return len(self.polynomial) - 1

    @property
    def values(self) -> npt.NDArray[np.complex128]:
        """The modes in floats, for people."""
        try:
            values = [float(Fraction(c, self.whole**k)) for k, c in enumerate(self.polynomial)]
        except OverflowError:
            return np.zeros(0, dtype=complex)
        return np.asarray(np.roots(values), dtype=complex)

    def __str__(self) -> str:
        return modes_text(self.values)


def modes_text(values: npt.NDArray[np.complex128]) -> str:
    """Print modes, a conjugate pair once."""
    rounding = 1e-7 * float(np.abs(values).max(initial=0.0))
    words = []
    for z in sorted(values, key=lambda z: (z.real, abs(z.imag))):
        real = f"{0.0 if abs(z.real) <= rounding else z.real:.4g}"
        if abs(z.imag) <= rounding:
            words.append(real)
        elif z.imag > 0:
            words.append(f"{real} +- {z.imag:.4g}j")
    return ", ".join(words)


def fixed_modes(A: Exact, B: Exact) -> FixedModes:
    """Return the modes of A that no input moves.

    Raises
    ------
    PlantError
        If there are some, and the entries are too long to say which.
    """
    n, whole = len(A), lcm(*(e.denominator for row in A for e in row))
    most, alike, taken = -1, 0, 0
    values: list[int] = []
    modulus = 1
    for p in _primes():
        a, b = (_residues(M, p) for M in (A, B))
        if a is None or b is None:
            continue  # a denominator is a multiple of p
        taken += 1
        pivots, basis = _reachable(a, b, p)
        if len(pivots) == n:
            return FixedModes()
        if len(pivots) < most:
            continue
        if len(pivots) > most:
            most, alike, values, modulus = len(pivots), 0, [0] * (n - len(pivots) + 1), 1
        coefficients = _fixed_polynomial(a, pivots, basis, p)
        powers = [pow(whole, k, p) for k in range(len(coefficients))]
        before = [_signed(v, modulus) for v in values]
        values = [
            v + modulus * ((int(c) * w - v) * pow(modulus, -1, p) % p)
            for v, c, w in zip(values, coefficients, powers, strict=True)
        ]
        modulus *= p
        alike = alike + 1 if before == [_signed(v, modulus) for v in values] else 0
        if alike == 3:  # primes agree
            return FixedModes(tuple(before), whole)
        if taken == MOST_PRIMES:
            break
    raise PlantError("the entries are too long to say which modes no input moves; round them")


def surely_controllable(A: Residues, B: Residues) -> npt.NDArray[np.bool_]:
    """Whether each of (..., n, n) and (..., n, m) pairs of residues modulo `PRIME` is controllable.

    Then so are those whose residues they are, whatever they are multiplied by; the reverse need not
    hold.
    """
    n = A.shape[-1]
    rows = [B.swapaxes(-1, -2)]
    for _ in range(n - 1):
        rows.append(_times(rows[-1], A.swapaxes(-1, -2)))
    left = np.concatenate(rows, axis=-2)  # (..., n m, n)
    lead, count = left.shape[:-2], left.shape[-2]
    left = left.reshape(-1, count, n)
    full, every = np.ones(len(left), dtype=bool), np.arange(len(left))
    for column in range(n):
        # a row with a pivot here is taken out, and eliminated from the others
        place = np.argmax(left[:, :, column] != 0, axis=1)
        pivot = left[every, place]
        full &= pivot[:, column] != 0
        pivots, factor = pivot[:, column, None, None], left[:, :, column, None]
        left = (left * pivots % PRIME - factor * pivot[:, None] % PRIME) % PRIME
    return full.reshape(lead)


def _times(X: Residues, Y: Residues) -> Residues:
    """Return products of stacks of matrices of residues modulo `PRIME`."""
    total = X[..., :, :1] * Y[..., :1, :] % PRIME
    for k in range(1, X.shape[-1]):
        total = (total + X[..., :, k : k + 1] * Y[..., k : k + 1, :] % PRIME) % PRIME
    return total


def _signed(value: int, modulus: int) -> int:
    return value - modulus if 2 * value > modulus else value


def _primes() -> Iterator[int]:
    """Yield primes from 2^31 down."""
    for candidate in range(TOP - 1, 0, -2):
        if all(_passes(candidate, base) for base in (2, 3, 5, 7)):  # enough below 3.2e9
            yield candidate


def _passes(n: int, base: int) -> bool:
    """Miller and Rabin's test of an odd number."""
    twos = (n - 1 & 1 - n).bit_length() - 1
    power = pow(base, n - 1 >> twos, n)
    if power in (1, n - 1):
        return True
    return any((power := power * power % n) == n - 1 for _ in range(twos - 1))


def _residues(matrix: Exact, p: int) -> Residues | None:
    """Return the entries modulo p, None where a denominator has no inverse."""
    inverses: dict[int, int] = {}
    for d in {e.denominator for row in matrix for e in row}:
        if d % p == 0:
            return None
        inverses[d] = pow(d, -1, p)
    rows = [[e.numerator % p * inverses[e.denominator] % p for e in row] for row in matrix]
    return np.array(rows, dtype=np.int64)


def _reachable(A: Residues, B: Residues, p: int) -> tuple[list[int], Residues]:
    """Return pivots and reduced echelon basis of the controllable subspace modulo p."""
    n = len(A)
    pivots: list[int] = []
    basis = np.zeros((0, n), dtype=np.int64)
    queue = [B[:, j] for j in range(B.shape[1])]
    while queue and len(pivots) < n:
        vector = _remainder(queue.pop(0), pivots, basis, p)
        places = np.flatnonzero(vector)
        if not len(places):
            continue
        pivot = int(places[0])
        vector = vector * pow(int(vector[pivot]), -1, p) % p
        basis = np.vstack([(basis - basis[:, pivot : pivot + 1] * vector % p) % p, vector])
        pivots.append(pivot)
        queue.append((A * vector % p).sum(axis=1) % p)
    return pivots, basis


def _remainder(vector: Residues, pivots: list[int], basis: Residues, p: int) -> Residues:
    """Return the vector modulo the subspace: zero at its pivots."""
    off: Any = (vector[pivots][:, None] * basis % p).sum(axis=0)
    return np.asarray((vector - off) % p)


def _fixed_polynomial(A: Residues, pivots: list[int], basis: Residues, p: int) -> list[int]:
    """Characteristic polynomial modulo p of A on what is left of the states."""
    free = [i for i in range(len(A)) if i not in pivots]
    part = np.array([_remainder(A[:, j], pivots, basis, p)[free] for j in free]).T
    d, coefficients = len(free), [1]
    power = np.eye(d, dtype=np.int64)
    for k in range(1, d + 1):  # Faddeev-LeVerrier
        power = _product(part, power, p)
        coefficients.append(-int(np.trace(power)) * pow(k, -1, p) % p)
        power = (power + coefficients[-1] * np.eye(d, dtype=np.int64)) % p
    return coefficients


def _product(X: Residues, Y: Residues, p: int) -> Residues:
    total = np.zeros_like(X)
    for k in range(len(Y)):
        total = (total + X[:, k : k + 1] * Y[k] % p) % p
    return total
