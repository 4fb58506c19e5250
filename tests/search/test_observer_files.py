"""An observer's file is its own kind: checked as one, and refused where a law is wanted."""

import json

import numpy as np
import pytest

from polefence import Disk, analyse, in_service, load, observe, place
from polefence.base.errors import DesignFileError
from polefence.certify.design import Design
from polefence.certify.margins import estimation_error, gain_error, parameter_rate
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.law.laws import given_law
from polefence.response.linear import simulate
from polefence.search.observer import Observer
from polefence.show.report import html_report
from support.commands import ran, refused
from support.drives import drive

SPEC = """
name = "stage"
states = ["place [m]", "speed [m/s]"]
inputs = ["force [N]"]
[parameter.k]
range = [1, 3]
[matrices]
A = [[0, 1], ["-k", "-0.2"]]
B = [[0], [1]]
E = [[0], [1]]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("observer")
    (where / "stage.toml").write_text(SPEC)
    (where / "car.toml").write_text(spec_text("quarter-car-ride"))
    words = ["observe", str(where / "stage.toml"), "--measured", "place", "--disk", "-6", "5.5"]
    assert main([*words, "-o", str(where / "seen")]) == 0
    place(load(where / "stage.toml"), Disk(-3, 2.9)).save(where / "law")
    return where


def test_the_file_says_what_it_is(folder):
    document = json.loads((folder / "seen" / "design.json").read_text())
    assert [claim["kind"] for claim in document["claims"]] == ["observer"]
    law = json.loads((folder / "law" / "design.json").read_text())
    assert [claim["kind"] for claim in law["claims"]] == ["region"]
    assert "law" not in document  # its claim has one: that of the dual plant
    assert document["plant"] == law["plant"]
    dual = Design.load(folder / "seen", observer=True)
    assert dual.certificate.observer
    assert json.loads(dual.certificate.dumps()) == document


@pytest.mark.parametrize(
    "words",
    [
        "service seen",
        "report seen",
        "analyse stage.toml --gain seen --region half_plane(0)",
        "analyse stage.toml --gain seen/design.json --region half_plane(0)",
        "export seen -o out",
        "export seen --lang mat -o out",
        "compare seen",
        "compare car.toml --law seen",
    ],
)
def test_it_is_no_law(folder, capsys, monkeypatch, words):
    monkeypatch.chdir(folder)
    assert "an observer, not a law" in refused(capsys, *words.split())
    assert not (folder / "out").exists()


def test_a_law_is_no_observer(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    assert main(["export", "law", "--observer", "law", "--sample-time", "0.01", "-o", "out"]) == 2
    assert "a law, not an observer" in capsys.readouterr().err


def test_nor_in_python(folder):
    plant = load(folder / "stage.toml")
    dual = observe(plant, ["place"], Disk(-6, 5.5)).design
    with pytest.raises(DesignFileError, match="not a law"):
        given_law(plant, dual)
    with pytest.raises(DesignFileError, match="not a law"):
        Design.load(folder / "seen")
    assert Observer.load(folder / "seen", plant, ["place"]).design.proved


def test_check_says_whose_poles(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    out = ran(capsys, "check", "seen", "--spec", "stage.toml")
    assert "poles in disk(-6, 5.5), of A - L C with -L(alpha)' = Z W^-1 of degree 1" in out
    assert "an observer, measured 'place [m]'" in out
    assert "B K" not in out
    assert "NOT about" not in out


CHANGES = {
    "A[2][2]": SPEC.replace("-0.2", "-0.3"),
    "ranges": SPEC.replace("[1, 3]", "[2, 6]").replace('"-k"', '"-k/2"'),
    "measurements": SPEC.replace("place [m]", "position [m]"),
    "names": SPEC.replace("speed [m/s]", "rate [m/s]"),
    "time": SPEC.replace("[parameter.k]", "sample_time = 0.01\n[parameter.k]"),
    "number or their shapes": SPEC.replace(
        "range = [1, 3]", "range = [1, 3]\n[parameter.c]\nrange = [0, 1]"
    ).replace('"-0.2"', '"-0.2 - c"'),
}


@pytest.mark.parametrize("what", CHANGES)
def test_check_compares_plant_and_measurements(folder, tmp_path, capsys, what):
    spec = tmp_path / "other.toml"
    spec.write_text(CHANGES[what])
    out = ran(capsys, "check", folder / "seen", "--spec", spec, status=1)
    assert f"but NOT about {spec}: other " in out
    if what not in ("measurements",):
        assert what in out


def test_a_signal_under_another_name_is_seen(folder, tmp_path, capsys):
    """The same proof, about what is measured of another state."""
    document = json.loads((folder / "seen" / "design.json").read_text())
    document["claims"][0]["measured"] = ["speed [m/s]"]
    path = tmp_path / "design.json"
    path.write_text(json.dumps(document))
    assert main(["check", str(path), "--spec", str(folder / "stage.toml")]) == 1
    assert "other measurements: C[1] is not 'speed [m/s]' alone" in capsys.readouterr().out


def test_what_is_measured_is_read_with_care(folder, tmp_path, capsys):
    document = json.loads((folder / "seen" / "design.json").read_text())
    claim = document["claims"][0]
    for change, message in (
        ({"C": [[[1]]]}, "is 1 x 1, not 1 x 2"),
        ({"C": [claim["C"][0]] * 3}, "one matrix, or one per vertex"),
        ({"measured": ["a", "b"]}, "must name each row of C"),
        ({"measured": 3}, "must be a list"),
    ):
        path = tmp_path / "design.json"
        path.write_text(json.dumps(document | {"claims": [claim | change]}))
        assert message in refused(capsys, "check", path)


def test_no_function_takes_it_for_a_law(folder):
    """What is said of a law would be false of -L' of the dual plant."""
    plant = load(folder / "stage.toml")
    dual = observe(plant, ["place"], Disk(-6, 5.5)).design
    uses = (
        in_service,
        estimation_error,
        gain_error,
        parameter_rate,
        html_report,
        Design.to_control,
        lambda design: drive(design.plant, design, duration=1.0, start=[1.0, 0.0]),
        lambda design: simulate(
            plant, design, plant.alpha(k=2), np.zeros((9, 1)), 0.1 * np.arange(9)
        ),
        lambda design: analyse(design.plant, design, Disk(-6, 5.5)),
    )
    for use in uses:
        with pytest.raises(DesignFileError, match="an observer, not a law"):
            use(dual)
