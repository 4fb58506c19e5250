"""What is known to be wrong before a proof, or a search, is refused before it."""

from __future__ import annotations

import shlex

import pytest

import polefence as pf
from polefence.certify.certificate import Certificate
from polefence.cli.main import main
from polefence.examples import spec_text
from support.commands import refused


class TooLateError(Exception):
    """Of work that is done before a command refuses."""


def _late(*_, **__):
    raise TooLateError


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("designs") / "car"
    pf.place(pf.examples.family("quarter-car-physical"), pf.HalfPlane(1), "quadratic").save(folder)
    return folder


# Commands about a design, behind which its path stands, and what they say.
OF_DESIGNS = {
    "simulate": "nothing moves the plant",
    "simulate --road Z --speed 3": "no road class 'Z'",
    "simulate --road C --speed 20 --set foo=3": "no parameter 'foo'",
    "simulate --road C --speed 20 --duration -1": "--duration [s] = -1",
    "simulate --initial foo=3": "no state",
    "simulate --road C --speed 20 --plot x.png --signals foo": "no signal 'foo'",
    "export -o code --fixed 16": "--fixed needs the range of",
    "export -o code --limit 0": "limits: 0.0 must be",
    "export -o code --rate 5": "give --sample-time too",
    "export -o code --lang fmu --observer car": "leave out the observer",
    "report --road Z": "no road class 'Z'",
    "report --speed -1": "speed",
    "report -o /proc/car/car.html": "cannot be written",
    "service --decay -1": "decay = -1.0 must be",
    "service --region disk(3,1)": "not in the left half-plane",
    "compare --road Z": "no road class 'Z'",
}


@pytest.mark.parametrize("words", OF_DESIGNS)
def test_before_the_proof_of_a_design(words, saved, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Certificate, "prove", _late)
    command, *options = shlex.split(words)
    assert OF_DESIGNS[words] in refused(capsys, command, saved, *options)
    assert not any(tmp_path.iterdir())


def test_a_compiler_that_is_missing(saved, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(Certificate, "prove", _late)
    monkeypatch.setenv("CC", "no-such-compiler")
    said = refused(capsys, "export", saved, "--lang", "fmu", "-o", tmp_path / "code")
    assert "'no-such-compiler' is not found" in said


@pytest.mark.parametrize("words", ["report", "service", "export -o code"])
def test_what_is_not_refused_is_proved(words, saved, monkeypatch, tmp_path):
    """Else the tests above would see no proof that comes too early."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Certificate, "prove", _late)
    command, *options = shlex.split(words)
    with pytest.raises(TooLateError):
        main([command, str(saved), *options])


OF_SPECS = {
    "--road Z": "no road class 'Z'",
    "--speed -2": "speed",
    "--disk 4 5": "not in the left half-plane",
}


@pytest.mark.parametrize("words", OF_SPECS)
def test_before_the_law_of_a_spec_is_searched(words, capsys, monkeypatch, tmp_path):
    spec = tmp_path / "car.toml"
    spec.write_text(spec_text("quarter-car-ride"))
    monkeypatch.setattr("polefence.search.optimise.optimise", _late)
    assert OF_SPECS[words] in refused(capsys, "compare", spec, *shlex.split(words))
    with pytest.raises(TooLateError):
        main(["compare", str(spec)])


def test_a_sample_time_of_a_design_that_has_one(capsys, monkeypatch, tmp_path):
    plant = pf.at_sample_time(pf.examples.family("quarter-car-physical"), 0.005)
    design = pf.place(plant, pf.HalfPlane(1), "quadratic").save(tmp_path / "car").parent
    monkeypatch.setattr(Certificate, "prove", _late)
    said = refused(capsys, "export", design, "--sample-time", 0.01, "-o", tmp_path / "code")
    assert "leave the sample time out" in said
    said = refused(capsys, "service", design, "--decay", 1)
    assert "in discrete time, where no rates" in said
