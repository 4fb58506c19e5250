"""What newcomers get wrong, and what they are told: one line that names the remedy."""

import pytest

from support.commands import ran, refused

CRANE = """
name = "crane"
states = ["trolley [m]", "rope angle [rad]", "speed [m/s]", "rate [rad/s]"]
inputs = ["force [N]"]
disturbances = ["push [m/s2]"]

[parameter.l]
range = [4, 8]
unit = "m"
through = "1/l"

[matrices]
A = [[0, 0, 1, 0], [0, 0, 0, 1], [0, 2, 0, 0], [0, "-12/l", 0, 0]]
B = [[0], [0], [0.001], ["-0.001/l"]]
E = [[0], [0], [0], [1]]
"""
PEAK = """
[[specification]]
kind = "initial peak"
signal = "force"
{}
at_most = 5000
"""


@pytest.fixture
def spec(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def written(text=""):
        (tmp_path / "crane.toml").write_text(CRANE + text)
        return "crane.toml"

    return written


@pytest.mark.parametrize("law", [["--schedule", "none"], ["--method", "quadratic"]])
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("points = [[5, 0, 0]]", "'force': initial state 1 of points has 3 numbers; crane has 4"),
        ("ellipsoid = [[1, 0], [0, 1]]", "'force': the ellipsoid is 2 x 2; crane has 4 states"),
    ],
)
def test_initial_states_of_another_size(spec, capsys, law, given, words):
    name = spec(PEAK.format(given))
    found = refused(capsys, "optimise", name, "--minimise", "gain of rope angle", *law)
    assert words in found
    assert "trolley, rope angle, speed, rate" in found


def test_a_region_on_the_wrong_side(spec, capsys):
    found = ran(capsys, "design", spec(), "--region", "half_plane(-1)")
    assert "note: half_plane(-1) lets poles go up to +1; left of -1 is half_plane(1)" in found
    found = ran(capsys, "design", spec(), "--region", "half_plane(0.1)")
    assert "note" not in found


def test_a_region_out_of_reach_names_the_other_way(spec, capsys):
    region = "half_plane(1) & sector(0.9) & disk(-2, 2)"
    found = ran(capsys, "design", spec(), "--region", region, status=1)
    assert "a tuned law ([law] in the spec) may reach further" in found


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["desing", "crane.toml"], "no command 'desing'; did you mean 'design'?"),
        (
            ["tightest", "crane.toml", "--of", "half_plane", "--method", "slack"],
            "slack finds disks only; for a half_plane use quadratic or scheduled",
        ),
        (
            ["verify", "crane.toml", "--gain", "[1 2 3 4]", "--limit", "gain of rope angle < 0.1"],
            "'< 0.1' at its end; a limit is written <= NUMBER, with a decimal point",
        ),
        (
            ["verify", "crane.toml", "--gain", "[1 2 3 4]", "--limit", "gain of rope angle 0,1"],
            "',1' at its end; a limit is written <= NUMBER, with a decimal point",
        ),
    ],
)
def test_words_that_are_none(spec, capsys, words, remedy):
    spec()
    assert remedy in refused(capsys, *words)


def test_a_key_below_the_tables(spec, capsys):
    name = spec('region = "half_plane(1)"\n')
    assert "matrices: unknown key 'region'; it belongs to the top of the file" in refused(
        capsys, "design", name
    )


def test_measured_signals_in_one_word(spec, capsys):
    words = ["observe", spec(), "--disk", "-3", "2.5"]
    one = ran(capsys, *words, "--measured", "trolley, rope angle")
    two = ran(capsys, *words, "--measured", "trolley", "--measured", "rope angle")
    assert one == two
