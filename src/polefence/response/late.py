"""How late an input acts, in samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, PlantError
from polefence.plant.parameters import exact
from polefence.proof.between import MAX_DELAY


@dataclass(frozen=True)
class Late:
    """So many samples late, a whole number of them or not."""

    samples: Fraction

    @classmethod
    def by(cls, delay: Any) -> Late:
        """Return a delay as it reads: 0.3, not the double next to it.

        Raises
        ------
        InputError
            If it is no number, negative or too long.
        """
        try:
            late = exact(delay, "delay")
        except PlantError as error:
            raise InputError(f"delay = {delay!r} must be a number of samples") from error
        if isinstance(delay, float):
            late = Fraction(repr(float(delay)))  # a double of NumPy writes its type too
        if not 0 <= late <= MAX_DELAY:
            raise InputError(f"delay = {delay!r} must be 0 to {MAX_DELAY}, in samples")
        return cls(late)

    def after(self, dead_time: Fraction) -> Late:
        """Return it with a dead time of the plant, in samples, on top.

        Raises
        ------
        InputError
            If that is too long.
        """
        late = self.samples + dead_time
        if late > MAX_DELAY:
            raise InputError(
                f"an input acts {float(late):.4g} samples late; at most {MAX_DELAY} are provided "
                "for: take a longer sample time"
            )
        return Late(late)

    @property
    def whole(self) -> int:
        """The same rounded up: how many inputs are on their way."""
        return math.ceil(self.samples)

    @property
    def early(self) -> Fraction:
        """By how much less that is."""
        return self.whole - self.samples
