"""Handles: what is dragged to a place has its boundary there, and the rest stays."""

from dataclasses import dataclass

import numpy as np
import pytest

from polefence import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    Wedge,
    parse_region,
)
from polefence.base.errors import RegionError
from polefence.examples import family
from polefence.region.regions import Region
from polefence.show.plots import PANEL, fitted, view_of
from polefence.studio.handles import WIDE, handles, in_sight, moved, outline
from polefence.studio.poles import ASKED, Poles

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
    "wedge(-2, 1.5)",
    "wedge(-70, -0.8) & half_plane(1)",
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


# --- outlines ------------------------------------------------------------------------------------

FURTHER = (
    "half_plane(0)",
    "disk(-1000000, 999990)",
    "horizontal_strip(20) & sector(0.6) & sector(0.3)",
    "disk(-40, 31) & ellipse(-40, 38, 12) & sector(0.9) & half_plane(4)",
)


def frame(view):
    """Return where an outline is cut off."""
    low, high, height = view
    middle, half = (low + high) / 2, WIDE * (high - low) / 2
    return middle - half, middle + half, WIDE * height


def depth(points, view):
    low, high, height = view
    return np.minimum.reduce([points.real - low, high - points.real, height - np.abs(points.imag)])


@pytest.mark.parametrize("text", REGIONS + FURTHER)
def test_the_outline_is_the_boundary_and_far_off_a_frame(text):
    """Of a convex region in a larger box: vertices on either boundary, in order, none left out."""
    region, wide = parse_region(text), frame(VIEW)
    points = outline(region, VIEW)
    far = wide[1] - wide[0]
    scale = np.maximum(np.abs(points), region.size)
    away, room = region.distance(points), depth(points, wide)
    assert (away <= 1e-9 * scale).all()
    assert (room >= -1e-9 * far).all()
    assert (np.minimum(np.abs(away) / scale, np.abs(room) / far) <= 1e-9).all()
    assert points[0] == points[-1]
    assert np.array_equal(points[:-1].conj()[::-1], points[:-1])
    # turning one way only, by 360 degrees in all
    sides = np.diff(points)
    sides = sides[np.abs(sides) > 1e-9 * far]
    turns = np.angle(np.roll(sides, -1) / sides)
    assert turns.max() < 1e-6
    assert turns.sum() == pytest.approx(-2 * np.pi)


@pytest.mark.parametrize("text", REGIONS + FURTHER)
def test_between_its_points_the_outline_is_near_the_boundary(text):
    """Less than a pixel from it, in the view: corners are points of it, and curves have many."""
    region, points = parse_region(text), outline(parse_region(text), VIEW)
    ends = np.stack([points[:-1], points[1:]])
    along = ends[0] + np.linspace(0, 1, 2001)[:, None] * (ends[1] - ends[0])
    shown = along[depth(along, VIEW) > 0]
    assert len(shown)
    assert np.abs(region.distance(shown)).max() < 1e-4 * (VIEW[1] - VIEW[0])


@pytest.mark.parametrize("text", REGIONS + FURTHER)
def test_no_frame_is_seen_where_one_zooms_out(text):
    """The sides of the outline that are not of the region's boundary lie far outside."""
    region, points = parse_region(text), outline(parse_region(text), VIEW)
    middles = (points[:-1] + points[1:]) / 2
    strange = middles[region.distance(middles) < -0.01 * (VIEW[1] - VIEW[0])]
    low, high, height = VIEW
    further = low - 9 * (high - low), high + 9 * (high - low), 19 * height
    assert (depth(strange, further) < 0).all()


def test_the_outline_of_a_disk_and_a_strip():
    points = outline(parse_region("disk(-40, 25) & horizontal_strip(20)"), VIEW)
    assert (points.real.min(), points.real.max()) == (-65, -15)
    assert points.imag.max() == 20
    for corner in (-55 + 20j, -25 + 20j):
        assert np.abs(points - corner).min() < 1e-3


@pytest.mark.parametrize("text", ["disk(-20000, 10)", "half_plane(9) & disk(-4, 5)"])
def test_of_a_region_that_is_nowhere_near_there_is_no_outline(text):
    assert len(outline(parse_region(text), VIEW)) == 0


SIGHT = {
    "disk(-40, 31)": True,
    "half_plane(4)": True,
    "half_plane(0)": True,
    "sector(0.3)": True,
    "disk(-90, 20)": True,  # its right end
    "disk(-90, 10.5)": True,
    "disk(-90, 9.5)": False,  # beside
    "half_plane(81)": False,
    "half_plane(-11)": False,
    "horizontal_strip(41)": False,
    "disk(-35, 200)": False,  # all around
    "disk(-40, 1)": True,
    "disk(-40, 0.2)": False,  # a dot
    "disk(-200, 10)": False,
    "half_plane(9) & disk(-4, 5)": False,  # nothing at all
}


@pytest.mark.parametrize("text", SIGHT)
def test_what_is_in_sight(text):
    assert in_sight(parse_region(text), VIEW) == SIGHT[text]


@pytest.mark.parametrize("text", REGIONS + FURTHER)
def test_a_view_before_any_poles_are_known_shows_the_boundary(text):
    view = low, high, height = fitted(view_of(parse_region(text), np.zeros(0)))
    assert np.isfinite(view).all()
    assert low < 0 < high
    assert high - low > 1  # [1/s], of a region without a scale too
    assert high - low == pytest.approx(PANEL * 2 * height)
    assert in_sight(parse_region(text), view)


# --- what the browser asks for --------------------------------------------------------------------


@dataclass(frozen=True)
class Looked:
    region: Region
    values: tuple[tuple[str, float], ...] = ()


class Drags:
    """A plane of poles, and what its drags asked for."""

    def __init__(self, text):
        self.regions, self._number, self.fails = [], 0, False
        self.poles = Poles(family("f4e"), Looked(parse_region(text)), self._drag)

    def _drag(self, region, end):
        self.regions.append((str(region), end))
        self.poles.look(Looked(region))
        if self.fails:
            raise RuntimeError

    def __call__(self, place, handle=0, begin=False, end=False):
        self._number += 1
        given = (place.real, place.imag, handle, begin, end, self._number)
        self.poles.asked.data = {key: [own] for key, own in zip(ASKED, given, strict=True)}
        assert self.poles.seen.data["number"] == [self._number]  # or the browser waits for ever

    def type(self, text):
        self.poles.look(Looked(parse_region(text)))

    @property
    def view(self):
        x, y = self.poles.figure.x_range, self.poles.figure.y_range
        return x.start, x.end, y.end

    def number(self, close_to):
        return int(np.argmin([abs(own.place - close_to) for own in self.poles._handles]))


def test_a_drag_begins_at_a_handle_and_goes_on_with_it():
    drags = Drags("vertical_strip(-60, -5)")
    low = drags.number(-60)
    drags(-50 + 0j, low, begin=True)
    drags(-2 + 0j, low)  # beyond the other edge: no region, nothing moves
    drags(-40 + 0j, low, end=True)
    assert drags.regions == [
        ("vertical_strip(-50, -5)", False),
        ("vertical_strip(-50, -5)", False),
        ("vertical_strip(-40, -5)", True),
    ]


def test_a_drag_whose_end_was_lost_is_over_where_the_next_begins():
    drags = Drags("vertical_strip(-60, -5)")
    drags(-50 + 0j, drags.number(-60), begin=True)
    drags(-8 + 0j, drags.number(-5), begin=True)
    drags(-7 + 0j, drags.number(-5), end=True)
    assert [text for text, _ in drags.regions] == [
        f"vertical_strip({ends})" for ends in ("-50, -5", "-50, -8", "-50, -7")
    ]


def test_an_end_that_came_lets_go():
    drags = Drags("vertical_strip(-60, -5)")
    drags(-50 + 0j, drags.number(-60), begin=True, end=True)
    drags(-8 + 0j, drags.number(-5))
    assert drags.regions[-1] == ("vertical_strip(-50, -8)", False)


def test_a_handle_that_is_no_more_is_not_dragged_and_the_browser_asks_on():
    drags = Drags("half_plane(4)")
    drags(-3 + 0j, 0, begin=True)
    drags(-8 + 0j, 99, begin=True)
    drags(-9 + 0j, 99)
    assert drags.regions == [("half_plane(3)", False)]


def test_a_fault_while_dragging_is_told_and_the_browser_asks_on():
    drags = Drags("half_plane(4)")
    drags.fails = True
    with pytest.raises(RuntimeError):
        drags(-3 + 0j, begin=True)
    assert drags.poles.seen.data["number"] == [1]
    drags.type("disk(-2000, 10)")
    assert in_sight(Disk(-2000, 10), drags.view)


@pytest.mark.parametrize("text", ["disk(-2000, 10)", "disk(-0.3, 0.2)", "half_plane(900)"])
def test_the_view_fits_a_region_that_is_typed_out_of_sight(text):
    drags = Drags("disk(-40, 31)")
    assert not in_sight(parse_region(text), drags.view)
    drags.type(text)
    assert in_sight(parse_region(text), drags.view)
    assert drags.view == drags.poles.view
    assert drags.poles._handles


@pytest.mark.parametrize("text", ["disk(-40, 36)", "half_plane(4)", "disk(-60, 50)"])
def test_the_view_stays_for_a_region_that_is_in_sight(text):
    drags = Drags("disk(-40, 31)")
    before = drags.view
    drags.type(text)
    assert drags.view == before


def test_the_view_is_the_one_that_the_browser_was_panned_to():
    drags = Drags("disk(-40, 31)")
    drags.poles.figure.x_range.update(start=-2030, end=-1960)
    drags.poles.look(Looked(Disk(-40, 31)))  # nothing new was asked for
    assert drags.view[0] == -2030
    drags.type("disk(-2000, 10)")
    assert drags.view[0] == -2030
    drags.type("disk(-40, 36)")
    assert in_sight(Disk(-40, 36), drags.view)


def test_the_view_stays_during_a_drag():
    drags = Drags("disk(-40, 31)")
    before, right = drags.view, drags.number(-9)
    drags(-39.9 + 0j, right, begin=True)
    assert drags.regions == [("disk(-40, 0.1)", False)]
    drags(-39.8 + 0j, right, end=True)
    assert drags.view == before
    drags.type("disk(-40, 0.1)")  # and no longer
    assert drags.view != before


def test_every_kind_of_part_can_be_dragged():
    kinds = {type(part) for text in REGIONS for part in parse_region(text).parts}
    assert kinds == {Disk, Ellipse, HalfPlane, HorizontalStrip, Sector, VerticalStrip, Wedge}
