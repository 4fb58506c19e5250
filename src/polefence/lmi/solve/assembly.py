r"""Conditions for a law that is sought, stacked for all coefficients at once.

`polefence.lmi.conditions` writes these conditions one inequality at a time, to be read and printed.
A search writes the same ones anew in every system of coordinates; here the coefficients of equally
many unknown matrices are one group, and an inequality of each is one array over the group:

    V = [ A W + B Z ; C W + D Z ],   X = W      as left factors of the stack [ W_k ; Z_k ].

What does not depend on numbers, which coefficient of the law is in which inequality and how often,
is worked out once for a domain and degree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from polefence.lmi.conditions.pencil import Index, Pencil, Variable
from polefence.lmi.conditions.performance import (
    Demands,
    Noise,
    Output,
    Points,
    Source,
    Through,
    raised,
    squares,
)
from polefence.lmi.conditions.target import Side
from polefence.lmi.solve.stacked import Batch, Family, Stacked
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Group:
    """Coefficients of an inequality with equally many of the law's.

    Attributes
    ----------
    numbers : (b,) array of int
        Of the monomials.
    law : (b, q) array of int
        Which coefficients of the law are in each.
    sums : (b, q) array
        How often, in the law's own polynomial elevated.
    products : (b, q, N) array
        How often times each vertex of the plant.
    binomials : (b,) array
        The coefficients of one.
    """

    numbers: Index
    law: Index
    sums: Array
    products: Array
    binomials: Array


@lru_cache(maxsize=64)
def groups(domain: Domain, degree: int, extra: int) -> tuple[Group, ...]:
    """Return the coefficients of degree + 1 + extra, by how many of the law's are in each."""
    exponents = domain.monomials(degree + 1 + extra)
    pairs, sums = domain.pairs(degree, extra), domain.elevated(degree, 1 + extra)
    found: dict[int, list[int]] = {}
    for number, own in enumerate(sums):
        found.setdefault(len(own), []).append(number)
    made = []
    for numbers in found.values():
        law = np.array([sorted(sums[number]) for number in numbers], dtype=np.intp)
        products = np.zeros((*law.shape, domain.corners))
        for b, number in enumerate(numbers):
            place = {k: q for q, k in enumerate(law[b])}
            for (j, k), weight in pairs[number].items():
                products[b, place[k], j] = weight
        own = [[float(sums[e][k]) for k in row] for e, row in zip(numbers, law, strict=True)]
        weights = [float(binomial(domain.sizes, exponents[number])) for number in numbers]
        made.append(Group(np.array(numbers), law, np.array(own), products, np.array(weights)))
    return tuple(made)


def stacked_design(
    A: Array, B: Array, demands: Demands, domain: Domain, degree: int, elevation: int
) -> tuple[Pencil, Stacked]:
    """Return what `polefence.lmi.conditions.methods.design` does, stacked; without bounds on the law.

    Of the pencil there are the variables only.
    """
    n, m, count = A.shape[1], B.shape[2], domain.count(degree)
    W = [Variable(f"W{k + 1}", (n, n), symmetric=True) for k in range(count)]
    Z = [Variable(f"Z{k + 1}", (m, n), rows="u") for k in range(count)]
    scalars = [Variable(f"t {source.name}", (1, 1), rows="") for source in demands.sources]
    pencil = Pencil("performance", (*W, *Z, *scalars), ())
    start = count * n * np.array([n, n + m])
    t = {source.name: int(start[1]) + k for k, source in enumerate(demands.sources)}
    extra = max(degree + 1, demands.degree(domain)) - degree - 1 + elevation
    AC = np.concatenate([A, *(o.C for o in demands.outputs)], axis=1)
    BD = np.concatenate([B, *(o.D for o in demands.outputs)], axis=1)
    kinds = [_positive(t)] if t else []
    for group in groups(domain, degree, extra):
        rows = (group.law[..., None] * n + np.arange(n)) * n
        more = int(start[0]) + (group.law[..., None] * m + np.arange(m)) * n
        rows = np.concatenate([x.reshape(len(x), -1) for x in (rows, more)], axis=1)
        form = _Form(group, domain, degree + 1 + extra, rows, AC, BD, demands.margin)
        kinds += form.kinds(demands, t)
    entries = np.concatenate([pencil.places[v.name].ravel() for v in pencil.variables])
    return pencil, _sorted(pencil.unknowns, entries, kinds)


@dataclass(frozen=True, eq=False)
class _Kind:
    """Blocks of one shape."""

    size: int
    terms: list[Batch]


def _sorted(unknowns: int, entries: Index, kinds: list[_Kind]) -> Stacked:
    families, filled = [], dict[int, int]()
    for kind in sorted(kinds, key=lambda kind: kind.size):
        begin = filled.get(kind.size, 0)
        end = filled[kind.size] = begin + len(kind.terms[0].D)
        families.append(Family(kind.size, slice(begin, end), tuple(kind.terms)))
    return Stacked(unknowns, entries, tuple(families), tuple(range(sum(filled.values()))))


def _positive(t: dict[str, int]) -> _Kind:
    """Return r t > 0 of each scalar."""
    rows, one = np.array(list(t.values()), dtype=np.intp), np.ones((len(t), 1, 1))
    return _Kind(1, [Batch(one / 2, 0 * one, one, rows[:, None, None], one[..., 0])])


class _Form:
    """V and X of a group, and the inequalities of which they are parts."""

    def __init__(
        self,
        group: Group,
        domain: Domain,
        degree: int,
        rows: Index,
        AC: Array,
        BD: Array,
        margin: float,
    ) -> None:
        self.group, self.domain, self.degree, self.margin = group, domain, degree, margin
        (b, q), (_, r, n), m = group.law.shape, AC.shape, BD.shape[2]
        self.b, self.n = b, n
        self.rows = rows[:, None]
        left = [np.tensordot(group.products, M, 1).transpose(0, 2, 1, 3) for M in (AC, BD)]
        self.V = np.concatenate([left[0].reshape(b, r, q * n), left[1].reshape(b, r, q * m)], 2)
        self.X = np.zeros((b, n, q * (n + m)))
        self.X[:, :, : q * n] = np.einsum("bq,ij->biqj", group.sums, np.eye(n)).reshape(b, n, -1)

    def kinds(self, demands: Demands, t: dict[str, int]) -> Iterator[_Kind]:
        """Yield the blocks of all that is demanded."""
        sources, outputs = demands.sources, demands.outputs
        q = max([1, *(o.F.shape[2] for o in outputs if o.F is not None)])
        data = {s.name: self._data(s, q) for s in sources}
        for source in sources:
            if not isinstance(source, Through):
                yield from self._moved(source, t[source.name], data[source.name])
        first = self.n
        by_name = {source.name: source for source in sources}
        for output in outputs:
            Y, own = self.V[:, first : first + output.rows], t[output.source]
            first += output.rows
            if isinstance(by_name[output.source], Through):
                yield self._passed(Y, own, data[output.source], output)
            else:
                yield self._bound(Y, own, output)
        for side in demands.target.sides:
            yield self._region(side)
        through = bool(sources) and all(isinstance(source, Through) for source in sources)
        if demands.target.positive or through:
            yield _Kind(self.n, [self._stack(None, -self.X / 2, np.eye(self.n))])

    @property
    def N(self) -> Array:
        return self.V[:, : self.n]

    def _of_exponents(self, table: object) -> Array:
        exponents = self.domain.monomials(self.degree)
        return np.array([table(exponents[k]) for k in self.group.numbers])  # type: ignore[operator]

    def _data(self, source: Source, q: int) -> Array:
        if isinstance(source, Noise) and source.root is not None:
            return np.zeros((0, 0, 0))
        return self._of_exponents(raised(source, self.domain, self.degree, q))

    def _stack(self, D: Array | None, M: Array, R: Array) -> Batch:
        """Return a term of the stack of the law's matrices, R one for all."""
        D = np.zeros_like(M) if D is None else D
        return Batch(D, M, self._tiled(R), self.rows, np.ones((self.b, 1)))

    def _scalar(self, t: int, D: Array | None, M: Array | None, R: Array) -> Batch:
        """Return a term of a scalar: D and M (b, size) or one of them, R (size,)."""
        some = D if D is not None else M
        assert some is not None
        D, M = (np.zeros_like(some) if x is None else x for x in (D, M))
        rows = np.full((self.b, 1, 1), t, dtype=np.intp)
        return Batch(D[..., None], M[..., None], self._tiled(R[:, None]), rows, np.ones((self.b, 1)))

    def _tiled(self, R: Array) -> Array:
        return np.tile(R, (self.b, 1, 1))

    def _weighted(self, column: Array) -> Array:
        """Return the coefficients of one, times half a column each."""
        return self.group.binomials[:, None] / 2 * column

    def _moved(self, source: Noise | Points, t: int, data: Array) -> Iterator[_Kind]:
        n, eye = self.n, np.eye(self.n)
        motion = self.N + self.margin * self.X if self.margin else self.N
        driven = [self._stack(None, motion, eye)]
        if isinstance(source, Noise) and source.root is not None:
            driven += [self._scalar(t, None, self._weighted(c), c) for c in source.root.T]
        elif isinstance(source, Noise):
            own = np.flatnonzero(np.any(data, axis=(0, 1)))
            driven += [self._scalar(t, None, data[:, :, k] / 2, eye[k]) for k in own]
        yield _Kind(n, driven)
        if isinstance(source, Noise):
            return
        first, rest = np.eye(n + 1)[0], np.eye(n + 1)[:, 1:]
        below = self._stack(None, rest @ (-self.X / 2), rest)
        for k in range(data.shape[2]):
            column = -self._weighted(first) - data[:, :, k] @ rest.T
            yield _Kind(n + 1, [self._scalar(t, None, column, first), below])
        if source.ellipsoid is not None:
            X0 = source.ellipsoid
            own = np.flatnonzero(np.any(X0, axis=0))
            above = [self._scalar(t, None, self._weighted(X0[:, k]), eye[k]) for k in own]
            yield _Kind(n, [*above, self._stack(None, -self.X / 2, eye)])

    def _bound(self, Y: Array, t: int, output: Output) -> _Kind:
        n, p = self.n, output.rows
        size = 1 + p * n
        first = np.eye(size)[0]
        square = self._of_exponents(squares(output, self.domain, self.degree).__getitem__)
        corner = square[:, None] * (output.level**2 / 2) * first
        terms = [self._ended(t, corner, first, output.fixed)]
        for j in range(p):
            at = slice(1 + j * n, 1 + (j + 1) * n)
            M = np.zeros((self.b, size, self.X.shape[2]))
            M[:, 0], M[:, at] = -Y[:, j], -self.X / 2
            terms.append(self._stack(None, M, np.eye(size)[:, at]))
        return _Kind(size, terms)

    def _ended(self, t: int, column: Array, R: Array, fixed: bool) -> Batch:
        """Return what grows with r, or else is there at once."""
        return self._scalar(t, None, -column, R) if fixed else self._scalar(t, column, None, R)

    def _passed(self, Y: Array, t: int, E: Array, output: Output) -> _Kind:
        n, q = E.shape[1:]
        size = n + q + output.rows
        eye, root = np.eye(size), np.sqrt(output.level)
        M = np.zeros((self.b, size, self.X.shape[2]))
        M[:, :n], M[:, n + q :] = self.N, Y / root
        through = np.zeros((self.b, size, q))
        through[:, :n] = E / root
        if output.F is not None:
            F = raised(Through("", output.F), self.domain, self.degree, q)
            through[:, n + q :] = self._of_exponents(F) / output.level
        terms = [self._stack(None, M, eye[:, :n])]
        terms += [self._scalar(t, None, through[:, :, k], eye[n + k]) for k in range(q)]
        for k in range(n, size):
            terms.append(self._ended(t, self._weighted(eye[k]), eye[k], output.fixed))
        return _Kind(size, terms)

    def _region(self, side: Side) -> _Kind:
        d, n, terms = len(side.L0), self.n, []
        above = np.triu(np.ones((d, d)), 1) + np.eye(d) / 2
        for b in range(d):
            D, M = (
                np.concatenate(
                    [m[a, b] * self.N + above[a, b] * l[a, b] * self.X for a in range(d)], axis=1
                )
                for l, m in ((-side.L1, -side.M1), (side.L0, side.M0))
            )
            if D.any() or M.any():
                terms.append(self._stack(D, M, np.eye(d * n)[:, b * n : (b + 1) * n]))
        return _Kind(d * n, terms)
