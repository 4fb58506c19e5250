"""Parameters' intervals, and the corners of parts of their box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Literal

from polefence.proof.short import Short

ANY: Literal["any"] = "any"  # of a rate: nothing bounds it


@dataclass(frozen=True)
class Range(Short):
    """A parameter's interval; ``inverted`` where the plant is affine in 1/p.

    ``rate`` holds the least and the largest dp/dt, or "any"; None of one that does not move.
    """

    low: Fraction
    high: Fraction
    inverted: bool = False
    name: str = ""
    unit: str = ""
    label: str = ""
    rate: tuple[Fraction, Fraction] | Literal["any"] | None = None


def corners(low: Sequence[Fraction], high: Sequence[Fraction]) -> list[tuple[Fraction, ...]]:
    """Return the corners of a part of the box, the first parameter's end varying slowest."""
    return list(product(*zip(low, high, strict=True)))


def corner_weights(at: Sequence[Fraction]) -> list[Fraction]:
    """Return the weights of the corners of the box at a point of it, in the order of `corners`."""
    pairs = ((1 - t, t) for t in at)
    return [math.prod(factors, start=Fraction(1)) for factors in product(*pairs)]
