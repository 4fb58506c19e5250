"""Which of laws that are as good as the best to a thousandth is taken: gain is saved for a fall.

A law of a higher level is taken where its gain falls by a fifth at least. Less is no reason to pay.
"""

from __future__ import annotations

from collections.abc import Sequence

NEAR = 1e-3  # above the best level, laws that are as good, as a share of it
SMALLER = 0.8  # of the gain: a law whose gain falls by less is worth neither a proof nor its level


def taken(levels: Sequence[float], gains: Sequence[float], limit: float) -> int:
    """Return which law is taken: the best, or one whose gain is so much smaller within a limit.

    From the best upwards each step is worth it, so that no law in between is as small.

    Parameters
    ----------
    levels, gains : sequence of float
        Of each law, at least one.
    limit : float
        The level that is not to be exceeded; the best law is taken where all exceed it.
    """
    order = sorted(range(len(levels)), key=lambda k: (levels[k], gains[k]))
    best = order[0]
    for k in order[1:]:
        if levels[k] <= limit and gains[k] <= SMALLER * gains[best] and gains[best] > 0:
            best = k
    return best
