"""Regions: membership and distance against the defining inequality, refusals, discrete time."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from polefence import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Scheduled,
    Sector,
    UncertainPlant,
    VerticalStrip,
    Wedge,
    analyse,
    check,
    place,
    tightest,
)
from polefence.base.errors import RegionError
from polefence.proof import regions as proof
from polefence.region.regions import CLASSES, Intersection, damping_of, slope_of
from polefence.region.text import parse_region, short_text
from support.api import API
from support.paths import DOCS


def number(low, high):
    """Numbers that are zero or of sensible size, as regions take them."""
    return st.floats(low, high).map(lambda value: round(value, 9))


SIZE = number(0.05, 40)
PARTS = {
    "disk": st.builds(Disk, SIZE.map(lambda c: -c), SIZE),
    "half_plane": st.builds(HalfPlane, number(-10, 10)),
    "sector": st.builds(Sector, st.floats(0.02, 0.98)),
    "vertical_strip": st.builds(
        lambda low, width: VerticalStrip(low, low + width), number(-40, 10), SIZE
    ),
    "horizontal_strip": st.builds(HorizontalStrip, SIZE),
    "wedge": st.builds(Wedge, number(-20, 20), st.one_of(SIZE, SIZE.map(lambda s: -s))),
    "ellipse": st.builds(Ellipse, SIZE.map(lambda c: -c), SIZE, SIZE),
}
ANY = st.one_of(*PARTS.values())
POLE = st.builds(complex, number(-100, 30), number(-60, 60))


def test_every_kind_is_tried_here_and_on_the_pages():
    assert PARTS.keys() == CLASSES.keys() == proof.KINDS.keys()
    for kind, own in CLASSES.items():
        assert f"| `{kind}(" in (DOCS / "regions.md").read_text()
        assert f":: {own.__name__}" in API


@given(ANY)
def test_what_is_drawn_is_the_boundary(region):
    """Poles cross it there: distance and the inequality's largest eigenvalue are zero."""
    for curve in region.boundary((-50.0, 20.0, 30.0)):
        assert np.abs(region.distance(curve)).max() < 1e-9 * max(region.size, 50)
        shown = [z for z in curve[::240] if abs(z) < 100]
        assert all(abs(level(region, z, 50.0)) < 1e-9 * (1 + abs(z)) for z in shown)


@given(ANY)
def test_a_region_in_six_digits_holds_it(region):
    try:
        short = parse_region(short_text(region), alone=False)
    except RegionError:  # of a number below the least
        assume(False)
    curve = np.concatenate(region.boundary((-50.0, 20.0, 30.0)))
    inside = curve[np.abs(curve) < 60]
    assert (short.distance(inside) <= 1e-9 * max(region.size, 50)).all()


def level(region, z, rate=1.0):
    """Return the largest eigenvalue of L + M z + M' conj(z) over the region's inequalities."""
    z = z / rate
    return max(
        np.linalg.eigvalsh(L + M * z + M.T * np.conj(z)).max() for L, M in region.pairs(rate)
    )


@pytest.mark.parametrize("kind", PARTS)
@settings(max_examples=25)
@given(data=st.data(), z=POLE, rate=st.floats(0.1, 10))
def test_a_pole_is_inside_if_and_only_if_the_inequality_holds(kind, data, z, rate):
    region = data.draw(PARTS[kind])
    assert region.kind == kind
    distance = float(region.distance(z))
    assume(abs(distance) > 1e-9 * max(region.size, abs(z)))
    assert (distance < 0) == (level(region, z, rate) < 0)
    assert region.contains([z, z.conjugate()]) == (distance < 0)


INSIDE = {
    "disk": lambda region: region.centre,
    "half_plane": lambda region: -region.decay - 1,
    "sector": lambda region: -1.0,
    "vertical_strip": lambda region: (region.low + region.high) / 2,
    "horizontal_strip": lambda region: -1.0,
    "ellipse": lambda region: region.centre,
    "wedge": lambda region: region.apex - math.copysign(1, region.slope),
}


@pytest.mark.parametrize("kind", PARTS)
@settings(max_examples=25)
@given(data=st.data(), z=POLE, rate=st.floats(0.1, 10))
def test_the_inequality_turns_where_the_distance_does(kind, data, z, rate):
    region = data.draw(PARTS[kind])
    within, beyond = complex(INSIDE[kind](region)), z
    assert float(region.distance(within)) < 0
    assume(float(region.distance(beyond)) > 0.01)
    size = -level(region, within, rate) + level(region, beyond, rate)
    for _ in range(60):
        middle = (within + beyond) / 2
        if float(region.distance(middle)) < 0:
            within = middle
        else:
            beyond = middle
    assert abs(level(region, within, rate)) < 1e-9 * size


@given(region=ANY, z=POLE, angle=st.floats(0, 2 * np.pi))
def test_no_point_nearer_than_the_distance_lies_across_the_boundary(region, z, angle):
    distance = float(region.distance(z))
    near = z + 0.999 * abs(distance) * np.exp(1j * angle)
    assume(abs(distance) > 1e-9 * max(region.size, abs(z)))
    assert (float(region.distance(near)) < 0) == (distance < 0)


@settings(max_examples=40)
@given(parts=st.lists(ANY, min_size=2, max_size=4), z=POLE)
def test_an_intersection_holds_what_all_of_its_parts_hold(parts, z):
    region = Intersection(tuple(parts))
    assert region.contains(z) == all(part.contains(z) for part in parts)
    assert len(region.pairs()) == sum(len(part.pairs()) for part in region.parts)
    assert region.document()["parts"] == [part.document() for part in region.parts]


@given(region=ANY, z=POLE)
def test_a_stable_region_holds_no_unstable_pole(region, z):
    assume(region.stable)
    unstable = complex(abs(z.real), z.imag)
    assert float(region.distance(unstable)) >= 0


@pytest.mark.parametrize(
    ("region", "inside", "boundary", "outside"),
    [
        (HalfPlane(2), [-2.1, -3 + 9j], -2 + 1j, -1.9),
        (Sector(0.6), [-3 + 3.9j, -1], -3 + 4j, -3 + 4.1j),
        (VerticalStrip(-5, -1), [-4.9, -1.1 + 7j], -1 + 2j, -5.1),
        (HorizontalStrip(3), [50 + 2.9j], 3j, -3.1j),
        (Ellipse(-4, 2, 1), [-5.9, -4 + 0.9j], -4 + 1j, -4 + 1.1j),
    ],
)
def test_by_hand(region, inside, boundary, outside):
    assert region.contains(inside)
    assert float(region.distance(boundary)) == pytest.approx(0, abs=1e-12)
    assert float(region.distance(outside)) > 0


@given(damping=st.floats(1e-8, 1, exclude_max=True))
def test_a_sectors_slope_never_promises_less_damping(damping):
    slope = slope_of(damping)
    assert Fraction(damping) ** 2 * (1 + Fraction(slope) ** 2) <= 1
    assert slope_of(damping_of(slope)) >= slope


def test_distance_is_negative_inside_and_zero_on_the_boundary():
    disk = Disk(-4, 2)
    assert disk.distance([-4, -2, -4 + 3j]).tolist() == [-2, 0, 1]
    assert disk.contains([-4, -5 + 1j])
    assert not disk.contains([-4, -2])  # the disk is open


@pytest.mark.parametrize("radius", [31, 29.07575, 7.066082123, 1 / 3])
def test_a_disk_prints_as_it_is(radius):
    """Rounded, it would be another claim."""
    assert float(str(Disk(-40, radius)).rstrip(")").split(",")[1]) == radius


@pytest.mark.parametrize(("radius", "stable"), [(3.99, True), (4.0, True), (4.01, False)])
def test_a_disk_is_stable_if_it_stays_in_the_open_left_half_plane(radius, stable):
    assert Disk(-4, radius).stable is stable


@pytest.mark.parametrize(
    ("centre", "radius"),
    [(float("nan"), 1), (float("-inf"), 1), ("x", 1), (None, 1)]
    + [(-4, 0), (-4, -1), (-4, float("nan")), (-4, float("inf")), (-4, "x")],
)
def test_what_is_no_disk_is_refused(centre, radius):
    with pytest.raises(RegionError):
        Disk(centre, radius)


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        (HalfPlane, (float("nan"),)),
        (Sector, (0,)),
        (Sector, (1,)),
        (Sector, (-0.5,)),
        (VerticalStrip, (-1, -1)),
        (VerticalStrip, (-1, -2)),
        (HorizontalStrip, (0,)),
        (Ellipse, (-1, 0, 1)),
        (Ellipse, (-1, 1, -1)),
        (HalfPlane, (1e200,)),
    ],
)
def test_what_is_no_region_is_refused(kind, numbers):
    with pytest.raises(RegionError):
        kind(*numbers)


SAMPLED = UncertainPlant.from_vertices(
    [[[1, "0.05"], [0, 1]]] * 2,
    [[["0.000625"], ["0.025"]], [["0.0004"], ["0.017"]]],
    sample_time="0.05",
    name="cart, sampled",
)


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled", Scheduled(2, 0)])
def test_a_discrete_time_plant_is_placed_in_a_disk_inside_the_unit_circle(method):
    design = place(SAMPLED, Disk(0.6, 0.3), method)
    assert check(design).proved
    weights = np.linspace(0, 1, 21)
    poles = design.poles(np.stack([weights, 1 - weights], axis=1))
    assert np.abs(poles - 0.6).max() < 0.3
    assert np.abs(poles).max() < 0.9


def test_the_smallest_disk_in_discrete_time_is_bracketed():
    design = tightest(SAMPLED, 0.6, "quadratic")
    assert design.lower < design.region.radius < 0.3
    assert design.region.radius < design.lower * (1 + 1e-5)


def test_two_disks_inside_the_unit_circle():
    design = place(SAMPLED, Disk(0.6, 0.3) & Disk(0.5, 0.39), "quadratic")
    assert design.region.contains(design.poles(np.eye(2)))


@pytest.mark.parametrize(
    "region", [Disk(0, 30), Disk(3, 2.9) & Sector(0.5), Disk(0.5, 0.4) & Disk(0.2, 0.9)]
)
def test_a_discrete_time_plant_refuses_disks_that_leave_the_unit_disk(region):
    with pytest.raises(RegionError, match="discrete-time plant; give a disk in the unit"):
        place(SAMPLED, region)


def test_a_continuous_time_plant_refuses_a_disk_about_the_origin(as_printed):
    with pytest.raises(RegionError, match="not in the left half-plane"):
        place(as_printed, Disk(0.5, 0.4))


@pytest.mark.parametrize("pole", [1, -1])
def test_the_unit_disk_is_stability_and_nothing_more(pole):
    """Open: a pole on the circle is refuted, one within 1e-9 of it proved."""
    inside, beyond = (Fraction(pole) * (1 + sign * Fraction(1, 10**9)) for sign in (-1, 1))
    for a, answer in ((inside, "proved"), (Fraction(pole), "refuted"), (beyond, "refuted")):
        plant = UncertainPlant.from_vertices([[[a]]], [[[1]]], sample_time=1)
        assert analyse(plant, [[0]], Disk(0, 1)).answer == answer


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_a_disk_may_touch_the_unit_circle(method):
    for region in (Disk(0, 1), Disk(0.5, 0.5), Disk(0.25, 0.75) & Disk(0.5, 0.5)):
        design = place(SAMPLED, region, method)
        assert check(design).proved
        assert region.contains(design.poles(np.eye(2)))


@pytest.mark.parametrize(
    ("centre", "radius"), [(0.5, math.nextafter(0.5, 1)), (0.0, 1.5), (0.5, 0.6), (1.0, 0.1)]
)
def test_a_disk_across_the_unit_circle_is_no_region_of_discrete_time(centre, radius):
    with pytest.raises(RegionError, match="discrete-time plant; give a disk in the unit"):
        place(SAMPLED, Disk(centre, radius))
