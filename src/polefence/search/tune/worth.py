"""Which of laws that are nearly as good as the best is taken: one of a smaller gain is worth it.

A thousandth of the level buys a gain that is smaller by a fifth at least: less is no reason to pay.
Where it is halved several times each may cost half of that. A law of a thirtieth of the gain lets a
car ride 0.16 % rougher, and is taken: the poles of the other are 100 times as fast as the car's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

NEAR = 1e-3  # above the best level, laws that are as good, as a share of it
SMALLER = 0.8  # of the gain: a law whose gain falls by less is worth neither a proof nor its level
PROMISING = 0.02  # above the best level, laws that are proved where the best has no proof
HALVINGS = 3, 6  # of the gain, from which on each is worth half of that, and up to which


def near(level: float, gain: float, smaller: float) -> float:
    """Return the level up to which a law of a smaller gain is as good as one of this level."""
    halvings = float(np.log2(gain / smaller)) if 0 < smaller < gain else np.inf * (gain > smaller)
    fewest, most = HALVINGS
    times = min(halvings, most) / 2 if halvings >= fewest else 1.0
    return float(level + times * NEAR * abs(level))


def promising(level: float) -> float:
    """Return the level up to which a law is worth a proof where the best one, of this, has none."""
    return level + PROMISING * abs(level)


def up_to(level: float, gain: float, other: float) -> float:
    """Return the level up to which a law of another gain may be taken for one of this level."""
    return near(level, gain, other) if other <= SMALLER * gain else level


def taken(levels: Sequence[float], gains: Sequence[float], most: float = np.inf) -> int:
    """Return which law is taken: the best, or one whose gain is so much smaller for its level.

    From the best upwards each step is worth it, so that no law in between is as small.

    Parameters
    ----------
    levels, gains : sequence of float
        Of each law, at least one.
    most : float
        The level that is not to be exceeded; the best law is taken where all exceed it.
    """
    order = sorted(range(len(levels)), key=lambda k: (levels[k], gains[k]))
    best = chosen = order[0]
    for k in order[1:]:
        limit = min(most, near(levels[best], gains[best], gains[k]))
        if levels[k] <= limit and gains[k] <= SMALLER * gains[chosen] and gains[chosen] > 0:
            chosen = k
    return chosen
