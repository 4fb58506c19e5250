"""The value every condition builds: a pencil r D(x) - M(x) > 0 in named blocks.

The smallest disk of a condition is a generalised eigenvalue problem: the least r for which some x
makes every block of r D(x) - M(x) positive definite. Nothing here solves anything.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from polefence.conditions.linear import Linear, Variable, block
from polefence.plant.system import Array

if TYPE_CHECKING:
    import scipy.sparse as sp  # imported where used: it would triple the package's import time

SQRT2 = np.sqrt(2.0)


def svec(matrices: Array) -> Array:
    """Stack upper triangles column by column, off-diagonal entries times sqrt(2); (..., k, k)."""
    j, i = np.tril_indices(matrices.shape[-1])
    return matrices[..., i, j] * np.where(i == j, 1.0, SQRT2)


def smat(vectors: Array) -> Array:
    """Return the symmetric matrices of stacked triangles: the inverse of `svec`."""
    size = int(np.sqrt(2 * vectors.shape[-1]))
    j, i = np.tril_indices(size)
    matrices = np.zeros((*vectors.shape[:-1], size, size))
    matrices[..., i, j] = matrices[..., j, i] = vectors / np.where(i == j, 1.0, SQRT2)
    return matrices


@dataclass(frozen=True, eq=False)
class Block:
    """One linear matrix inequality r D(x) - M(x) > 0.

    Attributes
    ----------
    name : str
        Where it comes from in the theorem ("(16) j=1 k=2").
    size : int
    D, M : sparse, (size (size + 1) / 2, unknowns)
        svec of the two symmetric parts as functions of x.
    """

    name: str
    size: int
    D: sp.csr_array
    M: sp.csr_array


@dataclass(frozen=True, eq=False)
class Pencil:
    """A condition as data: variables, and blocks r D(x) - M(x) that are to be positive definite.

    Print it to see its blocks; `matrices` evaluates them; ``D`` and ``M`` stack all blocks for a
    solver that takes svec cones.
    """

    method: str
    variables: tuple[Variable, ...]
    blocks: tuple[Block, ...]

    @property
    def unknowns(self) -> int:
        """Length of x."""
        return sum(v.size for v in self.variables)

    @cached_property
    def D(self) -> sp.csr_array:
        """All blocks' D, stacked."""
        return _stacked([b.D for b in self.blocks])

    @cached_property
    def M(self) -> sp.csr_array:
        """All blocks' M, stacked."""
        return _stacked([b.M for b in self.blocks])

    def pack(self, values: Mapping[str, Array]) -> Array:
        """Return x for the variables' matrices."""
        return np.concatenate([v.pack(values[v.name]) for v in self.variables])

    def unpack(self, x: Array) -> dict[str, Array]:
        """Return the variables' matrices for x."""
        cuts = np.cumsum([v.size for v in self.variables])[:-1]
        parts = np.split(x, cuts)
        return {v.name: v.unpack(p) for v, p in zip(self.variables, parts, strict=True)}

    def matrices(self, x: Array, r: float) -> dict[str, Array]:
        """Return each block of r D(x) - M(x) by name."""
        return {b.name: smat(r * (b.D @ x) - b.M @ x) for b in self.blocks}

    def __str__(self) -> str:
        lines = [f"{self.method}: r D(x) - M(x) > 0, {self.unknowns} unknowns"]
        for v in self.variables:
            kind = "symmetric" if v.symmetric else "full"
            lines.append(f"  variable {v.name}: {v.shape[0]} x {v.shape[1]}, {kind}")
        lines += [f"  block {b.name}: {b.size} x {b.size}" for b in self.blocks]
        return "\n".join(lines)


class Builder:
    """Collects a condition's variables and blocks, then `build`s the pencil."""

    def __init__(self, method: str) -> None:
        self.method = method
        self.variables: list[Variable] = []
        self.parts: list[tuple[str, Linear, Linear]] = []

    def symmetric(self, name: str, n: int) -> Linear:
        """Declare a symmetric n x n unknown."""
        self.variables.append(Variable(name, (n, n), symmetric=True))
        return self.variables[-1].as_linear()

    def full(self, name: str, shape: tuple[int, int], rows: str) -> Linear:
        """Declare an unknown without structure; see `Variable` for ``rows``."""
        self.variables.append(Variable(name, shape, rows=rows))
        return self.variables[-1].as_linear()

    def positive(self, name: str) -> Linear:
        """Declare a positive scalar unknown, as the 1 x 1 block r * name > 0."""
        scalar = self.full(name, (1, 1), rows="")
        self.parts.append((name, scalar, Linear((1, 1), {})))
        return scalar

    def disk(
        self,
        name: str,
        W: Linear,
        M: Linear,
        right: Linear | None = None,
        floor: Linear | None = None,
    ) -> None:
        """Add [[r W - floor, -M], [-M', r right]] > 0; ``right`` defaults to W, ``floor`` to zero.

        The signs of M are free (congruence by diag(I, -I)).
        """
        n = W.shape[0]
        zero = Linear((n, n), {})
        D = block([[W, zero], [zero, W if right is None else right]])
        self.parts.append((name, D, block([[zero if floor is None else floor, M], [M.T, zero]])))

    def build(self) -> Pencil:
        """Return the finished value."""
        start = {}
        total = 0
        for v in self.variables:
            start[v.name] = total
            total += v.size
        blocks = tuple(
            Block(
                name, D.shape[0], _svec_operator(D, start, total), _svec_operator(M, start, total)
            )
            for name, D, M in self.parts
        )
        return Pencil(self.method, tuple(self.variables), blocks)


def _stacked(operators: list[sp.csr_array]) -> sp.csr_array:
    import scipy.sparse as sp

    return sp.csr_array(sp.vstack(operators))


def _svec_operator(matrix: Linear, start: Mapping[str, int], total: int) -> sp.csr_array:
    import scipy.sparse as sp

    size = matrix.shape[0] * (matrix.shape[0] + 1) // 2
    rows, columns, values = [], [], []
    for name, tensor in matrix.terms.items():
        operator = svec(np.moveaxis(tensor, 2, 0)).T
        i, j = np.nonzero(operator)
        rows.append(i)
        columns.append(j + start[name])
        values.append(operator[i, j])
    if not rows:
        return sp.csr_array((size, total))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(sp.coo_array(entries, shape=(size, total)))
