"""Conditions as data: linear functions of matrix variables, and pencils r D(x) - M(x) > 0 of them.

The smallest disk of a condition is a generalised eigenvalue problem: the least r for which some x
makes every block of r D(x) - M(x) positive definite. Nothing here solves anything.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from polefence.lmi.conditions.target import Side
from polefence.plant.polynomial import Domain, Exponent
from polefence.plant.system import Array
from polefence.proof.short import Short

if TYPE_CHECKING:
    import scipy.sparse as sp  # imported where used: it would triple the package's import time

Index = npt.NDArray[np.intp]
SQRT2 = np.sqrt(2.0)


@dataclass(frozen=True)
class Variable(Short):
    """A matrix unknown.

    Parameters
    ----------
    name : str
    shape : (rows, columns)
    symmetric : bool
        Symmetric unknowns count their upper triangle only.
    rows : str
        Where the rows live: "x" (states), "u" (inputs), or "" (a scalar). Scaling needs to know.
    like : str
        Name of the variable, declared before, that it is to equal; "" of one that is free.
    """

    name: str
    shape: tuple[int, int]
    symmetric: bool = False
    rows: str = "x"
    like: str = ""

    @property
    def size(self) -> int:
        """Number of scalar unknowns of its own."""
        rows, columns = self.shape
        if self.like:
            return 0
        return rows * (rows + 1) // 2 if self.symmetric else rows * columns

    @property
    def places(self) -> Index:
        """For each entry of the matrix (rows, columns), which of its unknowns it is."""
        return _places(self.shape, self.symmetric)

    def pack(self, matrix: Array) -> Array:
        """Return the unknowns of a matrix, batched over leading axes."""
        if self.like:
            return matrix[..., 0, :0]
        if self.symmetric:
            return matrix[..., *_upper(self.shape[0])]
        return matrix.reshape(*matrix.shape[:-2], self.size)

    def as_linear(self) -> Linear:
        """Return the variable itself as a linear function."""
        return Linear((Term(self.name, np.eye(self.shape[0])),))


@dataclass(frozen=True, eq=False)
class Term(Short):
    """left @ X @ right', X the variable ``name``; without ``right`` left @ X."""

    name: str
    left: Array
    right: Array | None = None


@dataclass(frozen=True, eq=False)
class Linear(Short):
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


def put(part: Linear, rows: Array, columns: Array) -> tuple[Term, ...]:
    """Return the terms of rows @ part @ columns'."""
    return tuple(
        Term(t.name, rows @ t.left, columns if t.right is None else columns @ t.right)
        for t in part.terms
    )


def multiple(scalar: Linear, matrix: Array) -> Linear:
    """Return a scalar unknown times a matrix."""
    (term,) = scalar.terms
    columns, units = matrix.T[:, :, None], np.eye(matrix.shape[1])[:, :, None]
    pairs = zip(columns, units, strict=True)
    return Linear(tuple(Term(term.name, column, unit) for column, unit in pairs))


# A block's part: a linear function at a block row and column. Pieces are of a half, the block being
# the half plus its transpose.
Piece = tuple[int, int, Linear]


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
class Block(Short):
    """One linear matrix inequality r D(x) - M(x) > 0, by its halves: D = half_D + half_D'.

    Attributes
    ----------
    name : str
        Where it comes from in the theorem ("(16) j=1 k=2").
    size : int
    half_D, half_M : tuple of Term
        Sums of left @ X @ right', left (size, rows of X), right (size, columns of X).
    """

    name: str
    size: int
    half_D: tuple[Term, ...]
    half_M: tuple[Term, ...]


@dataclass(frozen=True, eq=False)
class Pencil(Short):
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
        """All blocks' D as functions of x, in svec, stacked."""
        return self._operator([b.half_D for b in self.blocks])

    @cached_property
    def M(self) -> sp.csr_array:
        """All blocks' M as functions of x, in svec, stacked."""
        return self._operator([b.half_M for b in self.blocks])

    @cached_property
    def places(self) -> dict[str, Index]:
        """For each variable its matrix of positions in x."""
        start, positions = np.cumsum([0] + [v.size for v in self.variables]), dict[str, Index]()
        for v, k in zip(self.variables, start, strict=False):
            positions[v.name] = positions[v.like] if v.like else v.places + k
        return positions

    def _operator(self, halves: list[tuple[Term, ...]]) -> sp.csr_array:
        import scipy.sparse as sp

        rows = [
            _svec_operator(half, b.size, self.places, self.unknowns)
            for b, half in zip(self.blocks, halves, strict=True)
        ]
        return sp.csr_array(sp.vstack(rows))

    def pack(self, values: Mapping[str, Array]) -> Array:
        """Return x for the variables' matrices, batched over leading axes."""
        return np.concatenate([v.pack(values[v.name]) for v in self.variables], axis=-1)

    def unpack(self, x: Array) -> dict[str, Array]:
        """Return the variables' matrices for x, batched over leading axes."""
        return {name: np.asarray(x[..., place]) for name, place in self.places.items()}

    def matrices(self, x: Array, r: float) -> dict[str, Array]:
        """Return each block of r D(x) - M(x) by name."""
        stacked = r * (self.D @ x) - self.M @ x
        cuts = np.cumsum([b.size * (b.size + 1) // 2 for b in self.blocks])[:-1]
        parts = np.split(stacked, cuts)
        return {b.name: smat(part) for b, part in zip(self.blocks, parts, strict=True)}

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
        self.blocks: list[Block] = []
        # a right factor placed twice must be one array: terms are collected by it
        self._rights: dict[tuple[int, int, int], tuple[Array, Array]] = {}

    def symmetric(self, name: str, n: int, like: str = "") -> Linear:
        """Declare a symmetric n x n unknown; see `Variable` for ``like``."""
        like = "" if like == name else like
        self.variables.append(Variable(name, (n, n), symmetric=True, like=like))
        return self.variables[-1].as_linear()

    def full(self, name: str, shape: tuple[int, int], rows: str, like: str = "") -> Linear:
        """Declare an unknown without structure; see `Variable` for ``rows`` and ``like``."""
        like = "" if like == name else like
        self.variables.append(Variable(name, shape, rows=rows, like=like))
        return self.variables[-1].as_linear()

    def positive(self, name: str) -> Linear:
        """Declare a positive scalar unknown, as the 1 x 1 block r * name > 0."""
        scalar = self.full(name, (1, 1), rows="")
        one = np.ones((1, 1))
        self.blocks.append(Block(name, 1, (Term(name, one / 2, one),), ()))
        return scalar

    def positive_definite(self, name: str, X: Linear) -> None:
        """Add X > 0, whatever r."""
        self.block(name, 1, [], [(0, 0, -0.5 * X)])

    def region(
        self,
        name: str,
        X: Linear,
        N: Linear,
        side: Side,
        floor: Linear | None = None,
        half: Linear | None = None,
    ) -> None:
        """Add -(L (x) X + M (x) N + M' (x) N') > 0, less ``floor`` in the first block.

        There is dX/dt besides of a half-plane, twice the ``half``; of others X is more by that in
        the first block.
        """
        D, M = list[Piece](), list[Piece]()
        moved = Linear() if half is None else half
        for a in range(len(side.L0)):
            for b in range(len(side.L0)):
                factor = 0.5 if a == b else float(a < b)
                total = side.M0[a, b] * N if side.M0[a, b] else Linear()
                if factor * side.L0[a, b]:
                    total = total + factor * side.L0[a, b] * X
                if moved.terms and a == b == 0:
                    total = total + (-1.0 if side.is_half_plane else side.L0[a, b]) * moved
                if total.terms:
                    M.append((a, b, total))
                growing = -1.0 * side.M1[a, b] * N if side.M1[a, b] else Linear()
                if factor * side.L1[a, b]:
                    growing = growing + -factor * side.L1[a, b] * X
                if moved.terms and a == b == 0 and not side.is_half_plane:
                    growing = growing - side.L1[a, b] * moved
                if growing.terms:
                    D.append((a, b, growing))
        if floor is not None:
            M.append((0, 0, 0.5 * floor))
        self.block(name, len(side.L0), D, M)

    def block(self, name: str, parts: int, D: list[Piece], M: list[Piece]) -> None:
        """Add r D - M > 0 of ``parts`` x ``parts`` square blocks, given as halves; see `Piece`."""
        first = (D or M)[0][2].terms[0]
        n = first.left.shape[0]
        halves = (
            tuple(t for a, b, part in pieces for t in self._placed(part, a, b, parts))
            for pieces in (D, M)
        )
        self.blocks.append(Block(name, parts * n, *halves))

    def _placed(self, part: Linear, row: int, column: int, parts: int) -> tuple[Term, ...]:
        """Put a linear function into a larger block, at a block row and under that selector."""
        placed = []
        for t in part.terms:
            n = t.left.shape[0]
            right = _selectors(n, parts)[column]
            if t.right is not None:
                key = id(t.right), column, parts
                if key not in self._rights:
                    self._rights[key] = t.right, right @ t.right
                right = self._rights[key][1]
            left = np.zeros((parts * n, t.left.shape[1]))
            left[row * n : (row + 1) * n] = t.left
            placed.append(Term(t.name, left, right))
        return tuple(placed)

    def build(self) -> Pencil:
        """Return the finished value."""
        return Pencil(self.method, tuple(self.variables), tuple(self.blocks))


def block_name(exponent: Exponent, domain: Domain, degree: int = -1, elevation: int = -1) -> str:
    """Name a block as the paper does where it has it, else by its monomial."""
    order = sorted((j for j, p in enumerate(exponent) if p), key=lambda j: (-exponent[j], j))
    if len(domain.sizes) == 1:
        number = {(0, 0): "8", (1, 1): str(14 + len(order))}.get((degree, elevation))
        if number is not None:
            indices = zip("jkl", order, strict=False)
            return f"({number}) " + " ".join(f"{letter}={j + 1}" for letter, j in indices)
    return "alpha^" + "".join(str(p) for p in exponent)


@lru_cache
def _upper(n: int) -> tuple[Index, Index]:
    """Return where the upper triangle is."""
    return np.triu_indices(n)


@lru_cache
def _places(shape: tuple[int, int], symmetric: bool) -> Index:
    rows, columns = shape
    table = np.arange(rows * columns, dtype=np.intp).reshape(rows, columns)
    if symmetric:
        i, j = _upper(rows)
        table[i, j] = table[j, i] = np.arange(len(i))
    table.setflags(write=False)
    return table


@lru_cache
def _selectors(n: int, parts: int) -> tuple[Array, ...]:
    """Return [I; 0; ...], [0; I; ...], ...: the block columns of the identity."""
    both = np.eye(parts * n)
    both.setflags(write=False)
    return tuple(both[:, k * n : (k + 1) * n] for k in range(parts))


def _svec_operator(
    half: tuple[Term, ...], size: int, places: Mapping[str, Index], total: int
) -> sp.csr_array:
    import scipy.sparse as sp

    operator = np.zeros((size * (size + 1) // 2, total))
    for t in half:
        right = np.eye(size) if t.right is None else t.right
        basis = np.einsum("ia,jc->acij", t.left, right)
        columns = svec(basis + basis.swapaxes(-1, -2)).reshape(places[t.name].size, -1)
        np.add.at(operator.T, places[t.name].ravel(), columns)
    return sp.csr_array(operator)
