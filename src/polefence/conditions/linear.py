"""Matrix-valued linear functions of matrix variables, so that conditions read like the theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from polefence.plant.system import Array


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

    def basis(self) -> Array:
        """Coefficient tensor (rows, columns, size): the matrix as a function of its unknowns."""
        rows, columns = self.shape
        tensor = np.zeros((rows, columns, self.size))
        if self.symmetric:
            i, j = np.triu_indices(rows)
            index = np.arange(self.size)
            tensor[i, j, index] = tensor[j, i, index] = 1.0
        else:
            tensor.reshape(-1, self.size)[:] = np.eye(self.size)
        return tensor

    def pack(self, matrix: Array) -> Array:
        """Return the unknowns of a matrix."""
        return matrix[np.triu_indices(self.shape[0])] if self.symmetric else matrix.ravel()

    def unpack(self, unknowns: Array) -> Array:
        """Return the matrix with these unknowns."""
        return np.asarray(self.basis() @ unknowns)

    def as_linear(self) -> Linear:
        """Return the variable itself as a linear function."""
        return Linear(self.shape, {self.name: self.basis()})


@dataclass(frozen=True)
class Linear:
    """A matrix that depends linearly on variables: for each name a tensor (rows, columns, size)."""

    shape: tuple[int, int]
    terms: dict[str, Array]

    def __add__(self, other: Linear) -> Linear:
        terms = dict(self.terms)
        for name, tensor in other.terms.items():
            terms[name] = terms[name] + tensor if name in terms else tensor
        return Linear(self.shape, terms)

    def __neg__(self) -> Linear:
        return -1.0 * self

    def __sub__(self, other: Linear) -> Linear:
        return self + -other

    def __rmul__(self, factor: float) -> Linear:
        return Linear(self.shape, {name: factor * t for name, t in self.terms.items()})

    def __rmatmul__(self, left: Array) -> Linear:
        terms = {name: np.tensordot(left, t, 1) for name, t in self.terms.items()}
        return Linear((left.shape[0], self.shape[1]), terms)

    # numpy must leave `array @ Linear` to __rmatmul__
    __array_ufunc__ = None

    @property
    def T(self) -> Linear:
        """The transpose."""
        terms = {name: t.transpose(1, 0, 2) for name, t in self.terms.items()}
        return Linear((self.shape[1], self.shape[0]), terms)


def block(rows: Sequence[Sequence[Linear]]) -> Linear:
    """Assemble a block matrix."""
    heights = [row[0].shape[0] for row in rows]
    widths = [entry.shape[1] for entry in rows[0]]
    shape = (sum(heights), sum(widths))
    terms: dict[str, Array] = {}
    for i, row in enumerate(rows):
        top = sum(heights[:i])
        for j, entry in enumerate(row):
            left = sum(widths[:j])
            for name, tensor in entry.terms.items():
                whole = terms.setdefault(name, np.zeros((*shape, tensor.shape[2])))
                whole[top : top + heights[i], left : left + widths[j]] = tensor
    return Linear(shape, terms)
