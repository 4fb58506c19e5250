"""A condition's stacked pencil, its layout worked out once for each shape of plant.

Conditions are linear in S_j = A_j + sigma I and B_j, and put them side by side and one on the
other, never their entries apart. So a pencil built for matrices full of powers of four shows in
its digits how often each S_j and B_j enters each column, and any plant of that shape is filled in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from polefence.lmi.conditions.linear import Index, Variable
from polefence.lmi.conditions.methods import Method, build, normal
from polefence.lmi.conditions.pencil import Pencil
from polefence.lmi.conditions.target import Target
from polefence.lmi.solve.stacked import Stacked, stack
from polefence.plant.system import Array

MOST_VERTICES = 26  # whose powers of four a double can add up


def stacked_pencil(
    method: Method, A: Array, B: Array, target: Target, unit: Array
) -> tuple[Pencil, Stacked]:
    """Return a pencil with the condition's variables, and the condition for this plant stacked.

    Of the pencil only what does not depend on the plant may be used: packing and unpacking.
    """
    N, n, m = B.shape
    method, sigma = normal(method), target.sigma
    if sigma is None or not isinstance(method, str) or N > MOST_VERTICES:
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
        data = np.concatenate([S, B], axis=2)
        families = []
        for family, columns in zip(self.stacked.families, self.columns, strict=True):
            terms = [
                t if c is None else replace(t, M=_filled(t.M.shape, data, *c))
                for t, c in zip(family.terms, columns, strict=True)
            ]
            families.append(replace(family, terms=tuple(terms)))
        return replace(self.stacked, families=tuple(families))


def _filled(shape: tuple[int, ...], data: Array, column: Index, counts: Array) -> Array:
    """M (blocks, size, a) whose column a is the sum of counts times that column of [S_j, B_j]."""
    M = np.zeros(shape)
    # data (N, n, n + m) by column: (blocks, a, N, n)
    chosen = data.transpose(2, 0, 1)[column]
    M[:, : data.shape[1]] = (counts[:, :, None, :] @ chosen)[:, :, 0].swapaxes(1, 2)
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
