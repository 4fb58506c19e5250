"""Rows of laws by the compiled kernel: poles, the size of the law, rms values.

`polefence.search.tune.measures` is the reference. It does what the kernel cannot: other measures,
and laws with a loop whose eigenvectors are too ill-conditioned for its Lyapunov equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.kernel import kernel
from polefence.plant.system import Array
from polefence.requirements.slopes import Channel
from polefence.response.modes import Modes
from polefence.search.tune.descent import Rows
from polefence.search.tune.smooth import Curve
from polefence.search.tune.unknowns import At
from polefence.search.tune.wanted import OTHER, Wanted

FINE, IMPOSSIBLE, HARD = range(3)  # of a law: one without rows, and one for the reference
LARGEST = 2  # rows of a side's matrices
MATRICES = "L0", "L1", "M0", "M1"


def knows(wanted: Wanted) -> bool:
    """Whether the kernel measures it."""
    return wanted.kind != OTHER and (wanted.side is None or len(wanted.side.L0) <= LARGEST)


@dataclass(frozen=True, eq=False)
class Plan:
    """The measures of one phase at some points, and the arrays that the kernel takes.

    Attributes
    ----------
    every, rest : tuple of Wanted
        Those that the kernel evaluates, and the others.
    channel : Channel
        The plant alone.
    at : At
    largest, weight : (m, r) arrays
        Limits on the magnitudes of the gain's entries; and their weights in its norm.
    step, fastest : float
    stable : bool
        Whether unstable loops have no rows.
    first : bool
        Whether measures in units are the objective; otherwise all measures are.
    trace : float
        Bound on the trace that defines a smooth measure.
    """

    every: tuple[Wanted, ...]
    rest: tuple[Wanted, ...]
    channel: Channel
    at: At
    largest: Array
    weight: Array
    step: float
    fastest: float
    stable: bool
    first: bool
    trace: float

    def rows(
        self, laws: int, K: Array, modes: Modes, unit: Array, most: Array
    ) -> tuple[list[Rows | None], list[int]]:
        """Return the rows of several laws, and the numbers of laws left to the reference.

        Parameters
        ----------
        K : (points, m, r) array
            Of what is measured.
        modes : Modes
            Of the plant's loops.
        unit, most : (laws,) arrays
        """
        values, slopes, groups, objective, ends, status, _ = self._asked(laws, K, modes, unit, most)
        objective, begin, rows = objective.view(bool), 0, list[Rows | None]()
        for end, how in zip(ends.tolist(), status.tolist(), strict=True):
            law = slice(begin, end)
            found = Rows(values[law], slopes[law], groups[law], objective[law])
            rows.append(found if how == FINE else None)
            begin = end
        return rows, np.flatnonzero(status == HARD).tolist()

    def worst(self, K: Array, modes: Modes) -> Array | None:
        """Return the largest of each group at each point; None where the reference is needed."""
        one = np.ones(1)
        *_, status, worst = self._asked(1, K, modes, one, one, slopes=False)
        if status[0] != FINE:
            return None
        groups = [wanted.group for wanted in self.every]
        largest = np.full((1 + groups[-1], len(K)), -np.inf)
        np.maximum.at(largest, groups, worst)
        return largest

    def _asked(
        self, laws: int, K: Array, modes: Modes, *of_laws: Array, slopes: bool = True
    ) -> Any:
        arrays = self._arrays
        loops = [_loops(self.channel, modes)]
        for channel in arrays.filtered:
            wide = np.pad(K @ self.at.C, ((0, 0), (0, 0), (0, channel.filters)))
            loops.append(_loops(channel, Modes(channel.A + channel.B @ wide, modes.step)))
        asked = (self.step, self.fastest, self.stable, self.first, slopes)
        law = (np.ascontiguousarray(K), *arrays.law, *of_laws)
        return kernel().rows(
            laws,
            *asked,
            *law,
            loops,
            arrays.sources,
            arrays.noises,
            arrays.sides,
            arrays.curves,
            arrays.measures,
            arrays.bends,
        )

    @cached_property
    def _arrays(self) -> _Arrays:
        return _Arrays.of(self)


@dataclass(frozen=True, eq=False)
class _Arrays:
    """The arguments of the kernel that do not depend on the law."""

    law: tuple[Array, ...]
    filtered: list[Channel]
    sources: list[tuple[int, Array]]
    noises: list[tuple[int, Array, Array, Array]]
    sides: list[tuple[Array, ...]]
    curves: Array
    measures: Any
    bends: Array

    @classmethod
    def of(cls, plan: Plan) -> _Arrays:
        filtered, sources = list[Channel](), list[tuple[int, Array]]()
        noises, sides = list[tuple[int, Array, Array, Array]](), list[tuple[Array, ...]]()
        numbers, curves = list[int](), list[tuple[float, ...]]()
        for wanted in plan.every:
            numbers.append(0)
            if wanted.side is not None:
                numbers[-1] = len(sides)
                sides.append(tuple(_plain(getattr(wanted.side, M)) for M in MATRICES))
                if wanted.curve is not None:
                    numbers[-1] = len(curves)
                    curves.append((len(sides) - 1, *_numbers(wanted.curve), plan.trace))
            elif wanted.channel is not None:
                numbers[-1] = len(noises)
                noises.append(_noise(wanted.channel, filtered, sources))
        unknowns = plan.at.unknowns
        law = (plan.at.C, plan.at.terms, unknowns.pattern, plan.largest, plan.weight)
        measures = [
            (wanted.kind, number, wanted.group, wanted.bend)
            for wanted, number in zip(plan.every, numbers, strict=True)
        ]
        bends = [(wanted.limit, wanted.shift) for wanted in plan.every]
        return cls(
            tuple(map(_plain, law)),
            filtered,
            sources,
            noises,
            sides,
            np.array(curves, dtype=float).reshape(-1, 11),
            np.array(measures, dtype=np.int64).reshape(-1, 4),
            np.array(bends, dtype=float).reshape(-1, 2),
        )


def _numbers(curve: Curve) -> tuple[float, ...]:
    a, b = (*curve.a, 0.0, 0.0)[:3], (*curve.b, 0j)[:2]
    return *a, b[0].real, b[0].imag, b[1].real, b[1].imag, curve.e, curve.s


def _noise(
    channel: Channel, filtered: list[Channel], sources: list[tuple[int, Array]]
) -> tuple[int, Array, Array, Array]:
    """Return a signal with the number of its source; signals with one E share it."""
    loops = 0
    if channel.filters:
        filtered.append(channel)
        loops = len(filtered)
    E = _plain(channel.E)
    same = [k for k, (n, M) in enumerate(sources) if n == loops and np.array_equal(M, E)]
    if not same:
        sources.append((loops, E))
    more = np.zeros(len(E)) + channel.more
    source = same[0] if same else len(sources) - 1
    return source, _plain(channel.C), _plain(channel.D), _plain(more)


def _loops(channel: Channel, modes: Modes) -> tuple[Array, ...]:
    parts = (modes.poles, modes.right, modes.left)
    return (
        _plain(modes.A),
        _plain(channel.B),
        *(np.ascontiguousarray(part, dtype=complex) for part in parts),
    )


def _plain(M: Array) -> Array:
    return np.ascontiguousarray(M, dtype=float)
