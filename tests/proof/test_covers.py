"""Every cover holds all delays up to one: exactly, at all frequencies; and at samples."""

import math
from fractions import Fraction

import numpy as np
import pytest

from polefence.proof import intervals
from polefence.proof.covers import COVERS, samples
from polefence.proof.dead_time import _alternating, _positive, _product, _shifted, _square, _sum
from polefence.proof.intervals import enclosing
from polefence.proof.matrices import ZERO

FAR = Fraction(2**14)  # beyond it coefficients say all
THREE, HALF_TURN = Fraction(3), Fraction(201, 64)  # that less than pi


def cover_parts(cover):
    """D, the centre's numerator and M."""
    return cover.D, cover.N or cover.D, cover.M


def on_cell(P, low, high):
    """An interval that holds a polynomial's values from low to high, by its Taylor form there."""
    middle, half = (low + high) / 2, (high - low) / 2
    total = [x * half**k for k, x in enumerate(_shifted(list(P), middle))]
    off = sum(map(abs, total[1:]), ZERO)
    return intervals.hull([enclosing(total[0] - off), enclosing(total[0] + off)])


def is_positive(decide, low, high, most=20_000):
    """Whether a decision on intervals of x holds on all of one, in parts."""
    cells = [(low, high)]
    for _ in range(most):
        if not cells:
            return True
        low, high = cells.pop()
        if not decide(low, high):
            middle = (low + high) / 2
            cells += [(low, middle), (middle, high)]
    return False


def above(P):
    """Whether an even polynomial, of x^2, is positive from FAR on: by its coefficients there."""
    shifted = _shifted(list(P)[::2], FAR**2)
    return min(shifted) >= 0 and shifted[0] > 0


@pytest.mark.parametrize("cover", COVERS)
def test_a_cover_holds_the_arc_of_every_delay(cover):
    D, N, M = cover_parts(cover)
    for P in (D, M) if not cover.N else (D, M, N):  # of N that it is positive at all z > 1 too
        assert np.roots([float(x) for x in P[::-1]]).real.max() < 0 or P is N
        assert min(P) > 0
    for a, b, c, d in (D, M) if cover.N else ():  # Hurwitz, of degree 3
        assert b * c > a * d
    d, n, m = (_alternating(list(P)) for P in (D, N, M))
    energy, centre, radius = (_square(P) for P in (d, n, m))
    apart = _square(tuple(_sum(a, [-x for x in b]) for a, b in zip(d, n, strict=True)))

    # (a) 1 is in the disk: |D - N|^2 < |M|^2
    one = _sum(radius, [-x for x in apart])
    if not cover.N:
        assert not any(apart)
    assert is_positive(lambda low, high: on_cell(one, low, high)[0] > 0, ZERO, FAR)
    assert above(one)

    # (b) all of the circle is: |M|^2 > (|D| + |N|)^2, for |M|^2 > |D|^2 + |N|^2 and the square
    # of the difference more than 4 |D N|^2
    rest = _sum(radius, [-x for x in _sum(energy, centre)])
    square = _sum(_product(rest, rest), [-4 * x for x in _product(energy, centre)])

    def whole(low, high):
        return on_cell(rest, low, high)[0] > 0 and on_cell(square, low, high)[0] > 0

    # (c) exp(-j x) is, and -C = |C| exp(-j y) is not on the arc from 1 to it, x <= y <= x + pi:
    # up to x = 3 for pi <= y <= 3 pi / 2, or for pi / 2 <= y <= 3 pi / 2 and sin(y - x) >= 0, and
    # from there to 2 pi for pi <= y <= 2 pi and the same
    real = _sum(_product(d[0], n[0]), _product(d[1], n[1]))  # of N conj(D)
    imaginary = _sum(_product(d[0], n[1]), [-x for x in _product(d[1], n[0])])

    both = real, [-x for x in imaginary]  # of D conj(N)

    def at_end(low, high):
        return _positive(
            radius, energy, centre, both, intervals.UNIT, (low + high) / 2, (high - low) / 2
        )

    def beside(low, high):
        a, b = on_cell(real, low, high), on_cell(imaginary[1:], low, high)  # of b over x
        if high <= THREE and a[0] >= 0 and b[1] <= 0:
            return True
        x = intervals.hull([enclosing(low), enclosing(high)])
        turned = intervals.times(intervals.cosine(x), intervals.times(b, x))
        ahead = intervals.plus(intervals.times(intervals.sine(x), a), turned)[0] >= 0
        return ahead and (a[0] >= 0 if high <= THREE else low >= THREE and b[1] <= 0)

    def held(low, high):
        if whole(low, high):
            return True
        if high - low > 1 or high > 6:
            return False
        if not cover.N:  # |1 - exp(-j y)| is largest at x, up to half a turn
            return high <= HALF_TURN and at_end(low, high)
        return beside(low, high) and at_end(low, high)

    assert is_positive(held, ZERO, FAR)
    assert above(rest)
    assert above(square)


@pytest.mark.parametrize("cover", COVERS)
@pytest.mark.parametrize(("time", "step"), [("0.3", "0"), ("0.3", "0.02"), ("0.05", "0.04")])
def test_its_states_are_the_disks(cover, time, step):
    """Of late inputs every delay is in the disk of what the states say, at many frequencies."""
    time, step = Fraction(time), Fraction(step)
    late = cover.late(time, step)
    a, b, c = (np.array(M, dtype=float) for M in (late.a, late.b, late.c))
    acting = np.zeros(len(a))
    acting[0] = late.acts
    longest = float(samples(time, step) * step if step else time)
    top = math.pi / float(step) if step else 1e3 / float(time)
    delays = np.linspace(0, longest, samples(time, step) + 1 if step else 60)
    for w in np.geomspace(1e-4 * top, top, 400):
        s = (np.exp(1j * w * float(step)) - 1) / float(step) if step else 1j * w
        x = np.linalg.solve(s * np.eye(len(a)) - a, b[:, 0])
        centre, radius = acting @ x + float(late.straight), abs(c[0] @ x + float(late.d))
        assert np.abs(np.exp(-1j * w * delays) - centre).max() <= radius
    assert np.linalg.eigvals(np.eye(len(a)) + float(step) * a if step else a).real.max() < 1
    assert late.straight >= 0
