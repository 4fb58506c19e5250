"""Filters behind signals: z' = a z + b y, and in the place of y the weighted signal c z + d y.

Nothing in the plant depends on z, and no law knows it. So what is claimed of a signal behind a
filter is what is claimed of c z + d y in a larger plant, whose law leaves z alone: of the same
poles, and those of a. In discrete time a and b are those of the filter's delta form.

A filter before a disturbance w is alike: z' = a z + b w, and c z + d w acts in the place of w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

from polefence.proof.matrices import ONE, ZERO, Rationals, mix, product
from polefence.proof.plant import Node, Output
from polefence.proof.ranges import corner_weights
from polefence.proof.reading import Table, plain
from polefence.proof.remainder import Remainder, Rows
from polefence.proof.work import RATIONAL, FormatError, spend

if TYPE_CHECKING:
    from polefence.proof.claims.signal import Subject
    from polefence.proof.laws import Law

MAX_STATES = 20  # of one filter


@dataclass(frozen=True)
class Filter:
    """Matrices a (k x k), b (k x 1) and c (1 x k), a name, and a number d, alone where k is 0."""

    a: Rationals
    b: Rationals
    c: Rationals
    name: str = ""
    d: Fraction = ZERO

    @classmethod
    def read(cls, table: Table) -> Filter:
        """Read a filter."""
        if "a" not in table:  # a number
            return cls([], [], [[]], table.text("name", ""), table.number("d"))
        a = table.matrix("a")
        k = len(a)
        if not 1 <= k <= MAX_STATES:
            raise FormatError(f"{table.path('a')} has {k} rows; a filter has 1 to {MAX_STATES}")
        a, b, c = table.matrix("a", k, k), table.matrix("b", k, 1), table.matrix("c", 1, k)
        return cls(a, b, c, table.text("name", ""), table.number("d", 0))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"name": self.name}
        if not self.a:
            return table | {"d": plain(self.d)}
        table |= {key: plain(getattr(self, key)) for key in "abc"}
        return table | ({"d": plain(self.d)} if self.d else {})

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.a)

    def in_z(self, step: Fraction) -> Filter:
        """Return it with z(t + T) in the place of z', where a sample time is not zero."""
        if not step:
            return self
        a = [[step * x + (i == j) for j, x in enumerate(row)] for i, row in enumerate(self.a)]
        return replace(self, a=a, b=[[step * x for x in row] for row in self.b])


Filters = tuple[Filter | None, ...]  # one a signal; None of one without


def states_of(filters: Filters) -> int:
    """Return the number of states of all filters."""
    return sum(weighting.states for weighting in filters if weighting is not None)


def in_series(
    subject: Subject, outputs: Sequence[Output], filters: Filters
) -> tuple[Subject, tuple[Output, ...]]:
    """Return the loop with filters behind some outputs, and what comes out of them.

    Raises
    ------
    FormatError
        If there is not one filter, or none, for each output.
    """
    if len(filters) != len(outputs):
        raise FormatError(f"there are {len(outputs)} outputs, and filters of {len(filters)}")
    more, at, vertices = states_of(filters), subject.n, len(subject.A)
    size, nodes = subject.n + more, subject.nodes
    weights = [corner_weights(node.at) for node in nodes]
    spend(RATIONAL * (vertices + len(nodes)) * size * (size + subject.m + subject.q), 64, 64)

    def everywhere(rows: Sequence[Rationals]) -> list[Rationals]:
        return [*rows, *(mix(w, list(rows)) for w in weights)]

    A = [[[*row, *(ZERO,) * more] for row in M] for M in (*subject.A, *(x.A for x in nodes))]
    B = [[list(row) for row in M] for M in (*subject.B, *(x.B for x in nodes))]
    E = [[list(row) for row in M] for M in (*subject.E, *(x.E for x in nodes if x.E))]
    filtered, none = list[Output](), [[[ZERO] * subject.q]] * vertices
    for output, weighting in zip(outputs, filters, strict=True):
        if weighting is None:
            C = [[[*row, *(ZERO,) * more] for row in rows] for rows in output.C]
            filtered.append(replace(output, C=C))
            continue
        before, after = (ZERO,) * (at - subject.n), (ZERO,) * (size - at - weighting.states)
        CDF = (everywhere(rows) for rows in (output.C, output.D, output.F or none))
        for j, (c, d, f) in enumerate(zip(*CDF, strict=True)):
            rows = zip(product(weighting.b, c), weighting.a, strict=True)
            A[j] += [[*left, *before, *right, *after] for left, right in rows]
            B[j] += product(weighting.b, d)
            if E:
                E[j] += product(weighting.b, f)
        if weighting.d and output.near is not None:
            raise FormatError("filters: one with a number d is of a signal that is known exactly")
        own, d = (*before, *weighting.c[0], *after), weighting.d
        C = [[[*(d * x for x in row), *own]] for (row,) in output.C]
        D, F = ([[[d * x for x in row]] for (row,) in rows] for rows in (output.D, output.F))
        passes = any(any(row) for (row,) in F)
        filtered.append(Output(C, D, output.name, tuple(F) if passes else (), output.unit))
        at += weighting.states
    remainder = subject.remainder and subject.remainder.padded(subject.n, subject.m, more)
    law = widened(subject.law, subject.n, more)
    known = zip(nodes, A[vertices:], B[vertices:], E[vertices:] or [[]] * len(nodes), strict=True)
    larger = replace(
        subject,
        A=A[:vertices],
        B=B[:vertices],
        E=E[:vertices],
        law=law,
        remainder=remainder,
        nodes=tuple(Node(node.at, *matrices) for node, *matrices in known),
    )
    return larger, tuple(filtered)


@dataclass(frozen=True)
class Entering:
    """Filters before disturbances of a plant with n states and m inputs."""

    n: int
    m: int
    filters: Filters

    def rows(self, M: Sequence[Sequence[Fraction]], first: int, *, sizes: bool = False) -> Rows:
        """Return rows of [x, ..., w], w from column ``first`` on, as rows of [x, z, ..., w]."""
        of = abs if sizes else Fraction
        rows = list[tuple[Fraction, ...]]()
        for row in M:
            at_states, acting = list[Fraction](), list[Fraction]()
            for applied, x in zip(self.filters, row[first:], strict=True):
                at_states += () if applied is None else (of(x * c) for c in applied.c[0])
                acting.append(x if applied is None else of(x * applied.d))
            rows.append((*row[: self.n], *at_states, *row[self.n : first], *acting))
        return tuple(rows)

    def own(self) -> tuple[Rationals, Rationals]:
        """Return [x, z] and w of the rates of z."""
        more, q, at = states_of(self.filters), len(self.filters), 0
        A, E = list[list[Fraction]](), list[list[Fraction]]()
        for k, applied in enumerate(self.filters):
            if applied is None:
                continue
            after = (ZERO,) * (more - at - applied.states)
            for row, (b,) in zip(applied.a, applied.b, strict=True):
                A.append([*(ZERO,) * (self.n + at), *row, *after])
                E.append([b if j == k else ZERO for j in range(q)])
            at += applied.states
        return A, E

    def plant(self, A: Rationals, B: Rationals, E: Rationals) -> tuple[Rationals, ...]:
        """Return A, B and E of the larger plant."""
        n, m, more = self.n, self.m, states_of(self.filters)
        rows = self.rows([[*a, *b, *e] for a, b, e in zip(A, B, E, strict=True)], n + m)
        below, driven = self.own()
        last = n + more
        return (
            [*(list(row[:last]) for row in rows), *below],
            [*(list(row[last : last + m]) for row in rows), *([ZERO] * m for _ in range(more))],
            [*(list(row[last + m :]) for row in rows), *driven],
        )

    def remainder(self, known: Remainder) -> Remainder:
        """Return that of the larger plant."""
        n, m, more = self.n, self.m, states_of(self.filters)

        def taller(M: Rows, *, sizes: bool = False) -> Rows:
            none = (ZERO,) * (n + more + m + len(self.filters))
            return (*self.rows(M, n + m, sizes=sizes), *(none,) * more)

        return known.mapped(taller, partial(taller, sizes=True))

    def row(
        self, c: Sequence[Fraction], f: Sequence[Fraction]
    ) -> tuple[tuple[Fraction, ...], tuple[Fraction, ...]]:
        """Return a row C and a row F of what the plant's are."""
        (row,), last = self.rows([[*c, *f]], self.n), self.n + states_of(self.filters)
        return row[:last], row[last:]

    def near(self, known: Remainder) -> Remainder:
        """Return what a row [C, D, F] is off by, of what it is of the plant's."""
        first = self.n + self.m
        return known.mapped(
            lambda M: self.rows(M, first), lambda M: self.rows(M, first, sizes=True)
        )

    def signal(self, output: Output) -> Output:
        """Return an output of the larger plant."""
        none: list[Rationals] = [[[ZERO] * len(self.filters)]] * len(output.C)
        pairs = [self.row(c, f) for (c,), (f,) in zip(output.C, output.F or none, strict=True)]
        F = tuple([list(f)] for _, f in pairs)
        F = F if any(any(f) for (f,) in F) else ()
        near = output.near and self.near(output.near)
        return replace(output, C=[[list(c)] for c, _ in pairs], F=F, near=near)

    def law(self, law: Law) -> Law:
        """Return a law of the larger plant."""
        n, more = self.n, states_of(self.filters)
        if not law.F:
            return widened(law, n, more)
        C, F = list[Rationals](), list[Rationals]()
        for rows, passed in zip(law.C, law.F, strict=True):
            wide = list(map(self.row, rows, passed))
            C.append([list(c) for c, _ in wide])
            F.append([list(f) for _, f in wide])
        return replace(law, C=tuple(C), F=tuple(F))


def in_turn(one: Filter | None, other: Filter | None) -> Filter | None:
    """Return two filters, the second behind the first; None stands for one."""
    if one is None or other is None:
        return one or other
    below = [[*into, *own] for into, own in zip(product(other.b, one.c), other.a, strict=True)]
    return Filter(
        [*([*row, *(ZERO,) * other.states] for row in one.a), *below],
        [*one.b, *([x * one.d] for (x,) in other.b)],
        [[*(other.d * x for x in one.c[0]), *other.c[0]]],
        one.name,
        one.d * other.d,
    )


def before(
    subject: Subject, outputs: Sequence[Output], filters: Filters
) -> tuple[Subject, tuple[Output, ...]]:
    """Return the loop with filters before some disturbances, and its outputs.

    Raises
    ------
    FormatError
        If there is not one filter, or none, for each disturbance.
    """
    if len(filters) != subject.q:
        raise FormatError(f"there are {subject.q} disturbances, and filters of {len(filters)}")
    entering, nodes = Entering(subject.n, subject.m, filters), subject.nodes
    size = subject.n + states_of(filters)
    spend(RATIONAL * (len(subject.A) + len(nodes)) * size * (size + subject.m + subject.q), 64, 64)
    vertices = zip(subject.A, subject.B, subject.E, strict=True)
    A, B, E = (list(M) for M in zip(*(entering.plant(*v) for v in vertices), strict=True))
    larger = replace(
        subject,
        A=A,
        B=B,
        E=E,
        law=entering.law(subject.law),
        remainder=subject.remainder and entering.remainder(subject.remainder),
        nodes=tuple(Node(v.at, *entering.plant(v.A, v.B, v.E)) for v in nodes),
    )
    return larger, tuple(map(entering.signal, outputs))


def widened(law: Law, n: int, more: int) -> Law:
    """Return a law of n states as one of more, which are not fed back.

    A W grows by a multiple of the identity: any will do that is positive.
    """
    if law.C:
        return replace(law, C=tuple(_beside(rows, more) for rows in law.C))
    if law.K is not None:
        return replace(law, K=[_beside(K, more) for K in law.K])
    size = law.W[0][0][0] if law.W and law.W[0] and law.W[0][0] else ONE
    eye = [[size if i == j else ZERO for j in range(more)] for i in range(more)]
    W = [[*_beside(M, more), *([*(ZERO,) * n, *row] for row in eye)] for M in law.W or []]
    return replace(law, W=W, Z=[_beside(M, more) for M in law.Z or []])


def _beside(matrix: Rationals, more: int) -> Rationals:
    return [[*row, *(ZERO,) * more] for row in matrix]
