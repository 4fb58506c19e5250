"""Parameters that move from the command line: what is said of them, and what is refused."""

from pathlib import Path

import pytest

from polefence.cli.main import main
from support.commands import ran, refused

SPEC = """
name = "walk"
{time}
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
[parameter.p]
range = [0.4, 1.2]
rate = {rate}
[matrices]
A = {A}
B = [[0], [1]]
E = [[0.1], [0.3]]
"""
AT_SAMPLES = {"time": "sample_time = 0.5", "A": '[[0.9, 0.4], ["-0.5*p", 0.7]]'}
IN_TIME = {"time": "", "A": '[[0, 1], ["-p", -1]]'}
FACTOR = "decays by 0.778801^k in k samples"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("form", "rate", "region", "how", "proved"),
    [
        (AT_SAMPLES, "[-0.1, 0.1]", "half_plane(0.5)", "moving by up to 0.1 1/s", FACTOR),
        (AT_SAMPLES, '"any"', "half_plane(0)", "moving at any rate", "is exponentially stable"),
        (IN_TIME, "[-1, 2]", "half_plane(0.5)", "moving by -1 to 2 1/s", "decays by exp(-0.5 t)"),
    ],
)
def test_what_is_said_is_what_is_checked(folder, capsys, form, rate, region, how, proved):
    (folder / "walk.toml").write_text(SPEC.format(**form, rate=rate))
    said = ran(capsys, "design", "walk.toml", "--region", region, "-o", "out")
    assert f"  the poles are for constant parameters; with p {how} the loop {proved}" in said
    checked = ran(capsys, "check", "out", "--spec", "walk.toml")
    assert f"with p {how}" in checked
    # the same plant with other rates is another
    (folder / "still.toml").write_text(SPEC.format(**form, rate="[0, 0]"))
    assert "NOT about still.toml" in ran(capsys, "check", "out", "--spec", "still.toml", status=1)


def test_a_region_that_says_nothing_of_motions_is_said_to(folder, capsys):
    (folder / "walk.toml").write_text(SPEC.format(**AT_SAMPLES, rate='"any"'))
    assert main(["design", "walk.toml", "--disk", "0.2", "0.6"]) == 0
    assert "note: nothing is proved for p moving at any rate" in capsys.readouterr().out


def test_estimates_that_are_off_are_said_of_parameters_at_rest(folder, capsys):
    (folder / "walk.toml").write_text(SPEC.format(**AT_SAMPLES, rate="[-0.1, 0.1]"))
    words = ["design", "walk.toml", "--region", "half_plane(0.1)", "--method", "scheduled"]
    said = ran(capsys, *words, "--error", "p=0.02")
    off = "for estimates that the law is given and that are off, for constant parameters: p by"
    assert off in said
    assert "with p moving by up to 0.1 1/s, of exact estimates, the loop decays" in said


def test_samples_are_of_parameters_at_rest(folder, capsys):
    (folder / "walk.toml").write_text(SPEC.format(**IN_TIME, rate="[-1, 1]"))
    words = ["design", "walk.toml", "--region", "half_plane(0.1)", "--sample-time", "0.01"]
    said = refused(capsys, *words)
    assert (
        "walk.toml: --sample-time 0.01: parameter p: rate: samples are for constant parameters"
        in said
    )


TABLE = """
disturbances = ["w"]
[parameter.p]
range = [1, 3]
rate = [-0.2, 0.1]
[table.spring]
arguments = [1, 2, 3]
values = [4, 2, 6]
[matrices]
A = [[0, 1], ["-spring(p)", -1]]
B = [[0], [1]]
E = [[0], [1]]
"""


def test_a_drive_within_the_rates_of_the_spec_is_covered(tmp_path, monkeypatch, capsys):
    """A proof on the cells of a grid has no margin of rates; the spec's own are proved."""
    monkeypatch.chdir(tmp_path)
    Path("moving.toml").write_text(TABLE)
    words = ["verify", "moving.toml", "--gain", "[[0, 0]]", "--region", "half_plane(0)"]
    ran(capsys, *words, "-o", "made")
    drive = ["simulate", "made", "--step-in", "w=1", "--duration", "20"]
    for end, above in ((11.5, True), (13.5, False)):  # 0.118 and 0.0952 a second
        said = ran(capsys, *drive, "--set", "p=1", "--drift", f"p=2@3..{end}")
        assert ("rate of change above what is proved" in said) == above
