"""Regions as text: what reads, what does not, and that writing and reading agree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polefence import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    load,
    parse_region,
)
from polefence.base.errors import RegionError, SpecError
from polefence.region.regions import Intersection, Region
from polefence.region.text import MAX_LENGTH, digits_down, digits_up, load_region, short_text

POSITIVE = st.floats(1e-90, 1e90)
PARTS = st.one_of(
    st.builds(Disk, POSITIVE.map(lambda c: -c), POSITIVE),
    st.builds(Disk, st.floats(-0.5, 0.5).filter(lambda c: abs(c) > 1e-9), st.floats(1e-6, 0.49)),
    st.builds(HalfPlane, POSITIVE | POSITIVE.map(lambda d: -d) | st.just(0.0)),
    st.builds(Sector, st.floats(1e-8, 1, exclude_max=True)),
    st.builds(VerticalStrip, POSITIVE.map(lambda low: -low), POSITIVE | st.just(0.0)),
    st.builds(HorizontalStrip, POSITIVE),
    st.builds(Ellipse, POSITIVE.map(lambda c: -c), POSITIVE, POSITIVE),
)
REGIONS = PARTS | st.lists(PARTS, min_size=2, max_size=6, unique=True).map(
    lambda parts: Intersection(tuple(parts))
)


@given(region=REGIONS)
def test_what_is_written_reads_back_the_same(region: Region):
    assert parse_region(str(region)) == region
    assert parse_region(str(region).upper().replace("_", "-")) == region


@pytest.mark.parametrize(
    ("text", "region"),
    [
        ("disk(-40, 31)", Disk(-40, 31)),
        ("  Disk ( -4e1 ,+3.1E1 )  ", Disk(-40, 31)),
        ("disk(-40.,.5)", Disk(-40, 0.5)),
        ("disk(0.5, 0.4)", Disk(0.5, 0.4)),
        ("half-plane(0)", HalfPlane(0)),
        ("HALF_PLANE(-1)", HalfPlane(-1)),
        ("vertical_strip(-20, -1)", VerticalStrip(-20, -1)),
        ("horizontal-strip(3)", HorizontalStrip(3)),
        ("ellipse(-4, 2, 1)", Ellipse(-4, 2, 1)),
        ("disk(-40, 31) & sector(0.3)", Disk(-40, 31) & Sector(0.3)),
        ("disk(-40, 31)&disk(-40, 31)", Disk(-40, 31)),
        ("disk(-40,\n 31)\n& sector(0.3)", Disk(-40, 31) & Sector(0.3)),
    ],
)
def test_what_reads(text, region):
    assert parse_region(text) == region


FAULTS = {
    "": "region is empty",
    "  ": "region is empty",
    "disk(-40, 31) &": "nothing stands on one side of '&'",
    "& disk(-40, 31)": "nothing stands on one side of '&'",
    "disc(-40, 31)": "kind 'disc' is unknown; did you mean 'disk'?",
    "halfplane(2)": "kind 'halfplane' is unknown; did you mean 'half_plane'?",
    "cone(3)": "kind 'cone' is unknown; known: disk, ellipse,",
    "disk": "'disk' is not of the form kind(numbers)",
    "disk -40 31": "'disk -40 31' is not of the form kind(numbers)",
    "disk(-40, 31": "the closing parenthesis is missing",
    "disk(-40, 31) sector(0.3)": "join parts by '&'",
    "(disk(-40, 31))": "is not of the form kind(numbers)",
    "disk(-40)": "disk(centre, radius) takes 2 numbers; got 1",
    "disk()": "disk(centre, radius) takes 2 numbers; got 0",
    "sector(0.3, 4)": "sector(damping) takes 1 number; got 2",
    "disk(-40, 3l)": "disk: radius = '3l' is not a number",
    "disk(-40,)": "disk: radius = '' is not a number",
    "disk(centre=-40, radius=31)": "disk: centre = 'centre=-40' is not a number",
    "disk(-40, nan)": "disk: radius = 'nan' is not a number",
    "disk(-40, inf)": "disk: radius = 'inf' is not a number",
    "disk(-40, 1_0)": "disk: radius = '1_0' is not a number",
    "disk(-40, ٣)": "is not a number",
    "disk(-40, 1e999)": "disk: radius = inf is not finite",
    "disk(-40, 1e-200)": "disk: radius = 1e-200 is out of range",
    "disk(-40, 0x10)": "is not a number",
    "disk(40, 31)": "disk(40, 31): centre = 40 is not in the left half-plane",
    "sector(30)": "sector: damping = 30 must be a damping ratio between 0 and 1",
    "vertical_strip(-1, -2)": "vertical_strip: low = -1 is not below high = -2",
    "disk(-40, __import__('os'))": "is not of the form kind(numbers)",
    "disk(-40, 31)" + " " * MAX_LENGTH: "region has 1013 characters; at most 1000 are read",
    "&".join(["sector(0.3)"] * 17): "region has 17 parts; at most 16 are read",
    "d" * 900: "...' is not of the form",
}


@pytest.mark.parametrize("text", FAULTS)
def test_each_fault_is_named_in_one_line(text):
    with pytest.raises(RegionError) as caught:
        parse_region(text)
    message = str(caught.value)
    assert FAULTS[text] in message
    assert "\n" not in message
    assert len(message) < 200


@pytest.mark.parametrize("value", [None, 5, ["disk(-40, 31)"], Disk(-40, 31), b"disk(-40, 31)"])
def test_only_text_is_read(value):
    with pytest.raises(RegionError, match="written as text"):
        parse_region(value)


@given(text=st.text(alphabet="disk(-40, 31)&sector.3e_half\n", max_size=60))
def test_any_text_is_read_or_refused(text):
    try:
        region = parse_region(text)
    except RegionError:
        return
    assert parse_region(str(region)) == region


@given(value=st.floats(1e-30, 1e30) | st.floats(-1e30, -1e-30), digits=st.integers(1, 12))
def test_rounding_goes_to_the_safe_side(value, digits):
    low, high = float(digits_down(value, digits)), float(digits_up(value, digits))
    assert low <= value <= high
    assert high - low <= abs(value) * 10.0 ** (1 - digits) * (1 + 1e-9)


def test_what_has_few_digits_is_not_rounded():
    assert (digits_down(0.7), digits_up(0.7), digits_down(0.0)) == ("0.7", "0.7", "0")
    assert (digits_down(1 / 3), digits_up(1 / 3)) == ("0.333333", "0.333334")


@settings(max_examples=40)
@given(region=REGIONS)
def test_a_short_text_holds_the_region(region):
    short = parse_region(short_text(region))
    points = np.array(points_about(region))
    inside, still = region.distance(points) < 0, short.distance(points) < 0
    assert not np.any(inside & ~still)


def points_about(region):
    scale = region.scale or 1.0
    return [scale * complex(x, y) for x in (-1.9, -1, -0.99, -0.5, 0, 0.3) for y in (0, 0.1, 0.7)]


SPEC = """
{}
[[vertex]]
A = [[0, 1], [2, 3]]
B = [[0], [1]]
"""


def spec(tmp_path, line):
    path = tmp_path / "plant.toml"
    path.write_text(SPEC.format(line))
    return path


def test_a_spec_may_name_a_region(tmp_path):
    path = spec(tmp_path, 'region = "disk(-4, 3) & sector(0.5)"')
    assert load_region(path) == Disk(-4, 3) & Sector(0.5)
    assert load(path).shape == (2, 1)
    assert load_region(spec(tmp_path, "")) is None


def test_a_region_that_does_not_read_names_the_file(tmp_path):
    path = spec(tmp_path, 'region = "sektor(0.5)"')
    load(path)  # the plant is not in question
    with pytest.raises(RegionError, match=r"plant\.toml: region: kind 'sektor' is unknown; did"):
        load_region(path)
    with pytest.raises(SpecError, match=r"plant\.toml: region must be a string"):
        load_region(spec(tmp_path, "region = 5"))
    with pytest.raises(SpecError, match="cannot be read"):
        load_region(tmp_path / "none.toml")
