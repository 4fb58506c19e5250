"""Regions of continuous time in the z-plane: what was asked holds there, and little is lost."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from polefence import (
    Design,
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    UncertainPlant,
    VerticalStrip,
    Wedge,
    analyse,
    check,
    observe,
    parse_region,
    place,
    tightest,
    z_plane,
)
from polefence.base.errors import InputError, RegionError
from polefence.certify.checks import implies_stability
from polefence.cli.main import main
from polefence.region.regions import Region
from polefence.region.text import short_text
from polefence.region.z_plane import annulus_kept, disk_kept, share_kept, shares
from support.commands import ran
from support.paths import ROOT

REGIONS = (ROOT / "docs" / "regions.md").read_text()
T = 0.05
DAMPINGS = [1e-6, 0.02, 0.3, 0.7071, 0.9, 0.99, 0.999]
A = [[[1, T], [0, 1]], [[1, T], [0, 0.98]]]
B = [[[T**2 / 4], [T / 2]], [[T**2 / 6], [T / 3]]]
CART = UncertainPlant.from_vertices(A, B, name="cart", sample_time="0.05")


def damping(z):
    s = np.log(np.asarray(z, dtype=complex))
    return -s.real / np.abs(s)


def filled(region: Region, count: int = 60_000):
    """Points of the unit disk's square that lie in a region."""
    z = np.random.default_rng(5).uniform(-1, 1, (count, 2)) @ [1, 1j]
    return z[region.distance(z) < 0]


def edge_points(region: Region):
    """Points just inside the boundary, close together near its corners too."""
    angle = np.concatenate([np.linspace(0, math.pi, 2000), np.geomspace(1e-7, 1, 500)])
    low, high = np.zeros(len(angle)), np.ones(len(angle))
    for _ in range(60):
        middle = (low + high) / 2
        inside = region.distance(middle * np.exp(1j * angle)) < 0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    z = low * np.exp(1j * angle)
    return z[low > 1e-12]


@pytest.mark.parametrize("edges", [2, 5, 12])
@pytest.mark.parametrize("ratio", DAMPINGS)
def test_poles_of_the_polygon_have_the_damping(ratio, edges):
    region = z_plane(Sector(ratio), T, edges)
    assert len(region.parts) <= edges + 1
    for points in (filled(region), edge_points(region)):
        assert damping(points).min() > ratio - 1e-9
    assert region.parts[0] == Disk(0, 1)


@pytest.mark.parametrize("ratio", DAMPINGS[1:-1])
def test_the_share_is_that_of_the_area_and_more_edges_keep_more(ratio):
    shares = [share_kept(ratio, edges) for edges in (2, 3, 5, 8, 12)]
    assert shares == sorted(shares)
    assert shares[2] > 0.85
    assert shares[-1] < 1
    k = ratio / math.sqrt(1 - ratio**2)
    image = (1 - math.exp(-2 * k * math.pi)) / (2 * k)  # of both halves, by integration
    z = edge_points(z_plane(Sector(ratio), T))
    z = z[np.argsort(np.angle(z))]
    polygon = np.sum(np.imag(np.conj(z[:-1]) * z[1:]))  # of both halves, by triangles
    assert shares[2] == pytest.approx(polygon / image, rel=2e-3)


def test_the_docs_say_how_much_is_kept_and_what_slow_poles_need():
    ratios = [*np.linspace(0.01, 0.99, 8)]  # the ends, and 0.85, are the extremes
    shares = [share_kept(ratio) for ratio in ratios]
    assert 0.88 <= min(shares) < 0.89
    assert 0.92 < max(shares) < 0.935
    assert min(share_kept(ratio, 12) for ratio in ratios) > 0.97
    slopes = [z_plane(Sector(ratio), T).parts[1].slope for ratio in ratios]
    more = 1 / np.hypot(1, slopes) - ratios
    assert 0.06 < max(more) <= 0.07


def test_slow_poles_need_little_more_damping():
    region = z_plane(Sector(0.5), T)
    for size in (0.02, 0.5, 5, 20):
        angle = math.acos(0.56)
        s = size * np.exp(1j * (math.pi - angle))
        assert region.contains(np.exp(s * T))
        assert not region.contains(np.exp(size * T * np.exp(1j * (math.pi - math.acos(0.49)))))


@pytest.mark.parametrize("share", [1 - 1e-9, 1 + 1e-9])
def test_decay_and_frequency_are_exact(share):
    inside = share < 1
    decays = z_plane(HalfPlane(3), T)
    assert decays == Disk(0, decays.radius)
    assert decays.contains(np.exp(T * complex(-3 / share, 20))) is inside
    assert z_plane(HalfPlane(0), T) == Disk(0, 1)
    slow = z_plane(HorizontalStrip(9), T)
    assert slow.contains(np.exp(T * complex(-7, 9 * share))) is inside
    assert slow.contains(np.exp(T * complex(-700, 8))) is True


@pytest.mark.parametrize("strip", [VerticalStrip(-3, -1), VerticalStrip(-60, 0)])
def test_a_vertical_strip_is_within_its_annulus(strip):
    region = z_plane(strip, T)
    rates = np.log(np.abs(filled(region, 400_000))) / T
    assert strip.low < rates.min()
    assert rates.max() < strip.high
    for rate in (strip.low * 0.999, strip.high * 1.001 - 1e-9):
        assert region.contains(np.exp(rate * T))  # all that are real
    z = np.random.default_rng(0).uniform(-1, 1, (400_000, 2)) @ [1, 1j]
    rates = np.log(np.abs(z)) / T
    image = (strip.low < rates) & (rates < strip.high)
    share = np.count_nonzero(region.distance(z) < 0) / np.count_nonzero(image)
    assert annulus_kept(strip, T) == pytest.approx(share, abs=0.01)


def test_a_design_is_no_faster_than_was_asked():
    design = place(CART, VerticalStrip(-8, -1), "quadratic")
    assert check(design).proved
    weights = np.linspace(0, 1, 21)
    poles = np.log(design.poles(np.stack([weights, 1 - weights], axis=1)).astype(complex)) / T
    assert VerticalStrip(-8, -1).contains(poles)


DISKS = [Disk(-400, 400), Disk(-2000, 1500), Disk(-3, 2.9), Disk(-1, 1e-6), Disk(-700, 900)]
ELLIPSES = [Ellipse(-300, 200, 250), Ellipse(-400, 390, 120)]


@pytest.mark.parametrize("part", [*DISKS, *ELLIPSES])
@pytest.mark.parametrize("sample_time", [5e-4, 2e-3, 5e-3])
def test_poles_of_the_inner_disk_lie_in_the_disk_that_was_asked(part, sample_time):
    (image,) = z_plane(part, sample_time).parts
    about = np.exp(1j * np.linspace(0, 2 * math.pi, 20_001))
    s = np.log(image.centre + image.radius * about) / sample_time
    assert part.distance(s).max() <= 1e-9 * part.scale
    # and it ends where the real axis leaves the image: no larger disk about the axis is within
    radius = min(part.half_axes)
    ends = [math.exp((part.centre + side * radius) * sample_time) for side in (-1, 1)]
    ends[1] = min(ends[1], 1.0)  # where poles are no longer stable
    assert np.allclose(image.ends, ends, rtol=1e-12, atol=1e-15)
    assert Fraction(image.centre) - Fraction(image.radius) >= Fraction(ends[0])
    assert Fraction(image.centre) + Fraction(image.radius) <= Fraction(ends[1])


def test_random_disks_have_inner_disks():
    rng = np.random.default_rng(3)
    about = np.exp(1j * np.linspace(0, 2 * math.pi, 2001))
    for centre, share, time in rng.uniform([-6, 0.01, 0.1], [-1.1, 1.3, 1], (200, 3)):
        part = Disk(centre, -centre * share)
        (image,) = z_plane(part, time).parts
        assert part.distance(np.log(image.centre + image.radius * about) / time).max() <= 1e-12


@pytest.mark.parametrize("part", [*DISKS[:3], *ELLIPSES])
def test_the_share_of_an_inner_disk_is_that_of_the_area(part):
    sample_time = 1e-3
    rng = np.random.default_rng(4)
    real, imaginary = part.half_axes
    assert imaginary * sample_time < math.pi  # no part of the image is covered twice
    s = part.centre + rng.uniform(-1, 1, (400_000, 2)) @ [real, 1j * imaginary]
    z = np.exp(s * sample_time)
    sizes = np.where(part.distance(s) < 0, np.abs(z) ** 2, 0)  # areas are |z|^2 times as large
    image = z_plane(part, sample_time)
    share = sizes[image.distance(z) < 0].sum() / sizes.sum()
    (said,) = shares(part, sample_time)
    assert said.kept == pytest.approx(share, abs=0.01)


def test_the_docs_say_how_much_an_inner_disk_keeps():
    kept = [math.floor(100 * disk_kept(Disk(-2, size), 1.0)) for size in (0.5, 1, 2)]
    said = "of {} % of the image at a radius of 0.5/T, {} % at 1/T and {} % at 2/T"
    assert said.format(*kept) in REGIONS


@pytest.mark.parametrize(("apex", "slope"), [(-5, 1), (-40, 0.3), (-1, 4)])
def test_a_wedge_beyond_the_unit_disk_is_one_of_continuous_time(apex, slope):
    part = Wedge(apex, slope)
    region = z_plane(part, T)
    for points in (filled(region), edge_points(region)):
        assert part.distance(np.log(points.astype(complex)) / T).max() < 1e-9
    assert region.parts[0].ends[1] == pytest.approx(math.exp(apex * T), rel=1e-12)
    assert shares(part, T)[0].kept > 0.85


def test_a_design_keeps_the_disk_that_was_asked():
    design = place(CART, Disk(-4, 3.9), "quadratic")
    assert check(design).proved
    weights = np.linspace(0, 1, 21)
    poles = np.log(design.poles(np.stack([weights, 1 - weights], axis=1)).astype(complex)) / T
    assert Disk(-4, 3.9).contains(poles)
    over = place(CART, Disk(-3, 3.5), "quadratic")
    assert over.region.parts[0].ends[1] == 1
    assert Disk(-3, 3.5).contains(np.log(over.poles(np.eye(2)).astype(complex)) / T)


def test_what_is_of_the_z_plane_stays():
    both = z_plane(HalfPlane(1) & Sector(0.5), T)
    assert z_plane(both, T) == both
    assert parse_region(str(both)) == both
    assert z_plane(Disk(0.5, 0.3), T) == Disk(0.5, 0.3)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        (VerticalStrip(-3, 1), "holds unstable poles"),
        (VerticalStrip(-1 - 1e-12, -1), "is too narrow at 0.05 s"),
        (HalfPlane(-1), "holds unstable poles"),
        (HalfPlane(1e5), "nothing decays so fast at 0.05 s"),
        (Sector(0.9999), "a polygon is made up to 0.999"),
        (HorizontalStrip(32), "height must be below 31.42 rad/s"),
        (Disk(0.5, 0.6), "give a disk in the unit disk"),
        (Disk(0, 30), "give a disk in the unit disk"),
        (Disk(-1e5, 9e4), "its image has no size in floats at 0.05 s"),
    ],
)
def test_what_has_no_image_is_refused(region, message):
    with pytest.raises(RegionError, match=message):
        place(CART, region, "quadratic")


@pytest.mark.parametrize("edges", [1, 13])
def test_edges_are_few(edges):
    with pytest.raises(RegionError, match="must be 2 to 12"):
        z_plane(Sector(0.5), T, edges)


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_a_design_has_the_decay_and_damping_that_were_asked(method):
    asked = HalfPlane(1) & Sector(0.6) & HorizontalStrip(15)
    design = place(CART, asked, method)
    assert check(design).proved
    assert design.region == z_plane(asked, T)
    weights = np.linspace(0, 1, 21)
    poles = np.log(design.poles(np.stack([weights, 1 - weights], axis=1)).astype(complex)) / T
    assert asked.contains(poles)
    gain = design.law.gain(np.eye(2))
    if method == "quadratic":
        assert analyse(CART, gain[0], asked).answer == "proved"
        assert analyse(CART, gain[0], HalfPlane(-np.real(poles).max() + 0.01)).answer == "refuted"


def test_the_largest_decay_rate_is_that_of_the_smallest_disk_about_zero():
    design, disk = tightest(CART, of="half_plane"), tightest(CART, 0.0)
    assert design.region == disk.region
    assert design.asked.decay == pytest.approx(-math.log(disk.region.radius) / T, rel=1e-5)
    assert z_plane(design.asked, T).radius >= design.region.radius
    with pytest.raises(InputError, match="a half_plane has no region within"):
        tightest(CART, of="half_plane", within=Disk(0, 0.9))


def test_an_observer_too():
    plant = UncertainPlant.from_vertices(A, B, states=("x", "v"), sample_time="0.05")
    observer = observe(plant, ["x"], HalfPlane(2) & Sector(0.5), "quadratic")
    assert observer.region == z_plane(HalfPlane(2) & Sector(0.5), T)


def test_the_command_says_how_much_of_an_annulus_was_proved(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.toml").write_text(SPEC)
    words = ["cart.toml", "--region", "vertical_strip(-8, -1)"]
    said = f"; the right part of {VerticalStrip(-8, -1)} is 17 % of its image"
    assert said in ran(capsys, "design", *words, "--method", "quadratic")
    assert main(["analyse", *words, "--gain", "[[-1, -1]]"]) == 1
    said = "note: so a pole outside that right part may still be in the strip asked"
    assert said in capsys.readouterr().out


def test_a_wedge_alone_is_not_said_to_be_stable():
    assert not implies_stability(CART, Wedge(2, 1))
    assert implies_stability(CART, z_plane(Sector(0.5), T))
    with pytest.raises(InputError, match="give a disk"):
        place(CART, Disk(0.5, 0.6) & Wedge(2, 1))


SPEC = """
name = "cart"
sample_time = 0.05
[parameter.m]
range = [2, 3]
through = "1/m"
[matrices]
A = [[1, 0.05], [0, 1]]
B = [["0.00125/m"], ["0.05/m"]]
"""


def test_the_command_finds_decay_rate_and_damping_ratio(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.toml").write_text(SPEC)
    own = {
        "half_plane": ["--schedule", "none", "--largest-gain", "3"],
        "sector": ["--method", "quadratic"],
    }
    for kind, said in (("half_plane", "proved: decay rate "), ("sector", "proved: damping ratio ")):
        words = ["tightest", "cart.toml", "--of", kind, *own[kind]]
        assert main([*words, "-o", "law", "--json", "summary.json"]) == 0
        value = json.loads((tmp_path / "summary.json").read_text())["value"]
        first = capsys.readouterr().out.splitlines()[0]
        assert first.startswith(said)
        assert float(first.split()[3].rstrip(",")) == pytest.approx(value, rel=1e-5)
        region = Design.load("law/design.json").region
        assert f"within {' & '.join(map(short_text, region.parts))}" in first
        ran(capsys, "check", "law", "--spec", "cart.toml")


def test_the_command_says_what_was_proved_and_what_was_asked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.toml").write_text(SPEC)
    words = ["cart.toml", "--region", "half_plane(1) & sector(0.5)"]
    assert main(["design", *words, "--method", "quadratic", "-o", "law"]) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    proved = str(z_plane(HalfPlane(1) & Sector(0.5), T))
    assert first == f"proved: quadratic keeps all poles of 'cart' in {proved} for every alpha"
    assert second == (
        "  that lies within half_plane(1) & sector(0.5) at T = 0.05 s, z = exp(s T); the polygon "
        "of sector(0.5) is 91 % of its image"
    )
    assert f"poles in {proved}, of A + B K" in ran(capsys, "check", "law", "--spec", "cart.toml")
    said = ran(capsys, "analyse", *words, "--gain", "[-1 -1]", status=1)
    assert said.startswith("refuted: ")
    assert "note: so a pole outside that polygon may still be in the sector asked" in said
