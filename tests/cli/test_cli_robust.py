"""`robust` from the command line: what is said, written and refused."""

import json
import re

import pytest

from polefence import check
from polefence.examples import spec_text
from support.commands import ran, refused

SPRING = """\
name = "spring"
states = ["x [m]", "v [m/s]"]
inputs = ["f [N]"]
disturbances = ["w [N]"]
region = "half_plane(0.1)"
[parameter.k]
range = [1, 3]
unit = "N/m"
[parameter.m]
range = [1, 2]
unit = "kg"
through = "1/m"
[matrices]
A = [[0, 1], ["-k/m", "-1/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
[[specification]]
kind = "gain"
signal = "x"
at_most = 4
"""
TABLE = '{"grid": {"k": [1, 3], "m": [1, 2]}, "K": [[[[0,0]],[[0,0]]],[[[0,0]],[[0,0]]]]}'


@pytest.fixture(autouse=True)
def spring(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spring.toml").write_text(SPRING)
    return tmp_path


def numbers(line):
    return [float(x) for x in re.findall(r"  (?:at least )?(\d[\d.]*)", line)[:2]]


def test_both_sides_each_parameter_and_the_worst_case(spring, capsys):
    words = ["robust", "spring.toml", "--gain", "none", "-o", "out", "--json", "all.json"]
    said = ran(capsys, *words).splitlines()
    assert said[0].startswith("spring: half_plane(0.1), gain of x <= 4, for ranges so many times")
    names = ["all ranges", "k alone", "m alone"]
    found = json.loads((spring / "all.json").read_text())
    reaches = [found["largest"], *found["alone"].values()]
    assert list(found["alone"]) == ["k", "m"]
    for line, name, reach in zip(said[2:5], names, reaches, strict=True):
        assert line.startswith(name)
        if reach["at least"]:
            assert name == "m alone"
            assert line.endswith("-  until m = 0, where the plant does not exist")
            continue
        proved, refuted = numbers(line)
        assert (proved, refuted) == (reach["proved"], reach["refuted"])
        assert 1 < proved < refuted <= proved * 1.001
        assert reach["at"].keys() == {"k", "m"}
    k = found["alone"]["k"]
    assert k["proved"] <= 1.75 <= k["refuted"] * (1 + 1e-9)  # k = 2 - f = 1 / 4
    assert "gain of x <= 4 is exceeded" in k["reason"]
    assert k["exact"]
    (worst,) = found["worst"]
    assert worst["signal"] == "gain of x"
    assert worst["proved"] * 0.998 <= worst["attained"] <= worst["proved"]
    assert said[-2:] == ["saved: out/design.json", "saved: all.json"]
    assert check("out").proved


def test_limits_and_regions_of_options_come_before_those_of_the_spec(capsys):
    words = ["robust", "spring.toml", "--gain", "none", "--limit", "none", "--disk", "-1", "3"]
    said = ran(capsys, *words)
    assert said.startswith("spring: disk(-1, 3), for ranges")
    assert "worst" not in said


def test_a_design_keeps_its_region_where_the_spec_has_none(spring, capsys):
    (spring / "car.toml").write_text(spec_text("quarter-car-m1"))
    ran(capsys, "design", "car.toml", "--disk", "-40", "31", "-o", "own")
    said = ran(capsys, "robust", "car.toml", "--law", "own", "-o", "out")
    assert said.startswith("quarter car, physical, m1: disk(-40, 31)") or "disk(-40, 31)" in said
    assert "alone" not in said
    assert check("out").proved


def test_margins_have_both_sides_and_files_that_check_proves(spring, capsys):
    unmodelled = "unmodelled dynamics of f with weight (s+1)/(0.1*s+1)"
    limits = ["--limit", "disk margin of f", "--limit", unmodelled]
    words = ["robust", "spring.toml", "--gain", "[[-1, -1]]", *limits, "-o", "out"]
    said = ran(capsys, *words, "--json", "all.json")
    assert "saved: out/refuted.json" in said
    assert "delta = " in said
    for worst in json.loads((spring / "all.json").read_text())["worst"]:
        assert worst["proved"] < worst["refuted"] < worst["proved"] * 1.001
        assert abs(worst["errors"][0]["gain"]) == worst["refuted"]
        assert worst["errors"][0]["loop"] == "f"
        assert worst["exact"]
        assert "attained" not in worst
    for name in ("design", "refuted", "margins"):
        assert ran(capsys, "check", f"out/{name}.json").startswith(f"out/{name}.json: proved: ")


def test_a_plant_without_parameters_has_worst_cases(spring, capsys):
    text = SPRING.replace("region", "#").replace('"-k/m", "-1/m"', "-2, -1").replace('"1/m"', "1")
    (spring / "one.toml").write_text(
        re.sub(r"\[parameter.*?\[matrices", "[matrices", text, flags=re.S)
    )
    said = ran(capsys, "robust", "one.toml", "--gain", "[[-1, -1]]", "--limit", "disk margin of f")
    assert said.startswith("proved: spring: half_plane(0)\nworst cases:\n  disk margin of f: 1.")
    assert " fails, delta = " in said
    assert "without parameters" in refused(
        capsys, "robust", "one.toml", "--gain", "none", "--limit", "none"
    )


def test_of_dampers_it_says_what_to_ask(spring, capsys):
    damper = '[damper.f]\ndeflection = "x"\nrange = [1, 4]\n'
    (spring / "damper.toml").write_text(SPRING.replace("[[spec", damper + "[[spec"))
    said = ran(capsys, "robust", "damper.toml", "--gain", "none", "--limit", "none")
    assert "the controllable dampers give no force" in said


def test_a_law_that_fails_at_the_centre_is_refuted_in_one_line(capsys):
    said = ran(capsys, "robust", "spring.toml", "--gain", "[9 0]", status=1)
    assert said.startswith("refuted: at the centre of all ranges the pole")
    assert said.count("\n") == 1


def test_ranges_that_are_too_wide_already_end_with_one(spring, capsys):
    (spring / "wide.toml").write_text(SPRING.replace("[1, 3]", "[0.05, 3.95]"))
    words = ["robust", "wide.toml", "--gain", "none", "--limit", "none"]
    said = ran(capsys, *words, status=1)
    assert numbers(said.splitlines()[2])[1] < 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--gain", "none", "--limit", "gain of y"], "no signal 'y'"),
        (["--gain", "none", "--limit", "wobble of x"], "--limit"),
        (["--gain", "none", "--region", "disk(1)"], "disk"),
        (["--gain", TABLE], "ends at its outer knots"),
        ([], "a spec has no gain"),
        (["--law", "nowhere"], "nowhere"),
    ],
)
def test_bad_input_is_refused_in_one_line(capsys, words, said):
    assert said in refused(capsys, "robust", "spring.toml", *words)


def test_vertices_are_refused(spring, capsys):
    text = "[[vertex]]\nA = [[-1]]\nB = [[1]]\n[[vertex]]\nA = [[-2]]\nB = [[1]]\n"
    (spring / "vertices.toml").write_text(text)
    said = refused(capsys, "robust", "vertices.toml", "--gain", "none")
    assert "[parameter.NAME]" in said
