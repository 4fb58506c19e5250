"""Filters behind signals: z' = a z + b y, and in the place of y the weighted signal c z + d y.

Nothing in the plant depends on z, and no law knows it. So what is claimed of a signal behind a
filter is what is claimed of c z + d y in a larger plant, whose law leaves z alone: of the same
poles, and those of a. In discrete time a and b are those of the filter's delta form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from polefence.proof.matrices import ONE, ZERO, Rationals, mix, product
from polefence.proof.plant import Node, Output
from polefence.proof.ranges import corner_weights
from polefence.proof.reading import Table, plain
from polefence.proof.work import RATIONAL, FormatError, spend

if TYPE_CHECKING:
    from polefence.proof.claims.signal import Subject
    from polefence.proof.laws import Law

MAX_STATES = 20  # of one filter


@dataclass(frozen=True)
class Filter:
    """Matrices a (k x k), b (k x 1) and c (1 x k), a name, and a number d."""

    a: Rationals
    b: Rationals
    c: Rationals
    name: str = ""
    d: Fraction = ZERO

    @classmethod
    def read(cls, table: Table) -> Filter:
        """Read a filter."""
        a = table.matrix("a")
        k = len(a)
        if not 1 <= k <= MAX_STATES:
            raise FormatError(f"{table.path('a')} has {k} rows; a filter has 1 to {MAX_STATES}")
        a, b, c = table.matrix("a", k, k), table.matrix("b", k, 1), table.matrix("c", 1, k)
        return cls(a, b, c, table.text("name", ""), table.number("d", 0))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table = {"name": self.name} | {key: plain(getattr(self, key)) for key in "abc"}
        return table | ({"d": plain(self.d)} if self.d else {})

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.a)


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
    law = _wider(subject.law, subject.n, more)
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


def _wider(law: Law, n: int, more: int) -> Law:
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
