"""Roads against their class, their shapes in closed form, and files that cannot be used."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from polefence.base.errors import InputError
from polefence.response.stationary import (
    ROUGHNESS,
    displacement_density,
    roughness,
    velocity_density,
)
from polefence.vehicle import roads
from polefence.vehicle.roads import Road, bump, grade, kerb, measured_road, pothole, random_road

# ISO 8608, table of Gd(n0) [1e-6 m3]: geometric mean and upper limit of every class.
MEANS = dict(zip("ABCDEFGH", (16, 64, 256, 1024, 4096, 16384, 65536, 262144), strict=True))


def test_classes_of_the_standard():
    for letter, mean in MEANS.items():
        assert roughness(letter) == pytest.approx(mean * 1e-6)
    assert displacement_density("C", [0.1, 1.0]) == pytest.approx([256e-6, 256e-8])
    # (2 pi 0.1)^2 256e-6 20, and the same from Gd: (2 pi f)^2 Gd(f / v) / v at any f.
    assert velocity_density("C", 20) == pytest.approx(2.0213e-3, rel=1e-4)
    f = np.array([0.5, 3.0, 40.0])
    from_height = (2 * np.pi * f) ** 2 * displacement_density("C", f / 20) / 20
    np.testing.assert_allclose(from_height, velocity_density("C", 20))


def test_a_grade_rises_as_its_slope_says():
    road = grade(-0.05, 40.0, before=2.0, after=10.0)
    height = np.interp(
        [-2.0, 0.0, 20.0, 40.0, 50.0], road.distance - road.distance[0] - 2.0, road.height
    )
    assert height == pytest.approx([0.0, 0.0, -1.0, -2.0, -2.0])


@pytest.mark.parametrize("letter", ["A", "C", "H"])
def test_random_road_has_the_density_of_its_class(letter):
    """Welch's estimate over windows of 100 m, in octaves: within the class, near its mean."""
    road = random_road(letter, 4000, seed=1)
    step = road.distance[1] - road.distance[0]
    n, density = signal.welch(road.height, 1 / step, nperseg=round(100 / step))
    for low in 0.04 * 2.0 ** np.arange(7):
        inside = (n >= low) & (n < 2 * low)
        ratio = (density[inside] / displacement_density(letter, n[inside])).mean()
        assert ratio == pytest.approx(1, abs=0.15), low  # limits of a class: 0.5 and 2


def test_every_wave_has_its_amplitude_and_none_lies_outside_the_limits():
    road = random_road("B", 500, seed=2, low=0.05, high=4)
    height = road.height[:-1]
    power = 2 * np.abs(np.fft.rfft(height) / len(height)) ** 2  # mean square of every wave
    n = np.arange(len(power)) / 500
    inside = (n >= 0.05 - 1e-9) & (n <= 4 + 1e-9)
    np.testing.assert_allclose(power[inside] * 500, displacement_density("B", n[inside]))
    assert power[~inside].max() < 1e-12 * power[inside].min()
    # Mean square of the whole: the integral of the class between the limits.
    whole = roughness("B") * 0.01 * (1 / 0.05 - 1 / 4)
    assert np.mean(height**2) == pytest.approx(whole, rel=0.03)


def test_widest_spacing_still_holds_the_shortest_wave():
    height = random_road("B", 50, seed=4, low=0.05, high=10, spacing=0.05).height[:-1]
    power = 2 * np.abs(np.fft.rfft(height) / len(height)) ** 2
    wanted = displacement_density("B", np.arange(3, 501) / 50) / 50
    np.testing.assert_allclose(power[3:501], wanted, rtol=1e-6)


def test_road_velocity_is_white_with_the_density_of_class_and_speed():
    _, w = random_road("D", 6000, seed=3).velocity(20, 0.002)
    f, density = signal.welch(w, 500, nperseg=5000)
    wanted = velocity_density("D", 20)
    for low, high in ((0.3, 1), (1, 3), (3, 10), (10, 20)):
        inside = (f >= low) & (f < high)
        assert density[inside].mean() == pytest.approx(wanted, rel=0.08)


def test_seeds():
    one, again, other = (random_road("C", 200, seed=s) for s in (5, 5, 6))
    assert (one.height == again.height).all()
    assert abs(np.corrcoef(one.height, other.height)[0, 1]) < 0.9
    assert one.length == pytest.approx(200)
    assert one.height[0] == one.height[-1]
    assert not one.height.flags.writeable
    assert len(random_road("C", 200, seed=5, spacing=0.05).height) <= 4003


@settings(max_examples=40, deadline=None)
@given(st.floats(0.7, 80), st.floats(1e-3, 0.05), st.integers(0, 2**32 - 1))
def test_velocity_brings_the_wheel_to_the_height_of_the_road(speed, step, seed):
    rng = np.random.default_rng(seed)
    road = Road(np.cumsum(rng.uniform(0.01, 0.5, 60)) - 3, rng.normal(0, 0.05, 60))
    time, w = road.velocity(speed, step)
    assert time.shape == w.shape
    np.testing.assert_allclose(time, step * np.arange(len(time)))
    ends = road.distance[0] + speed * step * np.arange(1, len(time) + 1)
    assert ends[-1] <= road.distance[-1] + 1e-9
    assert ends[-1] + speed * step > road.distance[-1] - 1e-9
    risen = road.height[0] + step * np.cumsum(w)
    np.testing.assert_allclose(risen, np.interp(ends, road.distance, road.height), atol=1e-12)


def test_velocity_on_a_slope_is_slope_times_speed():
    time, w = Road([0.0, 10.0, 20.0], [0.0, 1.0, 1.0]).velocity(5, 0.25, duration=3)
    assert len(time) == 12
    np.testing.assert_allclose(w, [0.5] * 8 + [0.0] * 4, atol=1e-14)


def test_bump_is_a_cosine():
    road = bump(0.08, 4.0, before=2.0, after=10.0)
    x = np.linspace(0, 4, 999)
    wanted = 0.04 * (1 - np.cos(2 * np.pi * x / 4))
    found = np.interp(2 + x, road.distance, road.height)
    np.testing.assert_allclose(found, wanted, atol=4e-5 * 0.08)
    assert road.height.max() == pytest.approx(0.08)
    assert (road.length, road.height[0], road.height[-1]) == (16.0, 0.0, pytest.approx(0))
    assert bump(-0.08, 4.0).height.min() == pytest.approx(-0.08)


@pytest.mark.parametrize("length", [0.04, 0.1, 0.5])
def test_pothole_is_the_hole_averaged_over_the_contact(length):
    road = pothole(0.06, length, contact=0.1, before=1.0, after=5.0)
    fine = np.linspace(0.5, 2.5, 20_001)
    hole = -0.06 * ((fine >= 1.05) & (fine < 1.05 + length))
    mean = np.convolve(hole, np.ones(1000) / 1000, mode="same")  # the contact, 0.1 m
    np.testing.assert_allclose(np.interp(fine, road.distance, road.height), mean, atol=0.06 * 2e-3)
    assert road.height.min() == pytest.approx(-0.06 * min(1, length / 0.1))


def test_kerb_rises_over_the_contact_and_stays():
    road = kerb(0.03, contact=0.2, before=1.0, after=9.0)
    assert np.interp([1.0, 1.1, 1.2, 9], road.distance, road.height) == pytest.approx(
        [0, 0.015, 0.03, 0.03]
    )
    assert road.length == pytest.approx(10.2)
    assert kerb(-0.03).height[-1] == -0.03
    _, w = road.velocity(10, 0.001)
    assert w.sum() * 0.001 == pytest.approx(0.03)
    assert w.max() == pytest.approx(0.03 / 0.2 * 10)


def write(folder, text):
    path = folder / "lane.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("header", ["", "distance [m],height [m]\n", "x,h\n"])
def test_measured_road_reads_what_was_written(tmp_path, header):
    path = write(tmp_path, header + "0,0.01\n0.5,-2e-3\n 1.5 , 0.0\n\n")
    road = measured_road(path)
    assert road.distance.tolist() == [0, 0.5, 1.5]
    assert road.height.tolist() == [0.01, -0.002, 0.0]
    assert road.name == "lane"
    again = measured_road(path, spacing=0.25)
    np.testing.assert_allclose(again.distance, 0.25 * np.arange(7))
    np.testing.assert_allclose(
        again.height, [0.01, 0.004, -0.002, -0.0015, -0.001, -0.0005, 0], atol=1e-15
    )
    assert measured_road(path, spacing=0.4).distance[-1] == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,h\n0,1\n1,\n2,0\n", "row 3: no height; fill the gap"),
        ("0,1\n,1\n2,0\n", "row 2: no distance"),
        ("0,1\n1,nan\n2,0\n", "row 2: height nan is not a finite number"),
        ("x,h\n0,1\ninf,2\n", "row 3: distance inf is not a finite number"),
        ("0,1\n2,1\n1,0\n", "row 3: distance 1 m lies before .* 2 m; sort"),
        ("x,h\n0,1\n1,1\n1,0\n", "row 4: distance 1 m repeats"),
        ("0\n1\n", "row 1: one cell; give distance and height"),
        ("x\n1\n", "row 1: one cell"),
        ("0,1,2\n", "row 1: 3 cells"),
        ("0,1\n\n2,0\n", "row 2: empty"),
        ("0;1\n1;1\n", "row 1: one cell; .* a comma between"),
        ("0,1\n1,high\n", "row 2: height 'high' is not a number"),
        ("0,level\n1,2\n", "row 1: height 'level' is not a number"),
        ("x [mm],h [mm]\n0,1\n1,1\n", r"row 1: 'x \[mm\]' is in mm; give metres"),
        ("x,h\n0,1\n", "1 points; a road needs two"),
        ("", "0 points"),
        ('0,1\n1,"' + "2" * 200_000 + '"\n', "row 2: field larger"),
    ],
)
def test_unusable_files_are_named_with_their_row(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        measured_road(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_unreadable_files(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="absent.csv: cannot be read"):
        measured_road(tmp_path / "absent.csv")
    path = tmp_path / "raw.csv"
    path.write_bytes(b"0,1\n1,\xff\n")
    with pytest.raises(InputError, match="raw.csv: not UTF-8"):
        measured_road(path)
    monkeypatch.setattr(roads, "MAX_BYTES", 7)
    with pytest.raises(InputError, match="raw.csv: 8 bytes; at most 7"):
        measured_road(path)


LEVEL = Road([0.0, 100.0], [0.0, 0.0], "level")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: LEVEL.velocity(0, 0.01), r"speed \[m/s\] = 0; give a number above zero"),
        (lambda: LEVEL.velocity(-3, 0.01), r"speed \[m/s\] = -3"),
        (lambda: LEVEL.velocity(math.nan, 0.01), "speed"),
        (lambda: LEVEL.velocity("fast", 0.01), "speed .* = 'fast'"),
        (lambda: LEVEL.velocity(20, 0), "sampling step"),
        (lambda: LEVEL.velocity(20, 6.0), "passed in 5 s, less than a step of 6 s"),
        (lambda: LEVEL.velocity(20, 0.01, 6), "100 m long; 6 s at 20 m/s need 120 m"),
        (lambda: LEVEL.velocity(20, 1e-9), "5e[+]09 steps"),
        (lambda: LEVEL.velocity(1e-300, 1e-20), "steps"),
        (lambda: LEVEL.velocity(20, 1e-9, 4), "4e[+]09 steps"),
        (lambda: LEVEL.resample(0), "spacing"),
        (lambda: LEVEL.resample(101), "use 2 to"),
        (lambda: LEVEL.resample(1e-9), "1e[+]11 points"),
        (lambda: velocity_density("C", 0), "speed"),
        (lambda: velocity_density("I", 10), "no road class 'I'; known: A, B"),
        (lambda: random_road("Z", 10, 1), "no road class 'Z'"),
        (lambda: random_road("A", -10, 1), r"length \[m\] of a random road = -10"),
        (lambda: random_road("A", 0.05, 1), "no wave of 0.01 to 10 .* fits 0.05 m"),
        (lambda: random_road("A", 10, 1, low=3, high=2), "no wave"),
        (
            lambda: random_road("A", 10, 1, spacing=0.06),
            "cannot show 10 cycles/m; use at most 0.05",
        ),
        (lambda: random_road("A", 1e6, 1), "1.6e[+]08 points"),
        (lambda: random_road("A", 10, -1), "seed = -1"),
        (lambda: random_road("A", 10, 1.5), "seed = 1.5"),
        (lambda: bump(0.1, 0), "length of the bump"),
        (lambda: bump(0.0, 1), "height of the bump"),
        (lambda: grade(0.1, -1), "length of the grade"),
        (lambda: grade(float("nan"), 1), "slope of the grade"),
        (lambda: pothole(-0.1, 1), "depth"),
        (lambda: pothole(0.1, 1, contact=0), "contact"),
        (lambda: kerb(math.inf), "height of the kerb"),
        (lambda: kerb(0.1, after=-1), "road after"),
        (lambda: Road([0.0], [0.0]), "two points or more"),
        (lambda: Road([0, 1], [0, 1, 2]), "one length"),
        (lambda: Road([0, 1, 1], [0, 0, 0]), "point 3: distance 1 m repeats"),
        (lambda: Road([0, 1], [0, math.nan]), "point 2: height nan"),
    ],
)
def test_bad_input_is_named_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_letters_in_either_case():
    assert set(ROUGHNESS) == set(MEANS)
    assert roughness("c") == roughness("C")
