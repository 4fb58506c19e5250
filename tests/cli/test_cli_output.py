"""Where answers go: JSON on standard output, nothing at all, gains that can be given back."""

import json

import numpy as np
import pytest

from polefence import InputError, Parameter, PlantError, UncertainPlant, load
from polefence.cli.given import read_gain
from polefence.cli.lines import MOST_GAINS, gain_lines, matrix_text
from polefence.cli.main import main
from support.commands import ran, refused

SPEC = """
[parameter.k]
range = [1, 2]
unit = "N/m"
[matrices]
A = [[0, 1], ["-k", -1]]
B = [[0], [1]]
"""


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(SPEC)
    return str(path)


DESIGN = ["design", "SPEC", "--disk", "-3", "2.5", "--method", "quadratic"]
JSON = {
    "design": DESIGN,
    "limits": ["limits", "SPEC", "--centre", "-3", "--method", "quadratic"],
    "tightest": ["tightest", "SPEC", "--of", "disk", "--centre", "-3", "--method", "quadratic"],
    "analyse": ["analyse", "SPEC", "--gain", "[[-3, -3]]", "--region", "half_plane(0.1)"],
}


@pytest.mark.parametrize("command", JSON)
def test_json_on_standard_output_is_all_there_is(command, spec, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = [spec if word == "SPEC" else word for word in JSON[command]]
    assert main([*words, "--json", "-"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["plant"]["vertices"] == 2
    assert "proved" in err  # what people read goes there
    assert main([*words, "--json", "-", "--quiet"]) == 0
    quiet, err = capsys.readouterr()
    assert json.loads(quiet).keys() == json.loads(out).keys()
    assert err == ""
    assert not list(tmp_path.glob("-*"))
    assert main(words) == 0  # and standard output is given back
    assert "proved" in capsys.readouterr().out


def test_rows_cannot_be_resumed_from_standard_output(spec, capsys):
    assert main(["limits", spec, "--centre", "-3", "--json", "-", "--resume"]) == 2
    assert "--resume needs --json FILE" in capsys.readouterr().err


def test_quiet_leaves_the_status_and_errors(spec, tmp_path, capsys):
    assert main([*DESIGN[:1], spec, *DESIGN[2:], "--quiet", "-o", str(tmp_path / "d")]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["check", str(tmp_path / "d"), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["check", str(tmp_path / "none.json"), "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)


def test_gains_print_as_they_are_taken(spec, capsys):
    assert main([DESIGN[0], spec, *DESIGN[2:]]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "K = " in line]
    printed = line.split("K = ")[1]
    assert main(["analyse", spec, "--gain", printed, "--region", "half_plane(0.1)"]) == 0
    plant = load(spec)
    for text in (printed, "[1 -2.5e-3]", "[ 1, 2 ]", "[[1, 2]]", "[1 2;]"[:-2] + "]"):
        assert read_gain(plant, text).K.shape == (1, 2)
    K = np.array([[1.5, -2e-7], [3.0, 4e5]])
    two = UncertainPlant.from_vertices([np.eye(2)], [np.eye(2)])
    assert np.array_equal(read_gain(two, matrix_text(K.tolist())).K, K)
    for text in ("[1 2; 3]", "[1 e]", "[;]", "[1;; 2]", "[--1 2]"):
        with pytest.raises(InputError):
            read_gain(two, text)


def test_gains_of_many_vertices_are_summarised():
    few = {f"K at vertex {j}": [[float(j), -float(j)]] for j in range(1, MOST_GAINS + 1)}
    assert len(gain_lines(few)) == MOST_GAINS
    many = few | {"K at vertex 64": [[64.0, -64.0]]}
    least, greatest, note = gain_lines(many)
    assert "[1 -64]" in least
    assert "[64 -1]" in greatest
    assert "--json" in note


def test_a_margin_as_wide_as_the_interval_says_so(spec, tmp_path, capsys):
    ran(capsys, DESIGN[0], spec, *DESIGN[2:6], "scheduled", "-o", tmp_path / "d")
    assert main(["service", str(tmp_path / "d")]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "of the estimate" in line]
    assert line.endswith("N/m, the whole interval: it need not be known")
    narrow = ["design", spec, "--disk", "-3", "0.2", "--method", "scheduled"]
    ran(capsys, *narrow, "-o", tmp_path / "n")
    assert main(["service", str(tmp_path / "n")]) in (0, 1)
    assert "whole interval" not in capsys.readouterr().out


def test_no_higher_degree_is_advised_where_there_is_none(spec, capsys):
    # both poles within 1e-9: the last bit of a gain moves them by 4e-8
    words = ["tightest", spec, "--of", "half-plane", "--within", "disk(-3, 1e-9)"]
    for method in ("quadratic", "scheduled"):
        assert main([*words, "--method", method]) == 1
        assert ("a higher degree" in capsys.readouterr().err) == (method == "scheduled")


def test_a_parameter_that_changes_nothing_is_refused(spec, tmp_path, capsys):
    path = tmp_path / "unused.toml"
    path.write_text(SPEC + "[parameter.spare]\nrange = [1, 2]\n")
    error = refused(capsys, "limits", path, "--centre", "-3")
    assert "parameter spare changes no entry" in error
    assert "leave it out" in error
    p, q = Parameter("p", 1, 2), Parameter("q", 1, 2, "", "1/q")
    with pytest.raises(PlantError, match="parameter p changes no entry"):
        UncertainPlant.from_expressions([p, q], [["1/q + 0*p"]], [[1]])
    for rows in ((["-p"], [[1]], None), ([-1], [["p"]], None), ([-1], [[1]], [["p"]])):
        A, B, E = rows
        assert len(UncertainPlant.from_expressions([p], [A], B, E).vertices) == 2


def test_margins_of_whole_intervals_are_whole(tmp_path, capsys):
    """0.2 is no short binary number: rounded to one, the margin would fall just short of it."""
    path = tmp_path / "spec.toml"
    friction = '[parameter.b]\nrange = [0.1, 0.3]\nunit = "N s/m"\n'
    path.write_text(friction + SPEC.replace('["-k", -1]', '["-k", "-b"]'))
    design = ["design", str(path), "--disk", "-3", "2.9", "-o", str(tmp_path / "d")]
    assert main(design) == 0
    assert main(["service", str(tmp_path / "d"), "-o", str(tmp_path / "s")]) == 0
    lines = {line.split("  ")[0]: line for line in capsys.readouterr().out.splitlines()}
    own = lines["error of the estimate, b"]
    assert own.endswith("N s/m, the whole interval: it need not be known")
    assert " 0.2 " in own
    every = lines["error of the estimate, all at once"]
    assert every.endswith("of each range, the whole intervals: no parameter need be known")
    assert lines["rate of change, b"].endswith("(N s/m)/s")
    assert main(["check", str(tmp_path / "s" / "estimate-b.json")]) == 0
    out = ran(capsys, "check", tmp_path / "s" / "rate-b.json")
    assert "b wrong by up to 0.2 N s/m, " in out
    assert "(N s/m)/s, " in out


def test_service_says_where_the_law_itself_is_outside(spec, tmp_path, capsys):
    design = [DESIGN[0], spec, *DESIGN[2:6], "scheduled", "-o", str(tmp_path / "d")]
    ran(capsys, *design)
    words = ["service", str(tmp_path / "d"), "--decay", "40"]
    out = ran(capsys, *words, "--region", "disk(-3, 0.01)", status=1)
    assert "note: even without an error at k = " in out
    assert "is not in disk(-3, 0.01)" in out
    assert "stable, with a decay rate of 40 1/s; ask for a lower decay rate by --decay" in out
    assert "\nat these rates" not in out
    assert "even without" not in ran(capsys, "service", tmp_path / "d", "--region", "half_plane(0)")


def test_the_disk_that_is_advised_is_of_the_plant_s_speed(tmp_path, capsys):
    spec = tmp_path / "slow.toml"
    for speed in (1, 1000):
        spec.write_text(
            f"[matrices]\nA = [[-{speed}, 0], [{speed}, -{speed}]]\nB = [[1], [0]]\n"
            "[parameter.p]\nrange = [1, 2]\n".replace("[[1], [0]]", "[['p'], [0]]")
        )
        out = ran(capsys, "tightest", spec, "--of", "sector")
        centre = float(out.partition("by --within, for example 'disk(")[2].partition(",")[0])
        assert 10 * speed <= -centre <= 100 * speed
