"""Designs: placed, saved, loaded, checked; and what happens when the proof fails."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polefence import (
    Design,
    DesignFileError,
    Disk,
    InputError,
    NotProvedError,
    OutputError,
    check,
    place,
    tightest,
)
from polefence.region.text import digits_up
from support.files import rewritten


def test_the_paper_design_keeps_every_sampled_pole_in_the_disk(placed):
    """Theorem 1 at (-40, 31) on the printed vertices: 10,000 random alpha."""
    assert check(placed).proved
    alpha = np.random.default_rng(0).dirichlet(np.ones(4), 10_000)
    assert placed.region.contains(placed.poles(alpha))
    assert placed.region.contains(placed.poles(np.eye(4)))


@pytest.mark.parametrize(("method", "radius"), [("quadratic", "33.644"), ("slack", "33.50")])
def test_fixed_gains_do_not_reach_it_and_the_answer_says_how_far_they_go(
    as_printed, method, radius
):
    with pytest.raises(NotProvedError, match=f"smallest radius found there is {radius}") as no:
        place(as_printed, Disk(-40, 31), method)
    assert check(no.value.best).proved
    unproved = place(as_printed, Disk(-40, 31), method, allow_unproved=True)
    assert not unproved.proved
    assert not check(unproved).proved


def test_a_design_survives_its_file(small_designs, tmp_path):
    for name, design in small_designs.items():
        path = design.save(tmp_path / name)
        again = Design.load(path)
        assert Design.load(tmp_path / name).region == again.region == design.region
        assert again.plant.vertices == design.plant.vertices
        assert np.array_equal(again.law.gain([1, 0, 0]), design.law.gain([1, 0, 0]))
        assert again.certificate.dumps() == design.certificate.dumps()
        assert check(path).proved


def test_a_design_file_runs_the_law_from_physical_parameters(placed, tmp_path):
    law = Design.load(placed.save(tmp_path)).law
    K = law.gain_at(m1=300, beta=2.5)
    assert np.array_equal(K, placed.law.gain(placed.plant.alpha(m1=300, beta=2.5)))


def test_an_unproved_file_is_loaded_only_by_name(small_designs, tmp_path):
    path = small_designs["slack"].save(tmp_path)
    with rewritten(path) as document:
        document["claims"][0]["region"]["radius"] *= 0.99
    with pytest.raises(NotProvedError, match="not proved"):
        Design.load(path)
    assert not Design.load(path, allow_unproved=True).proved


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: d["plant"].pop("name"),
        lambda d: d["plant"]["parameters"].append({"name": "p"}),
        lambda d: d["plant"].update(parameters=3),
        lambda d: d["claims"][0]["region"].update(centre=40.0),
        lambda d: d["plant"].update(states=["x"]),
    ],
)
def test_a_damaged_file_is_named(small_designs, tmp_path, damage):
    path = small_designs["slack"].save(tmp_path)
    with rewritten(path) as document:
        damage(document)
    with pytest.raises(DesignFileError, match=str(path)):
        Design.load(path)


def test_a_missing_file_is_named(tmp_path):
    for call in (Design.load, check):
        with pytest.raises(DesignFileError, match=r"none\.json: cannot be read"):
            call(tmp_path / "none.json")


def test_a_folder_that_cannot_be_written_is_named(small_designs, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        small_designs["slack"].save(tmp_path / "file" / "x")


def test_an_interrupted_write_leaves_the_old_file(small_designs, tmp_path, monkeypatch):
    path = small_designs["slack"].save(tmp_path)
    old = path.read_text()

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OutputError, match="No space left"):
        small_designs["quadratic"].save(tmp_path)
    assert path.read_text() == old
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_an_interrupt_just_after_the_renaming_stays_an_interrupt(
    small_designs, tmp_path, monkeypatch
):
    rename = os.replace

    def interrupted(*arguments):
        rename(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        small_designs["slack"].save(tmp_path)
    monkeypatch.undo()
    assert check(tmp_path).proved
    assert len(list(tmp_path.iterdir())) == 1


def test_wrong_types_are_named(as_printed):
    for call in (
        lambda: place(as_printed, (-40, 31)),
        lambda: place("car.toml", Disk(-40, 31)),
        lambda: tightest("car.toml", -40),
    ):
        with pytest.raises(InputError, match="must be of type"):
            call()


def test_place_at_the_smallest_radius_it_names(make_random):
    """What the message names can be asked for."""
    plant = make_random(4, 2, 1, 3)
    best = tightest(plant, -3, "slack").region.radius
    assert place(plant, Disk(-3, best * 1.0001), "slack").proved


@pytest.mark.parametrize("value", [33.64394489, 29.0, 0.00123456789, 1234567.8, 99.99999])
def test_printed_radii_are_digits_up(value):
    text = digits_up(value)
    assert float(text) >= value * (1 - 1e-15)
    assert float(text) <= value * (1 + 1e-5) + 1


def test_a_design_is_small_and_readable(placed, tmp_path):
    path = placed.save(tmp_path)
    assert path == Path(tmp_path) / "design.json"
    document = json.loads(path.read_text())
    assert document["claims"][0]["region"] == {"kind": "disk", "centre": -40.0, "radius": 31.0}
    assert document["plant"]["vertices"][0]["A"][4] == [1, 0, 0, 0, 0]
    assert path.stat().st_size < 50_000


def test_what_the_checker_does_not_prove_is_not_written(tmp_path, small_designs):
    """A search believes the kernel; what a file says is proved by the checker."""
    design = small_designs["quadratic"]
    smaller = Disk(design.region.centre, design.region.radius / 2)
    wrong = replace(design, certificate=replace(design.certificate, region=smaller))
    assert wrong.proved
    with pytest.raises(NotProvedError, match="its file is not proved: ineq"):
        wrong.save(tmp_path)
    assert not list(tmp_path.iterdir())
    unproved = replace(wrong, proved=False)
    assert unproved.save(tmp_path).exists()
