"""Laws with states of their own, a design's, analysed and verified afresh from the spec."""

import re

import pytest

from support.commands import ran, refused
from support.specs import SPRING

SPEC = f"""
{SPRING}
[law]
%s
[[specification]]
kind = "rms"
signal = "x"
density = 1
minimise = true
[[specification]]
kind = "rms"
signal = "f"
density = 1
at_most = 20
"""
ORDER = 'measured = ["x"]\nschedule = []\norder = 1'
PID = 'measured = ["x"]\nschedule = []\nkind = "pid"\nderivative_bandwidth = 10'
LATE = ["--sample-time", "0.02", "--delay", "0.5"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "order.toml").write_text(SPEC % ORDER)
    (tmp_path / "pid.toml").write_text(SPEC % PID)
    return tmp_path


def level(text):
    """What a command says is proved of x."""
    return float(re.search(r"rms of x(?: \[m\])?[; ]+([0-9.]+)", text)[1])


@pytest.mark.parametrize("law", ["order", "pid"])
@pytest.mark.parametrize("time", [[], LATE], ids=["continuous", "sampled"])
def test_a_design_is_judged_as_it_was_made(folder, capsys, law, time):
    spec = f"{law}.toml"
    made = ran(capsys, "optimise", spec, *time, "--region", "half_plane(0)", "-o", "car")
    limit = "rms of x with density 1"
    judged = ran(capsys, "analyse", spec, "--gain", "car", *time, "--limit", limit)
    assert level(judged) == pytest.approx(level(made), rel=2e-3)
    kept = ran(capsys, "verify", spec, "--gain", "car", *time)
    assert "rms of f" in kept


def test_states_of_another_time_are_refused_in_one_line(folder, capsys):
    ran(capsys, "optimise", "order.toml", "-o", "car")
    ran(capsys, "optimise", "order.toml", *LATE, "-o", "seen")
    said = refused(capsys, "analyse", "order.toml", "--gain", "car", *LATE)
    assert "in continuous time; leave out --sample-time" in said
    said = refused(capsys, "analyse", "order.toml", "--gain", "seen")
    assert "give --sample-time 0.02, and its --delay" in said
