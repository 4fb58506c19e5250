"""Parameters' intervals, and the corners of parts of their box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import Literal

from polefence.proof.dead_time import DeadTime
from polefence.proof.short import Short

ANY: Literal["any"] = "any"  # of a rate: nothing bounds it


@dataclass(frozen=True)
class Range(Short):
    """A parameter's interval; ``inverted`` where the plant is affine in 1/p.

    ``rate`` holds the least and the largest dp/dt, or "any"; None of one that does not move.
    ``dead_time`` says what one that stands for a causal system is of.
    """

    low: Fraction
    high: Fraction
    inverted: bool = False
    name: str = ""
    unit: str = ""
    label: str = ""
    rate: tuple[Fraction, Fraction] | Literal["any"] | None = None
    dead_time: DeadTime | None = None


def narrowed(parameter: Range, low: Fraction, high: Fraction) -> Range:
    """Return a parameter on a part of its interval, between weights of its upper end."""
    ends = (parameter.low, parameter.high)
    first, last = (1 / x if parameter.inverted else x for x in ends)
    start, end = (first + (last - first) * t for t in (low, high))
    if parameter.inverted:
        start, end = 1 / start, 1 / end
    return replace(parameter, low=start, high=end)


def corners(low: Sequence[Fraction], high: Sequence[Fraction]) -> list[tuple[Fraction, ...]]:
    """Return the corners of a part of the box, the first parameter's end varying slowest."""
    return list(product(*zip(low, high, strict=True)))


def corner_weights(at: Sequence[Fraction]) -> list[Fraction]:
    """Return the weights of the corners of the box at a point of it, in the order of `corners`."""
    pairs = ((1 - t, t) for t in at)
    return [math.prod(factors, start=Fraction(1)) for factors in product(*pairs)]
