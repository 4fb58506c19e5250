"""Half-planes and sectors: exact answers for scalars, Clarabel on both sides, and orderings."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from polefence import Disk, NotProvedError, UncertainPlant, check, place, tightest
from polefence.lmi.conditions.methods import Scheduled, Slack, build
from polefence.lmi.conditions.target import Around, Decays, Sectors
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.smallest import smallest
from polefence.region.regions import Ellipse, HalfPlane, HorizontalStrip, Sector, VerticalStrip
from support.margin import largest_margin

WITHIN = Disk(-3, 2.9)
METHODS = ["quadratic", "scheduled", Scheduled(2, 0)]


def scalar(a, b):
    return UncertainPlant.from_vertices([[[v]] for v in a], [[[v]] for v in b])


@pytest.mark.parametrize("a", [(-1, 3), (0.5, 0.75), (-4, -1)])
def test_the_largest_decay_rate_of_a_scalar_plant(a):
    """x' = a x + u: one gain shifts the poles' interval, to the left end of what holds them."""
    length = a[1] - a[0]
    for within, left in ((Disk(-3, 2.9), -5.9), (VerticalStrip(-7, -0.5), -7)):
        design = tightest(scalar(a, (1, 1)), method="quadratic", of="half_plane", within=within)
        decay = design.region.parts[0].decay
        assert check(design).proved
        assert (-left - length) * (1 - 2e-3) <= decay < -left - length
        # a gain scheduled on a leaves no interval
        design = tightest(scalar(a, (1, 1)), of="half_plane", within=within)
        assert -left * (1 - 2e-3) <= design.region.parts[0].decay < -left


def test_the_largest_damping_of_a_known_plant():
    """An oscillator without doubt about it: one gain makes its poles real, and damping 1."""
    A, B = [[0, 2], [-2, 0]], [[1], [1]]
    plant = UncertainPlant.from_vertices([A, A], [B, B])
    design = tightest(plant, method="quadratic", of="sector", within=WITHIN)
    assert design.region.parts[0].damping > 0.999


def family(seed, n, m, N):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    As, Bs = ([X + 0.2 * random.normal(size=X.shape) for _ in range(N)] for X in (A, B))
    return UncertainPlant.from_vertices(As, Bs)


def value(design):
    part = design.region.parts[0]
    return part.decay if part.kind == "half_plane" else part.slope


@pytest.mark.parametrize("of", ["half_plane", "sector"])
@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("seed", [4, 9])
def test_clarabel_brackets_the_optimum(seed, method, of):
    """A point 1 % inside, none 1 % beyond, in the coordinates of the answer's mean W."""
    plant = family(seed, 3, 1, 2)
    design = tightest(plant, method=method, of=of, within=WITHIN)
    assert check(design).proved
    assert design.region.parts[1:] == (WITHIN,)
    reached = value(design)
    if of == "sector" and reached < 1e-3:  # real poles: no frequency to bound
        return
    W = design.certificate.evidence["W"] if design.law.W is None else design.law.W.mean(axis=0)
    scaling = balanced(plant.A, plant.B, 3.0).refined(W)
    A, B = scaling.apply(plant.A, plant.B)
    margins = []
    for side in (0.99, 1.01):
        goal = Decays(30.0, WITHIN) if of == "half_plane" else Sectors(3.0, WITHIN)
        r = (30.0 - side * reached) / scaling.rate if of == "half_plane" else reached / side
        margins.append(largest_margin(build(method, A, B, goal.target(scaling.rate)), r))
    assert margins[1].optimal
    assert margins[0].t > 1e-7
    assert margins[1].t < -1e-7


NESTED = [WITHIN & HorizontalStrip(1), WITHIN, Disk(-3.02, 2.96)]
CLOSE = 1e-3  # of a decay rate; slopes that are smaller than this are as good as zero


@pytest.mark.parametrize("of", ["half_plane", "sector"])
def test_orderings(of):
    """Larger regions allow at least as much; so do higher degrees."""
    plant = family(4, 3, 1, 2)
    sign = 1 if of == "half_plane" else -1  # a smaller slope is more damping
    r = {
        (method, within): sign * value(tightest(plant, method=method, of=of, within=within))
        for method in METHODS
        for within in NESTED
    }
    for within in NESTED:
        for higher in METHODS[1:]:
            low, high = r["quadratic", within], r[higher, within]
            assert low <= high + CLOSE * max(abs(low), 1)
    for method in METHODS:
        for narrow, wide in pairwise(r[method, within] for within in NESTED):
            assert narrow <= wide + CLOSE * max(abs(narrow), 1)


def test_what_tightest_finds_place_finds_too():
    plant = family(4, 3, 1, 2)
    for of in ("half_plane", "sector"):
        best = tightest(plant, method="quadratic", of=of, within=WITHIN).region.parts[0]
        if of == "half_plane":
            easier, harder = HalfPlane(best.decay * 0.99), HalfPlane(best.decay * 1.01)
        else:
            easier, harder = Sector(best.damping - 1e-3), Sector((best.damping + 1) / 2)
        assert place(plant, easier & WITHIN, "quadratic").proved
        with pytest.raises(NotProvedError):
            place(plant, harder & WITHIN, "quadratic")


REGIONS = [
    HalfPlane(1) & WITHIN,
    VerticalStrip(-6, -1),
    HorizontalStrip(0.5) & WITHIN,
    Ellipse(-3, 2.5, 1),
    Sector(0.8) & WITHIN,
]


@pytest.mark.parametrize("region", REGIONS, ids=str)
def test_slack_tends_to_quadratic_or_better(region):
    """P = G = W leaves the quadratic form less e N'W^-1 N / 2, which vanishes with e."""
    plant = family(9, 2, 1, 3)
    r = {}
    for method in ("quadratic", Slack(epsilon=0.1), Slack(epsilon=1e-2), Slack(epsilon=1e-3)):
        r[method] = smallest(plant.A, plant.B, Around(region), method).r
    assert r[Slack(epsilon=1e-3)] <= r["quadratic"] * (1 + 2e-2)
    assert r[Slack(epsilon=1e-2)] <= r["quadratic"] * (1 + 1e-1)
    wider = r["quadratic"] < 0.9
    assert not wider or place(plant, region, Slack(epsilon=1e-2)).proved


def test_a_law_found_with_slack_holds_exactly_where_it_says():
    plant = family(9, 2, 1, 3)
    design = place(plant, HalfPlane(1) & WITHIN, Slack(epsilon=0.1))
    assert Fraction(float(design.certificate.evidence["epsilon"])) > 0
    poles = design.poles(np.random.default_rng(0).dirichlet(np.ones(3), 500))
    assert design.region.contains(poles)


# --- where there is no largest -------------------------------------------------------------------

FAST = [((-1, 3), (1, 1)), ((0, 0), (1, 1)), ((5, 6), (1, 2)), ((-1, -2), (1, 1))]


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_a_scalar_plant_is_as_fast_as_it_is_asked_to_be(method):
    """x' = a x + b u, b > 0: a high gain holds every half-plane, by every method."""
    for a, b in FAST:
        plant = scalar(a, b)
        for region in (HalfPlane(1), HalfPlane(0), Sector(0.99)):
            assert place(plant, region, method).proved
        assert tightest(plant, method=method, of="half_plane").region.parts[0].decay > 0


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize(("a", "b"), FAST)
def test_and_within_a_large_disk_it_is(a, b, method):
    plant, within = scalar(a, b), Disk(-100, 99.9)
    assert place(plant, HalfPlane(1) & within, method).proved
    assert place(plant, Sector(0.99) & within, method).proved
    design = tightest(plant, method=method, of="half_plane", within=within)
    assert design.region.parts[0].decay > 90
