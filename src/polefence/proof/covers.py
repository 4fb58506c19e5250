"""Disks that hold exp(-s t) of all delays t up to one, at each frequency.

In s times the longest delay, a cover has polynomials D, N and M without zeros to the right, and for
all x > 0 and y from 0 to x

    |exp(-j y) - N(j x) / D(j x)| <= |M(j x) / D(j x)|.

So delta = (exp(-s t) D - N) / M is stable and of gain at most one. A disk holds the arc of the unit
circle from 1 to exp(-j x) if it holds both ends, and the point opposite to its centre, -C / |C|, is
not on the arc; it holds the circle if its radius is 1 + |C|. Both are decided by polynomials, sines
and cosines of x alone: ``tests/proof/test_covers.py`` proves them of each cover, in intervals.

The first has its centre at one, the others at N / D: a disk whose edge goes through 1 and exp(-j x)
may lean, and which one is best depends on how far the loop's phase is from -180 degrees.

Of samples, x is t / T times 2 tan(w T / 2), w the frequency: that is no less than w t, and the arc
of a smaller x is a part of that of a larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.filters import Filter
from polefence.proof.matrices import ONE, ZERO, Rationals, identity, inverse, product
from polefence.proof.short import Short


@dataclass(frozen=True)
class Cover(Short):
    """Coefficients of D, N and M, that of the constant first; D's last is one.

    Without N the centre is one.
    """

    D: tuple[Fraction, ...]
    N: tuple[Fraction, ...]
    M: tuple[Fraction, ...]

    @property
    def states(self) -> int:
        """Degree of D."""
        return len(self.D) - 1

    def late(self, time: Fraction, step: Fraction) -> Late:
        """Return the states of an input that is late by up to a time [s], or by samples up to it.

        Parameters
        ----------
        step : Fraction
            The sample time [s]; zero in continuous time.
        """
        n, time = self.states, _whole(time, step)
        a = [[ONE / time if j == i + 1 else ZERO for j in range(n)] for i in range(n - 1)]
        a.append([-x / time for x in self.D[:-1]])
        b: Rationals = [[ONE / time if i == n - 1 else ZERO] for i in range(n)]
        centre: Rationals = [list(self.N) or [ZERO] * n]
        gain = self.M[-1]
        radius: Rationals = [[x - gain * y for x, y in zip(self.M, self.D[:-1], strict=False)]]
        straight = ZERO if self.N else ONE
        if step:  # s = z / (1 + step z / 2), z the delta operator
            moved = [[(i == j) - step / 2 * x for j, x in enumerate(r)] for i, r in enumerate(a)]
            Q = inverse(moved, "a cover")
            a, b = product(Q, a), product(Q, b)
            gain += step / 2 * product(radius, b)[0][0]
            straight += step / 2 * product(centre, b)[0][0]
            centre, radius = product(centre, Q), product(radius, Q)
        if self.N:  # so that the first state is what acts
            T = [centre[0], *identity(n)[1:]]
            back = inverse(T, "a cover")
            a, b, radius = product(product(T, a), back), product(T, b), product(radius, back)
        return Late(a, b, radius, gain, straight, bool(self.N))


@dataclass(frozen=True)
class Late(Short):
    """z' = a z + b u; what acts is straight u, and z1 if that does, and delta (c z + d u)."""

    a: Rationals
    b: Rationals
    c: Rationals
    d: Fraction
    straight: Fraction
    acts: bool

    def filter(self, level: Fraction) -> Filter:
        """Return c z + d u times a level."""
        return Filter(self.a, self.b, [[level * x for x in self.c[0]]], "late", level * self.d)

    def put(self, row: Sequence[Fraction], n: int, i: int) -> tuple[Fraction, ...]:
        """Return a row of the plant, of n states, with what acts in place of column i."""
        moved = list(row)
        moved[n] += row[i] if self.acts else ZERO
        moved[i] = row[i] * self.straight
        return tuple(moved)


def samples(time: Fraction, step: Fraction) -> int:
    """Return how many samples a time is at least."""
    return int(time / step)


def _whole(time: Fraction, step: Fraction) -> Fraction:
    return samples(time, step) * step if step else time


def _numbers(*digits: str) -> tuple[Fraction, ...]:
    return tuple(map(Fraction, digits))


COVERS = (
    Cover(_numbers("6.1182", "4.1581", "1"), (), _numbers("0.0060885", "6.1219", "2.0009")),
    # of loops that roll off, of phase margins about 35, 55 and 80 degrees
    Cover(
        _numbers("84.518", "43.984", "11.043", "1"),
        _numbers("86.39", "1.7979", "29.15"),
        _numbers("1.8728", "42.869", "30.702", "8.7777"),
    ),
    Cover(
        _numbers("155.87", "78.519", "22.058", "1"),
        _numbers("171.4", "2.4945", "72.027"),
        _numbers("15.694", "85.63", "73.467", "26.599"),
    ),
    Cover(
        _numbers("96.915", "48.1", "17.948", "1"),
        _numbers("85.696", "3.312", "21.887"),
        _numbers("21.435", "58.564", "28.563", "10.724"),
    ),
    # of others
    Cover(
        _numbers("41.722", "26.523", "5.9887", "1"),
        _numbers("39.957", "2.498", "1.8087"),
        _numbers("1.7656", "24.382", "4.9289", "1.2376"),
    ),
    Cover(
        _numbers("40.439", "26.602", "5.7209", "1"),
        _numbers("28.027", "1.6416", "1.1665"),
        _numbers("12.417", "25.438", "5.0293", "1.1469"),
    ),
)
