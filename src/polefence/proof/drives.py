"""What drives a motion over time: numbers w(t), as Chebyshev polynomials on each step.

A bump of height H is, for u = (t - begin) / T from 0 to 1,

    h = H / 2 (1 - cos 2 pi u),      h' = (pi H / T) sin 2 pi u,

and zero before and after. On a step with the middle u0, and s from -1 to 1, the angle is
2 pi u0 + kappa s with kappa = pi times the length of the step over T. So with f = h or h', as a
function of the angle,

    w = the sum over k up to m of f^(k)(2 pi u0) kappa^k / k! s^k,

but for |f^(m + 1)| kappa^(m + 1) / (m + 1)!. How far numbers are rounded comes to that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from polefence.proof import intervals
from polefence.proof.intervals import Interval, enclosing
from polefence.proof.short import Short
from polefence.proof.work import FormatError, spend

# Coefficients of T_0 on, over 2^bits; and how far w is off.
Driven = tuple[tuple[int, ...], Fraction]

ZERO = Fraction(0)
NOTHING: Driven = ((), ZERO)


class Drive:
    """A number w(t)."""

    rests: bool = False  # whether it becomes zero

    @property
    def turn(self) -> Fraction | None:
        """How long a turn of it takes [s]; None where it does not turn."""
        return None

    @property
    def changes(self) -> tuple[Fraction, ...]:
        """Times at which a step has to end [s]."""
        return ()

    def on(self, begin: Fraction, end: Fraction, terms: int, bits: int) -> Driven:
        """Return w on a step, of Chebyshev polynomials up to T_``terms``."""
        raise NotImplementedError


@dataclass(frozen=True)
class Constant(Short, Drive):
    """One, for ever."""

    def on(self, begin: Fraction, end: Fraction, terms: int, bits: int) -> Driven:  # noqa: ARG002
        """Return one."""
        return (1 << bits,), ZERO


@dataclass(frozen=True)
class Bump(Short, Drive):
    """The height of a bump, or its rate.

    Attributes
    ----------
    height, begin, duration : Fraction
        [m], [s] and [s].
    is_rate : bool
    """

    height: Fraction
    begin: Fraction
    duration: Fraction
    is_rate: bool

    rests = True

    @property
    def turn(self) -> Fraction:
        """It is one."""
        return self.duration

    @property
    def changes(self) -> tuple[Fraction, ...]:
        """When it begins and ends."""
        return (self.begin, self.begin + self.duration)

    def on(self, begin: Fraction, end: Fraction, terms: int, bits: int) -> Driven:
        """Return w on a step that is inside of the bump, or outside.

        Raises
        ------
        FormatError
            If the bump begins or ends inside of the step.
        """
        first, last = self.changes
        if end <= first or begin >= last:
            return NOTHING
        if begin < first or end > last:
            raise FormatError("the steps have no end where a bump begins or ends")
        spend(40 * terms * terms, 256, 256)
        twice = intervals.plus(intervals.pi(), intervals.pi())
        middle = ((begin + end) / 2 - first) / self.duration
        angle = intervals.times(twice, enclosing(middle))
        kappa = intervals.times(intervals.pi(), enclosing((end - begin) / self.duration))
        size, waves = self._waves(angle)
        powers, off = list[Fraction](), ZERO
        power = size
        for k in range(terms + 1):
            wave = waves[k % 4]
            if not k and not self.is_rate:
                wave = intervals.plus(intervals.UNIT, wave)  # 1 - cos
            term = intervals.times(power, wave)
            powers.append(intervals.middle(term))
            off += Fraction(term[1] - term[0], 2 * intervals.ONE)
            power = intervals.times(power, intervals.times(kappa, enclosing(Fraction(1, k + 1))))
        off += intervals.size(power)
        whole = [(x * 2**bits).__floor__() for x in _in_chebyshev(powers)]
        return tuple(whole), off + Fraction(len(whole), 2**bits)

    def _waves(self, angle: Interval) -> tuple[Interval, list[Interval]]:
        """Return how large it is, and its derivatives to the angle, which repeat after four."""
        sine, cosine = intervals.sine(angle), intervals.cosine(angle)
        less = [intervals.negative(x) for x in (sine, cosine)]
        half = enclosing(self.height / 2)
        if not self.is_rate:  # of 1 - cos, whose own value is one more than -cos
            return half, [less[1], sine, cosine, less[0]]
        rate = intervals.times(half, enclosing(2 / self.duration))
        return intervals.times(rate, intervals.pi()), [sine, cosine, less[0], less[1]]


def _in_chebyshev(powers: Sequence[Fraction]) -> list[Fraction]:
    """Return the coefficients of T_k of those of s^k."""
    total = [ZERO] * len(powers)
    for k, x in enumerate(powers):
        for j in range(k // 2 + 1):
            # s^k = 2^(1 - k) times the sum of C(k, j) T_(k - 2 j), half of it of T_0
            half = 2 if k == 2 * j else 1
            total[k - 2 * j] += x * math.comb(k, j) / 2 ** (k - 1) / half if k else x
    return total
