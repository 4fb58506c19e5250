"""Steady states under a disturbance that stays, over a family.

An rms is about noise without a mean. A constant disturbance, the road's velocity on a grade, is no
such noise, and a law that feeds back absolute velocities may answer it with a deflection that stays
as long as the grade does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.explained import explained
from polefence.base.readable import sample_text
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal, split
from polefence.proof.short import Short
from polefence.response.linear import final
from polefence.vehicle.suspensions import in_continuous_time

GRADE = "a grade of 5 % at 20 m/s"  # of the road's velocity, 1 m/s


@dataclass(frozen=True)
class Rest(Short):
    """Steady value of a signal under a unit of one disturbance, held.

    Attributes
    ----------
    source : Signal
    signal : Output
    low, high : float
        Over the points that were looked at, in the signal's unit; both zero where what is left is
        rounding.
    """

    source: Signal
    signal: Output
    low: float
    high: float

    @property
    def size(self) -> float:
        """The larger magnitude."""
        return max(abs(self.low), abs(self.high))

    @property
    def words(self) -> str:
        """Name, range and unit."""
        return f"{self.signal.name} {self.span} {self.signal.unit}".rstrip()

    @property
    def span(self) -> str:
        """The range."""
        low, high = map(sample_text, (self.low, self.high))
        return low if low == high else f"{low} to {high}"


@explained
def rests(
    plant: UncertainPlant, law: Any, alpha: Any, signals: Sequence[Output | str] | None = None
) -> tuple[Rest, ...]:
    """Return the steady value of each signal under each disturbance, where it has one.

    Noise of sensors is left out: it has no mean.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
    alpha : (count, N) array
        Points of the family; of a large plant the first of them.
    signals : sequence of Output or str, optional
        All states and inputs by default.

    Raises
    ------
    InputError
        If the plant has no disturbance, or as `close` raises.
    """
    # as many points as keep all matrices below 2e7 numbers
    points = np.atleast_2d(alpha)[: max(200, int(2e7 / plant.shape[0] ** 2))]
    sources, asked, values, scale = final(plant, law, points, signals)
    left = []
    for j, source in enumerate(sources):
        if source.name in plant.noise:
            continue
        for i, signal in enumerate(asked):
            if np.all(np.isfinite(values[:, i, j])):
                low, high = float(values[:, i, j].min()), float(values[:, i, j].max())
                if max(abs(low), abs(high)) <= 1e-9 * scale[i, j]:  # zero but for rounding
                    low = high = 0.0
                left.append(Rest(source, signal, low, high))
    return tuple(left)


def held_words(plant: UncertainPlant, source: Signal) -> str:
    """Describe the disturbance: one unit, and for a car's road the grade that it is."""
    text = f"{source.name} = 1 {source.unit}".rstrip()
    return f"{text} ({GRADE})" if is_grade(plant) else text


def is_grade(plant: UncertainPlant) -> bool:
    """Whether the one disturbance is the road's velocity under a car, in m/s."""
    roads = [split(name) for name in plant.disturbances if split(name)[0] not in plant.noise]
    vehicle = in_continuous_time(plant).vehicle
    return vehicle is not None and roads == [(vehicle.road, "m/s")]
