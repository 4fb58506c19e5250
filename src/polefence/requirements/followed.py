"""What requirements share whose motions are followed over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array

CALM, EVEN, DENSE = 12.0, 1500, 0.05  # of a response: time constants, and times that are looked at
TURN, TURNS = 40, 100  # of its fastest mode: times in a turn, and how many turns


def unfollowed(plant: UncertainPlant) -> str:
    """Say of which plants motions are not followed; "" of this one they are."""
    if plant.period or plant.sampling is not None:
        return "at a sample time"
    if plant.functions is not None or plant.remainder is not None:
        return "of a plant with functions of its parameters"
    return "while parameters move" if plant.moving else ""


def times_of(poles: Any, even: int = EVEN, turn: int = TURN, turns: int = TURNS) -> Array:
    """Return the times at which a motion of these poles is looked at [s].

    Parameters
    ----------
    even : int
        How many are as far apart, and how many as many times the one before.
    turn, turns : int
        How many are in a turn of the fastest mode, of the first ones.
    """
    slow, fast = -poles.real.max(), np.abs(poles).max()
    last = CALM / slow
    t = np.union1d(np.linspace(0, last, even), np.geomspace(DENSE / fast, last, even))
    period = 2 * np.pi / fast
    return np.union1d(t, np.arange(0, min(last, turns * period), period / turn))
