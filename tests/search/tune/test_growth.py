"""Poles against regions of every part: distances, slopes, and bounds that are smooth."""

import numpy as np
import pytest

from polefence.lmi.conditions.target import Around, Decays, Disks, Sectors
from polefence.region.regions import (
    CLASSES,
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    Wedge,
)
from polefence.response.modes import Modes
from polefence.search.tune.poles import growth, sides_of, slopes
from polefence.search.tune.smooth import curve_of, smooth_growth

REGIONS = [
    Disk(-2, 1.5),
    HalfPlane(1),
    HalfPlane(0),
    Sector(0.5),
    VerticalStrip(-5, -1),
    HorizontalStrip(2),
    Ellipse(-3, 2, 1),
    Wedge(-1, 0.8),
    Wedge(-6, -0.7),
]
GOALS = [Disks(-2), Decays(10), Sectors(1), Around(Disk(-2, 1) & Sector(0.4))]


def loops(seed, count=4, n=5):
    random = np.random.default_rng(seed)
    A = random.normal(size=(count, n, n))
    return A - 3 * np.eye(n), random.normal(size=(count, n, 2)), random


def test_every_part_is_tried():
    assert {own.kind for own in REGIONS} == CLASSES.keys()


@pytest.mark.parametrize("region", REGIONS, ids=str)
def test_growth_is_below_zero_inside_alone(region):
    random = np.random.default_rng(1)
    z = random.uniform(-7, 3, 500) + 1j * random.uniform(0, 4, 500)
    worst = np.max([growth(side, z)[0] for side in sides_of(region, 1.0)], axis=0)
    assert np.array_equal(worst < 0, region.distance(z) < 0)


def test_of_disks_and_half_planes_growth_is_the_distance():
    z = np.array([-3 + 1j, 2 + 2j, -0.5])
    (side,) = sides_of(HalfPlane(1), 7.0)
    assert growth(side, z)[0] == pytest.approx(HalfPlane(1).distance(z))
    (side,) = Disks(-2).target(1.0).sides
    assert growth(side, z)[0] == pytest.approx(np.abs(z + 2))
    (side,) = Decays(10).target(1.0).sides
    assert growth(side, z)[0] == pytest.approx(10 + z.real)
    (side,) = Sectors(1).target(1.0).sides
    assert growth(side, z[[0, 2]])[0] == pytest.approx([1 / 3, 0])


def every_side():
    fixed = [(region, side) for region in REGIONS for side in sides_of(region, 2.0)]
    return fixed + [(goal, side) for goal in GOALS for side in goal.target(1.0).sides]


@pytest.mark.parametrize(("name", "side"), every_side(), ids=lambda own: str(own)[:30])
def test_slopes_of_poles_are_those_of_central_differences(name, side):
    A, B, random = loops(3)
    step, size = random.normal(size=(len(A), 2, 5)), 1e-6
    modes = Modes(A)
    points, which = np.nonzero(modes.poles.imag > 0)
    poles = modes.poles[points, which]
    _, dx, dy = growth(side, poles)
    along = (slopes(modes, B, points, which, dx, dy) * step[points]).sum(axis=(1, 2))
    moved = [Modes(A + s * size * B @ step).poles[points] for s in (1, -1)]
    nearest = [m[np.arange(len(m)), np.abs(m - poles[:, None]).argmin(axis=1)] for m in moved]
    ahead, back = (growth(side, z)[0] for z in nearest)
    assert (ahead - back) / (2 * size) == pytest.approx(along, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize(("name", "side"), every_side(), ids=lambda own: str(own)[:30])
def test_smooth_growth_bounds_that_of_the_poles_and_comes_near(name, side):
    curve = curve_of(side, 1.0)
    if curve is None:
        assert "ellipse" in str(name)
        return
    A, _, random = loops(4)
    modes = Modes(A)
    upper = np.where(modes.poles.imag >= 0, modes.poles, modes.poles.conj())
    true = growth(side, upper)[0].max(axis=1)
    found = [smooth_growth(side, curve, modes, kappa)[0] for kappa in (3.0, 1e2, 1e6)]
    assert np.all(np.diff([*found[::-1]], axis=0) >= 0)
    assert np.all(found[-1] >= true)
    assert found[-1] == pytest.approx(true, rel=1e-3, abs=1e-3)
    step, size = random.normal(size=A.shape), 1e-5
    _, dA = smooth_growth(side, curve, modes, 30.0)
    ahead, back = (smooth_growth(side, curve, Modes(A + s * size * step), 30.0)[0] for s in (1, -1))
    along = (dA * step).sum(axis=(1, 2))
    assert (ahead - back) / (2 * size) == pytest.approx(along, rel=1e-3, abs=1e-4)


def test_smooth_growth_has_slopes_where_poles_meet():
    # a double pole, without a full set of eigenvectors but for rounding
    A = np.array([[[-1.0, 1.0], [1e-13, -1.0]]])
    (side,) = sides_of(HalfPlane(0.5), 1.0)
    r, dA = smooth_growth(side, curve_of(side, 1.0), Modes(A), 10.0)
    step, size = np.array([[[0.3, 0.2], [0.5, -0.1]]]), 1e-4
    ahead, back = (
        smooth_growth(side, curve_of(side, 1.0), Modes(A + s * size * step), 10.0)[0]
        for s in (1, -1)
    )
    assert r > -1  # of its own length, 0.5 1/s
    assert (ahead - back) / (2 * size) == pytest.approx((dA * step).sum(axis=(1, 2)), rel=1e-2)
