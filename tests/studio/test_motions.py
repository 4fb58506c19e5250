"""Motions of the car that is shown: heights that move as its signals say."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest

from polefence import Disk, place
from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.studio import State
from polefence.studio.rides import EVERY, ROADS, STEP, ridden, rides
from polefence.vehicle import drive, on_road

VALUES = {"m1": 300.0, "beta": 2.0}
GRAVITY = 9.81


@pytest.fixture(scope="module")
def design(physical):
    return place(physical, Disk(-40, 31), "scheduled")


@pytest.mark.parametrize("road", ROADS)
def test_newton_holds_for_what_is_drawn(physical, design, road):
    """Second differences of the heights; the tyre carries the car and what accelerates it."""
    own, distance, height = ridden(physical, design, VALUES, road, 20.0)
    assert height[0] == 0
    under = np.interp(20.0 * own.time, distance, height)
    assert own.tyre == pytest.approx((300 + 28.58) * GRAVITY + 155900 * (under - own.unsprung))
    assert own.travel == pytest.approx(own.unsprung - own.sprung)
    step = EVERY * STEP
    smooth = np.diff(own.sprung, 2) / step**2
    mean = (own.acceleration[:-2] + 4 * own.acceleration[1:-1] + own.acceleration[2:]) / 6
    assert np.corrcoef(smooth, mean)[0, 1] > 0.9
    assert own.sprung[0] == own.unsprung[0] == 0


def test_a_hill_is_climbed(physical, design):
    own, _, height = ridden(physical, design, VALUES, "hill, 6 %", 20.0)
    assert height[-1] == pytest.approx(0.06 * 30)
    assert own.sprung[-1] == pytest.approx(height[-1], abs=1e-2)


def test_a_pothole_taken_fast_lifts_the_wheel_and_a_good_road_never(physical, design):
    fast, _, _ = ridden(physical, design, VALUES, "pothole, 50 mm", 30.0)
    assert fast.lifted.any()
    assert (fast.tyre[fast.lifted] < 0).all()
    assert not ridden(physical, None, VALUES, "class A", 20.0)[0].lifted.any()


def test_comfort_is_that_of_the_drive(physical):
    own, _, _ = ridden(physical, None, VALUES, "class C", 20.0)
    chosen = ROADS["class C"]
    excitation = on_road(physical, chosen.make(20.0), 20.0, STEP, chosen.seconds(20.0))
    done = drive(physical, None, excitation, VALUES)
    assert own.acceleration == pytest.approx(done.of("sprung-mass acceleration")[0][::EVERY])
    assert 0.3 < own.comfort < 2
    assert "uncomfortable" in own.words


@pytest.mark.parametrize("road", ROADS)
def test_the_command_drives_the_same(physical, design, road, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(spec_text("quarter-car-physical"))
    design.save("design")
    state = State(Disk(-40, 31), road=road, speed=20.0, values=tuple(VALUES.items()))
    words = shlex.split(state.drive("car.toml"))[1:]
    assert main([*words, "-o", "drive.csv"]) == 0
    capsys.readouterr()
    head, *rows = (line.split(",") for line in (tmp_path / "drive.csv").read_text().splitlines())
    for name, law in (("passive", None), ("design", design)):
        column = head.index(f"{name}: sprung-mass acceleration [m/s2]")
        found = np.array([float(row[column]) for row in rows])[::EVERY]
        own = ridden(physical, law, VALUES, road, 20.0)[0].acceleration
        # the command is exact where the drive takes steps
        assert found == pytest.approx(own, abs=1e-3 * np.abs(own).max())


def test_which_plants_are_driven():
    assert rides(family("quarter-car-physical"))
    assert not rides(family("f16"))
    assert not rides(family("half-car"))
    assert all(re.match(r"--\w+", own.option) for own in ROADS.values())
