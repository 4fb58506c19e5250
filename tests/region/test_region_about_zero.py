"""Disks and ellipses about points that are not on the left: parts of regions that lie there."""

import numpy as np
import pytest

from polefence import (
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
    place,
    tightest,
)
from polefence.base.errors import RegionError
from polefence.cli.main import main
from polefence.law.structure import Structure
from polefence.proof.regions import parts_of, require_left
from polefence.proof.work import FormatError
from polefence.region.regions import region_of
from polefence.region.text import parse_region
from polefence.requirements.gain import Gain
from polefence.search.optimise import optimise
from polefence.studio.handles import Handle, moved
from support.commands import ran

STANDARD = HalfPlane(1) & Sector(0.7) & Disk(0, 500)
SPEC = """
name = "axis"
states = ["angle", "speed"]
inputs = ["torque"]
disturbances = ["load"]
region = "half_plane(1) & sector(0.7) & disk(0, 30)"
[parameter.J]
range = [0.8, 1.3]
through = "1/J"
[matrices]
A = [[0, 1], [0, "-0.2/J"]]
B = [[0], ["1/J"]]
E = [[0], ["1/J"]]
"""


def axis():
    from polefence.plant.spec import loads

    return loads(SPEC)


@pytest.fixture
def spec(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "axis.toml").write_text(SPEC)
    return "axis.toml"


KEEPS = [HalfPlane(0), HalfPlane(2), Sector(0.1), Wedge(-1, 3), VerticalStrip(-9, 0)]
KEEPS += [Disk(-4, 3), Ellipse(-3, 2, 9)]
LEAVES = [HalfPlane(-0.1), Wedge(0.1, 3), Wedge(-1, -3), VerticalStrip(-9, 0.1), Disk(-3, 4)]
LEAVES += [HorizontalStrip(2), Ellipse(-2, 3, 1)]
ROUND = [Disk(0, 500), Disk(3, 7), Ellipse(0, 20, 3), Ellipse(1, 2, 2)]


@pytest.mark.parametrize("part", ROUND)
@pytest.mark.parametrize("other", KEEPS)
def test_another_part_keeps_the_left_half_plane(part, other):
    region = part & other
    assert parse_region(str(region)) == region
    parts = parts_of(region.document())
    require_left(parts, discrete=False)
    kinds = [(own.kind, own.numbers) for own in parts]
    assert region_of(kinds) == region
    assert region.stable


@pytest.mark.parametrize("part", ROUND)
@pytest.mark.parametrize("other", [None, *LEAVES])
def test_alone_it_is_no_region(part, other):
    """Nor beside a part that reaches over zero, in the checker too."""
    region = part if other is None else part & other
    with pytest.raises(RegionError, match="not in the left half-plane"):
        parse_region(str(region))
    with pytest.raises(FormatError, match="must be negative"):
        require_left(parts_of(region.document()), discrete=False)
    with pytest.raises(RegionError, match="not in the left half-plane"):
        analyse(axis(), [[-2, -2]], region)


def test_the_unit_disk_in_continuous_time_needs_another_part():
    with pytest.raises(RegionError, match="add & half_plane"):
        place(axis(), Disk(0, 1))
    assert place(axis(), Disk(0, 1) & HalfPlane(0)).proved


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_the_standard_region_is_placed_and_proved(method):
    region = HalfPlane(1) & Sector(0.7) & Disk(0, 30)
    design = place(axis(), region, method)
    assert check(design).proved
    poles = design.poles(np.array([[s, 1 - s] for s in np.linspace(0, 1, 51)]))
    assert poles.real.max() < -1
    assert np.abs(poles).max() < 30
    assert (-poles.real / np.abs(poles)).min() > 0.7


def test_both_sides_of_its_radius():
    """Poles of s^2 + 4 s + 5 have the modulus sqrt(5)."""
    plant = UncertainPlant.from_vertices([[[0, 1], [0, 0]]], [[[0], [1]]])
    K, radius = [[-5, -4]], 5**0.5
    for size, answer in ((radius * (1 + 1e-9), "proved"), (radius * (1 - 1e-9), "refuted")):
        assert analyse(plant, K, HalfPlane(1) & Disk(0, size)).answer == answer


def test_what_else_is_asked_of_it():
    plant, region = axis(), HalfPlane(1) & Sector(0.5) & Disk(0, 30)
    scheduled = place(plant, region)
    assert analyse(plant, scheduled.law, region).proved
    assert analyse(plant, scheduled.law, region & Disk(-3, 1)).answer == "refuted"
    tuned = place(plant, region, structure=Structure(schedule=(), degree=0))
    assert check(tuned).proved
    assert tightest(plant, of="sector", within=Disk(0, 30)).region.parts[0].damping > 0.9
    observer = observe(plant, ["angle"], region)
    assert observer.design.region == region
    done = optimise(plant, Gain("angle"), (), region, "quadratic")
    poles = done.design.poles(np.eye(2))
    assert region.contains(poles)
    assert check(done.design).proved


@pytest.mark.parametrize(
    "command",
    [
        ["design", "axis.toml", "-o", "d"],
        ["analyse", "axis.toml", "--gain", "[-20 -9]", "-o", "d"],
        ["verify", "axis.toml", "--gain", "[-20 -9]", "-o", "d"],
        [
            "optimise",
            "axis.toml",
            "--minimise",
            "gain of angle",
            "--method",
            "quadratic",
            "-o",
            "d",
        ],
        ["tightest", "axis.toml", "--of", "half_plane", "--within", "disk(0, 30)", "-o", "d"],
    ],
)
def test_commands_take_it_and_their_files_are_checked(spec, capsys, command):
    assert main(command) == 0, capsys.readouterr()
    assert "disk(0, 30)" in capsys.readouterr().out
    assert "disk(0, 30)" in ran(capsys, "check", "d", "--spec", spec)
    assert main(["report", "d", "-o", "r.html"]) == 0


def test_discrete_time_still_wants_a_disk_in_the_unit_disk(spec, capsys):
    assert main(["design", spec, "--sample-time", "0.01"]) == 2
    assert "discrete-time plant; give a disk in the unit disk" in capsys.readouterr().err


def test_a_handle_in_the_studio_may_be_dragged_over_zero_only_where_another_part_helps():
    region = HalfPlane(1) & Disk(-4, 3)
    handle = Handle(-4 + 0j, (1,), centre=True)
    assert moved(region, handle, 2 + 0j) == HalfPlane(1) & Disk(2, 3)
    with pytest.raises(RegionError, match="not in the left half-plane"):
        moved(Disk(-4, 3), Handle(-4 + 0j, (0,), centre=True), 2 + 0j)


def test_a_checked_region_is_one_of_the_plants_own_time():
    """The unit disk keeps no loop of continuous time, nor the left half-plane one of samples."""
    unit, large = parts_of(Disk(0, 1).document()), parts_of(Disk(0.5, 2).document())
    left = parts_of((Disk(0, 500) & HalfPlane(0)).document())
    require_left(unit, discrete=True)
    require_left((*unit, *large), discrete=True)
    require_left(left, discrete=False)
    for parts, discrete in ((unit, False), (large, True), (left, True)):
        with pytest.raises(FormatError, match="must be negative"):
            require_left(parts, discrete=discrete)
