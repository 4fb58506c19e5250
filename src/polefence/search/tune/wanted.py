"""The measures of one phase of a search: poles, the law itself, requirements."""

from __future__ import annotations

from dataclasses import dataclass

from polefence.lmi.conditions.target import Side
from polefence.requirements.slopes import Channel
from polefence.search.tune.smooth import Curve

# Kinds, numbered as in src/kernel/laws.cpp, which has all but the last.
SIDE, SPEED, ENTRIES, NOISE, SIZE, SMOOTH_SIDE, OTHER = range(7)
# How a value becomes that of a row: value / limit + shift, to be zero or less; value / unit;
# value / most - 1.
KEPT, IN_UNITS, AT_MOST = range(3)


@dataclass(frozen=True, eq=False)
class Wanted:
    """One measure.

    Attributes
    ----------
    kind : int
        SIDE to OTHER.
    group : int
        Number of its rows' group; the sides of a region that grows share one.
    bend : int
        KEPT, IN_UNITS or AT_MOST.
    limit, shift : float
        For KEPT.
    side : Side, optional
        For SIDE and SMOOTH_SIDE: what poles are to be inside of.
    curve : Curve, optional
        For SMOOTH_SIDE: the same as a half-plane or a disk.
    requirement : int
        For NOISE and OTHER: its number in the task.
    channel : Channel, optional
        For NOISE and OTHER.
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
