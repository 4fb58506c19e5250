"""Handles: what is dragged to a place has its boundary there, and the rest stays."""

from __future__ import annotations

import numpy as np
import pytest

from polefence import Disk, Ellipse, HalfPlane, HorizontalStrip, Sector, VerticalStrip, parse_region
from polefence.base.errors import RegionError
from polefence.studio.handles import handles, moved, outline

VIEW = (-80.0, 10.0, 40.0)
REGIONS = (
    "disk(-40, 31)",
    "half_plane(4)",
    "sector(0.3)",
    "vertical_strip(-60, -5)",
    "horizontal_strip(20)",
    "ellipse(-40, 30, 15)",
    "half_plane(4) & sector(0.6) & disk(-30, 30)",
    "vertical_strip(-60, -5) & horizontal_strip(20)",
)


@pytest.mark.parametrize("text", REGIONS)
def test_edges_and_corners_lie_on_the_boundary_of_their_parts(text):
    region = parse_region(text)
    found = handles(region, VIEW)
    assert {k for own in found for k in own.parts} == set(range(len(region.parts)))
    for own in found:
        if not own.centre:
            assert own.place.imag >= 0
            for k in own.parts:
                assert abs(region.parts[k].distance(own.place)) < 0.1
            assert region.distance(own.place) < 0.1


def test_corners_are_where_two_boundaries_meet():
    region = parse_region("vertical_strip(-60, -5) & horizontal_strip(20)")
    corners = [own.place for own in handles(region, VIEW) if len(own.parts) == 2]
    assert sorted(corners, key=lambda z: z.real) == pytest.approx([-60 + 20j, -5 + 20j], abs=1e-6)
    region = parse_region("half_plane(4) & sector(0.6)")
    (corner,) = (own.place for own in handles(region, VIEW) if len(own.parts) == 2)
    assert corner == pytest.approx(-4 + 4j * 0.8 / 0.6, rel=1e-3)


@pytest.mark.parametrize("text", REGIONS)
@pytest.mark.parametrize("place", [-30 + 7j, -21.5 + 18.3j])
def test_a_boundary_is_dragged_through_a_place_and_the_other_parts_stay(text, place):
    region = parse_region(text)
    for own in handles(region, VIEW):
        if own.centre:
            continue
        found = moved(region, own, place)
        assert len(found.parts) == len(region.parts)
        for k, (before, after) in enumerate(zip(region.parts, found.parts, strict=True)):
            if k in own.parts:
                assert abs(after.distance(place)) < 1e-3 * abs(place)
            else:
                assert after == before


@pytest.mark.parametrize("place", [-62, -30, -10])
def test_the_edge_of_a_strip_that_is_held_moves(place):
    low, high = sorted(handles(VerticalStrip(-60, -5), VIEW), key=lambda own: own.place.real)
    assert moved(VerticalStrip(-60, -5), low, place + 3j) == VerticalStrip(place, -5)
    if place > -60:
        assert moved(VerticalStrip(-60, -5), high, place + 3j) == VerticalStrip(-60, place)


def test_what_is_below_the_real_axis_is_its_mirror_image():
    region, (top, *_) = Disk(-40, 31), handles(Disk(-40, 31), VIEW)
    assert moved(region, top, -40 - 20j) == moved(region, top, -40 + 20j) == Disk(-40, 20)


def test_a_centre_moves_the_whole():
    (own,) = (h for h in handles(Ellipse(-40, 30, 15), VIEW) if h.centre)
    assert moved(Ellipse(-40, 30, 15), own, -20 + 3j) == Ellipse(-20, 30, 15)


def test_what_would_be_no_region_is_refused():
    (own,) = (h for h in handles(Disk(-40, 31), VIEW) if h.centre)
    with pytest.raises(RegionError):
        moved(Disk(-40, 31), own, 5 + 0j)
    (top, *_) = handles(Disk(-40, 31), VIEW)
    with pytest.raises(RegionError):
        moved(Disk(-40, 31), top, -40 + 0j)


@pytest.mark.parametrize("text", REGIONS)
def test_the_outline_is_the_boundary_within_the_view(text):
    region = parse_region(text)
    points = outline(region, VIEW)
    low, high, height = VIEW
    edge = np.minimum.reduce([points.real - low, high - points.real, height - np.abs(points.imag)])
    assert (edge > -1e-6).all()
    inner = edge > 1e-6
    assert inner.any()
    assert np.abs(region.distance(points[inner])).max() < 1e-6
    assert points[0] == pytest.approx(points[-1])


def test_of_a_region_out_of_sight_there_is_no_outline():
    assert len(outline(Disk(-200, 10), VIEW)) == 0


def test_every_kind_of_part_can_be_dragged():
    kinds = {type(part) for text in REGIONS for part in parse_region(text).parts}
    assert kinds == {Disk, Ellipse, HalfPlane, HorizontalStrip, Sector, VerticalStrip}
