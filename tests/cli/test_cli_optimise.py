"""`polefence optimise`: what it prints and writes, what `check` makes of it, what it refuses."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from polefence import Design, InputError, load
from polefence.cli.main import main
from polefence.region.regions import HalfPlane
from polefence.region.text import digits_up
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.text import RoadSpectrum, load_specifications, parse_specification
from support.commands import ran, refused
from support.files import rewritten

PLANT = """
name = "stage"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["shock [m/s2]"]
region = "half_plane(0.2)"
[parameter.k]
range = [1, 3]
unit = "N/m"
[matrices]
A = [[0, 1], ["-k", -0.1]]
B = [[0], [1]]
E = [[0], [1]]
"""
ASKED = """
[[specification]]
kind = "rms"
signal = "x"
density = 2
minimise = true
[[specification]]
kind = "rms"
signal = "force"
density = 2
at_most = 1.5
[[specification]]
kind = "gain"
signal = "v"
at_most = 4
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a spec and what `optimise` made of it: the LMI's law, of W and Z."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "stage.toml").write_text(PLANT + ASKED)
    spec, out = str(folder / "stage.toml"), str(folder / "stage")
    more = ["--json", str(folder / "s.json"), "--plot", str(folder / "s.png")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("polefence.search.optimise._best_tuned", lambda *_: None)
        assert main(["optimise", spec, "--method", "scheduled", "-o", out, *more]) == 0
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    """A copy of it, entered."""
    shutil.copytree(made, tmp_path / "made")
    monkeypatch.chdir(tmp_path / "made")
    return tmp_path / "made"


def test_files_say_what_was_proved(here, capsys):
    design = Design.load("stage")
    assert design.region == HalfPlane(0.2)
    document = json.loads(Path("s.json").read_text())
    assert (document["answer"], document["method"]) == ("proved", "scheduled(1, 0, box)")
    assert document["gains"]["K at vertex 1"] == design.law.gain([1, 0]).tolist()
    first, force, gain = document["bounds"]
    assert [b["signal"] for b in document["bounds"]] == ["x", "force", "v"]
    assert first["limit"] is None
    assert (force["proved"], gain["proved"]) == (1.5, 4)
    assert gain["unit"] == "m/s per m/s2"
    for bound in document["bounds"]:
        assert bound["worst sampled"] <= bound["proved"]
        assert bound["conservatism"] == bound["proved"] / bound["worst sampled"]
        assert bound["passive"] is None  # no quarter car
    assert first["conservatism"] < 1.05  # one matrix for everything
    assert Path("s.png").read_bytes().startswith(b"\x89PNG")
    said = ran(capsys, "check", "stage")
    assert "  poles in half_plane(0.2), of A + B K with K(alpha) = Z W^-1 of degree 1, on " in said
    assert "  rms of 'x' = x1 <= " in said


def test_bounds_of_one_gain_are_of_the_parameters(here, capsys):
    """Those are proved on the box, whatever the region is: the sentence is of the less."""
    text = PLANT.replace("[matrices]", "[parameter.c]\nrange = [0.1, 0.2]\n[matrices]")
    Path("two.toml").write_text(text.replace("-0.1", '"-c"'))
    words = ["--minimise", "rms of x with density 2"]
    words += ["--limit", "rms of force <= 1.5 with density 2", "--method", "quadratic"]
    out = ran(capsys, "optimise", "two.toml", *words, "-o", "two")
    assert out.splitlines()[0].endswith(" and, for every alpha of the box,")
    said = ran(capsys, "check", "two")
    assert ", on the simplex of 4 vertices, method " in said or ", on the box of 2 " in said
    assert said.count(", on the box\n") == 2


def test_the_same_is_asked_by_options(here, capsys):
    Path("bare.toml").write_text(PLANT)
    words = ["--minimise", "rms of x with density 2", "--limit", "gain of v <= 4"]
    out = ran(
        capsys, "optimise", "bare.toml", *words, "--limit", "RMS of force<=1.5 with density 2"
    )
    assert out.startswith("proved: one gain of all states keeps all poles of 'stage' in half_plane")
    head, *rows = out.splitlines()[1:5]
    assert head.split() == ["proved", "sampled", "10000", "ratio"]
    assert [row.split()[-1] for row in rows] == ["minimised", "limit", "limit"]
    level = float(rows[0].split()[4])
    exactly = json.loads(Path("s.json").read_text())["bounds"][0]["proved"]
    assert level <= exactly  # of that file's law, which is begun at
    # an option takes the place of the spec's limit on the same, another is added
    words = [
        "--limit",
        "rms of force <= 1.2 with density 2",
        "--limit",
        "rms of v <= 9 with density 2",
    ]
    out = ran(capsys, "optimise", "stage.toml", *words, "--method", "quadratic", "--region",
              "half_plane(0)")  # fmt: skip
    assert out.startswith("proved: one gain of all states keeps all poles of 'stage' in half_")
    assert "rms of force [N] 1.2 " in " ".join(out.split())
    assert out.count(" limit\n") == 3


def test_what_is_not_proved_names_the_conflict(here, capsys, lmi_alone):
    words = ["optimise", "stage.toml", "--limit", "rms of force <= 0.01 with density 2"]
    words += ["--region", "half_plane(0)", "--limit", "rms of x <= 0.3 with density 2"]
    out = ran(capsys, *words, "-o", "no", status=1)
    assert out.startswith("refuted: at vertex ")
    assert out.endswith(" times each: rms of force <= 0.01; rms of x <= 0.3\n")
    assert not Path("no").exists() or not list(Path("no").iterdir())
    words = ["optimise", "stage.toml", "--limit", "rms of force <= 0.01 with density 2"]
    words += ["--limit", "gain of v <= 0.01", "--method", "scheduled"]
    out = ran(capsys, *words, "-o", "no", status=1)
    assert out.startswith("not proved: scheduled(1, 0, box) finds no law for all of these limits")
    assert not Path("no").exists() or not list(Path("no").iterdir())


def test_limits_alone_and_relative_to_no_control(here, capsys):
    Path("bare.toml").write_text(PLANT)
    words = ["--limit", "relative rms of x <= 0.5 with density 2"]
    words += ["--limit", "gain of v <= 4", "--method", "quadratic"]
    out = ran(capsys, "optimise", "bare.toml", *words, "-o", "any", "--json", "any.json")
    assert "minimised" not in out
    assert "one Lyapunov matrix" not in out
    ratio, gain = json.loads(Path("any.json").read_text())["bounds"]
    assert (ratio["limit"], ratio["proved"], ratio["unit"], gain["limit"]) == (0.5, 0.5, "", 4)
    assert ratio["worst sampled"] < 0.5
    said = "relative rms of 'x' = x1 <= 0.5 of that of {}, at density 2"
    assert said.format("no control") in ran(capsys, "check", "any")
    # of another loop than the plant under no control it is proved too, and said
    change("any/design.json", ["claims", 1, "baseline", "K"], [[1e-9, 0]])
    assert said.format("a loop that the file defines") in ran(capsys, "check", "any")
    error = refused(capsys, "optimise", "bare.toml")
    assert "bare.toml: nothing is asked; give --minimise" in error


# --- one number changed ---------------------------------------------------------------------------


def change(path, keys, value):
    with rewritten(Path(path)) as document:
        table = document
        for key in keys[:-1]:
            table = table[key]
        assert isinstance(table, list) or table.get(keys[-1]) != value
        table[keys[-1]] = value
    return document


CHANGES = {
    "lower level": (["claims", 1, "level"], 0.05, "rms of 'x' = x1 <= 0.05 at density 2"),
    "more noise": (["claims", 2, "intensity"], 40, "= u1 <= 1.5 at density 80"),
    "evidence": (["law", "W", 0, 0, 0], -1, "refuted: claim 1, region: at alpha = "),
    "asymmetry": (["law", "W", 0, 0, 1], 1e-3, "is not symmetric"),
    "another output": (["claims", 1, "output", "C", 0, 0], "1/2", "output called 'x' is"),
    "another name": (["claims", 2, "name"], "v", "output called 'v' is another"),
    "law": (["law", "Z", 0, 0, 0], 1000.0, "refuted: claim 1, region: at alpha = "),
    "disturbance": (["plant", "vertices", 0, "E", 1, 0], 5, "not positive definite"),
}  # fmt: skip


@pytest.mark.parametrize("case", CHANGES)
def test_one_number_changed_is_not_proved(here, capsys, case):
    keys, value, message = CHANGES[case]
    change("stage/design.json", keys, value)
    out = ran(capsys, "check", "stage", status=1)
    assert message in out
    assert "design.json: proved" not in out


def test_another_disturbance_is_seen(here, capsys):
    change("stage/design.json", ["plant", "vertices", 0, "E", 1, 0], 0.5)
    out = ran(capsys, "check", "stage", "--spec", "stage.toml", status=1)
    assert "other vertices: vertex 1: E[2][1] = 0.5, spec 1" in out


def test_what_is_no_performance_file_is_refused(here, capsys):
    path = Path("stage/design.json")
    whole = path.read_text()
    path.write_text(whole[:900])
    assert "design.json: " in refused(capsys, "check", "stage/design.json")
    path.write_text(whole.replace('"rms"', '"rns"', 1))
    assert "kind must be one of region" in refused(capsys, "check", "stage")
    path.write_text(whole.replace('"level"', '"levels"', 1))
    assert "claims[2].level is missing" in refused(capsys, "check", path)


def test_a_line_keeps_the_density_of_the_table_it_replaces():
    """The noise is the plant's, whatever is asked of it; a ratio is the same with any."""
    known = {"force": 2.0}
    assert parse_specification("rms of force <= 1", known=known).density == 2
    assert parse_specification("rms of force <= 1 with density 3", known=known).density == 3
    road = RoadSpectrum("C", 20)
    assert parse_specification("rms of force <= 1", road, known).density == road.density
    assert parse_specification("relative rms of v <= 1").density == 1
    with pytest.raises(InputError, match="with density D"):
        parse_specification("rms of v <= 1", known=known)


def test_the_command_knows_that_density(tmp_path, capsys, lmi_alone):
    spec = tmp_path / "stage.toml"
    spec.write_text(PLANT + ASKED)
    words = ["optimise", spec, "--method", "quadratic", "--json", "-"]
    asked = ["--minimise", "rms of x", "--limit", "rms of force <= 1.4"]
    plain = json.loads(ran(capsys, *words, *asked))
    full = [f"{text} with density 2" for text in ("rms of x", "rms of force <= 1.4")]
    given = json.loads(ran(capsys, *words, "--minimise", full[0], "--limit", full[1]))
    assert plain["bounds"] == given["bounds"]
    out = ran(
        capsys, "tradeoff", spec, "--over", "rms of force", "--value", 1.4, "--method", "quadratic"
    )
    assert digits_up(plain["bounds"][0]["proved"]) in out


def test_no_integral_is_advised_against_what_an_input_must_hold(tmp_path, capsys):
    """A push of 1 that the force must balance: u = -1 at rest, whatever the law's integrals."""
    spec = tmp_path / "cart.toml"
    free = PLANT.replace('"-k", -0.1', '0, "-k"')  # k is a friction, and nothing pulls back
    spec.write_text(free)
    limit = "rms of force <= 0.2 with density 0.01"
    asked = ["--minimise", "rms of x with density 0.01", "--limit", limit]
    out = ran(capsys, "optimise", spec, "--method", "quadratic", *asked)
    assert "note: that is more than is allowed of the rms of force" in out
    assert "an input that has to hold the disturbance needs that beside its rms" in out
    assert "integral" not in out


# --- bad input ------------------------------------------------------------------------------------

WORDS = {
    "signal": (["--limit", "gain of u <= 1"], "--limit 'gain of u <= 1': no signal 'u'; known:"),
    "kind": (["--limit", "peak of v <= 1"], "kind = 'peak' is unknown; known: bump, delay margin"),
    "form": (["--limit", "rms v <= 1"], "'rms v <= 1' is not of the form KIND of SIGNAL"),
    "no limit": (["--limit", "gain of v"], "--limit 'gain of v' has no limit"),
    "zero": (["--limit", "gain of v <= 0"], "at_most = 0.0 of 'v' must be a positive number"),
    "nan": (["--limit", "gain of v <= nan"], "'nan' behind <=; a limit is a number alone"),
    "huge": (["--limit", "gain of v <= 1e999"], "at_most is too large a number"),
    "key": (["--limit", "rms of v <= 1 with densty 2"], "unknown key densty = 2; did you mean"),
    "twice": (["--limit", "gain of v <= 1", "--limit", "gain of v <= 2"], "is given twice"),
    "density": (["--limit", "rms of v <= 1"], "neither density nor a road is given; write density"),
    "filter": (["--limit", "rms of v <= 1 with weight Wx with density 1"], "weight = 'Wx' is unkn"),
    "start": (["--limit", "initial peak of v <= 1"], "'v': give points or an impulse"),
    "key twice": (["--limit", "energy peak of v <= 1 with norm 1 with norm 2"], "given twice"),
    "least": (["--minimise", "gain of v <= 3"], "has a limit; give it by --limit"),
    "road": (["--road", "C"], "--road needs --speed V too"),
    "speed": (["--speed", "20"], "--speed needs --road CLASS too"),
    "class": (["--road", "I", "--speed", "20"], "no road class 'I'; known: A, B"),
    "slow": (["--road", "C", "--speed", "0"], "speed [m/s] = 0.0; give a number above zero"),
    "method": (["--method", "slack"], "invalid choice: 'slack'"),
    "degree": (["--method", "quadratic", "--degree", "2"], "--degree belongs to scheduled"),
    "high": (["--degree", "9"], "degree = 9"),
    "region": (["--region", "disc(-40, 31)"], "kind 'disc' is unknown"),
    "figure": (["--plot", "s.txt"], "s.txt: a figure ends in .png, .svg or .pdf"),
    "one file": (["--json", "a", "--plot", "a.png", "-o", "s.png/x"], "cannot be written"),
}  # fmt: skip


@pytest.mark.parametrize("case", WORDS)
def test_bad_options_are_one_line_and_leave_nothing(here, capsys, case):
    words, message = WORDS[case]
    before = sorted(here.rglob("*"))
    assert message in refused(capsys, "optimise", "stage.toml", *words)
    assert sorted(here.rglob("*")) == before


TABLES = {
    "key": ("at_most = 4", "atmost = 4", "specification 3, gain of v: unknown key atmost = 4"),
    "kind": ('"gain"', '"gian"', "specification 3: kind = 'gian' is unknown; did you mean 'gain'?"),
    "signal": ('"force"\ndensity', '"froce"\ndensity', "no signal 'froce'; did you mean 'force'?"),
    "no signal": ('signal = "v"', "", "specification 3: signal is missing"),
    "text": ('signal = "v"', "signal = 2", "specification 3: signal = 2 must be text"),
    "quoted": ("at_most = 4", 'at_most = "4"', "at_most = '4' must be a finite number, without q"),
    "nan": ("at_most = 4", "at_most = nan", "at_most = NaN must be a finite number"),
    "negative": ("at_most = 4", "at_most = -4", "at_most = -4.0 of 'v' must be a positive number"),
    "neither": ("at_most = 4", "", "gain of v: give at_most = LIMIT or minimise = true, one of th"),
    "both": ("at_most = 4", "at_most = 4\nminimise = true", "or minimise = true, one of them"),
    "two": ("at_most = 4", "minimise = true", "minimise = true for rms of x and gain of v"),
    "switch": ("minimise = true", "minimise = 1", "minimise = 1 must be true or false"),
    "no noise": ("density = 2\nat_most", "at_most", "neither density nor a road is given"),
    "density": ("density = 2\nat_most", "density = 0\nat_most", "density = 0.0 must be a positive"),
    "foreign": ("at_most = 4", "at_most = 4\nnorm = 1", "unknown key norm = 1; "),
    "no table": ("[[specification]]", "[specification.a]", "specification must be an array of tab"),
    "road": ("[parameter.k]", "[road]\nclas = 'C'\n[parameter.k]", "road: unknown key clas = 'C'"),
    "slow": ("[parameter.k]", "[road]\nclass = 'C'\nspeed = 0\n[parameter.k]", "road: speed [m/s]"),
    "half a road": ("[parameter.k]", "[road]\nspeed = 9\n[parameter.k]", "road: class is missing"),
    "no road": ("name =", "road = 3\nname =", "road must be a table; write [road]"),
    "no E": ("E = [[0], [1]]", "", "has no E, so no disturbance enters; give E"),
    "filter": ("density = 2\nat_most", "weight = 2\ndensity = 2\nat_most", "weight = 2 must be"),
    "points": ("at_most = 1.5", "points = [1]\nat_most = 1", "unknown key points = a list"),
    "discrete": ("name =", "sample_time = 0\nname =", "sample_time = 0 must be positive"),
    "same twice": ('"rms"\nsignal = "force"\ndensity = 2', '"gain"\nsignal = "v"', "two limits on"),
}  # fmt: skip


@pytest.mark.parametrize("case", TABLES)
def test_bad_tables_are_named_with_their_file(tmp_path, monkeypatch, capsys, case):
    monkeypatch.chdir(tmp_path)
    old, new, message = TABLES[case]
    count = 99 if case == "no table" else 1
    text = (PLANT + ASKED).replace(old, new, count)
    if case == "no table":
        text = text.replace("[specification.a]", "[specification]", 1).replace(
            "[specification.a]", "[specification.b]", 1
        )
    if case == "no E":
        text = text.replace('disturbances = ["shock [m/s2]"]\n', "")
    assert text != PLANT + ASKED
    Path("bad.toml").write_text(text)
    error = refused(capsys, "optimise", "bad.toml", "-o", "out")
    assert message in error
    assert "bad.toml" in error or case in ("discrete", "no E")
    assert not Path("out").exists()


def test_texts_and_tables_say_the_same(tmp_path):
    texts = {
        "rms of x <= 2 with density 0.5": Rms("x", 2.0, 0.5),
        "gain of v <= 1e-2": Gain("v", 0.01),
        "energy peak of out of phase <= 3 with norm 2": EnergyPeak("out of phase", 3.0, 2.0),
        "Initial  peak of v <= .5 with impulse 2": InitialPeak("v", 0.5, (), 2.0),
        "gain of v": Gain("v"),
        "relative rms of x <= 0.9 with density 3": RelativeRms("x", 0.9, 3.0),
        "rms of x <= 1 with weight Wk with density 3": Rms("x", 1.0, 3.0, "Wk"),
    }
    for text, wanted in texts.items():
        assert parse_specification(text) == wanted
    road = RoadSpectrum("C", 20.0)
    assert parse_specification("rms of x", road) == Rms("x", None, road.density)
    assert road.density == pytest.approx((2 * np.pi * 0.1) ** 2 * 256e-6 * 20)
    spec = tmp_path / "s.toml"
    peak = '[[specification]]\nkind = "initial peak"\nsignal = "v"\nat_most = 2\n'
    tables = ASKED.replace("density = 2\nat_most", "at_most") + peak + "points = [[0.1, -1]]\n"
    spec.write_text(PLANT + tables + '[road]\nclass = "b"\nspeed = 10\n')
    least, limits = load_specifications(spec)
    assert least == Rms("x", None, 2.0)
    assert limits == (
        Rms("force", 1.5, RoadSpectrum("B", 10.0).density),
        Gain("v", 4.0),
        InitialPeak("v", 2.0, ((0.1, -1.0),)),
    )
    assert load_specifications(spec, road)[1][0] == Rms("force", 1.5, road.density)
    assert load(spec).name == "stage"  # other commands read the plant as ever
    spec.write_text(PLANT)
    assert load_specifications(spec) == (None, ())
