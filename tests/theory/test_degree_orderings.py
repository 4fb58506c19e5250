"""Radii of any degree: what theory orders, the quarter car's table, and Clarabel from below."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import comb

import numpy as np
import pytest

from polefence import Parameter, UncertainPlant, check, tightest
from polefence.lmi.conditions.methods import Scheduled, Slack, build
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import lyapunov_mean
from polefence.lmi.solve.smallest import smallest
from polefence.plant.polynomial import Domain
from support.margin import largest_margin

CENTRE = -3.0
FLOOR = 1e-3 * -CENTRE  # searches stop there
CHAINS = [[(1, 0), (1, 1), (2, 0)], [(1, 1), (1, 2), (2, 1), (3, 0)], [(2, 0), (2, 1), (3, 0)]]
FORMS = [(1, 0), (1, 1), (2, 0), (1, 2), (2, 1), (3, 0)]


def family(seed, n, m):
    """A random pair's neighbours, as the corners of a box of two parameters."""
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    As = [A + 0.3 * random.normal(size=(n, n)) for _ in range(4)]
    Bs = [B + 0.3 * random.normal(size=(n, m)) for _ in range(4)]
    box = (Parameter("p", 0, 1), Parameter("q", 0, 1))
    return replace(UncertainPlant.from_vertices(As, Bs), parameters=box)


def radius(plant, method):
    design = tightest(plant, CENTRE, method)
    assert design.proved
    return max(design.region.radius, FLOOR)


def below(smaller, larger):
    return smaller <= larger * (1 + 2e-6)


@pytest.mark.parametrize(("seed", "n", "m"), [(0, 1, 1), (4, 2, 1)])
def test_orderings_that_theory_implies(seed, n, m):
    """What solves one condition, elevated, solves the next, with the same blocks or sums of them.

    - (g, d + 1) is (g, d) times the sum of alpha: its coefficients are sums of positive ones.
    - (g + 1, d): W and Z times the sum of alpha turn the blocks of (g, d + 1) into those of it.
    - quadratic is (0, 0), and (0, d) the same, so that all follow from it.
    - The box: a polynomial of degree g in alpha is, at products, one of degree g in each
      parameter's coordinates, and (sum of alpha)^d is the product of the parameters' own sums to
      the d. Every monomial in alpha becomes one of the box's, and every one of the box's comes of
      some: each of its coefficients is a sum of one or more of the simplex's. So a solution on the
      simplex is one on the box, and the radius there is no larger.
    """
    plant = family(seed, n, m)
    r = {
        (on, g, d): radius(plant, Scheduled(g, d, on))
        for on in ("simplex", "box")
        for g, d in FORMS
    }
    quadratic = radius(plant, "quadratic")
    for on in ("simplex", "box"):
        assert all(below(r[on, g, d], quadratic) for g, d in FORMS)
        for chain in CHAINS:
            for wide, narrow in pairwise(chain):
                assert below(r[(on, *narrow)], r[(on, *wide)]), (on, narrow, wide)
    assert all(below(r["box", g, d], r["simplex", g, d]) for g, d in FORMS)
    # strictly, somewhere: none of this is an accident of equal numbers
    assert r["box", 2, 0] < 0.999 * quadratic


@pytest.mark.parametrize(("seed", "n", "m"), [(4, 2, 1), (5, 3, 2)])
def test_orderings_of_the_slack_condition(seed, n, m):
    """P = G = W is a point of it; with P constant it is no more than that (Schur complement)."""
    plant = family(seed, n, m)
    quadratic = radius(plant, "quadratic")
    r = {(g, d, on): radius(plant, Slack(g, d, on)) for g, d, on in SLACK}
    assert r[0, 0, "simplex"] == pytest.approx(quadratic, rel=2e-6)
    assert below(r[1, 0, "simplex"], quadratic)
    assert r[1, 0, "simplex"] < 0.999 * quadratic
    assert below(r[1, 1, "simplex"], r[1, 0, "simplex"])
    assert below(r[2, 0, "simplex"], r[1, 1, "simplex"])
    assert below(r[1, 0, "box"], r[1, 0, "simplex"])
    assert below(r[2, 0, "box"], r[1, 0, "box"])


SLACK = [(0, 0, "simplex"), (1, 0, "simplex"), (1, 1, "simplex"), (2, 0, "simplex")]
SLACK += [(1, 0, "box"), (2, 0, "box")]


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_the_box_never_needs_more_blocks(p):
    """(g + d + 2)^p against the monomials of N = 2^p variables, equal for one parameter."""
    N = 2**p
    for g, d in [(0, 0), *FORMS]:
        box, simplex = (Domain.of(on, N).count(g + d + 1) for on in ("box", "simplex"))
        assert box == (g + d + 2) ** p
        assert simplex == comb(N + g + d, g + d + 1)
        assert (box < simplex) == (p > 1 and (g, d) != (0, 0))
        assert box <= simplex


# Smallest disks at centre -40, no larger than these; rounded up from what was measured.
TABLE = {
    ("as_printed", "simplex", 1, 0): 29.19,
    ("as_printed", "simplex", 1, 1): 29.0992,
    ("as_printed", "simplex", 1, 2): 29.07,
    ("as_printed", "simplex", 2, 0): 27.23,
    ("as_printed", "simplex", 2, 1): 26.64,
    ("as_printed", "simplex", 3, 0): 26.61,
    ("physical", "box", 1, 0): 29.18,
    ("physical", "box", 1, 1): 29.05,
    ("physical", "box", 2, 0): 27.22,
    ("physical", "box", 2, 1): 26.63,
}
CLARABEL = [("as_printed", "simplex", 1, 0), ("physical", "box", 2, 0)]


@pytest.mark.parametrize(("name", "on", "g", "d"), TABLE)
def test_the_car_at_centre_40(name, on, g, d, request):
    plant = request.getfixturevalue(name)
    design = tightest(plant, -40, Scheduled(g, d, on))
    assert check(design).proved
    assert design.region.radius <= TABLE[name, on, g, d]
    # a bound would show a table that is too good: 2 % below nothing of the kind was ever seen
    assert design.region.radius > 0.98 * TABLE[name, on, g, d]
    alpha = Domain.of(on, 4)
    points = np.random.default_rng(0).dirichlet(np.ones(2), (200, 2)).reshape(200, 4)
    points = points if on == "box" else np.random.default_rng(0).dirichlet(np.ones(4), 200)
    poles = design.poles(alpha.alpha(points))
    assert np.abs(poles + 40).max() < design.region.radius


@pytest.mark.parametrize(("name", "on", "g", "d"), CLARABEL)
def test_clarabel_finds_nothing_below(name, on, g, d, request):
    """0.3 % below no point, 0.3 % above one, in the coordinates of the answer."""
    plant, method = request.getfixturevalue(name), Scheduled(g, d, on)
    found = smallest(plant.A, plant.B, Disks(-40.0), method)
    scaling = balanced(plant.A, plant.B, 40.0).refined(lyapunov_mean(found.values))
    A, B = scaling.apply(plant.A, plant.B)
    pencil = build(method, A, B, 40.0 / scaling.rate)
    below, above = (
        largest_margin(pencil, found.r * side / scaling.rate) for side in (0.997, 1.003)
    )
    assert below.optimal
    assert below.t < -1e-7
    assert above.t > 1e-7
