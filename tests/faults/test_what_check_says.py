"""Files that are genuine but for what no proof is about: `check` says no more than is proved."""

from __future__ import annotations

import json
import re
import shutil
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from polefence import Disk, load, place
from polefence.cli.main import main
from polefence.proof.text import (
    errors_text,
    impulses_text,
    milliseconds_text,
    number_text,
    output_text,
    points_text,
    quoted,
    range_text,
    sum_text,
)
from polefence.region.text import digits_down, digits_up
from support.lmi_alone import lmi_alone

PLANT = """
name = "stage"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["shock [m/s2]", "push [m/s2]"]
region = "half_plane(0.2)"
[parameter.k]
range = [1, 3]
unit = "N/m"
[matrices]
A = [[0, 1], ["-k", -0.1]]
B = [[0], [1]]
E = [[0, 0.1], [1, 0.3]]
"""
ASKED = """
[[specification]]
kind = "rms"
signal = "x"
density = 2
minimise = true
[[specification]]
kind = "initial peak"
signal = "v"
impulse = 5
at_most = 40
[[specification]]
kind = "gain norm"
at_most = 40
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a file of each kind."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch, lmi_alone():
        patch.chdir(folder)
        Path("stage.toml").write_text(PLANT + ASKED)
        Path("gains.json").write_text('{"grid": {"k": [1, 3]}, "gains": [[[-9, -6]], [[-8, -6]]]}')
        for words in (
            ["optimise", "stage.toml", "--method", "scheduled", "-o", "stage"],
            ["design", "stage.toml", "--disk", "-3", "2.5", "-o", "law"],
            ["service", "law", "--decay", "0.25", "-o", "margins"],
            ["analyse", "stage.toml", "--gain", "gains.json", "--region", "half_plane(0.5)",
             "-o", "table"],
            ["export", "law", "--sample-time", "0.001", "-o", "code"],
        ):  # fmt: skip
            assert main(words) == 0, words
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path / "made")
    monkeypatch.chdir(tmp_path / "made")
    return tmp_path / "made"


FILES = ["stage", "law", "margins/gain.json", "margins/rate-k.json", "margins/estimate-k.json",
         "table", "code"]  # fmt: skip


def said_by(capsys, *words):
    capsys.readouterr()
    status = main([str(word) for word in words])
    said = capsys.readouterr()
    return status, said.out + said.err


def edited(path, change):
    document = json.loads(Path(path).read_text())
    change(document)
    Path(path).write_text(json.dumps(document))


@pytest.mark.parametrize("file", FILES)
def test_each_kind_of_file_says_where_the_poles_are(here, capsys, file):
    status, out = said_by(capsys, "check", file)
    assert status == 0
    region = {"stage": "half_plane(0.2)", "table": "half_plane(0.5)"}.get(file, "disk(-3, 2.5)")
    said = "exponential stability, decay rate 0.25 1/s" if "rate" in file else f"poles in {region}"
    assert out.startswith(f"{file}: proved: ")
    assert re.search(rf"{re.escape(said)}(,| with|$)", out, re.M)
    assert "--spec SPEC" in out
    assert re.search(r"^SHA-256 of the file: [0-9a-f]{64}$", out, re.M)
    status, out = said_by(capsys, "check", file, "--spec", "stage.toml")
    assert status == 0
    assert "note:" not in out


def test_a_design_says_region_method_law_and_domain(here, capsys):
    plant = load("stage.toml")
    for method, law, word in (
        ("quadratic", "one gain K", "quadratic"),
        ("scheduled", "K(alpha) = Z W^-1 of degree 1", "scheduled"),
    ):
        place(plant, Disk(-3, 2.75), method).save("d")
        _, out = said_by(capsys, "check", "d")
        domain = "on the simplex of 2 vertices"
        assert f"  poles in disk(-3, 2.75), of A + B K with {law}, {domain}, method {word}\n" in out


def test_names_swapped_in_a_genuine_file_are_seen(here, capsys):
    """The bound on x, told as one on v: the output is written out, and a spec is compared."""
    _, before = said_by(capsys, "check", "stage")
    level = re.search(r"rms of 'x' = x1 <= (\S+) at", before)[1]

    def swap(document):
        plant = document["plant"]
        plant["states"] = plant["states"][::-1]
        document["claims"][1]["name"] = "v"
        document["claims"][2]["name"] = "x"

    edited("stage/design.json", swap)
    shutil.copy("stage/design.json", "swapped.json")
    status, out = said_by(capsys, "check", "swapped.json")
    assert status == 0
    assert f"rms of 'v' = x1 <= {level} at" in out
    status, out = said_by(capsys, "check", "swapped.json", "--spec", "stage.toml")
    assert status == 1
    assert "but NOT about stage.toml: other names: states[1] = 'v [m/s]', spec 'x [m]'" in out


OTHERS = {
    "state": (["states", 0], "x [mm]", "other names: states[1] = 'x [mm]', spec 'x [m]'"),
    "input": (["inputs", 0], "force [kN]", "other names: inputs[1] = 'force [kN]'"),
    "disturbance": (["disturbances", 1], "pull [m/s2]", "other names: disturbances[2] = 'pull"),
    "no names": (["states"], [], "other names: 0 names of states, spec 2"),
    "unit": (["parameters", 0, "unit"], "kN/m", "other units: k in 'kN/m', spec 'N/m'"),
    "label": (["parameters", 0, "label"], "damper", "other names: k is 'damper', spec ''"),
    "range": (["parameters", 0, "range"], [1, 2.5], "other parameter ranges"),
}


@pytest.mark.parametrize("case", OTHERS)
@pytest.mark.parametrize("file", ["stage/design.json", "law/design.json", "table/table.json"])
def test_names_and_units_are_the_specs(here, capsys, case, file):
    keys, value, message = OTHERS[case]
    shutil.copy(file, "copy.json")
    before = said_by(capsys, "check", "copy.json", "--spec", "stage.toml")
    assert before[0] == 0, before

    def change(document):
        table = document["plant"]
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = value

    edited("copy.json", change)
    if case == "range" and "table" in file:
        return  # its cells are of the range
    status, out = said_by(capsys, "check", "copy.json", "--spec", "stage.toml")
    assert status == 1
    assert f"copy.json: but NOT about stage.toml: {message}" in out


def test_the_gain_is_told_in_its_own_numbers(here, capsys):
    """The same claim, measured by other scales: what is printed does not move."""
    _, genuine = said_by(capsys, "check", "margins/gain.json")
    line = next(x for x in genuine.splitlines() if "K off by" in x)

    def rescale(document):
        table = document["claims"][0]
        table["error"] = str(Fraction(table["error"]) * 10**9)
        table["sizes"] = [[str(Fraction(s) / 10**9) for s in row] for row in table["sizes"]]

    edited("margins/gain.json", rescale)
    status, out = said_by(capsys, "check", "margins/gain.json")
    assert status == 0
    assert line in out.splitlines()
    # and it is what the design's own gains bear: over K it is what `service` printed
    by = re.search(r"by up to \[(.*)\], poles", line)[1]
    _, table = said_by(capsys, "service", "law")
    share = float(re.search(r"error of each gain +(\S+)", table)[1])
    K = place(load("stage.toml"), Disk(-3, 2.5), "scheduled").law.gain([[1, 0], [0, 1]])
    rows = [[float(x) for x in row.split()] for row in by.split("; ")]
    assert np.allclose(rows, share * abs(K).max(axis=0), rtol=2e-3)


def test_each_impulse_is_told(here, capsys):
    _, out = said_by(capsys, "check", "stage")
    assert "from an impulse 5 in w1 or an impulse 5 in w2, on the" in out
    edited("stage/design.json", lambda d: d["claims"][2].update(impulses=[5, 0]))
    _, out = said_by(capsys, "check", "stage")
    assert "from an impulse 5 in w1, on the" in out
    edited("stage/design.json", lambda d: d["claims"][2].update(impulses=[0, -0.5]))
    _, out = said_by(capsys, "check", "stage")
    assert "from an impulse 0.5 in w2, on the" in out


def test_initial_states_are_told(here, capsys):
    points = [[1e-3, 0], ["1/3", 2]]
    edited("stage/design.json", lambda d: d["claims"][2].update(points=points))
    _, out = said_by(capsys, "check", "stage")
    assert "from x(0) = (0.001, 0) or (1/3, 2), or from an impulse 5 in w1" in out
    X0 = [[1e-6, 0], [0, "1/16"]]
    own = {"points": [[0, 0.1]] * 30, "ellipsoid": X0}
    edited("stage/design.json", lambda d: d["claims"][2].update(own))
    _, out = said_by(capsys, "check", "stage")
    assert " or 22 more of the file, or from" in out
    assert "x(0)' X0^-1 x(0) <= 1, X0 = diag(1e-06, 0.0625)" in out


def test_two_states_of_one_name_name_neither(here, capsys):
    edited("stage/design.json", lambda d: d["plant"].update(states=["x [m]", "x [m]"]))
    shutil.copy("stage/design.json", "twice.json")
    _, out = said_by(capsys, "check", "twice.json")
    assert "rms of 'x' (as the file defines it) = x1 <= " in out


FORGED = "x' = x2 <= 1e-9 at density 2, on the box"


def test_a_name_does_not_leave_its_quotes(here, capsys):
    edited("stage/design.json", lambda d: d["claims"][1].update(name=FORGED))
    _, out = said_by(capsys, "check", "stage")
    assert f"rms of {quoted(FORGED)} (as the file defines it) = x1 <= " in out
    assert quoted(FORGED)[0] == '"'


def test_a_unit_says_nothing_more(here, capsys):
    forged = "N/m, poles in disk(-9, 1), N/m"
    for file in ("margins/estimate-k.json", "margins/rate-k.json", "table/table.json"):

        def change(document):
            table = document["plant"]
            table["parameters"][0]["unit"] = forged

        edited(file, change)
        _, out = said_by(capsys, "check", file)
        assert f"'{forged}'" in out, file
        assert f" {forged}" not in out


def test_a_decay_is_rounded_down(here, capsys):
    edited("margins/rate-k.json", lambda d: d["claims"][0].update(decay=0.249999999))
    status, out = said_by(capsys, "check", "margins/rate-k.json")
    assert status == 0
    assert "decay rate 0.2499 1/s" in out
    _, out = said_by(capsys, "service", "law", "--decay", "0.249999999")
    assert "with a decay rate of 0.249999999 1/s" in out


def test_ranges_are_told_inwards(here, capsys):
    def widen(document):
        document["plant"]["parameters"][0]["range"] = [
            "1000000049/1000000000",
            2.99999999,
        ]

    edited("margins/estimate-k.json", widen)
    _, out = said_by(capsys, "check", "margins/estimate-k.json")
    assert "k in [1.00001, 2.99999] N/m" in out


def test_an_answer_that_is_not_proved_proves_nothing(here, capsys):
    edited("law/design.json", lambda d: d["claims"][0]["region"].update(radius=1.0))
    edited("stage/design.json", lambda d: d["claims"][1].update(level=1e-3))
    for file in ("law", "stage"):
        status, out = said_by(capsys, "check", file)
        assert status == 1
        claims = [line for line in out.splitlines() if line.startswith("  ")]
        assert claims
        assert all(line.startswith("  claimed, not proved: ") for line in claims)


def test_the_json_has_all_of_it(here, capsys):
    status, out = said_by(capsys, "check", "stage", "--json", "a.json")
    document = json.loads(Path("a.json").read_text())
    assert status == 0
    assert document["sha256"] in out
    assert [f"  {claim}" for claim in document["claims"]] == out.splitlines()[1:5]


# --- numbers and sums -----------------------------------------------------------------------------

F = Fraction


@pytest.mark.parametrize(
    "value", [F(1, 3), F(-1, 3), F(49999999, 10**8), F(2, 7) * 10**9, F(10**400, 7), 0.49999999]
)
@pytest.mark.parametrize("digits", [2, 4, 6])
def test_rounding_goes_one_way(value, digits):
    below, above = digits_down(value, digits), digits_up(value, digits)
    assert F(below) < F(value) < F(above)
    gap = F(above) - F(below)
    assert gap <= abs(F(value)) * F(10) ** (1 - digits)


def test_doubles_that_read_back_are_themselves():
    for value in (0.1, 2.5, 1e-7, 31.0):
        assert float(digits_down(value)) == float(digits_up(value)) == value
        assert digits_down(F(value)) == digits_up(F(value)) == digits_down(value)


def test_sums_read_as_they_are():
    assert sum_text([("x", [F(1), F(0), F(-2)]), ("u", [F(1, 3)])]) == "x1 - 2 x3 + 1/3 u1"
    assert sum_text([("x", [F(-1)]), ("u", [F(0)])]) == "-x1"
    assert sum_text([("x", [F(0)])]) == "0"
    assert sum_text([("x", [F(10**7, 3 * 10**6 + 1)])]) == "~3.33333 x1"
    C = [[[F(1), F(j)]] for j in range(10)]
    text = output_text(C, [[[F(0)]]] * 10)
    assert text.startswith("x1 at vertex 1; x1 + x2 at vertex 2; x1 + 2 x2 at vertex 3; ")
    assert text.endswith("; and what the file has at 2 more")
    assert output_text([[[F(1)]]] * 2, [[[F(0)]]] * 2, ([[F(2)]], [[F(2)]])) == "x1 + 2 w1"


def test_numbers_that_define_are_exact_or_say_that_they_are_not():
    assert number_text(F(0.1)) == "0.1"
    assert number_text(F(1, 3)) == "1/3"
    assert number_text(F("231.12")) == "231.12"
    assert number_text(F("0.49999999")) == "0.49999999"
    assert number_text(F(1, 10**7)) == "1e-07"
    assert number_text(F(123456789, 10**9 + 7)) == "~0.123457"
    assert number_text(F(10**320)).startswith("~")
    assert milliseconds_text(F(0.01)) == "10"
    assert milliseconds_text(F(0.001)) == "1"
    assert milliseconds_text(F(1, 200)) == "5"
    assert milliseconds_text(F(1, 3)) == "~333.333"
    assert milliseconds_text(F(0.010000000001)) != "10"


def test_errors_of_a_gain_are_normal():
    one = errors_text(F(1, 10), (F(2), F(1)), (F(3), F(30)))
    assert one == "K off by S D T for all |D| <= 1, S = diag(1, 0.5), T = diag(0.6, 6)"
    assert errors_text(F(1, 50), (F(10), F(5)), (F(3), F(30))) == one
    matrix = errors_text(F(1, 10), (F(1),), ((F(1), F(2)), (F(0), F(1))))
    assert matrix == "K off by D T for all |D| <= 1, T = 0.1 times [1 2; 0 1]"


def test_what_starts_a_peak():
    assert impulses_text((F(0), F(-2), F(1, 3))) == "an impulse 2 in w2 or an impulse 0.3333 in w3"
    assert points_text([(F(1), F(0))]) == "x(0) = (1, 0)"
    assert range_text("m", "kg", F(231.12), F(346.68)) == "m in [231.12, 346.68] kg"


def test_nothing_is_changed_by_being_looked_at(here, capsys):
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    for file in FILES:
        said_by(capsys, "check", file)
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before


OUTPUTS = PLANT.replace(
    "[matrices]",
    '[outputs]\n"effort [kN]" = {D = [0.001]}\n"rate" = {C = ["-k", -0.1], D = [1], F = [1, 0.3]}\n'
    "[matrices]",
)
ON_OUTPUTS = """
[[specification]]
kind = "rms"
signal = ["effort", "x"]
density = 1
disturbances = {push = 0.5}
minimise = true
[[specification]]
kind = "gain"
signal = ["rate", "x"]
at_most = 90
"""


@pytest.fixture(scope="module")
def with_outputs(tmp_path_factory):
    """A design of a plant that names outputs, with bounds on vectors of them."""
    folder = tmp_path_factory.mktemp("outputs")
    with pytest.MonkeyPatch.context() as patch, lmi_alone():
        patch.chdir(folder)
        Path("rows.toml").write_text(OUTPUTS + ON_OUTPUTS)
        assert main(["optimise", "rows.toml", "--method", "quadratic", "-o", "rows"]) == 0
    return folder


def _smaller(document):
    """The effort counted in MN, by the plant's output and by the claim's."""
    for outputs in (document["plant"]["outputs"], document["claims"][1]["outputs"]):
        outputs[0]["D"] = [[1e-6]]


def _hidden(document):
    """The same, of a file whose plant has no such output."""
    _smaller(document)
    del document["plant"]["outputs"][0]


def _undriven(document):
    """Without the way straight through, which the gain has."""
    document["plant"]["outputs"][1].pop("F")
    document["claims"][2]["outputs"][0].pop("F")


def _added(document):
    """An output that the spec does not have."""
    own = {"name": "ease", "C": [[0, 0]], "D": [[1e-9]]}
    document["plant"]["outputs"].append(own)
    document["claims"][1]["outputs"][0] = own


def _in_other_units(document):
    document["plant"]["outputs"][0]["unit"] = "N"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_smaller, "other signals: 'effort' = 1e-06 u1, spec 0.001 u1"),
        (_hidden, "other signals: 'effort' = 1e-06 u1, spec 0.001 u1"),
        (_undriven, "other signals: 'rate' = -x1 - 0.1 x2 + u1 at vertex 1; "),
        (_added, "other signals: 'ease' is not a signal of the spec"),
        (_in_other_units, "other units: 'effort' in 'N', spec 'kN'"),
    ],
)
def test_outputs_are_the_specs(with_outputs, tmp_path, monkeypatch, capsys, change, message):
    """The plant's own outputs are a file's words as its names are: a spec has others."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(with_outputs, tmp_path, dirs_exist_ok=True)
    assert said_by(capsys, "check", "rows", "--spec", "rows.toml")[0] == 0
    edited("rows/design.json", change)
    assert said_by(capsys, "check", "rows")[0] == 0  # true of what is written out
    status, out = said_by(capsys, "check", "rows", "--spec", "rows.toml")
    assert status == 1
    assert f"rows/design.json: but NOT about rows.toml: {message}" in out


def test_an_output_that_no_claim_is_about_may_be_another(with_outputs, tmp_path, capsys):
    spec = tmp_path / "more.toml"
    spec.write_text((OUTPUTS + ON_OUTPUTS).replace("[outputs]", '[outputs]\n"more" = {C = [1, 1]}'))
    assert said_by(capsys, "check", str(with_outputs / "rows"), "--spec", str(spec))[0] == 0
