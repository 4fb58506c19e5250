"""Matrix-valued linear functions of matrix variables, so that conditions read like the theory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from polefence.plant.system import Array

Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Variable:
    """A matrix unknown.

    Parameters
    ----------
    name : str
    shape : (rows, columns)
    symmetric : bool
        Symmetric unknowns count their upper triangle only.
    rows : str
        Where the rows live: "x" (states), "u" (inputs), or "" (a scalar). Scaling needs to know.
    """

    name: str
    shape: tuple[int, int]
    symmetric: bool = False
    rows: str = "x"

    @property
    def size(self) -> int:
        """Number of scalar unknowns."""
        rows, columns = self.shape
        return rows * (rows + 1) // 2 if self.symmetric else rows * columns

    @property
    def places(self) -> Index:
        """For each entry of the matrix (rows, columns), which of its unknowns it is."""
        rows, columns = self.shape
        if not self.symmetric:
            return np.arange(rows * columns, dtype=np.intp).reshape(rows, columns)
        table = np.zeros((rows, rows), dtype=np.intp)
        i, j = np.triu_indices(rows)
        table[i, j] = table[j, i] = np.arange(self.size)
        return table

    def pack(self, matrix: Array) -> Array:
        """Return the unknowns of a matrix."""
        return matrix[np.triu_indices(self.shape[0])] if self.symmetric else matrix.ravel()

    def unpack(self, unknowns: Array) -> Array:
        """Return the matrix with these unknowns."""
        return np.asarray(unknowns[self.places])

    def as_linear(self) -> Linear:
        """Return the variable itself as a linear function."""
        return Linear((Term(self.name, np.eye(self.shape[0])),))


@dataclass(frozen=True, eq=False)
class Term:
    """left @ X @ right', X the variable ``name``; without ``right`` left @ X."""

    name: str
    left: Array
    right: Array | None = None


@dataclass(frozen=True, eq=False)
class Linear:
    """A sum of terms; those with no ``right`` are collected, one a variable."""

    terms: tuple[Term, ...] = ()

    def __add__(self, other: Linear) -> Linear:
        sums: dict[object, Term] = {}
        for t in self.terms + other.terms:
            if t.right is not None:
                sums[t] = t
            elif t.name in sums:
                sums[t.name] = Term(t.name, sums[t.name].left + t.left)
            else:
                sums[t.name] = t
        return Linear(tuple(sums.values()))

    def __sub__(self, other: Linear) -> Linear:
        return self + -1.0 * other

    def __rmul__(self, factor: float) -> Linear:
        return Linear(tuple(Term(t.name, factor * t.left, t.right) for t in self.terms))

    def __rmatmul__(self, left: Array) -> Linear:
        return Linear(tuple(Term(t.name, left @ t.left, t.right) for t in self.terms))

    # numpy must leave `array @ Linear` to __rmatmul__
    __array_ufunc__ = None


def multiple(scalar: Linear, matrix: Array) -> Linear:
    """Return a scalar unknown times a matrix."""
    (term,) = scalar.terms
    columns, units = matrix.T[:, :, None], np.eye(matrix.shape[1])[:, :, None]
    pairs = zip(columns, units, strict=True)
    return Linear(tuple(Term(term.name, column, unit) for column, unit in pairs))
