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

from polefence.lmi.conditions.methods import Method, Slack, options, parameter_dependent
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
from polefence.lmi.conditions.target import Side, Target
from polefence.lmi.solve.stacked import Batch, Family, Stacked, stack, stacked_pencil
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array


def condition(
    method: Method, A: Array, B: Array, target: Target, unit: Array
) -> tuple[Pencil, Stacked]:
    """Return the condition of a method for a region, stacked, and a pencil of its variables."""
    o = options(method)
    still = not (target.motion or target.patches)
    if isinstance(o, Slack) or o.right_hand_sides or (still and target.sigma is not None):
        return stacked_pencil(method, A, B, target, unit)
    domain, degree = Domain.of(o.on, len(A)), int(o.degree)
    if not still:
        pencil = parameter_dependent(A, B, target, domain, degree, o.elevation)
        return pencil, stack(pencil)
    return stacked_design(A, B, Demands(target), domain, degree, o.elevation, degree > 0)


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
    """Return the coefficients of degree + 1 + extra, grouped by how many of the law's they hold."""
    exponents = domain.monomials(degree + 1 + extra)
    pairs, sums = domain.pairs(degree, extra), domain.elevated(degree, 1 + extra)
    by_count: dict[int, list[int]] = {}
    for number, places in enumerate(sums):
        by_count.setdefault(len(places), []).append(number)
    made = []
    for numbers in by_count.values():
        law = np.array([sorted(sums[number]) for number in numbers], dtype=np.intp)
        products = np.zeros((*law.shape, domain.corners))
        for b, number in enumerate(numbers):
            place = {k: q for q, k in enumerate(law[b])}
            for (j, k), weight in pairs[number].items():
                products[b, place[k], j] = weight
        often = [[float(sums[e][k]) for k in row] for e, row in zip(numbers, law, strict=True)]
        weights = [float(binomial(domain.sizes, exponents[number])) for number in numbers]
        made.append(Group(np.array(numbers), law, np.array(often), products, np.array(weights)))
    return tuple(made)


def stacked_design(
    A: Array,
    B: Array,
    demands: Demands,
    domain: Domain,
    degree: int,
    elevation: int,
    numbered: bool = True,
) -> tuple[Pencil, Stacked]:
    """Return what `polefence.lmi.conditions.methods.design` does, stacked; no bounds on the law.

    Of the pencil there are the variables only. Without ``numbered`` the one W is no W1.
    """
    n, m, count = A.shape[1], B.shape[2], domain.count(degree)
    t = {source.name: k for k, source in enumerate(demands.sources)}
    pencil, entries = _unknowns(n, m, count, tuple(t), numbered)
    start = count * n * np.array([n, n + m])
    t = {name: int(start[1]) + k for name, k in t.items()}
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
    return pencil, _sorted(pencil.unknowns, entries, kinds)


@lru_cache(maxsize=64)
def _unknowns(
    n: int, m: int, count: int, scalars: tuple[str, ...], numbered: bool
) -> tuple[Pencil, Index]:
    """Return a pencil of the variables alone, and which unknown each of their entries is."""
    names = [str(k + 1) for k in range(count)] if numbered else [""]
    W = [Variable(f"W{name}", (n, n), symmetric=True) for name in names]
    Z = [Variable(f"Z{name}", (m, n), rows="u") for name in names]
    more = [Variable(f"t {name}", (1, 1), rows="") for name in scalars]
    pencil = Pencil("performance", (*W, *Z, *more), ())
    return pencil, np.concatenate([pencil.places[v.name].ravel() for v in pencil.variables])


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
        """Yield the blocks of all demands."""
        sources, outputs = demands.sources, demands.outputs
        q = max([1, *(o.F.shape[2] for o in outputs if o.F is not None)])
        data = {s.name: self._data(s, q) for s in sources}
        for source in sources:
            if not isinstance(source, Through):
                yield from self._moved(source, t[source.name], data[source.name])
        first, by_rows = self.n, dict[int, list[tuple[Array, Output]]]()
        passing = [source.name for source in sources if isinstance(source, Through)]
        for output in outputs:
            Y = self.V[:, first : first + output.rows]
            first += output.rows
            if output.source in passing:
                yield self._passed(Y, t[output.source], data[output.source], output)
            else:
                by_rows.setdefault(output.rows, []).append((Y, output))
        for rows, bounded in by_rows.items():
            yield self._bound(rows, bounded, t)
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

    def _scalar(self, t: int, L: Array, R: Array, grows: bool = False) -> Batch:
        """Return a term of a scalar: L (b, size) of M, or of D where it grows with r; R (size,)."""
        L, ones = L[..., None], np.ones((self.b, 1))
        D, M = (L, 0 * L) if grows else (0 * L, L)
        rows = np.full((self.b, 1, 1), t, dtype=np.intp)
        return Batch(D, M, self._tiled(R[:, None]), rows, ones)

    def _tiled(self, R: Array) -> Array:
        many = np.empty((self.b, *R.shape))
        many[:] = R
        return many

    def _weighted(self, column: Array) -> Array:
        """Return the coefficients of the polynomial one times half a column."""
        return self.group.binomials[:, None] / 2 * column

    def _moved(self, source: Noise | Points, t: int, data: Array) -> Iterator[_Kind]:
        n, eye = self.n, np.eye(self.n)
        motion = self.N + self.margin * self.X if self.margin else self.N
        driven = [self._stack(None, motion, eye)]
        if isinstance(source, Noise) and source.root is not None:
            driven += [self._scalar(t, self._weighted(c), c) for c in source.root.T]
        elif isinstance(source, Noise):
            columns = np.flatnonzero(np.any(data, axis=(0, 1)))
            driven += [self._scalar(t, data[:, :, k] / 2, eye[k]) for k in columns]
        yield _Kind(n, driven)
        if isinstance(source, Noise):
            return
        first, rest = np.eye(n + 1)[0], np.eye(n + 1)[:, 1:]
        below = self._stack(None, rest @ (-self.X / 2), rest)
        for k in range(data.shape[2]):
            column = -self._weighted(first) - data[:, :, k] @ rest.T
            yield _Kind(n + 1, [self._scalar(t, column, first), below])
        if source.ellipsoid is not None:
            X0 = source.ellipsoid
            columns = np.flatnonzero(np.any(X0, axis=0))
            above = [self._scalar(t, self._weighted(X0[:, k]), eye[k]) for k in columns]
            yield _Kind(n, [*above, self._stack(None, -self.X / 2, eye)])

    def _bound(self, p: int, bounded: list[tuple[Array, Output]], t: dict[str, int]) -> _Kind:
        """Return the blocks of outputs with p rows, one output after the other."""
        n, size, many = self.n, 1 + p * self.n, len(bounded)
        first = np.eye(size)[0]
        D, M = np.zeros((2, many, self.b, size, 1))
        for k, (_, output) in enumerate(bounded):
            (M if output.fixed else D)[k, :, 0, 0] = self._corner(output)
        rows = np.repeat(np.array([t[output.source] for _, output in bounded]), self.b)
        ones = np.ones((many * self.b, 1))
        flat = (many * self.b, size, 1)
        R = np.broadcast_to(first[:, None], flat).copy()
        terms = [Batch(D.reshape(flat), -M.reshape(flat), R, rows[:, None, None], ones)]
        for j in range(p):
            at = slice(1 + j * n, 1 + (j + 1) * n)
            L = np.zeros((many, self.b, size, self.X.shape[2]))
            L[:, :, at] = -self.X / 2
            for k, (Y, _) in enumerate(bounded):
                L[k, :, 0] = -Y[:, j]
            L = L.reshape(many * self.b, size, -1)
            R = np.broadcast_to(np.eye(size)[:, at], (len(L), size, n)).copy()
            terms.append(Batch(np.zeros_like(L), L, R, np.tile(self.rows, (many, 1, 1)), ones))
        return _Kind(size, terms)

    def _corner(self, output: Output) -> Array:
        """Return half the coefficients of the bound's square."""
        square = self.group.binomials
        if output.square is not None:
            square = self._of_exponents(squares(output, self.domain, self.degree).__getitem__)
        return square * output.level**2 / 2

    def _ended(self, t: int, column: Array, R: Array, fixed: bool) -> Batch:
        """Return what grows with r, or else is there at once."""
        return self._scalar(t, -column, R) if fixed else self._scalar(t, column, R, True)

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
        terms += [self._scalar(t, through[:, :, k], eye[n + k]) for k in range(q)]
        for k in range(n, size):
            terms.append(self._ended(t, self._weighted(eye[k]), eye[k], output.fixed))
        return _Kind(size, terms)

    def _region(self, side: Side) -> _Kind:
        d, n, terms = len(side.L0), self.n, []
        above = np.triu(np.ones((d, d)), 1) + np.eye(d) / 2
        for b in range(d):
            D, M = (
                np.concatenate(
                    [m[a, b] * self.N + above[a, b] * x[a, b] * self.X for a in range(d)], axis=1
                )
                for x, m in ((-side.L1, -side.M1), (side.L0, side.M0))
            )
            if D.any() or M.any():
                terms.append(self._stack(D, M, np.eye(d * n)[:, b * n : (b + 1) * n]))
        return _Kind(d * n, terms)
