r"""A pencil as stacks of equal blocks, and the operators an interior point needs.

Each block is a sum of terms, F(x) = r D(x) - M(x) = sum_t L_t X_t R_t' + (its transpose), with
L_t = r L_D - L_M and X_t a matrix of unknowns (a stack of variables, or a weighted sum of them).
Blocks of one shape form a `Family` and are handled together; matrices of all blocks of one size
form one array (blocks, size, size), and "blocks" below means the list of these arrays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter

import numpy as np

from polefence.conditions.linear import Index
from polefence.conditions.pencil import Block, Pencil
from polefence.plant.system import Array

Blocks = list[Array]


@dataclass(frozen=True, eq=False)
class Batch:
    """One term in each block of a family.

    Attributes
    ----------
    D, M : (blocks, size, a) arrays
        L_D and L_M.
    R : (blocks, size, c) array
    rows : (blocks, p, a) array of int
        Where the a rows of the p matrices that X_t sums start in the list of all variables'
        entries, row by row.
    weights : (blocks, p) array
    """

    D: Array
    M: Array
    R: Array
    rows: Index
    weights: Array


@dataclass(frozen=True, eq=False)
class Family:
    """Blocks of one shape: ``where`` in the array of their size, and their terms."""

    size: int
    where: slice
    terms: tuple[Batch, ...]


@dataclass(frozen=True, eq=False)
class Stacked:
    """A pencil for the interior point.

    Attributes
    ----------
    unknowns : int
    entries : (all variables' entries,) array of int
        Which unknown each entry is (the two off-diagonal entries of a symmetric one are the same).
    families : tuple of Family
        In ascending size.
    sequence : tuple of int
        Which block of the pencil each of the families' blocks is, one after the other.
    """

    unknowns: int
    entries: Index
    families: tuple[Family, ...]
    sequence: tuple[int, ...]

    @cached_property
    def sizes(self) -> dict[int, int]:
        """Number of blocks of each size."""
        return {f.size: f.where.stop for f in self.families}

    @cached_property
    def order(self) -> int:
        """Sum of the blocks' sizes: the trace of the identity."""
        return sum(size * count for size, count in self.sizes.items())

    @cached_property
    def tensors(self) -> tuple[Tensor, ...]:
        """The families once more, spelt out in their unknowns for NumPy."""
        return tuple(_tensor(self, family) for family in self.families)

    def _each(self, blocks: Blocks) -> Iterator[tuple[Tensor, Array]]:
        at = dict(zip(self.sizes, blocks, strict=True))
        pairs = zip(self.families, self.tensors, strict=True)
        return ((tensor, at[f.size][f.where]) for f, tensor in pairs)

    def identity(self) -> Blocks:
        """Return the identity."""
        return [np.tile(np.eye(size), (count, 1, 1)) for size, count in self.sizes.items()]

    def parts(self, x: Array) -> tuple[Blocks, Blocks]:
        """Return D(x) and M(x)."""
        D = [np.empty((count, size, size)) for size, count in self.sizes.items()]
        M = [np.empty_like(d) for d in D]
        for (tensor, d), (_, m) in zip(self._each(D), self._each(M), strict=True):
            local = x[tensor.unknowns][:, None, :]
            d[:] = (local @ tensor.D.reshape(*tensor.D.shape[:2], -1)).reshape(d.shape)
            m[:] = (local @ tensor.M.reshape(*tensor.M.shape[:2], -1)).reshape(m.shape)
        return D, M

    def adjoint(self, r: float, P: Blocks, only_D: bool = False) -> Array:
        """Return the gradient of <P, r D(x) - M(x)> in x; with ``only_D`` that of <P, D(x)>."""
        total = np.zeros(self.unknowns)
        for tensor, p in self._each(P):
            F = tensor.D if only_D else r * tensor.D - tensor.M
            values = F.reshape(*F.shape[:2], -1) @ p.reshape(len(p), -1, 1)
            total += np.bincount(tensor.unknowns.ravel(), values.ravel(), self.unknowns)
        return total

    def hessian(self, r: float, Y: Blocks, Q: Blocks) -> Array:
        """Return H_ij = sum of tr(F_i Y F_j Q) over blocks, F_i the block's derivative in x_i."""
        H = np.zeros((self.unknowns, self.unknowns))
        for (tensor, y), (_, q) in zip(self._each(Y), self._each(Q), strict=True):
            for k, unknowns in enumerate(tensor.unknowns):
                F = r * tensor.D[k % len(tensor.D)] - tensor.M[k]
                FY, FQ = F @ y[k], F @ q[k]
                rows = FY.reshape(len(F), -1) @ FQ.swapaxes(1, 2).reshape(len(F), -1).T
                H[np.ix_(unknowns, unknowns)] += rows
        return (H + H.T) / 2


@dataclass(frozen=True, eq=False)
class Tensor:
    """A family in the unknowns that each block touches.

    Attributes
    ----------
    unknowns : (blocks, q) array of int
    D : (1, q, size, size) array
        The same for all blocks of a family, or (blocks, ...).
    M : (blocks, q, size, size) array
        Derivatives of D(x) and M(x).
    """

    unknowns: Index
    D: Array
    M: Array


def _tensor(stacked: Stacked, family: Family) -> Tensor:
    s, unknowns, tensors = family.size, [], []
    columns = [np.arange(t.R.shape[2]) for t in family.terms]
    for k in range(family.where.stop - family.where.start):
        places = [
            stacked.entries[t.rows[k, :, :, None] + c]
            for t, c in zip(family.terms, columns, strict=True)
        ]
        touched, index = np.unique(np.concatenate([p.ravel() for p in places]), return_inverse=True)
        tensor = np.zeros((2, len(touched), s, s))
        start = 0
        for t, p in zip(family.terms, places, strict=True):
            local = index[start : start + p.size].reshape(p.shape)
            start += p.size
            for part, L in zip(tensor, (t.D[k], t.M[k]), strict=True):
                products = np.einsum("ia,jc->acij", L, t.R[k])
                for w, where in zip(t.weights[k], local, strict=True):
                    np.add.at(part, where, w * products)
        unknowns.append(touched)
        tensors.append(tensor + tensor.swapaxes(2, 3))
    both = np.stack(tensors)
    D, M = both[:, 0], both[:, 1]
    shared = D[:1] if (D[0] == D).all() else D
    return Tensor(np.array(unknowns), np.ascontiguousarray(shared), np.ascontiguousarray(M))


def stack(pencil: Pencil) -> Stacked:
    """Sort a pencil's blocks into families."""
    start, begin = {}, 0
    for v in pencil.variables:
        start[v.name] = begin
        begin += v.shape[0] * v.shape[1]
    entries = np.concatenate([pencil.places[v.name].ravel() for v in pencil.variables])
    shapes: dict[_Shape, list[tuple[int, list[_Row]]]] = {}
    for number, block in enumerate(pencil.blocks):
        rows = _rows(block, start)
        shape = block.size, tuple((r.D.shape[1], r.R.shape[1], len(r.weights)) for r in rows)
        shapes.setdefault(shape, []).append((number, rows))
    families, sequence, filled = [], list[int](), dict[int, int]()
    for shape in sorted(shapes, key=itemgetter(0)):
        numbers, blocks = zip(*shapes[shape], strict=True)
        begin, end = filled.get(shape[0], 0), filled.get(shape[0], 0) + len(blocks)
        filled[shape[0]] = end
        terms = tuple(_batch([rows[k] for rows in blocks]) for k in range(len(blocks[0])))
        families.append(Family(shape[0], slice(begin, end), terms))
        sequence.extend(numbers)
    return Stacked(pencil.unknowns, entries, tuple(families), tuple(sequence))


_Shape = tuple[int, tuple[tuple[int, int, int], ...]]
_Lefts = dict[str, list[Array | None]]


@dataclass(eq=False)
class _Row:
    """A term of one block while it is being put together."""

    D: Array
    M: Array
    R: Array
    rows: Index
    weights: Array


def _batch(rows: list[_Row]) -> Batch:
    columns = ("D", "M", "R", "rows", "weights")
    return Batch(*(np.stack([getattr(row, c) for row in rows]) for c in columns))


def _rows(block: Block, start: dict[str, int]) -> list[_Row]:
    """Collect the halves' terms: those with the same right factor side by side."""
    lefts: dict[int, _Lefts] = {}
    rights: dict[int, Array] = {}
    for k, half in enumerate((block.half_D, block.half_M)):
        for t in half:
            if t.right is None:
                raise ValueError(f"block {block.name}: a term without its right factor")
            key = id(t.right)  # conditions share their selectors
            rights[key] = t.right
            pair = lefts.setdefault(key, {}).setdefault(t.name, [None, None])
            mine = pair[k]
            pair[k] = t.left if mine is None else mine + t.left
    return [_row(pairs, rights[key], start) for key, pairs in lefts.items()]


def _row(lefts: _Lefts, R: Array, start: dict[str, int]) -> _Row:
    names = sorted(lefts, key=start.__getitem__)
    columns = R.shape[1]
    only_D = [D for D, M in (lefts[name] for name in names) if D is not None and M is None]
    weights = _multiples(only_D) if len(only_D) == len(names) else None
    if weights is not None:
        D = only_D[0]
        rows = [start[name] + columns * np.arange(D.shape[1]) for name in names]
        return _Row(D, np.zeros_like(D), R, np.array(rows), weights)
    widths = [next(L for L in lefts[name] if L is not None).shape[1] for name in names]
    ends = np.cumsum(widths)
    both = np.zeros((2, len(R), ends[-1]))
    places = []
    for name, width, end in zip(names, widths, ends, strict=True):
        for part, left in zip(both, lefts[name], strict=True):
            if left is not None:
                part[:, end - width : end] = left
        places.append(start[name] + columns * np.arange(width))
    return _Row(both[0], both[1], R, np.concatenate(places)[None], np.ones(1))


def _multiples(lefts: list[Array]) -> Array | None:
    """Return w where all left factors are w times the first: X_t is then a weighted sum."""
    first = lefts[0]
    if len(lefts) == 1:
        return np.ones(1)
    if any(L.shape != first.shape for L in lefts):
        return None
    stacked = np.array(lefts)
    pivot = np.unravel_index(np.argmax(np.abs(first)), first.shape)
    weights = stacked[:, pivot[0], pivot[1]] / first[pivot]
    return weights if np.array_equal(stacked, weights[:, None, None] * first) else None
