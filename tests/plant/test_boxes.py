"""Parts of a box: their points and polynomials, and how it is divided."""

from fractions import Fraction
from math import prod

import numpy as np
import pytest

from polefence.plant.boxes import Box, divided, widest
from polefence.plant.polynomial import Domain, bernstein

DOMAIN = Domain((2, 2))


def at(P, coordinates):
    return sum(np.prod(np.power(coordinates, e)) * p for e, p in P.items())


def test_a_polynomial_in_a_part_is_the_same_polynomial():
    random = np.random.default_rng(0)
    box = Box((0.125, 0.5), (0.75, 1.0))
    P = bernstein(DOMAIN, random.normal(size=(DOMAIN.count(3), 2, 3)), 3)
    own = box.polynomial(P, DOMAIN)
    for t in random.random((5, 2)):
        inner = np.array([1 - t[0], t[0], 1 - t[1], t[1]])
        x, y = np.array(box.low) + (np.array(box.high) - np.array(box.low)) * t
        np.testing.assert_allclose(at(own, inner), at(P, [1 - x, x, 1 - y, y]), atol=1e-12)
        alpha = box.alpha(DOMAIN, DOMAIN.alpha(inner))
        np.testing.assert_allclose(alpha, DOMAIN.alpha(np.array([1 - x, x, 1 - y, y])), atol=1e-15)


def small(box, size=0.25):
    """Whether a part is small, or away from the corner at (0, 0)."""
    return True if max(box.high) <= size or max(box.low) >= size else None


def longest(box):
    sides = [b - a for a, b in zip(box.low, box.high, strict=True)]
    return sides.index(max(sides))


def test_the_parts_make_up_the_box():
    parts = divided([Box.whole(DOMAIN)], small, longest)
    sides = [
        [(Fraction(a), Fraction(b)) for a, b in zip(box.low, box.high, strict=True)]
        for box, _ in parts
    ]
    assert sum(prod(b - a for a, b in own) for own in sides) == 1
    for i, one in enumerate(sides):
        for other in sides[:i]:
            assert any(b <= c or d <= a for (a, b), (c, d) in zip(one, other, strict=True))
    assert 1 < len(parts) < 20
    most = len(parts)
    assert divided([Box.whole(DOMAIN)], small, longest, most) == parts
    assert divided([Box.whole(DOMAIN)], small, longest, most - 1) is None
    assert divided([Box.whole(DOMAIN)], small, lambda _: None) is None


@pytest.mark.parametrize("k", [0, 1])
def test_it_is_halved_along_what_changes_the_loop_most(k):
    def loops(alpha):
        t = DOMAIN.coordinates(alpha)[:, 1::2]
        rate = 1 + t[:, k] + 0.1 * t[:, 1 - k]
        return -rate[:, None, None] * np.eye(2)

    assert widest(DOMAIN, loops, lambda poles: -poles.real) == k


@pytest.mark.parametrize("k", [0, 1])
def test_a_slow_pole_that_comes_near_the_edge_counts_more_than_a_fast_one_that_moves(k):
    """From -0.1 to -0.01 beside one from -1000 to -600: what a Lyapunov matrix follows."""

    def loops(alpha):
        t = DOMAIN.coordinates(alpha)[:, 1::2]
        poles = np.stack([-0.1 + 0.09 * t[:, k], -1000 + 400 * t[:, 1 - k]], axis=-1)
        return poles[:, :, None] * np.eye(2)

    assert widest(DOMAIN, loops, lambda poles: -poles.real) == k
