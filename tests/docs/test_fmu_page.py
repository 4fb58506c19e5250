"""The page of the FMU: its numbers, and its loop against polefence's own drive."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from polefence.base.errors import InputError
from support.gallery import recorded
from support.needed import need, require
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-fmu.md").read_text()
(SHOWN,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?")
ROW = re.compile(r"(\d+) kg +(\S+) N +(\S+) +(\S+) +(\S+) %")


@pytest.fixture(scope="module")
def example():
    need("cc")
    require([] if find_spec("fmpy") else ["fmpy"])
    return docs_script("fmu")


@pytest.fixture(scope="module")
def ran(example, tmp_path_factory):
    return recorded(
        example, tmp_path_factory.mktemp("page"), ["drives", "found"], ["design", "units"]
    )


def test_the_page_has_what_the_script_prints(ran) -> None:
    words = [re.sub(r"\s+", " ", NUMBER.sub("#", text)) for text in (ran.said, SHOWN)]
    assert words[0] == words[1]
    said, shown = (text.split("load ")[0] for text in (ran.said, SHOWN))
    ours, theirs = (list(map(float, NUMBER.findall(own))) for own in (said, shown))
    share = ours.index(next(x for x in ours if 0 < x < 1e-3))  # of rounding, in two digits
    assert ours.pop(share) == pytest.approx(theirs.pop(share), abs=1.01e-5)
    assert ours == pytest.approx(theirs, rel=1e-2)
    for ours, theirs in zip(*map(ROW.findall, (ran.said, SHOWN)), strict=True):
        *plain, double, single, wrong = map(float, ours)
        *known, first, second, third = map(float, theirs)
        assert plain == pytest.approx(known, rel=1e-2)
        assert wrong == pytest.approx(third, abs=1)
        assert 0.3 < double / first < 3
        assert 0.3 < single / second < 3


def test_unit_and_drive_agree(example, ran) -> None:
    for load, drive in ran.drives.items():
        double, single, wrong = (
            example.off(ran.found[load, kind], drive).max() for kind in example.KINDS
        )
        assert double < 1e-9
        assert 1e-9 < single < 1e-5  # it is the code in float32 that ran
        assert wrong > 0.05
        states, force = drive
        assert np.abs(force).max() > 100
        assert np.all(np.abs(states).max(axis=0) > 0)


def test_a_demand_that_is_not_late_is_another_loop(example, ran, monkeypatch) -> None:
    load = max(ran.drives)
    monkeypatch.setattr(example, "SAMPLING", replace(example.SAMPLING, delay=0))
    assert example.off(ran.found[load, "float64"], example.drive(ran.design, load)).max() > 1e-3


def test_what_is_left_is_of_the_drives_own_steps(example, ran, monkeypatch, tmp_path) -> None:
    """Of order four: twice the step, sixteen times the difference."""
    load = max(ran.drives)
    fine = example.off(ran.found[load, "float64"], ran.drives[load]).max()
    monkeypatch.setattr(example, "FINE", example.FINE // 2)
    with example.Unit(ran.units["float64"], tmp_path) as unit:
        found = example.looped(ran.design.plant, load, unit)
    coarse = example.off(found, example.drive(ran.design, load)).max()
    assert 10 < coarse / fine < 25


def test_the_unit_says_what_the_script_prints(ran, tmp_path) -> None:
    import fmpy

    path = tmp_path / "law.fmu"
    path.write_bytes(ran.units["float64"].files["law_fmi2.fmu"])
    about = fmpy.read_model_description(str(path))
    assert about.fmiVersion == "2.0"
    assert about.description == " ".join(ran.said.split("\nload ")[0].split())
    assert all(unit.proved for unit in ran.units.values())


def test_what_is_missing_is_named(monkeypatch, tmp_path) -> None:
    script = docs_script("fmu")
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(SystemExit, match="pip install fmpy"):
        script.Unit(None, tmp_path)

    def without(*_, **__):
        raise InputError("compiler 'cc' is not found; install gcc")

    monkeypatch.setattr(script.pf.export, "export_c99", lambda *_, **__: None)
    monkeypatch.setattr(script.pf.export, "with_fmus", without)
    with pytest.raises(SystemExit, match="install gcc"):
        script.exported()


def test_the_figure_is_drawn(ran) -> None:
    assert ran.image.stat().st_size > 20_000
