"""The least radii of many plants of one shape at once: what a search does most of the time.

Starts, coordinates and inequalities are worked out for all plants together, as stacks of arrays;
only the interior points run one by one. A run that stalls goes on alone, from where it ended; a
point that is no start is left out: `polefence.lmi.solve.smallest` has the means for both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from polefence.lmi.conditions.pencil import Index, Pencil
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.interior_point import TOLERANCE, WIDE, Outcome
from polefence.lmi.solve.scaling import Scaling, balanced, factors
from polefence.lmi.solve.search import Reached, attempt, lyapunov_mean
from polefence.lmi.solve.smallest import (
    FLOOR,
    LOW,
    ROUGH,
    WIDENINGS,
    dual_of,
    is_near,
    smallest,
)
from polefence.lmi.solve.stacked import Stacked, stacked_plants
from polefence.lmi.solve.starts import nominal_start
from polefence.plant.system import Array


def smallest_disks(
    A: Array, B: Array, sigma: Array, method: str, enough: Array
) -> list[Reached | None]:
    """Find the least radius of each plant, as `smallest` does; None where that has other means.

    Parameters
    ----------
    A, B : (P, N, n, n), (P, N, n, m) arrays
        N at most `polefence.lmi.solve.stacked.MOST_VERTICES`.
    sigma, enough : (P,) arrays
        Minus the centres, and radii that end the searches [1/s].
    method : str
        "quadratic", "slack" or "scheduled".
    """
    each = [balanced(*own) for own in zip(A, B, sigma.tolist(), strict=True)]
    T, S, rate = (np.array([getattr(own, name) for own in each]) for name in ("T", "S", "rate"))
    start = nominal_start(A, B, sigma, Scaling(T, S, rate))
    W, Z = start.W, start.K @ start.W
    points = _Points(np.arange(len(A)), A, B, sigma, S, rate, start.radius, W, Z)
    if method != "quadratic":
        points = _run(points, "quadratic", ROUGH, LOW * sigma).points()
    found: list[Reached | None] = [None] * len(A)
    floor = np.maximum(enough, FLOOR * sigma)
    for k, reached in _run(points, method, TOLERANCE, floor).reached():
        found[k] = reached
        if not reached.converged and reached.r > floor[k]:
            goal, least = Disks(-float(sigma[k])), float(enough[k])
            found[k] = smallest(A[k], B[k], goal, method, enough=least, begun=reached)
    return found


@dataclass(frozen=True, eq=False)
class _Points:
    """Plants with a point of Lemma 1 each, r being its radius; ``number`` says which they are."""

    number: Index
    A: Array
    B: Array
    sigma: Array
    S: Array
    rate: Array
    r: Array
    W: Array
    Z: Array

    def at(self, kept: Index) -> _Points:
        """Return some of them."""
        return _Points(*(own[kept] for own in vars(self).values()))


@dataclass(frozen=True, eq=False)
class _Runs:
    """What interior points reached, in the coordinates of the points where they began."""

    begun: _Points
    T: Array
    pencil: Pencil
    stacked: list[Stacked]
    outcomes: list[Outcome]

    @property
    def scaling(self) -> Scaling:
        return Scaling(self.T, self.begun.S, self.begun.rate)

    @property
    def ends(self) -> dict[str, Array]:
        x = np.array([own.x for own in self.outcomes])
        return self.pencil.unpack(x.reshape(-1, self.pencil.unknowns))

    @property
    def r(self) -> Array:
        return np.asarray(self.begun.rate * np.array([own.r for own in self.outcomes]))

    def points(self) -> _Points:
        """Return where runs of Lemma 1 ended."""
        values = self.scaling.restore(self.ends, self.pencil.variables)
        return replace(self.begun, r=self.r, W=values["W"], Z=values["Z"])

    def reached(self) -> Iterator[tuple[int, Reached]]:
        """Yield number and end of each plant that had a start."""
        if not self.outcomes:
            return
        r, ends = self.r, self.ends
        values = self.scaling.restore(ends, self.pencil.variables)
        near = is_near(lyapunov_mean(ends))
        for k, (stacked, outcome) in enumerate(zip(self.stacked, self.outcomes, strict=True)):
            scaling = Scaling(self.T[k], self.begun.S[k], float(self.begun.rate[k]))
            yield (
                int(self.begun.number[k]),
                Reached(
                    r=float(r[k]),
                    values={name: own[k] for name, own in values.items()},
                    dual=dual_of(outcome, stacked, scaling),
                    converged=outcome.converged and bool(near[k]),
                    iterations=outcome.iterations,
                    rate=scaling.rate,
                ),
            )


def _run(points: _Points, method: str, tolerance: float, floor: Array) -> _Runs:
    """Run each plant's interior point in the coordinates of its W, where it has such."""
    T = factors(points.W)
    usable = np.flatnonzero(np.isfinite(T).all(axis=(1, 2)) & np.isfinite(points.r))
    points, T = points.at(usable), T[usable]
    scaling, floor = Scaling(T, points.S, points.rate), floor[points.number]
    A, B = scaling.apply(points.A, points.B)
    pencil, plants = stacked_plants(method, A, B, points.sigma / points.rate)
    common = {v.name: points.Z if v.rows == "u" else points.W for v in pencil.variables}
    x = pencil.pack(scaling.scaled(common, pencil.variables))
    r = WIDE * np.maximum(points.r, FLOOR * points.sigma) / points.rate
    ends = [
        attempt(*own, tolerance, widenings=WIDENINGS)
        for own in zip(plants, x, r.tolist(), (floor / points.rate).tolist(), strict=True)
    ]
    sound = np.array([k for k, end in enumerate(ends) if end is not None], dtype=np.intp)
    return _Runs(
        points.at(sound),
        T[sound],
        pencil,
        [plants[k] for k in sound],
        [end for end in ends if end is not None],
    )
