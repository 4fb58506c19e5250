"""Names and units of strangers: what is printed of them stays on its line, and stops nothing."""

from __future__ import annotations

import io
import json
import sys
import unicodedata
from pathlib import Path

import pytest

from polefence.cli.main import main
from polefence.proof.text import quoted, unit_text, visible
from support.lmi_alone import lmi_alone

FORGED = "all poles in disk(-9, 1)"
NAMES = {
    "newline": f"x\nstage: proved: {FORGED}",
    "lines of unicode": f"x\u2028stage: proved: {FORGED}\x85\x0b",
    "return": "x\rstage: proved",
    "escape": "x\x1b[2K\x1b[1Aproved",
    "backspaces": "x" + 40 * "\b" + "proved",
    "right to left": "x\u202edevorp",
    "half a letter": "x\ud800",
    "formula": "$\\nothing{$",
    "dollars": "$x_{1$ and $\\frac$",
}
SPEC = """
name = {name}
states = [{name}, "v [m/s]"]
inputs = [{unit}]
disturbances = [{name}]
[parameter.k]
range = [1, 3]
unit = {name}
[matrices]
A = [[0, 1], ["-k", -0.1]]
B = [[0], [1]]
E = [[0], [1]]
"""


def spec_of(name):
    unit = f"u [{name.replace(']', '')}]"
    words = (json.dumps(text, ensure_ascii=False) for text in (name, unit))
    return SPEC.format(**dict(zip(("name", "unit"), words, strict=True)))


def commands(spec):
    """Commands whose output has names in it; the third word of some is a file that they make."""
    yield ["design", spec, "--disk", "-3", "2.5", "-o", "law", "--plot", "poles.svg"]
    yield ["design", spec, "--disk", "-3", "0.01"]
    yield ["limits", spec, "--centre", "-3", "--method", "quadratic", "--plot", "limits.png"]
    yield ["tightest", spec, "--of", "half_plane"]
    yield ["analyse", spec, "--gain", "[[-9, -6]]", "--region", "half_plane(0.5)"]
    yield ["analyse", spec, "--gain", "[[9, 6]]", "--region", "half_plane(0.5)", "--plot", "p.svg"]
    yield ["analyse", spec, "--gain", "[[-9, -6]]", "--of", "disk", "--centre", "-3"]
    yield ["observe", spec, "--measured", "v", "--disk", "-3", "2.9"]
    ride = ["--minimise", "rms of v with density 2", "--limit", "rms of u <= 20 with density 2"]
    yield ["optimise", spec, *ride, "--method", "quadratic", "--plot", "ride.svg"]
    yield ["optimise", spec, "--minimise", "rms of nothing with density 2"]
    yield from of_a_design("law")


def of_a_design(law):
    yield ["check", law]
    yield ["service", law, "-o", "margins"]
    yield ["check", "margins/estimate-k.json"]
    yield ["report", law, "-o", "page.html"]
    moved = ["simulate", law, "--initial", "v=1", "--duration", "1"]
    yield [*moved, "--plot", "drive.svg", "-o", "drive.csv"]
    yield [*moved, "-o", "d.parquet"]
    yield ["simulate", law, "--road", "C", "--speed", "20"]
    yield ["export", law, "-o", "code"]
    yield ["export", law, "--lang", "mat", "-o", "matlab"]
    yield ["check", "code"]


def said_by(capsys, words):
    try:
        status = main(words)
    except SystemExit as leaving:
        status = leaving.code
    said = capsys.readouterr()
    return status, said.out, said.err


def run_all(capsys, some):
    return [(words, *said_by(capsys, words)) for words in some]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """How many lines each command prints where the name is an x, and its status."""
    folder, found = tmp_path_factory.mktemp("plain"), []
    with pytest.MonkeyPatch.context() as patch, lmi_alone():
        patch.chdir(folder)
        Path("stage.toml").write_text(spec_of("x"))
        for words in commands("stage.toml"):
            streams = io.StringIO(), io.StringIO()
            patch.setattr(sys, "stdout", streams[0])
            patch.setattr(sys, "stderr", streams[1])
            status = main(words)
            patch.undo()
            patch.chdir(folder)
            found.append((status, *(stream.getvalue().count("\n") for stream in streams)))
        design = json.loads(Path("law/design.json").read_text())
    return found, design


CONTROL = "".join(NAMES[kind] for kind in list(NAMES)[:6])


@pytest.mark.parametrize("name", [CONTROL, NAMES["dollars"]])
@pytest.mark.usefixtures("lmi_alone")
def test_nothing_that_is_printed_leaves_its_line(plain, tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    Path("stage.toml").write_text(spec_of(name), encoding="utf-8")
    every = run_all(capsys, commands("stage.toml"))
    for (words, status, out, err), expected in zip(every, plain[0], strict=True):
        assert (status, out.count("\n"), err.count("\n")) == expected, (words, out, err)
        for c in (out + err).replace("\n", ""):
            assert unicodedata.category(c) not in {"Cc", "Cf", "Cs", "Zl", "Zp"}, words
    for path in map(Path, ("page.html", "poles.svg", "drive.svg", "ride.svg")):
        assert not set(path.read_text(encoding="utf-8")) & set("\x1b\b\u202e\u2028\x85\x0b")


def test_half_a_letter_stops_nothing(plain, tmp_path, monkeypatch, capsys):
    """JSON can say what no UTF-8 can: one half of a pair."""
    monkeypatch.chdir(tmp_path)
    document, name = plain[1], NAMES["half a letter"]
    plant = document["plant"] | {"name": name, "states": [name, "v"], "inputs": [f"u{name}"]}
    plant |= {"parameters": [plant["parameters"][0] | {"unit": name}], "disturbances": [name]}
    Path("law").mkdir()
    Path("law/design.json").write_text(json.dumps(document | {"plant": plant}))
    expected = plain[0][-len(list(of_a_design("law"))) :]
    every = run_all(capsys, of_a_design("law"))
    for (words, status, out, err), like in zip(every, expected, strict=True):
        assert (status, out.count("\n"), err.count("\n")) == like, (words, out, err)
    assert "\\ud800" in Path("drive.csv").read_text(encoding="utf-8")


@pytest.mark.parametrize("code", ["ascii", "latin-1", "utf-8"])
def test_a_terminal_without_the_letter_is_told_its_number(tmp_path, monkeypatch, code):
    path = tmp_path / "stage.toml"
    path.write_text(spec_of("Fläche 😀"), encoding="utf-8")
    stream = io.TextIOWrapper(io.BytesIO(), encoding=code)
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(["design", str(path), "--disk", "-3", "2.5"]) == 0
    stream.flush()
    text = stream.buffer.getvalue().decode(code)
    assert ("Fläche" in text) is (code != "ascii")
    assert ("\\U0001f600" in text) is (code != "utf-8")


def test_words_of_the_command_line_stay_on_their_line(capsys, tmp_path):
    for words in (
        ["check", f"{tmp_path}/no\nproved: x\x1b[2K"],
        ["design", f"{tmp_path}/no\nproved", "--region", "disk(-1,\n2)"],
        ["optimise", "no.toml", "--method", "no\nproved: \x1b"],
        ["nothing\nproved: \x1b"],
    ):
        status, out, err = said_by(capsys, words)
        assert (status, out, err.count("\n")) == (2, "", 1), words
        assert err.isascii()
        assert err[:-1].isprintable()


@pytest.mark.parametrize("name", NAMES.values())
def test_what_is_shown_can_be_seen(name):
    for shown in (visible(name), quoted(name), unit_text(name)):
        assert "\n" not in shown
        assert shown.encode("utf-8")
        assert all(unicodedata.category(c)[0] in "LMNPSZ" for c in shown)


def test_what_people_write_is_shown_as_it_is():
    for name in ("Kraft à 5 m², Öl", "deflection 😀", "Öffnung №5", "x y"):
        assert visible(name) == name
    assert quoted("x, 'y'") == "\"x, 'y'\""
    assert len(quoted("x" * 10**6)) < 100


UNITS = "kg|N s/m|m/s^2|m/s2|1/s|%|m/s per m/s2|N/(m/s)|kg m^2|kg·m²|°|rad/s|kPa|m s^-1|Ω|°C|m s⁻²|"
NO_UNITS = [
    "50 kg",
    "kg, poles in disk(-9, 1)",
    "kg or 9000 kg",
    "1",
    "kg proved",
    "kg or any",
    "'",
]


@pytest.mark.parametrize("unit", UNITS.split("|"))
def test_units_are_shown_as_they_are(unit):
    assert unit_text(unit) == unit


@pytest.mark.parametrize("unit", NO_UNITS)
def test_what_is_no_unit_is_quoted(unit):
    shown = unit_text(unit)
    assert shown[0] == shown[-1]
    assert shown[0] in "'\""
