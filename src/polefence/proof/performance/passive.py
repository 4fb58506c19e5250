"""The loop that another is compared with: the same plant under one gain, less some states."""

from __future__ import annotations

from fractions import Fraction

from polefence.proof.matrices import Rationals
from polefence.proof.performance.claims import Output, Subject
from polefence.proof.work import FormatError

_Loop = tuple[list[Rationals], list[Rationals], list[Rationals]]


def baseline_loop(
    subject: Subject, output: Output, K: Rationals | None, states: tuple[int, ...]
) -> _Loop:
    """Return A, E, C of the subject's plant with u = K x, of these states alone.

    Parameters
    ----------
    subject : Subject
        Its law and evidence are not used.
    output : Output
    K : (m, n) rationals, optional
        None: u = 0, the passive plant.
    states : tuple of int
        Those that are kept, counted from 0.

    Raises
    ------
    FormatError
        If a state that is kept, or y, depends on one that is not: what is left would be another
        loop.
    """
    n = len(subject.A[0])
    if sorted(set(states)) != list(states) or not states or states[0] < 0 or states[-1] >= n:
        raise FormatError(f"states must be some of the {n}, in their order")
    left = [j for j in range(n) if j not in states]
    found: _Loop = ([], [], [])
    for k in range(len(subject.A)):
        A = _closed(subject.A[k], subject.B[k], K)
        C = _closed(output.C[k], output.D[k], K)
        if any(row[j] for row in ([A[i] for i in states] + C) for j in left):
            raise FormatError(f"vertex {k + 1}: the baseline depends on a state left out")
        found[0].append([[A[i][j] for j in states] for i in states])
        found[1].append([subject.E[k][i] for i in states])
        found[2].append([[row[j] for j in states] for row in C])
    return found


def _closed(A: Rationals, B: Rationals, K: Rationals | None) -> Rationals:
    """Return A + B K."""
    if K is None:
        return A
    columns = list(zip(*K, strict=True))
    return [
        [
            a + sum((b * k for b, k in zip(bs, column, strict=True)), Fraction(0))
            for a, column in zip(row, columns, strict=True)
        ]
        for row, bs in zip(A, B, strict=True)
    ]
