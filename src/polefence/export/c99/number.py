"""The numbers of a target: float32 or float64 of IEEE 754, rounding to nearest."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.system import Array


@dataclass(frozen=True)
class Number:
    """One of the two formats.

    Attributes
    ----------
    bits : int
        32 or 64.
    unit : Fraction
        Unit roundoff, the largest relative error of one operation.
    """

    bits: int
    unit: Fraction

    @property
    def c_type(self) -> str:
        """The type in C."""
        return "float" if self.bits == 32 else "double"

    @property
    def largest(self) -> str:
        """The macro of <float.h> with the largest finite number."""
        return "FLT_MAX" if self.bits == 32 else "DBL_MAX"

    def nearest(self, values: Array) -> Array:
        """Return the nearest numbers of the format, as doubles, which hold both."""
        if self.bits == 64:
            return np.asarray(values, dtype=float)
        with np.errstate(over="ignore"):
            return np.asarray(values, dtype=np.float32).astype(float)

    def outward(self, value: Fraction, up: bool) -> float:
        """Return the nearest number of the format that is not below (not above) a rational."""
        found = float(self.nearest(np.array(float(value))))
        wrong = Fraction(found) < value if up else Fraction(found) > value
        if not wrong:
            return found
        towards = np.inf if up else -np.inf
        if self.bits == 32:
            return float(np.nextafter(np.float32(found), np.float32(towards)))
        return float(np.nextafter(found, towards))

    def text(self, value: float) -> str:
        """Write a number as a C constant that reads back as the same number."""
        digits = f"{value:.9g}" if self.bits == 32 else repr(float(value))
        if not any(c in digits for c in ".e"):
            digits += ".0"
        return digits + ("F" if self.bits == 32 else "")


NUMBERS = {32: Number(32, Fraction(1, 2**24)), 64: Number(64, Fraction(1, 2**53))}


def number(bits: int) -> Number:
    """Return the format of so many bits.

    Raises
    ------
    InputError
        If it is neither 32 nor 64.
    """
    if bits not in NUMBERS:
        raise InputError(f"float = {bits!r} is no format of the export; use 32 or 64")
    return NUMBERS[bits]
