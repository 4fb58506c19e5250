"""What one phase of a search measures: of poles, of the law itself, of each requirement."""

from __future__ import annotations

from dataclasses import dataclass

from polefence.lmi.conditions.target import Side
from polefence.requirements.slopes import Channel
from polefence.search.tune.smooth import Curve

# What is measured. The kernel knows all but the last; see src/kernel/laws.cpp.
SIDE, SPEED, ENTRIES, NOISE, SIZE, SMOOTH_SIDE, OTHER = range(7)
# How: value / limit + shift, which is kept at zero or less; value / unit; value / most - 1.
KEPT, IN_UNITS, AT_MOST = range(3)


@dataclass(frozen=True, eq=False)
class Wanted:
    """One measure.

    Attributes
    ----------
    kind : int
    group : int
        Of its rows; sides of a region that grows share one.
    bend : int
    limit, shift : float
        Of one that is kept.
    side : Side, optional
        Of poles.
    curve : Curve, optional
        What it is smoothly.
    requirement : int
        Its number.
    channel : Channel, optional
        Of answers to noise.
    """

    kind: int
    group: int
    bend: int = KEPT
    limit: float = 1.0
    shift: float = 0.0
    side: Side | None = None
    curve: Curve | None = None
    requirement: int = 0
    channel: Channel | None = None
