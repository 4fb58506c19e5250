"""Grids of the box: where they are cut, which coefficients their cells share."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from polefence.lmi.solve.grids import cells_of, count_of, cut_finer, finer, nodes_of, whole_box
from polefence.plant.polynomial import Domain
from polefence.plant.spec import loads

SPEC = """
[parameter.m]
range = [2, 6]
through = "1/m"
[parameter.q]
range = [0, 1]
[table.spring]
arguments = [1, 3, 4, 7]
values = [5, 6, 8, 9]
[table.soft]
arguments = [0, 9]
values = [1, 2]
[matrices]
A = [[0, 1], ["-spring(m)/m - soft(q*m)", "-1 - q"]]
B = [[0], [1]]
"""


def test_knots_of_a_parameter_are_cuts_exactly():
    plant = loads(SPEC)
    m, q = finer(plant, {0}, 3)
    assert q == (0, 1)
    places = [(Fraction(1, 2) - Fraction(1, x)) / (Fraction(1, 2) - Fraction(1, 6)) for x in (3, 4)]
    assert set(places) < set(m)  # those of soft are of q m, and none of a parameter
    assert max(b - a for a, b in pairwise(m)) <= Fraction(1, 3)
    assert count_of(whole_box(plant)) == 1


@pytest.mark.parametrize("count", [1, 2, 5])
def test_an_interval_is_cut_finer(count):
    cuts = cut_finer((Fraction(0), Fraction(1, 7), Fraction(1)), count)
    assert {0, Fraction(1, 7), 1} <= set(cuts)
    assert list(cuts) == sorted(set(cuts))
    assert all(b - a <= Fraction(1, count) for a, b in pairwise(cuts))


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_cells_make_up_the_box_and_share_what_is_on_their_faces(degree):
    """A polynomial of each variable alone has the same coefficients from either side."""
    cuts = ((Fraction(0), Fraction(1, 3), Fraction(1)), (Fraction(0), Fraction(1, 2), Fraction(1)))
    domain, seen, volume = Domain.of("box", 4), {}, Fraction(0)
    for (low, high), places in cells_of(cuts, degree, domain):
        volume += (high[0] - low[0]) * (high[1] - low[1])
        alpha = domain.nodes(degree)
        shares = alpha[:, 2] + alpha[:, 3], alpha[:, 1] + alpha[:, 3]
        ends = zip(low, high, shares, strict=True)
        x, y = (float(a) + float(b - a) * share for a, b, share in ends)
        values = np.where(x <= 1 / 3, x, 5 * x - 4 / 3) + 2 * y  # continuous, linear in cells
        for place, value in zip(places, domain.interpolated(values, degree), strict=True):
            assert seen.setdefault(place, value) == pytest.approx(value, abs=1e-12)
    assert volume == 1
    assert len(seen) == np.prod(nodes_of(cuts, degree))
