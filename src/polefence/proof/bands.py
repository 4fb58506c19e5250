r"""Bands of frequency: where their ends are in a transfer function, in rationals.

A frequency f [Hz] is s = j w with w = 2 pi f; of samples every T, z = exp(2 pi j f T), after the
bilinear map of `proof.transfer` at w = 2 tan(pi f T) / T, which is infinite at f = 1 / (2 T).
Neither is rational. What is proved between ends that are rounded outwards is of a band at least as
wide, and what is shown at a frequency within ends that are rounded inwards is in the band itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from polefence.proof import intervals
from polefence.proof.intervals import FINE, Interval
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up
from polefence.proof.transfer import Ends
from polefence.proof.work import FormatError

DIGITS = 48  # bits that rounded ends have
HIGHEST = Fraction(10) ** 9  # [Hz]


@dataclass(frozen=True)
class Band(Short):
    """All frequencies from ``low`` to ``high`` [Hz], both among them."""

    low: Fraction
    high: Fraction

    @classmethod
    def of(cls, ends: Sequence[Fraction]) -> Band:
        """Return the band between two numbers.

        Raises
        ------
        FormatError
            If they are no band, or none is left where its ends are rounded into it to be printed.
        """
        if len(ends) != 2 or not 0 <= ends[0] < ends[1] <= HIGHEST:
            raise FormatError("band must hold two numbers, 0 <= low < high, in Hz")
        if Fraction(digits_up(ends[0])) >= Fraction(digits_down(ends[1])):
            raise FormatError("band: its ends must differ in six digits")
        return cls(*ends)

    def require(self, step: Fraction) -> None:
        """Refuse a band beyond what samples so far apart have; zero in continuous time."""
        if step and 2 * self.high * step > 1:
            raise FormatError("band: samples every T have no frequency above 1 / (2 T)")

    def outside(self, step: Fraction) -> Ends:
        """Return ends in w, rounded outwards.

        Raises
        ------
        FormatError
            If they are too large to be told.
        """
        low, high = _frequency(self.low, step), _frequency(self.high, step)
        if low is None:
            raise FormatError("band: its lower end is too near to half the sample rate")
        return _short(low[0], up=False), None if high is None else _short(high[1], up=True)

    def inside(self, step: Fraction) -> Ends | None:
        """Return ends in w, rounded inwards; None where nothing is left between them."""
        low, high = _frequency(self.low, step), _frequency(self.high, step)
        if low is None:
            return None
        first = _short(low[1], up=True) if self.low else Fraction(0)
        last = None if high is None else _short(high[0], up=False)
        # near half the sample rate it is infinite, or too large to be told
        if last is None and 2 * self.high * step != 1:
            return None
        return (first, last) if last is None or first <= last else None

    @property
    def text(self) -> str:
        """The band in words, each end rounded into it."""
        return f"from {digits_up(self.low)} to {digits_down(self.high)} Hz"


def _frequency(f: Fraction, step: Fraction) -> Interval | None:
    """Return w at a frequency; None where that is infinite, or may be."""
    if not step:
        return intervals.times(intervals.pi(), intervals.enclosing(2 * f))
    if 2 * f * step >= 1:
        return None
    angle = intervals.times(intervals.pi(), intervals.enclosing(f * step))
    below = intervals.cosine(angle)
    if below[0] <= 0:
        return None
    tangent = intervals.times(intervals.sine(angle), intervals.inverse(below))
    return intervals.times(tangent, intervals.enclosing(2 / step))


def _short(x: int, *, up: bool) -> Fraction:
    """Return a whole multiple of 2^-FINE that is rounded to a few digits, zero at least."""
    x = max(x, 0)
    more = max(0, x.bit_length() - DIGITS)
    rounded = -(-x >> more) if up else x >> more
    return Fraction(rounded << more, 1 << FINE)
