r"""A pencil as stacks of equal blocks, and the operators an interior point needs.

Each block is a sum of terms, F(x) = r D(x) - M(x) = sum_t L_t X_t R_t' + (its transpose), with
L_t = r L_D - L_M and X_t a matrix of unknowns (a stack of variables, or a weighted sum of them).
Blocks of one shape form a `Family` and are handled together; matrices of all blocks of one size
form one array (blocks, size, size), and "blocks" below means the list of these arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from polefence.lmi.conditions.methods import Method, build, normal
from polefence.lmi.conditions.pencil import Block, Index, Pencil, Variable
from polefence.lmi.conditions.target import Target
from polefence.plant.system import Array

if TYPE_CHECKING:
    import scipy.sparse as sp  # imported where used: slow

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
    def arrays(self) -> list[list[tuple[Array, Array, Array, Index, Array]]]:
        """The families' terms as the kernel takes them."""
        return [[(t.D, t.M, t.R, t.rows, t.weights) for t in f.terms] for f in self.families]

    @cached_property
    def operators(self) -> Operators:
        """D and M as NumPy's reference wants them."""
        return _operators(self)

    def identity(self) -> Blocks:
        """Return the identity."""
        return [np.tile(np.eye(size), (count, 1, 1)) for size, count in self.sizes.items()]

    def parts(self, x: Array) -> tuple[Blocks, Blocks]:
        """Return D(x) and M(x)."""
        both = self.operators.both @ x
        half = len(both) // 2
        return self.split(both[:half]), self.split(both[half:])

    def at(self, x: Array) -> list[tuple[Array, Array]]:
        """Return D(x) and M(x), one pair a size, for a few x without what `parts` sets up."""
        entries = x[self.entries]
        sums = {size: np.zeros((2, count, size, size)) for size, count in self.sizes.items()}
        for family in self.families:
            D, M = sums[family.size][:, family.where]
            for t in family.terms:
                gathered = entries[t.rows[..., None] + np.arange(t.R.shape[2])]
                if gathered.shape[1] == 1:  # mostly, and far quicker
                    X = t.weights[:, :, None] * gathered[:, 0]
                else:
                    X = np.einsum("bp,bpac->bac", t.weights, gathered)
                right = X @ t.R.swapaxes(1, 2)
                for total, L in ((D, t.D), (M, t.M)):
                    if L.any():
                        total += L @ right
        return [(D + D.swapaxes(1, 2), M + M.swapaxes(1, 2)) for D, M in sums.values()]

    def gradient(self, P: Blocks, D: float, M: float) -> Array:
        """Return the gradient of <P, D D(x) + M M(x)> in x, once without what `adjoint` sets up."""
        by_size = dict(zip(self.sizes, P, strict=True))
        places, values = [], []
        for family in self.families:
            multiplier = by_size[family.size][family.where]
            for t in family.terms:
                G = 2 * (D * t.D + M * t.M).swapaxes(1, 2) @ (multiplier @ t.R)
                places.append((t.rows[..., None] + np.arange(t.R.shape[2])).ravel())
                values.append((t.weights[:, :, None, None] * G[:, None]).ravel())
        entries = self.entries[np.concatenate(places)]
        return np.asarray(np.bincount(entries, np.concatenate(values), self.unknowns), dtype=float)

    def residual(self, x: Array, r: float, Y: Blocks) -> float:
        """Return the residual of A_r* Y = nu t, t'x fixed, at x, relative to r."""
        missed, t = self.gradient(Y, r, -1.0), self.gradient(self.identity(), 1.0, 0.0)
        missed -= (missed @ t) / (t @ t) * t
        return float(np.abs(missed * x).sum() / r)

    def adjoint(self, r: float, P: Blocks, only_D: bool = False) -> Array:
        """Return the gradient of <P, r D(x) - M(x)> in x; with ``only_D`` that of <P, D(x)>."""
        flat = _flat(P)
        both = np.zeros((2, len(flat)))
        both[0] = flat if only_D else r * flat
        if not only_D:
            both[1] = -flat
        return np.asarray(self.operators.transpose @ both.ravel())

    def hessian(self, r: float, Y: Blocks, Q: Blocks) -> Array:
        """Return H_ij = sum of tr(F_i Y F_j Q) over blocks, F_i the block's derivative in x_i."""
        H = np.zeros((self.unknowns, self.unknowns))
        flat_Y, flat_Q = _flat(Y), _flat(Q)
        for start, unknowns, D, M in self.operators.blocks:
            size = D.shape[1]
            y, q = (X[start : start + size**2].reshape(size, size) for X in (flat_Y, flat_Q))
            F = r * D - M
            # <F_i Y, (F_j Q)'>
            products = (F @ y).reshape(len(F), -1), (F @ q).swapaxes(1, 2).reshape(len(F), -1)
            H[unknowns[:, None], unknowns] += products[0] @ products[1].T
        return (H + H.T) / 2

    def newton(self, r: float, Y: Blocks, Q: Blocks, shift: float) -> Factors:
        """Return the factors of H, its scaled diagonal shifted."""
        return Factors.of(self.hessian(r, Y, Q), shift)

    def split(self, flat: Array) -> Blocks:
        """Return blocks from all their entries in one row."""
        blocks, start = [], 0
        for size, count in self.sizes.items():
            end = start + count * size**2
            blocks.append(flat[start:end].reshape(count, size, size))
            start = end
        return blocks


@dataclass(frozen=True, eq=False)
class Factors:
    """A positive definite matrix scaled to a diagonal of ones, and its factor's inverse."""

    scale: Array
    inverse: Array
    pivot: float

    @classmethod
    def of(cls, H: Array, shift: float) -> Factors:
        """Return the factors with the scaled diagonal shifted.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the matrix is singular in floats.
        """
        # an unknown in no block, of an input without effect say, stays put
        used = np.diag(H) > 0
        scale = np.where(used, 1 / np.sqrt(np.where(used, np.diag(H), 1.0)), 0.0)
        scaled = H * np.outer(scale, scale) + np.diag(np.where(used, shift, 1.0))
        factor = np.linalg.cholesky(scaled)
        return cls(scale, np.linalg.inv(factor), float(np.diag(factor).min(initial=1.0)))

    def half(self, a: Array) -> Array:
        """Return what has H^-1 as its square: a'H^-1 b is the product of two of these."""
        return np.asarray(self.inverse @ (self.scale * a.T).T)

    def solved(self, a: Array) -> Array:
        """Return H^-1 a."""
        return np.asarray(self.scale * (self.inverse.T @ self.half(a)))


def _flat(X: Blocks) -> Array:
    return X[0].ravel() if len(X) == 1 else np.concatenate([x.ravel() for x in X])


@dataclass(frozen=True, eq=False)
class Operators:
    """D and M spelt out in the unknowns.

    Attributes
    ----------
    both, transpose : sparse
        x to all entries of D(x) and then of M(x), and its transpose.
    blocks : list of tuples
        For each block where its entries start, the q unknowns it touches, and the derivatives of
        D and M by them, (q, size, size).
    """

    both: sp.csr_array
    transpose: sp.csr_array
    blocks: list[tuple[int, Index, Array, Array]]


def _operators(stacked: Stacked) -> Operators:
    import scipy.sparse as sp

    total = sum(count * size**2 for size, count in stacked.sizes.items())
    triples, blocks, start = [], [], 0
    for f in stacked.families:
        for k in range(f.where.stop - f.where.start):
            i, unknown, value = _entries(f, k, stacked.entries)
            touched, local = np.unique(unknown, return_inverse=True)
            parts = np.zeros((2, len(touched), f.size**2))
            half, place = np.divmod(i, f.size**2)
            np.add.at(parts, (half, local, place), value)
            shape = (len(touched), f.size, f.size)
            blocks.append((start, touched, parts[0].reshape(shape), parts[1].reshape(shape)))
            triples.append((half * total + start + place, unknown, value))
            start += f.size**2
    rows, columns, values = (np.concatenate(part) for part in zip(*triples, strict=True))
    whole = sp.coo_array((values, (rows, columns)), shape=(2 * total, stacked.unknowns))
    both = sp.csr_array(whole)
    return Operators(both, sp.csr_array(both.T), blocks)


def _entries(family: Family, k: int, entries: Index) -> tuple[Index, Index, Array]:
    """Places in [D; M] of block k, unknowns and values of all nonzero derivatives."""
    s, nonzero = family.size, []
    for t in family.terms:
        j, c = np.nonzero(t.R[k])
        for half, L in enumerate((t.D[k], t.M[k])):
            i, a = np.nonzero(L)
            products = np.outer(L[i, a], t.R[k][j, c])
            upper = i[:, None] * s + j + half * s**2
            lower = j * s + i[:, None] + half * s**2
            for w, rows in zip(t.weights[k], t.rows[k], strict=True):
                unknown = entries[rows[a][:, None] + c]
                nonzero += [(place, unknown, w * products) for place in (upper, lower)]
    places, unknowns, values = (
        np.concatenate([part.ravel() for part in parts]) for parts in zip(*nonzero, strict=True)
    )
    return places, unknowns, values


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
    return Batch(
        np.array([row.D for row in rows]),
        np.array([row.M for row in rows]),
        np.array([row.R for row in rows]),
        np.array([row.rows for row in rows]),
        np.array([row.weights for row in rows]),
    )


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
    both = np.zeros((2, len(R), sum(widths)))
    places, column = list[int](), 0
    for name, width in zip(names, widths, strict=True):
        for half, left in zip(both, lefts[name], strict=True):
            if left is not None:
                half[:, column : column + width] = left
        column += width
        places.extend(range(start[name], start[name] + columns * width, columns))
    return _Row(both[0], both[1], R, np.array([places]), np.ones(1))


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


def stacked_pencil(
    method: Method, A: Array, B: Array, target: Target, unit: Array
) -> tuple[Pencil, Stacked]:
    """Return a pencil with the condition's variables, and the condition for this plant stacked.

    Of the pencil only what does not depend on the plant may be used: packing and unpacking.
    """
    N, n, m = B.shape
    method, sigma = normal(method), target.sigma
    # a double adds up the powers of four of 26 vertices
    if sigma is None or not isinstance(method, str) or N > 26:
        pencil = build(method, A, B, target, unit)
        return pencil, stack(pencil)
    layout = _layout(method, N, n, m)
    return layout.pencil, layout.filled(A + sigma * np.eye(n), B)


@dataclass(frozen=True, eq=False)
class _Layout:
    """``columns`` and ``counts``: for each family and term, see `_filled`; None where M is zero."""

    pencil: Pencil
    stacked: Stacked
    columns: list[list[tuple[Index, Array] | None]]

    def filled(self, S: Array, B: Array) -> Stacked:
        """Return the condition of a plant, of which S = A + sigma I."""
        data = np.concatenate([S, B], axis=-1).transpose(2, 0, 1)  # columns, (n + m, N, n)
        families = []
        for family, columns in zip(self.stacked.families, self.columns, strict=True):
            terms = [
                t if c is None else Batch(t.D, _filled(t.M.shape, data, *c), t.R, t.rows, t.weights)
                for t, c in zip(family.terms, columns, strict=True)
            ]
            families.append(Family(family.size, family.where, tuple(terms)))
        return replace(self.stacked, families=tuple(families))


def _filled(shape: tuple[int, ...], data: Array, column: Index, counts: Array) -> Array:
    """M (blocks, size, a) whose column a is the sum of counts times that column of [S_j, B_j]."""
    M = np.zeros(shape)
    chosen = data[column]  # (blocks, a, N, n)
    M[:, : data.shape[-1]] = (counts[:, :, None, :] @ chosen)[:, :, 0].swapaxes(-1, -2)
    return M


@lru_cache(maxsize=64)
def _layout(method: str, N: int, n: int, m: int) -> _Layout:
    powers = 4.0 ** np.arange(N)[:, None, None]
    pencil = build(method, powers * np.ones((n, n)), powers * np.ones((n, m)), 0.0)
    stacked = stack(pencil)
    column = _columns(pencil.variables, n)
    columns: list[list[tuple[Index, Array] | None]] = []
    for family in stacked.families:
        columns.append([])
        for t in family.terms:
            if not t.M.any():
                columns[-1].append(None)
                continue
            digits = t.M[:, 0, :, None].astype(np.int64) // 4 ** np.arange(N) % 4
            columns[-1].append((column[t.rows[:, 0]], digits.astype(float)))
    return _Layout(pencil, stacked, columns)


def _columns(variables: tuple[Variable, ...], n: int) -> Index:
    """For where a row of a variable starts in the list of entries: its column in [S_j, B_j]."""
    column = [
        i + (n if v.rows == "u" else 0)
        for v in variables
        for i in range(v.shape[0])
        for _ in range(v.shape[1])
    ]
    return np.array(column, dtype=np.intp)
