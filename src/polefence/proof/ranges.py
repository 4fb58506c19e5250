"""Parameters' intervals."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
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
