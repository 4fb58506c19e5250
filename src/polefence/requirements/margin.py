"""Margins: what is bounded is 1 over a number that people read, and want to be large."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.proof.text import digits_down, digits_up
from polefence.requirements.specification import Specification, is_number


@dataclass(frozen=True)
class Margin(Specification):
    """A requirement whose level is 1 over a margin; `at_most` of 1 over it is `at_least` of it."""

    is_margin: ClassVar[bool] = True

    @property
    def limit(self) -> float | None:
        """The least margin, in the fewest digits that read back as it is."""
        if self.at_most is None:
            return None
        near = float(f"{1 / self.at_most:.15g}")
        return near if inverse(Fraction(repr(near))) == self.at_most else 1 / self.at_most

    def read_as(self, level: float) -> float:
        """Return the margin."""
        return 1 / level if level else np.inf

    def proved_text(self, level: float) -> str:
        """Return a proved margin, rounded down."""
        return digits_down(1 / Fraction(level)) if level else "inf"

    def sampled_text(self, level: float) -> str:
        """Return a sampled margin, rounded up."""
        return digits_up(1 / Fraction(level)) if 0 < level < np.inf else f"{self.read_as(level):g}"

    def unit(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Return none."""
        return ""


def level_of(at_least: float | None) -> float | None:
    """Return 1 over a limit; None where there is none.

    Raises
    ------
    InputError
        If it is no positive number.
    """
    if at_least is None:
        return None
    if not (is_number(at_least) and at_least > 0):
        raise InputError(f"at_least = {at_least!r} must be a positive number")
    return inverse(Fraction(repr(at_least)))


def inverse(margin: Fraction) -> float:
    """Return the largest double that is no more than 1 over a margin."""
    level = float(1 / margin)
    return level if Fraction(level) * margin <= 1 else math.nextafter(level, 0.0)
