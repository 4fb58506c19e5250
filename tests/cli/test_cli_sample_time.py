"""Designs at a sample time from the command line: files, comparisons with specs, code, refusals."""

import json
import re
from dataclasses import replace
from fractions import Fraction

import pytest

from polefence import HalfPlane, at_sample_time, load, place
from polefence.cli.main import main
from polefence.plant.spec import dumps
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import Rounded
from polefence.proof.claims.samples import Samples
from polefence.proof.document import loads
from support.commands import ran, refused
from support.files import rewritten

SPEC = """
name = "spring"
states = ["x [m]", "v [m/s]"]
inputs = ["f [N]"]
disturbances = ["w [N]"]
[parameter.m]
range = [0.8, 1.2]
unit = "kg"
through = "1/m"
[matrices]
A = [[0, 1], ["-100/m", "-2/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
[[specification]]
kind = "rms"
signal = "x"
density = 1
minimise = true
[[specification]]
kind = "rms"
signal = "f"
density = 1
at_most = 3
"""
AT = ["--sample-time", "0.02", "--delay", "1"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spring.toml").write_text(SPEC)
    (tmp_path / "heavy.toml").write_text(SPEC.replace("1.2", "1.3"))
    (tmp_path / "stiff.toml").write_text(SPEC.replace("-100", "-101"))
    (tmp_path / "named.toml").write_text(SPEC.replace("f [N]", "f [kN]"))
    return tmp_path


def design(folder, *more):
    words = ["design", "spring.toml", "--region", "half_plane(1)", "--method", "quadratic"]
    return main([*words, *AT, "-o", "out", *more])


def test_a_design_is_about_its_spec_and_no_other(folder, capsys):
    assert design(folder) == 0
    said = capsys.readouterr().out
    assert (
        "  at samples every 20 ms, not between them; inputs and disturbances held, inputs" in said
    )
    assert main(["check", "out", "--spec", "spring.toml"]) == 0
    assert "plant: samples every 20 ms of x' = A x + B u + E w" in capsys.readouterr().out
    for other, words in (
        ("heavy.toml", "but NOT about heavy.toml"),
        ("stiff.toml", "but NOT about stiff.toml: other vertices"),
        ("named.toml", "but NOT about named.toml: other names: inputs[1]"),
    ):
        assert words in ran(capsys, "check", "out", "--spec", other, status=1)


def test_a_file_whose_plant_is_changed_is_not_proved(folder, capsys):
    assert design(folder) == 0
    path = folder / "out" / "design.json"
    with rewritten(path) as data:
        data["claims"][-1]["vertices"][0]["A"][1][0] = -130
    assert main(["check", "out"]) == 1
    assert "farther from the vertices' than the remainder says" in capsys.readouterr().out


def test_specifications_are_kept_at_a_sample_time(folder, capsys):
    said = ran(capsys, "optimise", "spring.toml", *AT, "-o", "out")
    assert "  inputs held for 20 ms, inputs act 1 sample late; rms at all times, all else" in said
    found = ran(capsys, "check", "out", "--spec", "spring.toml")
    assert "rms of 'f' = u1 <= 3 at density 1, at all times, with inputs held for 20 ms" in found
    assert main(["tightest", "spring.toml", "--of", "disk", "--centre", "0.3", *AT]) == 0


def test_code_is_proved_with_the_samples_as_they_are(folder, capsys):
    assert design(folder) == 0
    said = ran(capsys, "export", "out", "--float", "32", "-o", "code")
    assert (
        "Run every 20 ms, the plant's own, u acting 1 sample late, as the plant has it"
        in " ".join(said.split())
    )
    document = loads((folder / "code" / "guarantee.json").read_text())
    assert isinstance(document.claims[-1], Samples)
    (claim,) = (own for own in document.claims if isinstance(own, Rounded))
    assert prove(claim).proved
    gain = claim.gain
    (own,) = gain.subject.design.evidence
    for spread in (
        replace(own.spread, omega=[[x / 2 for x in row] for row in own.spread.omega]),
        replace(own.spread, rows=tuple(10**6 * x for x in own.spread.rows)),
    ):
        poles = replace(gain.subject.design, evidence=(replace(own, spread=spread),))
        fault = replace(gain, subject=replace(gain.subject, design=poles))
        assert not prove(fault).proved
    # an error so large that it moves what the remainder is multiplied with
    assert not prove(replace(gain, error=gain.error * Fraction(10**12))).proved
    assert main(["check", "code", "--spec", "spring.toml"]) == 0


def test_a_gain_that_is_given_is_judged_as_a_computer_runs_it(folder, capsys):
    given = ["analyse", "spring.toml", "--gain", "[[-30, -12]]"]
    half = ["--region", "half_plane(1)"]
    seen = ["--sample-time", "0.02", "--delay", "1"]
    assert "inputs act 1 sample late" in ran(capsys, *given, *half, *seen, "-o", "judged")
    assert main(["check", "judged", "--spec", "spring.toml"]) == 0
    assert main([*given, *half, "--sample-time", "0.12", "--delay", "1"]) == 1
    assert "refuted" in capsys.readouterr().out
    said = ran(capsys, *given, "--of", "disk", "--centre", "0", *seen, "-o", "least")
    found = (re.search(rf"{word} radius ([0-9.]+)", said)[1] for word in ("proved:", "sampled:"))
    radius, worst = map(float, found)
    assert worst < radius < 1.02 * worst
    assert main(["check", "least", "--spec", "spring.toml"]) == 0
    for law, how in (("scheduled", "scheduled"), ("one", "quadratic")):  # designed so
        made = ["design", "spring.toml", *half, *seen, "--method", how, "-o", law]
        ran(capsys, *made)
        words = ["analyse", "spring.toml", "--gain", law, *half, *seen]
        assert "proved: all poles of 'spring'" in ran(capsys, *words)
        assert "refuted: rms of f <= 3; sampled" in ran(capsys, *words, "--limit", "spec", status=1)
        assert main(["analyse", "spring.toml", "--gain", law, *half]) == 2
        assert "spring needs 1 x 2" in capsys.readouterr().err
    table = {"grid": {"m": [1, 2]}, "gains": [[[-30, -12]]] * 2}
    (folder / "table.json").write_text(json.dumps(table))
    assert main(["analyse", "spring.toml", "--gain", "table.json", *half, *seen]) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--delay", "1"], "--delay counts samples: give --sample-time too"),
        (["--sample-time", "0"], "spring.toml: --sample-time 0: sample_time = 0 must be positive"),
        (["--sample-time", "nan"], "spring.toml: --sample-time nan: "),
        (["--sample-time", "9"], "--sample-time 9: .*take a shorter sample time"),
        (["--sample-time", "0.1", "--delay", "-1"], "delay = -1.0 must be 0 to 64, in samples"),
    ],
)
def test_bad_sample_times_are_one_line(folder, capsys, words, message):
    assert main(["design", "spring.toml", "--region", "half_plane(1)", *words, "-o", "out"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert re.search(message, said), said
    assert not (folder / "out").exists()


def test_a_spec_in_discrete_time_has_its_own_sample_time(folder, capsys):
    (folder / "own.toml").write_text(SPEC.replace('name = "', 'sample_time = 0.1\nname = "'))
    words = ["design", "own.toml", "--region", "half_plane(1)", "--sample-time", "0.1"]
    assert "is in discrete time already, every 0.1 s" in refused(capsys, *words)


def test_a_trade_off_is_of_the_samples(folder, capsys):
    words = ["tradeoff", "spring.toml", "--minimise", "rms of x with density 2"]
    words += ["--over", "rms of f with density 2"]
    words += ["--value", "2", "--value", "3", "--method", "quadratic"]
    said = ran(capsys, *words, "--sample-time", "0.02", "--delay", "1")
    assert "inputs held for 20 ms, inputs act 1 sample late; rms at all times" in said
    assert said.count(" proved ") >= 2
    assert main([*words, "--delay", "1"]) == 2
    assert "--delay counts samples: give --sample-time too" in capsys.readouterr().err


def test_samples_that_bend_are_not_those_of_a_spec_in_discrete_time(folder, capsys):
    seen = at_sample_time(load("spring.toml"), 0.02, 0, 2)
    (folder / "seen.toml").write_text(dumps(replace(seen, remainder=None, sampling=None)))
    place(seen, HalfPlane(1), "quadratic").save("out")
    ran(capsys, "check", "out", "--spec", "spring.toml")
    assert main(["check", "out", "--spec", "seen.toml"]) == 1
    assert "its plant is no function of the parameters that a spec says" in capsys.readouterr().out


def test_a_sample_time_at_which_nothing_moves_the_plant_is_said(tmp_path, monkeypatch, capsys):
    """Half a period of an oscillator: at samples no input held in between moves its mode."""
    monkeypatch.chdir(tmp_path)
    text = (
        'name = "oscillator"\n[matrices]\nA = [[0, 1], [-9.869604401089358, 0]]\nB = [[0], [1]]\n'
    )
    (tmp_path / "oscillator.toml").write_text(text)
    words = ["design", "oscillator.toml", "--region", "half_plane(0.5)", "--sample-time"]
    said = refused(capsys, *words, "1", status=1)
    assert "no disk within the unit circle" in said
    assert "is hardly controllable at this sample time" in said
    assert main([*words, "0.3"]) == 0


def test_a_clock_that_jitters_is_in_the_bounds_and_in_the_file(folder, capsys):
    words = ["optimise", "spring.toml", *AT, "--jitter", "0.1", "-o", "out", "--json", "out.json"]
    said = ran(capsys, *words)
    assert "  inputs held for 18 to 22 ms in any order, inputs act 1 sample late" in said
    rate = float(re.search(r"in any order the loop decays by exp\(-([0-9.]+) t\)", said)[1])
    whole = json.loads((folder / "out.json").read_text())["decay in any order"]
    assert whole * (1 - 1e-5) < rate <= whole
    found = ran(capsys, "check", "out", "--spec", "spring.toml")
    assert "rms of 'x' = x1 <= " in found
    said = "at all times, with inputs held for 18 to 22 ms in any order, and the loop stable"
    assert said in found
    document = json.loads((folder / "out" / "design.json").read_text())
    clocks = [claim["held"]["clock"] for claim in document["claims"] if "held" in claim]
    spans = [{"least": "9/10", "most": "11/10", "parts": 1}]
    assert clocks == [{"spans": spans}] * 3
    assert f"decay by exp(-{rate:g} t), at samples" in " ".join(found.split())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--jitter", "0.1"], "--jitter is of the sample time: give --sample-time too"),
        (["--lost", "1"], "--lost is of the sample time: give --sample-time too"),
        ([*AT, "--jitter", "1"], "jitter = 1 must be at least 0 and below 1"),
        ([*AT, "--lost", "99"], "lost = 99 must be 0 to 16"),
    ],
)
def test_a_clock_that_cannot_be_is_one_line(folder, capsys, words, told):
    assert main(["optimise", "spring.toml", *words, "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not (folder / "out").exists()


@pytest.mark.parametrize("kind", ["saturation", "initial peak"])
def test_an_impulse_at_a_sample_time_is_one_line(folder, capsys, kind):
    limit = f"{kind} of f <= 40 with impulse 2"
    for words in (["optimise", "spring.toml"], ["verify", "spring.toml", "--gain", "[[-9, -3]]"]):
        said = refused(capsys, *words, *AT, "--limit", limit)
        assert f"{kind} of f: impulse = 2: at a sample time" in said
        assert "give that state as points: E of the continuous plant times 2" in said


CART = """
name = "cart"
states = ["x [m]", "v [m/s]"]
inputs = ["f [N]"]
disturbances = ["w [N]"]
[matrices]
A = [[0, 1], [0, "-1/10"]]
B = [[0], ["1/10"]]
E = [[0], [1]]
"""


@pytest.mark.parametrize(("lost", "answer"), [("2", "proved"), ("3", "refuted")])
def test_analyse_says_how_many_lost_samples_a_loop_bears(folder, capsys, lost, answer):
    """Of a loop that is stable for constant periods up to 1.7294 s."""
    (folder / "cart.toml").write_text(CART)
    words = ["analyse", "cart.toml", "--gain", "[[-3.75, -11.5]]", "--region", "half_plane(0)"]
    words += ["--limit", "rms of x <= 100 with density 1", "--sample-time", "0.5", "--lost", lost]
    main(words)
    said = capsys.readouterr().out
    assert f"{answer}: rms of x <= 100; " in said
    bears = "the loop bears at most 2 lost samples in a row" in said
    assert bears == (answer == "refuted") == ("unstable where every period is the longest" in said)
    assert ("and the loop is stable" in said) == (answer == "proved")


def test_a_trade_off_of_a_clock_that_jitters_has_a_decay_rate_in_each_row(folder, capsys):
    clock = ["--sample-time", "0.02", "--delay", "1", "--jitter", "0.1"]
    over = ["--over", "rms of f with density 1", "--value", "40", "--method", "quadratic"]
    words = ["tradeoff", "spring.toml", *clock, *over, "--jobs", "1", "--json", "rows.json"]
    said = ran(capsys, *words)
    assert "decay: at least this rate [1/s], for these periods in any order" in said
    (row,) = json.loads((folder / "rows.json").read_text())["rows"]
    claims = loads(json.dumps(row["performance"])).claims
    (decay,) = [claim for claim in claims if claim.kind == "decay"]
    assert row["decay in any order"] == float(decay.level) > 0
    assert prove(decay).proved
    lines = [re.split(r"  +", text.strip()) for text in said.splitlines()]
    at = next(k for k, cells in enumerate(lines) if cells[0] == "limit")
    assert float(lines[at + 1][lines[at].index("decay")]) == pytest.approx(
        float(decay.level), rel=1e-3
    )
    # a run that is taken up proves it afresh, and refuses another rate
    assert "decay: at least" in ran(capsys, *words, "--resume")
    written = (folder / "rows.json").read_text()
    for faster in (1.5, 0.5):
        changed = json.loads(written)
        changed["rows"][0]["decay in any order"] *= faster
        (folder / "rows.json").write_text(json.dumps(changed))
        assert "a row is damaged" in refused(capsys, *words, "--resume")
    changed = json.loads(written)
    (table,) = [t for t in changed["rows"][0]["performance"]["claims"] if t["kind"] == "decay"]
    table["level"] = str(2 * Fraction(table["level"]))
    changed["rows"][0]["decay in any order"] *= 2
    (folder / "rows.json").write_text(json.dumps(changed))
    assert "a row is damaged" in refused(capsys, *words, "--resume")
    steady = ran(capsys, *words[:6], *over, "--jobs", "1")
    assert "decay" not in steady
