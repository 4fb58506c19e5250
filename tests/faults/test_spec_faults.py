"""One bad input a test: the command line answers with one clear line and exit 2."""

from __future__ import annotations

import pytest

from polefence.cli.main import main

GOOD = """
name = "car"
states = ["position [m]", "velocity [m/s]"]
[constants]
d = 0.5
[parameter.m]
range = [1.0, 2.0]
unit = "kg"
through = "1/m"
[definitions]
k = "3*d"
[matrices]
A = [[0, 1], ["-k/m", "-d/m"]]
B = [[0], ["1/m"]]
"""
VERTEX = "[[vertex]]\nA = [[0, 1], [2, 3]]\nB = [[0], [1]]\n"

WEIGHT = GOOD + '[[weight]]\nsignal = "position"\n'
FAULTS = {
    "nan entry": (VERTEX.replace("2", "nan"), r"vertex 1: A[2][1] = NaN must be a finite number"),
    "infinite entry": (VERTEX.replace("3", "inf"), "finite number"),
    "ragged": (VERTEX.replace("[2, 3]", "[2]"), "vertex 1: A is ragged: row 2 has 1 entries"),
    "not square": (VERTEX.replace("[2, 3]", "[2, 3], [4, 5]"), "must be square"),
    "B too short": (VERTEX.replace("[[0], [1]]", "[[1]]"), "B has 1 rows; A has 2"),
    "B of zeros": (VERTEX.replace("[[0], [1]]", "[[0], [0]]"), "B is zero"),
    "shapes differ": (VERTEX + "[[vertex]]\nA = [[1]]\nB = [[1]]\n", "vertex 2 has 1 states"),
    "uncontrollable": (
        VERTEX + "[[vertex]]\nA = [[1, 0], [0, 2]]\nB = [[0], [1]]\n",
        "vertex 2 is uncontrollable",
    ),
    "interval reversed": (
        GOOD.replace("[1.0, 2.0]", "[2.0, 1.0]"),
        "m: range = [2, 1] is reversed",
    ),
    "interval empty": (GOOD.replace("[1.0, 2.0]", "[2.0, 2.0]"), "range = [2, 2] is empty"),
    "mass touches zero": (GOOD.replace("[1.0, 2.0]", "[0.0, 2.0]"), "touches zero"),
    "range of one": (GOOD.replace("[1.0, 2.0]", "[1.0]"), "range must be two numbers"),
    "range of words": (GOOD.replace("[1.0, 2.0]", '["a", "b"]'), "must be a finite number"),
    "unknown name": (GOOD.replace("3*d", "3*e"), "unknown name 'e'"),
    "call": (GOOD.replace("3*d", "tan(d)"), "which is neither a function nor a table here"),
    "a zero in the box": (GOOD.replace('"-d/m"', '"1/(sin(m) - sin(m))"'), "a denominator may be"),
    "division by zero": (GOOD.replace('"-d/m"', '"d/(d-0.5)"'), "divides by zero"),
    "circle": (GOOD.replace("3*d", "k*d"), "definitions go in a circle: k -> k"),
    "unknown key": (GOOD.replace("[matrices]", "[matrces]"), "did you mean 'matrices'"),
    "unknown parameter key": (GOOD.replace("unit", "untl"), "did you mean 'unit'"),
    "both forms": (GOOD + VERTEX, "exclude each other"),
    "no matrices": ('name = "x"\n', "neither"),
    "B missing": (GOOD.replace('B = [[0], ["1/m"]]', ""), "matrices: B is missing"),
    "wrong signal count": (GOOD.replace('"position [m]", ', ""), "states names 1 signals"),
    "states no list": (
        GOOD.replace('["position [m]", "velocity [m/s]"]', '"x"'),
        "list of strings",
    ),
    "constant a word": (GOOD.replace("d = 0.5", 'd = "x"'), "constants.d"),
    "constant a truth": (GOOD.replace("d = 0.5", "d = true"), "constants.d"),
    "constant a date": (GOOD.replace("d = 0.5", "d = 1979-05-27"), "constants.d"),
    "name twice": (GOOD.replace("k = ", "d = "), "given twice"),
    "toml syntax": (GOOD.replace("[constants]", "[constants"), "not valid TOML"),
    "huge exponent": (GOOD.replace("0.5", "1e999999999"), "out of range"),
    "E for some": (VERTEX + "E = [[0], [1]]\n" + VERTEX, "for all or for none"),
    "region a number": (GOOD.replace("states", "region = 4\nstates"), "region must be a string"),
    "sample time zero": ("sample_time = 0\n" + VERTEX, "sample_time = 0 must be positive"),
    "sample time negative": ("sample_time = -0.1\n" + VERTEX, "must be positive, in seconds"),
    "sample time a word": ('sample_time = "10 ms"\n' + VERTEX, "sample_time"),
    "sample time infinite": ("sample_time = inf\n" + VERTEX, "must be a finite number"),
    "weight of nothing": (GOOD + '[[weight]]\ntransfer = "1"\n', "weight 1: signal is missing"),
    "weight no list": (GOOD + "[weight]\nsignal = 'position'\n", "write [[weight]]"),
    "weight without transfer": (WEIGHT, "no transfer function; give one, as transfer = "),
    "weight improper": (WEIGHT + 'transfer = "s"\n', "divide by a fast pole, such as (s/1000 + 1)"),
    "weight unstable": (WEIGHT + 'transfer = "1/(s - 2)"\n', "the pole 2 is not stable; move it"),
    "weight of another name": (WEIGHT + 'transfer = "1/(q + 2)"\n', "transfer: unknown name 'q'"),
    "weight in two forms": (
        WEIGHT + 'transfer = "1"\ngain = 2\n',
        "transfer beside gain; give",
    ),
    "weight, half a form": (WEIGHT + "poles = [-2]\n", "zeros is missing; give zeros, poles, gain"),
    "weight, unknown key": (WEIGHT + 'transfr = "1"\n', "weight 1: unknown key 'transfr'; did you"),
    "weight, unknown signal": (
        WEIGHT.replace('signal = "position"', 'signal = "speed"') + 'transfer = "2"\n',
        "weight of 'speed': no signal or disturbance 'speed'; known: position, u1, velocity",
    ),
    "weight, words": (WEIGHT + 'makeweight = ["a", 1, 2]\n', "makeweight = 'a' is not a number"),
    "weight, one root": (
        WEIGHT + 'zeros = []\npoles = ["-1+1j"]\ngain = 1\n',
        "poles: -1+1j has no conjugate; give both",
    ),
    "weight's name taken": (
        WEIGHT + 'transfer = "2"\nname = "velocity"\n',
        "has a signal 'velocity' already; rename it",
    ),
    "reference of nothing": (GOOD + "[reference.r]\n", "reference.'r': signal is missing"),
    "reference, unknown signal": (
        GOOD + "[reference.r]\nsignal = 'speed'\n",
        "reference 'r': no signal 'speed'; known",
    ),
    "reference no table": (GOOD + "[reference]\nr = 'position'\n", "must be a table; write [ref"),
    "reference, number": (GOOD + "[reference.r]\nsignal = 3\n", "signal must be a list of strings"),
    "parameter no table": (
        GOOD.replace("[parameter.m]", "[x]\n[parameter]\nm = 3\n[y]"),
        "unknown",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_spec(fault, tmp_path, capsys):
    text, message = FAULTS[fault]
    spec = tmp_path / "bad.toml"
    spec.write_text(text)
    out = tmp_path / "rows.json"
    assert main(["limits", str(spec), "--centre", "-4", "--json", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(spec) in error
    assert message in error
    assert not out.exists()


def test_the_good_spec_is_good(tmp_path, capsys):
    spec = tmp_path / "good.toml"
    spec.write_text(GOOD)
    assert main(["limits", str(spec), "--centre", "-4", "--method", "slack"]) == 0


USAGE = {
    "missing file": (["limits", "none.toml", "--centre", "-4"], "none.toml: cannot be read"),
    "centre on the right": (["limits", "SPEC", "--centre", "4"], "not in the left half-plane"),
    "centre nan": (["limits", "SPEC", "--centre", "nan"], "not finite"),
    "no centre": (["limits", "SPEC"], "no centre given"),
    "radius zero": (["design", "SPEC", "--disk", "-4", "0"], "radius = 0 must be positive"),
    "radius negative": (["design", "SPEC", "--disk", "-4", "-1"], "must be positive"),
    "disk on the right": (["design", "SPEC", "--disk", "4", "1"], "not in the left half-plane"),
    "output under a file": (["design", "SPEC", "--disk", "-4", "3", "-o", "SPEC/x"], "cannot be"),
    "json under a file": (["limits", "SPEC", "--centre", "-4", "--json", "SPEC/x"], "cannot be"),
    "figure of no kind": (["limits", "SPEC", "--centre", "-4", "--plot", "x.gif"], "ends in .png"),
    "resume without file": (["limits", "SPEC", "--centre", "-4", "--resume"], "needs --json"),
    "count": (["limits", "SPEC", "--centres", "-4", "-5", "1"], "whole number"),
    "jobs": (["limits", "SPEC", "--centre", "-4", "--jobs", "0"], "at least 1"),
    "no such example": (["example", "quarter-car-phsical"], "did you mean"),
    "right-hand sides": (
        ["design", "SPEC", "--disk", "-4", "3", "--method", "slack", "--right-hand-sides"],
        "belongs to the method scheduled",
    ),
    "no region": (["design", "SPEC"], "names no region; give --disk CENTRE RADIUS or --region"),
    "region misspelt": (["design", "SPEC", "--region", "dsik(-4, 3)"], "did you mean 'disk'?"),
    "degree of one gain": (
        ["limits", "SPEC", "--centre", "-4", "--method", "quadratic", "--degree", "2"],
        "--degree belongs to scheduled and slack",
    ),
    "degree negative": (["design", "SPEC", "--disk", "-4", "3", "--degree", "-1"], "0 to 8"),
    "degree too high": (["limits", "SPEC", "--centre", "-4", "--degree", "9"], "0 to 8"),
    "elevation with auto": (
        ["design", "SPEC", "--disk", "-4", "3", "--degree", "auto", "--elevation", "1"],
        "auto chooses the elevation",
    ),
    "auto for slack": (
        ["design", "SPEC", "--disk", "-4", "3", "--degree", "auto", "--method", "slack"],
        "--degree auto belongs to the method scheduled",
    ),
    "budget without auto": (
        ["design", "SPEC", "--disk", "-4", "3", "--budget", "9"],
        "--budget belongs to --degree auto",
    ),
    "budget zero": (
        ["design", "SPEC", "--disk", "-4", "3", "--degree", "auto", "--budget", "0"],
        "--budget = 0 must be positive",
    ),
    "right-hand sides and degree": (
        ["design", "SPEC", "--disk", "-4", "3", "--degree", "2", "--right-hand-sides"],
        "leave the others out",
    ),
    "right-hand sides of no disk": (
        ["design", "SPEC", "--region", "half_plane(1)", "--right-hand-sides"],
        "is for a single disk, not half_plane(1)",
    ),
    "design's figure": (["design", "SPEC", "--disk", "-4", "3", "--plot", "x.gif"], "ends in .png"),
    "two results in one file": (
        ["design", "SPEC", "--disk", "-4", "3", "--plot", "x.svg", "--json", "x.svg"],
        "named for two results",
    ),
    "tightest disk of no centre": (["tightest", "SPEC", "--of", "disk"], "needs --centre"),
    "centre of a sector": (
        ["tightest", "SPEC", "--of", "sector", "--centre", "-4"],
        "--centre belongs to --of disk",
    ),
    "disk within": (
        ["tightest", "SPEC", "--of", "disk", "--centre", "-4", "--within", "sector(0.3)"],
        "--within belongs to",
    ),
    "within misspelt": (
        ["tightest", "SPEC", "--of", "half_plane", "--within", "disk(-4)"],
        "disk(centre, radius) takes 2 numbers",
    ),
    "tightest by slack": (
        ["tightest", "SPEC", "--of", "half-plane", "--method", "slack"],
        "the method slack finds disks only; for a",
    ),
    "paper folder": (["paper", "-o", "SPEC/x"], "cannot be"),
}


@pytest.mark.parametrize("fault", USAGE)
def test_bad_usage(fault, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.toml").write_text(GOOD)
    words, message = USAGE[fault]
    assert main([word.replace("SPEC", "spec.toml") for word in words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert [p.name for p in tmp_path.iterdir()] == ["spec.toml"]


def test_a_file_too_long_or_binary_is_refused(tmp_path, capsys):
    for name, content, message in (
        ("long.toml", b"#" * 1_000_001, "longer than"),
        ("binary.toml", b"\xff\xfe\x00", "not UTF-8"),
    ):
        (tmp_path / name).write_bytes(content)
        assert main(["limits", str(tmp_path / name), "--centre", "-4"]) == 2
        assert message in capsys.readouterr().err
