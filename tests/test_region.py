"""The disk: membership, distance, refusals."""

from __future__ import annotations

import pytest

from polefence import Disk
from polefence.errors import RegionError


def test_distance_is_negative_inside_and_zero_on_the_boundary():
    disk = Disk(-4, 2)
    assert disk.distance([-4, -2, -4 + 3j]).tolist() == [-2, 0, 1]
    assert disk.contains([-4, -5 + 1j])
    assert not disk.contains([-4, -2])  # the disk is open


@pytest.mark.parametrize("radius", [31, 29.07575, 7.066082123, 1 / 3])
def test_a_disk_prints_as_it_is(radius):
    """Rounded, it would be another claim."""
    assert float(str(Disk(-40, radius)).rstrip(")").split(",")[1]) == radius


@pytest.mark.parametrize(("radius", "stable"), [(3.99, True), (4.0, False), (5.0, False)])
def test_a_disk_is_stable_if_it_stays_in_the_open_left_half_plane(radius, stable):
    assert Disk(-4, radius).stable is stable


@pytest.mark.parametrize(
    ("centre", "radius"),
    [(0, 1), (4, 1), (float("nan"), 1), (float("-inf"), 1), ("x", 1), (None, 1)]
    + [(-4, 0), (-4, -1), (-4, float("nan")), (-4, float("inf")), (-4, "x")],
)
def test_what_is_no_disk_is_refused(centre, radius):
    with pytest.raises(RegionError):
        Disk(centre, radius)
