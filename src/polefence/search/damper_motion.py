"""Where a car is whose dampers are cut off to their bounds: in which piece, how often.

A polynomial of a high degree is hard to find where dampers' curves are bent, unless the search
knows the moments of the motion in each piece. Drives tell them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import prod

import numpy as np

from polefence.lmi.solve.moments import Visits
from polefence.plant.system import Array
from polefence.proof.claims.clipped import Case, Group
from polefence.proof.dampers import SemiActive
from polefence.proof.sectors import GIVEN, LOWER, UPPER

# Drives: how many, their step by the fastest pole, how long by the slowest one, what of them is
# taken, and the share of what is hardly ever visited.
DRIVES, STEP, SETTLED, MAX_STEPS, RECORDS, RARE = 200, 1.0, 8.0, 20000, 150, 1e-3
ROUNDS, ENOUGH = 30, 300  # draws of that, until there are so many points in each case


@dataclass(frozen=True, eq=False)
class ClippedMotion:
    """x' = A x + B u + E w at each vertex, in units; u is cut off to what the dampers can give.

    Attributes
    ----------
    A, B : (N, n, n) and (N, n, m) arrays
    E : (n, w) array
    X : (n, n) array
        Covariance of x, near that of the motion.
    rates : (m, n) array
        Of the dampers, by x.
    dampers : tuple of SemiActive
    cases : sequence of sequence of Case
        Of each damper; their forces are by (x, 1) in the plant's own units.
    units : (n,) array
        Of x in these.
    groups : sequence of Group
        Of vertices; a piece is a group with a case of each damper.
    fastest, slowest : float
        Of the poles, 1/s.
    """

    A: Array
    B: Array
    E: Array
    X: Array
    rates: Array
    dampers: Sequence[SemiActive]
    cases: Sequence[Sequence[Case]]
    units: Array
    groups: Sequence[Group]
    fastest: float
    slowest: float

    def visits(self, degree: int) -> list[Visits]:
        """Return where the motion is in each piece, by drives at mixed parameters.

        One for each group of vertices, with the shares of all groups; and, to a small share, points
        drawn from a wider Gaussian, for what is hardly ever visited.
        """
        source = np.random.default_rng(0)
        found = _Found([(list[Array](), list[Array]()) for _ in range(self._pieces)], self.groups)
        self._drive(source, found)
        self._draw(source, found, degree)
        n = len(self.X)
        return [
            Visits(
                np.concatenate([np.zeros((0, n)), *points]), np.concatenate([np.zeros(0), *shares])
            )
            for points, shares in found.pieces
        ]

    @property
    def _pieces(self) -> int:
        return len(self.groups) * prod(map(len, self.cases))

    @cached_property
    def _root(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.X), dtype=np.float64)

    @cached_property
    def _numbers(self) -> list[Array]:
        return [np.array(_numbers(own)) for own in self.cases]

    @cached_property
    def _forces(self) -> list[Array]:
        """What is asked and both bounds, in each part of a damper's curves, by (x, 1) in units."""
        S = np.diag([*self.units, 1.0])
        return [
            np.array([[own[k].force for k in row] for row in rows.tolist()], float) @ S
            for own, rows in zip(self.cases, self._numbers, strict=True)
        ]

    @cached_property
    def _bends(self) -> list[Array]:
        return [np.array([start for start, _ in own.parts[1:]], float) for own in self.dampers]

    def _acting(self, y: Array) -> tuple[Array, Array]:
        """Return the forces, and the number of the case, where y = (x, 1)."""
        u, place = np.empty((len(y), len(self.cases))), np.zeros(len(y), dtype=int)
        for k, own in enumerate(self._forces):
            part = np.searchsorted(self._bends[k], y[:, :-1] @ self.rates[k], side="right")
            asked, low, high = (np.einsum("ij,ij->i", own[part, what], y) for what in range(3))
            least, most = np.minimum(low, high), np.maximum(low, high)
            u[:, k] = np.clip(asked, least, most)
            bound = np.where((asked < low) == (low <= high), LOWER, UPPER)
            what = np.where((least < asked) & (asked < most), GIVEN, bound)
            place = place * len(self.cases[k]) + self._numbers[k][part, what]
        return u, place

    def _drive(self, source: np.random.Generator, found: _Found) -> None:
        """Add points of drives, at the mean parameters of each group."""
        step = STEP / self.fastest
        steps = min(round(SETTLED / self.slowest / step), MAX_STEPS)
        every, E = max(steps // RECORDS, 1), self.E
        for group in self.groups:
            alpha = np.zeros(len(self.A))
            for pair in group:
                np.add.at(alpha, list(pair), 0.5 / len(group))
            A, B = np.tensordot(alpha, self.A, 1), np.tensordot(alpha, self.B, 1)
            y = self._drawn(source, np.ones(DRIVES))

            def slope(y: Array, A: Array = A, B: Array = B) -> Array:
                return np.asarray(y[:, :-1] @ A.T + self._acting(y)[0] @ B.T)

            for k in range(steps):
                middle = y.copy()
                middle[:, :-1] += step / 2 * slope(y)
                noise = source.standard_normal((DRIVES, E.shape[1])) @ E.T
                y[:, :-1] += step * slope(middle) + np.sqrt(step) * noise
                if k > steps // 2 and k % every == 0:
                    found.add(alpha, y, self._acting(y)[1], np.full(len(y), 1.0))

    def _draw(self, source: np.random.Generator, found: _Found, degree: int) -> None:
        """Add points from a wider Gaussian in the cases that have few."""
        N = len(self.A)
        even, drawn = np.full(N, 1 / N), np.zeros(prod(map(len, self.cases)))
        for _ in range(ROUNDS):
            wide = np.repeat((0.5, 1.0, 2.0, 4.0), 5 * DRIVES)
            y = self._drawn(source, wide)
            place = self._acting(y)[1]
            few = drawn[place] < ENOUGH
            found.add(even, y[few], place[few], RARE * wide[few] ** -degree)
            drawn += np.bincount(place[few], minlength=len(drawn))
            if not few.any() or drawn.min() >= ENOUGH:
                break

    def _drawn(self, source: np.random.Generator, wide: Array) -> Array:
        """Return y = (x, 1) of Gaussian x, so many times wider than the motion."""
        y = np.ones((len(wide), len(self.X) + 1))
        y[:, :-1] = wide[:, None] * source.standard_normal((len(wide), len(self.X))) @ self._root.T
        return y


@dataclass(frozen=True, eq=False)
class _Found:
    """Points and shares of each piece, as they are found."""

    pieces: list[tuple[list[Array], list[Array]]] = field(repr=False)
    groups: Sequence[Group]

    def add(self, alpha: Array, y: Array, place: Array, shares: Array) -> None:
        """Add points at parameters to each piece that they are in."""
        count = len(self.pieces) // len(self.groups)
        for g, group in enumerate(self.groups):
            j, k = group[0]
            part = float(alpha[j] * alpha[k])
            for case in np.unique(place).tolist() if part else ():
                own = place == case
                points, parts = self.pieces[g * count + case]
                points.append(y[own, :-1])
                parts.append(part * shares[own])


def _numbers(cases: Sequence[Case]) -> list[list[int]]:
    """Return the numbers of a damper's cases in each part: three, or thrice the only one."""
    rows = list[list[int]]()
    for k, case in enumerate(cases):
        if case.what == GIVEN:
            rows.append([k, k + 1, k + 2])
        elif not rows or k > max(rows[-1]):
            rows.append([k] * 3)
    return rows
